"""Imaginary pairs of eigenvalues that a finished run of a reduced flow has passed.

With many coupled fast variables their test function, a determinant of order n (n - 1)/2, is out of reach. So
eigenvalues are counted instead, at ends of steps: as many as at the start must lie to the right of the imaginary axis.
Those that pass one by one through zero have ended the run already.
"""

from __future__ import annotations

import numpy as np

from gsp.errors import Status
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.reduction_end.endings import ACROSS
from gsp.integration.reduction_end.validity import Validity, eigenvalues, validity_of
from gsp.integration.run_array import Record, RunRecord

# All eigenvalues of n by n take about 25 n^3 operations. So many are spent on a run: a second or two.
OPERATIONS = 1e10
FEWEST = 8


def cut_at_pair(flow: ReducedFlow, p: np.ndarray, record: RunRecord) -> tuple[Record, str, str] | None:
    """What of `record` holds, up to the last end of a step with the start's count of unstable eigenvalues; None if all.

    With a note and a remedy.
    """
    validity = validity_of(flow)
    states = record.states
    count = max(FEWEST, int(OPERATIONS / (25.0 * len(validity.fast) ** 3)))
    looked_at = np.unique(np.linspace(0, len(states) - 1, min(count, len(states))).round().astype(int)).tolist()
    unstable = _unstable(validity, states[0], p)
    good = looked_at[0]
    for row in looked_at[1:]:
        if _unstable(validity, states[row], p) != unstable:
            break
        good = row
    else:
        return None
    bad = row
    while bad - good > 1:
        middle = (good + bad) // 2
        good, bad = (middle, bad) if _unstable(validity, states[middle], p) == unstable else (good, middle)
    kept = record.apart()._replace(
        times=record.times[: good + 1].copy(),
        states=states[: good + 1].copy(),
        dense=record.dense[:good].copy(),
        status=Status.HYPERBOLICITY_LOST,
    )
    between = f"between t = {record.times[good]:.6g} and t = {record.times[bad]:.6g}"
    return kept, f"an imaginary pair of eigenvalues of the fast Jacobian is passed {between}", ACROSS


def _unstable(validity: Validity, state: np.ndarray, p: np.ndarray) -> int:
    values = eigenvalues(validity, validity.point(state, p))
    return int((np.real(values) > 0.0).sum()) if np.isfinite(values).all() else -1
