"""What a proof says: its claim holds, it does not, or neither was found."""

from __future__ import annotations

from enum import StrEnum

from gsp.errors import GspError


class ProofVerdict(StrEnum):
    """What a certificate says."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"


def require_proved(verdict: ProofVerdict, reason: str, remedy: str) -> None:
    """Raise `GspError` with what to do unless there is a proof, which can be saved."""
    if verdict is not ProofVerdict.PROVED:
        raise GspError("only a proof can be saved.", remedy, got=f"the verdict {verdict.name}: {reason}")
