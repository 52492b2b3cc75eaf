"""What report.json holds: an `Analysis` in plain values."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from gsp import charts
from gsp.analysis.analysis import Analysis
from gsp.analysis.fold_surroundings import FoldBeyond
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity
from gsp.integration.trajectory import Trajectory
from gsp.report.contacts import no_slip_as_json
from gsp.report.ramps import ramps_as_json
from gsp.results.attempts import Missing, attempt
from gsp.results.plain import plain
from gsp.systems.system import SlowFastSystem


def as_json(analysis: Analysis) -> dict[str, Any]:
    """What report.json holds, apart from what writing it adds: plain values only, nan and infinity as None.

    What could not be made is None, and `missing` maps its name to the reason.
    """
    scene, study = analysis.scene, analysis.study
    system, splitting = study.system, study.splitting
    coordinates = splitting.coordinates if splitting else {s: s for s in system.states}
    parts: dict[str, Callable[[], Any]] = {
        "name": lambda: scene.name,
        "title": lambda: scene.title,
        "source": lambda: scene.source,
        "description": lambda: scene.description,
        "slow": lambda: [x.name for x in system.x],
        "fast": lambda: [y.name for y in system.y],
        "coordinates": lambda: {s.name: str(e) for s, e in coordinates.items()},
        "equations": lambda: _equations(analysis),
        "h": lambda: [[str(e) for e in row] for row in analysis.shown.coefficients],
        "reduced_field": lambda: [[str(e) for e in row] for row in analysis.shown.reduced_field],
        "series": lambda: {
            "order": analysis.series.order,
            "terms": list(analysis.series.sizes),
            "run_through": analysis.short_series.order,
            "shown_through": analysis.shown.order,
            "cut": analysis.cut,
            "parameters": "symbolic" if analysis.shown is analysis.series else "values",
        },
        "slow_manifold_ends": lambda: charts.slow_ends(analysis)[1] if len(system.x) == 1 else [],
        "raw": lambda: _raw(analysis),
        "hyperbolicity": lambda: hyperbolicity_as_json(analysis.hyperbolicity, epsilon=scene.epsilon),
        "comparison": lambda: analysis.comparison.as_json(),
        "choice": lambda: analysis.choice.as_json(),
        "no_slip": lambda: no_slip_as_json(analysis),
        "ramps": lambda: ramps_as_json(scene),
        "failures": lambda: _failures(analysis),
        "boundary": lambda: _boundary(analysis),
        "parameters": lambda: {s.name: float(value) for s, value in system.parameters.items()},
        "epsilon": lambda: scene.epsilon,
        "tolerance": lambda: scene.tolerance,
        "span": lambda: list(scene.span),
        "span_in_fast_time": lambda: None if analysis.study.given is None else list(analysis.study.given.span),
        "start": lambda: dict(scene.full_start),
        "base_point": lambda: None if analysis.base is None else dict(analysis.base),
        "region": lambda: {name: list(interval) for name, interval in scene.region.items()},
        "stats": lambda: {name: _stats(analysis, name) for name in ("full", "limit", "reduced")},
        "timings": lambda: {**analysis.timings, "total": sum(analysis.timings.values())},
        "versions": lambda: dict(analysis.versions),
        "figures": lambda: [f"{name}.png" for name in charts.applicable(analysis)],
    }
    # Strict JSON of each part by itself: what cannot be made costs that part.
    content = {name: attempt(name, lambda make=make: plain(make())) for name, make in parts.items()}
    missing = {name: part.reason for name, part in content.items() if isinstance(part, Missing)}
    return {**content, **dict.fromkeys(missing), "missing": {**analysis.lost, **missing}}


def _equations(analysis: Analysis) -> dict[str, Any]:
    """The equations as they were given, the standard form, and the exact values of the parameters."""
    given, system = analysis.scene.system, analysis.study.system
    rates = (
        {**given.slow, **given.fast} if isinstance(given, SlowFastSystem) else zip(given.states, given.rates)
    )
    return {
        "given": {s.name: str(rate) for s, rate in dict(rates).items()},
        "slow": {s.name: str(rate) for s, rate in system.slow.items()},
        "fast": {s.name: str(rate) for s, rate in system.fast.items()},
        "reconstruction": {s.name: str(rate) for s, rate in analysis.scene.reconstruction.items()},
        "parameters": {s.name: str(value) for s, value in system.parameters.items()},
    }


def _raw(analysis: Analysis) -> dict[str, Any] | None:
    raw = analysis.raw
    if raw is None:
        return None
    return {
        "chart": [s.name for s in raw.chart],
        "coefficients": [{s.name: str(e) for s, e in row.as_dict().items()} for row in raw.coefficients],
        "reduced_field": [[str(e) for e in row] for row in raw.reduced_field],
    }


def hyperbolicity_as_json(found: Hyperbolicity, *, epsilon: float | None = None) -> dict[str, Any]:
    """A verdict in plain values; with `epsilon` its rates hold the r of r-normal hyperbolicity there."""
    names = (
        "kind",
        "gap",
        "sampled_gap",
        "conditions",
        "losses",
        "looked_at",
        "notes",
        "evidence",
        "exclusion",
    )
    content = {name: getattr(found, name) for name in names} | {
        "rates": plain(found.rates) | {"r": None if epsilon is None else found.rates.r(epsilon)},
        "holds_for": None if found.sub_region is None else found.sub_region.region,
        "certificate": None if found.certificate is None else found.certificate.as_dict(),
    }
    return plain(content)


def _failures(analysis: Analysis) -> dict[str, Any]:
    found = analysis.failures
    if found is None:
        return {"reason": analysis.failures_reason}
    between = analysis.study.region[found.axis]
    return found.as_json() | {"holds_up_to": {n: found.holds_up_to(n, between=between) for n in found.orders}}


def _boundary(analysis: Analysis) -> dict[str, Any]:
    found, epsilon = analysis.boundary, analysis.scene.epsilon
    return {
        "folds": [_fold(fold, epsilon) for fold in found.folds],
        "folded_singularities": [point.as_dict() for point in found.folded],
        "folded_reason": found.folded_reason,
        "orbit": None
        if found.orbit is None
        else {
            "message": found.orbit.message,
            "drops_per_period": found.orbit.period_pieces,
            "period_coefficients": found.period,
            "period": None if found.period is None else found.orbit.period(epsilon),
        },
        "orbit_reason": found.orbit_reason,
        "cycle": None if found.cycle is None else found.cycle.as_dict(),
        "proved_passage": None if found.passage is None else found.passage.as_dict(),
    }


def _fold(fold: FoldBeyond, epsilon: float) -> dict[str, Any]:
    passage, canard = fold.passage, fold.canard
    return {
        "point": fold.point,
        "reason": fold.reason,
        "passage": None
        if passage is None
        else {**passage.as_json(), "delay": passage.delay(epsilon), "exit": passage.exit(epsilon)},
        "canard": None
        if canard is None
        else {"parameter": canard.parameter.name, "coefficients": [str(c) for c in canard.coefficients]},
    }


def _stats(analysis: Analysis, name: str) -> dict[str, Any] | None:
    if name in analysis.lost:
        return None
    run: Trajectory = getattr(analysis, name)
    return {**plain(run.stats), "status": run.status.name}
