"""What a proof says: its claim holds, it does not, or neither was found."""

from __future__ import annotations

from enum import StrEnum


class ProofVerdict(StrEnum):
    """What a certificate says."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"
