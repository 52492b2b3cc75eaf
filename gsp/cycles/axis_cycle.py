"""Cycles that leave an invariant sheet by a delayed loss of stability: theorem 12 of docs/proofs.md.

From where the delay ends orbits jump to the sheet with the fold, follow it and drop from the fold back to the invariant
one: a strip, from v = width to v = width. A delay leads from its exit section into its entry section. Lines are found
by doubles, in x and the distance v from the invariant sheet.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.cycles.annulus import Strip
from gsp.cycles.band_search import FINE, EpsilonSearch, seen_divergence
from gsp.cycles.conditions import proved
from gsp.cycles.delay import STRIPS, ProvedDelay, delay_field, proved_delay
from gsp.cycles.enclosed_field import EnclosedField
from gsp.cycles.outline import Frame, NoOutline, Outline, Outliner, Point
from gsp.cycles.passage_outline import strip_between
from gsp.cycles.sectors import NotProved, Turn
from gsp.errors import GspError
from gsp.proofs import balls
from gsp.proofs.equations import without_decimals
from gsp.singular.passage.delayed_exit import DelayedExit, ExitKind
from gsp.singular.passage.entry_exit import entry_exit
from gsp.singular.singular_orbit import SingularOrbit


@dataclass(frozen=True, eq=False, repr=False)
class ProvedCircuit:
    """A strip and delays from both ends of its exit section, the first one that ends sooner, which lead into its entry
    section for every epsilon in (0, `epsilon`]. Coordinates are x and v, `level` is v = 0, `rates` are f and k.
    """

    strip: Strip
    delays: tuple[ProvedDelay, ProvedDelay]
    epsilon: float
    turn: Turn
    strip_turn: Turn
    fineness: int
    level: Fraction
    rates: tuple[sp.Expr, sp.Expr]

    @property
    def is_unique(self) -> bool:
        """Whether one closed orbit only passes the strip, which attracts."""
        return self.turn.contraction < 0.0

    @property
    def amplitude(self) -> tuple[tuple[tuple[float, float], tuple[float, float]], ...]:
        """For the slow variable and for the fast one: in which intervals its least and its largest value lie."""
        grid = self.delays[0].grid
        # The line from further on is about the other one.
        lines = sorted((self.strip.outer, self.strip.inner), key=lambda line: line[0, 0] * (grid[-1] - grid[0]))
        (x_in, v_in), (x_out, v_out) = (
            [(float(row.min()), float(row.max())) for row in line.T] for line in lines
        )
        level = balls.exact(self.level)
        fast = ((0.0, self.delays[0].width), (v_in[1], v_out[1]))
        low, high = ((balls.below(level + a) + 0.0, balls.above(level + b)) for a, b in fast)
        return ((x_out[0], x_in[0]), (x_in[1], x_out[1])), (low, high)

    @property
    def where(self) -> str:
        """What the closed orbit lies in."""
        return (
            f"a strip and the tube of a delay, of {len(self.strip.outer)} and {len(self.strip.inner)} vertices"
        )

    def as_dict(self) -> dict[str, object]:
        """Plain values, for JSON."""
        return {"vertices": [len(self.strip.outer), len(self.strip.inner)], "width": self.delays[0].width}


@dataclass(frozen=True, eq=False)
class _Placed:
    """A strip and delays that lead into it, and what the bound of the divergence may come to."""

    strip: Strip
    delays: tuple[ProvedDelay, ProvedDelay]
    seen: float


class CircuitSearch(EpsilonSearch[ProvedCircuit]):
    """Circuits for one epsilon or another; raises `NoOutline` where an orbit does not come back that way."""

    def __init__(self, orbit: SingularOrbit) -> None:
        super().__init__()
        self.exit = _exit(orbit)
        self.tube = delay_field(self.exit)
        f, k = self.tube.rates
        x, v, small = self.tube.arguments
        self.field = EnclosedField((x, v, small), (f, v * k, sp.S.Zero))
        self.level = _level(self.exit)
        self.frames = _frames(orbit, self.exit, float(self.level))
        self._known: dict[float, tuple[list[_Placed], NoOutline | NotProved]] = {}

    def seen(self, epsilon: float) -> float:
        """What the bound of the divergence may come to, by doubles."""
        return min(placed.seen for placed in self._placed(epsilon))

    def proved(self, epsilon: float) -> ProvedCircuit:
        """The circuit whose bound seems least, or else one that is proved."""
        why = NotProved("no tube was tried")
        for placed in self._placed(epsilon):
            try:
                return self._closed(placed, proved(self.field, placed.strip, epsilon, FINE), epsilon)
            except NotProved as error:
                why = error
        raise why

    def _placed(self, epsilon: float) -> list[_Placed]:
        """Strips and delays that follow one another, what seems to attract most first: the first that seems to attract
        at all, or one for each width; raises `NoOutline` or `NotProved` where there is none.
        """
        if epsilon not in self._known:
            found, why = [], NoOutline("no tube was tried")
            # Widths of the tube about the invariant sheet, as shares of the jump away from it.
            for share in (2.0**-6, 2.0**-9):
                try:
                    found.append(self._place(epsilon, share * float(self.frames[1].sizes[1])))
                except (NoOutline, NotProved) as error:
                    why = error
                    continue
                if found[-1].seen < 0.0:
                    break
            self._known[epsilon] = sorted(found, key=lambda one: one.seen), why
        found, why = self._known[epsilon]
        if not found:
            raise why
        return found

    def _place(self, epsilon: float, width: float) -> _Placed:
        outliner = _CircuitOutliner(self.field, self.frames, epsilon, width)
        (x,) = self.exit.branch.system.x
        way = self.frames[1].slow
        sooner = later = float(self.exit.point[x.name])
        # By this share of the way the entry section goes beyond what comes back.
        room = 0.05 * abs(float(self.exit.start[x.name]) - sooner)
        # How often sections are placed anew.
        for _ in range(4):
            begins = later + way * room, sooner - way * room
            strip = outliner.strip(*begins)
            ends = sorted((float(strip.outer[-1, 0]), float(strip.inner[-1, 0])), key=lambda u: -way * u)
            first, last = (self._delay(end, width, epsilon) for end in ends)
            exits = first.stays_to, last.leaves_by
            if way * begins[1] < way * exits[0] and way * exits[1] < way * begins[0]:
                return _Placed(strip, (first, last), seen_divergence(self.field, strip, epsilon) + last.growth)
            if not np.isfinite(exits[1]):
                raise NotProved("orbits are not proved to leave the invariant sheet")
            sooner, later = exits
        raise NotProved("orbits are not proved to come back where they began")

    def _delay(self, begin: float, width: float, epsilon: float) -> ProvedDelay:
        (x,) = self.exit.branch.system.x
        end = float(self.exit.point[x.name])
        # So far beyond the predicted exit a delay is looked at.
        grid = np.linspace(begin, end + 0.3 * (end - begin), STRIPS + 1)
        return proved_delay(self.tube, grid, width, epsilon, above=True)

    def _closed(self, placed: _Placed, turn: Turn, epsilon: float) -> ProvedCircuit:
        strip, delays = placed.strip, placed.delays
        # Rounded outwards.
        least = np.nextafter(turn.period[0] + delays[0].time[0], -np.inf)
        most = np.nextafter(turn.period[1] + delays[1].time[1], np.inf)
        contraction = np.nextafter(turn.contraction + delays[1].growth, np.inf)
        whole = Turn((float(least), float(most)), float(contraction))
        f, k = self.tube.rates
        return ProvedCircuit(strip, delays, epsilon, whole, turn, FINE, self.level, (f, k))


class _CircuitOutliner(Outliner):
    """Strips from v = `width` to v = `width`: frames of the sheet with the fold, and of the invariant one."""

    def __init__(self, field: EnclosedField, frames: Sequence[Frame], epsilon: float, width: float) -> None:
        super().__init__(field, frames[:1], epsilon)
        self.frames = frames
        self.delays, self.before = 2 * self.delays, 2 * self.before
        self.width = width

    def strip(self, outer: float, inner: float) -> Strip:
        """From these places x on."""
        sheet, axis = self.frames
        level = self.width * axis.fast
        lines = []
        for side, begin in ((-1.0, outer), (1.0, inner)):
            line = Outline([])
            point = line.follow(iter([(begin * axis.slow, self.width)]), axis)
            x, y = line.follow(self._across(1, point, side), axis)
            line.begins = [len(line.points) - 1, 0]
            point: Point = line.follow(self._along(0, (-x, -y), side, None), sheet)
            line.jumps = [len(line.points) - 1]
            line.follow(self._across(0, point, side, level * sheet.fast), sheet)
            lines.append(line)
        up = [np.array(line.points[: line.begins[0] + 1]) for line in lines]
        down = [np.array(line.points[line.jumps[0] :]) for line in lines]
        _, first = self._levels(axis, *up)
        second, _ = self._levels(sheet, *down)
        lines = [
            line.cut(1, first * axis.fast, axis.fast).cut(0, second * sheet.fast, sheet.fast) for line in lines
        ]
        found = strip_between(sheet, lines, slow_first=False)
        if min(np.abs(line[:, 1]).min() for line in (found.outer, found.inner)) < self.width:
            raise NoOutline("the strip comes into the tube")
        return found


def _exit(orbit: SingularOrbit) -> DelayedExit:
    """The delay that follows the last drop of an orbit that does not close; raises `NoOutline`."""
    *before, last = orbit.pieces
    fold = before[-1].fold if before else None
    if fold is None or not fold.drop.lands or last.fold is not None:
        raise NoOutline(f"the singular orbit does not close: {orbit.message}")
    system = orbit.branch.system
    (x,), (y,) = system.x, system.y
    branch = solve_critical(system).nearest(fold.drop.point)
    graph = branch.graph
    # The way along a sheet is followed only where it may be invariant: a pole beside it costs minutes.
    if graph is None or graph[y].has(x):
        raise NoOutline(f"the singular orbit does not close: {orbit.message}")
    try:
        exit = entry_exit(branch, start={x.name: fold.drop.point[x.name]})
    except GspError as error:
        raise NoOutline(f"the singular orbit does not close: {error.reason.fact}") from None
    if not exit.invariant or exit.kind is not ExitKind.ENTRY_EXIT:
        raise NoOutline(f"the singular orbit does not close: {orbit.message}")
    return exit


def _level(exit: DelayedExit) -> Fraction:
    (y,) = exit.branch.system.y
    assert exit.branch.graph is not None
    value = without_decimals(exit.branch.graph[y].xreplace(dict(exit.branch.system.parameters)))
    if not value.is_Rational:
        raise NoOutline("the invariant sheet is not at a fraction")
    return Fraction(int(value.p), int(value.q))


def _frames(orbit: SingularOrbit, exit: DelayedExit, level: float) -> list[Frame]:
    """Of the sheet with the fold, from where orbits land on it, and of the invariant sheet."""
    system = orbit.branch.system
    (x,), (y,) = system.x, system.y
    piece = orbit.pieces[-2]
    assert piece.fold is not None
    fold = np.array([piece.fold.point[x.name], piece.fold.point[y.name] - level])
    run = np.column_stack([piece.run[x.name], piece.run[y.name] - level])
    leaves, lost = float(exit.point[x.name]), float(exit.losses[0].point[x.name])
    slow, fast = float(np.sign(fold[0] - run[0, 0])), float(-np.sign(fold[1]))
    signs = np.array([slow, fast])
    late = abs(float(piece.fold.leading[0]))
    sizes = np.array([slow * (fold[0] - leaves), abs(fold[1])])
    if fold[1] < 0.0:
        raise NoOutline("orbits are tried above the invariant sheet only")
    if not sizes[0] > 0.0:
        raise NoOutline("what leaves the invariant sheet lands beyond the fold")
    sheet = Frame(slow, fast, run * signs, fold * signs, late, sizes)
    lands = float(np.interp(leaves * slow, run[:, 0] * slow, run[:, 1]))
    away = np.array([abs(fold[0] - leaves), abs(lands)])
    return [sheet, replace(sheet, slow=-slow, fast=-fast, fold=np.array([-slow * lost, 0.0]), sizes=away)]
