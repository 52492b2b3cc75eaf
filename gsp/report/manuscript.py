"""What of a report goes into a manuscript: report.tex, report.bib and the figures as PDF, which latexmk compiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from gsp.analysis.analysis import Analysis
from gsp.report.page import caption_or_reason
from gsp.report.sections import Page
from gsp.report.tex import Tex, display, tex
from gsp.report.three_scales import ThreeScales
from gsp.report.wording import number, scientific, signed, words
from gsp.results.attempts import Missing, attempt
from gsp.results.lettering import in_unicode

PACKAGE = __name__.rpartition(".")[0]
TEX, BIB = "report.tex", "report.bib"
# Two figures stand side by side: the first of these that there is, and the error of the reduced flow.
FIRST = ("path", "phase_portrait", "manifold", "time_series")
# What is proved of cycles and passages is drawn in these.
PROOFS = ("phenomenon", "passage")
SECOND = "error_against_epsilon"
_METHODS = {
    "radau": r"Radau's method of order %s~\cite{hairer1996}",
    "dop": r"the explicit method DOP853~\cite{hairer1993}",
}


def manuscript(
    analysis: Analysis, *, pictures: Mapping[str, bytes], model: str | None, three: ThreeScales | None = None
) -> dict[str, bytes]:
    """The files of a manuscript by their names; `pictures` are PDF files by chart, and `model` names the model file.
    `three` is the nested reduction of a model with two small parameters.

    Each value that is set goes through `tex`, so that no text of a model is read as a command. A section that cannot
    be made has the reason in its place.
    """
    environment = Environment(
        loader=PackageLoader(PACKAGE),
        undefined=StrictUndefined,
        finalize=tex,
        trim_blocks=True,
        lstrip_blocks=True,
        block_start_string="<%",
        block_end_string="%>",
        variable_start_string="<<",
        variable_end_string=">>",
        comment_start_string="<#",
        comment_end_string="#>",
    )
    environment.filters |= {
        "display": display,
        "in_unicode": in_unicode,
        "listed": _listed,
        "number": number,
        "scientific": scientific,
        "signed": signed,
        "sentence": lambda text: f"{text.rstrip('.')}.",
        "words": words,
    }
    page = Page(analysis)
    limits = attempt("the limits of the reduction", page.reduction_limits)
    shown = [name for name in FIRST if name in pictures][:1]
    shown += [SECOND] if SECOND in pictures else []
    text = environment.get_template(TEX).render(
        **page.head(),
        page=page,
        section=_section,
        figures=[
            {"file": Tex(f"{name}.pdf"), "caption": caption_or_reason(name, analysis, page)} for name in shown
        ],
        full=_method(analysis, "full"),
        reduced=_method(analysis, "reduced"),
        version=analysis.versions["gsp-toolkit"],
        model=model,
        three=three,
        drawn=[Tex(rf"\verb|{name}.pdf|") for name in PROOFS if name in pictures],
        limits=None if isinstance(limits, Missing) else limits,
        order=None if "series" in analysis.lost else analysis.series.order,
    )
    return {
        TEX: text.encode(),
        BIB: files(PACKAGE).joinpath("templates", BIB).read_bytes(),
        **{f"{name}.pdf": picture for name, picture in pictures.items()},
    }


def _section(heading: str, caller: Callable[[], str]) -> str:
    """The body of a section, or why there is none."""
    made = attempt(f'the section "{heading}"', caller)
    return tex(f"This part could not be made: {made.reason}") if isinstance(made, Missing) else made


def _method(analysis: Analysis, run: str) -> Tex:
    """What a run was made by, with its source."""
    if run in analysis.lost:
        return Tex("no method that reached the end")
    method = getattr(analysis, run).stats.method.value
    family = method.rstrip("0123456789")
    return Tex(_METHODS[family].replace("%s", method.removeprefix(family)))


def _listed(items: list[Any]) -> Tex:
    return Tex(", ".join(map(tex, items)))
