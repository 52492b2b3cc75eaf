"""The fast Jacobian J = g_y by blocks: its determinant, what it does to vectors, and how these change along the flow.

Fast variables that drive one another in turn form a block; J is block triangular when the blocks are put in the order
in which they drive one another. A chain of a hundred variables has blocks of size 1. With the blocks' determinants d_b
and adjugates A_b the determinant is D = prod_b d_b, and all else is regular where one of them is 0. What is constant is
left out of D, which counts for its zeros and their order only.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp

from gsp.algebra.sharing import plus, size, times
from gsp.algebra.triangular_blocks import triangular_blocks
from gsp.lowering.steps.kernel_call import Call

Matrix = list[list[sp.Expr]]


class FastBlocks:
    """D, adj J and what else is made of g_y, g_x, the slow rates f and the derivatives of g_y.

    `second` maps (i, j) to the derivatives of J_ij by the numbers of z = (x, y), those that are not 0. The expressions
    share their parts and are never expanded or searched: code is written once for each part.
    """

    leaves_pairs = False
    calls = ()

    def __init__(
        self,
        g_y: Matrix,
        g_x: Matrix,
        f: Sequence[sp.Expr],
        second: Mapping[tuple[int, int], Mapping[int, sp.Expr]],
    ) -> None:
        self._g_y, self._g_x, self._second = g_y, g_x, second
        self.members = triangular_blocks([[entry is not sp.S.Zero for entry in row] for row in g_y])
        self._adjugates: list[Matrix] = []
        self._determinants: list[sp.Expr] = []
        pairs = []
        for block in self.members:
            n = len(block)
            adjugate, coefficients = faddeev_leverrier([[g_y[i][j] for j in block] for i in block])
            determinant = times(coefficients[n], sp.Integer((-1) ** n))
            pairs.append(_hurwitz(coefficients))
            if determinant.is_Number and determinant is not sp.S.Zero and len(self.members) > 1:
                adjugate = [[times(entry, 1 / determinant) for entry in row] for row in adjugate]
                determinant = sp.S.One
            self._adjugates.append(adjugate)
            self._determinants.append(determinant)
        self.determinant = times(*self._determinants)
        self.hurwitz = times(*pairs)
        # D z': the slow rates times D, and -D J^-1 g_x f.
        self.scaled = self._driven_by(f)
        # D/d_b, by block.
        ahead, behind = [sp.S.One], [sp.S.One]
        for one, two in zip(self._determinants[:-1], self._determinants[:0:-1]):
            ahead.append(times(ahead[-1], one))
            behind.append(times(behind[-1], two))
        self._others = [times(a, b) for a, b in zip(ahead, reversed(behind))]

    @property
    def watches_pairs(self) -> bool:
        """Whether a block has eigenvalues enough for a pair. Two of different blocks with the sum 0 are real."""
        return any(len(block) > 1 for block in self.members)

    def determinant_rate(self) -> sp.Expr:
        """dD/ds in the time with dt = D ds: sum_b (D/d_b) tr(A_b G_b), G_b = D J_b'."""
        return plus(
            [
                times(others, _trace_of_product(adjugate, drift))
                for others, adjugate, drift in zip(self._others, self._adjugates, self._drifts())
            ]
        )

    def inverse_trace(self, *, relative: bool) -> tuple[sp.Expr, sp.Expr]:
        """What |d/dt tr J^-1| is measured by, and how often it holds that: 1 where it is `relative`, else |D|^3."""
        delta, rate = size(self.determinant), self._inverse_trace_rate()
        cube = times(delta, delta, delta)
        if rate is sp.S.Zero:
            return (sp.S.One if relative else cube), rate
        drift = size(rate)
        return (sp.S.One, times(drift, sp.Pow(cube, -1, evaluate=False))) if relative else (cube, drift)

    def _inverse_trace_rate(self) -> sp.Expr:
        """D^3 d/dt tr J^-1, but for its sign: sum_b (D/d_b)^2 tr(A_b^2 G_b)."""
        terms = []
        for others, adjugate, drift in zip(self._others, self._adjugates, self._drifts()):
            trace = _trace_of_product(_product(adjugate, adjugate), drift)
            terms.append(times(others, others, trace))
        return plus(terms)

    def rounding(self, lengths: Sequence[sp.Expr]) -> sp.Expr:
        """What changes of the states by their `lengths` l make of D: sum |dD/dJ_ij| |dJ_ij/dz_k l_k|."""
        moved = []
        for others, adjugate, block in zip(self._others, self._adjugates, self.members):
            for a, i in enumerate(block):
                for b, j in enumerate(block):
                    for k, slope in self._second.get((i, j), {}).items():
                        moved.append(size(times(others, adjugate[b][a], slope, lengths[k])))
        return plus(moved)

    def pair_size(self) -> sp.Expr:
        """What `hurwitz` is small beside: prod_b r_b^(n_b (n_b - 1)/2), r_b as the spectral radius of moduli |J_b|.

        r = sum_k tr(|J|^k)^(1/k), k = 1 to n, which no units of the fast variables change.
        """
        sizes = []
        for block in self.members:
            n = len(block)
            power = moduli = [[size(self._g_y[i][j]) for j in block] for i in block]
            radii = [plus([moduli[i][i] for i in range(n)])]
            for k in range(2, n + 1):
                power = _product(power, moduli)
                radii.append(sp.Pow(plus([power[i][i] for i in range(n)]), sp.Rational(1, k), evaluate=False))
            sizes += [plus(radii)] * (n * (n - 1) // 2)
        return times(*sizes)

    def pulled(self) -> tuple[list[sp.Expr], tuple[Call, ...]]:
        """-D J^-1 g_x, column by column: how the fast variables follow each of the slow ones; it takes no calls."""
        count = len(self._g_x[0])
        units = [[sp.Integer(int(i == j)) for i in range(count)] for j in range(count)]
        return [entry for unit in units for entry in self._driven_by(unit)[count:]], ()

    def _drifts(self) -> list[Matrix]:
        """G_b = D J_b' along the flow of order 0, by block."""
        return [[[self._drift(i, j) for j in block] for i in block] for block in self.members]

    def _drift(self, i: int, j: int) -> sp.Expr:
        return plus([times(slope, self.scaled[k]) for k, slope in self._second.get((i, j), {}).items()])

    def _driven_by(self, slow: Sequence[sp.Expr]) -> list[sp.Expr]:
        """D (x', y') for x' = `slow` on M0: block after block, each behind those that drive it."""
        count, n = len(slow), len(self._g_y)
        rates = [*slow, *[sp.S.Zero] * n]
        known: list[int] = []
        for block, adjugate, determinant in zip(self.members, self._adjugates, self._determinants):
            forced = []
            for i in block:
                row = [*self._g_x[i], *(self._g_y[i][j] for j in known)]
                forced.append(_dot(row, [*rates[:count], *(rates[count + j] for j in known)]))
            moved = [times(_dot(row, forced), sp.S.NegativeOne) for row in adjugate]
            # All that is known was for the product of the determinants up to here.
            rates = [times(determinant, rate) for rate in rates]
            for i, rate in zip(block, moved):
                rates[count + i] = rate
            known += block
        return rates


def faddeev_leverrier(J: Matrix) -> tuple[Matrix, list[sp.Expr]]:
    """adj J, and the coefficients 1, c_1, ..., c_n of det(l - J)."""
    n = len(J)
    M: Matrix = [[sp.Integer(int(i == j)) for j in range(n)] for i in range(n)]
    coefficients: list[sp.Expr] = [sp.S.One]
    product = J
    for k in range(1, n + 1):
        coefficients.append(times(plus([product[i][i] for i in range(n)]), sp.Rational(-1, k)))
        if k < n:
            M = [[plus([product[i][j], *[coefficients[k]] * (i == j)]) for j in range(n)] for i in range(n)]
            product = _product(J, M)
    return [[times(e, sp.Integer((-1) ** (n - 1))) for e in row] for row in M], coefficients


def _hurwitz(coefficients: list[sp.Expr]) -> sp.Expr:
    """The determinant of order n - 1 of the Hurwitz matrix: prod_(i<j) (-l_i - l_j)."""
    n = len(coefficients) - 1
    if n < 2:
        return sp.S.One

    def entry(i: int, j: int) -> sp.Expr:
        k = 2 * j - i + 1
        return coefficients[k] if 0 <= k <= n else sp.S.Zero

    matrix = [[entry(i, j) for j in range(n - 1)] for i in range(n - 1)]
    return times(faddeev_leverrier(matrix)[1][n - 1], sp.Integer((-1) ** (n - 1)))


def _product(a: Matrix, b: Matrix) -> Matrix:
    columns = list(zip(*b))
    return [[_dot(row, column) for column in columns] for row in a]


def _trace_of_product(a: Matrix, b: Matrix) -> sp.Expr:
    return plus([_dot(row, column) for row, column in zip(a, zip(*b))])


def _dot(a: Sequence[sp.Expr], b: Sequence[sp.Expr]) -> sp.Expr:
    return plus([times(x, y) for x, y in zip(a, b)])
