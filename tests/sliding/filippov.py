"""Filippov's solution by SciPy and nothing of ours: pieces off a surface and on it, with the times between."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp

Rates = Mapping[sp.Symbol, sp.Expr]


def filippov(plus: Rates, minus: Rates, surface: sp.Expr, start: list[float], end: float):
    """The signs (1, -1, 0 on the surface) and the ends of the pieces from a start off the surface, and the last state.

    Sliding ends where a field is tangent to the surface, along that field.
    """
    states = list(plus)
    fields = {sign: sp.lambdify([states], list(rates.values())) for sign, rates in ((1, plus), (-1, minus))}
    height = sp.lambdify([states], surface)
    normals = {
        sign: sp.lambdify([states], sum(surface.diff(s) * rates[s] for s in states))
        for sign, rates in ((1, plus), (-1, minus))
    }

    def sliding(u: np.ndarray) -> np.ndarray:
        above, below = normals[1](u), normals[-1](u)
        return (below * np.array(fields[1](u)) - above * np.array(fields[-1](u))) / (below - above)

    t, u, signs, ends = 0.0, np.array(start), [], []
    sign = int(np.sign(height(u)))
    while t < end:
        names = [1, -1] if sign == 0 else [0]
        events = []
        for name in names:
            value, sense = (normals[name], name) if name else (height, -sign)

            def event(_, v, value=value):
                return value(v)

            event.terminal, event.direction = True, sense  # type: ignore[attr-defined]
            events.append(event)
        run = solve_ivp(
            lambda _, v, sign=sign: sliding(v) if sign == 0 else fields[sign](v), (t, end), u, method="DOP853",
            rtol=1e-11, atol=1e-12, events=events, max_step=0.1,
        )  # fmt: skip
        t, u = run.t[-1], run.y[:, -1]
        signs.append(sign)
        ends.append(t)
        if run.status == 0:
            break
        if sign == 0:
            (sign,) = (name for name, times in zip(names, run.t_events) if len(times))
        else:
            above, below = normals[1](u), normals[-1](u)
            assert not above > 0.0 > below
            sign = 0 if above < 0.0 < below else int(np.sign(above))
    return signs, ends, u
