"""A flow as its expressions, to be written into the code of a step at whatever place it is evaluated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import sympy as sp
from llvmlite import ir

from gsp.algebra.differentiation import derivative
from gsp.algebra.functions import NON_SMOOTH
from gsp.lowering.steps.emission import Emitter
from gsp.lowering.steps.kernel_call import Call
from gsp.lowering.steps.straight_line import Elimination, eliminate
from gsp.lowering.steps.values import load

# Above this many operations of a decomposition compiling takes seconds. A full Jacobian of 9 states takes 500, a ring
# of 20 neurons 200.
_ALWAYS = 500
_MOST = 20_000
# With more states code takes longer to compile than any run that it speeds up.
_MOST_STATES = 40


@dataclass(frozen=True)
class FlowCode:
    """z' = `rates`(z), with p = (epsilon, *parameters) at run time."""

    states: tuple[sp.Symbol, ...]
    rates: tuple[sp.Expr, ...]
    epsilon: sp.Symbol | None
    parameters: tuple[sp.Symbol, ...]
    calls: tuple[Call, ...] = ()
    """What the rates hold the results of; such a flow has no Jacobian here."""

    @cached_property
    def jacobian(self) -> dict[tuple[int, int], sp.Expr]:
        """The derivatives d z'_i/d z_j that are not 0 throughout, row by row."""
        column = {state: j for j, state in enumerate(self.states)}
        return {
            (i, j): entry
            for i, rate in enumerate(self.rates)
            for j in sorted(column[symbol] for symbol in rate.free_symbols if symbol in column)
            if (entry := derivative(rate, self.states[j])) != 0
        }

    @cached_property
    def is_smooth(self) -> bool:
        """Whether no rate has a kink or a jump that is written as one."""
        return not any(rate.has(*NON_SMOOTH) for rate in self.rates)

    @cached_property
    def elimination(self) -> Elimination:
        """How shift - J is decomposed."""
        return eliminate(len(self.states), self.jacobian)

    def constants(self, builder: Any, p: ir.Value) -> dict[sp.Basic, Any]:
        """The values of epsilon and the parameters, loaded; what follows from them alone is kept with them."""
        found: dict[sp.Basic, Any] = {} if self.epsilon is None else {self.epsilon: load(builder, p, 0)}
        return found | {symbol: load(builder, p, 1 + i) for i, symbol in enumerate(self.parameters)}

    def field(
        self,
        builder: Any,
        z: Sequence[Any],
        constants: dict[sp.Basic, Any],
        *,
        width: int = 0,
        used: int | None = None,
    ) -> list[Any]:
        """The rates at `z` (n,); with a `width` at as many points at once, z being vectors, of which `used` count."""
        emitter = Emitter(builder, dict(zip(self.states, z)), constants=constants, width=width, used=used)
        return emitter.write(self.rates)


def is_worth_writing(flow: FlowCode) -> bool:
    """Whether code for this flow alone is better than loops for any."""
    n = len(flow.states)
    return n <= _MOST_STATES and flow.elimination.operations <= max(_ALWAYS, min(_MOST, _few_operations(n)))


def is_sparse(flow: FlowCode) -> bool:
    """Whether loops over the entries that are not 0 are better than dense ones, where no code is written."""
    return not is_worth_writing(flow) and flow.elimination.operations <= _few_operations(len(flow.states))


def _few_operations(n: int) -> float:
    # Between the two code pays when it does half of the dense operations, 2 n^3/3, or less.
    return n**3 / 3
