"""Regions: boxes of named intervals, and the checks that every box goes through."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.results.bounds import digits_of
from gsp.systems.arguments import shown
from gsp.systems.flow import LARGEST, values_by_name

Interval = tuple[float, float]
# A point is in a box when it lies outside by less than this, relative to its width: a loss on the edge counts. Points
# of a branch are found so well.
EDGE = 1e-12


@dataclass(frozen=True, eq=False)
class ImageBox(Mapping[str, Interval]):
    """The box around the image of a region in other coordinates, with places in it that no state of the region has.

    `exists` takes points (m, n) in these coordinates, fast ones as NaN where any will do, and tells which of them
    states of the region have: (m,) bool.
    """

    intervals: Mapping[str, Interval]
    exists: Callable[[np.ndarray], np.ndarray]

    def __getitem__(self, name: str) -> Interval:
        return self.intervals[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.intervals)

    def __len__(self) -> int:
        return len(self.intervals)

    def __repr__(self) -> str:
        return f"ImageBox({dict(self.intervals)})"


def state_sizes(region: Mapping[str, Interval], *points: Mapping[str, float]) -> dict[str, float]:
    """How large states are: the furthest end of each one's interval, or its values at `points`.

    One that is 0 in all of them says nothing of its size, and is left out.

    >>> state_sizes({"x": (-3, 2)}, {"x": 1.0, "y": 0.0})
    {'x': 3.0}
    """
    sizes = {name: max(abs(float(low)), abs(float(high))) for name, (low, high) in region.items()}
    for point in points:
        for name, value in point.items():
            sizes[name] = max(sizes.get(name, 0.0), abs(float(value)))
    return {name: size for name, size in sizes.items() if size > np.finfo(float).tiny}


def powers_of_two(sizes: Sequence[float] | np.ndarray) -> np.ndarray:
    """The power of two next to each of the positive `sizes` (n,): units that leave every digit as it is."""
    return np.exp2(np.round(np.log2(sizes)))


def balancing_units(matrix: np.ndarray) -> np.ndarray:
    """Units of the variables (n,), powers of two, in which rows and columns of a matrix (n, n) are alike in size."""
    from scipy.linalg import matrix_balance

    with np.errstate(invalid="ignore"):
        # SciPy reads large units as numbers of rows, too, and leaves what it read.
        answer: Any = matrix_balance(matrix, permute=False, separate=True)
    return answer[1][0]


def in_units(of: Mapping[sp.Symbol, sp.Expr], units: Mapping[sp.Symbol, float]) -> dict[sp.Symbol, sp.Expr]:
    """Values or rates by symbol where each symbol is in one of its `units`, and so is what belongs to it.

    >>> x = sp.Symbol("x")
    >>> in_units({x: 4 - x**2}, {x: 2.0})
    {x: 2 - 2*x**2}
    """
    exact = {s: sp.Rational(*float(unit).as_integer_ratio()) for s, unit in units.items()}
    inner = {s: unit * s for s, unit in exact.items()}
    return {s: e.xreplace(inner) / exact.get(s, 1) for s, e in of.items()}


def with_sides(region: Mapping[str, Interval], sides: Mapping[str, Interval]) -> Mapping[str, Interval]:
    """The region with other intervals for some names; the states of an image stay what they were."""
    intervals = MappingProxyType({**region, **sides})
    return replace(region, intervals=intervals) if isinstance(region, ImageBox) else intervals


def is_within(point: Mapping[str, float], region: Mapping[str, Interval]) -> bool:
    """Whether no variable of the point that the region bounds is outside it, to rounding."""
    within = {name: bounds for name, bounds in region.items() if name in point}
    return all(
        low - EDGE * (high - low) <= point[name] <= high + EDGE * (high - low)
        for name, (low, high) in within.items()
    )


def shown_region(region: Mapping[str, Interval]) -> str:
    """A region as text: "x in [0, 1], y in [-2, 2]"."""
    ends = {name: shown_ends(bounds) for name, bounds in region.items()}
    return ", ".join(f"{name} in [{low}, {high}]" for name, (low, high) in ends.items())


def shown_ends(bounds: Interval) -> tuple[str, str]:
    """Both ends as text, to the digits of `digits_between`."""
    low, high = (f"{end:.{digits_between(bounds)}g}" for end in bounds)
    return low, high


def shown_within(value: float, bounds: Interval) -> str:
    """A place between two ends as text, to four digits or as many more as these need to be told apart.

    Between a negative and a positive end what these digits of the ends would not show is 0.

    >>> shown_within(-3.4e-6, (-1, 1)), shown_within(-3.4e-6, (-1e-5, 1)), shown_within(3.4e-6, (0, 1))
    ('0', '-3.4e-06', '3.4e-06')
    """
    digits = digits_between(bounds, 4)
    hidden = bounds[0] < 0.0 < bounds[1] and abs(value) < 0.5 * 10.0**-digits * min(-bounds[0], bounds[1])
    return "0" if hidden else f"{value:.{digits}g}"


def digits_between(bounds: Interval, least: int = 6) -> int:
    """To how many digits two ends are told: to the `least` of each, and of what is between them."""
    return min(max(digits_of(*bounds, least) - 1, least), 17)


def rounded_outwards(low: float, high: float, accuracy: float) -> Interval:
    """The interval with ends in no more digits than the accuracy has, for who reads them."""
    # A state may be as small as numbers get.
    places = math.floor(math.log10(max(accuracy, np.finfo(float).tiny)))
    step = Fraction(10) ** places
    ends = math.floor(Fraction(low) / step), math.ceil(Fraction(high) / step)
    return float(f"{ends[0]}e{places}"), float(f"{ends[1]}e{places}")


def check_interval(bounds: object, *, what: str, remedy: str) -> Interval:
    """(low, high) as finite floats with low < high; raises `DeclarationError` otherwise."""
    be = "are" if what.partition(" ")[0] in ("bounds", "amplitudes") else "is"
    if isinstance(bounds, (str, bytes)) or not isinstance(bounds, Iterable):
        raise DeclarationError(f"{what} {be} a pair of numbers.", remedy, got=shown(bounds), value=bounds)
    ends = tuple(bounds) if not isinstance(bounds, np.ndarray) or bounds.ndim else ()
    if len(ends) != 2:
        raise DeclarationError(f"{what} {be} a pair of numbers.", remedy, got=f"{len(ends)} of them")
    values = values_by_name({"low": ends[0], "high": ends[1]}, what=f"the {what}")
    low, high = values["low"], values["high"]
    if not low < high:
        fact = f"{be} empty" if low == high else f"{be} reversed"
        raise DeclarationError(f"the {what} {fact}.", remedy, got=f"({low:g}, {high:g})")
    return low, high


def check_region(
    region: Mapping[str, object] | Mapping[sp.Symbol, object],
    names: Sequence[str],
    *,
    required: Sequence[str] = (),
    what: str = "region",
) -> Mapping[str, Interval]:
    """`region` as {name: (low, high)} in the order of `names`, every `required` name among them.

    Raises `DeclarationError` for unknown names, missing ones, and intervals that are empty, reversed, or so large or
    narrow that double precision does not hold their third powers.
    """
    if not isinstance(region, Mapping):
        raise DeclarationError(f"{what} maps states to intervals (low, high).", got=shown(region), value=region)
    given: dict[str, Interval] = {}
    for key, bounds in region.items():
        name = key.name if isinstance(key, sp.Symbol) else key
        if name not in names:
            raise DeclarationError.none_of(
                names, name, f'{what} bounds "{name}", which is no state.', "The states are"
            )
        if name in given:
            raise DeclarationError(f'{what} bounds "{name}" twice.', "Give one interval.")
        given[name] = check_interval(
            bounds, what=f"region of {name}", remedy="Give (low, high) with low < high."
        )
        low, high = given[name]
        if max(abs(low), abs(high)) > LARGEST or high - low < 1.0 / LARGEST:
            raise DeclarationError(
                f"the region of {name} reaches beyond {LARGEST:g} or is narrower than {1.0 / LARGEST:g}.",
                f"Rescale {name}, or move the region.",
                got=f"({low:g}, {high:g})",
            )
    if not given:
        raise DeclarationError(
            "region bounds no state.",
            f"Give at least one of {', '.join(required or names)} an interval (low, high).",
            got="{}",
        )
    missing = [name for name in required if name not in given]
    if missing:
        raise DeclarationError(
            f"region gives no interval for {', '.join(missing)}.", "Give each (low, high).", got=given
        )
    checked = MappingProxyType({name: given[name] for name in names if name in given})
    return replace(region, intervals=checked) if isinstance(region, ImageBox) else checked
