"""Continuation of the critical manifold: curves through folds, fold curves, and sheets over two variables."""

from __future__ import annotations

from gsp.critical.continuation.critical_curve import continue_critical, switch_branch
from gsp.critical.continuation.curve import CriticalCurve
from gsp.critical.continuation.fold_curve import FoldCurve, continue_folds
from gsp.critical.continuation.sheet import CriticalSheet, critical_sheet
from gsp.critical.continuation.special_points import SpecialKind, SpecialPoint
from gsp.errors import Status

# The name that endings of continuations had before there was one vocabulary.
Ending = Status

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
