"""The fast Jacobian J = g_y of many coupled variables by sparse factors: its determinant, and how it changes.

As `FastBlocks` does, but by numbers: code written for the factors of two hundred variables takes minutes to compile, so
that kernels decompose J in a fixed order of elimination instead. With the pivots p_k of J + s 1,
log det (J + s 1) = sum_k log p_k, so that tr J^-1 is its derivative by s at 0, and rates along the flow are those of
its infinitesimal parts. The determinant is taken by the sizes of the rows, D = prod_k p_k/|J_k|, which keeps it within
doubles; it has the zeros of det J. A fixed order has no value where a pivot vanishes by chance.

Imaginary pairs are not watched: their test is a determinant of order n (n - 1)/2. `passed_pairs` looks at what was run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp

from gsp.algebra.sharing import plus, size, times
from gsp.lowering.steps.kernel_call import Call
from gsp.lowering.steps.sparse_pattern import write_pattern
from gsp.lowering.steps.straight_line import eliminate

Matrix = list[list[sp.Expr]]


class SparseFastPart:
    """D, J^-1 and what else is made of g_y, g_x and the slow rates f in the `states` (x, y).

    `second` maps (i, j) to the derivatives of J_ij by the numbers of the states, those that are not 0. Expressions hold
    symbols whose values the `calls` find.
    """

    watches_pairs = False
    leaves_pairs = True
    hurwitz = sp.S.One

    def __init__(
        self,
        g_y: Matrix,
        g_x: Matrix,
        f: Sequence[sp.Expr],
        second: Mapping[tuple[int, int], Mapping[int, sp.Expr]],
        states: Sequence[sp.Symbol],
    ) -> None:
        n = len(g_y)
        places = [(i, j) for i, row in enumerate(g_y) for j, e in enumerate(row) if e is not sp.S.Zero]
        pattern = write_pattern(places, eliminate(n, places))
        self._pattern = (n, len(pattern), *pattern.tolist())
        self._entries = tuple(g_y[i][j] for i, j in places)
        self._g_x = g_x
        following = self._following("followed", [plus([times(a, b) for a, b in zip(row, f)]) for row in g_x])
        # The flow of order 0.
        self._rates = [*f, *following.results]

        def moved(by: Sequence[sp.Expr]) -> list[sp.Expr]:
            return [
                plus([times(slope, by[k]) for k, slope in second.get(at, {}).items()])
                if at in second
                else sp.S.Zero
                for at in places
            ]

        self._D, self._along, self._drift, self._moved = results = sp.symbols(
            "D along drift moved", cls=sp.Dummy
        )
        given = (*self._entries, *moved(self._rates), *moved(states))
        self.calls = following, Call("change", self._pattern, given, results)

    def _following(self, name: str, forced: Sequence[sp.Expr]) -> Call:
        """-J^-1 times what is forced."""
        results = tuple(sp.Dummy(f"{name}{i}") for i in range(len(forced)))
        return Call("follow", self._pattern, (*self._entries, *forced), results)

    @property
    def determinant(self) -> sp.Expr:
        """D."""
        return self._D

    @property
    def scaled(self) -> list[sp.Expr]:
        """D z' along the flow of order 0."""
        return [times(self._D, rate) for rate in self._rates]

    def determinant_rate(self) -> sp.Expr:
        """dD/ds in the time with dt = D ds."""
        return times(self._D, self._along)

    def inverse_trace(self, *, relative: bool) -> tuple[sp.Expr, sp.Expr]:
        """What |d/dt tr J^-1| is measured by, and how often it holds that: D^3 would underflow."""
        del relative
        return sp.S.One, size(self._drift)

    def rounding(self, lengths: Sequence[sp.Expr]) -> sp.Expr:
        """What a relative change of all of z makes of D, and D itself: its entries are rounded too."""
        del lengths
        return plus([size(self._moved), size(self._D)])

    def pair_size(self) -> sp.Expr:
        """No pair is watched."""
        return sp.S.One

    def pulled(self) -> tuple[list[sp.Expr], tuple[Call, ...]]:
        """-D J^-1 g_x, column by column, and the calls for that."""
        columns = [
            self._following(f"pulled{j}_", [row[j] for row in self._g_x]) for j in range(len(self._g_x[0]))
        ]
        expressions = [times(self._D, result) for call in columns for result in call.results]
        return expressions, (*self.calls, *columns)
