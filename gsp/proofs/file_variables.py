"""What a sentence calls the variables z0, z1, ... of a proof file, whose own names may be such words."""

from __future__ import annotations

import re
from collections.abc import Sequence


def lettered(names: Sequence[str], *texts: str) -> tuple[str, ...]:
    """The letter that stands before the number of a variable, longer where a name would be one, and `texts` with it.

    >>> lettered(("x", "y"), "z0*z1"), lettered(("z1", "z0"), "z0*z1")
    (('z', 'z0*z1'), ('zz', 'zz0*zz1'))
    """
    letter = "z"
    while any(re.fullmatch(f"{letter}[0-9]+", name) for name in names):
        letter += "z"
    return letter, *(re.sub(r"\bz(?=[0-9])", letter, text) for text in texts)
