"""Continuation of the critical manifold: known special points, invariances, endings, and calls that are refused."""

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.critical.continuation.critical_curve import REMEDIES
from gsp.critical.continuation.curve_continuation import continue_critical, switch_branch
from gsp.critical.loss_kind import LossKind
from gsp.errors import BranchError, DeclarationError, EndKind, Status
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems

eps = systems.epsilon
x, y, v, w, y1, y2, y3 = sp.symbols("x y v w y1 y2 y3")
current, a, b = sp.symbols("I a b")


def one(g: sp.Expr, parameters=None) -> SlowFastSystem:
    """One slow variable x, one fast variable y."""
    return SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: g}, epsilon=eps, parameters=parameters or {})


def several(*g: sp.Expr) -> SlowFastSystem:
    """One slow variable x, fast variables y1, y2, ..."""
    symbols = (y1, y2, y3)[: len(g)]
    return SlowFastSystem(slow={x: sp.Integer(1)}, fast=dict(zip(symbols, g)), epsilon=eps)


def fitzhugh_nagumo() -> SlowFastSystem:
    return SlowFastSystem(
        slow={w: v + sp.Rational(7, 10) - sp.Rational(4, 5) * w},
        fast={v: v - v**3 / 3 - w + current},
        epsilon=eps,
        parameters={current: 0.5},
    )


def disguised(*g: sp.Expr, seed: int = 1) -> tuple[SlowFastSystem, sp.Matrix]:
    """The same layer in other fast variables, y = T u with a random integer T."""
    n = len(g)
    T = sp.Matrix(np.random.default_rng(seed).integers(-3, 4, (n, n)).tolist()) + 4 * sp.eye(n)
    symbols = (y1, y2, y3)[:n]
    old = dict(zip(symbols, T * sp.Matrix(symbols)))
    return several(*(T.inv() * sp.Matrix(g).xreplace(old)).applyfunc(sp.expand)), T


def kinds(curve) -> list[LossKind]:
    return [point.kind for point in curve.special]


# -- folds -----------------------------------------------------------------------------------------


def test_the_folds_of_van_der_pol_are_where_they_are_known_to_be() -> None:
    curve = continue_critical(systems.van_der_pol(), start={"x": 2, "y": 0.6}, bounds={"x": (-3, 3)})
    assert kinds(curve) == [LossKind.FOLD] * 2
    for point, sign in zip(sorted(curve.special, key=lambda p: p["x"]), (-1, 1)):
        assert point["x"] == pytest.approx(sign, abs=1e-12)
        assert point["y"] == pytest.approx(-2 * sign / 3, abs=1e-12)
        # g = y - x^3/3 + x: g_xx/2 = -x, g_y = 1.
        assert point.coefficients["a"] == pytest.approx(-sign, abs=1e-12)
        assert point.coefficients["b"] == pytest.approx(1, abs=1e-12)
        assert curve["x"][point.row] == point["x"]
    assert [(s.kind, s.unstable) for s in curve.segments] == [
        ("attracting", 0),
        ("repelling", 1),
        ("attracting", 0),
    ]
    assert curve.status is Status.BOUND_REACHED
    assert curve["x"][[0, -1]].tolist() in ([3, -3], [-3, 3])


@pytest.mark.parametrize("unit", [sp.Integer(1), sp.Rational(1, 10**9), sp.Integer(10**9)])
def test_a_fold_at_zero_is_at_zero_and_not_at_what_newton_leaves_of_it(unit) -> None:
    curve = continue_critical(
        one((x - (y * unit) ** 2) / unit), start={"x": 1, "y": 1 / float(unit)}, bounds={"x": (-1, 3)}
    )
    (fold,) = curve.special
    assert dict(fold.point) == {"x": 0.0, "y": 0.0}


def test_a_curve_costs_what_it_should() -> None:
    curve = continue_critical(
        systems.van_der_pol(), start={"x": 2, "y": 0.6}, bounds={"x": (-3, 3), "y": (-3, 3)}
    )
    assert 100 < curve.stats.steps < 200
    assert curve.stats.rejected <= 3
    assert curve.stats.corrections < 4 * curve.stats.steps + 60
    assert curve.stats.located == 2


@pytest.mark.parametrize("free", ["y", "z"])
def test_one_of_several_slow_variables_is_free_and_the_others_stay(free: str) -> None:
    start = {"x": 2.0, "y": 0.5, "z": 0.3}
    curve = continue_critical(systems.koper(), start=start, free=free, bounds={"x": (-3, 3), free: (-5, 5)})
    other = "z" if free == "y" else "y"
    assert (curve[other] == start[other]).all()
    expected = [1, -1] if free == "y" else []
    assert sorted(p["x"] for p in curve.special) == pytest.approx(sorted(expected), abs=1e-12)


def test_a_fold_is_found_in_every_period() -> None:
    curve = continue_critical(one(sp.sin(y) - x), start={"x": 0, "y": 0}, bounds={"y": (-20, 20)})
    expected = (np.arange(12) - 5.5) * np.pi
    assert sorted(p["y"] for p in curve.special) == pytest.approx(expected, abs=1e-11)


def test_two_folds_within_one_step_are_both_found() -> None:
    h = 1e-2
    curve = continue_critical(one(x - y**3 / 3 + h**2 * y), start={"x": -1, "y": -1}, bounds={"x": (-1, 1)})
    assert kinds(curve) == [LossKind.FOLD] * 2
    assert sorted(p["y"] for p in curve.special) == pytest.approx([-h, h], abs=1e-12)


@pytest.mark.exhaustive
@pytest.mark.parametrize("start", [2.0, 0.5, -3.0])
def test_folds_of_a_curve_that_runs_away_are_found_from_every_start(start: float) -> None:
    """The size that y has at the curve's end says nothing of the direction at a fold before it."""
    curve = continue_critical(
        one(y - x * (1 + y**2)), start={"x": start / (1 + start**2), "y": start}, bounds={"x": (-1, 1)}
    )
    assert curve.status is Status.RUNS_AWAY
    assert sorted(point["y"] for point in curve.special) == pytest.approx([-1.0, 1.0], abs=1e-12)
    assert [segment.unstable for segment in curve.segments] == [0, 1, 0]


@pytest.mark.exhaustive
def test_every_fold_of_random_polynomials_is_found() -> None:
    rng = np.random.default_rng(0)
    for degree in (3, 4, 5, 6, 7):
        p = np.round(np.polyint(np.poly(rng.uniform(-1, 1, degree - 1))), 9)
        roots = np.roots(np.polyder(p))
        expected = np.sort(roots.real[np.abs(roots.imag) < 1e-9])
        g = x - sum(sp.Rational(str(c)) * y ** (degree - i) for i, c in enumerate(p))
        curve = continue_critical(
            one(g), start={"x": np.polyval(p, -1.2), "y": -1.2}, bounds={"y": (-1.2, 1.2)}
        )
        assert sorted(point["y"] for point in curve.special) == pytest.approx(expected, abs=1e-8)


def test_a_free_parameter_starts_where_the_start_says() -> None:
    curve = continue_critical(
        fitzhugh_nagumo(), start={"v": 2, "w": 1.0, "I": 1.7}, parameter=current, max_points=3
    )
    assert (curve["I"] > 1.5).all()
    assert (curve["w"] == 1.0).all()


def test_a_cusp_is_told_from_a_fold() -> None:
    curve = continue_critical(one(x - y**3), start={"x": -1, "y": -1}, bounds={"x": (-1, 1)})
    assert kinds(curve) == [LossKind.CUSP]
    assert curve.special[0]["y"] == pytest.approx(0, abs=1e-12)
    assert curve.special[0].coefficients["c"] == pytest.approx(-1, abs=1e-12)


@pytest.mark.parametrize("order", [4, 5])
def test_a_fold_of_higher_order_than_a_cusp_is_degenerate(order: int) -> None:
    curve = continue_critical(one(x - y**order), start={"x": 1, "y": 1}, bounds={"x": (-1, 1), "y": (-1, 1)})
    assert kinds(curve) == [LossKind.DEGENERATE]
    assert curve.special[0]["y"] == pytest.approx(0, abs=1e-3)


@pytest.mark.exhaustive
def test_a_start_at_a_fold_is_a_start_like_any_other() -> None:
    start = {"x": 1.0, "y": -2 / 3}
    both = continue_critical(systems.van_der_pol(), start=start, bounds={"x": (-3, 3)})
    assert sorted(p["x"] for p in both.special) == pytest.approx([-1, 1], abs=1e-12)
    ahead = continue_critical(systems.van_der_pol(), start=start, bounds={"x": (-3, 3)}, direction=1)
    assert ahead.special[0].row == 0


# -- Hopf points -----------------------------------------------------------------------------------

TURN = (x * y1 - 2 * y2, 2 * y1 + x * y2)
RADIUS = y1**2 + y2**2


@pytest.mark.exhaustive
@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("seed", [None, 1, 2, 3])
def test_a_hopf_point_of_the_layer_and_its_criticality(sign: int, seed: int | None) -> None:
    g = tuple(line + sign * u * RADIUS for line, u in zip(TURN, (y1, y2)))
    system = several(*g) if seed is None else disguised(*g, seed=seed)[0]
    curve = continue_critical(system, start={"x": -1, "y1": 0, "y2": 0}, bounds={"x": (-1, 1.3)})
    (point,) = curve.special
    assert point.kind is LossKind.HOPF
    assert point["x"] == pytest.approx(0, abs=1e-12)
    assert point.coefficients["omega"] == pytest.approx(2, abs=1e-12)
    assert point.coefficients["crossing"] == pytest.approx(1, abs=1e-12)
    assert np.sign(point.coefficients["l1"]) == sign
    if seed is None:
        # r' = sign r^3 is 2 sign |z|^2 z for y = z q + c.c. with |q| = 1, over omega.
        assert point.coefficients["l1"] == pytest.approx(2 * sign / 2, abs=1e-12)
    assert [s.unstable for s in curve.segments] == [0, 2]


def test_the_lyapunov_coefficient_is_that_of_guckenheimer_and_holmes() -> None:
    """(3.4.11) of Guckenheimer and Holmes (1983), a second road to the same number, on random cubics."""
    rng = np.random.default_rng(4)
    monomials = [y1**i * y2**j for i in range(4) for j in range(4) if 2 <= i + j <= 3]
    for omega in (1, 3):
        f, h = (
            sum(int(c) * m for c, m in zip(rng.integers(-4, 5, len(monomials)), monomials)) for _ in range(2)
        )
        system = several(x * y1 - omega * y2 + f, omega * y1 + x * y2 + h)
        curve = continue_critical(system, start={"x": -0.2, "y1": 0, "y2": 0}, bounds={"x": (-0.2, 0.1)})
        point = next(p for p in curve.special if p.kind is LossKind.HOPF)

        def d(e, i, j):
            return float(sp.diff(e, *[y1] * i, *[y2] * j).subs({y1: 0, y2: 0}))

        cubic = d(f, 3, 0) + d(f, 1, 2) + d(h, 2, 1) + d(h, 0, 3)
        quadratic = d(f, 1, 1) * (d(f, 2, 0) + d(f, 0, 2)) - d(h, 1, 1) * (d(h, 2, 0) + d(h, 0, 2))
        quadratic += -d(f, 2, 0) * d(h, 2, 0) + d(f, 0, 2) * d(h, 0, 2)
        expected = 2 * (cubic + quadratic / omega) / 16 / omega
        assert point.coefficients["l1"] == pytest.approx(expected, abs=1e-9)


@pytest.mark.exhaustive
def test_hopf_points_off_the_origin_in_three_fast_variables() -> None:
    # The branch is y = (0, 0, x) in hidden variables; the pair is x^2 - 1 +- 2i: two Hopf points, at x = +-1.
    g = ((y3**2 - 1) * y1 - 2 * y2 - y1**3, 2 * y1 + (y3**2 - 1) * y2, 5 * (x - y3))
    system, T = disguised(*g, seed=5)
    start = dict(zip(("y1", "y2", "y3"), map(float, T.inv() * sp.Matrix([0, 0, -2]))))
    curve = continue_critical(system, start={"x": -2, **start}, bounds={"x": (-2, 2)})
    assert kinds(curve) == [LossKind.HOPF] * 2
    assert [p["x"] for p in curve.special] == pytest.approx([-1, 1], abs=1e-11)
    assert [p.coefficients["crossing"] for p in curve.special] == pytest.approx([-2, 2], abs=1e-9)
    assert all(p.coefficients["l1"] < 0 for p in curve.special)
    assert [s.kind for s in curve.segments] == ["saddle", "attracting", "saddle"]


def test_a_neutral_saddle_is_no_hopf_point() -> None:
    curve = continue_critical(
        several((1 + x) * y1, -y2), start={"x": -0.7, "y1": 0, "y2": 0}, bounds={"x": (-0.7, 1)}
    )
    (point,) = curve.special
    assert point.kind is LossKind.NEUTRAL_SADDLE
    assert point["x"] == pytest.approx(0, abs=1e-12)
    assert len(curve.segments) == 1


def test_two_hopf_points_within_one_step_are_both_found() -> None:
    g = ((x**2 - 1e-4) * y1 - 2 * y2, 2 * y1 + (x**2 - 1e-4) * y2)
    curve = continue_critical(several(*g), start={"x": -1, "y1": 0, "y2": 0}, bounds={"x": (-1, 1.3)})
    assert kinds(curve) == [LossKind.HOPF] * 2
    assert [p["x"] for p in curve.special] == pytest.approx([-0.01, 0.01], abs=1e-12)


def test_a_layer_that_keeps_an_energy_raises_no_alarm() -> None:
    # The trace vanishes identically: a test that is zero everywhere tells nothing.
    curve = continue_critical(
        several(y2, x - y1 - y1**3), start={"x": 0, "y1": 0, "y2": 0}, bounds={"x": (-2, 2)}
    )
    assert curve.special == ()


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("system", "start", "box"),
    [
        (systems.michaelis_menten(), {"s": 1, "c": 0.5}, {"s": (0.1, 5)}),
        (systems.coupled(), {"x": 0.5, "y": 0.4, "z": 0.2}, {"x": (-0.5, 3)}),
        (systems.transcendental(), {"x": 0.5, "y": 0.3}, {"x": (-2, 4)}),
        (systems.saddle(), {"x": 1, "y": -1, "z": -1}, {"x": (-2, 2)}),
        (one(y**2 - 1), {"x": 0, "y": 1}, {"x": (-1, 1)}),
        (one(sp.tan(y) - x), {"x": 0, "y": 0}, {"x": (-50, 50)}),
    ],
)
def test_a_hyperbolic_curve_has_no_special_point(system, start, box) -> None:
    curve = continue_critical(system, start=start, bounds=box)
    assert curve.special == ()
    assert len(curve.segments) == 1
    assert curve.status is Status.BOUND_REACHED
    assert np.ptp(curve.unstable) == 0


# -- branch points ---------------------------------------------------------------------------------


def test_a_transcritical_point_is_located_and_switched() -> None:
    line = continue_critical(
        one(y * (y - x)), start={"x": -1, "y": 0}, bounds={"x": (-1, 1), "y": (-1, 1)}, switch_branches=True
    )
    (point,) = line.special
    assert point.kind is LossKind.TRANSCRITICAL
    assert (point["x"], point["y"]) == pytest.approx((0, 0), abs=1e-12)
    assert point.coefficients["discriminant"] > 0
    (other,) = line.others
    assert np.abs(other["y"] - other["x"]).max() < 1e-14
    assert other["x"][[0, -1]].tolist() == [-1, 1]
    assert [s.unstable for s in line.segments] == [1, 0]
    assert [s.unstable for s in other.segments] == [0, 1]
    assert kinds(other) == [LossKind.TRANSCRITICAL]


def test_a_transcritical_point_is_told_in_any_units_of_the_fast_variables() -> None:
    """Photons y1 on carriers y2 = 1: the rows of g_u differ by 10^12, and both are the rates of their variables."""
    found = []
    for power in (0, -6, 6):
        k, m = sp.Integer(10) ** power, sp.Integer(10) ** -power
        units = {y1: y1 / k, y2: y2 / m}
        g = [e.xreplace(units) for e in (k * y1 * (y2 - 1), m * (2 - y2 + (x + y1) / 2 - y1 * y2))]
        curve = continue_critical(
            several(*g),
            start={"x": 1, "y1": 3 * float(k), "y2": float(m)},
            bounds={"x": (-4, 4), "y1": (-4 * float(k), 6 * float(k)), "y2": (0, 2 * float(m))},
        )
        (point,) = curve.of_kind(LossKind.TRANSCRITICAL)
        found.append(point["x"])
    assert found == pytest.approx([-2.0] * 3, abs=1e-9)


@pytest.mark.parametrize("start", [{"x": -1, "y": 0}, {"x": 0.25, "y": 0.5}])
def test_a_pitchfork_is_told_from_a_fold_on_both_its_branches(start) -> None:
    bounds = {"x": (-1, 1), "y": (-2, 2)}
    first = continue_critical(one(y * (x - y**2)), start=start, bounds=bounds)
    assert kinds(first) == [LossKind.PITCHFORK]
    second = switch_branch(first, first.special[0])
    assert kinds(second) == [LossKind.PITCHFORK]
    line, parabola = (first, second) if start["y"] == 0 else (second, first)
    assert np.abs(line["y"]).max() < 1e-14
    assert np.abs(parabola["x"] - parabola["y"] ** 2).max() < 1e-14
    assert np.ptp(parabola["y"]) == pytest.approx(2)


def test_every_curve_of_an_arrangement_is_found_once() -> None:
    lines = y * (y - x) * (y - 1 + x) * (y**2 + x**2 - 4)
    box = {"x": (-3, 3), "y": (-3, 3)}
    curve = continue_critical(one(lines), start={"x": -0.5, "y": 0}, bounds=box, switch_branches=True)
    everything = [curve, *curve.others]
    assert len(everything) == 4
    assert sorted(c.status.name for c in everything) == ["BOUND_REACHED"] * 3 + ["CLOSED"]
    places = {(round(p["x"], 6) + 0.0, round(p["y"], 6) + 0.0) for c in everything for p in c.special}
    assert len(places) == 9
    assert max(abs(float(lines.subs({x: px, y: py}))) for px, py in places) < 1e-3


def test_a_branch_point_in_disguise() -> None:
    system, T = disguised(y1 * (y1 - x), -y2 + y1**2, seed=7)
    curve = continue_critical(
        system, start={"x": -1, "y1": 0, "y2": 0}, bounds={"x": (-1, 0.7)}, switch_branches=True
    )
    (point,) = curve.special
    assert point.kind is LossKind.TRANSCRITICAL
    assert np.abs(point.unknowns).max() < 1e-12
    (other,) = curve.others
    hidden = np.array(T, dtype=float) @ np.stack([other["y1"], other["y2"]])
    assert hidden == pytest.approx(np.stack([other["x"], other["x"] ** 2]), abs=1e-12)


@pytest.mark.parametrize("gap", [1e-3, 1e-7, 1e-10])
def test_a_curve_does_not_jump_across_a_gap(gap: float) -> None:
    g = y * (y - x) - sp.Rational(str(gap))
    curve = continue_critical(one(g), start={"x": -1, "y": 0}, bounds={"x": (-1, 1), "y": (-1, 1)})
    assert curve.special == ()
    assert (curve["y"] > 0).all()
    assert curve.points[-1].max() == pytest.approx(1)


def test_a_figure_of_eight_is_followed_through_its_crossing() -> None:
    curve = continue_critical(
        one((x**2 + y**2) ** 2 - x**2 + y**2), start={"x": 1, "y": 0}, switch_branches=True
    )
    assert curve.is_closed
    assert curve.others == ()
    assert kinds(curve).count(LossKind.TRANSCRITICAL) == 2
    assert kinds(curve).count(LossKind.FOLD) == 2


def test_a_tangency_of_two_curves_is_a_branch_point_of_higher_order() -> None:
    curve = continue_critical(one(y * (y - x**3)), start={"x": -1, "y": 0}, bounds={"x": (-1, 1)})
    (point,) = curve.special
    assert point.kind is LossKind.BRANCH_POINT
    assert abs(point["x"]) < 1e-6
    assert len(point.directions) == 0
    assert curve["x"][[0, -1]].tolist() == [-1, 1]


def test_three_curves_through_one_point_are_named_but_not_told_apart() -> None:
    curve = continue_critical(one(y * (y**2 - x**2)), start={"x": -1, "y": 0}, bounds={"x": (-1, 1)})
    (point,) = curve.special
    assert point.kind is LossKind.BRANCH_POINT
    assert abs(point["x"]) < 1e-6
    with pytest.raises(DeclarationError, match="with two tangents"):
        switch_branch(curve, point)


@pytest.mark.parametrize("unit", [1, 10**6, sp.Rational(1, 10**6)])
@pytest.mark.parametrize("origin", [0, 7])
def test_where_kinks_cross_on_the_edge_of_the_region_is_a_point_of_it(unit: sp.Expr, origin: int) -> None:
    """It was told a step's length beside its place, and so outside."""
    g = sp.Abs(unit * (x - origin)) - sp.Abs(y - origin)
    start = {"x": origin + 0.8 / float(unit), "y": origin + 0.8}
    (point,) = continue_critical(one(g), start=start).special
    assert point.kind is LossKind.BRANCH_POINT
    assert point["y"] == pytest.approx(origin, abs=1e-14)
    assert point.is_in({"y": (origin, origin + 2)})


# -- closed curves and invariances -----------------------------------------------------------------

ELLIPSE = 1 - x**2 / 4 - y**2 - x * y / 3


@pytest.mark.parametrize("unit", [1, sp.Rational(1, 10**9), 10**6])
@pytest.mark.parametrize(
    "g",
    [y**2 - x**4, y**3 - x**4, y**3 - x**5, (y - x**2) * (y + x**2) * (y - x / 2)],
    ids=["tacnode", "x^(4/3)", "x^(5/3)", "tacnode and a line"],
)
def test_a_contact_of_higher_order_is_one_branch_point(g: sp.Expr, unit: sp.Expr) -> None:
    curve = continue_critical(
        one(g.subs(x, x / unit)), start={"x": unit, "y": 1}, bounds={"x": (-2 * unit, 2 * unit), "y": (-3, 3)}
    )
    beside = [point for point in curve.special if abs(point["x"]) < 0.25 * unit]
    assert [point.kind for point in beside] == [LossKind.BRANCH_POINT]
    # g is zero to the tolerance of a step over this length.
    assert abs(beside[0]["x"]) < 1e-4 * unit
    assert curve.status is Status.BOUND_REACHED


@pytest.mark.parametrize("order", [3, 5])
def test_a_curve_that_turns_back_in_a_point_ends_at_one_branch_point(order: int) -> None:
    curve = continue_critical(one(y**2 - x**order), start={"x": 1, "y": 1}, bounds={"x": (-2, 2), "y": (-3, 3)})
    (point,) = curve.special
    assert point.kind is LossKind.BRANCH_POINT
    assert abs(point["x"]) < 1e-3
    assert curve.points[:, 0].min() > -1e-3


def test_a_fast_rate_that_is_small_over_a_stretch_has_no_branch_point_there() -> None:
    curve = continue_critical(
        one(sp.exp(-40 * x**2) * (y - sp.sin(x))), start={"x": 1, "y": 0.8}, bounds={"x": (-2, 2)}
    )
    assert curve.special == ()
    assert curve.status is Status.BOUND_REACHED


def test_a_curve_through_a_pole_of_the_field_ends_there_without_a_branch_point() -> None:
    # Zhabotinsky's oxidised catalyst: at x = 1 the field is infinite, but for y = 1/4, where it is 0/0.
    fast = y * (1 - y) - x / (1 - x) * (y - sp.Rational(1, 4)) / 50
    system = SlowFastSystem(slow={x: y}, fast={y: fast}, epsilon=sp.Symbol("epsilon"))
    curve = continue_critical(system, start={"x": 0.1, "y": 0.9}, bounds={"x": (-0.5, 1.5), "y": (0, 2)})
    assert not any(point.kind.is_branch_point for point in curve.special)
    assert curve["x"].max() == pytest.approx(1.0, abs=1e-6)
    assert "a pole here" in curve.message


@pytest.mark.exhaustive
@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_a_closed_curve_closes(direction: int) -> None:
    curve = continue_critical(one(ELLIPSE), start={"x": 0, "y": 1}, direction=direction)
    assert curve.status is Status.CLOSED
    assert curve.is_closed
    assert (curve.points[0] == curve.points[-1]).all()
    assert len(curve.stops) == 1
    # On the ellipse g_y = 0 is y = -x/6, so that x^2 (1/4 - 1/36) = 1.
    assert sorted(p["x"] for p in curve.special) == pytest.approx([-(4.5**0.5), 4.5**0.5], abs=1e-12)


# Powers of two, which change no rounding.
@pytest.mark.exhaustive
@pytest.mark.parametrize("factors", [(2.0**p, 2.0**q) for p, q in ((13, 0), (0, 13), (13, -13), (-13, 13))])
def test_the_units_of_the_variables_change_nothing(factors) -> None:
    k, m = (sp.Rational(str(f)) for f in factors)
    plain = continue_critical(one(x - y**3 / 3 + y), start={"x": -2, "y": -2.4}, bounds={"x": (-2, 2)})
    scaled = continue_critical(
        one(x / k - (y / m) ** 3 / 3 + y / m),
        start={"x": -2 * factors[0], "y": -2.4 * factors[1]},
        bounds={"x": (-2 * factors[0], 2 * factors[0])},
    )
    assert scaled.stats.steps == plain.stats.steps
    assert scaled.stats.rejected == plain.stats.rejected
    assert kinds(scaled) == kinds(plain)
    assert scaled.points / np.array(factors) == pytest.approx(plain.points, rel=1e-9, abs=1e-9)
    for p, q in zip(plain.special, scaled.special):
        assert (q["x"] / factors[0], q["y"] / factors[1]) == pytest.approx((p["x"], p["y"]), abs=1e-12)


def test_the_units_of_the_variables_do_not_move_a_hopf_point() -> None:
    k = 10**4
    old = {x: x * k, y1: y1 / k, y2: y2 * k}
    g = tuple((line - u * RADIUS).xreplace(old) for line, u in zip(TURN, (y1, y2)))
    curve = continue_critical(
        several(g[0] * k, g[1] / k), start={"x": -1 / k, "y1": 0, "y2": 0}, bounds={"x": (-1 / k, 1.3 / k)}
    )
    (point,) = curve.special
    assert point.kind is LossKind.HOPF
    assert point["x"] * k == pytest.approx(0, abs=1e-9)
    assert point.coefficients["l1"] < 0


def test_the_units_of_g_change_nothing() -> None:
    g = (1e6 * (x - y1**3 / 3 + y1), 1e-6 * (y1 - y2))
    curve = continue_critical(several(*g), start={"x": -2, "y1": -2.4, "y2": -2.4}, bounds={"x": (-2, 2)})
    folds = curve.of_kind(LossKind.FOLD)
    assert [p["y1"] for p in folds] == pytest.approx([-1, 1], abs=1e-10)


def test_the_order_of_the_fast_variables_changes_nothing() -> None:
    g = (x - y1**3 / 3 + y1 + y2 / 3, y1 / 2 - 2 * y2 + y1**2 / 5)
    start, box = {"x": -3, "y1": -2.4, "y2": -1}, {"x": (-3, 3)}
    plain = continue_critical(several(*g), start=start, bounds=box)
    swap = {y1: y2, y2: y1}
    other = several(g[1].xreplace(swap), g[0].xreplace(swap))
    turned = continue_critical(other, start={"x": -3, "y1": -1, "y2": -2.4}, bounds=box)
    assert kinds(turned) == kinds(plain)
    assert LossKind.FOLD in kinds(plain)
    for p, q in zip(plain.special, turned.special):
        assert (q["x"], q["y2"], q["y1"]) == pytest.approx((p["x"], p["y1"], p["y2"]), abs=1e-11)
        assert q.coefficients == pytest.approx(p.coefficients, abs=1e-9)


def test_a_linear_change_of_the_fast_variables_changes_nothing_on_the_slow_side() -> None:
    g = (x - y1**3 / 3 + y1, y1 - y2)
    plain = continue_critical(several(*g), start={"x": -2, "y1": -2.4, "y2": -2.4}, bounds={"x": (-2, 2)})
    system, T = disguised(*g, seed=11)
    u = np.linalg.solve(np.array(T, dtype=float), [-2.4, -2.4])
    other = continue_critical(system, start={"x": -2, "y1": u[0], "y2": u[1]}, bounds={"x": (-2, 2)})
    assert sorted(kinds(other)) == sorted(kinds(plain))
    for p, q in zip(plain.special, other.special):
        assert q["x"] == pytest.approx(p["x"], abs=1e-11)
        assert np.sort_complex(q.eigenvalues) == pytest.approx(np.sort_complex(p.eigenvalues), abs=1e-6)


@pytest.mark.exhaustive
def test_both_directions_are_the_two_directions_joined() -> None:
    options = {"start": {"x": 2, "y": 0.6}, "bounds": {"x": (-3, 3)}}
    both = continue_critical(systems.van_der_pol(), **options)
    forward = continue_critical(systems.van_der_pol(), direction=1, **options)
    backward = continue_critical(systems.van_der_pol(), direction=-1, **options)
    assert len(both) == len(forward) + len(backward) - 1
    assert np.vstack([backward.points[:0:-1], forward.points]) == pytest.approx(both.points, abs=1e-12)
    assert len(both.special) == len(forward.special) + len(backward.special) == 2
    assert forward["y"][1] > forward["y"][0]
    assert backward["y"][1] < backward["y"][0]


def test_the_same_curve_from_the_other_end() -> None:
    system, box = one(x - y**3 / 3 + y), {"x": (-2, 2)}
    there = continue_critical(system, start={"x": -2, "y": -2.4}, bounds=box)
    end = dict(zip(there.names, there.points[-1]))
    back = continue_critical(system, start=end, bounds=box)
    for p, q in zip(there.special, back.special, strict=True):
        assert (q["x"], q["y"]) == pytest.approx((p["x"], p["y"]), abs=1e-12)
    assert back.arclength[-1] == pytest.approx(there.arclength[-1], rel=2e-2)


def test_every_point_is_on_the_manifold_and_the_stability_is_that_of_its_rows() -> None:
    curve = continue_critical(systems.van_der_pol(), start={"x": 2, "y": 0.6}, bounds={"x": (-3, 3)})
    assert np.abs(curve["y"] - curve["x"] ** 3 / 3 + curve["x"]).max() < 1e-13
    assert curve.eigenvalues[:, 0].real == pytest.approx(1 - curve["x"] ** 2, abs=1e-13)
    plain = np.ones(len(curve), dtype=bool)
    plain[[p.row for p in curve.special]] = False
    assert (curve.unstable[plain] == (np.abs(curve["x"][plain]) < 1)).all()
    assert curve.segments[0].first == 0
    assert curve.segments[-1].last == len(curve) - 1
    for before, after in zip(curve.segments[:-1], curve.segments[1:]):
        assert before.last == after.first
        assert before.last in [p.row for p in curve.special]
    assert (np.diff(curve.arclength) > 0).all()
    with pytest.raises(ValueError, match="read-only"):
        curve.points[0, 0] = 1.0


# -- endings ---------------------------------------------------------------------------------------


def test_a_curve_ends_exactly_on_its_bound() -> None:
    curve = continue_critical(
        one(y - x**2 - sp.sin(x)), start={"x": 0, "y": 0}, bounds={"y": (-0.2, 0.7)}, direction=1
    )
    assert curve.stops[0].bound == "y"
    assert curve["y"][-1] == 0.7
    assert curve.message.startswith(f"stopped after {len(curve)} points: BOUND_REACHED at y = 0.7")


def test_a_start_on_a_bound_goes_inwards_only() -> None:
    curve = continue_critical(one(y - x), start={"x": 0, "y": 0}, bounds={"x": (0, 1)})
    assert curve["x"][[0, -1]].tolist() == [0, 1]
    assert [stop.ending for stop in curve.stops] == [Status.BOUND_REACHED] * 2


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("g", "start", "ending"),
    [
        (y - sp.sqrt(x), {"x": 1, "y": 1}, Status.NON_FINITE),
        (x - sp.Abs(y), {"x": 1, "y": 1}, Status.STEP_TOO_SMALL),
        (y - sp.Heaviside(-x), {"x": 1, "y": 0}, Status.STEP_TOO_SMALL),
        (x * y - 1, {"x": 1, "y": 1}, Status.RUNS_AWAY),
        (y - sp.sin(1000 * x) / 1000, {"x": 1, "y": 0}, Status.TOO_MANY_POINTS),
    ],
)
def test_each_ending_is_named_with_its_place_and_remedy(g, start, ending) -> None:
    curve = continue_critical(one(g), start=start, direction=-1, max_points=900)
    assert curve.status is ending
    assert not curve.status.ok
    assert f"{ending.name} at x = " in curve.message
    assert REMEDIES.get(ending, ending.remedy) in curve.message
    assert "fast eigenvalue" in curve.message
    assert np.isfinite(curve.points).all()


def test_the_message_names_the_special_point_nearby() -> None:
    g = sp.Piecewise((x - y**2, y > sp.Rational(1, 1000)), (x - y**2 + 1, True))
    curve = continue_critical(one(g), start={"x": 1, "y": 1}, direction=-1)
    assert curve.status is Status.STEP_TOO_SMALL
    bent = sp.Piecewise((x - y**2, y > -sp.Rational(1, 100)), (x - y**2 + 1, True))
    curve = continue_critical(one(bent), start={"x": 1, "y": 1}, direction=-1)
    assert curve.status is Status.STEP_TOO_SMALL
    assert "close to the fold at x = " in curve.message


def test_points_are_limited_and_counted() -> None:
    curve = continue_critical(one(y - x), start={"x": 0, "y": 0}, max_points=10)
    assert len(curve) == 19
    assert curve.status is Status.TOO_MANY_POINTS


def test_an_interruption_keeps_what_was_computed() -> None:
    shares = []

    def progress(share: float) -> None:
        shares.append(share)
        if len(shares) == 8:
            raise KeyboardInterrupt

    curve = continue_critical(one(y - x), start={"x": 0, "y": 0}, progress=progress)
    assert curve.status is Status.INTERRUPTED
    assert len(curve) == 9
    assert all(0 < share <= 1 for share in shares)


@pytest.mark.parametrize("ending", list(Status))
def test_every_ending_has_a_meaning_and_every_failure_a_remedy(ending: Status) -> None:
    assert ending.meaning
    assert bool(ending.remedy) is not ending.ok
    assert ending.meaning in str(ending)


def test_endings_of_all_computations_are_one_vocabulary_in_four_kinds() -> None:
    assert gsp.Ending is Status
    kinds = {kind: [ending for ending in Status if ending.kind is kind] for kind in EndKind}
    assert all(kinds.values())
    # What was reached needs no remedy; a fold is knowledge, and a failure never counts as all there is.
    assert all(ending.ok for ending in kinds[EndKind.REACHED])
    assert {Status.FOLD_REACHED, Status.HYPERBOLICITY_LOST, Status.EQUILIBRIUM_REACHED} <= set(
        kinds[EndKind.ENDS]
    )
    assert kinds[EndKind.STOPPED] == [Status.EVENT_REACHED, Status.REGION_LEFT, Status.INTERRUPTED]
    assert not any(ending.ok for ending in (*kinds[EndKind.STOPPED], *kinds[EndKind.FAILED]))


def test_a_curve_shows_itself() -> None:
    curve = continue_critical(systems.van_der_pol(), start={"x": 2, "y": 0.6}, bounds={"x": (-3, 3)})
    assert repr(curve) == f"CriticalCurve({len(curve)} points in y, x, BOUND_REACHED, 2 fold)"
    assert "repelling (1 unstable) from row" in str(curve)
    assert "fold at" in str(curve)


# -- calls that are refused ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": {"x": 2}}, "no value for y"),
        ({"start": {"x": 2, "y": 0, "z": 0}}, '"z", which is no state'),
        ({"start": {"x": 2, "y": 0, "a": 0}}, '"a", which is a parameter that is not free'),
        ({"bounds": {"a": (0, 1)}}, "does not vary here"),
        ({"bounds": {"yy": (0, 1)}}, "does not vary here"),
        ({"bounds": {"x": (-1, 1)}}, "start is outside the bounds: x = 2"),
        ({"start": {"x": 2, "y": 0.0}, "bounds": {"x": (1.9, 3)}}, "next to start is outside"),
        ({"max_points": 1}, "max_points"),
        ({"free": "y", "parameter": "a"}, "one variable is free"),
    ],
)
def test_a_wrong_call_is_named(options, message) -> None:
    with pytest.raises(DeclarationError, match=message):
        continue_critical(systems.van_der_pol(), **{"start": {"x": 2, "y": 0.6}, **options})


def test_several_slow_variables_need_one_that_is_free() -> None:
    with pytest.raises(DeclarationError, match='free="y"'):
        continue_critical(systems.koper(), start={"x": 2, "y": 0.5, "z": 0.3})


def test_a_start_far_from_any_point_of_the_manifold_is_refused() -> None:
    with pytest.raises(BranchError, match=r"start is not on the critical manifold.*g = 1\.25"):
        continue_critical(one(y**2 + 1), start={"x": 0, "y": 0.5})


def test_a_start_at_a_branch_point_is_refused() -> None:
    with pytest.raises(BranchError, match="start is a branch point"):
        continue_critical(one(y * (y - x)), start={"x": 0, "y": 0})


def test_a_start_where_g_has_no_derivative_is_refused() -> None:
    with pytest.raises(BranchError, match="no finite derivatives at start"):
        continue_critical(one(y - sp.sqrt(x)), start={"x": 0, "y": 0})


@pytest.mark.exhaustive
def test_only_a_branch_point_of_the_curve_is_switched_at() -> None:
    curve = continue_critical(systems.van_der_pol(), start={"x": 2, "y": 0.6}, bounds={"x": (-3, 3)})
    with pytest.raises(DeclarationError, match="Got a fold"):
        switch_branch(curve, curve.special[0])
    again = continue_critical(systems.van_der_pol(), start={"x": 2, "y": 0.6}, bounds={"x": (-3, 3)})
    with pytest.raises(DeclarationError, match="none of the curve's special points"):
        switch_branch(curve, again.special[0])


def test_an_unknown_column_is_named() -> None:
    curve = continue_critical(one(y - x), start={"x": 0, "y": 0}, max_points=3)
    with pytest.raises(DeclarationError, match='no column "z"'):
        curve["z"]


def test_a_curve_that_runs_into_a_pole_beside_the_domain_of_a_logarithm_ends_there() -> None:
    """T -> infinity at x = -1, and beyond T < -1: between them the field is not finite, and nothing is sought."""
    T = y
    system = SlowFastSystem(
        slow={x: 1}, fast={T: 2 / (1 + x) - T * (1 + T**2 / 20) - sp.log(1 + T) / 5}, epsilon=eps
    )
    curve = continue_critical(system, start={"x": 0.1, "y": 1.2}, bounds={"x": (-1.225, 2.175)})
    assert curve.special == ()
    assert curve.points[:, 0].min() > -1.0
    assert "STEP_TOO_SMALL" in str(curve)


@pytest.mark.parametrize("rate", [10, 10**5, 10**9])
def test_points_have_their_names_whatever_contracts_much_faster(rate: int) -> None:
    u, v, z, q, eps = sp.symbols("u v z q epsilon")

    def named(slow: int, fast: dict, start: dict):
        system = SlowFastSystem(slow={x: slow}, fast=fast | {z: -z + u * q, q: -rate * q + u * z}, epsilon=eps)
        return kinds(continue_critical(system, start=start | {"z": 0, "q": 0}, bounds={"x": (-1, 1)}))

    rotating = {u: x * u - v - u**3, v: u + x * v - v**3}
    assert named(1, rotating, {"x": -1, "u": 0, "v": 0}) == [LossKind.HOPF]
    assert set(named(-1, {u: x - u**2}, {"x": 1, "u": 1})) == {LossKind.FOLD, LossKind.NEUTRAL_SADDLE}


def test_a_curve_far_from_the_origin_is_told_so_that_its_ends_are_told_apart() -> None:
    """It went from 999999 to 1e+06 and ended at 1e+06."""
    x, y, epsilon = sp.symbols("x y epsilon")
    c = 10**6
    system = gsp.SlowFastSystem(slow={x: c - y}, fast={y: x - c - (y - c) * 2}, epsilon=epsilon)
    bounds = {"x": (c - 1, c + 0.25), "y": (c - 3, c + 3)}
    text = str(gsp.continue_critical(system, start={"x": c, "y": c}, bounds=bounds))
    assert "x from 999999 to 1000000.25" in text
    assert "forward BOUND_REACHED at x = 1000000.25" in text


@pytest.mark.parametrize(
    "rates",
    [
        (y1 * (1 - y1) - (x + 1) * sp.sqrt(y1), y1 - y2),
        (y1 * y2 - (x + 1) * sp.sqrt(y1) - y1 / 2, 1 - y2 - y1 * y2),
    ],
    ids=["a herd", "a chemostat"],
)
@pytest.mark.parametrize("least", [-1, 0])
def test_a_curve_that_ends_with_the_domain_of_a_root_is_followed_up_to_there(rates, least: int) -> None:
    """At y1 = 0 there are no slopes, and beyond it there is nothing."""
    curve = continue_critical(
        several(*rates),
        start={"x": -0.9, "y1": 0.5, "y2": 0.6},
        bounds={"x": (-3, 1), "y1": (least, 1.1), "y2": (-1, 2)},
    )
    assert curve["y1"].min() < 1e-6
    assert [point.kind for point in curve.special] == [LossKind.FOLD]
    assert [s.unstable for s in curve.segments] == [0, 1]
