"""A reduced run over many coupled fast variables ends where a pair of their eigenvalues passes the imaginary axis."""

import numpy as np
import pytest
import sympy as sp

from gsp import Event, SlowFastSystem, Status, expand, integrate, integrate_many, restrict, solve_critical
from gsp.integration.reduction_end import passed_pairs

s, epsilon = sp.symbols("s epsilon")
CELLS = 9
# The eigenvalues over y = 0 are s - w for the ninth roots w of 1: no real one comes first.
PASSED = float(np.cos(8 * np.pi / 9))


@pytest.fixture(scope="module")
def ring():
    y = sp.symbols(f"y:{CELLS}")
    fast = {y[i]: s * y[i] - y[(i + 1) % CELLS] for i in range(CELLS)}
    system = SlowFastSystem(slow={s: sp.Integer(1)}, fast=fast, epsilon=epsilon)
    (branch,) = solve_critical(system).branches
    return restrict(expand(branch, order=0))


def test_a_run_ends_before_the_pair_that_it_passes(ring) -> None:
    run = integrate(ring, start={"s": -2.0}, span=(0.0, 3.0), epsilon=0.01)
    assert run.status is Status.HYPERBOLICITY_LOST
    assert run["s"][-1] <= PASSED
    assert "an imaginary pair of eigenvalues" in str(run)
    before = integrate(ring, start={"s": -2.0}, span=(0.0, 2.0 + PASSED - 1e-6), epsilon=0.01)
    assert before.status is Status.SUCCESS


def test_between_its_steps_the_pair_lies(ring) -> None:
    grid = np.linspace(0.0, 3.0, 31)
    run = integrate(ring, start={"s": -2.0}, span=(0.0, 3.0), epsilon=0.01, at=grid)
    assert run.t[-1] <= 2.0 + PASSED
    ends = [float(word.rstrip(",;:.")) for word in run._outcome.note.split() if word[0].isdigit()]
    assert ends[0] <= 2.0 + PASSED <= ends[1]
    assert np.array_equal(run.t, grid[grid <= ends[0]])


def test_events_beyond_the_pair_are_none(ring) -> None:
    events = [Event(s + sp.Rational(3, 2), name="early"), Event(s, name="late")]
    run = integrate(ring, start={"s": -2.0}, span=(0.0, 3.0), epsilon=0.01, events=events)
    assert run.status is Status.HYPERBOLICITY_LOST
    assert len(run.events["late"].times) == 0
    assert len(run.events["early"].times) <= 1
    stop = [Event(s - 1, name="stop", terminal=True)]
    assert (
        integrate(ring, start={"s": -2.0}, span=(0.0, 5.0), epsilon=0.01, events=stop).status
        is Status.HYPERBOLICITY_LOST
    )


def test_events_of_the_last_step_before_the_pair_are_kept(ring) -> None:
    options = {"start": {"s": -2.0}, "span": (0.0, 3.0), "epsilon": 0.01}
    t = integrate(ring, **options).t
    places = {"inside": (t[-2] + t[-1]) / 2, "first step": (t[0] + t[1]) / 2, "behind": t[-1] + 1e-6}
    events = [Event(s - sp.Rational(float(time) - 2.0), name=name) for name, time in places.items()]
    run = integrate(ring, events=events, **options)
    assert run.status is Status.HYPERBOLICITY_LOST
    assert run.events["inside"].times == pytest.approx([places["inside"]], abs=1e-9)
    assert run.events["first step"].times == pytest.approx([places["first step"]], abs=1e-9)
    assert run.events["behind"].times.size == 0


def test_a_member_ends_as_its_run_alone(ring) -> None:
    found = integrate_many(ring, starts={"s": np.array([-2.0, -4.0])}, span=(0.0, 2.0), epsilon=0.01)
    alone = [integrate(ring, start={"s": a}, span=(0.0, 2.0), epsilon=0.01) for a in (-2.0, -4.0)]
    assert [run.status for run in alone] == [Status.HYPERBOLICITY_LOST, Status.SUCCESS]
    assert list(found.statuses) == [run.status for run in alone]


def test_a_long_run_is_looked_at_within_a_budget(ring, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[float] = []
    count = passed_pairs._unstable
    monkeypatch.setattr(passed_pairs, "OPERATIONS", 0.0)
    monkeypatch.setattr(passed_pairs, "_unstable", lambda v, y, p: looked.append(y[0]) or count(v, y, p))
    grid = np.linspace(0.0, 3.0, 301)
    run = integrate(
        ring, start={"s": -2.0}, span=(0.0, 3.0), epsilon=0.01, events=[Event(s - 9, name="never")], at=grid
    )
    assert run.status is Status.HYPERBOLICITY_LOST
    assert len(looked) <= passed_pairs.FEWEST + 1 + np.log2(301)
    assert run.t[-1] == grid[grid <= 2.0 + PASSED][-1]
