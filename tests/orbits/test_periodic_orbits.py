"""Periodic orbits: orders of convergence, exact cycles in disguise, published periods, and what is refused."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError, GspError, Status
from gsp.lowering.compiled_flow import parameter_vector
from gsp.orbits.periodic.collocation import Cycle, OrbitProblem, gauss
from gsp.orbits.periodic.finding import ISOLATED, isolation_of
from gsp.orbits.periodic.floquet import multipliers
from gsp.orbits.periodic.newton import scales_of, solve_cycle
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.orbits.periodic.settling import OrbitError
from tests.cases import sampled
from tests.rescaling import scene, shifted

x, y, z, eps = sp.symbols("x y z epsilon")
R = sp.Rational
# The unit circle, run through unevenly: theta' = 1 + cos(theta)/2, and r = 1 + rho with rho' = -2 rho to first order.
CIRCLE = {
    x: x * (1 - x**2 - y**2) - y * (1 + x / 2),
    y: y * (1 - x**2 - y**2) + x * (1 + x / 2),
}
PERIOD = 2 * math.pi / math.sqrt(1 - 0.25)
# theta' = 1 + x/2 has mean over a period 2 pi/T, so that x has the mean 2 (2 pi/T - 1).
MEAN_X = 2 * (2 * math.pi / PERIOD - 1)


def circle(sign: int = 1) -> gsp.VectorField:
    return gsp.VectorField({s: sign * rate for s, rate in CIRCLE.items()}, epsilon=None)


def van_der_pol() -> gsp.SlowFastSystem:
    """In Lienard's plane; slow time is that of x'' - mu (1 - x^2) x' + x = 0 over mu, and epsilon = 1/mu^2."""
    return gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=eps)


def on_uniform_mesh(degree: int, intervals: int):
    problem = OrbitProblem(circle(), parameter_vector(circle(), None))
    mesh = np.linspace(0, 1, intervals + 1)
    angle = 2 * math.pi * (mesh[:-1, None] + np.diff(mesh)[:, None] * gauss(degree).x)
    guess = Cycle(mesh, 1.01 * np.stack([np.cos(angle), np.sin(angle)], axis=2), 7.0)
    solution = solve_cycle(problem, guess, scales=scales_of(problem, guess))
    assert solution.status is Status.SUCCESS
    return solution.point


def radius_error(states: np.ndarray) -> float:
    return float(np.abs(np.hypot(*states) - 1).max())


# -- what the method must satisfy --------------------------------------------------------------------


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_the_error_falls_as_h_to_the_degree_plus_one_and_twice_the_degree_at_mesh_points(degree: int) -> None:
    between, at_points, period = [], [], []
    for intervals in (8, 16, 32, 64):
        cycle = on_uniform_mesh(degree, intervals)
        between.append(radius_error(cycle.at(np.linspace(0, 1, 1000, endpoint=False)).T))
        at_points.append(radius_error(cycle.values[:, 0].T))
        period.append(abs(cycle.period - PERIOD))
    for errors, order in ((between, degree + 1), (at_points, 2 * degree), (period, 2 * degree)):
        # The finest pair above rounding.
        above = [error for error in errors if error > 2e-13]
        assert math.log2(above[-2] / above[-1]) == pytest.approx(order, abs=0.3), errors


@pytest.mark.exhaustive
def test_a_cycle_known_exactly_is_found_in_any_coordinates() -> None:
    rng = np.random.default_rng(3)
    M = sp.Matrix(3, 3, [sp.Rational(int(v), 4) for v in rng.integers(-5, 6, 9)])
    assert M.det() != 0
    raw = sp.Matrix([CIRCLE[x], CIRCLE[y], -z / 5 + x * z / 3])
    w = sp.Matrix(sp.symbols("w1 w2 w3"))
    there = dict(zip((x, y, z), M.inv() * w))
    rates = M * raw.xreplace(there)
    flow = gsp.VectorField(dict(zip(w, map(sp.expand, rates))), epsilon=None)
    start = M * sp.Matrix([sp.Rational(1, 2), 0, sp.Rational(1, 10)])
    orbit = gsp.periodic_orbit(flow, start={s.name: float(v) for s, v in zip(w, start)})
    assert orbit.status.ok
    assert orbit.period == pytest.approx(PERIOD, rel=1e-12)
    expected = sorted([math.exp(PERIOD * (-0.2 + MEAN_X / 3)), math.exp(-2 * PERIOD)], reverse=True)
    assert orbit.multipliers[0] == pytest.approx(1, abs=1e-9)
    assert orbit.multipliers[1:].real == pytest.approx(expected, rel=1e-6)
    assert orbit.divergence == pytest.approx(math.log(expected[0] * expected[1]), abs=1e-9)
    # Each state is a linear form of (cos, sin), whose amplitude is twice its length.
    for i, symbol in enumerate(w):
        exact = 2 * math.hypot(float(M[i, 0]), float(M[i, 1]))
        assert orbit.amplitude[symbol.name] == pytest.approx(exact, rel=1e-8)


def test_units_of_time_and_of_the_states_change_nothing_but_the_units() -> None:
    slow, wide = sp.Rational(1, 1000), 10**6
    there = {x: x / wide, y: y * 100}
    flow = gsp.VectorField(
        {x: wide * slow * CIRCLE[x].xreplace(there), y: slow * CIRCLE[y].xreplace(there) / 100}, epsilon=None
    )
    orbit = gsp.periodic_orbit(flow, start={"x": 0.5e6, "y": 0.0})
    assert orbit.period * 1e-3 == pytest.approx(PERIOD, rel=1e-12)
    assert orbit.amplitude["x"] == pytest.approx(2e6, rel=1e-8)
    assert orbit.multipliers[1].real == pytest.approx(math.exp(-2 * PERIOD), rel=1e-8)


def test_multipliers_come_from_products_that_overflow() -> None:
    # Transfers P_(j+1) D P_j^-1 around a closed chain of bases: the multipliers are the entries of D^N.
    rng = np.random.default_rng(0)
    bases = rng.normal(size=(200, 3, 3)) + 3 * np.eye(3)
    D = np.diag([math.exp(5), 1.0, math.exp(-5)])
    transfers = np.array([bases[(j + 1) % 200] @ D @ np.linalg.inv(bases[j]) for j in range(200)])
    found = multipliers(transfers, 0.0, np.ones(3))
    assert found[0] == pytest.approx(1, abs=1e-9)
    assert np.isinf(found[1]) or abs(found[1]) > 1e15
    assert abs(found[2]) < 1e-15
    few = multipliers(transfers[:1], 0.0, np.ones(3))
    assert sorted(np.abs(few)) == pytest.approx(sorted(np.abs(np.linalg.eigvals(transfers[0]))), rel=1e-9)


# -- published values and two routes -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("mu", "period"), [(10, 19.078369566939014070430112825), (100, 162.83707109237001213246370716)]
)
def test_van_der_pols_period_by_collocation_and_by_shooting(mu: int, period: float) -> None:
    orbit = gsp.periodic_orbit(van_der_pol(), start={"x": 2, "y": 0}, epsilon=1 / mu**2)
    assert orbit.period * mu == pytest.approx(period, rel=1e-12)
    assert orbit.period_error < 1e-10
    assert orbit.error < 1e-9
    assert orbit.is_stable
    for phase in (0.0, 0.3):
        shot = gsp.shoot(orbit, phase=phase)
        assert shot.status.ok
        assert shot.period * mu == pytest.approx(period, rel=1e-12)


def test_relaxation_at_a_millionth_needs_few_intervals() -> None:
    orbit = gsp.periodic_orbit(van_der_pol(), start={"x": 2, "y": 0}, epsilon=1e-6)
    assert orbit.status.ok
    assert orbit.stats.intervals < 400
    assert gsp.shoot(orbit, phase=0.2).period == pytest.approx(orbit.period, rel=1e-12)
    # T = (3 - 2 ln 2) mu + 3 Omega_0 mu^(-1/3) - (2/3) ln(mu)/mu - 1.32327/mu in the units of mu = 1000.
    mu = 1000.0
    series = (
        (3 - 2 * math.log(2)) * mu
        + 3 * 2.33810741 * mu ** (-1 / 3)
        - (2 / 3) * math.log(mu) / mu
        - 1.32327 / mu
    )
    assert orbit.period * mu == pytest.approx(series, abs=1e-4)


@pytest.mark.exhaustive
@pytest.mark.parametrize("epsilon", [1e-10, 1e-12, 5e-13, 2.972e-13])
def test_relaxation_converges_where_phases_are_too_coarse_for_its_jumps(epsilon: float) -> None:
    # A jump takes the share epsilon of the period, and rounding moves the state at a phase by 1e-16/epsilon: the run
    # that Newton's method starts from must know the jumps' phases.
    orbit = gsp.periodic_orbit(van_der_pol(), start={"x": 2, "y": 0}, epsilon=epsilon)
    assert orbit.status is Status.SUCCESS
    mu = epsilon**-0.5
    series = 3 - 2 * math.log(2) + (3 * 2.338107410459767 * mu ** (-1 / 3) - 2 / 3 * math.log(mu) / mu) / mu
    assert orbit.period == pytest.approx(series - 1.32327 * epsilon, rel=3e-13)


def test_relaxation_that_time_in_double_precision_cannot_hold_is_not_called_absent() -> None:
    with pytest.raises(OrbitError, match=r"no cycle was found: .* jumps within the rounding of time") as caught:
        gsp.periodic_orbit(van_der_pol(), start={"x": 2, "y": 0}, epsilon=1e-17)
    assert "there is no cycle" not in str(caught.value)


def test_an_orbit_of_saddle_type_from_a_lap_nearby() -> None:
    # The shortest orbit of Lorenz' attractor; D. Viswanath, Physica D 190 (2004) 115-128.
    lorenz = gsp.VectorField(
        {x: 10 * (y - x), y: 28 * x - y - x * z, z: x * y - sp.Rational(8, 3) * z}, epsilon=None
    )
    orbit = gsp.periodic_orbit(lorenz, start={"x": -13.7636, "y": -19.5788, "z": 27}, period=1.56)
    assert orbit.period == pytest.approx(1.5586522107161747, rel=1e-12)
    assert orbit.unstable == 1
    assert orbit.divergence == pytest.approx(-41 / 3 * orbit.period, rel=1e-12)
    assert np.log(np.abs(np.prod(orbit.multipliers))) == pytest.approx(orbit.divergence, abs=1e-3)


def test_a_mixed_mode_orbit_crosses_its_section_several_times_a_lap() -> None:
    koper = gsp.models.load("koper").system.with_parameters(**{"lambda": -7.5})
    orbit = gsp.periodic_orbit(koper, start={"x": 2, "y": 0, "z": 0}, epsilon=0.1)
    assert orbit.status.ok
    shot = gsp.shoot(orbit)
    assert shot.status.ok
    assert shot.period == pytest.approx(orbit.period, rel=1e-11)
    x_values = orbit.values("x", np.linspace(0, 1, 4000))
    peaks = (x_values[1:-1] > x_values[:-2]) & (x_values[1:-1] > x_values[2:])
    assert peaks.sum() > 1


def test_a_repelling_cycle_is_found_backward_and_shot_backward() -> None:
    orbit = gsp.periodic_orbit(circle(-1), start={"x": 0.5, "y": 0.1}, backward=True)
    assert orbit.period == pytest.approx(PERIOD, rel=1e-12)
    assert not orbit.is_stable
    assert orbit.multipliers[1].real == pytest.approx(math.exp(2 * PERIOD), rel=1e-8)
    shot = gsp.shoot(orbit)
    assert shot.status.ok
    assert shot.period == pytest.approx(PERIOD, rel=1e-12)
    # In forward time.
    s = 0.3
    ahead = gsp.integrate(
        circle(-1), start=dict(zip("xy", orbit.at(s))), span=(0, 0.1 * orbit.period), rtol=1e-12
    )
    assert np.abs(ahead.at(ahead.t[-1]) - orbit.at(s + 0.1)).max() < 1e-7


def test_an_orbit_starts_the_search_at_other_parameters() -> None:
    a = sp.Symbol("a")
    system = gsp.SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=eps, parameters={a: 0})
    orbit = gsp.periodic_orbit(system, start={"x": 2, "y": 0}, epsilon=0.05)
    moved = gsp.periodic_orbit(system.with_parameters(a=0.05), start=orbit, epsilon=0.05)
    fresh = gsp.periodic_orbit(system.with_parameters(a=0.05), start={"x": 2, "y": 0}, epsilon=0.05)
    assert moved.period == pytest.approx(fresh.period, rel=1e-11)
    assert moved.constants == {"epsilon": 0.05, "a": 0.05}


def test_an_orbit_can_be_read_by_phase_and_by_name() -> None:
    radius = sp.Symbol("radius")
    flow = gsp.VectorField(CIRCLE, epsilon=None, observables={radius: sp.sqrt(x**2 + y**2)})
    orbit = gsp.periodic_orbit(flow, start={"x": 0.5, "y": 0})
    assert orbit.at(0.25) == pytest.approx(orbit.at(7.25), abs=1e-14)
    assert orbit.at([0.1, 0.2, 0.3]).shape == (2, 3)
    assert orbit["x"].shape == orbit.phases.shape
    assert orbit["x"][0] == orbit["x"][-1]
    assert orbit["radius"] == pytest.approx(1, abs=1e-9)
    assert orbit.maximum["x"] == pytest.approx(1, abs=1e-9)
    assert not any(array.flags.writeable for array in (orbit.multipliers, orbit.mesh))
    assert "PeriodicOrbit([x, y], period=7.255" in repr(orbit)
    assert "multipliers 1, " in str(orbit)
    with pytest.raises(GspError, match="no state and no observable"):
        orbit["radios"]
    with pytest.raises(GspError, match="phase"):
        orbit.at(math.nan)
    with pytest.raises(GspError, match="masked"):
        orbit.at(np.ma.array([0.1, 0.2], mask=[0, 1]))


def roessler(c: float) -> gsp.VectorField:
    value = sp.Symbol("c")
    return gsp.VectorField(
        {x: -y - z, y: x + y / 5, z: sp.Rational(1, 5) + z * (x - value)}, epsilon=None, parameters={value: c}
    )


@pytest.mark.exhaustive
def test_periods_are_minimal_on_both_sides_of_a_doubling() -> None:
    # Before it, at c = 2.8324, a run closes sooner after two laps than after one; behind it, almost after one.
    start = {"x": 1, "y": 1, "z": 0}
    before, behind = (gsp.periodic_orbit(roessler(c), start=start) for c in (2.8, 2.8325))
    assert before.period == pytest.approx(5.7679, abs=1e-3)
    assert behind.period == pytest.approx(2 * 5.7698, abs=1e-3)
    assert before.is_stable
    assert behind.is_stable
    thrice = gsp.periodic_orbit(circle(), start={"x": 1, "y": 0}, period=21.5)
    assert thrice.period == pytest.approx(PERIOD, rel=1e-12)


@pytest.mark.parametrize("height", sampled([0, 0.25, 0.5, 1], always=[0.25]))
def test_a_chaotic_run_leads_to_an_orbit_near_which_it_came_back_whenever_that_was(height: float) -> None:
    orbit = gsp.periodic_orbit(roessler(5.7), start={"x": 1, "y": 1, "z": height})
    assert orbit.status.ok
    assert orbit.unstable == 1


def test_crossings_are_phases() -> None:
    orbit = gsp.periodic_orbit(circle(), start={"x": 0.5, "y": 0})
    phases = orbit.crossings("x", 0.5)
    assert phases.shape == (2,)
    assert orbit.values("x", phases) == pytest.approx(0.5, abs=1e-9)
    # theta' = 1 + cos(theta)/2 from -pi/3 to pi/3: t = (4/sqrt(3)) atan(tan(theta/2)/sqrt(3)) in all.
    short = min(abs(phases[1] - phases[0]), 1 - abs(phases[1] - phases[0]))
    exact = 2 * (4 / math.sqrt(3)) * math.atan(math.tan(math.pi / 6) / math.sqrt(3))
    assert short * orbit.period == pytest.approx(exact, abs=1e-8)
    assert orbit.crossings("x", 2.0).size == 0


@pytest.mark.exhaustive
def test_a_reduced_flow_has_the_period_to_its_order() -> None:
    system = gsp.SlowFastSystem(
        slow={x: x - y - x * z, y: x + y - y * z + x**2 / 4}, fast={z: x**2 + y**2 + x / 2 - z}, epsilon=eps
    )
    branch = gsp.solve_critical(system).branches[0]
    start = {"x": 0.9, "y": 0.1}
    errors = {order: [] for order in (0, 1, 2)}
    for epsilon in (0.01, 0.005):
        full = gsp.periodic_orbit(system, start={**start, "z": 0.8}, epsilon=epsilon)
        for order in errors:
            flow = gsp.restrict(gsp.expand(branch, order=order), order=order)
            reduced = gsp.periodic_orbit(flow, start=start, epsilon=epsilon)
            errors[order].append(abs(reduced.period - full.period))
    for order, (coarse, fine) in errors.items():
        assert math.log2(coarse / fine) == pytest.approx(order + 1, abs=0.15)


# -- endings -----------------------------------------------------------------------------------------


def test_a_run_that_settles_names_the_equilibrium() -> None:
    a = sp.Symbol("a")
    system = gsp.SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=eps, parameters={a: 1.2})
    with pytest.raises(OrbitError, match=r"settles at the equilibrium y = -0.624, x = 1.2\. Got start x = 2"):
        gsp.periodic_orbit(system, start={"x": 2, "y": 0.1}, epsilon=0.05)


@pytest.mark.parametrize(
    ("rates", "said"),
    [
        (
            {x: y, y: -x},
            "no isolated orbit here: the run from start closes by itself, and so do its neighbours",
        ),
        ({x: y - x**3 / 100, y: -x}, "no isolated orbit"),
        ({x: x**2}, "STEP_TOO_SMALL.* at an epsilon of about 1e-14 and below; then raise epsilon"),
        ({x: 1 + 0 * x}, "leaves for infinity"),
        ({x: sp.sin(x)}, "equilibrium x = 3.14159"),
    ],
    ids=["centre", "slow focus", "blow-up", "drift", "line"],
)
def test_flows_without_an_isolated_cycle_are_named(rates, said: str) -> None:
    with pytest.raises(OrbitError, match=said):
        gsp.periodic_orbit(
            gsp.VectorField(rates, epsilon=None), start={s.name: 1.0 if s is x else 0.0 for s in rates}
        )


CONSERVATIVE = {
    "centre": ({x: y, y: -x}, (1, 0)),
    "Lotka and Volterra": ({x: x * (1 - y), y: y * (x - 1)}, (2, 1)),
    "cubic": ({x: y, y: -(x**3)}, (1, 0)),
    "pendulum": ({x: y, y: -sp.sin(x)}, (2, 0)),
    "Euler's top": ({x: y * z, y: -2 * x * z, z: x * y / 2}, (1, 0.1, 0.2)),
}


def moved(rates, start, seed: int):
    """The same flow in coordinates turned, stretched and shifted at random, and its start."""
    rng = np.random.default_rng(seed)
    n = len(rates)
    M = np.linalg.qr(rng.normal(size=(n, n)))[0] @ np.diag(10.0 ** rng.uniform(-1, 1, n))
    c = rng.normal(size=n)
    new = sp.Matrix(sp.symbols(f"w:{n}"))
    there = dict(zip(rates, sp.Matrix(np.linalg.inv(M)) * (new - sp.Matrix(c))))
    turned = sp.Matrix(M) * sp.Matrix(list(rates.values())).xreplace(there)
    flow = gsp.VectorField(dict(zip(new, turned)), epsilon=None)
    return flow, dict(zip((s.name for s in new), map(float, M @ np.array(start, dtype=float) + c)))


@pytest.mark.parametrize("seed", sampled([0, 1, 2], always=[1]))
@pytest.mark.parametrize("name", CONSERVATIVE)
def test_orbits_of_conservative_flows_are_not_isolated_in_any_coordinates(name: str, seed: int) -> None:
    flow, start = moved(*CONSERVATIVE[name], seed)
    with pytest.raises(OrbitError, match="no isolated orbit here") as caught:
        gsp.periodic_orbit(flow, start=start)
    # A tenth of the limit at most, whatever rounding does.
    assert float(re.search(r"isolation (\S+),", str(caught.value))[1]) < 0.1 * ISOLATED


@pytest.mark.exhaustive
@pytest.mark.parametrize("share", [1e-2, 1e-4, 1e-6])
def test_a_cycle_that_hardly_attracts_is_isolated_all_the_same(share: float) -> None:
    flow, start = moved({x: y, y: -x + share * (1 - x**2) * y}, (1, 0), 0)
    orbit = gsp.periodic_orbit(flow, start=start)
    assert orbit.status.ok
    # The multiplier is exp(-2 pi share) but for share^2.
    assert -orbit.divergence == pytest.approx(2 * math.pi * share, rel=1e-3)


@pytest.mark.parametrize("epsilon", [1.0, 1e-2, 1e-5, 1e-8])
def test_isolation_of_a_relaxation_oscillation_does_not_depend_on_epsilon(epsilon: float) -> None:
    orbit = gsp.periodic_orbit(van_der_pol(), start={"x": 2, "y": 0}, epsilon=epsilon)
    problem = OrbitProblem(van_der_pol(), parameter_vector(van_der_pol(), epsilon))
    assert 0.5 < isolation_of(problem, orbit._cycle) < 0.8


def test_an_orbit_of_a_family_is_refused_from_an_orbit_nearby_too() -> None:
    a = sp.Symbol("a")
    flow = gsp.VectorField({x: y, y: -x + a * (1 - x**2) * y}, epsilon=None, parameters={a: 1e-6})
    orbit = gsp.periodic_orbit(flow, start={"x": 1, "y": 0})
    assert orbit.status.ok
    with pytest.raises(OrbitError, match="no isolated orbit here"):
        gsp.periodic_orbit(flow.with_parameters(a=0), start=orbit)


def test_too_few_intervals_are_a_status_with_the_error_that_was_reached() -> None:
    orbit = gsp.periodic_orbit(van_der_pol(), start={"x": 2, "y": 0}, epsilon=0.01, max_intervals=20)
    assert orbit.status is Status.MESH_LIMIT
    assert 1e-9 < orbit.error < 1e-2
    assert "raise max_intervals" in orbit.message
    assert orbit.period == pytest.approx(1.9078369566939, rel=1e-4)
    digits = re.search(r"period (\S+) \(relative error (\S+)\)", str(orbit))
    assert len(digits[1].replace(".", "")) <= 1 - math.log10(float(digits[2]))


def test_a_period_that_is_far_off_does_not_converge_and_says_so() -> None:
    orbit = gsp.periodic_orbit(van_der_pol(), start={"x": 2, "y": 0}, epsilon=0.1, period=0.3)
    assert orbit.status is Status.NOT_CONVERGED
    assert "stopped after" in orbit.message
    # What is no orbit has no period, no multipliers and no stability to show.
    for shown in (str(orbit), repr(orbit)):
        assert "NOT_CONVERGED" in shown
        for word in ("inf", "nan", "period ", "period=", "stable", "multipliers", f"{orbit.period:.3g}"):
            assert word not in shown, shown


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"start": {"x": 1, "q": 0}}, 'names "q"'),
        ({"epsilon": None}, "depends on epsilon"),
        ({"tolerance": 1e-20}, "tolerance is a share"),
        ({"degree": 1}, "degree is a whole number"),
        ({"max_steps": 0}, "max_steps"),
    ],
)
def test_wrong_calls_say_what_is_wrong(options, said: str) -> None:
    given = {"start": {"x": 2, "y": 0}, "epsilon": 0.1, **options}
    with pytest.raises(DeclarationError, match=said):
        gsp.periodic_orbit(van_der_pol(), **given)


def test_an_orbit_of_another_flow_is_refused() -> None:
    orbit = gsp.periodic_orbit(circle(), start={"x": 0.5, "y": 0})
    with pytest.raises(DeclarationError, match="another flow"):
        gsp.periodic_orbit(van_der_pol(), start=orbit, epsilon=0.1)


def test_an_equilibrium_below_the_tolerance_is_zero() -> None:
    sink = gsp.SlowFastSystem(slow={y: -y}, fast={x: y - x}, epsilon=eps)
    with pytest.raises(OrbitError, match="settles at the equilibrium y = 0, x = 0"):
        gsp.periodic_orbit(sink, start={"y": 1, "x": 1}, epsilon=0.05)


@pytest.mark.parametrize(
    ("error", "shown"),
    [
        (1e-6, "6.28319"),
        (9e-4, "6.28"),
        (0.5, "6"),
        (3.0, "6"),
        (0.0, "6.28318530717959"),
        (1e-30, "6.28318530717959"),
    ],
)
def test_a_period_is_shown_to_the_digits_that_its_error_leaves(error: float, shown: str) -> None:
    orbit = SimpleNamespace(period=2 * np.pi, period_error=error)
    assert PeriodicOrbit._period_shown.fget(orbit) == shown  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize("unit", [sp.Rational(1, 10**18), sp.Rational(1, 10**13)])
def test_a_cycle_is_found_in_units_in_which_it_is_smaller_than_tolerances(unit) -> None:
    # Van der Pol's in amounts of moles: the run was said to settle at an equilibrium.
    scaled = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / (3 * unit**2) + x}, epsilon=eps)
    orbit = gsp.periodic_orbit(scaled, start={"x": 2 * float(unit), "y": 0}, epsilon=0.01)
    assert orbit.period == pytest.approx(1.9078369566939, abs=1e-11)
    assert gsp.periodic_orbit(
        scaled, start={"x": 2 * float(unit), "y": 0}, epsilon=0.01, period=1.9
    ).period == (pytest.approx(1.9078369566939, abs=1e-11))


@pytest.mark.parametrize("units", [(1, 1, R(1, 10**15)), (10**9, 1, R(1, 10**9)), (1, 1, 10**20)])
def test_a_cycle_and_its_family_do_not_depend_on_how_far_apart_units_are(units) -> None:
    m = sp.Symbol("m")
    rates = (m * x - y - x * (x**2 + y**2) + z / 10, x + m * y - y * (x**2 + y**2), x**2 - z)
    size = dict(zip((x, y, z), units))

    def found(chosen: dict) -> tuple:
        within = {s: s / chosen[s] for s in chosen}
        field = gsp.VectorField(
            {s: chosen[s] * rate.xreplace(within) for s, rate in zip(chosen, rates)}, parameters={m: R(1, 2)}
        )
        orbit = gsp.periodic_orbit(field, start={"x": float(chosen[x]), "y": 0, "z": float(chosen[z])})
        family = gsp.continue_orbits(orbit, parameter=m, bounds=(0.1, 0.5), direction=-1)
        return orbit, family

    here, there = found(dict.fromkeys((x, y, z), sp.S.One)), found(size)
    assert there[0].period == pytest.approx(here[0].period, rel=1e-12)
    # Of a pair either may come first.
    sizes = [np.sort(np.abs(orbit.multipliers)) for orbit, _ in (here, there)]
    assert sizes[1] == pytest.approx(sizes[0], abs=1e-9)
    assert there[0].error < 1e-8
    assert there[1].period[-1] == pytest.approx(here[1].period[-1], rel=1e-9)


def test_a_run_that_crosses_an_invariant_axis_says_so_and_its_remedy_finds_the_cycle() -> None:
    # Along x = 0 orbits come as near as 1e-21; u = ln x. The run left for infinity, or settled at x < 0.
    prey = 1 - x - y / (sp.Rational(1, 4) + x)
    predator = y * (x / (sp.Rational(1, 4) + x) - sp.Rational(1, 3))
    plain = gsp.SlowFastSystem(slow={y: predator}, fast={x: x * prey}, epsilon=eps)
    with pytest.raises(OrbitError, match=r"crosses x = 0, .*Take ln\(x\) for a state"):
        gsp.periodic_orbit(plain, start={"x": 0.8, "y": 0.2}, epsilon=0.01)
    u = sp.Symbol("u")
    put_in = {x: sp.exp(u)}
    logarithmic = gsp.SlowFastSystem(
        slow={y: predator.xreplace(put_in)}, fast={u: prey.xreplace(put_in)}, epsilon=eps
    )
    orbit = gsp.periodic_orbit(logarithmic, start={"u": float(np.log(0.8)), "y": 0.2}, epsilon=0.01)
    # Radau of SciPy in ln x and ln y at a relative tolerance of 1e-11.
    assert orbit.period == pytest.approx(6.290000125062, abs=1e-10)


@pytest.mark.parametrize(
    ("rates", "place"),
    [
        ({x: y, y: -x - y / 10}, "x = 0, y = 0"),
        ({x: x * (1 - x), y: -y}, "x = 1, y = "),
        ({x: x * (1 - x - 2 * y), y: y * (1 - y - 2 * x)}, "x = 1, y = "),
    ],
    ids=["a damped spring", "logistic growth", "competition"],
)
def test_a_run_that_comes_to_rest_to_the_last_bit_settles_at_the_equilibrium(rates, place: str) -> None:
    # Steps grow without bound there: the end was called infinity, and steps of 1e140 were taken for a lap.
    with pytest.raises(OrbitError, match=f"settles at the equilibrium {place}"):
        gsp.periodic_orbit(gsp.VectorField(rates, epsilon=None), start={"x": 0.5, "y": 0.1})


HERD = sp.sqrt(x) / (1 + R(3, 2) * sp.sqrt(x))


@pytest.mark.parametrize(
    "rates",
    [{x: -sp.sqrt(x) - 1, y: -y}, {x: 2 * x * (1 - x) - 2 * HERD * y, y: y * (HERD - R(1, 5))}],
    ids=["a draining tank", "a herd that dies out"],
)
def test_a_run_that_leaves_the_domain_of_the_field_is_at_no_rest(rates) -> None:
    # Its last steps shrink towards the edge, where the rates are not 0.
    with pytest.raises(OrbitError, match="ends with NON_FINITE"):
        gsp.periodic_orbit(gsp.VectorField(rates), start={"x": 0.3, "y": 0.6})


def test_a_run_that_goes_on_at_a_constant_speed_leaves_for_infinity() -> None:
    with pytest.raises(OrbitError, match="leaves for infinity"):
        gsp.periodic_orbit(gsp.VectorField({x: 1 + y, y: -y}, epsilon=None), start={"x": 0.5, "y": 0.1})


def test_a_cycle_that_comes_close_to_an_axis_has_the_period_of_its_logarithms() -> None:
    # The prey falls to 2e-10; how far from there to its axis is in no amplitude, but in the time to come back.
    prey, predator = (lambda x, y: 1 - x - y / (x + R(1, 4))), (lambda x, y: x / (x + R(1, 4)) - R(1, 3))
    plain = gsp.SlowFastSystem(slow={y: y * predator(x, y)}, fast={x: x * prey(x, y)}, epsilon=eps)
    u, v = sp.symbols("u v")
    rates = predator(sp.exp(u), sp.exp(v)), prey(sp.exp(u), sp.exp(v))
    logarithms = gsp.SlowFastSystem(slow={v: rates[0]}, fast={u: rates[1]}, epsilon=eps)
    found = gsp.periodic_orbit(plain, start={"x": 0.8, "y": 0.2}, epsilon=0.03)
    second = gsp.periodic_orbit(logarithms, start={"u": math.log(0.8), "v": math.log(0.2)}, epsilon=0.03)
    assert found.status is second.status is Status.SUCCESS
    assert found["x"].min() < 1e-9
    assert found.period == pytest.approx(second.period, rel=1e-10)
    # Between the places of the mesh, which are not the same.
    assert found.minimum["x"] == pytest.approx(math.exp(second.minimum["u"]), rel=1e-6)


@pytest.mark.parametrize("far", [1000, -(10**6)])
def test_an_orbit_does_not_depend_on_where_its_states_have_their_origin(far: int) -> None:
    # It comes as near u = 0 as exp(-9): from -1e6 the run left for infinity.
    plain = scene("rosenzweig_macarthur")
    moved = shifted(plain, {"u": far, "v": far})
    here, there = (
        gsp.periodic_orbit(asked.system, start=asked.start, epsilon=asked.epsilon) for asked in (plain, moved)
    )
    assert there.period == pytest.approx(here.period, rel=1e-12)
    assert there.multipliers == pytest.approx(here.multipliers, rel=1e-6, abs=1e-30)
    assert there.amplitude == pytest.approx(here.amplitude, rel=1e-8)
    assert there.maximum["u"] == pytest.approx(far + here.maximum["u"], rel=1e-12)
    shot = gsp.shoot(there)
    assert shot.status.ok
    assert shot.period == pytest.approx(here.period, rel=1e-12)
    assert shot.point == pytest.approx({s.name: v for s, v in zip(there.flow.states, there.at(0.0))}, rel=1e-12)
    again = gsp.periodic_orbit(moved.system, start=there, epsilon=plain.epsilon)
    assert again.period == pytest.approx(here.period, rel=1e-12)


def test_messages_name_places_of_a_flow_far_from_the_origin() -> None:
    at = x - 10**6 - R(1, 4)
    resting = gsp.VectorField({x: y, y: -at - at**3 - y})
    with pytest.raises(OrbitError, match=r"settles at the equilibrium x = 1000000\.25, y = 0\.") as caught:
        gsp.periodic_orbit(resting, start={"x": 10**6 + 0.5, "y": 0})
    assert "start x = 1000000.5, y = 0." in str(caught.value)
