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

from gsp.kernels import ledger
from gsp.kernels.compilation import inner_kernel, kernel

# Pivots are fixed: so many units in the last place of a row may be lost to them. Partial pivoting keeps it near 1.
LARGEST_GROWTH = 1e3

ENTRIES = 0
FACTORS = 1
ORDER = 2


@inner_kernel
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
    if program.shape[0] > ledger.PATTERN and program[ledger.CODE] == 0:
        return program[ledger.PATTERN :]
    return program[:0]


@inner_kernel
def entries_of(pattern, n):
    """How many numbers the Jacobian's function gives."""
    return n * n if pattern.shape[0] == 0 else pattern[ENTRIES]


@inner_kernel
def _size(z):
    return abs(z.real) + abs(z.imag)


@inner_kernel
def fill(jacobian, shift, pattern, n, values):
    """Fill `values` (factors,) with shift - J."""
    _, middle, _, _, place, _ = places(pattern, n)
    for p in range(pattern[FACTORS]):
        values[p] = 0.0
    for e in range(pattern[ENTRIES]):
        values[pattern[place + e]] = -jacobian[e]
    for k in range(n):
        values[pattern[middle + k]] += shift


@kernel
def factorise_sparse(pattern, values, row, largest):
    """Overwrite `values` (factors,) by the LU factors, U's diagonal inverted; False when a pivot cannot be used.

    A pivot can when it and its inverse are finite and not 0, and no update exceeds `LARGEST_GROWTH` times what its row
    held. `row` (n,), of the type of `values`, and `largest` (n,) are scratch.
    """
    n = row.shape[0]
    start, middle, column, pivot, _, _ = places(pattern, n)
    usable = True
    for k in range(n):
        first, diagonal, last = pattern[start + k], pattern[middle + k], pattern[start + k + 1]
        bound = 0.0
        for p in range(first, last):
            row[pattern[column + p]] = values[p]
            bound = max(bound, _size(values[p]))
        bound *= LARGEST_GROWTH
        for p in range(first, diagonal):
            above = pattern[pivot + p]
            place = pattern[column + p]
            factor = row[place] * values[pattern[middle + above]]
            row[place] = factor
            # Written so that what is not a number is not usable.
            usable = usable and _size(factor) * largest[above] <= bound
            for q in range(pattern[middle + above] + 1, pattern[start + above + 1]):
                row[pattern[column + q]] -= factor * values[q]
        for p in range(first, last):
            values[p] = row[pattern[column + p]]
        inverse = 1.0 / values[diagonal]
        size = _size(inverse)
        # The inverse of what is infinite, or too large to be squared, is 0.
        usable = usable and 0.0 < size < math.inf
        values[diagonal] = inverse
        top = 0.0
        for p in range(diagonal + 1, last):
            top = max(top, _size(values[p]))
        largest[k] = top
    return usable


@kernel
def solve_sparse(pattern, values, b):
    """Overwrite `b` (n,) by the solution, with what `factorise_sparse` left."""
    n = b.shape[0]
    start, middle, column, _, _, _ = places(pattern, n)
    for k in range(n):
        i = pattern[ORDER + k]
        total = b[i]
        for p in range(pattern[start + k], pattern[middle + k]):
            total -= values[p] * b[pattern[column + p]]
        b[i] = total
    for k in range(n - 1, -1, -1):
        i = pattern[ORDER + k]
        diagonal = pattern[middle + k]
        total = b[i]
        for p in range(diagonal + 1, pattern[start + k + 1]):
            total -= values[p] * b[pattern[column + p]]
        b[i] = total * values[diagonal]


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
