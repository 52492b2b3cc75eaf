"""Initial layers: composite expansions, uniformly valid from the start on.

composite = inner + outer - common. The outer solution is the slow flow of order n from the base point corrected
through epsilon^n; the common part is what the inner series tends to, so that inner - common are its decaying parts, and
the sum is in error by O(epsilon^(n+1)) on the whole span (A. B. Vasil'eva, V. F. Butuzov and L. V. Kalachev, The
Boundary Function Method for Singular Perturbation Problems, SIAM, 1995). Equation (17) of Eldering (2015) is the
sleigh's inner solution through order 1 with v and omega frozen.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.critical.branch import Branch
from gsp.errors import GspError, HyperbolicityError, Status
from gsp.fibres.inner_expansion import InnerExpansion, expand_inner
from gsp.integration.loop import check_grid, check_span
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.slow.expansion import Expansion
from gsp.slow.run_series import run_series
from gsp.slow.series import SeriesManifold
from gsp.systems.arguments import check_noun, check_times
from gsp.systems.declaration import reconstruction_of
from gsp.systems.flow import Point, check_epsilon, check_order

RTOL = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class CompositeSolution(Card, Tabular):
    """A composite expansion z(t): `t` (m,) and `y` (n, m), read-only, rows as in `names`.

    `["name"]` is a state, a reconstruction variable or an observable over `t`, `.at(t)` the state at other times,
    `.sample(t)` the same solution there. `inner` is the inner series, `outer` the slow flow's trajectory; `status` is
    that of the outer run. `inner_at`, `outer_at` and `common_at` are the three parts.
    """

    inner: InnerExpansion
    outer: Trajectory
    epsilon: float
    order: int
    names: tuple[str, ...]
    t: np.ndarray
    y: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        times = np.array(self.t, dtype=float, ndmin=1)
        values = self.at(times)
        for array in (times, values):
            array.setflags(write=False)
        object.__setattr__(self, "t", times)
        object.__setattr__(self, "y", values)

    @property
    def status(self) -> Status:
        """How the outer run ended; `t` covers what it reached."""
        return self.outer.status

    @property
    def layer_time(self) -> float:
        """epsilon/gap: the time in which the layer falls by a factor e, at the slowest."""
        return self.epsilon / self.inner.gap

    def __getitem__(self, key: str | sp.Symbol) -> np.ndarray:
        """Values (m,) over `t`; raises `GspError` for an unknown name."""
        name = key.name if isinstance(key, sp.Symbol) else key
        if name in self.names:
            return self.y[self.names.index(name)]
        system = self.inner.branch.system
        observables = [s.name for s in system.observables]
        if name in observables:
            states = self.y[[self.names.index(s.name) for s in system.states]].T
            values = compile_flow(system).observables(states, parameter_vector(system, self.epsilon))
            return values[:, observables.index(name)]
        known = [*self.names, *observables]
        raise GspError.none_of(known, name, f"{name!r} is no state and no observable.", "Those are")

    def at(self, t: ArrayLike) -> np.ndarray:
        """State (n,) at a time, or (n, m) at times (m,); raises `GspError` outside the span."""
        times = check_times(t)
        outer = self.outer_at(times)
        layer = self.inner.layer(self._fast(times), self.epsilon, order=self.order)
        return outer + self._rows(layer).reshape(outer.shape)

    def sample(self, t: ArrayLike) -> CompositeSolution:
        """The same solution on other times."""
        return CompositeSolution(
            self.inner, self.outer, self.epsilon, self.order, self.names, np.atleast_1d(check_times(t))
        )

    def outer_at(self, t: ArrayLike) -> np.ndarray:
        """The slow flow from the base point, as `at`."""
        times = check_times(t)
        run = self.outer.sample(np.atleast_1d(times))
        rows = np.array([run[name] for name in self.names])
        return rows if times.ndim else rows[:, 0]

    def inner_at(self, t: ArrayLike) -> np.ndarray:
        """The inner series through `order`, as `at`; good for t of the size of epsilon."""
        common = self.common_at(t)
        layer = self.inner.layer(self._fast(check_times(t)), self.epsilon, order=self.order)
        return common + self._rows(layer).reshape(common.shape)

    def common_at(self, t: ArrayLike) -> np.ndarray:
        """What inner and outer share, polynomials in t/epsilon, as `at`."""
        times = check_times(t)
        rows = self._rows(self.inner.matched(self._fast(times), self.epsilon, order=self.order))
        return rows if times.ndim else rows[:, 0]

    def inner_expression(self, name: str, tau: sp.Symbol) -> sp.Expr:
        """The inner series of one variable in fast time `tau` and the system's epsilon; exact layers only."""
        epsilon = self.inner.branch.system.epsilon
        return sp.Add(*[epsilon**k * self.inner.expression(name, k, tau) for k in range(self.order + 1)])

    def _fast(self, times: np.ndarray) -> np.ndarray:
        return (np.atleast_1d(times) - self.outer.t[0]) / self.epsilon

    def _rows(self, parts: Mapping[str, np.ndarray]) -> np.ndarray:
        return np.array([parts[name] for name in self.names])

    def __repr__(self) -> str:
        return (
            f"CompositeSolution([{', '.join(self.names)}], order={self.order}, epsilon={self.epsilon:g}, "
            f"t={self.t[0]:.6g}..{self.t[-1]:.6g}, {self.status.name})"
        )


def composite(
    manifold: SeriesManifold | Branch,
    start: Point,
    *,
    span: tuple[float, float],
    epsilon: float,
    order: int = 1,
    at: ArrayLike | None = None,
    reconstruction: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> CompositeSolution:
    """The composite expansion of the solution through `start` over `span`, in error by O(epsilon^(order+1)).

    `start` names every state of the system in standard form; with `at` (m,) these are the result's times. Raises as
    `project` does, `HyperbolicityError` where the layer grows, on a repelling branch and backward in time, and
    `DeclarationError` for an order that the series does not reach.

    >>> from gsp.fibres.composite_solution import composite
    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=eps)
    >>> solution = composite(solve_critical(system).branches[0], {"x": 1, "y": 3}, span=(0, 1), epsilon=0.01)
    >>> solution.at(0.0).round(3), solution.inner_expression("y", sp.Symbol("tau"))
    (array([1., 3.]), epsilon*(-tau + 2*tau*exp(-tau) - 1 + exp(-tau)) + 1 + 2*exp(-tau))
    """
    check_noun(manifold, (SeriesManifold, Branch), verb="composite")
    value = check_epsilon(epsilon)
    check_order(order)
    first, last = check_span(span)
    grid = None if at is None else check_grid(at, first, last)
    branch = manifold if isinstance(manifold, Branch) else manifold.branch
    reconstruction = reconstruction_of(branch.system, reconstruction)
    series = manifold if isinstance(manifold, SeriesManifold) else run_series(Expansion(branch), order)
    flow = restrict(series, order=order, reconstruction=reconstruction)
    inner = expand_inner(branch, start, order=order, reconstruction=reconstruction)
    # Where it ends early the fast variables are known through one order less than the slow ones.
    inner.require(order + 1 if inner.ending else order)
    if inner.direction < 0:
        raise HyperbolicityError(
            f"the branch {branch} repels, so a layer grows forward in time from {dict(inner.start)}.",
            "There is nothing to match; start on the manifold, or on an attracting branch.",
        )
    if last < first:
        raise HyperbolicityError(
            f"the branch {branch} attracts, so a layer grows backward in time from {dict(inner.start)}.",
            "There is nothing to match; give a span that runs forward.",
            got=f"span = ({first:g}, {last:g})",
        )
    base = {n: sum(float(c) * value**k for k, c in enumerate(terms)) for n, terms in inner.base.items()}
    outer = trajectory_of(flow, start=base, span=span, epsilon=value, rtol=RTOL, atol=0.01 * RTOL)
    names = (*(s.name for s in branch.system.states), *(s.name for s in reconstruction or {}))
    times = _times(outer, value / inner.gap) if grid is None else grid
    return CompositeSolution(inner, outer, value, order, names, times)


def _times(outer: Trajectory, layer_time: float) -> np.ndarray:
    first, last = float(outer.t[0]), float(outer.t[-1])
    length = min(40.0 * layer_time, last - first)
    inside = first + length * np.append(0.0, np.geomspace(1e-3, 1.0, 120))
    # In the layer times are spaced geometrically from a thousandth of its length, and after it evenly.
    return np.unique(np.append(np.minimum(inside, last), np.linspace(first, last, 200)))
