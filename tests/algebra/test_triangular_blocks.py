"""Block triangular matrices: found whatever the order of rows and columns."""

from __future__ import annotations

import numpy as np
import pytest

from gsp.algebra.triangular_blocks import triangular_blocks


@pytest.mark.parametrize("seed", range(5))
def test_hidden_blocks_are_found_in_an_order_in_which_the_matrix_is_triangular(seed):
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, 4, 6)
    n = int(sizes.sum())
    label = np.repeat(np.arange(6), sizes)
    # Full blocks, and some of what lies below them.
    pattern = (label[:, None] == label) | ((label[:, None] > label) & (rng.random((n, n)) < 0.3))
    shuffled = rng.permutation(n)
    found = triangular_blocks(pattern[np.ix_(shuffled, shuffled)].tolist())
    assert sorted(sorted(label[shuffled[i]] for i in block) for block in found) == sorted(
        [k] * size for k, size in enumerate(sizes.tolist())
    )
    place = {i: k for k, block in enumerate(found) for i in block}
    for i, j in zip(*np.nonzero(pattern[np.ix_(shuffled, shuffled)])):
        assert place[j] <= place[i]
