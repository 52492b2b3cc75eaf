"""A field as quotients of polynomials in states and parameters, and its leading parts along a ray of parameters."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property

import flint
import sympy as sp

from gsp.algebra.functions import are_rational, is_rational_node, require_rules
from gsp.algebra.ring import LocalisedRing, read
from gsp.algebra.ring_elements import RingElement
from gsp.errors import HyperbolicityError
from gsp.scales.triangular_sets import Polynomial, Variables
from gsp.systems.system import VectorField

# A polynomial as the list of its terms.
Terms = list[tuple[tuple[int, ...], flint.fmpq]]
Fraction = tuple[Polynomial, Polynomial]
FractionTerms = tuple[Terms, Terms]


class PolynomialField:
    """The rates and the Jacobian of `field`, exact, with its parameters as variables.

    Functions of states are further variables, with their derivatives. Parameters within functions cannot vanish.
    """

    def __init__(self, field: VectorField) -> None:
        require_rules({f"{state}'": rate for state, rate in field.equations.items()})
        self.field = field
        symbols = tuple(field.parameters)
        self.has_functions = not are_rational(field.rates)
        self.ring = LocalisedRing(
            field.states,
            constants=symbols,
            functions=self.has_functions,
            derivations=len(field.states),
        )
        for j, state in enumerate(field.states):
            self.ring.set_derivative(state, j, self.ring.one)
        zero = {p: self.ring.zero for p, value in field.parameters.items() if value == 0}
        cache: dict = {}
        try:
            rates = [read(rate, self.ring, zero, cache).reduced() for rate in field.rates]
        except HyperbolicityError:
            raise HyperbolicityError("a parameter that is zero stands in a denominator.") from None
        n = range(len(rates))
        jacobian = [[self.ring.derive(rate, j).reduced() for j in n] for rate in rates]
        # What is adjoined comes first in the ring: places are asked for when nothing more will be.
        self.rates = [_terms(e) for e in rates]
        self.jacobian = [[_terms(e) for e in row] for row in jacobian]

    @cached_property
    def places(self) -> dict[sp.Symbol, int]:
        """The generator of each state and parameter."""
        count = len(self.ring.context.gens())
        own = (*self.field.states, *self.field.parameters)
        return {symbol: count - len(own) + i for i, symbol in enumerate(own)}

    @cached_property
    def variables(self) -> Variables:
        """The generators by their roles."""
        places = self.places
        states = tuple(places[s] for s in self.field.states)
        functions = range(min(states))
        kept = [i for p, i in places.items() if p not in self._in_functions and p in self.field.parameters]
        return Variables(frozenset((*functions, *states)), states, tuple(kept))

    @cached_property
    def signs(self) -> Mapping[int, int | None]:
        """The signs of parameters and of functions of positive states, by their generators; None where it depends."""
        signs: dict[int, int | None] = {
            self.places[p]: -1 if value < 0 else 1 for p, value in self.field.parameters.items()
        }
        known = {s: sp.Dummy(positive=True) for s in self.field.states}
        known |= {
            p: sp.Dummy(real=True, negative=value < 0, zero=value == 0)
            for p, value in self.field.parameters.items()
        }
        for i, function in self.functions.items():
            told = function.xreplace(known)
            signs[i] = 1 if told.is_positive else -1 if told.is_negative else None
        return signs

    @cached_property
    def functions(self) -> Mapping[int, sp.Expr]:
        """The functions of states among the generators."""
        context, count = self.ring.context, min(self.places.values()) if self.has_functions else 0
        return {i: self.ring.to_sympy(RingElement(self.ring, context.gen(i), ())) for i in range(count)}

    @cached_property
    def _in_functions(self) -> set[sp.Symbol]:
        found: set[sp.Symbol] = set()
        for rate in self.field.rates:
            for piece in sp.preorder_traversal(rate):
                if not is_rational_node(piece):
                    found |= piece.free_symbols
        return found

    @cached_property
    def may_vanish(self) -> tuple[sp.Symbol, ...]:
        """Parameters that are not zero already and stand in no function."""
        present = set().union(*(rate.free_symbols for rate in self.field.rates))
        return tuple(
            p
            for p, value in self.field.parameters.items()
            if p in present and value != 0 and p not in self._in_functions
        )


class Ray:
    """F(x, p) with epsilon p* in place of each p that vanishes: F = (F_0 + epsilon F_1 + ...) / epsilon^k, k = 0 or 1.

    `layer` is F_0, `drift` F_1 where F_0 = 0, and `jacobian` D F_0, as fractions. None of them where k is another.
    """

    def __init__(self, whole: PolynomialField, vanishing: Iterable[sp.Symbol]) -> None:
        self._small = tuple(whole.places[p] for p in vanishing)
        rates = [_along(f, self._small) for f in whole.rates]
        orders = [top[0][0] - below[0][0] for top, below in rates if top]
        self.order = -min(orders, default=1)
        self.is_special = self.order in (0, 1)
        if not self.is_special:
            return
        context = whole.ring.context
        self.layer = [_part(context, parts, -self.order) for parts in rates]
        self.drift = [_drift(context, parts, -self.order) for parts in rates]
        self._jacobian = whole.jacobian
        self._context = context

    @cached_property
    def jacobian(self) -> list[list[Fraction]]:
        """D F_0 (n, n)."""
        return [
            [_part(self._context, _along(entry, self._small), -self.order) for entry in row]
            for row in self._jacobian
        ]


Parts = list[tuple[int, Terms]]


def _along(fraction: FractionTerms, small: Sequence[int]) -> tuple[Parts, Parts]:
    """Numerator and denominator by powers of epsilon, lowest first; none of a numerator that is zero."""
    return _by_degree(fraction[0], small), _by_degree(fraction[1], small)


def _by_degree(terms: Terms, small: Sequence[int]) -> Parts:
    rows: dict[int, Terms] = {}
    for powers, c in terms:
        rows.setdefault(sum([powers[i] for i in small]), []).append((powers, c))
    return sorted(rows.items())


def _part(context, parts: tuple[Parts, Parts], order: int) -> Fraction:
    """The coefficient of epsilon^order where nothing of a lower order is there."""
    top, below = parts
    if not top or top[0][0] - below[0][0] != order:
        return context.constant(0), context.constant(1)
    return _lowest(context.from_dict(dict(top[0][1])), context.from_dict(dict(below[0][1])))


def _drift(context, parts: tuple[Parts, Parts], order: int) -> Fraction:
    """The next coefficient, where the one of epsilon^order vanishes."""
    top, below = parts
    following = [terms for k, terms in top if k - below[0][0] == order + 1]
    if not following:
        return context.constant(0), context.constant(1)
    return _lowest(context.from_dict(dict(following[0])), context.from_dict(dict(below[0][1])))


def _lowest(top: Polynomial, below: Polynomial) -> Fraction:
    if below.is_constant():
        return top * (1 / flint.fmpq(below.leading_coefficient())), below.context().constant(1)
    common = top.gcd(below)
    return top / common, below / common


def _terms(element: RingElement) -> FractionTerms:
    ring = element.ring
    below = ring.context.constant(1)
    for i, exponent in enumerate(element.exponents):
        below = below * ring.denominator_power(i, exponent) if exponent else below
    top, under = ([(tuple(map(int, k)), c) for k, c in p.terms()] for p in (element.numerator, below))
    return top, under
