"""The orbit from the start of a ramp to the edge state at its end, with the rate at which there is one.

Over the ramped parameter l the orbit x(l) of x' = f(x, l), l' = r rho(l) solves

    r rho(l) dx/dl = f(x, l),   x(l_0) = x_0,   x(l_1) = x_1,                                                       (1)

x_0 attracting and x_1 repelling for l at rest. Where rho vanishes at an end, (1) is singular there and its smooth
solutions make up the unstable set of the start and the stable set of the edge: both are curves, and they meet for
single r. So (1) has N + 2 equations for a polynomial of degree N and r: the ends, and collocation at the N
Gauss-Chebyshev points. Solutions are analytic over [l_0, l_1], so that errors fall geometrically with N.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial import chebyshev

from gsp.roots import root

# r changes by at most this factor in one step.
FACTOR = 4.0
# Degrees: the first, and the one at which an orbit is not resolved.
FIRST, LAST = 16, 256
# Two starts lead to one threshold when they agree to this.
SAME = 1e-6
ROUNDING = np.finfo(float).eps

Rates = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Values (m, 3) of f, f_x and rho at x (m,) and l (m,)."""


class RampEnds(NamedTuple):
    """(l, x) where the ramp starts and where its edge state is."""

    start: tuple[float, float]
    edge: tuple[float, float]


class Connection(NamedTuple):
    """The `rate` with its `error`, and the orbit: x (k,), of several states (k, n), at the phases (k,)."""

    rate: float
    error: float
    phase: np.ndarray
    x: np.ndarray


def zero_error(gap: Callable[[float, float], float], zero: float, looser: float) -> float:
    """How far off a `zero` of gap(rate, rtol) is, by those of a `looser` rtol and three times that.

    One of them may agree by luck.
    """
    near = 1e3 * looser * zero
    zeros = [root(lambda r, t=rtol: gap(r, t), zero - near, zero + near) for rtol in (looser, 3.0 * looser)]
    return max(near if each is None else abs(each - zero) for each in zeros) + 8.0 * ROUNDING * zero


def nodes(degree: int) -> np.ndarray:
    """The Chebyshev nodes (N + 1,) of polynomials of degree N over [-1, 1]."""
    return -np.cos(np.pi * np.arange(degree + 1) / degree)


def matrices(degree: int, c: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """From values at the nodes of polynomials of degree N to values and to slopes at places `c` (k,): (k, N + 1)."""
    at_nodes, on = (chebyshev.chebvander(at, degree) for at in (nodes(degree), c))
    slopes = chebyshev.chebval(c, chebyshev.chebder(np.eye(degree + 1))).T
    values, slopes = np.linalg.solve(at_nodes.T, np.hstack([on.T, slopes.T])).T.reshape(2, len(c), degree + 1)
    return values, slopes


@lru_cache(maxsize=8)
def _grid(degree: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points s (N,) between the nodes, and the matrices to values and slopes there."""
    s = -np.cos(np.pi * (2 * np.arange(degree) + 1) / (2 * degree))
    return s, *matrices(degree, s)


def connection(
    rates: Rates,
    ends: RampEnds,
    guess: float,
    shape: Callable[[np.ndarray], np.ndarray],
    known: Sequence[Connection] = (),
) -> Connection | None:
    """The solution of (1) that Newton's method reaches from x = `shape`(l) and r = `guess`.

    None where it reaches none, or one that is `known`. The error is what twice the degree changes, with the rounding
    of the equations.
    """
    first, last = ends.start[0], ends.edge[0]
    found = _solved(rates, ends, guess, FIRST, shape(places(first, last, nodes(FIRST))))
    before, degree = np.inf, FIRST
    while found is not None and degree < LAST:
        if any(abs(found[0] - one.rate) <= SAME * one.rate for one in known):
            return None
        rate, x, _ = found
        degree *= 2
        found = _solved(rates, ends, rate, degree, refined(x, degree))
        if found is None:
            return None
        change = abs(found[0] - rate) / rate
        # Below the root of rounding a change that falls no longer is rounding that the estimate has not seen.
        if change <= max(found[2], ROUNDING * degree) or before <= change <= ROUNDING**0.5:
            rate, x, rounding = found
            return Connection(rate, (change + rounding) * rate, places(first, last, nodes(degree)), x)
        # A rate that moves by more when the degree doubles is one of the equations for polynomials, and of no orbit.
        if change > 0.5:
            return None
        before = change
    return None


def places(first: float, last: float, c: np.ndarray) -> np.ndarray:
    """Phases between two ends at places c of [-1, 1]."""
    return first + 0.5 * (last - first) * (c + 1.0)


def refined(x: np.ndarray, degree: int) -> np.ndarray:
    """The polynomial with values x (k,) or (k, n) at the nodes of a lower degree, at those of `degree`."""
    return matrices(len(x) - 1, nodes(degree))[0] @ x


def _solved(
    rates: Rates, ends: RampEnds, rate: float, degree: int, x: np.ndarray
) -> tuple[float, np.ndarray, float] | None:
    """(r, x, relative rounding of r) by Newton's method."""
    s, values, slopes = _grid(degree)
    (first, x_0), (last, x_1) = ends
    l, per_unit = places(first, last, s), 2.0 / (last - first)  # noqa: E741
    matrix = np.zeros((degree + 2, degree + 2))
    matrix[0, 0] = matrix[-1, degree] = 1.0
    # Newton's method converges within a few steps or goes elsewhere.
    for _ in range(25):
        f, f_x, rho = rates(values @ x, l).T
        slope = per_unit * (slopes @ x)
        residual = np.concatenate([[x[0] - x_0], rate * rho * slope - f, [x[-1] - x_1]])
        matrix[1:-1, :-1] = (rate * per_unit * rho)[:, None] * slopes - f_x[:, None] * values
        matrix[1:-1, -1] = rho * slope
        if not np.isfinite(matrix).all():
            return None
        try:
            inverse = np.linalg.inv(matrix)
        except np.linalg.LinAlgError:
            return None
        step = inverse @ residual
        size = float(np.abs(x).max() + abs(x_1 - x_0))
        x, moved = x - step[:-1], rate - step[-1]
        rate = float(np.clip(moved, rate / FACTOR, FACTOR * rate))
        # What rounding of the terms of (1) does to r, and of x in them.
        lengths = per_unit * (np.abs(slopes) @ np.abs(x))
        inside = np.abs(rate * rho * lengths) + np.abs(f) + np.abs(f_x * (values @ x))
        terms = np.concatenate([[abs(x_0)], inside, [abs(x_1)]])
        rounding = float(np.abs(inverse[-1]) @ terms) * ROUNDING / rate
        if np.abs(step[:-1]).max() <= 1e-9 * size and abs(step[-1]) <= max(1e-9, rounding) * rate:
            return rate, x, rounding
    return None
