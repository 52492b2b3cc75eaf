"""The names of a model as names of another language: identifiers, none of its keywords, no two alike."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator

import sympy as sp

from gsp.results.tex import spelt


def renamed(
    symbols: Iterable[sp.Symbol],
    *,
    reserved: Collection[str],
    longest: int | None = None,
    cases: bool = True,
) -> dict[sp.Symbol, str]:
    """A name for each symbol: its own where that is a free identifier, else one like it.

    `longest` bounds the number of characters; without `cases` names that differ in upper and lower case are alike.
    """

    def same(name: str) -> str:
        return name if cases else name.lower()

    taken = {same(name) for name in reserved}
    names: dict[sp.Symbol, str] = {}
    for symbol in symbols:
        plain = re.sub(r"[^A-Za-z0-9_]", "_", spelt(symbol.name))
        plain = plain if plain[:1].isalpha() else f"n{plain}"
        names[symbol] = next(name for name in _candidates(plain, longest) if same(name) not in taken)
        taken.add(same(names[symbol]))
    return names


def fresh(names: Iterable[str], *, reserved: Collection[str], cases: bool = True) -> Iterator[str]:
    """Names for intermediate values, u0, u1 and so on, that are none of `names` and not `reserved`."""
    taken = {name if cases else name.lower() for name in (*names, *reserved)}
    count = 0
    while True:
        if f"u{count}" not in taken:
            yield f"u{count}"
        count += 1


def _candidates(plain: str, longest: int | None) -> Iterator[str]:
    yield plain[:longest]
    yield plain[: None if longest is None else longest - 1] + "_"
    count = 2
    while True:
        end = f"_{count}"
        yield plain[: None if longest is None else longest - len(end)] + end
        count += 1
