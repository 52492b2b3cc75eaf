"""The measurement of work curves: what it says of runs that fail, and how far it is."""

import numpy as np
import pytest

from gsp.comparison.work_runs import Task, WorkKind, measure

REFERENCE = np.array([[1.0, 2.0]])


@pytest.fixture(autouse=True)
def timed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gsp.comparison.work_runs.ROUNDS", 1)
    monkeypatch.setattr("gsp.comparison.work_runs.MEASURED", 0.0)


def measured(failing: set[float], *, reasons: dict[float, str] | None = None):
    def run(rtol: float):
        return (REFERENCE * np.nan if rtol in failing else REFERENCE * (1 + rtol)), 10, 30

    steps: list[float] = []
    task = Task("one", WorkKind.FULL, run, failures=reasons or {})
    (curve,) = measure([task], (1e-2, 1e-4, 1e-6), REFERENCE, 1e9, steps.append)
    assert steps == pytest.approx([1 / 3, 2 / 3, 1])
    return curve


def test_every_tolerance_that_is_reached_is_a_point() -> None:
    curve = measured(set())
    assert [point.rtol for point in curve.points] == [1e-2, 1e-4, 1e-6]
    assert [point.error for point in curve.points] == pytest.approx([1e-2, 1e-4, 1e-6], rel=1e-9)
    assert curve.ended == ""


def test_a_failure_is_named_where_it_is_the_last() -> None:
    assert measured({1e-4}).ended == ""
    assert measured({1e-6}).ended == "did not reach the end at rtol 1e-06"
    assert measured({1e-4, 1e-6}, reasons={1e-6: "a pole"}).ended == "a pole at rtol 1e-06"
