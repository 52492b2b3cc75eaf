"""Layers that carry a start beyond its sheet, and rates that leave nothing to divide by."""

from dataclasses import replace

import pytest
import sympy as sp

from gsp import load
from gsp.choice.choice import choose
from gsp.choice.forecast import forecast_of
from gsp.choice.prediction import Failure
from gsp.choice.verdict import Answer
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.systems.system import SlowFastSystem
from tests.literature import FOLDER

x, y, epsilon = sp.symbols("x y epsilon")


@pytest.mark.exhaustive
def test_an_order_whose_base_point_is_beyond_the_sheet_does_not_refuse_those_below_it() -> None:
    # The coefficients of the base point grow by a factor 30 each: that of order 5 is 1e6, at p = -6.05.
    gene = study_of(replace(load(FOLDER / "gene_dimers.toml"), tolerance=1e-2))
    forecast = forecast_of(gene, (0, 1, 2, 3))
    assert max(forecast.prediction.runs) == 4
    assert "order 5" in forecast.astray
    assert choose(gene, solve=False).verdict.answer not in (Answer.NO, Answer.IN_PART)


@pytest.mark.exhaustive
def test_a_layer_that_carries_the_start_beyond_its_sheet_is_told() -> None:
    choice = choose(load(FOLDER / "gene_dimers_from_nothing.toml"), orders=(0,), solve=False)
    first = choice.candidates[0]
    assert first.failure is Failure.UNTOLD
    assert "Through order 1 the initial layer carries p = 7 to p = -17.98" in choice.verdict.accuracy
    assert "ends at p = -3.75" in choice.verdict.accuracy


@pytest.mark.exhaustive
@pytest.mark.parametrize("slow", [0, -1, -20, 20, sp.Rational(1, 1000)])
@pytest.mark.parametrize("fast", [-1, sp.Rational(-1, 1000), 0])
def test_no_rate_leaves_nothing_to_divide_by(slow, fast) -> None:
    scene = Scene(
        SlowFastSystem(slow={x: slow * x}, fast={y: fast * (y - x)}, epsilon=epsilon),
        region={"x": (-1, 1)},
        start={"x": 1, "y": 1},
        span=(0, 6),
        epsilon=0.1,
    )
    choice = choose(scene)
    assert str(choice.verdict).endswith(".")
    # The reduced run is exact: an error that falls with epsilon is not what stands in the way.
    assert "about" not in choice.verdict.remedy


def test_a_normal_rate_that_does_not_dominate_asks_for_a_smaller_epsilon_alone() -> None:
    choice = choose(load(FOLDER / "fast_slow_rate.toml"))
    assert choice.candidates[0].failure is Failure.RATE
    assert choice.verdict.remedy == "A smaller epsilon would help."
