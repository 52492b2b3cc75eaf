"""The public verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import FLAG, FOLDER, Contract, kind
from tests.example_nouns import blank

VERBS = {
    "write_report": Contract(
        ("Analysis", "Averaging"),
        lambda: blank(gsp.Analysis),
        lambda: {"folder": "report"},
        {"folder": FOLDER, "reductions": kind(), "latex": FLAG},
    ),
}  # fmt: skip
