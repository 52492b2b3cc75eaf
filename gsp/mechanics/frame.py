"""Moving frames adapted to the constraints: velocities u along the distribution D, w = A qdot + c across it."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError, HyperbolicityError
from gsp.mechanics.algebra import (
    Algebra,
    Matrix,
    common_denominator,
    entries,
    generic_points,
    numbers,
    transpose,
)
from gsp.mechanics.lagrangian import LagrangianSystem, is_singular
from gsp.mechanics.turning import turned_velocities
from gsp.mechanics.velocity_forms import VelocityForms, linear_form, rank


@dataclass(frozen=True)
class MovingFrame:
    """Quasi-velocities (`along`, `across`) = `forms` qdot + (0, `offset`).

    `forms` is (n, n): the n - k - h forms of u, then A (k, n), then those of the holonomic constraints (h, n), whose
    velocities are zero and have no name. `across` are the slip velocities w.
    """

    along: tuple[sp.Symbol, ...]
    across: tuple[sp.Symbol, ...]
    forms: sp.ImmutableMatrix
    offset: tuple[sp.Expr, ...]

    @property
    def quasi_velocities(self) -> tuple[sp.Symbol, ...]:
        """u, then w."""
        return (*self.along, *self.across)

    @property
    def constrained(self) -> sp.ImmutableMatrix:
        """A and the forms of the holonomic constraints (k + h, n)."""
        return sp.ImmutableMatrix(self.forms[len(self.along) :, :])

    @property
    def slip_forms(self) -> sp.ImmutableMatrix:
        """A (k, n)."""
        a, k = len(self.along), len(self.across)
        return sp.ImmutableMatrix(self.forms[a : a + k, :])

    def expressions(self, velocities: Sequence[sp.Symbol]) -> dict[sp.Symbol, sp.Expr]:
        """Each quasi-velocity in terms of q and qdot."""
        linear = self.forms * sp.Matrix(list(velocities))
        offsets = [sp.Integer(0)] * len(self.along) + list(self.offset)
        return {s: e + c for s, e, c in zip(self.quasi_velocities, linear, offsets)}


def moving_frames(
    system: LagrangianSystem,
    constraints: VelocityForms,
    frame: Mapping[sp.Symbol, sp.Expr] | None,
    reserved: Sequence[sp.Symbol] = (),
) -> Iterator[list[MovingFrame]]:
    """The frame that the user names, or those that are built; raises `DeclarationError` when it is none.

    In `frame` an entry equal to a constraint names that slip velocity; the others are quasi-velocities on D. Frames
    that are built are regular wherever D is, and then, in a second list, of velocities alone, which are shorter.
    """
    if frame is not None:
        yield [_moving_frame(system, constraints, reserved, frame=frame)]
        return
    axes = [sp.ImmutableMatrix(sp.eye(len(system.velocities))), *turned_velocities(system, constraints.rows)]
    for regular in (True, False):
        built = (_moving_frame(system, constraints, reserved, axes=each, regular=regular) for each in axes)
        yield list(dict.fromkeys(built))


def _moving_frame(
    system: LagrangianSystem,
    constraints: VelocityForms,
    reserved: Sequence[sp.Symbol],
    *,
    frame=None,
    **build: Any,
) -> MovingFrame:
    fixed = {s.name for s in (*system.coordinates, *system.values, *system.clock, *reserved)}
    across: list[sp.Symbol | None] = list(constraints.names)
    if frame is None:
        taken = fixed | {v.name for v in system.velocities} | {s.name for s in across if s is not None}
        along, rows = _built(system, constraints, taken, **build)
    else:
        along, rows = _quasi_velocities(system, constraints, frame, across)
    used = fixed | {s.name for s in along} | {s.name for s in across if s is not None}
    used |= {v.name for v in system.velocities}
    fresh = fresh_symbols(sum(s is None for s in across), ("w", "s", "slip"), used)
    slips = tuple(next(fresh) if s is None else s for s in across)
    for symbol in (*along, *slips):
        if symbol.name in fixed or [s.name for s in (*along, *slips)].count(symbol.name) > 1:
            raise DeclarationError(f"the quasi-velocity {symbol} has a name that is taken.", "Give it another.")
    forms = sp.ImmutableMatrix([*rows, *constraints.rows.tolist()])
    result = MovingFrame(along, slips, forms, constraints.offset)
    shown = result.expressions(system.velocities)
    for symbol in result.quasi_velocities:
        if symbol in system.velocities and shown[symbol] != symbol:
            raise DeclarationError(
                f"the quasi-velocity {symbol} = {shown[symbol]} has the name of a velocity and is not that.",
                "Rename it.",
            )
    points = generic_points(3, len(system.coordinates))
    n = len(system.velocities)
    matrices = numbers(entries(result.forms), system.coordinates, points, system.values).reshape(3, n, n)
    if all(is_singular(matrix) for matrix in matrices):
        listed = ", ".join(f"{s} = {e}" for s, e in shown.items())
        raise DeclarationError(
            f"the frame does not determine the velocities: {listed} are dependent.",
            "Choose quasi-velocities that are independent of one another and of the constraints.",
        )
    return result


def _quasi_velocities(system, constraints: VelocityForms, frame, across) -> tuple[tuple[sp.Symbol, ...], list]:
    if not isinstance(frame, Mapping):
        raise DeclarationError("frame maps symbols to velocities.", got=type(frame).__name__)
    along, rows = [], []
    for symbol, expression in frame.items():
        if not isinstance(symbol, sp.Symbol):
            raise DeclarationError("frame is keyed by SymPy symbols.", got=f"the key {symbol!r}", value=symbol)
        coefficients, offset = linear_form(system, expression, f"the quasi-velocity {symbol}")
        for i in range(constraints.count):
            pairs = zip([*coefficients, offset], [*constraints.matrix.row(i), constraints.offset[i]])
            if across[i] in (None, symbol) and all(sp.expand(a - b) == 0 for a, b in pairs):
                across[i] = symbol
                break
        else:
            if offset != 0:
                raise DeclarationError(
                    f"the quasi-velocity {symbol} = {expression} is not linear in the velocities: "
                    f"it contains {offset}."
                )
            along.append(symbol)
            rows.append(coefficients)
    dimension = len(system.velocities) - constraints.rows.rows
    if len(along) != dimension:
        raise DeclarationError(
            f"the frame names {len(along)} quasi-velocities along the constraints.",
            got=(
                f"{', '.join(map(str, along)) or 'none'}; {len(system.velocities)} velocities with "
                f"{constraints.rows.rows} constraints need {dimension}"
            ),
        )
    return tuple(along), rows


def _built(
    system, constraints: VelocityForms, taken: set[str], axes: sp.ImmutableMatrix, regular: bool
) -> tuple[tuple[sp.Symbol, ...], list]:
    """A frame of D: velocities along `axes` where constant pivots leave them free, combinations elsewhere."""
    algebra = Algebra(system.coordinates, tuple(system.values), [*entries(constraints.rows), *entries(axes)])
    n, directions = len(system.velocities), algebra.matrix(axes)
    turned = algebra.multiply(algebra.matrix(constraints.rows), transpose(directions))
    rows, solved = _constant_pivots(algebra, turned)
    support = [j for j in range(n) if j not in solved and any(not row[j].is_zero for row in rows)]
    forms = {j: directions[j] for j in range(n) if j not in solved and j not in support}
    if rows:
        block = [[row[j] for j in support] for row in rows]
        places = generic_points(3, len(system.coordinates))
        # Velocities alone are dependent somewhere: not where all bodies are aligned, if some are not.
        pivots = _pivots(system, algebra, block, places if regular else np.vstack([0 * places[:1], places]))
        free = [i for i in range(len(support)) if i not in pivots]
        combinations = [
            [algebra.ring.one if i == j else algebra.ring.zero for j in range(len(support))] for i in free
        ]
        if regular:
            null = _null_space(algebra, block, pivots)
            # U = (N^T N)^-1 N^T is a left inverse of the null vectors N, so that S restricted to them is N.
            gram = algebra.multiply(null, transpose(null))
            combinations = algebra.multiply(algebra.inverse(gram), null)
        found = algebra.multiply(combinations, [directions[j] for j in support])
        forms |= {support[i]: form for i, form in zip(free, found)}
    written = [[algebra.write(e) for e in form] for _, form in sorted(forms.items())]
    plain = {tuple(row): v for row, v in zip(sp.eye(n).tolist(), system.velocities)}
    names = [plain.get(tuple(form)) for form in written]
    fresh = fresh_symbols(names.count(None), ("u", "nu", "along"), taken, always=True)
    return tuple(next(fresh) if name is None else name for name in names), written


def _constant_pivots(algebra: Algebra, matrix: Matrix) -> tuple[Matrix, set[int]]:
    """Rows left, and columns solved for, after eliminating with every pivot that no position enters."""
    rows, solved = [list(row) for row in matrix], set()
    while True:
        found = next(
            (
                (i, j)
                for numeric in (True, False)
                for i, row in enumerate(rows)
                for j, e in enumerate(row)
                if not e.is_zero and algebra.is_constant(e) and (algebra.write(e).is_number or not numeric)
            ),
            None,
        )
        if found is None:
            return rows, solved
        i, j = found
        pivot_row = rows.pop(i)
        scale = pivot_row[j].inverse()
        rows = [[(a - row[j] * scale * b).reduced() for a, b in zip(row, pivot_row)] for row in rows]
        solved.add(j)


def _pivots(system, algebra: Algebra, block: Matrix, places: np.ndarray) -> tuple[int, ...]:
    """Columns of `block` that tell the others, with few operations, at the first of `places` that has some."""
    k, columns = len(block), range(len(block[0]))
    expressions = [[algebra.write(e) for e in row] for row in block]
    flat = list(itertools.chain(*expressions))
    values = numbers(flat, system.coordinates, places, system.values).reshape(len(places), k, -1)
    finite = values[np.isfinite(values).all(axis=(1, 2))]
    bases = ([c for c in itertools.combinations(columns, k) if rank(each[:, list(c)]) == k] for each in finite)
    return max(
        next(filter(None, bases)), key=lambda c: -sum(sp.count_ops(row[j]) for row in expressions for j in c)
    )


def _null_space(algebra: Algebra, block: Matrix, pivots: Sequence[int]) -> Matrix:
    """Vectors that `block` annihilates, without denominators, each with its first entry not negated."""
    columns = len(block[0])
    square = [[row[j] for j in pivots] for row in block]
    inverse = algebra.inverse(square)
    vectors = []
    for free in [j for j in range(columns) if j not in pivots]:
        tops = algebra.apply(inverse, [row[free] for row in block])
        vector: list[sp.Expr] = [sp.Integer(0)] * columns
        vector[free] = sp.Integer(1)
        for j, top in zip(pivots, tops):
            vector[j] = algebra.write(-top)
        denominator = common_denominator(vector)
        cleared = [algebra.read(sp.cancel(e * denominator)) for e in vector]
        leading = next(algebra.write(e) for e in cleared if not e.is_zero)
        vectors.append([-e for e in cleared] if leading.could_extract_minus_sign() else cleared)
    return vectors


def fresh_symbols(
    count: int, stems: Sequence[str], taken: set[str], *, always: bool = False
) -> Iterator[sp.Symbol]:
    """Symbols of the first stem that is free: the stem itself for a single one, else numbered from 1."""
    for stem in itertools.chain(stems, (f"{stems[-1]}{i}_" for i in itertools.count())):
        names = [f"{stem}{i + 1}" for i in range(count)] if always or count > 1 else [stem]
        if not taken & set(names):
            return iter([sp.Symbol(name) for name in names])
    raise AssertionError("the stems never end")


def inverse_forms(algebra: Algebra, frame: MovingFrame) -> Matrix:
    """Psi = (S, T) with qdot = S u + T (w - c); raises `DeclarationError` when the forms are dependent."""
    try:
        whole = algebra.inverse(algebra.matrix(frame.forms))
    except HyperbolicityError:
        raise DeclarationError(f"the forms {frame.forms.tolist()} of the frame are dependent.") from None
    return [row[: len(frame.quasi_velocities)] for row in whole]
