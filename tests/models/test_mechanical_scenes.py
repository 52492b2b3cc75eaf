"""The mechanical scenes against closed forms, and the page on mechanics against what the package prints."""

import contextlib
import io
import re
import runpy
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp import models
from gsp.errors import GspError
from gsp.integration.trajectory import Method
from gsp.mechanics import FrictionSystem, LagrangianSystem

ROOT = Path(__file__).parent.parent.parent
STIFF = {"rtol": 1e-12, "atol": 1e-14}
TIGHT = {"rtol": 1e-13, "atol": 1e-14, "method": Method.DOP853}
SCENES = models.mechanical()[:-2]


def limit_run(name: str, times, **start: float):
    """The run of the constrained system from `start`, other positions at 0."""
    field = models.friction_system(name).limit.full_field
    begin = dict.fromkeys((s.name for s in field.states), 0.0) | start
    return gsp.integrate(field, start=begin, span=(0, times[-1]), at=times, **TIGHT)


def series_of(name: str, order: int):
    system = models.friction_system(name)
    return gsp.expand(gsp.solve_critical(system.standard_form).branches[0], order=order)


# -- the table -------------------------------------------------------------------------------------


def test_every_mechanical_name_gives_its_lagrangian_system() -> None:
    for name in models.mechanical():
        system = models.lagrangian_system(name)
        assert isinstance(system, LagrangianSystem)
        assert system.name == name
    for name in SCENES:
        assert isinstance(models.friction_system(name), FrictionSystem)
        assert name in models.names()
    with pytest.raises(GspError, match=r'no system with friction "falling_particle".*rolling_disc'):
        models.friction_system("falling_particle")
    with pytest.raises(GspError, match=r'no mechanical system "kar".*Did you mean "car"'):
        models.lagrangian_system("kar")


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", SCENES)
def test_friction_is_the_limit_of_its_constraints(name: str) -> None:
    system = models.friction_system(name)
    assert system.slip_defect() == (0,) * len(system.constraints)
    assert system.limit.virtual_work() == (0,) * len(system.frame.along)
    assert not system.limit.is_holonomic


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", sorted(set(SCENES) - {"rolling_disc", "rolling_ball"}))
def test_the_slope_of_order_n_is_n_plus_one(name: str) -> None:
    comparison = gsp.compare(models.load(name), orders=(0, 1, 2, 3))
    for order, slope in comparison.slopes.items():
        assert slope == pytest.approx(order + 1, abs=0.1)


@pytest.mark.exhaustive
def test_on_a_disc_order_one_is_as_good_as_order_two() -> None:
    comparison = gsp.compare(models.load("rolling_disc"), orders=(0, 1, 2, 3))
    assert list(comparison.slopes.values()) == pytest.approx([1, 3, 3, 5], abs=0.1)
    assert all(h.is_zero for h in series_of("rolling_disc", 2).reduced_field[2])


# -- without constraints ---------------------------------------------------------------------------


def test_a_particle_in_gravity_falls_on_a_parabola() -> None:
    field = models.lagrangian_system("falling_particle").euler_lagrange()
    times = np.linspace(0, 2, 9)
    start = {"x": 0, "y": 1, "z": 3, "xdot": 1, "ydot": -2, "zdot": 4}
    run = gsp.integrate(field, start=start, span=(0, 2), at=times, **TIGHT)
    np.testing.assert_allclose(run["x"], times, rtol=0, atol=1e-11)
    np.testing.assert_allclose(run["y"], 1 - 2 * times, rtol=0, atol=1e-11)
    np.testing.assert_allclose(run["z"], 3 + 4 * times - 9.81 * times**2 / 2, rtol=0, atol=1e-11)


def test_a_free_particle_seen_from_a_rotating_frame_moves_straight() -> None:
    field = models.lagrangian_system("rotating_frame").euler_lagrange()
    times = np.linspace(0, 9, 10)
    start = {"x": 1, "y": 0.5, "xdot": -0.3, "ydot": 0.8, **{s.name: 0 for s in field.states[4:]}}
    run = gsp.integrate(field, start=start, span=(0, 9), at=times, **TIGHT)
    seen = np.exp(0.7j * times) * (run["x"] + 1j * run["y"])
    velocity = -0.3 + 0.8j + 0.7j * (1 + 0.5j)
    np.testing.assert_allclose(seen, 1 + 0.5j + velocity * times, rtol=0, atol=1e-9)


# -- sliding ---------------------------------------------------------------------------------------


def test_the_derived_sleigh_is_the_typed_one_exactly() -> None:
    ours, home = models.load("sleigh_from_lagrangian"), models.load("chaplygin_sleigh")
    assert ours.system.states == home.system.states
    assert dict(ours.system.parameters) == dict(home.system.parameters)
    for flow in (ours.full_flow, home.full_flow):
        assert set(flow.equations) == set(sp.symbols("v omega w x y phi"))
    for symbol, rate in ours.full_flow.equations.items():
        assert sp.cancel(rate - home.full_flow.equations[symbol]) == 0


def test_a_spinning_sleigh_goes_ahead_like_a_hyperbolic_tangent() -> None:
    times = np.linspace(0, 10, 11)
    run = limit_run("sleigh_from_lagrangian", times, omega=2)
    speed = 2 * np.sqrt(1.04)
    np.testing.assert_allclose(run["v"], speed * np.tanh(0.2 * speed * times / 1.04), rtol=0, atol=1e-10)


def test_a_knife_edge_moves_on_a_cycloid_across_the_slope() -> None:
    times, rate, G, speed = np.linspace(0, 6, 13), 1.3, 9.81 * np.sin(0.2), 0.4
    down = -np.pi / 2
    run = limit_run("knife_edge", times, phi=down, omega=rate)
    angle = rate * times
    across = G * (angle - np.sin(2 * angle) / 2) / (2 * rate**2)
    height = -G * np.sin(angle) ** 2 / (2 * rate**2)
    np.testing.assert_allclose(run["x"], across, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run["y"], height, rtol=0, atol=1e-9)
    pushed = limit_run("knife_edge", times, phi=down, omega=rate, v=speed)
    np.testing.assert_allclose(pushed["x"], across + speed * (1 - np.cos(angle)) / rate, rtol=0, atol=1e-9)
    np.testing.assert_allclose(pushed["y"], height - speed * np.sin(angle) / rate, rtol=0, atol=1e-9)


@pytest.mark.parametrize("rate", [1.0, 1.7])
def test_with_friction_the_knife_edge_creeps_downhill_whatever_its_turning(rate: float) -> None:
    field = models.friction_system("knife_edge").full_field
    G, epsilon, turn = 9.81 * np.sin(0.2), 1e-3, 2 * np.pi / rate
    start = {"phi": -np.pi / 2, "v": 0, "omega": rate, "w": 0, "x": 0, "y": 0}
    run = gsp.integrate(field, start=start, span=(0, turn), epsilon=epsilon, **STIFF)
    assert run["y"][-1] / (-2 * epsilon * G * turn) == pytest.approx(1, abs=5 * epsilon)


def test_the_nonholonomic_particle_moves_on_a_catenary() -> None:
    times, ahead, turning = np.linspace(0, 4, 9), 0.8, 1.1
    run = limit_run("nonholonomic_particle", times, xdot=ahead, ydot=turning)
    c_over_b = ahead / turning
    np.testing.assert_allclose(run["x"], c_over_b * np.arcsinh(turning * times), rtol=0, atol=1e-9)
    catenary = c_over_b * (np.cosh(run["x"] / c_over_b) - 1)
    np.testing.assert_allclose(run["z"], catenary, rtol=0, atol=1e-9)


# -- rolling ---------------------------------------------------------------------------------------


def test_the_contact_point_of_a_rolling_disc_moves_on_a_circle() -> None:
    times = np.linspace(0, 7, 15)
    run = limit_run("rolling_disc", times, phidot=0.8, thetadot=2, x=1, y=-2, phi=0.3)
    radius = 2 / 0.8
    centre = 1 - radius * np.sin(0.3), -2 + radius * np.cos(0.3)
    np.testing.assert_allclose(np.hypot(run["x"] - centre[0], run["y"] - centre[1]), radius, rtol=0, atol=1e-9)


def test_a_slipping_disc_loses_its_rolling_at_the_rate_of_its_docstring() -> None:
    m, R, K, p, phidot = sp.symbols("m R K p phidot")
    first = series_of("rolling_disc", 1).reduced_field[1].as_dict()
    wanted = -((m * R * phidot) ** 2) / (K + m * R**2) * p
    assert sp.cancel(first[p] - wanted) == 0


def test_upright_rolling_is_stable_beyond_the_speed_of_its_docstring() -> None:
    limit = models.friction_system("falling_disc").limit.reduced
    A, C, m, g, R, psidot = sp.symbols("A C m g R psidot")
    upright = dict.fromkeys(sp.symbols("theta phidot thetadot"), 0)
    matrix = sp.Matrix(limit.rates).jacobian(limit.states).subs(upright).applyfunc(sp.cancel)
    z = sp.Symbol("z")
    squared = [root**2 for root in sp.roots(matrix.charpoly(z).as_expr(), z) if root != 0]
    growth = (m * g * R - C * (C + m * R**2) * psidot**2 / A) / (A + m * R**2)
    assert squared
    for value in squared:
        assert sp.simplify(value - growth) == 0


def test_a_ball_on_a_plane_rolls_straight_and_every_correction_vanishes() -> None:
    for coefficient in series_of("rolling_ball", 4).coefficients:
        assert tuple(coefficient) == (0, 0)
    times = np.linspace(0, 3, 7)
    run = limit_run("rolling_ball", times, q0=1, omega_x=0.4, omega_y=-0.7, omega_z=0.3)
    np.testing.assert_allclose(run["x"], -0.7 * times, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run["y"], -0.4 * times, rtol=0, atol=1e-9)


def test_the_slip_of_a_ball_decays_exponentially_onto_its_base_point() -> None:
    field = models.friction_system("rolling_ball").full_field
    epsilon, rate, share = 0.2, 1 + 1 / 0.4, 1 / (1 + 1 / 0.4)
    slip, spin = np.array([2.1, -1.4]), np.array([0.6, -0.5])
    start = {"omega_x": spin[0], "omega_y": spin[1], "omega_z": 0.3, "s1": slip[0], "s2": slip[1]}
    start |= {"x": 0, "y": 0, "q0": 1, "q1": 0, "q2": 0, "q3": 0}
    times = np.linspace(0, 0.5, 11)
    run = gsp.integrate(field, start=start, span=(0, 0.5), epsilon=epsilon, at=times, **TIGHT)
    decay = np.exp(-rate * times / epsilon)
    np.testing.assert_allclose(run["s1"], slip[0] * decay, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run["s2"], slip[1] * decay, rtol=0, atol=1e-9)
    # R = 1: the ball's velocity is (omega_y, -omega_x) + slip, and tends to v0 - s0/(1 + m R^2/J).
    thrown = np.array([spin[1], -spin[0]]) + slip
    base = thrown - share * slip
    velocity = np.stack([run["omega_y"] + run["s1"], -run["omega_x"] + run["s2"]], axis=1)
    np.testing.assert_allclose(velocity, base + share * slip * decay[:, None], rtol=0, atol=1e-9)
    way = base * times[:, None] + share * slip * epsilon / rate * (1 - decay[:, None])
    np.testing.assert_allclose(np.stack([run["x"], run["y"]], axis=1), way, rtol=0, atol=1e-9)


def test_a_ball_on_a_turntable_moves_on_circles_at_two_sevenths_of_its_rate() -> None:
    times = np.linspace(0, 8, 17)
    run = limit_run("ball_on_turntable", times, x=0.4, y=0.1, q0=1, omega_x=0.7, omega_y=-0.2)
    place, turning = run["x"] + 1j * run["y"], 3 * 2 / 7
    velocity = (-3 * 0.1 - 0.2) + 1j * (3 * 0.4 - 0.7)
    circle = place[0] + velocity * (np.exp(1j * turning * times) - 1) / (1j * turning)
    np.testing.assert_allclose(place, circle, rtol=0, atol=1e-9)


# -- the car ---------------------------------------------------------------------------------------


def test_a_parking_manoeuvre_moves_the_car_sideways_and_nothing_else() -> None:
    turns = 2 * np.pi * np.arange(3)
    run = limit_run("car", turns, sigmadot=1)
    for name in ("x", "phi", "sigma", "u"):
        np.testing.assert_allclose(run[name], 0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run["y"][2], 2 * run["y"][1], rtol=0, atol=1e-9)
    assert run["y"][1] == pytest.approx(np.pi / 4, rel=0.1)
    # The bracket direction: steering the other way parks on the other side; small angles give pi A^2 b/(4 l).
    assert limit_run("car", turns, sigmadot=-1)["y"][1] == pytest.approx(-run["y"][1], abs=1e-9)
    small = limit_run("car", turns, sigmadot=1e-2)["y"][1]
    assert small / 1e-2 == pytest.approx(np.pi / 4, rel=1e-3)
    assert models.friction_system("car").limit.growth_vector == (2, 3, 4)


@pytest.mark.exhaustive
def test_with_tyres_that_slip_the_manoeuvre_closes_up_to_epsilon() -> None:
    scene = models.load("car")
    gaps = []
    for epsilon in (0.02, 0.01):
        run = gsp.integrate(
            scene.full_flow, start=scene.full_start, span=(0, 2 * np.pi), epsilon=epsilon, **STIFF
        )
        gaps.append(abs(run["x"][-1]))
    assert gaps[0] / gaps[1] == pytest.approx(2, abs=0.1)


# -- the page and the creeping tyre ----------------------------------------------------------------


@pytest.mark.exhaustive
@pytest.mark.parametrize(("name", "least"), [("mechanics.md", 10), ("no-slip.md", 3)])
def test_a_page_shows_what_its_code_prints(name: str, least: int) -> None:
    page = (ROOT / "docs" / name).read_text(encoding="utf-8")
    names: dict = {}
    shown = 0
    for block, _, text in re.findall(
        r"^```python\n(.*?)^```\n(\n```text\n(.*?)^```)?", page, re.DOTALL | re.MULTILINE
    ):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block, name, "exec"), names)
        assert printed.getvalue() == text
        shown += bool(text)
    assert shown > least


# As the lecture prints them, with its slip in (18) mended; v, w, omega and symbols as on the page.
LECTURE = {
    r"lambda = (.*)": "m*(v*omega - a**2*m*v*omega/(I + m*a**2))",
    r"epsilon\^0 in v': (.*)": "a*omega**2",
    r"epsilon\^0 in omega': (.*)": "-m*a*v*omega/(I + m*a**2)",
    r"epsilon\^1 in v': (.*)": "-I*m*v*omega**2/(I + m*a**2)",
    r"epsilon\^1 in omega': (.*)": ("I*m**2*a/(I + m*a**2)**2*(a*omega**3 - m*a*v**2*omega/(I + m*a**2))"),
    r"-rho = (.*)": "-(I + m*a**2)/(I*m*epsilon)",
    r"at rest w = (.*)": "-v*omega*I*m*epsilon/(I + m*a**2)",
    r"x: (.*)": "m*xddot + m*a*(-phiddot*sin(phi) - phidot**2*cos(phi))",
    r"y: (.*)": "m*yddot + m*a*(phiddot*cos(phi) - phidot**2*sin(phi))",
}


@pytest.mark.parametrize("pattern", list(LECTURE))
def test_a_formula_on_the_page_is_the_lectures(pattern: str) -> None:
    page = (ROOT / "docs" / "mechanics.md").read_text(encoding="utf-8")
    (found, *_) = re.findall(rf"^{pattern}$", page, re.MULTILINE)
    own = {"I": sp.Symbol("I")}
    assert sp.cancel(sp.sympify(found, own) - sp.sympify(LECTURE[pattern], own)) == 0


def test_a_block_creeps_in_a_simulator_as_the_first_order_says() -> None:
    """Twenty runs of MuJoCo within 0.1 %, among them 507.7, 50.77, 5.077 and 0.5077 um/s."""
    example = runpy.run_path(str(ROOT / "examples" / "mechanics" / "simulator_creep.py"))
    assert example["worst"] < 1e-3
    assert 1e6 * example["expected"][:4] == pytest.approx([507.8732, 50.7873, 5.0787, 0.5079], rel=1e-3)


def test_the_tyre_creeps_as_far_as_the_first_order_says() -> None:
    example = runpy.run_path(str(ROOT / "examples" / "mechanics" / "creep.py"))
    tyre = example["tyre"]()
    for speed in (2.0, 20.0):
        row = example["creep"](tyre, speed)
        small = example["MASS"] * speed**2 / (example["RADIUS"] * example["STIFFNESS"])
        estimate = (2 - np.pi / 2) * example["RADIUS"] * small
        assert abs(row["order 0"]) < 1e-5
        assert row["full"] == pytest.approx(estimate, rel=3 * small)
        assert row["order 1"] == pytest.approx(row["full"], rel=3 * small)
    assert row["full"] == pytest.approx(1.307, abs=1e-3)
