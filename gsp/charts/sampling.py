"""What charts read off an analysis: curves, grids and fields as arrays, ready to be drawn."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import cast

import numpy as np
import sympy as sp

from gsp.analysis.analysis import Analysis
from gsp.charts.continuity import are_joined
from gsp.errors import BranchError, DeclarationError, HyperbolicityError
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.scenes.view import TIME
from gsp.slow.series import best_sum
from gsp.slow.truncation import errors, past, units
from gsp.systems.arguments import check_noun
from gsp.systems.flow import Flow
from gsp.systems.system import SlowFastSystem

# Points of a line, and of a grid along each axis.
LINE, GRID = 400, 41


def shape(analysis: Analysis) -> tuple[int, int]:
    """Numbers of slow and of fast variables."""
    check_noun(analysis, Analysis, verb="charts.shape")
    return len(analysis.study.system.x), len(analysis.study.system.y)


def chart_symbols(analysis: Analysis) -> tuple[sp.Symbol, ...]:
    """The variables to read the slow motion in: raw ones where the series can be carried back to them."""
    return analysis.raw.chart if analysis.raw is not None else analysis.study.system.x


def dense_run(run: Trajectory) -> Trajectory:
    """The same run on its own steps and enough times between for a smooth line."""
    return run.sample(np.unique([*run.t, *np.linspace(run.t[0], run.t[-1], 3 * LINE)]))


def during(run: Trajectory, times: np.ndarray) -> Trajectory:
    """The run at those of `times` that it reached; on its own, where it ended before the first."""
    reached = times[(times >= run.t[0]) & (times <= run.t[-1])]
    return run.sample(reached) if reached.size else run


def reading(analysis: Analysis, run: Trajectory, name: str) -> np.ndarray:
    """Values (m,) of a variable along a run, also of a slow coordinate along a run in raw variables."""
    splitting = analysis.study.splitting
    known = {s.name for s in (*run.flow.states, *run.flow.observables)}
    coordinates = {} if splitting is None else {s.name: e for s, e in splitting.coordinates.items()}
    if name in known or name not in coordinates:
        return run[name]
    assert splitting is not None
    states = splitting.field.states
    points = np.stack([run[s.name] for s in states], axis=1)
    return evaluate([coordinates[name]], analysis.scene.system, run.epsilon or 0.0, points, states)[:, 0]


def along(
    run: Trajectory, name: str, read: Callable[[Trajectory, str], np.ndarray] | None = None
) -> np.ndarray:
    """Values (m,) of a quantity along a run as `read` finds it; its times for t, unless the flow has a t of its own."""
    is_time = name == TIME and all(s.name != TIME for s in (*run.flow.states, *run.flow.observables))
    return run.t if is_time else run[name] if read is None else read(run, name)


def evaluate(
    outputs: Sequence[sp.Expr], flow: Flow, epsilon: float | None, points: np.ndarray, arguments=None
) -> np.ndarray:
    """Values (m, outputs) of expressions in `arguments`, by default the flow's states, at `points` (m, n).

    Of what does not depend on it no `epsilon` is given.
    """
    function = compile_over(flow, tuple(outputs), arguments=tuple(arguments or flow.states))
    return function(
        points, compile_flow(flow).constants if epsilon is None else parameter_vector(flow, epsilon)
    )


def at_zero(expression: sp.Expr, system: SlowFastSystem) -> sp.Expr:
    """The expression at epsilon = 0."""
    return cast(sp.Expr, expression.xreplace({system.epsilon: sp.Integer(0)}))


def mesh(low: np.ndarray, high: np.ndarray, n: int = GRID) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Grid of a rectangle: both axes (n,), and its points (n^2, 2), the first variable running fastest."""
    u, v = np.linspace(low[0], high[0], n), np.linspace(low[1], high[1], n)
    return u, v, np.stack([a.ravel() for a in np.meshgrid(u, v)], axis=1)


def widened(low, high, share: float = 0.05):
    """An interval, or arrays of them, with a margin on both sides."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    margin = share * np.where(high > low, high - low, 1.0)
    return low - margin, high + margin


def margins(values: np.ndarray, share: float = 0.05) -> tuple[float, float]:
    """Limits of an axis that holds `values`, where they are finite."""
    low, high = widened(np.nanmin(values), np.nanmax(values), share)
    return float(low), float(high)


def frame(
    analysis: Analysis, names: Sequence[str], runs: Sequence[Trajectory]
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (n,) of the region's box in the variables `names`, widened to hold the runs, within reason."""
    low, high = [], []
    for name in names:
        interval = analysis.scene.region.get(name) or analysis.study.region.get(name)
        values = np.concatenate([run[name] for run in runs]) if runs else np.empty(0)
        if interval is None:
            interval = tuple(map(float, widened(values.min(), values.max())))
        # Runs leave the region in a picture by its width at most.
        width = interval[1] - interval[0]
        low.append(min(interval[0], max(values.min(initial=np.inf), interval[0] - width)))
        high.append(max(interval[1], min(values.max(initial=-np.inf), interval[1] + width)))
    return np.array(low), np.array(high)


def box_points(analysis: Analysis, n: int) -> np.ndarray:
    """Grid points (n^d, d) of the region in the d slow variables, the last one running fastest."""
    system = analysis.study.system
    axes = [np.linspace(*analysis.study.region[s.name], n) for s in system.x]
    return np.stack([a.ravel() for a in np.meshgrid(*axes, indexing="ij")], axis=1)


def on_branch(analysis: Analysis, x: np.ndarray) -> np.ndarray:
    """Fast coordinates (m, n_fast) of the critical manifold over `x` (m, n_slow); nan where there are none."""
    branch = analysis.study.branch
    if branch.seed is not None and not branch.is_explicit:
        return branch.follow(x)[0]
    try:
        return branch.points(x)
    except BranchError:
        return np.array([_or_nan(branch, point) for point in x])


def _or_nan(branch, point: np.ndarray) -> np.ndarray:
    try:
        return branch.points(point[None, :])[0]
    except BranchError:
        return np.full(len(branch.system.y), np.nan)


def slow_manifold(analysis: Analysis, x: np.ndarray) -> np.ndarray:
    """h_epsilon (m, n_fast) at the scene's epsilon over `x` (m, n_slow), each point at its own optimal order.

    nan where the branch is not reached, where the terms do not fall, and where what is left out is visible.
    """
    epsilon, series = analysis.scene.epsilon, analysis.short_series
    leading = on_branch(analysis, x)
    good = np.isfinite(leading).all(axis=1)
    result = np.full(leading.shape, np.nan)
    if not good.any():
        return result
    sums, orders, left_out = best_sum(series, x[good], epsilon, near=leading[good])
    size = np.abs(leading[good]).max() or 1.0
    # The slow manifold is drawn where its estimated error is below this share of its size.
    drawn = (left_out <= 0.05 * size) & ((orders > 0) | (series.order == 0))
    result[good] = np.where(drawn[:, None], sums, np.nan)
    return result


def slow_curve(analysis: Analysis) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 1 + n_fast) of the slow manifold over the region of the one slow variable, and M0 there (m, n_fast).

    A row of nan stands where M0 does not go on from one point to the next.
    """
    x = np.linspace(*analysis.study.region[analysis.study.system.x[0].name], LINE)[:, None]
    on, leading = np.hstack([x, slow_manifold(analysis, x)]), on_branch(analysis, x)
    low, high = fast_range(analysis, on)
    joined = np.all(
        [
            are_joined(lambda at, i=i: on_branch(analysis, at)[:, i], x[:-1], x[1:], seen=(high - low) / LINE)
            for i in range(leading.shape[1])
        ],
        axis=0,
    )
    breaks = np.flatnonzero(~joined) + 1
    return np.insert(on, breaks, np.nan, axis=0), np.insert(leading, breaks, np.nan, axis=0)


def slow_ends(analysis: Analysis) -> tuple[bool, list[float]]:
    """(whether any of the slow manifold over one slow variable is drawn, the values of it at which its terms stop
    falling)."""
    check_noun(analysis, Analysis, verb="charts.slow_ends")
    on, leading = slow_curve(analysis)
    return bool(np.isfinite(on[:, 1]).any()), [float(value) for value in on[ends_of(on, leading), 0]]


def ends_of(on: np.ndarray, leading: np.ndarray) -> np.ndarray:
    """Rows of the curve `on` (m, n) next to points where it is left out though the branch `leading` (m, k) is there."""
    there = np.isfinite(on).all(axis=1)
    left_out = ~there & np.isfinite(leading).all(axis=1)
    beside = np.zeros(len(on), dtype=bool)
    beside[1:] |= left_out[:-1]  # pyright: ignore[reportIndexIssue]
    beside[:-1] |= left_out[1:]  # pyright: ignore[reportIndexIssue]
    return np.flatnonzero(there & beside)


def fast_range(analysis: Analysis, on: np.ndarray) -> tuple[float, float]:
    """The region's interval of the first fast variable, or what the manifold and the landing runs need."""
    name = analysis.study.system.y[0].name
    if name in analysis.study.region:
        return analysis.study.region[name]
    values = np.concatenate([on[:, 1], analysis.full[name][:1], *(run[name] for run in analysis.landing)])
    return float(np.nanmin(values)), float(np.nanmax(values))


def graph(analysis: Analysis, points: np.ndarray) -> np.ndarray:
    """Height (m,) of the slow manifold, in its one fast variable, over `points` (m, 2) of the chart."""
    raw, system = analysis.raw, analysis.study.system
    fast = system.y[0]
    if raw is None or set(raw.chart) == set(system.x):
        order = [chart_symbols(analysis).index(s) for s in system.x]
        return slow_manifold(analysis, points[:, order])[:, 0]
    epsilon = analysis.scene.epsilon
    terms = evaluate([row[fast] for row in raw.coefficients], system, epsilon, points, raw.chart)
    terms = terms * epsilon ** np.arange(raw.order + 1)
    estimates = errors(np.abs(terms), raw.order, unit=units(points))
    return np.where(past(estimates), np.nan, terms.sum(axis=1))


def limit_field(analysis: Analysis, points: np.ndarray) -> np.ndarray:
    """The reduced field of order 0 (m, 2) at `points` (m, 2) of the chart; nan where there is none."""
    raw, system, epsilon = analysis.raw, analysis.study.system, analysis.scene.epsilon
    if raw is not None and set(raw.chart) != set(system.x):
        return evaluate(raw.reduced_field[0], system, epsilon, points, raw.chart)
    symbols = chart_symbols(analysis)
    x = points[:, [symbols.index(s) for s in system.x]]
    f = [at_zero(rate, system) for rate in system.slow.values()]
    rates = evaluate(f, system, epsilon, np.hstack([x, on_branch(analysis, x)]))
    return rates[:, [system.x.index(s) for s in symbols]]


def distances(analysis: Analysis, run: Trajectory) -> np.ndarray:
    """|y - h_epsilon(x)| (m,) along a run of the standard form, up to where the slow manifold is not known."""
    slow, _ = shape(analysis)
    x, y = run.y[:slow].T, run.y[slow:].T
    try:
        on = slow_manifold(analysis, x)
    except (BranchError, HyperbolicityError):
        return np.empty(0)
    found = np.linalg.norm(y - on, axis=1)
    return found[: np.isfinite(found).cumprod().sum()]


def path_names(analysis: Analysis) -> tuple[str, str]:
    """The two quantities of the path; raises `DeclarationError` for a scene without one."""
    if analysis.scene.path is None:
        raise DeclarationError(
            f"the scene {analysis.scene.name or 'given'} draws no path.",
            'Declare Scene(..., path=("x", "y")), or draw time_series.',
            got="path=None",
        )
    return analysis.scene.path


def heading_of(analysis: Analysis) -> str | None:
    """The angle whose sine and cosine drive the path, when there is exactly one."""
    check_noun(analysis, Analysis, verb="charts.heading_of")
    rates = {symbol.name: rate for symbol, rate in analysis.scene.reconstruction.items()}
    angles = {
        function.args[0]
        for name in path_names(analysis)
        if name in rates
        for function in rates[name].atoms(sp.sin, sp.cos)
    }
    only = angles.pop() if len(angles) == 1 else None
    return only.name if isinstance(only, sp.Symbol) and only.name in rates else None


def even_places(x: np.ndarray, y: np.ndarray, count: int) -> np.ndarray:
    """Indices of `count` points at equal distances along a path."""
    along = np.concatenate([[0.0], np.hypot(np.diff(x), np.diff(y)).cumsum()])
    return np.searchsorted(along, np.linspace(0.0, along[-1], count)).clip(0, len(x) - 1)
