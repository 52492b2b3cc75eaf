"""Where a function of one variable passes through zero, or is least, between two places: SciPy's bracketing methods.

SciPy's optimisers are imported on first use; most runs need none of them. Every check of hyperbolicity looks for where
a function of several variables is least, so that this search is our own.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import numpy as np

# What two neighbouring results of double precision differ by.
ROUNDING = 2.0**-52
# Brent's method needs about ten evaluations; this many only where the function jumps.
MOST = 400
# Below this share of the interval a minimum is level to rounding.
LEVEL = 4e-9
# SciPy's first simplex: the share by which a coordinate is moved, and how far one that is 0; and the difference of
# values at which a search may end.
WIDER, BESIDE = 1.05, 0.00025
ALIKE = 1e-4


class _Undefined(Exception):
    pass


class _Below(Exception):
    pass


class _Spent(Exception):
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
        return brentq(value, a, b, xtol=width, maxiter=MOST, full_output=True, disp=False)[0]
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

    with contextlib.suppress(_Below):
        minimize_scalar(value, bounds=(0.0, 1.0), method="bounded", options={"xatol": LEVEL})
    return best


def least_in_box(
    f: Callable[[np.ndarray], float], start: np.ndarray, box: np.ndarray, *, apart: float, most: int
) -> tuple[np.ndarray, float]:
    """(place (n,), value) where `f` is least near `start` (n,) in `box` (n, 2), by the simplex of Nelder and Mead.

    The search ends where places are within `apart` of the best and values within ALIKE, or after `most` evaluations. It
    is that of `scipy.optimize.minimize` bit for bit, without the import (J. A. Nelder, R. Mead, The Computer Journal 7
    (1965) 308-313).

    >>> box = np.array([[0.5, 2.0], [0.5, 2.0]])
    >>> place, value = least_in_box(lambda x: abs(x).sum(), np.ones(2), box, apart=1e-9, most=200)
    >>> place.tolist(), value
    ([0.5, 0.5], 1.0)
    """
    low, high = np.asarray(box, dtype=float).T
    n = len(start)
    places = np.tile(np.clip(start, low, high), (n + 1, 1))
    for i in range(n):
        places[i + 1, i] = WIDER * places[i + 1, i] if places[i + 1, i] != 0.0 else BESIDE
    # What lies past an upper bound is turned inwards: clipped, the simplex could be flat.
    places = np.clip(np.where(places > high, 2.0 * high - places, places), low, high)
    values = np.full(n + 1, math.inf)
    left = most

    def at(place: np.ndarray) -> tuple[np.ndarray, float]:
        nonlocal left
        if left == 0:
            raise _Spent
        left -= 1
        place = np.clip(place, low, high)
        return place, float(f(place.copy()))

    with contextlib.suppress(_Spent):
        for i in range(n + 1):
            _, values[i] = at(places[i])
        while True:
            order = np.argsort(values)
            places, values = places[order], values[order]
            # Between Python's numbers infinity less infinity is no warning.
            alike = float(values[-1]) - float(values[0]) <= ALIKE
            if alike and np.abs(places[1:] - places[0]).max() <= apart:
                break
            middle, worst = places[:-1].sum(axis=0) / n, places[-1]
            new = at(2.0 * middle - worst)
            if new[1] < values[0]:
                farther = at(3.0 * middle - 2.0 * worst)
                new = farther if farther[1] < new[1] else new
            elif not new[1] < values[-2]:
                outside = new[1] < values[-1]
                nearer = at(1.5 * middle - 0.5 * worst if outside else 0.5 * middle + 0.5 * worst)
                if not (nearer[1] <= new[1] if outside else nearer[1] < values[-1]):
                    for i in range(1, n + 1):
                        places[i], values[i] = at(places[0] + 0.5 * (places[i] - places[0]))
                    continue
                new = nearer
            places[-1], values[-1] = new
    best = int(np.argsort(values)[0])
    return places[best], float(values[best])
