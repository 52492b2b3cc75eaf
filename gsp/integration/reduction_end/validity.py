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
scale only, and a term may vanish by chance. Where M0 is invariant for every epsilon, Q is not watched. H is the last
but one Hurwitz determinant (Orlando's formula).

In the time s with dt = Delta ds the flow of order 0 is (x, y)_s = (Delta f, -A g_x f), regular on the whole of
M0; it crosses a fold in finite time, and tends to a transcritical point in infinite time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.algebra.sharing import largest, plus, size, times
from gsp.algebra.switching_functions import on_side, switches
from gsp.algebra.triangular_blocks import triangular_blocks
from gsp.critical import spectrum
from gsp.integration.reduction_end.fast_blocks import FastBlocks
from gsp.integration.reduction_end.sparse_fast_part import SparseFastPart
from gsp.kernels.scan import ON_LOSS
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.lowering.remembering import remembered
from gsp.lowering.steps.kernel_call import Call
from gsp.systems.flow import Flow, Portable, Values

if TYPE_CHECKING:
    from gsp.critical.branch import Branch
    from gsp.integration.reduced_flow import ReducedFlow

# A polynomial within these is freed of repeated factors in milliseconds.
MOST_OPERATIONS, MOST_DEGREES = 200, 12
# Adjugates of more fast variables that depend on one another are not written out.
LARGEST_BLOCK = 8
# The first outputs of `Validity.tests`; the borders follow, then the surfaces on which M0 jumps.
TESTS = ("det g_y", "pair", "series", "rounding of det g_y", "size of pair")


class DesingularisedFlow(Flow):
    """The reduced flow of order 0 on M0 in slow and fast variables, in the time s with dt = det(g_y) ds.

    Its states are (x, y), what is reconstructed, and the time t.
    """

    epsilon: sp.Symbol | None
    is_stiff = False

    def __init__(
        self,
        states: Sequence[sp.Symbol],
        rates: Sequence[sp.Expr],
        epsilon: sp.Symbol,
        calls: tuple[Call, ...],
    ) -> None:
        self.states = tuple(states)
        self.calls = calls
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
        self.watches_series = flow.order > 0 and not _is_exact(flow.manifold.branch)
        system = flow.manifold.branch.system
        self.slow, self.fast = system.x, system.y
        self.states, self._centres = system.states, system.centres
        values = dict(system.parameters)
        zero = sp.Integer(0)

        def leading(expression: sp.Expr) -> sp.Expr:
            return laurent(expression, system.epsilon, order=0).get(0, zero).xreplace(values)

        self.f = [leading(e) for e in system.f]
        g = [leading(e) for e in system.g]
        self.g_y = [_slopes(e, self.fast) for e in g]
        self.g_x = [_slopes(e, self.slow) for e in g]
        self._fall = sp.Dummy("fall")
        # Where M0 jumps, slow coordinates are carried on. Fast ones do not tell where the jump leads.
        carries = all(s in system.x for s in flow.manifold.coordinates)
        sides = {
            switch.surface: [[on_side(e, switch.surface, side) for e in g] for side in (-1, 0, 1)]
            for switch in (() if carries else switches(g, self.states))
        }
        self._sides = {surface: of for surface, of in sides.items() if of[0] != of[2]}
        # Where it is not constant.
        numbers = {z: k for k, z in enumerate(self.states)}
        self.second = {
            (i, j): {
                numbers[z]: derivative(e, z)
                for z in sorted(e.free_symbols & numbers.keys(), key=numbers.__getitem__)
            }
            for i, row in enumerate(self.g_y)
            for j, e in enumerate(row)
            if not e.is_number
        }

    @property
    def watches_pairs(self) -> bool:
        """Whether there are eigenvalues enough for a pair."""
        return self._parts.watches_pairs

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
    def surfaces(self) -> tuple[sp.Expr, ...]:
        """What vanishes where g jumps, if M0 has fast coordinates, which a jump would have to move."""
        return tuple(self._sides)

    @cached_property
    def beside(self) -> CompiledFunction:
        """At (x, y) for each of the `surfaces` what g is where that is below, at and above 0."""
        return self._over(self.states, [e for of in self._sides.values() for g in of for e in g])

    @property
    def watches_terms(self) -> bool:
        """Whether the series has two terms to compare."""
        return self.order > 1

    @cached_property
    def tests(self) -> CompiledFunction:
        """Delta, H and Q; what relative changes of (x, y), about the centres, make of Delta; H's size; the borders; the
        surfaces.

        At (x, y) and the terms' fall.
        """
        return self._over((*self.states, self._fall), self._outputs, self._parts.calls)

    @cached_property
    def _outputs(self) -> list[sp.Expr]:
        parts = self._parts
        q = self._series_test(relative=False)
        rounding, pair_size = parts.rounding(self._lengths), parts.pair_size()
        return [parts.determinant, parts.hurwitz, q, rounding, pair_size, *self.borders, *self.surfaces]

    @property
    def _lengths(self) -> list[sp.Expr]:
        """How large the states are: |z|, but about the system's centres, with what the rounding there is of that."""
        rounded = float(np.finfo(float).eps) / ON_LOSS
        centres = self._centres
        return [
            plus([size(s - centres[s]), sp.Float(abs(centres[s]) * rounded)]) if s in centres else s
            for s in self.states
        ]

    def _series_test(self, *, relative: bool) -> sp.Expr:
        """Q, or with `relative` Q by |Delta|^3; at orders above 1 what the fall of the terms says, if that is more."""
        growth = sp.Integer(-max(1, 3 * (self.order - 1)))
        unit, drift = self._parts.inverse_trace(relative=relative)
        if drift is sp.S.Zero:
            return unit
        q = plus([unit, times(self.epsilon, drift, growth)])
        return largest(times(self._fall, unit), q) if self.watches_terms else q

    def watched(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Which columns (w,) of `tests` a run watches, and the signs (m, w) that they keep from starts with `rows`."""
        columns = np.array(self._columns)
        signs = np.where(rows < 0.0, -1.0, 1.0)
        # Positive where the series holds; the others may have either sign.
        signs[:, 2] = 1.0
        return columns, signs[:, columns]

    @cached_property
    def _columns(self) -> tuple[int, ...]:
        first = [0, *[1] * self.watches_pairs, *[2] * self.watches_series]
        return *first, *range(len(TESTS), len(TESTS) + len(self.borders) + len(self.surfaces))

    @cached_property
    def varying(self) -> tuple[int, ...]:
        """Which of the columns that are `watched` can change along a run; a linear fast part has none."""
        outputs, epsilon = self._outputs, {self.epsilon}
        return tuple(k for k, c in enumerate(self._columns) if not outputs[c].free_symbols <= epsilon)

    @cached_property
    def functions(self) -> np.ndarray:
        """What `kernels.scan` takes."""
        along, lift, tests = self.along, self.lift, self.tests
        flags = self.watches_pairs, self.watches_series
        addresses = along.address, lift.address, lift.outputs, tests.address, tests.outputs
        columns = [self._columns[k] for k in self.varying]
        return np.array((along.outputs, *addresses, *flags, 0, 0, *columns), np.int64)

    @cached_property
    def along(self) -> CompiledFunction:
        """Those of the `tests` that are watched and can change, over the states of the reduced flow."""
        outputs = list(self._outputs)
        if 2 in self._columns:
            # Q by |Delta|^3 has the same sign, and no bends where Delta only grows.
            outputs[2] = self._series_test(relative=True)
        through = dict(zip((*self.states, self._fall), (*self._base, self._falls)))
        return compile_function(
            [outputs[self._columns[k]] for k in self.varying],
            arguments=self._coordinates, epsilon=self.epsilon, through=through, calls=self._parts.calls,
        )  # fmt: skip

    @cached_property
    def lift(self) -> CompiledFunction:
        """(x, y) on M0 over the states of the reduced flow, and the shares by which the last two terms fall."""
        return self._over(self._coordinates, [*self._base, self._falls])

    @cached_property
    def _falls(self) -> sp.Expr:
        """The mean, over fast variables, of the fall of the square of its terms as a share of their sum.

        No units, as in Q; and 1 at most, so that Q, where it is nearly that, does not make a bend beside it.
        """
        if not self.watches_terms:
            return sp.S.Zero
        falls = []
        for before, last in zip(*([times(term, term) for term in terms] for terms in self._last_terms)):
            # The least double keeps terms that are both 0 from having no share.
            whole = plus([before, last, sp.Rational(float(np.finfo(float).tiny))])
            fall = plus([before, times(last, sp.S.NegativeOne)])
            falls.append(times(fall, sp.Pow(whole, -1, evaluate=False), sp.Rational(1, len(self.fast))))
        return plus(falls)

    def point(self, y: np.ndarray, p: np.ndarray) -> np.ndarray:
        """(x, y) on M0 over one state of the reduced flow."""
        return self.lift(y, p)[:-1]

    @property
    def leaves_pairs(self) -> bool:
        """Whether imaginary pairs may come along a run that no test function sees."""
        return self._parts.leaves_pairs and bool(self.second)

    def fast_jacobian(self, z: np.ndarray) -> np.ndarray:
        """g_y (n, n) at z = (x, y)."""
        matrix = np.zeros((len(self.fast), len(self.fast)))
        rows, columns = self._places
        matrix[rows, columns] = self._entries(z, _NO_CONSTANTS)
        return matrix

    @cached_property
    def _places(self) -> tuple[list[int], list[int]]:
        """Rows and columns of what is not 0 throughout in g_y."""
        places = [(i, j) for i, row in enumerate(self.g_y) for j, e in enumerate(row) if e is not sp.S.Zero]
        return [i for i, _ in places], [j for _, j in places]

    @cached_property
    def _entries(self) -> CompiledFunction:
        return self._over(self.states, [self.g_y[i][j] for i, j in zip(*self._places)])

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
            *(times(parts.determinant, rate) for rate in self._driven_rates),
            parts.determinant,
        ]
        return DesingularisedFlow((*self.states, *self._driven, clock), rates, self.epsilon, parts.calls)

    @cached_property
    def crossing(self) -> CompiledFunction:
        """Delta and its rate in the time s, tr(A G), over the states of the desingularised flow."""
        parts = self._parts
        outputs = [parts.determinant, parts.determinant_rate()]
        return self._over(self.desingularised.states, outputs, parts.calls)

    @cached_property
    def pulled(self) -> CompiledFunction:
        """-adj(g_y) g_x at (x, y), but for constants, column by column."""
        return self._over(self.states, *self._parts.pulled())

    @cached_property
    def _parts(self) -> FastBlocks | SparseFastPart:
        pattern = [[entry is not sp.S.Zero for entry in row] for row in self.g_y]
        if max(map(len, triangular_blocks(pattern))) > LARGEST_BLOCK:
            return SparseFastPart(self.g_y, self.g_x, self.f, self.second, self.states)
        return FastBlocks(self.g_y, self.g_x, self.f, self.second)

    def _over(
        self, arguments: Sequence[sp.Symbol], outputs: Sequence[sp.Expr], calls: tuple[Call, ...] = ()
    ) -> CompiledFunction:
        return compile_function(outputs, arguments=arguments, epsilon=self.epsilon, calls=calls)


@remembered
def validity_of(flow: ReducedFlow) -> Validity:
    """The test functions of `flow`, made once."""
    return Validity(flow)


def _is_exact(branch: Branch) -> bool:
    """Whether M0 is seen to be invariant for every epsilon: its series is h_0 alone, and ends where M0 does."""
    system, graph = branch.system, branch.graph
    if graph is None:
        return False
    for y, h in graph.items():
        moved = [times(system.epsilon, derivative(h, x), rate) for x, rate in system.slow.items() if h.has(x)]
        residual = (system.fast[y] - plus(moved)).xreplace(dict(graph))
        if sp.count_ops(residual) > MOST_OPERATIONS or sp.expand(residual) != 0:
            return False
    return True


def _slopes(expression: sp.Expr, by: Sequence[sp.Symbol]) -> list[sp.Expr]:
    held = expression.free_symbols
    return [derivative(expression, s) if s in held else sp.S.Zero for s in by]


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


def eigenvalues(validity: Validity, z: np.ndarray) -> np.ndarray:
    """Eigenvalues of g_y at z = (x, y)."""
    matrix = validity.fast_jacobian(z)
    if not np.isfinite(matrix).all():
        return np.full(len(matrix), np.nan)
    return spectrum.eigenvalues(matrix[np.newaxis])[0]


_NO_CONSTANTS = np.array([float("nan")])
