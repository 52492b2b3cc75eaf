"""Independent rows and columns of a matrix of expressions, by elimination at one generic point.

Over the rationals where the matrix is rational there, else to `DIGITS` digits.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import flint
import sympy as sp
from sympy.utilities.iterables import connected_components

from gsp.algebra.substitution import substituted

# Half of them tell what is left of a row from the rounding of what was taken away.
DIGITS = 50


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


def numbers_at(matrix: sp.Matrix, point: Mapping[sp.Symbol, sp.Expr]) -> list[list[sp.Expr]] | None:
    """The matrix at a point to `DIGITS` digits, rationals exactly; None where an entry has no value."""
    inexact = {s: sp.Float(value, DIGITS) for s, value in point.items()}

    def number(entry: sp.Expr) -> sp.Expr:
        value = substituted(entry, point)
        # Worked out from below: parts that an entry shares with itself are, too.
        return value if value.is_Rational else _number(substituted(entry, inexact))

    values = [[number(matrix[i, j]) for j in range(matrix.cols)] for i in range(matrix.rows)]
    return values if all(value.is_finite for row in values for value in row) else None


def _number(value: sp.Expr) -> sp.Expr:
    return value if value.is_Rational else sp.N(value, DIGITS)


def less(row: Sequence[sp.Expr], factor: sp.Expr, other: Sequence[sp.Expr]) -> list[sp.Expr]:
    """row - factor other. At a generic point roots may be complex, whose products SymPy does not work out by itself."""
    return [_number(a - factor * b) for a, b in zip(row, other)]


def independent_rows(values: Sequence[Sequence[sp.Expr]]) -> list[int]:
    """The places of the rows that are no combination of those before them: more than rounding is left of them."""
    held: list[tuple[int, list[sp.Expr]]] = []
    found = []
    for i, row in enumerate(values):
        size = max(map(abs, row))
        left = list(row)
        for pivot, other in held:
            factor = _number(left[pivot] / other[pivot])
            left = less(left, factor, other)
            left[pivot] = sp.S.Zero
        pivot = max(range(len(left)), key=lambda j: abs(left[j]))
        if abs(left[pivot]) > size * sp.Rational(1, 10 ** (DIGITS // 2)):
            held.append((pivot, left))
            found.append(i)
    return found


def connected_parts(
    entries: Iterable[tuple[int, int]], rows: int, columns: int
) -> list[tuple[list[int], list[int]]]:
    """Rows and columns of the parts of a matrix that no entry joins, from the places of its entries."""
    edges = [(i, rows + j) for i, j in entries]
    parts = map(sorted, connected_components((range(rows + columns), edges)))
    return [([k for k in part if k < rows], [k - rows for k in part if k >= rows]) for part in parts]
