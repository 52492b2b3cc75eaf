"""Why a measured run shows no exit: each reason with the numbers of the run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from gsp.errors import Status
from gsp.singular.passage.delay_measurement import MeasuredDelay

TIMES = np.array([0.0, 0.5, 1.25])


@pytest.mark.parametrize(
    ("loss", "distance", "status", "why"),
    [
        (
            2.0,
            [1.0, 0.01, 0.001],
            Status.NON_FINITE,
            f"before the loss, at t = 1.25: {Status.NON_FINITE.meaning}",
        ),
        (
            2.0,
            [1.0, 0.5, 0.25],
            Status.SUCCESS,
            "starts outside the branch's basin: it comes no nearer than 0.25",
        ),
        (
            2.0,
            [1.0, 0.01, 0.5],
            Status.SUCCESS,
            "left the neighbourhood before the loss, where it is at distance 0.5",
        ),
        (
            0.75,
            [1.0, 0.01, 0.02],
            Status.SUCCESS,
            "never reaches the radius: distance 0.02 at most up to t = 1.25",
        ),
    ],
)
def test_why_there_is_no_exit_is_told_with_its_numbers(
    loss: float, distance: list[float], status: Status, why: str
) -> None:
    run: Any = SimpleNamespace(radius=0.1, delayed=SimpleNamespace(loss=SimpleNamespace(t=loss)))
    assert why in MeasuredDelay._reason(cast("MeasuredDelay", run), TIMES, np.array(distance), status)
