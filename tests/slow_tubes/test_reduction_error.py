"""Proved bounds on |full - reduced| against the error itself, found by integration to fourteen digits."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from flint import arb
from scipy.integrate import solve_ivp
from sympy import Rational as R

from gsp.algebra.precision import precision
from gsp.errors import DeclarationError, UnsupportedFunctionError
from gsp.proofs import balls
from gsp.proofs.verdict import ProofVerdict
from gsp.slow_tubes import deviation
from gsp.slow_tubes.reduction_error import ReductionBound, _Run, bound_reduction
from gsp.slow_tubes.validated_flow import solution_steps
from tests.slow_tubes.test_slow_tube import a, epsilon, michaelis_menten, s, saddle, series, sleigh, v, w, x, y


def error_of(manifold, start, end, value):
    """max and last |full - reduced| in the slow variables, on a grid of times."""
    system = manifold.branch.system
    n, small = len(system.x), R(value)
    rates = [e.subs(epsilon, small) for e in (*system.f, *(g / small for g in system.g))]
    full = sp.lambdify([*system.x, *system.y], rates)
    terms = range(manifold.order + 1)
    reduced = sp.lambdify(
        [*system.x], [sum(manifold.reduced_field[k][i] * small**k for k in terms) for i in range(n)]
    )
    at = [start[v.name] for v in system.x]
    if system.y[0].name in start:
        fast = [start[v.name] for v in system.y]
    else:
        fast = manifold.evaluate(np.array([at]), value)[0]
    # The layer is between the first ones.
    times = np.union1d(np.linspace(0.0, end, 1001), np.geomspace(0.01 * value, end, 300))
    tight = {"rtol": 1e-13, "atol": 1e-16, "t_eval": times}
    one = solve_ivp(lambda t, z: full(*z), (0.0, end), [*at, *fast], method="DOP853", **tight).y[:n]
    two = solve_ivp(lambda t, z: reduced(*z), (0.0, end), at, method="DOP853", **tight).y
    away = np.linalg.norm(one - two, axis=0)
    return away.max(), away[-1]


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("order", "value", "first", "end"),
    [
        (0, 0.125, 1.0, 2.0),
        (0, 0.125, 5.0, 10.0),
        (1, 0.01, 5.0, 10.0),
        (2, 0.1, 5.0, 10.0),
        (2, 0.1, 1.0, 2.0),
    ],
)
def test_michaelis_menten_within_a_hundredth_of_the_error(
    order: int, value: float, first: float, end: float
) -> None:
    manifold = michaelis_menten(order)
    bound = bound_reduction(manifold, start={"s": first}, span=(0.0, end), epsilon=value)
    largest, last = error_of(manifold, {"s": first}, end, value)
    assert bound.verdict is ProofVerdict.PROVED
    assert largest <= bound.bound <= 1.01 * largest
    assert last <= bound.slow[-1] <= 1.01 * last
    # Work: the steps that were asked for, a few in the layer, and the ends of the steps of the flow.
    assert len(bound.times) < 300


def test_what_is_printed_is_the_bound_over_all_times_and_that_at_the_end() -> None:
    times, slow = np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.25, 0.125])
    found = ReductionBound(ProofVerdict.PROVED, "", 0.1, times, slow, slow, 0.375)
    assert "[0, 2]" in str(found)
    assert "<= 0.375 in the slow variables, <= 0.125 at the end" in str(found)


@pytest.mark.exhaustive
@pytest.mark.parametrize("order", [0, 1, 2])
def test_the_initial_layer_is_in_the_bound(order: int) -> None:
    manifold, start = michaelis_menten(order), {"s": 1.0, "c": 0.25}
    bound = bound_reduction(manifold, start=start, span=(0.0, 2.0), epsilon=0.1)
    largest, _ = error_of(manifold, start, 2.0, 0.1)
    assert bound.verdict is ProofVerdict.PROVED
    assert largest <= bound.bound <= 1.02 * largest
    # In the layer y is as far from the series as it starts, and later as near as the tube.
    assert bound.fast[0] == pytest.approx(abs(0.25 - manifold.evaluate(np.array([[1.0]]), 0.1)[0, 0]), rel=1e-9)
    assert bound.fast[-1] < 0.2 * bound.fast[0]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("order", "share"), [(0, 1.05), (1, 1.01)])
def test_two_slow_variables(order: int, share: float) -> None:
    manifold = sleigh(order)
    start = {"v": 1.0, "p": 1.0}
    bound = bound_reduction(manifold, start=start, span=(0.0, 10.0), epsilon=0.05)
    largest, _ = error_of(manifold, start, 10.0, 0.05)
    assert bound.verdict is ProofVerdict.PROVED
    assert largest <= bound.bound <= share * largest


@pytest.mark.exhaustive
def test_rates_with_functions_of_the_slow_variable() -> None:
    manifold = series({x: -sp.sin(x) + y / 4}, {y: -y + sp.tanh(x)}, 1)
    bound = bound_reduction(manifold, start={"x": 1.0}, span=(0.0, 5.0), epsilon=0.05)
    largest, _ = error_of(manifold, {"x": 1.0}, 5.0, 0.05)
    assert bound.verdict is ProofVerdict.PROVED
    assert largest <= bound.bound <= 1.1 * largest


PAIR = {x: -x - 8 * y + s, y: x - y}
# Rates, order, start, epsilon, and how many times the error the bound is at most.
TURNING = {
    "a pair": ({s: -s + x * y / 4}, PAIR, 1, {"s": 1.0}, 0.01, 1.01),
    "a pair, order 0": ({s: -s + x * y / 4}, PAIR, 0, {"s": 1.0}, 0.01, 1.02),
    "a pair, order 2": ({s: -s + x * y / 4}, PAIR, 2, {"s": 1.0}, 0.1, 1.02),
    "its layer": ({s: -s + x / 4}, PAIR, 0, {"s": 1.0, "x": 0.5, "y": 0.4}, 0.01, 1.02),
    "a layer with a product": ({s: -s + x * y / 4}, PAIR, 1, {"s": 1.0, "x": 0.5, "y": 0.4}, 0.01, 1.15),
    "a rate and a normal form that change": (
        {s: -s / 2 + x / 4},
        {x: -(1 + s) * x - (3 + 2 * s) * y + s, y: (1 + s**2) * x - y},
        1,
        {"s": 2.0},
        0.02,
        1.05,
    ),
    "twenty times as fast as it shrinks": (
        {s: -s / 2 + x / 4},
        {x: -x - 20 * y + s, y: 20 * x - y},
        1,
        {"s": 2.0},
        0.05,
        1.04,
    ),
    "two slow ones that turn as well": (
        {s: -v, v: s - v / 5 + x},
        {x: -x - 3 * y + s, y: 2 * x - y + v},
        1,
        {"s": 1.0, "v": 0.5},
        0.02,
        1.03,
    ),
    "a pair and a third": (
        {s: -s / 2 + x / 4 + w * y / 3},
        {x: -x - 4 * y + s, y: x - y + w / 5, w: -3 * w + x + s**2},
        0,
        {"s": 2.0},
        0.02,
        1.03,
    ),
    "two that do not turn": (
        {s: -2 * s + x / 4},
        {x: -x + 6 * y + s, y: -7 * y + s**2},
        1,
        {"s": 2.0},
        0.02,
        1.03,
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", TURNING)
def test_several_fast_variables_within_a_few_hundredths_of_the_error(name: str) -> None:
    slow, fast, order, start, value, share = TURNING[name]
    manifold = series(slow, fast, order)
    bound = bound_reduction(manifold, start=start, span=(0.0, 5.0), epsilon=value)
    largest, last = error_of(manifold, start, 5.0, value)
    assert bound.verdict is ProofVerdict.PROVED
    assert largest <= bound.bound <= share * largest
    # The end is small beside the largest where all of it decays.
    assert last <= bound.slow[-1] <= share * last + 0.02 * largest
    assert len(bound.times) < 700


@pytest.mark.exhaustive
def test_a_frame_follows_a_pair_whose_plane_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    # Where the first of the two couplings is less than the other, the norm in the basis of the start grows.
    fast = {x: -x - (1 + 4 * s**2) * y + s, y: (1 + 4 * (1 - s) ** 2) * x - y}
    manifold = series({s: -R(1, 10) - x / 50}, fast, 0)
    asked = {"start": {"s": 1.0}, "span": (0.0, 5.0), "epsilon": 0.01}
    bound = bound_reduction(manifold, **asked)
    largest, _ = error_of(manifold, {"s": 1.0}, 5.0, 0.01)
    assert bound.verdict is ProofVerdict.PROVED
    assert largest <= bound.bound <= 1.2 * largest
    monkeypatch.setattr(deviation, "framed", lambda frame, B: (frame, frame.decay(B)))
    assert bound_reduction(manifold, **asked).verdict is ProofVerdict.UNDECIDED


def test_the_reduced_solution_may_start_elsewhere() -> None:
    manifold = series({x: -x}, {y: -y + x}, 3)
    bound = bound_reduction(manifold, start={"x": 1.0}, reduced_start={"x": 1.5}, span=(0.0, 1.0), epsilon=0.1)
    assert bound.slow[0] == pytest.approx(0.5, rel=1e-12)
    assert 0.5 * np.exp(-1.0) <= bound.slow[-1] <= 0.5 * np.exp(-1.0) * 1.01


@pytest.mark.exhaustive
def test_finer_steps_bound_tighter() -> None:
    bounds = [
        bound_reduction(
            michaelis_menten(1), start={"s": 5.0}, span=(0.0, 10.0), epsilon=0.01, steps=steps
        ).bound
        for steps in (100, 200, 400)
    ]
    assert bounds == sorted(bounds, reverse=True)


def test_a_wrong_series_is_refuted() -> None:
    right = michaelis_menten(2)
    ring = right.chart.ring
    wrong = [[e + ring.constant(R(1, 10**6)) if i == 2 else e for i, e in enumerate(row)] for row in right._h]
    bound = bound_reduction(replace(right, _h=wrong), start={"s": 1.0}, span=(0.0, 1.0), epsilon=0.1)
    assert bound.verdict is ProofVerdict.REFUTED
    assert np.isnan(bound.bound)


def test_a_wrong_reduced_field_is_refuted() -> None:
    right = michaelis_menten(1)
    ring = right.chart.ring
    wrong = [[e + ring.constant(R(1, 10**6)) if i == 1 else e for i, e in enumerate(row)] for row in right._f]
    bound = bound_reduction(replace(right, _f=wrong), start={"s": 1.0}, span=(0.0, 1.0), epsilon=0.1)
    assert bound.verdict is ProofVerdict.REFUTED


def test_where_attraction_ends_the_proof_ends() -> None:
    # epsilon y' = (x - 1/2) y + x from x = 0 with x' = 1: the branch repels from x = 1/2 on.
    manifold = series({x: sp.Integer(1)}, {y: (x - R(1, 2)) * y + x}, 1)
    bound = bound_reduction(manifold, start={"x": 0.0}, span=(0.0, 1.0), epsilon=0.01)
    assert bound.verdict is ProofVerdict.UNDECIDED
    assert bound.times[-1] < 0.5


@pytest.mark.exhaustive
def test_an_explosion_ends_the_proof_in_time() -> None:
    # x' = x^2 from 1 is infinite at t = 1.
    manifold = series({x: x**2}, {y: -y + x}, 0)
    bound = bound_reduction(manifold, start={"x": 1.0}, span=(0.0, 2.0), epsilon=0.01)
    assert bound.verdict is ProofVerdict.UNDECIDED
    assert 0.5 < bound.times[-1] < 1.0


@pytest.mark.parametrize(("field", "exact"), [(-a, lambda t: np.exp(-t)), (-(a**2), lambda t: 1.0 / (1.0 + t))])
def test_an_enclosed_solution_holds_the_exact_one(field: sp.Expr, exact) -> None:
    met = 0
    for step in solution_steps([field], [a], [arb(1)], 3.0):
        for share in (0.0, 0.3, 0.9):
            time = step.start + share * (step.end - step.start)
            (ball,) = step.over(time, time)
            assert abs(float(ball.mid()) - exact(time)) <= float(ball.rad()) + 4e-16
            assert ball.rad() < 1e-14
            met += 1
    assert met > 20


def test_bad_input_is_refused() -> None:
    good = {"start": {"s": 1.0}, "span": (0.0, 1.0), "epsilon": 0.1}
    with pytest.raises(DeclarationError, match="no value for s"):
        bound_reduction(michaelis_menten(1), **{**good, "start": {"c": 1.0}})
    with pytest.raises(DeclarationError, match="span"):
        bound_reduction(michaelis_menten(1), **{**good, "span": (1.0, 0.0)})
    with pytest.raises(DeclarationError, match="steps"):
        bound_reduction(michaelis_menten(1), **good, steps=0)
    with pytest.raises(DeclarationError, match="does not attract"):
        bound_reduction(saddle(1), **good)
    with pytest.raises(DeclarationError, match="explicit"):
        bound_reduction(series({x: y}, {y: x - y**5 / 5 - y}, 1), start={"x": 1.0}, span=(0, 1), epsilon=0.1)
    with pytest.raises(UnsupportedFunctionError, match="erf"):
        bound_reduction(series({x: sp.erf(x) + y}, {y: -y + x}, 1), start={"x": 1.0}, span=(0, 1), epsilon=0.1)


@pytest.mark.exhaustive
def test_a_span_counts_from_its_beginning_and_a_proof_says_what_carried_it() -> None:
    manifold = michaelis_menten(1)
    asked = {"start": {"s": 1.0}, "epsilon": 0.03125, "steps": 40}
    one = bound_reduction(manifold, span=(0, 0.5), **asked)
    late = bound_reduction(manifold, span=(1, 1.5), **asked)
    assert late.verdict is one.verdict is ProofVerdict.PROVED
    assert (late.times[-1], late.bound) == (one.times[-1], one.bound) == (0.5, one.bound)
    assert "to the end" in one.reason


def test_the_bound_is_that_of_the_decimal_that_is_printed() -> None:
    # The double 0.3 is another number, and does not lie in a ball about 3/10 of four times the precision.
    with precision(4 * balls.PRECISION):
        run = _Run(series({x: -x}, {y: -y + x}, 1), 0.3, [arb(1)])
        assert run.epsilon.contains(arb(3) / 10)
        assert not run.epsilon.contains(arb(0.3))
