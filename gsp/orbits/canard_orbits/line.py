"""The line on one sheet of M0 where orbits of a sheet begin, and starts on it inside the funnel."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_flow import compile_flow
from gsp.orbits.canard_orbits.frame import DEPARTURE, FoldedNodeFrame, Plane
from gsp.roots import root

# Points of the strong singular canard that are looked at for the default line.
LOOKS = 4000
_NOTHING = [float("nan")]


class SheetNotFound(Exception):
    """Within the package: no sheet could be started; the message says why."""


class SheetLine:
    """A line {state = value} on the attracting (`side` 1) or repelling (-1) sheet of M0.

    `plane` is the one given, or the level of the fast variable where the strong singular canard has contracted by
    the first of DECAYS powers of e that has starts; where the next fold comes before, the level where |g_y| is
    largest. `contraction` is what it has contracted there.
    """

    def __init__(self, frame: FoldedNodeFrame, side: int, plane: Plane | None) -> None:
        self.frame, self.side = frame, side
        self.desingularised = compile_flow(frame.desingularised)
        self.strong = frame.strong_canard(side)
        if plane is None:
            # How many powers of e orbits come nearer to M_epsilon between a default line and the node: the first of
            # these at which the slow flow runs to the node from beside the strong canard too.
            for decay in (40.0, 32.0, 25.0, 20.0, 16.0, 12.0):
                self._put(self._default(decay))
                if self.crossing is not None and next(self.starts(), None) is not None:
                    break
        else:
            self._put(plane)
        if self.crossing is None:
            raise SheetNotFound(
                f"the strong singular canard does not cross {self.in_words()} on the {self.kind} sheet."
            )
        self.contraction = float(self.strong.at(self.crossing)[3] / frame.epsilon)

    def _put(self, plane: Plane) -> None:
        self.plane, self.crossing = plane, _crossing(self.strong, plane)

    @property
    def kind(self) -> str:
        return "attracting" if self.side > 0 else "repelling"

    def in_words(self) -> str:
        """The line for messages."""
        frame, index = self.frame, self.plane.index
        return (
            f"the line {frame.system.states[index].name} = {frame.units.back.of(self.plane.value)[index]:.6g}"
        )

    def _default(self, decay: float) -> Plane:
        times = np.linspace(0.0, self.strong.t[-1], LOOKS)
        states = self.strong.at(times).T
        fold = -self.side * self.frame.critical(states[:, :3], _NOTHING)[:, 4]
        turned = np.flatnonzero(~(fold > 0.0))
        last = int(turned[0]) if turned.size else LOOKS
        enough = np.flatnonzero(states[:last, 3] >= decay * self.frame.epsilon)
        furthest = int(np.argmax(fold[:last])) if turned.size else LOOKS - 1
        place = int(enough[0]) if enough.size else furthest
        return Plane(2, float(states[place, 2]))

    @property
    def beginning(self) -> np.ndarray:
        """Where the strong canard crosses the line (3,)."""
        assert self.crossing is not None
        return self.strong.at(self.crossing)[:3]

    def starts(self) -> Iterator[tuple[np.ndarray, float]]:
        """Points of the line inside the funnel, from the strong canard on, and the slow time from each to the node."""
        frame = self.frame
        beside = frame.outwards(
            frame.point + self.side * DEPARTURE * (frame.strong + frame.weak), abs(float(self.strong.t[-1]))
        )
        met = _crossing(beside, self.plane)
        if met is None or self.crossing is None:
            return
        z = self.beginning
        along, distance = self._along(z, beside.at(met)[:3] - z), frame.unit
        # Where the first start is too far, half of it.
        for _ in range(5):
            if self._serves(self._on(z + distance * along)):
                break
            distance *= 0.5
        # Starts are one local unit apart and then three tenths more each.
        for _ in range(24):
            z = self._on(z + distance * along)
            if not self._serves(z):
                return
            along = self._along(z, along)
            time = self._duration(z)
            if np.isfinite(time):
                yield z, time
            distance *= 1.3

    def enters(self, z: np.ndarray) -> bool:
        """Whether the desingularised reduced flow crosses the line at z as along the strong canard, to the node."""
        if self.crossing is None:
            return False
        return self._heading(z) * self._heading(self.beginning) > 0.0

    def _serves(self, z: np.ndarray) -> bool:
        """On the line's sheet, and before the line runs along the slow flow, where the family ends."""
        return self.side * self.frame.critical(z, _NOTHING)[4] < 0.0 and self.enters(z)

    def _heading(self, z: np.ndarray) -> float:
        return float(self.desingularised.rates([*z, 0.0], _NOTHING)[self.plane.index])

    def _along(self, z: np.ndarray, towards: np.ndarray) -> np.ndarray:
        """Unit tangent at z of the line on M0."""
        across = np.zeros(3)
        across[self.plane.index] = 1.0
        tangent = np.cross(self.frame.gradient(z), across)
        return tangent / np.linalg.norm(tangent) * np.sign(tangent @ towards)

    def _on(self, z: np.ndarray) -> np.ndarray:
        """The point of the line on M0 next to z."""
        z = z.copy()
        z[self.plane.index] = self.plane.value
        return self.frame.on_critical(z, held=self.plane.index)

    def _duration(self, z: np.ndarray) -> float:
        """Slow time that the reduced flow takes from z into the node, dt = -g_y ds; infinite when it leaves."""
        run = self.frame.inwards(z)
        states = run.y.T
        if not np.linalg.norm(states[-1, :2] - self.frame.point[:2]) < self.frame.unit:
            return float("inf")
        fold = np.abs(self.frame.critical(states[:, :3], _NOTHING)[:, 4])
        return float(np.sum(0.5 * (fold[1:] + fold[:-1]) * np.abs(np.diff(run.t))))


def crossing_times(path: Trajectory, plane: Plane) -> Iterator[tuple[int, float]]:
    """The times at which a path crosses a plane, each with the row of `path.t` before it."""
    values = path.y[plane.index] - plane.value
    for k in np.flatnonzero(values[:-1] * values[1:] <= 0.0):
        found = root(
            lambda t: float(path.at(t)[plane.index] - plane.value),
            float(path.t[k]),
            float(path.t[k + 1]),
            ends=(float(values[k]), float(values[k + 1])),
        )
        assert found is not None
        yield int(k), found


def _crossing(path: Trajectory, plane: Plane) -> float | None:
    return next((time for _, time in crossing_times(path, plane)), None)
