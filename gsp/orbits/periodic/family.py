"""A family of cycles: its orbits in order, stability along it, and the special ones between."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from itertools import pairwise

import numpy as np

from gsp.errors import DeclarationError, Status
from gsp.orbits.periodic.explosion import Explosion, explosions
from gsp.orbits.periodic.hopf import HopfPoint
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.systems.flow import Flow

# What to do about an ending that reads otherwise for curves of equilibria.
REMEDIES = {
    Status.STEP_TOO_SMALL: "lower tolerance or raise max_intervals: the mesh may be too coarse for these cycles",
    Status.TOO_MANY_POINTS: "raise max_points, or bound the parameter",
}


class CycleKind(StrEnum):
    """What happens at a special orbit of a family."""

    FOLD = "fold of cycles"
    BRANCH_POINT = "branch point of cycles"
    PERIOD_DOUBLING = "period doubling"
    TORUS = "torus bifurcation"


@dataclass(frozen=True, eq=False)
class SpecialOrbit:
    """A special orbit of a family: its `kind`, the `orbit`, and the `row` of the family that holds it."""

    kind: CycleKind
    orbit: PeriodicOrbit
    row: int

    def __repr__(self) -> str:
        return f"SpecialOrbit({self.kind}, row={self.row}, {self.orbit!r})"


@dataclass(frozen=True)
class FamilyStats:
    """What a family cost: steps made and rejected, Newton iterations, and the most intervals of any orbit."""

    steps: int
    rejected: int
    iterations: int
    intervals: int


@dataclass(frozen=True, eq=False, repr=False)
class OrbitFamily(Drawn, Tabular):
    """Periodic orbits along one parameter, in the order of continuation.

    `orbits` (m of them) are the orbits; `family["a"]` (m,) the values of the parameter, `period` (m,),
    `amplitude("x")`, `maximum("x")`, `minimum("x")` (m,), `arclength` (m,). `special` are folds of cycles and other
    bifurcations, each a row of the family too. `hopf` is the Hopf point at which it begins, when it does. `status`
    says how it ended.
    `epsilon` is None where it is the parameter that varies.
    """

    flow: Flow
    epsilon: float | None
    parameter: str
    orbits: tuple[PeriodicOrbit, ...]
    arclength: np.ndarray
    special: tuple[SpecialOrbit, ...]
    hopf: HopfPoint | None
    status: Status
    stats: FamilyStats

    def __len__(self) -> int:
        return len(self.orbits)

    def __getitem__(self, name: str) -> np.ndarray:
        """Values (m,) of a parameter or of epsilon; raises `DeclarationError` for an unknown one."""
        known = list(self.orbits[0].constants)
        if name not in known:
            raise DeclarationError.none_of(known, name, f"the family has no parameter {name!r}.", "It has")
        return np.array([orbit.constants[name] for orbit in self.orbits])

    @cached_property
    def period(self) -> np.ndarray:
        """Periods (m,)."""
        return np.array([orbit.period for orbit in self.orbits])

    @cached_property
    def unstable(self) -> np.ndarray:
        """Number of unstable multipliers of each orbit (m,)."""
        return np.array([orbit.unstable for orbit in self.orbits])

    def amplitude(self, name: str) -> np.ndarray:
        """Amplitudes (m,) of a state."""
        return self.maximum(name) - self.minimum(name)

    def maximum(self, name: str) -> np.ndarray:
        """Largest values (m,) of a state."""
        return np.array([orbit.maximum[self._state(name)] for orbit in self.orbits])

    def minimum(self, name: str) -> np.ndarray:
        """Least values (m,) of a state."""
        return np.array([orbit.minimum[self._state(name)] for orbit in self.orbits])

    def of_kind(self, kind: CycleKind) -> tuple[SpecialOrbit, ...]:
        """The special orbits of one kind, in the order of the family."""
        return tuple(special for special in self.special if special.kind is kind)

    @cached_property
    def explosions(self) -> tuple[Explosion, ...]:
        """Where the cycles grow while the parameter all but stands still, as in a canard explosion, in order."""
        amplitudes = np.array([self.amplitude(symbol.name) for symbol in self.flow.states])
        return explosions(self[self.parameter], amplitudes)

    def _state(self, name: str) -> str:
        known = [symbol.name for symbol in self.flow.states]
        if name not in known:
            raise DeclarationError.none_of(known, name, f"{name!r} is no state.", "The states are")
        return name

    @property
    def message(self) -> str:
        """One line: how it ended and where."""
        last = self.orbits[-1]
        text = (
            f"stopped after {len(self)} orbits: {self.status.name} at {self.parameter} = "
            f"{last.constants[self.parameter]:.6g}, period {last.period:.6g}"
        )
        if not self.status.ok:
            text += f" ({self.status.meaning}; {REMEDIES.get(self.status, self.status.remedy)})"
        return text

    def __repr__(self) -> str:
        values = self[self.parameter]
        return (
            f"OrbitFamily({len(self)} orbits, {self.parameter}={values[0]:.6g}..{values[-1]:.6g}, "
            f"{self.status.name})"
        )

    def __str__(self) -> str:
        values, period = self[self.parameter], self.period
        lines = [
            f"family of periodic orbits in {self.parameter}"
            + ("" if self.epsilon is None else f", {self.flow.epsilon} = {self.epsilon:g}"),
            f"  {self.parameter} from {values.min():.10g} to {values.max():.10g}",
            f"  period from {period.min():.6g} to {period.max():.6g}",
        ]
        if self.hopf is not None:
            lines.append(f"  from the Hopf point at {self.parameter} = {self.hopf.value:.10g}")
        for special in self.special:
            value = special.orbit.constants[self.parameter]
            lines.append(
                f"  {special.kind} at {self.parameter} = {value:.10g}, period {special.orbit.period:.6g}"
            )
        lines += [
            f"  explosion at {self.parameter} = {explosion.value:.10g}, over {explosion.width:.1e}"
            for explosion in self.explosions
        ]
        lines += [
            f"  {self.stats.steps} steps, {self.stats.rejected} rejected, {self.stats.iterations} Newton steps, "
            f"at most {self.stats.intervals} intervals",
            f"  {self.message}",
        ]
        return "\n".join(lines)


def stability_runs(family: OrbitFamily) -> tuple[tuple[slice, bool], ...]:
    """Runs of rows with the same stability as (rows, stable); neighbours share the row between them."""
    stable = family.unstable == 0
    changes = np.flatnonzero(stable[1:] != stable[:-1]) + 1
    edges = [0, *changes.tolist(), len(stable)]
    runs: list[tuple[slice, bool]] = []
    for first, last in pairwise(edges):
        runs.append((slice(max(first - 1, 0), last), bool(stable[first])))
    return tuple(runs)
