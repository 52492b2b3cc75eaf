"""Tubes about the series of a slow manifold: figures to reach, what they promise, and what must never be proved."""

from dataclasses import replace
from pathlib import Path

import flint
import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy import Rational as R

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError, GspError, UnsupportedFunctionError
from gsp.proofs import balls
from gsp.proofs.verdict import ProofVerdict
from gsp.slow.series import expand
from gsp.slow_tubes.certify import certify
from gsp.slow_tubes.isolation import Isolation, Tally, _proved
from gsp.slow_tubes.slow_tube import _TubeSearch
from gsp.slow_tubes.tube_search import TubeSearch
from gsp.systems.system import SlowFastSystem

epsilon, s, c, v, p, w, x, y, a = sp.symbols("epsilon s c v p w x y a")


def series(slow, fast, order, **more):
    system = SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon, **more)
    return expand(solve_critical(system).branches[0], order=order)


def michaelis_menten(order):
    return series({s: -s + (s + R(1, 2)) * c}, {c: s - (s + 1) * c}, order)


def sleigh(order):
    """Chaplygin's with m = I = 1 and a = 1/5, p in units of J = I + m a^2."""
    turn = p - R(5, 26) * w
    slow = {v: turn * (w + turn / 5), p: -R(5, 26) * v * turn}
    return series(slow, {w: -R(26, 25) * w - epsilon * v * turn}, order)


def saddle(order):
    return series({s: -s}, {x: x + s**2, y: -y + x * s}, order)


SQUARE = {"v": (-2, 2), "p": (-2, 2)}
HALF_LINE = {"s": (R(1, 10), 5)}


@pytest.mark.exhaustive
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_the_tube_of_the_sleigh_is_hardly_wider_than_the_first_term_left_out(order: int) -> None:
    # Measured with another program: 1.602e-4, 1.173e-5, 3.897e-7, 1.358e-8.
    tube = certify(sleigh(order), region=SQUARE, epsilon=0.01)
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.ratio <= 1.1
    assert tube.delta == pytest.approx([1.602e-4, 1.173e-5, 3.897e-7, 1.358e-8][order - 1], rel=0.02)


@pytest.mark.exhaustive
def test_epsilon_a_tenth_and_the_largest_one_for_the_sleigh() -> None:
    assert certify(sleigh(3), region=SQUARE, epsilon=0.1).ratio <= 2.0
    largest = certify(sleigh(3), region=SQUARE)
    assert largest.verdict is ProofVerdict.PROVED
    assert largest.epsilon_0 >= 0.15
    assert largest.ratio <= 2.1
    assert largest.tried < 1700


@pytest.mark.exhaustive
@pytest.mark.parametrize(("order", "most"), [(1, 1900), (2, 4200), (3, 7000), (4, 12000)])
def test_michaelis_menten_holds_to_nine_tenths(order: int, most: int) -> None:
    tube = certify(michaelis_menten(order), region=HALF_LINE)
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.epsilon_0 >= 0.9
    # What lies below an epsilon that was proved is not proved again on the way to the next: it took 12000. Nor are
    # faces that were proved for a larger one, and a test ends when its budget cannot suffice. A third of it goes into
    # the width of the collar.
    assert tube.tried < most
    assert tube.ratio <= 1.1
    # Half of the region is left.
    assert 2 * tube.collar <= 0.5 * 4.9 * (1 + 1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_saddle_is_decoupled_and_holds(order: int) -> None:
    tube = certify(saddle(order), region={"s": (-1, 1)}, epsilon=0.1)
    assert tube.verdict is ProofVerdict.PROVED
    assert sorted(tube.signs) == [-1, 1]
    # The unstable part of the tube is that of the first term left out: 4, 8, ... (2 epsilon)^n epsilon.
    assert tube.widths["x"] == pytest.approx((2 * 0.1) ** (order + 1), rel=0.02)
    assert tube.ratio <= 1.6
    # The fast rate 1/epsilon must exceed the slow one and the collar, 2 together.
    assert 0.13 <= certify(saddle(order), region={"s": (-1, 1)}).epsilon_0 < 0.5


@pytest.mark.exhaustive
@pytest.mark.parametrize(("order", "bound"), [(1, 2.3e-4), (2, 3.1e-6), (3, 4.5e-8)])
def test_a_complex_pair_far_from_normal(order: int, bound: float) -> None:
    pair = series({s: -s + x * y / 4}, {x: -x - 8 * y + s, y: x - y}, order)
    tube = certify(pair, region={"s": (-1, 1)}, epsilon=0.01)
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.delta <= 2.0 * bound


@pytest.mark.exhaustive
def test_the_cones_of_the_steps_cover_every_epsilon() -> None:
    manifold = michaelis_menten(2)
    with flint.ctx.workprec(balls.PRECISION):
        search = _TubeSearch(manifold, {"s": (0.1, 5.0)}, 20_000)
        search.result(None)
        tube = search.best
        assert tube is not None
        ends = [0.0, *(cone.high for cone in tube.cones)]
        assert [cone.low for cone in tube.cones] == ends[:-1]
        assert ends[-1] == tube.epsilon
        assert len({cone.slope for cone in tube.cones}) > 1
        # Narrower than the tube in which they were proved; there they hold as well.
        for cone in tube.cones:
            part = tube.problem.over(cone.low, cone.high)
            assert part.cones(tube.widths, cone.slope, cone.collar)
            assert part.faces(tube.widths)


@pytest.mark.exhaustive
def test_faces_are_not_proved_again_for_fewer_epsilon(monkeypatch: pytest.MonkeyPatch) -> None:
    faces, proved = Isolation.faces, []

    def once(self, widths):
        low, high = self.region[-1]
        assert not any(list(widths) == w and a <= low and high <= b for w, a, b in proved)
        found = faces(self, widths)
        if found:
            proved.append((list(widths), low, high))
        return found

    monkeypatch.setattr(Isolation, "faces", once)
    assert certify(michaelis_menten(1), region=HALF_LINE).epsilon_0 > 0.9
    assert (0.5, 1.0) in [(a, b) for _, a, b in proved]


def test_parts_that_the_budget_does_not_reach_are_not_begun() -> None:
    tally, seen = Tally(100), []
    assert not _proved(((0.0, 1.0),), lambda box: bool(seen.append(box)), tally)
    assert tally.spent
    # 1 + 2 + ... + 32 = 63, and the next 64 are too many.
    assert len(seen) == tally.tried == 63
    seen.clear()
    assert not _proved(
        ((0.0, 1.0),), lambda box: bool(seen.append(box)), Tally(100), is_hopeless=lambda box: box[0][0] == 0.5
    )
    assert len(seen) == 3


def test_cones_proved_without_a_collar_are_not_taken_for_cones_with_one() -> None:
    # At x = 1 the flow leaves for epsilon < 1/4 and enters beyond: what was proved without a collar does not do there.
    manifold = series({x: (x - 4 * epsilon) / 8}, {y: -8 * y + x}, 1)
    assert certify(manifold, region={"x": (-1, 1)}, epsilon=0.125).boundary == "overflowing"
    with flint.ctx.workprec(balls.PRECISION):
        search = _TubeSearch(manifold, {"x": (-1.0, 1.0)}, 20_000)
        tube = search.result(None)
        assert tube.epsilon_0 > 0.25
        assert (tube.boundary, tube.collar > 0.0) == ("mixed", True)
        assert search.best is not None
        assert all(cone.collar > 0.0 for cone in search.best.cones)
        assert search.best.cones[0].low == 0.0


def test_a_side_that_is_decided_by_luck_takes_no_collar_for_granted(monkeypatch: pytest.MonkeyPatch) -> None:
    # Whether the flow leaves through a side is proved within a budget of boxes: it may be proved later only.
    boundary, said = TubeSearch.boundary, iter(["mixed", *["overflowing"] * 40])

    def lucky(self, epsilon: float, widths: np.ndarray) -> str:
        assert boundary(self, epsilon, widths) == "overflowing"
        return next(said)

    monkeypatch.setattr(TubeSearch, "boundary", lucky)
    manifold = series({x: x / 8}, {y: -8 * y + x}, 1)
    with flint.ctx.workprec(balls.PRECISION):
        search = _TubeSearch(manifold, {"x": (-1.0, 1.0)}, 20_000)
        tube = search.result(None)
        assert search.best is not None
        assert all(cone.collar > 0.0 for cone in search.best.cones)
        assert tube.collar > 0.0
        assert not tube.is_unique


def test_a_tube_whose_cones_have_no_collar_is_overflowing(monkeypatch: pytest.MonkeyPatch) -> None:
    # The narrower tube lies in the one over which it was proved that the flow leaves through every side.
    least = TubeSearch.least

    def unlucky(self, *more):
        monkeypatch.setattr(TubeSearch, "boundary", lambda *_: "mixed")
        return least(self, *more)

    monkeypatch.setattr(TubeSearch, "least", unlucky)
    tube = certify(series({x: x / 8}, {y: -8 * y + x}, 1), region={"x": (-1, 1)})
    assert (tube.boundary, tube.is_unique, tube.collar) == ("overflowing", True, 0.0)


@pytest.mark.exhaustive
def test_trajectories_that_start_in_the_tube_stay_in_it() -> None:
    manifold = sleigh(2)
    tube = certify(manifold, region=SQUARE, epsilon=0.1)
    system = manifold.branch.system
    field = [e.subs(epsilon, R(1, 10)) for e in (*system.f, *(10 * g for g in system.g))]
    rates = sp.lambdify((v, p, w), field)
    random = np.random.default_rng(1)
    met = 0
    for side in (-0.999, 0.999):
        for start in random.uniform(-2.0, 2.0, (12, 2)):
            height = manifold.evaluate(start[None], 0.1)[0, 0] + side * tube.delta
            run = solve_ivp(
                lambda t, z: rates(*z),
                (0.0, 3.0),
                [*start, height],
                rtol=1e-11,
                atol=1e-13,
                t_eval=np.linspace(0, 3, 301),
            )
            inside = np.cumprod((np.abs(run.y[:2]) <= 2.0).all(axis=0)).astype(bool)
            away = np.abs(run.y[2] - manifold.evaluate(run.y[:2].T, 0.1)[:, 0])[inside]
            assert (away <= tube.delta).all()
            met += inside.sum()
    assert met > 1000


@pytest.mark.parametrize("k", [0, 1, 2, 3])
def test_a_wrong_coefficient_is_refuted(k: int) -> None:
    right = michaelis_menten(3)
    ring = right.chart.ring
    wrong = [[e + ring.constant(R(1, 10**9)) if i == k else e for i, e in enumerate(row)] for row in right._h]
    tube = certify(replace(right, _h=wrong), region=HALF_LINE, epsilon=0.01)
    assert tube.verdict is ProofVerdict.REFUTED
    assert f"epsilon^{k}" in tube.reason
    assert np.isnan(tube.delta)


def test_a_pole_in_the_region_is_never_proved() -> None:
    tube = certify(michaelis_menten(1), region={"s": (-2, 1)}, epsilon=0.01)
    assert tube.verdict is ProofVerdict.UNDECIDED
    assert not tube.is_isolating


def test_no_epsilon_beyond_the_loss_of_attraction_is_proved() -> None:
    # epsilon y' = -(1 - 4 epsilon) y + x, x' = 1: the fast direction repels from epsilon = 1/4 on.
    manifold = series({x: sp.Integer(1)}, {y: -(1 - 4 * epsilon) * y + x}, 2)
    assert certify(manifold, region={"x": (0, 1)}, epsilon=0.26).verdict is ProofVerdict.UNDECIDED
    assert 0.02 < certify(manifold, region={"x": (0, 1)}).epsilon_0 < 0.25


@pytest.mark.parametrize("rate", [1, 3])
def test_no_epsilon_beyond_the_crossing_of_rates_is_proved(rate: int) -> None:
    # x' = -rate x, epsilon y' = -y + x: solutions approach x = 0 faster than one another where epsilon rate > 1.
    manifold = series({x: -rate * x}, {y: -y + x}, 2)
    tube = certify(manifold, region={"x": (-1, 1)})
    assert 0.1 / rate < tube.epsilon_0 < 1.0 / rate
    beyond = certify(manifold, region={"x": (-1, 1)}, epsilon=1.1 / rate)
    assert beyond.verdict is ProofVerdict.UNDECIDED
    assert not beyond.has_cones


def test_a_series_that_is_the_manifold() -> None:
    manifold = series({x: sp.Integer(0)}, {y: -y + x**2}, 1)
    tube = certify(manifold, region={"x": (-1, 1)}, epsilon=0.1)
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.delta < 1e-7


def test_what_is_proved_hangs_on_the_sides() -> None:
    out = certify(series({x: x}, {y: -y + x**2}, 1), region={"x": (-1, 1)}, epsilon=0.05)
    into = certify(series({x: -x}, {y: -y + x**2}, 1), region={"x": (-1, 1)}, epsilon=0.05)
    mixed = certify(series({x: sp.Integer(1)}, {y: -y + x**2}, 1), region={"x": (-1, 1)}, epsilon=0.05)
    assert (out.boundary, into.boundary, mixed.boundary) == ("overflowing", "inflowing", "mixed")
    assert "unique" in out.statement[-1]
    # The steepest collar is that of the fast rate 1/epsilon = 20 less the slow one: the width is |f| over that.
    assert out.collar == 0.0
    assert 1.0 / 20.0 < mixed.collar <= 1.0 / 8.0
    assert "for ever" in into.statement[0]
    assert all("others may lie outside the tube" in tube.statement[-1] for tube in (into, mixed))
    assert "for every epsilon in (0, 0.05]" in str(mixed)


def test_a_parameter_may_be_an_interval() -> None:
    manifold = series({x: 1 - x}, {y: -a * y + x}, 2, parameters={a: 1})
    whole = certify(manifold, region={"x": (0, 1), "a": (1, 2)}, epsilon=0.05)
    one = certify(manifold, region={"x": (0, 1)}, epsilon=0.05)
    assert whole.verdict is one.verdict is ProofVerdict.PROVED
    # The widest tube is that of a = 1.
    assert whole.delta == pytest.approx(one.delta, rel=0.02)
    assert certify(manifold, region={"x": (0, 1), "a": (-1, 2)}, epsilon=0.05).verdict is ProofVerdict.UNDECIDED


def test_what_has_no_exact_residual_is_refused() -> None:
    with pytest.raises(UnsupportedFunctionError, match="tanh"):
        certify(series({x: -x + sp.tanh(y)}, {y: -y + x}, 1), region={"x": (0, 1)})


def test_an_implicit_branch_is_refused() -> None:
    with pytest.raises(DeclarationError, match="explicit"):
        certify(series({x: y}, {y: x - y**5 / 5 - y}, 1), region={"x": (0, 1)})


def test_a_spent_budget_is_said() -> None:
    tube = certify(michaelis_menten(3), region=HALF_LINE, epsilon=0.1, most_boxes=3)
    assert tube.verdict is ProofVerdict.UNDECIDED
    assert "3 boxes" in tube.reason


def test_an_interruption_keeps_what_is_proved(monkeypatch: pytest.MonkeyPatch) -> None:
    within, calls = TubeSearch.within, []

    def interrupted(self, epsilon: float, *more):
        calls.append(epsilon)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return within(self, epsilon, *more)

    monkeypatch.setattr(TubeSearch, "within", interrupted)
    tube = certify(saddle(1), region={"s": (-1, 1)})
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.epsilon_0 == calls[0]
    calls.append(0.0)
    calls.remove(calls[1])
    calls.pop()
    nothing = certify(saddle(1), region={"s": (-1, 1)})
    assert nothing.verdict is ProofVerdict.UNDECIDED
    assert "interrupted" in nothing.reason


def test_progress_rises_to_one_and_an_interrupt_in_it_keeps_what_is_proved() -> None:
    shares: list[float] = []
    whole = certify(saddle(1), region={"s": (-1, 1)}, progress=shares.append)
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)
    # The search, of a dozen steps, is seen to go on within each of them.
    assert len(set(shares)) > 5
    assert len(shares) > whole.tried / 2
    told = 0

    def interrupt(share: float) -> None:
        nonlocal told
        told += 1
        if share > 0.5 and told < len(shares):
            told = len(shares)
            raise KeyboardInterrupt

    cut = certify(saddle(1), region={"s": (-1, 1)}, progress=interrupt)
    assert cut.verdict is ProofVerdict.PROVED
    assert 0.0 < cut.epsilon_0 <= whole.epsilon_0


def test_where_no_tube_is_proved_the_place_and_the_remedy_are_told(tmp_path: Path) -> None:
    fold = expand(
        solve_critical(SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - y**2}, epsilon=epsilon))
        .branches[0].through({"x": 1, "y": 1}),
        order=1,
    )  # fmt: skip
    near = certify(fold, region={"x": (R(1, 10**6), 1)}, epsilon=0.01)
    assert near.verdict is ProofVerdict.UNDECIDED
    assert "weakest near x = 0.02" in near.reason
    assert "Lower epsilon, or shrink the region" in near.reason
    wide = certify(series({x: x}, {y: x**2 - y + 20 * y**2 * x}, 0), region={"x": (-1, 1)})
    assert wide.verdict is ProofVerdict.UNDECIDED
    assert "Take a region without this place" in wide.reason
    sine = certify(series({x: sp.Integer(1)}, {y: sp.sin(x) - y}, 1), region={"x": (-1, 1)}, epsilon=0.05)
    with pytest.raises(GspError, match=r"Got sin\. A tube of such a system has no file"):
        sine.save(tmp_path / "tube.json")


def test_why_no_tube_is_proved_names_parameters_of_the_region_too() -> None:
    manifold = series({x: -x}, {y: -a * y + x**2}, 1, parameters={a: 1})
    found = certify(manifold, region={"x": (-1, 1), "a": (-0.5, 1)}, epsilon=0.1)
    assert "near x = -1, a = -0.5 a fast direction does not shrink" in found.reason


@pytest.mark.parametrize(("unit", "far"), [(1, 2020), (10**6, 300)])
def test_a_tube_is_the_same_far_from_the_origin_and_in_other_units(unit: int, far: int) -> None:
    here = series({x: -x + v, y: x - y}, {v: x * y - v - v * y**2}, 0)
    X, Y, V = x - far, y - far, (v - 10**6) / unit
    there = series({x: -X + V, y: X - Y}, {v: unit * (X * Y - V - V * Y**2)}, 0)
    tube = certify(here, region={"x": (-1, 1), "y": (-1, 1)}, epsilon=0.0078125)
    region = dict.fromkeys("xy", (far - 1, far + 1))
    moved = certify(there, region=region, epsilon=0.0078125)
    assert tube.verdict is moved.verdict is ProofVerdict.PROVED
    assert moved.delta == pytest.approx(unit * tube.delta, rel=1e-6)
    assert moved.collar == pytest.approx(tube.collar, rel=1e-6)
    assert moved.tried == pytest.approx(tube.tried, rel=0.1)
