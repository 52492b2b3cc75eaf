"""Finding one periodic orbit: from a run that settles on it, or from one lap, to collocation."""

from __future__ import annotations

import operator
from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from gsp.errors import DeclarationError, Status
from gsp.flow import Flow, Point
from gsp.integrators import check_step_limit
from gsp.lowering import parameter_vector
from gsp.periodic.collocation import Cycle, OrbitProblem
from gsp.periodic.floquet import multipliers
from gsp.periodic.mesh import FEWEST
from gsp.periodic.newton import COLLAPSED, Refined, refine, scales_of
from gsp.periodic.orbit import OrbitStats, PeriodicOrbit
from gsp.periodic.settling import OrbitError, given_lap, settled_lap

# Errors that first meshes are made for, in turn: Newton's method may need a finer one to begin with.
FIRST_ERRORS = (1e-8, 1e-11)
# Tolerances nearer to rounding than this are never met.
SMALLEST_TOLERANCE = 1e-12


def periodic_orbit(
    flow: Flow,
    *,
    start: Point | PeriodicOrbit,
    epsilon: float | None = None,
    period: float | None = None,
    backward: bool = False,
    tolerance: float = 1e-9,
    degree: int = 6,
    max_intervals: int = 2000,
    max_steps: int = 60_000,
    progress: Callable[[float], object] | None = None,
) -> PeriodicOrbit:
    """The periodic orbit on which the run from `start` settles, refined by Gauss collocation.

    A run forward, or `backward` for a repelling orbit, is followed until it comes back to itself in a section
    that is found from the run. With `period`, a guess, there is no settling: one lap of that length from `start` is
    the first guess, which serves for orbits of saddle type. `start` may also be an orbit nearby, of this flow at
    other parameters say. Then the orbit is solved by Newton's method as u' = T F(u), u(1) = u(0), with piecewise
    polynomials of `degree` on a mesh that is adapted until the estimated error of u is below `tolerance` of each
    state's amplitude; the period is far more accurate [DKK91]. `max_steps` bounds the run.

    Raises `OrbitError` when the run finds no cycle, naming the equilibrium where it settles on one, and
    `DeclarationError` for a call that is not well formed.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> van_der_pol = SlowFastSystem(slow={y: -x}, fast={x: y - x**3/3 + x}, epsilon=eps)
    >>> orbit = periodic_orbit(van_der_pol, start={"x": 2, "y": 0}, epsilon=0.01)
    >>> round(orbit.period * 10, 9)      # of x'' - 10 (1 - x^2) x' + x = 0
    19.078369567
    """
    check_accuracy(tolerance, degree, max_intervals)
    limit = check_step_limit(max_steps)
    problem = OrbitProblem(flow, parameter_vector(flow, epsilon))
    if isinstance(start, PeriodicOrbit):
        if start.flow.states != flow.states:
            raise DeclarationError(
                f"start is an orbit of another flow. Got one with the states {start.flow.states}, where these are "
                f"{flow.states}. Give a point, or an orbit of this flow at other parameters."
            )
        cycle = Cycle(start._cycle.mesh, start._cycle.values, start.period)
        refined = refine(problem, cycle, tolerance=tolerance, most=max_intervals, progress=progress)
        return assembled(problem, refined, epsilon)
    flow.initial(start)
    if period is None:
        lap = settled_lap(
            flow, start, epsilon, backward=bool(backward), max_steps=limit, progress=progress
        )  # fmt: skip
    else:
        length = _checked_period(period)
        lap = given_lap(flow, start, epsilon, -length if backward else length)
    refined: Refined | None = None
    guess = lap.cycle(degree, error=FIRST_ERRORS[0], most=max_intervals)
    size = scales_of(guess)
    for error in FIRST_ERRORS:
        guess = lap.cycle(degree, error=error, most=max_intervals)
        found = refine(problem, guess, tolerance=tolerance, most=max_intervals, progress=progress)
        if refined is None or found.status.ok or found.error < refined.error:
            refined = found
        if refined.status.ok:
            break
    assert refined is not None
    cycle = refined.solution.cycle
    if (cycle.amplitudes <= 1e-4 * size).all() and (problem.residual(cycle, size) < COLLAPSED):
        where = ", ".join(f"{s.name} = {v:.6g}" for s, v in zip(flow.states, cycle.values.mean(axis=(0, 1))))
        raise OrbitError(
            f"there is no cycle here: Newton's method ends at the equilibrium {where}. "
            "The run from start closes by itself, as around a centre or a slow focus: there is no isolated orbit. "
            "Start elsewhere, or change a parameter."
        )
    return assembled(problem, refined, epsilon)


def assembled(problem: OrbitProblem, refined: Refined, epsilon: float | None) -> PeriodicOrbit:
    """The result, with everything that is read off the linearisation at the cycle itself."""
    cycle = refined.solution.cycle
    scales = scales_of(cycle)
    constants = problem.constants(cycle)
    status, divergence = refined.status, float("nan")
    found = np.full(problem.size, complex(np.nan))
    try:
        linear = problem.linearise(cycle)
        divergence = linear.divergence
        found = multipliers(linear.transfers, divergence, scales)
    except (np.linalg.LinAlgError, ValueError):
        # An iterate that is not finite has no multipliers; a converged cycle is.
        status = status if not status.ok else Status.NON_FINITE
    for array in (cycle.mesh, cycle.values, found, constants):
        array.setflags(write=False)
    names = [symbol.name for symbol in problem.flow.parameters]
    return PeriodicOrbit(
        flow=problem.flow,
        epsilon=None if problem.flow.epsilon is None else float(constants[0]),
        parameters=MappingProxyType(dict(zip(names, map(float, constants[1:])))),
        period=cycle.period,
        multipliers=found,
        divergence=divergence,
        error=refined.error,
        period_error=refined.period_error,
        residual=problem.residual(cycle, scales),
        status=status,
        stats=OrbitStats(refined.iterations, refined.meshes, len(cycle.mesh) - 1),
        _cycle=cycle,
        _constants=constants,
    )


def _checked_period(period: float) -> float:
    try:
        length = float(period)
    except (TypeError, ValueError):
        length = float("nan")
    if not 0.0 < length < float("inf"):
        raise DeclarationError(
            f"period is a positive number, about that of the orbit. Got {period!r}. Leave it out to have it found."
        )
    return length


def check_accuracy(tolerance: float, degree: int, max_intervals: int) -> None:
    """Raises `DeclarationError` for a tolerance, a degree or a number of intervals that is none."""
    if not isinstance(tolerance, (int, float)) or not SMALLEST_TOLERANCE <= tolerance < 1.0:
        raise DeclarationError(
            f"tolerance is a share of the amplitude, from {SMALLEST_TOLERANCE:g} to 1. Got {tolerance!r}. "
            "The default serves most uses."
        )
    for name, value, low, high in (("degree", degree, 2, 10), ("max_intervals", max_intervals, FEWEST, 10**6)):
        try:
            fine = low <= operator.index(value) <= high
        except TypeError:
            fine = False
        if not fine:
            raise DeclarationError(f"{name} is a whole number from {low} to {high}. Got {value!r}.")
