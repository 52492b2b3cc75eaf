"""Isolated real points of analytic equations: exactly where algebra allows it, else by Newton's method."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

import flint
import numpy as np
import sympy as sp

from gsp.algebra.algebraic_numbers import AlgebraicPoint, InfinitelyManyPoints, arb, rational_point, real_points
from gsp.algebra.differentiation import jacobian
from gsp.hyperbolicity.losses.roots import gauss_newton
from gsp.lowering.compiled_function import compile_function
from gsp.systems.flow import in_words

# Digits to which a point without a formula is refined at first, and below which a value there counts as zero.
DIGITS = 60
ZERO = sp.Float("1e-30", 30)
# A Newton step that stays larger than this, relative to the point, leads to no point.
NOT_A_POINT = sp.Float("1e-8", 20)
# Points nearer than this, relative to 1 + their size in units, are one.
SAME = 1e-6
# Within so many steps Newton's method halves its step towards any root of multiplicity m up to 12, ((m - 1)/m)^8 < 1/2.
# One of a higher multiplicity is further off than NOT_A_POINT after all 40 of them, as a root at infinity is.
HALVED_WITHIN = 8


@dataclass(frozen=True, eq=False)
class Located:
    """A solution of `equations`: `exact` when it has a formula, else `near`, correct to `DIGITS` digits.

    Values below `zero` at a point without a formula count as zero.
    """

    equations: tuple[sp.Expr, ...]
    unknowns: tuple[sp.Symbol, ...]
    exact: AlgebraicPoint | None
    near: Mapping[sp.Symbol, sp.Float]
    zero: sp.Float = ZERO

    def expressions(self) -> dict[sp.Symbol, sp.Expr]:
        """Coordinates: exact numbers, or floats of `DIGITS` digits."""
        return dict(self.near) if self.exact is None else self.exact.expressions()

    def numbers(self) -> dict[sp.Symbol, float]:
        """Coordinates as floats."""
        if self.exact is None:
            return {symbol: float(value) for symbol, value in self.near.items()}
        return self.exact.numbers()

    def value(self, expression: sp.Expr) -> sp.Expr:
        """The value of an expression here: an exact number where there is one, zero told from tiny."""
        if self.exact is not None and expression.is_rational_function():
            try:
                return self.exact.field.expression(self.exact.value(expression))
            except ZeroDivisionError:
                return sp.zoo
        value = expression.xreplace(self.expressions())
        if self.exact is not None:
            value = sp.simplify(value)
            return value if value.is_zero or value.is_Rational or sp.N(abs(value), 40) > ZERO else sp.Integer(0)
        number = sp.N(value, DIGITS)
        return sp.Integer(0) if number.is_finite and abs(number) < self.zero else number

    def sign(self, expression: sp.Expr) -> int:
        """-1, 0 or 1; 0 is decided exactly at exact points, to 30 digits at others."""
        if self.exact is not None and expression.is_rational_function():
            return self.exact.field.sign(self.exact.value(expression))
        value = self.value(expression)
        return 0 if value == 0 else (1 if sp.N(value, 30) > 0 else -1)

    def balls(self, bits: int) -> dict[sp.Symbol, flint.arb]:
        """Enclosures of the coordinates with about `bits` correct bits."""
        if self.exact is not None:
            return {s: self.exact.field.ball(value, bits) for s, value in self.exact.values.items()}
        digits = max(DIGITS, int(bits * 0.30103) + 10)
        near, _ = polish(self.equations, self.unknowns, self.near, digits=digits)
        radius = arb(sp.Rational(1, 10 ** (digits - 8)))
        return {
            s: flint.arb(sp.sstr(v, full_prec=True)) + radius * (1 + abs(float(v))) * flint.arb(0, 1)
            for s, v in near.items()
        }


def with_slopes(
    equations: Sequence[sp.Expr], unknowns: Sequence[sp.Symbol]
) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """The values (k,) of equations at a point (n,) and their Jacobian (k, n), compiled."""
    compiled = compile_function([*equations, *jacobian(equations, unknowns)], arguments=unknowns)

    def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, slopes = np.split(compiled(u[None, :], [0.0])[0], [len(equations)])
        return values, slopes.reshape(len(equations), -1)

    return evaluate


def locate(
    equations: Sequence[sp.Expr],
    unknowns: Sequence[sp.Symbol],
    *,
    starts: Iterable[Sequence[float] | np.ndarray],
    units: np.ndarray | None = None,
) -> list[Located]:
    """Every real solution of rational equations; of others, those that Newton's method reaches from `starts`.

    Lengths are in `units`, one for each unknown, and values in what a unit changes in each equation.

    Raises `InfinitelyManyPoints` when solutions are not isolated.
    """
    unknowns, equations = tuple(unknowns), tuple(equations)
    exact = real_points(equations, unknowns)
    if exact is not None:
        return [Located(equations, unknowns, point, {}) for point in exact]
    evaluate = with_slopes(equations, unknowns)
    scales = np.ones(len(unknowns)) if units is None else units

    def solve(start: np.ndarray) -> np.ndarray | None:
        value, slope = evaluate(start)
        sizes = 1.0 if units is None else np.abs(value) + np.abs(slope * scales).max(axis=1)
        return gauss_newton(evaluate, start, scales=scales, sizes=sizes)

    found: list[np.ndarray] = []
    for start in np.array(list(starts), dtype=float):
        u = solve(start)
        length = 1.0 if u is None else 1.0 + np.linalg.norm(u / scales)
        if u is None or any(np.abs((u - v) / scales).max() < SAME * length for v in found):
            continue
        value, slope = evaluate(u)
        # Roots at infinity: the residual is small, but the next step is not.
        if np.linalg.norm(np.linalg.lstsq(slope * scales, value, rcond=None)[0]) >= 1e-3 * length:
            continue
        found.append(u)
        # From a place beside it, where the slopes vanish, Newton's method comes back to a point, and stays on a curve.
        along = _null_direction(slope * scales)
        aside = SAME**0.5 * length
        beside = None if along is None else solve(u + aside * along * scales)
        if beside is not None and abs(np.linalg.norm((beside - u) / scales) - aside) < 0.5 * aside:
            raise InfinitelyManyPoints(
                "the solutions are not isolated.",
                "Fewer unknowns would leave single points.",
                got=in_words(zip(unknowns, u)),
            )
    located: list[Located] = []
    for u in found:
        rough = {s: sp.Float(float(v), 30) for s, v in zip(unknowns, u)}
        near, step = polish(equations, unknowns, rough, digits=DIGITS, units=scales)
        if step > NOT_A_POINT:
            continue
        point = Located(
            equations, unknowns, _recognised(equations, near, step), near, sp.Max(ZERO, sp.sqrt(step))
        )
        # Roots that are approached linearly arrive here several times.
        if not any(_same(point, other, scales) for other in located):
            located.append(point)
    return sorted(located, key=lambda point: tuple(point.numbers().values()))


def _null_direction(slopes: np.ndarray) -> np.ndarray | None:
    """The unit vector that slopes (n, n) all but annihilate, whatever the factors of equations and unknowns; None
    without one."""
    lengths = np.abs(slopes).max(axis=0)
    lengths = np.where(lengths > 0.0, lengths, 1.0)
    sizes = np.abs(slopes / lengths).max(axis=1, keepdims=True)
    values, directions = np.linalg.svd(slopes / lengths / np.where(sizes > 0.0, sizes, 1.0))[1:]
    # Where an eigenvalue vanishes Newton's method is off by the root of rounding.
    if values[-1] > np.finfo(float).eps ** 0.5 * len(slopes) * values[0]:
        return None
    found = directions[-1] / lengths
    return found / np.linalg.norm(found)


def _same(a: Located, b: Located, units: np.ndarray) -> bool:
    first, second = (np.array([of.numbers()[s] for s in a.unknowns]) / units for of in (a, b))
    return bool((np.abs(first - second) < SAME * (1.0 + np.abs(first))).all())


def polish(
    equations: Sequence[sp.Expr],
    unknowns: Sequence[sp.Symbol],
    near: Mapping[sp.Symbol, sp.Expr],
    *,
    digits: int,
    units: Sequence[float] | np.ndarray | None = None,
) -> tuple[dict[sp.Symbol, sp.Float], sp.Float]:
    """Newton's method from `near` to `digits` digits, in at most 40 steps; with the relative size of the last one, in
    `units`.

    Multiple roots are approached linearly, and roots at infinity by steps that do not shrink, at which it ends early.
    """
    matrix = sp.Matrix(list(equations))
    slopes = jacobian(equations, unknowns)
    u = {s: sp.Float(near[s], digits + 10) for s in unknowns}
    size = sp.Float(1, 20)
    scales = [sp.Float(float(unit), 20) for unit in (units if units is not None else [1.0] * len(unknowns))]
    lengths: list[sp.Float] = []
    for _ in range(40):
        try:
            value, slope = (m.xreplace(u).evalf(digits + 10) for m in (matrix, slopes))
        except OverflowError:
            return u, sp.Float(1, 20)
        if all(entry == 0 for entry in value):
            return u, sp.Float(10, 20) ** (-digits)
        try:
            step = slope.LUsolve(value)
        except (ValueError, ZeroDivisionError):
            break
        # From where the slopes are singular a step leads beyond all numbers.
        if not all(entry.is_finite and math.isfinite(float(entry)) for entry in step):
            return u, sp.Float(1, 20)
        u = {s: sp.Float(u[s] - step[i], digits + 10) for i, s in enumerate(unknowns)}
        lengths.append(max(abs(entry) / unit for entry, unit in zip(step, scales)))
        size = sp.Float(lengths[-1] / (1 + max(abs(v) / unit for v, unit in zip(u.values(), scales))), 20)
        stays = len(lengths) > HALVED_WITHIN and 2 * lengths[-1] > lengths[-1 - HALVED_WITHIN]
        if size < sp.Float(10, 20) ** (3 - digits) or (stays and size > NOT_A_POINT):
            break
    return u, size


def _recognised(
    equations: Sequence[sp.Expr], near: Mapping[sp.Symbol, sp.Float], step: sp.Float
) -> AlgebraicPoint | None:
    """The rational point that `near` is, when it solves the equations exactly."""
    tolerance = sp.Max(sp.Float("1e-40", 20), 100 * step)
    values = {}
    for symbol, value in near.items():
        # Larger denominators are not taken for exact values of numerical roots.
        guess = sp.Rational(sp.sstr(value, full_prec=True)).limit_denominator(10**6)
        if tolerance > sp.Float("1e-30", 20):
            guess = sp.Rational(sp.sstr(value, full_prec=True)).limit_denominator(1000)
        if abs(guess - value) > tolerance:
            return None
        values[symbol] = sp.Rational(guess)
    if any(sp.simplify(e.xreplace(values)) != 0 for e in equations):
        return None
    return rational_point(values)
