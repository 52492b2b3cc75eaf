"""The canards of a folded node: two sheets up to a section, where their curves cross, and each crossing as an orbit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from gsp.errors import GspError, Status
from gsp.orbits.canard_orbits.canard import (
    Canard,
    CanardKind,
)
from gsp.orbits.canard_orbits.canard_finder import AWAY, BEYOND, CanardFinder
from gsp.orbits.canard_orbits.frame import FoldedNodeFrame, frame_at, line_of, section_of
from gsp.orbits.canard_orbits.line import SheetNotFound
from gsp.orbits.canard_orbits.node_units import canard_in, in_own_units, plane_in, sheet_in
from gsp.orbits.canard_orbits.sheet import Sheet, SheetBuilder, SheetEnd
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.singular.singularities.folded_singularities import FoldedSingularity
from gsp.systems.arguments import check_noun
from gsp.systems.flow import check_epsilon
from gsp.systems.system import SlowFastSystem

State = Mapping[str, float] | Mapping[sp.Symbol, float]


class CanardOrbitError(GspError):
    """Canards that cannot be sought, because no orbit joins the lines and the section."""


@dataclass(frozen=True, eq=False, repr=False)
class CanardOrbits(Drawn, Tabular):
    """The canards of a folded node at one epsilon: `canards` from the strong one inwards, the weak one last.

    - `attracting` and `repelling` are the sheets' curves in the section, `section` its (name, value);
    - `expected` is how many secondary canards there are as epsilon goes to 0, `missing` their names and
      gamma_0's that were not found here; the number holds in the limit only, and there may be more here;
    - `touching` tells that the curves touch at the weak canard, as where 1/mu is a whole number: it is known to
      the root of rounding only, see its `error`;
    - `exhausted` tells that the work allowed for the crossings was used up before the innermost;
    - `unresolved` is the number of crossings about the weak canard whose turns rounding hides;
    - `status` and `message` say how the curves ended, and why canards are missing.
    """

    system: SlowFastSystem
    singularity: FoldedSingularity
    epsilon: float
    canards: tuple[Canard, ...]
    attracting: Sheet
    repelling: Sheet
    expected: int
    unresolved: int
    touching: bool
    exhausted: bool
    frame: FoldedNodeFrame

    @property
    def section(self) -> tuple[str, float]:
        plane = self.attracting.section
        return self.system.states[plane.index].name, plane.value

    @property
    def status(self) -> Status:
        """SUCCESS when both curves were followed to their natural ends, and all their crossings looked at."""
        if self.exhausted and self.attracting.status.ok and self.repelling.status.ok:
            return Status.TOO_MANY_STEPS
        return self.attracting.status if not self.attracting.status.ok else self.repelling.status

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of gamma_0 and the secondary canards of the limit that were not found."""
        found = {canard.index for canard in self.canards}
        return tuple(_name(k) for k in range(self.expected + 1) if k not in found)

    @property
    def message(self) -> str:
        """One line: what was found, what the theory of the limit expects, and why they differ."""
        turning = [c for c in self.canards if c.index is not None]
        usual = sum(c.index is not None and c.index <= self.expected for c in turning)
        text = f"{usual} of {self.expected + 1} canards that turn"
        epsilon = f"{self.system.epsilon} = {self.epsilon:g}"
        found = [c.index for c in turning if c.index is not None]
        is_weak_known = any(c.kind is CanardKind.WEAK for c in self.canards)
        outer = [k for k in range(min(found, default=self.expected + 1)) if k <= self.expected]
        if outer:
            text += f"; {_names(outer)} do{'es' * (len(outer) == 1)} not cross the section at {epsilon}"
            text += " between the lines, or only outside the window"
        inner = list(range(max(found, default=self.expected) + 1, self.expected + 1))
        if inner:
            where = "within rounding of the weak canard" if is_weak_known else "beyond the ends of the curves"
            text += f"; {_names(inner)}: {where}, or none at {epsilon}"
        between = [k for k in range(min(found, default=0), max(found, default=0)) if k not in found]
        if between:
            text += f"; {', '.join(map(_name, between))}: no crossing was found between their neighbours"
        extra = [k for k in found if k > self.expected]
        if extra:
            text += f"; {_names(extra)} beyond the number of the limit"
        odd = [c.index for c in turning if c.index is not None and c.half_turns != 2 * c.index + 1]
        if odd:
            text += (
                f"; {', '.join(map(_name, odd))} named by their order: their half-turns do not tell them apart"
            )
        if self.unresolved:
            text += f"; {self.unresolved} more crossing{'s' * (self.unresolved > 1)} within rounding of the weak canard"
        ends = {self.attracting.inner, self.repelling.inner}
        if ends & (BEYOND | AWAY) and not is_weak_known:
            text += "; the curves do not cross at gamma_w before they end"
            if SheetEnd.PASSED in ends:
                text += f", where the slow flow runs along a line: lines in {self.section[0]} may reach it"
        if self.touching:
            text += "; the curves touch at gamma_w, as for whole 1/mu: its place is known to the root of rounding only"
        if self.exhausted:
            text += "; the work allowed for the crossings was used up before the innermost"
        for sheet in (self.attracting, self.repelling):
            # Fewer powers of e between a line and the node are said in the message.
            if sheet.contraction < 15.0:
                side = "attracting" if sheet.attracting else "repelling"
                text += (
                    f"; the line on the {side} sheet counts: orbits beside the strong canard come nearer by "
                )
                text += f"{sheet.contraction:.1f} powers of e only"
            if not sheet.status.ok:
                bad = [end for end in (sheet.inner, sheet.outer) if not end.status.ok]
                text += f"; {sheet!r}: {', '.join(bad)}"
        return text

    def __getitem__(self, name: str) -> Canard:
        """A canard by name: gamma_0, xi_1, ..., gamma_w."""
        for canard in self.canards:
            if canard.name == name:
                return canard
        raise GspError(
            f"there is no canard {name!r} here.",
            f"Those found are {', '.join(c.name for c in self.canards) or 'none'}.",
        )

    def __len__(self) -> int:
        return len(self.canards)

    def __repr__(self) -> str:
        names = [c.name for c in self.canards]
        shown = ", ".join(names) if len(names) < 6 else f"{names[0]}, {names[1]}, ..., {names[-1]}"
        return f"CanardOrbits({len(names)} at {self.system.epsilon} = {self.epsilon:g}: {shown})"

    def __str__(self) -> str:
        name, value = self.section
        others = [s.name for s in self.system.states if s.name != name]
        width = max([7, *(len(c.name) for c in self.canards)])
        lines = [
            f"canards of the folded node at {self.system.epsilon} = {self.epsilon:g}, "
            f"mu = {float(sp.N(self.singularity.mu)):.6g}, in the section {name} = {value:.6g}",
            f"  {'':{width}}  {others[0]:>15}  {others[1]:>15}  half-turns  {'error':>7}",
        ]
        for c in self.canards:
            turns = "" if c.half_turns is None else str(c.half_turns)
            place = "  ".join(f"{c.point[n]:15.10f}" for n in others)
            lines.append(f"  {c.name:{width}}  {place}  {turns:>10}  {c.error:7.0e}")
        lines.append(f"  {self.message}")
        return "\n".join(lines)


def folded_canards(
    singularity: FoldedSingularity,
    *,
    epsilon: float,
    section: State | None = None,
    attracting: State | None = None,
    repelling: State | None = None,
) -> CanardOrbits:
    """The canards through a folded node, as orbits, for one fast and two slow variables.

    The attracting slow manifold is extended by orbit segments from a line on the attracting sheet of M0 forward to a
    section, the repelling one backward; their curves in the section turn about the weak canard, and where they cross
    there is a canard: gamma_0, the strong one, after one half-turn, the secondary xi_k after 2 k + 1 (Wechselberger,
    SIAM J. Appl. Dyn. Syst. 4 (2005) 101-139). Each is solved as one orbit from line to line.

    `section` fixes a slow variable near the node, by default the one that is the faster there beside its size.
    `attracting` and `repelling` fix one state on a line of M0 each; by default the fast variable, where orbits
    beside the strong canard have come nearer to the slow manifold by 40 powers of e. Another line moves the canards
    by exp(-c/epsilon).

    Raises `FoldedError` for a folded singularity without canards that turn, and for more than two slow variables;
    `CanardOrbitError` when no orbit joins a line with the section.

    >>> x, z, y, eps = sp.symbols("x z y epsilon")
    >>> system = SlowFastSystem(
    ...     slow={x: 3*z/20 - 13*y/10, z: 1}, fast={y: x + y**2}, epsilon=eps)
    >>> from gsp import folded_singularities
    >>> node, = folded_singularities(system, region={"y": (-1, 1)})
    >>> folded_canards(node, epsilon=0.01)
    CanardOrbits(3 at epsilon = 0.01: gamma_0, xi_1, gamma_w)
    """
    check_noun(singularity, FoldedSingularity, verb="folded_canards")
    model = frame_at(singularity, epsilon=check_epsilon(epsilon))
    frame = in_own_units(model)
    plane = plane_in(section_of(model, section), frame.units)
    lines = [
        None if line is None else plane_in(line_of(model, line, what=what), frame.units)
        for line, what in ((attracting, "attracting"), (repelling, "repelling"))
    ]
    try:
        builders = [
            SheetBuilder(frame, plane, attracting=side, line=line) for side, line in zip((True, False), lines)
        ]
        sheets = [builder.build() for builder in builders]
    except SheetNotFound as error:
        raise CanardOrbitError(
            f"{error} Take a smaller {frame.system.epsilon}, or another line nearer to the fold, on the same sheet."
        ) from None
    finder = CanardFinder(frame, plane, builders, sheets)
    back = frame.units.back
    return CanardOrbits(
        system=model.system,
        singularity=singularity,
        epsilon=model.epsilon,
        canards=tuple(canard_in(canard, back, model) for canard in finder.find()),
        attracting=sheet_in(sheets[0], back),
        repelling=sheet_in(sheets[1], back),
        expected=singularity.secondary_canards,
        unresolved=finder.unresolved,
        touching=finder.touching,
        exhausted=finder.exhausted,
        frame=model,
    )


def _names(indices: list[int]) -> str:
    ends = [_name(indices[0]), _name(indices[-1])]
    return ends[0] if len(indices) == 1 else f"{ends[0]} to {ends[1]}"


def _name(index: int) -> str:
    return "gamma_0" if index == 0 else f"xi_{index}"
