"""Passage through losses of normal hyperbolicity: folds, and delayed exits along branches that go on."""

from __future__ import annotations

from gsp.passage.drop import Drop, DropKind
from gsp.passage.failure import PassageError
from gsp.passage.fold_measurement import AiryFit, FoldExit, fit_omega0, fold_exit
from gsp.passage.folds import FoldPassage, fold_passage, omega0

__all__ = [
    "AiryFit",
    "Drop",
    "DropKind",
    "FoldExit",
    "FoldPassage",
    "PassageError",
    "fit_omega0",
    "fold_exit",
    "fold_passage",
    "omega0",
]
