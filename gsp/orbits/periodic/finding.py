"""Finding one periodic orbit: from a run that settles on it, or from one lap, to collocation."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType

import numpy as np

from gsp.errors import DeclarationError, Status
from gsp.integration.loop import check_step_limit
from gsp.lowering.compiled_flow import parameter_vector
from gsp.orbits.periodic.collocation import Cycle, OrbitProblem
from gsp.orbits.periodic.floquet import isolation, multipliers
from gsp.orbits.periodic.mesh import FEWEST
from gsp.orbits.periodic.newton import COLLAPSED, Refined, refine, scales_of
from gsp.orbits.periodic.orbit import OrbitStats, PeriodicOrbit
from gsp.orbits.periodic.settling import CLOSES, MOST_CROSSINGS, Lap, OrbitError, given_lap, settled_lap
from gsp.systems.arguments import check_flag, check_noun, check_number, check_progress, check_whole
from gsp.systems.flow import Flow, Point

# A second lap closes within this share of its amplitude, when the first has led to an orbit that does not attract.
CLOSER = 1e-6
# A cycle with a smaller isolation has neighbours that are cycles too. Laps of conservative flows have 1e-9 at most,
# which is the accuracy of the run, and 1e-14 for linear ones; hyperbolic cycles, relaxation included, 1e-3 to 1.
ISOLATED = 1e-8
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
    state's amplitude; the period is far more accurate (Doedel, Keller, Kernevez 1991). `max_steps` bounds the run. On a
    chaotic attractor, where no run settles, the result is an unstable orbit near which the run came back, as its
    multipliers say. Periods are minimal.

    Raises `OrbitError` when the run finds no cycle, naming the equilibrium where it settles on one, and
    `DeclarationError` for a call that is not well formed.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> van_der_pol = SlowFastSystem(slow={y: -x}, fast={x: y - x**3/3 + x}, epsilon=eps)
    >>> orbit = periodic_orbit(van_der_pol, start={"x": 2, "y": 0}, epsilon=0.01)
    >>> round(orbit.period * 10, 9)      # of x'' - 10 (1 - x^2) x' + x = 0
    19.078369567
    """
    check_noun(flow, Flow, verb="periodic_orbit")
    check_accuracy(tolerance, degree, max_intervals)
    check_flag(backward, what="backward")
    check_progress(progress)
    length = None if period is None else _checked_period(period)
    limit = check_step_limit(max_steps)
    problem = OrbitProblem(flow, parameter_vector(flow, epsilon))
    if isinstance(start, PeriodicOrbit):
        if start.flow.states != flow.states:
            raise DeclarationError(
                "start is an orbit of another flow.",
                "Give a point, or an orbit of this flow at other parameters.",
                got=f"one with the states {start.flow.states}, where these are {flow.states}",
            )
        values = start._cycle.values + (start.flow.centre - flow.centre)
        cycle = Cycle(start._cycle.mesh, values, start.period)
        refined = refine(problem, cycle, tolerance=tolerance, most=max_intervals, progress=progress)
        _check_isolated(problem, refined, isolation_of(problem, cycle))
        return assembled(problem, refined)
    flow.initial(start)

    def solved(lap: Lap) -> PeriodicOrbit:
        refined = _solved(
            problem, lap, degree=degree, tolerance=tolerance, most=max_intervals, progress=progress
        )
        return assembled(problem, refined)

    if length is not None:
        return solved(given_lap(flow, start, epsilon, -length if backward else length))

    def settled(closes: float) -> PeriodicOrbit:
        lap = settled_lap(
            flow, start, epsilon, closes=closes, backward=bool(backward), max_steps=limit, progress=progress
        )  # fmt: skip
        return solved(lap)

    orbit = settled(CLOSES)
    if backward or (orbit.status.ok and orbit.unstable == 0):
        return orbit
    # A run does not settle on an unstable orbit: it came near one on its way, beyond a period doubling say.
    try:
        closer = settled(CLOSER)
    except OrbitError:
        return orbit
    return closer if closer.status.ok and (closer.unstable == 0 or not orbit.status.ok) else orbit


def _solved(
    problem: OrbitProblem,
    lap: Lap,
    *,
    degree: int,
    tolerance: float,
    most: int,
    progress: Callable[[float], object] | None,
) -> Refined:
    """The cycle that a lap leads to, once around; raises `OrbitError` when that is an equilibrium."""
    best: Refined | None = None
    size, nearest = np.full(problem.size, np.inf), np.inf
    # Errors that first meshes are made for, in turn: Newton's method may need a finer one to begin with.
    for error in (1e-8, 1e-11):
        guess = lap.cycle(problem, degree, error=error, most=most)
        size = scales_of(problem, guess)
        nearest = min(nearest, isolation_of(problem, guess))
        found = refine(problem, guess, tolerance=tolerance, most=most, progress=progress)
        if best is None or found.status.ok or found.error < best.error:
            best = found
        if best.status.ok:
            break
    assert best is not None
    _check_isolated(problem, best, nearest)
    cycle = best.solution.point
    if (cycle.amplitudes <= 1e-4 * size).all() and (problem.residual(cycle, size) < COLLAPSED):
        flow = problem.asked
        place = flow.place(zip(flow.states, cycle.values.mean(axis=(0, 1)) + flow.centre))
        raise OrbitError(
            f"there is no cycle here: Newton's method ends at the equilibrium {place}.",
            "The run from start closes by itself, as around a centre or a slow focus: there is no isolated "
            "orbit. Start elsewhere, or change a parameter.",
        )
    times = _times_around(problem, cycle) if best.status.ok else 1
    if times > 1:
        once = Cycle(cycle.mesh, _part(cycle, times), cycle.period / times)
        best = refine(problem, once, tolerance=tolerance, most=most, progress=progress)
    return best


def isolation_of(problem: OrbitProblem, cycle: Cycle) -> float:
    """`isolation` of a cycle, or of a lap that may become one; infinite where it cannot be told."""
    try:
        with np.errstate(all="ignore"):
            transfers = problem.linearise(cycle).transfers
            rates = problem.compiled.rates(cycle.values[:, 0], problem.constants(cycle))
            found = isolation(transfers, rates, scales_of(problem, cycle))
    except (np.linalg.LinAlgError, ValueError):
        return np.inf
    return found if np.isfinite(found) else np.inf


def _check_isolated(problem: OrbitProblem, refined: Refined, before: float) -> None:
    """Raises `OrbitError` for a cycle of a family; `before` is the isolation of the lap that it came from.

    Newton's equations have no unique solution in a family: where its iterates go, if anywhere, rounding decides.
    """
    if refined.status.ok:
        before = isolation_of(problem, refined.solution.point)
    if before <= ISOLATED:
        raise OrbitError(
            "there is no isolated orbit here: the run from start closes by itself, and so do its "
            f"neighbours, as around a centre or where a quantity is conserved (isolation {before:.1e}, where "
            f"cycles have more than {ISOLATED:g}).",
            "Start elsewhere, change a parameter, or integrate over the lap that you want.",
        )


def _times_around(problem: OrbitProblem, cycle: Cycle) -> int:
    """How many times a cycle runs around the same orbit."""
    scales = scales_of(problem, cycle)
    s = np.linspace(0.0, 1.0, 400, endpoint=False)
    here, times = cycle.at(s), 1
    for k in range(2, MOST_CROSSINGS + 1):
        # A part of a cycle is the whole again when the two agree to this share of the amplitude.
        if (np.abs(cycle.at(np.mod(s + 1.0 / k, 1.0)) - here) <= 1e-6 * scales).all():
            times = k
    return times


def _part(cycle: Cycle, times: int) -> np.ndarray:
    """Values of the first part of a cycle, one of `times`, on its own mesh."""
    places = cycle.scheme.places(cycle.mesh)
    return cycle.at(places.ravel() / times).reshape(cycle.values.shape)


def assembled(problem: OrbitProblem, refined: Refined) -> PeriodicOrbit:
    """The result, with everything that is read off the linearisation at the cycle itself."""
    cycle = refined.solution.point
    scales = scales_of(problem, cycle)
    status, divergence = refined.status, float("nan")
    found = np.full(problem.size, complex(np.nan))
    try:
        linear = problem.linearise(cycle)
        divergence = problem.divergence(cycle)
        found = multipliers(linear.transfers, divergence, scales)
    except (np.linalg.LinAlgError, ValueError):
        # An iterate that is not finite has no multipliers; a converged cycle is.
        status = status if not status.ok else Status.NON_FINITE
    return orbit_of(
        problem, cycle, found, divergence, (refined.error, refined.period_error), status,
        (refined.iterations, refined.meshes),
    )  # fmt: skip


def orbit_of(
    problem: OrbitProblem,
    cycle: Cycle,
    found: np.ndarray,
    divergence: float,
    errors: tuple[float, float],
    status: Status,
    counts: tuple[int, int],
) -> PeriodicOrbit:
    """The orbit of a cycle with its multipliers `found`, the `errors` of u and of the period, (iterations, meshes)."""
    constants = problem.constants(cycle)
    for array in (cycle.mesh, cycle.values, found, constants):
        array.setflags(write=False)
    names = [symbol.name for symbol in problem.flow.parameters]
    return PeriodicOrbit(
        flow=problem.asked,
        epsilon=None if problem.flow.epsilon is None else float(constants[0]),
        parameters=MappingProxyType(dict(zip(names, map(float, constants[1:])))),
        period=cycle.period,
        multipliers=found,
        divergence=divergence,
        error=errors[0],
        period_error=errors[1],
        residual=problem.residual(cycle, scales_of(problem, cycle)),
        status=status,
        stats=OrbitStats(*counts, len(cycle.mesh) - 1),
        _cycle=cycle,
        _constants=constants,
    )


def _checked_period(period: float) -> float:
    be = "a positive number, about that of the orbit"
    return check_number(period, what="period", be=be, above=0.0, remedy="Leave it out to have it found.")


def check_accuracy(tolerance: float, degree: int, max_intervals: int) -> None:
    """Raises `DeclarationError` for a tolerance, a degree or a number of intervals that is none."""
    check_number(
        tolerance,
        what="tolerance",
        be=f"a share of the amplitude, from {SMALLEST_TOLERANCE:g} to 1",
        least=SMALLEST_TOLERANCE,
        below=1.0,
        remedy="The default serves most uses.",
    )
    for name, value, low, high in (("degree", degree, 2, 10), ("max_intervals", max_intervals, FEWEST, 10**6)):
        check_whole(value, what=name, least=low, most=high)
