"""Canards as orbits: one boundary-value problem from the attracting line through the section to the repelling one.

Where the curves of the two sheets cross in the section an orbit lies on both: a canard. Joined, its two segments
solve the boundary-value problem with both ends on M0 and on their lines; its time is an unknown, and the section
takes no part in it, so that the crossing of the curves and the orbit are two routes to one point.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from gsp.collocation.bordered import Conditions
from gsp.orbits.canard_orbits.collocation import Collocation, OrbitSegment, joined
from gsp.orbits.canard_orbits.frame import FoldedNodeFrame, Plane
from gsp.orbits.canard_orbits.sheet import Sheet
from gsp.roots import root
from gsp.systems.arguments import check_times
from gsp.systems.flow import Flow, in_words

# Interpolation error that a canard's mesh is made for, and its elements at least and at most.
PRECISION, FEWEST, MOST = 1e-11, 80, 1500
# Crossings that are kept, and the places looked at for them, at most: curves that run along each other have more.
MOST_CROSSINGS, MOST_PLACES = 300, 4000
# Chords of the interpolant from one segment to the next on which crossings are looked for.
CHORDS = 8
# States of an orbit that are looked at where its turns are counted, an element.
LOOKS = 12
# A deviation from the axis below this share of the local width has no sign.
SIGNLESS = 1e-9


class CanardKind(StrEnum):
    """Which canard of a folded node."""

    STRONG = "strong canard"
    SECONDARY = "secondary canard"
    WEAK = "weak canard"


@dataclass(frozen=True, eq=False, repr=False)
class Canard:
    """A maximal canard of a folded node: an orbit on both slow manifolds, with how well it is known.

    - `kind`, and `index` k of gamma_0 (0) and the secondary canards xi_k; `None` for the weak one;
    - `half_turns` about the weak canard: 2 k + 1 for xi_k, `None` where they cannot be told (on the weak one);
    - `point`: where it crosses the section, by name; `time_before` and `time_after` the slow time it takes
      from its attracting line to there and from there to its repelling line;
    - `crossing_gap`: distance in the section from where the interpolated curves of the sheets cross, in local units;
    - `residual`: largest relative defect of the orbit in the field between collocation points; `error`: by how much
      `point` moves, in local units, when every element is halved;
    - `["name"]` are states along it and `t` the slow time, 0 at the section, as arrays.
    """

    system: Flow
    epsilon: float
    kind: CanardKind
    index: int | None
    half_turns: int | None
    point: Mapping[str, float]
    time_before: float
    time_after: float
    crossing_gap: float
    residual: float
    error: float
    orbit: OrbitSegment
    attracting_line: Plane
    repelling_line: Plane
    section: Plane
    frame: FoldedNodeFrame

    @property
    def name(self) -> str:
        """gamma_0, xi_k or gamma_w."""
        if self.kind is CanardKind.WEAK:
            return "gamma_w"
        return "gamma_0" if self.index == 0 else f"xi_{self.index}"

    @property
    def t(self) -> np.ndarray:
        """Slow time along the orbit, 0 at the section."""
        return self.orbit.time * self._sigma() - self.time_before

    def __getitem__(self, name: str) -> np.ndarray:
        """A state along the orbit, over `t`."""
        names = [s.name for s in self.system.states]
        return self.orbit.at(self._sigma())[:, names.index(name)]

    def at(self, t: np.ndarray | float) -> np.ndarray:
        """States (k, n) at slow times t (k,), or (n,) at one, from the collocation polynomials."""
        times = check_times(t)
        states = self.orbit.at((np.atleast_1d(times) + self.time_before) / self.orbit.time)
        return states if times.ndim else states[0]

    def _sigma(self) -> np.ndarray:
        return np.append(self.orbit.places(4), 1.0)

    def __repr__(self) -> str:
        turns = (
            "" if self.half_turns is None else f", {self.half_turns} half-turn" + "s" * (self.half_turns > 1)
        )
        return f"Canard({self.name} at {in_words(self.point, 8)}{turns})"


class CanardSolver:
    """Solves the boundary-value problem of canards between two lines; `free` makes epsilon an unknown."""

    def __init__(
        self, frame: FoldedNodeFrame, lines: tuple[Plane, Plane], *, epsilon_free: bool = False
    ) -> None:
        self.frame = frame
        self.lines = lines
        self.solver = Collocation(frame.system, epsilon_free=epsilon_free)

    def conditions(self, orbit: OrbitSegment) -> Conditions:
        """Both ends on M0 and on their lines: four rows."""
        left, right, target = np.zeros((4, 3)), np.zeros((4, 3)), np.zeros(4)
        for rows, matrix, z, line in zip(((0, 1), (2, 3)), (left, right), (orbit.start, orbit.end), self.lines):
            matrix[rows[0]], target[rows[0]] = self.frame.gradient(z), -self.frame.g(z)
            matrix[rows[1], line.index], target[rows[1]] = 1.0, line.value - z[line.index]
        return Conditions(left, right, np.zeros((4, 1)), target)

    def solve(self, guess: OrbitSegment) -> OrbitSegment | None:
        """The canard near an orbit, on a mesh adapted to it."""
        orbit: OrbitSegment | None = guess
        # Meshes on which a canard is solved one after another, each adapted to the orbit before.
        for _ in range(3):
            if orbit is None:
                return None
            orbit = self.solver.solve(orbit.adapted(PRECISION, FEWEST, MOST), self.conditions)
        return orbit

    def settled(self, guess: OrbitSegment) -> OrbitSegment | None:
        """The canard near an orbit where `solve` ends in rounding, as where the two manifolds touch."""
        return self.solver.settled(guess.adapted(PRECISION, FEWEST, MOST), self.conditions)

    def finer(self, orbit: OrbitSegment, *, settles: bool) -> OrbitSegment | None:
        """The same canard with every element halved, where Newton's method `settles` or in rounding."""
        solve = self.solver.solve if settles else self.solver.settled
        return solve(orbit.halved(), self.conditions)


@dataclass(frozen=True, eq=False)
class SectionCrossing:
    """Where two curves in the section cross: `place` (2,), and on each the segment before it and the share beyond."""

    place: np.ndarray
    attracting: tuple[int, float]
    repelling: tuple[int, float]


def crossings(attracting: Sheet, repelling: Sheet) -> tuple[list[SectionCrossing], bool]:
    """Where the curves of two sheets cross, from the outermost inwards, on their cubic Hermite interpolants.

    The second value is whether these are all: MOST_CROSSINGS and MOST_PLACES bound the search.
    """
    a, b = (sheet.chords(CHORDS) for sheet in (attracting, repelling))
    found: list[SectionCrossing] = []
    places = 0
    lower, upper = b.min(axis=1), b.max(axis=1)
    for i in reversed(range(len(a))):
        points = a[i]
        near = (lower <= points.max(axis=0)).all(axis=1) & (upper >= points.min(axis=0)).all(axis=1)
        for j in np.flatnonzero(near):
            step, across = np.diff(points, axis=0)[:, None], np.diff(b[j], axis=0)[None]
            away = b[j][None, :-1] - points[:-1, None]
            with np.errstate(divide="ignore", invalid="ignore"):
                area = step[..., 0] * across[..., 1] - step[..., 1] * across[..., 0]
                s = (away[..., 0] * across[..., 1] - away[..., 1] * across[..., 0]) / area
                t = (away[..., 0] * step[..., 1] - away[..., 1] * step[..., 0]) / area
            # A little beyond the chords: the interpolants bulge.
            for k, m in zip(*np.nonzero((s >= -0.1) & (s <= 1.1) & (t >= -0.1) & (t <= 1.1))):
                if len(found) >= MOST_CROSSINGS or places >= MOST_PLACES:
                    return _ordered(found), False
                places += 1
                start = (k + s[k, m]) / CHORDS, (m + t[k, m]) / CHORDS
                refined = _refined(attracting, i, float(start[0]), repelling, int(j), float(start[1]))
                if refined is not None and not any(_same(refined, other) for other in found):
                    found.append(refined)
    return _ordered(found), True


def _ordered(found: list[SectionCrossing]) -> list[SectionCrossing]:
    return sorted(found, key=lambda crossing: -sum(crossing.attracting))


def _same(one: SectionCrossing, other: SectionCrossing) -> bool:
    return all(
        abs(sum(p) - sum(q)) < 1e-3
        for p, q in ((one.attracting, other.attracting), (one.repelling, other.repelling))
    )


def _refined(first: Sheet, i: int, s: float, second: Sheet, j: int, t: float) -> SectionCrossing | None:
    for _ in range(20):
        (p, dp), (q, dq) = first.interpolated(i, s), second.interpolated(j, t)
        matrix = np.stack([dp, -dq], axis=1)
        if abs(np.linalg.det(matrix)) < 1e-14 * np.linalg.norm(dp) * np.linalg.norm(dq):
            return None
        ds, dt = np.linalg.solve(matrix, q - p)
        s, t = s + float(np.clip(ds, -0.3, 0.3)), t + float(np.clip(dt, -0.3, 0.3))
        if max(abs(ds), abs(dt)) < 1e-13:
            break
    inside = -1e-9 <= s < 1.0 + 1e-9 and -1e-9 <= t < 1.0 + 1e-9
    return SectionCrossing(first.interpolated(i, s)[0], (i, s), (j, t)) if inside else None


def guess_at(crossing: SectionCrossing, attracting: Sheet, repelling: Sheet) -> OrbitSegment:
    """The two segments at a crossing, each blended from its neighbours on its sheet, joined."""
    halves = []
    for sheet, (i, s) in ((attracting, crossing.attracting), (repelling, crossing.repelling)):
        halves.append(sheet.segments[i].blended(sheet.segments[i + 1], float(np.clip(s, 0.0, 1.0))))
    return joined(*halves)


def section_crossing(orbit: OrbitSegment, section: Plane, near: float) -> tuple[float, np.ndarray] | None:
    """Share of the orbit's time at which it crosses the section, the one next to `near`, and the state there."""
    sigma = orbit.places(LOOKS)
    values = orbit.at(sigma)[:, section.index] - section.value
    change = np.flatnonzero(values[:-1] * values[1:] <= 0.0)
    if not change.size:
        return None
    k = int(change[np.argmin(np.abs(sigma[change] - near))])
    found = root(
        lambda share: float(orbit.at(np.array([share]))[0, section.index] - section.value),
        float(sigma[k]),
        float(sigma[k + 1]),
        ends=(float(values[k]), float(values[k + 1])),
    )
    assert found is not None
    return found, orbit.at(np.array([found]))[0]


def half_turns(
    orbit: OrbitSegment, share: float, axis: tuple[OrbitSegment, OrbitSegment], section: Plane, width: float
) -> int | None:
    """How often the fast variable of an orbit crosses that of the axis, over the same values of the section's variable.

    The axis, the weak canard, is given up to the section and from there on; `share` is where the orbit
    crosses the section. Counted where both exist; `None` when it depends on what counts as rounding.
    """
    halves = []
    for coordinate, gap, along in _beside(orbit, share, axis, section):
        # Only as far as the section's variable runs one way, and the axis is there.
        sign = np.sign(along[-1] - along[0])
        stop = _one_way(coordinate, sign)
        inside = np.flatnonzero((coordinate[:stop] - along[-1]) * sign >= 0.0)
        halves.append(gap[: int(inside[0]) if inside.size else stop])
    values = np.concatenate([halves[0][::-1], halves[1]])
    counts = set()
    for least in (SIGNLESS, 10.0 * SIGNLESS):
        kept = values[np.abs(values) > least * width]
        counts.add(int((kept[:-1] * kept[1:] < 0.0).sum()))
    return counts.pop() if len(counts) == 1 else None


def deviation(
    orbit: OrbitSegment,
    share: float,
    axis: tuple[OrbitSegment, OrbitSegment],
    section: Plane,
    reach: float,
) -> float:
    """Largest distance in the fast variable between an orbit and the axis within `reach` of the section."""
    return max(
        float(np.abs(gap[np.abs(coordinate - section.value) <= reach]).max(initial=0.0))
        for coordinate, gap, _ in _beside(orbit, share, axis, section)
    )


def _beside(
    orbit: OrbitSegment, share: float, axis: tuple[OrbitSegment, OrbitSegment], section: Plane
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Before the section and beyond, from there on: the section's variable along an orbit (k,), how far the fast one is
    above the axis there (k,), and the section's along the axis.
    """
    sigma = orbit.places(LOOKS)
    states, middle = orbit.at(sigma), int(np.searchsorted(sigma, share))
    for half, part, from_end in ((states[:middle][::-1], axis[0], True), (states[middle:], axis[1], False)):
        along, height = _graph(part, section.index, from_end=from_end)
        sign, coordinate = np.sign(along[-1] - along[0]), half[:, section.index]
        yield coordinate, half[:, 2] - np.interp(sign * coordinate, sign * along, height), along


def _one_way(values: np.ndarray, sign: float) -> int:
    """How many of the values (k,) run one way, upwards for a `sign` of 1."""
    steps = np.diff(values) * sign > 0.0
    return len(values) if steps.all() else int(np.argmin(steps)) + 1


def _graph(orbit: OrbitSegment, index: int, *, from_end: bool) -> tuple[np.ndarray, np.ndarray]:
    """The fast variable over the section's, from the section on as far as that one runs one way."""
    sigma = np.append(orbit.places(LOOKS), 1.0)
    states = orbit.at(sigma[::-1] if from_end else sigma)
    along = states[:, index]
    stop = _one_way(along, np.sign(along[1] - along[0]))
    return along[:stop], states[:stop, 2]


def split(orbit: OrbitSegment, share: float) -> tuple[OrbitSegment, OrbitSegment]:
    """An orbit up to a share of its time, and from there on."""
    parts = []
    for low, high in ((0.0, share), (share, 1.0)):
        inside = orbit.mesh[(orbit.mesh > low) & (orbit.mesh < high)]
        mesh = np.concatenate([[low], inside, [high]])
        piece = orbit.on(mesh)
        parts.append(replace(piece, mesh=(mesh - low) / (high - low), time=orbit.time * (high - low)))
    return parts[0], parts[1]


def named_point(frame: FoldedNodeFrame, z: np.ndarray) -> Mapping[str, float]:
    """A state by name."""
    return MappingProxyType({s.name: float(v) for s, v in zip(frame.system.states, z)})
