"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from functools import cache

import gsp
from gsp.orbits.canard_orbits.canard import Canard
from tests.contracts import INTERVAL, NUMBER, POSITIVE, Contract, kind
from tests.example_nouns import FLOWS, ON_FOLD, OSCILLATOR, blank, canard_system, hopf, node, van_der_pol


@cache
def cycle() -> gsp.PeriodicOrbit:
    return gsp.periodic_orbit(van_der_pol(), start={"x": 2.0, "y": 0.5}, epsilon=0.1)


@cache
def family() -> gsp.OrbitFamily:
    return gsp.continue_orbits(hopf(), bounds=(0.95, 1.1), max_points=4)


@cache
def canards() -> gsp.CanardOrbits:
    return gsp.folded_canards(node(), epsilon=0.01)


VERBS = {
    "periodic_orbit": Contract(FLOWS, van_der_pol, lambda: {"start": OSCILLATOR, "epsilon": 0.1}),
    "shoot": Contract(("PeriodicOrbit",), lambda: blank(gsp.PeriodicOrbit), dict, {"phase": NUMBER}),
    "hopf_points": Contract(
        FLOWS, canard_system,
        lambda: {"start": ON_FOLD, "parameter": "a", "bounds": (0.5, 1.5), "epsilon": 0.01},
        {"bounds": INTERVAL},
    ),
    "continue_orbits": Contract(
        ("PeriodicOrbit", "HopfPoint"), hopf, lambda: {"bounds": (0.5, 1.5)}, {"bounds": INTERVAL}
    ),
    "folded_canards": Contract(
        ("FoldedSingularity",), node, lambda: {"epsilon": 0.01},
        dict.fromkeys(("section", "attracting", "repelling"), kind()),
    ),
    "follow_canard": Contract(
        ("Canard",), lambda: blank(Canard), lambda: {"epsilon": (0.01, 0.02)},
        {"epsilon": kind("an array", inside=POSITIVE)},
    ),
}  # fmt: skip

NOUNS = {
    "CanardFamily": (
        lambda: gsp.follow_canard(next(iter(canards().canards)), epsilon=(0.01, 0.011)), lambda n: n.epsilon
    ),
    "CanardOrbits": (canards, str),
    "HopfPoint": (hopf, str),
    "OrbitFamily": (family, str),
    "PeriodicOrbit": (cycle, lambda n: (n.period, n.at(0.3))),
}  # fmt: skip
