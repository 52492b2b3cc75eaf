"""May a scene be reduced: one answer, made once from the candidates, that every card, page and table shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from gsp.choice.candidates import LARGEST_LAYER, Candidate, ModelKind, left_to_model
from gsp.choice.costs import Cost, cheapest, cost_beside
from gsp.choice.prediction import Failure
from gsp.scenes.scene import Scene
from gsp.systems.region import Interval, digits_between, shown_within
from gsp.systems.system import SlowFastSystem

# A named epsilon is this share of the one at which the predicted error would just do.
MARGIN = 0.8
CUT_SHORT = "Of a reduced run that ends before the span does, time and steps are as far as it holds."


class Answer(StrEnum):
    """Whether a scene may be reduced."""

    YES = "yes"
    AS_FAST = "yes, at about the same cost"
    NO_GAIN = "yes, but it does not pay"
    IN_PART = "for part of the span"
    NO = "no"


_ALLOWED = {Cost.LESS: Answer.YES, Cost.SAME: Answer.AS_FAST, Cost.MORE: Answer.NO_GAIN}


@dataclass(frozen=True)
class Verdict:
    """Whether a scene may be reduced: the `answer`, and sentences on `accuracy`, on `speed` and on what would help.

    Accuracy decides whether one may; speed whether it pays. `speed` and `remedy` may be empty.
    """

    answer: Answer
    accuracy: str
    speed: str = ""
    remedy: str = ""

    @property
    def sentences(self) -> str:
        """Accuracy, speed and what would help, one after the other."""
        return " ".join(filter(None, (self.accuracy, self.speed, self.remedy)))

    def __str__(self) -> str:
        return f"May I reduce? {self.answer.capitalize()}: {self.sentences}"


@dataclass(frozen=True)
class Evidence:
    """What a verdict rests on: every candidate, the full system last, the `layer` in slow time, and the scene.

    `names` are the variables that the errors are of. `fast_error` is what the shown model's fast variables are
    predicted to be off by behind the layer, or measured on `fast_measured` where their series does not converge, and
    `layer_error` in it; not numbers where they count among `names`.
    `far` is what `far_from_origin` says of the names.
    `obstacle` says why there are no reduced candidates, `ending` why the series ends where the error of one of them is
    not told; `place` is where in the slow variables the `partial` one ends. `limit_ends` says when the run of
    order 0 ends before the span does, and what it meets, whatever epsilon is.
    """

    scene: Scene
    candidates: Sequence[Candidate]
    model: Candidate
    partial: Candidate | None = None
    layer: float = 0.0
    obstacle: str = ""
    ending: str = ""
    place: Mapping[str, float] = field(default_factory=dict)
    names: Sequence[str] = ()
    fast_error: float = float("nan")
    layer_error: float = float("nan")
    fast_measured: Interval | None = None
    far: tuple[str, float] | None = None
    limit_ends: tuple[float, str] | None = None


def judge(evidence: Evidence) -> Verdict:
    """The verdict on a scene for the model that was chosen."""
    *reduced, full = evidence.candidates
    scene, model, partial = evidence.scene, evidence.model, evidence.partial

    def promised(begin: float) -> str:
        digits = digits_between(scene.span)
        return (
            f"a relative error of {scene.tolerance:g} over t = {begin:.{digits}g} to {scene.span[1]:.{digits}g} "
            f"at {scene.system.epsilon} = {scene.epsilon:g}"
        )

    if not reduced:
        why = f"it cannot be reduced here: {evidence.obstacle.removesuffix('.')}."
        return Verdict(Answer.NO, why, "" if full.valid else f"The full system {full.why_not}.")
    shown = serving_of(model, reduced)
    if shown is not None:
        cost = cost_beside(shown, full) if full.valid else Cost.LESS
        return Verdict(
            _ALLOWED[cost],
            f"{in_words(shown)} stays within {promised(scene.span[0] + evidence.layer)}. {_off(shown, evidence)}",
            _speed(shown, full, cost),
            "" if cost is Cost.LESS else "The reduction gives a formula; to compute runs, use the full system.",
        )
    length = scene.span[1] - scene.span[0]
    # Less than this share of the span, behind the layer, is no part worth naming.
    if partial is not None and partial.holds_until - scene.span[0] - evidence.layer < 0.05 * length:
        partial = None
    nearest = _nearest(reduced)
    if partial is not None and (nearest.order is not None or not _is_longer(nearest, partial, scene)):
        nearest = partial
    whole = promised(scene.span[0])
    # Beyond a loss, a kink or the region's edge nothing is predicted, and little may happen.
    stays = (
        "stays" if all(each.failure in (Failure.ERROR, Failure.END) for each in reduced) else "is known to stay"
    )
    lead = "For" if nearest.failure is Failure.UNTOLD else "The nearest is"
    but = "" if nearest.failure is Failure.UNTOLD else ", but"
    accuracy = f"no reduced model {stays} within {whole}. {lead} {in_words(nearest)}{but} {nearest.why_not}."
    accuracy = " ".join(filter(None, (accuracy, evidence.ending)))
    if partial is None:
        also = "" if full.valid else f"The run of the full system {_ended(full, scene)}."
        return Verdict(Answer.NO, accuracy, also, _remedy(nearest, evidence))
    region = scene.region
    place = ", ".join(
        f"{name} = {shown_within(value, region[name]) if name in region else format(value, '.4g')}"
        for name, value in evidence.place.items()
    )
    until = f"t = {shown_within(partial.holds_until, scene.span)}" + (f", {place}" if place else "")
    subject = "It" if nearest is partial else f"T{in_words(partial)[1:]}"
    accuracy = f"{accuracy} {subject} serves until {until}."
    return Verdict(
        Answer.IN_PART,
        accuracy,
        "simulate() uses it up to there, and the full system elsewhere"
        + ("." if full.valid else f", whose run {_ended(full, scene)}."),
        _remedy(nearest, evidence),
    )


def serving_of(model: Candidate, candidates: Sequence[Candidate]) -> Candidate | None:
    """The reduced model that a Yes speaks of: the one chosen, or the one that costs least where none pays."""
    # Sorted by order: ties go to the lowest order.
    return model if model.kind is not ModelKind.FULL else cheapest([c for c in candidates if c.valid])


def _off(shown: Candidate, evidence: Evidence) -> str:
    """What a model is off by, of which variables."""
    of = f" in {', '.join(evidence.names)}" if evidence.names else ""
    text = f"Its {'measured' if shown.is_measured else 'predicted'} error is {_error(shown.predicted)}{of}"
    if np.isfinite(evidence.layer_error):
        text += f"; in the fast variables it is {_off_behind(evidence)}"
        text += f" and {_error(evidence.layer_error)} within the layer" if evidence.layer_error > 0.0 else ""
    name, share = evidence.far or ("", 1.0)
    if shown.predicted > share * evidence.scene.tolerance:
        error = _error(shown.predicted / share)
        text += ". Errors are shares of how large a state is. As a share of the width of its region, that of "
        text += f"{name} may be {error}"
    return f"{text}."


def far_from_origin(
    system: SlowFastSystem, names: Sequence[str], region: Mapping[str, Interval]
) -> tuple[str, float] | None:
    """Which of the named states with a centre elsewhere is furthest from the origin for the width of its region, and
    that width as a share of how large it is there; None where none is.
    """
    found = []
    for symbol in system.centres:
        low, high = region.get(symbol.name, (0.0, 0.0))
        if symbol.name in names and low < high:
            found.append(((high - low) / max(abs(low), abs(high)), symbol.name))
    share, name = min(found, default=(1.0, ""))
    return (name, share) if share < 1.0 else None


def _off_behind(evidence: Evidence) -> str:
    """What the fast variables are off by behind the layer, and how that is known."""
    if evidence.fast_measured is None:
        return f"{_error(evidence.fast_error)} after the initial layer"
    if np.isnan(evidence.fast_error):
        return "unknown after the initial layer, because their series does not converge,"
    begin, end = (shown_within(t, evidence.scene.span) for t in evidence.fast_measured)
    return (
        f"{_error(evidence.fast_error)} after the initial layer (measured on t = {begin} to {end} only, "
        "because their series does not converge)"
    )


def in_words(candidate: Candidate) -> str:
    """A candidate in a sentence."""
    if candidate.kind is ModelKind.SOLVED:
        return "the flow on the solved manifold"
    return "the full system" if candidate.order is None else f"the reduced flow of order {candidate.order}"


def seconds_shown(seconds: float) -> str:
    """Seconds of a run as they are set in text and tables; empty when they are not known."""
    if not np.isfinite(seconds):
        return ""
    scale, unit = next(
        (s, u) for s, u in ((1e6, "us"), (1e3, "ms"), (1.0, "s")) if s == 1.0 or s * seconds < 1e3
    )
    return f"{scale * seconds:.3g} {unit}"


def _error(value: float) -> str:
    """An error of two digits, as 3.0e-06, 0.95 and 18."""
    return f"{value:#.2g}".rstrip(".")


def _speed(shown: Candidate, full: Candidate, cost: Cost) -> str:
    if not full.valid:
        return f"It is the only run that reaches the end: the full system {full.why_not}."
    times = f"{seconds_shown(shown.seconds)} a run against {seconds_shown(full.seconds)} of the full system"
    times += f" ({full.unseen})" if full.unseen else ""
    if cost is not Cost.LESS:
        return f"It {cost}: {times}."
    runs = max(1.0, np.ceil((shown.preparation - full.preparation) / (full.seconds - shown.seconds)))
    # Two digits: it is the difference of times that are measured to three.
    after = "1 run" if runs == 1.0 else f"about {float(f'{runs:.2g}'):.0f} runs"
    return (
        f"It is {full.seconds / shown.seconds:.2g} times as fast: {times}. Preparing it pays off after {after}."
    )


def _ended(full: Candidate, scene: Scene) -> str:
    return f"ends at t = {shown_within(full.holds_until, scene.span)}"


def _nearest(reduced: Sequence[Candidate]) -> Candidate:
    """Of the candidates that hold longest, the one that is predicted to be least wrong."""
    flows = [c for c in reduced if c.order is not None or c.failure is not None]
    furthest = max(c.holds_until for c in flows)
    reaching = [c for c in flows if c.holds_until >= furthest]
    # What is predicted to be off by all of its size, or more, or by as much in the digits shown, is not seen to be
    # nearer than another: the lowest order comes first.
    return min(reaching, key=lambda c: float(f"{c.predicted:.1e}") if c.predicted < 1.0 else np.inf)


def _is_longer(one: Candidate, other: Candidate, scene: Scene) -> bool:
    """Whether one holds longer than the other by the digits that are shown."""
    until, others = (float(shown_within(c.holds_until, scene.span)) for c in (one, other))
    return until > others


def _has_room(candidate: Candidate, layer: float, scene: Scene) -> bool:
    """Whether a span that ended where the candidate no longer holds would not be mostly layer."""
    return layer < LARGEST_LAYER * (candidate.holds_until - scene.span[0])


def within_region(candidate: Candidate, layer: float, scene: Scene) -> str:
    """What would help a candidate that leaves the region."""
    also = " or a shorter span" if _has_room(candidate, layer, scene) else ""
    return f"A larger region{also} would help."


def _remedy(nearest: Candidate, evidence: Evidence) -> str:
    """What would help, in one sentence."""
    scene, full = evidence.scene, evidence.candidates[-1]
    length = scene.span[1] - scene.span[0]
    if nearest.failure in (Failure.GAP, Failure.KINK, Failure.END):
        if _has_room(nearest, evidence.layer, scene):
            return "A span that ends before that place, or a start behind it, would help."
        return "A start further from that place, or behind it, would help."
    if not full.valid:
        # Beyond there is nothing that a reduced model could be near to.
        return f"Ask about a span that ends before t = {shown_within(full.holds_until, scene.span)}."
    if evidence.layer > LARGEST_LAYER * length:
        enough = MARGIN * scene.epsilon * LARGEST_LAYER * length / evidence.layer
        return (
            f"A smaller {scene.system.epsilon}, about {enough:.1g}, or a longer span would help, because the initial "
            "layer takes most of this span."
        )
    if evidence.limit_ends is not None and nearest.failure in (Failure.RATE, Failure.ORDER, Failure.ERROR):
        time, meaning = evidence.limit_ends
        return (
            f"A smaller {scene.system.epsilon} or a larger tolerance would help up to t = "
            f"{shown_within(time, scene.span)} only, where the limit's run ends: {meaning}."
        )
    if nearest.failure is Failure.RATE:
        return f"A smaller {scene.system.epsilon} would help."
    if nearest.failure is Failure.UNTOLD:
        return "compare() measures its error against full runs."
    if nearest.failure is Failure.REGION:
        return within_region(nearest, evidence.layer, scene)
    enough = max((_enough(c, scene) for c in evidence.candidates), default=0.0)
    # A smaller epsilon is named down to this share of the scene's: further off the power law is no guide.
    if enough >= 0.01 * scene.epsilon:
        return f"A smaller {scene.system.epsilon}, about {enough:.1g}, is expected to be enough, or a larger tolerance."
    return f"A smaller {scene.system.epsilon} or a larger tolerance would help."


def _enough(candidate: Candidate, scene: Scene) -> float:
    """The epsilon at which an error that falls like epsilon^(order + 1) meets the tolerance; 0 where none is told."""
    limit = left_to_model(scene.tolerance)
    # An error within the limit is not what stands in the way, and one of all there is falls by no power of epsilon.
    if candidate.order is None or candidate.valid or not limit < candidate.predicted < 1.0:
        return 0.0
    return MARGIN * scene.epsilon * (limit / candidate.predicted) ** (1.0 / (candidate.order + 1))
