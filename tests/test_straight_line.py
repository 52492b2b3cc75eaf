"""Straight-line decompositions: against LAPACK on any pattern, no needless fill, no silent failure."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
import sympy as sp

from gsp.ensemble import integrate_many
from gsp.errors import Status
from gsp.integrators import Method
from gsp.lowering import compile_flow
from gsp.straight_line import FEWEST_STATES, Decomposition, decompose, eliminate
from gsp.system import SlowFastSystem, VectorField
from gsp.trajectory import integrate

POINTER = ctypes.POINTER(ctypes.c_double)
FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)


def run(address: int, t: float, *arrays: np.ndarray) -> None:
    FUNCTION(address)(t, *(array.ctypes.data_as(POINTER) for array in arrays))


def ring(cells: int) -> np.ndarray:
    """Pattern of a ring of FitzHugh-Nagumo cells (v_1.., w_1..), each coupled to its neighbours' v."""
    pattern = np.zeros((2 * cells, 2 * cells), dtype=bool)
    for i in range(cells):
        pattern[i, [(i - 1) % cells, i, (i + 1) % cells, cells + i]] = True
        pattern[cells + i, [i, cells + i]] = True
    return pattern


def compiled(pattern: np.ndarray) -> Decomposition:
    found = decompose(pattern)
    assert found is not None
    return found


def factors(code: Decomposition, jacobian: np.ndarray, shift: complex) -> tuple[np.ndarray, bool]:
    """Factors of shift - J, real ones for a real shift, and whether they can be used."""
    flat = np.ascontiguousarray(jacobian).ravel()
    if isinstance(shift, complex):
        out = np.full(2 * code.size, np.nan)
        run(code.factorise_complex, shift.real, flat, np.array([shift.imag]), out)
        return out, out[2 * (code.size - 1)] == 1.0
    out = np.full(code.size, np.nan)
    run(code.factorise, shift, flat, np.zeros(1), out)
    return out, out[code.size - 1] == 1.0


PATTERNS = {
    "ring": ring(5),
    "long ring": ring(16),
    "arrow": np.eye(12, dtype=bool) | (np.arange(12) == 0)[None, :] | (np.arange(12) == 0)[:, None],
    "random": np.random.default_rng(3).random((15, 15)) < 0.15,
    "one way": np.tri(9, k=-1, dtype=bool) & (np.random.default_rng(4).random((9, 9)) < 0.6),
    "diagonal": np.eye(8, dtype=bool),
}


@pytest.mark.parametrize("shift", [3.0, 250.0, 3.0 + 4.0j])
@pytest.mark.parametrize("name", PATTERNS)
def test_solutions_are_those_of_lapack(name, shift):
    pattern = PATTERNS[name]
    n = len(pattern)
    rng = np.random.default_rng(n)
    jacobian = np.where(pattern, rng.normal(size=(n, n)), 0.0) - 2.0 * np.diag(np.diag(pattern))
    code = compiled(pattern)
    found, usable = factors(code, jacobian, shift)
    assert usable
    b = rng.normal(size=n) + (1j * rng.normal(size=n) if isinstance(shift, complex) else 0.0)
    x = b.copy()
    solve = code.solve_complex if isinstance(shift, complex) else code.solve
    run(solve, 0.0, found, np.zeros(1), x.view(float))
    matrix = shift * np.eye(n) - jacobian
    expected = np.linalg.solve(matrix, b)
    assert x == pytest.approx(expected, rel=1e-13 * np.linalg.cond(matrix), abs=1e-13)


def test_an_arrow_matrix_fills_in_nothing():
    pattern = PATTERNS["arrow"]
    elimination = eliminate(pattern)
    assert elimination.order[-2:] in ((0, 11), (11, 0), (10, 0), (0, 10))
    assert len(elimination.position) == pattern.sum()
    # Eleven pivots with one row and one column each, and the corner.
    assert elimination.operations == 11 * 3


def test_the_cost_of_a_ring_grows_with_its_length_only():
    costs = [eliminate(ring(cells)).operations for cells in (8, 16, 32)]
    assert costs[1] - costs[0] == (costs[2] - costs[1]) / 2


def test_every_entry_that_fills_in_is_stored():
    rng = np.random.default_rng(11)
    for _ in range(20):
        pattern = rng.random((10, 10)) < 0.25
        elimination = eliminate(pattern)
        matrix = np.where(pattern | np.eye(10, dtype=bool), rng.random((10, 10)), 0.0) + 5.0 * np.eye(10)
        order = list(elimination.order)
        lower_upper = matrix[np.ix_(order, order)]
        for k in range(9):
            lower_upper[k + 1 :, k] /= lower_upper[k, k]
            lower_upper[k + 1 :, k + 1 :] -= np.outer(lower_upper[k + 1 :, k], lower_upper[k, k + 1 :])
        filled = {(order[i], order[j]) for i, j in zip(*np.nonzero(lower_upper))}
        assert filled <= set(elimination.position)


@pytest.mark.parametrize("shift", [0.0, 0.0j])
@pytest.mark.parametrize(
    "pair",
    [
        [[0.0, 1.0], [1.0, 0.0]],  # regular, with no pivot on the diagonal
        [[1e-9, 1.0], [1.0, 1.0]],  # regular, with a pivot that loses nine digits
        [[0.0, 0.0], [0.0, 1.0]],  # singular
        [[np.nan, 1.0], [1.0, 1.0]],
    ],
)
def test_a_pivot_that_cannot_be_trusted_is_reported(pair, shift):
    pattern = np.eye(8, dtype=bool)
    pattern[:2, :2] = True
    jacobian = -np.eye(8)
    jacobian[:2, :2] = pair
    _, usable = factors(compiled(pattern), jacobian, shift)
    assert not usable


def test_small_and_dense_patterns_are_left_to_the_loops():
    assert decompose(np.eye(FEWEST_STATES - 1, dtype=bool)) is None
    assert decompose(np.ones((20, 20), dtype=bool)) is None


def test_one_pattern_is_compiled_once():
    assert decompose(ring(5)) is decompose(ring(5).tolist())


# In an integration


def cells(count: int) -> SlowFastSystem:
    """A ring of FitzHugh-Nagumo cells."""
    v, w = sp.symbols(f"v0:{count}"), sp.symbols(f"w0:{count}")
    fast = {
        v[i]: v[i] - v[i] ** 3 / 3 - w[i] + sp.Rational(1, 2) + (v[i - 1] - 2 * v[i] + v[(i + 1) % count]) / 10
        for i in range(count)
    }
    slow = {w[i]: v[i] + sp.Rational(7, 10) - sp.Rational(4, 5) * w[i] for i in range(count)}
    return SlowFastSystem(slow=slow, fast=fast, epsilon=sp.Symbol("epsilon"))


def start_of(count: int) -> dict[str, float]:
    phase = 2 * np.pi * np.arange(count) / count
    return {f"v{i}": np.cos(phase[i]) for i in range(count)} | {
        f"w{i}": 0.3 * np.sin(phase[i]) for i in range(count)
    }


def both(flow, start, monkeypatch, **options):
    """The run with the straight-line code, and with the loops alone."""
    found = integrate(flow, start=start, **options)
    assert compile_flow(flow).decomposition is not None
    monkeypatch.setitem(compile_flow(flow).__dict__, "decomposition", None)
    return found, integrate(flow, start=start, **options)


STIFF = pytest.mark.parametrize("method", [Method.RODAS5P, Method.RADAU5, Method.RADAU9, Method.RADAU13])


@STIFF
def test_a_run_is_that_of_the_loops(method, monkeypatch):
    sparse, dense = both(
        cells(4), start_of(4), monkeypatch, span=(0, 3), epsilon=0.01, method=method, rtol=1e-7
    )
    assert sparse.stats == dense.stats
    # At the end, not step by step: the steps' ends differ in the last digits, and at a jump that is much.
    assert sparse.y[:, -1] == pytest.approx(dense.y[:, -1], abs=1e-9)


@STIFF
def test_pivots_that_cannot_be_trusted_are_left_to_the_loops(method, monkeypatch):
    # Fast rotations: beside 1e7 on both sides of it the diagonal is small as soon as steps are long.
    x = sp.symbols("x0:8")
    rates = {}
    for a, b in zip(x[::2], x[1::2]):
        rates[a] = 10**7 * (sp.cos(x[0]) - b)
        rates[b] = 10**7 * (a - sp.Rational(1, 10) * b)
    rates[x[0]] = -x[0]
    flow = VectorField(rates, epsilon=None)
    start = {s.name: 1.0 for s in x}
    sparse, dense = both(flow, start, monkeypatch, span=(0, 2), method=method, rtol=1e-6)
    assert sparse.status is dense.status is Status.SUCCESS
    assert sparse.stats.steps < 3000
    assert sparse.y[0, -1] == pytest.approx(np.exp(-2.0), rel=1e-5)
    assert sparse.y[3, -1] == pytest.approx(np.cos(np.exp(-2.0)), abs=1e-4)


def test_members_of_an_ensemble_use_the_same_code():
    flow, start = cells(4), start_of(4)
    options = {"span": (0.0, 1.0), "epsilon": 0.01, "rtol": 1e-6}
    ensemble = integrate_many(flow, [start, {**start, "v0": 0.5}], **options)
    alone = integrate(flow, start=start, at=[1.0], **options)
    assert (ensemble.y[0] == alone.y).all()
