"""Independent rows and columns of a matrix of expressions, by elimination over the rationals at one generic point."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import flint
import sympy as sp

from gsp.algebra.substitution import substituted


def generic_point(symbols: Iterable[sp.Symbol]) -> dict[sp.Symbol, sp.Rational]:
    """A quotient of primes for every symbol, where little vanishes that does not vanish everywhere."""
    return {s: sp.Rational(sp.prime(i + 3), sp.prime(i + 6)) for i, s in enumerate(symbols)}


def at_point(matrix: sp.Matrix, point: Mapping[sp.Symbol, sp.Expr]) -> flint.fmpq_mat | None:
    """The matrix at a point; None where it is not rational there."""
    found = flint.fmpq_mat(matrix.rows, matrix.cols)
    for (i, j), entry in matrix.todok().items():
        value = substituted(entry, point) if entry.free_symbols else entry
        if not value.is_Rational:
            return None
        found[i, j] = flint.fmpq(value.p, value.q)
    return found


def independent_columns(matrix: flint.fmpq_mat, order: Sequence[int]) -> list[int]:
    """Of the columns, as they come in `order`, each that is no combination of those before it."""
    place = {j: k for k, j in enumerate(order)}
    entries = matrix.table()
    held = [(i, j) for i, row in enumerate(entries) for j, entry in enumerate(row) if j in place and entry != 0]
    pivots: list[int] = []
    # Elimination of all at once has one common denominator, as long as the whole determinant.
    for rows, columns in connected_parts(held, matrix.nrows(), matrix.ncols()):
        if not rows or not columns:
            continue
        columns.sort(key=place.__getitem__)
        reduced, rank = flint.fmpq_mat([[entries[i][j] for j in columns] for i in rows]).rref()
        column = 0
        for i in range(rank):
            while reduced[i, column] == 0:
                column += 1
            pivots.append(columns[column])
    return sorted(pivots, key=place.__getitem__)


def connected_parts(
    entries: Iterable[tuple[int, int]], rows: int, columns: int
) -> list[tuple[list[int], list[int]]]:
    """Rows and columns of the parts of a matrix that no entry joins, from the places of its entries."""
    label = list(range(rows + columns))

    def first(k: int) -> int:
        while label[k] != k:
            k = label[k]
        return k

    for i, j in entries:
        label[first(rows + j)] = first(i)
    parts: dict[int, tuple[list[int], list[int]]] = {}
    for k in range(len(label)):
        kept = parts.setdefault(first(k), ([], []))
        if k < rows:
            kept[0].append(k)
        else:
            kept[1].append(k - rows)
    return list(parts.values())
