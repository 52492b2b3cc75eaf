"""Parts that may fail without the whole: what cannot be made is `Missing`, with its reason in its place."""

from __future__ import annotations

import traceback
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from gsp.errors import DefectWarning, GspError, MissingPartError, Reason, one_line

T = TypeVar("T")

# What arithmetic itself may end in, on a model that is well formed.
NUMERICAL = (ArithmeticError, np.linalg.LinAlgError)


@dataclass(frozen=True)
class Missing:
    """A part that could not be made, and why, as one or a few sentences."""

    reason: Reason


def attempt(what: str, make: Callable[[], T]) -> T | Missing:
    """What `make` returns, or `Missing` when it raises a `GspError` or a numerical error.

    Any other exception is a defect of this package: it is `Missing` too, and a `DefectWarning` names `what`, the
    exception and its place. An interrupt passes through.
    """
    try:
        return make()
    except GspError as error:
        return Missing(error.reason)
    except NUMERICAL as error:
        return Missing(Reason(f"the computation failed: {error or type(error).__name__}."))
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        warnings.warn(
            f"a defect in gsp: {what} could not be made. {one_line(error, 200)} "
            f"({Path(frame.filename).name}, line {frame.lineno}). Please report it with the model.",
            DefectWarning,
            stacklevel=2,
        )
        fact = f"a defect in gsp ({type(error).__name__})"
        return Missing(Reason.of(fact, "Please report it with the model."))


def made(part: T | Missing) -> T:
    """The part; raises `MissingPartError` with the reason when there is none."""
    if isinstance(part, Missing):
        raise MissingPartError(part.reason)
    return part
