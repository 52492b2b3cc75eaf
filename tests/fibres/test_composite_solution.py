"""Composite expansions: uniform errors of the order promised, equation (17), and the three parts."""

import numpy as np
import pytest
import sympy as sp

from gsp.comparison.comparison import slope
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError, GspError, HyperbolicityError
from gsp.fibres.composite_solution import composite
from gsp.integration.trajectory import integrate
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems
from tests.example_systems import epsilon, x, y

v, p, w, m, inertia, a, omega, phi, tau = sp.symbols("v p w m I a omega phi tau")
SLEIGH = solve_critical(systems.sleigh()).branches[0]
SLIDING = {"v": -1, "p": 1.66, "w": 0.5}
CASES = {
    "sleigh": (SLEIGH, SLIDING, (0, 5), (0.02, 0.01, 0.005)),
    "Michaelis-Menten": (
        solve_critical(systems.michaelis_menten()).branches[0],
        {"s": 1, "c": 0},
        (0, 3),
        (0.04, 0.02, 0.01),
    ),
    "van der Pol": (
        solve_critical(systems.van_der_pol()).branches[0].through({"y": 2 / 3, "x": 2}),
        {"y": 2 / 3, "x": 3},
        (0, 0.6),
        (0.02, 0.01, 0.005),
    ),
    "two fast": (
        solve_critical(systems.coupled()).branches[0].through({"x": 1, "y": 0.5, "z": 0.3}),
        {"x": 1, "y": 2, "z": 1},
        (0, 2),
        (0.04, 0.02, 0.01),
    ),
    "two slow": (
        solve_critical(systems.koper()).branches[0].through({"y": 0, "z": 0.5, "x": 2.4}),
        {"y": 0, "z": 0.5, "x": 3},
        (0, 0.3),
        (0.01, 0.005, 0.0025),
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize(("branch", "start", "span", "ladder"), CASES.values(), ids=CASES)
def test_the_error_is_uniform_and_of_the_order_promised(branch, start, span, ladder) -> None:
    series = expand(branch, order=2)
    for order in (0, 1, 2):
        errors = []
        for e in ladder:
            solution = composite(series, start, span=span, epsilon=e, order=order)
            full = integrate(
                branch.system, start=start, span=span, epsilon=e, rtol=1e-12, atol=1e-14, at=solution.t
            )
            errors.append(np.abs(solution.y - full.y).max(axis=1))
        for component in np.array(errors).T:
            assert slope(ladder, component, [1e-13] * 3) == pytest.approx(order + 1, abs=0.1)


def test_equation_17_is_the_inner_solution_with_v_and_omega_frozen() -> None:
    # w' = -v omega - rho w, rho = (I + m a^2)/(I m epsilon); (v, omega, w) = (-1, 3/2, 1/2).
    rho = (inertia + m * a**2) / (inertia * m)
    frozen = SlowFastSystem(
        slow={v: sp.S.Zero, omega: sp.S.Zero},
        fast={w: -epsilon * v * omega - rho * w},
        epsilon=epsilon,
        parameters={m: 1, inertia: 1, a: sp.Rational(1, 5)},
    )
    branch = solve_critical(frozen).branches[0]
    start = {"v": -1, "omega": 1.5, "w": 0.5}
    inner = composite(branch, start, span=(0, 1), epsilon=0.01).inner_expression("w", tau)
    rho_0, drift = sp.Rational(26, 25), -epsilon * sp.Rational(3, 2) * sp.Rational(25, 26)
    equation_17 = (sp.Rational(1, 2) + drift) * sp.exp(-rho_0 * tau) - drift
    assert sp.expand(inner - equation_17) == 0


def test_equation_17_holds_through_order_one_without_initial_slip_only() -> None:
    # With w0 = 0 omega does not jump and (17) with omega = p/J is the inner solution through order 1.
    inner = composite(SLEIGH, {"v": -1, "p": 1.66, "w": 0}, span=(0, 1), epsilon=0.01).inner_expression(
        "w", tau
    )
    drift = -epsilon * sp.Rational("1.66") / sp.Rational("1.04") ** 2
    equation_17 = drift * sp.exp(-sp.Rational(26, 25) * tau) - drift
    assert sp.expand(inner - equation_17) == 0
    # With w0 = 1/2 the coupling to omega adds a resonant term, epsilon tau exp(-tau).
    sliding = composite(SLEIGH, SLIDING, span=(0, 1), epsilon=0.01).inner_expression("w", tau)
    assert sp.expand(sliding).coeff(epsilon, 1).coeff(tau, 1) != 0


def test_the_three_parts_add_up_and_match() -> None:
    solution = composite(SLEIGH, SLIDING, span=(0, 5), epsilon=0.02, order=1)
    t = np.array([0.0, 0.01, 0.05, 0.3])
    total = solution.inner_at(t) + solution.outer_at(t) - solution.common_at(t)
    assert np.allclose(solution.at(t), total, rtol=0, atol=1e-15)
    # Slow variables start exactly where they should, fast ones within O(epsilon^2).
    assert np.allclose(solution.at(0.0)[:2], [-1, 1.66], rtol=0, atol=1e-14)
    assert abs(solution.at(0.0)[2] - 0.5) < 10 * 0.02**2
    # Far from the start inner and common are the same, and so are composite and outer.
    assert np.allclose(solution.inner_at(2.0), solution.common_at(2.0), atol=1e-14)
    assert np.allclose(solution.at(5.0), solution.outer_at(5.0), atol=1e-14)


def test_a_composite_reads_like_a_trajectory() -> None:
    J = inertia + m * a**2
    system = SlowFastSystem(
        slow=systems.sleigh().slow,
        fast=systems.sleigh().fast,
        epsilon=epsilon,
        parameters=systems.sleigh().parameters,
        observables={omega: (p - m * a * w) / J},
    )
    branch = solve_critical(system).branches[0]
    solution = composite(
        branch, SLIDING, span=(0, 5), epsilon=0.01, reconstruction={phi: omega}, at=np.linspace(0, 5, 11)
    )
    assert solution.names == ("v", "p", "w", "phi")
    assert solution.t.shape == (11,)
    assert solution.y.shape == (4, 11)
    assert np.array_equal(solution["v"], solution.y[0])
    # In the layer omega jumps by m a w0/J.
    fine = solution.sample([0.0, 0.1])
    jump = float(fine["omega"][1] - fine["omega"][0])
    assert fine["omega"][0] == pytest.approx(1.5, abs=1e-3)
    assert jump == pytest.approx(0.2 * 0.5 / 1.04, abs=0.03)
    assert solution.status.ok
    # The fast rate of the sleigh is -J w/(I m) at leading order.
    assert solution.layer_time == pytest.approx(0.01 * 1.0 / 1.04)
    assert "order=1" in repr(solution)
    with pytest.raises(GspError, match="no state and no observable"):
        solution["theta"]
    with pytest.raises(GspError, match="covers"):
        solution.at(6.0)
    with pytest.raises(DeclarationError, match="with masked values"):
        solution.at(np.ma.array([0.1, 0.2], mask=[0, 1]))


def test_reconstruction_variables_are_uniformly_approximated_too() -> None:
    J = inertia + m * a**2
    rates = {phi: (p - m * a * w) / J}
    errors = []
    ladder = (0.02, 0.01, 0.005)
    for e in ladder:
        solution = composite(SLEIGH, SLIDING, span=(0, 3), epsilon=e, reconstruction=rates)
        full = integrate(SLEIGH.system, start=SLIDING, span=(0, 3), epsilon=e, rtol=1e-12, atol=1e-14)
        t = np.linspace(0, 3, 4001)
        values = full.at(t)
        angle = (values[1] - 0.2 * values[2]) / 1.04
        # Simpson's rule on the full run.
        step = t[1] - t[0]
        middle = step / 3 * (angle[:-2:2] + 4 * angle[1:-1:2] + angle[2::2])
        errors.append(np.abs(solution.sample(t[2::2])["phi"] - np.cumsum(middle)).max())
    assert slope(ladder, errors, [1e-9] * 3) == pytest.approx(2, abs=0.1)


@pytest.mark.exhaustive
def test_quadratic_rates_of_many_fast_variables_are_matched_by_programs() -> None:
    fast = sp.symbols("y0:4")
    states = (x, *fast)
    squares = [sp.Add(*states[: k + 1]) * states[k] for k in range(5)]
    rates = {}
    for i, s in enumerate(fast):
        linear = sp.Add(*[state / (i + k + 3) for k, state in enumerate(states)])
        rates[s] = linear - (3 + i) * s + sp.Add(*[q / (i + 2 * k + 7) for k, q in enumerate(squares)])
    system = SlowFastSystem(slow={x: -x + sp.Add(*fast)}, fast=rates, epsilon=epsilon)
    start = {s.name: 0.2 for s in states}
    branch = solve_critical(system).nearest(start)
    errors = []
    ladder = (0.04, 0.02, 0.01)
    for e in ladder:
        solution = composite(branch, start, span=(0, 1), epsilon=e, order=2)
        full = integrate(system, start=start, span=(0, 1), epsilon=e, rtol=1e-12, atol=1e-14)
        errors.append(np.abs(solution.y - full.at(solution.t)).max())
    assert slope(ladder, errors, [1e-10] * 3) == pytest.approx(3, abs=0.25)


def test_what_cannot_be_matched_is_refused() -> None:
    repelling = solve_critical(SlowFastSystem(slow={x: -x}, fast={y: y - x}, epsilon=epsilon)).branches[0]
    with pytest.raises(HyperbolicityError, match="repels"):
        composite(repelling, {"x": 1, "y": 2}, span=(0, 1), epsilon=0.1)
    attracting = solve_critical(SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=epsilon)).branches[0]
    with pytest.raises(HyperbolicityError, match="grows backward"):
        composite(attracting, {"x": 1, "y": 2}, span=(0, -1), epsilon=0.1)
    with pytest.raises(DeclarationError, match="known through order 1"):
        composite(expand(SLEIGH, order=1), SLIDING, span=(0, 1), epsilon=0.1, order=2)
    cubic = solve_critical(systems.coupled()).branches[0].through({"x": 1, "y": 0.5, "z": 0.3})
    sampled = composite(cubic, {"x": 1, "y": 2, "z": 1}, span=(0, 1), epsilon=0.1)
    with pytest.raises(DeclarationError, match="samples only"):
        sampled.inner_expression("y", tau)
