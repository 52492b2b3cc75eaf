"""Kinds of published models, rebuilt by hand: read, run without an epsilon, asked for their time scales, or refused.

The rates beside each file are written by hand from the same chemistry, and run by SciPy: a second way from the file to
the end of its run.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import gsp
from gsp.errors import ModelFileError

FOLDER = Path(__file__).parent / "kinds"


def cascade(A, Ap, B, Bp):
    on, off, on2, off2 = 2 * A / (0.2 + A), 0.5 * Ap / (0.2 + Ap), 5 * Ap * B / (0.1 + B), Bp / (0.1 + Bp)
    return off - on, on - off, off2 - on2, on2 - off2


def enzyme(E, S, C, P):
    bind, make = 100 * E * S - 10 * C, 5 * C
    return make - bind, -bind, bind - make, make


def inhibition(E, S, C, P, inhibitor, D):
    one, make, two = 50 * E * S - 5 * C, 2 * C, 20 * E * inhibitor - 2 * D
    return make - one - two, -one, one - make, make, -two, two


def repressilator(m1, m2, m3, p1, p2, p3):
    made = [0.1 + 50 / (1 + p * p) for p in (p3, p1, p2)]
    return *(a - m for a, m in zip(made, (m1, m2, m3))), *(
        2 * (m - p) for m, p in ((m1, p1), (m2, p2), (m3, p3))
    )


def chain(A, B, C):
    first, second = 100 * A - 50 * B, B - 0.5 * C
    return -first, first - second, second


def robertson(A, B, C):
    first, second, third = 0.04 * A, 1e4 * B * C, 3e7 * B * B
    return second - first, first - second - third, third


def dimers(M, D):
    pair = 200 * M * M - 100 * D
    return 0.1 - 2 * pair, pair - 0.2 * D


def mitotic(C, M, X):
    return (
        0.025 - 0.25 * X * C / (0.02 + C) - 0.01 * C,
        3 * C / (0.5 + C) * (1 - M) / (1.05 - M) - 1.5 * M / (0.05 + M),
        M * (1 - X) / (1.05 - X) - 0.5 * X / (0.05 + X),
    )


def operon(M, A):
    return A * A / (0.25 + A * A) - 5 * M, 4 * M * 2 / 3 - 0.2 * A


def sodium_potassium(v, n):
    m, rest = 1 / (1 + np.exp((-20 - v) / 15)), 1 / (1 + np.exp((-25 - v) / 5))
    return 10 - 8 * (v + 80) - 20 * m * (v - 60) - 10 * n * (v + 90), rest - n


def chua(x, y, z):
    line = -0.71 * x + 0.5 * (-1.14 + 0.71) * (abs(x + 1) - abs(x - 1))
    return 9 * (y - x - line), x - y + z, -14.2 * y


def lorenz84(x, y, z):
    return -y * y - z * z - 0.25 * x + 1.5, x * y - 4 * x * z - y + 1, 4 * x * y + x * z - z


def line(*z):
    u, w = np.array(z[:12]), np.array(z[12:])
    wide = np.concatenate([u[:1], u, u[-1:]])
    return *((u * (1 - u) * (u - 0.1) - w + 0.5 * np.diff(wide, 2)) / 0.05), *(0.5 * u - w)


def harvest(x, y):
    eaten = x / (1 + 0.5 * x) * y
    return x * (1 - x / 2) - eaten - 0.05, 0.6 * eaten - 0.3 * y


# Rates by hand, their start, and which states are fast at the end of the run.
RUN: dict[str, tuple[Callable, dict[str, float], str]] = {
    "cascade.ant": (cascade, {"A": 1, "Ap": 0, "B": 1, "Bp": 0}, ""),
    "enzyme.ant": (enzyme, {"E": 0.02, "S": 1, "C": 0, "P": 0}, "C"),
    "inhibition.ant": (inhibition, {"E": 0.05, "S": 1, "C": 0, "P": 0, "I": 0.5, "D": 0}, "C E"),
    "repressilator.ant": (repressilator, {"m1": 0, "m2": 1, "m3": 2, "p1": 1, "p2": 2, "p3": 3}, ""),
    "glycolysis.ant": (lambda S, P: (1 - S * P * P, S * P * P - 1.1 * P), {"S": 1, "P": 1}, ""),
    "two_compartments.ant": (
        lambda p, t: (-(2 * (p - t) + 0.5 * p) / 3, 2 * (p - t) / 12), {"Cp": 10, "Ct": 0}, "Cp",
    ),
    "autoregulation.ant": (lambda m, p: (5 / (1 + p**4) - 2 * m, 3 * m - 0.1 * p), {"m": 0, "p": 0}, ""),
    "dimers.ant": (dimers, {"M": 1, "D": 0}, "M"),
    "cell_cycle.ant": (
        lambda u, v: (180 * (v - u) * (1e-4 + u * u) - u, 0.015 - u), {"u": 0.1, "v": 0.2}, "",
    ),
    "mitotic.ant": (mitotic, {"C": 0.01, "M": 0.01, "X": 0.01}, ""),
    "epidemic.ant": (
        lambda S, E, ill, R: (-S * ill / 2, S * ill / 2 - E / 5, E / 5 - ill / 10, ill / 10),
        {"S": 0.99, "E": 0, "I": 0.01, "R": 0}, "",
    ),
    "glucose.ant": (
        lambda G, X, ins: (0.03 * (90 - G) - X * G, 1.3e-5 * (ins - 7) - 0.02 * X, -0.3 * (ins - 7)),
        {"G": 280, "X": 0, "I": 360}, "",
    ),
    "operon.ant": (operon, {"M": 0.1, "A": 0.5}, "M"),
    "chain.ant": (chain, {"A": 1, "B": 0, "C": 0}, "B"),
    "robertson.ant": (robertson, {"A": 1, "B": 0, "C": 0}, "B"),
    "sodium_potassium.ode": (sodium_potassium, {"v": -65, "n": 0}, ""),
    "chua.ode": (chua, {"x": 0.1, "y": 0, "z": 0}, ""),
    "lorenz84.ode": (lorenz84, {"x": 1, "y": 1, "z": 0}, ""),
    "line.ode": (
        line, {**{f"u{k}": 0.8 * (k < 4) for k in range(1, 13)}, **{f"w{k}": 0 for k in range(1, 13)}}, "",
    ),
    "forced.ode": (
        lambda x, v, t: (v, x - x**3 - 0.2 * v + 0.3 * np.cos(1.2 * t), 1), {"x": 1, "v": 0, "t": 0}, "",
    ),
    "thermostat.ode": (lambda T: (4 - 0.1 * (T - 5),), {"t": 10}, ""),
    "theta.ode": (lambda th: (1 - np.cos(th) - 0.2 * (1 + np.cos(th)),), {"th": 1}, ""),
    "harvest.ode": (harvest, {"x": 1, "y": 0.5}, ""),
    "boundary.xml": (lambda X: (1.5 - 0.7 * X,), {"X": 0}, ""),
    "rules.xml": (lambda X, y: (-0.5 * y * X, X - y), {"X": 1, "y": 2}, ""),
}  # fmt: skip
# In closed form, as SciPy steps over their jumps: a pulse from 1 to 2, and a decay that is linear down to 1.
EXACT = {
    "pulse.ode": {"x": np.exp(-2) + 4 * (np.exp(-1) - np.exp(-1.5))},
    "clipped.xml": {"X": np.exp(-9)},
}
REFUSED = {
    "algebraic.xml": "1 algebraic rule",
    "event.xml": "1 event",
    "noise.ode": "wiener is noise",
    "delay.ode": "delay is a delay",
    "reset.ode": "global is an event",
}


def test_every_kind_has_an_outcome() -> None:
    assert {path.name for path in FOLDER.iterdir()} == {*RUN, *EXACT, *REFUSED}
    assert len(RUN) + len(EXACT) + len(REFUSED) >= 30


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", RUN)
def test_a_kind_runs_without_an_epsilon_as_its_rates_by_hand_do(name: str) -> None:
    rates, start, fast = RUN[name]
    scene = gsp.load(FOLDER / name)
    assert not scene.has_small
    scales = gsp.time_scales(scene)
    assert scales.status.ok
    assert " ".join(sorted(scales.fast(len(scales.t) - 1))) == fast
    run = gsp.integrate(scene.system, start=scene.start, span=scene.span, rtol=1e-10, atol=1e-12)
    by_hand = solve_ivp(
        lambda t, z: rates(*z), scene.span, list(start.values()), method="LSODA", rtol=1e-10, atol=1e-13
    )
    expected = dict(zip(start, by_hand.y[:, -1]))
    for state in scene.system.states:
        size = np.abs(run[state.name]).max()
        assert run[state.name][-1] == pytest.approx(expected[state.name], rel=1e-6, abs=1e-7 * size), state


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", EXACT)
def test_a_kind_with_jumps_ends_where_it_does_in_closed_form(name: str) -> None:
    scene = gsp.load(FOLDER / name)
    assert not scene.has_small
    assert gsp.time_scales(scene).status.ok
    run = gsp.integrate(scene.system, start=scene.start, span=scene.span, rtol=1e-10, atol=1e-12)
    for state, value in EXACT[name].items():
        assert run[state][-1] == pytest.approx(value, rel=1e-6)


@pytest.mark.parametrize("name", REFUSED)
def test_a_kind_that_is_no_flow_is_refused_by_name(name: str) -> None:
    with pytest.raises(ModelFileError, match=REFUSED[name]):
        gsp.load(FOLDER / name)
