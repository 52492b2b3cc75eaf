"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from functools import cache

import gsp
from tests import example_systems as systems
from tests.contracts import NAME, NAMES, SIGN, Contract, kind
from tests.example_nouns import OSCILLATOR, branch, study, van_der_pol

KOPER = {"x": -1.2, "y": 0.5, "z": 0.5}


@cache
def curve() -> gsp.CriticalCurve:
    return gsp.continue_critical(van_der_pol(), start={"x": 2, "y": 2 / 3}, bounds={"y": (-1, 1)})


VERBS = {
    "solve_critical": Contract(("SlowFastSystem",), van_der_pol, dict),
    "continue_critical": Contract(
        ("SlowFastSystem",), van_der_pol, lambda: {"start": OSCILLATOR, "bounds": {"y": (-1.0, 1.0)}},
        {"free": NAME, "direction": SIGN},
    ),
    "switch_branch": Contract(
        ("CriticalCurve",), curve, lambda: {"point": curve().special[0]}, {"point": kind()}
    ),
    "continue_folds": Contract(
        ("SlowFastSystem",), systems.koper,
        lambda: {"start": KOPER, "bounds": {"y": (-1.0, 1.0)}}, {"free": NAMES},
    ),
    "critical_sheet": Contract(
        ("SlowFastSystem",), systems.koper,
        lambda: {"start": KOPER, "bounds": {"y": (-1.0, 1.0), "z": (-1.0, 1.0)}}, {"free": NAMES},
    ),
}  # fmt: skip

NOUNS = {
    "Branch": (branch, lambda n: n.points({"s": 0.5})),
    "CriticalCurve": (curve, lambda n: n["x"]),
    "CriticalManifold": (lambda: study().critical, lambda n: n.branches[0].points({"s": 0.5})),
    "CriticalSheet": (
        lambda: gsp.critical_sheet(
            systems.koper(), start=KOPER, bounds={"y": (-1.0, 1.0), "z": (-1.0, 1.0)}, max_points=30
        ),
        lambda n: n["x"],
    ),
    "FoldCurve": (
        lambda: gsp.continue_folds(systems.koper(), start=KOPER, bounds={"y": (-1.0, 1.0)}), lambda n: n["x"]
    ),
    "SpecialPoint": (lambda: curve().special[0], str),
}  # fmt: skip
