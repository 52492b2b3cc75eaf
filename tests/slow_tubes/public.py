"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import COUNT, LIMIT, POINT, Contract
from tests.example_nouns import BOX, PIECE, branch, series

VERBS = {
    "certify": Contract(
        ("Branch", "SeriesManifold", "SampledManifold", "SingularOrbit", "FoldPassage", "DelayedExit"),
        branch, lambda: {"region": BOX},
        {"most_boxes": LIMIT},
    ),
    "bound_reduction": Contract(
        ("SeriesManifold",), series, lambda: {"start": {"s": 1.0}, "span": (0.0, 1.0), "epsilon": 0.01},
        {"reduced_start": POINT, "steps": COUNT},
    ),
}  # fmt: skip

NOUNS = {
    "ReductionBound": (
        lambda: gsp.bound_reduction(series(), start={"s": 1.0}, span=(0.0, 0.2), epsilon=0.01, steps=8), str
    ),
    "SlowTube": (lambda: gsp.certify(series(), region=PIECE, epsilon=0.001), str),
    "SolvedTube": (
        lambda: gsp.certify(gsp.solve_manifold(branch(), region=PIECE, epsilon=0.01), region=PIECE), str
    ),
}  # fmt: skip
