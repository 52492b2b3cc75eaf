"""Four complex sparse systems over one pattern, eliminated and solved at once; see `sparse_systems` for the pattern.

The systems that a step of Radau's methods solves differ in the shift of the diagonal alone: one walk through the
pattern serves them all, and one vector holds the numbers that stand at its entry.
"""

from __future__ import annotations

from gsp.kernels.compilation import kernel
from gsp.kernels.quads import LANES, QUAD, copy, invert, multiply, size, subtract_product
from gsp.kernels.sparse_systems import (
    AT,
    ENTRIES,
    FACTORS,
    HELD,
    LARGEST,
    LARGEST_GROWTH,
    ORDER,
    SHARE,
    hold,
    places,
)


@kernel
def fill_quads(jacobian, shifts, pattern, n, values, sizes):
    """`fill` for four systems: fill the quads `values` (8 factors,) with shifts - J, for the quad `shifts` (8,)."""
    _, middle, _, _, place, _ = places(pattern, n)
    hold(jacobian, size(shifts, 0) / LANES, pattern, n, sizes)
    for p in range(QUAD * pattern[FACTORS]):
        values[p] = 0.0
    for e in range(pattern[ENTRIES]):
        first = QUAD * pattern[AT(place + e)]
        for m in range(first, first + LANES):
            values[AT(m)] = -jacobian[e]
    for k in range(n):
        first = QUAD * pattern[AT(middle + k)]
        for m in range(QUAD):
            values[AT(first + m)] += shifts[m]


@kernel
def factorise_quads(pattern, values, row, sizes, factor):
    """`factorise_sparse` for four systems: overwrite `values` (8 factors,), False when a pivot cannot be used.

    An update is measured over all four. `sizes` (3, n) are those of `fill_quads`; `row` (8 n,) and `factor` (8,) are
    scratch.
    """
    n = sizes.shape[1]
    start, middle, column, pivot, _, _ = places(pattern, n)
    # The mean of one quad times that of another, and not the sums.
    limit = LANES * LARGEST_GROWTH
    usable = True
    for k in range(n):
        first, diagonal, last = pattern[AT(start + k)], pattern[AT(middle + k)], pattern[AT(start + k + 1)]
        bound = 0.0
        for p in range(first, last):
            copy(row, pattern[AT(column + p)], values, p)
            bound = max(bound, size(values, p))
        bound *= limit
        for p in range(first, diagonal):
            above = pattern[AT(pivot + p)]
            multiply(factor, 0, row, pattern[AT(column + p)], values, pattern[AT(middle + above)])
            # Written so that what is not a number is not usable.
            own = size(factor, 0)
            usable = usable and (own * sizes[LARGEST, above] <= bound or own * sizes[SHARE, above] <= limit)
            for q in range(pattern[AT(middle + above)] + 1, pattern[AT(start + above + 1)]):
                subtract_product(row, pattern[AT(column + q)], factor, 0, values, q)
            copy(values, p, factor, 0)
        for p in range(diagonal, last):
            copy(values, p, row, pattern[AT(column + p)])
        usable = invert(values, diagonal) and usable
        largest = share = 0.0
        for p in range(diagonal + 1, last):
            own = size(values, p)
            largest = max(largest, own)
            share = max(share, own / (LANES * sizes[HELD, pattern[AT(column + p)]]))
        sizes[LARGEST, k], sizes[SHARE, k] = largest, share
    return usable


@kernel
def solve_quads(pattern, values, b, n):
    """Overwrite the quads `b` (8 n,) by the solutions, with what `factorise_quads` left."""
    start, middle, column, _, _, _ = places(pattern, n)
    for k in range(n):
        for p in range(pattern[AT(start + k)], pattern[AT(middle + k)]):
            subtract_product(b, pattern[AT(ORDER + k)], values, p, b, pattern[AT(column + p)])
    for k in range(n - 1, -1, -1):
        i = pattern[AT(ORDER + k)]
        diagonal = pattern[AT(middle + k)]
        for p in range(diagonal + 1, pattern[AT(start + k + 1)]):
            subtract_product(b, i, values, p, b, pattern[AT(column + p)])
        multiply(b, i, b, i, values, diagonal)
