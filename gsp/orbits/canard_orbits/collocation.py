"""Orbit segments of the full flow as collocation polynomials: Newton's method and meshes that follow the orbit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.collocation.bordered import Conditions, FlowEquations, OrbitChange, linearise
from gsp.collocation.gauss import gauss
from gsp.collocation.mesh import equidistributed
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.systems.system import SlowFastSystem
from gsp.tracing.newton import Rules, newton

# Gauss points an element: order 10 at the elements' ends. No pedigree; 4 and 6 cost about the same.
STAGES = 5
SCHEME = gauss(STAGES)
ITERATIONS = 12
# A Newton step of this length, relative to 1 + |z|, is rounding; one below LAST is followed by rounding.
ROUNDING, LAST = 1e-13, 1e-8
# A step this much longer than the one before ends the iteration; one longer than half the orbit is shortened.
RULES = Rules(ITERATIONS, ROUNDING, LAST, growth=4.0, hopeless=1.0, longest=0.5)


@dataclass(frozen=True, eq=False, repr=False)
class OrbitSegment:
    """An orbit z(sigma) of the full flow, sigma from 0 to 1, that takes the slow time `time` at `epsilon`.

    `mesh` (m + 1,) are the ends of the elements, `states` (m + 1, n) the orbit there and `stages` (m, s, n) at the
    Gauss points inside.
    """

    mesh: np.ndarray
    states: np.ndarray
    stages: np.ndarray
    time: float
    epsilon: float

    @property
    def values(self) -> np.ndarray:
        """The states at each element's start and inside it (m, s + 1, n)."""
        return np.concatenate([self.states[:-1, None], self.stages], axis=1)

    @property
    def start(self) -> np.ndarray:
        """The state where the orbit begins (n,)."""
        return self.states[0]

    @property
    def end(self) -> np.ndarray:
        """The state where it ends (n,)."""
        return self.states[-1]

    def at(self, sigma: np.ndarray) -> np.ndarray:
        """States (k, n) at shares sigma (k,) of the orbit's time, from the collocation polynomials."""
        return SCHEME.at(self.mesh, self.values, np.asarray(sigma, dtype=float))

    def places(self, number: int) -> np.ndarray:
        """Shares of the orbit's time, `number` of them an element from its start on."""
        return np.linspace(self.mesh[:-1], self.mesh[1:], number, endpoint=False).T.ravel()

    def on(self, mesh: np.ndarray) -> OrbitSegment:
        """The same orbit on another mesh, by interpolation."""
        values = self.at(SCHEME.places(mesh).ravel()).reshape(len(mesh) - 1, STAGES + 1, -1)
        states = np.concatenate([values[:, 0], self.states[-1:]])
        return replace(self, mesh=mesh, states=states, stages=np.ascontiguousarray(values[:, 1:]))

    def halved(self) -> OrbitSegment:
        """The same orbit with every element cut in two."""
        middle = 0.5 * (self.mesh[:-1] + self.mesh[1:])
        return self.on(np.sort(np.concatenate([self.mesh, middle])))

    def blended(self, other: OrbitSegment, share: float) -> OrbitSegment:
        """What lies at that share of the way from this orbit to another, on the mesh of this one."""
        other = other.on(self.mesh)
        return replace(
            self,
            states=(1 - share) * self.states + share * other.states,
            stages=(1 - share) * self.stages + share * other.stages,
            time=(1 - share) * self.time + share * other.time,
        )

    def moved(self, step: OrbitChange, share: float = 1.0) -> OrbitSegment:
        """This orbit plus `share` times a step."""
        return replace(
            self,
            states=self.states + share * step.states,
            stages=self.stages + share * step.stages,
            time=self.time + share * step.parameters[0],
            epsilon=self.epsilon + (share * step.parameters[1] if len(step.parameters) > 1 else 0.0),
        )

    def monitor(self) -> np.ndarray:
        """De Boor's monitor of the discretisation's error on each element (m,), h |z^(s+1)|^(1/(s+1))."""
        h = np.diff(self.mesh)
        scale = np.maximum(np.ptp(self.states, axis=0), 1e-8)
        top = np.einsum("j,mjn->mn", SCHEME.barycentric, self.values) / scale / h[:, None] ** STAGES
        jump = np.abs(np.diff(top, axis=0)) / (0.5 * (h[1:] + h[:-1]))[:, None]
        slope = np.zeros_like(top)
        slope[:-1] += 0.5 * jump
        slope[1:] += 0.5 * jump
        slope[0], slope[-1] = jump[0], jump[-1]
        return h * np.linalg.norm(slope, axis=1) ** (1.0 / (STAGES + 1))

    def elements_for(self, tolerance: float) -> int:
        """How many elements an even mesh needs for interpolation errors below `tolerance` of the orbit's extent."""
        # Largest value of the nodal polynomial of the Gauss points and the start of an element of length one.
        even = (tolerance * (STAGES + 1) / 2e-3) ** (1.0 / (STAGES + 1))
        return int(np.ceil(self.monitor().sum() / even))

    def adapted(self, tolerance: float, fewest: int, most: int) -> OrbitSegment:
        """The same orbit on a mesh of `elements_for` the tolerance, within bounds, that spreads its monitor evenly."""
        elements = int(np.clip(self.elements_for(tolerance), fewest, most))
        weight = self.monitor()
        # Share of the elements that is spread evenly, so that none grows too long.
        weight += 0.15 * weight.sum() * np.diff(self.mesh)
        return self.on(equidistributed(self.mesh, weight, elements))


# Conditions at an orbit, to be met; the number of rows is that of the states and the free parameters.
Problem = Callable[[OrbitSegment], Conditions]


class Collocation:
    """Newton's method for orbit segments of one system; `epsilon_free` makes epsilon an unknown.

    `iterations` counts Newton steps, and `work` their elements.
    """

    def __init__(self, system: SlowFastSystem, *, epsilon_free: bool = False) -> None:
        self.system = system
        self.flow = compile_flow(system)
        self.epsilon_free = epsilon_free
        self.iterations = 0
        self.work = 0
        self.sensitivity = compile_over(
            system,
            [derivative(rate, system.epsilon) for rate in system.rates] if epsilon_free else [sp.Integer(0)],
        )
        self.equations = FlowEquations(
            self.flow.field, self.flow.jacobian, self.sensitivity.address, 2 if epsilon_free else 1
        )

    def linear(self, orbit: OrbitSegment, conditions: Conditions, *, tangent: bool = False) -> OrbitChange:
        """Newton's step at `orbit`, or the `tangent` that the conditions pick.

        Raises `numpy.linalg.LinAlgError` where the system is singular.
        """
        if not orbit.epsilon > 0.0:
            raise np.linalg.LinAlgError("no field")
        self.work += len(orbit.mesh) - 1
        p = parameter_vector(self.system, orbit.epsilon)
        linear = linearise(
            self.equations, SCHEME, p, orbit.time, np.diff(orbit.mesh), orbit.states, orbit.stages
        )
        if tangent:
            return linear.solve(conditions, tangents=conditions.target[:, None])[1]
        return linear.solve(conditions)[0]

    def solve(self, orbit: OrbitSegment, problem: Problem, *, limit: int = ITERATIONS) -> OrbitSegment | None:
        """The orbit near `orbit` that meets the conditions; None when Newton's method does not converge."""
        found = newton(
            orbit, lambda orbit: self.linear(orbit, problem(orbit)), length=_length, moved=_moved,
            rules=replace(RULES, steps=limit),
        )  # fmt: skip
        self.iterations += found.iterations
        return found.point if found.status.ok else None

    def settled(self, orbit: OrbitSegment, problem: Problem) -> OrbitSegment | None:
        """As `solve` where the root is multiple: the iterate of the shortest step, which rounding ends."""
        best, shortest = None, 1e-4
        # At a multiple root Newton's method converges linearly, to the root of rounding of its multiplicity: it is
        # given so many steps, and the shortest has to be below 1e-4.
        for _ in range(40):
            self.iterations += 1
            try:
                step = self.linear(orbit, problem(orbit))
            except np.linalg.LinAlgError:
                break
            length = _length(step, orbit)
            orbit = orbit.moved(step, min(1.0, 0.5 / max(length, ROUNDING)))
            if orbit.time <= 0.0:
                break
            if length < shortest:
                best, shortest = orbit, length
        return best

    def defect(self, orbit: OrbitSegment) -> float:
        """Largest defect |dz/dsigma - time F| of the polynomials, over 1 + |time F|, between the Gauss points."""
        theta = np.linspace(0.05, 0.95, 7)
        h = np.diff(orbit.mesh)
        # The derivative has degree s - 1: its values at the Gauss points are all of it.
        slopes = np.einsum("ik,jkn->jin", SCHEME.slopes, orbit.values) / h[:, None, None]
        powers = np.arange(STAGES)
        between = (theta[:, None] ** powers) @ np.linalg.inv(SCHEME.c[:, None] ** powers)
        rate = np.einsum("kj,mjn->mkn", between, slopes)
        inside = orbit.mesh[:-1, None] + h[:, None] * theta
        field = orbit.time * self.flow.rates(
            orbit.at(inside.ravel()), parameter_vector(self.system, orbit.epsilon)
        )
        field = field.reshape(rate.shape)
        size = 1.0 + np.abs(field)
        return float((np.abs(rate - field) / size).max())


def _length(step: OrbitChange, orbit: OrbitSegment) -> float:
    """Largest change of a state over 1 + |z|, and of a parameter over its value, in a step."""
    return float(
        (np.abs(step.states).max(axis=1) / (1.0 + np.abs(orbit.states).max(axis=1))).max()
        + np.abs(step.parameters / [orbit.time, orbit.epsilon][: len(step.parameters)]).max()
    )


def _moved(orbit: OrbitSegment, step: OrbitChange, share: float) -> OrbitSegment | None:
    found = orbit.moved(step, share)
    return found if found.time > 0.0 else None


def sampled(run: Trajectory, steps: np.ndarray, *, elements: int) -> OrbitSegment:
    """The orbit that `run` has between steps[0] and steps[-1], on elements spread as its steps (k,) are."""
    first, last = float(steps[0]), float(steps[-1])
    mesh = np.interp(
        np.linspace(0.0, 1.0, elements + 1), np.linspace(0.0, 1.0, len(steps)), (steps - first) / (last - first)
    )
    mesh[0], mesh[-1] = 0.0, 1.0
    inside = SCHEME.places(mesh)[:, 1:]

    def states(share: np.ndarray) -> np.ndarray:
        return run.at(np.clip(first + share * (last - first), min(first, last), max(first, last))).T

    stages = states(inside.ravel()).reshape(elements, STAGES, -1)
    assert run.epsilon is not None
    return OrbitSegment(mesh, states(mesh), np.ascontiguousarray(stages), last - first, run.epsilon)


def joined(first: OrbitSegment, second: OrbitSegment) -> OrbitSegment:
    """Two orbits as one; the end of the first is taken for the start of the second."""
    time = first.time + second.time
    share = first.time / time
    mesh = np.concatenate([share * first.mesh, share + (1.0 - share) * second.mesh[1:]])
    states = np.concatenate([first.states, second.states[1:]])
    return OrbitSegment(mesh, states, np.concatenate([first.stages, second.stages]), time, first.epsilon)
