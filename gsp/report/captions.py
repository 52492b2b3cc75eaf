"""What to see in each figure of a page."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import sympy as sp
from markupsafe import Markup

from gsp.analysis.analysis import Analysis
from gsp.charts import heading_of, shape, slow_ends
from gsp.charts.manifolds import approaches
from gsp.charts.orbits import differs_from_limit, shrinks_in_proportion
from gsp.comparison.survey import HORIZON
from gsp.critical.continuation.critical_curve import CriticalCurve
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity
from gsp.hyperbolicity.samples import Kind
from gsp.report.wording import number, span, unit
from gsp.results.bounds import at_least
from gsp.results.mathml import Typesetter
from gsp.singular.mixed_modes import MixedMode
from gsp.systems.region import digits_between

# What figures of views are called, before their names.
VIEW = "view_"


def caption(name: str, analysis: Analysis, setter: Typesetter) -> Markup:
    """The caption of the chart called `name`."""
    if name.startswith(VIEW):
        return _view(analysis, name.removeprefix(VIEW), setter)
    return CAPTIONS[name](analysis, setter)


def _view(analysis: Analysis, name: str, setter: Typesetter) -> Markup:
    view = analysis.scene.views[name]
    shown = Markup(", ").join(setter.inline(sp.Symbol(quantity)) for quantity in view.names)
    return Markup("{}, a view of the model's author: {}. The full run at {}, and the limit.").format(
        view.title or name, shown, _at(analysis, setter)
    )


def _phase_portrait(analysis: Analysis, setter: Typesetter) -> Markup:
    if shape(analysis) == (1, 1):
        return Markup(
            "Phase plane at {}: the critical manifold <i>M</i><sub>0</sub> (black; dashed where it repels){} "
            "Streamlines follow the fast direction, onto <i>M</i><sub>0</sub> where it attracts and away from it where "
            "it repels. The full run from the scene's start is in orange."
        ).format(_at(analysis, setter), _slow_line(analysis, setter))
    if shape(analysis)[0] == 1:
        return Markup(
            "The plane of {} and {} at {}: the critical manifold (black){} The full run from the scene's start is "
            "in orange."
        ).format(
            setter.inline(analysis.study.system.x[0]),
            setter.inline(analysis.study.system.y[0]),
            _at(analysis, setter),
            _slow_line(analysis, setter),
        )
    chart = analysis.raw.chart if analysis.raw else analysis.study.system.x
    plane = Markup(", ").join(setter.inline(s) for s in chart[:2])
    if len(chart) > 2:
        return Markup("The scene's limit trajectory, at {} = 0, in the plane of {}.").format(
            _epsilon(analysis, setter), plane
        )
    return Markup(
        "Phase portrait of the reduced flow at {} = 0 in the plane of {}, with the scene's limit trajectory in orange."
    ).format(_epsilon(analysis, setter), plane)


def _slow_line(analysis: Analysis, setter: Typesetter) -> Markup:
    """The end of a sentence about the critical manifold: what of the slow one over one slow variable is drawn."""
    drawn, ends = slow_ends(analysis)
    if not drawn:
        return Markup(
            ". The slow manifold is not drawn: the terms of its series do not fall anywhere in the region."
        )
    text = Markup(" and the slow manifold <i>M</i><sub>ε</sub> (blue).")
    if ends:
        x = analysis.study.system.x[0]
        places = Markup(", ").join(_coordinate(x.name, value, analysis) for value in ends)
        name = setter.inline(x)
        text += Markup(
            " The blue line ends (circles) where the terms of its series stop falling, {} = {}."
        ).format(name, places)
    return text


def _phenomenon(analysis: Analysis, setter: Typesetter) -> Markup:
    found, system = analysis.phenomenon, analysis.study.system
    at = _at(analysis, setter)
    if isinstance(found, MixedMode):
        pattern = Markup("").join(
            Markup("{}<sup>{}</sup> ").format(large, small) for large, small in found.pattern
        )
        swings = Markup("The pattern {}repeats. ").format(pattern) if found.pattern else Markup("")
        small = "" if found.is_large.all() else "; dots are small ones near the folds"
        return Markup(
            "What the full system does at {}: {} over time, past the folds again and again. {}Triangles are large "
            "swings, from sheet to sheet{}. The reduction holds between the jumps."
        ).format(at, setter.inline(sp.Symbol(found.name)), swings, small)
    orbit = analysis.boundary.orbit
    # A region that holds a loss is more than one piece.
    is_lost = analysis.hyperbolicity.kind is Kind.LOST
    rest = "" if is_lost else " The rest of this report is about one of them."
    below = (
        Markup(
            " Below it the singular orbit, the limit at {} = 0: slow pieces (blue) and jumps from the folds."
        ).format(_epsilon(analysis, setter))
        if orbit is not None and orbit.closes
        else Markup("")
    )
    return Markup(
        "What the full system does at {}, in the plane of {} and {}: it follows the critical manifold to a fold, "
        "jumps, and comes back.{} The reduction holds on the slow pieces.{}"
    ).format(at, setter.inline(system.x[0]), setter.inline(system.y[0]), below, rest)


def _path(analysis: Analysis, setter: Typesetter) -> Markup:
    return Markup(
        "The path of the limit trajectory in the plane. Darts point along the heading, which may differ from the "
        "direction of motion."
        if heading_of(analysis) is not None
        else "The path of the limit trajectory in the plane."
    )


def _convergence(analysis: Analysis, setter: Typesetter) -> Markup:
    if analysis.scene.path is not None:
        return Markup("Paths of the full system at three values of {}. They approach the limit (blue).").format(
            _epsilon(analysis, setter)
        )
    text = Markup("Full runs minus the limit, relative to the largest value.")
    if shrinks_in_proportion(analysis):
        text += Markup(" The difference is proportional to {}.").format(_epsilon(analysis, setter))
    if not differs_from_limit(analysis):
        text += " They are the same within the runs' tolerance."
    elif analysis.hyperbolicity.kind is Kind.ATTRACTING:
        text += " At the left, in the initial layer, the slow variables change a little."
    if not analysis.limit.status.ok:
        text += f" The limit ends early: {analysis.limit.status.meaning}."
    if not all(run.status.ok for run in analysis.ladder.values()):
        text += " A full run is shown as far as it goes."
    return text


def _error(analysis: Analysis, setter: Typesetter) -> Markup:
    more = Markup(" Dashed: the fields stated elsewhere.") if analysis.scene.claims else Markup("")
    return (
        Markup(
            "Largest relative error of the reduced runs over {}{}, the full system started on the slow manifold. "
            "Markers are measured. The broad bands have the expected slope, {}<sup><i>N</i>+1</sup> at order "
            "<i>N</i>. In the grey zone the errors of the reference run dominate."
        ).format(span(analysis.scene.span), unit("t", analysis.scene.units), _epsilon(analysis, setter))
        + more
    )


def _manifold(analysis: Analysis, setter: Typesetter) -> Markup:
    found = analysis.hyperbolicity
    if shape(analysis) not in ((1, 1), (2, 1)):
        return Markup("Full runs that start off the slow manifold. ") + _distance(analysis, setter)
    if not analysis.landing:
        why = "Normal hyperbolicity is lost" if found.kind is Kind.LOST else f"It is {found.kind.adjective}"
        return Markup("The slow manifold at {}. {}, so no runs are shown landing on it.").format(
            _at(analysis, setter), why
        )
    shown = Markup("The slow manifold")
    if shape(analysis) == (1, 1):
        shown = Markup("The critical manifold (dashed)") + _slow_line(analysis, setter)[:-1]
    elsewhere = any(each.is_whole and not each.lands for each in approaches(analysis))
    fall = "towards it or another sheet of the critical manifold" if elsewhere else "towards it"
    return Markup("At {}: {}. Full runs that start off it (dots) fall along the fast direction, {}.").format(
        _at(analysis, setter), shown, fall
    )


def _distance(analysis: Analysis, setter: Typesetter) -> Markup:
    found, curves = analysis.hyperbolicity, approaches(analysis)
    text = Markup("Distance of such runs to the slow manifold in fast time.")
    text += Markup(
        " The slope of the dashed line is {}, {}. No run next to the manifold may fall more slowly."
    ).format(
        _gap(found), "the gap that is proved" if found.is_proved else "the gap, the slowest rate at the samples"
    )
    if not all(each.is_whole for each in curves):
        text += " A line ends where its run leaves what is known of the slow manifold."
    if any(each.lands and each.is_whole for each in curves):
        text += " Distances in the grey zone are below the accuracy of the series and the runs."
    return text


def _gap(found: Hyperbolicity) -> Markup:
    return number(found.gap, 4, bound=at_least if found.is_proved else None)


def _eigenvalues(analysis: Analysis, setter: Typesetter) -> Markup:
    found, slow = analysis.hyperbolicity, shape(analysis)[0]
    shown = {
        1: "Real parts of the fast eigenvalues over the region, in fast time.",
        2: "The real part that is nearest to 0 of the fast eigenvalues over the region, in fast time.",
    }.get(slow, "The fast eigenvalues over the region, in the complex plane and in fast time.")
    if found.failing:
        at = Markup("; ").join(_place(point, analysis, setter, 4) for point in found.failing)
        return Markup("{} A ring marks where a condition fails: at {}.").format(shown, at)
    who, where = ("None", "throughout") if found.is_proved else ("At the samples none", "there")
    nearer = "is nearer to 0 than" if slow == 2 else "enters the strip of half-width"
    return Markup("{} {} {} {}, the gap: the manifold is {} {}.").format(
        shown, who, nearer, _gap(found), found.kind.adjective, where
    )


def _proof(analysis: Analysis, setter: Typesetter) -> Markup:
    found = analysis.hyperbolicity.certificate
    assert found is not None
    how = "height" if len(analysis.study.system.x) == 1 else "colour"
    least = number(min(found.gaps), 4, bound=at_least)
    text = Markup(
        "The {} boxes of the {}. Their {} shows how far from the imaginary axis, in fast time, every eigenvalue over "
        "the box is proved to be: at least {}."
    ).format(
        len(found.boxes),
        "proof" if not found.undecided else "attempt at a proof",
        how,
        least,
    )
    if found.undecided:
        text += Markup(" Over the {} hatched boxes nothing is proved.").format(len(found.undecided))
    return text


def _critical_manifold(analysis: Analysis, setter: Typesetter) -> Markup:
    found = analysis.surroundings
    assert found is not None
    points = (
        found.special if isinstance(found, CriticalCurve) else tuple(p for f in found.folds for p in f.special)
    )
    text = Markup("The critical manifold around the region, by continuation, coloured by stability.")
    if isinstance(found, CriticalSheet) and found.folds:
        text += " Normal hyperbolicity is lost along the black fold curves."
    if points:
        listed = Markup("; ").join(
            Markup("{} at {}").format(str(point.kind), _place(point.point, analysis, setter, 6))
            for point in points[:4]
        )
        text += Markup(" Special points: {}.").format(listed)
    for stop in found.stops if isinstance(found, CriticalCurve) else ():
        if not stop.ending.ok:
            place = _place(stop.point, analysis, setter)
            text += Markup(" The curve ends at {}: {}.").format(place, stop.ending.meaning)
    return text


def _time_series(analysis: Analysis, setter: Typesetter) -> Markup:
    found = analysis.hyperbolicity
    # What is lost somewhere attracts, or not, where it is not.
    kind = found.kind if found.sub_region is None else found.sub_region.kind
    ways: dict[str, str] = {Kind.ATTRACTING: "come nearer to it", Kind.REPELLING: "move away from it"}
    layer = Markup(
        "Next to the slow manifold orbits {} by a factor of e or more in the time {}/gap (dotted). "
    ).format(ways.get(kind, "move away from it, in some directions,"), _epsilon(analysis, setter))
    shown = "and the reduced run of order {} (dashed), over logarithmic time"
    if len(analysis.reduced.t) == 1:
        shown = "over logarithmic time; the reduced run of order {} ends where it starts, and is not drawn"
    return Markup("The full run at {} (broad) " + shown + ". {}{}").format(
        _at(analysis, setter),
        analysis.short_series.order,
        layer if found.gap > 0.0 else "",
        _reduced_start(analysis, setter),
    )


def _reduced_start(analysis: Analysis, setter: Typesetter) -> Markup:
    if analysis.base is not None:
        # An error that the digits shown would hide.
        off = [
            Markup(" ({} is {})").format(
                setter.inline(sp.Symbol(name)), Markup(analysis.base.how_known(name)).format(number(error, 1))
            )
            for name, error in analysis.base.errors.items()
            if number(analysis.base[name] - error) != number(analysis.base[name] + error)
        ]
        return Markup(
            "The reduced run starts at the base point of the fast fibre through the start: {}{}."
        ).format(_place(analysis.base, analysis, setter), Markup("").join(off))
    return Markup(
        "The reduced run starts over the same slow variables ({}), so an offset of order {} may remain."
    ).format(analysis.base_reason, _epsilon(analysis, setter))


def _failure_map(analysis: Analysis, setter: Typesetter) -> Markup:
    found = analysis.failures
    assert found is not None
    return Markup(
        "Where each method holds, measured in {} runs. Above: runs that start at positions along {}, over {} of the "
        "span, with a tolerance of {}. Below: runs over the whole span, for a range of tolerances; reduced runs begin "
        "on the slow manifold, and so do those that they are measured against. In darker places a higher order of the "
        "reduced flow is needed. In hatched places explicit steps need more than four times as many calls of the field "
        "as implicit ones."
    ).format(
        found.runs, setter.inline(sp.Symbol(found.axis)), f"{100.0 * HORIZON:g}\u00a0%", number(found.tolerance)
    )


def _epsilon(analysis: Analysis, setter: Typesetter) -> Markup:
    return setter.inline(analysis.study.system.epsilon)


def _at(analysis: Analysis, setter: Typesetter) -> Markup:
    """The small parameter and its value."""
    return Markup("{} = {}").format(_epsilon(analysis, setter), number(analysis.scene.epsilon, 6))


def _place(point: Mapping[str, float], analysis: Analysis, setter: Typesetter, digits: int = 3) -> Markup:
    return Markup(", ").join(
        Markup("{} = {}").format(setter.inline(sp.Symbol(name)), _coordinate(name, value, analysis, digits))
        for name, value in point.items()
    )


def _coordinate(name: str, value: float, analysis: Analysis, digits: int = 3) -> Markup:
    """A place in the region, to so many digits or as many more as the ends of the region take to be told apart."""
    region = analysis.study.region
    return number(value, digits_between(region[name], digits) if name in region else digits)


def _the_same(text: str) -> Callable[[Analysis, Typesetter], Markup]:
    """A caption that is the same for every analysis."""
    return lambda analysis, setter: Markup(text)


TIME_SCALES = (
    "Time scales 1/|<i>λ</i>| of the modes of the Jacobian along the full run, from the first step on. Exhausted "
    "modes, which have decayed, are blue. The gap to the next mode is shaded."
)
_no_slip = _the_same(
    "The force that each contact must carry along the run without slip, divided by the largest force that its friction "
    "can carry. The contact sticks below 1 (dashed), and lets go at 1."
)
RAMP = (
    "A state along the first ramp that has a critical rate, at this rate and on both sides of it. At the critical rate "
    "it ends in the edge state. Time is 0 half way along the ramp."
)
_three_scales = _the_same(
    "The states from the start, over logarithmic time. Dashed: the flow on the manifold within the manifold. "
    "The fastest variables reach C1 first; then the next ones reach C2. Vertical lines are at one over the gap of each."
)
_passage = _the_same(
    "Orbits are proved to stay in what is shaded from the entry on, past where the critical manifold (solid where it "
    "attracts) loses its stability."
)

# Every name that a figure of a report may have, but for views; files of other names in its folder are never touched.
CAPTIONS: Mapping[str, Callable[[Analysis, Typesetter], Markup]] = {
    "time_scales": _the_same(TIME_SCALES),
    "phenomenon": _phenomenon,
    "no_slip": _no_slip,
    "ramp": _the_same(RAMP),
    "phase_portrait": _phase_portrait,
    "path": _path,
    "convergence": _convergence,
    "error_against_epsilon": _error,
    "manifold": _manifold,
    "distance": _distance,
    "critical_manifold": _critical_manifold,
    "eigenvalues": _eigenvalues,
    "proof": _proof,
    "three_scales": _three_scales,
    "time_series": _time_series,
    "failure_map": _failure_map,
    "passage": _passage,
}
