"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import tempfile

import gsp
from tests.contracts import FLAG, FOLDER, LIMIT, NAME, TIMES, Contract, kind

VERBS = {
    "sweep": Contract(
        (), lambda: "integrate",
        lambda: {"over": {"epsilon": (0.1,)}, "into": tempfile.mkdtemp(), "model": "michaelis_menten"},
        {"over": kind(inside=TIMES), "into": FOLDER, "model": NAME, "options": kind(), "workers": LIMIT,
         "client": kind(), "anew": FLAG, "points_per_chunk": LIMIT},
    ),
}  # fmt: skip

NOUNS = {
    "Sweep": (
        lambda: gsp.sweep(
            "integrate", model="michaelis_menten", over={"epsilon": (0.01,)}, into=tempfile.mkdtemp(), workers=1
        ),
        lambda n: (str(n), n.to_xarray().final.values),
    ),
}  # fmt: skip
