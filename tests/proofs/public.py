"""The public nouns of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.example_nouns import PIECE, branch

NOUNS = {
    "Certificate": (lambda: gsp.certify(branch(), region=PIECE), lambda n: (n.verdict, n.gap)),
}  # fmt: skip
