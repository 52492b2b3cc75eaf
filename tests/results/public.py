"""The public verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

from tests.contracts import FLAG, Contract

VERBS = {
    "progress_bar": Contract((), lambda: "map", dict, {"left": FLAG}),
}  # fmt: skip
