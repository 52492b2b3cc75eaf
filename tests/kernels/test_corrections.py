"""What corrects the dense output of DOP853: the error over all trees of order 8, and a single step."""

from __future__ import annotations

from collections import Counter
from math import factorial, prod

import numpy as np
import pytest
import sympy as sp
from numpy.polynomial import polynomial

from gsp.integration.methods import Method
from gsp.integration.trajectory import integrate
from gsp.kernels import corrections, integrator
from gsp.kernels.corrections import READ
from gsp.kernels.dop853_tableau import DENSE, DENSE_ROWS, EXTENDED_STAGES, STAGES, A
from gsp.lowering.compiled_flow import compile_flow
from gsp.systems.system import VectorField

x, y = sp.symbols("x y")
SHARES = np.linspace(0, 1, 101)


def trees(order: int) -> list[tuple]:
    """Rooted trees, each the sorted tuple of what hangs on its root."""

    def forests(total: int, most: tuple):
        if total == 0:
            yield ()
        for size in range(1, total + 1):
            for tree in trees(size):
                if (size, tree) <= most:
                    for rest in forests(total - size, (size, tree)):
                        yield (tree, *rest)

    return sorted(set(map(tuple, map(sorted, forests(order - 1, (order, ()))))))


def nodes(tree: tuple) -> int:
    return 1 + sum(map(nodes, tree))


def density(tree: tuple) -> int:
    return nodes(tree) * prod(map(density, tree))


def symmetry(tree: tuple) -> int:
    return prod(factorial(count) * symmetry(branch) ** count for branch, count in Counter(tree).items())


def weights(tree: tuple) -> np.ndarray:
    found = np.ones(EXTENDED_STAGES)
    for branch in tree:
        found = found * (A @ weights(branch))
    return found


def output_weights(shares: np.ndarray) -> np.ndarray:
    """The weights of the stages in the dense output (shares, stages)."""
    first, last = np.eye(EXTENDED_STAGES)[[0, STAGES]]
    rise = A[STAGES]
    rows = [np.zeros(EXTENDED_STAGES), rise, first - rise, 2 * rise - last - first, *DENSE]
    return corrections._values(corrections._OUTPUT, shares).T @ np.array(rows)


def test_the_correction_leaves_a_thirtieth_of_the_error_over_all_trees_of_order_8():
    known = trees(8)
    assert len(known) == 115
    stages = np.array([weights(tree) for tree in known]).T
    exact = np.array([1 / density(tree) for tree in known])
    scale = np.array([1 / symmetry(tree) for tree in known])
    errors = (SHARES[:, None] ** 8 * exact - output_weights(SHARES) @ stages) * scale
    # The slopes of these polynomials of degree 8 where they are looked at.
    fitted = polynomial.polyfit(SHARES, errors, 8)
    slopes = polynomial.polyval(np.array(corrections.PLACES), polynomial.polyder(fitted)).T
    terms = corrections._values(corrections._ERROR, SHARES).T @ corrections.NUMBERS.T
    left = errors - terms @ slopes

    def size(values: np.ndarray) -> float:
        return np.sqrt((values**2).sum(axis=1)).max()

    assert size(left) < size(errors) / 28
    # What is found is not magnified.
    assert np.abs(terms).sum(axis=1).max() < 0.34


@pytest.mark.exhaustive
def test_corrected_values_in_a_step_are_ten_times_as_good_as_the_dense_output():
    field = VectorField({x: y, y: (1 - x**2) * y - x}, epsilon=None)
    asked = {"start": {"x": 2.0, "y": 0.5}, "span": (0, 0.5), "method": Method.DOP853}
    times = np.linspace(0, 0.5, 21)[1:-1]
    exact = integrate(field, at=times, **asked | {"method": Method.RADAU13}, rtol=1e-13, atol=1e-15).y
    compiled = compile_flow(field)
    run = integrate(field, rtol=1e-5, atol=1e-5, **asked)._record
    corrected = np.ascontiguousarray(integrate(field, rtol=1e-5, atol=1e-5, **asked).at(times).T)
    dense = np.abs(corrected.T - exact).max()
    doubts, counters = np.empty(len(times), np.int64), np.zeros(integrator.COUNTERS_SIZE, np.int64)
    # At a tolerance that the dense output does not meet.
    steps = run.times, run.states, run.dense
    asked = compiled.explicit_program, compiled.constants, (0.0, 0.2 * dense), steps
    assert corrections.correct_grid(*asked, times, corrected, doubts, counters) == 0
    assert np.abs(corrected.T - exact).max() < 0.1 * dense
    assert (doubts == READ).all()
    assert counters[integrator.FIELD_CALLS] == 3 * (len(run.times) - 1) + 3


def test_where_the_field_is_not_finite_nothing_is_corrected_and_all_is_in_doubt():
    compiled = compile_flow(VectorField({x: sp.sqrt(x)}, epsilon=None))
    times, states = np.array([0.0, 1.0]), np.array([[1.0], [0.5]])
    rows = np.full((1, DENSE_ROWS, 1), -50.0)
    grid, out, doubts = np.array([0.3, 0.6]), np.array([[1.0], [2.0]]), np.empty(2, np.int64)
    found = corrections.correct_grid(
        compiled.explicit_program, compiled.constants, (1e-3, 1e-3), (times, states, rows), grid, out, doubts,
        np.zeros(integrator.COUNTERS_SIZE, np.int64),
    )  # fmt: skip
    assert found == 2
    assert doubts.tolist() == [0, 0]
    assert out.tolist() == [[1.0], [2.0]]
