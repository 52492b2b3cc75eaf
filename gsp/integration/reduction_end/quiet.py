"""A quick run of a reduced flow: its start and every step looked at in compiled code, as long as nothing happens there.

Where something may happen the run is made again with all that locates and names it, `endings`.
"""

from __future__ import annotations

import numpy as np

from gsp.integration.crossings import DIP, SUBDIVISIONS
from gsp.integration.loop import Numbers
from gsp.integration.reduction_end.endings import ON_LOSS
from gsp.integration.reduction_end.validity import Validity
from gsp.kernels.scan import look_along


class Look:
    """The `watch` of one run from `y` (n,) at `first`; it ends the run with the first steps that may be of interest."""

    def __init__(self, validity: Validity, p: Numbers, first: float, y: Numbers) -> None:
        self._functions, self._columns = validity.functions, validity.columns
        self._p = np.array(p, float)
        # The start and the signs there, which the look itself moves on and finds.
        self._place = np.array((first, *y))
        self._signs = np.zeros(self._columns.size)

    def __call__(self, times: np.ndarray, states: np.ndarray, dense: np.ndarray) -> bool:
        """Whether something may happen over these steps, or at the start."""
        return not look_along(
            self._functions, self._columns, self._signs, ON_LOSS, DIP, SUBDIVISIONS, self._p, self._place,
            times, states, dense,
        )  # fmt: skip
