"""Continuation of the critical manifold: one curve of M0 through its folds, and the curves that branch off it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import sympy as sp

from gsp.critical.continuation.arclength import Controls, CurveTrace, PointTracer
from gsp.critical.continuation.critical_curve import CriticalCurve, Options, curve_of, oriented, stability
from gsp.critical.continuation.location import locate
from gsp.critical.continuation.special_points import VERTICAL, BranchPoints, SpecialPoint
from gsp.critical.layer_problem import (
    Bounds,
    LayerProblem,
    check_bounds,
    corrected_start,
    find_symbol,
    layer_problem,
    natural_scales,
)
from gsp.errors import BranchError, DeclarationError, Status
from gsp.systems.arguments import (
    check_flag,
    check_noun,
    check_number,
    check_one_of,
    check_progress,
    check_whole,
    shown,
)
from gsp.systems.flow import Point, in_words
from gsp.systems.region import Interval
from gsp.systems.system import SlowFastSystem


def continue_critical(
    system: SlowFastSystem,
    *,
    start: Point,
    parameter: sp.Symbol | str | None = None,
    free: sp.Symbol | str | None = None,
    bounds: Bounds | None = None,
    direction: int = 0,
    step: float = 0.01,
    max_step: float = 0.04,
    max_points: int = 2000,
    tolerance: float = 1e-10,
    switch_branches: bool = False,
    progress: Callable[[float], None] | None = None,
) -> CriticalCurve:
    """The curve of M0 = {g(x, y, 0) = 0} through `start`, through its folds, with its special points.

    One variable is free: the slow variable `free` (which may be left out when there is one only), or `parameter`;
    the others keep their values at `start`, which names every state and is first corrected onto M0. `bounds`
    ends the curve exactly on an interval of any free or fast variable. `direction` +1 or -1 starts with the free
    variable increasing or decreasing; 0 goes both ways and joins the two. Steps are in units of each variable's
    scale: the width of its bounds, or its size. `switch_branches` continues the curves that cross this one too
    (`others`). `progress(share)` is called as points are added.

    Raises `DeclarationError` for a call that is not well formed and `BranchError` when no point of M0 is near
    `start`, or it is a branch point. How the curve ended is its `status`. Pseudo-arclength continuation is
    Keller's (1977); test functions and located points are those of Govaerts (2000) and Kuznetsov (2004).

    >>> v, w, eps = sp.symbols("v w epsilon")
    >>> system = SlowFastSystem(slow={w: -v}, fast={v: w + v - v**3/3}, epsilon=eps)
    >>> curve = continue_critical(system, start={"v": 2, "w": 0.7}, bounds={"w": (-2, 2)})
    >>> [(round(p["v"], 10), round(p["w"], 10)) for p in curve.special]
    [(-1.0, 0.6666666667), (1.0, -0.6666666667)]
    """
    check_noun(system, SlowFastSystem, verb="continue_critical")
    variable = _free_symbol(system, parameter, free)
    controls = check_controls(step, max_step, max_points, tolerance)
    check_one_of(direction, (-1, 0, 1), what="direction", be="+1, -1, or 0 for both")
    check_flag(switch_branches, what="switch_branches")
    check_progress(progress)
    problem, guess = layer_problem(system, (variable,), start)
    box = check_bounds(bounds, problem)
    check_inside(problem, guess, box, "start")
    scales = natural_scales(problem, guess, box)
    u = corrected_start(problem, guess, scales, tolerance)
    check_inside(problem, u, box, "the point of M0 next to start")
    if not np.isfinite(problem.jacobian(u)).all():
        raise BranchError(
            "g has no finite derivatives at start.", "Start beside that point.", got=in_words(problem.point(u))
        )
    options = Options(box, controls)
    tracer = _tracer(problem, options, scales, progress)
    tangent = tracer.null_vector(u)
    if tangent is None:
        raise BranchError(
            "start is a branch point, where the curve has no one tangent.",
            "Start beside it, and switch_branches=True finds the curves that cross there.",
            got=in_words(problem.point(u)),
        )
    tangent = oriented(tangent, VERTICAL, direction)
    curve = _continued(problem, options, tracer, u, tangent, both=direction == 0, at_crossing=False)
    if not switch_branches or curve.status is Status.INTERRUPTED:
        return curve
    return replace(curve, others=tuple(_all_branches(curve, progress)))


def switch_branch(
    curve: CriticalCurve, point: SpecialPoint, *, progress: Callable[[float], None] | None = None
) -> CriticalCurve:
    """The other curve of M0 through a branch point of `curve`, continued both ways with the curve's options.

    Raises `DeclarationError` when `point` is no branch point of the curve with two tangents.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={x: 1 + 0*y}, fast={y: y*(x - y**2)}, epsilon=eps)
    >>> line = continue_critical(system, start={"x": -1, "y": 0}, bounds={"x": (-1, 1)})
    >>> parabola = switch_branch(line, line.special[0])
    >>> parabola["y"].min().round(12), parabola["y"].max().round(12)
    (np.float64(-1.0), np.float64(1.0))
    """
    check_noun(curve, CriticalCurve, verb="switch_branch")
    check_progress(progress)
    if not any(point is own for own in curve.special):
        raise DeclarationError(
            "the point is none of the curve's special points.",
            "Take one of them.",
            got=shown(point),
            value=point,
        )
    if not point.kind.is_branch_point or len(point.directions) == 0:
        raise DeclarationError(
            "a curve can be switched at a branch point with two tangents.",
            "Take a transcritical point or a pitchfork.",
            got=f"a {point.kind} at {in_words(curve.problem.point(point.unknowns))}",
        )
    problem, options = curve.problem, curve.options
    scales = np.array([curve.scales[s.name] for s in problem.unknowns])
    tracer = _tracer(problem, options, scales, progress)
    return _continued(
        problem, options, tracer, point.unknowns, point.directions[1], both=True, at_crossing=True,
        known=(point,),
    )  # fmt: skip


# -- checks ----------------------------------------------------------------------------------------


def _free_symbol(system: SlowFastSystem, parameter, free) -> sp.Symbol:
    if parameter is not None and free is not None:
        raise DeclarationError(
            "one variable is free.", "Give one.", got=f"parameter={parameter!r} and free={free!r}"
        )
    if parameter is not None:
        return find_symbol(system, parameter, tuple(system.parameters), "parameter")
    if free is not None:
        return find_symbol(system, free, system.x, "free")
    if len(system.x) > 1:
        names = ", ".join(s.name for s in system.x)
        raise DeclarationError(
            "there are several slow variables and none is free.",
            f'Name the one that varies, as in free="{system.x[0].name}", or a parameter; critical_sheet '
            "varies two.",
            got=names,
        )
    return next(iter(system.slow))


def check_controls(step: float, max_step: float, max_points: int, tolerance: float) -> Controls:
    """The controls of a continuation; raises `DeclarationError` for numbers that are none."""
    for name, value in (("step", step), ("max_step", max_step), ("tolerance", tolerance)):
        check_number(value, what=name, be="a positive number, in units of the scales", above=0.0)
    check_whole(max_points, what="max_points", least=2, most=10**9, be="a whole number of at least 2")
    return Controls(float(step), float(max_step), int(max_points), float(tolerance))


def check_inside(problem: LayerProblem, u: np.ndarray, bounds: Mapping[str, Interval], what: str) -> None:
    """Raise `DeclarationError` when u is outside `bounds` by more than rounding."""
    for symbol, value in zip(problem.unknowns, u):
        low, high = bounds.get(symbol.name, (-np.inf, np.inf))
        slack = 1e-9 * (high - low) if np.isfinite(high - low) else 0.0
        if not low - slack <= value <= high + slack:
            raise DeclarationError(
                f"{what} is outside the bounds: {symbol.name} = {value:.6g}.",
                "Move the start or widen them.",
                got=f"bounds ({low:g}, {high:g})",
                value=float(value),
                point=dict(zip((s.name for s in problem.unknowns), map(float, u))),
            )


# -- the curve -------------------------------------------------------------------------------------


def box_of(problem: LayerProblem, bounds: Mapping[str, Interval]) -> np.ndarray:
    """Bounds of the unknowns (N, 2), infinite where there are none."""
    return np.array([bounds.get(s.name, (-np.inf, np.inf)) for s in problem.unknowns])


def _tracer(
    problem: LayerProblem, options: Options, scales: np.ndarray, progress: Callable[[float], None] | None
) -> PointTracer:
    tracer = PointTracer(
        problem,
        scales=scales,
        bounds=box_of(problem, options.bounds),
        names=tuple(s.name for s in problem.unknowns),
        controls=options.controls,
        progress=progress,
    )
    tracer.find = BranchPoints(problem, tracer)
    return tracer


def traced(
    tracer: PointTracer, u: np.ndarray, tangent: np.ndarray, *, both: bool, at_crossing: bool
) -> list[CurveTrace]:
    """The traces, forward or backward and forward; only forward when the curve closes."""
    scales = tracer.scales.copy()
    forward = tracer.run(u, tangent, at_crossing=at_crossing)
    if not both or forward.ending in (Status.CLOSED, Status.INTERRUPTED):
        return [forward]
    tracer.scales, grown = scales, tracer.scales
    backward = tracer.run(u, -tangent, at_crossing=at_crossing)
    tracer.scales = np.maximum(tracer.scales, grown)
    return [backward, forward]


def joined(traces: list[CurveTrace]) -> CurveTrace:
    """The whole curve as one trace in the forward direction; its ending and bound are the forward ones."""
    forward = traces[-1]
    if len(traces) == 1:
        return forward
    backward = traces[0]
    last = len(backward.points) - 1
    return CurveTrace(
        points=[*backward.points[:0:-1], *forward.points],
        tangents=[*(-t for t in backward.tangents[:0:-1]), *forward.tangents],
        scales=[*backward.scales[:0:-1], *forward.scales],
        ending=forward.ending,
        bound=forward.bound,
        crossings={last - row: found for row, found in backward.crossings.items()}
        | {last + row: found for row, found in forward.crossings.items()},
    )


def _continued(
    problem: LayerProblem,
    options: Options,
    tracer: PointTracer,
    u: np.ndarray,
    tangent: np.ndarray,
    *,
    both: bool,
    at_crossing: bool,
    known: tuple[SpecialPoint, ...] = (),
) -> CriticalCurve:
    with np.errstate(all="ignore"):
        traces = traced(tracer, u, tangent, both=both, at_crossing=at_crossing)
        points, special, arclength = locate(problem, tracer, joined(traces), known)
        eigenvalues = problem.eigenvalues(points)
    unstable, segments = stability(eigenvalues, [point.row for point in special])
    located = (points, special, arclength)
    return curve_of(
        CriticalCurve, problem, options, tracer, traces, located,
        eigenvalues=eigenvalues, unstable=unstable, segments=segments,
    )  # fmt: skip


def _all_branches(curve: CriticalCurve, progress: Callable[[float], None] | None) -> list[CriticalCurve]:
    """Every curve reached by switching, once each."""
    scales = np.array([curve.scales[s.name] for s in curve.problem.unknowns])
    seen: list[tuple[np.ndarray, np.ndarray]] = []

    def passed(u: np.ndarray, direction: np.ndarray) -> bool:
        return any(
            np.linalg.norm((u - v) / scales) < 1e-5 and abs(direction @ other) > 0.999 for v, other in seen
        )

    found: list[CriticalCurve] = []
    waiting = [curve]
    while waiting:
        current = waiting.pop(0)
        crossings = [p for p in current.special if p.kind.is_branch_point and len(p.directions)]
        seen += [(p.unknowns, p.directions[0]) for p in crossings]
        for point in crossings:
            if len(found) < 32 and not passed(point.unknowns, point.directions[1]):
                other = switch_branch(current, point, progress=progress)
                seen += [(p.unknowns, p.directions[0]) for p in other.special if len(p.directions)]
                found.append(other)
                waiting.append(other)
                if other.status is Status.INTERRUPTED:
                    return found
    return found
