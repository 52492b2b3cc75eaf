"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from functools import cache

import sympy as sp

import gsp
from tests.contracts import (
    CALLABLE,
    COUNT,
    EXPRESSIONS,
    INTERVAL,
    NAME,
    NUMBER,
    POINT,
    POSITIVE,
    Contract,
    kind,
)
from tests.example_nouns import (
    BOX,
    ENZYME,
    FLOWS,
    ON_FOLD,
    OSCILLATOR,
    branch,
    canard_system,
    node,
    node_system,
    van_der_pol,
)

epsilon, x, y, a = sp.symbols("epsilon x y a")

BEHIND = {"x": -0.5, "y": 0.1}


@cache
def canard() -> gsp.CanardValue:
    return gsp.canard_value(canard_system(), parameter=a, order=1)


@cache
def passage() -> gsp.FoldPassage:
    return gsp.fold_passage(van_der_pol(), {"x": 1, "y": -2 / 3})


@cache
def ramped() -> gsp.VectorField:
    return gsp.VectorField(states={x: (x + a) ** 2 - 1}, epsilon=None, parameters={a: 0})


@cache
def rate() -> gsp.CriticalRate:
    return gsp.critical_rate(ramped(), ramp={a: a * (3 - a)}, start={"x": -1, "a": 0}, edge={"x": -2, "a": 3})


@cache
def over() -> gsp.CriticalRate:
    field = gsp.VectorField(states={x: x**2 + a - 1}, epsilon=None, parameters={a: 0})
    return gsp.critical_rate(
        field, ramp=gsp.Ramp.there_and_back({a: (0, 1.01)}), start={"x": -1}, edge={"x": 1}
    )


@cache
def diagram() -> gsp.RateDiagram:
    return gsp.rate_diagram(
        ramped(),
        ramp=gsp.Ramp.tanh({a: (0, 3)}),
        start={"x": -1},
        edge={"x": -2},
        amplitudes=(0.9, 1.1),
        points=2,
    )


@cache
def blown_up() -> gsp.BlowUp:
    return gsp.blow_up(van_der_pol(), near={"x": 1, "y": -2 / 3})


@cache
def delayed() -> gsp.DelayedExit:
    system = gsp.SlowFastSystem(slow={x: 1}, fast={y: x * y}, epsilon=epsilon)
    return gsp.entry_exit(gsp.solve_critical(system).branches[0], start={"x": -0.5}, region={"x": (-1, 1)})


VERBS = {
    "canard_value": Contract(("SlowFastSystem",), canard_system, lambda: {"parameter": "a"}),
    "match_canard": Contract(
        ("CanardValue",), canard, lambda: {"epsilon": 0.05, "reach": (1.2, 1.9)},
        {"reach": kind("an array", inside=POSITIVE)},
    ),
    "folded_singularities": Contract(
        ("SlowFastSystem",), node_system, lambda: {"region": {"y": (-1.0, 1.0)}}
    ),
    "critical_rate": Contract(
        ("VectorField", "SlowFastSystem"), ramped,
        lambda: {"ramp": {a: a * (3 - a)}, "start": {"x": -1.0, "a": 0.0}, "edge": {"x": -2.0, "a": 3.0}},
        {"ramp": EXPRESSIONS, "start": POINT, "edge": POINT, "epsilon": POSITIVE},
    ),
    "slow_ramp": Contract(("CriticalRate",), over, lambda: {"order": 1}, {"threshold": COUNT}),
    "rate_diagram": Contract(
        ("VectorField", "SlowFastSystem"), ramped,
        lambda: {
            "ramp": gsp.Ramp.tanh({a: (0, 3)}), "start": {"x": -1.0}, "edge": {"x": -2.0},
            "amplitudes": (0.9, 1.1), "points": 2,
        },
        {
            "ramp": kind(), "start": POINT, "edge": POINT, "amplitudes": INTERVAL, "points": COUNT,
            "epsilon": POSITIVE, "progress": CALLABLE,
        },
    ),
    "blow_up": Contract(
        ("SlowFastSystem", "FoldedSingularity"), van_der_pol, lambda: {"near": ON_FOLD},
        # Its parameter is called a.
        {"near": POINT, "parameters": kind("[]", "an array of text")},
    ),
    "fold_passage": Contract(("SlowFastSystem",), van_der_pol, lambda: {"fold": ON_FOLD}, {"fold": POINT}),
    "fold_exit": Contract(
        ("FoldPassage",), passage, lambda: {"epsilon": 0.01, "section": {"x": -1.0}}, {"section": POINT}
    ),
    "fit_omega0": Contract(("FoldPassage",), passage, lambda: {"section": {"x": -1.0}}, {"section": POINT}),
    "entry_exit": Contract(("Branch",), branch, lambda: {"start": {"s": 1.0}, "region": BOX},
        {"start": kind("-1", "0.5", "an array of one", inside=NUMBER)}),
    "measure_delay": Contract(
        ("DelayedExit",), delayed, lambda: {"epsilon": 0.05, "radius": 0.1, "start": BEHIND},
    ),
    "follow": Contract(
        ("SlowFastSystem",), van_der_pol,
        lambda: {"start": OSCILLATOR, "span": (0.0, 0.1), "epsilon": 0.1, "watch": {"speed": x + y}},
        {"until": kind("an expression"), "after": NUMBER,
         "watch": kind(inside=kind("an expression"))},
    ),
    "singular_orbit": Contract(("Branch",), branch, lambda: {"start": ENZYME}, {"switched": kind()}),
    "mixed_mode": Contract(
        FLOWS, van_der_pol,
        lambda: {"name": "x", "start": OSCILLATOR, "span": (0.0, 1.0), "epsilon": 0.1},
        {"settle": POSITIVE, "name": NAME},
    ),
}  # fmt: skip

NOUNS = {
    "BlowUp": (blown_up, str),
    "CanardValue": (canard, lambda n: n.value(0.01)),
    "BlowUpChart": (lambda: blown_up().charts[0], str),
    "CriticalRate": (rate, lambda n: (n.verdict, n.rates, n.errors)),
    "Ramp": (lambda: gsp.Ramp.tanh({a: (0, 3)}), str),
    "RampRun": (lambda: rate().run(1.0), lambda n: n["x"].tolist()),
    "RateDiagram": (diagram, str),
    "SlowRamp": (lambda: gsp.slow_ramp(over(), order=1), str),
    "DelayedExit": (delayed, str),
    "FoldPassage": (passage, str),
    "FoldedSingularity": (node, str),
    "MixedMode": (
        lambda: gsp.mixed_mode(
            van_der_pol(), name="x", start={"x": 2.0, "y": 0.5}, span=(0.0, 8.0), epsilon=0.1
        ),
        str,
    ),
    "SingularOrbit": (
        lambda: gsp.singular_orbit(
            gsp.solve_critical(van_der_pol()).branches[0], start={"x": 2.0, "y": 0.5}
        ),
        lambda n: n.period,
    ),
}  # fmt: skip
