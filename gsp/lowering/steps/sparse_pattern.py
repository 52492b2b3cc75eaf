"""A sparse Jacobian's pattern and the elimination over it, as the kernels' array; see `gsp.kernels.sparse_systems`."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gsp.lowering.steps.straight_line import Elimination


def write_pattern(places: Sequence[tuple[int, int]], elimination: Elimination) -> np.ndarray:
    """The array for a Jacobian with entries at `places`, (row, column) each, eliminated as `elimination` says.

    >>> from gsp.lowering.steps.straight_line import eliminate
    >>> write_pattern([(0, 1)], eliminate(2, [(0, 1)])).tolist()
    [1, 3, 0, 1, 0, 2, 3, 0, 2, 0, 1, 1, 0, 1, 1, 1, 0]
    """
    order = elimination.order
    number = {i: k for k, i in enumerate(order)}
    left: list[list[int]] = [[] for _ in order]
    for k, rows in enumerate(elimination.rows):
        for i in rows:
            left[number[i]].append(k)
    start, middle, columns, pivots = [0], [], [], []
    where: dict[tuple[int, int], int] = {}
    for k, right in enumerate(elimination.columns):
        row = [*(order[one] for one in left[k]), order[k], *right]
        middle.append(len(columns) + len(left[k]))
        for column in row:
            where[order[k], column] = len(columns)
            columns.append(column)
            pivots.append(number[column])
        start.append(len(columns))
    entries = [where[place] for place in places]
    rows = [i for i, _ in places]
    head = [len(entries), len(columns)]
    return np.array([*head, *order, *start, *middle, *columns, *pivots, *entries, *rows], dtype=np.int64)
