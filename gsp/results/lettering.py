"""Running text and printed formulas with the letters of mathematics: epsilon as ε, a^2 as a², sqrt(x) as √(x).

Only what is read by people goes through here; files, JSON and what another program reads keep their plain letters.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import zip_longest

_NAMES = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon phi chi psi "
    "omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
)
GREEK: Mapping[str, str] = dict(zip(_NAMES.split(), "αβγδεζηθικλμνξπρστυφχψωΓΔΘΛΞΠΣΥΦΨΩ"))
_SUPERSCRIPTS = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
_SUBSCRIPTS = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
_SIGNS = {"<=": "≤", ">=": "≥", "!=": "≠", "+-": "±"}

# What a person types as it stands: code between backticks, options as in --epsilon, and arguments as in epsilon=0.1.
_CODE, _ARGUMENT = r"`[^`]*`|--[\w-]+", r"\b\w+=(?![=\s])"
_REST = (
    # A name, with its number below: epsilon, k_1 and h_0, also within M_epsilon.
    rf"|(?P<greek>(?:(?<![\w.])|(?<=\b[A-Za-z]_))(?:{'|'.join(GREEK)}))(?![A-Za-z])(?:_?(?P<below>[0-9]+)(?![0-9A-Za-z.]))?"
    r"|(?<=\b[A-Za-z])_(?P<index>[0-9]+)\b"
    r"|(?:\*\*|\^)(?P<power>-?[0-9]+)(?![0-9.])"
    r"|(?:\*\*|\^)\((?P<bracketed>-?[0-9]+)\)"
    r"|(?P<raised>\*\*)"
    r"|\b(?P<root>sqrt)(?=\()"
    r"|(?<=[\w)\]])(?P<product>\*)(?=[\w(])"
    r"|(?<=[0-9] )(?P<micro>u)(?=s\b)"
    rf"|(?P<sign>{'|'.join(map(re.escape, _SIGNS))})(?!>)"
)
_PATTERN = re.compile(rf"(?P<typed>{_CODE}|{_ARGUMENT}){_REST}")
_SHOWN = re.compile(rf"(?P<typed>{_CODE}){_REST}")


def in_unicode(text: str, *, is_typed: bool = True) -> str:
    """`text` as people write it; what lies in columns stays below one another.

    Where nobody types it again, with `is_typed` False, names of arguments change too, as in ε=0.1.

    >>> in_unicode("x' = -epsilon*x**2 + sqrt(omega)*h_0, at --epsilon 0.1")
    "x' = -ε·x² + √(ω)·h₀, at --epsilon 0.1"
    >>> in_unicode("15 us a run")
    '15 μs a run'
    """
    pattern = _PATTERN if is_typed else _SHOWN
    return "\n".join(_line(line, pattern) for line in text.split("\n"))


_RATE = re.compile(rf"([A-Za-z]|{'|'.join(GREEK)})(d?)dot")


def rate_of(name: str) -> tuple[str, int] | None:
    """What a name such as phidot or xddot is the rate of, and how many dots it has; None for any other name."""
    found = _RATE.fullmatch(name)
    return None if found is None else (found[1], 1 + len(found[2]))


def letter(name: str) -> str:
    """The name of one symbol: its Greek letter, with the number below or with the dots of a rate above.

    >>> letter("epsilon"), letter("k_1"), letter("K_M"), letter("xdot") == "x\u0307"
    ('ε', 'k₁', 'K_M', True)
    """
    if rate := rate_of(name):
        return GREEK.get(rate[0], rate[0]) + "\u0307\u0308"[rate[1] - 1]
    return _PATTERN.sub(_written, re.sub(r"^([A-Za-z]|[A-Za-z]*[a-z])([0-9]+)$", r"\1_\2", name))


def _line(line: str, pattern: re.Pattern[str]) -> str:
    """Gaps of two blanks part columns: what a cell loses its gap gains; indented equations keep their signs in line."""
    if equation := re.match(r" {2,}(\S[^=]*) = ", line):
        left = pattern.sub(_written, equation[1])
        indent = " " * (equation.end(1) - len(left))
        return indent + left + _line(line[equation.end(1) :], pattern)
    pieces = re.split(r"( {2,})", line)
    made: list[str] = []
    for cell, gap in zip_longest(pieces[::2], pieces[1::2], fillvalue=""):
        shown = pattern.sub(_written, cell)
        made += [shown, gap + " " * (len(cell) - len(shown) if gap else 0)]
    return "".join(made)


def _written(found: re.Match[str]) -> str:
    if found["typed"]:
        return found["typed"]
    if found["greek"]:
        return GREEK[found["greek"]] + (found["below"] or "").translate(_SUBSCRIPTS)
    if found["index"]:
        return found["index"].translate(_SUBSCRIPTS)
    if power := found["power"] or found["bracketed"]:
        return power.translate(_SUPERSCRIPTS)
    if found["micro"]:
        return "μ"
    if found["root"]:
        return "√"
    return "^" if found["raised"] else "·" if found["product"] else _SIGNS[found["sign"]]
