"""Where a function of one variable passes through zero, or is least, between two places: SciPy's bracketing methods.

SciPy's optimisers are imported on first use; most runs need none of them.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import numpy as np

# What two neighbouring results of double precision differ by.
ROUNDING = np.finfo(float).eps


class _Undefined(Exception):
    pass


class _Below(Exception):
    pass


def root(
    f: Callable[[float], float],
    a: float,
    b: float,
    *,
    ends: tuple[float, float] | None = None,
    apart: float = 0.0,
) -> float | None:
    """Where `f` changes its sign between `a` and `b`, to rounding or within `apart`: a place at which f was called.

    `ends` are f(a) and f(b) where they are known, and then decide. None where the ends have one sign, and where `f` is
    not a number at a place that is looked at. A jump through zero counts as a zero.

    >>> round(root(lambda s: s * s - 2.0, 0.0, 2.0), 12)
    1.414213562373
    """
    from scipy.optimize import brentq

    at_a, at_b = (f(a), f(b)) if ends is None else ends
    if at_a == 0.0:
        return a
    if at_b == 0.0:
        return b
    if math.isnan(at_a) or math.isnan(at_b) or (at_a > 0.0) == (at_b > 0.0):
        return None

    def value(s: float) -> float:
        if s in (a, b):
            return at_a if s == a else at_b
        found = f(s)
        if math.isnan(found):
            raise _Undefined
        return found

    width = max(apart, ROUNDING * max(abs(a), abs(b)))
    try:
        # With full output the answer comes without an exception after the last evaluation too; its relative width is
        # four roundings where none is given, the least that it takes.
        # Brent's method needs about ten evaluations; this many only where the function jumps.
        return brentq(value, a, b, xtol=width, maxiter=400, full_output=True, disp=False)[0]
    except _Undefined:
        return None


def roots(
    f: Callable[[np.ndarray], np.ndarray],
    a: np.ndarray,
    b: np.ndarray,
    *,
    ends: tuple[np.ndarray, np.ndarray] | None = None,
) -> np.ndarray:
    """Where `f`, which takes places (k,) to values (k,), changes its sign between each of `a` and `b` (m,): (m,).

    `ends` are f(a) and f(b) where they are known, and then decide. NaN where the ends have one sign, and where `f` is
    not finite between them.

    >>> roots(np.cos, np.array([1.0, 4.0]), np.array([2.0, 5.0])).round(9).tolist()
    [1.570796327, 4.71238898]
    """
    from scipy.optimize.elementwise import find_root

    if not len(a):
        return np.array(a, dtype=float)
    at_a, at_b = (f(a), f(b)) if ends is None else ends

    def value(s: np.ndarray, a: np.ndarray, b: np.ndarray, at_a: np.ndarray, at_b: np.ndarray) -> np.ndarray:
        return np.where(s == a, at_a, np.where(s == b, at_b, f(s)))

    found = find_root(value, (a, b), args=(a, b, at_a, at_b))
    return np.where(found.success, found.x, np.nan)


def least(f: Callable[[float], float], a: float, b: float, *, below: float = -math.inf) -> tuple[float, float]:
    """(place, value) where `f`, with one minimum between `a` and `b`, is least; ends at the first value under `below`.

    The place is good to about 1e-8 of the interval, as far as a minimum can be told from its neighbours.

    >>> place, value = least(lambda s: (s - 0.25) ** 2, 0.0, 1.0)
    >>> round(place, 6), round(value, 9)
    (0.25, 0.0)
    """
    from scipy.optimize import minimize_scalar

    best = (a, math.inf)

    # In shares of the interval: the method's own tolerance is relative to the place.
    def value(share: float) -> float:
        nonlocal best
        place = a + float(share) * (b - a)
        found = float(f(place))
        if found < best[1]:
            best = (place, found)
        if found < below:
            raise _Below
        return found

    # Where values are infinite the method's parabolas are no numbers.
    with contextlib.suppress(_Below), np.errstate(invalid="ignore", over="ignore"):
        # Below this share of the interval a minimum is level to rounding.
        minimize_scalar(value, bounds=(0.0, 1.0), method="bounded", options={"xatol": 4e-9})
    return best
