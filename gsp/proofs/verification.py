"""`gsp verify`: a file of a proof, checked by the checker of its kind."""

from __future__ import annotations

from pathlib import Path

from gsp.proofs import checker, circuit_checker, cycle_checker, passage_checker, tube_checker
from gsp.proofs.checked_cycle import CheckedCycle
from gsp.proofs.checked_passage import CheckedPassage
from gsp.proofs.checked_tube import CheckedTube
from gsp.proofs.checker import Checked
from gsp.proofs.untrusted import read_json


def verify(path: Path) -> Checked | CheckedTube | CheckedCycle | CheckedPassage:
    """Check the proof in a file; raises `Rejected` with the reason when it does not hold, OSError when it cannot
    be read.
    """
    read = read_json(path)
    kind = read.get("format") if isinstance(read, dict) else None
    if isinstance(kind, str) and kind.startswith(tube_checker.KIND):
        return tube_checker.check(read)
    for one in (cycle_checker, circuit_checker, passage_checker):
        if kind == one.FORMAT:
            return one.check(read)
    return checker.checked(read)
