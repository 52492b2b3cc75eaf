"""Relaxation orbits in the limit: slow pieces on attracting sheets, joined by drops from folds.

The singular orbit follows the reduced flow of order 0 until it meets a fold, drops along the layer flow at constant x,
and goes on from where it lands. When it closes up and each fold on the way is generic, a relaxation orbit of the full
system lies within O(epsilon^(2/3)) of it (Szmolyan and Wechselberger, Journal of Differential Equations 200 (2004)
69-104; the planar case is E. F. Mishchenko's). Its period follows from the passage of each fold
(`passage.fold_passage`): the slow variables drop later by Delta x = x_1 epsilon^(2/3) + q epsilon ln epsilon, and the
fold takes the slow time

    Omega_0 (ab)^(-1/3) epsilon^(2/3) + (b c/a^2 - d/(2a))/(3b) epsilon ln epsilon + O(epsilon),

whence the period T = T_0 + T_1 epsilon^(2/3) + T_2 epsilon ln epsilon + O(epsilon), the shifts Delta x carried around
the orbit by the slow flow.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.sampling import Sampler
from gsp.errors import DeclarationError, HyperbolicityError, Reason
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.singular.flight import Flight, Flights
from gsp.singular.orbit_period import period_of
from gsp.singular.passage.fold_passage import ZERO
from gsp.singular.slow_pieces import CLOSED, SlowPiece, follow_piece, landed_on, on_sheet
from gsp.systems.arguments import check_noun, check_progress, check_whole, counted, shown
from gsp.systems.flow import Point, check_epsilon, complete, in_words
from gsp.systems.system import VectorField


@dataclass(frozen=True, eq=False, repr=False)
class SingularOrbit(Drawn, Tabular):
    """Slow `pieces` in order, each but the last followed by the drop from its fold, or by a flight.

    When it `closes`, the last `period_pieces` of them make up the closed orbit, each followed by a drop, and
    `coefficients` = (T_0, T_1, T_2) are those of its period; otherwise they are None. `message` says how it ended.
    """

    branch: Branch
    pieces: tuple[SlowPiece, ...]
    period_pieces: int
    message: Reason
    flights: Flights | None = None

    @property
    def closes(self) -> bool:
        """Whether it is a closed orbit, after what leads to it."""
        return self.period_pieces > 0

    @property
    def cycle(self) -> tuple[SlowPiece, ...]:
        """The pieces of the closed orbit; empty when it does not close."""
        return self.pieces[len(self.pieces) - self.period_pieces :] if self.closes else ()

    @cached_property
    def coefficients(self) -> tuple[float, float, float] | None:
        """T_0, T_1 and T_2 of the period T_0 + T_1 epsilon^(2/3) + T_2 epsilon ln epsilon + O(epsilon).

        T_2 is nan where the orbit flies, for how the switch ends on the way is not in it.
        """
        return period_of(self.branch, self.cycle, self.flights) if self.closes else None

    def period(self, epsilon: float) -> float:
        """Slow time around the orbit; nan when it does not close. The error is O(epsilon), or O(epsilon ln epsilon)
        where it flies."""
        small = check_epsilon(epsilon)
        if self.coefficients is None:
            return float("nan")
        leading, first, second = self.coefficients
        logarithmic = 0.0 if self.flies else second * small * float(np.log(small))
        return leading + first * small ** (2.0 / 3.0) + logarithmic

    @property
    def flies(self) -> bool:
        """Whether it leaves the surface of a switch on its way around."""
        return any(piece.flight is not None for piece in self.cycle)

    def __repr__(self) -> str:
        ending = f"closed, {counted(self.period_pieces, 'drop')}" if self.closes else "open"
        return f"SingularOrbit({counted(len(self.pieces), 'slow piece')}, {ending})"

    def __str__(self) -> str:
        lines = [f"singular orbit: {self.message}"]
        for piece in self.cycle or self.pieces:
            if piece.fold is None and piece.run.status.ok:
                # It was followed for that long, and comes to no end.
                continue
            text = f"  slow time {piece.duration:.10g}"
            if piece.fold is not None:
                fold = in_words(piece.fold.point, 8)
                text += f" to the fold at {fold}; "
                text += str(piece.fold.drop) if piece.flight is None else _told(piece.flight)
            lines.append(text)
        if self.coefficients is not None:
            small, (leading, first, second) = self.branch.system.epsilon.name, self.coefficients
            log = f"{small} ln {small}"
            rest = f" + O({log})" if self.flies else f" {second:+.8g} {log} + O({small})"
            lines.append(f"  period {leading:.10g} {first:+.8g} {small}^(2/3){rest}")
        return "\n".join(lines)


def singular_orbit(
    branch: Branch,
    start: Point,
    *,
    switched: VectorField | None = None,
    progress: Callable[[int], object] | None = None,
    max_pieces: int = 200,
) -> SingularOrbit:
    """The singular orbit from the sheet of `branch` through `start`, which names every state of the system.

    It goes on until it closes up, or until a slow piece ends otherwise than at a generic fold, a drop lands on no
    attracting sheet, or `max_pieces` are used up: `message` says which. `progress` is called with the number of pieces.
    `switched` is the field with a switch phi(s/epsilon) that the system was split from: an orbit that leaves a fold for
    s/epsilon = infinity flies on by what the field is off the surface, until it is back.

    Raises `DeclarationError` for arguments that are not well formed, `BranchError` where the branch has no point,
    `HyperbolicityError` when the sheet does not attract at the start, and what `restrict` and `integrate` raise.

    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    >>> orbit = singular_orbit(solve_critical(system).branches[0], {"x": 2, "y": 0.6})
    >>> [round(c, 8) for c in orbit.coefficients]
    [1.61370564, 7.01432223, 0.33333333]
    """
    check_noun(branch, Branch, verb="singular_orbit")
    check_whole(
        max_pieces, what="max_pieces", least=1, most=10**9, be="a positive integer",
        remedy="The default serves most uses.",
    )  # fmt: skip
    check_progress(progress)
    system = branch.system
    complete(start, system.states, what="start")
    _require_attracting(branch, start)
    branch = branch.in_own_units(on_sheet(branch, start))
    if switched is not None and not isinstance(switched, VectorField):
        raise DeclarationError(
            "switched is the VectorField that was split.", got=shown(switched), value=switched
        )
    flights = None if switched is None else Flights(switched, system)
    point: Point = start
    pieces: list[SlowPiece] = []
    landings: list[np.ndarray] = []
    back, message = (
        0,
        Reason(f"not closed after {counted(max_pieces, 'slow piece')}; raise max_pieces to go on"),
    )
    while len(pieces) < max_pieces:
        sheet = landed_on(branch, point) if pieces else branch
        if sheet is None:
            fact = f"the last drop lands at {in_words(point, 8)}, where the reduced flow has no branch to go on along"
            message = Reason(f"{counted(len(pieces), 'slow piece')}; {fact}")
            break
        piece, why = follow_piece(sheet, point, flights)
        pieces.append(piece)
        if progress is not None:
            progress(len(pieces))
        if piece.landing is None:
            message = why or Reason(f"{counted(len(pieces), 'slow piece')}; {piece.fold and piece.fold.drop}")
            break
        point = piece.landing
        landed = np.array([point[s.name] for s in system.states]) / np.concatenate(branch.scales)
        back = _closed(landings, landed)
        landings.append(landed)
        if back:
            message = Reason(
                f"closed after {counted(len(pieces), 'slow piece')}, {counted(back, 'drop')} a period"
            )
            break
    return SingularOrbit(branch, tuple(pieces), back, message, flights)


def _require_attracting(branch: Branch, start: Point) -> None:
    """The start's sheet attracts over the start: orbits next to any other leave it before a slow time has passed."""
    point = on_sheet(branch, start)
    values = np.linalg.eigvals(Sampler(branch).fast_jacobian(point[None, :])[0])
    # At a fold one of them is zero to rounding only, of either sign; `integrate` names that start.
    if values.real.max() > ZERO * np.abs(values).max(initial=1.0):
        at = branch.system.place(zip(branch.system.states, point))
        raise HyperbolicityError(
            f"the sheet under the start does not attract: at {at} the fast eigenvalues are "
            f"{np.array2string(values, precision=4)}.",
            "Start next to an attracting sheet; fast variables of the start choose it.",
        )


def _told(flight: Flight) -> str:
    return f"it flies for a slow time {flight.duration:.10g} and comes down at {in_words(flight.point, 8)}"


def _closed(landings: list[np.ndarray], landed: np.ndarray) -> int:
    """How many drops ago an orbit landed at the same point, in the branch's units; 0 for never."""
    ago = enumerate(reversed(landings), start=1)
    return next((back for back, earlier in ago if np.abs(earlier - landed).max() <= CLOSED), 0)
