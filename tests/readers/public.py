"""The public verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import tempfile

from tests.contracts import Contract, kind
from tests.example_nouns import michaelis

VERBS = {
    "load": Contract((), lambda: "no such file.toml", dict),
    "save": Contract(
        ("Scene",), michaelis, lambda: {"path": f"{tempfile.mkdtemp()}/kept.toml"}, {"path": kind()}
    ),
}  # fmt: skip
