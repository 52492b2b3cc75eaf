"""The public verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from tests.contracts import NAME, Contract
from tests.example_nouns import michaelis

VERBS = {
    "export": Contract(("Scene", "Study"), michaelis, dict, {"to": NAME}),
}  # fmt: skip
