"""Sparse linear systems by a fixed elimination: LU factors in place, over a pattern known beforehand.

A pattern is one array of whole numbers, so that it stands at the end of an integrator's program:

    entries, factors, order (n,), start (n + 1,), middle (n,), column (factors,), pivot (factors,), place (entries,),
    row (entries,)

`entries` are those of the Jacobian, `factors` those of the LU factors. Row `order[k]` is eliminated as number k; its
factors are `start[k]` to `start[k + 1]`, those left of the diagonal by the number of their pivot, `pivot`, the diagonal
itself at `middle[k]`, then the rest; `column` says where in the row they stand. Entry e of the Jacobian lies in
`row[e]` and goes to the factor `place[e]`. An empty pattern stands for a dense matrix.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.compilation import kernel

# Pivots are fixed: so many units in the last place of a row or of a column may be lost to them. Partial pivoting keeps
# it near 1. Rates of reactions lie decades apart, and rows grow by them; columns that their diagonals outweigh do not.
LARGEST_GROWTH = 1e3
# Rows of the scratch `sizes` (3, n): the largest that a column held, the largest right of a row's diagonal, and the
# largest there as a share of what its column held.
HELD, LARGEST, SHARE = range(3)

ENTRIES, FACTORS, ORDER = range(3)
# An index that numba does not compare with 0, as it does each other one in case it counts from the end: that took two
# fifths of a solution.
AT = np.uint64


@kernel
def places(pattern, n):
    """Where `start`, `middle`, `column`, `pivot`, `place` and `row` begin."""
    count = pattern[FACTORS]
    start = ORDER + n
    middle = start + n + 1
    column = middle + n
    pivot = column + count
    place = pivot + count
    return start, middle, column, pivot, place, place + pattern[ENTRIES]


@kernel
def pattern_of(program):
    """The pattern in an integrator's program; empty where its Jacobian is dense, or its step has code of its own."""
    if program.shape[0] > integrator.PATTERN and program[integrator.CODE] == 0:
        return program[integrator.PATTERN :]
    return program[:0]


@kernel
def entries_of(pattern, n):
    """How many numbers the Jacobian's function gives."""
    return n * n if pattern.shape[0] == 0 else pattern[ENTRIES]


@kernel
def hold(jacobian, shift, pattern, n, sizes):
    """Set what the columns of shift - J hold, for a shift of this size: that and their entries of J."""
    _, _, column, _, place, _ = places(pattern, n)
    for k in range(n):
        sizes[HELD, k] = shift
    for e in range(pattern[ENTRIES]):
        j = AT(pattern[AT(column + pattern[AT(place + e)])])
        sizes[HELD, j] = max(sizes[HELD, j], abs(jacobian[e]))


@kernel
def fill(jacobian, shift, pattern, n, values, sizes):
    """Fill `values` (factors,) with shift - J, and `sizes` (3, n) with what its columns hold."""
    _, middle, _, _, place, _ = places(pattern, n)
    hold(jacobian, abs(shift), pattern, n, sizes)
    for p in range(pattern[FACTORS]):
        values[p] = 0.0
    for e in range(pattern[ENTRIES]):
        values[AT(pattern[AT(place + e)])] = -jacobian[e]
    for k in range(n):
        values[AT(pattern[AT(middle + k)])] += shift


@kernel
def factorise_sparse(pattern, values, row, sizes):
    """Overwrite `values` (factors,) by the LU factors, U's diagonal inverted; False when a pivot cannot be used.

    A pivot can when it and its inverse are finite and not 0, and no update exceeds `LARGEST_GROWTH` times what its row
    or its column held. `sizes` (3, n) are those of `fill`; `row` (n,) is scratch.
    """
    n = row.shape[0]
    start, middle, column, pivot, _, _ = places(pattern, n)
    usable = True
    for k in range(n):
        first, diagonal, last = pattern[AT(start + k)], pattern[AT(middle + k)], pattern[AT(start + k + 1)]
        bound = 0.0
        for p in range(first, last):
            row[AT(pattern[AT(column + p)])] = values[AT(p)]
            bound = max(bound, abs(values[AT(p)]))
        bound *= LARGEST_GROWTH
        for p in range(first, diagonal):
            above = pattern[AT(pivot + p)]
            place = AT(pattern[AT(column + p)])
            right = pattern[AT(middle + above)]
            factor = row[place] * values[AT(right)]
            row[place] = factor
            # Written so that what is not a number is not usable.
            size = abs(factor)
            usable = usable and (
                size * sizes[LARGEST, AT(above)] <= bound or size * sizes[SHARE, AT(above)] <= LARGEST_GROWTH
            )
            for q in range(right + 1, pattern[AT(start + above + 1)]):
                row[AT(pattern[AT(column + q)])] -= factor * values[AT(q)]
        for p in range(first, last):
            values[AT(p)] = row[AT(pattern[AT(column + p)])]
        inverse = 1.0 / values[AT(diagonal)]
        size = abs(inverse)
        # The inverse of what is infinite, or too large to be squared, is 0.
        usable = usable and 0.0 < size < math.inf
        values[AT(diagonal)] = inverse
        largest = share = 0.0
        for p in range(diagonal + 1, last):
            size = abs(values[AT(p)])
            largest = max(largest, size)
            share = max(share, size / sizes[HELD, AT(pattern[AT(column + p)])])
        sizes[LARGEST, k], sizes[SHARE, k] = largest, share
    return usable


@kernel
def solve_sparse(pattern, values, b):
    """Overwrite `b` (n,) by the solution, with what `factorise_sparse` left."""
    n = b.shape[0]
    start, middle, column, _, _, _ = places(pattern, n)
    for k in range(n):
        i = AT(pattern[AT(ORDER + k)])
        total = b[i]
        for p in range(pattern[AT(start + k)], pattern[AT(middle + k)]):
            total -= values[AT(p)] * b[AT(pattern[AT(column + p)])]
        b[i] = total
    for k in range(n - 1, -1, -1):
        i = AT(pattern[AT(ORDER + k)])
        diagonal = pattern[AT(middle + k)]
        total = b[i]
        for p in range(diagonal + 1, pattern[AT(start + k + 1)]):
            total -= values[AT(p)] * b[AT(pattern[AT(column + p)])]
        b[i] = total * values[AT(diagonal)]


@kernel
def dense_jacobian(jacobian, pattern, n):
    """The Jacobian (n*n,) row by row, of whatever pattern."""
    if pattern.shape[0] == 0:
        return jacobian
    _, _, column, _, place, row = places(pattern, n)
    full = np.zeros(n * n)
    for e in range(pattern[ENTRIES]):
        full[pattern[row + e] * n + pattern[column + pattern[place + e]]] = jacobian[e]
    return full
