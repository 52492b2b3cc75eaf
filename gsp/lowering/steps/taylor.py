"""Taylor series of a flow's solution through a point, as straight-line code for one flow and one order K.

Three functions with the signature of `emission`, in time scaled by a length `scale`, so that coefficient k is
scale^k z^(k)/k!:

    expand         t = scale, z = y (n,), then rtol and atol; out = the coefficients 0 to K, each `stride` doubles
    with
                   those of the n states in front, then `TAIL` doubles
    advance        t = h/scale, z = what `expand` made; out = y at the step's end, then y' there, `stride` doubles
    each,
                   then the mean square of the defect h (y' - the series' derivative) over the tolerance
    interpolate    t = h/scale, z = what `expand` made; out = rows of the dense output (dense_rows(K), n)

The tail is the mean squares of coefficients 1, K - 1 and K over the tolerance, then rtol, atol and the scale, at the
places that `kernels.taylor` names.

An instruction's coefficient k is a sum of products of earlier ones (Griewank and Walther 2008, section 13.2). All but
its first and last term hold no coefficient of order k, so that these inner sums are taken together for all
instructions, several to a vector, whatever depends on what.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from typing import Any, ClassVar

import sympy as sp
from llvmlite import ir

from gsp.algebra.functions import COMPOSED
from gsp.errors import GspError, UnsupportedFunctionError
from gsp.kernels import jets
from gsp.kernels.taylor import ATOL, FIRST, LAST, LAST_BUT_ONE, RTOL, SCALE
from gsp.lowering.instructions import Instructions, every_part, write_instructions
from gsp.lowering.steps.arithmetic import RealArithmetic
from gsp.lowering.steps.convolutions import WIDTH, Bundle, convolutions, vector
from gsp.lowering.steps.emission import Emitter
from gsp.lowering.steps.flow_code import FlowCode
from gsp.lowering.steps.values import (
    SIGNATURE,
    constant,
    lane,
    load,
    load_vector,
    spread,
    store,
    store_vector,
)

# Building takes 0.1 milliseconds for each, and more where there are many.
MOST_PRODUCTS = 100_000
# Sums that run side by side where one would wait for itself.
_SUMS = 4
_ZERO = constant(0.0)
# A multiple that is added to something is rounded once.
_FUSED = ("contract",)
_FUNCTIONS: dict[int, Any] = {
    getattr(jets, name.upper()): getattr(sp, name)
    for name in (
        *("exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh"),
        *("asin", "acos", "atan", "asinh", "acosh", "atanh", "erf"),
    )
}
_ARGUMENT, _POWER = sp.Dummy("u"), sp.Dummy("k")


def dense_rows(order: int) -> int:
    """Rows of the dense output: its basis converges faster than the series, by a factor of 2 a row."""
    return (2 * order + 2) // 3


def stride(states: int) -> int:
    """Doubles from a coefficient to the next: whole vectors, so that the code has no remainder."""
    width = lanes(states)
    return -(-states // width) * width


def lanes(states: int) -> int:
    """Lanes of a vector of states."""
    return WIDTH if states > 2 else 2


def has_parts(flow: FlowCode, *, at_most: int) -> bool:
    """Whether the rates have no more parts, counted as often as they occur: large ones are not looked through."""
    parts = chain.from_iterable(map(every_part, flow.rates))
    return next(islice(parts, at_most, None), None) is None


@dataclass(frozen=True)
class TaylorCode:
    """A flow and the instructions for its rates, from which a series of any order can be written.

    Raises `UnsupportedFunctionError` for a function that has no differential equation in `gsp.algebra.functions`, or
    jumps.
    """

    flow: FlowCode

    NAMES: ClassVar = ("expand", "advance", "interpolate")

    def __post_init__(self) -> None:
        states = set(self.flow.states)
        for state, rate in zip(self.flow.states, self.flow.rates):
            for part in every_part(rate):
                if type(part).__name__ in ("sign", *COMPOSED) and part.free_symbols & states:
                    raise UnsupportedFunctionError(
                        f"the rate of {state} has {part}, whose Taylor series does not go beyond its "
                        "switching set.",
                        "Use Method.DOP853.",
                    )
        try:
            _ = self.instructions
        except UnsupportedFunctionError as error:
            raise UnsupportedFunctionError(f"{error} Method.DOP853 needs no series.") from None

    @cached_property
    def instructions(self) -> Instructions:
        """The rates as instructions."""
        return write_instructions(self.flow.states, self.flow.rates)

    def products(self, order: int) -> int:
        """Products of one expansion, which are most of its code."""
        return len(convolutions(self.instructions)) * order * order // 2

    def write(self, order: int) -> str:
        """The module's text; raises `GspError` where it would take minutes to build."""
        products = self.products(order)
        if products > MOST_PRODUCTS:
            raise GspError(
                f"a Taylor series of order {order} has at most {MOST_PRODUCTS} products.",
                f"That of this flow has {products}. Use another method.",
                limit=MOST_PRODUCTS,
            )
        module = ir.Module()
        _write_expand(module, self.flow, self.instructions, order)
        _write_advance(module, self.flow, order)
        _write_interpolate(module, len(self.flow.states), order)
        return str(module)


def _write_expand(module: ir.Module, flow: FlowCode, instructions: Instructions, order: int) -> None:
    function = ir.Function(module, SIGNATURE, "expand")
    builder: Any = ir.IRBuilder(function.append_basic_block())
    scale, z, p, out = function.args
    n = len(flow.states)
    step = stride(n)
    known = flow.constants(builder, p)
    emitter = Emitter(builder, {}, constants=known)
    constants = emitter.write(instructions.constants)
    y = [load(builder, z, i) for i in range(n)]
    rtol, atol = load(builder, z, n), load(builder, z, n + 1)
    real = RealArithmetic(builder)
    weights = [real.reciprocal(real.add_product(atol, rtol, real.size(value))) for value in y]

    coefficients: list[list[Any]] = [[value] for value in y]
    coefficients += [[] for _ in instructions.rows[n:]]
    needed = convolutions(instructions)
    bundles = [Bundle(needed[i : i + WIDTH]) for i in range(0, len(needed), WIDTH)]
    inverses: dict[int, Any] = {}
    doubles: dict[int, Any] = {}
    for i in range(n):
        store(builder, y[i], out, i)
    for k in range(order):
        sums: dict[int, Any] = {}
        if k > 1:
            for bundle in bundles:
                sums |= zip((one.row for one in bundle.members), bundle.inner_sums(builder, k))
        for row in range(n, len(instructions.rows)):
            value = _coefficient(
                real, instructions.rows[row], coefficients, row, k, constants, sums.get(row), inverses, doubles
            )
            coefficients[row].append(value)
        if 0 < k < order - 1:
            for bundle in bundles:
                bundle.extend(builder, coefficients, k)
        factor = builder.fmul(scale, real.constant(1.0 / (k + 1)))
        for i, row in enumerate(instructions.outputs):
            coefficients[i].append(builder.fmul(coefficients[row][k], factor))
            store(builder, coefficients[i][-1], out, (k + 1) * step + i)
    for k in range(order + 1):
        for i in range(n, step):
            store(builder, _ZERO, out, k * step + i)
    tail = (order + 1) * step
    for place, k in ((FIRST, 1), (LAST_BUT_ONE, order - 1), (LAST, order)):
        squares = []
        for i in range(n):
            ratio = builder.fmul(coefficients[i][k], weights[i])
            squares.append(builder.fmul(ratio, ratio))
        store(builder, builder.fmul(_total(builder, squares), real.constant(1.0 / n)), out, tail + place)
    for place, value in ((RTOL, rtol), (ATOL, atol), (SCALE, scale)):
        store(builder, value, out, tail + place)
    builder.ret_void()


def _coefficient(
    real: RealArithmetic,
    instruction: tuple[int, int, int, int],
    v: Sequence[Sequence[Any]],
    row: int,
    k: int,
    constants: Sequence[Any],
    inner: Any,
    inverses: dict[int, Any],
    doubles: dict[int, Any],
) -> Any:
    """Coefficient k of one instruction, its first and last products added to the `inner` sum; see `kernels.jets`."""
    builder = real.builder
    operation, a, b, place = instruction
    if operation == jets.CONSTANT:
        return constants[place] if k == 0 else _ZERO
    if operation == jets.ADD:
        return builder.fadd(v[a][k], v[b][k], flags=_FUSED)
    if operation == jets.SUBTRACT:
        return builder.fsub(v[a][k], v[b][k], flags=_FUSED)
    if operation == jets.SHIFT:
        return builder.fadd(v[a][k], constants[place]) if k == 0 else v[a][k]
    if operation == jets.SCALE:
        factor = constants[place]
        negated = isinstance(factor, ir.Constant) and factor.constant == -1.0
        return builder.fneg(v[a][k]) if negated else builder.fmul(v[a][k], factor, flags=_FUSED)
    if operation == jets.MULTIPLY:
        if k == 0:
            return builder.fmul(v[a][0], v[b][0])
        if a == b:
            doubles.setdefault(a, builder.fadd(v[a][0], v[a][0]))
            return real.add_product(inner, doubles[a], v[a][k])
        return real.add_product(real.add_product(inner, v[a][0], v[b][k]), v[a][k], v[b][0])
    if operation in (jets.DIVIDE, jets.QUOTIENT):
        below = b if operation == jets.DIVIDE else a
        if k == 0:
            above = v[a][0] if operation == jets.DIVIDE else constants[place]
            inverses[below] = real.reciprocal(v[below][0])
            return builder.fdiv(above, v[below][0])
        total = real.add_product(inner, v[below][k], v[row][0])
        rest = builder.fsub(v[a][k], total) if operation == jets.DIVIDE else builder.fneg(total)
        return builder.fmul(rest, inverses[below])
    if k == 0:
        function = _ARGUMENT**_POWER if operation == jets.POWER else _FUNCTIONS[operation](_ARGUMENT)
        values = {_ARGUMENT: v[a][0]}
        if operation == jets.POWER:
            values[_POWER] = constants[place]
        return Emitter(builder, values).write([function])[0]
    if inner is None:
        return builder.fmul(v[a][k], v[b][0])
    return real.add_product(builder.fmul(inner, real.constant(1.0 / k)), v[a][k], v[b][0])


def _write_advance(module: ir.Module, flow: FlowCode, order: int) -> None:
    function = ir.Function(module, SIGNATURE, "advance")
    builder: Any = ir.IRBuilder(function.append_basic_block())
    share, z, p, out = function.args
    n = len(flow.states)
    width, length = lanes(n), stride(n)
    tail = (order + 1) * length
    real = RealArithmetic(builder, width)
    rtol, atol = (spread(builder, load(builder, z, tail + place), width) for place in (RTOL, ATOL))
    step = spread(builder, builder.fmul(share, load(builder, z, tail + SCALE)), width)
    powers = _powers(builder, share, width, order)
    slopes = [builder.fmul(power, real.constant(float(k))) for k, power in enumerate(powers)]
    found = []
    for place in range(0, length, width):
        c = [load_vector(builder, z, k * length + place, width) for k in range(order + 1)]
        end = _sum(real, c[0], c[1:], powers[1:])
        found.append((c[0], end, _sum(real, None, c[1:], slopes[1:])))
    y = [builder.extract_element(found[i // width][1], lane(i % width)) for i in range(n)]
    rates = flow.field(builder, y, flow.constants(builder, p)) + [_ZERO] * (length - n)
    squares: Any = None
    for i, (begin, end, slope) in enumerate(found):
        rate = vector(builder, rates[i * width : (i + 1) * width])
        weight = real.add_product(atol, rtol, real.largest([real.size(begin), real.size(end)]))
        defect = builder.fdiv(real.subtract_product(slope, step, rate), weight)
        squares = real.add_product(squares, defect, defect)
        # 0, or NaN where the end is not finite.
        squares = builder.fadd(squares, builder.fsub(end, end))
        store_vector(builder, end, out, i * width)
        store_vector(builder, rate, out, length + i * width)
    total = _total(builder, [builder.extract_element(squares, lane(i)) for i in range(width)])
    store(builder, builder.fmul(total, constant(1.0 / n)), out, 2 * length)
    builder.ret_void()


def _total(builder: Any, values: Sequence[Any]) -> Any:
    """The sum, by pairs: it waits for few of them."""
    while len(values) > 1:
        pairs = [builder.fadd(a, b) for a, b in zip(values[::2], values[1::2])]
        values = [*pairs, *values[len(values) & ~1 :]]
    return values[0]


def _sum(real: RealArithmetic, start: Any, values: Sequence[Any], factors: Sequence[Any]) -> Any:
    """`start` and all products, from the last, which are smallest, to the first; several sums at once."""
    parts: list[Any] = [None] * _SUMS
    for k in range(len(values) - 1, -1, -1):
        part = k * _SUMS // len(values)
        parts[part] = real.add_product(parts[part], values[k], factors[k])
    total = parts[-1]
    for part in (*parts[-2::-1], start):
        total = total if part is None else real.builder.fadd(total, part)
    return total


def _write_interpolate(module: ir.Module, n: int, order: int) -> None:
    """The series in the nesting of `interpolate_many`, cut after `dense_rows`.

    z - (1-s) z(0) - s z(1) = s (1-s) q, where coefficient i of q is minus the sum of the series' from i + 2 on. A row
    is q(0), and then q - q(0) is divided by s; or it is q(1), and then q - q(1) by 1 - s, which makes minus the sums
    of q's coefficients from i + 1 on.
    """
    function = ir.Function(module, SIGNATURE, "interpolate")
    builder: Any = ir.IRBuilder(function.append_basic_block())
    share, z, _, out = function.args
    width, length = lanes(n), stride(n)
    powers = _powers(builder, share, width, order)
    rows: list[list[Any]] = [[] for _ in range(dense_rows(order))]
    for place in range(0, length, width):
        q = [
            builder.fmul(load_vector(builder, z, k * length + place, width), powers[k])
            for k in range(1, order + 1)
        ]
        # Whether q stands for minus its values.
        negative = False
        for row in range(-1, len(rows)):
            if row % 2:
                for i in range(len(q) - 2, -1, -1):
                    q[i] = builder.fadd(q[i], q[i + 1])
            if row >= 0:
                rows[row].append(builder.fneg(q[0]) if negative else q[0])
            if row % 2:
                negative = not negative
            q = q[1:]
    for row, values in enumerate(rows):
        for i, value in enumerate(values):
            if row + 1 < len(rows) or (i + 1) * width <= n:
                # Beyond the row's end lies the next one, which is written next.
                store_vector(builder, value, out, row * n + i * width)
            else:
                for j in range(n - i * width):
                    store(builder, builder.extract_element(value, lane(j)), out, row * n + i * width + j)
    builder.ret_void()


def _powers(builder: Any, share: Any, width: int, order: int) -> list[Any]:
    """`share` to the powers 0 to `order`, in every lane; each from two of half its exponent."""
    powers = [RealArithmetic(builder, width).constant(1.0), spread(builder, share, width)]
    for k in range(2, order + 1):
        powers.append(builder.fmul(powers[k // 2], powers[k - k // 2]))
    return powers
