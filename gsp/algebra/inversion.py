"""Explicit solution of equations, only by formulas that are real where they should be."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp
from sympy.polys.matrices import DomainMatrix
from sympy.polys.matrices.exceptions import DMNonInvertibleMatrixError

from gsp.algebra.factorisation import coefficients, factored, lowest_terms, numerator

INVERSES = {sp.exp: sp.log, sp.log: sp.exp, sp.tanh: sp.atanh, sp.sinh: sp.asinh, sp.atanh: sp.tanh}


def solve_for(unknown: Sequence[sp.Symbol], equations: Mapping[sp.Symbol, sp.Expr]):
    """Each unknown, in order, as an expression from {value: expression in unknowns}, or None without a formula.

    Linear systems are solved together; other equations one at a time, each for an unknown that a linear step or
    one inverse function or odd root isolates. Two-valued formulas (square roots) are refused.
    """
    remaining = [expression - value for value, expression in equations.items()]
    if not unknown:
        return {}
    places = {z: j for j, z in enumerate(unknown)}
    slopes = {
        (i, places[z]): sp.diff(e, z) for i, e in enumerate(remaining) for z in e.free_symbols & places.keys()
    }
    if not any(slope.free_symbols & places.keys() for slope in slopes.values()):
        matrix = DomainMatrix.from_Matrix(sp.SparseMatrix(len(remaining), len(unknown), slopes)).to_field()
        offset = [-e.xreplace(dict.fromkeys(unknown, sp.S.Zero)) for e in remaining]
        try:
            inverse = matrix.inv().to_Matrix()
        except DMNonInvertibleMatrixError:
            return None
        rows: list[list[sp.Expr]] = [[] for _ in unknown]
        for (i, j), entry in inverse.todok().items():
            rows[i].append(entry * offset[j])
        return {z: factored(sp.Add(*row)) for z, row in zip(unknown, rows)}
    solved: dict[sp.Symbol, sp.Expr] = {}
    while remaining:
        step = _isolate(remaining, [z for z in unknown if z not in solved])
        if step is None:
            return None
        place, symbol, value = step
        del remaining[place]
        solved = {z: e.xreplace({symbol: value}) for z, e in solved.items()}
        solved[symbol] = value
        remaining = [numerator(e.xreplace({symbol: value})) for e in remaining]
    return {z: solved[z] for z in unknown}


def _isolate(equations: Sequence[sp.Expr], unknown: Sequence[sp.Symbol]):
    """(place, symbol, value) of the plainest step: a constant slope, any other, an inverse function, an odd root."""
    best = None
    for place, equation in enumerate(equations):
        for symbol in unknown:
            if not equation.has(symbol):
                continue
            slope = lowest_terms(sp.diff(equation, symbol)) if equation.is_polynomial(symbol) else None
            if slope is not None and not slope.has(symbol):
                rank = 1 if slope.has(*unknown) else 0
                if best is None or rank < best[0]:
                    best = (rank, place, symbol, lowest_terms(-equation.subs(symbol, 0) / slope))
            elif best is None:
                value = one_inverse(equation, symbol)
                value = _odd_root(equation, symbol) if value is None else value
                if value is not None:
                    best = (2, place, symbol, value)
    return None if best is None else best[1:]


def one_inverse(equation: sp.Expr, symbol: sp.Symbol) -> sp.Expr | None:
    """The solution of an equation linear in one invertible function of a linear argument, or None."""
    functions = {piece for piece in equation.atoms(sp.Function) if piece.has(symbol)}
    if len(functions) != 1:
        return None
    inner = functions.pop()
    if inner.func not in INVERSES:
        return None
    stand_in = sp.Dummy()
    outer = equation.xreplace({inner: stand_in})
    outer_slope = sp.diff(outer, stand_in)
    argument = inner.args[0]
    slope = sp.diff(argument, symbol)
    if outer.has(symbol) or outer_slope.has(stand_in) or slope == 0 or slope.has(symbol):
        return None
    value = lowest_terms(-outer.subs(stand_in, 0) / outer_slope)
    return (INVERSES[inner.func](value) - argument.subs(symbol, 0)) / slope


def _odd_root(equation: sp.Expr, symbol: sp.Symbol) -> sp.Expr | None:
    """The real solution of a z^n + b with odd n, smooth where it is not zero; None for other equations."""
    row = coefficients(equation, symbol)
    if row is None or len(row) % 2 or any(c != 0 for c in row[1:-1]):
        return None
    power = lowest_terms(-row[-1] / row[0])
    return sp.sign(power) * sp.Abs(power) ** sp.Rational(1, len(row) - 1)
