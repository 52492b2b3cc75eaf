"""The public nouns of this package, as the tests of all of them take them."""

from __future__ import annotations

import gsp
from tests.example_nouns import van_der_pol
from tests.singular.public import delayed

ON_ORBIT = {"x": 2.0, "y": 0.6}

NOUNS = {
    "CycleCertificate": (
        lambda: gsp.certify(gsp.singular_orbit(gsp.solve_critical(van_der_pol()).nearest(ON_ORBIT), ON_ORBIT)),
        lambda n: (n.epsilon_0, n.epsilon_1),
    ),
    "PassageCertificate": (
        lambda: gsp.certify(delayed(), epsilon=0.01),
        lambda n: (n.epsilon_0, n.delay and n.delay.stays_to),
    ),
}  # fmt: skip
