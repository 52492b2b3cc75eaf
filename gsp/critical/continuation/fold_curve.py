"""Curves of folds: {g = 0, det g_y = 0} with two free variables, with the cusps and Bogdanov-Takens points on them.

det g_y is replaced by the bordered test s, which is as smooth and better scaled; its borders are renewed at every
point (Govaerts 2000, 4.1).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.critical.continuation.arclength import SAME_PLACE, CurveTrace, PointTracer
from gsp.critical.continuation.critical_curve import NamedCurve, Options, curve_of, oriented
from gsp.critical.continuation.curve_continuation import box_of, check_controls, check_inside, joined, traced
from gsp.critical.continuation.location import (
    AROUND,
    TOUCH,
    inserted,
    least_between,
    place_between,
    sign_changes,
    touches,
)
from gsp.critical.continuation.special_points import (
    SpecialPoint,
    curvature,
    fold_coefficient,
    fold_point,
    fold_vectors,
    special_point,
)
from gsp.critical.layer_problem import (
    Bounds,
    LayerProblem,
    check_bounds,
    corrected_start,
    eigenvalue_sizes,
    find_symbol,
    layer_problem,
    least_norm_newton,
    natural_scales,
)
from gsp.critical.loss_kind import LossKind
from gsp.critical.minimally_augmented import Singular, identity, singular_near
from gsp.errors import BranchError, DeclarationError
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.systems.arguments import check_each, check_noun, check_one_of, check_progress
from gsp.systems.flow import Point, in_words
from gsp.systems.system import SlowFastSystem


@dataclass(frozen=True, eq=False, repr=False)
class FoldCurve(NamedCurve, Card, Tabular):
    """A curve of folds of M0: `points` (m, n) with the columns `names`.

    `coefficient` (m,) is a = <psi, g_yy phi phi>/2 with |phi| = |psi| = 1, both continuous along the curve: it
    changes its sign at a cusp. `skew` (m,) is <psi, phi>: it does at a Bogdanov-Takens point. `eigenvalues`
    (m, n_fast) are those of g_y, the rightmost first, `arclength` (m,) in units of the scales. `special` holds the
    cusps, folds of higher order and Bogdanov-Takens points, which are rows of the curve too.
    """

    coefficient: np.ndarray
    skew: np.ndarray
    eigenvalues: np.ndarray

    def _headed(self) -> tuple[str, Sequence[str]]:
        return f"curve of folds over {', '.join(self.free)}", ()


def continue_folds(
    system: SlowFastSystem,
    *,
    start: Point,
    parameter: sp.Symbol | str | None = None,
    free: tuple[sp.Symbol | str, ...] | None = None,
    bounds: Bounds | None = None,
    direction: int = 0,
    step: float = 0.01,
    max_step: float = 0.04,
    max_points: int = 2000,
    tolerance: float = 1e-10,
    progress: Callable[[float], None] | None = None,
) -> FoldCurve:
    """The curve of folds {g = 0, det g_y = 0} through the fold next to `start`.

    Two variables are free: the slow variables named in `free` (all two when there are two), or one of them and
    `parameter`. `start` names every state, and may name the parameter; it is corrected onto a fold. The other
    arguments are those of `continue_critical`; `direction` is that of the first free variable.

    Raises `DeclarationError` for a call that is not well formed and `BranchError` when no fold is near `start`.

    >>> a, b, y, eps = sp.symbols("a b y epsilon")
    >>> system = SlowFastSystem(slow={a: y, b: -y}, fast={y: y**3 + a*y + b}, epsilon=eps)
    >>> folds = continue_folds(system, start={"a": -3, "b": 2, "y": 1}, bounds={"a": (-3, 1), "y": (-1, 1)})
    >>> [point.kind.value for point in folds.special]
    ['cusp']
    >>> bool(abs(4*folds["a"]**3 + 27*folds["b"]**2).max() < 1e-12)
    True
    """
    check_noun(system, SlowFastSystem, verb="continue_folds")
    controls = check_controls(step, max_step, max_points, tolerance)
    check_one_of(direction, (-1, 0, 1), what="direction", be="+1, -1, or 0 for both")
    check_progress(progress)
    problem, guess = layer_problem(system, two_free(system, parameter, free), start)
    box = check_bounds(bounds, problem)
    check_inside(problem, guess, box, "start")
    scales = natural_scales(problem, guess, box)
    u = _corrected_fold(problem, guess, scales, tolerance)
    check_inside(problem, u, box, "the fold next to start")
    return fold_curve(problem, u, Options(box, controls), scales, direction=direction, progress=progress)


def two_free(system: SlowFastSystem, parameter, free) -> tuple[sp.Symbol, sp.Symbol]:
    """The two free symbols that were asked for; raises `DeclarationError` when they are not two."""
    if free is None or isinstance(free, (str, sp.Symbol)):
        given = () if free is None else (free,)
    else:
        given = check_each(free, lambda variable: variable, what="free", be="two slow variables, or one")
    chosen = [find_symbol(system, s, system.x, "free") for s in given]
    if free is None and len(system.x) == (2 if parameter is None else 1):
        chosen = list(system.x)
    if parameter is not None:
        chosen.append(find_symbol(system, parameter, tuple(system.parameters), "parameter"))
    if len(chosen) != 2 or chosen[0] == chosen[1]:
        names = ", ".join(s.name for s in chosen) or "none"
        raise DeclarationError(
            "two different variables are free (free=, parameter=).",
            "Give free=(two slow ones), or one slow variable and parameter=...",
            got=f"{names}; the slow variables are {', '.join(s.name for s in system.x)}",
        )
    return chosen[0], chosen[1]


def fold_curve(
    problem: LayerProblem,
    u: np.ndarray,
    options: Options,
    scales: np.ndarray,
    *,
    direction: int = 0,
    progress: Callable[[float], None] | None = None,
) -> FoldCurve:
    """The curve of folds through the fold u (N,)."""
    with np.errstate(all="ignore"):
        tracer = PointTracer(
            singular_near(problem, identity, u, scales),
            scales=scales,
            bounds=box_of(problem, options.bounds),
            names=tuple(s.name for s in problem.unknowns),
            controls=options.controls,
            refresh=lambda _, u: singular_near(problem, identity, u, scales),
            progress=progress,
        )
        tangent = tracer.null_vector(u)
        if tangent is None:
            raise BranchError(
                "several curves of folds meet at start.", "Start beside that point.", got=problem.point(u)
            )
        tangent = oriented(tangent, 1e-6, direction)
        traces = traced(tracer, u, tangent, both=direction == 0, at_crossing=False)
        located = _special(problem, tracer, joined(traces), scales)
        # Told in the states' own units, as everything is.
        coefficient, skew = _tests(problem, located[0], scales, np.ones(len(scales)))
        eigenvalues = problem.eigenvalues(located[0])
    return curve_of(
        FoldCurve, problem, options, tracer, traces, located,
        coefficient=coefficient, skew=skew, eigenvalues=eigenvalues,
    )  # fmt: skip


def _corrected_fold(
    problem: LayerProblem, guess: np.ndarray, scales: np.ndarray, tolerance: float
) -> np.ndarray:
    found = None
    for first in (guess, None):
        try:
            u = corrected_start(problem, guess, scales, tolerance) if first is None else first
            found = least_norm_newton(singular_near(problem, identity, u, scales), u, scales, tolerance)
        except (np.linalg.LinAlgError, BranchError):
            continue
        if found is not None:
            # Once more with the best borders there are.
            found = least_norm_newton(singular_near(problem, identity, found, scales), found, scales, tolerance)
        if found is not None:
            return found
    values = ", ".join(f"{value:.3g}" for value in problem.eigenvalues(guess[None, :])[0])
    raise BranchError(
        "Newton's method found no fold near start.",
        "Give a point near one; continue_critical finds the folds on a curve.",
        got=f"{in_words(problem.point(guess))}, where g_y has the eigenvalues {values}",
    )


def _oriented(problem: LayerProblem, points: np.ndarray, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Null vectors (phi, psi), (m, n) each, of unit length in the fast variables' `scales` (n,), continuous in them."""
    phi, psi = map(np.array, zip(*(fold_vectors(problem, u, scales) for u in points)))
    phi, psi = phi / scales, psi * scales
    for vectors in (phi, psi):
        for i in range(1, len(vectors)):
            if vectors[i] @ vectors[i - 1] < 0.0:
                vectors[i] = -vectors[i]
    return phi * scales, psi / scales


def _tests(
    problem: LayerProblem, points: np.ndarray, scales: np.ndarray, units: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The fold coefficient and the skewness (m,), with continuous null vectors of unit length in `units` (N,)."""
    k = len(problem.free)
    phi, psi = _oriented(problem, points, scales[k:])
    phi = phi / np.linalg.norm(phi / units[k:], axis=1, keepdims=True)
    psi = psi / np.linalg.norm(psi * units[k:], axis=1, keepdims=True)
    second = np.array([problem.second(u)[:, k:, k:] for u in points])
    return 0.5 * np.einsum("mi,mijk,mj,mk->m", psi, second, phi, phi), np.einsum("mi,mi->m", psi, phi)


def _special(
    problem: LayerProblem, tracer: PointTracer, trace: CurveTrace, units: np.ndarray
) -> tuple[np.ndarray, tuple[SpecialPoint, ...], np.ndarray]:
    """The trace's points with cusps and Bogdanov-Takens points among them, these, and the arclength."""
    points, scales = np.array(trace.points), np.array(trace.scales)
    lengths = np.linalg.norm(np.diff(points, axis=0) / scales[1:], axis=1)
    found: list[tuple[float, SpecialPoint]] = []
    for kind, values in zip((LossKind.CUSP, LossKind.BOGDANOV_TAKENS), _tests(problem, points, units, units)):
        slopes = np.gradient(values, np.append(0.0, np.cumsum(lengths))) if len(lengths) else values
        for a, b in [*sign_changes(values), *touches(values, slopes, lengths)]:
            tracer.scales = scales[a]
            tracer.equations = singular_near(problem, identity, points[b], units)
            for u in _zeros(tracer, points[a : b + 1], _bordered_test(tracer.equations, kind)):
                if all(np.linalg.norm((u - point.unknowns) / scales[a]) > SAME_PLACE for _, point in found):
                    place = place_between(points, a, b, u, scales[a])
                    around = points[max(a - AROUND, 0) : b + AROUND + 1]
                    found.append((place, _described(problem, u, kind, scales[a], around)))
    tracer.scales = scales.max(axis=0)
    return inserted(points, scales, found)


def _zeros(tracer: PointTracer, rows: np.ndarray, test: Callable[[np.ndarray], float]) -> list[np.ndarray]:
    """Where `test` is zero between the first and the last of `rows` (m, N): it changes its sign, or touches."""
    first, last = rows[0], rows[-1]
    tracer.counters.located += 1
    if len(rows) == 1:
        return [first]
    ends = test(first), test(last)
    brackets = [(first, last)]
    if ends[0] * ends[1] > 0.0:
        u, least = least_between(tracer, rows, lambda us: np.array([test(u) for u in us]))
        if least >= 0.0:
            return [u] if least <= TOUCH * min(map(abs, ends)) else []
        brackets = [(first, u), (u, last)]
    return [u for low, high in brackets if (u := tracer.root(low, high, test)) is not None]


def _bordered_test(system, kind: LossKind) -> Callable[[np.ndarray], float]:
    """The test function along one step, with the bordered vectors, which are continuous."""
    assert isinstance(system, Singular)

    def test(u: np.ndarray) -> float:
        if kind is LossKind.CUSP:
            return fold_coefficient(system, u)
        try:
            null = system.null(u)
        except np.linalg.LinAlgError:
            return float("nan")
        return float(null.left @ null.right)

    return test


def _described(
    problem: LayerProblem, u: np.ndarray, kind: LossKind, scales: np.ndarray, points: np.ndarray
) -> SpecialPoint:
    """The point with its coefficients. It is what its test says, or degenerate."""
    if kind is LossKind.BOGDANOV_TAKENS:
        phi, psi = fold_vectors(problem, u, np.ones(problem.size))
        return special_point(problem, u, kind, right=phi, left=psi)
    bent, sizes = curvature(problem, points, scales), eigenvalue_sizes(problem.eigenvalues(points))
    return fold_point(problem, u, scales=scales, curvature=bent, sizes=sizes, is_flat=True)
