"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import Contract
from tests.example_nouns import BOX, branch, study, van_der_pol

VERBS = {
    "classify": Contract(("Branch",), branch, lambda: {"region": BOX}),
}  # fmt: skip

NOUNS = {
    "Hyperbolicity": (lambda: study().hyperbolicity, lambda n: n.eigenvalues({"s": 0.5})),
    "Loss": (
        lambda: gsp.classify(
            gsp.solve_critical(van_der_pol()).branches[0], region={"x": (0.5, 2.0), "y": (-1.0, 1.0)}
        ).losses[0],
        str,
    ),
}  # fmt: skip
