"""The card of a value, as HTML that needs no script, and its equations as LaTeX."""

from __future__ import annotations

import base64

from markupsafe import Markup

from gsp.results import registry
from gsp.results.attempts import Missing, attempt
from gsp.results.equations import Equation, equations_of, symbols_of
from gsp.results.lettering import in_unicode
from gsp.results.mathml import Typesetter, math

FRAME = Markup(
    '<div class="gsp-card" style="border:1px solid #8886;border-radius:6px;padding:.6em .9em;max-width:60em">'
    '<div style="font-weight:600;margin-bottom:.4em">{}</div>{}</div>'
)
TABLE = Markup(
    '<div style="overflow-x:auto"><table style="border:0;background:none;font-size:1.05em">{}</table></div>'
)
LINE = Markup(
    '<tr style="background:none"><td style="text-align:right;border:0;padding:.15em">{}</td>'
    '<td style="text-align:left;white-space:nowrap;border:0;padding:.15em">= {}</td></tr>'
)
# Notebooks give <pre> a font of their own, in which columns do not stand below one another.
WORDS = Markup(
    '<pre style="white-space:pre-wrap;word-break:normal;overflow-wrap:anywhere;font-family:monospace;font-size:.85em;'
    'margin:.5em 0 0;background:none">{}</pre>'
)
FIGURE = Markup(
    '<img alt="{}" style="max-width:100%;width:36em;background:#fff" src="data:image/png;base64,{}">'
)


def html(value: object) -> str:
    """A card: the kind of the value, its equations as MathML, what it prints, its figure. All text is escaped."""
    parts = [_mathematics(equations_of(value)), WORDS.format(in_unicode(str(value), is_typed=False))]
    if registry.charts.find(value) is not None:
        parts.append(_figure(value))
    return str(FRAME.format(type(value).__name__, Markup("").join(parts)))


def latex(value: object) -> str | None:
    """The equations, aligned; None for a value that has none, of which a notebook shows the card or the text."""
    equations = equations_of(value)
    if not equations:
        return None
    body = r" \\ ".join(equation.latex() for equation in equations)
    return rf"$\displaystyle \begin{{aligned}}{body}\end{{aligned}}$"


def _mathematics(equations: list[Equation]) -> Markup:
    if not equations:
        return Markup("")
    setter = Typesetter(symbols_of(equations))
    lines = [
        LINE.format(*(Markup(math(side, display=True)) for side in equation.mathml(setter)))
        for equation in equations
    ]
    return TABLE.format(Markup("").join(lines))


def _figure(value: object) -> Markup:
    name = type(value).__name__
    picture = attempt(f"the figure of a {name}", lambda: registry.draw(value)._repr_png_())
    if isinstance(picture, Missing):
        return WORDS.format(in_unicode(f"no figure: {picture.reason}"))
    return FIGURE.format(f"Figure of the {name}", base64.b64encode(picture).decode("ascii"))
