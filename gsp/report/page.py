"""The page of a report: what an analysis says, in the words and the mathematics of a short paper.

Words come from here and from templates/report.html; all that comes from a model file is escaped there.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from gsp.analysis import Analysis
from gsp.report.captions import caption
from gsp.report.sections import Page
from gsp.report.wording import listed, number, scientific, signed, words


def render(analysis: Analysis, *, pictures: Mapping[str, bytes], timings: Mapping[str, float]) -> str:
    """The page as self-contained HTML; `pictures` are PNG files by chart, in the order of the page."""
    environment = Environment(
        loader=PackageLoader("gsp"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "number": number,
        "scientific": scientific,
        "words": words,
        "listed": listed,
        "signed": signed,
    }
    page = Page(analysis)
    return environment.get_template("report.html").render(
        **page.sections(),
        figures=_figures(analysis, page, pictures),
        timings=timings,
        versions=analysis.versions,
    )


def _figures(analysis: Analysis, page: Page, pictures: Mapping[str, bytes]) -> dict[str, dict[str, Any]]:
    result = {}
    for i, (name, picture) in enumerate(pictures.items()):
        data = base64.b64encode(picture).decode()
        result[name] = {
            "number": i + 1,
            "source": Markup("data:image/png;base64,{}").format(data),
            "caption": caption(name, analysis, page.set),
        }
    return result
