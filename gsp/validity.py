"""Where a reduced flow holds: test functions along it, and the desingularised flow that runs into a fold.

On M0 let J = g_y, Delta = det J and A = adj J, so that J^-1 = A/Delta. Along the flow of order 0, z' = (f, -J^-1 g_x f)
for z = (x, y), and J' = G/Delta with G = sum_i (dJ/dz_i) (Delta z_i'), which is regular at a fold. Then

    Delta                               is 0 where an eigenvalue passes through zero,
    H = prod_(i<j) (-l_i - l_j)         where two eigenvalues l have the sum 0: an imaginary pair, or a neutral saddle,
    Q = |Delta|^3 - epsilon |tr(A^2 G)| where epsilon |d/dt tr J^-1| = 1.

For one fast variable with eigenvalue l the last is epsilon |l'| = l^2: at distance epsilon^(1/3) of a simple fold in y
(Krupa, Szmolyan 2001), epsilon^(1/2) of a transcritical point, the parameter of the series in epsilon has grown to 1.
H is the last but one Hurwitz determinant (Orlando's formula).

In the time s with dt = Delta ds the flow of order 0 is (x, y)_s = (Delta f, -A g_x f), regular on the whole of
M0; it crosses a fold in finite time, and tends to a transcritical point in infinite time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property, lru_cache

import numpy as np
import sympy as sp

from gsp.differentiation import derivative
from gsp.flow import Flow, Values
from gsp.laurent import laurent
from gsp.lowering import CompiledFunction, compile_function
from gsp.reduced import ReducedFlow

Matrix = list[list[sp.Expr]]


class DesingularisedFlow(Flow):
    """The reduced flow of order 0 on M0 in slow and fast variables, in the time s with dt = det(g_y) ds.

    Its states are (x, y), what is reconstructed, and the time t.
    """

    epsilon: sp.Symbol | None
    is_stiff = False

    def __init__(self, states: Sequence[sp.Symbol], rates: Sequence[sp.Expr], epsilon: sp.Symbol) -> None:
        self.states = tuple(states)
        self.rates = tuple(rates)
        self.epsilon = epsilon
        self.parameters: Values = {}
        self.observables: Values = {}


class Validity:
    """The test functions of one reduced flow and its desingularised flow, compiled; parameters have their values."""

    def __init__(self, flow: ReducedFlow) -> None:
        self.flow = flow
        system = flow.manifold.branch.system
        self.slow, self.fast = system.x, system.y
        self.states = system.states
        values = dict(system.parameters)
        zero = sp.Integer(0)

        def leading(expression: sp.Expr) -> sp.Expr:
            return laurent(expression, system.epsilon, order=0).get(0, zero).xreplace(values)

        self.f = [leading(e) for e in system.f]
        g = [leading(e) for e in system.g]
        self.g_y = [[derivative(e, y) for y in self.fast] for e in g]
        self.g_x = [[derivative(e, x) for x in self.slow] for e in g]
        self.second = [[[derivative(e, z) for z in self.states] for e in row] for row in self.g_y]

    @property
    def watches_pairs(self) -> bool:
        """Whether there are eigenvalues enough for a pair."""
        return len(self.fast) > 1

    @cached_property
    def tests(self) -> CompiledFunction:
        """Delta, H, Q over the states of the reduced flow; what relative changes of (x, y) make of Delta; H's size."""
        put = dict(zip(self.states, self.flow.base))
        parts = _Parts(self, put)
        n = len(self.fast)
        q = _size(parts.determinant) ** 3 - self.flow.epsilon * _size(_trace_of_product(parts.A2, parts.G))
        moved = [
            _size(parts.adjugate[j][i] * slope.xreplace(put) * z)
            for i in range(n)
            for j in range(n)
            for slope, z in zip(self.second[i][j], self.flow.base)
            if slope != 0
        ]
        norm = sp.Add(*[e.xreplace(put) ** 2 for row in self.g_y for e in row])
        size = norm ** sp.Rational(n * (n - 1), 4)
        return self._over(
            self.flow.states, [parts.determinant, parts.hurwitz, q, sp.Add(*moved, evaluate=False), size]
        )

    @cached_property
    def lift(self) -> CompiledFunction:
        """(x, y) on M0 over the states of the reduced flow."""
        return self._over(self.flow.states, self.flow.base)

    @cached_property
    def fast_jacobian(self) -> CompiledFunction:
        """g_y at (x, y), row by row."""
        return self._over(self.states, [e for row in self.g_y for e in row])

    @cached_property
    def desingularised(self) -> DesingularisedFlow:
        """The flow in the time s."""
        parts = self._raw
        clock = sp.Dummy("t")
        rates = [
            *parts.scaled,
            *(parts.determinant * rate for rate in self.flow.driven_rates),
            parts.determinant,
        ]
        return DesingularisedFlow((*self.states, *self.flow.driven, clock), rates, self.flow.epsilon)

    @cached_property
    def crossing(self) -> CompiledFunction:
        """Delta and its rate in the time s, tr(A G), over the states of the desingularised flow."""
        parts = self._raw
        return self._over(
            self.desingularised.states, [parts.determinant, _trace_of_product(parts.adjugate, parts.G)]
        )

    @cached_property
    def pulled(self) -> CompiledFunction:
        """adj(g_y) g_x at (x, y)."""
        entries = [
            sp.Add(*[a * self.g_x[k][j] for k, a in enumerate(row)])
            for row in self._raw.adjugate
            for j in range(len(self.slow))
        ]
        return self._over(self.states, entries)

    @cached_property
    def _raw(self) -> _Parts:
        return _Parts(self, {})

    def _over(self, arguments: Sequence[sp.Symbol], outputs: Sequence[sp.Expr]) -> CompiledFunction:
        return compile_function(outputs, arguments=arguments, epsilon=self.flow.epsilon, parameters=())


@lru_cache(maxsize=256)
def validity_of(flow: ReducedFlow) -> Validity:
    """The test functions of `flow`, made once."""
    return Validity(flow)


class _Parts:
    """Determinant, adjugate and what else is made of g_y at points given by `put`.

    The expressions share their parts and are never expanded or searched: code is written once for each part.
    """

    def __init__(self, of: Validity, put: Values) -> None:
        J: Matrix = [[e.xreplace(put) for e in row] for row in of.g_y]
        self.adjugate, coefficients = faddeev_leverrier(J)
        n = len(J)
        self.determinant = coefficients[n] * (-1) ** n
        self.hurwitz = _hurwitz(coefficients)
        self.A2 = _product(self.adjugate, self.adjugate)
        f = [e.xreplace(put) for e in of.f]
        forced = [sp.Add(*[e.xreplace(put) * r for e, r in zip(row, f)]) for row in of.g_x]
        pulled = [-sp.Add(*[a * b for a, b in zip(row, forced)]) for row in self.adjugate]
        # Delta z': the slow rates times Delta, and -A g_x f.
        self.scaled = [*(self.determinant * rate for rate in f), *pulled]
        self.G: Matrix = [
            [sp.Add(*[s.xreplace(put) * r for s, r in zip(slopes, self.scaled) if s != 0]) for slopes in row]
            for row in of.second
        ]


def faddeev_leverrier(J: Matrix) -> tuple[Matrix, list[sp.Expr]]:
    """adj J, and the coefficients 1, c_1, ..., c_n of det(l - J)."""
    n = len(J)
    M: Matrix = [[sp.Integer(int(i == j)) for j in range(n)] for i in range(n)]
    coefficients: list[sp.Expr] = [sp.S.One]
    product = J
    for k in range(1, n + 1):
        coefficients.append(sp.Add(*[product[i][i] for i in range(n)]) * sp.Rational(-1, k))
        if k < n:
            M = [[product[i][j] + (coefficients[k] if i == j else 0) for j in range(n)] for i in range(n)]
            product = _product(J, M)
    sign = (-1) ** (n - 1)
    return [[sign * e for e in row] for row in M], coefficients


def _hurwitz(coefficients: list[sp.Expr]) -> sp.Expr:
    """The determinant of order n - 1 of the Hurwitz matrix: prod_(i<j) (-l_i - l_j)."""
    n = len(coefficients) - 1
    if n < 2:
        return sp.S.One

    def entry(i: int, j: int) -> sp.Expr:
        k = 2 * j - i + 1
        return coefficients[k] if 0 <= k <= n else sp.S.Zero

    matrix = [[entry(i, j) for j in range(n - 1)] for i in range(n - 1)]
    return faddeev_leverrier(matrix)[1][n - 1] * (-1) ** (n - 1)


def _product(a: Matrix, b: Matrix) -> Matrix:
    n = len(a)
    return [[sp.Add(*[a[i][k] * b[k][j] for k in range(n)]) for j in range(n)] for i in range(n)]


def _trace_of_product(a: Matrix, b: Matrix) -> sp.Expr:
    n = len(a)
    return sp.Add(*[a[i][k] * b[k][i] for i in range(n) for k in range(n)])


def eigenvalues(validity: Validity, z: np.ndarray) -> np.ndarray:
    """Eigenvalues of g_y at z = (x, y)."""
    n = len(validity.fast)
    matrix = validity.fast_jacobian(z, _NO_CONSTANTS).reshape(n, n)
    return np.linalg.eigvals(matrix) if np.isfinite(matrix).all() else np.full(n, np.nan)


_NO_CONSTANTS = np.array([float("nan")])


def _size(expression: sp.Expr) -> sp.Expr:
    # Evaluated, SymPy takes Abs apart into real and imaginary parts of symbols.
    return sp.Abs(expression, evaluate=False)
