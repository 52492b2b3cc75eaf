"""Proved bounds as decimal text, rounded to the side on which they stay true."""

from __future__ import annotations

import math
from collections.abc import Mapping
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal


def at_least(bound: float, digits: int = 6) -> str:
    """A lower bound with at most so many digits: no more than `bound`."""
    return _directed(bound, digits, ROUND_FLOOR)


def at_most(bound: float, digits: int = 6) -> str:
    """An upper bound with at most so many digits: no less than `bound`."""
    return _directed(bound, digits, ROUND_CEILING)


def outside(low: float, high: float, digits: int = 6) -> tuple[str, str]:
    """A lower and an upper bound with so many digits of what is between them: no less of the line than they bound."""
    whole = digits_of(low, high, digits)
    return at_least(low, whole), at_most(high, whole)


def inside(low: float, high: float, digits: int = 6) -> tuple[str, str]:
    """The ends of an interval with so many digits of its width: no more of the line than it is."""
    whole = digits_of(low, high, digits)
    return at_most(low, whole), at_least(high, whole)


def digits_of(low: float, high: float, digits: int) -> int:
    """How many digits of the ends there are in so many of what is between them."""
    width, size = high - low, max(abs(low), abs(high))
    return digits + math.ceil(math.log10(size / width)) if 0.0 < width < size < math.inf else digits


def as_given(value: float) -> str:
    """The shortest decimal that stands for a double: what a proof says holds of it too."""
    return repr(float(value)).removesuffix(".0")


def shown_sides(region: Mapping[str, tuple[float, float]]) -> str:
    """The region of a proof as text, its ends as they are: "x in [0, 1], y in [-2, 0.1234567]"."""
    return ", ".join(f"{name} in [{as_given(low)}, {as_given(high)}]" for name, (low, high) in region.items())


def _directed(bound: float, digits: int, rounding: str) -> str:
    """In the form of "%g"; a double is a decimal exactly."""
    if not math.isfinite(bound) or not bound:
        return f"{bound:g}"
    found = Context(prec=digits, rounding=rounding).normalize(Decimal(bound))
    exponent = found.adjusted()
    if -4 <= exponent < digits:
        return f"{found:f}"
    return f"{found.scaleb(-exponent):f}e{exponent:+03d}"
