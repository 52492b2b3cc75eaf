"""The public verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from tests.contracts import Contract
from tests.example_nouns import michaelis

VERBS = {
    "find_reductions": Contract(("Scene",), michaelis, dict),
}  # fmt: skip
