"""What report.json holds: an `Analysis` in plain values."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import sympy as sp

from gsp import charts
from gsp.analysis.analysis import Analysis
from gsp.analysis.fold_surroundings import FoldBeyond
from gsp.choice.choice import Choice
from gsp.comparison.survey import Claim
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity
from gsp.hyperbolicity.losses.kinds import Loss
from gsp.integration.trajectory import Trajectory
from gsp.results.attempts import Missing, attempt
from gsp.results.plain import plain


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
        "raw": lambda: _raw(analysis),
        "hyperbolicity": lambda: hyperbolicity_as_json(analysis.hyperbolicity, epsilon=scene.epsilon),
        "comparison": lambda: _comparison(analysis),
        "choice": lambda: choice_as_json(analysis.choice),
        "failures": lambda: _failures(analysis),
        "boundary": lambda: _boundary(analysis),
        "parameters": lambda: {s.name: float(value) for s, value in system.parameters.items()},
        "epsilon": lambda: scene.epsilon,
        "tolerance": lambda: scene.tolerance,
        "span": lambda: list(scene.span),
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
    content = {
        "kind": str(found.kind),
        "gap": found.gap,
        "rates": {
            "normal": found.rates.normal,
            "tangential": found.rates.tangential,
            "r": None if epsilon is None else found.rates.r(epsilon),
        },
        "conditions": [
            {
                "name": condition.name,
                "statement": condition.statement,
                "value": condition.value,
                "requirement": condition.requirement,
                "holds": condition.holds,
            }
            for condition in found.conditions
        ],
        "losses": [_loss(loss) for loss in found.losses],
        "looked_at": [_loss(loss) for loss in found.looked_at],
        "notes": list(found.notes),
        "holds_for": None if found.sub_region is None else dict(found.sub_region.region),
        "evidence": found.evidence,
        "exclusion": None
        if found.exclusion is None
        else {
            "boxes": found.exclusion.tried,
            "left": list(found.exclusion.left),
            "share": found.exclusion.share,
            "reason": found.exclusion.reason,
        },
        "certificate": None if found.certificate is None else found.certificate.as_dict(),
    }
    return plain(content)


def choice_as_json(choice: Choice) -> dict[str, Any]:
    """A choice in plain values: what is run, why, the candidates, and predicted against measured."""
    content = {
        "model": choice.model.label,
        "verdict": {
            "answer": str(choice.verdict.answer),
            "accuracy": choice.verdict.accuracy,
            "speed": choice.verdict.speed,
            "remedy": choice.verdict.remedy,
        },
        "reason": choice.reason,
        "ending": choice.ending,
        "epsilon": choice.epsilon,
        "tolerance": choice.tolerance,
        "quantities": choice.names,
        "candidates": choice.as_rows(),
        "partial": None if choice.partial is None else choice.partial.label,
        "layer": choice.layer,
        "piece": choice.piece,
        "predicted": choice.predicted,
        "predicted_on_piece": choice.predicted_on_piece,
        "measured": choice.measured,
        "speed_up": choice.speed_up,
        "fast_error": choice.fast_error,
        "layer_error": choice.layer_error,
        "fast_measured": choice.fast_measured,
    }
    return plain(content)


def _loss(loss: Loss) -> dict[str, Any]:
    return {
        "kind": str(loss.kind),
        "point": dict(loss.point),
        "eigenvalue": [loss.eigenvalue.real, loss.eigenvalue.imag],
        "crossing": loss.crossing,
        "test": {"name": loss.test, "value": loss.value},
        "coefficients": dict(loss.coefficients),
        "consequence": loss.consequence,
        "may_reduce": loss.may_reduce,
        "remedy": loss.remedy,
        "note": loss.note,
        "samples": loss.samples,
        "extent": {name: list(interval) for name, interval in loss.extent.items()},
        "on_edge": loss.on_edge,
    }


def _comparison(analysis: Analysis) -> dict[str, Any]:
    found = analysis.comparison
    return {
        "epsilons": found.epsilons,
        "errors": found.errors,
        "slopes": found.slopes,
        "expected": found.expected,
        "exact": {order: found.is_exact(order) for order in found.errors},
        "floor": found.floor,
        "claims": found.claims,
        "claim_slopes": found.claim_slopes,
    }


def _failures(analysis: Analysis) -> dict[str, Any]:
    found = analysis.failures
    if found is None:
        return {"reason": analysis.failures_reason}
    between = analysis.study.region[found.axis]
    return {
        "axis": found.axis,
        "epsilons": found.epsilons,
        "positions": found.positions,
        "tolerances": found.tolerances,
        "tolerance": found.tolerance,
        "orders": found.orders,
        "least_order": found.least_order,
        "least_order_demanded": found.least_order_demanded,
        "holds": {**_holding(found.places), "over_span": _holding(found.demands)},
        "holds_up_to": {n: found.holds_up_to(n, between=between) for n in found.orders},
        "holds_over_span": {n: found.holds_over_span(n) for n in found.orders},
        "runs": found.runs,
    }


def _holding(claims: Mapping[str, Claim]) -> dict[str, float]:
    return {name: claim.share for name, claim in claims.items()}


def _boundary(analysis: Analysis) -> dict[str, Any]:
    found, epsilon = analysis.boundary, analysis.scene.epsilon
    return {
        "folds": [_fold(fold, epsilon) for fold in found.folds],
        "folded_singularities": [
            {
                "kind": str(point.kind),
                "point": point.point,
                "eigenvalues": [[float(sp.re(v)), float(sp.im(v))] for v in point.eigenvalues],
                "mu": point.mu,
                "s_max": point.s_max,
                "secondary_canards": point.secondary_canards,
                "to_repelling": point.to_repelling,
                "reason": point.reason,
            }
            for point in found.folded
        ],
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
    }


def _fold(fold: FoldBeyond, epsilon: float) -> dict[str, Any]:
    passage, canard = fold.passage, fold.canard
    return {
        "point": fold.point,
        "reason": fold.reason,
        "passage": None
        if passage is None
        else {
            "a": passage.a,
            "b": passage.b,
            "leading": passage.leading,
            "logarithmic": passage.logarithmic,
            "delay": passage.delay(epsilon),
            "exit": passage.exit(epsilon),
            "drop": {"kind": str(passage.drop.kind), "point": passage.drop.point},
        },
        "canard": None
        if canard is None
        else {"parameter": canard.parameter.name, "coefficients": [str(c) for c in canard.coefficients]},
    }


def _stats(analysis: Analysis, name: str) -> dict[str, Any] | None:
    if name in analysis.lost:
        return None
    run: Trajectory = getattr(analysis, name)
    return {**asdict(run.stats), "method": run.stats.method.value, "status": run.status.name}
