"""Expressions and lists as a line of text can hold them."""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp

# Characters of an expression in a message.
SHOWN = 240
# How many of many quantities a message lists.
LISTED = 12


def brief(expression: sp.Expr) -> str:
    """`expression` as a line of text holds it: a sum's first terms, and how many there are, where all are too long."""
    text = str(expression)
    if len(text) <= SHOWN:
        return text
    last_space = text[:SHOWN].rfind(" ")
    terms = len(sp.Add.make_args(expression))
    size = f"{terms} terms" if terms > 1 else f"{len(text)} characters"
    return f"{text[: last_space if last_space > 0 else SHOWN]} ... ({size})"


def listed(texts: Iterable[str]) -> str:
    """The first of `texts`, and how many more there are."""
    every = list(texts)
    more = [f"and {len(every) - LISTED} more"] if len(every) > LISTED else []
    return ", ".join([*every[:LISTED], *more])
