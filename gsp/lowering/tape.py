"""A system as a tape: the straight-line program that the jets of `gsp.kernels.jets` run through.

One tape serves every order, epsilon and parameter value: whatever does not depend on the states is an expression
in epsilon and the parameters, evaluated once a call.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.lowering.compiled_function import CompiledFunction, compile_over
from gsp.lowering.instructions import write_instructions
from gsp.lowering.remembering import remembered
from gsp.systems.system import SlowFastSystem


@dataclass(frozen=True, eq=False)
class Tape:
    """Instructions (rows, 4), the rows (n,) that hold the rates f and g, and the constants as a function."""

    instructions: np.ndarray
    rates: np.ndarray
    _constants: CompiledFunction

    def constants(self, p: np.ndarray) -> np.ndarray:
        """Values of the constants at p = (epsilon, *parameters)."""
        return self._constants(np.empty((1, 0)), p)[0]


@remembered
def write_tape(system: SlowFastSystem) -> Tape:
    """The tape of the rates (f, g) of `system`, g without its 1/epsilon.

    Raises `UnsupportedFunctionError` for a function that has no differential equation in `gsp.algebra.functions`.

    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> write_tape(SlowFastSystem(slow={x: -x}, fast={y: sp.sin(x) - y}, epsilon=epsilon)).instructions.shape
    (7, 4)
    """
    written = write_instructions(system.states, (*system.f, *system.g))
    constants = compile_over(system, list(written.constants) or [sp.S.Zero], arguments=())
    return Tape(np.array(written.rows, dtype=np.int64), np.array(written.outputs, dtype=np.int64), constants)
