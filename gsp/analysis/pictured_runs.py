"""Runs worth looking at: on the way down in epsilon, off the slow manifold and onto it, and through the folds."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from gsp.analysis.fold_surroundings import Boundary
from gsp.comparison.compared_runs import on_manifold
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind
from gsp.integration.spread_times import spread_times
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.results.attempts import Missing, made
from gsp.scenes.study import RTOL, Study
from gsp.singular.mixed_modes import MixedMode, mixed_mode
from gsp.slow.series import SeriesManifold
from gsp.systems.flow import Flow, Point
from gsp.systems.tolerances import absolute_tolerance

# A run that has swung over the folds so often shows the whole phenomenon.
SWINGS = 3


def ladder_of(study: Study) -> Mapping[float, Trajectory]:
    """Full runs at the pictured epsilons."""
    # Epsilons of the pictures, as multiples of the scene's: a ladder that an eye can tell apart.
    epsilons = [multiple * study.scene.epsilon for multiple in (2.0, 1.0, 0.4)]
    return MappingProxyType({e: study.full(e) for e in epsilons})


def phenomenon_of(study: Study, ends: Boundary | Missing) -> Trajectory | MixedMode | None:
    """What the full system does beyond the folds: a run that swings over them `SWINGS` times, or None."""
    if isinstance(ends, Missing) or not ends.has_folds:
        return None
    scene, system = study.scene, study.system
    name = system.y[0].name
    t0, t1 = scene.span
    # The whole phenomenon: spans tried, as multiples of the scene's, until a run has swung over the folds so often.
    for longer in (4.0, 16.0, 64.0, 256.0):
        end = t0 + longer * (t1 - t0)
        run = _picture(study, system, study.start, end)
        if not run.status.ok:
            return None
        if _swings(run[name]) < SWINGS:
            continue
        if len(system.x) == 1:
            return run
        return mixed_mode(system, name, start=study.start, span=(t0, end), epsilon=scene.epsilon)
    return None


def _swings(values: np.ndarray) -> int:
    """How often `values` rise from the lowest to the highest quarter of their range."""
    low, high = float(values.min()), float(values.max())
    sides = np.sign(values[np.abs(values - 0.5 * (low + high)) > 0.25 * (high - low)] - 0.5 * (low + high))
    return int((np.diff(sides) > 0).sum())


def reduced_run(study: Study, order: int, start: Point) -> Trajectory:
    """The run of the reduced flow of that order over the scene's span."""
    return _picture(study, study.reduced(order), start, study.scene.span[1])


def _picture(study: Study, flow: Flow, start: Point, end: float) -> Trajectory:
    span, epsilon = (study.scene.span[0], end), study.scene.epsilon
    atol = absolute_tolerance(RTOL, study.region, study.start)
    return trajectory_of(flow, start=start, span=span, epsilon=epsilon, rtol=RTOL, atol=atol)


def _last_inside(study: Study, limit: Trajectory) -> float:
    """The time at which a run leaves the region of the slow variables first, where it may begin beside that."""
    times = spread_times(limit, limit.t[0], limit.t[-1], 400)
    run = limit.sample(times)
    sides = [(run[s.name], *study.region[s.name]) for s in study.system.x]
    inside = np.all([(low <= values) & (values <= high) for values, low, high in sides], axis=0)
    leaves = inside[:-1] & ~inside[1:]
    return float(times[np.argmax(leaves)] if leaves.any() else times[-1])


def landing_runs(
    study: Study,
    series: SeriesManifold | Missing,
    hyperbolicity: Hyperbolicity,
    limit: Trajectory | Missing,
) -> tuple[Trajectory, ...]:
    """Runs of the standard form that start off M_epsilon in each fast direction, through the layer and beyond."""
    if hyperbolicity.kind is not Kind.ATTRACTING:
        return ()
    scene, series, limit = study.scene, study.short_series(made(series).order), made(limit)
    t0, t1 = scene.span
    layer = 12.0 * scene.epsilon / hyperbolicity.gap
    # Each is followed for so many layer times epsilon/gap, or a share of the span.
    end = t0 + min(t1 - t0, max(layer, 0.3 * (t1 - t0)))
    runs = []
    last = _last_inside(study, limit)
    begun = limit.sample(limit.t[:1])
    # Where nothing bounds a fast variable: as far off as the start is, or as the limit run moves in it.
    lengths = [
        max(abs(study.start[y.name] - float(begun[y.name][0])), float(np.ptp(limit[y.name]))) or 1.0
        for y in study.system.y
    ]
    # Over which points of the limit run within the region (as shares of its time there), and how far off (as shares of
    # the fast variable's range).
    for share, offsets in {0.0: (-1.0, -0.5, 0.5, 1.0), 0.35: (-1.0, 1.0), 0.7: (-1.0, 1.0)}.items():
        there = limit.sample(limit.t[0] + share * (last - limit.t[0]))
        x = {s.name: float(there[s.name][0]) for s in study.system.x}
        on = on_manifold(series, {**study.start, **x}, scene.epsilon)
        for y, off in zip(study.system.y, lengths):
            low, high = study.region.get(y.name, (on[y.name] - off, on[y.name] + off))
            for offset in offsets:
                distance = (high if offset > 0 else low) - on[y.name]
                start = {**on, y.name: on[y.name] + abs(offset) * distance}
                runs.append(_picture(study, study.system, start, end))
    return tuple(run for run in runs if run.status.ok and np.isfinite(run.y).all())
