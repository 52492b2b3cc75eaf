"""A whole step of Rodas5P as straight-line code for one flow: eight stages, one decomposition, no loop.

Two functions with the signature of `emission`, on a point's block [y (n), z' (n), entries of the Jacobian]:

    linearise    z = y (n,), out = the block
    step         t = h, z = the block, then rtol, atol and the share of the dense output's error that counts; out = the
                 block at the step's end, then [error over the tolerance, rows of the dense output (3, n)]

The error is infinite where the pivots cannot be used or something is not finite: then the loops of `kernels.rodas5p`,
which do the same for any flow, decide.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from gsp.kernels.rodas5p_tableau import DENSE, DENSE_ROWS, GAMMA, LAST_BUT_ONE, LAST_TERM, STAGES, A, C
from gsp.lowering.steps.arithmetic import RealArithmetic, intrinsic
from gsp.lowering.steps.flow_code import FlowCode
from gsp.lowering.steps.state_vectors import StateVectors
from gsp.lowering.steps.straight_line import factorise, solve
from gsp.lowering.steps.values import DOUBLE, address, begin, load, store

# With more operations than these in a field and a solution both are called once a stage; else they are written into it,
# and all is in registers: 75 ns a step of van der Pol's oscillator in place of 135. A ring of 100 neurons gains 5 %.
_MOST_INLINED = 120


def write_rosenbrock(flow: FlowCode) -> str:
    """The module's text."""
    module = ir.Module()
    inlined = flow.operations + 2 * len(flow.elimination.places) <= _MOST_INLINED
    linearise = _write_linearise(module, flow)
    parts = (_write_field(module, flow), _write_decompose(module, flow), _write_solve(module, flow))
    for function in parts:
        function.linkage = "internal"
        function.attributes.add("alwaysinline" if inlined else "noinline")
    _write_step(module, flow, linearise, *parts)
    return str(module)


def block_size(flow: FlowCode) -> int:
    """Doubles of a point's block."""
    return 2 * len(flow.states) + len(flow.jacobian)


def _write_linearise(module: ir.Module, flow: FlowCode) -> ir.Function:
    builder, (_, z, p, out) = begin(module, "linearise")
    y = [load(builder, z, i) for i in range(len(flow.states))]
    rates, entries = flow.linearisation(builder, y, flow.constants(builder, p))
    for i, value in enumerate((*y, *rates, *entries.values())):
        store(builder, value, out, i)
    builder.ret_void()
    return builder.function


def _write_field(module: ir.Module, flow: FlowCode) -> ir.Function:
    """out = the rates at z."""
    builder, (_, z, p, out) = begin(module, "field")
    y = [load(builder, z, i) for i in range(len(flow.states))]
    for i, rate in enumerate(flow.field(builder, y, flow.constants(builder, p))):
        store(builder, rate, out, i)
    builder.ret_void()
    return builder.function


def _write_decompose(module: ir.Module, flow: FlowCode) -> ir.Function:
    """out = factors of t - J for the entries z of J, then 1 if they can be used."""
    builder, (shift, z, _, out) = begin(module, "decompose")
    real = RealArithmetic(builder)
    entries = {place: real.negative(load(builder, z, i)) for i, place in enumerate(flow.jacobian)}
    for i in range(len(flow.states)):
        entries[i, i] = real.add(entries[i, i], shift) if (i, i) in entries else shift
    factors, usable = factorise(real, entries, flow.elimination)
    for i, place in enumerate(flow.elimination.places):
        store(builder, factors[place], out, i)
    store(builder, builder.uitofp(usable, DOUBLE), out, len(flow.elimination.places))
    builder.ret_void()
    return builder.function


def _write_solve(module: ir.Module, flow: FlowCode) -> ir.Function:
    """out = the solution for the right-hand side out, with the factors z."""
    builder, (_, z, _, out) = begin(module, "solve")
    factors = {place: load(builder, z, i) for i, place in enumerate(flow.elimination.places)}
    b = [load(builder, out, i) for i in range(len(flow.states))]
    for i, value in enumerate(solve(RealArithmetic(builder), factors, flow.elimination, b)):
        store(builder, value, out, i)
    builder.ret_void()
    return builder.function


def _write_step(
    module: ir.Module,
    flow: FlowCode,
    linearise: ir.Function,
    field: ir.Function,
    decompose: ir.Function,
    solve: ir.Function,
) -> None:
    builder, (h, block, p, out) = begin(module, "step")
    n, size = len(flow.states), block_size(flow)
    real = RealArithmetic(builder)
    vectors = StateVectors(builder, n)
    zero = real.constant(0.0)

    argument, value, end = (vectors.array(n) for _ in range(3))
    factors = vectors.array(len(flow.elimination.places) + 1)
    inverse = real.reciprocal(h)
    entries = address(builder, block, 2 * n)
    builder.call(decompose, [real.multiply(inverse, real.constant(1.0 / GAMMA)), entries, p, factors])

    def increment(right: list[Any]) -> list[Any]:
        vectors.store(right, value)
        builder.call(solve, [zero, factors, p, value])
        return vectors.load(value)

    y = here = vectors.load(block)
    k = [increment(vectors.load(block, n))]
    for s in range(1, STAGES):
        # Oldest increments first: only the last is waited for.
        here = vectors.combination(A[s, :s], k, y) if s < len(A) else vectors.add(here, k[-1])
        vectors.store(here, argument)
        pushes = vectors.combination(C[s, :s], k)
        builder.call(field, [zero, argument, p, value])
        k.append(increment(vectors.add_multiple(vectors.load(value), inverse, pushes)))
    y_new = vectors.add(here, k[-1])
    vectors.store(y_new, end)
    builder.call(linearise, [zero, end, p, out])

    rtol, atol, share = (load(builder, block, size + i) for i in range(3))
    weights = vectors.weights(y, y_new, rtol, atol)
    rows = [vectors.combination(DENSE[m], k) for m in range(DENSE_ROWS)]
    ratios = vectors.multiply(k[-1], weights)
    mean = real.multiply(vectors.sum(vectors.multiply(ratios, ratios)), real.constant(1.0 / n))
    gap = vectors.largest(vectors.multiply(_gap(vectors, rows[1], rows[2]), weights))
    error = real.largest([intrinsic(builder, "sqrt", mean), real.multiply(share, gap)])
    # What is not finite leaves a difference with itself that is no number.
    finite = vectors.sum([builder.fsub(part, part) for part in (*y_new, *vectors.load(out, n))])
    finite = builder.fcmp_ordered("==", real.add(finite, builder.fsub(error, error)), zero)
    usable = builder.fcmp_ordered(
        "==", load(builder, factors, len(flow.elimination.places)), real.constant(1.0)
    )
    store(builder, builder.select(builder.and_(finite, usable), error, real.constant(float("inf"))), out, size)
    for m, row in enumerate(rows):
        vectors.store(row, out, size + 1 + m * n)
    builder.ret_void()


def _gap(vectors: StateVectors, before: list[Any], last: list[Any]) -> list[Any]:
    """The first term left out of the dense output; see `kernels.rodas5p`."""
    builder = vectors.builder
    terms = []
    for b, a in zip(vectors.size(before), vectors.size(last)):
        smaller = builder.fmul(a, vectors.alike(LAST_TERM, a))
        larger = builder.fmul(b, vectors.alike(LAST_BUT_ONE, b))
        less = builder.fcmp_ordered("<", smaller, larger)
        terms.append(builder.select(less, builder.fmul(smaller, builder.fdiv(smaller, larger)), smaller))
    return terms
