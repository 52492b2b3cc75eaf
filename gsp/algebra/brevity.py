"""Expressions and lists as a line of text can hold them, and the shorter of two forms of one expression."""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp

from gsp.algebra.factorisation import factored, lowest_terms
from gsp.algebra.sharing import operations

# Characters of an expression in a message.
SHOWN = 240
# Characters of a formula that stands in the middle of a line or a table: what takes more hides what is beside it.
HALF_LINE = 64
# How many of many quantities a message lists.
LISTED = 12


def brief(expression: sp.Expr) -> str:
    """`expression` as a line of text holds it: a sum's first terms, and how many there are, where all are too long."""
    terms = sp.Add.make_args(sp.sympify(expression, strict=True))
    size = f"{len(terms)} terms" if len(terms) > 1 else f"{operations(terms)} operations"
    # SymPy's printer orders terms by expanding them, which can take minutes: what would be cut is not printed.
    if operations(terms) + len(terms) - 1 > SHOWN:
        short = [str(term) for term in terms if operations([term]) <= SHOWN]
        text = " + ".join([*short, ""]).replace("+ -", "- ") + size
    else:
        text = str(expression)
    if len(text) <= SHOWN:
        return text
    last_space = text[:SHOWN].rfind(" ")
    return f"{text[: last_space if last_space > 0 else SHOWN]} ... ({size})"


def shorter(form: sp.Expr, given: sp.Expr) -> sp.Expr:
    """`form` where it takes no more operations than `given`, parts that are shared counted once."""
    return form if operations([form]) <= operations([given]) else given


def in_lowest_terms(expression: sp.Expr) -> sp.Expr:
    """`lowest_terms` where these are no longer than `expression`: long sums of powers cancel in doubles."""
    return shorter(lowest_terms(expression), expression)


def in_factors(expression: sp.Expr) -> sp.Expr:
    """`factored` where this is no longer than `expression`."""
    return shorter(factored(expression), expression)


def brief_list(expressions: Iterable[sp.Expr]) -> str:
    """`expressions` in brackets, each as `brief` has it."""
    return f"[{', '.join(map(brief, expressions))}]"


def listed(texts: Iterable[str]) -> str:
    """The first of `texts`, and how many more there are."""
    every = list(texts)
    more = [f"and {len(every) - LISTED} more"] if len(every) > LISTED else []
    return ", ".join([*every[:LISTED], *more])
