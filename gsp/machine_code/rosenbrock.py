"""A whole step of Rodas5P as straight-line code for one flow: eight stages, one decomposition, no loop.

Two functions with the signature of `emission`, on a point's block [y (n), z' (n), entries of the Jacobian]:

    linearise    z = y (n,), out = the block
    step         t = h, z = the block, then rtol and atol; out = the block at the step's end, then [1 if the pivots can
                 be used, squared error, error of the dense output, rows of the dense output (3, n)]

Both errors are over the tolerance; see `kernels.rodas5p`, whose loops do the same for any flow.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from gsp.kernels.rodas5p_tableau import DENSE, DENSE_ROWS, GAMMA, LAST_BUT_ONE, LAST_TERM, STAGES, A, C
from gsp.machine_code.arithmetic import RealArithmetic
from gsp.machine_code.emission import DOUBLE, SIGNATURE, load, store
from gsp.machine_code.flow_code import FlowCode
from gsp.machine_code.straight_line import factorise, solve


def write_rosenbrock(flow: FlowCode) -> str:
    """The module's text."""
    module = ir.Module()
    _write_linearise(module, flow)
    _write_step(module, flow)
    return str(module)


def block_size(flow: FlowCode) -> int:
    """Doubles of a point's block."""
    return 2 * len(flow.states) + len(flow.jacobian)


def _write_linearise(module: ir.Module, flow: FlowCode) -> None:
    function = ir.Function(module, SIGNATURE, "linearise")
    builder: Any = ir.IRBuilder(function.append_basic_block())
    _, z, p, out = function.args
    y = [load(builder, z, i) for i in range(len(flow.states))]
    _store_block(builder, flow, y, flow.constants(builder, p), out)
    builder.ret_void()


def _store_block(builder: Any, flow: FlowCode, y: list[Any], constants: dict, out: ir.Value) -> None:
    rates, entries = flow.linearisation(builder, y, constants)
    for i, value in enumerate((*y, *rates, *entries.values())):
        store(builder, value, out, i)


def _write_step(module: ir.Module, flow: FlowCode) -> None:
    function = ir.Function(module, SIGNATURE, "step")
    builder: Any = ir.IRBuilder(function.append_basic_block())
    h, block, p, out = function.args
    n, size = len(flow.states), block_size(flow)
    y = [load(builder, block, i) for i in range(n)]
    rates = [load(builder, block, n + i) for i in range(n)]
    entries = {place: load(builder, block, 2 * n + i) for i, place in enumerate(flow.jacobian)}
    rtol, atol = load(builder, block, size), load(builder, block, size + 1)
    constants = flow.constants(builder, p)
    real = RealArithmetic(builder)

    inverse = real.reciprocal(h)
    diagonal = builder.fmul(inverse, real.constant(1.0 / GAMMA))
    matrix = {place: builder.fneg(entry) for place, entry in entries.items()}
    for i in range(n):
        matrix[i, i] = builder.fadd(matrix[i, i], diagonal) if (i, i) in matrix else diagonal
    elimination = flow.elimination
    factors, usable = factorise(real, matrix, elimination)

    k = [solve(real, factors, elimination, rates)]
    argument = y
    for s in range(1, STAGES):
        if s < len(A):
            argument = [_combination(real, A[s, :s], [row[i] for row in k], y[i]) for i in range(n)]
        else:
            argument = [builder.fadd(argument[i], k[-1][i]) for i in range(n)]
        # Oldest increments first: only the last is waited for.
        pushes = [_combination(real, C[s, :s], [row[i] for row in k]) for i in range(n)]
        values = flow.field(builder, argument, constants)
        right = [real.add_product(values[i], pushes[i], inverse) for i in range(n)]
        k.append(solve(real, factors, elimination, right))
    y_new = [builder.fadd(argument[i], k[-1][i]) for i in range(n)]

    weights = []
    for a, b in zip(y, y_new):
        larger = real.largest([real.size(a), real.size(b)])
        weights.append(real.reciprocal(real.add_product(atol, rtol, larger)))
    total: Any = None
    for weight, last in zip(weights, k[-1]):
        ratio = builder.fmul(last, weight)
        total = real.add_product(total, ratio, ratio)
    rows = [[_combination(real, DENSE[m], [row[i] for row in k]) for i in range(n)] for m in range(DENSE_ROWS)]
    gap = _gap(real, rows[1], rows[2], weights)
    _store_block(builder, flow, y_new, constants, out)
    store(builder, builder.uitofp(usable, DOUBLE), out, size)
    store(builder, builder.fmul(total, real.constant(1.0 / n)), out, size + 1)
    store(builder, gap, out, size + 2)
    for m in range(DENSE_ROWS):
        for i in range(n):
            store(builder, rows[m][i], out, size + 3 + m * n + i)
    builder.ret_void()


def _combination(real: RealArithmetic, weights: Any, values: list[Any], start: Any = None) -> Any:
    total = start
    for weight, value in zip(weights, values):
        if weight != 0.0:
            total = real.add_product(total, real.constant(float(weight)), value)
    return total


def _gap(real: RealArithmetic, before: list[Any], last: list[Any], weights: list[Any]) -> Any:
    """Largest first term left out of the dense output, over the tolerance; see `kernels.rodas5p`."""
    builder = real.builder
    gaps = []
    for b, a, weight in zip(before, last, weights):
        smaller = builder.fmul(real.size(a), real.constant(LAST_TERM))
        larger = builder.fmul(real.size(b), real.constant(LAST_BUT_ONE))
        less = builder.fcmp_ordered("<", smaller, larger)
        term = builder.select(less, builder.fdiv(builder.fmul(smaller, smaller), larger), smaller)
        gaps.append(builder.fmul(term, weight))
    return real.largest(gaps)
