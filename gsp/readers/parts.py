"""The parts that the expressions of one file are built of: each is built by SymPy once, and looked at once."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any

import sympy as sp

from gsp.algebra.canonical import new_parts

_NOT_REAL = frozenset({sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I})


class Parts:
    """What has been built of which operation and arguments, and what of it is known to be in order."""

    def __init__(self) -> None:
        self._made: dict[tuple[Hashable, ...], Any] = {}
        self._real: set[sp.Basic] = set()
        self._short: set[sp.Basic] = set()

    def once(self, build: Callable[[], Any], *key: Hashable) -> Any:
        """What `build` returns, from memory if it was asked for the same `key` before; what it raises is not kept."""
        made = self._made.get(key)
        if made is None:
            made = self._made[key] = build()
        return made

    def is_real(self, expression: sp.Basic) -> bool:
        """Whether no part of `expression` is infinite, undefined or the imaginary unit."""
        new = new_parts(expression, self._real)
        if not _NOT_REAL.isdisjoint(new):
            return False
        self._real |= new
        return True

    def new_numbers(self, expression: sp.Basic) -> list[sp.Rational]:
        """The rational numbers in those parts of `expression` that were in none before it."""
        new = new_parts(expression, self._short)
        self._short |= new
        return [part for part in new if isinstance(part, sp.Rational)]
