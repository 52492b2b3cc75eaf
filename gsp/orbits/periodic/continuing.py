"""`continue_orbits`: from an orbit or a Hopf point to a family in one parameter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sympy as sp

from gsp.collocation.gauss import gauss
from gsp.errors import DeclarationError, Status
from gsp.lowering.compiled_flow import parameter_vector
from gsp.orbits.periodic.collocation import Cycle, LinearCondition, OrbitProblem, phase_condition
from gsp.orbits.periodic.family import FamilyStats, OrbitFamily, SpecialOrbit
from gsp.orbits.periodic.finding import check_accuracy, orbit_of
from gsp.orbits.periodic.hopf import HopfPoint
from gsp.orbits.periodic.location import located
from gsp.orbits.periodic.newton import scales_of, solve_cycle
from gsp.orbits.periodic.orbit import PeriodicOrbit, check_name
from gsp.orbits.periodic.settling import OrbitError
from gsp.orbits.periodic.tracing import CycleControls, CycleTracer, Row
from gsp.systems.arguments import (
    check_noun,
    check_number,
    check_one_of,
    check_positive,
    check_progress,
    check_whole,
)
from gsp.systems.region import Interval, check_interval


def continue_orbits(
    origin: PeriodicOrbit | HopfPoint,
    *,
    bounds: Interval,
    parameter: sp.Symbol | str | None = None,
    direction: int = 1,
    step: float = 0.05,
    max_step: float = 0.4,
    max_points: int = 500,
    tolerance: float = 1e-9,
    degree: int = 6,
    max_intervals: int = 1000,
    max_period: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> OrbitFamily:
    """The family of periodic orbits through `origin`, by pseudo-arclength in `parameter`, the period free.

    `parameter` is one of the flow's, or epsilon. `origin` is an orbit, from which it first increases (`direction` +1)
    or decreases (-1), or a Hopf point (see `hopf_points`), whose small cycles come first. `bounds` (low, high) of the
    parameter end the family exactly on one. Steps are in units of the cycle's amplitudes, its period and the width of
    the bounds. Each orbit has a mesh of its own, adapted until its estimated error is below `tolerance` of the
    amplitudes. Folds of cycles, branch points, period doublings and torus bifurcations are located. `max_period` is by
    default a thousand first ones.

    Raises `DeclarationError` for a call that is not well formed and `OrbitError` when no cycle is found at the Hopf
    point. How the family ended is its `status`.

    >>> x, y, mu = sp.symbols("x y mu")
    >>> square = x**2 + y**2                # r' = r (mu + r^2 - r^4), a fold of cycles at mu = -1/4
    >>> factor = mu + square - square**2
    >>> flow = VectorField({x: x*factor - y, y: y*factor + x}, epsilon=None, parameters={mu: -1})
    >>> hopf, = hopf_points(flow, start={"x": 0, "y": 0}, parameter="mu", bounds=(-2, 1))
    >>> family = continue_orbits(hopf, bounds=(-2, 1))
    >>> fold, = family.special
    >>> fold.kind.value, round(fold.orbit.parameters["mu"], 9)
    ('fold of cycles', -0.25)
    """
    check_noun(origin, (PeriodicOrbit, HopfPoint), verb="continue_orbits")
    check_accuracy(tolerance, degree, max_intervals)
    check_progress(progress)
    low, high = check_interval(bounds, what="bounds", remedy="Give (low, high) of the parameter.")
    check_one_of(direction, (-1, 1), what="direction", be="+1 or -1: where the parameter goes first")
    for name, value in (("step", step), ("max_step", max_step)):
        check_number(value, what=name, be="a positive number, in units of the cycle", above=0.0)
    check_whole(max_points, what="max_points", least=2, most=10**9, be="a whole number of at least 2")
    if max_period is not None:
        max_period = check_positive(max_period, what="max_period")
    symbol = _parameter(origin, parameter)
    value = origin.value if isinstance(origin, HopfPoint) else origin.constants[symbol.name]
    if not low <= value <= high:
        raise DeclarationError(
            "the family starts outside the bounds.",
            "Widen them.",
            got=f"{symbol} = {value:g} and ({low:g}, {high:g})",
        )
    if symbol == origin.flow.epsilon and low <= 0.0:
        raise DeclarationError(
            f"{symbol} is positive along a family.",
            "Give a positive lower one.",
            got=f"the bounds ({low:g}, {high:g})",
        )
    period = 2.0 * np.pi / origin.omega if isinstance(origin, HopfPoint) else origin.period
    controls = CycleControls(
        float(step), float(max_step), int(max_points), float(tolerance), int(max_intervals),
        float(max_period or 1e3 * period),
    )  # fmt: skip
    problem = OrbitProblem(origin.flow, _constants(origin), symbol)
    tracer = CycleTracer(problem, (low, high), controls)
    with np.errstate(all="ignore"):
        if isinstance(origin, HopfPoint):
            first = _born(tracer, origin, degree)
        else:
            first = _through(tracer, origin, symbol.name, direction)
        rows, lengths, ending, rejected = tracer.run(first, progress)
        special = [] if ending is Status.INTERRUPTED else located(tracer, rows, lengths)
    stats = FamilyStats(
        steps=len(rows) - 1,
        rejected=rejected,
        iterations=sum(row.iterations for row in rows),
        intervals=max(len(row.cycle.mesh) - 1 for row in rows),
    )
    return _family(origin, tracer, symbol.name, rows, lengths, special, ending, stats)


def _parameter(origin: PeriodicOrbit | HopfPoint, parameter: sp.Symbol | str | None) -> sp.Symbol:
    if isinstance(origin, PeriodicOrbit):
        if parameter is None:
            names = ", ".join(origin.constants) or "none"
            raise DeclarationError(
                'name the parameter that varies, as in parameter="a".', f"The parameters are {names}."
            )
        return check_name(origin.flow, parameter, epsilon=True)
    symbol = check_name(origin.flow, parameter if parameter is not None else origin.parameter)
    if symbol.name != origin.parameter:
        raise DeclarationError(
            f"this is a Hopf point in {origin.parameter}.",
            f"Leave it out, or find the Hopf point in {symbol.name}.",
            got=f"parameter={symbol.name!r}",
            value=symbol.name,
        )
    return symbol


def _constants(origin: PeriodicOrbit | HopfPoint) -> np.ndarray:
    if isinstance(origin, PeriodicOrbit):
        return origin._constants.copy()
    return parameter_vector(origin.flow, origin.epsilon)


# -- the first cycle -------------------------------------------------------------------------------


def _through(tracer: CycleTracer, orbit: PeriodicOrbit, name: str, direction: int) -> Row:
    if not orbit.status.ok:
        raise DeclarationError(
            "the orbit has not converged.", "Continue one whose status is SUCCESS.", got=orbit.status.name
        )
    value = orbit.constants[name]
    cycle = Cycle(orbit._cycle.mesh, orbit._cycle.values, orbit.period, value)
    nothing = Cycle(cycle.mesh, np.zeros_like(cycle.values), 0.0, float(direction))
    # The tangent is found across the parameter's own direction, and across a generic one at a fold.
    solution = tracer.solved(cycle, cycle, tracer.at_parameter(cycle, value))
    try:
        if solution.status.ok:
            return tracer.row(solution, tracer.across(solution.point, nothing), solution.iterations)
    except np.linalg.LinAlgError:
        pass
    raise OrbitError(
        f"the orbit at {name} = {value:g} is singular: a fold of cycles or a branch point.",
        "Start at another value of the parameter.",
    )


def _born(tracer: CycleTracer, hopf: HopfPoint, degree: int) -> Row:
    """A small cycle at the Hopf point, and the family's direction there: growing."""
    point = np.array(list(hopf.point.values())) - hopf.flow.centre
    # A first cycle at a Hopf point is at most so large a share of the equilibrium's size.
    size = 1e-2 * max(1.0, float(np.abs(point).max()))
    if hopf.l1 and hopf.crossing:
        # Normal form rho' = crossing dlambda rho + l1 omega rho^3, with u = point + 2 Re(rho q e^(i omega t)).
        # It moves the parameter by about 1e-4 of the bounds' width.
        size = min(size, 2.0 * np.sqrt(1e-4 * tracer.width * abs(hopf.crossing / (hopf.l1 * hopf.omega))))
    mesh = np.linspace(0.0, 1.0, 17)
    places = gauss(degree).places(mesh)
    mode = np.real(hopf.vector * np.exp(2j * np.pi * places[..., None]))
    # Each that fails is followed by one of a quarter of its size.
    for _ in range(6):
        rest = Cycle(mesh, np.broadcast_to(point, mode.shape), 2.0 * np.pi / hopf.omega, hopf.value)
        row = _beside(tracer, rest, Cycle(mesh, size * mode, 0.0, 0.0))
        if row is not None:
            return row
        size *= 0.25
    raise OrbitError(
        f"no small cycle was found at the Hopf point {hopf.parameter} = {hopf.value:.10g}.",
        got=(
            f"l1 = {hopf.l1:.3g} and crossing = {hopf.crossing:.3g}; the cycles are degenerate when one of them "
            "is 0"
        ),
    )


def _beside(tracer: CycleTracer, rest: Cycle, step: Cycle) -> Row | None:
    """The cycle as far from an equilibrium as the step leads, in its direction; None where Newton's method fails."""
    guess = rest.moved(step)
    scales = scales_of(tracer.problem, guess)
    weight = guess.scheme.b[:, None] * guess.widths[:, None, None]
    weights = step.values[:, 1:] / scales**2
    weights = weights / float(np.sum(weight * weights * step.values[:, 1:]))

    def condition(cycle: Cycle) -> LinearCondition:
        moved = cycle.values[:, 1:] - guess.values[:, 1:]
        return LinearCondition(weights, 0.0, 0.0, -float(np.sum(weight * weights * moved)))

    def conditions(cycle: Cycle) -> list[LinearCondition]:
        return [phase_condition(cycle, guess, scales), condition(cycle)]

    solution = solve_cycle(tracer.problem, guess, scales=scales, conditions=conditions)
    return tracer.settled(solution, condition, step) if solution.status.ok else None


# -- the result ------------------------------------------------------------------------------------


def _family(origin, tracer, name, rows, lengths, special, ending, stats) -> OrbitFamily:
    arclength = np.cumsum(lengths)
    arclength.setflags(write=False)
    orbits = tuple(_orbit(tracer, row) for row in rows)
    varies = tracer.problem.free == origin.flow.epsilon
    return OrbitFamily(
        flow=origin.flow,
        epsilon=None if varies else origin.epsilon,
        parameter=name,
        orbits=orbits,
        arclength=arclength,
        special=tuple(SpecialOrbit(kind, orbits[row], row) for kind, row in special),
        hopf=origin if isinstance(origin, HopfPoint) else None,
        status=ending,
        stats=stats,
    )


def _orbit(tracer: CycleTracer, row: Row) -> PeriodicOrbit:
    return orbit_of(
        tracer.problem, row.cycle, row.multipliers, row.divergence,
        (row.error, float("nan")), row.status, (row.iterations, 1),
    )  # fmt: skip
