"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import Contract
from tests.example_nouns import michaelis

VERBS = {
    "analyse": Contract(("Scene", "Study"), michaelis, dict),
}  # fmt: skip

NOUNS = {
    "Analysis": (lambda: gsp.analyse(michaelis(), order=1), lambda n: n.base),
}  # fmt: skip
