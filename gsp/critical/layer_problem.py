"""The layer problem y' = g(x, y, 0) as equations for continuation: values and exact derivatives, compiled.

Some of the slow variables and parameters are *free*; together with the fast variables they are the unknowns
u = (free..., y...). Everything else is fixed. M0 is then the zero set of n_fast equations in n_free + n_fast
unknowns: a curve for one free variable, a sheet for two.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Protocol

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.critical.multilinear_form import Derivatives, MultilinearForm
from gsp.errors import BranchError, DeclarationError
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.systems.arguments import shown
from gsp.systems.flow import Point, check_given, in_words, values_by_name
from gsp.systems.region import Interval, balancing_units, check_interval
from gsp.systems.system import SlowFastSystem

Bounds = Mapping[str, Interval] | Mapping[sp.Symbol, Interval]

# What is less than this share of the size that matters is known to no digit.
NOTHING = np.sqrt(np.finfo(float).eps)


@dataclass(frozen=True, eq=False, repr=False)
class LayerProblem:
    """g(x, y, 0) of `system` in the unknowns (free..., y...), every other symbol `fixed` at its value."""

    system: SlowFastSystem
    free: tuple[sp.Symbol, ...]
    fixed: Mapping[sp.Symbol, float]

    @classmethod
    @lru_cache(maxsize=16)
    def over_all(cls, system: SlowFastSystem) -> LayerProblem:
        """That in which every slow variable is free, the parameters at their values."""
        return cls(system, system.x, dict(zip(system.parameters, compile_flow(system).constants[1:].tolist())))

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]:
        """The free symbols, then the fast ones."""
        return (*self.free, *self.system.y)

    @property
    def size(self) -> int:
        """Number of equations, n_fast."""
        return len(self.system.y)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the columns of a result: slow, fast, then free parameters."""
        extra = [s.name for s in self.free if s not in self.system.x]
        return (*(s.name for s in self.system.states), *extra)

    def rows(self, u: np.ndarray) -> np.ndarray:
        """Unknowns (m, N) as points (m, n) with the columns `names`."""
        column = {s.name: u[:, i] for i, s in enumerate(self.unknowns)}
        for symbol, value in self.fixed.items():
            column.setdefault(symbol.name, np.full(len(u), value))
        return np.column_stack([column[name] for name in self.names])

    def point(self, u: np.ndarray) -> dict[str, float]:
        """One point by name."""
        return dict(zip(self.names, map(float, self.rows(u[None, :])[0])))

    # -- values ------------------------------------------------------------------------------------

    def residual(self, u: np.ndarray) -> np.ndarray:
        """g at u: (n,) for one point, (m, n) for (m, N)."""
        return self._g(u, self._p)

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """g_u at one point: (n, N)."""
        return self._g_u(u, self._p).reshape(self.size, -1)

    def jacobians(self, u: np.ndarray) -> np.ndarray:
        """g_u at points (m, N): (m, n, N)."""
        return self._g_u(u, self._p).reshape(len(u), self.size, -1)

    def fast_jacobians(self, u: np.ndarray) -> np.ndarray:
        """g_y at points (m, N): (m, n, n)."""
        return self.jacobians(u)[:, :, len(self.free) :]

    def eigenvalues(self, u: np.ndarray) -> np.ndarray:
        """Eigenvalues of g_y at points (m, N), the rightmost first: complex (m, n); NaN where g_y is not finite."""
        matrices = self.fast_jacobians(u)
        finite = np.isfinite(matrices).all(axis=(1, 2))
        values = np.full(matrices.shape[:2], complex(np.nan))
        if finite.any():
            values[finite] = np.linalg.eigvals(matrices[finite])
        order = np.lexsort((-np.imag(values), -np.real(values)), axis=1)
        return np.take_along_axis(values, order, axis=1)

    def second(self, u: np.ndarray) -> np.ndarray:
        """g_uu at one point: (n, N, N)."""
        return self._g_uu.at(u, self._p).dense(len(self.unknowns))

    def third(self, u: np.ndarray) -> MultilinearForm:
        """g_yyy at one point, a form in three vectors (n,)."""
        return self._g_yyy.at(u, self._p)

    def bent_slopes(self, u: np.ndarray, j: int) -> np.ndarray:
        """The second derivatives of g_y (n n,) in the j-th unknown, at one point."""
        s = self.unknowns[j]
        slopes = [derivative(g, y) for g in self._rates for y in self.system.y]
        return self._compiled([derivative(derivative(slope, s), s) for slope in slopes])(u, self._p)

    @cached_property
    def _rates(self) -> list[sp.Expr]:
        epsilon = self.system.epsilon
        return [laurent(g, epsilon, order=0).get(0, sp.Integer(0)) for g in self.system.g]

    @cached_property
    def _p(self) -> np.ndarray:
        return np.array([np.nan, *self.fixed.values()])

    def _compiled(self, outputs: Sequence[sp.Expr]) -> CompiledFunction:
        return compile_function(
            outputs, arguments=self.unknowns, epsilon=self.system.epsilon, parameters=tuple(self.fixed)
        )

    @cached_property
    def _g(self) -> CompiledFunction:
        return self._compiled(self._rates)

    @cached_property
    def _g_u(self) -> CompiledFunction:
        return self._compiled([derivative(g, s) for g in self._rates for s in self.unknowns])

    @cached_property
    def _g_uu(self) -> Derivatives:
        return Derivatives(self._rates, self.unknowns, 2, self._compiled)

    @cached_property
    def _g_yyy(self) -> Derivatives:
        return Derivatives(self._rates, self.system.y, 3, self._compiled)


# -- what a caller gives ---------------------------------------------------------------------------


def find_symbol(
    system: SlowFastSystem, variable: sp.Symbol | str, among: Sequence[sp.Symbol], what: str
) -> sp.Symbol:
    """The symbol of `among` that is `variable`, by itself or by name; raises `DeclarationError` otherwise."""
    name = variable.name if isinstance(variable, sp.Symbol) else variable
    for symbol in among:
        if isinstance(name, str) and symbol.name == name:
            return symbol
    names = [symbol.name for symbol in among]
    known = ", ".join(names) or "none"
    raise DeclarationError(
        f"{what} is one of {known}.",
        f"Take a symbol of the system {system.name or repr(system)}.",
        got=shown(name),
        value=name,
        known=names,
    )


def layer_problem(
    system: SlowFastSystem, free: tuple[sp.Symbol, ...], start: Point
) -> tuple[LayerProblem, np.ndarray]:
    """The layer problem with `free` unknown and the rest fixed at `start`, and the unknowns there (N,).

    `start` names every state, and free parameters if they are not to start from the system's values.
    """
    values = values_by_name(start, what="start")
    parameters = dict(zip(system.parameters, map(float, compile_flow(system).constants[1:])))
    allowed = [s.name for s in system.states] + [s.name for s in free if s in parameters]
    for name in values:
        if name not in allowed:
            known = [s.name for s in parameters]
            fact = "a parameter that is not free" if name in known else "no state and no free parameter"
            raise DeclarationError.none_of(allowed, name, f'start names "{name}", which is {fact}.', "It takes")
    check_given(values, [s.name for s in system.states], what="start")
    everything = {**parameters, **{s: values[s.name] for s in system.states}}
    everything |= {s: values[s.name] for s in free if s.name in values}
    fixed = {s: v for s, v in everything.items() if s not in free and s not in system.y}
    problem = LayerProblem(system, free, fixed)
    return problem, np.array([everything[s] for s in problem.unknowns])


def check_bounds(bounds: Bounds | None, problem: LayerProblem) -> dict[str, Interval]:
    """`bounds` by name, each (low, high); raises `DeclarationError` for names that are not unknowns."""
    if bounds is None:
        return {}
    if not isinstance(bounds, Mapping):
        raise DeclarationError("bounds maps names to intervals (low, high).", got=shown(bounds), value=bounds)
    names = [s.name for s in problem.unknowns]
    result: dict[str, Interval] = {}
    for key, interval in bounds.items():
        name = key.name if isinstance(key, sp.Symbol) else key
        if name not in names:
            raise DeclarationError.none_of(
                names, name, f'bounds names "{name}", which does not vary here.', "What varies is"
            )
        result[name] = check_interval(
            interval, what=f"bounds of {name}", remedy="Give (low, high) with low < high."
        )
    return result


class Bent(Protocol):
    """Equations in `unknowns` with their first and second derivatives."""

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]: ...

    def jacobian(self, u: np.ndarray, /) -> np.ndarray: ...

    def second(self, u: np.ndarray, /) -> np.ndarray: ...


def natural_scales(
    problem: Bent, u: np.ndarray, bounds: Mapping[str, Interval], *, above: float = np.inf
) -> np.ndarray:
    """A typical size of each unknown (N,): the width of its bounds, else |u|, else what matters as much in g.

    The last is the least size at which a column of g_u or of g_uu weighs as much as the others do, so that scaling
    a variable scales it. It counts also where |u| is nothing beside it but rounding. Where g tells nothing the size is
    |u| if that is `above` this, or no rounding of the size at which g bends in a fast variable alone, or g_y changes
    with a slow one, which is its size else; and 1 for others, or for several fast variables what balances g_y among
    them. Where all are 0 the fast ones have the sizes at which g bends in each alone, if it does.
    """
    names = [s.name for s in problem.unknowns]
    scales = np.array([bounds[n][1] - bounds[n][0] if n in bounds else abs(v) for n, v in zip(names, u)])
    weights = np.abs(problem.jacobian(u))
    slow = {s.name for s in problem.system.x} if isinstance(problem, LayerProblem) else set()
    if np.isfinite(weights).all():
        if isinstance(problem, LayerProblem) and not scales.any():
            fast = range(len(u) - len(problem.system.y), len(u))
            alone = np.array([_size_by_itself(problem, u, j) for j in fast])
            scales[fast] = np.where(np.isfinite(alone), alone, 0.0)
        given = scales.copy()
        for j in (j for j, name in enumerate(names) if name not in bounds):
            others = np.where(np.arange(len(u)) == j, 0.0, given)
            total = weights @ others
            if not total.any():
                # At a fold, to the last bit, g does not move with the fast variables but for how it bends.
                total = 0.5 * np.abs(problem.second(u)) @ others @ others
            matters = _least(total, weights[:, j])
            if given[j] <= NOTHING * matters:
                bent = np.sqrt(_least(2.0 * total, np.abs(problem.second(u)[:, j, j])))
                matters = min(matters, bent)
                if matters == np.inf:
                    alone = _size_by_itself(problem, u, j)
                    if given[j] > min(above, NOTHING * alone):
                        continue
                    if names[j] in slow:
                        matters = alone
                scales[j] = matters if given[j] <= NOTHING * matters else given[j]
    known = (scales > 0.0) & np.isfinite(scales)
    scales = np.where(known, scales, 1.0)
    if isinstance(problem, LayerProblem) and np.isfinite(weights).all():
        fast = len(names) - problem.size
        unsized = np.flatnonzero(~known[fast:])
        scales[fast + unsized] = _balanced(weights[np.ix_(unsized, fast + unsized)])
    return scales


def _size_by_itself(problem: Bent, u: np.ndarray, j: int) -> float:
    """The least size of a fast variable at which a later term of g's series in it weighs as much as the first.

    Of a slow one that at which entries of g_y do so.
    """
    if not isinstance(problem, LayerProblem):
        return float("inf")
    m = len(u) - len(problem.system.y)
    if j < m:
        first, second = (np.abs(of)[:, m:].ravel() for of in (problem.jacobian(u), problem.second(u)[:, j]))
        third = 0.5 * np.abs(problem.bent_slopes(u, j))
        return min(_least(first, second), float(np.sqrt(_least(first, third))))
    along = np.eye(len(problem.system.y))[j - m]
    first, second = np.abs(problem.jacobian(u)[:, j]), 0.5 * np.abs(problem.second(u)[:, j, j])
    third = np.abs(problem.third(u)(along, along, along)) / 6.0
    return (
        min(_least(first, second), float(np.sqrt(_least(first, third))))
        if first.any()
        else _least(second, third)
    )


def _balanced(block: np.ndarray) -> np.ndarray:
    """Sizes (k,) of variables with which the rows of a block (k, k) of |g_y| weigh alike: 1 in the geometric mean."""
    if len(block) < 2:
        return np.ones(len(block))
    sizes = balancing_units(block)
    return sizes / np.exp(np.log(sizes).mean())


def _least(total: np.ndarray, weights: np.ndarray) -> float:
    """The least share of `total` (n,) in `weights` (n,); infinite where there is none."""
    rows = (weights > 0.0) & (total > 0.0)
    return float((total[rows] / weights[rows]).min()) if rows.any() else float("inf")


def eigenvalue_sizes(eigenvalues: np.ndarray) -> np.ndarray:
    """Of the k-th smallest of eigenvalues (m, n) in modulus the largest, (n,), no less than rounding of them all."""
    values = np.sort(np.abs(eigenvalues), axis=1)
    sizes = np.max(np.where(np.isfinite(values), values, 0.0), axis=0, initial=0.0)
    return np.maximum(sizes, np.sqrt(np.finfo(float).eps) * sizes.max(initial=0.0))


def sizes_beside(sizes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Those of `sizes` (n,) that belong to eigenvalues (n,) at one place: what they count as 0 beside.

    Beside the largest of all, -1 were a zero where another direction contracts at a million times that rate.
    """
    return sizes[np.argsort(np.argsort(np.abs(values), kind="stable"), kind="stable")]


def least_norm_newton(equations, u: np.ndarray, scales: np.ndarray, tolerance: float) -> np.ndarray | None:
    """The zero of `equations` next to u by damped Newton steps of least norm in u/scales; None when they fail."""
    found = _least_norm_newtons(
        lambda points: np.array([equations.residual(u) for u in points]),
        lambda points: np.array([equations.jacobian(u) for u in points]),
        u[None, :], scales[None, :], tolerance,
    )[0]  # fmt: skip
    return found if np.isfinite(found).all() else None


def points_near(problem: LayerProblem, u: np.ndarray, scales: np.ndarray, tolerance: float) -> np.ndarray:
    """The points of M0 (m, N) next to each of u (m, N), by steps of least norm in u/scales; NaN where they fail."""
    return _least_norm_newtons(problem.residual, problem.jacobians, u, scales, tolerance)


def _least_norm_newtons(
    residual: Callable[[np.ndarray], np.ndarray],
    jacobian: Callable[[np.ndarray], np.ndarray],
    u: np.ndarray,
    scales: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """The zeros next to points u (m, N), moved where `scales` (m, N) are positive; NaN where Newton's method fails.

    Steps of `tolerance` end it, and those that are rounding of u.
    """
    moving = scales > 0.0
    sizes = np.linalg.norm(np.divide(u, scales, out=np.zeros(u.shape), where=moving), axis=1)
    tolerances = np.maximum(tolerance, 2.0 * np.finfo(float).eps * sizes)
    u, found, left = u.copy(), np.full(u.shape, np.nan), np.arange(len(u))
    # Newton's method for a start: more steps than a corrector takes, as the guess may be poor.
    for _ in range(60):
        if not left.size:
            break
        value, slope = residual(u[left]), jacobian(u[left]) * scales[left, None, :]
        finite = np.isfinite(value).all(axis=1) & np.isfinite(slope).all(axis=(1, 2))
        left, value, slope = left[finite], value[finite], slope[finite]
        size = np.linalg.norm(slope, axis=2)
        size[size == 0.0] = 1.0
        value = value / size
        step = np.einsum("mij,mj->mi", np.linalg.pinv(slope / size[:, :, None], rcond=1e-13), value)
        length = np.linalg.norm(step, axis=1)
        u[left] -= scales[left] * step * np.minimum(1.0, 1.0 / np.maximum(length, 1e-300))[:, None]
        ended = length <= tolerances[left]
        # Where the slope vanishes the step does too, but not the value.
        at_zero = left[ended & (np.abs(value).max(axis=1) <= 100.0 * tolerances[left])]
        found[at_zero], left = u[at_zero], left[~ended]
    return found


def corrected_start(problem: LayerProblem, u: np.ndarray, scales: np.ndarray, tolerance: float) -> np.ndarray:
    """The point of M0 next to u: over the same free variables if there is one, else the nearest.

    Raises `BranchError` when Newton's method fails both ways.
    """
    k = len(problem.free)
    over = _Fast(problem, u[:k])
    y = least_norm_newton(over, u[k:], scales[k:], tolerance)
    found = None if y is None else np.concatenate([u[:k], y])
    if found is None or np.abs((found - u) / scales).max() > 1.0:
        found = least_norm_newton(problem, u, scales, tolerance)
    if found is None:
        size = ", ".join(f"{value:.3g}" for value in problem.residual(u))
        raise BranchError(
            "start is not on the critical manifold and Newton's method found no point of it nearby.",
            "Give a point with g(x, y, 0) near 0; solve_critical(system) has some.",
            got=f"{in_words(problem.point(u))}, where g = {size}",
        )
    return found


@dataclass(frozen=True)
class _Fast:
    """The layer problem at fixed free variables."""

    problem: LayerProblem
    x: np.ndarray

    def residual(self, y: np.ndarray) -> np.ndarray:
        return self.problem.residual(np.concatenate([self.x, y]))

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        return self.problem.jacobian(np.concatenate([self.x, y]))[:, len(self.x) :]
