"""The layer problem of a field with a simple pole: F = L/epsilon + G with L = N f, and the rank of its equilibria."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import sympy as sp
from sympy.polys.domains import EXRAW
from sympy.polys.matrices import DomainMatrix

from gsp.algebra.brevity import brief
from gsp.algebra.differentiation import derivative
from gsp.algebra.elimination_over_rationals import (
    connected_parts,
    generic_point,
    independent_rows,
    less,
    numbers_at,
)
from gsp.algebra.factorisation import lowest_terms, short_forms
from gsp.algebra.first_integrals import common_factor, linear_relations
from gsp.algebra.laurent import laurent, pole_order
from gsp.algebra.polynomials import rational
from gsp.algebra.rational_matrices import rational_matrix
from gsp.algebra.sharing import operations, plus, reciprocal, times
from gsp.errors import SplittingError
from gsp.systems.system import VectorField

# Expressions with more operations are not rewritten for looks.
TIDY_LIMIT = 120
# Determinants of matrices up to this size are expanded by rows; the number of terms grows like the factorial.
LAPLACE = 4


def principal_part(field: VectorField) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """(L, G) with F = L/epsilon + G, term by term so that nothing is expanded needlessly."""
    epsilon = field.epsilon
    assert epsilon is not None
    layer, drift = [], []
    for rate in field.rates:
        pole, regular, entangled = [], [], []
        for term in sp.Add.make_args(rate):
            # What is as it stands over epsilon, or without it, keeps its form: enclosures depend on it.
            free, bound = term.as_independent(epsilon, as_Add=False)
            own = {1 / epsilon: pole, sp.S.One: regular}.get(bound)
            (entangled.append(term) if own is None else own.append(free))
        # Expansion in epsilon only: products of sums that contain it are multiplied out, the rest is kept.
        # Exponentials are hidden, as SymPy's `collect` makes powers exp(u)**(1/5) of exp(u/5).
        hidden = {atom: sp.Dummy() for atom in rate.atoms(sp.exp)}
        meaning = {symbol: atom for atom, symbol in hidden.items()}
        bound_up = sp.expand_mul(sp.Add(*entangled).xreplace(hidden))
        collected = sp.collect(bound_up, epsilon, evaluate=True).xreplace(meaning)
        for term in sp.Add.make_args(collected):
            for part in sp.Add.make_args(sp.expand_mul(term)):
                if not pole_order(part, epsilon):
                    regular.append(part)
                    continue
                residue = laurent(part, epsilon, order=-1)[-1]
                pole.append(residue)
                if (part - residue / epsilon).expand() != 0:
                    regular.append(lowest_terms(part - residue / epsilon))
        total = sp.Add(*pole)
        layer.append(tidy(total) if sp.expand_mul(total) != 0 else sp.S.Zero)
        drift.append(sp.Add(*regular))
    return layer, drift


def factorised(layer, field: VectorField, rank: int) -> tuple[sp.ImmutableMatrix, sp.ImmutableMatrix]:
    """(N, f) with L = N f; off {f = 0} exactly when N is constant or one-dimensional, else on {f = 0}."""
    states = list(field.states)
    L = sp.Matrix(layer)
    if rank == 1:
        f = common_factor(layer, states)
        if not f.free_symbols.isdisjoint(states):
            return sp.ImmutableMatrix((L / f).applyfunc(lowest_terms)), sp.ImmutableMatrix([f])
    relations = linear_relations(layer, states)
    if relations is not None and len(relations) == len(states) - rank:
        # The last component in each is a combination of the others, which stand in no other one last.
        held = [{i: c for i, c in enumerate(relation) if c is not sp.S.Zero} for relation in relations]
        last = {max(relation) for relation in held}
        rows = [i for i in range(len(states)) if i not in last]
        constant = sp.zeros(len(states), rank)
        place = {i: j for j, i in enumerate(rows)}
        for i, j in place.items():
            constant[i, j] = sp.S.One
        for relation in held:
            k = max(relation)
            for i in relation.keys() & place.keys():
                constant[k, place[i]] = lowest_terms(-relation[i] / relation[k])
        return sp.ImmutableMatrix(constant), sp.ImmutableMatrix([layer[i] for i in rows])
    DL = jacobian(L, states)
    values = numbers_at(DL, generic_point((*states, *field.parameters)))
    rows = [] if values is None else independent_rows(values)[:rank]
    if values is None or len(rows) < rank:
        raise SplittingError(f"the fast part {shown(field, layer)} has no {rank} independent components.")
    columns = independent_rows([[values[i][j] for i in rows] for j in range(len(states))])
    # DL = N Df on {f = 0}, so N follows from any invertible block.
    N = DL.extract(list(range(len(states))), columns) * inverse(DL.extract(rows, columns))
    return sp.ImmutableMatrix(reduced(N)), sp.ImmutableMatrix([layer[i] for i in rows])


def inverse(matrix: sp.Matrix) -> sp.Matrix:
    """The inverse, of the parts that stand apart each: nothing is simplified, which can take minutes.

    By cofactors up to `LAPLACE` rows, beyond by elimination, whose steps are shared.
    """
    found = sp.zeros(matrix.rows, matrix.cols)
    for rows, columns in connected_parts(matrix.todok(), *matrix.shape):
        part = matrix.extract(rows, columns)
        inverted = _by_cofactors(part) if len(rows) <= LAPLACE else _by_elimination(part)
        for (i, j), entry in inverted.todok().items():
            found[columns[i], rows[j]] = entry
    return found


def _by_elimination(matrix: sp.Matrix) -> sp.Matrix:
    """The inverse by elimination, the pivots those that are largest at the generic point."""
    exact = rational_matrix(matrix)
    if exact is not None:
        return sp.Matrix(matrix.rows, matrix.cols, [rational(e) for row in exact.inv().table() for e in row])
    n = matrix.rows
    values = numbers_at(matrix, generic_point(sorted(matrix.free_symbols, key=str)))
    if values is None:
        raise SplittingError(f"the matrix of {n} fast directions has no value at a generic point.")
    left = [[*matrix.row(i), *(sp.Integer(int(i == j)) for j in range(n))] for i in range(n)]
    order: list[int] = []
    for k in range(n):
        pivot = max((i for i in range(n) if i not in order), key=lambda i: abs(values[i][k]))
        order.append(pivot)
        scale = reciprocal(left[pivot][k])
        values[pivot] = [value / values[pivot][k] for value in values[pivot]]
        left[pivot] = [times(scale, entry) for entry in left[pivot]]
        for i in range(n):
            if i != pivot and left[i][k] != 0:
                value, factor = values[i][k], times(sp.S.NegativeOne, left[i][k])
                values[i] = less(values[i], value, values[pivot])
                left[i] = [plus([a, times(factor, b)]) for a, b in zip(left[i], left[pivot])]
    return sp.Matrix([left[pivot][n:] for pivot in order])


def _by_cofactors(matrix: sp.Matrix) -> sp.Matrix:
    adjugate, determinant = adjugate_and_determinant(matrix)
    return adjugate.applyfunc(lambda cofactor: cofactor / determinant)


def adjugate_and_determinant(matrix: sp.Matrix) -> tuple[sp.Matrix, sp.Expr]:
    """The inverse times the determinant, and the determinant, by cofactors: sums of products, with no quotient."""
    n = matrix.rows
    adjugate = sp.Matrix(n, n, lambda i, j: (-1) ** (i + j) * _determinant(matrix.minor_submatrix(j, i)))
    return adjugate, sp.Add(*[matrix[0, j] * adjugate[j, 0] for j in range(n)])


def _determinant(matrix: sp.Matrix) -> sp.Expr:
    if matrix.rows == 0:
        return sp.Integer(1)
    terms = [
        (-1) ** j * matrix[0, j] * _determinant(matrix.minor_submatrix(0, j))
        for j in range(matrix.cols)
        if matrix[0, j] != 0
    ]
    return sp.Add(*terms)


def reduced(matrix: sp.Matrix) -> sp.Matrix:
    """`matrix` with its entries in lowest terms, unless it is long: nested sines and roots take minutes."""
    length = operations(matrix)
    if length > 5000 or (length > TIDY_LIMIT and not all(e.is_rational_function() for e in matrix)):
        return matrix
    return matrix.applyfunc(lowest_terms)


def jacobian(column: Iterable[sp.Expr], states: Sequence[sp.Symbol]) -> sp.Matrix:
    """Derivatives of the entries of `column` (rows) by `states` (columns)."""
    entries = list(column)
    places = {z: j for j, z in enumerate(states)}
    slopes = {
        i: {places[z]: derivative(entry, z) for z in sorted(moving, key=places.__getitem__)}
        for i, entry in enumerate(entries)
        if (moving := entry.free_symbols & places.keys())
    }
    # Another way to a matrix writes every zero.
    return DomainMatrix(slopes, (len(entries), len(states)), EXRAW).to_Matrix()


def tidy(expression: sp.Expr) -> sp.Expr:
    """The shortest of a few equal forms; long expressions are left as they are."""
    length = sp.count_ops(expression)
    if length > TIDY_LIMIT:
        return expression
    forms = dict.fromkeys((expression, *short_forms(expression)))
    return min(forms, key=lambda form: length if form is expression else sp.count_ops(form))


def shown(field: VectorField, layer: Sequence[sp.Expr]) -> str:
    return ", ".join(f"{z}' = ({brief(e)})/{field.epsilon}" for z, e in zip(field.states, layer) if e != 0)
