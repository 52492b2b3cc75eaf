"""Values of LLVM's intermediate code: doubles, vectors of them, and where they are kept."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

from llvmlite import ir

DOUBLE = ir.DoubleType()
POINTER = DOUBLE.as_pointer()
_LANE = ir.IntType(32)
WHOLE = ir.IntType(64)
# That of every compiled function: void f(double t, double* z, double* p, double* out).
SIGNATURE = ir.FunctionType(ir.VoidType(), [DOUBLE, POINTER, POINTER, POINTER])


# Constants are written over and over again, and their text costs more than to keep them.
@lru_cache(maxsize=65536)
def constant(value: float) -> Any:
    """A double."""
    return ir.Constant(DOUBLE, value)


@lru_cache(maxsize=65536)
def constants(*values: float) -> Any:
    """Doubles side by side."""
    return ir.Constant(ir.VectorType(DOUBLE, len(values)), list(map(constant, values)))


@lru_cache(maxsize=1024)
def lane(k: int) -> Any:
    """The number of a lane."""
    return ir.Constant(_LANE, k)


def shuffled(builder: Any, a: Any, b: Any, lanes: Sequence[int]) -> Any:
    """Those lanes of `a`, then `b`."""
    return builder.shuffle_vector(a, b, _mask(tuple(lanes)))


@lru_cache(maxsize=4096)
def _mask(lanes: tuple[int, ...]) -> Any:
    return ir.Constant(ir.VectorType(_LANE, len(lanes)), list(lanes))


@lru_cache(maxsize=1024)
def _place(i: int) -> Any:
    return ir.Constant(WHOLE, i)


def address(builder: Any, array: ir.Value, i: int) -> Any:
    """The address of `array[i]`."""
    return builder.gep(array, [_place(i)])


def load(builder: Any, array: ir.Value, i: int) -> Any:
    """`array[i]`."""
    return builder.load(address(builder, array, i))


def store(builder: Any, value: Any, array: ir.Value, i: int) -> None:
    """`array[i] = value`."""
    builder.store(value, address(builder, array, i))


def fill(builder: Any, value: ir.Value, array: ir.Value, count: int) -> None:
    """`array[:count] = value` by a loop, `count` at least 1; the builder goes on behind it."""
    before = builder.block
    loop, behind = builder.append_basic_block(), builder.append_basic_block()
    builder.branch(loop)
    builder.position_at_end(loop)
    i = builder.phi(WHOLE)
    i.add_incoming(_place(0), before)
    builder.store(value, builder.gep(array, [i]))
    following = builder.add(i, _place(1))
    i.add_incoming(following, loop)
    builder.cbranch(builder.icmp_unsigned("<", following, _place(count)), loop, behind)
    builder.position_at_end(behind)


def load_vector(builder: Any, array: ir.Value, i: int, width: int) -> Any:
    """`array[i : i + width]`, at any multiple of a double's address."""
    start = builder.bitcast(address(builder, array, i), ir.VectorType(DOUBLE, width).as_pointer())
    return builder.load(start, align=8)


def store_vector(builder: Any, value: Any, array: ir.Value, i: int) -> None:
    """The vector `value` into `array[i]` and on."""
    builder.store(value, builder.bitcast(address(builder, array, i), value.type.as_pointer()), align=8)


def spread(builder: Any, value: Any, width: int) -> Any:
    """A vector of `width` copies of one number."""
    kind = ir.VectorType(value.type, width)
    if isinstance(value, ir.Constant):
        return (
            constants(*[value.constant] * width) if value.type == DOUBLE else ir.Constant(kind, [value] * width)
        )
    nothing = ir.Constant(kind, ir.Undefined)
    return shuffled(builder, builder.insert_element(nothing, value, lane(0)), nothing, [0] * width)
