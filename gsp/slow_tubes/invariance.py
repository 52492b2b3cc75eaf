"""The flow about a slow manifold's series, exactly: what the series leaves over, divided by its power of epsilon.

With y = h_0 + ... + epsilon^n h_n + epsilon^(n+1) P(x) z, a system x' = f, epsilon y' = g becomes

    x' = f(x, y, epsilon),    epsilon z' = Gamma(x, z, epsilon) = P^-1 (g - epsilon D_x y f) / epsilon^(n+1) .

The division is exact, in the ring of rational functions: the lower coefficients vanish for the right h_k and for no
others. rho = Gamma(x, 0, epsilon) is the residual. To subtract the balls of two terms that agree through epsilon^n
would lose all of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import sympy as sp
from flint import arb

from gsp.algebra.factorisation import exponentials
from gsp.algebra.functions import are_rational, is_rational_node
from gsp.algebra.ring import LocalisedRing, read
from gsp.algebra.ring_elements import RingElement, power
from gsp.errors import UnsupportedFunctionError
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.verdict import ProofVerdict
from gsp.slow.coordinates import dot, invert
from gsp.slow.series import SeriesManifold
from gsp.slow_tubes.series_function import SeriesFunction


class NotInvariantError(ValueError):
    """A coefficient of epsilon^`order`, `left` as a function of x and z, does not cancel in the invariance equation.

    Without functions it is not 0, and the series is wrong. With some it may be 0 and not be seen to: the ring takes
    exp(x) and log(exp(x) + 1), say, for independent of one another.
    """

    def __init__(self, order: int, left: sp.Expr, x: Sequence[sp.Symbol], z: Sequence[sp.Symbol]) -> None:
        super().__init__(order)
        self.order, self.left, self.x, self.z = order, left, x, z

    def is_proved(self, points: Iterable[Sequence[arb]]) -> bool:
        """Whether the coefficient is proved not to be 0: all over, or at one of the `points` (n,)."""
        if are_rational([self.left]):
            return self.left != 0
        left = BallFunction((*self.x, *self.z), [self.left])
        values = (left([*point, *[arb(0)] * len(self.z)])[0] for point in points)
        return any(value > 0 or value < 0 for value in values)

    def verdict_at(self, small: sp.Symbol, points: Iterable[Sequence[arb]]) -> tuple[ProofVerdict, str]:
        """The verdict, and the reason for it."""
        left = f"a term in {small}^{self.order} is left over"
        if self.is_proved(points):
            return ProofVerdict.REFUTED, f"the series does not solve the invariance equation: {left}"
        return ProofVerdict.UNDECIDED, f"the residual of the series is not formed: {left} that may be 0"


@dataclass(frozen=True, eq=False)
class Smooth:
    """Values over balls, and how they change along a direction."""

    values: BallFunction
    series: SeriesFunction

    def along(self, point: Sequence[arb], direction: Sequence[arb]) -> list[arb]:
        """The derivatives along `direction`, over the balls `point`."""
        return [row[1] for row in self.series([[p, d] for p, d in zip(point, direction)], 2)]


class Invariance:
    """Gamma and f about `series`, over x (n,), z (m,) and epsilon, and their derivatives, as functions of balls.

    The first `slow` of the symbols `x` are the slow variables, the others parameters that stand for intervals;
    `values` are those of all other parameters. `basis` is P (m, m), rational in x. Every function takes the balls
    (*x, *z, epsilon), those at z = 0 the balls (*x, epsilon).

    Raises `NotInvariantError`, and `UnsupportedFunctionError` for what is not rational in y and epsilon.
    """

    def __init__(
        self,
        series: SeriesManifold,
        *,
        parameters: Sequence[sp.Symbol] = (),
        values: dict[sp.Symbol, sp.Expr],
        basis: sp.Matrix | None = None,
    ) -> None:
        system = series.branch.system
        self.order = series.order
        self.epsilon = system.epsilon
        self.x = (*system.x, *parameters)
        self.slow, self.n, self.m = len(system.x), len(self.x), len(system.y)
        self.z = tuple(sp.Dummy(f"z{i}") for i in range(self.m))
        self.basis = sp.eye(self.m) if basis is None else basis
        f, g = ([e.xreplace(values) for e in rates] for rates in (system.f, system.g))
        h = [[e.xreplace(values) for e in row] for row in series.coefficients]
        _require_rational([*f, *g], (*system.y, system.epsilon))
        every = [*f, *g, *(e for row in h for e in row), *self.basis]
        self._ring = LocalisedRing(
            (*self.x, *self.z, system.epsilon),
            functions=not are_rational(every),
            derivations=self.n + self.m + 1,
            centres={s: c for s, c in series.chart.centres.items() if s in self.x},
        )
        for j, symbol in enumerate((*self.x, *self.z, system.epsilon)):
            self._ring.set_derivative(symbol, j, self._ring.one)
        for exponential in exponentials(every):
            self._read(exponential)
        self._P = [[self._read(self.basis[i, j]) for j in range(self.m)] for i in range(self.m)]
        terms = [self._ring.zero] * self.m
        for k, row in enumerate(h):
            terms = [t + self._read(e) * self._small(k) for t, e in zip(terms, row)]
        z = [self._ring.generator(s) for s in self.z]
        turned = [dot(row, z, self._ring) for row in self._P]
        self._f, self._gamma = self._flow(
            system.y, f, g, [t + self._small(self.order + 1) * p for t, p in zip(terms, turned)]
        )
        self._f0, self._rho = self._flow(system.y, f, g, terms)
        self._graph = terms
        self._reduced = [self._ring.zero] * self.slow
        for k, row in enumerate(series.reduced_field):
            self._reduced = [
                t + self._read(e.xreplace(values)) * self._small(k) for t, e in zip(self._reduced, row)
            ]

    # -- the ring ----------------------------------------------------------------------------------

    def _read(self, expression: sp.Expr) -> RingElement:
        return read(expression, self._ring, {})

    def _small(self, exponent: int) -> RingElement:
        return power(self._ring.generator(self.epsilon), exponent)

    def _flow(
        self, symbols: Sequence[sp.Symbol], f: list[sp.Expr], g: list[sp.Expr], y: list[RingElement]
    ) -> tuple[list[RingElement], list[RingElement]]:
        """f (slow,) and Gamma (m,) where the fast variables are `y`."""
        ring, at = self._ring, dict(zip(symbols, y))
        cache: dict = {}
        rates = [read(e, ring, at, cache).reduced() for e in f]
        defects = []
        for i, e in enumerate(g):
            slopes = [ring.derive(y[i], j) for j in range(self.slow)]
            left = read(e, ring, at, cache) - self._small(1) * dot(slopes, rates, ring)
            defects.append(self._divided(left.reduced()))
        inverse = invert(self._P, ring)
        return rates, [dot(row, defects, ring).reduced() for row in inverse]

    def _divided(self, element: RingElement) -> RingElement:
        """The element over epsilon^(n+1), or `NotInvariantError`."""
        numerator = element.numerator
        one = self._small(1).numerator
        for order in range(self.order + 1):
            numerator, rest = divmod(numerator, one)
            if rest != 0:
                left = self._ring.to_sympy(RingElement(self._ring, rest, element.exponents))
                raise NotInvariantError(order, left, self.x, self.z)
        return RingElement(self._ring, numerator, element.exponents)

    def _by(self, elements: Sequence[RingElement], places: Sequence[int]) -> list[RingElement]:
        """The derivatives by x, z and epsilon at `places`, row by row."""
        return [self._ring.derive(e, j).reduced() for e in elements for j in places]

    def _balls(self, elements: Sequence[RingElement], *, at_zero: bool = False) -> BallFunction:
        arguments = (*self.x, self.epsilon) if at_zero else (*self.x, *self.z, self.epsilon)
        return BallFunction(arguments, [self._written(e) for e in elements])

    def _smooth(self, elements: Sequence[RingElement], *, at_zero: bool = False) -> Smooth:
        arguments = (*self.x, self.epsilon) if at_zero else (*self.x, *self.z, self.epsilon)
        written = [self._written(e) for e in elements]
        return Smooth(BallFunction(arguments, written), SeriesFunction(arguments, written))

    def _written(self, element: RingElement) -> sp.Expr:
        """An element for balls: a polynomial in z and epsilon whose coefficients, functions of x, are each reduced.

        Over one common denominator the leading term would hold the same ball above and below, expanded.
        """
        ring = self._ring
        places = [ring.generator(s).numerator.degrees().index(1) for s in (*self.z, self.epsilon)]
        parts: dict[tuple[int, ...], dict] = {}
        for exponents, coefficient in element.numerator.to_dict().items():
            powers = tuple(int(exponents[i]) for i in places)
            rest = tuple(0 if i in places else int(e) for i, e in enumerate(exponents))
            parts.setdefault(powers, {})[rest] = coefficient
        total = []
        for powers, terms in parts.items():
            part = RingElement(ring, ring.context.from_dict(terms), element.exponents).reduced()
            monomial = sp.Mul(*(s**p for s, p in zip((*self.z, self.epsilon), powers)))
            total.append(sp.Mul(monomial, ring.to_sympy(part)))
        return sp.Add(*total)

    @property
    def _by_x(self) -> range:
        return range(self.n)

    @property
    def _by_z(self) -> range:
        return range(self.n, self.n + self.m)

    # -- over balls --------------------------------------------------------------------------------

    @cached_property
    def residual(self) -> BallFunction:
        """rho (m,), at z = 0."""
        return self._balls(self._rho, at_zero=True)

    @cached_property
    def residual_slopes(self) -> BallFunction:
        """The derivatives of rho by x and by epsilon, (m (n + 1),), row by row, at z = 0."""
        return self._balls(self._by(self._rho, (*self._by_x, self.n + self.m)), at_zero=True)

    @cached_property
    def normal(self) -> BallFunction:
        """D_z Gamma (m m,), row by row."""
        return self._balls(self._by(self._gamma, self._by_z))

    @cached_property
    def rates(self) -> BallFunction:
        """f (slow,)."""
        return self._balls(self._f)

    @cached_property
    def _linearisation(self) -> BallFunction:
        rates = [*self._by(self._f, self._by_x), *self._by(self._f, self._by_z)]
        normal = self._by(self._gamma, self._by_z)
        return self._balls([*rates, *normal, *self._by(self._rho, self._by_x), *self._by(normal, self._by_x)])

    def linearisation(self, arguments: Sequence[arb]) -> tuple[list[arb], list[arb], list[arb], list[arb]]:
        """D_x f (slow n,) and D_z f (slow m,), `normal`, D_x rho (m n,) and D_x D_z Gamma (m m n,).

        D_x f is the total derivative at constant z; the last is by row of Gamma, then z, then x. They share what they
        are made of, so that together they cost less.
        """
        values, n, m = self._linearisation(arguments), self.n, self.m
        ends = [self.slow * (n + m)]
        ends += [ends[0] + m * m, ends[0] + m * m + m * n]
        return values[: ends[0]], values[ends[0] : ends[1]], values[ends[1] : ends[2]], values[ends[2] :]

    @cached_property
    def forcing(self) -> BallFunction:
        """D_z f / epsilon^(n+1) (slow m,), row by row."""
        return self._balls([self._divided(e) for e in self._by(self._f, self._by_z)])

    @cached_property
    def push(self) -> Smooth:
        """Gamma (m,), then what z adds to f, over epsilon^(n+1) (slow,)."""
        added = [self._divided((f - r).reduced()) for f, r in zip(self._f, self._f0)]
        return self._smooth([*self._gamma, *added])

    @cached_property
    def drift(self) -> Smooth:
        """The derivatives (slow n,) by x of f on the graph, at z = 0, row by row."""
        return self._smooth(self._by(self._f0, self._by_x), at_zero=True)

    @cached_property
    def mismatch(self) -> Smooth:
        """What f at z = 0 has over the reduced field f_0 + ... + epsilon^n f_n, over epsilon^(n+1) (slow,)."""
        left = [(f - r).reduced() for f, r in zip(self._f0, self._reduced)]
        return self._smooth([self._divided(e) for e in left], at_zero=True)

    @cached_property
    def graph(self) -> BallFunction:
        """h_0 + ... + epsilon^n h_n (m,), over (*x, epsilon)."""
        return self._balls(self._graph, at_zero=True)

    @cached_property
    def reduced_field(self) -> tuple[sp.Expr, ...]:
        """f_0 + ... + epsilon^n f_n (slow,), rational in x and epsilon or with functions of x."""
        return tuple(self._written(e) for e in self._reduced)

    @cached_property
    def gamma(self) -> tuple[sp.Expr, ...]:
        """Gamma (m,), as expressions in x, z and epsilon."""
        return tuple(self._written(e) for e in self._gamma)

    @cached_property
    def turning(self) -> BallFunction:
        """P (m m,), row by row, over (*x, epsilon)."""
        return self._balls([e for row in self._P for e in row], at_zero=True)


def _require_rational(expressions: Sequence[sp.Expr], symbols: Sequence[sp.Symbol]) -> None:
    for expression in expressions:
        for piece in sp.preorder_traversal(expression):
            if not is_rational_node(piece) and piece.has(*symbols):
                raise UnsupportedFunctionError(
                    "the residual of a series is divided exactly where the rates are rational in "
                    f"{', '.join(map(str, symbols))}.",
                    "Take certify(solve_manifold(...)), which proves a tube at one epsilon.",
                    got=piece,
                )
