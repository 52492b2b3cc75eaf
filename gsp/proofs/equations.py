"""The equations whose root is enclosed: with their derivatives, over balls to prove and over doubles to search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from math import isfinite

import numpy as np
import sympy as sp
from flint import arb

from gsp.algebra.differentiation import gathered_derivative
from gsp.algebra.laurent import laurent
from gsp.critical.branch import Branch
from gsp.kernels.evaluate import evaluate_many
from gsp.kernels.linear_algebra import factorise, solve
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction

# Newton's method over doubles is done at rounding.
ROUNDING = 5 * np.finfo(float).eps
# The longest step along a line on which a root is followed, as a share of it.
LONGEST = 1.0 / 16.0


def without_decimals(expression: sp.Expr) -> sp.Expr:
    """The expression with the number that each double in it is, as a fraction."""
    decimals = expression.atoms(sp.Float)
    return expression.xreplace({number: sp.Rational(number) for number in decimals}) if decimals else expression


class EnclosedEquations:
    """m equations F(x, y) = 0 for y (m,) over x (n,), smooth where their enclosures are finite.

    `sizes` (m,) of y, 1 for each unless told, are what lengths are small beside in the search: no proof rests on them.
    Raises `UnsupportedFunctionError` for a function without an enclosure.
    """

    def __init__(
        self,
        x: Sequence[sp.Symbol],
        y: Sequence[sp.Symbol],
        equations: Sequence[sp.Expr],
        sizes: np.ndarray | None = None,
    ) -> None:
        # A derivative of a decimal would be rounded by SymPy.
        self.x, self.y, self.equations = tuple(x), tuple(y), tuple(without_decimals(e) for e in equations)
        self.n, self.m = len(self.x), len(self.y)
        self.sizes = np.ones(self.m) if sizes is None else sizes
        self._by_y, self._by_x = (
            [gathered_derivative(e, s) for e in self.equations for s in symbols] for symbols in (self.y, self.x)
        )

    @property
    def derivatives_by_y(self) -> tuple[sp.Expr, ...]:
        """The expressions of D_y F (m m,), row by row."""
        return tuple(self._by_y)

    def along(self, line: Mapping[sp.Symbol, sp.Expr], parameter: sp.Symbol) -> EnclosedEquations:
        """The same equations where x is given by expressions in one parameter."""
        equations = [e.xreplace(dict(line)) for e in self.equations]
        return EnclosedEquations((parameter,), self.y, equations, self.sizes)

    @property
    def arguments(self) -> tuple[sp.Symbol, ...]:
        """x, then y."""
        return self.x + self.y

    # -- over balls --------------------------------------------------------------------------------

    @cached_property
    def _values(self) -> BallFunction:
        return BallFunction(self.arguments, self.equations)

    @cached_property
    def _derivatives(self) -> BallFunction:
        return BallFunction(self.arguments, self._by_y)

    @cached_property
    def _slopes(self) -> BallFunction:
        return BallFunction(self.arguments, [*self._by_y, *self._by_x])

    def value(self, x: list[arb], y: list[arb]) -> list[arb]:
        """F (m,)."""
        return self._values([*x, *y])

    def derivative(self, x: list[arb], y: list[arb]) -> list[arb]:
        """D_y F (m m,), row by row."""
        return self._derivatives([*x, *y])

    def slopes(self, x: list[arb], y: list[arb]) -> tuple[list[arb], list[arb]]:
        """D_y F (m m,) and D_x F (m n,), row by row."""
        both = self._slopes([*x, *y])
        return both[: self.m**2], both[self.m**2 :]

    @property
    def operations(self) -> int:
        """Ball operations that one evaluation of all derivatives takes, at least 1."""
        return max(self._slopes.operations, 1)

    # -- over doubles ------------------------------------------------------------------------------

    @cached_property
    def _doubles(self) -> CompiledFunction:
        """F, D_y F and D_x F, row by row."""
        return compile_function([*self.equations, *self._by_y, *self._by_x], arguments=self.arguments)

    def nearby(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives at points (k, n), (k, m): D_y F (k, m, m) and D_x F (k, m, n), rounded."""
        points = np.hstack([x, y])
        values = self._doubles(points, _NO_PARAMETERS)
        self._mend(points, values)
        m, n = self.m, self.n
        return values[:, m : m + m * m].reshape(-1, m, m), values[:, m + m * m :].reshape(-1, m, n)

    def root(self, x: np.ndarray, near: np.ndarray) -> np.ndarray | None:
        """The root (m,) over x (n,) that Newton's method finds from `near` (m,), rounded; None when it finds none."""
        point, out = self._room(x, near)
        y, step = point[0, self.n :], np.empty(self.m)
        factors, pivots = np.empty((self.m, self.m)), np.empty(self.m, np.int64)
        length = scale = np.inf
        # Kernels on arrays made once: LAPACK's call and copies would take most of the time.
        for _ in range(40):
            evaluate_many(self._doubles.address, point, _NO_PARAMETERS, out)
            self._mend(point, out[:, : self.m + self.m**2])
            step[:] = out[0, : self.m]
            factors[:] = self._by_y_in(out)
            if not factorise(factors, pivots):
                return None
            solve(factors, pivots, step)
            if not all(map(isfinite, step.tolist())):
                return None
            y -= step
            length, scale = _largest(step / self.sizes), 1.0 + _largest(y / self.sizes)
            if length <= ROUNDING * scale:
                return y
        # At rounding Newton's method may go to and fro for ever; a proof does not ask how near the centre is.
        return y if length <= 1e-8 * scale else None

    def followed(self, start: np.ndarray, end: np.ndarray, near: np.ndarray) -> tuple[float, np.ndarray] | None:
        """How far the root near `near` (m,) can be followed from x = `start` (n,) towards `end`: (share, y), by
        doubles.

        Steps are halved where a correction is so long that it may lead to another root, or det D_y F changes its
        sign. None where there is no root at the start.
        """
        y = self.root(start, near)
        if y is None:
            return None
        way = np.asarray(end, dtype=float) - start
        here = self._tangent(start, y, way)
        share, step = 0.0, LONGEST
        while here is not None and share < 1.0 and step > 1e-10:
            ahead = min(share + step, 1.0)
            x, moved = start + ahead * way, (ahead - share) * here[0]
            found = self.root(x, y + moved)
            there = None
            off = np.inf if found is None else _largest((found - y - moved) / self.sizes)
            if found is not None and off <= 0.5 * _largest(moved / self.sizes) + 1e-9:
                there = self._tangent(x, found, way)
            if found is not None and there is not None and there[1] == here[1]:
                share, y, here, step = ahead, found, there, min(2.0 * step, LONGEST)
            else:
                step *= 0.5
        return share, y

    def _tangent(self, x: np.ndarray, y: np.ndarray, way: np.ndarray) -> tuple[np.ndarray, float] | None:
        """How the root moves along `way` (n,) to first order (m,), and the sign of det D_y F; None where that is 0."""
        point, out = self._room(x, y)
        evaluate_many(self._doubles.address, point, _NO_PARAMETERS, out)
        self._mend(point, out)
        factors, pivots = self._by_y_in(out).copy(), np.empty(self.m, np.int64)
        if not factorise(factors, pivots):
            return None
        moved = -(out[0, self.m + self.m**2 :].reshape(self.m, self.n) @ way)
        solve(factors, pivots, moved)
        signs = ((row != i) != (factors[i, i] < 0.0) for i, row in enumerate(pivots.tolist()))
        return moved, -1.0 if sum(signs) % 2 else 1.0

    def _room(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The point (1, n + m), and an array for all that is compiled."""
        return np.concatenate([x, y])[None], np.empty((1, self._doubles.outputs))

    def _mend(self, points: np.ndarray, values: np.ndarray) -> None:
        """Put balls' middles into the first `values` (k, any) where doubles overflowed on the way: balls do not."""
        if np.isfinite(values).all():
            return
        for point, row in zip(points, values):
            places = np.flatnonzero(~np.isfinite(row)).tolist()
            if places and np.isfinite(point).all():
                at = [balls.exact(v) for v in point.tolist()]
                exact = self._values(at) if places[0] < self.m else [arb(0)] * self.m
                exact += self._slopes(at) if places[-1] >= self.m else []
                for place in places:
                    if exact[place].is_finite():
                        row[place] = float(exact[place].mid())

    def _by_y_in(self, out: np.ndarray) -> np.ndarray:
        return out[0, self.m : self.m + self.m**2].reshape(self.m, self.m)


def _largest(vector: np.ndarray) -> float:
    return max(map(abs, vector.tolist()))


def limit_equations(branch: Branch, names: Sequence[str]) -> tuple[EnclosedEquations, list[sp.Expr]]:
    """g = 0 and the slow rates f, on epsilon = 0, over the slow variables and the parameters in `names`."""
    system = branch.system
    x = [*system.x, *(p for p in system.parameters if p.name in names)]
    values = {p: v for p, v in system.parameters.items() if p not in x}
    zero = sp.Integer(0)
    g, f = (
        [laurent(e, system.epsilon, order=0).get(0, zero).xreplace(values) for e in rates]
        for rates in (system.g, system.f)
    )
    return EnclosedEquations(x, system.y, g, branch.scales[1]), [without_decimals(e) for e in f]


_NO_PARAMETERS = np.array([np.nan])
