"""Errors over the span that are measured against a full run, where no series tells them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from gsp.choice.candidates import Candidate, ModelKind, Trial, measured_candidate
from gsp.choice.choice import choose
from gsp.choice.forecast import forecast_of
from gsp.choice.measured_errors import measured_errors, measured_where_untold
from gsp.choice.prediction import Failure
from gsp.integration.trajectory import trajectory_of
from gsp.readers.loading import load_noted
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.systems.system import SlowFastSystem

x, y, eps = sp.symbols("x y epsilon")
E, LAYER, END = 0.05, 0.3, 2.0
# x' = -y, epsilon y' = x - y: to order 0 x' = -x, and the full system has the rates of E r^2 + r + 1 = 0.
SCENE = Scene(
    SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=eps),
    region={"x": (0, 2)}, start={"x": 1, "y": 1}, span=(0, END), epsilon=E, epsilons=(E, E / 2), tolerance=1e-3,
)  # fmt: skip


def exact(times: np.ndarray) -> np.ndarray:
    fast, slow = np.sort(np.roots([E, 1, 1]))
    share = (-1 - slow) / (fast - slow)
    return share * np.exp(fast * times) + (1 - share) * np.exp(slow * times)


def untold(order: int) -> Candidate:
    return Candidate(ModelKind.REDUCED, order, failure=Failure.UNTOLD, why_not="nothing tells its error")


def test_the_error_is_the_largest_behind_the_layer_relative_to_the_largest_value() -> None:
    found = measured_errors(study_of(SCENE), [untold(0)], ["x"], LAYER)
    times = np.linspace(LAYER, END, 4001)
    full = exact(times)
    assert found == {0: pytest.approx((np.abs(np.exp(-times) - full) / full.max()).max(), rel=1e-3)}


def test_nothing_is_measured_in_the_layer_nor_of_an_order_that_does_not_follow() -> None:
    study = study_of(SCENE)
    assert not measured_errors(study, [untold(0)], ["x"], END)
    leaves = replace(untold(1), failure=Failure.END)
    assert set(measured_errors(study, [untold(0), leaves], ["x"], LAYER)) == {0}


def test_the_error_is_the_same_where_a_scene_reconstructs() -> None:
    place = replace(SCENE, reconstruction={sp.Symbol("q"): y})
    (own,), (alone,) = (
        measured_errors(study_of(s), [untold(0)], ["x"], LAYER).values() for s in (place, SCENE)
    )
    assert own == pytest.approx(alone)


def test_what_is_predicted_and_what_is_measured_are_relative_to_the_largest_value_behind_the_layer() -> None:
    """x falls to a third before the layer has left less than a tenth of the tolerance."""
    choice = choose(replace(SCENE, tolerance=1e-9), solve=False)
    assert np.abs(exact(np.linspace(choice.layer, END, 401))).max() < 0.5
    (error,) = measured_errors(choice.study, [choice.candidates[0]], ["x"], choice.layer).values()
    assert 0.33 * choice.candidates[0].predicted <= error <= 1.02 * choice.candidates[0].predicted


def test_the_places_of_a_late_span_are_told_apart() -> None:
    """x' = -y from t = 2020.25: at t = 2020 nothing begins, ends or fails."""
    late = replace(SCENE, span=(2020.25, 2020.75))
    text = str(choose(late, solve=False))
    assert "to 2020.75 at epsilon" in text
    assert "2020 " not in text
    assert "2020." in text.splitlines()[-1]


@pytest.mark.parametrize("share", [0.85, 0.95])
def test_a_measured_error_has_to_be_within_what_the_integrator_leaves_as_a_predicted_one_has(
    share: float,
) -> None:
    found = measured_candidate(Trial(untold(0)), share * SCENE.tolerance, SCENE).candidate
    assert found.valid is (share < 0.9)
    assert ("passes the 0.0009 that the integrator leaves of the tolerance" in found.why_not) is (share > 0.9)


@pytest.mark.parametrize("tolerance", [1e-3, 0.2])
def test_only_what_serves_takes_the_place_of_what_is_not_told(tolerance: float) -> None:
    forecast = forecast_of(replace(SCENE, tolerance=tolerance), (0,))
    (found,) = measured_where_untold([Trial(untold(0))], forecast, ["x"])
    assert found.candidate.valid is (tolerance == 0.2)
    assert found.candidate.is_measured is (tolerance == 0.2)


def test_where_something_serves_as_predicted_nothing_is_measured() -> None:
    serving = Trial(Candidate(ModelKind.REDUCED, 1, 1e-9, valid=True))
    trials = [Trial(untold(0)), serving]
    assert measured_where_untold(trials, forecast_of(replace(SCENE, tolerance=0.2), (0,)), ["x"]) == trials


@pytest.mark.exhaustive
def test_a_series_that_is_run_through_ends_no_choice() -> None:
    """A battery: order 2 is the last that is run, no higher one tells its error, and a full run does."""
    scene, _ = load_noted(Path(__file__).parents[1] / "systems" / "battery.toml")
    choice = choose(scene, solve=False)
    (last,) = [c for c in choice.candidates if c.order == 2]
    assert last.valid
    assert last.is_measured
    study = choice.study
    times = np.linspace(scene.span[0] + choice.layer, scene.span[1], 97)
    common = {"span": scene.span, "epsilon": scene.epsilon, "rtol": 1e-9, "atol": 1e-12, "at": times}
    full = trajectory_of(study.system, start=study.start, **common)
    own = trajectory_of(study.reduced(2), start=study.base_point(2), **common)
    worst = max(np.abs(own[n] - full[n]).max() / np.abs(full[n]).max() for n in choice.names)
    assert last.predicted == pytest.approx(worst, rel=0.2)
