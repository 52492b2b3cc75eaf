"""Expressions as machine code, by address.

Every compiled function has the signature `void f(double t, double* z, double* p, double* out)` with
p = (epsilon, *parameters), so that kernels take any model, and another epsilon or parameter value compiles nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from threading import RLock
from types import MappingProxyType
from typing import Any

import numpy as np
import sympy as sp
from llvmlite import ir

from gsp.errors import GspError
from gsp.kernels.engine import LONGEST_SCHEDULED, Engine, build
from gsp.kernels.evaluate import evaluate_many
from gsp.lowering.steps.emission import LIBRARY, Emitter
from gsp.lowering.steps.kernel_call import Call, write_calls
from gsp.lowering.steps.values import SIGNATURE, constant, fill, load, store
from gsp.systems.flow import Flow, Values

# Functions and steps that are kept when nothing uses them any more; each takes about 1 MB, and 2 to 20 ms to compile.
MOST_KEPT = 96
# Long code is cut into functions of about so many instructions: LLVM's schedules take more than in proportion to a
# function's length. A field of 1000 states along a line runs in a sixth of the time that it takes unscheduled.
LENGTH_OF_PART = 1500
# One thread at a time makes code. Of two that made the same, one would hold addresses of what is thrown away.
MAKING = RLock()
# Where a compiled function's arguments are.
_Z, _P, _OUT = range(1, 4)


@dataclass(frozen=True, eq=False, repr=False)
class CompiledFunction:
    """Machine code for a tuple of expressions, callable from kernels by `address` and from Python by value.

    `arguments` are the symbols of z, `parameters` those of p after epsilon. The address is good for as long as
    this object lives.

    >>> x, y = sp.symbols("x y")
    >>> f = compile_function([x * y, x - y], arguments=[x, y], epsilon=None, parameters=[])
    >>> f([[2.0, 3.0], [1.0, 5.0]], [float("nan")])
    array([[ 6., -1.],
           [ 5., -4.]])
    """

    address: int
    arguments: tuple[sp.Symbol, ...]
    parameters: tuple[sp.Symbol, ...]
    outputs: int
    _source: tuple
    _engine: Engine

    def __reduce__(self) -> tuple:
        # Machine code stays where it was made: who receives this compiles it again.
        return _compiled_again, self._source

    def __call__(self, points: np.typing.ArrayLike, p: np.typing.ArrayLike) -> np.ndarray:
        """Values (m, outputs) at `points` (m, n), or (outputs,) at one (n,); `p` is (epsilon, *parameters).

        Raises `GspError` when a shape does not fit.
        """
        # Copies: compiled code takes writable contiguous arrays only.
        z = np.array(points, dtype=float, order="C")
        constants = np.array(p, dtype=float, order="C")
        size, length = len(self.arguments), 1 + len(self.parameters)
        if z.ndim not in (1, 2) or z.shape[-1] != size:
            raise GspError(
                f"points have shape (m, {size}) or ({size},), one column for each argument.", got=z.shape
            )
        if constants.shape != (length,):
            raise GspError(f"p has shape ({length},): epsilon, then the parameters.", got=constants.shape)
        rows = z if z.ndim == 2 else z[np.newaxis]
        out = np.empty((rows.shape[0], self.outputs))
        if out.size:
            evaluate_many(self.address, rows, constants, out)
        return out if z.ndim == 2 else out[0]

    def __repr__(self) -> str:
        names = ", ".join(symbol.name for symbol in self.arguments)
        return f"CompiledFunction(arguments=({names}), outputs={self.outputs})"


def compile_function(
    outputs: Sequence[sp.Expr],
    *,
    arguments: Sequence[sp.Symbol],
    epsilon: sp.Symbol | None = None,
    parameters: Sequence[sp.Symbol] = (),
    through: Values = MappingProxyType({}),
    calls: tuple[Call, ...] = (),
    scheduled: bool = False,
) -> CompiledFunction:
    """Compile `outputs` as functions of `arguments`, `epsilon` and `parameters`; equal calls compile once.

    `outputs` may contain the symbols of `through` too, which stand for expressions in the arguments, and the results of
    `calls`, which come after these, in turn. `scheduled` is for what a run calls at every stage: see
    `gsp.kernels.engine.build`.

    Raises `UnsupportedFunctionError` for a function without machine code, `GspError` for an unknown symbol.
    """
    with MAKING:
        return _compile(
            tuple(map(exact, outputs)),
            tuple(arguments),
            epsilon,
            tuple(parameters),
            tuple(through.items()),
            calls,
            scheduled,
        )


def compile_over(
    flow: Flow, outputs: Sequence[sp.Expr], *, arguments: Sequence[sp.Symbol] | None = None
) -> CompiledFunction:
    """`outputs` as functions of the states of `flow`, or of `arguments`, and of its epsilon and parameters."""
    return compile_function(
        outputs,
        arguments=flow.states if arguments is None else arguments,
        epsilon=flow.epsilon,
        parameters=tuple(flow.parameters),
        calls=flow.calls if arguments is None else (),
    )


def finite_rows(values: np.ndarray) -> np.ndarray:
    """Which rows of `values` (m, ...) are finite throughout: booleans (m,)."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))


@lru_cache(maxsize=MOST_KEPT)
def _compile(
    outputs: tuple[sp.Expr, ...],
    arguments: tuple[sp.Symbol, ...],
    epsilon: sp.Symbol | None,
    parameters: tuple[sp.Symbol, ...],
    through: tuple[tuple[sp.Symbol, sp.Expr], ...],
    calls: tuple[Call, ...],
    scheduled: bool,
) -> CompiledFunction:
    # A store for each entry of a sparse matrix that is 0 would be most of the code.
    # More outputs that are 0 are written by a loop.
    zeros = len(outputs) if outputs.count(sp.S.Zero) > 64 else 0
    kept = [(i, e) for i, e in enumerate(outputs) if not (zeros and e is sp.S.Zero)]
    places = {symbol: (_Z, i) for i, symbol in enumerate(arguments)}
    if epsilon is not None:
        places[epsilon] = (_P, 0)
    places |= {symbol: (_P, 1 + i) for i, symbol in enumerate(parameters)}
    module = ir.Module()
    whole = _write(module, "f", kept, places, zeros, through, calls)
    length = sum(len(block.instructions) for block in whole.blocks)
    if scheduled and length > LONGEST_SCHEDULED and not (through or calls):
        module = _in_parts(kept, places, zeros, length // LENGTH_OF_PART)
    engine = build(str(module), library=LIBRARY, scheduled=scheduled)
    source = outputs, arguments, epsilon, parameters, through, calls, scheduled
    return CompiledFunction(
        engine.get_function_address("f"), arguments, parameters, len(outputs), source, engine
    )


def _write(
    module: ir.Module,
    name: str,
    outputs: Sequence[tuple[int, sp.Expr]],
    places: Mapping[sp.Symbol, tuple[int, int]],
    zeros: int = 0,
    through: tuple[tuple[sp.Symbol, sp.Expr], ...] = (),
    calls: tuple[Call, ...] = (),
) -> ir.Function:
    """Write a function that stores each output at its index, after 0 at the first `zeros` of them."""
    function = ir.Function(module, SIGNATURE, name)
    builder: Any = ir.IRBuilder(function.append_basic_block())
    # All loads come before any store, so that `out` may overlap the arguments.
    values = {symbol: load(builder, function.args[array], i) for symbol, (array, i) in places.items()}
    symbols, expressions = [symbol for symbol, _ in through], [expression for _, expression in through]
    values |= dict(zip(symbols, Emitter(builder, values).write(expressions)))
    values = write_calls(builder, calls, values)
    written = Emitter(builder, values).write([expression for _, expression in outputs])
    out = function.args[_OUT]
    if zeros:
        fill(builder, constant(0.0), out, zeros)
    for (i, _), value in zip(outputs, written):
        store(builder, value, out, i)
    builder.ret_void()
    return function


def _in_parts(
    outputs: Sequence[tuple[int, sp.Expr]], places: Mapping[sp.Symbol, tuple[int, int]], zeros: int, count: int
) -> ir.Module:
    """The same in `count` functions that f calls, of which each loads what it needs; `out` overlaps nothing."""
    module = ir.Module()
    parts: list[ir.Function] = []
    for k in range(count):
        part = outputs[k * len(outputs) // count : (k + 1) * len(outputs) // count]
        needed = {symbol for _, expression in part for symbol in expression.free_symbols}
        own = {symbol: place for symbol, place in places.items() if symbol in needed}
        parts.append(_write(module, f"part{k}", part, own, 0 if parts else zeros))
    function = ir.Function(module, SIGNATURE, "f")
    builder: Any = ir.IRBuilder(function.append_basic_block())
    for part in parts:
        builder.call(part, function.args)
    builder.ret_void()
    return module


def _compiled_again(*source: Any) -> CompiledFunction:
    with MAKING:
        return _compile(*source)


def exact(expression: object) -> sp.Expr:
    return sp.sympify(expression, strict=True)
