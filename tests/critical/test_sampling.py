"""A sampled branch: where its samples lie, which of them are neighbours, and its derivatives against SymPy's."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.sampling import Sampler, grid, neighbours
from gsp.critical.sheet_points import (
    Allowance,
    distinct,
    fast_lengths,
    guesses,
    newton_at_each,
    signs,
    solve_each,
)
from gsp.errors import DeclarationError
from gsp.systems.region import EDGE
from gsp.systems.system import SlowFastSystem

u, v, w, x, y, eps = sp.symbols("u v w x y epsilon")


def sampler(slow: dict, fast: dict) -> Sampler:
    return Sampler(solve_critical(SlowFastSystem(slow=slow, fast=fast, epsilon=eps)).branches[0])


# Two slow and two fast variables, all derivatives of both kinds different from zero.
COUPLED = (
    {u: x * v - u, v: y**2 + u * v},
    {x: u**2 - 2 * x + v * y / 2, y: sp.sin(v) - 3 * y + u * x},
)
POINTS = np.array([[0.3, -0.2, 0.1, 0.4], [1.0, 0.5, -0.3, 0.2]])


def at(expression, point: np.ndarray):
    return np.array(sp.Matrix(expression).subs(dict(zip((u, v, x, y), point))).evalf(), dtype=float)


# -- samples -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dimension", "coarse", "count"),
    [(1, False, 257), (2, False, 33**2), (3, False, 2048 + 8), (1, True, 33), (2, True, 81), (3, True, 64 + 8)],
)
def test_samples_fill_the_box_up_to_its_corners(dimension: int, coarse: bool, count: int) -> None:
    box = np.array([[-1.0, 3.0], [10.0, 10.5], [-7.0, -6.0]])[:dimension]
    points = grid(box, coarse=coarse)
    corners = {tuple(corner) for corner in np.array(np.meshgrid(*box)).reshape(dimension, -1).T.tolist()}
    assert corners <= {tuple(point) for point in points.tolist()}
    assert len(points) == count
    assert (points >= box[:, 0]).all()
    assert (points <= box[:, 1]).all()
    # Evenly: the mean is the middle, to within the share of the corners.
    middle = (points.mean(axis=0) - box[:, 0]) / (box[:, 1] - box[:, 0])
    assert middle == pytest.approx(0.5, abs=0.01)


def test_neighbours_of_a_grid_are_one_step_apart_along_one_axis_and_all_of_them_are_there() -> None:
    first, second = neighbours(33, 1)
    assert (second - first == 1).all()
    assert sorted(first) == list(range(32))
    box = np.array([[0.0, 32.0], [0.0, 3200.0]])
    x = grid(box)
    first, second = neighbours(len(x), 2)
    steps = (x[second] - x[first]) / [1.0, 100.0]
    assert len(first) == len(set(zip(first.tolist(), second.tolist()))) == 2 * 33 * 32
    assert np.sort(steps, axis=1) == pytest.approx(np.tile([0.0, 1.0], (len(steps), 1)))
    first, second = neighbours(5, 3)
    assert (first.tolist(), second.tolist()) == ([0, 1, 2, 3], [1, 2, 3, 4])


@pytest.mark.exhaustive
def test_links_stay_on_their_sheet_whatever_the_order_of_the_samples() -> None:
    # y^3 - 3 y = x has three sheets over (-2, 2) and one beyond.
    own = sampler({x: sp.Integer(1)}, {y: x - y**3 + 3 * y})
    box = {"x": (-3.0, 3.0)}
    grid_points = own.grid(box)
    z, rows = own.points(grid_points, box)
    inner = np.abs(grid_points[:, 0]) < 2
    assert [np.sum(rows == r) for r in range(len(grid_points))] == [3 if i else 1 for i in inner]
    assert own.residual(z) < 1e-12
    shuffled = np.random.default_rng(0).permutation(len(z))
    a, b = own.links(z[shuffled], rows[shuffled], grid_points)
    width = 6.0 / 256
    assert b[:, 0] - a[:, 0] == pytest.approx(width)
    # Along a sheet dy = dx/(3 y^2 - 3); a link never jumps to another one.
    sheet = np.digitize(a[:, 1], [-1.0, 1.0])
    assert (np.digitize(b[:, 1], [-1.0, 1.0]) == sheet).all()
    away = np.abs(3 * a[:, 1] ** 2 - 3) > 1.0
    slope = (b[away, 1] - a[away, 1]) / width
    assert slope == pytest.approx(1 / (3 * ((a[away, 1] + b[away, 1]) / 2) ** 2 - 3), rel=0.02)
    assert len(a) >= 3 * inner.sum() - 3 + (~inner).sum() - 2


def test_a_point_on_the_edge_is_inside_and_one_beyond_rounding_is_not() -> None:
    own = sampler(*COUPLED)
    box = {"u": (0.0, 2.0), "y": (-1.0, 1.0)}
    z = np.array(
        [
            [0.0, 9.0, 9.0, 1.0],
            [-EDGE, 0, 0, 0],
            [-3 * EDGE, 0, 0, 0],
            [2 + EDGE, 0, 0, 0],
            [2 + 3 * EDGE, 0, 0, 0],
        ]
    )
    assert own.inside(z, box).tolist() == [True, True, False, True, False]
    assert own.inside(np.array([[np.nan, 0, 0, np.nan], [1.0, 0, 0, 1.1]]), box).tolist() == [True, False]


# -- derivatives -------------------------------------------------------------------------------------


def test_rates_and_derivatives_are_those_of_sympy() -> None:
    own = sampler(*COUPLED)
    f, g = sp.Matrix(list(COUPLED[0].values())), sp.Matrix(list(COUPLED[1].values()))
    everything, fast = sp.Matrix([*f, *g]), g.jacobian([x, y])
    bent = own.bent(POINTS[:1], np.array([[2.0, -1.0]]))
    for i, point in enumerate(POINTS):
        assert own.rates(POINTS)[i] == pytest.approx(at(everything, point)[:, 0])
        assert own.equilibria(POINTS)[i] == pytest.approx(at(g, point)[:, 0])
        assert own.jacobians(POINTS)[i] == pytest.approx(at(everything.jacobian([u, v, x, y]), point))
        assert own.equilibria_jacobian(POINTS)[i] == pytest.approx(at(g.jacobian([u, v, x, y]), point))
        assert own.fast_jacobian(POINTS)[i] == pytest.approx(at(fast, point))
    expected = (g.jacobian([x, y]) * sp.Matrix([2, -1])).jacobian([u, v, x, y])
    assert bent[0] == pytest.approx(at(expected, POINTS[0]))


def test_tangents_and_rates_along_the_sheet_are_those_of_the_implicit_function() -> None:
    own = sampler(*COUPLED)
    f, g = sp.Matrix(list(COUPLED[0].values())), sp.Matrix(list(COUPLED[1].values()))
    slope = -g.jacobian([x, y]).inv() * g.jacobian([u, v])
    along = f.jacobian([u, v]) + f.jacobian([x, y]) * slope
    fast = g.jacobian([x, y])
    largest = []
    for i, point in enumerate(POINTS):
        Y = at(slope, point)
        assert own.tangents(POINTS)[i] == pytest.approx(np.vstack([np.eye(2), Y]))
        A = at(along, point)
        expected = np.abs(np.linalg.eigvals(A).real).max()
        assert own.tangential_rates(POINTS)[i] == pytest.approx(expected)
        for k, slow in enumerate((u, v)):
            total = at(fast.diff(slow), point) + sum(
                Y[j, k] * at(fast.diff(s), point) for j, s in enumerate((x, y))
            )
            largest.append(np.abs(total).max())
    # No metric serves all points as well as its own serves each, and none is worse than the best one.
    in_units = max(np.abs(np.linalg.eigvalsh((A + A.T) / 2)).max() for A in map(partial(at, along), POINTS))
    assert (
        own.tangential_rates(POINTS).max()
        <= own.tangential_rate(POINTS) * (1 + 1e-12)
        <= in_units * (1 + 1e-12)
    )
    assert own.jacobian_variation(POINTS) == pytest.approx(max(largest))
    # Each entry of g_y changes as a whole: its parts are added before the largest is taken.
    cancels = sampler({u: -u}, {x: -x + 3 * u * y - 3 * y**2 / 2 + 3 * u - 3 * u**2 / 2, y: u - y})
    assert cancels.jacobian_variation(np.array([[0.2, 0.1, 0.2]])) == pytest.approx(0.0, abs=1e-12)


def test_where_the_fast_jacobian_is_singular_there_are_no_tangents() -> None:
    own = sampler({x: y}, {y: x - y**3 / 3 + y})
    fold = np.array([[-2 / 3, 1.0], [0.0, 0.0]])
    assert np.isnan(own.tangents(fold)[0]).all()
    assert own.tangents(fold)[1] == pytest.approx(np.array([[1.0], [-1.0]]))
    assert own.tangential_rates(fold).tolist() == [np.inf, 1.0]
    assert own.tangential_rate(fold) == 1.0
    assert own.tangential_rate(fold[:1]) == np.inf
    assert own.jacobian_variation(fold) == own.jacobian_variation(fold[:0]) == np.inf
    assert own.jacobian_variation(fold[1:]) == 0.0
    assert sampler({x: y}, {y: x - y}).jacobian_variation(fold) == 0.0


def test_a_graph_keeps_its_slope_where_another_branch_passes_through_it() -> None:
    """g = (x - 1)(x^2 - y) on y = x^2: g_y = 1 - x, and dh_0/dx = 2x at x = 1 as elsewhere."""
    own = sampler({x: 1}, {y: (x - 1) * (x**2 - y)})
    z = np.array([[0.5, 0.25], [1.0, 1.0]])
    assert own.tangents(z)[:, :, 0] == pytest.approx(np.array([[1.0, 1.0], [1.0, 2.0]]))
    assert own.jacobian_variation(z) == pytest.approx(1.0)
    # At several such points at once, each has its own.
    own = sampler({x: 1}, {y: (x - 1) * (x + 2) * (x**2 - y)})
    z = np.array([[1.0, 1.0], [-2.0, 4.0], [0.5, 0.25]])
    assert own.tangents(z)[:, 1, 0] == pytest.approx([2.0, -4.0, 1.0])


def test_residuals_are_relative_to_how_far_the_branch_reaches() -> None:
    own = sampler({x: y}, {y: x - y})
    # From the lower to the upper tenth of y: 3.7 - 1.3.
    assert own.residual(np.array([[1.0, 1.0], [9.0, 4.0]])) == pytest.approx(5 / (3.7 - 1.3))


def test_a_jacobian_is_singular_when_most_samples_say_so() -> None:
    own = sampler({u: -u}, {x: u - x, y: u**2 * 1000 - y * u})
    samples = np.array([[0.0, 0, 0], [1e-6, 0, 0], [0.5, 0, 0], [1.0, 0, 0]])
    assert not own.is_singular(samples)
    assert own.is_singular(samples[:3])
    assert not own.is_singular(samples[2:])
    assert not own.is_singular(np.full((2, 3), np.nan))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_neither_units_nor_factors_of_equations_make_a_jacobian_singular(size: float) -> None:
    s = sp.Rational(size)
    system = SlowFastSystem(
        slow={u: -u}, fast={x: u - 2 * x + x**3 / 3 + y / s, y: s * sp.sin(u) - 3 * y + s * x}, epsilon=eps
    )
    branch = solve_critical(system).branches[0].through({"u": 0, "x": 0, "y": 0}, region={"y": (-size, size)})
    own = Sampler(branch)
    z, _ = own.points(np.linspace(-0.2, 0.2, 9)[:, None], {})
    assert len(z) == 9
    assert not own.is_singular(z)


def test_a_variable_is_as_long_as_the_branch_reaches_and_a_constant_one_as_it_is_large() -> None:
    y = np.array([[1e-9 * k, 5e6, 0.0] for k in range(9)])
    lengths = fast_lengths(y, None)
    np.testing.assert_allclose(lengths[:2], [6.4e-9, 5e6])
    assert lengths[2] == lengths[0]
    assert fast_lengths(y, (1.0, 1.0, 0.125))[2] == 0.125
    assert fast_lengths(np.full((2, 1), np.nan), None) == 1.0


def test_spectra_of_a_constant_large_jacobian_are_found_once_and_stand_everywhere() -> None:
    n = 34
    ys = sp.symbols(f"y:{n}")
    rates = {ys[i]: u - (i + 1) * ys[i] + (ys[i + 1] if i + 1 < n else 0) for i in range(n)}
    own = sampler({u: -u}, rates)
    assert own.is_large
    assert own.is_constant
    found = own.eigenvalues(np.zeros((3, n + 1)))
    assert np.sort(-found.real, axis=1) == pytest.approx(np.tile(np.arange(1.0, n + 1), (3, 1)))
    assert not sampler(*COUPLED).is_large


# -- batched linear algebra --------------------------------------------------------------------------


@pytest.mark.parametrize("n", [1, 2, 5, 40])
def test_batches_are_solved_and_signed_as_one_by_one(n: int) -> None:
    rng = np.random.default_rng(n)
    matrices, vectors = rng.normal(size=(6, n, n)), rng.normal(size=(6, n))
    matrices[1] = matrices[0][np.append(np.arange(1, n), 0)]
    matrices[2] = 0.0
    solved = solve_each(matrices, vectors)
    assert np.isnan(solved[2]).all() or (n == 1 and not np.isfinite(solved[2]).any())
    for k in (0, 1, 3, 4, 5):
        assert matrices[k] @ solved[k] == pytest.approx(vectors[k], abs=1e-9)
    assert signs(matrices).tolist() == np.linalg.slogdet(matrices)[0].tolist()


@pytest.mark.parametrize("size", [40, 41])
def test_signs_of_large_sparse_matrices_count_the_exchanges_of_both_sides(size: int) -> None:
    rng = np.random.default_rng(size)
    matrices = []
    for _ in range(8):
        order = rng.permutation(size)
        matrix = np.diag(rng.choice([-1.0, 1.0], size) * rng.uniform(0.5, 2.0, size))[order]
        matrix[rng.integers(size), rng.integers(size)] += 0.3
        matrices.append(matrix)
    assert signs(np.array(matrices)).tolist() == np.linalg.slogdet(np.array(matrices))[0].tolist()


def test_newton_finds_each_root_and_gives_up_on_the_others() -> None:
    x_values = np.array([[4.0], [9.0], [-1.0], [np.nan]])
    starts = np.array([[1.0], [-1.0], [0.5], [1.0]])
    found, good = newton_at_each(lambda z: z[:, 1:] ** 2 - z[:, :1], lambda z: 2 * z[:, 1:], x_values, starts)
    assert good.tolist() == [True, True, False, False]
    assert found[:2, 0] == pytest.approx([2.0, -3.0], rel=1e-12)
    assert starts[0, 0] == 1.0


def test_a_step_whose_length_is_beyond_doubles_is_given_up_in_silence() -> None:
    with np.errstate(over="raise"):
        _, good = newton_at_each(
            lambda z: np.full((len(z), 1), 1e200),
            lambda z: np.full((len(z), 1), 1e-5),
            np.zeros((1, 1)),
            np.ones((1, 1)),
        )
    assert good.tolist() == [False]


def test_roots_that_are_rounding_of_one_another_are_one() -> None:
    points = np.array(
        [[3.0, 1.0], [0.0, 0.0], [0.0, 0.9e-8], [3.0, 1.0 + 3e-8], [0.0, 1.1e-8], [3.0, 1.0 + 6e-8]]
    )
    assert distinct(points).tolist() == [[0.0, 0.0], [0.0, 1.1e-8], [3.0, 1.0], [3.0, 1.0 + 6e-8]]
    assert distinct(np.empty((0, 2))).shape == (0, 2)


def test_an_allowance_is_used_up_exactly_and_stays_so() -> None:
    own = Allowance(5)
    assert [own.take(3), own.spent, own.take(2), own.spent, own.left] == [True, False, True, False, 0]
    assert [own.take(1), own.spent, own.take(0)] == [False, True, False]
    greedy = Allowance(5)
    assert [greedy.take(6), greedy.left, greedy.take(1)] == [False, 5, False]


def test_guesses_are_finite_and_one_or_one_each() -> None:
    assert guesses(2.0, 3, (x,)).tolist() == [[2.0]] * 3
    assert guesses([1, 2], 2, (x, y)).tolist() == [[1.0, 2.0]] * 2
    for wrong in ([1.0, np.inf], [], [1, 2, 3], [[1, 2]] * 3):
        with pytest.raises(DeclarationError, match="finite numbers for x, y"):
            guesses(wrong, 2, (x, y))


def test_newton_at_rest_far_out_overflows_nothing() -> None:
    # A warning is an error here. A step of no length was a divisor of 1e-300.
    found, good = newton_at_each(
        lambda z: 0.0 * z[:, 1:], lambda z: np.ones((len(z), 1)), np.zeros((1, 1)), np.array([[1e9]])
    )
    assert good.all()
    assert found[0, 0] == 1e9


@pytest.mark.parametrize("power", [-9, 0, 9])
@pytest.mark.parametrize("factor", [sp.Rational(1, 10**6), sp.Integer(10) ** 6])
def test_how_far_points_are_off_does_not_depend_on_units_nor_on_factors_of_the_rates(
    power: int, factor
) -> None:
    unit = sp.Integer(10) ** power
    rate = factor * (x**2 + 1 - y / unit) * unit
    system = SlowFastSystem(slow={x: -x}, fast={y: rate}, epsilon=sp.Symbol("epsilon"))
    sampler = Sampler(solve_critical(system).branches[0])
    at = np.linspace(1.0, 2.0, 11)
    on = np.stack([at, (at**2 + 1) * float(unit)], axis=1)
    off = on + np.array([0.0, 1e-3 * float(unit)])
    assert sampler.residual(on) < 1e-14
    assert sampler.residual(off) == pytest.approx(1e-3 / (4.61 - 2.21), rel=1e-6)
