"""A step of Radau IIA as straight-line code for one flow: its stages, and its linear systems, side by side in lanes.

The rises Z of all stages of one state are one vector; the transformed systems (lambda/h - J) x = b, one of them real,
are the lanes of one complex system. Functions with the signature of `emission`, on the block of `kernels.radau_block`:

    begin     t = h, z = the driver's memory: decomposes, and guesses Z from the last step's polynomial
    round     t = h: one round of simplified Newton iteration; leaves the correction's norm
    finish    t = h: the step's end, its rate, both errors and the dense output
    again     t = h: after `finish`, the same with the estimate (8.20) for a start off the slow manifold
    accept    t = h, z = the driver's memory: the end becomes the point, and the memory's polynomial the new one

See `kernels.radau`, which decides what is done with them and whose loops do the same for any flow. Systems are scaled
to (1 - h J/lambda) x = h b/lambda, which takes no product in a round.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from llvmlite import ir

from gsp.kernels import radau_block
from gsp.kernels.radau_tableau import (
    DEFECT,
    DENSE,
    EIGENVALUES,
    LARGEST_FACTORS,
    LINEARISED,
    NODES,
    T_INVERSE,
    A,
    T,
)
from gsp.lowering.steps.arithmetic import ComplexArithmetic, RealArithmetic, intrinsic
from gsp.lowering.steps.emission import Emitter
from gsp.lowering.steps.flow_code import FlowCode
from gsp.lowering.steps.straight_line import factorise, solve
from gsp.lowering.steps.values import (
    DOUBLE,
    SIGNATURE,
    constants,
    lane,
    load,
    load_vector,
    shuffled,
    spread,
    store,
    store_vector,
)


@dataclass(frozen=True)
class CollocationCode:
    """The code for one flow and one number of stages."""

    flow: FlowCode
    stages: int

    NAMES: ClassVar = ("begin", "round", "finish", "again", "accept")

    @property
    def family(self) -> int:
        """Index into the tableau."""
        return (self.stages - 5) // 2

    @property
    def width(self) -> int:
        """Lanes of a vector of stages; those beyond the last stage hold 0."""
        return radau_block.width_of.py_func(self.stages)

    @property
    def systems(self) -> int:
        """Lanes of the complex system: the real one, the pairs, and what fills up half a vector of stages."""
        return self.width // 2

    @cached_property
    def components(self) -> list[int]:
        """Which transformed component is in which lane, real parts before imaginary ones; -1 where there is none."""
        real = [0, *range(1, self.stages, 2)]
        imaginary = [-1, *range(2, self.stages, 2)]
        fill = [-1] * (self.systems - len(real))
        return [*real, *fill, *imaginary, *fill]

    @property
    def lines(self) -> int:
        """Where the dense output begins in the block, rows of `width`."""
        return radau_block.lines_of.py_func(len(self.flow.states))

    @property
    def rises(self) -> int:
        """Where the rises begin in the block, rows of `width`."""
        return self.lines + len(self.flow.states) * self.width

    @property
    def factors(self) -> int:
        """Where the factors begin in the block: for each place `width` numbers, real parts first."""
        return self.rises + len(self.flow.states) * self.width

    @property
    def size(self) -> int:
        """Doubles of the block."""
        return self.factors + len(self.flow.elimination.places) * self.width

    def text(self) -> str:
        """The module."""
        module = ir.Module()
        for name in self.NAMES:
            function = ir.Function(module, SIGNATURE, name)
            builder: Any = ir.IRBuilder(function.append_basic_block())
            getattr(_Writer(self, builder, function.args), name)()
            builder.ret_void()
        return str(module)


class _Writer:
    """One function of the module; each method writes one."""

    def __init__(self, code: CollocationCode, builder: Any, arguments: Sequence[Any]) -> None:
        self.code = code
        self.flow = code.flow
        self.builder = builder
        self.h, self.memory, p, self.block = arguments
        self.n = len(self.flow.states)
        self.real = RealArithmetic(builder)
        self.lanes = ComplexArithmetic(builder, code.systems)
        self.constants = self.flow.constants(builder, p)

    # Access to the block

    def number(self, i: int) -> Any:
        """Entry i."""
        return load(self.builder, self.block, i)

    def keep(self, value: Any, i: int) -> None:
        """Make `value` entry i."""
        store(self.builder, value, self.block, i)

    def row(self, k: int) -> list[Any]:
        """The n numbers of row k."""
        return [self.number(radau_block.POINT + k * self.n + i) for i in range(self.n)]

    def keep_row(self, values: Iterable[Any], k: int) -> None:
        """Make `values` (n,) row k."""
        for i, value in enumerate(values):
            self.keep(value, radau_block.POINT + k * self.n + i)

    def vector(self, i: int, width: int) -> Any:
        """The vector that begins at entry i."""
        return load_vector(self.builder, self.block, i, width)

    def keep_vector(self, value: Any, i: int) -> None:
        """Store the vector `value` from entry i on."""
        store_vector(self.builder, value, self.block, i)

    def rises(self) -> list[Any]:
        """Z, a vector for each state."""
        width = self.code.width
        return [self.vector(self.code.rises + i * width, width) for i in range(self.n)]

    def keep_rises(self, rises: list[Any]) -> None:
        """Store Z."""
        for i, rise in enumerate(rises):
            self.keep_vector(rise, self.code.rises + i * self.code.width)

    # Vectors

    def column(self, values: Iterable[float]) -> Any:
        """A constant vector of stages, filled up with zeros."""
        given = [float(value) for value in values]
        return _constant([*given, *[0.0] * (self.code.width - len(given))])

    def lane(self, vector: Any, k: int) -> Any:
        """Number k of `vector`."""
        return self.builder.extract_element(vector, lane(k))

    def shuffled(self, a: Any, b: Any, lanes: Sequence[int]) -> Any:
        """Those numbers of `a`, then `b`."""
        return shuffled(self.builder, a, b, lanes)

    def sum(self, factors: Sequence[Any], values: Sequence[Any]) -> Any:
        """Sum of the products, in two chains: only half as many are waited for."""
        chains: list[Any] = [None, None]
        for k, (a, b) in enumerate(zip(factors, values)):
            chains[k % 2] = self.real.add_product(chains[k % 2], a, b)
        return chains[0] if chains[1] is None else self.builder.fadd(*chains)

    def product(self, columns: Sequence[Any], lanes: Sequence[int], vector: Any) -> Any:
        """The matrix of these constant `columns` times those `lanes` of `vector`."""
        width = self.code.width
        return self.sum(columns, [self.shuffled(vector, vector, [k] * width) for k in lanes])

    def total(self, vector: Any) -> Any:
        """Sum over the lanes."""
        width = vector.type.count
        while width > 1:
            width //= 2
            low = self.shuffled(vector, vector, range(width))
            high = self.shuffled(vector, vector, range(width, 2 * width))
            vector = self.builder.fadd(low, high)
        return self.lane(vector, 0)

    def norm(self, squares: Any, count: int) -> Any:
        """The root of the mean of `count` squares that sum up to `squares`."""
        return intrinsic(self.builder, "sqrt", self.builder.fmul(squares, self.real.constant(1.0 / count)))

    def tolerances(self) -> tuple[Any, Any]:
        """rtol and atol."""
        return self.number(radau_block.RTOL), self.number(radau_block.ATOL)

    # The functions

    def begin(self) -> None:
        """Factors, weights, first guess."""
        code, builder = self.code, self.builder
        y = self.row(0)
        rises = self.guess()
        self.keep_rises(rises)
        stage = int(LINEARISED[code.family])
        near = [builder.fadd(a, self.lane(rise, stage)) for a, rise in zip(y, rises)]
        emitter = Emitter(builder, dict(zip(self.flow.states, near)), constants=self.constants)
        entries = dict(zip(self.flow.jacobian, emitter.write(tuple(self.flow.jacobian.values()))))
        inverse = 1.0 / EIGENVALUES[code.family, : 1 + code.stages // 2]
        # Lanes that fill up repeat the real system.
        inverse = np.append(inverse, [inverse[0]] * (code.systems - inverse.size))
        minus = builder.fneg(self.h)
        matrix = {}
        for (i, j), entry in entries.items():
            scaled = spread(builder, builder.fmul(entry, minus), code.systems)
            matrix[i, j] = tuple(builder.fmul(scaled, _constant(part)) for part in (inverse.real, inverse.imag))
        one, zero = _constant([1.0] * code.systems), _constant([0.0] * code.systems)
        for i in range(self.n):
            a, b = matrix.get((i, i), (None, zero))
            matrix[i, i] = (one if a is None else builder.fadd(a, one)), b
        factors, usable = factorise(self.lanes, matrix, self.flow.elimination)
        for k, (i, j) in enumerate(code.flow.elimination.places):
            for part, value in enumerate(factors[i, j]):
                self.keep_vector(value, code.factors + k * code.width + part * code.systems)
        # In lanes, so that all must be 1.
        bits = ir.IntType(code.systems)
        every = builder.icmp_unsigned("==", builder.bitcast(usable, bits), ir.Constant(bits, -1))
        self.keep(builder.uitofp(every, DOUBLE), radau_block.USABLE)
        rtol, atol = self.tolerances()
        weights = [self.real.reciprocal(self.real.add_product(atol, rtol, self.real.size(a))) for a in y]
        self.keep_row(weights, radau_block.WEIGHT)

    def guess(self) -> list[Any]:
        """The last step's dense output, continued; 0 where there is none."""
        code, builder = self.code, self.builder
        length = load(builder, self.memory, radau_block.LENGTH)
        none = builder.fcmp_ordered("==", length, self.real.constant(0.0))
        ratio = builder.select(none, self.real.constant(0.0), builder.fdiv(self.h, length))
        nodes = self.column(NODES[code.family, : code.stages])
        beyond = builder.fmul(nodes, spread(builder, ratio, code.width))
        s, r = builder.fadd(beyond, spread(builder, self.real.constant(1.0), code.width)), builder.fneg(beyond)
        basis = [builder.fmul(s, r)]
        for k in range(code.stages - 1):
            basis.append(builder.fmul(basis[-1], r if k % 2 else s))
        result = []
        for i in range(self.n):
            line = radau_block.LINES + i * code.width
            rows = [load(builder, self.memory, line + k) for k in range(code.stages + 1)]
            values = [spread(builder, value, code.width) for value in rows]
            result.append(self.sum([beyond, *basis], [values[-1], *values[:-1]]))
        return result

    def round(self) -> None:
        """Z + dZ for the residual h A F - Z of the collocation equations."""
        code, builder, stages = self.code, self.builder, self.code.stages
        y, rises, weights = self.row(0), self.rises(), self.row(radau_block.WEIGHT)
        points = [builder.fadd(spread(builder, a, code.width), z) for a, z in zip(y, rises)]
        rates = self.flow.field(builder, points, self.constants, width=code.width, used=stages)
        rates = [f if isinstance(f.type, ir.VectorType) else spread(builder, f, code.width) for f in rates]
        h = spread(builder, self.h, code.width)
        a, forth, back = (matrix[code.family, :stages, :stages] for matrix in (A, T_INVERSE, T))
        a = [self.column(a[:, k]) for k in range(stages)]
        forth = [self.column(forth[q, k] if q >= 0 else 0.0 for q in code.components) for k in range(stages)]
        lanes = [k for k, q in enumerate(code.components) if q >= 0]
        back = [self.column(back[:, code.components[k]]) for k in lanes]
        half = code.systems
        right = []
        for f, z in zip(rates, rises):
            # In this form, not multiplied by A^-1, the rises become exact to rounding.
            residual = builder.fsub(builder.fmul(h, self.product(a, range(stages), f)), z)
            transformed = self.product(forth, range(stages), residual)
            right.append(
                (
                    self.shuffled(transformed, transformed, range(half)),
                    self.shuffled(transformed, transformed, range(half, 2 * half)),
                )
            )
        factors = {
            place: tuple(self.vector(code.factors + k * code.width + part * half, half) for part in range(2))
            for k, place in enumerate(code.flow.elimination.places)
        }
        solution = solve(self.lanes, factors, self.flow.elimination, right)
        corrections = [self.shuffled(a, b, range(2 * half)) for a, b in solution]
        weighted = [builder.fmul(x, spread(builder, w, code.width)) for x, w in zip(corrections, weights)]
        squares = self.total(self.sum(weighted, weighted))
        self.keep(self.norm(squares, self.n * stages), radau_block.NORM)
        self.keep_rises([builder.fadd(z, self.product(back, lanes, x)) for z, x in zip(rises, corrections)])

    def finish(self) -> None:
        """(8.19): e = (gamma/h - J)^-1 (f0 - u'(0)) with the collocation polynomial u."""
        y, rises = self.row(0), self.rises()
        coefficients = self.coefficients(rises)
        ends = [self.lane(rise, self.code.stages - 1) for rise in rises]
        new = [self.builder.fadd(a, end) for a, end in zip(y, ends)]
        self.keep_row(new, radau_block.END)
        self.keep_row(self.flow.field(self.builder, new, self.constants), radau_block.END + 1)
        self.estimate(self.row(1), y, new, ends, coefficients)

    def again(self) -> None:
        """(8.20): the rate at the point in (8.19) is that at the point + e."""
        y = self.row(0)
        moved = [self.builder.fadd(a, e) for a, e in zip(y, self.row(radau_block.ESTIMATE))]
        rates = self.flow.field(self.builder, moved, self.constants)
        rises = self.rises()
        ends = [self.lane(rise, self.code.stages - 1) for rise in rises]
        self.estimate(rates, y, self.row(radau_block.END), ends, self.coefficients(rises))

    def accept(self) -> None:
        """Move the end to the point, and the lines to the memory."""
        width = self.code.width
        for k in range(2):
            self.keep_row(self.row(radau_block.END + k), k)
        for i in range(self.n):
            line = self.vector(self.code.lines + i * width, width)
            store_vector(self.builder, line, self.memory, radau_block.LINES + i * width)
        store(self.builder, self.h, self.memory, radau_block.LENGTH)

    def coefficients(self, rises: list[Any]) -> list[Any]:
        """The collocation polynomial's coefficients, a vector for each state."""
        stages = range(self.code.stages)
        columns = [self.column(DENSE[self.code.family, : self.code.stages, k]) for k in stages]
        return [self.product(columns, stages, rise) for rise in rises]

    def estimate(
        self, rates: list[Any], y: list[Any], new: list[Any], ends: list[Any], coefficients: list[Any]
    ) -> None:
        """The errors, and the dense output: the collocation polynomial and its leading error, filtered likewise."""
        code, builder, real = self.code, self.builder, self.real
        inverse = real.constant(1.0 / EIGENVALUES[code.family, 0].real)
        right = []
        for f, end, c in zip(rates, ends, coefficients):
            slope = builder.fadd(end, self.lane(c, 0))
            right.append(builder.fmul(inverse, builder.fsub(builder.fmul(self.h, f), slope)))
        # The real system's numbers are the first of each vector.
        factors = {
            place: self.number(code.factors + k * code.width)
            for k, place in enumerate(code.flow.elimination.places)
        }
        errors = solve(real, factors, self.flow.elimination, right)
        self.keep_row(errors, radau_block.ESTIMATE)
        rtol, atol = self.tolerances()
        # What is not finite leaves a difference with itself that is no number.
        total: Any = real.constant(0.0)
        for value in (*new, *self.row(radau_block.END + 1)):
            total = builder.fadd(total, builder.fsub(value, value))
        gaps = []
        largest = [real.constant(float(factor)) for factor in LARGEST_FACTORS[code.family]]
        for a, b, e, c in zip(y, new, errors, coefficients):
            larger = real.largest([real.size(a), real.size(b)])
            weight = real.reciprocal(real.add_product(atol, rtol, larger))
            ratio = builder.fmul(e, weight)
            total = real.add_product(total, ratio, ratio)
            term = self.left_out([
                builder.fmul(factor, self.lane(c, code.stages - 5 + k)) for k, factor in enumerate(largest)
            ])  # fmt: skip
            gaps.append(builder.fmul(term, weight))
        self.keep(self.norm(total, self.n), radau_block.ERROR)
        self.keep(real.largest(gaps), radau_block.GAP)
        leading = self.column(EIGENVALUES[code.family, 0].real * DEFECT[code.family, : code.stages])
        last = self.code.stages
        for i, (c, e, end) in enumerate(zip(coefficients, errors, ends)):
            line = real.add_product(c, leading, spread(builder, e, code.width))
            line = builder.insert_element(line, end, lane(last))
            self.keep_vector(line, code.lines + i * code.width)

    def left_out(self, terms: list[Any]) -> Any:
        """What the polynomial's last four terms foretell of the first one left out; as in `radau_loops`."""
        builder, real = self.builder, self.real
        sizes = [real.size(term) for term in terms]
        before, last = real.largest(sizes[:2]), real.largest(sizes[2:])
        falls = builder.fcmp_ordered("<", last, before)
        in_pairs = builder.select(falls, builder.fmul(last, builder.fdiv(last, before)), last)
        size = real.largest([before, last])
        unit = real.reciprocal(size)
        first, second, third, fourth = (builder.fmul(term, unit) for term in terms)
        envelope = real.size(real.subtract_product(builder.fmul(third, third), second, fourth))
        bound = real.size(real.subtract_product(builder.fmul(second, second), first, third))
        ahead = builder.fmul(envelope, intrinsic(builder, "sqrt", envelope))
        falls = builder.fcmp_ordered("<", builder.fmul(ahead, size), builder.fmul(bound, last))
        in_envelope = builder.select(falls, builder.fmul(size, builder.fdiv(ahead, bound)), last)
        return real.largest([in_pairs, in_envelope])


def _constant(values: Iterable[float]) -> Any:
    return constants(*map(float, values))
