"""Passage through losses of normal hyperbolicity: folds, and delayed exits along branches that go on."""

from __future__ import annotations

from gsp.singular.passage.delay import entry_exit
from gsp.singular.passage.delay_measurement import MeasuredDelay, measure_delay
from gsp.singular.passage.delayed_exit import DelayedExit, ExitKind
from gsp.singular.passage.drop import Drop, DropKind
from gsp.singular.passage.extended import ExtendedOrbit, follow
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_measurement import AiryFit, FoldExit, fit_omega0, fold_exit
from gsp.singular.passage.folds import FoldPassage, fold_passage, omega0
from gsp.singular.passage.losses_met import Outcome, PassedLoss

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
