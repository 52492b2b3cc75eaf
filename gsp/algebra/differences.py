"""The difference of two elements of a ring, which follows from their sum and their product with an integer."""

from __future__ import annotations

from typing import Any, Self


class Subtractable:
    """An element of a ring that has + and *; a class that negates at less cost than a product says so itself."""

    __slots__ = ()

    def __add__(self, other: Any) -> Any: ...

    def __mul__(self, other: Any) -> Any: ...

    def __neg__(self) -> Self:
        return self * -1

    def __sub__(self, other: Self) -> Self:
        return self + (-other)
