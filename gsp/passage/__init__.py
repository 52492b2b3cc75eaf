"""Passage through losses of normal hyperbolicity: folds, and delayed exits along branches that go on."""

from __future__ import annotations

from gsp.passage.delay import DelayedExit, ExitKind, entry_exit
from gsp.passage.delay_measurement import MeasuredDelay, measure_delay
from gsp.passage.drop import Drop, DropKind
from gsp.passage.extended import ExtendedOrbit, follow
from gsp.passage.failure import PassageError
from gsp.passage.fold_measurement import AiryFit, FoldExit, fit_omega0, fold_exit
from gsp.passage.folds import FoldPassage, fold_passage, omega0
from gsp.passage.losses_met import Outcome, PassedLoss

__all__ = [
    "AiryFit",
    "DelayedExit",
    "Drop",
    "DropKind",
    "ExitKind",
    "ExtendedOrbit",
    "FoldExit",
    "FoldPassage",
    "MeasuredDelay",
    "Outcome",
    "PassageError",
    "PassedLoss",
    "entry_exit",
    "fit_omega0",
    "fold_exit",
    "fold_passage",
    "follow",
    "measure_delay",
    "omega0",
]
