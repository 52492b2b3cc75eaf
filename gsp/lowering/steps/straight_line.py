"""Straight-line LU decompositions, written for the sparsity pattern of one Jacobian.

The integrators solve (shift - J) x = b many times with one pattern of zeros in J. Code without a loop that touches
nothing but the entries that fill in is faster than any loop, dense or sparse. Pivots are taken from the diagonal in an
order fixed beforehand (Markowitz 1957: the least fill), so that nothing is decided at run time; where entries grow
beyond `LARGEST_GROWTH` the code says so, and the caller falls back to partial pivoting.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from heapq import heapify, heappop, heappush
from typing import Any

from gsp.kernels.sparse_systems import LARGEST_GROWTH
from gsp.lowering.steps.arithmetic import RealArithmetic


@dataclass(frozen=True)
class Elimination:
    """Which entries Gaussian elimination meets: the pivots' `order`, and for each the rows and columns it changes.

    `rows[k]` and `columns[k]` are what is left of column and row `order[k]`.
    """

    order: tuple[int, ...]
    rows: tuple[tuple[int, ...], ...]
    columns: tuple[tuple[int, ...], ...]

    @cached_property
    def places(self) -> tuple[tuple[int, int], ...]:
        """Where the factors have entries, pivot by pivot."""
        return tuple(
            place
            for k, rows, columns in zip(self.order, self.rows, self.columns)
            for place in ((k, k), *((i, k) for i in rows), *((k, j) for j in columns))
        )

    @property
    def operations(self) -> int:
        """Multiplications and additions of one decomposition."""
        return sum(len(r) * (1 + 2 * len(c)) for r, c in zip(self.rows, self.columns))


def eliminate(n: int, entries: Iterable[tuple[int, int]]) -> Elimination:
    """The elimination of n unknowns with pivots on the diagonal in Markowitz's order; `entries` says what is not zero.

    The diagonal counts as not zero.

    >>> eliminate(3, [(0, 1), (0, 2), (1, 0), (2, 0)]).order
    (1, 2, 0)
    """
    below: list[set[int]] = [set() for _ in range(n)]
    right: list[set[int]] = [set() for _ in range(n)]
    for i, j in entries:
        if i != j:
            below[j].add(i)
            right[i].add(j)
    order, rows, columns = [], [], []
    # Of equals the one that waits for the fewest others, so that a long chain is not walked from end to end.
    depth = [0] * n
    known = [(len(below[i]) * len(right[i]), 0, i) for i in range(n)]
    waiting = list(known)
    heapify(waiting)
    while waiting:
        found = heappop(waiting)
        k = found[2]
        if known[k] != found:
            continue
        known[k] = (-1, 0, k)
        touched = below[k] | right[k]
        order.append(k)
        rows.append(tuple(sorted(below[k])))
        columns.append(tuple(sorted(right[k])))
        for i in rows[-1]:
            right[i] = (right[i] | right[k]) - {i, k}
        for j in columns[-1]:
            below[j] = (below[j] | below[k]) - {j, k}
        for i in touched:
            depth[i] = max(depth[i], depth[k] + 1)
            known[i] = (len(below[i]) * len(right[i]), depth[i], i)
            heappush(waiting, known[i])
    return Elimination(tuple(order), tuple(rows), tuple(columns))


def factorise(
    arithmetic: RealArithmetic, entries: Mapping[tuple[int, int], Any], elimination: Elimination
) -> tuple[dict[tuple[int, int], Any], Any]:
    """Factors of the matrix of `entries`, by place, the pivots inverted; and a bit, whether they can be used.

    They can when every pivot and its inverse are finite and not 0, and no update exceeds `LARGEST_GROWTH` times what
    its row held: the backward error of a solution is then so small, row by row.
    """
    builder = arithmetic.builder
    entries = dict(entries)
    sizes: dict[int, list[Any]] = {}
    for (i, _), value in entries.items():
        sizes.setdefault(i, []).append(arithmetic.size(value))
    limit = RealArithmetic(builder, arithmetic.width).constant(LARGEST_GROWTH)
    bounds = {i: builder.fmul(limit, arithmetic.largest(row)) for i, row in sizes.items()}
    infinity = RealArithmetic(builder, arithmetic.width).constant(float("inf"))
    zero = RealArithmetic(builder, arithmetic.width).constant(0.0)
    usable: Any = None
    for k, rows, columns in zip(elimination.order, elimination.rows, elimination.columns):
        inverse = arithmetic.reciprocal(entries[k, k])
        # The inverse of what is infinite, or too large to be squared, is 0.
        size = arithmetic.size(inverse)
        checks = [builder.fcmp_ordered("<", size, infinity), builder.fcmp_ordered(">", size, zero)]
        entries[k, k] = inverse
        pivot_row = arithmetic.largest([arithmetic.size(entries[k, j]) for j in columns]) if columns else None
        for i in rows:
            multiplier = entries[i, k] = arithmetic.multiply(entries[i, k], inverse)
            if pivot_row is not None:
                update = builder.fmul(arithmetic.size(multiplier), pivot_row)
                checks.append(builder.fcmp_ordered("<=", update, bounds[i]))
            for j in columns:
                entries[i, j] = arithmetic.subtract_product(entries.get((i, j)), multiplier, entries[k, j])
        for check in checks:
            usable = check if usable is None else builder.and_(usable, check)
    return entries, usable


def solve(
    arithmetic: RealArithmetic,
    factors: Mapping[tuple[int, int], Any],
    elimination: Elimination,
    b: Sequence[Any],
) -> list[Any]:
    """The solution x (n,) for the right-hand side `b` (n,)."""
    x = list(b)
    for k, rows in zip(elimination.order, elimination.rows):
        for i in rows:
            x[i] = arithmetic.subtract_product(x[i], factors[i, k], x[k])
    for k, columns in zip(reversed(elimination.order), reversed(elimination.columns)):
        for j in columns:
            x[k] = arithmetic.subtract_product(x[k], factors[k, j], x[j])
        x[k] = arithmetic.multiply(x[k], factors[k, k])
    return x
