"""Square matrices by blocks: the order of rows and columns in which they are block triangular."""

from __future__ import annotations

from collections.abc import Sequence

from sympy.utilities.iterables import strongly_connected_components


def triangular_blocks(pattern: Sequence[Sequence[bool]]) -> list[list[int]]:
    """The indices of each diagonal block of a matrix with this pattern of entries that are not zero.

    Each block is as small as can be, and stands behind those whose columns its rows have entries in.
    """
    n = range(len(pattern))
    edges = [(i, j) for i in n for j in n if pattern[i][j]]
    return [sorted(block) for block in strongly_connected_components((list(n), edges))]
