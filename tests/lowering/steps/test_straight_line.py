"""Straight-line decompositions: against LAPACK on any pattern, in lanes too; no needless fill, no silent failure."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from llvmlite import ir

from gsp.kernels.engine import build
from gsp.lowering.steps.arithmetic import ComplexArithmetic, RealArithmetic
from gsp.lowering.steps.straight_line import eliminate, factorise, solve
from gsp.lowering.steps.values import DOUBLE, SIGNATURE, load, store

POINTER = ctypes.POINTER(ctypes.c_double)
FUNCTION = ctypes.CFUNCTYPE(None, ctypes.c_double, POINTER, POINTER, POINTER)


def ring(cells: int) -> np.ndarray:
    """Pattern of a ring of FitzHugh-Nagumo cells (v_1.., w_1..), each coupled to its neighbours' v."""
    pattern = np.zeros((2 * cells, 2 * cells), dtype=bool)
    for i in range(cells):
        pattern[i, [(i - 1) % cells, i, (i + 1) % cells, cells + i]] = True
        pattern[cells + i, [i, cells + i]] = True
    return pattern


def solved(pattern: np.ndarray, jacobian: np.ndarray, shifts, b: np.ndarray) -> tuple[np.ndarray, bool]:
    """x (lanes, n) of (shift - J) x = b for each of the `shifts`, complex, in lanes; and whether it can be used."""
    n, lanes = len(pattern), len(shifts)
    module = ir.Module()
    function = ir.Function(module, SIGNATURE, "f")
    builder = ir.IRBuilder(function.append_basic_block())
    _, j, p, out = function.args
    arithmetic = ComplexArithmetic(builder, lanes)
    real = RealArithmetic(builder, lanes)
    vector = ir.VectorType(DOUBLE, lanes)
    lane = [ir.Constant(ir.IntType(32), k) for k in range(lanes)]

    def gathered(start: int) -> ir.Value:
        value = ir.Constant(vector, ir.Undefined)
        for k in range(lanes):
            value = builder.insert_element(value, load(builder, p, start + k), lane[k])
        return value

    def same(value: ir.Value) -> ir.Value:
        result = ir.Constant(vector, ir.Undefined)
        for k in range(lanes):
            result = builder.insert_element(result, value, lane[k])
        return result

    zero = real.constant(0.0)
    shift = gathered(0), gathered(lanes)
    entries = {
        (r, c): (same(builder.fneg(load(builder, j, r * n + c))), zero)
        for r in range(n)
        for c in range(n)
        if pattern[r, c]
    }
    for i in range(n):
        entry = entries.get((i, i))
        entries[i, i] = shift if entry is None else tuple(map(builder.fadd, entry, shift))
    elimination = eliminate(n, zip(*np.nonzero(pattern)))
    factors, usable = factorise(arithmetic, entries, elimination)
    right = [(gathered(2 * lanes * (i + 1)), gathered(2 * lanes * (i + 1) + lanes)) for i in range(n)]
    for i, (a, c) in enumerate(solve(arithmetic, factors, elimination, right)):
        for k in range(lanes):
            store(builder, builder.extract_element(a, lane[k]), out, 2 * (k * n + i))
            store(builder, builder.extract_element(c, lane[k]), out, 2 * (k * n + i) + 1)
    for k in range(lanes):
        flag = builder.uitofp(builder.extract_element(usable, lane[k]), DOUBLE)
        store(builder, flag, out, 2 * lanes * n + k)
    builder.ret_void()
    engine = build(str(module), library=())
    values = np.array(shifts, dtype=complex)
    constants = [np.concatenate([values.real, values.imag])]
    constants += [np.concatenate([b[:, i].real, b[:, i].imag]) for i in range(n)]
    result = np.empty(2 * lanes * n + lanes)
    arrays = np.ascontiguousarray(jacobian).ravel(), np.concatenate(constants), result
    FUNCTION(engine.get_function_address("f"))(0.0, *(a.ctypes.data_as(POINTER) for a in arrays))
    return result[: 2 * lanes * n].view(complex).reshape(lanes, n), bool(result[2 * lanes * n :].all())


PATTERNS = {
    "ring": ring(5),
    "long ring": ring(16),
    "arrow": np.eye(12, dtype=bool) | (np.arange(12) == 0)[None, :] | (np.arange(12) == 0)[:, None],
    "random": np.random.default_rng(3).random((15, 15)) < 0.15,
    "one way": np.tri(9, k=-1, dtype=bool) & (np.random.default_rng(4).random((9, 9)) < 0.6),
    "diagonal": np.eye(8, dtype=bool),
    "full": np.ones((5, 5), dtype=bool),
}


@pytest.mark.parametrize("name", PATTERNS)
def test_solutions_are_those_of_lapack(name):
    pattern = PATTERNS[name]
    n = len(pattern)
    rng = np.random.default_rng(n)
    jacobian = np.where(pattern, rng.normal(size=(n, n)), 0.0) - 2.0 * np.diag(np.diag(pattern))
    shifts = [3.0, 250.0, 3.0 + 4.0j]
    b = rng.normal(size=(3, n)) + 1j * rng.normal(size=(3, n))
    found, usable = solved(pattern, jacobian, shifts, b)
    assert usable
    for shift, right, x in zip(shifts, b, found):
        matrix = shift * np.eye(n) - jacobian
        expected = np.linalg.solve(matrix, right)
        assert x == pytest.approx(expected, rel=1e-13 * np.linalg.cond(matrix), abs=1e-13)


def test_no_needless_fill():
    """An arrow fills in wholly when its tip is taken first, and not at all when it is taken last."""
    elimination = eliminate(12, zip(*np.nonzero(PATTERNS["arrow"])))
    assert elimination.order[-2] == 0 or elimination.order[-1] == 0
    assert elimination.operations == 11 * 3
    assert eliminate(8, zip(*np.nonzero(PATTERNS["diagonal"]))).operations == 0


@pytest.mark.parametrize("scale", [1.0, 1e6, 1e-6])
def test_growth_is_seen_and_units_are_not_mistaken_for_it(scale):
    """[[d, -1], [-s, 2s + d]]: big numbers in a fast row are no growth; a pivot of 1e-9 beside 1 is."""
    pattern = np.ones((2, 2), dtype=bool)
    b = np.ones((1, 2), dtype=complex)
    stiff = np.array([[0.0, 1.0], [scale, -2.0 * scale]])
    found, usable = solved(pattern, stiff, [1.0], b)
    assert usable
    assert found[0] == pytest.approx(np.linalg.solve(np.eye(2) - stiff, b[0]), rel=1e-12)
    small = np.array([[1.0 - 1e-9 * scale, scale], [scale, 0.5]])
    _, usable = solved(pattern, small, [1.0], b)
    assert not usable


def test_a_pivot_that_is_zero_infinite_or_no_number_is_seen():
    pattern = np.ones((2, 2), dtype=bool)
    b = np.ones((1, 2), dtype=complex)
    for bad in (1.0, float("nan"), float("inf")):
        _, usable = solved(pattern, np.array([[bad, 1.0], [1.0, 0.0]]), [1.0], b)
        assert not usable
