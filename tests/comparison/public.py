"""The public nouns and verbs of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.contracts import LADDER, NAME, ORDERS_OR_NONE, TIMES, Contract, kind
from tests.example_nouns import michaelis, study

VERBS = {
    "method_table": Contract(
        ("Scene", "Study"), michaelis, dict,
        {"points": kind("-1", "0.5", "an array", "an array of one"), "refinements": ORDERS_OR_NONE,
         "iterates": ORDERS_OR_NONE, "orders": ORDERS_OR_NONE},
    ),
    "compare": Contract(("Scene", "Study", "Nesting"), michaelis, dict),
    "work_precision": Contract(
        ("Scene", "Study"), michaelis, dict,
        {"rtols": LADDER, "methods": kind("[]"), "peers": kind("[]"), "orders": ORDERS_OR_NONE},
    ),
    "failure_map": Contract(
        ("Scene", "Study"), michaelis, dict,
        {"axis": NAME, "positions": TIMES, "tolerances": LADDER},
    ),
}  # fmt: skip

NOUNS = {
    "Comparison": (lambda: gsp.compare(study(), orders=(0, 1)), lambda n: (n.errors, n.slopes)),
    "FailureMap": (
        lambda: gsp.failure_map(study(), orders=(0,), positions=(0.4, 0.5), epsilons=(0.02, 0.01)),
        lambda n: n.as_rows(),
    ),
    "MethodTable": (lambda: gsp.method_table(study(), orders=(0, 1)), lambda n: n.as_rows()),
    "WorkPrecision": (
        lambda: gsp.work_precision(study(), orders=(0,), rtols=(1e-3, 1e-4), methods=(), peers=()),
        lambda n: n.as_rows(),
    ),
}  # fmt: skip
