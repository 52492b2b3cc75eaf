"""Where the critical manifold jumps under a run on coordinates of which some are fast.

On a surface where g jumps, as of an input that is switched on, the slow variables go on and the fast ones fall onto
another point of M0, or onto another sheet. A run whose states are slow variables goes on too. One in fast variables
would keep these, and with them it is the slow variables that jump, or the run that leaves M0: it ends there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsp.errors import HyperbolicityError
from gsp.integration.crossings import Search
from gsp.integration.pieces import RunPiece
from gsp.integration.reduction_end.validity import Validity
from gsp.integration.watched import Settled, Stepper


def leaps(validity: Validity, z: np.ndarray, stepper: Stepper) -> np.ndarray:
    """Whether M0 leaps at the point `z` of each surface: from just below onto it, from it to just above, and from just
    below to just above, booleans (surfaces, 3).

    It leaps where y at the same x moves by more than the tolerance of the run.
    """
    below, on, above = np.moveaxis(validity.beside(z, stepper.p).reshape(len(validity.surfaces), 3, -1), 1, 0)
    changes = np.stack([below - on, above - on, above - below], axis=1)
    flat = changes.reshape(-1, changes.shape[2])
    moves = np.linalg.lstsq(validity.fast_jacobian(z), flat.T)[0].T.reshape(changes.shape)
    y = np.abs(z[len(validity.slow) :])
    return np.any(np.abs(moves) > stepper.atol + stepper.rtol * y, axis=2)


def sides_at_start(validity: Validity, z: np.ndarray, values: np.ndarray, stepper: Stepper) -> np.ndarray:
    """The sides (s,) on which a run begins of the surfaces with these `values`, 0 for either side.

    Raises `HyperbolicityError` for a start on a surface that belongs to neither of its sides.
    """
    sides = np.sign(values)
    for k in np.flatnonzero(sides == 0.0):
        below, above, jumps = leaps(validity, z, stepper)[k]
        if jumps and below and above:
            raise HyperbolicityError(
                f"the start lies where the critical manifold jumps, {validity.surfaces[k]} = 0, on neither side of it.",
                "Start on one side, or let the field have the value of one side there.",
            )
        sides[k] = float(jumps) * (float(below) - float(above))
    return sides


def just_before(search: Search, column: int, settled: Settled, piece: RunPiece, stops: np.ndarray) -> Settled:
    """The end of the run on the side from which it comes, where it has the states that the jump has not moved.

    Where it has hardly moved since one of its `stops` (s,) it ends there, as before a switch of a clock: at any order.
    """
    forward = 1.0 if piece.times[-1] > piece.times[0] else -1.0
    signs = np.sign(search.values(piece.times, piece.states)[:, column])
    k = piece.step(settled.t)
    side = -signs[k + 1] or signs[k]
    before = np.flatnonzero(signs[: k + 1] == side)
    if not before.size:
        return Settled(float(piece.times[0]), piece.states[0], None, row=search.rows)
    k = int(before[-1])
    stepper, stopped = search.stepper, before[np.isin(piece.times[before], stops)]
    for j in map(int, stopped[-1:]):
        y = piece.states[j]
        if (np.abs(settled.y - y) <= stepper.atol + stepper.rtol * np.abs(y)).all():
            return Settled(float(piece.times[j]), y, None, row=search.rows + j)
    start, y, back = float(piece.times[k]), piece.states[k], float(np.spacing(abs(settled.t)))
    while np.sign(search.values(np.array([settled.t]), settled.y[np.newaxis])[0, column]) != side:
        t = settled.t - forward * back
        if (t - start) * forward <= 0.0:
            return Settled(start, y, None, row=search.rows + k)
        record, back = search.run(start, y, t), 2.0 * back
        settled = Settled(float(record.times[-1]), record.states[-1], record)
    return replace(settled, row=search.rows + k)
