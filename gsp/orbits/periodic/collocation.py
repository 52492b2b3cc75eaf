"""Gauss collocation of periodic orbits: a discrete cycle, its equation, and steps under conditions.

In the phase s in [0, 1] an orbit is u' = T F(u, lambda), u(1) = u(0), approximated on each of N mesh intervals by a
polynomial of degree m that satisfies the equation at the m Gauss points [dBS73]. Its error is O(h^(m+1)) between the
mesh points and O(h^(2m)) at them and in T. The polynomials' inner values are eliminated interval by interval; what
is left is almost block diagonal, bordered by a phase condition and, along a family, the arclength.

[dBS73] C. de Boor, B. Swartz, SIAM J. Numer. Anal. 10 (1973) 582-606. The bordered form is that of AUTO: E. J. Doedel,
H. B. Keller, J. P. Kernevez, Int. J. Bifurcation and Chaos 1 (1991) 745-772.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.collocation.bordered import Conditions, FlowEquations, Linearisation, linearise
from gsp.collocation.gauss import Scheme, gauss
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import CompiledFunction, compile_over
from gsp.systems.flow import Flow


@dataclass(frozen=True, eq=False)
class Cycle:
    """A discrete cycle: `mesh` (N + 1,) of phases from 0 to 1, `values` (N, m + 1, n), period and parameter.

    The values are those at the left end and at the m Gauss points of each interval; the parameter is the one that
    is free along a family, NaN without one. Differences of cycles on one mesh are kept in the same form.
    """

    mesh: np.ndarray
    values: np.ndarray
    period: float
    parameter: float = float("nan")

    @property
    def widths(self) -> np.ndarray:
        """Interval lengths (N,)."""
        return np.diff(self.mesh)

    @property
    def scheme(self) -> Scheme:
        """The Gauss method whose polynomials these are."""
        return gauss(self.values.shape[1] - 1)

    def at(self, s: np.ndarray) -> np.ndarray:
        """States (k, n) at phases s (k,) in [0, 1]."""
        return self.scheme.at(self.mesh, self.values, s)

    def on(self, mesh: np.ndarray) -> Cycle:
        """The same function on another mesh."""
        places = self.scheme.places(mesh)
        values = self.at(places.ravel()).reshape(*places.shape, self.values.shape[2])
        return Cycle(mesh, values, self.period, self.parameter)

    def moved(self, step: Cycle, share: float = 1.0) -> Cycle:
        """This plus `share` times `step`."""
        return Cycle(
            self.mesh,
            self.values + share * step.values,
            self.period + share * step.period,
            self.parameter + share * step.parameter,
        )

    def times(self, factor: float) -> Cycle:
        """Every number times `factor`; for differences of cycles."""
        return replace(
            self, values=factor * self.values, period=factor * self.period, parameter=factor * self.parameter
        )

    @property
    def slopes(self) -> np.ndarray:
        """du/ds at the Gauss points (N, m, n)."""
        return np.einsum("ik,jkn->jin", self.scheme.slopes, self.values) / self.widths[:, None, None]

    @property
    def amplitudes(self) -> np.ndarray:
        """max - min of each state over the stored values (n,)."""
        return np.ptp(self.values, axis=(0, 1))


@dataclass(frozen=True, eq=False)
class LinearCondition:
    """One linear equation for a step: the integral of <weights, du> + period dT + parameter dlambda = value."""

    weights: np.ndarray
    period: float
    parameter: float
    value: float


def with_axis(flow: Flow) -> list[bool]:
    """For each state whether its rate vanishes with it, so that no orbit crosses its axis."""
    return [rate.xreplace({z: sp.S.Zero}) == 0 for z, rate in zip(flow.states, flow.rates)]


def driven(flow: Flow, states: list[int]) -> list[int]:
    """Those of `states`, by number, which the others move though all that are not moved so are 0."""
    zero = {flow.states[k]: sp.S.Zero for k in states}
    still = [k for k in states if flow.rates[k].xreplace(zero) == 0]
    return [] if still == states else [*set(states).difference(still), *driven(flow, still)]


class OrbitProblem:
    """The equation of a cycle for one flow: F, its derivatives, and `free`, the parameter that may vary.

    Its cycles are those of `flow`, which is the one that was `asked` about, about its centres.
    """

    def __init__(self, asked: Flow, p: np.ndarray, free: sp.Symbol | None = None) -> None:
        self.asked = asked
        self.flow = flow = asked.about_centres
        self.compiled = compile_flow(flow)
        self.p = p
        self.free = free
        self.has_axis = np.array(with_axis(flow))
        # Where p = (epsilon, *parameters) holds it; epsilon itself may be free.
        self.place = 0 if free is None or free == flow.epsilon else 1 + list(flow.parameters).index(free)
        self.by_parameter: CompiledFunction | None = None
        if free is not None:
            self.by_parameter = compile_over(flow, [derivative(rate, free) for rate in flow.rates])

    @property
    def size(self) -> int:
        """Number of states, n."""
        return len(self.flow.states)

    def constants(self, cycle: Cycle) -> np.ndarray:
        """p = (epsilon, *parameters) at this cycle."""
        p = self.p.copy()
        if self.free is not None:
            p[self.place] = cycle.parameter
        return p

    def rates(self, cycle: Cycle) -> np.ndarray:
        """F at the Gauss points (N, m, n)."""
        inner = cycle.values[:, 1:]
        return self.compiled.rates(inner.reshape(-1, self.size), self.constants(cycle)).reshape(inner.shape)

    def jacobians(self, cycle: Cycle) -> np.ndarray:
        """F_u at the Gauss points (N, m, n, n)."""
        inner = cycle.values[:, 1:]
        J = self.compiled.derivatives(inner.reshape(-1, self.size), self.constants(cycle))
        return J.reshape(*inner.shape, self.size)

    def linearise(self, cycle: Cycle) -> Linearisation:
        """Everything about `cycle` to first order, the inner values eliminated.

        Raises `numpy.linalg.LinAlgError` where an interval is singular.
        """
        sensitivity = 0 if self.by_parameter is None else self.by_parameter.address
        equations = FlowEquations(
            self.compiled.field, self.compiled.jacobian, sensitivity, 1 if self.free is None else 2
        )
        states = np.concatenate([cycle.values[:, 0], cycle.values[:1, 0]])
        return linearise(
            equations,
            cycle.scheme,
            self.constants(cycle),
            cycle.period,
            cycle.widths,
            states,
            cycle.values[:, 1:],
        )

    def divergence(self, cycle: Cycle) -> float:
        """The integral of div F over a period."""
        return float(
            cycle.period * np.einsum("j,i,jikk->", cycle.widths, cycle.scheme.b, self.jacobians(cycle))
        )

    def steps(
        self,
        linear: Linearisation,
        cycle: Cycle,
        conditions: Sequence[LinearCondition],
        scales: np.ndarray,
        tangents: np.ndarray | None = None,
    ) -> list[Cycle]:
        """Steps as differences of cycles: Newton's with the conditions' values, then one for each of `tangents`.

        The orbit closes, and meets as many conditions as there are free scalars. A tangent (c,) is a right-hand side of
        the conditions with no defect elsewhere. Raises `numpy.linalg.LinAlgError` when the bordered matrix is singular.
        """
        n, count = self.size, len(conditions)
        closing = np.zeros((count, n))
        identity = np.eye(n)
        weight = (cycle.scheme.b[:, None] * cycle.widths[:, None, None])[None]
        held = Conditions(
            np.vstack([-identity, closing]),
            np.vstack([identity, closing]),
            np.vstack([np.zeros((n, count)), [[c.period, c.parameter][:count] for c in conditions]]),
            np.append(np.zeros(n), [c.value for c in conditions]),
            inside=weight * np.array([c.weights for c in conditions]),
        )
        # Steps are found in units of `scales`, of the period and of the parameter itself.
        units = np.append(scales, [cycle.period, 1.0][:count])
        given = None
        if tangents is not None:
            given = np.vstack([np.zeros((n, len(tangents))), np.transpose(tangents)])
        found = []
        for step in linear.solve(held, tangents=given, units=units):
            values = np.concatenate([step.states[:-1, None], step.stages], axis=1)
            parameter = float(step.parameters[1]) if count == 2 else 0.0
            found.append(Cycle(cycle.mesh, values, float(step.parameters[0]), parameter))
        return found

    def residual(self, cycle: Cycle, scales: np.ndarray) -> float:
        """Largest defect of the discrete equations, in units of `scales` (n,)."""
        scheme, step = cycle.scheme, cycle.period * cycle.widths[:, None, None]
        F = self.rates(cycle)
        left = cycle.values[:, :1]
        inner = left + step * np.einsum("ik,jkn->jin", scheme.A, F) - cycle.values[:, 1:]
        ends = left[:, 0] + step[:, 0] * np.einsum("k,jkn->jn", scheme.b, F) - np.roll(left[:, 0], -1, axis=0)
        worst = max(np.abs(inner / scales).max(), np.abs(ends / scales).max())
        return float(worst) if np.isfinite(worst) else float("inf")


def phase_condition(cycle: Cycle, reference: Cycle, scales: np.ndarray) -> LinearCondition:
    """The integral of <u - reference, reference'> = 0 in units of `scales`, for a step from `cycle`."""
    weights = reference.slopes / scales**2
    # Of order one, so that the border is as large as the rest of the matrix.
    weight = cycle.scheme.b[:, None] * cycle.widths[:, None, None]
    norm = float(np.sqrt(np.sum(weight * (weights * scales) ** 2)))
    weights = weights / norm
    value = -float(np.sum(weight * weights * (cycle.values[:, 1:] - reference.values[:, 1:])))
    return LinearCondition(weights, 0.0, 0.0, value)
