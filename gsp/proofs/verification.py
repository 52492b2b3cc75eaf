"""`gsp verify`: a file of a proof, checked by the checker of its kind."""

from __future__ import annotations

from pathlib import Path

from gsp.proofs import checker, tube_checker
from gsp.proofs.checked_tube import CheckedTube
from gsp.proofs.checker import Checked
from gsp.proofs.untrusted import read_json


def verify(path: Path) -> Checked | CheckedTube:
    """Check the proof in a file; raises `Rejected` with the reason when it does not hold, OSError when it cannot
    be read.
    """
    read = read_json(path)
    kind = read.get("format") if isinstance(read, dict) else None
    if isinstance(kind, str) and kind.startswith(tube_checker.KIND):
        return tube_checker.check(read)
    return checker.checked(read)
