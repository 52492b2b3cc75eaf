"""Exact algebra of mechanics: matrices over functions of positions, in which cos^2 + sin^2 = 1 is always used.

Sines and cosines of sums are written by those of single angles, so that every expression becomes a polynomial
in them over few denominators; `gsp.algebra.ring` does the arithmetic. Nothing is simplified, only reduced.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import reduce
from types import MappingProxyType
from typing import Any

import numpy as np
import sympy as sp

from gsp.algebra.elimination_over_rationals import connected_parts
from gsp.algebra.functions import are_rational
from gsp.algebra.ring import DENOMINATOR_TERMS, LocalisedRing, read
from gsp.algebra.ring_elements import RingElement
from gsp.errors import BudgetError
from gsp.lowering.compiled_function import compile_function
from gsp.slow.coordinates import dot, invert

Matrix = list[list[RingElement]]
# What makes the formulas of several bodies shorter.
SHORTER = (
    "Name velocities that turn with a body, frame={u: cos(theta)*xdot + ...}, or put numbers for parameters."
)

_RATIOS = {
    sp.tan: lambda u: sp.sin(u) / sp.cos(u),
    sp.cot: lambda u: sp.cos(u) / sp.sin(u),
    sp.sec: lambda u: 1 / sp.cos(u),
    sp.csc: lambda u: 1 / sp.sin(u),
}


@contextmanager
def within_budget() -> Iterator[None]:
    """A `BudgetError` of what is derived here tells what makes formulas shorter."""
    try:
        yield
    except BudgetError as error:
        raise BudgetError(f"{error.fact}.", SHORTER, value=error.spent, limit=error.limit) from None


def refuse_long(terms: int, what: str) -> None:
    """Raise `BudgetError` for more terms than are written."""
    if terms > DENOMINATOR_TERMS:
        fact = f"{what} {terms:,} terms, and {DENOMINATOR_TERMS:,} at most are written."
        raise BudgetError(fact, SHORTER, value=terms, limit=DENOMINATOR_TERMS)


class Angles:
    """The rewriting of sin and cos of sums and multiples by those of `units`, one for each angle.

    An angle q of `measured_from` is written by q - measured_from[q], and no angle is measured from itself in the end.
    """

    def __init__(self, expressions: Iterable[sp.Expr], measured_from: Mapping[sp.Symbol, sp.Expr]) -> None:
        own = {q: sp.Dummy(q.name) for q in measured_from}
        self._told = {own[q]: q - base for q, base in measured_from.items()}
        self._turned = {q: own[q] + base for q, base in measured_from.items()}
        for _ in measured_from:
            self._turned = {q: turned.xreplace(self._turned) for q, turned in self._turned.items()}
        self._sizes: dict[sp.Expr, sp.Rational] = {}
        functions = [f for e in expressions for f in sorted(_plain(e).atoms(sp.sin, sp.cos), key=str)]
        for function in functions:
            for base, coefficient in self._terms(function.args[0]):
                self._sizes[base] = sp.gcd(self._sizes.get(base, 0), coefficient)

    @property
    def units(self) -> list[sp.Expr]:
        """The single angles; phi/2 when half angles of phi occur, and 18 phi when no other multiple does."""
        return [self._unit(base) for base in self._sizes]

    def _unit(self, base: sp.Expr) -> sp.Expr:
        return sp.expand(self._sizes[base] * self._told.get(base, base))

    def expand(self, expression: sp.Expr) -> sp.Expr:
        """`expression` with every sine and cosine a polynomial in those of the units."""
        plain = _plain(expression)
        places = {}
        for function in plain.atoms(sp.sin, sp.cos):
            sine, cosine = self._pair(function.args[0])
            places[function] = sine if isinstance(function, sp.sin) else cosine
        return plain.xreplace(places)

    def _pair(self, argument: Any) -> tuple[Any, Any]:
        sine: Any
        cosine: Any
        sine, cosine = sp.Integer(0), sp.Integer(1)
        for base, coefficient in self._terms(argument):
            unit, times = self._unit(base), abs(coefficient) / self._sizes[base]
            assert times.is_Integer, f"{argument} is no multiple of {unit}"
            c = sp.cos(unit)
            # sin(n u) = sin(u) U_(n-1)(cos(u)), cos(n u) = T_n(cos(u)), Chebyshev's polynomials.
            s = sp.sign(coefficient) * sp.sin(unit) * sp.chebyshevu(times - 1, c)
            c = sp.chebyshevt(times, c)
            sine, cosine = sine * c + cosine * s, cosine * c - sine * s
        return sine, cosine

    def _terms(self, argument: Any) -> list[tuple[sp.Expr, sp.Rational]]:
        """(base, rational coefficient) of every term of an angle; a number is a base of its own."""
        pairs = []
        for term in sp.Add.make_args(sp.expand(argument.xreplace(self._turned))):
            coefficient, base = term.as_coeff_Mul()
            whole = base.is_number or not coefficient.is_Rational
            pairs.append((term, sp.Integer(1)) if whole else (base, coefficient))
        return pairs


def _plain(expression: Any) -> Any:
    for ratio, rule in _RATIOS.items():
        expression = expression.replace(ratio, rule)
    return expression


class Algebra:
    """Functions of `coordinates` and `parameters` that `expressions` are made of, with derivations.

    For each angle in `sines` powers of the cosine are reduced, for every other those of the sine. `measured_from` is
    for `Angles`.
    """

    def __init__(
        self,
        coordinates: Sequence[sp.Symbol],
        parameters: Sequence[sp.Symbol],
        expressions: Sequence[sp.Expr],
        *,
        derivations: int = 1,
        sines: frozenset[sp.Expr] = frozenset(),
        measured_from: Mapping[sp.Symbol, sp.Expr] = MappingProxyType({}),
    ) -> None:
        self.measured_from = measured_from
        self._angles = Angles(expressions, measured_from)
        expanded = [self._angles.expand(e) for e in expressions]
        self.ring = LocalisedRing(
            coordinates, constants=parameters, functions=not are_rational(expanded), derivations=derivations
        )
        self.coordinates = tuple(coordinates)
        self._trigonometric: dict[sp.Expr, dict[str, RingElement]] = {}
        used = set().union(*(e.atoms(sp.sin, sp.cos) for e in expanded)) if expanded else set()
        for unit in self._angles.units:
            if not any(f.args[0] == unit for f in used):
                continue
            angle = read(unit, self.ring, {})
            # The one adjoined later leads the relation s^2 + c^2 = 1, and its square is the one replaced.
            names = ("sin", "cos") if unit in sines else ("cos", "sin")
            self._trigonometric[unit] = {name: angle.apply(name) for name in names}

    def read(
        self, expression: sp.Expr, environment: Mapping[sp.Symbol, RingElement] | None = None
    ) -> RingElement:
        """The element of an expression, symbols looked up in `environment` first."""
        return read(self._angles.expand(expression), self.ring, dict(environment or {})).reduced()

    def matrix(
        self, expressions: sp.MatrixBase, environment: Mapping[sp.Symbol, RingElement] | None = None
    ) -> Matrix:
        """The same for every entry of a matrix."""
        return [
            [self.read(expressions[i, j], environment) for j in range(expressions.cols)]
            for i in range(expressions.rows)
        ]

    def write(self, element: RingElement, *, factored: bool = True) -> sp.Expr:
        """The element as an expression; `factored` for reading, else as it comes.

        Raises `BudgetError` for more terms than are factored.
        """
        element = element.reduced()
        refuse_long(len(element.numerator), "a formula of the motion has")
        expression = self.ring.to_sympy(element, factored=factored)
        return self._shown(expression) if factored else expression

    def _shown(self, expression: sp.Expr) -> sp.Expr:
        """Each sum in the shorter of its forms, by sines or by cosines, and no sum led by a minus sign."""
        sign, factors = sp.Integer(1), []
        for factor in sp.Mul.make_args(expression):
            base, exponent = factor.as_base_exp()
            if not (base.is_Add and exponent.is_Integer):
                factors.append(factor)
                continue
            for unit in self._trigonometric:
                base = _shorter(base, sp.sin(unit), sp.cos(unit))
            if base.is_Add and base.could_extract_minus_sign():
                base, sign = -base, sign * (-1) ** exponent
            factors.append(base**exponent)
        return sp.Mul(sign, *factors)

    def clean(self, expression: sp.Expr) -> sp.Expr:
        """The expression in its reduced form; 0 exactly when it vanishes identically."""
        return self.write(self.read(expression))

    def put(self, element: RingElement, values: Mapping[sp.Symbol, sp.Expr]) -> RingElement:
        """The element with expressions put for some symbols."""
        return self.read(_put(self.write(element, factored=False), values))

    def is_constant(self, element: RingElement) -> bool:
        """Whether the element contains parameters and numbers only."""
        return self.ring.is_constant(element.reduced())

    def derive(self, elements: Sequence[RingElement], j: int) -> list[RingElement]:
        """Derivation j of each element."""
        return [self.ring.derive(e, j).reduced() for e in elements]

    def apply(self, matrix: Matrix, vector: Sequence[RingElement]) -> list[RingElement]:
        """Matrix times vector."""
        return [dot(row, vector, self.ring).reduced() for row in matrix]

    def multiply(self, left: Matrix, right: Matrix) -> Matrix:
        """Matrix times matrix."""
        columns = transpose(right)
        return [[dot(row, column, self.ring).reduced() for column in columns] for row in left]

    def inverse(self, matrix: Matrix) -> Matrix:
        """Inverse, block by block; raises `HyperbolicityError` when the matrix is singular."""
        n = len(matrix)
        result = [[self.ring.zero] * n for _ in range(n)]
        entries = [(i, j) for i in range(n) for j in range(n) if not matrix[i][j].is_zero]
        for rows, columns in connected_parts(entries, n, n):
            if len(rows) != len(columns):
                # A block that is not square makes the matrix singular; inverting zero says so.
                self.ring.zero.inverse()
            block = invert([[matrix[i][j] for j in columns] for i in rows], self.ring)
            for a, j in enumerate(columns):
                for b, i in enumerate(rows):
                    result[j][i] = block[a][b]
        return result

    @property
    def denominators(self) -> list[sp.Expr]:
        """The denominators met so far, irreducible, no constants: where one vanishes, a formula fails."""
        ring = self.ring
        elements = [RingElement(ring, factor, ()) for factor in ring.denominators]
        return [ring.to_sympy(e, factored=False) for e in elements if not ring.is_constant(e)]

    @property
    def awkward_angles(self) -> frozenset[sp.Expr]:
        """Angles by whose sine something was divided: their cosines should be reduced instead."""
        found = []
        known = self.ring.denominators
        for unit, pair in self._trigonometric.items():
            s, c = pair["sin"].numerator, pair["cos"].numerator
            divided = s in known or (c - 1 in known and c + 1 in known)
            if divided and c not in known:
                found.append(unit)
        return frozenset(found)


def entries(matrix: Any) -> list[sp.Expr]:
    """The entries of a SymPy matrix, row by row."""
    return list(matrix)


def _put(expression: Any, values: Mapping[sp.Symbol, sp.Expr]) -> Any:
    return expression.xreplace(dict(values))


def transpose(matrix: Matrix) -> Matrix:
    """The transposed matrix."""
    return [list(column) for column in zip(*matrix)]


def _shorter(total: sp.Expr, sine: sp.Expr, cosine: sp.Expr) -> sp.Expr:
    """`total` with squares of the cosine, or of the sine, replaced, when that leaves fewer terms."""
    forms = [total]
    for kept, replaced in ((sine, cosine), (cosine, sine)):
        # Sums with more terms are shown as they come: trying their other forms costs more than it explains.
        if len(sp.Add.make_args(total)) > 60 or not total.has(replaced):
            continue
        powers = {
            p: p.exp for p in total.atoms(sp.Pow) if p.base == replaced and p.exp.is_Integer and p.exp > 1
        }
        rules = {p: (1 - kept**2) ** (k // 2) * replaced ** (k % 2) for p, k in powers.items()}
        forms.append(sp.expand(total.xreplace(rules)))
    return min(forms, key=lambda form: len(sp.Add.make_args(form)))


def common_denominator(expressions: Iterable[sp.Expr]) -> sp.Expr:
    """The least common multiple of their denominators."""
    return reduce(sp.lcm, (sp.denom(sp.together(e)) for e in expressions), sp.S.One)


def numbers(
    expressions: Sequence[sp.Expr],
    symbols: Sequence[sp.Symbol],
    points: np.ndarray,
    parameters: Mapping[sp.Symbol, sp.Expr],
) -> np.ndarray:
    """Values (m, len(expressions)) at `points` (m, len(symbols)), parameters at their values."""
    function = compile_function(tuple(expressions), arguments=tuple(symbols), parameters=tuple(parameters))
    constants = np.array([float("nan"), *(float(value) for value in parameters.values())])
    return np.asarray(function(np.array(points, dtype=float, ndmin=2), constants))


def generic_points(count: int, dimension: int) -> np.ndarray:
    """Points (count, dimension) at which nothing vanishes by accident, the same in every run."""
    return np.random.default_rng(20).uniform(0.2, 1.3, size=(count, dimension))
