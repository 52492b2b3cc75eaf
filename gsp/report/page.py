"""The page of a report: what an analysis says, in the words and the mathematics of a short paper.

Words come from here and from templates/report.html; all that comes from a model file is escaped there.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from gsp.analysis.analysis import Analysis
from gsp.demos.demo import Demo
from gsp.demos.page import frame_script
from gsp.reductions.reductions import Reductions
from gsp.report.captions import caption
from gsp.report.reductions import reductions_found
from gsp.report.sections import Page
from gsp.report.three_scales import ThreeScales
from gsp.report.wording import ends, listed, number, scientific, signed, words
from gsp.results.attempts import Missing, attempt
from gsp.results.lettering import in_unicode
from gsp.scenes.scene import Scene


def render(
    analysis: Analysis,
    *,
    pictures: Mapping[str, bytes | Missing],
    panel: Demo | Missing,
    reductions: Reductions | None,
    three: ThreeScales | Missing | None,
    timings: Mapping[str, float],
    model: str | None,
) -> str:
    """The page as self-contained HTML; `pictures` are PNG files by chart, in the order of the page. `model` names
    the model file beside it, where the scene can be kept in one, `panel` is the demo at its top, and `reductions` is
    what of a model without a small parameter may be left out; `three` is of one with two.

    A section or a figure that cannot be made costs itself: its reason stands in its place.
    """
    page = Page(analysis)
    return (
        environment_of_pages()
        .get_template("report.html")
        .render(
            **page.head(),
            page=page,
            section=_section,
            figures=figures(
                pictures,
                lambda name: caption_or_reason(name, analysis, page),
                None if model is None else lambda name: _code(analysis, name, model),
            ),
            reductions=None if reductions is None else reductions_found(reductions),
            three=three,
            no_three=words(three.reason) if isinstance(three, Missing) else None,
            **panel_values(panel),
            timings=timings,
            versions=analysis.versions,
        )
    )


@dataclass(frozen=True)
class ShortReport:
    """The page of a report of something else than an analysis, what report.json holds, and its figures.

    `pictures` are PNG files by name, or why there is none.
    """

    page: str
    content: dict[str, Any]
    pictures: Mapping[str, bytes | Missing]

    @property
    def made(self) -> dict[str, bytes]:
        """The pictures that could be drawn, by the names of their files."""
        return {f"{name}.png": each for name, each in self.pictures.items() if not isinstance(each, Missing)}

    def as_json(self) -> dict[str, Any]:
        """What report.json holds, with the names of the figures, and why others are missing."""
        lost = {f"{k}.png": each.reason for k, each in self.pictures.items() if isinstance(each, Missing)}
        return self.content | {"figures": list(self.made), "missing": lost}


def said_of(scene: Scene) -> dict[str, str]:
    """What a scene says of itself, as it stands in report.json."""
    return {name: getattr(scene, name) for name in ("name", "title", "source", "description")}


def environment_of_pages() -> Environment:
    """The templates with the words that all of them use."""
    environment = Environment(
        loader=PackageLoader(__name__.rpartition(".")[0]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "ends": ends,
        "number": number,
        "scientific": scientific,
        "words": words,
        "listed": listed,
        "signed": signed,
        "in_unicode": in_unicode,
    }
    return environment


def _section(heading: str, caller: Callable[[], Markup]) -> Markup:
    """The body of a section, as `{% call section("...") %}` hands it over, or why there is none."""
    made = attempt(f'the section "{heading}"', caller)
    if isinstance(made, Missing):
        return Markup('<p class="note missing">This part could not be made: {}</p>').format(words(made.reason))
    return made


def figures(
    pictures: Mapping[str, bytes | Missing],
    caption: Callable[[str], Markup],
    code: Callable[[str], str] | None = None,
) -> dict[str, dict[str, Any]]:
    """The figures of the template by name, each with its number, caption and `code`, or why there is none.

    `pictures` are PNG files, in the order of the page.
    """
    result: dict[str, dict[str, Any]] = {}
    made = 0
    first_named: dict[str, str] = {}
    for name, picture in pictures.items():
        if isinstance(picture, Missing):
            # A long reason that many pictures share is read once.
            first = first_named.setdefault(picture.reason, name)
            same = Markup('<a href="#{}">the same reason as above</a>').format(first)
            result[name] = {"reason": words(picture.reason) if first == name else same}
            continue
        made += 1
        data = base64.b64encode(picture).decode()
        result[name] = {
            "number": made,
            "source": Markup("data:image/png;base64,{}").format(data),
            "caption": caption(name),
            "reason": None,
            "code": None if code is None else code(name),
        }
    return result


def panel_values(panel: Demo | Missing) -> dict[str, Any]:
    """Values for the template's panel: the demo, or why there is none, and the script of its frame."""
    script, script_hash = frame_script()
    return {
        "panel": None if isinstance(panel, Missing) else panel,
        "no_panel": words(panel.reason) if isinstance(panel, Missing) else None,
        "frame_script": Markup(script),
        "frame_hash": script_hash,
    }


def caption_or_reason(name: str, analysis: Analysis, page: Page) -> Markup:
    """The caption of a figure of an analysis, or why there is none."""
    text = attempt(f"the caption of {name}", lambda: caption(name, analysis, page.set))
    return words(text.reason) if isinstance(text, Missing) else text


def _code(analysis: Analysis, name: str, model: str) -> str:
    """Python that draws the figure again, in the report's folder."""
    if name in ("time_scales", "three_scales"):
        verb = "time_scales" if name == "time_scales" else "nest"
        return (
            f'import gsp\n\naxes = gsp.{verb}(gsp.load("{model}")).plot()\ngsp.charts.save(axes, "{name}.svg")'
        )
    order = "" if "series" in analysis.lost else f", order={analysis.series.order}"
    return (
        "import gsp\n\n"
        f'analysis = gsp.analyse(gsp.load("{model}"){order})\n'
        f'axes = gsp.charts.applicable(analysis)["{name}"](analysis)\n'
        f'gsp.charts.save(axes, "{name}.svg")'
    )
