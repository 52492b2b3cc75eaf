"""Where a reduced flow holds: test functions along it, and the desingularised flow that runs into a fold.

On M0 let J = g_y, Delta = det J and A = adj J, so that J^-1 = A/Delta. Along the flow of order 0, z' = (f, -J^-1 g_x f)
for z = (x, y), and J' = G/Delta with G = sum_i (dJ/dz_i) (Delta z_i'), which is regular at a fold. Then

    Delta                               is 0 where an eigenvalue passes through zero,
    H = prod_(i<j) (-l_i - l_j)         where two eigenvalues l have the sum 0: an imaginary pair, or a neutral saddle,
    Q = |Delta|^3 - c epsilon |tr(A^2 G)| where c epsilon |d/dt tr J^-1| = 1.

For one fast variable with eigenvalue l the last is c epsilon |l'| = l^2, c = max(1, 3 (N - 1)) at order N. It is where
the terms of order N and N - 1 in Riccati's equation epsilon x' = x^2 + t, the inner problem of a fold (Krupa, Szmolyan
2001), are equally large: exact for N = 1 and within 20 % to order 5 and beyond, as the series is that of Airy functions
with the exponent (4/3) (-t)^(3/2)/epsilon. The distance is of order epsilon^(1/3) in y at a fold, epsilon^(1/2) at a
transcritical point. From N = 2 on the terms themselves must have stopped falling too: the criterion counts the time
scale only, and a term may vanish by chance. H is the last but one Hurwitz determinant (Orlando's formula).

In the time s with dt = Delta ds the flow of order 0 is (x, y)_s = (Delta f, -A g_x f), regular on the whole of
M0; it crosses a fold in finite time, and tends to a transcritical point in infinite time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.integration.reduced_flow import ReducedFlow
from gsp.lowering.compiled_flow import CompiledFunction, compile_function
from gsp.lowering.remembering import remembered
from gsp.systems.flow import Flow, Portable, Values

Matrix = list[list[sp.Expr]]
# A polynomial within these is freed of repeated factors in milliseconds.
MOST_OPERATIONS, MOST_DEGREES = 200, 12
# The first outputs of `Validity.tests`; the borders follow.
TESTS = ("det g_y", "pair", "series", "rounding of det g_y", "size of pair")


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


class Validity(Portable):
    """The test functions of one reduced flow and its desingularised flow, compiled; parameters have their values.

    It does not hold the flow, with which it is forgotten.
    """

    def __init__(self, flow: ReducedFlow) -> None:
        self.order, self.epsilon = flow.order, flow.epsilon
        self._coordinates, self._base, self._last_terms = flow.states, flow.base, flow.last_terms
        self._driven, self._driven_rates = flow.driven, flow.driven_rates
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
        self._fall = sp.Dummy("fall")
        self.second = [[[derivative(e, z) for z in self.states] for e in row] for row in self.g_y]

    @property
    def watches_pairs(self) -> bool:
        """Whether there are eigenvalues enough for a pair."""
        return len(self.fast) > 1

    @cached_property
    def borders(self) -> tuple[sp.Expr, ...]:
        """What vanishes at the poles of g_y and g_x, of even order too: bases of negative powers, a tangent's cosine.

        A polynomial base has no repeated factors, which would let it pass through zero without changing its sign.
        """
        found: dict[sp.Expr, None] = {}
        for entry in (e for matrix in (self.g_y, self.g_x) for row in matrix for e in row):
            for atom in sorted(entry.atoms(sp.Pow, sp.tan), key=sp.default_sort_key):
                if isinstance(atom, sp.tan):
                    found[sp.cos(atom.args[0])] = None
                elif atom.exp.could_extract_minus_sign() and not atom.base.is_number:
                    found[_without_repetition(atom.base)] = None
        return tuple(found)

    @property
    def watches_terms(self) -> bool:
        """Whether the series has two terms to compare."""
        return self.order > 1

    @cached_property
    def tests(self) -> CompiledFunction:
        """Delta, H and Q; what relative changes of (x, y) make of Delta; H's size; the borders.

        At (x, y) and the terms' fall.
        """
        return self._over((*self.states, self._fall), self._outputs)

    @cached_property
    def _outputs(self) -> list[sp.Expr]:
        parts, n = self._parts, len(self.fast)
        growth = sp.Integer(max(1, 3 * (self.order - 1)))
        delta, drift = _size(parts.determinant), _size(_trace_of_product(parts.A2, parts.G))
        q = _plus([_times(delta, delta, delta), _times(self.epsilon, drift, -growth)])
        if self.watches_terms:
            q = sp.Max(q, self._fall, evaluate=False)
        moved = [
            _size(_times(parts.adjugate[j][i], slope, z))
            for i in range(n)
            for j in range(n)
            for slope, z in zip(self.second[i][j], self.states)
            if slope is not sp.S.Zero
        ]
        norm = sp.Add(*[e**2 for row in self.g_y for e in row])
        size = norm ** sp.Rational(n * (n - 1), 4)
        return [parts.determinant, parts.hurwitz, q, _plus(moved), size, *self.borders]

    def watched(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which columns (w,) of `tests` a run watches, and the signs (m, w) that they keep from starts with `rows`."""
        columns = np.array(self._columns)
        signs = np.where(rows < 0.0, -1.0, 1.0)
        # Positive where the series holds; the others may have either sign.
        signs[:, 2] = 1.0
        return columns, signs[:, columns]

    @cached_property
    def _columns(self) -> tuple[int, ...]:
        first = [0, *[1] * self.watches_pairs, *[2] * (self.order > 0)]
        return *first, *range(len(TESTS), len(TESTS) + len(self.borders))

    @cached_property
    def functions(self) -> np.ndarray:
        """What `kernels.scan` takes."""
        along, lift, tests = self.along, self.lift, self.tests
        flags = self.watches_pairs, self.order > 0
        addresses = along.address, lift.address, lift.outputs, tests.address, tests.outputs
        return np.array((along.outputs, *addresses, *flags, *self._columns), np.int64)

    @cached_property
    def along(self) -> CompiledFunction:
        """Those of the `tests` that a run watches, over the states of the reduced flow."""
        outputs = self._outputs
        through = dict(zip((*self.states, self._fall), (*self._base, self._falls)))
        return compile_function(
            [outputs[column] for column in self._columns],
            arguments=self._coordinates, epsilon=self.epsilon, parameters=(), through=through,
        )  # fmt: skip

    @cached_property
    def lift(self) -> CompiledFunction:
        """(x, y) on M0 over the states of the reduced flow, and by how much the squares of the last two terms fall."""
        return self._over(self._coordinates, [*self._base, self._falls])

    @cached_property
    def _falls(self) -> sp.Expr:
        if not self.watches_terms:
            return sp.S.Zero
        before, last = (sp.Add(*[term**2 for term in terms]) for terms in self._last_terms)
        return _plus([before, _times(last, sp.S.NegativeOne)])

    def point(self, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(x, y) on M0 over one state of the reduced flow."""
        return self.lift(y, p)[:-1]

    @cached_property
    def fast_jacobian(self) -> CompiledFunction:
        """g_y at (x, y), row by row."""
        return self._over(self.states, [e for row in self.g_y for e in row])

    @cached_property
    def derivatives(self) -> CompiledFunction:
        """g_y and g_x at (x, y), row by row."""
        return self._over(self.states, [e for matrix in (self.g_y, self.g_x) for row in matrix for e in row])

    @cached_property
    def desingularised(self) -> DesingularisedFlow:
        """The flow in the time s."""
        parts = self._parts
        clock = sp.Dummy("t")
        rates = [
            *parts.scaled,
            *(_times(parts.determinant, rate) for rate in self._driven_rates),
            parts.determinant,
        ]
        return DesingularisedFlow((*self.states, *self._driven, clock), rates, self.epsilon)

    @cached_property
    def crossing(self) -> CompiledFunction:
        """Delta and its rate in the time s, tr(A G), over the states of the desingularised flow."""
        parts = self._parts
        return self._over(
            self.desingularised.states, [parts.determinant, _trace_of_product(parts.adjugate, parts.G)]
        )

    @cached_property
    def pulled(self) -> CompiledFunction:
        """adj(g_y) g_x at (x, y)."""
        product = _product(self._parts.adjugate, self.g_x)
        return self._over(self.states, [entry for row in product for entry in row])

    @cached_property
    def _parts(self) -> _Parts:
        return _Parts(self)

    def _over(self, arguments: Sequence[sp.Symbol], outputs: Sequence[sp.Expr]) -> CompiledFunction:
        return compile_function(outputs, arguments=arguments, epsilon=self.epsilon, parameters=())


@remembered
def validity_of(flow: ReducedFlow) -> Validity:
    """The test functions of `flow`, made once."""
    return Validity(flow)


class _Parts:
    """Determinant, adjugate and what else is made of g_y.

    The expressions share their parts and are never expanded or searched: code is written once for each part.
    """

    def __init__(self, of: Validity) -> None:
        n = len(of.fast)
        self.adjugate, coefficients = faddeev_leverrier(of.g_y)
        self.determinant = _times(coefficients[n], sp.Integer((-1) ** n))
        self.hurwitz = _hurwitz(coefficients)
        self.A2 = _product(self.adjugate, self.adjugate)
        forced = [_dot(row, of.f) for row in of.g_x]
        pulled = [_times(_dot(row, forced), sp.S.NegativeOne) for row in self.adjugate]
        # Delta z': the slow rates times Delta, and -A g_x f.
        self.scaled = [*(_times(self.determinant, rate) for rate in of.f), *pulled]
        self.G: Matrix = [[_dot(slopes, self.scaled) for slopes in row] for row in of.second]


def faddeev_leverrier(J: Matrix) -> tuple[Matrix, list[sp.Expr]]:
    """adj J, and the coefficients 1, c_1, ..., c_n of det(l - J)."""
    n = len(J)
    M: Matrix = [[sp.Integer(int(i == j)) for j in range(n)] for i in range(n)]
    coefficients: list[sp.Expr] = [sp.S.One]
    product = J
    for k in range(1, n + 1):
        coefficients.append(_times(_plus([product[i][i] for i in range(n)]), sp.Rational(-1, k)))
        if k < n:
            M = [[_plus([product[i][j], *[coefficients[k]] * (i == j)]) for j in range(n)] for i in range(n)]
            product = _product(J, M)
    return [[_times(e, sp.Integer((-1) ** (n - 1))) for e in row] for row in M], coefficients


def _hurwitz(coefficients: list[sp.Expr]) -> sp.Expr:
    """The determinant of order n - 1 of the Hurwitz matrix: prod_(i<j) (-l_i - l_j)."""
    n = len(coefficients) - 1
    if n < 2:
        return sp.S.One

    def entry(i: int, j: int) -> sp.Expr:
        k = 2 * j - i + 1
        return coefficients[k] if 0 <= k <= n else sp.S.Zero

    matrix = [[entry(i, j) for j in range(n - 1)] for i in range(n - 1)]
    return _times(faddeev_leverrier(matrix)[1][n - 1], sp.Integer((-1) ** (n - 1)))


def _without_repetition(base: sp.Expr) -> sp.Expr:
    # A longer base is left as it is: its poles of odd order are found all the same.
    symbols = sorted(base.free_symbols, key=sp.default_sort_key)
    if not base.is_polynomial(*symbols) or sp.count_ops(base) > MOST_OPERATIONS:
        return base
    polynomial = sp.Poly(base, *symbols)
    is_small = polynomial.total_degree() <= MOST_DEGREES and (
        polynomial.domain.is_ZZ or polynomial.domain.is_QQ
    )
    return polynomial.sqf_part().as_expr() if is_small else base


def _product(a: Matrix, b: Matrix) -> Matrix:
    columns = list(zip(*b))
    return [[_dot(row, column) for column in columns] for row in a]


def _trace_of_product(a: Matrix, b: Matrix) -> sp.Expr:
    return _plus([_dot(row, column) for row, column in zip(a, zip(*b))])


def _dot(a: Sequence[sp.Expr], b: Sequence[sp.Expr]) -> sp.Expr:
    return _plus([_times(x, y) for x, y in zip(a, b)])


# SymPy would distribute and reorder these sums and products, and ask for the assumptions of each.


def _plus(terms: Sequence[sp.Expr]) -> sp.Expr:
    left = [term for term in terms if term is not sp.S.Zero]
    if all(term.is_Number for term in left):
        return sp.Add(*left)
    return left[0] if len(left) == 1 else sp.Add(*left, evaluate=False)


def _times(*factors: sp.Expr) -> sp.Expr:
    if sp.S.Zero in factors:
        return sp.S.Zero
    left = [factor for factor in factors if factor is not sp.S.One]
    if all(factor.is_Number for factor in left):
        return sp.Mul(*left)
    # A sign in front would be taken out again when code is written.
    left.sort(key=lambda factor: bool(factor.is_Number))
    return left[0] if len(left) == 1 else sp.Mul(*left, evaluate=False)


def _size(expression: sp.Expr) -> sp.Expr:
    # Evaluated, SymPy takes Abs apart into real and imaginary parts of symbols.
    return sp.Abs(expression, evaluate=False)


def eigenvalues(validity: Validity, z: np.ndarray) -> np.ndarray:
    """Eigenvalues of g_y at z = (x, y)."""
    n = len(validity.fast)
    matrix = validity.fast_jacobian(z, _NO_CONSTANTS).reshape(n, n)
    return np.linalg.eigvals(matrix) if np.isfinite(matrix).all() else np.full(n, np.nan)


_NO_CONSTANTS = np.array([float("nan")])
