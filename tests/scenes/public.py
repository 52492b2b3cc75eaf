"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests import example_systems as systems
from tests.contracts import EXPRESSIONS, NAME, POINT, Contract, kind
from tests.example_nouns import ENZYME, blank, michaelis, study

VERBS = {
    "take_scaling": Contract(("Scene",), michaelis, lambda: {"scaling": blank(gsp.Scaling)}, {"scaling": kind()}),
    "take_small": Contract(("Scene",), michaelis, lambda: {"parameter": "kappa"}, {"parameter": NAME}),
    "take_fast": Contract(
        ("Scene",), michaelis, lambda: {"variables": ("c",)}, {"variables": kind("text")}
    ),
    "study": Contract(("Scene", "Study"), michaelis, dict),
    "Scene": Contract(
        ("SlowFastSystem", "VectorField"), systems.michaelis_menten,
        lambda: {"region": {"s": (0.1, 1.0), "c": (0.0, 1.0)}, "start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01,
                 "epsilons": (0.02, 0.01), "tolerance": 1e-4},
        {**dict.fromkeys(("name", "title", "source", "description", "second"), kind("text")),
         "reconstruction_start": POINT, "path": kind(), "claims": kind("[]"), "starts": kind(inside=POINT),
         "units": kind(inside=kind("text")), "views": kind(), "contacts": kind(), "ramps": kind(), "phase": kind(),
         "worked_out": kind(), "found_bounds": kind(),
         "reconstruction": kind("None", inside=EXPRESSIONS.inside)},
    ),
}  # fmt: skip

NOUNS = {
    "Scene": (michaelis, lambda n: gsp.integrate(n, span=(0.0, 1.0))["s"]),
    "Study": (study, lambda n: (n.series(3).coefficients, n.hyperbolicity.gap)),
}  # fmt: skip
