"""Interval matrices of the checker: products, elimination, and what is proved of every matrix in one."""

from __future__ import annotations

import math

from gsp.proofs import intervals as ia
from gsp.proofs.intervals import Interval

Matrix = list[list[Interval]]


def dot(row: list[Interval], column: list[Interval], total: Interval = ia.ZERO) -> Interval:
    """`total` and the sum of the products."""
    for a, b in zip(row, column):
        total = ia.add(total, ia.multiply(a, b))
    return total


def solved(matrix: Matrix, right: Matrix) -> Matrix | None:
    """The solution of matrix X = right, by elimination with row exchanges; None where a pivot may be 0."""
    size = len(matrix)
    width = size + len(right[0])
    rows = [list(a) + list(b) for a, b in zip(matrix, right)]
    for k in range(size):
        pivot = max(range(k, size), key=lambda i: min(abs(rows[i][k][0]), abs(rows[i][k][1])))
        rows[k], rows[pivot] = rows[pivot], rows[k]
        if rows[k][k][0] <= 0 <= rows[k][k][1]:
            return None
        for i in range(k + 1, size):
            if rows[i][k] == ia.ZERO:
                continue
            factor = ia.divide(rows[i][k], rows[k][k])
            for j in range(k, width):
                rows[i][j] = ia.subtract(rows[i][j], ia.multiply(factor, rows[k][j]))
    for k in range(size - 1, -1, -1):
        for j in range(size, width):
            value = rows[k][j]
            for i in range(k + 1, size):
                value = ia.subtract(value, ia.multiply(rows[k][i], rows[i][j]))
            rows[k][j] = ia.divide(value, rows[k][k])
    return [row[size:] for row in rows]


def is_regular(matrix: Matrix) -> bool:
    """Whether every matrix in `matrix` is regular."""
    return solved(matrix, [[] for _ in matrix]) is not None


def is_positive(form: Matrix) -> bool:
    """Whether every symmetric matrix in `form` is positive definite, by pivots."""
    size = len(form)
    rows = [list(row) for row in form]
    for k in range(size):
        if not rows[k][k][0] > 0:
            return False
        for i in range(k + 1, size):
            factor = ia.divide(rows[i][k], rows[k][k])
            for j in range(k + 1, size):
                rows[i][j] = ia.subtract(rows[i][j], ia.multiply(factor, rows[k][j]))
    return True


def norm(entries: list[Interval]) -> int:
    """A bound of the Euclidean norm of every vector with these entries."""
    if len(entries) == 1:
        return ia.magnitude(entries[0])
    return math.isqrt(sum(ia.magnitude(e) ** 2 for e in entries)) + 1


def decay(matrix: Matrix, block: list[int], sign: int) -> int:
    """A number that lambda_min(Sym(s B_ii)) does not fall below, by Gershgorin's theorem; twice is halved down."""
    least = None
    for i in block:
        entry = matrix[i][i] if sign > 0 else ia.negative(matrix[i][i])
        row = 2 * entry[0] - sum(ia.magnitude(ia.add(matrix[i][j], matrix[j][i])) for j in block if j != i)
        least = row if least is None else min(least, row)
    assert least is not None
    return least >> 1


def symmetric(w: Matrix, q: list[int], side: int, i: int, j: int) -> Interval:
    """Twice the entry of s (W^T Q + Q W), q being twice the diagonal of Q and s = `side`."""
    return ia.add(ia.times(w[j][i], q[j] * side), ia.times(w[i][j], q[i] * side))


def up(product: int) -> int:
    """A product of two whole numbers in units of 2^-384, in units of 2^-192, rounded up."""
    return -(-product >> ia.SHIFT)


def down(product: int) -> int:
    """The same rounded down."""
    return product >> ia.SHIFT
