"""Reduced flows: the right order, on explicit and implicit branches, with reconstruction."""

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError
from gsp.integration.restriction import restrict
from gsp.integration.trajectory import Method, integrate
from gsp.slow.series import expand
from gsp.splitting.splitting import split
from gsp.systems.system import SlowFastSystem, VectorField
from tests import example_systems as systems
from tests.cases import crossed

eps = systems.epsilon
TIGHT = {"rtol": 1e-12, "atol": 1e-14}

CASES = {
    "sleigh": (systems.sleigh(), {"v": 1.0, "p": 1.04, "w": 0.0}),
    "michaelis_menten": (systems.michaelis_menten(), {"s": 1.0, "c": 0.5}),
    "van_der_pol": (systems.van_der_pol(), {"x": 2.0, "y": 2 / 3}),
    "koper": (systems.koper(), {"x": 2.4, "y": 0.0, "z": 0.5}),
    "coupled": (systems.coupled(), {"x": 0.5, "y": 0.4, "z": 0.2}),
    "transcendental": (systems.transcendental(), {"x": 0.5, "y": 0.3}),
}


def error(series, system, start, order: int, epsilon: float) -> float:
    """Largest difference in the slow variables between reduced and full run from the slow manifold."""
    slow = {s.name: start[s.name] for s in system.x}
    y = series.evaluate(slow, epsilon)
    on = {**slow, **{s.name: float(v) for s, v in zip(system.y, y)}}
    at = np.linspace(0, 0.5, 9)
    run = integrate(restrict(series, order=order), start=start, span=(0, 0.5), epsilon=epsilon, at=at, **TIGHT)
    full = integrate(system, start=on, span=(0, 0.5), epsilon=epsilon, at=at, **TIGHT)
    assert run.status.ok
    assert full.status.ok
    return max(float(np.abs(run[s] - full[s]).max()) for s in system.x)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "order"), crossed(CASES, [0, 1, 2]))
def test_the_flow_of_order_n_is_in_error_by_epsilon_to_the_n_plus_one(name: str, order: int) -> None:
    system, start = CASES[name]
    series = expand(solve_critical(system).nearest(start), order=4)
    coarse, fine = (error(series, system, start, order, e) for e in (0.01, 0.005))
    assert np.log2(coarse / fine) == pytest.approx(order + 1, abs=0.12)


def test_a_reduced_flow_is_not_stiff_and_takes_the_explicit_method() -> None:
    system, start = CASES["michaelis_menten"]
    flow = restrict(expand(solve_critical(system).branches[0], order=2))
    run = integrate(flow, start=start, span=(0, 5), epsilon=1e-6)
    assert run.stats.method is Method.DOP853
    assert run.stats.steps < 40


def test_fast_variables_and_raw_states_are_read_off_a_reduced_run() -> None:
    v, omega, w, a = sp.symbols("v omega w a")
    field = VectorField(
        {v: omega * w + a * omega**2, omega: a * w / eps, w: -v * omega - (1 + a**2) * w / eps},
        epsilon=eps,
        parameters={a: 0.2},
    )
    splitting = split(field)
    assert splitting.system is not None
    series = expand(solve_critical(splitting.system).branches[0], order=3)
    run = integrate(restrict(series), start={"v": 1, "p": 1.04}, span=(0, 1), epsilon=0.01, **TIGHT)
    p, w_on = run["p"], run["w"]
    np.testing.assert_allclose(run["omega"], (p - 0.2 * w_on) / 1.04, rtol=1e-14)
    expected = series.evaluate(np.stack([run["v"], p], axis=1), 0.01)[:, 0]
    np.testing.assert_allclose(w_on, expected, rtol=1e-12)


def test_reconstruction_is_driven_by_the_reduced_run() -> None:
    system, start = CASES["sleigh"]
    phi, X = sp.symbols("phi X")
    v, p, w = system.states
    rates = {phi: p, X: v * sp.cos(phi) - w * sp.sin(phi)}
    flow = restrict(expand(solve_critical(system).branches[0], order=1), reconstruction=rates)
    run = integrate(flow, start={**start, "X": 2.0}, span=(0, 1), epsilon=0.05, **TIGHT)
    assert run["X"][0] == 2.0
    assert run["phi"][0] == 0.0
    # phi' = p: the change of phi is the integral of p over the run.
    t = np.linspace(0, 1, 2001)
    fine = run.sample(t)
    assert run["phi"][-1] == pytest.approx(np.trapezoid(fine["p"], t), abs=1e-6)


def test_on_an_implicit_branch_the_chart_carries_the_slow_variable() -> None:
    system, start = CASES["van_der_pol"]
    flow = restrict(expand(solve_critical(system).nearest(start), order=2))
    assert [s.name for s in flow.states] == ["x0"]
    run = integrate(flow, start=start, span=(0, 0.4), epsilon=0.01, **TIGHT)
    np.testing.assert_allclose(run["y"], run["x0"] ** 3 / 3 - run["x0"], rtol=1e-13)


def test_a_branch_with_more_coordinates_than_slow_variables_is_run_on_from_these_alone() -> None:
    branch = solve_critical(systems.coupled()).branches[0].through({"x": 1, "y": 0.5, "z": 0.3})
    flow = restrict(expand(branch, order=1))
    assert len(flow.states) > len(branch.system.x)
    asked = {"span": (0, 0.5), "epsilon": 0.05, **TIGHT}
    whole = dict(zip("xyz", [1.0, *branch.points([[1.0]])[0]]))
    alone, named = integrate(flow, start={"x": 1.0}, **asked), integrate(flow, start=whole, **asked)
    assert alone.status.ok
    np.testing.assert_allclose(alone.y[:, -1], named.y[:, -1], rtol=1e-9)


def test_a_fresh_name_for_a_point_of_the_critical_manifold_avoids_those_taken() -> None:
    x, x0, y = sp.symbols("x x0 y")
    system = SlowFastSystem(slow={y: -x}, fast={x: y + x0 * x - x**3}, epsilon=eps, parameters={x0: 1})
    flow = restrict(expand(solve_critical(system).nearest({"x": 2.0, "y": 6.0}), order=1))
    assert [s.name for s in flow.states] == ["x00"]


@pytest.mark.parametrize(
    ("start", "words"),
    [
        ({"v": 1}, "no value for p"),
        ({"v": 1, "p": 1, "q": 0}, "names q"),
        ({"v": 1, "p": "a"}, "no real number"),
    ],
)
def test_a_wrong_start_is_named(start, words: str) -> None:
    series = expand(solve_critical(systems.sleigh()).branches[0], order=1)
    with pytest.raises(DeclarationError, match=words):
        restrict(series).initial(start)


def test_equal_flows_are_equal_and_hash_alike() -> None:
    one, two = (restrict(expand(solve_critical(systems.sleigh()).branches[0], order=2)) for _ in range(2))
    assert one == two
    assert hash(one) == hash(two)
    assert one != restrict(one.manifold, order=1)
