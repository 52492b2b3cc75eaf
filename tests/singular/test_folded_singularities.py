"""Folded singularities: published cases, the normal forms, the exact boundaries, and invariance under coordinates."""

import dataclasses

import pytest
import sympy as sp

import gsp
from gsp.algebra.algebraic_numbers import InfinitelyManyPoints
from gsp.errors import DeclarationError
from gsp.singular.singularities import located_points
from gsp.singular.singularities.desingularised import FoldedError, desingularise
from gsp.singular.singularities.folded_singularities import (
    FoldedKind,
    FoldedSingularity,
    folded_singularities,
    folded_singularity,
)
from tests.literature import FOLDER

x, y, z, u, eps = sp.symbols("x y z u epsilon")
h, s, v = sp.symbols("h s v")
R = sp.Rational


def normal_form(mu: sp.Expr) -> gsp.SlowFastSystem:
    """Wechselberger (2005): x' = mu/2 y - (mu + 1) z, y' = 1, epsilon z' = x + z^2; eigenvalues -1, -mu. z is fast."""
    return gsp.SlowFastSystem(slow={x: mu / 2 * y - (mu + 1) * z, y: 1}, fast={z: x + z**2}, epsilon=eps)


def planar_part(trace: sp.Expr, determinant: sp.Expr) -> gsp.SlowFastSystem:
    """The same with any trace and determinant."""
    return gsp.SlowFastSystem(slow={x: determinant / 2 * y + trace * z, y: 1}, fast={z: x + z**2}, epsilon=eps)


def koper(level: float) -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(
        slow={y: x - 2 * y + z, z: y - z}, fast={x: -10 * y - x**3 + 3 * x - level}, epsilon=eps
    )


def self_coupled() -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(
        slow={h: -(2 * h + R(13, 5) * v), s: -R(113, 200) * s},
        fast={v: h - (v**3 - v + 1) / 2 - s * v / 2},
        epsilon=eps,
    )


def only(system: gsp.SlowFastSystem, **region: tuple[float, float]) -> FoldedSingularity:
    found = folded_singularities(system, region=region)
    assert len(found) == 1
    return found[0]


# -- published cases ---------------------------------------------------------------------------------


def test_koper_has_a_folded_node_with_six_secondary_canards() -> None:
    node = only(koper(-7), x=(0, 2))
    assert node.kind is FoldedKind.NODE
    assert dict(node.point) == {"x": 1, "y": R(9, 10), "z": R(4, 5)}
    assert sp.simplify(node.mu - (5 - sp.sqrt(19)) / (5 + sp.sqrt(19))) == 0
    assert float(node.mu) == pytest.approx(0.06850176076554408, rel=1e-15)
    assert (node.s_max, node.secondary_canards) == (7, 6)
    assert node.to_repelling
    assert node.is_exact


@pytest.mark.parametrize(("level", "fold"), [(-8, 1), (8, -1)])
def test_koper_has_a_folded_saddle_node_of_type_two_where_the_equilibrium_meets_the_fold(level, fold) -> None:
    found = only(koper(level), x=(fold - 0.5, fold + 0.5))
    assert found.kind is FoldedKind.SADDLE_NODE_II
    assert dict(found.point) == {"x": fold, "y": fold, "z": fold}
    assert found.mu == 0
    assert found.eigenvalues == (-10, 0)


def test_koper_changes_from_node_to_saddle_through_that_saddle_node() -> None:
    kinds = [only(koper(level), x=(0, 2)).kind for level in (R(-79, 10), -8, R(-81, 10))]
    assert kinds == [FoldedKind.NODE, FoldedKind.SADDLE_NODE_II, FoldedKind.SADDLE]


def test_the_self_coupled_neuron_has_its_published_folded_node_in_a_cubic_field() -> None:
    node = only(self_coupled(), v=(-2, 2), h=(-2, 2), s=(-1, 2))
    assert node.kind is FoldedKind.NODE
    assert float(node["v"]) == pytest.approx(-0.49001, abs=5e-6)
    assert float(node["h"]) == pytest.approx(0.61766, abs=5e-6)
    assert float(node["s"]) == pytest.approx(0.27967, abs=5e-6)
    assert node.is_exact
    # On the fold s = 1 - 3 v^2 and h = (1 - 2 v^3)/2, so that q = 0 is a cubic in v.
    cubic = sp.expand((-2 * (1 - 2 * v**3) / 2 - R(13, 5) * v) + v * R(113, 400) * (1 - 3 * v**2))
    assert abs(sp.N(cubic.subs(v, node["v"]), 40)) < sp.Float("1e-35", 10)
    assert float(node.mu) == pytest.approx(0.018014782620064795, rel=1e-12)
    assert node.s_max == 28


# -- normal forms ------------------------------------------------------------------------------------


@pytest.mark.parametrize("mu", [R(1, 2), R(2, 7), R(1, 10), R(3, 100), R(1)])
def test_the_normal_form_has_the_ratio_it_is_written_with(mu: sp.Rational) -> None:
    node = only(normal_form(mu), z=(-1, 1))
    assert node.kind is FoldedKind.NODE
    assert node.mu == mu
    assert node.eigenvalues == (-1, -mu)
    assert node.s_max == sp.floor((mu + 1) / (2 * mu))
    assert node.secondary_canards == node.s_max - 1


@pytest.mark.exhaustive
@pytest.mark.parametrize("odd", [3, 5, 7, 9, 11, 49])
def test_at_one_over_an_odd_number_the_boundary_counts_exactly(odd: int) -> None:
    on = only(normal_form(R(1, odd)), z=(-1, 1))
    assert on.s_max == (odd + 1) // 2
    assert on.is_resonant
    tiny = R(1, 10**25)
    above, below = (only(normal_form(R(1, odd) + shift), z=(-1, 1)) for shift in (tiny, -tiny))
    assert (above.s_max, below.s_max) == ((odd - 1) // 2, (odd + 1) // 2)
    assert not above.is_resonant
    assert not below.is_resonant


def test_one_ninth_is_exact_for_irrational_coordinates_too() -> None:
    # M0 is x = z - 2 z^3/3 with its fold at r = sqrt(1/2); x' = 9/2 y - 10 (z^2 - r^2), y' = 2 z. There T = 20 r,
    # D = g_zz f.q_x = (-4 r)(2 r)(-9/2) = 18, and T^2/D = 100/9 = 9 + 2 + 1/9.
    system = gsp.SlowFastSystem(
        slow={x: R(9, 2) * y - 10 * (z**2 - R(1, 2)), y: 2 * z}, fast={z: -x + z - 2 * z**3 / 3}, epsilon=eps
    )
    node = only(system, z=(0, 1))
    assert node.is_exact
    assert node.kind is FoldedKind.NODE
    assert sp.simplify(node.trace**2 / node.determinant) == R(100, 9)
    assert node.s_max == 5
    assert node.is_resonant
    assert float(node.mu) == pytest.approx(1 / 9, rel=1e-14)


def test_a_negative_ratio_is_a_saddle_and_complex_ones_a_focus() -> None:
    saddle = only(normal_form(-R(1, 3)), z=(-1, 1))
    assert saddle.kind is FoldedKind.SADDLE
    assert saddle.eigenvalues == (-1, R(1, 3))
    assert (saddle.mu, saddle.s_max, saddle.secondary_canards) == (None, None, 0)
    focus = only(planar_part(-1, 5), z=(-1, 1))
    assert focus.kind is FoldedKind.FOCUS
    assert not focus.kind.has_canards
    assert {sp.im(e) for e in focus.eigenvalues} == {sp.sqrt(19) / 2, -sp.sqrt(19) / 2}


def test_a_node_with_positive_eigenvalues_has_faux_canards_only() -> None:
    node = only(planar_part(R(5, 4), R(1, 4)), z=(-1, 1))
    assert node.kind is FoldedKind.NODE
    assert (node.eigenvalues, node.s_max) == ((1, R(1, 4)), 2)
    assert not node.to_repelling
    assert node.secondary_canards == 0


def test_type_one_is_where_a_node_and_a_saddle_merge() -> None:
    def system(distance: sp.Expr) -> gsp.SlowFastSystem:
        return gsp.SlowFastSystem(slow={x: y**2 - distance - z, y: 1}, fast={z: x + z**2}, epsilon=eps)

    merged = only(system(0), z=(-1, 1))
    assert merged.kind is FoldedKind.SADDLE_NODE_I
    apart = folded_singularities(system(R(1, 1000)), region={"z": (-1, 1)})
    assert {p.kind for p in apart} == {FoldedKind.SADDLE, FoldedKind.NODE}
    assert folded_singularities(system(-R(1, 100)), region={"z": (-1, 1)}) == ()


@pytest.mark.parametrize(
    ("system", "reason"),
    [
        (planar_part(0, 1), "centre"),
        (gsp.SlowFastSystem(slow={x: y, y: z}, fast={z: x + z**2}, epsilon=eps), "both eigenvalues"),
        (gsp.SlowFastSystem(slow={x: y - z, y: 1}, fast={z: x + z**3}, epsilon=eps), "a cusp"),
    ],
)
def test_what_is_not_generic_is_named(system: gsp.SlowFastSystem, reason: str) -> None:
    found = only(system, z=(-1, 1))
    assert found.kind is FoldedKind.DEGENERATE
    assert reason in found.reason


# -- two routes --------------------------------------------------------------------------------------


@pytest.mark.parametrize("level", [-7, R(-15, 2), 3])
def test_the_eigenvalues_are_those_of_the_jacobian_of_the_desingularised_flow(level: sp.Expr) -> None:
    system = koper(level)
    flow = desingularise(system)
    for found in folded_singularities(system, region={"x": (-2, 2)}):
        values = {sp.Symbol(name): value for name, value in found.point.items()}
        jacobian = sp.Matrix(list(flow.rates.values())).jacobian(list(flow.rates)).subs(values)
        spectrum = sorted(
            (complex(e) for e in jacobian.eigenvals(multiple=True)), key=lambda e: (e.real, e.imag)
        )
        expected = sorted((complex(e) for e in (*found.eigenvalues, 0)), key=lambda e: (e.real, e.imag))
        assert spectrum == pytest.approx(expected, abs=1e-12)


def test_the_critical_manifold_is_invariant_under_the_desingularised_flow() -> None:
    flow = desingularise(self_coupled())
    assert sp.expand(sum(sp.diff(flow.g, symbol) * rate for symbol, rate in flow.rates.items())) == 0


@pytest.mark.exhaustive
def test_newton_s_method_and_algebra_agree() -> None:
    # cosh z - 1 has the fold of z^2/2; the sine keeps g_x f's derivatives at 0.
    analytic = gsp.SlowFastSystem(
        slow={x: R(1, 9) * y - R(10, 9) * sp.sin(z), y: sp.cos(z)},
        fast={z: x + sp.cosh(z) - 1},
        epsilon=eps,
    )
    node = only(analytic, x=(-1, 1), y=(-1, 1), z=(-1, 1))
    assert node.is_exact
    assert dict(node.point) == {"x": 0, "y": 0, "z": 0}
    assert (node.trace, node.determinant) == (-R(10, 9), R(1, 9))
    assert node.s_max == 5
    assert node.is_resonant


@pytest.mark.exhaustive
def test_newton_s_method_finds_what_algebra_finds_in_koper_s_model(monkeypatch: pytest.MonkeyPatch) -> None:
    box = {"x": (-2, 2), "y": (-3, 3), "z": (-3, 3)}
    exact = folded_singularities(self_coupled(), region={"v": (-2, 2), "h": (-2, 2), "s": (-1, 2)})
    koper_exact = folded_singularities(koper(-7), region=box)
    monkeypatch.setattr("gsp.algebra.algebraic_numbers.SOLUTION_LIMIT", 0)
    newton = folded_singularities(self_coupled(), region={"v": (-2, 2), "h": (-2, 2), "s": (-1, 2)})
    assert [p.is_exact for p in (*exact, *newton)] == [True, False]
    assert abs(sp.N(exact[0].mu, 50) - newton[0].mu) < sp.Float("1e-40", 10)
    found = folded_singularities(koper(-7), region=box)
    assert [(p.kind, dict(p.point), p.s_max) for p in found] == [
        (p.kind, dict(p.point), p.s_max) for p in koper_exact
    ]
    with pytest.raises(DeclarationError, match="no interval for y, z"):
        folded_singularities(koper(-7), region={"x": (-2, 2)})


@pytest.mark.exhaustive
def test_an_irrational_point_of_an_analytic_system_is_found_to_many_digits() -> None:
    moved = gsp.SlowFastSystem(
        slow={x: R(1, 9) * y - R(10, 9) * (z - 1), y: 1},
        fast={z: x + sp.exp(z) - 3 * z},
        epsilon=eps,
    )
    node = only(moved, x=(-1, 1), y=(-2, 2), z=(0, 2))
    assert not node.is_exact
    assert abs(node["z"] - sp.log(3)) < sp.Float("1e-50", 10)
    assert abs(node.determinant - R(1, 3)) < sp.Float("1e-50", 10)


# -- invariance --------------------------------------------------------------------------------------


@pytest.mark.exhaustive
@pytest.mark.parametrize("matrix", [sp.Matrix([[2, 1], [1, 1]]), sp.Matrix([[R(1, 3), -4], [5, R(7, 2)]])])
@pytest.mark.parametrize("scale", [1, -R(3, 2), 10])
def test_linear_changes_of_the_slow_and_scaling_of_the_fast_variable_change_nothing(matrix, scale) -> None:
    # (y, z) = M (p, q) + c and x = scale X, with g multiplied by 7 as well.
    p, q = sp.symbols("p q")
    old = matrix * sp.Matrix([p, q]) + sp.Matrix([1, R(-2, 3)])
    put_in = {y: old[0], z: old[1], x: scale * x}
    system = koper(-7)
    rates = matrix.inv() * system.f.xreplace(put_in)
    changed = gsp.SlowFastSystem(
        slow={p: sp.expand(rates[0]), q: sp.expand(rates[1])},
        fast={x: sp.expand(7 * system.g[0].xreplace(put_in) / scale)},
        epsilon=eps,
    )
    here = only(changed, x=(0, 2 / scale) if scale > 0 else (2 / scale, 0))
    node = only(system, x=(0, 2))
    assert here.kind is node.kind
    assert (here.s_max, here.secondary_canards, here.to_repelling) == (7, 6, True)
    assert sp.simplify(here.mu - node.mu) == 0
    place = {sp.Symbol(n): value for n, value in here.point.items()}
    assert [e.xreplace(put_in).subs(place) for e in (x, y, z)] == [1, R(9, 10), R(4, 5)]


# -- more slow variables -----------------------------------------------------------------------------


def test_with_three_slow_variables_a_held_one_gives_the_family_of_nodes() -> None:
    # u is a constant of motion, so that each value of it is the normal form with mu = u.
    system = gsp.SlowFastSystem(
        slow={x: u / 2 * y - (u + 1) * z, y: 1, u: 0 * x}, fast={z: x + z**2}, epsilon=eps
    )
    for mu, s_max in ((0.2, 3), (0.1, 5), (0.3, 2)):
        node = folded_singularity(system, near={"x": 0, "y": 0.1, "u": mu, "z": 0.1})
        assert node.mu == sp.Rational(str(mu))
        assert node.s_max == s_max
        assert node["u"] == sp.Rational(str(mu))
    with pytest.raises(FoldedError, match="dimension 1"):
        folded_singularities(system, region={"z": (-1, 1)})


def test_a_single_singularity_is_the_one_nearest_to_the_given_point() -> None:
    assert folded_singularity(koper(-7), near={"x": 0.9, "y": 1, "z": 1}).kind is FoldedKind.NODE
    assert folded_singularity(koper(-7), near={"x": -0.9, "y": 0, "z": 2}).kind is FoldedKind.FOCUS


# -- bad input ---------------------------------------------------------------------------------------


def test_folds_that_are_all_jumps_give_nothing() -> None:
    jump = gsp.SlowFastSystem(slow={x: 1 + y**2, y: 1}, fast={z: x + z**2}, epsilon=eps)
    assert folded_singularities(jump, region={"z": (-1, 1)}) == ()
    with pytest.raises(FoldedError, match="jump points"):
        folded_singularity(jump, near={"x": 0, "y": 0, "z": 0})


def test_the_region_is_respected() -> None:
    assert folded_singularities(koper(-7), region={"x": (2, 3)}) == ()
    assert len(folded_singularities(koper(-7), region={"x": (-2, 2)})) == 2
    assert len(folded_singularities(koper(-7), region={"x": (1, 2)})) == 1


@pytest.mark.parametrize(
    ("slow", "fast", "message"),
    [
        ({x: 1, y: 1}, {z: x}, "does not depend on z"),
        ({x: 1}, {z: x + z**2}, "canard_value"),
        ({x: z, y: z}, {z: x + z**2}, "not isolated"),
        ({x: 1, y: 1}, {z: x + z**2, u: -u}, "one fast variable. Got 2"),
    ],
)
def test_what_has_no_isolated_folded_singularities_is_refused(slow, fast, message: str) -> None:
    with pytest.raises(FoldedError, match=message):
        folded_singularities(gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=eps), region={"z": (-1, 1)})


def test_an_analytic_system_needs_an_interval_for_every_state() -> None:
    analytic = gsp.SlowFastSystem(slow={x: sp.exp(z), y: 1}, fast={z: x + z**2}, epsilon=eps)
    with pytest.raises(DeclarationError, match="no interval for x, y"):
        folded_singularities(analytic, region={"z": (-1, 1)})


def test_the_result_is_frozen_and_prints_its_ratio() -> None:
    node = only(normal_form(R(1, 9)), z=(-1, 1))
    with pytest.raises(dataclasses.FrozenInstanceError):
        node.s_max = 3  # type: ignore[misc]
    assert repr(node) == "FoldedSingularity(folded node at x = 0, y = 0, z = 0, mu = 0.111111)"
    assert "secondary canards: 4" in str(node)


@pytest.mark.exhaustive
def test_slow_rates_that_switch_elsewhere_change_nothing_at_a_folded_singularity() -> None:
    x, y, z, eps = sp.symbols("x y z epsilon")
    region = {"x": (-1, 1), "y": (-1, 1), "z": (-1, 1)}

    def found(gate: sp.Expr):
        slow = {y: -(z + 2 * x) * gate, z: gate / 10}
        return folded_singularities(
            gsp.SlowFastSystem(slow=slow, fast={x: y + x**2}, epsilon=eps), region=region
        )

    (smooth,) = found(sp.Integer(1))
    (gated,) = found((1 + sp.sign(x + sp.Rational(3, 2))) / 2)
    assert str(gated) == str(smooth)
    (switching,) = found(3 + sp.sign(x))
    assert switching.kind is FoldedKind.DEGENERATE
    assert switching.reason == "the rates are not smooth here, where sign(x) switches"


@pytest.mark.exhaustive
def test_where_branches_cross_along_a_curve_no_folded_singularities_are_told() -> None:
    """An epidemic with slow loss of immunity: infected and healthy equilibria meet along a curve, which is no fold."""
    found = gsp.study(gsp.load(FOLDER / "sirs.toml"))
    box = {"p1": (-0.1, 0.1), "p2": (0.1, 0.3), "r": (-0.7, 0.7)}
    with pytest.raises(FoldedError, match="not isolated"):
        gsp.folded_singularities(found.system, region=box)


@pytest.mark.parametrize("crossing", [3 - z, (3 - z) / (1 + z**2), (3 - z) * (4 + x + z)])
def test_a_sheet_that_another_one_crosses_keeps_its_folded_singularities(crossing: sp.Expr) -> None:
    alone = normal_form(R(1, 9))
    crossed = gsp.SlowFastSystem(slow=alone.slow, fast={z: alone.fast[z] * crossing}, epsilon=eps)
    (node,) = folded_singularities(crossed, region={"z": (-1, 1)})
    (same,) = folded_singularities(alone, region={"z": (-1, 1)})
    assert (node.kind, node.mu, dict(node.point)) == (same.kind, R(1, 9), dict(same.point))
    # A factor that is below 0 turns the sides round.
    turned = gsp.SlowFastSystem(slow=alone.slow, fast={z: -alone.fast[z] * crossing}, epsilon=eps)
    assert only(turned, z=(-1, 1)).to_repelling is not same.to_repelling


def test_two_fast_prey_with_an_axis_have_a_folded_node() -> None:
    p, q, n = sp.symbols("p q n")
    meals = n / (n + R(3, 10))
    slow = {p: p * (R(2, 5) * meals - R(1, 5)), q: q * (R(3, 10) * meals - R(3, 20) - q / 10)}
    prey = n * (1 - n - (R(2, 5) * p + R(3, 10) * q) / (n + R(3, 10)))
    system = gsp.SlowFastSystem(slow=slow, fast={n: prey}, epsilon=eps)
    (node,) = folded_singularities(system, region={"p": (0, 1), "q": (0, 1), "n": (0, 1)})
    # On the fold n = 7/20 and 2 p/5 + 3 q/10 = 169/400; q = g_x . f leaves 3 q^2/100 + 3 q/2600 = 13/2000.
    at = float(-R(3, 2600) + sp.sqrt(R(3, 2600) ** 2 + 4 * R(3, 100) * R(13, 2000))) / 0.06
    assert float(node.point["q"]) == pytest.approx(at, rel=1e-12)
    assert float(node.point["p"]) == pytest.approx((0.4225 - 0.3 * at) / 0.4, rel=1e-12)
    # The ratio of the eigenvalues of the desingularised flow's Jacobian, by mpmath.
    assert float(node.mu) == pytest.approx(0.07886665, rel=1e-7)


def test_solutions_along_a_curve_are_not_gone_through_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of exp(x) = 1 + y all along, a second equation or its multiple; a double root alone is a point."""
    x, y = sp.symbols("x y")
    curve = sp.exp(x) - 1 - y
    polished = []
    polish = located_points.polish
    monkeypatch.setattr(located_points, "polish", lambda *a, **k: polished.append(a) or polish(*a, **k))
    starts = [(0.1 * k, 0.3) for k in range(-5, 6)]
    with pytest.raises(InfinitelyManyPoints, match="not isolated"):
        located_points.locate([curve, curve * (2 + sp.cos(y))], [x, y], starts=starts)
    assert not polished
    (point,) = located_points.locate([curve, (x - y) ** 2], [x, y], starts=starts)
    assert all(abs(float(value)) < 1e-6 for value in point.numbers().values())


def test_a_step_that_leads_beyond_all_numbers_is_no_point() -> None:
    """y (x - exp(z) - y) = 0: where its branches cross all slopes are singular, and exp of a step overflows."""
    x, y, z, epsilon = sp.symbols("x y z epsilon")
    system = gsp.SlowFastSystem(slow={x: 1 - y, z: x / 2}, fast={y: y * (x - sp.exp(z) - y)}, epsilon=epsilon)
    try:
        found = gsp.folded_singularities(system, region={"x": (0.5, 3), "z": (-0.5, 1), "y": (-1, 1)})
    except FoldedError:
        return
    assert all("critical manifold is singular" in each.reason for each in found)
