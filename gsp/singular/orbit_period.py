"""The period of a closed singular orbit in powers of epsilon: the slow flow carries the shifts at its folds around."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gsp.critical.branch import Branch
from gsp.errors import GspError, Status
from gsp.hyperbolicity.losses.consequences import OMEGA_0
from gsp.singular.flight import Flights
from gsp.singular.slow_pieces import PATIENCE, SlowPiece, flight_from, landed_on, longest_on, run_on

# Landing points are shifted by so much, relative to the states' sizes, to carry the shifts of folds around the orbit.
SHIFT = 1e-5


def period_of(
    branch: Branch, cycle: Sequence[SlowPiece], flights: Flights | None
) -> tuple[float, float, float]:
    """T_0, T_1, T_2: with the landing points shifted by Delta x at every fold, x -> P x + Delta x around the cycle.

    A shift xi of the landing point before a piece changes its duration by tau . xi and where it leaves the fold to
    P xi + Delta; a flight makes Q of that shift, and changes by sigma times it. The closed orbit solves
    xi_(k+1) = Q_k (P_k xi_k + Delta_k) cyclically.
    """
    m, count = len(branch.system.x), len(cycle)
    folds = [piece.fold for piece in cycle]
    transfers, gradients = zip(*(_sensitivity(branch, piece) for piece in (cycle[-1], *cycle[:-1])))
    flown, delays = zip(*(_flight_sensitivity(branch, piece, flights) for piece in cycle))
    total = sum(piece.duration + (piece.flight.duration if piece.flight else 0.0) for piece in cycle)
    result = [total]
    for shifts, times in (
        ([f.leading for f in folds if f], [OMEGA_0 * (f.a * f.b) ** (-1.0 / 3.0) for f in folds if f]),
        (
            [f.logarithmic for f in folds if f],
            [(f.b * f.c / f.a**2 - f.d / (2.0 * f.a)) / (3.0 * f.b) for f in folds if f],
        ),
    ):
        matrix = np.eye(count * m)
        right = np.zeros(count * m)
        for k in range(count):
            # xi_k is the shift at the beginning of piece k, made by the fold of piece k - 1.
            before = (k - 1) % count
            rows, columns = slice(k * m, k * m + m), slice(before * m, before * m + m)
            matrix[rows, columns] -= flown[before] @ transfers[before]
            right[rows] += flown[before] @ shifts[before]
        try:
            xi = np.linalg.solve(matrix, right).reshape(count, m)
        except np.linalg.LinAlgError:
            raise GspError(
                "closed singular orbits fill a family here: to first order a shift of the landing point "
                "comes back as it was.",
                "The period of the full system is not that of one of them.",
            ) from None
        left = (delay @ (P @ x + shift) for delay, P, x, shift in zip(delays, transfers, xi, shifts))
        result.append(float(sum(times) + sum(g @ x for g, x in zip(gradients, xi)) + sum(left)))
    return result[0], result[1], float("nan") if any(piece.flight for piece in cycle) else result[2]


def _flight_sensitivity(
    branch: Branch, piece: SlowPiece, flights: Flights | None
) -> tuple[np.ndarray, np.ndarray]:
    """Q (m, m) and sigma (m,): how landing point and duration of a flight move with where it leaves the fold."""
    assert piece.fold is not None
    names = [s.name for s in piece.fold.system.x]
    m = len(names)
    if piece.flight is None:
        return np.eye(m), np.zeros(m)
    fold, longest = piece.fold, PATIENCE * piece.flight.duration

    def end(beside: Mapping[str, float]) -> tuple[np.ndarray, float]:
        flight = flight_from(fold, beside, flights, longest)
        if flight is None:
            raise GspError(
                "a flight beside this one does not come back.", "The period is not to be expanded here."
            )
        return np.array([flight.point[n] for n in names]), flight.duration

    return _slopes(branch, fold.point, end)


def _sensitivity(branch: Branch, before: SlowPiece) -> tuple[np.ndarray, np.ndarray]:
    """P (m, m) and tau (m,): how the end and the duration of the next piece move with where the one `before` lands.

    For one slow variable the folds stay where they are, and tau = -1/f.
    """
    landing = before.landing
    assert landing is not None
    sheet = landed_on(branch, landing)
    assert sheet is not None

    def end(beside: Mapping[str, float]) -> tuple[np.ndarray, float]:
        run = run_on(sheet, beside, longest_on(sheet, beside))
        if run.status is not Status.FOLD_REACHED:
            raise GspError(
                f"the slow flow from {beside} ends otherwise than its neighbour: {run.message}.",
                "The closed orbit passes too near to a boundary of the fold's basin for its period to be expanded.",
            )
        return np.array([run[s.name][-1] for s in sheet.system.x]), float(run.t[-1] - run.t[0])

    return _slopes(sheet, landing, end)


def _slopes(
    branch: Branch,
    point: Mapping[str, float],
    end: Callable[[Mapping[str, float]], tuple[np.ndarray, float]],
) -> tuple[np.ndarray, np.ndarray]:
    """How the slow variables (m,) of an `end`, and its time, move with those of `point`: (m, m) and (m,)."""
    m = len(branch.system.x)
    transfer, delay = np.zeros((m, m)), np.zeros(m)
    for i, (s, scale) in enumerate(zip(branch.system.x, branch.scales[0])):
        h = SHIFT * float(scale)
        (up, late), (down, early) = (end({**point, s.name: point[s.name] + step}) for step in (h, -h))
        transfer[:, i], delay[i] = (up - down) / (2.0 * h), (late - early) / (2.0 * h)
    return transfer, delay
