"""Text of a page with formulas between dollar signs: words are escaped, formulas are set as MathML."""

from __future__ import annotations

import re

import sympy as sp
from markupsafe import Markup, escape

from gsp.errors import ModelFileError, met_at, printable
from gsp.readers.expressions import FUNCTIONS, parse_expression
from gsp.results.lettering import in_unicode
from gsp.results.mathml import Typesetter, dotted, math, operator

_RELATION = re.compile(r"(<=|>=|!=|->|=|<|>|,)")
_NUMBER = re.compile(r"[+-]?[0-9]*\.?[0-9]+")
_NAME = re.compile(r"[A-Za-z]\w*")
_RATE = re.compile(r"([A-Za-z]\w*)'")
_SIGNS = {"<=": "≤", ">=": "≥", "!=": "≠", "->": "→"}


def markup(text: str) -> str:
    """HTML of `text`: between dollar signs formulas as in a model file, a relation or a list of them.

    Raises `ModelFileError` for a dollar sign that is alone, and for a formula that the grammar does not have.

    >>> markup("The rate $v' = a^2$.")[:42]
    'The rate <math><mover><mi>v</mi><mo mathsi'
    """
    pieces = printable(text).split("$")
    if len(pieces) % 2 == 0:
        raise ModelFileError("a dollar sign opens a formula that is not closed.", "Write $epsilon = 0.1$.")
    made = [formula(piece) if k % 2 else escape(in_unicode(piece)) for k, piece in enumerate(pieces)]
    return str(Markup("").join(made))


def formula(text: str) -> Markup:
    """A formula as MathML: expressions of the grammar of model files, with =, <, >, <=, >=, -> and commas between."""
    symbols = {n: sp.Symbol(n) for n in dict.fromkeys(_NAME.findall(text)) if n not in FUNCTIONS and n != "pi"}
    setter = Typesetter(symbols.values())
    made = []
    for piece in _pieces(text):
        if _RELATION.fullmatch(piece):
            made.append(operator(_SIGNS.get(piece, piece)))
        elif rate := _RATE.fullmatch(piece):
            made.append(dotted(setter.row(symbols[rate[1]])))
        elif _NUMBER.fullmatch(piece):
            made.append(f"<mn>{piece.replace('-', '−')}</mn>")
        else:
            with met_at(f"in the formula {text[:60]}"):
                made.append(setter.row(parse_expression(piece, symbols=symbols)))
    return Markup(math(*made))


def _pieces(text: str) -> list[str]:
    """Expressions and the signs between them; a comma within brackets parts nothing."""
    found, depth = [""], 0
    for part in re.split(r"([()])|" + _RELATION.pattern, text):
        if not part:
            continue
        depth += (part == "(") - (part == ")")
        if depth == 0 and _RELATION.fullmatch(part):
            found += [part, ""]
        else:
            found[-1] += part
    return [piece.strip() for piece in found if piece.strip()]
