"""Units in which the numbers of every state are common ones, so that `1 + |y|` is a size of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from gsp.critical.layer_problem import NOTHING, LayerProblem, natural_scales
from gsp.systems.region import Interval, powers_of_two
from gsp.systems.system import SlowFastSystem

if TYPE_CHECKING:
    from gsp.critical.branch import Branch


def common_units(system: SlowFastSystem, points: np.ndarray, more: np.ndarray | tuple[()] = ()) -> np.ndarray:
    """Units of the states (n,), by the largest finite numbers of each at `points` (m, n), and of `more` sizes (k,).

    All are 1 where all sizes are common numbers, else each is the power of two next to a size. A state that is 0 at all
    points, but for rounding, has the size at which it matters in g; of `more` what is 0 has unit 1.
    """
    sizes = np.abs(np.where(np.isfinite(points), points, 0.0)).max(axis=0)
    others = np.array([size or 1.0 for size in more])
    # Fractions and millivolts are common numbers: most models stay in the units that they are in, and as compiled.
    low, high = 2.0**-3, 2.0**7
    if ((sizes >= low) & (sizes < high)).all() and ((others >= low) & (others < high)).all():
        return np.ones(len(sizes) + len(others))
    return powers_of_two(np.concatenate([own_sizes(system, sizes, above=0.0), others]))


def sized(branch: Branch, y: np.ndarray) -> np.ndarray:
    """Points `y` (m, n) of M0, those of a fast variable that is 0 at all of them by the size that the branch has of it.

    M0 does not tell how large a slip is, of which friction leaves none; the region of a scene does.
    """
    return np.where((y == 0.0).all(axis=0), branch.scales[1], y) if branch.units else y


def own_sizes(
    system: SlowFastSystem,
    point: np.ndarray,
    bounds: Mapping[str, Interval] | None = None,
    *,
    above: float = NOTHING,
) -> np.ndarray:
    """Sizes (n,) of the states: the widths of their `bounds`, or those at a `point` (n,), or at which they matter.

    The last counts where one at the point is nothing beside it, and those at the point only `above` a number where g
    does not tell.
    """
    with np.errstate(all="ignore"):
        return natural_scales(LayerProblem.over_all(system), point, bounds or {}, above=above)
