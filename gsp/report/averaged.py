"""The report of a model with a fast phase: the averaged field, and how good it is."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import sympy as sp
from markupsafe import Markup

from gsp import charts
from gsp.averaging.averaging import Averaging
from gsp.comparison.averaged import compare_averaged
from gsp.comparison.comparison import Comparison
from gsp.errors import DeclarationError
from gsp.report.page import ShortReport, environment_of_pages, figures, said_of
from gsp.report.setting import Setting
from gsp.report.wording import fitted, number
from gsp.results.attempts import Missing, attempt
from gsp.results.equations import OPERATIONS
from gsp.results.mathml import dotted, row
from gsp.scenes.scene import TIME, Scene

CAPTIONS = {
    "averaging": "A slow variable from the scene's start along the full run, and its mean.",
    "error_against_epsilon": "Errors of the averaged runs over the small parameter, with slopes fitted and expected.",
}


def averaged_report(found: Averaging, progress: Callable[[float], object]) -> ShortReport:
    """The report of an averaging of a scene, measured; raises `DeclarationError` for one of no scene."""
    scene = found.scene
    if scene is None:
        raise DeclarationError(
            "a report is of an averaging of a scene, which says from where and for how long.",
            "Give average() the scene.",
            got=repr(found),
        )
    measured = compare_averaged(found, progress=lambda share: progress(0.8 * share))
    pictures = {
        "averaging": attempt("the figure averaging", lambda: charts.png(charts.averaging(found))),
        "error_against_epsilon": attempt(
            "the figure error_against_epsilon", lambda: charts.png(charts.error_against_epsilon(measured))
        ),
    }
    progress(0.9)
    content = {
        **said_of(scene),
        "epsilon": scene.epsilon,
        "averaging": found.as_dict(),
        "comparison": measured.as_json(),
    }
    return ShortReport(_page(found, scene, measured, pictures), content, pictures)


def answer(scene: Scene, measured: Comparison, epsilon: str) -> tuple[str, Markup]:
    """Whether an averaged run meets the scene's tolerance at its `epsilon`, as it is set, and through which order."""
    nearest = min(measured.epsilons, key=lambda e: abs(e - scene.epsilon))
    errors = {n: values[measured.epsilons.index(nearest)] for n, values in measured.errors.items()}
    at = Markup("At {} = {} the error of order {} is {}, and {} is the tolerance.")
    for n, error in errors.items():
        if error <= scene.tolerance:
            return "Yes", at.format(
                Markup(epsilon), number(nearest), n, number(error, 2), number(scene.tolerance)
            )
    known = {n: error for n, error in errors.items() if error == error}
    if not known:
        return "Unknown", Markup("no averaged run reached the end.")
    best = min(known, key=lambda n: known[n])
    return "No", at.format(
        Markup(epsilon), number(nearest), best, number(known[best], 2), number(scene.tolerance)
    )


def _page(found: Averaging, scene: Scene, measured: Comparison, pictures: Mapping[str, bytes | Missing]) -> str:
    epsilon, phase = found.epsilon, found.form.phase
    slow = list(found.form.rates)
    setting = Setting([epsilon, *found.system.parameters, *found.system.states, *slow, phase], scene.units)
    turning = row(setting.set.row(epsilon), dotted(setting.set.row(phase)))
    moves = {**{s: dotted(setting.set.row(s)) for s in slow}, phase: turning}
    coefficients = {s: [each[s] for each in found.averaged_field] for s in slow} | {
        phase: list(found.frequency)
    }
    rows = [
        (setting.inline(moves[s]), k, e)
        for s, terms in coefficients.items()
        for k, e in enumerate(terms)
        if k and e != 0
    ]
    for k, shifts in enumerate(found.transformation, 1):
        rows += [
            (Markup("{} before averaging").format(setting.inline(s)), k, e) for s, e in shifts.items() if e != 0
        ]
    orders = list(measured.errors)
    return (
        environment_of_pages()
        .get_template("averaged.html")
        .render(
            found=found,
            scene=scene,
            measured=measured,
            title=scene.title or scene.name or "A system with a fast phase",
            epsilon=setting.inline(epsilon),
            answer=answer(scene, measured, setting.inline(epsilon)),
            phase=setting.inline(phase),
            slow=setting.names(slow),
            orders=orders,
            slopes=["at rounding" if measured.is_exact(n) else fitted(measured.slopes[n]) for n in orders],
            equations=setting.rates(zip(found.system.states, found.system.rates)),
            parameters=[setting.named_value(p, value) for p, value in found.system.parameters.items()],
            start=[setting.named_value(sp.Symbol(name), value) for name, value in scene.start.items()],
            time_unit=setting.unit(TIME),
            coordinates=[
                setting.block(setting.set.row(s), e) for s, e in found.form.coordinates.items() if s != e
            ],
            leading=[setting.block(moves[s], terms[0]) for s, terms in coefficients.items()],
            rows=[
                {
                    "left": left,
                    "power": setting.inline(epsilon**k),
                    "coefficient": setting.inline(e)
                    if sp.count_ops(e) <= OPERATIONS
                    else "too long to be set here; report.json has it",
                }
                for left, k, e in rows
            ],
            figures=figures(pictures, lambda name: Markup(CAPTIONS[name])),
            panel=None,
        )
    )
