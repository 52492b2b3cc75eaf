"""Arithmetic on state vectors (n,) in intermediate code: a number for each state, or eight states side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir

from gsp.lowering.steps.arithmetic import intrinsic
from gsp.lowering.steps.values import DOUBLE, constant, lane, load, load_vector, spread, store, store_vector

# From so many states on they are worth gathering from where their rates leave them.
_FEWEST_SIDE_BY_SIDE = 8
_WIDTH = 8

Parts = list[Any]


class StateVectors:
    """Writes operations on vectors of n numbers, each a list of parts: numbers, or vectors of `_WIDTH` and the rest."""

    def __init__(self, builder: Any, n: int) -> None:
        self.builder = builder
        width = _WIDTH if n >= _FEWEST_SIDE_BY_SIDE else 1
        self._parts = [(start, min(width, n - start)) for start in range(0, n, width)]

    def array(self, size: int) -> ir.Value:
        """Scratch of `size` doubles."""
        array = self.builder.alloca(ir.ArrayType(DOUBLE, size))
        return self.builder.bitcast(array, DOUBLE.as_pointer())

    def load(self, array: ir.Value, start: int = 0) -> Parts:
        """The vector at `array[start]`."""
        return [
            load(self.builder, array, start + i)
            if width == 1
            else load_vector(self.builder, array, start + i, width)
            for i, width in self._parts
        ]

    def store(self, vector: Parts, array: ir.Value, start: int = 0) -> None:
        """The vector into `array[start]` and on."""
        for value, (i, width) in zip(vector, self._parts):
            (store if width == 1 else store_vector)(self.builder, value, array, start + i)

    def alike(self, value: float | ir.Value, part: Any) -> Any:
        """One number as a part like `part`."""
        one = constant(value) if isinstance(value, float) else value
        return spread(self.builder, one, part.type.count) if isinstance(part.type, ir.VectorType) else one

    def add(self, a: Parts, b: Parts) -> Parts:
        """a + b."""
        return [self.builder.fadd(x, y) for x, y in zip(a, b)]

    def multiply(self, a: Parts, b: Parts) -> Parts:
        """a b, entry by entry."""
        return [self.builder.fmul(x, y) for x, y in zip(a, b)]

    def add_multiple(self, a: Parts, factor: float | ir.Value, b: Parts) -> Parts:
        """a + factor b."""
        return [intrinsic(self.builder, "fmuladd", self.alike(factor, y), y, x) for x, y in zip(a, b)]

    def combination(self, weights: np.ndarray, vectors: Sequence[Parts], start: Parts | None = None) -> Parts:
        """start + sum of weight vector, in the order given."""
        total = start
        for weight, vector in zip(map(float, weights), vectors):
            if weight == 0.0:
                continue
            if total is None:
                total = [self.builder.fmul(self.alike(weight, part), part) for part in vector]
            else:
                total = self.add_multiple(total, weight, vector)
        assert total is not None
        return total

    def size(self, a: Parts) -> Parts:
        """|a|, entry by entry."""
        return [intrinsic(self.builder, "fabs", part) for part in a]

    def weights(self, a: Parts, b: Parts, rtol: ir.Value, atol: ir.Value) -> Parts:
        """1/(atol + rtol max(|a|, |b|))."""
        builder, result = self.builder, []
        for x, y in zip(self.size(a), self.size(b)):
            larger = builder.select(builder.fcmp_ordered(">", x, y), x, y)
            scale = intrinsic(builder, "fmuladd", self.alike(rtol, x), larger, self.alike(atol, x))
            result.append(builder.fdiv(self.alike(1.0, x), scale))
        return result

    def sum(self, a: Parts) -> Any:
        """The sum of all entries."""
        numbers = self._numbers(a)
        total = numbers[0]
        for number in numbers[1:]:
            total = self.builder.fadd(total, number)
        return total

    def largest(self, a: Parts) -> Any:
        """The largest entry; one that is no number may be passed over."""
        numbers = self._numbers(a)
        result = numbers[0]
        for number in numbers[1:]:
            result = self.builder.select(self.builder.fcmp_ordered(">", number, result), number, result)
        return result

    def _numbers(self, a: Parts) -> list[Any]:
        numbers = []
        for part in a:
            if isinstance(part.type, ir.VectorType):
                numbers += [self.builder.extract_element(part, lane(i)) for i in range(part.type.count)]
            else:
                numbers.append(part)
        return numbers
