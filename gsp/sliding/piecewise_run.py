"""Runs of fields that switch, in the limit of a sharp switch: pieces off the surfaces and on them, joined by events.

On a surface the run slides by Filippov's field while the law can hold it there: while c of `PiecewiseField.share` is
between the values at which phi stops rising, -1 and 1 for a monotone law. At c = 1 X+ is tangent to the surface, a
fold, and orbits leave along X+; a law with an overshoot holds on to its maximum. `modes` says it for several surfaces.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.sharing import size
from gsp.critical.loss_kind import LossKind
from gsp.errors import GspError, Reason, Status
from gsp.integration.loop import check_span
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.sliding.between import run_to_event
from gsp.sliding.crossing_field import CrossingField
from gsp.sliding.law import LawEndKind, SwitchLaw, switch_law
from gsp.sliding.modes import SwitchMode, SwitchModes
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.systems.arguments import check_noun, check_positive, check_whole
from gsp.systems.flow import Point, complete, values_by_name
from gsp.systems.tolerances import absolute_tolerance

# A start is on the surface within the rounding of the surface's own terms.
ROUNDING = 8.0 * np.finfo(float).eps


class Side(StrEnum):
    """Where a piece of a run is."""

    PLUS = "s > 0"
    MINUS = "s < 0"
    SLIDING = "sliding"


@dataclass(frozen=True, eq=False, repr=False)
class Piece:
    """A part of a run on one side of each surface or on it: its `run`, and the `loss` that ended sliding, or None."""

    sides: tuple[Side, ...]
    run: Trajectory
    loss: LossKind | None = None

    @property
    def side(self) -> Side:
        """The side of the first surface, of which most fields have no other."""
        return self.sides[0]

    def __repr__(self) -> str:
        ending = f", loss: {self.loss}" if self.loss else ""
        return f"Piece({', '.join(self.sides)}, t = {self.run.t[0]:.8g} to {self.run.t[-1]:.8g}{ending})"


@dataclass(frozen=True, eq=False, repr=False)
class PiecewiseRun(Card, Tabular):
    """The `pieces` of a run in order, none where it could not begin; `message` says how it ended."""

    field: PiecewiseField | CrossingField
    law: SwitchLaw
    pieces: tuple[Piece, ...]
    message: Reason

    @property
    def t(self) -> np.ndarray:
        """The times of all pieces (m,); where one ends and the next begins a time stands twice."""
        return np.concatenate([np.empty(0), *(piece.run.t for piece in self.pieces)])

    def __getitem__(self, name: str) -> np.ndarray:
        """Values (m,) of a state at the times `t`."""
        return np.concatenate([np.empty(0), *(piece.run[name] for piece in self.pieces)])

    @property
    def changes(self) -> tuple[float, ...]:
        """The times at which one piece follows another."""
        return tuple(float(piece.run.t[0]) for piece in self.pieces[1:])

    def __repr__(self) -> str:
        listed = ", ".join(" and ".join(piece.sides) for piece in self.pieces)
        return f"PiecewiseRun({listed}; {self.message})"

    def __str__(self) -> str:
        lines = [f"run of {self.field!r}: {self.message}"]
        for piece in self.pieces:
            last = ", ".join(f"{s.name} = {piece.run[s.name][-1]:.8g}" for s in self.field.states)
            ending = f"  {piece.loss}" if piece.loss else ""
            lines.append(
                f"  {' and '.join(piece.sides):<8} t = {piece.run.t[0]:.8g} to {piece.run.t[-1]:.8g}: {last}{ending}"
            )
        return "\n".join(lines)


def run_piecewise(
    field: PiecewiseField | CrossingField,
    *,
    start: Point,
    span: tuple[float, float],
    phi: str | sp.Expr | SwitchLaw = "linear",
    rtol: float = 1e-10,
    atol: float | None = None,
    # Orbits that spiral into a two-fold cross for ever.
    max_pieces: int = 1000,
) -> PiecewiseRun:
    """The run from `start` over `span` in the limit of a sharp switch: crossing, sliding and leaving by events.

    Without `atol` it is a hundredth of `rtol` times the size of the smallest state at the start.
    `phi` matters only by how far it rises: where it overshoots, sliding goes on beyond Filippov's. The run ends with
    the span, at a two-fold, where sliding repels (two orbits begin there), when a piece fails, or after `max_pieces`:
    `message` says which. Raises `DeclarationError` for arguments that are not well formed.

    >>> x, y = sp.symbols("x y")
    >>> field = PiecewiseField(plus={x: 1, y: x}, minus={x: 1, y: 1}, surface=y)
    >>> run_piecewise(field, start={"x": -1, "y": 0}, span=(0, 2)).pieces
    (Piece(sliding, t = 0 to 1, loss: visible fold), Piece(s > 0, t = 1 to 2))
    """
    check_noun(field, (PiecewiseField, CrossingField), verb="run_piecewise")
    first, last = check_span(span)
    if not first < last:
        raise GspError("a run of a field that switches goes forward in time.", got=f"span = {span}")
    check_whole(max_pieces, what="max_pieces", least=1, most=10**9, be="a positive integer", remedy="Try 1000.")
    if atol is None:
        atol = absolute_tolerance(check_positive(rtol, what="rtol"), {}, values_by_name(start, what="start"))
    law = switch_law(phi)
    crossing = field.crossing if isinstance(field, PiecewiseField) else field
    modes = SwitchModes(crossing, -law.lower.value, law.upper.value)
    state = np.array(complete(start, crossing.states, what="start"))
    signs, among = _sides(crossing, state)
    pieces: list[Piece] = []
    found, t, why = modes.after(signs, among, state), first, Reason()
    while len(found) == 1 and not why and len(pieces) < max_pieces:
        (mode,) = found
        run = run_to_event(
            mode.flow,
            start=dict(zip((s.name for s in crossing.states), state)),
            span=(t, last),
            rtol=rtol,
            atol=atol,
            events=mode.events,
            functions=mode.enclosed_events,
        ).run
        t, state = float(run.t[-1]), run.y[:, -1].copy()
        if run.status is not Status.EVENT_REACHED or t >= last:
            why, loss = _ended(run, pieces, last), None
        else:
            met = {name for name, crossings in run.events.items() if len(crossings.times)}
            among = {*mode.stuck, *(int(name.split()[0]) for name in met if name != "both")}
            loss = LossKind.TWO_FOLD if mode.ends_in_two_fold(run.y) else _loss(met, law)
            if loss is LossKind.TWO_FOLD:
                why = Reason(
                    "a two-fold: both fields are tangent there, and what follows is not decided by them"
                )
            signs = mode.signs
            found = modes.after(signs, among, state)
        pieces.append(Piece(tuple(_SIDES[sign] for sign in mode.signs), run, loss))
    if not why:
        held = modes.of(tuple(0 if c in among else sign for c, sign in enumerate(signs)))
        why = (
            _undecided(found, held)
            if len(found) != 1
            else Reason(f"{max_pieces} pieces; raise max_pieces to go on")
        )
    return PiecewiseRun(field, law, tuple(pieces), why)


def _ended(run: Trajectory, before: list[Piece], last: float) -> Reason:
    """How a run ended with this piece: at the end of its span, or since the piece failed."""
    count = len(before) + 1
    if not run.status.ok and run.t[-1] < last:
        return Reason(f"piece {count} {run.message}")
    steps = run.stats.steps + sum(piece.run.stats.steps for piece in before)
    ways = [f"{n} {word}" + ("" if n == 1 else "s") for n, word in ((count, "piece"), (steps, "step"))]
    return Reason(f"reached the end after {' and '.join(ways)}: {run.end_in_words}")


_SIDES = {1: Side.PLUS, -1: Side.MINUS, 0: Side.SLIDING}


def _sides(field: CrossingField, state: np.ndarray) -> tuple[tuple[int, ...], set[int]]:
    """On which side of each surface a start is, and the surfaces that it is on."""
    flow = field.flow(field.drift)
    sizes = [sp.Add(*(size(derivative(s, z) * z) for z in field.states)) for s in field.surfaces]
    values = compile_over(flow, [*field.surfaces, *sizes])(state, compile_flow(flow).constants)
    count = len(field.surfaces)
    on = {c for c in range(count) if abs(values[c]) <= ROUNDING * values[count + c]}
    return tuple(0 if c in on else int(np.sign(values[c])) for c in range(count)), on


def _loss(met: set[str], law: SwitchLaw) -> LossKind | None:
    """What ended sliding, None where a surface was reached."""
    if "both" in met:
        return LossKind.TWO_FOLD
    for side, end in (("above", law.upper), ("below", law.lower)):
        if any(name.endswith(side) for name in met):
            return LossKind.SLIP_ONSET if end.kind is LawEndKind.PEAK else LossKind.VISIBLE_FOLD
    return None


def _undecided(found: list[SwitchMode], held: SwitchMode) -> Reason:
    """Why none or several of the modes go on, beside the one that is `held` on every surface met."""
    if found:
        return Reason("sliding repels: orbits leave it to more than one side")
    if held.is_shared and len(held.stuck) > 1:
        met = " and ".join(f"{held.field.surfaces[c]} = 0" for c in held.stuck)
        return Reason(
            f"{met} are met at once and depend on one another: which of them bears how much is not decided"
        )
    return Reason("a two-fold: the fields are tangent there, and what follows is not decided by them")
