"""The rank of a layer problem on its critical manifold: the equilibria of the layer, and DL there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.algebra.centres import centres
from gsp.algebra.elimination_over_rationals import at_point, connected_parts
from gsp.errors import DegenerateError, SplittingError
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.splitting.fast_part import jacobian, shown
from gsp.systems.region import balancing_units
from gsp.systems.system import VectorField

# Random starts and tolerances in the search for equilibria of the layer problem.
SEARCH_STARTS = 64
SEARCH_TOLERANCE = 1e-10
RANK_TOLERANCE = 1e-7


@dataclass(frozen=True, eq=False)
class Blocks:
    """Places of the entries of DL that are not zero everywhere, and the parts of the states that they join.

    A linear step and a rank are those of the parts: of 200 states in pairs they take no more than 100 pairs do.

    >>> blocks = Blocks.of([(0, 2), (2, 0), (1, 1)], 3)
    >>> [block.tolist() for block in blocks.matrices(np.array([5.0, 6.0, 7.0]))]
    [[[[0.0, 5.0], [6.0, 0.0]]], [[[7.0]]]]
    """

    rows: np.ndarray
    columns: np.ndarray
    # Of each size k: the states (m, k) of the parts, and which entries are where in the matrices (m, k, k).
    parts: tuple[tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]], ...]

    @classmethod
    def of(cls, entries: Sequence[tuple[int, int]], states: int) -> Blocks:
        """The blocks of a square matrix with these `entries`."""
        # A state and its rate go together.
        together = [*entries, *((i, i) for i in range(states))]
        by_size: dict[int, list[list[int]]] = {}
        for part, _ in connected_parts(together, states, states):
            by_size.setdefault(len(part), []).append(part)
        rows, columns = np.array(entries, dtype=int).reshape(-1, 2).T
        parts = []
        for chosen in by_size.values():
            block, place = np.full((2, states), -1)
            for m, part in enumerate(chosen):
                block[part], place[part] = m, range(len(part))
            own = np.flatnonzero(block[rows] >= 0)
            parts.append((np.array(chosen), own, (block[rows[own]], place[rows[own]], place[columns[own]])))
        return cls(rows, columns, tuple(sorted(parts, key=lambda part: -part[0].shape[1])))

    def matrices(self, values: np.ndarray) -> list[np.ndarray]:
        """The blocks (m, k, k) of each size k of the matrix with the entries `values` (e,)."""
        found = []
        for states, own, places in self.parts:
            count, size = states.shape
            found.append(np.zeros((count, size, size)))
            found[-1][places] = values[own]
        return found

    def step(self, values: np.ndarray, right: np.ndarray, *, damping: float = 0.0) -> np.ndarray:
        """The shortest of the best solutions (n,) of the matrix with the entries `values` for the `right` side (n,).

        With `damping` each singular value s is s + damping/s, as in the steps of Levenberg and Marquardt.
        """
        found = np.empty(len(right))
        for (states, *_), blocks in zip(self.parts, self.matrices(values)):
            if len(blocks) == 1 and not damping:
                found[states[0]] = np.linalg.lstsq(blocks[0], right[states[0]], rcond=1e-10)[0]
                continue
            left, sizes, across = np.linalg.svd(blocks)
            told = sizes > 1e-10 * sizes[:, :1]
            along = np.einsum("mji,mj->mi", left, right[states])
            sizes = np.divide(damping, sizes, out=np.full(sizes.shape, np.inf), where=told) + sizes
            along = along / sizes
            found[states] = np.einsum("mji,mj->mi", across, along)
        return found


def layer_rank(layer: list[sp.Expr], field: VectorField) -> int:
    """Rank of DL on the critical manifold: the one met most often on zeros of L that Gauss-Newton finds.

    The parameters have their values; the number of states when every zero found is isolated.
    """
    if all(component == 0 for component in layer):
        raise SplittingError(f"no rate has a pole in {field.epsilon}.", got=shown(field, layer))
    _refuse_constants(layer, field)
    states = field.states
    written = shown(field, layer)
    values = dict(field.parameters)
    there = {s: s + c for s, c in centres(tuple(e.xreplace(values) for e in layer), states).items()}
    layer = [component.xreplace(there) for component in layer]
    matrix = jacobian(layer, states)
    constant = at_point(matrix, dict(field.parameters)) if matrix.free_symbols.isdisjoint(states) else None
    origin = dict.fromkeys(states, sp.S.Zero)
    if constant is not None and all(component.xreplace(origin) == 0 for component in layer):
        # Of whole numbers: a thousand states take a hundredth of a second, and 13 with fractions.
        whole, _ = constant.numer_denom()
        if (whole * whole).rank() == whole.rank():
            return whole.rank()
    slopes = matrix.todok()
    blocks = Blocks.of(list(slopes), len(states))
    outputs = (layer, slopes.values())
    plain = [compile_over(field, tuple(entries), arguments=states) for entries in outputs]
    p = compile_flow(field).constants
    random = np.random.default_rng(0)
    z = random.standard_normal((SEARCH_STARTS, len(states)))
    z[: SEARCH_STARTS // 2] = np.abs(z[: SEARCH_STARTS // 2])
    functions = _in_units(plain, _balanced(plain[1](z, p), blocks), blocks)
    # In a unit of time in which DL is not small at the starts: what vanishes is told from what is slow.
    sizes = np.linalg.norm(functions[1](z, p), axis=1)
    usual = sizes[np.isfinite(sizes) & (sizes > 0.0)]
    speed = min(float(np.median(usual)), 1.0) if usual.size else 1.0
    compiled = [lambda z, p, of=of: of(z, p) / speed for of in functions]

    def at_starts(*, damped: bool) -> tuple[list[list[np.ndarray]], list[tuple[int, int]]]:
        """The blocks of DL at the zeros found from the starts, and the ranks there."""
        zeros = [_equilibrium(start, compiled, p, blocks, damped=damped) for start in z]
        there = [blocks.matrices(np.nan_to_num(compiled[1](point, p))) for point, good in zeros if good]
        return there, [ranks for matrix in there for ranks in _ranks(matrix)]

    matrices, found = at_starts(damped=False)
    if found and max(rank for rank, _ in found) == 0:
        # Newton's steps for a field homogeneous in the states, (x - y)*(a*x, b*y), all lead to where it vanishes.
        damped = at_starts(damped=True)
        matrices, found = damped if damped[1] else (matrices, found)

    def in_units() -> Iterator[list[list[np.ndarray]]]:
        """The blocks of DL at the zeros that are found, the states in units that are drawn, and in these units."""
        # Amounts may be of any size: molecules in a cubic centimetre, moles in a litre. Each set of units has eight
        # starts.
        for _ in range(32):
            units = 10.0 ** random.uniform(-12.0, 16.0, len(states))
            yield list(_matrices_in_units(z[:: SEARCH_STARTS // 8], units, compiled, p, blocks))

    for there in in_units() if not found else ():
        found = [ranks for matrix in there for ranks in _ranks(matrix, _by_rows)]
        if found:
            break
    if not found:
        raise SplittingError(
            f"no real equilibrium of the fast part {written} was found, and without one there is no "
            "critical manifold.",
            "A fast rotation or drift is averaged, by `average`, not reduced; or check the parameters' values.",
        )
    if max(rank for rank, _ in found) == 0:
        raise DegenerateError(
            f"the fast part {written} vanishes to second order on its zeros, so no direction is "
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
            f"the fast part {written} is tangent to its own zeros (its linear part is nilpotent "
            "there), so no direction is normally hyperbolic.",
            "Rescale the fast variables (gsp.scalings(field) looks for powers of the small parameter), or average.",
        )
    return rank


def _balanced(entries: np.ndarray, blocks: Blocks) -> np.ndarray:
    """The units (n,), powers of two, in which the usual one of the matrices with these `entries` (m, e) is balanced."""
    units = np.ones(sum(states.size for states, *_ in blocks.parts))
    finite = entries[np.isfinite(entries).all(axis=1)]
    if not finite.size:
        return units
    usual = np.median(np.abs(finite), axis=0)
    for (states, *_), matrices in zip(blocks.parts, blocks.matrices(usual)):
        for own, matrix in zip(states, matrices):
            units[own] = balancing_units(matrix)
    return units


def _in_units(compiled: Sequence[Callable], units: np.ndarray, blocks: Blocks) -> list[Callable]:
    """L and the entries of DL of states in `units` (n,), by those of the states themselves."""
    of, derivatives = compiled
    ratios = units[blocks.columns] / units[blocks.rows]
    return [lambda z, p: of(z * units, p) / units, lambda z, p: derivatives(z * units, p) * ratios]


def _matrices_in_units(
    starts: np.ndarray, units: np.ndarray, compiled, p: np.ndarray, blocks: Blocks
) -> Iterator[list[np.ndarray]]:
    """The blocks of DL at zeros found from `starts` (m, n), the states in `units` (n,), then in units of its value.

    What is a zero is judged relative to the terms.
    """
    values, entries = _in_units(compiled, units, blocks)
    rows, columns = blocks.rows, blocks.columns
    for start in starts:
        z, converged = _equilibrium(start, (values, entries), p, blocks)
        there = np.nan_to_num(entries(z, p))
        sizes = np.bincount(rows, np.abs(there * z[columns]), minlength=len(z))
        if not converged or (np.abs(values(z, p)) > SEARCH_TOLERANCE * sizes).any():
            continue
        own = np.where(z == 0.0, 1.0, np.abs(z))
        yield blocks.matrices(there * own[columns] / own[rows])


def _ranks(
    blocks: Sequence[np.ndarray], scaled: Callable[[np.ndarray], np.ndarray] = np.asarray
) -> list[tuple[int, int]]:
    """The ranks of a matrix of `blocks` and of its square, each `scaled`; none where the square is beyond doubles."""
    squares = [block @ block for block in blocks]
    if not all(np.isfinite(square).all() for square in squares):
        return []
    of, of_square = (sum(int(_numerical_ranks(scaled(b)).sum()) for b in each) for each in (blocks, squares))
    return [(of, of_square)]


def _has_as_many_eigenvalues(blocks: Sequence[np.ndarray], rank: int) -> bool:
    """Whether a matrix of this rank has as many eigenvalues off zero: each block as many as its own rank."""
    ranks = [_numerical_ranks(_by_rows(each)) for each in blocks]
    return sum(int(own.sum()) for own in ranks) == rank and all(
        _has_this_many_eigenvalues(block, int(own))
        for each, of_each in zip(blocks, ranks)
        for block, own in zip(each, of_each)
    )


def _has_this_many_eigenvalues(matrix: np.ndarray, rank: int) -> bool:
    """Whether the sum of the principal minors of the size `rank` is not zero.

    It is judged by the terms of the minors, and is the same in all units of the states.
    """
    n = len(matrix)
    if not rank:
        return True
    # More principal minors are not added up.
    if math.comb(n, rank) > 1000:
        return False
    chosen = [matrix[np.ix_(rows, rows)] for rows in itertools.combinations(range(n), rank)]
    terms = sum(float(np.prod(np.abs(minor).sum(axis=1))) for minor in chosen)
    return abs(sum(float(np.linalg.det(minor)) for minor in chosen)) > RANK_TOLERANCE * terms


def _by_rows(matrices: np.ndarray) -> np.ndarray:
    """Each row relative to its largest entry, those of zeros as they are."""
    largest = np.abs(matrices).max(axis=-1, keepdims=True)
    return matrices / np.where(largest > 0.0, largest, 1.0)


def _refuse_constants(layer: list[sp.Expr], field: VectorField) -> None:
    states = frozenset(field.states)
    for state, component in zip(field.states, layer):
        if component != 0 and states.isdisjoint(component.free_symbols):
            raise SplittingError(
                f"the fast part of {state}' is {component}/{field.epsilon}, which has no equilibrium.",
                "A fast drift or rotation is averaged, by `average`, not reduced.",
            )


def _equilibrium(
    start: np.ndarray, compiled, p: np.ndarray, blocks: Blocks, *, damped: bool = False
) -> tuple[np.ndarray, bool]:
    z = start.copy()
    for _ in range(60):
        value = compiled[0](z, p)
        if not np.isfinite(value).all():
            return z, False
        try:
            damping = float(np.linalg.norm(value)) if damped else 0.0
            step = blocks.step(np.nan_to_num(compiled[1](z, p)), value, damping=damping)
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


def _numerical_ranks(matrices: np.ndarray) -> np.ndarray:
    """The rank of each of the `matrices` (m, k, k)."""
    singular_values = np.linalg.svd(matrices, compute_uv=False)
    return (singular_values > RANK_TOLERANCE * (1 + singular_values[:, :1])).sum(axis=1)
