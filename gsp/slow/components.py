"""A coefficient of a series: one expression for each of some symbols."""

from __future__ import annotations

from collections.abc import Iterable

import sympy as sp


class Components(tuple):
    """Expressions in the order of some symbols, indexed by place, by symbol or by name."""

    symbols: tuple[sp.Symbol, ...]

    def __new__(cls, symbols: Iterable[sp.Symbol], values: Iterable[sp.Expr]) -> Components:
        self = super().__new__(cls, values)
        self.symbols = tuple(symbols)
        return self

    def __getnewargs__(self) -> tuple:
        return self.symbols, tuple(self)

    def __getitem__(self, key):  # pyright: ignore[reportIncompatibleMethodOverride]
        if isinstance(key, (str, sp.Symbol)):
            names = [symbol.name for symbol in self.symbols]
            name = key if isinstance(key, str) else key.name
            if name not in names:
                raise KeyError(f"{name} is none of {', '.join(names)}")
            return super().__getitem__(names.index(name))
        return super().__getitem__(key)

    def as_dict(self) -> dict[sp.Symbol, sp.Expr]:
        """The same as a mapping."""
        return dict(zip(self.symbols, self))
