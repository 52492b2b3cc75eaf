"""Where an orbit drops to from a fold: the layer flow y' = g(x_0, y, 0), out along the centre direction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gsp.fibres.layer_end import attractor_at
from gsp.fibres.layer_flow import LayerFlow
from gsp.integration.trajectory import trajectory_of
from gsp.systems.flow import in_words
from gsp.systems.region import Interval

# The drop begins at this distance from the fold along r, in the layer's units; its error there is the cube.
BEGINNING = 1e-4


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
        place = in_words(self.point, 8)
        if self.kind is DropKind.ESCAPE:
            # The fast variables come last.
            fast = list(self.point.items())[-len(self.eigenvalues) :]
            name, value = max(fast, key=lambda pair: abs(pair[1]))
            return f"the drop lands on {self.kind}, and {name} goes to {'-' if value < 0.0 else ''}infinity"
        if not self.lands:
            return f"the drop lands on {self.kind}; last seen at {place}"
        values = ", ".join(f"{v:.4g}" for v in np.real_if_close(self.eigenvalues))
        return f"the drop lands on {self.kind} at {place} (fast eigenvalues {values})"

    def __repr__(self) -> str:
        return f"Drop({self})"


# A drop that escapes may pass the largest number: infinity lies beyond every bound.
@np.errstate(over="ignore")
def drop_from(
    layer: LayerFlow,
    fold: np.ndarray,
    direction: np.ndarray,
    bending: np.ndarray,
    *,
    rate: float,
    region: Mapping[str, Interval] | None,
) -> Drop:
    """The drop from the `fold` y along `direction`, on y + direction v + bending v^2, v' = `rate` v^2.

    All of these (n_fast,) are in the system's units, and lengths are measured in those of `layer`.
    """
    slow = {s.name: float(value) for s, value in zip(layer.system.x, layer.x)}
    centre, layer = layer.system.centre[len(layer.x) :], layer.about_centres
    fold = fold - centre
    units = layer.units
    names = [s.name for s in layer.system.y]
    v = BEGINNING / float(np.linalg.norm(direction / units))
    y, here = fold / units, (fold + direction * v + bending * v**2) / units
    # Twice the time that the escape from there takes, doubled until it has.
    span = 2.0 / (rate * v)
    flow = layer.flow()

    def result(kind: DropKind, at: np.ndarray) -> Drop:
        matrix = layer.jacobian(at[None, :])[0]
        finite = bool(np.isfinite(matrix).all())
        spectrum = np.linalg.eigvals(matrix) if finite else np.full(len(at), np.nan)
        return Drop(kind, {**slow, **dict(zip(names, map(float, at * units + centre)))}, spectrum)

    for _ in range(8):
        run = trajectory_of(flow, start=dict(zip(names, here)), span=(0.0, span), rtol=1e-10, atol=1e-12)
        outside = _leaving(run.y * units[:, None] + centre[:, None], names, region)
        if outside is not None:
            return result(DropKind.LEAVES, run.y[:, outside])
        here = run.y[:, -1].copy()
        # Beyond this distance, in the layer's units, the drop counts as having no end.
        if not run.status.ok or np.linalg.norm(here - y) > 1e8:
            return result(DropKind.ESCAPE, here)
        landed = attractor_at(layer, here)
        if landed is not None and np.linalg.norm(landed - y) > 10.0 * BEGINNING:
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
