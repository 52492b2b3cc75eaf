"""Hamel's equations: Lagrange's equations in a moving frame, with what both limits take from them.

With qdot = Psi (eta - gamma), eta = (u, w), gamma = (0, c): G eta' = Q, G = Psi^T M Psi,
Q = Psi^T (R - M d(qdot)/dt at constant eta). Constraint forces and friction act on the rows of w alone,
since Psi^T A^T = (0, 1).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cache, cached_property
from operator import itemgetter
from types import MappingProxyType

import sympy as sp

from gsp.algebra.brevity import shorter
from gsp.algebra.ring import DENOMINATOR_TERMS
from gsp.algebra.ring_elements import RingElement
from gsp.errors import BudgetError, DeclarationError, HyperbolicityError
from gsp.mechanics.algebra import Algebra, Matrix, refuse_long, transpose, within_budget
from gsp.mechanics.frame import MovingFrame, inverse_forms
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.turning import measured, turned_together
from gsp.systems.flow import Values
from gsp.systems.system import VectorField


@dataclass(frozen=True, eq=False)
class HamelEquations:
    """The equations in elements of `algebra`, functions of (q, t, u, w).

    Derivation 0 of the algebra is d/dt at constant eta, derivation 1 + j the one by eta_j.
    """

    system: LagrangianSystem
    frame: MovingFrame
    algebra: Algebra
    psi: Matrix
    velocities: list[RingElement]
    metric: Matrix
    force: list[RingElement]
    along_inverse: Matrix

    @property
    def along(self) -> int:
        """Number of quasi-velocities on D."""
        return len(self.frame.along)

    @property
    def zeros(self) -> dict[sp.Symbol, sp.Expr]:
        """w = 0."""
        return dict.fromkeys(self.frame.across, sp.Integer(0))

    @cached_property
    def coupling(self) -> Matrix:
        """C = G_uu^-1 G_uw (n - k, k): u + C w feels no friction."""
        a = self.along
        return self.algebra.multiply(self.along_inverse, [row[a:] for row in self.metric[:a]])

    @cached_property
    def free(self) -> list[RingElement]:
        """G_uu^-1 Q_u, the rate of u + C w at constant C."""
        return self.algebra.apply(self.along_inverse, self.force[: self.along])

    @cached_property
    def schur_inverse(self) -> Matrix:
        """(G_ww - G_wu C)^-1 = A M^-1 A^T (k, k): the mobility of the slip velocities."""
        a, algebra = self.along, self.algebra
        schur = self.metric
        if a:
            product = algebra.multiply([row[:a] for row in self.metric[a:]], self.coupling)
            schur = [
                [(x - y).reduced() for x, y in zip(row[a:], other)]
                for row, other in zip(self.metric[a:], product)
            ]
        try:
            return algebra.inverse(schur)
        except HyperbolicityError:
            raise DeclarationError(
                f"A M^-1 A^T is degenerate for L = {self.system.lagrangian}: the kinetic energy is not "
                "definite across the constraints, so that no force there determines the motion.",
                "Correct it.",
            ) from None

    def rates(self, force: Sequence[RingElement]) -> list[RingElement]:
        """eta' = G^-1 Q under a force Q (n,): w' = A M^-1 A^T (Q_w - G_wu G_uu^-1 Q_u), u' = G_uu^-1 Q_u - C w'."""
        a, algebra = self.along, self.algebra
        free = algebra.apply(self.along_inverse, force[:a])
        pulled = algebra.apply([row[:a] for row in self.metric[a:]], free)
        slip = algebra.apply(self.schur_inverse, [f - p for f, p in zip(force[a:], pulled)])
        back = algebra.apply(self.coupling, slip)
        return [*[(f - b).reduced() for f, b in zip(free, back)], *slip]

    def written(self, force: Sequence[RingElement]) -> list[sp.Expr]:
        """`rates` as expressions, each with its factors as they are where multiplied out it is longer or too long."""
        a, write = self.along, self.algebra.write

        def times(matrix: list[list[sp.Expr]], vector: Sequence[sp.Expr]) -> list[sp.Expr]:
            return [sp.Add(*[e * x for e, x in zip(row, vector)]) for row in matrix]

        along_inverse, pull, schur_inverse, coupling = self._factors
        given = [write(f) for f in force]
        free = times(along_inverse, given[:a])
        slip = times(schur_inverse, [f - p for f, p in zip(given[a:], times(pull, free))])
        found = [*(f - b for f, b in zip(free, times(coupling, slip))), *slip]
        with self.algebra.ring.afresh(), suppress(BudgetError):
            for i, rate in enumerate(self.rates(force)):
                with suppress(BudgetError):
                    found[i] = shorter(write(rate), found[i])
        return found

    @cached_property
    def _factors(self) -> list[list[list[sp.Expr]]]:
        pull = [row[: self.along] for row in self.metric[self.along :]]
        matrices = (self.along_inverse, pull, self.schur_inverse, self.coupling)
        return [[[self.algebra.write(e) for e in row] for row in matrix] for matrix in matrices]

    @cached_property
    def on_distribution(self) -> tuple[list[RingElement], list[RingElement]]:
        """(u', lambda) of the Lagrange-d'Alembert equations (9) on w = 0."""
        a, algebra = self.along, self.algebra
        rates = [algebra.put(f, self.zeros) for f in self.free]
        pulled = algebra.apply([row[:a] for row in self.metric[a:]], rates)
        multipliers = [algebra.put(p - f, self.zeros) for p, f in zip(pulled, self.force[a:])]
        return rates, multipliers

    def positions(self, *, on_distribution: bool = False) -> dict[sp.Symbol, RingElement]:
        """q' and t' as elements; with w = 0 on request."""
        put = (lambda e: self.algebra.put(e, self.zeros)) if on_distribution else (lambda e: e)
        rates = {q: put(v) for q, v in zip(self.system.coordinates, self.velocities)}
        return rates | dict.fromkeys(self.system.clock, self.algebra.ring.one)

    def raw_velocities(self, *, on_distribution: bool = False) -> Values:
        """qdot in terms of (q, u, w); with w = 0 on request."""
        rates = self.positions(on_distribution=on_distribution)
        pairs = zip(self.system.coordinates, self.system.velocities)
        return MappingProxyType({v: self.algebra.write(rates[q]) for q, v in pairs})

    @cached_property
    def energy(self) -> RingElement:
        """H (4) in the moving frame."""
        system = self.system
        return self.algebra.read(system.raw_energy, dict(zip(system.velocities, self.velocities)))

    def energy_derivative(self, rates: list[RingElement], *, explicit: bool) -> RingElement:
        """sum_j eta_j' dH/d eta_j, and with `explicit` also dH/dt at constant eta."""
        ring = self.algebra.ring
        total = ring.derive(self.energy, 0) if explicit else ring.zero
        for j, rate in enumerate(rates):
            total = total + ring.derive(self.energy, 1 + j) * rate
        return total.reduced()


@within_budget()
def hamel(
    system: LagrangianSystem, frames: Iterable[Sequence[MovingFrame]], further: tuple[sp.Expr, ...] = ()
) -> HamelEquations:
    """Hamel's equations of `system` in the frame that makes them shortest, with angles measured so.

    It is one of the first list of `frames` in which there are some that can be written. `further` are expressions to
    be read in their algebra.
    """
    found: list[tuple[int, HamelEquations]] = []
    over: list[BudgetError] = []
    # A search in every frame takes most of the time: what bodies are neighbours in one they are in others.
    known: dict[sp.Symbol, sp.Expr] = {}
    for alternatives in frames:
        for frame in alternatives:
            try:
                equations = _shortest(system, frame, further, known)
                known = known or dict(equations.algebra.measured_from)
                found.append((_length(equations), equations))
            except BudgetError as error:
                over.append(error)
        if any(length <= DENOMINATOR_TERMS for length, _ in found):
            break
    if not found:
        raise over[-1]
    length, best = min(found, key=itemgetter(0))
    refuse_long(length, "the formulas of the motion have")
    awkward, measured_from = best.algebra.awkward_angles, best.algebra.measured_from
    return (
        _derived(system, best.frame, further, sines=awkward, measured_from=measured_from) if awkward else best
    )


def _length(equations: HamelEquations) -> int:
    """The terms of all that `HamelEquations.written` multiplies."""
    matrices = (equations.metric, equations.along_inverse, equations.coupling, equations.schur_inverse)
    rows = itertools.chain(*matrices, [equations.force, equations.free])
    return sum(len(e.numerator) for row in rows for e in row)


def _terms(equations: HamelEquations) -> int:
    # The force tells of denominators too, which its derivatives multiply out and the metric does not show.
    return sum(len(e.numerator) for row in (*equations.metric, equations.force) for e in row)


def _shortest(system: LagrangianSystem, frame: MovingFrame, further, known: Values) -> HamelEquations:
    """The equations in one frame, angles that turn together measured as `known`, or from one another, if shorter."""

    # In one order of the angles, so that formulas are the same in every process.
    def derived(measured_from: Values) -> HamelEquations:
        return in_order(tuple((q, measured_from[q]) for q in system.coordinates if q in measured_from))

    @cache
    def in_order(measured_from: tuple[tuple[sp.Symbol, sp.Expr], ...]) -> HamelEquations:
        return _derived(system, frame, further, measured_from=dict(measured_from))

    given = before = derived({})
    if not (together := turned_together(system, frame.constrained)):
        return given
    first = derived({q: each[-1] for q, each in together.items()})
    if known:
        return min(given, first, derived(known), key=_terms)
    while before is not first:
        before = first
        for q, references in together.items():
            tried = (derived(measured(first.algebra.measured_from, q, each)) for each in references)
            first = min((first, *tried), key=_terms)
    return min(first, given, key=_terms)


def _derived(
    system, frame: MovingFrame, further, *, sines=frozenset(), measured_from: Values = MappingProxyType({})
) -> HamelEquations:
    eta = frame.quasi_velocities
    right = list(system.right_hand_sides)
    mass = system.raw_mass_matrix
    expressions = [*right, *mass, *frame.forms, *frame.offset, system.lagrangian, *further]
    algebra = Algebra(
        (*system.coordinates, *system.clock, *eta),
        tuple(system.values),
        expressions,
        derivations=1 + len(eta),
        sines=sines,
        measured_from=measured_from,
    )
    ring = algebra.ring
    psi = inverse_forms(algebra, frame)
    offsets = [ring.zero] * len(frame.along) + [algebra.read(c) for c in frame.offset]
    shifted = [ring.generator(s) - c for s, c in zip(eta, offsets)]
    velocities = algebra.apply(psi, shifted)
    for q, v in zip(system.coordinates, velocities):
        ring.set_derivative(q, 0, v)
    for t in system.clock:
        ring.set_derivative(t, 0, ring.one)
    for j, s in enumerate(eta):
        ring.set_derivative(s, 1 + j, ring.one)
    environment = dict(zip(system.velocities, velocities))
    M = algebra.matrix(mass, environment)
    psi_transposed = transpose(psi)
    metric = algebra.multiply(psi_transposed, algebra.multiply(M, psi))
    inertia = algebra.apply(M, algebra.derive(velocities, 0))
    applied = [(algebra.read(r, environment) - f).reduced() for r, f in zip(right, inertia)]
    force = algebra.apply(psi_transposed, applied)
    a = len(frame.along)
    try:
        along_inverse = algebra.inverse([row[:a] for row in metric[:a]])
    except HyperbolicityError:
        raise DeclarationError(
            f"the kinetic energy is degenerate along the constraints, L = {system.lagrangian}: the motion is "
            "not determined.",
            "Give every admissible velocity a kinetic energy.",
        ) from None
    return HamelEquations(system, frame, algebra, psi, velocities, metric, force, along_inverse)


def split_positions(
    positions: dict[sp.Symbol, sp.Expr], rates: list[sp.Expr], clock: tuple[sp.Symbol, ...]
) -> tuple[dict[sp.Symbol, sp.Expr], dict[sp.Symbol, sp.Expr]]:
    """(those that the rates depend on, the others): the second are driven, which is the symmetry.

    Time that nothing depends on is left out of both.
    """
    needed: set = set()
    waiting: list = list(rates)
    while waiting:
        met = waiting.pop().free_symbols & set(positions) - needed
        needed |= met
        waiting += [positions[q] for q in met]
    matter = {q: rate for q, rate in positions.items() if q in needed}
    driven = {q: rate for q, rate in positions.items() if q not in needed}
    for t in clock:
        if t in driven and not any(rate.has(t) for q, rate in driven.items() if q != t):
            del driven[t]
    return matter, driven


def clocked(
    system: LagrangianSystem, matter: Values, rates: Values, *, epsilon: sp.Symbol | None
) -> VectorField:
    """The field of the positions that matter and of the quasi-velocities, time last when it matters."""
    positions = dict(matter)
    clock = {t: positions.pop(t) for t in system.clock if t in positions}
    return VectorField(
        {**positions, **rates, **clock}, epsilon=epsilon, parameters=system.values, name=system.name
    )


def extended(field: VectorField, reconstruction: Values) -> VectorField:
    """`field` with the reconstruction variables behind its states."""
    return VectorField(
        {**field.equations, **reconstruction},
        epsilon=field.epsilon,
        parameters=field.parameters,
        name=field.name,
    )
