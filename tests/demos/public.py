"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import NAME, POSITIVE, Contract, kind
from tests.example_nouns import michaelis

VERBS = {
    "animate": Contract(
        ("Scene", "Study"), michaelis, lambda: {"path": "film.gif"},
        {"path": kind(), "view": NAME, "seconds": POSITIVE},
    ),
    "demo": Contract(("Scene", "Study"), michaelis, dict, {"story": kind("text")}),
    "write_demo": Contract(
        ("Scene", "Study"), michaelis, lambda: {"path": "demo.html"},
        {"path": kind("text"), "story": kind("text")},
    ),
}  # fmt: skip

NOUNS = {
    "Demo": (lambda: gsp.demo(michaelis()), lambda n: (len(n.html), n.html[:200])),
}  # fmt: skip
