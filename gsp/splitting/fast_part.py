"""The layer problem of a field with a simple pole: F = L/epsilon + G with L = N f, and the rank of its equilibria."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
import scipy.linalg
import sympy as sp
from sympy.polys.domains import EXRAW
from sympy.polys.matrices import DomainMatrix

from gsp.algebra.differentiation import derivative
from gsp.algebra.elimination_over_rationals import (
    at_point,
    connected_parts,
    generic_point,
    independent_rows,
    numbers_at,
)
from gsp.algebra.factorisation import factored, lowest_terms
from gsp.algebra.first_integrals import common_factor, linear_relations
from gsp.algebra.laurent import laurent, pole_order
from gsp.algebra.polynomials import rational
from gsp.algebra.rational_matrices import rational_matrix
from gsp.algebra.sharing import operations, plus, reciprocal, times
from gsp.errors import DegenerateError, SplittingError
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.systems.system import VectorField

# Random starts, Gauss-Newton steps and tolerances in the search for equilibria of the layer problem.
SEARCH_STARTS = 64
SEARCH_STEPS = 60
# Where that finds nothing, so many sets of units are tried for the states, over these decades, from fewer starts each.
UNITS, DECADES, STARTS_IN_UNITS = 32, (-12.0, 16.0), 8
SEARCH_TOLERANCE = 1e-10
RANK_TOLERANCE = 1e-7
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


def layer_rank(layer: list[sp.Expr], field: VectorField) -> int:
    """Rank of DL on the critical manifold: the one met most often on zeros of L that Gauss-Newton finds.

    The parameters have their values; the number of states when every zero found is isolated.
    """
    if all(component == 0 for component in layer):
        raise SplittingError(f"no rate has a pole in {field.epsilon}.", got=shown(field, layer))
    _refuse_constants(layer, field)
    states = field.states
    matrix = jacobian(layer, states)
    constant = at_point(matrix, dict(field.parameters)) if not matrix.has(*states) else None
    origin = dict.fromkeys(states, sp.S.Zero)
    if constant is not None and all(component.xreplace(origin) == 0 for component in layer):
        # Of whole numbers: a thousand states take a hundredth of a second, and 13 with fractions.
        whole, _ = constant.numer_denom()
        if (whole * whole).rank() == whole.rank():
            return whole.rank()
    plain = [compile_over(field, tuple(outputs), arguments=states) for outputs in (layer, matrix)]
    p = compile_flow(field).constants
    random = np.random.default_rng(0)
    z = random.standard_normal((SEARCH_STARTS, len(states)))
    z[: SEARCH_STARTS // 2] = np.abs(z[: SEARCH_STARTS // 2])
    functions = _in_units(plain, _balanced(plain[1](z, p)))
    # In a unit of time in which DL is not small at the starts: what vanishes is told from what is slow.
    sizes = np.linalg.norm(functions[1](z, p), axis=1)
    usual = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    speed = min(float(np.median(usual)), 1.0) if usual.size else 1.0
    compiled = [lambda z, p, of=of: of(z, p) / speed for of in functions]
    found: list[tuple[int, int]] = []
    matrices: list[np.ndarray] = []
    for start in z:
        point, converged = _equilibrium(start, compiled, p)
        if converged:
            matrices.append(_matrix(compiled[1], point, p))
            found += _ranks(matrices[-1])

    def in_units() -> Iterator[list[np.ndarray]]:
        """DL (n, n) at the zeros that are found, the states in units that are drawn, and in these units."""
        # Amounts may be of any size: molecules in a cubic centimetre, moles in a litre.
        for _ in range(UNITS):
            units = 10.0 ** random.uniform(*DECADES, len(states))
            yield list(_matrices_in_units(z[:: SEARCH_STARTS // STARTS_IN_UNITS], units, compiled, p))

    for there in in_units() if not found else ():
        found = [ranks for matrix in there for ranks in _ranks(matrix, _by_rows)]
        if found:
            break
    if not found:
        raise SplittingError(
            f"no real equilibrium of the fast part {shown(field, layer)} was found, and without one there is no "
            "critical manifold.",
            "A fast rotation or drift is averaged, by `average`, not reduced; or check the parameters' values.",
        )
    if max(rank for rank, _ in found) == 0:
        raise DegenerateError(
            f"the fast part {shown(field, layer)} vanishes to second order on its zeros, so no direction is "
            "hyperbolic there.",
            "Rescale the fast variables; gsp.scalings(field) looks for powers of the small parameter.",
        )
    # Isolated equilibria have full rank and say nothing about the manifold next to them.
    on_manifolds = [rank for rank, _ in found if 0 < rank < len(states)]
    if not on_manifolds:
        return len(states)
    rank = max(on_manifolds, key=on_manifolds.count)
    # Rates of a million beside rates of one: in the square the latter are rounding.
    # Where a switch is flat to rounding its zeros say nothing; in other units they are where it is steep.
    looked_at = itertools.chain([matrices], in_units())
    if (rank, rank) not in found and not any(
        _has_as_many_eigenvalues(matrix, rank) for there in looked_at for matrix in there
    ):
        raise DegenerateError(
            f"the fast part {shown(field, layer)} is tangent to its own zeros (its linear part is nilpotent "
            "there), so no direction is normally hyperbolic.",
            "Rescale the fast variables (gsp.scalings(field) looks for powers of the small parameter), or average.",
        )
    return rank


def _balanced(matrices: np.ndarray) -> np.ndarray:
    """The units (n,), powers of two, in which the usual one of the `matrices` (m, n * n) is balanced."""
    n = math.isqrt(matrices.shape[1])
    finite = matrices[np.isfinite(matrices).all(axis=1)]
    if not finite.size:
        return np.ones(n)
    usual = np.median(np.abs(finite), axis=0).reshape(n, n)
    answer: Any = scipy.linalg.matrix_balance(usual, permute=False, separate=True)
    return answer[1][0]


def _in_units(compiled: Sequence[Callable], units: np.ndarray) -> list[Callable]:
    """L and DL of states in `units` (n,), by those of the states themselves."""
    of, derivatives = compiled
    ratios = (units / units[:, None]).ravel()
    return [lambda z, p: of(z * units, p) / units, lambda z, p: derivatives(z * units, p) * ratios]


def _matrices_in_units(starts: np.ndarray, units: np.ndarray, compiled, p: np.ndarray) -> Iterator[np.ndarray]:
    """DL (n, n) at the zeros found from `starts` (m, n), the states in `units` (n,), each then in units of its value.

    What is a zero is judged relative to the terms.
    """

    values, matrix = _in_units(compiled, units)
    for start in starts:
        z, converged = _equilibrium(start, (values, matrix), p)
        there = _matrix(matrix, z, p)
        sizes = np.abs(there) @ np.abs(z)
        if not converged or (np.abs(values(z, p)) > SEARCH_TOLERANCE * sizes).any():
            continue
        own = np.where(z == 0.0, 1.0, np.abs(z))
        yield there * own / own[:, None]


def _ranks(
    matrix: np.ndarray, scaled: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> list[tuple[int, int]]:
    """The ranks of a matrix and of its square, each `scaled`; nothing where the square is beyond doubles."""
    square = matrix @ matrix
    if not np.isfinite(square).all():
        return []
    return [(_numerical_rank(scaled(matrix)), _numerical_rank(scaled(square)))]


def _has_as_many_eigenvalues(matrix: np.ndarray, rank: int) -> bool:
    """Whether a matrix of this rank has as many eigenvalues off zero: the sum of its principal minors of that size.

    It is judged by the terms of the minors, and is the same in all units of the states.
    """
    n = len(matrix)
    # More principal minors are not added up.
    if math.comb(n, rank) > 1000 or _numerical_rank(_by_rows(matrix)) != rank:
        return False
    chosen = [matrix[np.ix_(rows, rows)] for rows in itertools.combinations(range(n), rank)]
    terms = sum(float(np.prod(np.abs(minor).sum(axis=1))) for minor in chosen)
    return abs(sum(float(np.linalg.det(minor)) for minor in chosen)) > RANK_TOLERANCE * terms


def _by_rows(matrix: np.ndarray) -> np.ndarray:
    """Each row relative to its largest entry, those of zeros as they are."""
    largest = np.abs(matrix).max(axis=1, keepdims=True)
    return matrix / np.where(largest > 0.0, largest, 1.0)


def _refuse_constants(layer: list[sp.Expr], field: VectorField) -> None:
    for state, component in zip(field.states, layer):
        if component != 0 and not component.has(*field.states):
            raise SplittingError(
                f"the fast part of {state}' is {component}/{field.epsilon}, which has no equilibrium.",
                "A fast drift or rotation is averaged, by `average`, not reduced.",
            )


def _equilibrium(start: np.ndarray, compiled, p: np.ndarray) -> tuple[np.ndarray, bool]:
    z = start.copy()
    for _ in range(SEARCH_STEPS):
        value = compiled[0](z, p)
        if not np.isfinite(value).all():
            return z, False
        try:
            step = np.linalg.lstsq(_matrix(compiled[1], z, p), value, rcond=1e-10)[0]
        except np.linalg.LinAlgError:
            # Entries near the largest double.
            return z, False
        if not np.isfinite(step).all():
            return z, False
        length = np.linalg.norm(step)
        longest = 1.0 + np.linalg.norm(z)
        z = z - (step * (longest / length) if length > longest else step)
        if length < SEARCH_TOLERANCE * (1 + np.linalg.norm(z)):
            residual = np.linalg.norm(compiled[0](z, p))
            return z, bool(residual < 1e-8 and np.linalg.norm(z) < 1e6)
    return z, False


def _matrix(compiled, z: np.ndarray, p: np.ndarray) -> np.ndarray:
    values = np.nan_to_num(compiled(z, p))
    return values.reshape(-1, len(z))


def _numerical_rank(matrix: np.ndarray) -> int:
    singular_values = np.linalg.svd(matrix, compute_uv=False)
    return int((singular_values > RANK_TOLERANCE * (1 + singular_values[0])).sum())


def factorised(layer, field: VectorField, rank: int) -> tuple[sp.ImmutableMatrix, sp.ImmutableMatrix]:
    """(N, f) with L = N f; off {f = 0} exactly when N is constant or one-dimensional, else on {f = 0}."""
    states = list(field.states)
    L = sp.Matrix(layer)
    if rank == 1:
        f = common_factor(layer, states)
        if f.has(*states):
            return sp.ImmutableMatrix((L / f).applyfunc(lowest_terms)), sp.ImmutableMatrix([f])
    relations = linear_relations(layer, states)
    if relations is not None and len(relations) == len(states) - rank:
        # The last component in each is a combination of the others, which stand in no other one last.
        last = [max(i for i, c in enumerate(relation) if c != 0) for relation in relations]
        rows = [i for i in range(len(states)) if i not in last]
        constant = sp.zeros(len(states), rank)
        for j, i in enumerate(rows):
            constant[i, j] = sp.S.One
            for relation, k in zip(relations, last):
                constant[k, j] = lowest_terms(-relation[i] / relation[k])
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
                values[i] = [a - value * b for a, b in zip(values[i], values[pivot])]
                left[i] = [plus([a, times(factor, b)]) for a, b in zip(left[i], left[pivot])]
    return sp.Matrix([left[pivot][n:] for pivot in order])


def _by_cofactors(matrix: sp.Matrix) -> sp.Matrix:
    n = matrix.rows
    cofactors = sp.Matrix(n, n, lambda i, j: (-1) ** (i + j) * _determinant(matrix.minor_submatrix(j, i)))
    determinant = sp.Add(*[matrix[0, j] * cofactors[j, 0] for j in range(n)])
    return cofactors.applyfunc(lambda cofactor: cofactor / determinant)


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
    if sp.count_ops(expression) > TIDY_LIMIT:
        return expression
    # One function of one argument stays one in all components, whatever its argument's factors.
    stand_in = {function: sp.Dummy() for function in expression.atoms(sp.Function)}
    back = {dummy: function for function, dummy in stand_in.items()}
    terms = sp.factor_terms(expression.xreplace(stand_in)).xreplace(back)
    forms = (expression, factored(expression), lowest_terms(expression), terms)
    return min(forms, key=sp.count_ops)


def shown(field: VectorField, layer: Sequence[sp.Expr]) -> str:
    return ", ".join(f"{z}' = ({e})/{field.epsilon}" for z, e in zip(field.states, layer) if e != 0)
