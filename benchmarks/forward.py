"""A problem as most peers want it: time s = |t - first| that grows from 0, and all values put in.

Flows are autonomous, so that nothing depends on `first`; where t falls, dz/ds is the negative of dz/dt.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.errors import DeclarationError
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.systems.flow import Flow

# Decimal digits that a double put into an expression keeps: enough to come out again as the same double.
_DIGITS = 25


@dataclass(frozen=True, eq=False)
class Forward:
    """`flow` with parameters p from `start` (n,) at `first`, wanted at the times of `grid` (m,)."""

    flow: Flow
    p: np.ndarray
    start: np.ndarray
    first: float
    grid: np.ndarray

    def __post_init__(self) -> None:
        steps = np.diff(np.concatenate([[self.first], self.grid]))
        if not ((steps > 0).all() or (steps < 0).all()) or not len(steps):
            raise DeclarationError(
                f"a grid leads away from the start, at t = {self.first:g}, without turning.",
                "Sort the times, and leave the start out.",
                got=self.grid,
            )

    @property
    def is_backward(self) -> bool:
        """Whether t falls."""
        return bool(self.grid[-1] < self.first)

    @cached_property
    def times(self) -> np.ndarray:
        """The grid in s, (m,)."""
        return np.abs(np.array(self.grid, dtype=float) - self.first)

    @cached_property
    def times_from_start(self) -> np.ndarray:
        """0 and the grid in s, (m + 1,)."""
        return np.concatenate([[0.0], self.times])

    @cached_property
    def rates(self) -> tuple[sp.Expr, ...]:
        """dz/ds in the states alone."""
        values = dict(zip(self.flow.parameters, self.p[1:]))
        if self.flow.epsilon is not None:
            values[self.flow.epsilon] = self.p[0]
        exact = {symbol: _number(float(value)) for symbol, value in values.items()}
        sign = -1 if self.is_backward else 1
        return tuple(sign * rate.xreplace(exact) for rate in self.flow.rates)

    @cached_property
    def field(self) -> CompiledFunction:
        """dz/ds in machine code, (n,)."""
        return self._compiled(self.flow.rates) if self.is_backward else compile_flow(self.flow).rates

    @cached_property
    def jacobian(self) -> CompiledFunction:
        """Its derivatives by the states, row by row, (n*n,)."""
        if not self.is_backward:
            return compile_flow(self.flow).derivatives
        return self._compiled([derivative(rate, z) for rate in self.flow.rates for z in self.flow.states])

    def _compiled(self, outputs: Any) -> CompiledFunction:
        return compile_function(
            [-output for output in outputs],
            arguments=self.flow.states,
            epsilon=self.flow.epsilon,
            parameters=tuple(self.flow.parameters),
            scheduled=True,
        )


def _number(value: float) -> sp.Expr:
    # Halves stay what they are, for the sake of powers.
    is_half = (2 * value).is_integer() and abs(value) < 1e9
    return sp.Rational(int(2 * value), 2) if is_half else sp.Float(value, _DIGITS)
