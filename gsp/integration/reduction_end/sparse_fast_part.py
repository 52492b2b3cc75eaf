"""The fast Jacobian J = g_y of many coupled variables by sparse factors: its determinant, and how it changes.

As `FastBlocks` does, but by straight-line programs: with the pivots p_k of J + s 1 in a fixed order of elimination,
log det (J + s 1) = sum_k log p_k, so that tr J^-1 is its derivative by s at 0, and rates along the flow are those of
the program. The determinant is taken by the sizes of the rows, D = prod_k p_k/|J_k|, which keeps it within doubles; it
has the zeros of det J. A fixed order has no value where a pivot vanishes by chance.

Imaginary pairs are not watched: their test is a determinant of order n (n - 1)/2. `passed_pairs` looks at what was run.
"""

from __future__ import annotations

from collections.abc import Sequence

import sympy as sp

from gsp.algebra.circuits import CircuitRing, Factors, Gate, derived
from gsp.algebra.ring import read
from gsp.algebra.sharing import size
from gsp.lowering.steps.straight_line import eliminate

Matrix = list[list[sp.Expr]]


class SparseFastPart:
    """D, J^-1 and what else is made of g_y, g_x and the slow rates f in the `states` (x, y)."""

    watches_pairs = False
    leaves_pairs = True
    hurwitz = sp.S.One

    def __init__(self, g_y: Matrix, g_x: Matrix, f: Sequence[sp.Expr], states: Sequence[sp.Symbol]) -> None:
        n, self._count = len(g_y), len(f)
        expressions = [e for matrix in (g_y, g_x) for row in matrix for e in row] + list(f)
        others = {s for e in expressions for s in e.free_symbols} - set(states)
        shift = sp.Dummy("shift")
        ring = CircuitRing((*states, *sorted(others, key=str), shift))
        self._ring, self._states = ring, tuple(states)
        cache: dict = {}
        entries = {
            (i, j): read(e, ring, {}, cache) for i, row in enumerate(g_y) for j, e in enumerate(row) if e != 0
        }
        squares = [[e * e for (k, _), e in entries.items() if k == i] for i in range(n)]
        unit = ring.generator(shift)
        shifted = {**entries, **{(i, i): entries.get((i, i), ring.zero) + unit for i in range(n)}}
        # Whatever is written is taken at s = 0.
        self._written_already: dict = {unit.index: sp.S.Zero}
        order = eliminate(n, shifted)
        self._factors = Factors(ring, shifted, order.order, order.rows, order.columns)
        half = ring.constant(sp.Rational(-1, 2))
        D = ring.one
        for k, pivot in zip(order.order, self._factors.pivots):
            norm = ring.zero
            for square in squares[k]:
                norm = norm + square
            D = D * pivot * norm.apply("pow", half)
        self._D = D
        self._f = [read(e, ring, {}, cache) for e in f]
        self._columns = [[read(row[j], ring, {}, cache) for row in g_x] for j in range(self._count)]
        # The flow of order 0.
        self._rates = [*self._f, *self._followed(self._f)]
        images = dict(zip((ring.generator(s).index for s in states), self._rates))
        along_shift = {unit.index: ring.one}
        pivots = self._factors.pivots
        trace = ring.zero
        for pivot, slope in zip(pivots, derived(ring, pivots, along_shift, {})):
            trace = trace + slope * pivot.inverse()
        slopes: dict[int, Gate] = {}
        self._drift, self._determinant_drift = derived(ring, [trace, D], images, slopes)
        self._moved = derived(ring, [D], {ring.generator(s).index: ring.generator(s) for s in states}, {})[0]

    def _followed(self, slow: Sequence[Gate]) -> list[Gate]:
        """-J^-1 g_x x' for x' = `slow`."""
        forced = [self._ring.zero] * len(self._columns[0])
        for rate, column in zip(slow, self._columns):
            forced = [total + entry * rate for total, entry in zip(forced, column)]
        return [-value for value in self._factors.solve(forced)]

    def _written(self, *gates: Gate) -> list[sp.Expr]:
        return self._ring.written(gates, self._written_already)

    @property
    def determinant(self) -> sp.Expr:
        """D."""
        return self._written(self._D)[0]

    @property
    def scaled(self) -> list[sp.Expr]:
        """D z' along the flow of order 0."""
        return self._written(*(self._D * rate for rate in self._rates))

    def determinant_rate(self) -> sp.Expr:
        """dD/ds in the time with dt = D ds."""
        return self._written(self._D * self._determinant_drift)[0]

    def inverse_trace_rate(self) -> sp.Expr:
        """D^3 d/dt tr J^-1."""
        return self._written(self._D * self._D * self._D * self._drift)[0]

    def rounding(self, states: Sequence[sp.Symbol]) -> sp.Expr:
        """What a relative change of all of z makes of D, and D itself: its entries are rounded too."""
        del states
        moved, D = self._written(self._moved, self._D)
        return size(moved) + size(D)

    def pair_size(self) -> sp.Expr:
        """No pair is watched."""
        return sp.S.One

    def pulled(self) -> list[sp.Expr]:
        """-D J^-1 g_x, column by column."""
        one, zero = self._ring.one, self._ring.zero
        units = [[one if i == j else zero for i in range(self._count)] for j in range(self._count)]
        return [e for unit in units for e in self._written(*(self._D * v for v in self._followed(unit)))]
