"""Numbers as they were given, between doubles: the sides of a box, rounded outwards or inwards, and an epsilon."""

from __future__ import annotations

import math
from collections.abc import Mapping
from decimal import Decimal
from fractions import Fraction
from numbers import Rational
from typing import Any

import sympy as sp

Side = tuple[float, float]


def rounded_sides(region: Mapping[Any, object], checked: Mapping[str, Side]) -> dict[str, tuple[Side, Side]]:
    """The intervals of a `checked` region by name, as they were given in `region`, rounded outwards and inwards."""
    given = {(key.name if isinstance(key, sp.Symbol) else key): ends for key, ends in region.items()}
    return {name: rounded(given[name], ends) for name, ends in checked.items()}


def rounded(given: object, nearest: Side) -> tuple[Side, Side]:
    """An interval rounded outwards and inwards; doubles are what they are."""
    low, high = (_fraction(end) for end in (given if isinstance(given, (tuple, list)) else nearest))
    first, last = nearest
    return (_down(first, low), _up(last, high)), (_up(first, low), _down(last, high))


def written(given: object, nearest: float) -> Side:
    """The doubles about a number and what it was given as: a double stands for the decimal that is printed for it."""
    exact = _fraction(given)
    decimal = Fraction(repr(nearest)) if exact is None else exact
    return _down(nearest, decimal), _up(nearest, decimal)


def _down(nearest: float, exact: Fraction | None) -> float:
    return math.nextafter(nearest, -math.inf) if exact is not None and Fraction(nearest) > exact else nearest


def _up(nearest: float, exact: Fraction | None) -> float:
    return math.nextafter(nearest, math.inf) if exact is not None and Fraction(nearest) < exact else nearest


def _fraction(value: Any) -> Fraction | None:
    if isinstance(value, (Rational, Decimal)):
        return Fraction(value)
    if isinstance(value, sp.Rational):
        return Fraction(int(value.p), int(value.q))
    return None
