"""Exact algebra: a polynomial ring localised at a few denominators, with derivations.

Elements are N / (D_1^e_1 ... D_k^e_k) with N in QQ[generators] and the D_i irreducible. The D_i are few and
known (the factors of det g_y and of the denominators in f and g), so sums and products need no greatest
common divisor; a common factor is divided out only when asked for. Functions such as exp(u) are adjoined as
generators E with their derivative D E = E D u.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from types import MappingProxyType
from typing import Any

import flint
import sympy as sp

from gsp.algebra.factorisation import MULTIPLE
from gsp.algebra.functions import COMPOSED, CONSTANTS, RULES, composed, is_rational_node, parts
from gsp.algebra.polynomials import (
    FACTOR_TERMS,
    horner_expression,
    polynomial_expression,
    primitive_multiple,
    rational,
    reach,
)
from gsp.algebra.ring_elements import RingElement, exponents_sum, number_of, power
from gsp.errors import BudgetError

# Room for this many functions at first, doubled when it is used up; every generator lengthens all monomials.
FIRST_ROOM = 4
# Products of terms in one multiplication or division, and in all that a ring ever does: the first bounds the memory of
# one product, the second the work.
PRODUCT = 20_000_000
BUDGET = 200_000_000
# Terms of all sums and products that a ring ever forms: no more can be in memory at once. Results up to `SHORT` terms
# do not count, of which a series of order 60 forms thousands.
TERMS = 4_000_000
SHORT = 1_000
# Numerators with more terms are not factored, as they have to be to become denominators.
DENOMINATOR_TERMS = 10_000


class LocalisedRing:
    """QQ[coordinates, parameters, adjoined functions] localised at irreducible denominators.

    `functions` says that functions are to be adjoined (`gsp.algebra.functions.are_rational` tells); how many need not
    be known. Polynomials are in v - c for coordinates v with one of the `centres` c, about which their powers do not
    cancel. `derivations` is the number of derivations; they are zero on `constants`, and the image of a coordinate
    under each is given by `set_derivative`.
    """

    def __init__(
        self,
        coordinates: Sequence[sp.Symbol],
        *,
        constants: Sequence[sp.Symbol] = (),
        functions: bool = False,
        derivations: int = 0,
        centres: Mapping[sp.Symbol, sp.Rational] = MappingProxyType({}),
    ) -> None:
        symbols = (*coordinates, *constants)
        self._names = [f"g{i}" for i in range(len(symbols))]
        self._room = 0
        self._centres = centres
        self._meaning: list[sp.Expr] = [symbol - centres.get(symbol, 0) for symbol in symbols]
        self.relations: list[flint.fmpq_mpoly] = []
        self.roots: list[tuple[flint.fmpq_mpoly, Callable[[], RingElement]]] = []
        # sign(u) and u, which are shown as |u| where they are multiplied.
        self._distances: list[tuple[flint.fmpq_mpoly, flint.fmpq_mpoly]] = []
        self._adjoined_count = 0
        self.denominators: list[flint.fmpq_mpoly] = []
        self._powers: list[list[flint.fmpq_mpoly]] = []
        # Generators are counted from the back, as negative numbers: room for more is made at the front.
        self._index = {symbol: i - len(symbols) for i, symbol in enumerate(symbols)}
        self._adjoined: dict[tuple, RingElement] = {}
        # u and exp(u).
        self._exponentials: list[tuple[RingElement, RingElement]] = []
        self.derivations = derivations
        # How large symbols are where elements are evaluated, in powers of 2, as far as that is known.
        self.sizes: dict[sp.Symbol, int] = {}
        self._derivatives: list[dict[int, RingElement]] = [{} for _ in range(derivations)]
        self._pending: dict[int, tuple[str, RingElement, RingElement | None]] = {}
        self._constant = {self._index[symbol] for symbol in constants}
        self.spent = 0
        self.terms = 0
        self._make_room(FIRST_ROOM if functions else 0)
        self.zero = RingElement(self, self.context.constant(0), ())
        self.one = RingElement(self, self.context.constant(1), ())

    def _make_room(self, more: int) -> None:
        """Let `more` functions be adjoined; elements follow when they are next used."""
        # What is adjoined later comes first in the ordering, so that in q^2 - u the power of q leads even when u
        # contains functions itself. The names stay, and with them the keys of elements.
        first = self._room
        self._names = [f"a{i}" for i in reversed(range(first, first + more))] + self._names
        self._meaning = [sp.nan] * more + self._meaning
        self._room += more
        # Lexicographic with the adjoined functions first when there are any: division by a relation such as
        # s^2 + c^2 - 1 or q^2 - u then lowers the power of s or q, whatever the degree of u.
        ordering = flint.Ordering.lex if self._room else flint.Ordering.degrevlex
        self.context = flint.fmpq_mpoly_ctx.get(self._names, ordering)
        self._gens = self.context.gens()

        def moved(polynomial: flint.fmpq_mpoly) -> flint.fmpq_mpoly:
            return polynomial.project_to_context(self.context)

        self.relations = [moved(p) for p in self.relations]
        self.roots = [(moved(v), reciprocal) for v, reciprocal in self.roots]
        self._distances = [(moved(sign), moved(u)) for sign, u in self._distances]
        self.denominators = [moved(p) for p in self.denominators]
        self._powers = [[moved(p) for p in powers] for powers in self._powers]

    # -- denominators ------------------------------------------------------------------------------

    def denominator_index(self, factor: flint.fmpq_mpoly) -> tuple[int, flint.fmpq]:
        """Index of the monic irreducible `factor` among the denominators, appended when it is new, and their quotient.

        A denominator from before the first function was adjoined is monic in the ordering of that time.
        """
        for i, known in enumerate(self.denominators):
            leading = known.leading_coefficient()
            if known == (factor if leading == 1 else factor * leading):
                return i, leading
        self.denominators.append(factor)
        self._powers.append([self.one.numerator, factor])
        return len(self.denominators) - 1, flint.fmpq(1)

    def denominator_power(self, i: int, exponent: int) -> flint.fmpq_mpoly:
        """D_i to a power, remembered."""
        powers = self._powers[i]
        while len(powers) <= exponent:
            powers.append(self.product(powers[-1], powers[1]))
        return powers[exponent]

    # -- the budget --------------------------------------------------------------------------------

    @property
    def spending(self) -> tuple[int, int]:
        """What was spent so far; what an attempt took that came to nothing is given back by setting it."""
        return self.spent, self.terms

    @spending.setter
    def spending(self, before: tuple[int, int]) -> None:
        self.spent, self.terms = before

    @contextmanager
    def afresh(self, share: float = 1.0) -> Iterator[None]:
        """A block with a `share` of the budget of its own, so that what was done before it does not matter."""
        before, self.spending = self.spending, (round((1.0 - share) * BUDGET), round((1.0 - share) * TERMS))
        try:
            yield
        finally:
            self.spending = before

    def product(self, a: flint.fmpq_mpoly, b: flint.fmpq_mpoly) -> flint.fmpq_mpoly:
        """a b, within the budget."""
        self.spend(a, b)
        return self.formed(a * b)

    def formed(self, result: flint.fmpq_mpoly) -> flint.fmpq_mpoly:
        """`result`, its terms counted; raises `BudgetError` when all results together have too many."""
        if len(result) > SHORT:
            self.terms += len(result)
        if self.terms > TERMS:
            raise BudgetError(
                f"the exact algebra formed a polynomial of {len(result):,} terms, and {self.terms:,} with all that "
                f"came before; at most {TERMS:,} are formed.",
                limit=TERMS,
                value=self.terms,
            )
        return result

    def require_factorable(self, polynomial: flint.fmpq_mpoly) -> None:
        """Raises `BudgetError` when `polynomial` has too many terms to be factored."""
        if len(polynomial) > DENOMINATOR_TERMS:
            raise BudgetError(
                f"the exact algebra met a denominator of {len(polynomial):,} terms; at most {DENOMINATOR_TERMS:,} are "
                "factored.",
                limit=DENOMINATOR_TERMS,
                value=len(polynomial),
            )

    def spend(self, a: flint.fmpq_mpoly, b: flint.fmpq_mpoly) -> None:
        """Count the products of terms that a b, or a division of a by b, takes at most.

        Raises `BudgetError` when they are too many.
        """
        count = len(a) * len(b)
        self.spent += count
        if count > PRODUCT or self.spent > BUDGET:
            raise BudgetError(
                f"the exact algebra met polynomials of {len(a):,} and {len(b):,} terms, after {self.spent - count:,} "
                f"products of terms; at most {PRODUCT:,} are formed in one step and {BUDGET:,} in all.",
                limit=PRODUCT if count > PRODUCT else BUDGET,
                value=count if count > PRODUCT else self.spent,
            )

    # -- generators and derivations ----------------------------------------------------------------

    def generator(self, symbol: sp.Symbol) -> RingElement:
        """The element of a declared symbol."""
        found = RingElement(self, self._gens[self._index[symbol]], ())
        return found + self.constant(self._centres[symbol]) if symbol in self._centres else found

    def constant(self, value: sp.Rational | int) -> RingElement:
        """A rational number as an element."""
        exact = sp.Rational(value)
        return RingElement(self, self.context.constant(1) * flint.fmpq(int(exact.p), int(exact.q)), ())

    def set_derivative(self, symbol: sp.Symbol, j: int, image: RingElement) -> None:
        """Let derivation j map the generator of `symbol` to `image`; the default is 0."""
        self._derivatives[j][self._index[symbol]] = image

    def derive(self, a: RingElement, j: int) -> RingElement:
        """Derivation j of an element: D(N/D^e) = (D N)/D^e - sum_i e_i N (D D_i)/(D_i D^e)."""
        result = self._derive_polynomial(a.numerator, j)
        result = RingElement(self, result.numerator, exponents_sum(result.exponents, a.exponents))
        for i, exponent in enumerate(a.exponents):
            if exponent:
                inner = self._derive_polynomial(self.denominators[i], j)
                if not inner.is_zero:
                    one = tuple(int(k == i) for k in range(i + 1))
                    exponents = exponents_sum(exponents_sum(a.exponents, inner.exponents), one)
                    product = self.product(a.numerator, inner.numerator) * exponent
                    result = result - RingElement(self, product, exponents)
        return result

    def _derive_polynomial(self, polynomial: flint.fmpq_mpoly, j: int) -> RingElement:
        total = self.zero
        degrees = polynomial.degrees()
        for i in [i for i in self._pending if degrees[i] > 0]:
            if i in self._pending:
                self._settle(i)
        if polynomial.context() is not self.context:
            polynomial = polynomial.project_to_context(self.context)
            degrees = polynomial.degrees()
        for i, image in self._derivatives[j].items():
            if degrees[i] > 0 and (partial := polynomial.derivative(i)) != 0:
                total = total + RingElement(self, self.product(partial, image.numerator), image.exponents)
        return total

    # -- adjoined functions ------------------------------------------------------------------------

    def adjoin(self, name: str, u: RingElement, exponent: RingElement | None = None) -> RingElement:
        """The generator for the function `name` of `u` (u^exponent for "pow"), made once per argument."""
        identity = (name, *u.key, *(exponent.key if exponent else ()))
        if identity in self._adjoined:
            return self._adjoined[identity]
        if name == "exp":
            # exp(2 u) is a power of exp(u), so that the two are not independent.
            for v, known in self._exponentials:
                multiple = _multiple(u, v)
                if multiple is not None:
                    return power(known, multiple)
        if self._adjoined_count == self._room:
            self._make_room(max(self._room, FIRST_ROOM))
        self._adjoined_count += 1
        i = -len(self._index) - self._adjoined_count
        argument = self.to_sympy(u)
        if name in CONSTANTS:
            self._meaning[i] = CONSTANTS[name]
        elif exponent is not None:
            self._meaning[i] = argument ** self.to_sympy(exponent)
        else:
            self._meaning[i] = getattr(sp, name)(argument)
        element = RingElement(self, self._gens[i], ())
        self._adjoined[identity] = element
        if name == "exp":
            self._exponentials.append((u, element))
        self._relate(name, element, u, exponent)
        if name in CONSTANTS or self.is_constant(u):
            self._constant.add(i)
        else:
            # Its derivative waits until it is asked for: sine and cosine refer to one another, and the
            # derivatives of implicit coordinates are found from expressions that contain such functions.
            self._pending[i] = (name, u, exponent)
        return element

    def _relate(self, name: str, element: RingElement, u: RingElement, exponent: RingElement | None) -> None:
        """Record the algebraic relations that keep representations short: q^n = u, s^2 + c^2 = 1, sign^2 = 1."""
        v = element.numerator
        if name == "sign":
            self.relations.append(v * v - 1)
            self.roots.append((v, partial(power, element, 1)))
            if not any(u.exponents):
                self._distances.append((v, u.numerator))
            return
        for sine, cosine, sign in (("sin", "cos", 1), ("sinh", "cosh", -1)):
            if name in (sine, cosine) and {(sine, *u.key), (cosine, *u.key)} <= set(self._adjoined):
                s, c = self._adjoined[sine, *u.key].numerator, self._adjoined[cosine, *u.key].numerator
                self.relations.append(c * c + sign * s * s - 1)
        number = None if exponent is None else number_of(exponent)
        degree = 2 if name == "sqrt" else (int(number.q) if number is not None else 0)
        # Roots of fractions are left alone: clearing the denominator under a root can change its sign.
        if degree and not any(u.exponents):
            self.relations.append(v**degree - u.numerator)
            self.roots.append((v, partial(_reciprocal, element, degree, u)))

    def is_constant(self, a: RingElement) -> bool:
        """Whether every derivation vanishes on `a` because it contains constants only."""
        return self._in_constants(a.numerator) and all(
            self._in_constants(self.denominators[i]) for i, exponent in enumerate(a.exponents) if exponent
        )

    def _in_constants(self, polynomial: flint.fmpq_mpoly) -> bool:
        degrees = polynomial.degrees()
        return all(i - len(degrees) in self._constant for i, degree in enumerate(degrees) if degree > 0)

    def _settle(self, i: int) -> None:
        """Form the derivatives of an adjoined function: D F(u) = rate(F, u) D u."""
        name, u, exponent = self._pending.pop(i)
        rate = RULES[name].rate if exponent is None else (lambda v, u: exponent * v * u.inverse())
        if rate is None:
            return
        slope = rate(RingElement(self, self._gens[i], ()), u)
        for j in range(self.derivations):
            self._derivatives[j][i] = (slope * self.derive(u, j)).reduced()

    # -- back to SymPy -----------------------------------------------------------------------------

    def to_sympy(self, a: RingElement, *, factored: bool = True) -> sp.Expr:
        """The element as a SymPy expression, numerator factored when short, denominators as powers."""
        if a.is_zero:
            return sp.Integer(0)
        scale = sp.Integer(1)
        beside = [self.denominators[i] for i, exponent in enumerate(a.exponents) if exponent]
        if factored and len(a.numerator) <= FACTOR_TERMS:
            content, factors = a.numerator.factor()
            scale = rational(content)
            powers = [(p, int(k)) for p, k in factors]
            distances = []
            for sign, u in self._distances:
                present = [p for p, _ in powers]
                other = next((p for p in present if p == u or p == -u), None)
                if sign in present and other is not None:
                    powers = [(p, k - int(p in (sign, other))) for p, k in powers]
                    scale = scale if other == u else -scale
                    distances.append(sp.Abs(polynomial_expression(u, self._meaning)))
            written = [polynomial_expression(p, self._meaning, beside) ** k for p, k in powers]
            numerator = sp.Mul(*distances, *written)
        else:
            numerator = polynomial_expression(a.numerator, self._meaning, beside)
        denominator = []
        for i, exponent in enumerate(a.exponents):
            if exponent:
                # Integer coefficients read better: 1/(x + 1/2) is shown as 2/(2 x + 1).
                primitive, lift = primitive_multiple(self.denominators[i])
                denominator.append(polynomial_expression(primitive, self._meaning) ** (-exponent))
                scale = scale * lift**exponent
        return scale * sp.Mul(numerator, *denominator)

    def horner(self, a: RingElement) -> sp.Expr:
        """The element for evaluation: numerator in Horner form, denominators kept factored; symbols over their `sizes`
        where powers of them would come near the ends of the doubles' range."""
        powers = [(self.denominators[i], exponent) for i, exponent in enumerate(a.exponents) if exponent]
        beside = [p for p, _ in powers]
        sizes = [self.sizes.get(symbol, 0) for symbol in self._meaning]
        if any(sizes) and not a.is_zero:
            reaches = [(reach(p, sizes), exponent) for p, exponent in [(a.numerator, 1), *powers]]
            # Elements reach no further from 1 than this power of 2 where they are evaluated: a derivative,
            # which squares denominators, times another stays within the doubles' 2^1022 then.
            if max(furthest * exponent for (_, furthest), exponent in reaches) > 256:
                size, below = 0, []
                for (p, exponent), ((largest, _), _) in zip(powers, reaches[1:]):
                    size += largest * exponent
                    below.append(horner_expression(p, self._meaning, sizes, largest) ** -exponent)
                return sp.Mul(horner_expression(a.numerator, self._meaning, sizes, size, beside), *below)
        below = [polynomial_expression(p, self._meaning, beside) ** -exponent for p, exponent in powers]
        return sp.Mul(horner_expression(a.numerator, self._meaning, beside=beside), *below)


def read(expression: sp.Expr, ring: Any, environment: dict[sp.Symbol, Any], cache: dict | None = None) -> Any:
    """The element of a SymPy expression, symbols looked up in `environment` first, then in the ring, of either kind."""
    cache = {} if cache is None else cache
    if expression in cache:
        return cache[expression]
    if isinstance(expression, sp.Symbol):
        value = environment[expression] if expression in environment else ring.generator(expression)
    elif expression.is_Rational:
        value = ring.constant(expression)
    elif expression.is_Add:
        value = ring.zero
        for part in expression.args:
            value = value + read(part, ring, environment, cache)
    elif expression.is_Mul:
        value = ring.one
        for part in expression.args:
            value = value * read(part, ring, environment, cache)
    elif is_rational_node(expression):
        value = power(read(expression.base, ring, environment, cache), int(expression.exp))
    else:
        name, operands = parts(expression)
        inner = [read(operand, ring, environment, cache) for operand in operands]
        if name in COMPOSED:
            value = composed(name, inner)
        else:
            value = inner[0].apply(name, *inner[1:]) if inner else ring.zero.apply(name)
    cache[expression] = value
    return value


def _multiple(u: RingElement, v: RingElement) -> int | None:
    """k where u = k v with a small whole number k, both in lowest terms; else None."""
    if u.exponents != v.exponents or len(u.numerator) != len(v.numerator):
        return None
    ratio = flint.fmpq(u.numerator.leading_coefficient()) / flint.fmpq(v.numerator.leading_coefficient())
    if ratio.q != 1 or abs(ratio.p) > MULTIPLE or u.numerator != v.numerator * ratio:
        return None
    return int(ratio.p)


def _reciprocal(root: RingElement, degree: int, u: RingElement) -> RingElement:
    """1 / q for the root q of degree n of u: q^(n-1) / u."""
    return power(root, degree - 1) * u.inverse()
