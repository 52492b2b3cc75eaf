"""Where a series is best cut and how wrong it is there: honest on random systems, robust to single small terms."""

from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

from gsp.analysis.analysis import Analysis
from gsp.charts.manifolds import slow_line
from gsp.charts.sampling import slow_curve, slow_ends
from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BeyondReachWarning, HyperbolicityError
from gsp.slow.series import LONGEST, SeriesManifold, best_sum, expand
from gsp.slow.solved_manifold import solve_manifold
from gsp.slow.truncation import AHEAD, best, errors, least, past
from gsp.systems.system import SlowFastSystem
from tests.example_systems import michaelis_menten, saddle, van_der_pol

x, y, u, eps = sp.symbols("x y u epsilon")
# A solved manifold tells the error of a series that is this much larger than its own.
CLEAR = 10.0
POINTS = 30


def random_system(rng: np.random.Generator) -> SlowFastSystem:
    """One or two slow variables and a fast one, quadratic, attracting at 0."""

    def c(largest: int = 20) -> sp.Rational:
        return sp.Rational(int(rng.integers(-largest, largest + 1)), 20)

    kind = rng.choice(["linear in y", "quadratic in y", "two slow"], p=[0.4, 0.4, 0.2])
    slow = {x: int(rng.choice([-1, 1])) + c() * x + c() * y + c(8) * x * y}
    fast = {y: -(1 + abs(c())) * y + c() * x + c(10) * x**2 + c(10) * x * y}
    if kind == "quadratic in y":
        slow[x] += c(8) * x**2 + c(8) * y**2
        fast[y] += c(8) * y**2
    if kind == "two slow":
        slow[u] = c() + c() * x + c() * u + c() * y + c(8) * x * y
        fast[y] += c() * u + c(10) * u * y + c(10) * x * u
    return SlowFastSystem(slow=slow, fast=fast, epsilon=eps)


def battery(seed: int, count: int):
    """(series, points, epsilon, solved values, their error) of random systems whose manifold could be solved well."""
    rng = np.random.default_rng(seed)
    found = 0
    while found < count:
        system = random_system(rng)
        epsilon, width = float(rng.choice([0.02, 0.05, 0.1, 0.2, 0.4])), rng.uniform(0.2, 1.0)
        points = rng.uniform(-width, width, (POINTS, len(system.x)))
        branch = solve_critical(system).nearest(dict.fromkeys(system.states, 0.0))
        region = {s.name: (-width, width) for s in system.x}
        solved = solve_manifold(branch, region=region, epsilon=epsilon, tolerance=1e-10)
        if solved.surface is not None and solved.error_estimate < 1e-7:
            found += 1
            yield branch, points, epsilon, solved.evaluate(points), solved.error_estimate


@pytest.mark.exhaustive
def test_the_truncation_error_is_honest_on_random_systems() -> None:
    ratios = []
    for branch, points, epsilon, true, floor in battery(seed=11, count=20):
        for order in (1, 2, 3, 4):
            series = expand(branch, order=order, symbolic=False)
            orders = series.optimal_order(points, epsilon)
            sums = series.terms(points, epsilon).cumsum(axis=1)[np.arange(POINTS), orders]
            error = np.linalg.norm(sums - true, axis=1)
            told = error > CLEAR * floor
            ratios.append((error / series.truncation_error(points, epsilon))[told])
    ratio = np.concatenate(ratios)
    assert len(ratio) > 1500
    assert (ratio > 1.0).mean() <= 0.01
    assert ratio.max() <= 3.0
    # Honest, and of use: it is not above the error by more than this as a rule.
    assert np.median(ratio) > 0.1


@pytest.mark.exhaustive
def test_an_accidentally_small_term_does_not_end_the_search() -> None:
    # h_4 is nearly 0 at this point; the true error of order 3 is 1.4e-2.
    system = SlowFastSystem(
        slow={x: 1 + x / 20 + 7 * y / 20 + x * y / 20},
        fast={y: -3 * x**2 / 10 - x * y / 4 - x - 6 * y / 5},
        epsilon=eps,
    )
    branch = solve_critical(system).branches[0]
    point, epsilon = 0.3802, 0.4
    solved = solve_manifold(branch, region={"x": (0.3, 0.45)}, epsilon=epsilon, tolerance=1e-10)
    assert solved.error_estimate < 1e-6
    for order in (3, 4, 5):
        series = expand(branch, order=order)
        chosen = series.optimal_order(point, epsilon)
        error = abs(series.terms(point, epsilon)[: chosen + 1].sum() - solved.evaluate(point)[0])
        assert error <= series.truncation_error(point, epsilon) <= 30 * error


@pytest.mark.exhaustive
@pytest.mark.parametrize("order", [4, 2, 6])
def test_the_error_is_honest_near_a_zero_of_several_terms(order: int) -> None:
    # A Hill function of exponent 4: near x = 0 three terms in a row are small. The manifold through all of time is
    # h(x) = the integral of exp(-s) hill(x - epsilon s) over s > 0.
    hill = x**4 / (1 + x**4)
    branch = solve_critical(SlowFastSystem(slow={x: 1}, fast={y: hill - y}, epsilon=eps)).branches[0]
    series = expand(branch, order=order)
    places, height = np.concatenate([[0.0], np.geomspace(1e-4, 0.9, 30)]), sp.lambdify(x, hill)
    nodes, weights = np.polynomial.legendre.leggauss(600)
    s, weights = 20 * (nodes + 1), 20 * weights
    for epsilon in (0.1, 0.2, 0.3):
        true = height(places[:, None] - epsilon * s) @ (weights * np.exp(-s))
        orders = np.asarray(series.optimal_order(places, epsilon))
        sums = series.terms(places, epsilon)[..., 0].cumsum(axis=1)[np.arange(len(places)), orders]
        assert (np.abs(sums - true) / series.truncation_error(places, epsilon)).max() < 2.0


@pytest.mark.exhaustive
def test_the_error_and_the_best_order_are_honest_on_linear_fibres() -> None:
    """epsilon y' = phi(x) - y over x' = 1, x and -x, where h(x) = the integral of exp(-s) phi(x(-epsilon s)), s > 0."""
    nodes, weights = np.polynomial.legendre.leggauss(400)
    s = np.concatenate([1.5 * (nodes + 1) + 3 * k for k in range(14)])
    weights = np.tile(1.5 * weights, 14) * np.exp(-s)
    graphs = (
        1 / (1 + x**2),
        sp.tanh(x),
        sp.exp(-(x**2)),
        sp.sin(2 * x),
        1 / (2 + sp.cos(x)),
        sp.sqrt(1 + x**2),
    )
    flows = {sp.S.One: lambda u, t: u + t, x: lambda u, t: u * np.exp(t), -x: lambda u, t: u * np.exp(-t)}
    places, short, far, count = np.linspace(-2, 2, 41) + 0.0123, 0, 0, 0
    for phi in graphs:
        height = sp.lambdify(x, phi)
        for rate, flow in flows.items():
            system = SlowFastSystem(slow={x: rate}, fast={y: phi - y}, epsilon=eps)
            branch = solve_critical(system).branches[0]
            for order in (2, 4, 6):
                series = expand(branch, order=order, symbolic=False)
                for epsilon in (0.05, 0.1, 0.2):
                    true = height(flow(places[:, None], -epsilon * s)) @ weights
                    value, orders, told = best_sum(series, places[:, None], epsilon)
                    ratio = np.abs(value[:, 0] - true) / np.maximum(told, 1e-13)
                    assert ratio.max() < 3.0
                    sums = series.terms(places[:, None], epsilon)[..., 0].cumsum(axis=1)
                    # The sums' errors pass through zero: what counts is the largest nearby.
                    wide = np.pad(np.abs(sums - true[:, None]), ((2, 2), (0, 0)), mode="edge")
                    envelope = np.lib.stride_tricks.sliding_window_view(wide, 5, axis=0).max(axis=-1)
                    best = np.maximum(envelope.min(axis=1), 1e-13)
                    far += int((envelope[np.arange(len(places)), orders] > 10 * best).sum())
                    short, count = short + int((ratio > 1.0).sum()), count + len(places)
    assert short <= 0.001 * count
    assert far <= 0.002 * count


def test_terms_that_rise_more_and_more_slowly_come_out_of_a_dip() -> None:
    def told(row: list[float]) -> tuple[int, float]:
        sizes = np.array([row])
        estimates = errors(sizes, 4)
        orders = best(estimates)
        return orders[0], least(sizes, orders, estimates)[0]

    for small in ([1e-6, 1e-4, 8e-3], [0.0, 0.0, 0.0]):
        order, error = told([1.0, *small, 0.2, 3.0, 40.0])
        assert order < 2
        assert error >= 0.2
    # A series that diverges rises by larger and larger factors: it is best cut at once.
    rising = [1.0, 0.01, 0.02, 0.08, 0.4, 2.4, 16.8]
    assert told(rising) == (0, pytest.approx(errors(np.array([rising]), 4)[0, 0]))


def test_the_best_order_is_looked_for_two_orders_further() -> None:
    # Near the fold of van der Pol the terms of order 4 and 5 are the first to grow.
    branch = solve_critical(van_der_pol()).nearest({"x": 2, "y": 2 / 3})
    series = expand(branch, order=3)
    place = np.linspace(-0.6, -0.3, 61)
    terms = expand(branch, order=3 + AHEAD).terms(place, 0.05)[..., 0]
    sizes = np.abs(terms)
    growing = (
        (sizes[:, 3] < sizes[:, 2]) & (sizes[:, 2] < sizes[:, 1]) & (sizes[:, 4:].max(axis=1) > 3 * sizes[:, 3])
    )
    assert growing.any()
    assert (series.optimal_order(place[growing], 0.05) < 3).all()


@pytest.mark.parametrize(
    ("sizes", "order", "expected"),
    [
        ([1, 0.1, 0.01, 1e-3, 1e-4, 1e-5], 3, 3),
        ([1, 0.1, 0.01, 1e-3, 1e-2, 1e-1], 3, 1),
        ([1, 0.1, 1e-9, 1e-3, 1e-4, 1e-5], 3, 3),
        ([1, 2, 4, 8, 16, 32], 3, 0),
        ([1, 0, 0, 0, 0, 0], 3, 3),
        ([1, 0.1, 0.01, 1e-3, np.nan, np.nan], 3, 3),
        ([1, 0.1, 0.01, np.nan, np.nan, np.nan], 3, 2),
    ],
)
def test_the_best_order_of_a_row_of_terms(sizes: list, order: int, expected: int) -> None:
    found = errors(np.array([sizes], dtype=float), order)
    assert found.shape == (1, order + 1)
    assert best(found)[0] == expected


def test_errors_of_terms_that_fall_geometrically_are_three_times_their_sum() -> None:
    falling = np.array([[2.0, 0.1, 0.01, 1e-3, 1e-4, 1e-5], [1.0, 8.0, 6.0, 4.5, 3.375, 2.53125]])
    found = errors(falling, 3)
    assert found[0] == pytest.approx(3 * falling[0, 1:5] / (1 - 0.1))
    # Terms that fall more slowly than by halves are summed as if they fell by halves.
    assert found[1] == pytest.approx(3 * falling[1, 1:5] / (1 - 0.5))
    # Two orders on are not known for the last: what is known of them stands for both, or else its own term.
    assert errors(falling[:, :5], 3)[:, 3] == pytest.approx(3 * falling[:, 4])
    assert errors(falling[:, :4], 3)[:, 3] == pytest.approx(3 * falling[:, 3])


def test_a_dip_of_two_terms_is_bridged_and_one_of_three_is_not() -> None:
    falling = np.array([1, 0.1, 0.01, 1e-3, 1e-4, 1e-5, 1e-6])
    for first in (2, 3):
        for width in (1, 2, 3):
            dipped = falling.copy()
            dipped[first : first + width] = 1e-12
            found, plain = errors(dipped[None], 4), errors(falling[None], 4)
            if width < 3:
                assert found == pytest.approx(plain)
            else:
                assert found[0, first - 1] < 0.02 * plain[0, first - 1]


def test_the_first_term_is_no_end_of_a_bridge() -> None:
    assert errors(np.array([[1.0, 1e-9, 1e-3, 1e-4]]), 1)[0, 0] == pytest.approx(3 * 1e-3 / (1 - 0.5))


def test_an_error_is_never_below_the_terms_left_out_nor_below_rounding() -> None:
    falling = np.array([[1, 0.1, 0.01, 1e-3, 1e-4, 1e-5]])
    assert (errors(falling, 3) >= falling[:, 1:5]).all()
    assert errors(np.array([[2.0, 0.0, 0.0]]), 0)[0, 0] > 1e-16
    # 1/2 + 1/4 + ... = 1
    assert errors(np.array([[1.0, 0.5, 0.25]]), 0)[0, 0] >= 1.0


# -- the reach ---------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def curve() -> SeriesManifold:
    return expand(solve_critical(van_der_pol()).nearest({"x": 2, "y": 2 / 3}), order=3)


def test_evaluation_beyond_the_reach_warns_and_gives_nan_on_request(curve: SeriesManifold) -> None:
    with pytest.warns(
        BeyondReachWarning, match=r"beyond its reach at y = -0\.66: .*after order 0.*optimal_order"
    ):
        value = curve.evaluate(-0.66, 0.05)
    assert abs(value[0]) > 100
    assert np.isnan(curve.evaluate(-0.66, 0.05, masked=True)).all()
    points = np.array([-0.66, -0.65, 0.5, 1.0])
    with pytest.warns(BeyondReachWarning, match=r"through order 3 is beyond .* 1 more of 4 points"):
        plain = curve.evaluate(points, 0.05)
    masked = curve.evaluate(points, 0.05, masked=True)
    assert np.isnan(masked[:, 0]).tolist() == [True, True, False, False]
    assert (masked[2:] == plain[2:]).all()
    # M0 itself is what there is: order 0 is never past the best one.
    assert curve.evaluate(-0.66, 0.05, order=0)[0] == pytest.approx(1.08, abs=0.01)


def test_within_the_reach_nothing_is_said() -> None:
    # Warnings are errors here.
    for system in (saddle(), michaelis_menten()):
        series = expand(solve_critical(system).branches[0], order=3)
        for value in (0.1, 0.01, 1e-6):
            assert np.isfinite(series.evaluate([0.5, 1.0], value)).all()


def test_a_singular_point_is_nan_on_request_too() -> None:
    series = expand(solve_critical(michaelis_menten()).branches[0], order=2)
    with pytest.raises(HyperbolicityError, match="singular at s = -1"):
        series.evaluate(np.array([-1.0, 1.0]), 0.1)
    assert np.isnan(series.evaluate(np.array([-1.0, 1.0]), 0.1, masked=True)[:, 0]).tolist() == [True, False]


def test_terms_are_summed_without_the_check(curve: SeriesManifold, monkeypatch: pytest.MonkeyPatch) -> None:
    called = []
    monkeypatch.setattr("gsp.slow.series.errors", lambda *a: called.append(a))
    assert curve.terms(-0.66, 0.05).sum() > 100
    assert not called


def test_an_unknown_last_term_counts_as_past_the_best_order() -> None:
    assert past(np.array([[0.1, np.nan], [0.1, 0.15], [0.1, 0.5]])).tolist() == [True, False, True]


# -- pictures ----------------------------------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_the_slow_manifold_is_drawn_as_far_as_its_terms_fall_and_the_end_is_marked(
    curve: SeriesManifold,
) -> None:
    # What a picture reads off an analysis, of the sheet right up to its fold at y = -2/3.
    study = SimpleNamespace(
        branch=curve.branch,
        system=curve.branch.system,
        region={"y": (-0.66, 1.0), "x": (1, 2.5)},
        scene=SimpleNamespace(system=curve.branch.system, epsilon=0.05),
    )
    pictured = type("Pictured", (Analysis,), {"short_series": curve})
    analysis = object.__new__(pictured)
    vars(analysis).update(series=curve, study=study)
    on, leading = slow_curve(analysis)
    drawn = np.isfinite(on[:, 1])
    first = int(np.argmax(drawn))
    assert first > 0
    assert drawn[first:].all()
    solved = solve_manifold(curve.branch, region={"y": (on[first, 0], 1.0)}, epsilon=0.05, tolerance=1e-8)
    assert solved.status.ok
    assert np.abs(solved.evaluate(on[first:, :1]) - on[first:, 1:]).max() < 0.05 * np.abs(on[first:, 1]).max()
    assert slow_ends(analysis) == (True, [on[first, 0]])
    axes = Figure().add_subplot()
    slow_line(analysis, axes, on, leading)
    assert [line.get_label() for line in axes.lines][1] == "its terms stop falling"
    # Far from the fold there is no end to mark.
    study.region |= {"y": (0.5, 1.0)}
    assert slow_ends(analysis) == (True, [])


def test_a_sum_at_the_best_order_follows_the_sheet_once_and_evaluates_each_term_once(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: x - y - sp.sin(y) / 2}, epsilon=eps)
    branch = solve_critical(system).branches[0].through({x: 0, y: 0})
    series, points = expand(branch, order=3), np.linspace(-1.0, 1.0, 9)[:, None]
    orders, left_out = series.optimal_order(points, 0.2), series.truncation_error(points, 0.2)
    terms = series.terms(points, 0.2)
    wanted = [row[: k + 1].sum(axis=0) for row, k in zip(terms, np.atleast_1d(orders))]

    calls: list[str] = []
    for owner, name in ((Branch, "points"), (SeriesManifold, "terms_at")):
        original = getattr(owner, name)
        monkeypatch.setattr(
            owner, name,
            lambda *a, original=original, name=name, **k: calls.append(name) or original(*a, **k),
        )  # fmt: skip
    found, found_orders, found_errors = best_sum(series, points, 0.2)
    # The digits of the terms are heard by moving the points three times.
    assert sorted(calls) == ["points", *["terms_at"] * (1 + 3)]
    np.testing.assert_array_equal(found_orders, orders)
    np.testing.assert_array_equal(found_errors, left_out)
    np.testing.assert_allclose(found, wanted, rtol=1e-13)


def test_orders_ahead_are_judged_by_those_before_them() -> None:
    # Of 103, 5504 and 115,736 terms: by the first alone all would look short.
    V, m, h, n, w = sp.symbols("V m h n w")
    current = 4 * m**3 * h * (1 - V) - 3 * n**4 * (V + 1) - w * (V + 1)
    fast = {
        m: 10 * (1 / (1 + sp.exp(-7 * V)) - m),
        h: 1 / (1 + sp.exp(8 * V)) - h,
        n: (1 / (1 + sp.exp(-5 * V)) - n) / (1 + sp.exp(-(V**2))),
        w: (1 / (1 + sp.exp(-9 * V)) - w) * sp.cosh(V),
    }
    branch = solve_critical(SlowFastSystem(slow={V: current}, fast=fast, epsilon=eps)).branches[0]
    series = expand(branch, order=0, symbolic=False)
    ahead = series._ahead
    assert max(series.sizes) <= LONGEST < ahead.sizes[1]
    assert ahead.order == 1
