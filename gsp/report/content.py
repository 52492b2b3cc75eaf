"""What report.json holds: an `Analysis` in plain values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from gsp import charts
from gsp.analysis import Analysis
from gsp.choice import Choice
from gsp.hyperbolicity import Hyperbolicity
from gsp.losses import Loss
from gsp.trajectory import Trajectory


def as_json(analysis: Analysis) -> dict[str, Any]:
    """What report.json holds, apart from what writing it adds: plain values only, nan and infinity as None."""
    scene, placement, series = analysis.scene, analysis.placement, analysis.shown
    system, splitting = placement.system, placement.splitting
    coordinates = splitting.coordinates if splitting else {s: s for s in system.states}
    content = {
        "name": scene.name,
        "title": scene.title,
        "source": scene.source,
        "description": scene.description,
        "slow": [x.name for x in system.x],
        "fast": [y.name for y in system.y],
        "coordinates": {s.name: str(e) for s, e in coordinates.items()},
        "h": [[str(e) for e in row] for row in series.coefficients],
        "reduced_field": [[str(e) for e in row] for row in series.reduced_field],
        "series": {
            "order": analysis.series.order,
            "terms": list(analysis.series.sizes),
            "shown_through": series.order,
            "parameters": "symbolic" if series is analysis.series else "values",
        },
        "raw": _raw(analysis),
        "hyperbolicity": hyperbolicity_as_json(analysis.hyperbolicity, epsilon=scene.epsilon),
        "comparison": _comparison(analysis),
        "choice": choice_as_json(analysis.choice),
        "parameters": {s.name: float(value) for s, value in system.parameters.items()},
        "epsilon": scene.epsilon,
        "tolerance": scene.tolerance,
        "span": list(scene.span),
        "start": dict(scene.full_start),
        "base_point": None if analysis.base is None else dict(analysis.base),
        "region": {name: list(interval) for name, interval in scene.region.items()},
        "stats": {name: _stats(getattr(analysis, name)) for name in ("full", "limit", "reduced")},
        "timings": {**analysis.timings, "total": sum(analysis.timings.values())},
        "versions": dict(analysis.versions),
        "figures": [f"{name}.png" for name in charts.applicable(analysis)],
    }
    return plain(content)


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
    }
    return plain(content)


def choice_as_json(choice: Choice) -> dict[str, Any]:
    """A choice in plain values: what is run, why, the candidates, and predicted against measured."""
    content = {
        "model": choice.model.label,
        "reason": choice.reason,
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


def _stats(run: Trajectory) -> dict[str, Any]:
    return {**asdict(run.stats), "method": run.stats.method.value, "status": run.status.name}


def plain(value: Any) -> Any:
    """Strict JSON: text keys, lists, Python numbers, None for nan and infinity."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if value is None or isinstance(value, (str, bool, int)):
        return value
    number = float(value)
    return number if math.isfinite(number) else None
