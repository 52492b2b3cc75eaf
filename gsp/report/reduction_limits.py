"""The section of a page on where the reduction ends: the failure map, folds and what follows, the singular orbit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import sympy as sp
from markupsafe import Markup

from gsp.analysis.analysis import Analysis
from gsp.analysis.fold_surroundings import FoldBeyond
from gsp.comparison.survey import HORIZON
from gsp.cycles.cycle_certificate import CycleCertificate, ProvedAnnulus
from gsp.cycles.passage_certificate import PassageCertificate
from gsp.report.wording import number, words
from gsp.results.bounds import as_given, at_least, at_most
from gsp.results.mathml import Typesetter
from gsp.singular.singularities.folded_singularities import FoldedSingularity
from gsp.systems.system import SlowFastSystem


def reduction_limits(analysis: Analysis, setter: Typesetter) -> dict[str, Any]:
    """Values of the section for the template; tables are empty and sentences None where there is nothing to say."""
    found = analysis.boundary
    return {
        "folds": [_fold(fold, analysis, setter) for fold in found.folds],
        "passes": any(fold.passage is not None for fold in found.folds),
        "folded": [_folded(point, setter) for point in found.folded],
        "folded_reason": words(found.folded_reason.fact),
        "orbit": _orbit(analysis),
        "proofs": [text for text in (_cycle(found.cycle, setter), _passage(found.passage, setter)) if text],
    }


def failures(analysis: Analysis, setter: Typesetter) -> dict[str, Any]:
    """What is read off the failure map, or why there is none."""
    return {
        "map": None if analysis.failures is None else _map(analysis, setter),
        "no_map": words(analysis.failures_reason.fact),
    }


def _map(analysis: Analysis, setter: Typesetter) -> Markup:
    """One sentence read off the failure map."""
    found = analysis.failures
    assert found is not None
    between = analysis.study.region[found.axis]
    epsilon = setter.inline(analysis.study.system.epsilon)
    here = [found.holds_up_to(n, between=between) for n in found.orders]
    span = [found.holds_over_span(n) for n in found.orders]
    return Markup(
        "The largest {} up to which the reduced flow meets the tolerance of {}: for runs of {} of the span that begin "
        "anywhere in the region's interval of {}, {}; for runs over the whole span, both "
        "begun on the slow manifold, {}. "
        "The map covers {} = {} to {}."
    ).format(
        epsilon,
        number(found.tolerance),
        f"{100.0 * HORIZON:g}\u00a0%",
        setter.inline(sp.Symbol(found.axis)),
        _listed_orders(found.orders, here, found.epsilons[-1]),
        _listed_orders(found.orders, span, found.epsilons[-1]),
        epsilon,
        number(float(found.epsilons[0])),
        number(float(found.epsilons[-1])),
    )


def _listed_orders(orders: Sequence[int], largest: Sequence[float], end: float) -> Markup:
    values = [
        Markup("none") if value == 0.0 else Markup("all of the map") if value == end else number(value, 2)
        for value in largest
    ]
    if len(set(values)) == 1:
        return Markup("{} at any of the orders {}").format(values[0], ", ".join(map(str, orders)))
    return Markup(", ").join(Markup("{} at order {}").format(*pair) for pair in zip(values, orders))


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


def _orbit(analysis: Analysis) -> dict[str, Any] | None:
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
    return {
        "sentence": sentence,
        "period": found.period,
        "at": found.orbit.period(small),
    }


def _cycle(cycle: CycleCertificate | None, setter: Typesetter) -> Markup:
    """What is proved of the cycle near the singular orbit, in a sentence; empty where nothing is."""
    if cycle is None or cycle.existence is None:
        return Markup("")
    one = cycle.uniqueness or cycle.existence
    area = "annulus" if isinstance(one, ProvedAnnulus) else "strip and tube"
    what = (
        f"just one closed orbit lies in the {area} of the figure, and attracts"
        if cycle.uniqueness
        else f"a closed orbit lies in the {area} of the figure"
    )
    least, most = one.turn.period
    return Markup("Proved: {} {}; its slow time is from {} to {}.").format(
        _up_to(cycle.orbit.branch.system, one.epsilon, setter),
        what,
        _bound(least, at_least),
        _bound(most, at_most),
    )


def _passage(passage: PassageCertificate | None, setter: Typesetter) -> Markup:
    """What is proved of orbits that pass the first loss of hyperbolicity; empty where nothing is."""
    if passage is None or passage.epsilon_0 == 0.0:
        return Markup("")
    up_to = _up_to(passage.system, passage.epsilon_0, setter)
    if passage.strip is not None:
        # Those through less than the entry section come out within more than the exit section.
        sections = [
            Markup(", ").join(
                _within(name, ends, exact, low, high, setter)
                for name, ends, exact in zip(passage.names, section, passage.strip.exactly(place))
            )
            for place, section, low, high in (
                (0, passage.strip.entry, at_most, at_least),
                (-1, passage.strip.exit, at_least, at_most),
            )
        ]
        least, most = passage.strip.turn.period
        return Markup(
            "Proved: {} each orbit through {} passes the strip of the figure, and leaves it through {}, after a slow "
            "time from {} to {}."
        ).format(up_to, *sections, _bound(least, at_least), _bound(most, at_most))
    delay = passage.delay
    assert delay is not None
    x = setter.inline(passage.system.x[0])
    early, late = (at_least, at_most) if delay.grid[-1] > delay.grid[0] else (at_most, at_least)
    left = (
        Markup("; those that begin at this distance have left by {} = {}").format(
            x, _bound(delay.leaves_by, late)
        )
        if delay.left is not None
        else Markup("")
    )
    return Markup(
        "Proved: {} each orbit within {} of the branch at {} = {} stays so at least to {} = {}, past where the branch "
        "has lost its stability{}."
    ).format(
        up_to,
        _bound(delay.width, at_least),
        x,
        _as(as_given(delay.grid[0])),
        x,
        _bound(delay.stays_to, early),
        left,
    )


def _up_to(system: SlowFastSystem, epsilon: float, setter: Typesetter) -> Markup:
    return Markup("for every {} in (0, {}]").format(setter.inline(system.epsilon), _bound(epsilon, at_least))


def _within(
    name: str,
    ends: tuple[float, float],
    exact: str,
    low: Callable[[float, int], str],
    high: Callable[[float, int], str],
    setter: Typesetter,
) -> Markup:
    symbol = setter.inline(sp.Symbol(name))
    if exact:
        return Markup("{} = {}").format(symbol, _as(exact))
    return Markup("{} from {} to {}").format(symbol, _bound(ends[0], low), _bound(ends[1], high))


def _bound(value: float, rounded: Callable[[float, int], str]) -> Markup:
    """A proved bound, rounded to the side on which it stays true."""
    return number(value, 6, bound=rounded)


def _as(exact: str) -> Markup:
    """A number with all the digits of its text."""
    return number(float(exact), bound=lambda value, digits: exact)
