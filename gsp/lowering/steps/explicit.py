"""A whole step of DOP853 as straight-line code for so many states: twelve stages, no loop.

The field is called by its address, so that one code serves all flows of a size: written into the code it would save a
twentieth of a step, and cost every flow 20 ms. Two functions with the signature of `emission`:

    step       t = h, z = [y (n), z' (n), rtol, atol, address]; out = the record of a step, below
    between    t = h, z = that record; out = the rows of the dense output (6, n), which takes three more stages

A record is [y and z' at the step's end (n, n), the error over the tolerance, (h times a Lipschitz quotient there)^2,
address, y (n), the rates of the stages (12, n)]. The error is infinite where the end is not finite. The address is that
of the field, bit by bit. Loops for any number of states, in `kernels.dop853_loops`, do the same.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from gsp.kernels.dop853_tableau import DENSE, ERROR_3, ERROR_5, EXTENDED_STAGES, STAGES, A
from gsp.lowering.steps.arithmetic import intrinsic
from gsp.lowering.steps.state_vectors import Parts, StateVectors
from gsp.lowering.steps.values import SIGNATURE, begin, constant, load, store

# More states take loops: what a step does beside the field then costs no more than the field.
MOST_STATES = 12

NAMES = ("step", "between")


def write_explicit(n: int) -> str:
    """The module's text."""
    module = ir.Module()
    _write_step(module, n)
    _write_between(module, n)
    return str(module)


class _Stages:
    """Writes stages of the method from `y` on, whose rates `k` are known so far; `field` is an address as a double."""

    def __init__(self, builder: Any, n: int, field: ir.Value, h: ir.Value, p: ir.Value) -> None:
        self.vectors = StateVectors(builder, n)
        number = builder.bitcast(field, ir.IntType(64))
        self._builder, self._field = builder, builder.inttoptr(number, SIGNATURE.as_pointer())
        self._h, self._p = h, p
        self._argument, self._value = self.vectors.array(n), self.vectors.array(n)

    def argument(self, s: int, y: Parts, k: list[Parts]) -> Parts:
        """Where stage `s` asks for the rates."""
        return self.vectors.add_multiple(y, self._h, self.vectors.combination(A[s, :s], k))

    def rate(self, argument: Parts) -> Parts:
        """The rates there."""
        self.vectors.store(argument, self._argument)
        self._builder.call(self._field, [constant(0.0), self._argument, self._p, self._value])
        return self.vectors.load(self._value)


def _write_step(module: ir.Module, n: int) -> None:
    builder, (h, block, p, out) = begin(module, "step")
    field = load(builder, block, 2 * n + 2)
    stages = _Stages(builder, n, field, h, p)
    vectors = stages.vectors
    y = last = vectors.load(block)
    k = [vectors.load(block, n)]
    for s in range(1, STAGES):
        last = stages.argument(s, y, k)
        k.append(stages.rate(last))
    # Row 13 of the tableau is the solution itself.
    y_new = stages.argument(STAGES, y, k)
    rate = stages.rate(y_new)

    weights = vectors.weights(y, y_new, load(builder, block, 2 * n), load(builder, block, 2 * n + 1))
    fifth, third = (
        _norm(vectors, vectors.multiply(vectors.combination(e, k), weights)) for e in (ERROR_5, ERROR_3)
    )
    together = intrinsic(builder, "fmuladd", third, constant(0.01), fifth)
    root = intrinsic(builder, "sqrt", builder.fmul(together, constant(float(n))))
    quotient = builder.fdiv(builder.fmul(intrinsic(builder, "fabs", h), fifth), root)
    zero = constant(0.0)
    error = builder.select(builder.fcmp_ordered("==", together, zero), zero, quotient)
    # What is not finite leaves a difference with itself that is no number.
    spoilt = vectors.sum([builder.fsub(part, part) for part in (*y_new, *rate)])
    error = builder.select(builder.fcmp_ordered("==", spoilt, zero), error, constant(float("inf")))
    rise, run = (_norm(vectors, vectors.add_multiple(a, -1.0, b)) for a, b in ((rate, k[-1]), (y_new, last)))
    stretch = builder.fdiv(builder.fmul(builder.fmul(h, h), rise), run)
    stretch = builder.select(builder.fcmp_ordered(">", run, zero), stretch, zero)
    for i, vector in enumerate((y_new, rate)):
        vectors.store(vector, out, i * n)
    store(builder, error, out, 2 * n)
    store(builder, stretch, out, 2 * n + 1)
    store(builder, field, out, 2 * n + 2)
    for i, vector in enumerate((y, *k)):
        vectors.store(vector, out, (2 + i) * n + 3)
    builder.ret_void()


def _norm(vectors: StateVectors, a: Parts) -> Any:
    """The sum of squares."""
    return vectors.sum(vectors.multiply(a, a))


def _write_between(module: ir.Module, n: int) -> None:
    builder, (h, record, p, out) = begin(module, "between")
    stages = _Stages(builder, n, load(builder, record, 2 * n + 2), h, p)
    vectors = stages.vectors
    y_new, rate = vectors.load(record), vectors.load(record, n)
    y, *k = (vectors.load(record, (2 + i) * n + 3) for i in range(1 + STAGES))
    first = k[0]
    k.append(rate)
    for s in range(STAGES + 1, EXTENDED_STAGES):
        k.append(stages.rate(stages.argument(s, y, k)))
    rise = vectors.add_multiple(y_new, -1.0, y)
    both = vectors.add(rate, first)
    # In the nesting of `interpolate_many`; section II.6.
    rows = [
        vectors.add_multiple(_times(vectors, h, first), -1.0, rise),
        vectors.add_multiple(_times(vectors, 2.0, rise), -1.0, _times(vectors, h, both)),
        *(_times(vectors, h, vectors.combination(row, k)) for row in DENSE),
    ]
    for i, row in enumerate(rows):
        vectors.store(row, out, i * n)
    builder.ret_void()


def _times(vectors: StateVectors, factor: float | ir.Value, a: Parts) -> Parts:
    return [vectors.builder.fmul(vectors.alike(factor, part), part) for part in a]
