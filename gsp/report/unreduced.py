"""The report of a model in which nothing is small: its time scales, why it is not reduced, its run and its ramps."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import sympy as sp
from markupsafe import Markup

from gsp import charts
from gsp.analysis.ramp_answers import drawn_ramp
from gsp.demos.demo import Demo, demo
from gsp.errors import DeclarationError
from gsp.reductions.reductions import Reductions, plain_run
from gsp.report.captions import RAMP, TIME_SCALES
from gsp.report.page import ShortReport, environment_of_pages, figures, panel_values, said_of
from gsp.report.ramps import ramps, ramps_as_json
from gsp.report.reductions import reductions_found
from gsp.report.setting import Setting
from gsp.results.attempts import Missing, attempt
from gsp.scenes.view import TIME

CAPTIONS = {
    "time_series": "Every state from the start, over the span.",
    "time_scales": TIME_SCALES,
    "ramp": RAMP,
}


def unreduced_report(found: Reductions, progress: Callable[[float], object]) -> ShortReport:
    """The report of a scene without a small parameter; raises `DeclarationError` where a candidate is taken."""
    if found.taken is not None:
        raise DeclarationError(
            f"something is small in {found.scene.name or 'the model'}: {found.taken.name}.",
            "Report write_report(analyse(found.taken.scene), folder, reductions=found).",
        )
    scene = found.scene
    drawn: dict[str, Callable[[], Any]] = {}
    answered = attempt("the ramps", lambda: drawn_ramp(scene))
    if not isinstance(answered, Missing) and answered is not None:
        drawn["ramp"] = lambda: charts.critical_rate(answered)
    drawn |= {
        "time_series": lambda: charts.trajectory(plain_run(scene)),
        "time_scales": lambda: charts.time_scales(found.scales),
    }
    pictures: dict[str, bytes | Missing] = {}
    for k, (name, draw) in enumerate(drawn.items(), 1):
        pictures[name] = attempt(f"the figure {name}", lambda draw=draw: charts.png(draw()))
        progress(0.8 * k / len(drawn))
    content = {
        **said_of(scene),
        "equations": {s.name: str(rate) for s, rate in zip(scene.system.states, scene.system.rates)},
        "parameters": {p.name: str(value) for p, value in scene.system.parameters.items()},
        "start": dict(scene.start),
        "span": list(scene.span),
        "tolerance": scene.tolerance,
        "reductions": found.as_dict(),
        "ramps": ramps_as_json(scene),
    }
    panel = attempt("the panel", lambda: demo(scene))
    return ShortReport(_page(found, pictures, panel), content, pictures)


def _page(found: Reductions, pictures: Mapping[str, bytes | Missing], panel: Demo | Missing) -> str:
    scene, system = found.scene, found.scene.system
    setting = Setting([*system.parameters, *system.states], scene.units)
    return (
        environment_of_pages()
        .get_template("unreduced.html")
        .render(
            scene=scene,
            title=scene.title or scene.name or "A model without a small parameter",
            reductions=reductions_found(found),
            equations=setting.rates(zip(system.states, system.rates)),
            parameters=[setting.named_value(p, value) for p, value in system.parameters.items()],
            start=[setting.named_value(sp.Symbol(name), value) for name, value in scene.start.items()],
            time_unit=setting.unit(TIME),
            ramps=ramps(scene),
            figures=figures(pictures, lambda name: Markup(CAPTIONS[name])),
            **panel_values(panel),
        )
    )
