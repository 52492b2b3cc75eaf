"""Ramps without end of one state: the rate at which the rest point of the moving frame is lost.

In u = x + c s a ramp s' = r rho makes u' = f(u) + c r rho. From the start on its rest point moves to one side while the
rate rises to r(u) = -f(u)/(c rho), until r is greatest: there it meets another, or it goes to infinity.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.algebra.algebraic_numbers import real_points
from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import vanishes
from gsp.lowering.compiled_function import compile_function
from gsp.roots import ROUNDING, root
from gsp.singular.ramps.ramped import Place, Ramped, RampError

# Places in each octave of the distance from the start, over all of double precision.
PLACES = 32


class FrameRate(NamedTuple):
    """A critical rate, its error, and what happens there."""

    rate: float
    error: float
    message: str


def moving_frame(given: Ramped, begin: Place) -> FrameRate | None:
    """The rate of a ramp without end; None where the rest point is there at any rate.

    Raises `RampError` unless the field is a function of u and rho a number.
    """
    (f,), (x,), p = given.field.rates, given.field.states, given.ramp.phase
    f, rho = f.xreplace(given.kept), given.ramp.profile.xreplace(given.kept)
    slopes = derivative(f, x), derivative(f, p)
    c = sp.cancel(slopes[1] / slopes[0])
    if not (c.is_number and rho.is_number) or not vanishes(slopes[1] - c * slopes[0]):
        raise RampError(
            "a ramp without an end has a critical rate where the field is the same in a moving frame only.",
            "Give its end as edge={...}, or make f a function of x + c l.",
            got=f"f_{p}/f_{x} = {c}",
        )
    # At s = 0 the state is u.
    u, push = float(begin.x[0] + float(c) * begin.s), float(c * rho)
    return _greatest(f.xreplace({p: sp.Integer(0)}), x, u, push) if push else None


def _greatest(f: sp.Expr, x: sp.Symbol, u: float, push: float) -> FrameRate | None:
    """The first maximum of r = -f/push from `u` on towards the side of `push`, or its limit at infinity."""
    compiled = compile_function((-f, -derivative(f, x)), arguments=(x,))

    def along(distance: np.ndarray) -> np.ndarray:
        """r and its slope (k, 2) at distances (k,)."""
        return compiled((u + np.sign(push) * distance)[:, None], [np.nan]) / [push, abs(push)]

    distances = _distances(f, x, u, np.sign(push))
    rates, rising = along(distances).T
    defined = np.isfinite(rates) & np.isfinite(rising)
    stop = len(distances) if defined.all() else int(np.argmin(defined))
    most = np.maximum.accumulate(rates[:stop])
    noise = PLACES * ROUNDING * most
    falls = np.flatnonzero((rising[:stop] < 0.0) & (rates[:stop] < most - noise))
    end = int(falls[0]) if len(falls) else stop
    # Beyond a pole r begins anew, from below.
    if (rates[1:end] < 0.5 * most[: end - 1]).any():
        return None
    if not len(falls):
        # What has a limit did not rise any more since it was nearer by all of the digits.
        before = int(np.searchsorted(distances, ROUNDING * distances[stop - 1]))
        if not most[-1] - most[before] <= noise[-1]:
            return None
        text = "the rest point of the moving frame goes to infinity there"
        return FrameRate(float(most[-1]), float(noise[-1]), text)
    top = int(np.argmax(rates[:end]))
    low, high = distances[max(top - 1, 0)], distances[top + 1]
    at = root(lambda d: float(along(np.array([d]))[0, 1]), float(low), float(high))
    at = float(distances[top]) if at is None else at
    rate = -float(sp.N(f.xreplace({x: sp.Float(u + np.sign(push) * at, 30)}), 20)) / push
    beside = [rate, *along(at + np.spacing(abs(u) + at) * np.array([-2.0, 0.0, 2.0]))[:, 0]]
    # Next to a pole rounding of the place changes all of r.
    if not max(beside) <= 2.0 * min(beside):
        return None
    error = 4.0 * ROUNDING * rate + float(np.ptp(beside))
    return FrameRate(rate, error, "two rest points of the moving frame meet there")


def _distances(f: sp.Expr, x: sp.Symbol, u: float, side: float) -> np.ndarray:
    """Distances (k,) from `u`, of every size, and on both sides of the places where algebra says that f turns."""
    limits = np.finfo(float)
    least = max(ROUNDING * abs(u), limits.tiny)
    # Of the largest distance the fourth power is a number still.
    every = 2.0 ** np.arange(np.log2(least), limits.maxexp // 4, 1.0 / PLACES)
    turning = side * (np.array([p.numbers()[x] for p in real_points([derivative(f, x)], [x]) or ()]) - u)
    beside = np.outer(turning[turning > least], [1.0 - ROUNDING**0.25, 1.0 + ROUNDING**0.25])
    return np.sort(np.concatenate([every, beside.ravel()]))
