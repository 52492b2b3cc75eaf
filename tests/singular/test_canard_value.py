"""Canard values: published coefficients, theorems on random systems, and slow manifolds matched by integration."""

import dataclasses
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError, GspError
from gsp.singular.singularities.canard_matching import match_canard
from gsp.singular.singularities.canard_points import CanardError
from gsp.singular.singularities.canard_value import CanardValue, canard_value
from gsp.singular.singularities.fold_starts import fold_starts
from gsp.singular.singularities.located_points import polish

x, y, a, eps = sp.symbols("x y a epsilon")
v, w, current = sp.symbols("v w I")
R = sp.Rational
# x is fast and y slow throughout, as in van der Pol's equation.


def planar(fast: sp.Expr, slow: sp.Expr, **parameters: float) -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(
        slow={y: slow}, fast={x: fast}, epsilon=eps, parameters={sp.Symbol(n): p for n, p in parameters.items()}
    )


def van_der_pol(value: float = 1) -> gsp.SlowFastSystem:
    return planar(y - x**3 / 3 + x, a - x, a=value)


def fitzhugh_nagumo() -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(
        slow={w: v + 0.7 - sp.Rational(4, 5) * w},
        fast={v: v - v**3 / 3 - w + current},
        epsilon=eps,
        parameters={current: 0},
    )


# -- the classical cases -----------------------------------------------------------------------------


def test_van_der_pol_has_the_published_coefficients() -> None:
    canard = canard_value(van_der_pol(), parameter=a, order=10)
    published = (1, "-1/8", "-3/32", "-173/1024", "-7593/16384")
    assert canard.coefficients[:5] == tuple(sp.Rational(c) for c in published)
    assert canard.coefficients[10] == sp.Rational(-1485473230701825, 137438953472)
    assert len(canard.coefficients) == 11
    assert canard.is_exact
    assert dict(canard.point) == {"y": sp.Rational(-2, 3), "x": 1, "a": 1}


def test_van_der_pol_has_its_hopf_point_at_one_for_every_epsilon() -> None:
    canard = canard_value(van_der_pol(), parameter="a", order=5)
    assert canard.hopf_coefficients == (1, 0, 0, 0, 0, 0)


def test_the_value_at_a_hundredth_is_right_to_25_digits() -> None:
    value = canard_value(van_der_pol(), parameter=a).value(0.01, digits=25)
    assert abs(value - sp.Float("0.99874045124595557658620761797", 30)) < sp.Float("1e-25", 10)


def test_the_value_does_not_depend_on_the_order_that_was_asked_for() -> None:
    values = {canard_value(van_der_pol(), parameter=a, order=n).value(0.02, digits=18) for n in (0, 3, 12)}
    assert len(values) == 1


def test_fitzhugh_nagumo_in_slow_time() -> None:
    canard = canard_value(fitzhugh_nagumo(), parameter=current)
    exact = ("7/24", "13/32", "-19/9600", "20789/512000", "27443677/368640000")
    assert canard.coefficients == tuple(sp.Rational(c) for c in exact)
    assert canard.point["v"] == -1
    assert sp.N(_hopf_of(sp.Rational(2, 25)), 15) == pytest.approx(0.33128133745474581144, abs=1e-15)
    series = [sp.diff(_hopf_of(eps), eps, k).subs(eps, 0) / sp.factorial(k) for k in range(5)]
    assert canard.hopf_coefficients == tuple(sp.nsimplify(c) for c in series)


def _hopf_of(epsilon: sp.Expr) -> sp.Expr:
    # The trace condition solved in closed form: 1 - v^2 = 0.8 epsilon on the equilibria.
    rest = -sp.sqrt(1 - sp.Rational(4, 5) * epsilon)
    return (rest + sp.Rational(7, 10)) * sp.Rational(5, 4) - rest + rest**3 / 3


# -- theorems ----------------------------------------------------------------------------------------


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(4))
def test_the_krupa_szmolyan_formulas_hold_for_their_normal_form(seed: int) -> None:
    # lambda_H = -(a1 + a5)/2 epsilon, lambda_c = -((a1 + a5)/2 + A/8) epsilon, A = -a2 + 3 a3 - 2 a4 - 2 a5
    # (2001, theorems 3.1 and 3.2), in their variables: x fast, y slow.
    numbers = [sp.Rational((7 * seed + 5 * i) % 11 - 5, 2 + (seed + i) % 4) for i in range(9)]
    a1, a2, a3, a4, a5, *rest = numbers
    fast = -y * (1 + a2 * x + rest[0] * y) + x**2 * (1 + a3 * x + rest[1] * x**2) + eps * (a1 * x + rest[2] * y)
    slow = x * (1 + a4 * x + rest[3] * eps) - a * (1 + rest[3] * x) + a5 * y
    canard = canard_value(planar(fast, slow, a=0), parameter=a, order=2, near={"x": 0, "y": 0, "a": 0})
    A = -a2 + 3 * a3 - 2 * a4 - 2 * a5
    assert canard.hopf_coefficients[:2] == (0, -(a1 + a5) / 2)
    assert canard.coefficients[:2] == (0, -((a1 + a5) / 2 + A / 8))


def test_a_canard_that_is_a_parabola_for_every_epsilon_ends_its_series() -> None:
    # y = x^2 - epsilon/2 is invariant for a = 0 exactly; the parameter b adds b epsilon to it.
    canard = canard_value(planar(y - x**2, a - x, a=0.3), parameter=a, order=6)
    assert canard.coefficients == (0,) * 7
    assert float(canard.value(0.1)) == 0.0
    shifted = canard_value(planar(y - x**2, a - x + 3 * eps, a=0.3), parameter=a, order=6)
    assert shifted.coefficients == (0, -3, 0, 0, 0, 0, 0)


def test_affine_changes_of_both_variables_and_of_the_parameter_change_nothing_but_the_parameter() -> None:
    # x = 2 X - 1, y = 3 - 5 Y, a = 7 b + 2 (epsilon is kept: epsilon X' = g/2, Y' = -f/5).
    put_in = {x: 2 * x - 1, y: 3 - 5 * y, a: 7 * a + 2}
    fast = (y - x**3 / 3 + x).subs(put_in, simultaneous=True) / 2
    slow = -(a - x).subs(put_in, simultaneous=True) / 5
    changed = canard_value(planar(fast, slow, a=0), parameter=a, order=6)
    plain = canard_value(van_der_pol(), parameter=a, order=6)
    assert 7 * changed.coefficients[0] + 2 == plain.coefficients[0]
    assert tuple(7 * c for c in changed.coefficients[1:]) == plain.coefficients[1:]


def test_a_fixed_factor_of_epsilon_scales_the_coefficients_by_its_powers() -> None:
    plain = canard_value(van_der_pol(), parameter=a, order=5).coefficients
    scaled = canard_value(planar((y - x**3 / 3 + x) / 3, a - x, a=1), parameter=a, order=5).coefficients
    assert scaled == tuple(c * 3**k for k, c in enumerate(plain))


def test_elementary_functions_at_a_rational_fold_are_exact_and_agree_with_their_taylor_polynomials() -> None:
    # Coefficient k sees the equations through the power 2 k + 2 of the fast variable.
    transcendental = canard_value(planar(y - sp.exp(x) + x, a - sp.sin(x), a=0.1), parameter=a, order=3)
    taylor = [
        sum(c * x**k for k, c in enumerate(s)) for s in ([1 / sp.factorial(k) for k in range(11)], _sine(11))
    ]
    polynomial = canard_value(
        planar(y - taylor[0] + x, a - taylor[1], a=0.1), parameter=a, order=3, near={"x": 0, "y": 1, "a": 0}
    )
    assert transcendental.is_exact
    assert transcendental.coefficients == polynomial.coefficients
    assert transcendental.coefficients[1] != 0


def _sine(length: int) -> list[sp.Expr]:
    return [sp.Integer((0, 1, 0, -1)[k % 4]) / sp.factorial(k) for k in range(length)]


def test_an_algebraic_fold_is_solved_in_its_number_field() -> None:
    canard = canard_value(planar(y - x**3 / 3 + 2 * x, a - x, a=1), parameter=a, order=3)
    root = sp.sqrt(2)
    assert canard.coefficients[0] == root
    # x = sqrt(2) X, y = 2 sqrt(2) Y, a = sqrt(2) A, t = 2 s, epsilon = 4 delta bring back van der Pol's equation.
    plain = canard_value(van_der_pol(), parameter=a, order=3).coefficients
    assert canard.coefficients == tuple(root * c / 4**k for k, c in enumerate(plain))
    assert canard.is_exact
    numerical = canard.value(sp.Rational(1, 50), digits=12)
    assert abs(numerical - sp.N(canard.partial_sum(sp.Rational(1, 50)), 15)) < 1e-6


def test_a_root_that_is_rational_at_an_algebraic_fold_stays_in_its_number_field() -> None:
    # sqrt(x^2 + 2) is 2 at x = sqrt(2); its Taylor polynomial there is rational in w = x^2 - 2.
    w = x**2 - 2
    roots = (sp.sqrt(x**2 + 2), 2 + w / 4 - w**2 / 64 + w**3 / 512)
    with_root, plain = (
        canard_value(planar(y - x**3 / 3 + 2 * x, a - x + eps * root, a=1), parameter=a, order=2)
        for root in roots
    )
    assert with_root.is_exact
    assert with_root.coefficients == plain.coefficients


def test_a_transcendental_fold_gives_floats_and_says_so() -> None:
    # The fold of y = exp(x) - 2 x is at log 2; g = y - exp(x) + 2 x with x = u + log 2 is y - 2 exp(u) + 2 u + c.
    canard = canard_value(planar(y - sp.exp(x) + 2 * x, a - x, a=0.5), parameter=a, order=3)
    moved = canard_value(planar(y - 2 * sp.exp(x) + 2 * x, a - x, a=0.1), parameter=a, order=3)
    assert not canard.is_exact
    assert moved.is_exact
    assert abs(canard.coefficients[0] - sp.log(2)) < sp.Float("1e-45", 10)
    for left, right in zip(canard.coefficients[1:], moved.coefficients[1:]):
        assert abs(left - right) < sp.Float("1e-40", 10)


# -- against integration -----------------------------------------------------------------------------


@pytest.mark.exhaustive
@pytest.mark.parametrize(("epsilon", "digits"), [(0.1, 4), (0.05, 10)])
def test_the_slow_manifolds_of_van_der_pol_meet_where_the_series_says(epsilon: float, digits: int) -> None:
    canard = canard_value(van_der_pol(), parameter=a, order=6)
    match = match_canard(canard, epsilon, reach=(1.2, 1.9), digits=20)
    value = canard.value(epsilon, digits=digits)
    assert match.mismatch < 1e-15
    assert abs(match.value - value) < 10.0 ** (1 - digits)
    # No formula knows the parameter better than the manifolds define it.
    assert abs(match.value - value) < 10 * match.resolution + 10.0**-digits


@pytest.mark.parametrize("powers", [(6, 0, 0, 0), (0, 6, -12, 0), (-9, 3, 6, -6)])
def test_a_match_is_the_same_in_any_units(powers: tuple[int, int, int, int]) -> None:
    X, Y, A, E = (sp.Integer(10) ** k for k in powers)
    scaled = gsp.SlowFastSystem(
        slow={y: sp.expand(Y * (a / A - x / X))},
        fast={x: sp.expand(X / E * (y / Y - (x / X) ** 3 / 3 + x / X))},
        epsilon=eps,
        parameters={a: A * R(9, 10)},
    )
    match = match_canard(
        canard_value(scaled, parameter=a, order=2),
        R(1, 20) / E,
        reach=(1.2 * float(X), 1.9 * float(X)),
        digits=12,
    )
    assert float(match.value / A) == pytest.approx(0.993490932517, abs=3e-11)
    assert match.resolution == pytest.approx(2.674e-12, rel=1e-3)


@pytest.mark.exhaustive
def test_the_slow_manifolds_of_a_system_with_exponentials_meet_where_the_series_says() -> None:
    canard = canard_value(planar(y - sp.exp(x) + x, a - sp.sin(x), a=0.1), parameter=a, order=8)
    match = match_canard(canard, 0.02, reach=(0.8, 1.0), digits=16)
    assert match.resolution < 1e-5
    assert abs(match.value - canard.partial_sum(0.02, order=8)) < 100 * match.resolution + 1e-9


@pytest.mark.exhaustive
def test_the_brusselator_has_its_hopf_point_at_one_plus_epsilon_and_its_canard_beyond() -> None:
    # epsilon x' = 1 - (a + 1) x + x^2 y, y' = a x - x^2 y: the trace at (1, a) is a - 1 - epsilon.
    canard = canard_value(planar(1 - (a + 1) * x + x**2 * y, a * x - x**2 * y, a=2), parameter=a, order=4)
    assert canard.hopf_coefficients == (1, 1, 0, 0, 0)
    assert canard.coefficients == (1, R(3, 2), R(15, 8), R(81, 8), R(2667, 32))
    match = match_canard(canard, R(1, 100), reach=(0.4, 0.8), digits=18)
    assert match.resolution < 1e-5
    assert abs(match.value - canard.value(R(1, 100), digits=6)) < 10 * match.resolution + 1e-6


def test_an_orbit_that_does_not_reach_the_fold_is_reported() -> None:
    canard = canard_value(van_der_pol(), parameter=a)
    with pytest.raises(CanardError, match="does not arrive at the fold"):
        match_canard(canard, 5, reach=(1.0, 1.0), digits=8)


@pytest.mark.parametrize(
    ("rate", "reach", "what"), [(a - x, 2.5, "fold"), ((a - x) * (x + R(1, 2)), 1.6, "equilibrium")]
)
def test_a_start_beyond_the_end_of_a_branch_is_refused(rate: sp.Expr, reach: float, what: str) -> None:
    # The one from x = -3/2 was matched, with a resolution of 4e-13 that counts the other branch: 2.6e-12 is the most.
    canard = canard_value(planar(y - x**3 / 3 + x, rate, a=1), parameter=a, near={"x": 1})
    with pytest.raises(CanardError, match=f"does not begin on the branch .* has its next {what} before"):
        match_canard(canard, 0.05, reach=(1.0, reach), digits=8)


@pytest.mark.parametrize("order", [5, -1, "1", 1.5, float("nan"), True])
def test_a_partial_sum_beyond_the_coefficients_is_refused(order) -> None:
    with pytest.raises(DeclarationError, match="order is a whole number from 0 to 4"):
        canard_value(van_der_pol(), parameter=a).partial_sum(0.05, order=order)


def test_near_may_name_the_fast_variable_at_the_fold_alone() -> None:
    # Newton's method began at common numbers of y, a million away.
    u, v = x + 10**6, y + 10**6
    moved = gsp.SlowFastSystem(slow={y: u - a}, fast={x: sp.exp(u) - u - 1 - v}, epsilon=eps, parameters={a: 0})
    assert canard_value(moved, parameter=a, order=1, near={"x": -(10**6)}).coefficients == (0, -R(1, 2))


def test_a_start_of_newtons_method_whose_slopes_leave_the_floats_leads_nowhere() -> None:
    # x in 1e-6 and y in 1e6, about x = -1000 and y = 1000: the singular values of such slopes do not exist.
    u, v = x / 10**6 + 1000, 10**6 * y - 1000
    moved = gsp.SlowFastSystem(
        slow={y: (u - a) / 10**6}, fast={x: 10**6 * (sp.exp(u) - u - 1 - v)}, epsilon=eps, parameters={a: 0}
    )
    canard = canard_value(moved, parameter=a, order=2, near={"x": -999_900_000})
    assert canard.coefficients == (0, -R(1, 2), -R(13, 24))


# -- accuracy is told --------------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_more_digits_than_the_series_has_are_refused_with_their_number() -> None:
    canard = canard_value(van_der_pol(), parameter=a)
    with pytest.raises(CanardError, match=r"has about 10 digits at epsilon = 0\.05"):
        canard.value(0.05, digits=16)
    canard.value(0.05, digits=10)


@pytest.mark.parametrize("digits", [0, -1, 2.5, True, 10**6])
def test_digits_are_a_whole_number(digits: float) -> None:
    with pytest.raises(DeclarationError, match="digits"):
        canard_value(van_der_pol(), parameter=a).value(0.01, digits=digits)  # type: ignore[arg-type]


@pytest.mark.parametrize("epsilon", [0, -0.1, float("nan"), float("inf")])
def test_epsilon_is_positive(epsilon: float) -> None:
    with pytest.raises(DeclarationError, match="epsilon"):
        canard_value(van_der_pol(), parameter=a).value(epsilon)


# -- which canard point ------------------------------------------------------------------------------


def test_the_nearest_canard_point_is_taken_and_the_others_are_listed() -> None:
    assert canard_value(van_der_pol(-0.5), parameter=a).coefficients[0] == -1
    assert canard_value(van_der_pol(0.5), parameter=a).coefficients[0] == 1
    both = canard_value(van_der_pol(0), parameter=a)
    assert both.coefficients[0] == 1
    assert [point["a"] for point in both.others] == [-1]
    assert canard_value(van_der_pol(), parameter=a, near={"x": -0.8}).coefficients[:2] == (
        -1,
        sp.Rational(1, 8),
    )


@pytest.mark.parametrize(
    ("fast", "slow", "message"),
    [
        (y - x, a - x, "no fold at a finite point"),
        # Newton's method looks for a fold from hundreds of starts.
        pytest.param(y - sp.exp(-x), a - x, "no fold was found", marks=pytest.mark.exhaustive),
        (y, a - x, "does not depend on x"),
        (y - x**3, a - x, "a cusp"),
        (y - x**2, 1 + a**2, "jump point"),
        (y - x**2, -x + a**2, "transversality coefficient"),
        (y - x**2, -x + eps * a, "does not appear"),
        (y - x**2, a + x, "faux canard"),
        (y - x**2, a + y + x**2, "f_x = 0"),
        (y**2 - x**2, a - x, "two of its branches meet"),
        (y - x**2, a * x, "does not move"),
    ],
)
def test_what_is_no_canard_point_is_named(fast: sp.Expr, slow: sp.Expr, message: str) -> None:
    with pytest.raises(CanardError, match=message):
        canard_value(planar(fast, slow, a=0), parameter=a)


@pytest.mark.parametrize(
    ("equation", "start", "steps"),
    [(sp.exp(-x), 30, 9), (1 / x, 30, 9), (sp.exp(-(x**2)), 5, 9), (x**12, R(1, 2), 40)],
)
def test_a_root_at_infinity_is_left_early_and_a_multiple_one_is_not(
    equation: sp.Expr, start: sp.Expr, steps: int
) -> None:
    reached, size = polish([equation], [x], {x: sp.sympify(start)}, digits=60)
    step = sp.lambdify(x, equation / equation.diff(x))
    expected = float(start)
    for _ in range(steps):
        expected -= step(expected)
    assert float(reached[x]) == pytest.approx(expected, rel=1e-12)
    assert size > 1e-8


def test_a_step_beyond_all_numbers_ends_the_search() -> None:
    far = x / R(10) ** 30 - 1
    reached, size = polish([far + sp.exp(sp.exp(x)) / R(10) ** 60], [x], {x: sp.Integer(0)}, digits=60)
    assert float(reached[x]) == pytest.approx(1e30, rel=1e-6)
    assert float(size) == 1.0


def test_what_is_not_planar_is_refused() -> None:
    z = sp.Symbol("z")
    system = gsp.SlowFastSystem(slow={y: a - x, z: 1}, fast={x: y - x**2}, epsilon=eps, parameters={a: 0})
    with pytest.raises(CanardError, match="2 slow and 1 fast"):
        canard_value(system, parameter=a)


def test_the_result_is_frozen_and_reads_as_a_series() -> None:
    canard = canard_value(van_der_pol(), parameter=a, order=2)
    assert isinstance(canard, CanardValue)
    with pytest.raises(dataclasses.FrozenInstanceError):
        canard.order = 3  # type: ignore[misc]
    assert repr(canard) == "CanardValue(a = 1 - epsilon/8 - 3*epsilon**2/32 + O(epsilon^3))"
    assert canard.partial_sum(Fraction(1, 2)) == 1 - sp.Rational(1, 16) - sp.Rational(3, 128)
    assert canard.partial_sum(Fraction(1, 2), order=1) == 1 - sp.Rational(1, 16)
    assert canard.partial_sum(Fraction(1, 2), order=0) == 1
    assert issubclass(CanardError, GspError)


# -- any units ---------------------------------------------------------------------------------------


def morris_lecar(declared: float, volts: sp.Expr = v, gate: sp.Expr = w) -> gsp.SlowFastSystem:
    """Morris and Lecar (1981), the Hopf set of Ermentrout and Terman (2010), with V and w as given functions."""
    m, n = (1 + sp.tanh((volts + R(6, 5)) / 18)) / 2, (1 + sp.tanh((volts - 2) / 30)) / 2
    leaves = current - 2 * (volts + 60) - 8 * gate * (volts + 84) - R(22, 5) * m * (volts - 120)
    return gsp.SlowFastSystem(
        slow={w: (n - gate) * sp.cosh((volts - 2) / 60) / sp.diff(gate, w)},
        fast={v: leaves / 20 / sp.diff(volts, v)},
        epsilon=eps,
        parameters={current: declared},
    )


UNITS = {
    "as it is": (v, w),
    "in hundredths": (v / 100, w),
    "in hundreds": (100 * v, w),
    "shifted": (v + 500, w),
    "gate": (v, w / 50),
    "all": (7 * v - 300, 3 - 20 * w),
    "gate bent": (v, w + w**3),
}


@pytest.mark.parametrize("size", [R(1, 10**9), 10**9])
@pytest.mark.parametrize("near", [None, {"x": 1.0}])
def test_of_two_canard_points_in_a_unit_of_all_states_the_nearest_is_taken(size, near) -> None:
    """Folds of w = v - 2 tanh v are where cosh v = sqrt 2, so at a = asinh 1 and -asinh 1."""
    saturating = planar(y + 2 * size * sp.tanh(x / size) - x, a - x, a=size)
    place = near and {name: value * float(size) for name, value in near.items()}
    found = canard_value(saturating, parameter=a, order=1, near=place)
    assert [float(c / size) for c in found.coefficients] == pytest.approx(
        [np.arcsinh(1), 2**0.5 / 8], rel=1e-12
    )
    assert [float(point["a"] / size) for point in found.others] == pytest.approx([-np.arcsinh(1)], rel=1e-12)


@pytest.mark.exhaustive
def test_what_newtons_method_did_not_find_is_not_said_to_be_nowhere() -> None:
    away = planar(y + 2 * sp.tanh(x - 300) - x + 300, a - x, a=300)
    with pytest.raises(CanardError, match="no fold was found"):
        canard_value(away, parameter=a)
    assert float(canard_value(away, parameter=a, order=0, near={"x": 301}).coefficients[0]) == pytest.approx(
        300 + np.arcsinh(1), rel=1e-13
    )


@pytest.mark.exhaustive
@pytest.mark.parametrize(("declared", "near"), [(84, None), (230, None), (90, 83.6), (90, 222)])
@pytest.mark.parametrize("name", UNITS)
def test_the_nearest_canard_point_is_found_in_any_units(name, declared: float, near: float | None) -> None:
    nearest, other = sorted(
        (83.645531767021, 222.452513410707), key=lambda value: abs(value - (near or declared))
    )
    place = None if near is None else {"I": near}
    found = canard_value(morris_lecar(declared, *UNITS[name]), parameter="I", order=0, near=place)
    assert float(found.coefficients[0]) == pytest.approx(nearest, rel=1e-12)
    assert [float(point["I"]) for point in found.others] == pytest.approx([other], rel=1e-12)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "gate", [(1 + sp.sign(x + 3)) / 2, sp.Abs(x + 3) / (x + 3), sp.Heaviside(x + 3), sp.Max(x + 3, 0) / (x + 3)]
)
def test_rates_that_switch_elsewhere_have_the_same_canard_value(gate: sp.Expr) -> None:
    systems = planar((y - x**3 / 3 + x) * gate, (a - x) * gate, a=1), planar(y - x**3 / 3 + x, a - x, a=1)
    found, wanted = (canard_value(system, parameter=a, order=2) for system in systems)
    assert found.coefficients == wanted.coefficients


def test_a_switch_at_the_canard_point_is_named() -> None:
    gated = planar(y - x**3 / 3 + x, (a - x) * (3 + sp.sign(x - 1)), a=1)
    with pytest.raises(
        CanardError, match=r"not smooth at .*, where sign\(x - 1\) switches: there is no expansion"
    ):
        canard_value(gated, parameter=a, order=2, near={"x": 1})


def test_a_fold_far_away_makes_no_curve_of_points_near_by() -> None:
    """x = (y + exp(-y))/(1 + y/20) folds where x = -2e10 too; shooting between Radau's runs ends at 0.0534394047."""
    sheet = x * (1 + y / 20) - sp.exp(-y) - y
    found = gsp.canard_value(
        gsp.SlowFastSystem(slow={x: a - y * sp.exp(y / 5)}, fast={y: sheet}, epsilon=eps, parameters={a: 0}),
        parameter=a, order=4,
    )  # fmt: skip
    series = sum(float(c) * 0.002**k for k, c in enumerate(found.coefficients))
    assert series == pytest.approx(0.05343940468, abs=1e-10)


def test_no_fold_is_looked_for_at_a_pole_of_the_sheet() -> None:
    """X = (y + exp(-y))/(1 + y/10) has its pole where one of the places is that are tried; its folds are two."""
    found = list(fold_starts(x * (1 + y / 10) - sp.exp(-y) - y, x, y, a, 0.0))
    assert sorted(v for _, v, _ in found) == pytest.approx([-10.999833, 0.1047916], rel=1e-6)
