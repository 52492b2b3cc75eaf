"""The failure map: boundaries where theory puts them, and every cell a measurement."""

from __future__ import annotations

import csv
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

from gsp import charts, models
from gsp.comparison import compared_runs, survey
from gsp.comparison.failure_map import failure_map
from gsp.comparison.survey import EXPLICIT, IMPLICIT, MANIFOLD, NEWTON, reduced_name, series_name
from gsp.errors import DeclarationError, GspError
from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem
from tests.rescaling import rescaled

x, y, epsilon = sp.symbols("x y epsilon")


def scene(slow, fast, start, region, *, span=(0, 1), tolerance=1e-6) -> Scene:
    system = SlowFastSystem(slow={x: slow}, fast={y: fast}, epsilon=epsilon, name="probe")
    return Scene(system, region, start, span, 0.01, (0.04, 0.02, 0.01), tolerance, name="probe")


@pytest.fixture(scope="module")
def van_der_pol():
    return failure_map(models.load("van_der_pol"), epsilons=np.geomspace(1e-4, 1e-1, 10))


@pytest.mark.exhaustive
def test_higher_orders_hold_where_lower_ones_do_for_small_epsilon(van_der_pol):
    least = van_der_pol.least_order[0]
    on_sheet = van_der_pol.positions > -0.5
    assert (least[on_sheet] >= 0).all()
    for low, high in ((0, 1), (1, 2), (2, 3)):
        below, above = (van_der_pol.places[series_name(n)].measure[0][on_sheet] for n in (low, high))
        assert (above < below).all()


@pytest.mark.exhaustive
def test_nothing_holds_beyond_the_fold(van_der_pol):
    beyond = van_der_pol.positions < -2.0 / 3.0
    for claim in van_der_pol.places.values():
        assert not claim.holds[:, beyond].any()
    assert (van_der_pol.least_order[:, beyond] == -1).all()


@pytest.mark.exhaustive
def test_the_manifold_is_lost_before_the_fold_at_a_distance_that_grows_like_epsilon_to_two_thirds():
    found = failure_map(
        models.load("van_der_pol"),
        # At 3e-2 the distance is as long as the range of positions.
        epsilons=np.geomspace(1e-4, 1.3e-2, 8),
        positions=np.linspace(-2.0 / 3.0 + 1e-4, 0.8, 200),
        orders=(2,),
    )
    distance = []
    for row in found.places[series_name(2)].holds:
        distance.append(found.positions[np.flatnonzero(row)[0]] + 2.0 / 3.0)
    # epsilon^3 h_3 ~ epsilon^3 d^-4 against the tolerance: d ~ (epsilon^3/tolerance)^(1/4).
    slope = np.polyfit(np.log(found.epsilons), np.log(distance), 1)[0]
    assert slope == pytest.approx(0.75, abs=0.1)


def test_explicit_steps_are_held_back_below_a_line_in_epsilon(van_der_pol):
    share = van_der_pol.places[EXPLICIT].holds[:, van_der_pol.positions > 0.5].mean(axis=1)
    assert share[0] == 0.0
    assert share[-1] == 1.0
    ratio = van_der_pol.places[EXPLICIT].measure[:, -1]
    # Steps bounded by stability: their number grows like 1/epsilon.
    assert ratio[0] / ratio[1] == pytest.approx(10 ** (1 / 3), rel=0.25)


def test_demands_move_with_the_power_of_epsilon(van_der_pol):
    for n in (0, 1, 2):
        claim = van_der_pol.demands[reduced_name(n)]
        errors = claim.measure[:, 0]
        fitted = np.polyfit(np.log(van_der_pol.epsilons[:4]), np.log(errors[:4]), 1)[0]
        assert fitted == pytest.approx(n + 1, abs=0.1)
        assert (claim.holds == (claim.measure <= van_der_pol.tolerances)).all()


@pytest.mark.exhaustive
def test_explicit_steps_are_held_back_alike_in_any_unit():
    # The tolerance of states of 1e-9 was that of states of 1, and nothing held explicit steps back.
    found = []
    for unit in (1, 10**9):
        given = scene(-x, x + unit**2 * x**3 - y, {"x": 1 / unit, "y": 2 / unit}, {"x": (0.5 / unit, 2 / unit)})
        found.append(failure_map(given, orders=(0,)).demands[EXPLICIT].measure)
    assert found[1] == pytest.approx(found[0], rel=0.2)


@pytest.mark.exhaustive
def test_a_linear_fast_equation_never_fails():
    found = failure_map(scene(-x, x - y, {"x": 1, "y": 1}, {"x": (0.5, 2)}), orders=(0, 1, 2))
    for name in (NEWTON, MANIFOLD, IMPLICIT):
        assert found.places[name].share == 1.0, name
    assert found.places[EXPLICIT].share < 1.0


@pytest.mark.exhaustive
def test_newtons_method_goes_astray_where_its_basin_ends():
    # M0 is y = +-sqrt(x); from y = 1 Newton's method reaches the upper sheet for every x > 0.
    found = failure_map(scene(-x, x - y**2, {"x": 1, "y": 1}, {"x": (0.5, 2)}), orders=(0,))
    there = found.positions > 1e-3
    assert found.places[NEWTON].holds[:, there].all()
    # The tangent of tanh at y = 2 is so flat that from there the steps overshoot for x < 0.
    tanh = scene(-sp.Integer(1) / 10, x - sp.tanh(y), {"x": 0.95, "y": 2.0}, {"x": (0.0, 0.98)})
    lost = failure_map(tanh, positions=np.linspace(-0.9, 0.98, 21), orders=(0,), epsilons=(1e-4, 1e-3))
    newton = lost.places[NEWTON].holds
    assert newton[0, -1]
    assert not newton[0, 0]


def test_on_a_repelling_branch_runs_go_backward():
    found = failure_map(
        scene(-x, y - x**2, {"x": 1, "y": 1}, {"x": (0.5, 2)}),
        orders=(0, 1),
        epsilons=(0.01, 0.04),
        tolerances=(1e-3, 1e-6),
        positions=(0.5, 1.0, 2.0),
    )
    assert found.places[MANIFOLD].share > 0.9


def test_rows_say_what_was_measured(van_der_pol, tmp_path):
    rows = van_der_pol.as_rows()
    cells = van_der_pol.epsilons.size
    assert len(rows) == cells * (
        len(van_der_pol.places) * van_der_pol.positions.size
        + len(van_der_pol.demands) * van_der_pol.tolerances.size
    )
    with van_der_pol.write_csv(tmp_path / "map.csv").open(encoding="utf-8") as file:
        assert len(list(csv.reader(file))) > len(rows) / 2
    assert "reduced flow 3" in str(van_der_pol)
    assert van_der_pol.runs > 1000


def test_every_run_is_counted_and_its_errors_are_relative(monkeypatch):
    asked = []
    for module in (compared_runs, survey):

        def counted(flow, *, _run=module.trajectory_of, **options):
            asked.append(options["atol"] / options["rtol"])
            return _run(flow, **options)

        monkeypatch.setattr(module, "trajectory_of", counted)
    found = failure_map(
        scene(-x, x - y, {"x": 1, "y": 1}, {"x": (0.5, 2)}),
        orders=(0, 1),
        epsilons=(0.01, 0.02),
        tolerances=(1e-3, 1e-6),
        positions=(0.5, 1.0, 2.0),
    )
    assert found.runs == len(asked)
    assert max(asked) < 1.0


@pytest.mark.exhaustive
def test_the_chart_has_both_maps(van_der_pol):
    axes = charts.failure_map(van_der_pol)
    assert len(axes.figure.axes) == 2
    assert charts.png(axes).startswith(b"\x89PNG")


def test_the_largest_epsilon_is_that_below_which_all_holds(van_der_pol):
    claim = van_der_pol.places[reduced_name(2)].holds
    inside = (van_der_pol.positions >= 0.0) & (van_der_pol.positions <= 1.0)
    largest = van_der_pol.holds_up_to(2, between=(0.0, 1.0))
    assert claim[van_der_pol.epsilons <= largest][:, inside].all()
    assert not claim[van_der_pol.epsilons > largest][:, inside].all(axis=1)[0]
    # More room to hold in, more orders, and looser tolerances: no smaller.
    assert (
        van_der_pol.holds_up_to(2, between=(-0.5, 1.0))
        <= largest
        <= van_der_pol.holds_up_to(3, between=(0.0, 1.0))
    )
    assert van_der_pol.holds_over_span(1) <= van_der_pol.holds_over_span(1, tolerance=1e-3)
    # Beyond the fold there is nothing, at any epsilon.
    assert van_der_pol.holds_up_to(3, between=(-1.5, -1.0)) == 0.0
    with pytest.raises(DeclarationError, match="orders 0, 1, 2, 3"):
        van_der_pol.holds_over_span(7)
    with pytest.raises(DeclarationError, match="no position"):
        van_der_pol.holds_up_to(1, between=(5.0, 6.0))


def test_progress_goes_on_through_both_maps():
    shares: list[float] = []
    small, places = (0.01, 0.02, 0.04), (0.5, 1.0)
    failure_map(
        models.load("michaelis_menten"), epsilons=small, orders=(0,), positions=places, progress=shares.append
    )
    assert shares == sorted(set(shares))
    assert shares[-1] == 1.0
    assert sum(0.8 < share < 1.0 for share in shares) >= 3


def test_tolerances_are_those_asked_for():
    found = failure_map(
        models.load("linear"), epsilons=(0.01, 0.02), positions=(0.5, 1.0), tolerances=(1e-6, 1e-3), orders=(0,)
    )
    assert found.tolerances.tolist() == [1e-3, 1e-6]
    assert found.demands[EXPLICIT].measure.shape == (2, 2)


@pytest.mark.parametrize("stacked", [False, True])
def test_the_maps_lie_side_by_side_or_one_below_the_other(van_der_pol, stacked):
    first, second = charts.failure_map(van_der_pol, stacked=stacked).figure.axes
    across = [axes.get_subplotspec().colspan.start for axes in (first, second)]
    assert across == ([0, 0] if stacked else [0, 1])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"positions": (1.0,)}, "two finite numbers"),
        ({"epsilons": (0.1,)}, "two numbers or more"),
        ({"tolerances": (0.1,)}, "tolerances are two numbers"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(DeclarationError, match=message):
        failure_map(models.load("van_der_pol"), **arguments)


def test_claims_that_are_not_there_are_told(van_der_pol):
    with pytest.raises(GspError, match=r"The names are .*reduced flow 3"):
        van_der_pol.places["reduced flow 7"]
    with pytest.raises(GspError, match="The names are"):
        van_der_pol.demands["reduced flow 7"]


def test_a_span_that_ends_at_a_fold_is_said_to(van_der_pol):
    assert van_der_pol.unmeasured == ""
    long = replace(models.load("van_der_pol"), span=(0.0, 0.9))
    found = failure_map(
        long, epsilons=(1e-3, 1e-2), positions=(0.2, 0.6, 1.0), tolerances=(1e-3, 1e-6), orders=(0, 1)
    )
    assert "fold of the critical manifold was reached" in found.unmeasured
    assert found.unmeasured in str(found)
    assert "  0.0 %  largest relative error" not in str(found)
    panel = charts.failure_map(found).figure.axes[1]
    assert "no reduced flow reaches the end" in " ".join(text.get_text() for text in panel.texts)


@pytest.mark.exhaustive
def test_the_legend_lists_what_is_drawn_and_nothing_else(van_der_pol):
    def labels(result):
        return {text.get_text() for text in charts.failure_map(result).figure.legends[0].get_texts()}

    assert {"full system only", "no slow manifold here", "reduced flow of order 1"} <= labels(van_der_pol)
    assert "Newton's method goes astray" not in labels(van_der_pol)
    easy = failure_map(models.load("linear"), epsilons=(1e-4, 1e-3), tolerances=(1e-1, 1e-2), orders=(0, 1, 2))
    assert labels(easy) <= {"reduced flow of order 0", "stability holds explicit steps back"}


@pytest.mark.exhaustive
def test_a_series_at_rounding_is_not_past_its_optimal_order():
    # h = k x/(1 - epsilon): the series converges, and at these epsilons is at rounding from order 2 or 3 on.
    found = failure_map(
        scene(-x, sp.Rational(7, 3) * x - y, {"x": 1, "y": 2}, {"x": (0.5, 2)}),
        epsilons=np.geomspace(1e-7, 1e-3, 5),
        tolerances=(1e-3, 1e-6),
    )
    assert (found.best_order >= max(found.orders)).all()


def test_a_failure_map_by_method(van_der_pol) -> None:
    found = van_der_pol
    data = found.to_xarray()
    for name, claim in found.places.items():
        np.testing.assert_array_equal(data.place_measure.sel(place_method=name).values, claim.measure)
        np.testing.assert_array_equal(data.place_holds.sel(place_method=name).values, claim.holds)
    frame = found.to_pandas()
    assert frame.to_dict("records")[0] == pytest.approx(found.as_rows()[0], nan_ok=True)


def test_a_failure_map_is_plotted_as_two_maps_or_on_given_axes_as_one():
    found = failure_map(models.load("linear"), epsilons=(0.05, 0.02), orders=(0, 1))
    both = found.plot()
    assert len(both.figure.axes) == 2
    given = Figure().subplots()
    assert found.plot(given) is given
    assert given.get_xlabel() == both.get_xlabel()


def test_nothing_is_compared_with_a_slow_manifold_that_is_not_known() -> None:
    """By the pole at s = -1 the zero-derivative principle gives points that are off by 0.8; h_0 seemed exact there."""
    scene = models.load("michaelis_menten")
    found = failure_map(scene, positions=[-0.8275, 0.5], epsilons=[0.08, 0.04])
    assert np.isnan(found.places["series 0"].measure[0, 0])
    assert not found.places["series 0"].holds[0, 0]
    assert np.isfinite(found.places["series 0"].measure[0, 1])


@pytest.mark.parametrize("powers", [{"s": 6, "c": -6}, {"s": -6, "c": 6}])
def test_claims_are_the_same_in_other_units(powers: dict[str, int]) -> None:
    """Distances were relative to 1 + |y|: in units in which c is 1e-6 every series held."""
    scene = models.load("michaelis_menten")
    other = rescaled(scene, powers)
    positions, epsilons = np.array([-0.5, 0.1, 0.5, 0.9]), [0.003, 0.08, 0.6]
    plain = failure_map(scene, positions=positions, epsilons=epsilons)
    found = failure_map(other, positions=positions * 10.0 ** powers["s"], epsilons=epsilons)
    for name in ("series 0", "series 2", "reduced flow 1", "Newton's method", "slow manifold"):
        a, b = plain.places[name], found.places[name]
        assert (a.holds == b.holds).all(), name
        np.testing.assert_allclose(b.measure, a.measure, rtol=1e-3, atol=1e-11)
