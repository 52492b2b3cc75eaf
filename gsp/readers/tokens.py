"""The words of an expression: numbers, names and operators, each with its place in the text."""

from __future__ import annotations

import re
from collections.abc import Iterable
from functools import lru_cache
from typing import NamedTuple, NoReturn

import sympy as sp

from gsp.errors import ModelFileError

TOKENS = 5_000
DIGITS = 50
EXPONENT = 300

_TOKEN = re.compile(
    r"[ \t\r\n]*(?:(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_]*)|(?P<operator>\*\*|[-+*/^(),])|(?P<end>\Z))"
)
_BLANK = re.compile(r"[ \t\r\n]*")
_NUMBER = re.compile(r"([0-9]*)\.?([0-9]*)(?:[eE]([+-]?)([0-9]+))?")


class Token(NamedTuple):
    """One word: its kind (number, name, operator or end), its text, and where it begins."""

    kind: str
    text: str
    position: int


_token = Token._make


def tokenise(text: str, functions: Iterable[str]) -> list[Token]:
    """The words of `text`, the last of kind "end"; `functions` are named in errors.

    Raises `ModelFileError` at a character that means nothing and beyond `TOKENS` words.
    """
    tokens: list[Token] = []
    position = 0
    for match in _TOKEN.finditer(text):
        if match.start() != position:
            blank = _BLANK.match(text, position)
            start = blank.end() if blank else position
            fail_at(
                text,
                f"the character {text[start]!r} means nothing in an expression",
                start,
                f"Use numbers, names, + - * / ^, parentheses and the functions {', '.join(sorted(functions))}.",
            )
        kind = match.lastgroup or ""
        start, position = match.span(kind)
        tokens.append(_token((kind, text[start:position], start)))
        if kind == "end":
            break
        if len(tokens) > TOKENS:
            fail_at(text, f"the expression has more than {TOKENS} symbols", start, "Split it.")
    return tokens


def fail_at(text: str, fact: str, position: int, remedy: str) -> NoReturn:
    """Raise `ModelFileError` with the fact, the remedy, and a caret under the place in `text`."""
    low = max(0, position - 40)
    excerpt = "".join(c if c.isprintable() else " " for c in text[low : position + 30])
    caret = " " * (position - low) + "^"
    place = f"\n    {excerpt}\n    {caret}"
    raise ModelFileError(f"{fact}, at character {position + 1}.", f"{remedy}{place}") from None


class NumberError(ModelFileError):
    """A number that a model file may not hold."""


@lru_cache(maxsize=4096)
def parse_number(text: str) -> sp.Rational:
    """Exact rational of a decimal number without sign, as the grammar writes it.

    Raises `NumberError` when there are more than `DIGITS` digits or the exponent exceeds `EXPONENT`.

    >>> parse_number("1.5e-3")
    3/2000
    """
    match = _NUMBER.fullmatch(text)
    if match is None or not (match[1] or match[2]):
        raise NumberError(f"{text[:60]!r} is no decimal number.", "Write it as 0.5 or 1e-3.")
    digits, exponent = match[1] + match[2], (match[4] or "0").lstrip("0") or "0"
    if len(digits) > DIGITS:
        raise NumberError(
            f"a number has {len(digits)} digits; {DIGITS} are allowed.",
            "Shorten it.",
            limit=DIGITS,
            value=len(digits),
        )
    if len(exponent) > 3 or int(exponent) > EXPONENT:
        raise NumberError(
            f"the number {text[:60]} has a decimal exponent beyond {EXPONENT}.", "Rescale the variables."
        )
    power = (-int(exponent) if match[3] == "-" else int(exponent)) - len(match[2])
    return sp.Integer(int(digits)) * sp.Integer(10) ** power
