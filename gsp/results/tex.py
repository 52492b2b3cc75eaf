"""Expressions in TeX, by SymPy's printer, but for names that it would set as something else.

SymPy takes the end of a name for an instruction, kabs for |k|, and x__2 for x^2; of a name of several letters it makes
a product.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Mapping

import sympy as sp

_ACCENTED = r"\\(?:dot|ddot|hat|bar|tilde|vec|check|breve|acute|grave|mathring)\{(?:[A-Za-z]|\\[A-Za-z]+)\}"
_SET = re.compile(
    rf"(?:(?P<letter>[A-Za-z]|\\[A-Za-z]+|{_ACCENTED})|(?P<word>[A-Za-z][A-Za-z0-9]+))"
    r"(?P<below>_\{[^{}^]*[^{}^ ]\})?"
)


def tex(expression: sp.Basic, *, names: Mapping[sp.Symbol, str] = {}) -> str:
    """`expression` in TeX; `names` are those of symbols that are set in another way than by `name_in_tex`.

    >>> s, es = sp.symbols("s es")
    >>> tex(s * es**2)
    '\\\\mathrm{es}^{2} s'
    """
    found = {s: name_in_tex(s.name) for s in expression.atoms(sp.Symbol)}
    return sp.latex(expression, symbol_names={**found, **names})


def name_in_tex(name: str) -> str:
    """A name as a letter with what stands below it, a word upright, and as it is spelt where that would be no name.

    >>> [name_in_tex(name) for name in ("omega_max", "Km_1", "kabs", "x__2")]
    ['\\\\omega_{max}', '\\\\mathrm{Km}_{1}', '\\\\mathrm{kabs}', '\\\\mathrm{x\\\\_\\\\_2}']
    """
    found = _SET.fullmatch(sp.latex(sp.Symbol(spelt(name))))
    if found is None:
        return as_spelt(name)
    # A blank between two indices is nothing in mathematics: k_{1 2} would be read as k_{12}.
    below = (found["below"] or "").replace(" ", r"\,")
    return (found["letter"] or rf"\mathrm{{{found['word']}}}") + below


def as_spelt(name: str) -> str:
    """A name upright, with all its characters."""
    return rf"\mathrm{{{spelt(name)}}}".replace("_", r"\_")


def spelt(name: str) -> str:
    """A name in the letters A to Z, digits and underscores: Greek letters by their names, others as underscores.

    >>> spelt("\u03c3"), spelt("\u00b5_max"), spelt("e\u0301")
    ('sigma', 'mu_max', 'e_')
    """
    return "".join(map(_letter, unicodedata.normalize("NFD", name)))


def _letter(character: str) -> str:
    if character.isascii():
        return character
    words = [word for word in unicodedata.name(character, "?").split() if word != "SYMBOL"]
    if words[0] == "MICRO":
        return "mu"
    if words[0] != "GREEK":
        return "_"
    # Unicode's spelling of lambda.
    word = {"LAMDA": "LAMBDA"}.get(words[-1], words[-1])
    return word.capitalize() if "CAPITAL" in words else word.lower()
