"""Arrays that kernels use without counting references."""

from __future__ import annotations

import numba
import numpy as np

from gsp.kernels.uncounted import uncounted


@numba.njit
def _lent(array):
    return uncounted(array)


@numba.njit
def _doubled(array):
    mine = uncounted(array)
    for i in range(mine.shape[0]):
        mine[i] *= 2.0


def test_an_uncounted_array_has_the_entries_of_its_owner_and_no_owner():
    array = np.arange(3.0)
    lent = _lent(array)
    assert np.shares_memory(lent, array)
    assert lent.base is None
    assert not lent.flags.owndata


def test_what_is_written_to_an_uncounted_array_is_written_to_its_owner():
    array = np.arange(3.0)
    _doubled(array[1:])
    np.testing.assert_array_equal(array, [0.0, 2.0, 4.0])
