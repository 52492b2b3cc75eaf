"""Flows as machine code, by address: fields, Jacobians, and the programs of integrators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
import sympy as sp

from gsp.algebra.clocks import clocks
from gsp.algebra.sharing import holding
from gsp.errors import DeclarationError, UnsupportedFunctionError
from gsp.kernels import addresses
from gsp.kernels.compilation import address_of
from gsp.kernels.dop853 import dop853
from gsp.kernels.engine import Engine, build
from gsp.kernels.radau import radau
from gsp.kernels.radau_loops import attempt_by_loops
from gsp.lowering.compiled_clock import CompiledClock
from gsp.lowering.compiled_function import MAKING, MOST_KEPT, CompiledFunction, compile_function, exact
from gsp.lowering.remembering import remembered
from gsp.lowering.steps.collocation import CollocationCode
from gsp.lowering.steps.emission import LIBRARY, nearest_double
from gsp.lowering.steps.flow_code import FlowCode, is_sparse, is_worth_writing
from gsp.lowering.steps.sparse_pattern import write_pattern
from gsp.systems.flow import LARGEST, Flow, Values, check_epsilon, frozen

Loops = tuple[Callable[..., Any], Any]
"""A method's step for any flow, a kernel, and its signature."""
COLLOCATION_LOOPS: Loops = (attempt_by_loops, addresses.COLLOCATION_LOOPS)


if TYPE_CHECKING:
    _made_once = cached_property
else:

    class _made_once(cached_property):
        """A cached property that is made once, whatever the threads that ask for it first."""

        def __get__(self, instance, owner=None):
            with MAKING:
                return super().__get__(instance, owner)


@dataclass(frozen=True, eq=False, repr=False)
class CompiledFlow:
    """Machine code of a flow: addresses of its field (n,) and its Jacobian (n, n), and its observables.

    Each is compiled when first asked for, so that an explicit method never pays for the Jacobian. The addresses
    are good for as long as this object lives. It does not hold the flow, with which it is forgotten.
    """

    expressions: FlowCode
    """What is written into the code of a step."""
    values: Values
    """Values of the parameters, exact."""
    watched: Values
    """The flow's observables."""
    is_stiff: bool
    layouts: dict = field(default_factory=dict, init=False)
    """What integrators keep of their runs over this flow, by method; see `integration.run_array`."""
    _steps: dict[int, CompiledStep | None] = field(default_factory=dict, init=False)
    _programs: dict[int, np.ndarray] = field(default_factory=dict, init=False)

    def __reduce__(self) -> tuple:
        return CompiledFlow, (self.expressions, self.values, self.watched, self.is_stiff)

    @property
    def size(self) -> int:
        """Number of states, n."""
        return len(self.expressions.states)

    @property
    def field(self) -> int:
        """Address of the rates z'."""
        return self.rates.address

    @property
    def jacobian(self) -> int:
        """Address of the derivatives d z'_i/d z_j, row by row, exact."""
        return self.derivatives.address

    @_made_once
    def rates(self) -> CompiledFunction:
        """The rates as a function with n outputs."""
        return self._compiled(self.expressions.rates)

    @_made_once
    def derivatives(self) -> CompiledFunction:
        """The Jacobian as a function with n*n outputs, row by row."""
        n, entries = range(self.size), self.expressions.jacobian
        return self._compiled([entries.get((i, j), sp.S.Zero) for i in n for j in n])

    @_made_once
    def entries(self) -> CompiledFunction:
        """The entries of the Jacobian that are not 0 throughout, in the order of `expressions.jacobian`."""
        return self._compiled(list(self.expressions.jacobian.values()))

    def jacobians(self, points: np.typing.ArrayLike, p: np.typing.ArrayLike) -> np.ndarray:
        """The Jacobians (m, n, n) at `points` (m, n), or (n, n) at one (n,)."""
        n = self.size
        if not self.is_sparse:
            values = self.derivatives(points, p)
            return values.reshape(*values.shape[:-1], n, n)
        values = self.entries(points, p)
        found = np.zeros((*values.shape[:-1], n, n))
        rows, columns = zip(*self.expressions.jacobian)
        found[..., rows, columns] = values
        return found

    @_made_once
    def is_sparse(self) -> bool:
        """Whether the implicit methods run through loops over those entries alone."""
        return is_sparse(self.expressions)

    @_made_once
    def _pattern(self) -> np.ndarray:
        """What `kernels.sparse_systems` calls a pattern; empty where the Jacobian is dense."""
        if not self.is_sparse:
            return np.empty(0, np.int64)
        return write_pattern(tuple(self.expressions.jacobian), self.expressions.elimination)

    def collocation(self, stages: int) -> CompiledStep | None:
        """A step of Radau IIA with so many stages for this flow alone, or None where loops are as good."""
        with MAKING:
            if stages not in self._steps:
                self._steps[stages] = _collocation(self.expressions, stages) if self.is_written else None
        return self._steps[stages]

    @_made_once
    def is_written(self) -> bool:
        """Whether code for this flow alone is better than loops for any."""
        return is_worth_writing(self.expressions)

    @_made_once
    def explicit_program(self) -> np.ndarray:
        """What a kernel takes that asks for no Jacobian; see `kernels.integrator`."""
        return np.array([self.field, 0, address_of(dop853, addresses.METHOD), 0, 0])

    def collocation_program(self, stages: int) -> np.ndarray:
        """What the kernel of the Radau methods takes for the method of so many stages."""
        known = self._programs.get(stages)
        if known is None:
            known = self._programs[stages] = self._program(self.collocation(stages))
        return known

    def _program(self, code: CompiledStep | None) -> np.ndarray:
        # The loops stand behind a code as well, but next to no run comes to them.
        run = address_of(radau, addresses.METHOD)
        if code is None:
            # With the whole Jacobian, or its entries and their pattern.
            derivatives = self.entries.address if self.is_sparse else self.jacobian
            return np.array([self.field, derivatives, run, address_of(*COLLOCATION_LOOPS), 0, *self._pattern])
        return np.array([self.field, self.jacobian, run, 0, *code.program])

    @_made_once
    def clocks(self) -> tuple[CompiledClock, ...]:
        """The states of constant rate of which the rates hold functions that switch or peak."""
        found = []
        for clock in clocks(self.expressions.states, self.expressions.rates):
            numbers = chain.from_iterable(zeros.numbers for zeros in (*clock.switches, *clock.peaks))
            found.append(CompiledClock(clock, self._compiled([clock.rate, *numbers]), self.size))
        return tuple(found)

    @_made_once
    def observables(self) -> CompiledFunction:
        """The flow's observables, in their order."""
        return self._compiled(list(self.watched.values()))

    @_made_once
    def constants(self) -> np.ndarray:
        """(nan, *parameter values), read-only; see `parameter_vector`."""
        return frozen(np.array(self._values))

    @_made_once
    def _values(self) -> tuple[float, ...]:
        return float("nan"), *[nearest_double(exact(value)) for value in self.values.values()]

    @_made_once
    def _fixed(self) -> tuple[float, ...]:
        return self._values[1:]

    def parameters(self, epsilon: float | None) -> tuple[float, ...]:
        """p = (epsilon, *parameter values) for the functions here; see `parameter_vector`."""
        symbol = self.expressions.epsilon
        if symbol is not None and type(epsilon) is float and 1.0 / LARGEST <= epsilon <= LARGEST:
            return epsilon, *self._fixed
        if symbol is None:
            if epsilon is not None:
                raise DeclarationError(
                    "this flow has no small parameter.",
                    "Leave epsilon out, or declare the field with one.",
                    got=f"epsilon={epsilon!r}",
                    value=epsilon,
                )
            return self._values
        if epsilon is None:
            raise DeclarationError(
                f"this flow depends on {symbol}.", "Give its value, as in epsilon=0.01.", got="epsilon=None"
            )
        return check_epsilon(epsilon), *self._fixed

    def _compiled(self, outputs: Sequence[sp.Expr]) -> CompiledFunction:
        return compile_function(
            outputs,
            arguments=self.expressions.states,
            epsilon=self.expressions.epsilon,
            parameters=self.expressions.parameters,
            calls=self.expressions.calls,
            scheduled=True,
        )


@dataclass(frozen=True, eq=False, repr=False)
class CompiledStep:
    """A method's step for one flow: the addresses of its functions and the numbers behind them that the kernel takes.

    The addresses are good for as long as this object lives.
    """

    program: tuple[int, ...]
    _engine: Engine = field(repr=False)


@remembered
def compile_flow(flow: Flow) -> CompiledFlow:
    """Compiled form of a flow; flows with the same rates share their code, whatever their parameters' values."""
    unknown = next((str(state) for state, bad in zip(flow.states, holding(flow.rates, [sp.nan])) if bad), None)
    if unknown is not None:
        # An observable may have no value anywhere, and is nan then; a rate may not.
        raise UnsupportedFunctionError(f"the rate of {unknown} is nan.", "Write the expression in real terms.")
    rates = tuple(map(exact, flow.rates))
    code = FlowCode(tuple(flow.states), rates, flow.epsilon, tuple(flow.parameters), flow.calls)
    return CompiledFlow(code, flow.parameters, flow.observables, flow.is_stiff)


def parameter_vector(flow: Flow, epsilon: float | None) -> np.ndarray:
    """p = (epsilon, *parameter values) for the compiled functions of `flow`, a fresh array; NaN for no epsilon.

    Raises `DeclarationError` when `epsilon` is missing, superfluous, or not finite and positive.
    """
    return np.array(compile_flow(flow).parameters(epsilon))


@lru_cache(maxsize=MOST_KEPT // 3)
def _collocation(code: FlowCode, stages: int) -> CompiledStep:
    written = CollocationCode(code, stages)
    engine = build(written.text(), library=LIBRARY)
    return CompiledStep((*map(engine.get_function_address, written.NAMES), written.size), engine)
