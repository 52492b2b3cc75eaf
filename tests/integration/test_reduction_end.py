"""How runs end: a reduced flow at a loss of normal hyperbolicity, any flow at what stops it."""

from __future__ import annotations

import re

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import BranchError, HyperbolicityError, Status
from gsp.integration.pieces import RunPiece
from gsp.integration.reduction_end.endings import Ending
from gsp.integration.reduction_end.fast_blocks import FastBlocks, faddeev_leverrier
from gsp.integration.reduction_end.validity import Validity
from gsp.integration.trajectory import Method, Trajectory, integrate
from gsp.integration.watched import Stepper
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.systems.system import SlowFastSystem, VectorField
from tests import example_systems as systems
from tests.cases import thinned

eps = systems.epsilon
x, y, z, w = sp.symbols("x y z w")
# f = 1 needs a symbol to be no Python number.
ONE = sp.Integer(1)


def run(system, start, *, order=0, span=(0, 5), epsilon=1e-3, near=None, **options) -> Trajectory:
    branch = gsp.solve_critical(system).nearest(near or start)
    flow = gsp.restrict(gsp.expand(branch, order=order))
    return integrate(flow, start=start, span=span, epsilon=epsilon, **options)


VAN_DER_POL = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=eps, name="van der Pol, a = 0")
ON_VAN_DER_POL = {"x": 2, "y": 2 / 3}
# t = (x^2 - 1)/2 - ln x from x = 2 to the fold, by y' = (x^2 - 1) x' = -x.
FOLD_TIME = 1.5 - np.log(2)


def position(left: np.ndarray) -> np.ndarray:
    """x on van der Pol's right sheet at the time `left` before the fold, by bisection."""
    low, high = np.ones_like(left), np.full_like(left, 3.0)
    for _ in range(80):
        middle = 0.5 * (low + high)
        below = 0.5 * (middle**2 - 1) - np.log(middle) < left
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


# Folds


@pytest.mark.parametrize("rtol", [1e-5, 1e-8, 1e-11])
@pytest.mark.parametrize("method", [Method.DOP853, Method.RADAU9])
def test_van_der_pol_reaches_its_fold_at_the_exact_time_and_place(rtol, method):
    trajectory = run(VAN_DER_POL, ON_VAN_DER_POL, rtol=rtol, atol=rtol / 100, method=method)
    assert trajectory.status is Status.FOLD_REACHED
    assert trajectory.t[-1] == pytest.approx(FOLD_TIME, abs=3 * rtol)
    assert trajectory["x0"][-1] == pytest.approx(1.0, abs=1e-12)
    assert trajectory["y"][-1] == pytest.approx(-2 / 3, abs=1e-12)
    assert "the fold of the critical manifold at y = -0.666667, x = 1" in trajectory.message
    assert trajectory.message.endswith("integrate the full system across the fold")


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [-40, 40])
def test_how_a_run_ends_does_not_depend_on_the_unit_of_the_fast_rate(power):
    unit = sp.Integer(2) ** power
    scaled = SlowFastSystem(slow={y: -x}, fast={x: unit * (y - x**3 / 3 + x)}, epsilon=eps)
    plain, other = (run(system, ON_VAN_DER_POL) for system in (VAN_DER_POL, scaled))
    assert (other.status, other.message) == (plain.status, plain.message)
    assert other.t[-1] == pytest.approx(plain.t[-1], rel=1e-12)
    crossed = SlowFastSystem(slow={x: ONE}, fast={y: unit * (x - 1) * y}, epsilon=eps)
    lost = run(crossed, {"x": 0, "y": 0}, span=(0, 3))
    assert lost.status is Status.HYPERBOLICITY_LOST
    assert lost.t[-1] == pytest.approx(1.0, rel=1e-9)


def test_a_run_into_a_fold_is_exact_up_to_it():
    trajectory = run(VAN_DER_POL, ON_VAN_DER_POL, rtol=1e-10, atol=1e-12)
    end = trajectory.t[-1]
    times = np.concatenate([np.linspace(0, end, 500), end - np.geomspace(1e-13, 1e-2, 200)])
    exact = position(end - times)
    # As a function of the time that is left, which knows the fold as the run does.
    assert trajectory.at(times)[0] == pytest.approx(exact, abs=1e-8)
    assert np.all(np.diff(trajectory.t) > 0)
    assert trajectory.t.size == trajectory.stats.steps + 1
    assert trajectory.stats.steps < 150


@pytest.mark.parametrize("sheet", [-1, 1])
def test_the_fold_of_a_graph_with_a_root_is_reached(sheet):
    # x' = (x^2 + y)/epsilon, y' = 1 reaches y = 0 at t = -y(0), along x = +-sqrt(-y), where the field is regular.
    system = SlowFastSystem(slow={y: ONE}, fast={x: x**2 + y}, epsilon=eps)
    trajectory = run(system, {"x": sheet, "y": -1}, span=(0, 3))
    assert trajectory.status is Status.FOLD_REACHED
    assert trajectory.t[-1] == pytest.approx(1.0, abs=1e-12)
    times = np.linspace(0, 1 - 1e-12, 200)
    assert trajectory.at(times)[0] == pytest.approx(times - 1, abs=1e-9)
    assert np.isfinite(trajectory.sample(times)["x"]).all()


def test_a_folded_surface_over_two_slow_variables():
    # x^2 + y + z^2 = 0 with y' = 1, z' = 1: the fold y = -z^2 is met where y0 + t + (z0 + t)^2 = 0.
    system = SlowFastSystem(slow={y: ONE, z: ONE}, fast={x: x**2 + y + z**2}, epsilon=eps)
    trajectory = run(system, {"x": -1, "y": -1.25, "z": 0.5}, span=(0, 3))
    exact = (-2 + np.sqrt(4 + 4 * 1.0)) / 2
    assert trajectory.status is Status.FOLD_REACHED
    assert trajectory.t[-1] == pytest.approx(exact, abs=1e-10)
    implicit = run(systems.koper(), {"x": -2.4, "y": (2.4**3 - 7.2 + 7) / 10, "z": 0.5})
    assert implicit.status is Status.FOLD_REACHED
    assert implicit["x"][-1] == pytest.approx(-1, abs=1e-12)
    assert implicit["y"][-1] == pytest.approx(0.5, abs=1e-12)


def test_backward_in_time_a_repelling_sheet_runs_into_its_fold():
    # Backward van der Pol's y' = -x carries the middle sheet from x = 0.2 towards 0, and a' = 2 carries it into a fold.
    shifted = SlowFastSystem(slow={y: 2 - x}, fast={x: y - x**3 / 3 + x}, epsilon=eps)
    trajectory = run(shifted, {"x": 0.2, "y": 0.2**3 / 3 - 0.2}, span=(0, -5))
    # y' = (x^2 - 1) x' = 2 - x, t from x = 0.2 to 1 with dt = (x^2 - 1)/(2 - x) dx.
    s = sp.Symbol("s")
    exact = float(sp.integrate((s**2 - 1) / (2 - s), (s, sp.Rational(1, 5), 1)))
    assert exact < 0
    assert trajectory.status is Status.FOLD_REACHED
    assert trajectory.t[-1] == pytest.approx(exact, abs=1e-8)


def test_what_is_reconstructed_goes_with_the_flow_into_the_fold():
    q = sp.Symbol("q")
    branch = gsp.solve_critical(VAN_DER_POL).nearest(ON_VAN_DER_POL)
    flow = gsp.restrict(gsp.expand(branch, order=0), reconstruction={q: x})
    trajectory = integrate(flow, start=ON_VAN_DER_POL, span=(0, 5), epsilon=1e-3, rtol=1e-10, atol=1e-12)
    # q' = x = -y'.
    assert trajectory["q"] == pytest.approx(2 / 3 - trajectory["y"], abs=1e-8)
    assert trajectory["q"][-1] == pytest.approx(4 / 3, abs=1e-9)


def test_a_grid_ends_before_the_fold():
    grid = np.linspace(0, 5, 51)
    trajectory = run(VAN_DER_POL, ON_VAN_DER_POL, at=grid)
    assert trajectory.status is Status.FOLD_REACHED
    assert np.array_equal(trajectory.t, grid[grid < FOLD_TIME])
    assert trajectory["x"] == pytest.approx(position(FOLD_TIME - trajectory.t), abs=1e-7)


# Folded singularities and branch points

FROM_LEFT, FROM_RIGHT = {"x": -1, "y": -1}, {"x": 1, "y": -1}
# x' = x^2 + y, w' = -3 w + x y in new coordinates x = u + 2 v, w = u - v.
u, v = sp.symbols("u v")
DX, DW = (u + 2 * v) ** 2 + y, -3 * (u - v) + (u + 2 * v) * y
# On x = -sqrt(-y) with s = sqrt(-y): 2 s s' = -(1 + s) for y' = 1 - x, so t = 2 (s - ln(1 + s)); s' = -1/2 for y' = -x.
ROOT_TIME = 2 - 2 * np.log(2)
FOLD, LOST = Status.FOLD_REACHED, Status.HYPERBOLICITY_LOST
# Slow and fast rates, start, how the run ends, when, to how much, and a word of what is told.
ENDINGS = {
    "fold where the field is singular": ({y: 1 - x}, {x: x**2 + y}, FROM_LEFT, FOLD, ROOT_TIME, 2e-8, "fold"),
    "fold with two fast variables": (
        {y: ONE}, {u: (DX + 2 * DW) / 3, v: (DX - DW) / 3}, {"y": -1, "u": -1 / 9, "v": -4 / 9}, FOLD, 1, 1e-8, "fold"
    ),
    "canard point, reached at rest": ({y: -x}, {x: x**2 + y}, FROM_LEFT, FOLD, 2, 1e-8, "folded singularity"),
    "transcritical": ({y: ONE}, {x: x**2 - y**2}, FROM_LEFT, LOST, 1, 1e-10, "branch point"),
    "transcritical, repelling": ({y: ONE}, {x: x**2 - y**2}, FROM_RIGHT, LOST, 1, 1e-10, "branch point"),
    "pitchfork": ({y: -ONE}, {x: y * x - x**3}, {"x": 1, "y": 1}, LOST, 1, 2e-8, ""),
    "singular pitchfork": ({y: -1 - x}, {x: y * x - x**3}, {"x": 1, "y": 1}, LOST, ROOT_TIME, 2e-8, ""),
    "factor that vanishes": (
        {y: -ONE, z: x}, {x: -y * (x - z)}, {"x": 1, "y": 1, "z": 1}, LOST, 1, 1e-10, "z = 2.71828"
    ),
    # The eigenvalue -sqrt(y) - 1 on x = 0 does not vanish at y = 0, where it ends.
    "border of the domain": (
        {y: -ONE}, {x: -(1 + sp.sqrt(y)) * x}, {"x": 0, "y": 1}, Status.NON_FINITE, 1, 1e-9, "ends"
    ),
}  # fmt: skip


@pytest.mark.parametrize(
    ("slow", "fast", "start", "status", "time", "within", "word"), ENDINGS.values(), ids=ENDINGS
)
def test_a_run_ends_when_and_as_its_system_says(slow, fast, start, status, time, within, word):
    trajectory = run(SlowFastSystem(slow=slow, fast=fast, epsilon=eps), start, span=(0, 3))
    assert trajectory.status is status
    assert trajectory.t[-1] == pytest.approx(time, abs=within)
    assert np.isfinite(trajectory.y).all()
    assert word in trajectory.message


CORNER = y - sp.Abs(x)
# Fast rates and the start beside y = 0.8.
CORNERS = {
    "explicit": ({x: CORNER}, {"x": 0.8}),
    "repelling": ({x: -CORNER}, {"x": 0.8}),
    "large rates": ({x: 10**6 * CORNER}, {"x": 0.8}),
    "large variable": ({x: y - sp.Abs(x) / 10**6}, {"x": 0.8e6}),
    "elsewhere": ({x: CORNER.subs(x, x - 7)}, {"x": 7.8}),
    "uneven": ({x: y - sp.Max(-x, x / 2)}, {"x": 1.6}),
    "two sheets": ({x: sp.Abs(y) - sp.Abs(x)}, {"x": 0.8}),
    "implicit": ({x: CORNER - x**5 / 10}, {"x": 0.8}),
    "two fast": ({x: y - sp.Abs(x + w) - w / 2, w: x - w}, {"x": 0.32, "w": 0.32}),
}


@pytest.mark.parametrize("order", [0, 1])
@pytest.mark.parametrize(("fast", "start"), CORNERS.values(), ids=CORNERS)
def test_a_run_into_a_corner_loses_hyperbolicity_there(fast, start, order):
    """It was said to blow up or to leave the domain, and an implicit branch to let the run go to and fro."""
    system = SlowFastSystem(slow={y: -ONE}, fast=fast, epsilon=eps)
    trajectory = run(system, {"y": 0.8, **start}, order=order, span=(0, 3))
    assert trajectory.status is Status.HYPERBOLICITY_LOST
    assert trajectory.t[-1] == pytest.approx(0.8, abs=1e-7)
    assert "an eigenvalue of the fast Jacobian jumps through zero at" in trajectory.message


def test_a_folded_node_is_named_and_located():
    trajectory = run(systems.koper(), {"x": 2.4, "y": (-(2.4**3) + 7.2 + 7) / 10, "z": 0.5})
    assert trajectory.status is Status.FOLD_REACHED
    assert "a folded singularity of the critical manifold at y = 0.9, z = 0.8, x = 1" in trajectory.message
    assert [trajectory[name][-1] for name in "yzx"] == pytest.approx([0.9, 0.8, 1.0], abs=1e-8)
    # At a tenth of the tolerance it is there at the same time.
    again = run(systems.koper(), {"x": 2.4, "y": (-(2.4**3) + 7.2 + 7) / 10, "z": 0.5}, rtol=1e-10, atol=1e-12)
    assert again.t[-1] == pytest.approx(trajectory.t[-1], abs=2e-9)


# (fast, slow): a factor of the fast rates vanishes at y = 2, and with it all rates of the fast fibre.
AT_2 = 2 - y
FIBRES = {
    "line": ({x: AT_2 * (y - x)}, {y: ONE}),
    "parabola": ({x: AT_2 * (y**2 - x)}, {y: ONE}),
    "constant": ({x: AT_2 * (sp.Rational(1, 3) - x)}, {y: 1 + x**2 / 7}),
    "driven by x": ({x: AT_2 * (sp.sqrt(3) * y - x)}, {y: 1 + x**2 / 7}),
    "two slow": ({x: AT_2 * (y + z - x)}, {y: ONE, z: -z}),
    "second fast": ({x: AT_2 * (y - x), w: x - w}, {y: ONE}),
    "second fast first": ({w: x - w, x: AT_2 * (y + w - 2 * x)}, {y: ONE}),
    "tanh": ({x: sp.tanh(AT_2) * (y - x)}, {y: 1 + y / 10}),
    "implicit": ({x: AT_2 * (y - x - x**3)}, {y: ONE}),
    "exponential": ({x: AT_2 * (1 + y - sp.exp(x))}, {y: ONE}),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", FIBRES)
def test_a_fibre_of_equilibria_ends_the_reduction_as_classify_says(name):
    fast, slow = FIBRES[name]
    start = dict.fromkeys("xyzw", 0.0) | {"z": 1.0}
    system = SlowFastSystem(slow=slow, fast=fast, epsilon=eps)
    start = {s.name: start[s.name] for s in system.states}
    trajectory = run(system, start, span=(0, 5))
    assert trajectory.status is Status.HYPERBOLICITY_LOST
    assert trajectory["y"][-1] == pytest.approx(2.0, abs=1e-7)
    branch = gsp.solve_critical(system).nearest(start)
    # The point that is named lies on the critical manifold.
    named = dict(re.findall(r"\b([xyzw]) = ([-+.e0-9]+)(?=[,;])", trajectory.message.split("branch point")[1]))
    at = {s.name: float(trajectory[s.name][-1]) for s in system.x}
    height = branch.points(at, near=None if branch.is_explicit else [1.0])
    assert [float(named[s.name]) for s in system.y] == pytest.approx(height, abs=2e-5)
    loss = gsp.classify(branch, region={"y": (0.1, 3), **({"z": (0.1, 1)} if len(slow) > 1 else {})}).losses[0]
    assert loss.point["y"] == pytest.approx(2.0, abs=1e-6)


@pytest.mark.parametrize(
    "g", [y - x * y + x, y - z - x * y + x, 1 - y - sp.exp(-x), (y - x * y + x) * (3 - y)], ids=str
)
@pytest.mark.parametrize("unit", [1, 10**12])
def test_a_run_ends_where_the_manifold_goes_to_infinity(g, unit):
    system = SlowFastSystem(slow={y: ONE, z: -z}, fast={x: g.subs(x, x * unit)}, epsilon=eps)
    trajectory = run(system, {"x": 0, "y": 0, "z": 1}, span=(0, 3), atol=1e-10 / unit)
    assert trajectory.status is Status.NON_FINITE
    assert trajectory.t[-1] == pytest.approx(1.0, abs=1e-9)
    assert "the critical manifold goes to infinity at y = 1" in trajectory.message


@pytest.mark.parametrize(
    "g",
    thinned(
        [
            -x / y,
            -x / y**2,
            -x / y**3,
            -x / (4 * y**2 + 4 * y**3 + y**4),
            -x / sp.sqrt(y),
            -x * (1 + 1 / (3 * y) ** 4),
            -x * sp.exp(1) / y**2,
            -x - x * sp.tan(1 - y) ** 2,
            1 / y**2 - x,
            1 / y - x,
            -x * (3 - sp.log(y)) / y,
        ],
        2,
    ),
    ids=str,
)
@pytest.mark.parametrize("order", [0, 1])
def test_a_run_ends_at_a_pole_of_the_fast_field(g, order):
    # x' is regular there, and -1/y^2 does not change its sign.
    system = SlowFastSystem(slow={y: -ONE}, fast={x: g}, epsilon=eps)
    trajectory = run(system, {"x": 0, "y": 1}, span=(0, 3), order=order, epsilon=1e-6)
    if trajectory.status is not Status.NON_FINITE:
        # Where the series ends before.
        assert order > 0
        assert trajectory.status is Status.SERIES_ENDS
        return
    pole = 1 - np.pi / 2 if g.has(sp.tan) else 0.0
    assert trajectory.t[-1] == pytest.approx(1.0 - pole, abs=1e-9)
    assert trajectory["y"][-1] == pytest.approx(pole, abs=1e-9)
    assert "ends at y = " in trajectory.message


@pytest.mark.parametrize(
    "g", [-x * (y**2 + 2 * y) / y, -x * (1 + y) / (1 + y**2), -x - x**2 * sp.sin(y) / y], ids=str
)
def test_a_run_passes_where_there_is_no_pole(g):
    system = SlowFastSystem(slow={y: -ONE}, fast={x: g - x}, epsilon=eps)
    trajectory = run(system, {"x": 0, "y": sp.Rational(3, 4)}, span=(0, 1.6))
    assert trajectory.status is Status.SUCCESS


def test_a_change_of_sign_through_a_pole_is_no_event():
    field = VectorField({y: -ONE, x: sp.cos(y)}, epsilon=None)
    events = [
        gsp.Event(1 / y, name="pole"),
        gsp.Event(y, name="zero"),
        gsp.Event(y / (1 + y**2), name="bounded"),
    ]
    found = integrate(field, start={"x": 0, "y": 1}, span=(0, 3), events=events)
    assert found.events["pole"].times.tolist() == []
    assert found.events["zero"].times == pytest.approx([1.0], abs=1e-9)
    assert found.events["bounded"].times == pytest.approx([1.0], abs=1e-9)


# Pairs


def test_a_hopf_point_of_three_fast_variables_disguised():
    P = sp.Matrix([[2, -3, -2], [-2, -2, 2], [3, 1, -2]])
    a, b, c = P.inv() * sp.Matrix([x, y, w])
    fast = P * sp.Matrix([z * a - b, a + z * b, -2 * c + z])
    system = SlowFastSystem(slow={z: ONE}, fast=dict(zip((x, y, w), fast)), epsilon=eps)
    start = dict(zip("xyw", map(float, P * sp.Matrix([0, 0, sp.Rational(-1, 2)]))), z=-1)
    trajectory = run(system, start, order=1, span=(0, 3))
    assert trajectory.status is Status.HYPERBOLICITY_LOST
    assert trajectory.t[-1] == pytest.approx(1.0, abs=1e-10)
    assert "Hopf point of the layer problem" in trajectory.message
    assert "1 i" in trajectory.message


def test_a_neutral_saddle_is_no_loss():
    # Eigenvalues -1 and 2 + z, whose sum passes through zero at z = -1.
    system = SlowFastSystem(slow={z: ONE}, fast={x: -x + z, y: (2 + z) * y + x}, epsilon=eps)
    trajectory = run(system, {"x": -1.5, "y": 3, "z": -1.5}, order=1, span=(0, 3))
    assert trajectory.status is Status.SUCCESS


# Above order 0


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("epsilon", [1e-2, 1e-3, 1e-4])
def test_the_series_is_left_at_the_distance_from_the_fold_where_it_stops_being_asymptotic(order, epsilon):
    trajectory = run(VAN_DER_POL, ON_VAN_DER_POL, order=order, epsilon=epsilon, rtol=1e-11, atol=1e-13)
    assert trajectory.status is Status.FOLD_REACHED
    # epsilon |l'|/l^2 for l = 1 - x^2 and x' = -x/(x^2 - 1).
    at = trajectory["x0"][-1]
    rate = 2 * epsilon * at**2 / (at**2 - 1) ** 3
    if order == 1:
        assert rate == pytest.approx(1, rel=1e-7)
    else:
        assert rate >= (1 - 1e-7) / (3 * (order - 1))
        assert rate < 1.5 / (3 * (order - 1))
        series = gsp.expand(gsp.solve_critical(VAN_DER_POL).branches[0], order=order)
        terms = np.abs(series.terms(float(trajectory["y"][-1]), epsilon, near=[at])[:, 0])
        assert terms[order] >= terms[order - 1] * (1 - 1e-6)
    assert "fall no further" in trajectory.message
    assert "the fold of the critical manifold at y = -0.666667, x = 1 is near" in trajectory.message
    # Until then the flow of order N is as good as it is to be, against the full system.
    grid = np.linspace(0, float(trajectory.t[-1]) * 0.7, 5)
    full = integrate(
        VAN_DER_POL,
        start={"x": float(trajectory.sample(0.0)["x"][0]), "y": 2 / 3},
        span=(0, grid[-1]),
        epsilon=epsilon,
        rtol=1e-11,
        atol=1e-13,
        at=grid,
    )
    assert np.abs(full["y"] - trajectory.sample(grid)["y"]).max() < 30 * epsilon ** (order + 1) + 1e-10


def test_a_series_that_ends_where_the_manifold_attracts_is_no_loss_of_hyperbolicity():
    # A mirror in a driven cavity: the eigenvalues are -1/2 and a detuning, and det g_y varies with the place y.
    a, b, p = sp.symbols("a b p")
    turn = (2 * y - 5) / 10
    system = SlowFastSystem(
        slow={y: p, p: -y - p / 20 + 2 * (a**2 + b**2) / 5},
        fast={a: -a / 2 - turn * b + sp.Rational(6, 5), b: -b / 2 + turn * a},
        epsilon=eps,
    )
    start = {"y": 0, "p": 0, "a": 1.2, "b": -1.2}
    ended = run(system, start, order=3, span=(0, 6), epsilon=0.3)
    assert ended.status is Status.SERIES_ENDS
    assert "the terms of the series" in ended.message
    assert "hyperbolicity" not in ended.message
    assert run(system, start, order=0, span=(0, 6), epsilon=0.3).status is Status.SUCCESS


def test_a_start_without_a_real_point_is_outside_the_domain():
    gene = SlowFastSystem(slow={y: x - y}, fast={x: 10 / (1 + y ** sp.Rational(5, 2)) - x}, epsilon=eps)
    (branch,) = gsp.solve_critical(gene).branches
    for order in (1, 2):
        flow = gsp.restrict(gsp.expand(branch, order=order))
        ended = integrate(flow, start={"y": -0.2}, span=(0, 1), epsilon=0.05)
        assert ended.status is Status.NON_FINITE
        assert "terms" not in ended.message


def test_near_a_transcritical_point_the_distance_is_the_root_of_epsilon():
    system = SlowFastSystem(slow={y: ONE}, fast={x: x**2 - y**2 + eps / 2}, epsilon=eps)
    for epsilon in (1e-2, 1e-4):
        trajectory = run(system, {"x": -1, "y": -1}, order=1, span=(0, 3), epsilon=epsilon)
        assert trajectory.status is Status.SERIES_ENDS
        # l = 2 y: 2 epsilon = 4 y^2.
        assert trajectory["y"][-1] == pytest.approx(-np.sqrt(epsilon / 2), rel=1e-8)
        assert "order 0" in trajectory.message


def test_a_start_where_the_series_is_none_is_returned_as_it_is():
    trajectory = run(
        VAN_DER_POL, {"x": 1.05, "y": 1.05**3 / 3 - 1.05}, order=2, epsilon=0.01, near=ON_VAN_DER_POL
    )
    assert trajectory.status is Status.FOLD_REACHED
    assert np.array_equal(trajectory.t, [0.0])
    assert "fall no further" in trajectory.message


def test_the_quick_look_along_a_run_changes_nothing(monkeypatch):
    looked = [run(VAN_DER_POL, ON_VAN_DER_POL, order=n) for n in (0, 1)]
    monkeypatch.setattr(Ending, "quiet", lambda *steps: False)
    for n, fast in enumerate(looked):
        slow = run(VAN_DER_POL, ON_VAN_DER_POL, order=n)
        assert np.array_equal(slow.y, fast.y)
        assert slow.status is fast.status


@pytest.mark.parametrize("place", ["fold", "transcritical", "Hopf"])
def test_a_start_on_a_loss_is_refused(place):
    systems_ = {
        "fold": (SlowFastSystem(slow={y: ONE}, fast={x: x**2 + y}, epsilon=eps), {"x": -1, "y": -1}, {"y": 0}),
        "transcritical": (
            SlowFastSystem(slow={y: ONE}, fast={x: x**2 - y**2}, epsilon=eps),
            {"x": -1, "y": -1},
            {"y": 0},
        ),
        "Hopf": (
            SlowFastSystem(slow={z: ONE}, fast={x: z * x - y, y: x + z * y}, epsilon=eps),
            {"x": 0, "y": 0, "z": -1},
            {"z": 0},
        ),
    }
    system, near, start = systems_[place]
    with pytest.raises(HyperbolicityError, match=r"start lies where normal hyperbolicity is lost\. Got"):
        run(system, start, near=near)


def test_a_start_on_an_implicit_fold_is_refused():
    with pytest.raises((BranchError, HyperbolicityError), match=r"fold|normal hyperbolicity"):
        run(VAN_DER_POL, {"x": 1, "y": -2 / 3}, near=ON_VAN_DER_POL)


def test_a_comparison_across_a_fold_says_where_it_ends():
    scene = gsp.Scene(
        VAN_DER_POL,
        region={"x": (1.2, 2.5)},
        start=ON_VAN_DER_POL,
        span=(0, 1),
        epsilon=1e-3,
        epsilons=(2e-3, 1e-3),
        tolerance=1e-6,
    )
    comparison = gsp.compare(scene, orders=(0, 1))
    for order in (0, 1):
        assert np.isnan(comparison.errors[order]).all()
        assert set(comparison.statuses[order]) == {Status.FOLD_REACHED}
        assert np.isnan(comparison.slopes[order])


# The algebra underneath


@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_adjugate_and_determinant(n):
    entries = np.random.default_rng(n).integers(-4, 5, (n, n))
    J = sp.Matrix(n, n, [sp.Integer(int(e)) for e in entries.ravel()])
    adjugate, coefficients = faddeev_leverrier(J.tolist())
    assert sp.Matrix(adjugate).equals(J.adjugate())
    assert coefficients == J.charpoly().all_coeffs()


def test_a_loss_beyond_the_horizon_is_none():
    branch = gsp.solve_critical(systems.michaelis_menten()).branches[0]
    flow = gsp.restrict(gsp.expand(branch, order=0))
    state = np.array([1.0])
    p = parameter_vector(flow, 0.01)
    stepper = Stepper(compile_flow(flow), p, Method.DOP853, 1e-8, 1e-10)
    assert Ending(flow, stepper, (0.0, 1.0), state).fold_ahead(0.0, state) is None


# Other endings


def test_backward_on_an_attracting_stiff_field_it_is_said_that_it_cannot_work():
    for method in (None, Method.RADAU9, Method.RADAU13):
        trajectory = integrate(
            systems.michaelis_menten(),
            start={"s": 1, "c": 0.6},
            span=(5, 0),
            epsilon=1e-3,
            method=method,
            max_steps=20_000,
        )
        assert not trajectory.status.ok
        assert 0 < trajectory.t[-1] < 5
        assert "backward in time the fast directions grow at the rate 2e+03" in trajectory.message
        assert "restrict()" in trajectory.message
    # The reduced flow runs backward as well as forward.
    flow = gsp.restrict(gsp.expand(gsp.solve_critical(systems.michaelis_menten()).branches[0], order=2))
    back = integrate(flow, start={"s": 1}, span=(5, 0), epsilon=1e-3)
    assert back.status is Status.SUCCESS


def test_backward_without_a_fast_direction_nothing_is_said():
    field = VectorField({x: -(x**2)}, epsilon=None)
    trajectory = integrate(field, start={x: 1}, span=(0, -3))
    assert not trajectory.status.ok
    assert "backward" not in trajectory.message


@pytest.mark.parametrize("power", [2, 3])
def test_the_time_of_a_blow_up_is_told(power):
    # x' = x^p from x = 2 blows up at t = 2^(1-p)/(p - 1), like (T - t)^(-1/(p-1)).
    trajectory = integrate(VectorField({x: x**power}, epsilon=None), start={x: 2}, span=(0, 1))
    assert not trajectory.status.ok
    time = 2.0 ** (1 - power) / (power - 1)
    assert f"x grows without bound, like (T - t)^-{1 / (power - 1):.3g} with T = " in trajectory.message
    told = float(trajectory.message.split("T = ")[1].split(";")[0])
    assert told == pytest.approx(time, rel=1e-6)


def test_a_start_off_the_domain_is_said_to_be_one():
    trajectory = integrate(VectorField({x: sp.log(x)}, epsilon=None), start={x: -1}, span=(0, 1))
    assert trajectory.status is Status.NON_FINITE
    assert trajectory.message == (
        "stopped after 0 steps: NON_FINITE at t = 0, x = -1; the field is not finite at the start; "
        "move the start into the domain of the field"
    )


# Blocks: fast variables that drive one another one way


CHAIN = SlowFastSystem(
    slow={x: ONE},
    fast={y: x - 2 * y, z: 2 * y + z**2, w: z - 2 * w - w**3},
    epsilon=eps,
)
"""A linear link, one with a fold at x = 0, and one that it drives."""


def test_a_fold_in_a_chain_is_reached_at_its_time_and_place():
    near = {"x": -1, "y": -0.5, "z": -1, "w": -0.45}
    for order in (0, 1):
        flow = gsp.restrict(gsp.expand(gsp.solve_critical(CHAIN).nearest(near).through(near), order=order))
        trajectory = gsp.integrate(flow, start={"x": -1}, span=(0, 3), epsilon=1e-3, rtol=1e-9)
        assert trajectory.status is Status.FOLD_REACHED
        if order == 0:
            assert trajectory.t[-1] == pytest.approx(1.0, abs=1e-7)
        else:
            assert 0.9 < trajectory.t[-1] < 1.0


@pytest.mark.parametrize("case", ["chain", "two and one", "one and two"])
def test_the_test_functions_of_blocks_are_those_of_the_whole_jacobian(case):
    u = y * z
    rates = {
        "chain": ({y: -y * (1 + x**2) + x, z: y - z - z**3, w: z - 3 * w + y}, (0.4, 0.3, 0.2)),
        "two and one": ({y: x - y - u, z: y - 2 * z - z**3 + x, w: u - w - w**3}, (0.3, 0.3, 0.1)),
        "one and two": ({w: x - w - w**3, y: w - y - u, z: y - 2 * z + w**2}, (0.4, 0.3, 0.3)),
    }
    fast, places = rates[case]
    near = {"x": 0.5, **{symbol.name: place for symbol, place in zip(fast, places)}}
    system = SlowFastSystem(slow={x: 1 - x * y}, fast=fast, epsilon=eps)
    branch = gsp.solve_critical(system).branches[0]
    validity = Validity(gsp.restrict(gsp.expand(branch.through(near), order=1), order=1))
    names = [s.name for s in system.y]
    at = branch.points({"x": 0.5}, near=[near[name] for name in names])
    point = np.array([0.5, *at])

    def jacobian(h: float, rates: np.ndarray) -> np.ndarray:
        return validity.fast_jacobian(point + h * rates)

    delta, hurwitz, q, rounding, size, *_ = validity.tests(np.append(point, 0.0), [0.01])
    J, g_x = jacobian(0.0, point), validity.derivatives(point, [np.nan])[9:]
    constant = 3.0 if case == "chain" else 1.0
    assert abs(delta) * constant == pytest.approx(abs(np.linalg.det(J)), rel=1e-12)
    # Along the flow of order 0, by difference quotients.
    scaled = compile_flow(validity.desingularised).rates(np.append(point, 0.0), [np.nan])
    slow = 1 - 0.5 * at[names.index("y")]
    along = np.array([slow, *(-np.linalg.solve(J, g_x) * slow)])
    assert scaled == pytest.approx([*(delta * along), delta], rel=1e-10)
    inverse = [np.trace(np.linalg.inv(jacobian(h, along))) for h in (1e-5, -1e-5)]
    assert q == pytest.approx(abs(delta) ** 3 * (1 - 0.01 * abs(inverse[0] - inverse[1]) / 2e-5), rel=1e-8)
    sizes = [np.linalg.det(jacobian(h, along)) for h in (1e-5, -1e-5)]
    rate = (sizes[0] - sizes[1]) / 2e-5 / np.linalg.det(J) * delta**2
    crossing = validity.crossing(np.append(point, 0.0), [np.nan])
    assert crossing == pytest.approx([delta, rate], rel=1e-8)
    assert validity.watches_pairs is (case != "chain")
    assert rounding > 0.0
    if validity.watches_pairs:
        pair = {"two and one": J[:2, :2], "one and two": J[1:, 1:]}[case]
        assert abs(hurwitz) == pytest.approx(abs(np.trace(pair)), rel=1e-12)
        moduli = np.abs(pair)
        assert size == pytest.approx(np.trace(moduli) + np.sqrt(np.trace(moduli @ moduli)), rel=1e-12)
    pulled = validity.pulled(point, [np.nan])
    assert pulled == pytest.approx(-delta * np.linalg.solve(J, g_x), rel=1e-10)


@pytest.mark.exhaustive
def test_what_is_watched_of_a_chain_grows_with_its_links():
    """Loops through all of J, 10^6 products for a hundred links, would never end."""
    links = sp.symbols("y1:31")
    fast = {b: a - b - b**3 / 10 for a, b in zip((x, *links), links)}
    system = SlowFastSystem(slow={x: -x}, fast=fast, epsilon=eps)
    g_y = [[sp.diff(g, b) for b in links] for g in fast.values()]
    second = {
        (i, j): {k: sp.diff(e, s) for k, s in enumerate(system.states) if s in e.free_symbols}
        for i, row in enumerate(g_y)
        for j, e in enumerate(row)
        if not e.is_number
    }
    blocks = FastBlocks(g_y, [[sp.diff(g, x)] for g in fast.values()], [-x], second)
    assert blocks.members == [[i] for i in range(30)]
    parts = set()
    drift = blocks.inverse_trace(relative=False)[1]
    for expression in (blocks.determinant, drift, blocks.rounding(system.states)):
        parts.update(sp.preorder_traversal(expression))
    # The rates of each link are multiplied by the determinants of all behind it: half of 30^2.
    assert len(parts) < 2 * 30**2


# Runs that get nowhere


@pytest.mark.exhaustive
def test_a_run_that_can_only_slide_ends_there():
    """Dry friction: on y = -sign(x) the flow x' = y meets x = 0 at t = 0.6 from both sides."""
    # sign, and not Max: what is at x = 0 is no matter.
    friction = SlowFastSystem(slow={x: y}, fast={y: -y - sp.sign(x)}, epsilon=eps)
    trajectory = run(friction, {"x": 0.6, "y": -1.0}, span=(0, 3))
    assert trajectory.status is Status.STEP_TOO_SMALL
    assert trajectory.t[-1] == pytest.approx(0.6, abs=1e-6)
    assert "jumps and points there from both sides" in trajectory.message
    assert trajectory.stats.steps < 500


def test_many_turns_at_the_beginning_of_a_long_span_are_no_end():
    """x'' = -x until a clock stops it: 64 steps take 25 of 1e9."""
    turning = SlowFastSystem(slow={x: w, y: -x, z: ONE}, fast={w: y - w}, epsilon=eps)
    start = {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
    stop = gsp.Event(z - 200, terminal=True)
    trajectory = run(turning, start, span=(0, 1e9), rtol=1e-6, atol=1e-8, events=stop)
    assert trajectory.status is Status.EVENT_REACHED
    assert trajectory.stats.steps > 128


def test_output_times_that_lie_together_are_no_end():
    at = [*(1.0 + np.linspace(0.0, 1e-7, 200)), 2.0]
    decay = SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=eps)
    trajectory = run(decay, {"x": 1.0, "y": 1.0}, span=(0, 2), at=at, events=gsp.Event(x - sp.Rational(1, 5)))
    assert trajectory.status is Status.SUCCESS
    assert trajectory.events["x - 1/5"].times == pytest.approx([np.log(5.0)], rel=1e-7)


SQUARE = (1 - x) ** 2


@pytest.mark.parametrize(
    "fast",
    thinned(
        [
            {y: SQUARE * (x - y)},
            {y: sp.expand(SQUARE) * x - sp.expand(SQUARE) * y},
            {y: (1 - x) ** 4 * (x - y)},
            {y: (1 - x) * (1 - y) * (x - y)},
            {y: sp.Abs(1 - x) * (x - y)},
            {y: SQUARE * (x - y), z: x - z},
            {y: SQUARE * (x - y) + z - x, z: x - z},
            {y: SQUARE * (x - y) + x - z, z: y - x + SQUARE * (x - z)},
        ],
        4,
    ),
    ids=["square", "expanded", "fourth", "on M0", "kink", "one of two", "driven", "pair"],
)
def test_an_eigenvalue_that_touches_zero_ends_a_run_where_classify_says_that_it_is_lost(fast) -> None:
    system = SlowFastSystem(slow={x: ONE}, fast=fast, epsilon=eps)
    branch = gsp.solve_critical(system).branches[0]
    lost = [loss.point["x"] for loss in gsp.classify(branch, region={"x": (0, 3)}).losses]
    assert lost == pytest.approx([1.0] * len(lost), abs=1e-3)
    assert lost
    flow = gsp.restrict(gsp.expand(branch, order=0))
    found = integrate(flow, start={"x": 0}, span=(0, 3), epsilon=0.01)
    many = gsp.integrate_many(flow, starts={"x": np.array([0.0, 0.5])}, span=(0, 3), epsilon=0.01)
    # On a grid a step may end on the zero itself.
    gridded = integrate(flow, start={"x": 0}, span=(0, 3), epsilon=0.01, at=np.linspace(0.5, 3, 6))
    for one in (found, gridded):
        assert one.status is Status.HYPERBOLICITY_LOST
    assert found["x"][-1] == pytest.approx(1.0, abs=1e-3)
    assert [status.name for status in many.statuses] == ["HYPERBOLICITY_LOST"] * 2


def test_an_eigenvalue_that_comes_near_zero_and_turns_ends_nothing() -> None:
    system = SlowFastSystem(slow={x: ONE}, fast={y: (SQUARE + sp.Rational(1, 1000)) * (x - y)}, epsilon=eps)
    assert run(system, {"x": 0, "y": 0}, span=(0, 3), epsilon=0.01).status.ok


def test_the_tests_of_a_run_have_no_units() -> None:
    """A piston in metres and oil in pascals: the pair is as far from the axis as with both in units of their size."""

    def tests_of(unit: sp.Expr) -> np.ndarray:
        fast = {y: (2 * x - 3 * y - z / unit) * (1 + y**2), z: unit * (y - (1 + x) * z / unit)}
        system = SlowFastSystem(slow={x: 1 - y}, fast=fast, epsilon=eps)
        (branch,) = gsp.solve_critical(system).branches
        begun = branch.through({"x": 0.5, "y": 0.3, "z": float(0.2 * unit)})
        flow = gsp.restrict(gsp.expand(begun, order=2), order=2)
        validity, p = Validity(flow), np.array([0.05])
        state = np.array(flow.initial({"x": 0.5, **dict(zip("yz", begun.points({"x": 0.5})))}))
        return validity.tests(validity.lift(state, p), p)

    plain = tests_of(sp.Integer(1))
    for unit in (sp.Integer(10) ** 12, sp.Rational(1, 10**9)):
        found = tests_of(unit)
        delta, hurwitz, q, _, size = found[:5]
        assert (delta, hurwitz, size) == pytest.approx(tuple(plain[[0, 1, 4]]), rel=1e-9)
        assert q == pytest.approx(plain[2], rel=1e-9)


def test_terms_that_pass_through_zero_far_from_any_loss_are_looked_at_once(monkeypatch) -> None:
    """A robot's arm on a stiff joint: each term of its series vanishes as it swings, and nothing is lost."""
    p, q, u, clock = sp.symbols("p q u clock")
    pull, weight, motor = 400 * (p - 3 * z) + 15 * (q - 3 * u), 3 * sp.sin(z) / 10, 2 * sp.cos(clock) / 5
    own = pull - weight
    system = SlowFastSystem(
        slow={p: q, q: 2 * own + 2 * (motor - pull), clock: ONE},
        fast={
            z: u - q / 3 + eps * q / 3,
            u: own / 3 - 2 * (motor - pull) / 3 + eps * (2 * own + 2 * (motor - pull)) / 3,
        },
        epsilon=eps,
    )
    start = {"p": 1.5, "q": 0.0, "clock": 0.0}
    searched, sample = [], RunPiece.sample
    monkeypatch.setattr(RunPiece, "sample", lambda *given: searched.append(1) or sample(*given))
    for order in (2, 3):
        found = run(
            system, start, order=order, span=(0, 10), epsilon=1.0, near={**start, "z": 0.5, "u": 0.0}, rtol=1e-7
        )
        assert found.status is Status.SUCCESS
    assert not searched


@pytest.mark.parametrize("by", [0, 10_000_000])
def test_a_start_far_from_the_origin_is_not_on_a_loss(by: int) -> None:
    """What relative changes of y make of g_y = -1 - 3 Y^2 is 6 Y, and not 6 Y (Y + 10^7)/Y."""
    X, Y = x - by, y - by
    system = SlowFastSystem(slow={x: -X}, fast={y: X - Y - Y**3}, epsilon=eps)
    (branch,) = gsp.solve_critical(system).branches
    flow = gsp.restrict(gsp.expand(branch.through({x: 2 + by, y: 1 + by}), order=0))
    run = integrate(flow, start={x: 2 + by}, span=(0.0, 1.0), epsilon=0.1, rtol=1e-9)
    assert run.status.ok
    assert run[x][-1] - by == pytest.approx(2 * np.exp(-1.0), abs=1e-6 + 1e-8 * by)


def test_a_start_on_a_fold_far_from_the_origin_is_refused() -> None:
    by = 10_000_301
    X, Y = x - by, y - by
    system = SlowFastSystem(slow={x: -1 - X**2}, fast={y: X - Y**2}, epsilon=eps)
    branch = gsp.solve_critical(system).nearest({x: 1 + by, y: 1 + by})
    with pytest.raises(HyperbolicityError, match="x = 10000301, y = 10000301"):
        integrate(gsp.restrict(gsp.expand(branch, order=0)), start={x: by}, span=(0.0, 1.0), epsilon=0.1)


# Sheets that are invariant for every epsilon: their series has one term, and nothing in it stops falling.
INVARIANT = {
    "0": (x * (y - eps), 0),
    "a line": ((x - y) * y + eps, y),
    "a parabola": ((x - y**2) * y + 2 * y * eps, y**2),
}


@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize("name", INVARIANT)
def test_on_an_invariant_sheet_a_run_of_any_order_goes_to_the_loss(name: str, order: int) -> None:
    rate, sheet = INVARIANT[name]
    system = SlowFastSystem(slow={y: ONE}, fast={x: rate}, epsilon=eps)
    start = {"y": -1, "x": sp.sympify(sheet).subs(y, -1)}
    ended = run(system, start, order=order, epsilon=0.02)
    assert ended.status is Status.HYPERBOLICITY_LOST
    assert ended.t[-1] == pytest.approx(1.0, abs=1e-6)


def test_a_sheet_that_is_invariant_to_leading_orders_alone_is_watched() -> None:
    system = SlowFastSystem(slow={y: ONE}, fast={x: x * y + eps**3}, epsilon=eps)
    assert run(system, {"y": -1, "x": 0}, order=1, epsilon=0.02).status is Status.SERIES_ENDS
