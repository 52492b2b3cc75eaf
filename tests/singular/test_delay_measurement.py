"""Why a measured run shows no exit: each reason with the numbers of the run."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import Status
from gsp.singular.passage.delay_measurement import MeasuredDelay, measure_delay
from gsp.singular.passage.entry_exit import entry_exit
from gsp.systems.system import SlowFastSystem

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


def test_a_run_in_double_precision_goes_on_where_one_fast_variable_alone_falls_to_zero() -> None:
    # z = x + i y = -epsilon + a exp((t^2/2 + i t)/epsilon): y falls to 0 beside x = -epsilon, and took every step.
    x, y, t, epsilon = sp.symbols("x y t epsilon")
    u = x + epsilon
    system = SlowFastSystem(slow={t: 1}, fast={x: t * u - y, y: u + t * y}, epsilon=epsilon)
    delayed = entry_exit(solve_critical(system).branches[0], start={"t": -2})
    # The deviation epsilon of the start is back at 2.
    measured = measure_delay(delayed, epsilon=0.1, radius=0.2)
    assert measured.double.status.ok
    assert measured.double_exit == pytest.approx(float(measured.exit), abs=0.05)
