"""The section of a page on where the reduction ends: the failure map, folds and what follows, the singular orbit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import sympy as sp
from markupsafe import Markup

from gsp.analysis.analysis import Analysis
from gsp.analysis.fold_surroundings import FoldBeyond
from gsp.comparison.failure_map import FailureMap
from gsp.comparison.survey import HORIZON
from gsp.report.wording import number, words
from gsp.results.mathml import Typesetter
from gsp.singular.singularities.folded_singularities import FoldedSingularity


def reduction_limits(analysis: Analysis, setter: Typesetter) -> dict[str, Any]:
    """Values of the section for the template; tables are empty and sentences None where there is nothing to say."""
    found = analysis.boundary
    return {
        "folds": [_fold(fold, analysis, setter) for fold in found.folds],
        "passes": any(fold.passage is not None for fold in found.folds),
        "folded": [_folded(point, setter) for point in found.folded],
        "folded_reason": words(found.folded_reason.fact),
        "orbit": _orbit(analysis, setter),
    }


def failures(analysis: Analysis, setter: Typesetter) -> dict[str, Any]:
    """What is read off the failure map, or why there is none."""
    return {
        "map": None if analysis.failures is None else _map(analysis, analysis.failures, setter),
        "no_map": words(analysis.failures_reason.fact),
    }


def _map(analysis: Analysis, found: FailureMap, setter: Typesetter) -> Markup:
    """One sentence read off the failure map."""
    between = analysis.study.region[found.axis]
    epsilon = setter.inline(analysis.study.system.epsilon)
    here = [found.holds_up_to(n, between=between) for n in found.orders]
    span = [found.holds_over_span(n) for n in found.orders]
    return Markup(
        "The largest {} up to which the reduced flow meets the tolerance of {}: for runs of {} of the span that begin "
        "anywhere in the region's interval of {}, {}; for the run over the whole span from the start, {}. "
        "The map covers {} = {} to {}."
    ).format(
        epsilon,
        number(found.tolerance),
        f"{100.0 * HORIZON:g}\u00a0%",
        setter.inline(sp.Symbol(found.axis)),
        _listed_orders(found, here),
        _listed_orders(found, span),
        epsilon,
        number(float(found.epsilons[0])),
        number(float(found.epsilons[-1])),
    )


def _listed_orders(found: FailureMap, largest: Sequence[float]) -> Markup:
    values = [
        Markup("none")
        if value == 0.0
        else Markup("all of the map")
        if value == found.epsilons[-1]
        else number(value, 2)
        for value in largest
    ]
    if len(set(values)) == 1:
        return Markup("{} at any of the orders {}").format(values[0], ", ".join(map(str, found.orders)))
    return Markup(", ").join(Markup("{} at order {}").format(*pair) for pair in zip(values, found.orders))


def _place(point: Mapping[str, Any], setter: Typesetter) -> Markup:
    return Markup(", ").join(
        Markup('<span class="whole">{} = {}</span>').format(
            setter.inline(sp.Symbol(name)), number(float(value), 5)
        )
        for name, value in point.items()
    )


def _fold(fold: FoldBeyond, analysis: Analysis, setter: Typesetter) -> dict[str, Any]:
    """A row: the fold, and its passage at the scene's epsilon or the reason why there is none."""
    small, system = analysis.scene.epsilon, analysis.study.system
    row: dict[str, Any] = {
        "place": _place(fold.point, setter),
        "passage": None,
        "reason": words(fold.reason.fact),
        "canard": None,
    }
    if fold.passage is not None:
        drop = fold.passage.drop
        fast = {y.name: drop.point[y.name] for y in system.y}
        row["passage"] = {
            "delay": fold.passage.delay(small),
            "exit": _place(fold.passage.exit(small), setter),
            "drop": _place(fast, setter) if drop.lands else str(drop.kind),
        }
    if fold.canard is not None:
        series = setter.power_series(fold.canard.coefficients, system.epsilon)
        row["canard"] = setter.inline(setter.equation(setter.row(fold.canard.parameter), series))
    return row


def _folded(point: FoldedSingularity, setter: Typesetter) -> dict[str, Any]:
    mu = "" if point.mu is None else number(float(point.mu), 4)
    return {
        "kind": str(point.kind),
        "place": _place(point.point, setter),
        "mu": mu,
        "secondary": point.secondary_canards if point.kind.has_canards else "",
        "reason": words(point.reason),
    }


def _orbit(analysis: Analysis, setter: Typesetter) -> dict[str, Any] | None:
    """The singular orbit in a sentence, and its period as an equation when it closes."""
    found, small = analysis.boundary, analysis.scene.epsilon
    if not found.has_folds:
        return None
    if found.orbit is None:
        reason = words(found.orbit_reason.fact)
        return {
            "sentence": Markup("There is no singular orbit from the start: {}.").format(reason),
            "period": None,
        }
    if found.period is None:
        reason = words(found.orbit.message.fact)
        text = Markup("The singular orbit from the start does not close: {}.")
        return {"sentence": text.format(reason), "period": None}
    count = found.orbit.period_pieces
    sentence = Markup(
        "The singular orbit from the start, slow pieces and drops from fold to fold, closes: {} a period. When it "
        "attracts, a relaxation orbit of the full system lies near it, and takes the slow time"
    ).format("one drop" if count == 1 else f"{count} drops")
    return {"sentence": sentence, "period": found.period, "at": found.orbit.period(small)}
