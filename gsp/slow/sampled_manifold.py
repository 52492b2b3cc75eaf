"""A slow manifold known by its points: the interpolant between them, with what is known of its error."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from gsp.critical.branch import Branch
from gsp.errors import GspError, Status
from gsp.hyperbolicity.hyperbolicity import Kind
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.results.bounds import as_given
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.slow.chebyshev import ChebyshevSurface
from gsp.systems.flow import as_points
from gsp.systems.region import EDGE, Interval, shown_region


@dataclass(frozen=True, eq=False, repr=False)
class SampledManifold(Card, Tabular):
    """The slow manifold of `branch` over `region` at one `epsilon`: y = `evaluate(x)`.

    `kind` and `gap` are those of M0 over the region. `error_estimates` (n_fast,) are meant to bound the errors of
    `evaluate`: twice the residual of the invariance equation over the gap, at points that were not solved for, plus
    what is left of the ends of the orbit segments (infinite when there is no surface). `nodes` (k, n_slow) and
    `values` (k, n_fast) are the points that were solved, NaN where that failed, and `node_errors` (k,) their estimated
    errors. With a failure among them, normal rates that change their type on it, or an estimate above the size of y,
    there is no surface and `evaluate` gives NaN.
    `status` and `message` say how it ended, where, and what to do.
    """

    branch: Branch
    region: Mapping[str, Interval]
    epsilon: float
    tolerance: float
    kind: Kind
    gap: float
    nodes: np.ndarray
    values: np.ndarray
    node_errors: np.ndarray
    error_estimates: np.ndarray
    status: Status
    message: str
    surface: ChebyshevSurface | None
    """The interpolant, or None when there is none."""

    @property
    def error_estimate(self) -> float:
        """The largest of `error_estimates`."""
        return float(self.error_estimates.max())

    def evaluate(self, x) -> np.ndarray:
        """h_epsilon(x), shape (m, n_fast), or (n_fast,) for one point; `x` is as for `Branch.points`.

        Raises `GspError` for a point outside the region.
        """
        return self._told(x, lambda surface, at: surface(at))

    def slope(self, x) -> np.ndarray:
        """Dh_epsilon(x), shape (m, n_fast, n_slow), or (n_fast, n_slow) for one point."""
        return self._told(x, lambda surface, at: surface.derivative(at), len(self.branch.system.x))

    def residual(self, x) -> np.ndarray:
        """Defect of the invariance equation, epsilon Dh f(x, h, epsilon) - g(x, h, epsilon), as `evaluate`."""
        return self._told(x, lambda surface, at: defect_of(self.branch, surface, self.epsilon, at)[0])

    def _told(self, x, told: Callable[[ChebyshevSurface, np.ndarray], np.ndarray], *more: int) -> np.ndarray:
        """What a surface tells at each point, (n_fast, `more`) numbers; NaN where there is none."""
        array, single = self._inside(x)
        shape = (len(array), len(self.branch.system.y), *more)
        found = np.full(shape, np.nan) if self.surface is None else told(self.surface, array)
        return found[0] if single else found

    def covers(self, x: np.ndarray) -> np.ndarray:
        """Which coordinates (m, n_slow) of points `x` (m, n_slow) lie in the region, to rounding."""
        low, high = np.array([self.region[s.name] for s in self.branch.system.x]).T
        margin = EDGE * (high - low)
        return (x >= low - margin) & (x <= high + margin)

    def _inside(self, x) -> tuple[np.ndarray, bool]:
        array, single = as_points(self.branch.system.x, x, what="x")
        covered = self.covers(array)
        for i, symbol in enumerate(self.branch.system.x):
            low, high = self.region[symbol.name]
            outside = array[~covered[:, i], i]
            if outside.size:
                raise GspError(
                    f"the manifold covers {symbol} in [{low:g}, {high:g}].",
                    "Ask inside, or solve it over a larger region.",
                    got=f"{symbol} = {as_given(outside[0])}",
                    value=float(outside[0]),
                    point={symbol.name: float(outside[0])},
                )
        return array, single

    def __repr__(self) -> str:
        return (
            f"SampledManifold({self.branch}, {shown_region(self.region)}, epsilon={self.epsilon:g}, {self.kind}, "
            f"nodes={len(self.nodes)}, error_estimate={self.error_estimate:.2g}, {self.status.name})"
        )

    def __str__(self) -> str:
        at = f"{self.branch.system.epsilon} = {self.epsilon:g}"
        return f"{self.kind} slow manifold of {self.branch} at {at}\n  {self.message}"


def defect_of(
    branch: Branch, surface: ChebyshevSurface, epsilon: float, x: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """epsilon Dh f - g (m, n_fast), and what it is divided by for the error: g_y - epsilon Dh f_y."""
    system = branch.system
    flow, p = compile_flow(system), parameter_vector(system, epsilon)
    nx = len(system.x)
    z = np.hstack([x, surface(x)])
    slope = surface.derivative(x)
    rates = flow.rates(z, p)
    J = flow.jacobians(z, p)
    defect = epsilon * (np.einsum("mij,mj->mi", slope, rates[:, :nx]) - rates[:, nx:])
    return defect, epsilon * (J[:, nx:, nx:] - slope @ J[:, :nx, nx:])
