"""Continuation of the critical manifold: curves through folds, fold curves, and sheets over two variables."""

from __future__ import annotations

from gsp.continuation.critical_curve import continue_critical, switch_branch
from gsp.continuation.curve import CriticalCurve
from gsp.continuation.ending import Ending
from gsp.continuation.fold_curve import FoldCurve, continue_folds
from gsp.continuation.sheet import CriticalSheet, critical_sheet
from gsp.continuation.special_points import SpecialKind, SpecialPoint

__all__ = [
    "CriticalCurve",
    "CriticalSheet",
    "Ending",
    "FoldCurve",
    "SpecialKind",
    "SpecialPoint",
    "continue_critical",
    "continue_folds",
    "critical_sheet",
    "switch_branch",
]
