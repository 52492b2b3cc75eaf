"""Where an orbit drops to from a fold: the layer flow y' = g(x_0, y, 0), out along the centre direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.integration.trajectory import trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.systems.declaration import exact
from gsp.systems.region import Interval
from gsp.systems.system import SlowFastSystem, VectorField

# The drop begins at this distance from the fold along r, relative to 1 + |y_0|; its error there is the cube.
BEGINNING = 1e-4
# Fast times, in units of the time that the escape from there takes, and how often they are doubled.
PATIENCE, DOUBLINGS = 2.0, 8
# Beyond this distance, relative to 1 + |y_0|, the drop counts as having no end.
FAR = 1e8


class DropKind(StrEnum):
    """What a drop lands on."""

    SHEET = "an attracting sheet"
    ESCAPE = "nothing: it escapes"
    LEAVES = "nothing in the region"
    UNSETTLED = "no equilibrium"


@dataclass(frozen=True, eq=False, repr=False)
class Drop:
    """Where the layer flow leads from a fold: `kind`, the last `point` by name, and its fast `eigenvalues` (n_fast,).

    At a SHEET `point` is a point of M0, polished; otherwise it is where the drop was given up.
    """

    kind: DropKind
    point: Mapping[str, float]
    eigenvalues: np.ndarray

    @property
    def lands(self) -> bool:
        """Whether the drop ends on an attracting sheet of M0."""
        return self.kind is DropKind.SHEET

    def __str__(self) -> str:
        place = ", ".join(f"{name} = {value:.8g}" for name, value in self.point.items())
        if not self.lands:
            return f"the drop lands on {self.kind}; last seen at {place}"
        values = ", ".join(f"{v:.4g}" for v in np.real_if_close(self.eigenvalues))
        return f"the drop lands on {self.kind} at {place} (fast eigenvalues {values})"

    def __repr__(self) -> str:
        return f"Drop({self})"


def drop_from(
    system: SlowFastSystem,
    x: np.ndarray,
    y: np.ndarray,
    direction: np.ndarray,
    bending: np.ndarray,
    *,
    rate: float,
    region: Mapping[str, Interval] | None,
) -> Drop:
    """The drop over `x` from the fold `y` along `direction`, on y + direction v + bending v^2, v' = `rate` v^2."""
    rates = [laurent(g, system.epsilon, order=0).get(0, sp.Integer(0)) for g in system.g]
    fixed = {s: exact(float(value)) for s, value in zip(system.x, x)}
    layer = VectorField(dict(zip(system.y, rates)), epsilon=None, parameters={**system.parameters, **fixed})
    names = [s.name for s in system.y]
    n, scale = len(y), 1.0 + float(np.linalg.norm(y))
    v = BEGINNING * scale
    here = y + direction * v + bending * v**2
    span = PATIENCE / (rate * v)
    slow = {s.name: float(value) for s, value in zip(system.x, x)}
    compiled = compile_over(system, [*rates, *(derivative(g, s) for g in rates for s in system.y)])
    constants = compile_flow(system).constants

    def values(at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        out = compiled(np.concatenate([x, at]), constants)
        return out[:n], out[n:].reshape(n, n)

    def result(kind: DropKind, at: np.ndarray) -> Drop:
        matrix = values(at)[1]
        finite = bool(np.isfinite(matrix).all())
        spectrum = np.linalg.eigvals(matrix) if finite else np.full(n, np.nan)
        return Drop(kind, {**slow, **dict(zip(names, map(float, at)))}, spectrum)

    for _ in range(DOUBLINGS):
        run = trajectory_of(
            layer, start=dict(zip(names, here)), span=(0.0, span), rtol=1e-10, atol=1e-12 * scale
        )
        outside = _leaving(run.y, names, region)
        if outside is not None:
            return result(DropKind.LEAVES, run.y[:, outside])
        here = run.y[:, -1].copy()
        if not run.status.ok or np.linalg.norm(here - y) > FAR * scale:
            return result(DropKind.ESCAPE, here)
        landed = _equilibrium(values, here, y)
        if landed is not None:
            return result(DropKind.SHEET, landed)
        span *= 2.0
    return result(DropKind.UNSETTLED, here)


def _leaving(y: np.ndarray, names: list[str], region: Mapping[str, Interval] | None) -> int | None:
    """The first column of `y` outside the region."""
    if region is None:
        return None
    outside = np.zeros(y.shape[1], dtype=bool)
    for i, name in enumerate(names):
        if name in region:
            low, high = region[name]
            outside |= (y[i] < low) | (y[i] > high)
    return int(np.argmax(outside)) if outside.any() else None


def _equilibrium(values, here: np.ndarray, fold: np.ndarray) -> np.ndarray | None:
    """The attracting equilibrium at `here`, by Newton's method; None when it has not been reached."""
    y = here.copy()
    for _ in range(20):
        g, g_y = values(y)
        try:
            step = np.linalg.solve(g_y, g)
        except np.linalg.LinAlgError:
            return None
        y = y - step
        if not np.isfinite(y).all():
            return None
        if np.linalg.norm(step) <= 1e-13 * (1.0 + np.linalg.norm(y)):
            break
    near = np.linalg.norm(y - here) <= 1e-4 * (1.0 + np.linalg.norm(y))
    away = np.linalg.norm(y - fold) > 10.0 * BEGINNING * (1.0 + np.linalg.norm(fold))
    stable = np.linalg.eigvals(values(y)[1]).real.max() < 0.0
    return y if near and away and stable else None
