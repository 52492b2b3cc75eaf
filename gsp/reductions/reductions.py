"""`Reductions`: what of a scene without a small parameter may be left out, each candidate measured."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gsp.algebra.brevity import HALF_LINE
from gsp.choice.candidates import GRID_POINTS, left_to_model
from gsp.choice.choice import Choice
from gsp.choice.costs import cheapest
from gsp.choice.measured_errors import RTOL
from gsp.choice.prediction import Failure
from gsp.choice.verdict import seconds_shown, serving_of, within_region
from gsp.errors import GspError
from gsp.integration.trajectory import Trajectory, trajectory_of
from gsp.reductions.fast_directions import fast_directions
from gsp.reductions.fast_parts import FastPart, fast_parts
from gsp.reductions.measurement import (
    LARGEST,
    LEADING,
    field_of,
    is_solved,
    measure,
    needed_gap,
    timed_together,
)
from gsp.reductions.reduction import Reduction
from gsp.reductions.screening import defect
from gsp.reductions.special_parts import SpecialPart, special_parts, with_errors, without_repetition
from gsp.results.card import Card
from gsp.scales.small_parameter import SmallParameter
from gsp.scales.time_scales import TimeScales, time_scales
from gsp.scenes.scene import Scene
from gsp.scenes.small_parameter import without_small
from gsp.scenes.study import Study, study_of
from gsp.systems.arguments import check_noun, check_progress
from gsp.systems.region import shown_ends, shown_within
from gsp.systems.tolerances import absolute_tolerance

# Candidates that are measured: those that the run stays nearest to.
MEASURED = 6


@dataclass(frozen=True, eq=False, repr=False)
class Reductions(Card):
    """What may be left out of a scene: the candidates measured, by error, and the one that is `recommended`.

    `recommended` is the cheapest within the scene's tolerance, None where none serves: do not reduce. `nearest` is the
    one of order 0 that is least in error, or of order 1 where none of order 0 is right to a tenth; None where none of
    these is: then nothing is separated, and nothing is offered. `solved` is whether the flow on its solved manifold
    serves, where no reduced flow does. `reason` says which, and why. `scales` are the time scales along the run, and
    `special` the special values of its parameters with so many fast directions as are separated, found exactly, least
    in `error` first.
    """

    scene: Scene
    scales: TimeScales
    found: tuple[Reduction, ...]
    recommended: Reduction | None
    nearest: Reduction | None
    special: tuple[SmallParameter, ...]
    reason: str
    solved: bool = False

    @property
    def near(self) -> list[tuple[SmallParameter, float]]:
        """The special values that are no candidates, with an error of a tenth at most, and that error."""
        measured = {each.name for each in self.found}
        return [
            (each, each.error)
            for each in self.special
            if each.error is not None and each.error <= LARGEST and SpecialPart(each).name not in measured
        ]

    @property
    def taken(self) -> Reduction | None:
        """What verbs that need a small parameter go on with."""
        return self.recommended or self.nearest

    @property
    def study(self) -> Study | None:
        """The study of the one taken, with the errors of its orders that were measured; None where none is."""
        taken = self.taken
        if taken is None:
            return None
        limit = left_to_model(taken.scene.tolerance)
        own = [each for each in self.found if each.name == taken.name]
        errors = {each.order: each.error for each in own if not each.why_not or each.error > limit}
        return replace(study_of(taken.scene), measured=errors, is_stiff=taken.is_stiff)

    def as_dict(self) -> dict[str, object]:
        """The reason, what is recommended, and every candidate, as plain values."""
        return {
            "reason": self.reason,
            "time_scales": self.scales.message,
            "recommended": None if self.recommended is None else self.recommended.as_dict(),
            "solved": self.solved,
            "candidates": [each.as_dict() for each in self.found],
            "special": [
                {
                    "vanishing": list(each.vanishing),
                    "manifold": [str(e.lhs) for e in each.manifold],
                    "error": each.error,
                }
                for each in self.special
            ],
        }

    def __repr__(self) -> str:
        name = self.scene.name or "scene"
        best = self.recommended or (f"solved manifold of {self.nearest}" if self.solved else "do not reduce")
        return f"Reductions({name}: {len(self.found)} measured, {best})"

    def with_costs(self, choice: Choice) -> Reductions:
        """The same with the costs that a `choice` of the one taken measured, so that one run has one cost."""
        taken, own = self.taken, {c.order: c.timings for c in choice.candidates}

        def costed(each: Reduction) -> Reduction:
            if taken is None or each.name != taken.name or not own.get(each.order):
                return each
            candidate = replace(each.candidate, timings=own[each.order])
            return replace(each, candidate=candidate, full_seconds=choice.candidates[-1].seconds)

        rows = {each: costed(each) for each in self.found}
        recommended = self.recommended
        if recommended is not None:
            # The order that the answer speaks of, the same in both.
            best = serving_of(choice.model, choice.candidates[:-1])
            order = recommended.order if best is None or best.order is None else best.order
            same = [e for e in self.found if (e.name, e.order) == (recommended.name, order) and not e.why_not]
            recommended = same[0] if same else recommended
        return replace(
            self,
            found=tuple(rows.values()),
            recommended=None if recommended is None else rows[recommended],
            nearest=None if self.nearest is None else rows[self.nearest],
            reason=self.reason if recommended is None else _recommending(self.scene, recommended),
        )

    def shown(self) -> Iterator[Reduction]:
        """Of each candidate the reduction itself, and the lowest order that serves; where none does, the nearest."""
        followed = [each for each in self.found if each.candidate.follows and np.isfinite(each.error)]
        best: dict[str, Reduction] = {}
        for each in sorted(followed, key=lambda r: (bool(r.why_not), r.error if r.why_not else r.order)):
            best.setdefault(each.name, each)
        for each in self.found:
            if each.order == 0 or each is self.recommended or each is best.get(each.name):
                yield each

    def __str__(self) -> str:
        lines = [self.reason]
        if self.found:
            width = _width([each.name for each in self.found])
            lines.append(f"    {'what is fast':<{width}}  order     error       run  of the full system")
        for each in self.shown():
            mark = "->" if each is self.recommended else ""
            cost = f"{each.cost:7.2f}" if np.isfinite(each.cost) else ""
            lines.append(
                f"  {mark:2}{_cell(each.name, width)}  {each.order:5d}  {_shown(each.error):>8}  "
                f"{seconds_shown(each.seconds):>8}  {cost:>7}  {each.why_not}".rstrip()
            )
        if self.near:
            names = [SpecialPart(each).name for each, _ in self.near]
            heading = "special values of parameters"
            width = _width([heading, *names])
            lines.append(f"    {heading:<{width}}  order     error")
            lines += [
                f"    {_cell(name, width)}  {0:5d}  {_shown(error):>8}"
                for name, (_, error) in zip(names, self.near)
            ]
        return "\n".join(lines)


def find_reductions(
    scene: Scene, *, tolerance: float | None = None, progress: Callable[[float], object] | None = None
) -> Reductions:
    """What of a scene without a small parameter may be left out, measured at its own values over its own span.

    Candidates are sets of states in quasi-steady state, of up to three states or of those that are fast together at
    some time, reactions in partial equilibrium and total quasi-steady states, and where none of these is separated with
    as many fast directions as the widest gap says, the linear coordinates of a fast subspace. A candidate has as many
    fast modes as fast directions. It is looked at where these decay along the run, and the next mode is slower by so
    much that within its time scale they are gone: slow manifolds are unique up to exp(-gap) only (Fenichel 1979), which
    has to be below
    the share of the tolerance that is left to a layer. The `MEASURED` ones that the run from the start stays nearest to
    are reduced, to orders 0 to 3, and compared with the full run. Beside them stand the special values of the
    parameters (see `small_parameters`), each with its error; where no other candidate serves they are candidates too,
    with the distance along the ray for a small parameter. The cheapest within the tolerance (default the scene's) is
    recommended. `progress(share)` is called as candidates are measured.

    >>> from gsp import models
    >>> find_reductions(models.load("michaelis_menten"), tolerance=0.05).recommended       # doctest: +SKIP
    Reduction(total quasi-steady state of c in c <-> s, order 0: error 0.0011)
    """
    check_noun(scene, Scene, verb="find_reductions")
    check_progress(progress)
    plain = without_small(scene)
    if tolerance is not None:
        plain = replace(plain, tolerance=tolerance)
    run, field = plain_run(plain), field_of(plain)
    scales = time_scales(plain)
    gaps = _gaps(scales)
    found: dict[Reduction, Study] = {}

    def look_at(parts: Iterable[FastPart | SpecialPart]) -> None:
        for i, part in enumerate(parts):
            if progress is not None:
                progress(i / MEASURED)
            found.update(measure(plain, part, gaps))

    # What is fast together most often, however many states that are: sets of a few are tried one by one.
    together = Counter(scales.fast(i) for i in np.flatnonzero(scales.separated).tolist())
    named = {s.name: s for s in field.states}
    large = [[named[name] for name in names] for names, _ in together.most_common(MEASURED)]
    parts = fast_parts(field, large=large)
    ranked = sorted(_screened(plain, run, gaps, parts), key=lambda pair: pair[0])
    count = int(np.argmax(gaps)) + 1 if gaps.size and gaps.max() >= needed_gap(LARGEST) else 0
    # Each state that is fast lies nearer than all together, which are what the widest gap leaves out.
    widest = next((k for k, (_, part) in enumerate(ranked) if part.count == count), 0)
    chosen = ranked[:MEASURED] if widest < MEASURED else [*ranked[: MEASURED - 1], ranked[widest]]
    look_at(part for _, part in chosen)
    named = set(found)
    # Where nothing that has a name is as fast as the widest gap says, combinations of states may be.
    if count and not any(len(found[each].system.y) == count for each in _separated(found)):
        unnamed = fast_directions(field, run.y[:, -1], count, gaps[count - 1])
        look_at(part for _, part in _screened(plain, run, gaps, unnamed))
    is_separated = gaps >= needed_gap(LARGEST)
    parts_at = special_parts(field, lambda count: bool(is_separated[count - 1]))
    special = without_repetition(with_errors(plain, run, parts_at))
    # What no state or reaction names may have a formula.
    if all(each.why_not for each in named):
        look_at(SpecialPart(e) for e in special[:MEASURED] if e.error is not None and e.error <= LARGEST)
    timed = timed_together(plain, found)
    timed.sort(key=lambda each: (not np.isfinite(each.error), each.error))
    serving = sorted((each for each in timed if not each.why_not), key=lambda r: (r.order, r.error))
    best = cheapest([each.candidate for each in serving])
    recommended = next((each for each in serving if each.candidate is best), None)
    nearest = _nearest(timed)
    solved = recommended is None and nearest is not None and is_solved(found[nearest])
    reason = _reason(plain, timed, recommended, nearest, gaps, solved)
    return Reductions(plain, scales, tuple(timed), recommended, nearest, special, reason, solved)


def plain_run(scene: Scene) -> Trajectory:
    """The run of a scene without a small parameter with which candidates are compared."""
    atol = absolute_tolerance(RTOL, scene.region, scene.start)
    return trajectory_of(scene.system, start=scene.start, span=scene.span, epsilon=None, rtol=RTOL, atol=atol)


def _gaps(scales: TimeScales) -> np.ndarray:
    """By how much (n - 1,) the r fastest modes are apart from the next, over half of the run; 0 where they grow.

    A mode that is slower than the run is long counts as slow as that: what fades over the run is not fast in it.
    """
    length = scales.t[-1] - scales.t[0]
    fastest, next_one = scales.times[:, :-1], np.minimum(scales.times[:, 1:], length)
    with np.errstate(invalid="ignore"):
        apart = np.where(np.real(scales.rates[:, :-1]) < 0.0, next_one / fastest, 0.0)
    gaps = np.array([_median(column, np.gradient(scales.t)) for column in apart.T])
    # Where all is fast but conserved sums nothing moves on the slow manifold: it is where the run ends.
    gaps[scales.times.shape[1] - len(scales.conserved) - 1 :] = 0.0
    return gaps


def _median(values: np.ndarray, weights: np.ndarray) -> float:
    """The value that is reached or passed over half of the whole weight."""
    order = np.argsort(-values)
    return float(values[order][np.searchsorted(np.cumsum(weights[order]), 0.5 * weights.sum())])


def _screened(
    scene: Scene, run: Trajectory, gaps: np.ndarray, parts: Sequence[FastPart]
) -> Iterator[tuple[float, FastPart]]:
    """The candidates that are separated and attract along the run, with how near it stays to where they are at rest."""
    times = np.linspace(float(run.t[0]), float(run.t[-1]), GRID_POINTS)
    for part in parts:
        # As many directions as states leave nothing that is slow.
        if part.count > len(gaps) or gaps[part.count - 1] < needed_gap(LARGEST):
            continue
        try:
            far = defect(field_of(scene), part, run, times)
        except (GspError, np.linalg.LinAlgError):
            continue
        if np.isfinite(far):
            yield far, part


def _nearest(found: Iterable[Reduction]) -> Reduction | None:
    """Of the candidates whose error to leading order is small the one that comes nearest to any order."""
    found = list(found)

    def nearness(each: Reduction) -> tuple[float, int, float]:
        own = [e.error for e in found if e.name == each.name and e.candidate.follows]
        return min(own), each.order, each.error

    return min(_separated(found), key=nearness, default=None)


def _separated(found: Iterable[Reduction]) -> list[Reduction]:
    """The reductions of leading order whose error is small."""
    return [e for e in found if e.order in LEADING and e.error <= LARGEST and e.candidate.follows]


def _recommending(scene: Scene, recommended: Reduction) -> str:
    begin = shown_within(recommended.measured[0], scene.span)
    return (
        f"What may be left out: the {recommended.name}, to order {recommended.order}; its error over "
        f"t = {begin} to {shown_ends(scene.span)[1]} is {recommended.error:.2g}, "
        f"within the tolerance {scene.tolerance:g}."
    )


def _reason(
    scene: Scene,
    found: Sequence[Reduction],
    recommended: Reduction | None,
    nearest: Reduction | None,
    gaps: np.ndarray,
    solved: bool,
) -> str:
    first, last = shown_ends(scene.span)
    over = f"over t = {first} to {last}"
    if recommended is not None:
        return _recommending(scene, recommended)
    if nearest is not None:
        corrected = [
            e for e in found if e.name == nearest.name and e.order > nearest.order and e.candidate.follows
        ]
        best = min(corrected, key=lambda each: each.error, default=nearest)
        further = f", and {best.error:.2g} to order {best.order}" if best.error < nearest.error else ""
        to_order = f"{nearest.error:.2g} to order {nearest.order}{further}"
        if solved:
            return (
                f"What may be left out: the {nearest.name}, on its solved manifold. No reduced flow stays within the "
                f"tolerance {scene.tolerance:g} {over}: its error is {to_order}."
            )
        told = f"{nearest.name}, whose error is {to_order}"
        if best.error <= scene.tolerance:
            reason = (
                f"Do not reduce: no candidate serves {over}. The nearest is the {told}; but {best.why_not}."
            )
            if best.candidate.failure is not Failure.REGION:
                return reason
            return f"{reason} {within_region(best.candidate, best.measured[0] - scene.span[0], scene)}"
        return (
            f"Do not reduce: no candidate stays within the tolerance {scene.tolerance:g} {over}. The nearest is the "
            f"{told}."
        )
    if not gaps.size:
        return "Do not reduce: there is one state only."
    widest = float(gaps.max())
    if widest == 0.0:
        return f"Do not reduce: no mode decays ahead of the others over most of t = {first} to {last}."
    if widest < 1.0:
        return (
            f"Do not reduce: over most of t = {first} to {last} the fastest mode that decays takes "
            f"{1.0 / widest:.3g} times as long as that."
        )
    if widest < needed_gap(LARGEST):
        return (
            f"Do not reduce: nothing is separated over most of t = {first} to {last}. There the next mode is at "
            f"most {widest:.1f} times as slow as one that decays, and {needed_gap(LARGEST):.1f} times are needed for a "
            "layer to pass before the rest has moved."
        )
    return f"Do not reduce: no part of the field is fast, attracts and lets the rest follow {over}."


def _width(names: Iterable[str]) -> int:
    """Of a column of names; one of more than half a line has a line of its own."""
    return max((len(name) for name in names if len(name) <= HALF_LINE), default=0)


def _cell(name: str, width: int) -> str:
    return f"{name:<{width}}" if len(name) <= width else f"{name}\n{'':<{width + 4}}"


def _shown(error: float | None) -> str:
    return f"{error:.1e}" if error is not None and np.isfinite(error) else ""
