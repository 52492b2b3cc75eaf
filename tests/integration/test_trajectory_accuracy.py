"""What the numbers of a trajectory are worth: published references, second routes, exact invariances."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.errors import Status
from gsp.integration.trajectory import Method, integrate
from gsp.systems.system import VectorField

v, w, omega, phi, x, y, z, a, epsilon = sp.symbols("v w omega phi x y z a epsilon")
BOTH = pytest.mark.parametrize("method", list(Method))
RADAU = pytest.mark.parametrize("method", [Method.RADAU9, Method.RADAU13])

# The Chaplygin sleigh with friction, m = I = 1: Eldering (2015), section 3.
SLEIGH = VectorField(
    {
        v: omega * w + a * omega**2,
        w: -v * omega - (1 + a**2) * w / epsilon,
        omega: a * w / epsilon,
        phi: omega,
        x: v * sp.cos(phi) - w * sp.sin(phi),
        y: v * sp.sin(phi) + w * sp.cos(phi),
    },
    epsilon=epsilon,
    parameters={a: "0.2"},
    observables={sp.Symbol("energy"): (v**2 + (w + a * omega) ** 2 + omega**2) / 2},
)
SLEIGH_START = {"v": 1, "w": 0, "omega": 1, "phi": 0, "x": 0, "y": 0}
# (v, w, omega, phi, x, y) at t = 20, by two high-precision methods that agree to all digits shown.
SLEIGH_END = {
    0.1: (
        1.2236647535486021,
        -1.0890604820211897e-3,
        9.0415944717688819e-3,
        4.4656899985566562,
        -10.592048550659358,
        -10.792687275540032,
    ),
    0.01: (
        1.4076458378568931,
        -6.9825174423507255e-5,
        5.1453760473548719e-3,
        4.0769982283842256,
        -17.062474982338171,
        -8.8204790618654922,
    ),
    0.001: (
        1.4262126292348858,
        -6.6789812828583833e-6,
        4.8690553394811340e-3,
        4.0410946803687146,
        -17.692331064614387,
        -8.4986611603525473,
    ),
}


@BOTH
@pytest.mark.parametrize("small", SLEIGH_END)
def test_the_chaplygin_sleigh(method, small):
    trajectory = integrate(
        SLEIGH, start=SLEIGH_START, span=(0, 20), epsilon=small, rtol=1e-10, atol=1e-10, method=method
    )
    assert trajectory.status is Status.SUCCESS
    assert trajectory.y[:, -1] == pytest.approx(SLEIGH_END[small], rel=0, abs=1e-8)
    # Friction only takes energy away: E' = -w^2/epsilon.
    assert np.diff(trajectory["energy"]).max() < 1e-9


def test_the_cost_of_the_sleigh_does_not_grow_as_epsilon_falls():
    steps = {
        small: integrate(SLEIGH, start=SLEIGH_START, span=(0, 20), epsilon=small).stats.steps
        for small in (1e-2, 1e-4, 1e-6, 1e-8)
    }
    assert max(steps.values()) < 250, steps


def test_errors_follow_the_tolerance():
    errors = []
    for rtol in (1e-5, 1e-7, 1e-9, 1e-11):
        trajectory = integrate(SLEIGH, start=SLEIGH_START, span=(0, 20), epsilon=0.01, rtol=rtol, atol=rtol)
        errors.append(np.abs(trajectory.y[:, -1] - SLEIGH_END[0.01]).max())
        assert errors[-1] < 30 * rtol
    assert errors == sorted(errors, reverse=True)


ROBERTSON = VectorField(
    {
        x: -sp.Rational(1, 25) * x + 10**4 * y * z,
        y: sp.Rational(1, 25) * x - 10**4 * y * z - 3 * 10**7 * y**2,
        z: 3 * 10**7 * y**2,
    },
    epsilon=None,
    observables={sp.Symbol("mass"): x + y + z},
)


def test_robertson_over_eleven_decades():
    trajectory = integrate(ROBERTSON, start={"x": 1, "y": 0, "z": 0}, span=(0, 1e11), rtol=1e-9, atol=1e-18)
    # Test Set for IVP Solvers (Mazzia, Magherini 2008), problem ROBER.
    expected = [0.2083340149701255e-07, 0.8333360770334713e-13, 0.9999999791665050]
    assert trajectory.y[:, -1] == pytest.approx(expected, rel=1e-6)
    assert trajectory["mass"] == pytest.approx(1.0, abs=1e-12)
    assert trajectory.stats.steps < 2500


@BOTH
def test_a_constant_field_is_integrated_exactly_in_a_few_steps(method):
    field = VectorField({x: sp.Integer(3), y: sp.Rational(-1, 4)}, epsilon=None)
    trajectory = integrate(field, start={"x": 1, "y": 0}, span=(0, 8), at=[1, 2, 8], method=method)
    assert trajectory.y == pytest.approx(np.array([[4, 7, 25], [-0.25, -0.5, -2]]), rel=1e-14)
    assert trajectory.stats.steps < 16
    assert trajectory.stats.rejected == 0


# Tight tolerances: Radau IIA


@RADAU
def test_the_sleigh_to_twelve_digits(method):
    for small, expected in SLEIGH_END.items():
        trajectory = integrate(
            SLEIGH, start=SLEIGH_START, span=(0, 20), epsilon=small, rtol=1e-12, atol=1e-12, method=method
        )
        assert trajectory.y[:, -1] == pytest.approx(expected, rel=1e-11, abs=1e-11)


@RADAU
def test_robertson_to_eleven_digits(method):
    trajectory = integrate(
        ROBERTSON,
        start={"x": 1, "y": 0, "z": 0},
        span=(0, 40),
        rtol=1e-12,
        atol=1e-20,
        method=method,
    )
    # Radau IIA with 7 and with 9 stages in arithmetic of 34 digits; they agree in 19.
    expected = [0.7158270687194050905, 9.185534764557764e-6, 0.2841637457458303518]
    assert trajectory.y[:, -1] == pytest.approx(expected, rel=1e-11)


@RADAU
def test_van_der_pol_of_the_test_set_to_eleven_digits(method):
    field = VectorField({x: y, y: 10**6 * ((1 - x**2) * y - x)}, epsilon=None)
    trajectory = integrate(field, start={"x": 2, "y": 0}, span=(0, 2), rtol=1e-12, atol=1e-12, method=method)
    # Test Set for IVP Solvers (Mazzia, Magherini 2008), problem VDPOL.
    assert trajectory.y[:, -1] == pytest.approx([0.1706167732170483e1, -0.8928097010247975], rel=1e-11)


@RADAU
def test_dense_output_and_end_meet_a_tolerance_of_1e_11(method):
    options = {"start": SLEIGH_START, "span": (0, 20), "epsilon": 1e-3}
    t = np.linspace(0, 20, 501)
    trajectory = integrate(SLEIGH, rtol=1e-11, atol=1e-11, method=method, **options)
    # The reference lands on every t: no interpolation.
    reference = integrate(SLEIGH, rtol=1e-13, atol=1e-13, method=Method.RADAU9, at=t[1:], **options)
    errors = np.abs(trajectory.at(t[1:]) - reference.y) / (1 + np.abs(reference.y))
    assert errors[:, -1].max() < 1e-11
    assert errors.max() < 3e-11


@RADAU
def test_a_decay_at_a_rate_of_1e12_is_damped_at_once_and_costs_few_steps(method):
    decay = VectorField({x: -(10**12) * x}, epsilon=None)
    trajectory = integrate(decay, start={"x": 1}, span=(0, 1), method=method)
    assert trajectory.stats.steps < 100
    assert abs(trajectory["x"][-1]) < 1e-20
    follow = VectorField({x: -(10**12) * (x - sp.cos(y)), y: sp.Integer(1)}, epsilon=None)
    trajectory = integrate(follow, start={"x": 3, "y": 0}, span=(0, 10), method=method)
    assert trajectory["x"][-1] == pytest.approx(np.cos(10), abs=1e-8)
    assert trajectory.stats.steps < 300


@RADAU
def test_the_work_of_radau_grows_with_its_order_in_the_tolerance(method):
    """Each attempt costs one Jacobian, and a tenth of the tolerance 10^(1/(stages + 2)) as many steps."""
    stages = {Method.RADAU9: 5, Method.RADAU13: 7}[method]
    tolerances = np.array([1e-6, 1e-8, 1e-10, 1e-12])
    steps = []
    for rtol in tolerances:
        stats = integrate(
            SLEIGH, start=SLEIGH_START, span=(0, 20), epsilon=0.01, rtol=rtol, atol=rtol, method=method
        ).stats
        assert stats.jacobian_calls == stats.decompositions == stats.steps + stats.rejected
        steps.append(stats.steps)
    slope = -np.polyfit(np.log(steps), np.log(tolerances), 1)[0]
    assert stages + 1 < slope < stages + 5, steps


# Invariances

PENDULUM = {x: y, y: -sp.sin(x) - y / 8}


@BOTH
def test_scaling_time_by_a_power_of_two_changes_no_bit(method):
    slow = integrate(VectorField(PENDULUM, epsilon=None), start={"x": 1, "y": 0.5}, span=(0, 16), method=method)
    quick = {state: 1024 * rate for state, rate in PENDULUM.items()}
    fast = integrate(
        VectorField(quick, epsilon=None), start={"x": 1, "y": 0.5}, span=(0, 16 / 1024), method=method
    )
    assert np.array_equal(slow.t, 1024 * fast.t)
    assert np.array_equal(slow.y, fast.y)


@BOTH
def test_scaling_the_states_of_a_linear_field_by_a_power_of_two_changes_no_bit(method):
    field = VectorField({x: y - x / 3, y: -7 * x}, epsilon=None)
    one = integrate(field, start={"x": 1, "y": 0.5}, span=(0, 5), atol=2.0**-30, method=method)
    many = integrate(field, start={"x": 2.0**20, "y": 2.0**19}, span=(0, 5), atol=2.0**-10, method=method)
    assert np.array_equal(one.t, many.t)
    assert np.array_equal(2.0**20 * one.y, many.y)


@BOTH
def test_permuting_the_states_permutes_the_result(method):
    forward = integrate(SLEIGH, start=SLEIGH_START, span=(0, 5), epsilon=0.05, at=[1, 5], method=method)
    turned = VectorField(
        dict(reversed(SLEIGH.equations.items())), epsilon=epsilon, parameters=dict(SLEIGH.parameters)
    )
    backward = integrate(turned, start=SLEIGH_START, span=(0, 5), epsilon=0.05, at=[1, 5], method=method)
    assert backward.y[::-1] == pytest.approx(forward.y, rel=1e-10, abs=1e-12)
    assert abs(backward.stats.steps - forward.stats.steps) <= 1


def test_all_methods_are_routes_to_one_answer():
    field = VectorField(PENDULUM, epsilon=None)
    grid = np.linspace(1, 30, 30)
    first, *others = (
        integrate(field, start={"x": 3, "y": 0}, span=(0, 30), rtol=1e-11, atol=1e-12, at=grid, method=m)
        for m in Method
    )
    for other in others:
        assert first.y == pytest.approx(other.y, abs=1e-9)
