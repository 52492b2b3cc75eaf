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
    rows = matrix.nrows()
    permuted = flint.fmpq_mat(rows, len(order), [matrix[i, j] for i in range(rows) for j in order])
    reduced, rank = permuted.rref()
    pivots, column = [], 0
    for i in range(rank):
        while reduced[i, column] == 0:
            column += 1
        pivots.append(order[column])
    return pivots
