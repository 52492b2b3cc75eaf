"""A series that ends before the orders asked for: what there is of it is used, and the end is told."""

import json
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

from gsp import load, models
from gsp.analysis.analysis import analyse
from gsp.choice.candidates import ModelKind, reduced_candidate
from gsp.choice.choice import choose
from gsp.choice.forecast import forecast_of
from gsp.choice.prediction import Failure
from gsp.choice.simulation import simulate
from gsp.choice.verdict import Answer
from gsp.cli import cli
from gsp.comparison.comparison import compare
from gsp.comparison.survey import demands_of
from gsp.errors import BudgetError
from gsp.report import as_json
from gsp.results.point_verbs import point_verbs
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.slow.expansion import Expansion
from gsp.systems.system import SlowFastSystem

LONG = Path(__file__).parents[1] / "systems" / "chay_keizer.toml"
WHY = "the exact algebra has met its limit"


@pytest.fixture
def ends(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Lets every series end at the order given, as a spent budget does."""

    def limit(last: int) -> None:
        whole = Expansion._next

        def bounded(expansion: Expansion) -> None:
            if expansion._known == last:
                raise BudgetError(f"{WHY}.", limit=last)
            whole(expansion)

        monkeypatch.setattr(Expansion, "_next", bounded)

    return limit


@pytest.mark.exhaustive
def test_what_an_order_beyond_the_budget_spent_is_not_charged_to_those_before_it() -> None:
    study = study_of(load(LONG))
    ring = study.series(1, symbolic=False).chart.ring
    before = ring.spent, ring.terms
    with pytest.raises(BudgetError, match="order 2 was reached through order 1"):
        study.series(2, symbolic=False)
    assert (ring.spent, ring.terms) == before
    # It is known now: nothing is formed again to say so.
    with pytest.raises(BudgetError, match="order 3 was reached through order 1"):
        study.series(3, symbolic=False)
    series, ending = study.series_within_budget(3)
    assert series.order == 1
    assert ending.startswith("The series ends at order 1: the exact algebra met polynomials of ")


def test_orders_that_are_there_are_compared_and_the_end_is_told(ends) -> None:
    whole = compare(models.load("michaelis_menten"), orders=(0, 1))
    ends(1)
    found = compare(models.load("michaelis_menten"))
    assert list(found.errors) == [0, 1]
    assert found.slopes[1] == pytest.approx(whole.slopes[1], abs=0.05)
    assert found.ending == f"The series ends at order 1: {WHY}."
    assert found.ending in str(found)
    assert found.as_json()["attributes"]["ending"] == found.ending
    assert whole.ending == ""
    with pytest.raises(BudgetError, match="order 2 was reached through order 1"):
        compare(models.load("michaelis_menten"), orders=(2, 3))


def test_one_order_ahead_tells_an_error_and_the_last_order_has_none(ends) -> None:
    scene = models.load("michaelis_menten")
    whole = choose(scene, orders=(0, 1, 2), solve=False)
    ends(1)
    found = choose(scene, orders=(0, 1, 2), solve=False)
    zero, one, two, full = found.candidates
    assert zero.predicted == pytest.approx(whole.candidates[0].predicted, rel=0.2)
    assert zero.failure is whole.candidates[0].failure
    assert one.failure is Failure.UNTOLD
    assert not one.valid
    assert math.isnan(one.predicted)
    assert two.why_not == "not looked at: the series is run through order 1 only"
    assert found.model is full
    assert found.ending == f"The series ends at order 1: {WHY}."
    assert found.ending in found.verdict.accuracy
    assert str(found).count(found.ending) == 1
    # One verdict, whatever shows it.
    shown = found.as_json()
    assert shown["attributes"]["reason"] == found.reason
    assert shown["attributes"]["ending"] == found.ending
    assert shown["variables"]["why_not"]["values"] == [c.why_not for c in found.candidates]
    assert whole.ending == ""


def test_a_single_order_ahead_that_does_not_differ_tells_nothing(ends) -> None:
    """The slow rate does not feel the fast variable, so that no order of the slow run differs from another."""
    x, y, eps = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: -x}, fast={y: x**2 - y}, epsilon=eps)
    scene = Scene(system, {"x": (-2, 2)}, {"x": 1, "y": 0.5}, (0, 2), 0.01, (0.02, 0.01), 1e-4)
    assert choose(scene, orders=(0,), solve=False).candidates[0].valid
    ends(1)
    found = reduced_candidate(forecast_of(scene, (0,)), 0, scene, 1e-5).candidate
    assert found.failure is Failure.UNTOLD
    assert found.why_not.startswith("nothing tells its error: the term of order 1 moves the run by no more")
    # Then it is measured, and is that of two runs of one flow.
    measured = choose(scene, orders=(0,), solve=False).candidates[0]
    assert measured.valid
    assert measured.is_measured
    assert measured.predicted < 1e-8


@pytest.mark.exhaustive
def test_the_solved_manifold_serves_where_no_order_tells_its_error(ends) -> None:
    ends(0)
    found = choose(models.load("michaelis_menten"), orders=(0, 1))
    solved = found.candidates[-2]
    assert (found.candidates[0].failure, solved.kind) == (Failure.UNTOLD, ModelKind.SOLVED)
    assert solved.valid
    assert (found.manifold is not None) == (found.model.kind is ModelKind.SOLVED)
    assert found.verdict.answer in (Answer.YES, Answer.AS_FAST, Answer.NO_GAIN)
    assert found.measured <= found.tolerance


def test_a_reduced_flow_with_one_order_ahead_is_simulated(ends) -> None:
    ends(1)
    scene = models.load("michaelis_menten")
    found = choose(scene, tolerance=0.2, orders=(0,), solve=False)
    assert found.candidates[0].valid
    run = simulate(study_of(scene).asking(tolerance=0.2), choice=found)
    assert run.status.ok


def test_a_sweep_and_a_map_have_no_number_for_an_order_that_is_not_there(ends) -> None:
    ends(1)
    study = study_of(models.load("michaelis_menten"))
    record = point_verbs()["compare"].record(study, 0.01, 1e-4)
    assert np.isfinite(record["error"]).tolist() == [True, True, False, False]
    claims = list(demands_of(study, np.array([0.01]), np.array([1e-3]), (0, 2)))
    assert claims[0].is_measured
    assert claims[1].reason == f"The series ends at order 1: {WHY}."


def test_an_analysis_has_the_orders_that_are_there(ends) -> None:
    ends(1)
    found = analyse(models.load("michaelis_menten"))
    assert not found.lost
    assert (found.series.order, found.reduced.flow.order) == (1, 1)
    assert list(found.comparison.errors) == [0, 1]
    assert found.cut == f"The series ends at order 1: {WHY}."
    assert str(found).count(found.cut) >= 1
    content = as_json(found)
    assert content["series"]["cut"] == found.cut
    assert content["choice"]["attributes"]["reason"] == found.choice.reason
    assert content["missing"] == {}


@pytest.mark.exhaustive
def test_a_long_series_is_chosen_for_at_the_command_line() -> None:
    shown = json.loads(CliRunner().invoke(cli, ["choose", str(LONG), "--json"]).stdout)
    assert shown["coordinates"]["model"]["values"][:2] == ["reduced 0", "reduced 1"]
    assert re.search(
        r"at order \d it has coefficients of \d+ steps, more than 600", shown["attributes"]["ending"]
    )
    # Two orders run ahead, so that the error of order 0 is told whatever ends the series.
    assert "the reduced flow of order 0 stays within" in shown["attributes"]["accuracy"]
