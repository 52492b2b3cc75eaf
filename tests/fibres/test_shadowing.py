"""Shadows of linear systems, whose fibres and slow manifolds are straight: the base point is a projection."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pytest
import sympy as sp

from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BranchError, GspError, Status, UnsupportedFunctionError
from gsp.fibres import shadowing
from gsp.fibres.base_points import project
from gsp.fibres.shadowing import NEAR, shadow
from gsp.slow.solved_manifold import solve_manifold
from gsp.systems.system import SlowFastSystem

x, y, q, eps = sp.symbols("x y q epsilon")
START = {"x": 1.0, "y": 3.0}


def linear(a: float, b: float, c: float, d: float) -> tuple[Branch, dict[float, float]]:
    """The branch of x' = a x + b y, epsilon y' = c x + d y, and x of the base point of `START` at two epsilons."""
    system = SlowFastSystem(slow={x: a * x + b * y}, fast={y: c * x + d * y}, epsilon=eps)
    exact = {}
    for epsilon in (0.02, 0.01):
        values, vectors = np.linalg.eig(np.array([[a, b], [c / epsilon, d / epsilon]]))
        slow = int(np.argmin(np.abs(values)))
        exact[epsilon] = vectors[0, slow] * np.linalg.solve(vectors, list(START.values()))[slow]
    return solve_critical(system).branches[0], exact


@pytest.mark.exhaustive
@pytest.mark.parametrize("fast", [-0.5, -20.0, 0.5, 20.0])
def test_both_routes_give_the_projection_along_the_fast_eigenvector(fast: float) -> None:
    branch, exact = linear(-0.5, 1.0, 1.0, fast)
    gap = abs(fast)
    for epsilon, value in exact.items():
        found = shadow(branch, START, epsilon=epsilon, reconstruction={})
        assert abs(found.values["x"] - value) <= found.errors["x"] + 1e-13
        assert found.errors["x"] < 1e-11
        # The layer, 3 - 1/gap high or so, is over when it is 1e-12.
        assert found.time * gap / epsilon == pytest.approx(-np.log(NEAR), rel=0.2)
    # Each order of the series leaves a term of the next: half of epsilon halves the error so many times.
    for order in (0, 1, 2):
        errors = [project(branch, START, epsilon=e, order=order)["x"] - value for e, value in exact.items()]
        assert np.log2(errors[0] / errors[1]) == pytest.approx(order + 1, abs=0.3)


def driven(fast: float) -> tuple[Branch, dict[sp.Symbol, sp.Expr], dict[str, float]]:
    """q' = 5 (y - h) with x at rest: the layer from 3 to 1/2 adds 5 (5/2) epsilon/gap, forward or backward."""
    system = SlowFastSystem(slow={x: sp.Integer(0)}, fast={y: fast * (y - x / 2)}, epsilon=eps)
    (branch,) = solve_critical(system).branches
    return branch, {q: 5 * (y - x / 2)}, {"x": 1.0, "q": -12.5 * 0.01 / fast}


@pytest.mark.parametrize("fast", [-2.0, 2.0])
def test_what_is_driven_by_the_fast_variable_jumps_by_the_integral_of_its_layer(fast: float) -> None:
    branch, rates, expected = driven(fast)
    found = shadow(branch, START, epsilon=0.01, reconstruction=rates)
    assert found.values == pytest.approx(expected, abs=1e-12)
    assert all(0 < error < 1e-10 for error in found.errors.values())
    assert dict(project(branch, START, epsilon=0.01, order=1, reconstruction=rates)) == pytest.approx(expected)


class Surface:
    """The manifold y = x/2, off by what it says."""

    error_estimates = np.array([1e-6])
    region = MappingProxyType({"x": (-9.0, 9.0)})

    @staticmethod
    def covers(points: np.ndarray) -> np.ndarray:
        return np.abs(points) <= 9.0

    @staticmethod
    def evaluate(points: np.ndarray) -> np.ndarray:
        return 0.5 * points - Surface.error_estimates


@pytest.mark.parametrize("fast", [-2.0, 2.0])
def test_the_error_of_the_manifold_is_in_that_of_the_base_point(fast: float) -> None:
    branch, rates, expected = driven(fast)
    found = shadow(branch, START, epsilon=0.01, reconstruction=rates, surface=Surface)
    off = abs(found.values["q"] - expected["q"])
    rate, layer_time = 5 * Surface.error_estimates[0], 0.01 / 2
    # The layer counts as over at ten errors of the manifold.
    assert (
        max(off, rate * (found.time + layer_time)) < found.errors["q"] < rate * (found.time + 10 * layer_time)
    )


def test_without_jets_heights_are_sums_and_their_error_is_the_largest_of_all_points(monkeypatch) -> None:
    # x' = -x^2 with y' = (x - y)/epsilon: h_k is k! x^(k + 1), so that sums are exact to rounding near x = 0 alone.
    system = SlowFastSystem(slow={x: -(x**2)}, fast={y: x - y}, epsilon=eps)
    (branch,) = solve_critical(system).branches
    places = np.array([[0.01], [1.0]])
    jets, _ = shadowing._height(branch, 0.05, np.zeros(1), None, system, np.ones(2))(places)

    def refuse(system: SlowFastSystem) -> None:
        raise UnsupportedFunctionError("no series.", "")

    monkeypatch.setattr(shadowing, "write_tape", refuse)
    sums, error = shadowing._height(branch, 0.05, np.zeros(1), None, system, np.ones(2))(places)
    off = np.abs(sums - jets)[:, 0]
    assert off[0] < 1e-14
    assert 1e-9 < off[1] <= error < 1e-4


def test_where_no_height_is_found_is_told_in_the_models_own_units(monkeypatch) -> None:
    system = SlowFastSystem(slow={x: 2 - x}, fast={y: (x - 2) ** 2 * (x - 2) - y}, epsilon=eps)
    assert system.centre[0] == 2.0
    (branch,) = solve_critical(system).branches
    units = np.array([4.0, 1.0])
    own = branch.about_centres.moved_into(units)
    height = shadowing._height(own, 0.05, np.zeros(1), None, system, units)

    def lost(tape, branch, x, y, epsilon, order, tolerance) -> tuple:
        return y, np.where(x[:, 0] == 3.0, -1, 2), np.zeros(len(x)), None, 0

    monkeypatch.setattr(shadowing, "climb", lost)
    with pytest.raises(BranchError, match="over x = 14\\."):
        height(np.array([[1.0], [3.0], [5.0]]))


@dataclass
class Run:
    """A run that is what its values `y` (n, m) say, at times 1, 2, ..."""

    y: np.ndarray
    status: Status = Status.SUCCESS

    @property
    def t(self) -> np.ndarray:
        return 1.0 + np.arange(self.y.shape[1])


@pytest.mark.parametrize("away", [0.0, 1.0])
def test_a_run_that_leaves_again_and_comes_back_has_not_landed(away: float, monkeypatch) -> None:
    branch, rates, _ = driven(-2.0)
    problem = shadowing.Problem.declare(branch, START, rates)
    off = np.zeros(20)
    off[0], off[4] = 1.0, away
    run = Run(np.array([np.zeros(20), off, np.zeros(20)]))
    landing = shadowing.land(branch, np.array([1.0]), np.array([3.0]))
    asked = shadowing._Shadowing(problem, 2.0, landing, None)
    monkeypatch.setattr(asked, "height", lambda points: (np.zeros((len(points), 1)), 0.0))
    if away:
        with pytest.raises(BranchError, match="leaves the slow manifold"):
            asked._landed(run)
    else:
        first, second, _ = asked._landed(run)
        assert (first, second) == (1, 7)


@pytest.mark.exhaustive
@pytest.mark.parametrize("end", [8, 16, 40])
def test_a_solved_piece_that_the_run_leaves_before_its_layer_is_over_gives_what_it_can(end: int) -> None:
    """x' = 1 + y/2 from x = 0 leaves [-1, end layer times]: what is left of the layer then is the error."""
    epsilon = 0.01
    system = SlowFastSystem(slow={x: 1 + y / 2}, fast={y: -y + sp.sin(x)}, epsilon=eps)
    (branch,) = solve_critical(system).branches
    start = {"x": 0.0, "y": 1.0}
    exact = shadow(branch, start, epsilon=epsilon, reconstruction={})
    piece = solve_manifold(branch, region={"x": (-1, end * epsilon)}, epsilon=epsilon, tolerance=1e-12)
    found = shadow(branch, start, epsilon=epsilon, reconstruction={}, surface=piece)
    assert abs(found.values["x"] - exact.values["x"]) <= found.errors["x"] + exact.errors["x"]
    assert found.time <= end * epsilon
    # The layer moves x by epsilon/2 of its height.
    assert found.errors["x"] <= 2 * max(epsilon * np.exp(-found.time / epsilon), 1e-11)


def test_a_base_point_off_the_solved_piece_is_refused() -> None:
    """The layer takes x from 0 to 1/10, and the piece begins at 1/5, where the run comes onto it later."""
    system = SlowFastSystem(slow={x: 10 * y + 1}, fast={y: -y}, epsilon=eps)
    (branch,) = solve_critical(system).branches
    piece = solve_manifold(branch, region={"x": (0.2, 1)}, epsilon=0.01, tolerance=1e-12)
    with pytest.raises(GspError, match=r"covers x in \[0.2, 1\]"):
        shadow(branch, {"x": 0.0, "y": 1.0}, epsilon=0.01, reconstruction={}, surface=piece)


@pytest.mark.parametrize("by", [1_000, -1_000_000])
@pytest.mark.parametrize("is_solved", [False, True])
def test_far_from_the_origin_a_base_point_is_where_it_is_and_costs_the_same(
    by: int, is_solved: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Slopes over steps of 1e-4 |x| made 80,000 panels of one layer at a million."""
    calls: list[int] = []
    rates = shadowing._ShadowingFlow.rates
    monkeypatch.setattr(
        shadowing._ShadowingFlow, "rates", lambda flow, z: calls.append(len(z)) or rates(flow, z)
    )
    found = []
    for c in (0, by):
        u, v = x - c, y - c
        system = SlowFastSystem(
            slow={x: u * v - 2 * u**2 / (1 + u**2)}, fast={y: u - v - v**3 / 5}, epsilon=eps
        )
        (branch,) = solve_critical(system).branches
        branch = branch.through({"x": 1.0 + c, "y": 0.8 + c})
        surface = solve_manifold(branch, region={"x": (c + 0.2, c + 2.0)}, epsilon=0.02) if is_solved else None
        start = {"x": 1.0 + c, "y": 2.0 + c, "q": 0.0}
        base = shadow(branch, start, epsilon=0.02, reconstruction={q: v}, surface=surface)
        found.append((base.values["x"] - c, base.values["q"], base.errors["x"], len(calls)))
        calls.clear()
    (near, driven_near, _, few), (far, driven_far, error, many) = found
    assert far == pytest.approx(near, abs=error + abs(by) * 2e-15)
    assert driven_far == pytest.approx(driven_near, abs=abs(by) * 2e-15 + 1e-12)
    assert error < 1e-7
    assert many <= 2 * few
