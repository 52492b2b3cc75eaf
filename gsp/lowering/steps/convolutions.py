"""The inner sums of products of Taylor coefficients, several instructions' side by side in the lanes of vectors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from gsp.kernels import jets
from gsp.lowering.instructions import Instructions
from gsp.lowering.steps.arithmetic import RealArithmetic
from gsp.lowering.steps.values import constant, constants, lane

# Lanes of a vector.
WIDTH = 4


@dataclass(frozen=True)
class Convolution:
    """An inner sum: coefficients 1 to k - 1 of instruction `a`, times j if `weighted`, and k - 1 to 1 of `b`."""

    row: int
    a: int
    b: int
    weighted: bool


def convolutions(instructions: Instructions) -> list[Convolution]:
    """Those of all instructions that have one, squares last."""
    found = []
    for row, (operation, a, b, _) in enumerate(instructions.rows):
        if operation == jets.MULTIPLY:
            found.append(Convolution(row, a, b, False))
        elif operation == jets.DIVIDE:
            found.append(Convolution(row, b, row, False))
        elif operation == jets.QUOTIENT:
            found.append(Convolution(row, a, row, False))
        elif operation >= jets.CHAIN:
            found.append(Convolution(row, a, b, True))
    return sorted(found, key=lambda one: one.a == one.b)


class Bundle:
    """Convolutions side by side, in the lanes of vectors; or a single one, in doubles."""

    def __init__(self, members: Sequence[Convolution]) -> None:
        self.members = members
        self.squares = all(one.a == one.b and not one.weighted for one in members)
        self._a: list[Any] = [None]
        self._b: list[Any] = [None]

    def extend(self, builder: Any, coefficients: Sequence[Sequence[Any]], k: int) -> None:
        """Take up the coefficients of order k."""
        a = [coefficients[one.a][k] for one in self.members]
        for i, one in enumerate(self.members):
            if one.weighted and k > 1:
                a[i] = builder.fmul(a[i], constant(float(k)))
        self._a.append(vector(builder, a))
        b = self._a[-1] if self.squares else vector(builder, [coefficients[one.b][k] for one in self.members])
        self._b.append(b)

    def inner_sums(self, builder: Any, k: int) -> list[Any]:
        """The inner sum of order k of each member."""
        real = RealArithmetic(builder)
        total: Any = None
        if self.squares:
            # From the middle outwards: what was found last is waited for.
            for j in range((k - 1) // 2, 0, -1):
                total = real.add_product(total, self._a[j], self._a[k - j])
            if total is not None:
                total = builder.fadd(total, total)
            if k % 2 == 0:
                total = real.add_product(total, self._a[k // 2], self._a[k // 2])
        else:
            for j in sorted(range(1, k), key=lambda j: -min(j, k - j)):
                total = real.add_product(total, self._a[j], self._b[k - j])
        if len(self.members) == 1:
            return [total]
        return [builder.extract_element(total, lane(i)) for i in range(len(self.members))]


def vector(builder: Any, values: Sequence[Any]) -> Any:
    """The values in the lanes of a vector of 2 or `WIDTH`, filled up with zeros; one value as it is."""
    if len(values) == 1:
        return values[0]
    width = 2 if len(values) == 2 else WIDTH
    result: Any = constants(*[0.0] * width)
    for i, value in enumerate(values):
        result = builder.insert_element(result, value, lane(i))
    return result
