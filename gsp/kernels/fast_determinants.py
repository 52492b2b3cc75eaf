"""The determinant of a sparse matrix and how it changes, by LU factors of numbers with infinitesimal parts.

`Call`s of compiled functions run these kernels between expressions: `void f(whole* pattern, double* in, double* out)`.
`pattern` is n, the length of what follows, and a pattern as `gsp.kernels.sparse_systems` has it, of a matrix J with m
entries. Pivots are fixed: where one of them is 0 by chance, and not the last, there is no value.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import carray, types  # pyright: ignore[reportPrivateImportUsage]

from gsp.kernels.compilation import kernel
from gsp.kernels.sparse_systems import (
    ENTRIES,
    FACTORS,
    factorise_sparse,
    fill,
    places,
    solve_sparse,
)

SIGNATURE: Any = types.void(
    types.CPointer(types.int64), types.CPointer(types.float64), types.CPointer(types.float64)
)
# Of a number a + s S + t T + st S T + r R with S^2 = T^2 = R^2 = R S = R T = 0: its parts.
_PARTS = 5


@kernel
def follow(head, given, found):
    """found (n,) = -J^-1 b for given = (J (m,), b (n,))."""
    size = carray(head, 2)
    n = size[0]
    pattern = carray(head, 2 + size[1])[2:]
    count = pattern[ENTRIES]
    values, row, sizes = np.empty(pattern[FACTORS]), np.zeros(n), np.empty((3, n))
    inputs, solution = carray(given, count + n), carray(found, n)
    fill(inputs[:count], 0.0, pattern, n, values, sizes)
    factorise_sparse(pattern, values, row, sizes)
    solution[:] = inputs[count:]
    solve_sparse(pattern, values, solution)


@kernel
def _product(x, y):
    return (
        x[0] * y[0],
        x[1] * y[0] + x[0] * y[1],
        x[2] * y[0] + x[0] * y[2],
        x[3] * y[0] + x[1] * y[2] + x[2] * y[1] + x[0] * y[3],
        x[4] * y[0] + x[0] * y[4],
    )


@kernel
def _inverse(x):
    i = 1.0 / x[0]
    square = i * i
    return i, -x[1] * square, -x[2] * square, (2.0 * x[1] * x[2] * i - x[3]) * square, -x[4] * square


@kernel
def _read(values, p):
    return values[p, 0], values[p, 1], values[p, 2], values[p, 3], values[p, 4]


@kernel
def _write(values, p, x):
    values[p, 0], values[p, 1], values[p, 2], values[p, 3], values[p, 4] = x


@kernel
def change(head, given, found):
    """found = (D, dD/dt, d/dt tr J^-1, dD/dr) for given = (J (m,), dJ/dt (m,), dJ/dr (m,)).

    D = prod_k p_k/|J_k| with the pivots p and the sizes of the rows J_k. With the pivots of J + s 1,
    tr J^-1 = sum_k d/ds log p_k at s = 0.
    """
    size = carray(head, 2)
    n = size[0]
    pattern = carray(head, 2 + size[1])[2:]
    count = pattern[ENTRIES]
    inputs = carray(given, 3 * count)
    start, middle, column, pivot, place, home = places(pattern, n)
    values, row, inverses = np.zeros((pattern[FACTORS], _PARTS)), np.zeros((n, _PARTS)), np.empty((n, _PARTS))
    # |J_k|^2, and half its rates.
    rows = np.zeros((n, 3))
    for e in range(count):
        a, t, r = inputs[e], inputs[count + e], inputs[2 * count + e]
        _write(values, pattern[place + e], (a, 0.0, t, 0.0, r))
        k = pattern[home + e]
        rows[k, 0] += a * a
        rows[k, 1] += a * t
        rows[k, 2] += a * r
    D, along, moved, drift = 1.0, 0.0, 0.0, 0.0
    for k in range(n):
        first, diagonal, last = pattern[start + k], pattern[middle + k], pattern[start + k + 1]
        values[diagonal, 1] += 1.0
        for p in range(first, last):
            _write(row, pattern[column + p], _read(values, p))
        for p in range(first, diagonal):
            above, j = pattern[pivot + p], pattern[column + p]
            factor = _product(_read(row, j), _read(inverses, above))
            for q in range(pattern[middle + above] + 1, pattern[start + above + 1]):
                update = _product(factor, _read(values, q))
                i = pattern[column + q]
                for part in range(_PARTS):
                    row[i, part] -= update[part]
        for p in range(first, last):
            _write(values, p, _read(row, pattern[column + p]))
        own = _read(values, diagonal)
        _write(inverses, k, _inverse(own))
        drift += (own[3] * own[0] - own[1] * own[2]) / (own[0] * own[0])
        norm = rows[pattern[2 + k], 0]
        length = math.sqrt(norm)
        share = own[0] / length
        along = along * share + D * (own[2] - own[0] * rows[pattern[2 + k], 1] / norm) / length
        moved = moved * share + D * (own[4] - own[0] * rows[pattern[2 + k], 2] / norm) / length
        D *= share
    results = carray(found, 4)
    results[0], results[1], results[2], results[3] = D, along, drift, moved


KERNELS: dict[str, Any] = {"follow": follow, "change": change}
"""By the names that a `Call` has."""
