"""`LossKind`: the one vocabulary of what happens where normal hyperbolicity is lost."""

from __future__ import annotations

from enum import StrEnum


class LossKind(StrEnum):
    """What happens where a condition of normal hyperbolicity fails, and at special points of the critical manifold."""

    FOLD = "fold"
    CUSP = "cusp"
    TRANSCRITICAL = "transcritical point"
    PITCHFORK = "pitchfork"
    BRANCH_POINT = "branch point"
    FOLDED_SINGULARITY = "folded singularity"
    RANK_CHANGE = "rank change"
    HOPF = "Hopf point"
    BOGDANOV_TAKENS = "Bogdanov-Takens point"
    NEUTRAL_SADDLE = "neutral saddle"
    NILPOTENT = "nilpotent fast Jacobian"
    VANISHING_DAMPING = "vanishing linear damping"
    HIDDEN_TIME_SCALE = "hidden time scale"
    CENTRE = "centre"
    DEGENERATE = "degenerate point"
    DOMAIN_END = "end of the field's domain"
    NON_SMOOTH = "non-smooth right-hand side"
    BRANCH_POLE = "pole of the branch"
    FIELD_POLE = "pole of the field"
    VISIBLE_FOLD = "visible fold"
    INVISIBLE_FOLD = "invisible fold"
    TWO_FOLD = "two-fold"
    SLIP_ONSET = "onset of slip"
    CONE_END = "end of the friction cone"

    @property
    def is_pole(self) -> bool:
        """Whether the branch or the field goes to infinity."""
        return self in (LossKind.BRANCH_POLE, LossKind.FIELD_POLE)

    @property
    def is_fold(self) -> bool:
        """Whether M0 turns back here, as it does at the maximum of a law of friction too."""
        return self in (LossKind.FOLD, LossKind.SLIP_ONSET)

    @property
    def of_contact(self) -> LossKind:
        """What it is called at a contact: a visible fold of the field in which it slips is the end of its cone."""
        return LossKind.CONE_END if self is LossKind.VISIBLE_FOLD else self

    @property
    def is_branch_point(self) -> bool:
        """Whether several curves of M0 meet here."""
        return self in (LossKind.TRANSCRITICAL, LossKind.PITCHFORK, LossKind.BRANCH_POINT)


SpecialKind = LossKind
"""The name that the kinds of special points had in 0.2.0."""
