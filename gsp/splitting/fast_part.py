"""The layer problem of a field with a simple pole: F = L/epsilon + G with L = N f, and the rank of its equilibria."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Sequence

import numpy as np
import sympy as sp
from sympy.polys.domains import EXRAW
from sympy.polys.matrices import DomainMatrix

from gsp.algebra.differentiation import derivative
from gsp.algebra.elimination_over_rationals import at_point, connected_parts, generic_point, independent_columns
from gsp.algebra.factorisation import factored, lowest_terms
from gsp.algebra.first_integrals import common_factor
from gsp.algebra.laurent import laurent, pole_order
from gsp.algebra.substitution import substituted
from gsp.errors import SplittingError
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
# More principal minors are not added up.
PRINCIPAL_MINORS = 1000
# Expressions with more operations are not rewritten for looks.
TIDY_LIMIT = 120
RATIONAL_LIMIT = 5000
# Determinants are expanded by rows up to this size; the number of terms grows like the factorial.
LAPLACE = 4


def principal_part(field: VectorField) -> tuple[list[sp.Expr], list[sp.Expr]]:
    """(L, G) with F = L/epsilon + G, term by term so that nothing is expanded needlessly."""
    epsilon = field.epsilon
    assert epsilon is not None
    layer, drift = [], []
    for rate in field.rates:
        pole, regular = [], []
        # Expansion in epsilon only: products of sums that contain it are multiplied out, the rest is kept.
        for term in sp.Add.make_args(sp.collect(sp.expand_mul(rate), epsilon, evaluate=True)):
            for part in sp.Add.make_args(sp.expand_mul(term)):
                if not pole_order(part, epsilon):
                    regular.append(part)
                    continue
                residue = laurent(part, epsilon, order=-1)[-1]
                pole.append(residue)
                if (part - residue / epsilon).expand() != 0:
                    regular.append(lowest_terms(part - residue / epsilon))
        total = sp.Add(*pole)
        layer.append(tidy(total))
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
    compiled = [compile_over(field, tuple(outputs), arguments=states) for outputs in (layer, matrix)]
    p = compile_flow(field).constants
    random = np.random.default_rng(0)
    z = random.standard_normal((SEARCH_STARTS, len(states)))
    z[: SEARCH_STARTS // 2] = np.abs(z[: SEARCH_STARTS // 2])
    found: list[tuple[int, int]] = []
    matrices: list[np.ndarray] = []
    for start in z:
        point, converged = _equilibrium(start, compiled, p)
        if converged:
            matrices.append(_matrix(compiled[1], point, p))
            found += _ranks(matrices[-1])
    for _ in range(0 if found else UNITS):
        # Amounts may be of any size: molecules in a cubic centimetre, moles in a litre.
        units = 10.0 ** random.uniform(*DECADES, len(states))
        found = _ranks_in_units(z[:: SEARCH_STARTS // STARTS_IN_UNITS], units, compiled, p)
        if found:
            break
    if not found:
        raise SplittingError(
            f"no real equilibrium of the fast part {shown(field, layer)} was found, and without one there is no "
            "critical manifold.",
            "A fast rotation or drift is averaged, not reduced; or check the parameters' values.",
        )
    if max(rank for rank, _ in found) == 0:
        raise SplittingError(
            f"the fast part {shown(field, layer)} vanishes to second order on its zeros, so no direction is "
            "hyperbolic there.",
            "Rescale the fast variables.",
        )
    # Isolated equilibria have full rank and say nothing about the manifold next to them.
    on_manifolds = [rank for rank, _ in found if 0 < rank < len(states)]
    if not on_manifolds:
        return len(states)
    rank = max(on_manifolds, key=on_manifolds.count)
    # Rates of a million beside rates of one: in the square the latter are rounding.
    if (rank, rank) not in found and not any(_has_as_many_eigenvalues(matrix, rank) for matrix in matrices):
        raise SplittingError(
            f"the fast part {shown(field, layer)} is tangent to its own zeros (its linear part is nilpotent "
            "there), so no direction is normally hyperbolic.",
            "Rescale the fast variables, or average.",
        )
    return rank


def _ranks_in_units(starts: np.ndarray, units: np.ndarray, compiled, p: np.ndarray) -> list[tuple[int, int]]:
    """Ranks of DL and of its square at the zeros found from `starts` (m, n), the states in `units` (n,).

    What is a zero, and what is a rank, is judged relative to the terms, each state in units of its value.
    """

    def values(z: np.ndarray, p: np.ndarray) -> np.ndarray:
        return compiled[0](z * units, p) / units

    def matrix(z: np.ndarray, p: np.ndarray) -> np.ndarray:
        return (_matrix(compiled[1], z * units, p) * units / units[:, None]).ravel()

    found: list[tuple[int, int]] = []
    for start in starts:
        z, converged = _equilibrium(start, (values, matrix), p)
        there = _matrix(matrix, z, p)
        sizes = np.abs(there) @ np.abs(z)
        if not converged or (np.abs(values(z, p)) > SEARCH_TOLERANCE * sizes).any():
            continue
        own = np.where(z == 0.0, 1.0, np.abs(z))
        found += _ranks(there * own / own[:, None], _by_rows)
    return found


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
    if math.comb(n, rank) > PRINCIPAL_MINORS or _numerical_rank(_by_rows(matrix)) != rank:
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
                "A fast drift or rotation is averaged, not reduced.",
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
    DL = jacobian(L, states)
    places = _block(DL, rank, generic_point((*states, *field.parameters)))
    if places is None:
        raise SplittingError(f"the fast part {shown(field, layer)} has no {rank} independent components.")
    rows, columns = places
    # DL = N Df on {f = 0}, so N follows from any invertible block.
    N = DL.extract(list(range(len(states))), columns) * inverse(DL.extract(rows, columns))
    return sp.ImmutableMatrix(N.applyfunc(reduced)), sp.ImmutableMatrix([layer[i] for i in rows])


def _block(
    matrix: sp.Matrix, rank: int, point: dict[sp.Symbol, sp.Rational]
) -> tuple[list[int], list[int]] | None:
    """The first rows and columns (`rank` each) that make an invertible block; None where there are none."""
    values = at_point(matrix, point)
    if values is not None:
        rows = independent_columns(values.transpose(), range(matrix.rows))[:rank]
        chosen = at_point(matrix.extract(rows, list(range(matrix.cols))), point) if len(rows) == rank else None
        return None if chosen is None else (rows, independent_columns(chosen, range(matrix.cols)))
    for rows in itertools.combinations(range(matrix.rows), rank):
        for columns in itertools.combinations(range(matrix.cols), rank):
            block = matrix.extract(list(rows), list(columns))
            if block.applyfunc(lambda e: substituted(e, point)).det() != 0:
                return list(rows), list(columns)
    return None


def inverse(matrix: sp.Matrix) -> sp.Matrix:
    """The inverse by cofactors of the parts that stand apart: nothing is simplified, which can take minutes."""
    found = sp.zeros(matrix.rows, matrix.cols)
    for rows, columns in connected_parts(matrix.todok(), *matrix.shape):
        cofactors, determinant = _cofactors(matrix.extract(rows, columns))
        for (i, j), cofactor in cofactors.todok().items():
            found[columns[i], rows[j]] = cofactor / determinant
    return found


def _cofactors(matrix: sp.Matrix) -> tuple[sp.Matrix, sp.Expr]:
    n = matrix.rows
    cofactors = sp.Matrix(n, n, lambda i, j: (-1) ** (i + j) * _determinant(matrix.minor_submatrix(j, i)))
    return cofactors, sp.Add(*[matrix[0, j] * cofactors[j, 0] for j in range(n)])


def _determinant(matrix: sp.Matrix) -> sp.Expr:
    if matrix.rows == 0:
        return sp.Integer(1)
    if matrix.rows > LAPLACE:
        return matrix.det(method="berkowitz")
    terms = [
        (-1) ** j * matrix[0, j] * _determinant(matrix.minor_submatrix(0, j))
        for j in range(matrix.cols)
        if matrix[0, j] != 0
    ]
    return sp.Add(*terms)


def reduced(expression: sp.Expr) -> sp.Expr:
    """`expression` in lowest terms, unless it is long: `cancel` takes minutes on nested sines and roots."""
    limit = RATIONAL_LIMIT if expression.is_rational_function() else TIDY_LIMIT
    return expression if sp.count_ops(expression) > limit else lowest_terms(expression)


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
    forms = (expression, factored(expression), lowest_terms(expression), sp.factor_terms(expression))
    return min(forms, key=sp.count_ops)


def shown(field: VectorField, layer: Sequence[sp.Expr]) -> str:
    return ", ".join(f"{z}' = ({e})/{field.epsilon}" for z, e in zip(field.states, layer) if e != 0)
