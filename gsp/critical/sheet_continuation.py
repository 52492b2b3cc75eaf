"""Sheets of a branch followed along straight lines in x: Euler steps and Newton corrections, at many points at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gsp.critical.sheet_points import Allowance, signs, solve_each
from gsp.kernels.sheets import ROUNDING, TRUSTED

# Pieces into which a straight line in x is cut, one after the other, when a sheet is followed along it; then steps
# are halved where the sheet bends.
PIECES = (1, 4, 16)
# A sheet ends where no more than this share of the way is left to the place that its steps do not reach.
LEAST_SHARE = 1e-13


@dataclass(frozen=True, eq=False)
class SheetContinuation:
    """Follows the sheets of g(x, y) = 0, as many equations as there are fast variables.

    `newton` takes x (m, n_slow) and y (m, n_fast) to the points of a sheet over x and which were found; `jacobian` and
    `slow_jacobian` are g_y and g_x as compiled functions of (x, y) and of `p`.
    """

    newton: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    jacobian: Callable[[np.ndarray, np.ndarray], np.ndarray]
    slow_jacobian: Callable[[np.ndarray, np.ndarray], np.ndarray]
    p: np.ndarray

    def follow(
        self, x: np.ndarray, x0: np.ndarray, y0: np.ndarray, allowance: Allowance | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The sheets through (x0, y0) over `x` (m, n_slow): y (m, n_fast), and which points they reach."""
        result = np.full(y0.shape, np.nan)
        pending = np.arange(len(x))
        orientation = self.orientation(x0, y0)
        for pieces in PIECES:
            y = y0[pending].copy()
            alive = np.ones(len(pending), dtype=bool)
            step = (x[pending] - x0[pending]) / pieces
            if allowance is not None and not allowance.take(pieces * len(pending)):
                break
            for k in range(pieces):
                y, good = self.continued(x0[pending] + k * step, y, step)
                alive &= good
            alive &= self.orientation(x[pending], y) == orientation[pending]
            result[pending[alive]] = y[alive]
            pending = pending[~alive]
            if len(pending) == 0:
                break
        y, share = self.walked(x0[pending], y0[pending], x[pending], allowance)
        arrived = share == 1.0
        result[pending[arrived]] = y[arrived]
        good = np.ones(len(x), dtype=bool)
        good[pending[~arrived]] = False
        return result, good

    def walked(
        self, x0: np.ndarray, y0: np.ndarray, target: np.ndarray, allowance: Allowance | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Sheets through (x0, y0) towards `target` (m, n_slow) as far as they go: y there, and the share of the way.

        A step is halved when its correction is so long that it may have landed on another sheet, or det g_y has changed
        its sign.
        """
        y, way = np.array(y0), target - x0
        share, length = np.zeros(len(x0)), np.full(len(x0), 1.0 / PIECES[-1])
        orientation = self.orientation(x0, y0)
        active = np.arange(len(x0))
        # Towards a fold about three trials halve what is left of the way.
        for _ in range(600):
            if len(active) == 0 or (allowance is not None and not allowance.take(len(active))):
                break
            here, share_tried = share[active], np.minimum(length[active], 1.0 - share[active])
            start = x0[active] + here[:, None] * way[active]
            tried, good = self.continued(start, y[active], share_tried[:, None] * way[active])
            end = x0[active] + (here + share_tried)[:, None] * way[active]
            good &= self.orientation(end, tried) == orientation[active]
            moved = active[good]
            y[moved] = tried[good]
            # The last step ends on the target exactly.
            share[moved] = np.where(share_tried[good] < length[moved], 1.0, share[moved] + share_tried[good])
            length[moved] *= 2.0
            length[active[~good]] = 0.5 * share_tried[~good]
            active = active[(share[active] < 1.0) & (length[active] > LEAST_SHARE)]
        return y, share

    def continued(self, x: np.ndarray, y: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """One Euler step and its Newton correction at all points at once, and where both can be trusted.

        They are where the correction is small, and smaller after a step by the mean of the slopes at both ends.
        """
        change = self._change(x, y, step)
        usable = np.isfinite(change).all(axis=1)
        change[~usable] = 0.0
        corrected, good = self.newton(x + step, y + change)
        last = self._change(x + step, corrected, step)
        length = np.linalg.norm(step, axis=1)
        rounding = ROUNDING * (1.0 + np.linalg.norm(corrected, axis=1))
        for way, slope, share in ((change, change, TRUSTED), ((change + last) / 2.0, last, TRUSTED**2)):
            off = np.linalg.norm(corrected - y - way, axis=1)
            good &= off <= share * (np.linalg.norm(slope, axis=1) + length) + rounding
        return corrected, usable & good

    def _change(self, x: np.ndarray, y: np.ndarray, step: np.ndarray) -> np.ndarray:
        """How y changes along an Euler step in x, at all points at once."""
        n = y.shape[1]
        z = np.hstack([x, y])
        slope = self.slow_jacobian(z, self.p).reshape(len(z), n, -1)
        jacobian = self.jacobian(z, self.p).reshape(-1, n, n)
        return -solve_each(jacobian, np.einsum("mij,mj->mi", slope, step))

    def orientation(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Sign of det g_y: constant on a sheet, since it changes at folds only."""
        n = y.shape[1]
        jacobian = self.jacobian(np.hstack([x, y]), self.p).reshape(-1, n, n)
        return signs(np.nan_to_num(jacobian))
