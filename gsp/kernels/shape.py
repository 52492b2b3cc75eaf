"""How many stages and states a kernel has: read from its arrays, or fixed in its machine code."""

from __future__ import annotations

from typing import Any

from numba import types
from numba.extending import overload


def shape_of(dense, shape) -> Any:
    """What `sizes` takes: the tuples of `shape`, or for `None` two numbers from the record's array `dense`."""
    raise NotImplementedError("for compiled code only")


def sizes(shape) -> tuple[int, int]:
    """(rows, n) of one step's dense output, from what `shape_of` gave.

    Two tuples of these lengths carry them in their type: they are constants to the compiler, which unrolls the
    loops over them. From two numbers one machine code serves all.
    """
    raise NotImplementedError("for compiled code only")


@overload(shape_of)
def _shape_of(dense, shape):
    if isinstance(shape, types.BaseTuple):
        return lambda dense, shape: shape
    return lambda dense, shape: (dense.shape[1], dense.shape[2])


@overload(sizes)
def _sizes(shape):
    first: Any = shape.types[0]
    if isinstance(first, types.BaseTuple):
        return lambda shape: (len(shape[0]), len(shape[1]))
    return lambda shape: shape
