"""Slow ramps: canards as series, against rates that were found, a formula, and runs of an excitable system."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar

import gsp
from gsp.singular.ramps.critical_rate import TippingVerdict
from gsp.singular.ramps.ramped import RampError
from gsp.singular.singularities.folded_singularities import FoldedKind
from gsp.systems.ramp import PHASE, Ramp

x, l, T, C, air, eps = sp.symbols("x l T C T_a epsilon")  # noqa: E741
FOLD = gsp.VectorField({x: x**2 + l - 1}, epsilon=None, parameters={l: 0})


def over(peak: float) -> gsp.CriticalRate:
    return gsp.critical_rate(FOLD, ramp=Ramp.there_and_back({l: (0, peak)}), start={"x": -1}, edge={"x": 1})


def test_a_ramp_over_a_fold_and_back_tips_slowly_by_a_series_in_the_rate() -> None:
    """b = 1 + r/sqrt(2) + ...: where x' = x^2 + d - s^2/2, s' = r has the canard x = s/sqrt(2), d = r/sqrt(2)."""
    found = over(1.02)
    assert found.verdict is TippingVerdict.BELOW
    series = gsp.slow_ramp(found, order=4)
    assert series.is_amplitude
    assert 1.02 * series.coefficients[:2] == pytest.approx([1, 0.5**0.5], rel=1e-9)
    assert series.errors[:3].max() < 1e-6
    assert abs(series.difference) < 1e-8


@pytest.mark.exhaustive
@pytest.mark.parametrize("order", [1, 2, 3])
def test_the_series_is_off_by_its_next_term(order: int) -> None:
    """Amplitudes at rates that collocation found apart from it; the slope of what is missing."""
    series = gsp.slow_ramp(over(1.02), order=order)
    found = [over(peak) for peak in (1.03, 1.05)]
    rates = np.array([f.rates[0] for f in found])
    missing = [abs(1.02 * series.value(r) - peak) for r, peak in zip(rates, (1.03, 1.05))]
    slope = np.diff(np.log(missing))[0] / np.diff(np.log(rates))[0]
    assert slope == pytest.approx(order + 1, abs=0.1)


# The compost bomb with its authors' numbers: C. M. Luke, P. M. Cox, Eur. J. Soil Sci. 62 (2011) 5-12, S. Wieczorek,
# P. Ashwin, C. M. Luke, P. M. Cox, Proc. R. Soc. A 467 (2011) 1243-1269; years, degrees, and kg of carbon per m^2.
LITTER, COOLING = sp.Rational(1055, 1000), sp.Rational(5049, 39000)
RESPIRED = C / 100 * sp.exp(T * sp.log(sp.Rational(5, 2)) / 10)
COMPOST = gsp.SlowFastSystem(
    slow={C: LITTER - RESPIRED}, fast={T: RESPIRED - COOLING * (T - air)}, epsilon=eps, parameters={air: 0}
)
EPSILON = 2.5 / 39


def warming(epsilon: float, level: float = 60) -> gsp.CriticalRate:
    return gsp.critical_rate(
        COMPOST, ramp=Ramp.linear_with_ends({air: (0, 20)}), start={"T": 8, "C": 50}, edge={"T": level},
        epsilon=epsilon,
    )  # fmt: skip


def test_the_compost_bomb_starts_where_it_is_said_to() -> None:
    found = warming(EPSILON)
    assert (round(found.start["T"], 2), round(found.start["C"], 1)) == (8.15, 50.0)
    assert found.verdict is TippingVerdict.ABOVE
    assert found.edge is None


@pytest.mark.exhaustive
def test_the_rate_of_the_compost_bomb_does_not_depend_on_the_level() -> None:
    """Bisection of runs by SciPy's Radau, at levels of 30 and 60, ends between 0.08848328 and 0.08848335."""
    rates = [warming(EPSILON, level).rates[0] for level in (40, 90)]
    assert rates[0] == pytest.approx(rates[1], rel=1e-10)
    assert 0.08848328 < rates[0] < 0.08848335


@pytest.mark.exhaustive
def test_the_compost_bomb_goes_through_a_folded_saddle() -> None:
    """The number is off the series by epsilon^2, as its start is off the slow manifold."""
    found = [warming(epsilon) for epsilon in (0.01, 0.005)]
    series = [gsp.slow_ramp(each, order=3) for each in found]
    assert series[0].singularity is not None
    assert series[0].singularity.kind is FoldedKind.SADDLE
    assert series[0].coefficients[:3] == pytest.approx(series[1].coefficients[:3], rel=1e-5)
    assert series[0].difference / series[1].difference == pytest.approx(4, rel=0.05)
    assert not series[0].is_amplitude


def test_a_level_tells_nothing_where_the_rest_point_is_lost() -> None:
    y = sp.Symbol("y")
    field = gsp.VectorField({x: -(x**2) - l, y: x - y}, epsilon=None, parameters={l: -1})
    with pytest.raises(RampError, match="does not attract as far"):
        gsp.critical_rate(field, ramp=Ramp.tanh({l: (-1, 1)}), start={"x": 1, "y": 1}, edge={"x": -9})


@pytest.mark.exhaustive
def test_the_compost_bomb_from_rest_tips_where_folded_points_are_born() -> None:
    """SciPy finds the least rate with a folded point; the numbers depart from it with sqrt(epsilon)."""
    ramp = Ramp.tanh({air: (0, 20)})
    found = [
        gsp.critical_rate(COMPOST, ramp=ramp, start={"T": 8, "C": 50}, edge={"T": 60}, epsilon=epsilon)
        for epsilon in (0.02, 0.005)
    ]
    series = [gsp.slow_ramp(each) for each in found]
    a, k = np.log(2.5) / 10, float(COOLING)

    def rate(warmed: float) -> float:
        # On the fold R = k/a, and g_C C' = k T_a' where T = T_a + 1/a.
        pace = (k / a - float(LITTER)) * np.exp(a * warmed + 1) / (100 * k)
        return pace / (10 * (1 - (warmed / 10 - 1) ** 2))

    born = minimize_scalar(rate, bounds=(2, 12), method="bounded", options={"xatol": 1e-10})
    for each in series:
        assert each.singularity is not None
        assert each.singularity.kind is FoldedKind.SADDLE_NODE_I
        assert each.coefficients == pytest.approx([born["fun"]], rel=1e-12)
    assert "departs with sqrt(epsilon)" in str(series[0])
    assert series[0].difference / series[1].difference == pytest.approx(2, rel=0.1)


# The excitable normal form of Wieczorek, Ashwin, Luke and Cox 2011.
y = sp.Symbol("y")
EXCITABLE = gsp.SlowFastSystem(slow={y: -x}, fast={x: y + l + x * (x - 1)}, epsilon=eps, parameters={l: 0})


def excited(epsilon: float) -> gsp.CriticalRate:
    ramp = Ramp.tanh({l: (0, sp.Rational(1, 2))})
    return gsp.critical_rate(EXCITABLE, ramp=ramp, start={"x": 0, "y": 0}, edge={"x": 5}, epsilon=epsilon)


def test_a_canard_from_rest_through_a_folded_saddle_is_a_series() -> None:
    """Off the numbers of runs by epsilon^4 through order 3, and the limit by shooting in SciPy."""
    found = [excited(epsilon) for epsilon in (0.005, 0.0025)]
    series = [gsp.slow_ramp(each, order=3) for each in found]
    assert series[0].singularity is not None
    assert series[0].singularity.kind is FoldedKind.SADDLE
    assert series[0].difference / series[1].difference == pytest.approx(16, rel=0.1)

    def jumps(rate: float) -> bool:
        # On y = x - x^2 - l, (1 - 2 x) x' = l' - x: whether x comes to the fold.
        def slope(t: float, u: np.ndarray) -> np.ndarray:
            return (rate / 4 / np.cosh(rate * t) ** 2 - u) / (1 - 2 * u)

        def fold(t: float, u: np.ndarray) -> float:
            return 0.5 - 1e-5 - u[0]

        fold.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
        run = solve_ivp(slope, (-12 / rate, 12 / rate), [0.0], rtol=1e-9, atol=1e-12, events=fold)
        return len(run.t_events[0]) > 0

    low, high = 2.8, 3.0
    for _ in range(18):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if jumps(middle) else (middle, high)
    assert series[0].coefficients[0] == pytest.approx(low, rel=1e-5)


@pytest.mark.exhaustive
def test_a_canard_from_rest_is_singled_out_of_two_variables_alone() -> None:
    z = sp.Symbol("z")
    more = gsp.SlowFastSystem({y: -x, z: x - z}, EXCITABLE.fast, epsilon=eps, parameters={l: 0})
    found = gsp.critical_rate(
        more, ramp=Ramp.tanh({l: (0, sp.Rational(1, 2))}), start={"x": 0, "y": 0, "z": 0}, edge={"x": 5},
        epsilon=0.01,
    )  # fmt: skip
    with pytest.raises(RampError, match="singled out of one fast and one slow"):
        gsp.slow_ramp(found)


def test_there_is_nothing_to_start_from_where_no_ramp_tips() -> None:
    with pytest.raises(RampError, match="no threshold to start from"):
        gsp.slow_ramp(over(0.5))


def test_canards_far_from_the_origin_have_the_same_series() -> None:
    """The folded singularity, x = 1/2, is told where it is."""
    far = -(10**6)
    moved = {x: x - far, y: y - far}
    system = gsp.SlowFastSystem(
        slow={y: -x + far}, fast={x: EXCITABLE.fast[x].xreplace(moved)}, epsilon=eps, parameters={l: 0}
    )
    ramp = Ramp.tanh({l: (0, sp.Rational(1, 2))})
    found = gsp.critical_rate(system, ramp=ramp, start={"x": far, "y": far}, edge={"x": far + 5}, epsilon=0.01)
    series = gsp.slow_ramp(found, order=2)
    # Those about the origin.
    assert series.coefficients == pytest.approx([2.88409303, 13.8650416, 90.08976], rel=1e-6)
    assert series.singularity is not None
    assert series.singularity["x"] == pytest.approx(far + 0.5, abs=1e-9)
    point = {s: sp.nsimplify(series.singularity[s.name]) for s in (x, y, PHASE)}
    assert abs(series.singularity.system.fast[x].xreplace(point)) < 1e-9


def test_a_ramp_that_loses_nothing_on_the_way_has_no_canard() -> None:
    """Every amplitude has a smooth orbit on the branch of the start, and so has none: 0 was told, and 3.65."""
    far = 10**6
    field = gsp.VectorField({x: (x - far + l) ** 2 - 1}, epsilon=None, parameters={l: 0})
    two = gsp.VectorField({x: (x + l) ** 2 - 1 + y / 5, y: -y + (x + l) / 4}, epsilon=None, parameters={l: 0})
    found = [
        gsp.critical_rate(
            field, ramp=Ramp.linear_with_ends({l: (0, 3)}), start={"x": far - 1}, edge={"x": far - 2}
        ),
        gsp.critical_rate(
            two.with_parameters(l=0), ramp=Ramp.tanh({l: (0, 3)}), start={"x": -1, "y": -0.3},
            edge={"x": -2, "y": 0.25},
        ),
    ]  # fmt: skip
    for each in found:
        with pytest.raises(RampError, match="no smooth orbit was reached"):
            gsp.slow_ramp(each)
