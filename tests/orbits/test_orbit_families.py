"""Families of cycles: exact folds and branch points, the canard explosion against the canard value, the endings."""

import math

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp import charts
from gsp.errors import BranchError, DeclarationError, Status
from gsp.orbits.periodic.family import CycleKind

x, y, z, w, a, mu, eps = sp.symbols("x y z w a mu epsilon")
SQUARE = x**2 + y**2


def van_der_pol(value: float = 1.1) -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=eps, parameters={a: value})


def hopf(epsilon: float) -> gsp.HopfPoint:
    (found,) = gsp.hopf_points(
        van_der_pol(), start={"x": 1.1, "y": -0.6}, parameter="a", bounds=(0.5, 1.5), epsilon=epsilon
    )
    return found


def bautin() -> gsp.VectorField:
    """r' = r (mu + r^2 - r^4): subcritical at mu = 0, a fold of cycles at mu = -1/4, r^2 = 1/2."""
    factor = mu + SQUARE - SQUARE**2
    return gsp.VectorField({x: x * factor - y, y: y * factor + x}, epsilon=None, parameters={mu: -1})


def with_rotation(extra) -> gsp.VectorField:
    """An attracting unit circle with period 2 pi, and more states."""
    rates = {x: x * (1 - SQUARE) - y, y: y * (1 - SQUARE) + x, **extra}
    return gsp.VectorField(rates, epsilon=None, parameters={mu: -1})


@pytest.fixture(scope="module")
def explosion():
    return gsp.continue_orbits(hopf(0.01), bounds=(0.9, 1.1))


# -- Hopf points -------------------------------------------------------------------------------------


def test_hopf_points_of_the_full_system() -> None:
    found = gsp.hopf_points(
        van_der_pol(), start={"x": 1.1, "y": -0.6}, parameter=a, bounds=(-1.5, 1.5), epsilon=0.01
    )
    assert [point.value for point in found] == pytest.approx([-1, 1], abs=1e-12)
    assert all(point.omega == pytest.approx(10, rel=1e-10) and point.l1 < 0 for point in found)
    neuron = gsp.models.load("fitzhugh_nagumo").system
    first = gsp.hopf_points(
        neuron, start={"v": -1.2, "w": -0.6}, parameter="I", bounds=(-0.5, 1), epsilon=0.08
    )[0]
    assert first.value == pytest.approx(0.33128133745474581144, abs=1e-12)
    assert first.l1 > 0
    assert "HopfPoint(I = 0.33128133745" in repr(first)


@pytest.mark.exhaustive
@pytest.mark.parametrize("start", [(-30, 0), (-30, 0.1), (-60, 0), (30, 0.9), (8, 0.4)])
def test_hopf_points_are_on_the_curve_through_the_equilibrium_at_the_flows_own_parameter(start) -> None:
    # Morris and Lecar's saddle-node set: at I = 90 there is one equilibrium, and a fold of the curve at I = 39.96 is
    # nearer to most starts.
    v, w, current, epsilon = sp.symbols("v w I epsilon")
    m, n = (1 + sp.tanh((v + sp.Rational(6, 5)) / 18)) / 2, (1 + sp.tanh(5 * (v - 12) / 87)) / 2
    system = gsp.SlowFastSystem(
        slow={w: (n - w) * sp.cosh(5 * (v - 12) / 174)},
        fast={v: (current - 2 * (v + 60) - 8 * w * (v + 84) - 4 * m * (v - 120)) / 20},
        epsilon=epsilon,
        parameters={current: 90},
    )
    at = {"v": start[0], "w": start[1]}
    (found,) = gsp.hopf_points(system, start=at, parameter="I", bounds=(0, 300), epsilon=1 / 15)
    assert found.value == pytest.approx(97.787888964, rel=1e-9)


@pytest.mark.parametrize(
    "units", [(1, 1), (10**6, sp.Rational(1, 10**6)), (sp.Rational(1, 10**6), 10**6), (10**9, 1)]
)
def test_a_hopf_point_at_the_origin_is_found_in_any_units(units) -> None:
    # The states are 0 and tell no size: what balances their Jacobian does.
    m = sp.Symbol("m")
    within = {x: x / units[0], y: y / units[1]}
    rates = (m * x - y - x * (x**2 + y**2), x + m * y - y * (x**2 + y**2))
    field = gsp.VectorField(
        {s: unit * rate.xreplace(within) for s, unit, rate in zip((x, y), units, rates)},
        parameters={m: sp.Rational(1, 5)},
    )
    (found,) = gsp.hopf_points(field, start={"x": 0, "y": 0}, parameter=m, bounds=(-1, 1))
    assert (found.value, found.omega) == (pytest.approx(0.0, abs=1e-12), pytest.approx(1.0))
    assert found.l1 < 0.0


def test_a_curve_that_ends_before_the_bounds_without_a_hopf_point_is_named() -> None:
    x, y, mu, epsilon = sp.symbols("x y mu epsilon")
    system = gsp.SlowFastSystem(slow={y: -y}, fast={x: sp.sqrt(mu) - x}, epsilon=epsilon, parameters={mu: 1})
    with pytest.raises(
        BranchError, match=r"no Hopf point was found, and .* not followed to the bounds: .* mu ="
    ):
        gsp.hopf_points(system, start={"x": 1, "y": 0}, parameter="mu", bounds=(-1, 2), epsilon=1)
    assert gsp.hopf_points(system, start={"x": 1, "y": 0}, parameter="mu", bounds=(0.5, 2), epsilon=1) == ()


def test_small_cycles_grow_as_the_normal_form_says() -> None:
    start = hopf(0.1)
    family = gsp.continue_orbits(start, bounds=(0.99, 1.01), max_points=4)
    shift = np.abs(family["a"] - 1)
    # lambda - lambda_H = -l1 omega rho^2/crossing, and x has the amplitude 4 rho |q_x|.
    rho = family.amplitude("x") / (4 * abs(start.vector[1]))
    expected = abs(start.l1 * start.omega / start.crossing) * rho**2
    assert shift[0] == pytest.approx(expected[0], rel=1e-3)
    assert shift[2] == pytest.approx(expected[2], rel=1e-2)


# -- families known exactly --------------------------------------------------------------------------


def test_a_fold_of_cycles_is_passed_and_located() -> None:
    (start,) = gsp.hopf_points(bautin(), start={"x": 0, "y": 0}, parameter="mu", bounds=(-2, 1))
    family = gsp.continue_orbits(start, bounds=(-2, 1))
    (fold,) = family.special
    assert fold.kind is CycleKind.FOLD
    assert fold.orbit.parameters["mu"] == pytest.approx(-0.25, abs=1e-12)
    assert family.orbits[fold.row] is fold.orbit
    assert family.period == pytest.approx(2 * math.pi, rel=1e-12)
    squared = (family.amplitude("x") / 2) ** 2
    assert family["mu"] == pytest.approx(squared**2 - squared, abs=1e-8)
    assert (family.unstable[: fold.row] == 1).all()
    assert (family.unstable[fold.row + 1 :] == 0).all()
    assert family.status is Status.BOUND_REACHED
    assert family["mu"][-1] == 1
    assert (np.diff(family.arclength) > 0).all()
    # A plain fold is no explosion.
    assert family.explosions == ()


def test_the_multiplier_along_a_family_is_liouvilles() -> None:
    (start,) = gsp.hopf_points(bautin(), start={"x": 0, "y": 0}, parameter="mu", bounds=(-2, 1))
    family = gsp.continue_orbits(start, bounds=(-2, 1))
    for orbit in family.orbits[::4]:
        squared = (orbit.amplitude["x"] / 2) ** 2
        exact = 2 * math.pi * (2 * squared - 4 * squared**2)
        assert orbit.divergence == pytest.approx(exact, abs=1e-7)
        assert orbit.multipliers[1].real == pytest.approx(math.exp(exact), rel=1e-6)


def test_a_pitchfork_of_cycles_is_a_branch_point() -> None:
    flow = with_rotation({z: mu * z - z**3})
    orbit = gsp.periodic_orbit(flow, start={"x": 1, "y": 0, "z": 0.3})
    family = gsp.continue_orbits(orbit, parameter="mu", bounds=(-1.5, 1))
    (point,) = family.special
    assert point.kind is CycleKind.BRANCH_POINT
    assert point.orbit.parameters["mu"] == pytest.approx(0, abs=1e-10)


def test_a_torus_bifurcation() -> None:
    turning = {
        z: mu * z - w / 3 - z * (z**2 + w**2),
        w: mu * w + z / 3 - w * (z**2 + w**2),
    }
    orbit = gsp.periodic_orbit(with_rotation(turning), start={"x": 1, "y": 0, "z": 0, "w": 0}, period=6.3)
    family = gsp.continue_orbits(orbit, parameter=mu, bounds=(-1.5, 1))
    (point,) = family.of_kind(CycleKind.TORUS)
    assert point.orbit.parameters["mu"] == pytest.approx(0, abs=1e-10)
    assert family.unstable[-1] == 2


def test_roesslers_first_period_doubling() -> None:
    c = sp.Symbol("c")
    flow = gsp.VectorField(
        {x: -y - z, y: x + y / 5, z: sp.Rational(1, 5) + z * (x - c)}, epsilon=None, parameters={c: 2.5}
    )
    orbit = gsp.periodic_orbit(flow, start={"x": 1, "y": 1, "z": 0})
    family = gsp.continue_orbits(orbit, parameter="c", bounds=(1, 4))
    (point,) = family.special
    assert point.kind is CycleKind.PERIOD_DOUBLING
    value = point.orbit.parameters["c"]
    assert value == pytest.approx(2.8324450, abs=1e-6)
    # By shooting, from the orbit at that value found afresh.
    fresh = gsp.periodic_orbit(flow.with_parameters(c=value), start=orbit)
    assert fresh.multipliers[1].real == pytest.approx(-1, abs=1e-6)
    assert gsp.shoot(fresh).period == pytest.approx(point.orbit.period, rel=1e-11)


# -- the canard explosion ----------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_van_der_pols_explosion_from_the_hopf_point_to_relaxation(explosion) -> None:
    assert explosion.status is Status.BOUND_REACHED
    assert explosion["a"][-1] == 0.9
    (found,) = explosion.explosions
    assert found.value == pytest.approx(0.998740451245955573, abs=1e-11)
    assert found.value == pytest.approx(
        float(gsp.canard_value(van_der_pol(), parameter=a).value(0.01)), abs=1e-11
    )
    # Cycles without a head stay right of the left fold, those with one go round it, and the period is longest between.
    least, longest = explosion.minimum("x"), int(np.argmax(explosion.period))
    assert (least[:longest] > -1.1).sum() > 10
    assert (least[longest + 1 :] < -1).all()
    during = np.abs(explosion["a"] - found.value) < 1e-10
    without, with_head = during & (least > -0.9), during & (least < -1.1)
    assert without.sum() >= 5
    assert with_head.sum() >= 5
    assert explosion.amplitude("x")[during].max() > 3.8
    # Krupa and Szmolyan: every cycle of this explosion is stable; the multiplier is exp of the divergence.
    assert (explosion.unstable == 0).all()
    assert not explosion.special
    # The mesh moves with the layers; without that five times as many steps are needed.
    assert explosion.stats.steps < 100
    assert explosion.stats.intervals < 200


@pytest.mark.exhaustive
@pytest.mark.parametrize(("epsilon", "accuracy"), [(0.1, 2e-5), (0.05, 2e-9)])
def test_explosions_where_the_series_has_fewer_digits(epsilon: float, accuracy: float) -> None:
    family = gsp.continue_orbits(hopf(epsilon), bounds=(0.9, 1.1))
    (found,) = family.explosions
    value = next(_values(gsp.canard_value(van_der_pol(), parameter=a), epsilon))
    assert found.value == pytest.approx(value, abs=accuracy)
    assert (family.unstable == 0).all()


def _values(canard, epsilon):
    for digits in range(12, 1, -1):
        try:
            yield float(canard.value(epsilon, digits=digits))
        except gsp.GspError:
            continue


@pytest.mark.exhaustive
def test_the_explosion_is_the_same_from_the_side_of_relaxation(explosion) -> None:
    orbit = gsp.periodic_orbit(van_der_pol(0.9), start={"x": 2, "y": 0}, epsilon=0.01)
    assert orbit.period == pytest.approx(explosion.period[-1], rel=1e-10)
    back = gsp.continue_orbits(orbit, parameter="a", bounds=(0.5, 1.1))
    assert back.status is Status.EQUILIBRIUM_REACHED
    assert back["a"][-1] == pytest.approx(1, abs=1e-5)
    assert back.explosions[0].value == pytest.approx(explosion.explosions[0].value, abs=1e-10)


@pytest.mark.exhaustive
def test_an_orbit_of_the_explosion_at_a_tighter_tolerance_has_the_same_parameter(explosion) -> None:
    tight = gsp.continue_orbits(hopf(0.01), bounds=(0.9, 1.1), tolerance=1e-11, max_points=40)
    at = np.interp(2.5, tight.amplitude("x"), tight["a"])
    assert at == pytest.approx(0.998740451245955573, abs=1e-12)


@pytest.mark.exhaustive
def test_fitzhugh_nagumo_from_hopf_point_to_hopf_point() -> None:
    neuron = gsp.models.load("fitzhugh_nagumo").system
    first, second = gsp.hopf_points(
        neuron, start={"v": -1.2, "w": -0.6}, parameter="I", bounds=(-0.5, 3), epsilon=0.05
    )
    family = gsp.continue_orbits(first, bounds=(0, 2))
    assert family.status is Status.EQUILIBRIUM_REACHED
    assert family["I"][-1] == pytest.approx(second.value, abs=1e-4)
    # (v, w, I) -> (-v, -w + 7/4, 7/4 - I) is a symmetry.
    lower, upper = (special.orbit.parameters["I"] for special in family.of_kind(CycleKind.FOLD))
    assert lower + upper == pytest.approx(1.75, abs=1e-8)
    # Subcritical: unstable canard cycles as far as the fold.
    rows = [special.row for special in family.special]
    assert (family.unstable[: rows[0]] == 1).all()
    assert (family.unstable[rows[0] + 1 : rows[1]] == 0).all()
    value = next(_values(gsp.canard_value(neuron, parameter="I"), 0.05))
    assert family.explosions[0].value == pytest.approx(value, abs=1e-8)


def test_a_family_in_epsilon_towards_the_singular_limit() -> None:
    orbit = gsp.periodic_orbit(van_der_pol(0), start={"x": 2, "y": 0}, epsilon=0.01)
    family = gsp.continue_orbits(orbit, parameter=eps, bounds=(1e-4, 0.5), direction=-1)
    assert family.status is Status.BOUND_REACHED
    assert family["epsilon"][-1] == 1e-4
    assert family.orbits[-1].epsilon == 1e-4
    # mu = 100; in slow time periods are over mu.
    assert family.period[-1] * 100 == pytest.approx(162.83707109237001, rel=1e-11)
    assert family.epsilon is None
    assert gsp.shoot(family.orbits[-1]).period == pytest.approx(family.period[-1], rel=1e-11)
    with pytest.raises(DeclarationError, match="epsilon is positive"):
        gsp.continue_orbits(orbit, parameter="epsilon", bounds=(0, 0.5))


# -- endings and wrong calls -------------------------------------------------------------------------


def test_a_homoclinic_orbit_ends_a_family_by_its_period() -> None:
    flow = gsp.VectorField({x: y, y: mu * y + x - x**2 + x * y}, epsilon=None, parameters={mu: -0.95})
    (start,) = gsp.hopf_points(flow, start={"x": 1, "y": 0}, parameter="mu", bounds=(-1.5, -0.5))
    family = gsp.continue_orbits(start, bounds=(-1.5, -0.5), max_period=100)
    assert family.status is Status.PERIOD_GROWS
    assert "homoclinic" in family.message
    # At the end the parameter has converged: exponentially in the period.
    assert abs(np.diff(family["mu"])[-1]) < 1e-10


def test_points_used_up() -> None:
    family = gsp.continue_orbits(hopf(0.1), bounds=(0.9, 1.1), max_points=5)
    assert family.status is Status.TOO_MANY_POINTS
    assert len(family) == 5
    assert "raise max_points" in family.message
    last = family.orbits[-1]
    assert (
        f"{family.parameter} = {last.constants[family.parameter]:.6g}, period {last.period:.6g}"
        in family.message
    )


def test_a_family_reads_by_name(explosion) -> None:
    assert "OrbitFamily(" in repr(explosion)
    card = str(explosion)
    assert "from the Hopf point at a = 1" in card
    assert "explosion at a = 0.99874045" in card
    with pytest.raises(DeclarationError, match="no parameter 'b'"):
        explosion["b"]
    with pytest.raises(DeclarationError, match="'u' is no state"):
        explosion.amplitude("u")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"bounds": (1.2, 1.1)}, "reversed"),
        ({"bounds": (0.2, 0.5)}, "outside the bounds"),
        ({"parameter": "b"}, "no parameter 'b'. The parameters are a"),
        ({"max_points": 1}, "max_points"),
    ],
)
def test_wrong_calls_say_what_is_wrong(options, said: str) -> None:
    with pytest.raises(DeclarationError, match=said):
        gsp.continue_orbits(hopf(0.1), **{"bounds": (0.9, 1.1), **options})


def test_an_orbit_needs_the_name_of_the_parameter_and_a_status_of_success() -> None:
    orbit = gsp.periodic_orbit(van_der_pol(0), start={"x": 2, "y": 0}, epsilon=0.1)
    with pytest.raises(DeclarationError, match="name the parameter"):
        gsp.continue_orbits(orbit, bounds=(-1, 1))
    coarse = gsp.periodic_orbit(van_der_pol(0), start={"x": 2, "y": 0}, epsilon=0.01, max_intervals=20)
    with pytest.raises(DeclarationError, match="MESH_LIMIT"):
        gsp.continue_orbits(coarse, parameter="a", bounds=(-1, 1))


def test_cycles_around_a_centre_are_a_family_at_one_value() -> None:
    # r' = mu r: every cycle is at mu = 0, and the arclength is all in the cycle.
    flow = gsp.VectorField({x: mu * x - y, y: mu * y + x}, epsilon=None, parameters={mu: -1})
    (start,) = gsp.hopf_points(flow, start={"x": 0, "y": 0}, parameter="mu", bounds=(-2, 1))
    family = gsp.continue_orbits(start, bounds=(-2, 1), max_points=8)
    assert family["mu"] == pytest.approx(0, abs=1e-12)
    assert (np.diff(family.amplitude("x")) > 0).all()


# -- charts ------------------------------------------------------------------------------------------


def test_the_explosion_is_drawn_with_its_inset_and_its_cycles(explosion) -> None:
    axes = charts.canard_explosion(explosion, canard=gsp.canard_value(van_der_pol(), parameter=a))
    assert axes.get_xlabel() == "$a$"
    assert "amplitude" in axes.get_ylabel()
    (inset,) = axes.child_axes
    assert "0.99874045125" in inset.get_title()
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"stable", "Hopf point", "canard value"} <= set(labels)
    plane = charts.canard_cycles(explosion)
    assert (plane.get_xlabel(), plane.get_ylabel()) == ("$x$", "$y$")
    assert len(plane.lines) >= 9
    assert charts.png(axes).startswith(b"\x89PNG")
    other = gsp.canard_value(gsp.models.load("fitzhugh_nagumo").system, parameter="I")
    with pytest.raises(DeclarationError, match="canard value is one of I"):
        charts.canard_explosion(explosion, canard=other)


def test_a_family_without_epsilon_is_drawn_too() -> None:
    (start,) = gsp.hopf_points(bautin(), start={"x": 0, "y": 0}, parameter="mu", bounds=(-2, 1))
    family = gsp.continue_orbits(start, bounds=(-2, 1))
    axes = charts.canard_explosion(family)
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"stable", "unstable", "fold of cycles"} <= set(labels)
    assert not axes.child_axes
    assert charts.canard_cycles(family).get_ylabel() == "$y$"
