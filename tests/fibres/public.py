"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import Contract
from tests.example_nouns import ENZYME, series, study

VERBS = {
    "project": Contract(
        ("SeriesManifold", "Branch", "SampledManifold"), series, lambda: {"start": ENZYME, "epsilon": 0.01}
    ),
    "composite": Contract(
        ("SeriesManifold", "Branch"), series, lambda: {"start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01}
    ),
}  # fmt: skip

NOUNS = {
    "BasePoint": (lambda: study().base_point(1), dict),
    "CompositeSolution": (
        lambda: gsp.composite(series(), start={"s": 1.0, "c": 0.0}, span=(0.0, 1.0), epsilon=0.01),
        lambda n: n.at([0.0, 0.01, 0.5]),
    ),
}  # fmt: skip
