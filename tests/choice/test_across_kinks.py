"""What `choose` says of saturations and kinks: starts on one, layers that carry a start over one, and the last word of
what is measured."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.choice.candidates import ModelKind, run_model
from gsp.choice.choice import choose
from gsp.choice.forecast import forecast_of
from gsp.choice.prediction import Failure, Prediction
from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem

v, i, eps = sp.symbols("v i epsilon")


def scene(slow, fast, v0: float, i0: float, **asked) -> Scene:
    words = {"span": (0, 4), "epsilon": 0.01, "epsilons": (0.02, 0.01), "tolerance": 1e-3} | asked
    system = SlowFastSystem(slow={v: slow}, fast={i: fast}, epsilon=eps)
    return Scene(system, region={"v": (-10, 150), "i": (-200, 200)}, start={"v": v0, "i": i0}, **words)


def converter(v0: float, duty) -> Scene:
    """A buck converter with a fast current; its duty cycle is clipped to [0, 1]."""
    return scene(i - 3 * v, 100 * sp.Max(0, sp.Min(1, duty)) - v - i, v0, 0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("kink", [sp.Max(v, 1), sp.Min(1, v), sp.Abs(v - 1), 100 * sp.Max(0, sp.Min(1, 2 - v))])
def test_a_layer_from_a_kink_is_not_over_at_once(kink: sp.Expr) -> None:
    # i = h + (i0 - h) exp(-tau) moves v by -epsilon (i0 - h) exp(-tau) behind the base point.
    asked = scene(i - v, kink - i, 1, 20)
    found = forecast_of(asked, (0, 1))
    moved = 0.01 * abs(20 - float(kink.subs(v, 1))) / found.prediction.scale["v"]
    assert found.layer == pytest.approx(0.01 * np.log(moved / 1e-4), rel=0.1)


def test_of_a_converter_that_starts_where_it_saturates_no_yes_stands_beside_a_larger_error() -> None:
    found = choose(converter(50, (60 - v) / 10), orders=(0, 1), solve=False)
    assert found.layer > 0.0
    assert not any(c.valid for c in found.candidates if c.kind is ModelKind.REDUCED)
    near = choose(converter(49, (60 - v) / 10), orders=(0, 1, 2), solve=False)
    assert near.model.kind is ModelKind.FULL or near.measured <= 1e-3
    assert near.candidates[2].valid


@pytest.mark.parametrize(("v0", "i0"), [(0.0, 30.0), (0.4, -30.0)])
def test_a_layer_that_carries_its_start_over_a_kink_ends_every_order_but_the_lowest(
    v0: float, i0: float
) -> None:
    # The layer moves v by epsilon i0, over v = 1/5; the series at the start is that of the other side.
    asked = scene(i, 10 * sp.Abs(v - sp.Rational(1, 5)) - i - v, v0, i0, span=(0, 0.4), tolerance=0.5)
    found = choose(asked, solve=False)
    assert [c.failure for c in found.candidates[1:4]] == [Failure.KINK] * 3
    # Where the start is further off, the layer crosses none.
    beside = choose(scene(i, 10 * sp.Abs(v + 5) - i - v, v0, i0, span=(0, 0.4), tolerance=0.5), solve=False)
    assert all(c.failure is not Failure.KINK for c in beside.candidates)


def test_a_run_that_leaves_a_kink_and_comes_back_is_followed_to_where_it_crosses() -> None:
    # v'' = -v from v = 0 comes back at t = pi; that the start is on the kink says nothing of a side.
    w = sp.Symbol("w")
    system = SlowFastSystem(slow={v: w, w: -v}, fast={i: sp.Abs(v) - i}, epsilon=eps)
    asked = Scene(
        system, region={"v": (-2, 2), "w": (-2, 2), "i": (-5, 5)}, start={"v": 0, "w": 1, "i": 0}, span=(0, 4),
        epsilon=0.01, epsilons=(0.02, 0.01), tolerance=1e-3,
    )  # fmt: skip
    found = forecast_of(asked, (0, 1)).prediction
    assert found.crossing(1) == pytest.approx(np.pi, abs=1e-3)


@pytest.mark.parametrize(
    ("fast", "jumps"),
    [
        (v * sp.sign(v - sp.Rational(1, 2)) / 3 + v - i, True),
        (sp.Abs(v - sp.Rational(1, 2)) + v - i, False),
        (sp.Abs(v - sp.Rational(3, 4)) + sp.sign(v - sp.Rational(1, 2)) / 5 + v - i, True),
    ],
    ids=["a jump", "a kink", "a jump behind a kink"],
)
def test_order_0_ends_where_the_critical_manifold_jumps_and_not_at_a_kink(fast: sp.Expr, jumps: bool) -> None:
    """Past a jump the full run is off the manifold for a time epsilon, which the difference of two orders hides."""
    found = forecast_of(scene(-i / 2 - v / 2, fast, 1, 1), (0, 1)).prediction
    if not jumps:
        assert found.crossing(0) == np.inf
        return
    run = found.runs[0]
    assert run.at(found.crossing(0))[0] == pytest.approx(0.5, abs=1e-3)
    assert found.crossing(1) <= found.crossing(0) + 1e-9


@pytest.mark.parametrize(("switch", "ends"), [(i, True), (i + v, True), (v, False)])
def test_order_0_ends_where_a_slow_rate_jumps_by_what_fast_variables_say(switch: sp.Expr, ends: bool) -> None:
    """The full run jumps a time O(epsilon) from the reduced one: x' = -3/2 and -1/2 leave 0.01 of it. Of i as a switch
    order 0 was told to be exact to 0.0, as no term of the series tells when."""
    level = sp.Rational(1, 2) if switch in (i, v) else 1
    found = forecast_of(scene(-1 - sp.sign(switch - level) / 2, v - i, 1, 1, span=(0, 0.9)), (0, 1)).prediction
    assert found.crossing(0) == (pytest.approx(1 / 3, abs=1e-3) if ends else np.inf)
    assert found.crossing(1) == pytest.approx(1 / 3, abs=1e-2)


def test_what_fast_variables_are_off_by_is_told_where_their_own_layer_is_over() -> None:
    # The layer of v ends after 5.7 fast times, where 2.6e-3 of that of i is left.
    system = SlowFastSystem(slow={v: -v / 2 - i / 2 - 1}, fast={i: -v - i - 1}, epsilon=eps)
    asked = Scene(
        system, region={"v": (-60, 60), "i": (-60, 60)}, start={"v": -1, "i": 2}, span=(0, 5), epsilon=0.01,
        epsilons=(0.02, 0.01), tolerance=1e-4,
    )  # fmt: skip
    found = choose(asked)
    forecast = forecast_of(asked, (0, 1, 2, 3))
    times = np.linspace(found.layer, 5, 401)
    full = run_model(system, asked.start, asked, (0, 5), 1e-11, at=times)
    own = run_model(forecast.flows[1], forecast.starts[1], asked, (0, 5), 1e-11, at=times)
    off = float(np.abs(full["i"] - own["i"]).max()) / forecast.fast.scale["i"]
    told, _ = forecast.fast_errors(1, times)
    assert off <= 1.05 * told
    assert found.fast_error < 0.1 * told


def test_a_yes_never_stands_beside_a_measured_error_beyond_the_tolerance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = scene(i - v, 20 + v / 2 - i, 0, 0, tolerance=1e-6)
    monkeypatch.setattr(Prediction, "errors", lambda self, order, times: np.full(len(times), 1e-9))
    monkeypatch.setattr(Prediction, "tells", lambda self, order, times: True)
    found = choose(asked, orders=(0, 1), solve=False)
    assert not any(c.valid for c in found.candidates[:2])
    assert "more than was predicted" in found.candidates[0].why_not
    assert found.verdict.answer == "no"


def test_a_dose_that_begins_at_a_time_that_is_looked_at_is_no_jump() -> None:
    """The run is looked at from t = 1.5 on, at the beginning of the dose to rounding, and again as it is narrowed down.

    The order after the next is off by more than the next moves the run: of order 0 the error is measured then.
    """
    clock, dose = sp.symbols("clock dose")
    system = SlowFastSystem(
        slow={clock: 1, v: dose}, fast={dose: sp.Max(0, 1 - 4 * (clock - 2) ** 2) - dose}, epsilon=eps
    )
    asked = Scene(
        system, {"clock": (0, 7), "v": (0, 9)}, {"clock": 0, "v": 1, "dose": 0}, (0, 6), 0.4, tolerance=0.45
    )
    best = choose(asked, orders=(0,), solve=False).candidates[0]
    assert best.valid
    assert best.is_measured
    # With SciPy's Radau at 1e-9.
    assert best.predicted == pytest.approx(0.17101, rel=0.01)
