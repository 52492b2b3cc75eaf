"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import Contract, kind
from tests.example_nouns import michaelis, study

VERBS = {
    "choose": Contract(("Scene", "Study"), michaelis, dict),
    "simulate": Contract(("Scene", "Study"), michaelis, dict, {"choice": kind()}),
}  # fmt: skip

NOUNS = {
    "Choice": (lambda: gsp.choose(study(), orders=(0, 1)), lambda n: n.verdict),
    "Simulation": (lambda: gsp.simulate(study()), str),
}  # fmt: skip
