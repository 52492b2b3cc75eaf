"""The integrators that there are, and which of them is taken."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from operator import attrgetter, methodcaller
from typing import NamedTuple

import numpy as np

from gsp.errors import DeclarationError
from gsp.kernels import dop853_tableau, grid, ledger, radau_tableau
from gsp.kernels.compilation import address_of
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import radau
from gsp.kernels.radau_block import memory_size
from gsp.kernels.step_control import largest_rate
from gsp.kernels.taylor import taylor
from gsp.lowering.compiled_flow import COLLOCATION_LOOPS, EXPLICIT_LOOPS, CompiledFlow, Loops
from gsp.lowering.steps.taylor import dense_rows
from gsp.systems.arguments import shown

# Order 13 takes as long as order 9 at the same tolerance from 1e-5 on, and errs by a tenth: on the eight stiff problems
# of `benchmarks/problems.py` targets of 1e-6 to 1e-9 take up to 6 % less with this border than with 1e-6.
_TIGHT_RTOL = 2e-5
# The default does not wait longer for its code than half a second: so many products, and parts of the expressions.
_MOST_PRODUCTS = 5_000
_MOST_PARTS = 3_000


class Method(Enum):
    """How to integrate.

    RADAU5, RADAU9, RADAU13: Radau IIA, implicit Runge-Kutta, order 5, 9, 13; for fields with a fast time scale.
    DOP853: explicit Runge-Kutta, order 8; for reduced flows and other fields on one time scale.
    TAYLOR: explicit, order 12 to 20 by the tolerance; for smooth fields that are barely stiff or not at all, code for
    which takes a tenth of a second to build.
    """

    RADAU5 = "radau5"
    RADAU9 = "radau9"
    RADAU13 = "radau13"
    DOP853 = "dop853"
    TAYLOR = "taylor"

    # There is one of each: their identity serves as the key of the tables below, and costs less than their text.
    __hash__ = object.__hash__


class Solver(NamedTuple):
    """A kernel, the rows of its dense output, and the program of a flow that it takes.

    `check` says what `kernels.grid` does about the dense output's error; `loops` stand behind the code for a flow.
    """

    kernel: Callable[..., int]
    rows: int
    program: Callable[[CompiledFlow], np.ndarray]
    check: int = grid.TRUSTS
    loops: Loops | None = None

    def memory_size(self, n: int) -> int:
        """Entries of `memory` for `n` states."""
        return memory_size(self.rows, n) if self.kernel is radau else ledger.MEMORY_SIZE

    def give_loops(self, program: np.ndarray) -> None:
        """Enter the loops for any flow into `program`, which next to no run needs where there is code for the flow."""
        if self.loops is not None:
            program[ledger.LOOPS] = address_of(*self.loops)


# The dense output of order 4 for 5 is checked and of order 7 for 8 corrected; the others are as good as the steps.
_SOLVERS = {
    **{
        method: Solver(radau, stages, methodcaller("collocation_program", stages), check, COLLOCATION_LOOPS)
        for method, stages, check in zip(
            (Method.RADAU5, Method.RADAU9, Method.RADAU13),
            radau_tableau.STAGES,
            (grid.CHECKS, grid.TRUSTS, grid.TRUSTS),
        )
    },
    Method.DOP853: Solver(
        dop853, dop853_tableau.DENSE_ROWS, attrgetter("explicit_program"), grid.CORRECTS, EXPLICIT_LOOPS
    ),
}
# Orders of Taylor series, each from a tolerance on. On nine problems, at errors from 1e-3 to 1e-11 on a grid, these
# take 1 to 7 % longer than the best of the even orders from 8 to 24 (geometric means).
_TAYLOR_ORDERS = ((1e-5, 12), (1e-9, 16), (0.0, 20))
_TAYLOR = {
    order: Solver(taylor, dense_rows(order), methodcaller("taylor_program", order))
    for _, order in _TAYLOR_ORDERS
}


def solver_of(method: Method, rtol: float) -> Solver:
    """The solver of `method` at the tolerance."""
    return _TAYLOR[taylor_order(rtol)] if method is Method.TAYLOR else _SOLVERS[method]


def trusts(method: Method, rtol: float) -> bool:
    """Whether the method's dense output is as good as its steps."""
    return solver_of(method, rtol).check == grid.TRUSTS


def taylor_order(rtol: float) -> int:
    """The order of a Taylor series at a tolerance."""
    for least, order in _TAYLOR_ORDERS:
        if rtol >= least:
            return order
    return _TAYLOR_ORDERS[-1][1]


def program_of(compiled: CompiledFlow, method: Method, rtol: float) -> np.ndarray:
    """The addresses that the kernel of `method` takes; see `ledger`. What is missing is compiled.

    Raises `UnsupportedFunctionError` for `Method.TAYLOR` where the field has no Taylor series.
    """
    return solver_of(method, rtol).program(compiled)


def choose_method(compiled: CompiledFlow, rtol: float) -> Method:
    """What was measured to be fastest for such a flow at this tolerance."""
    if not compiled.is_stiff:
        return Method.DOP853
    return Method.RADAU9 if rtol >= _TIGHT_RTOL else Method.RADAU13


# What serves in place of the methods of earlier versions.
_REMOVED = {"rodas5p": Method.RADAU9.value}


def check_method(method: Method | str | None) -> Method | None:
    """The method asked for; raises `DeclarationError` when there is none such, or none any more."""
    if method is None or isinstance(method, Method):
        return method
    try:
        return Method(method)
    except (ValueError, TypeError):
        if isinstance(method, str) and method in _REMOVED:
            raise DeclarationError(
                f"{shown(method)} was removed.",
                f'Take "{_REMOVED[method]}", or leave method out.',
                value=method,
            ) from None
        names = [member.value for member in Method]
        raise DeclarationError.none_of(
            names, method, f"{shown(method)} is no method.", "The methods are"
        ) from None


# What has few fast times in its span, |J| (t1 - t0) at the start, is tried by Taylor series, with so many attempts.
# Measured on the sleigh from epsilon = 0.01 to 3.2, linear fields, van der Pol's oscillator and others, with code for
# each method's step. They draw level with the Radau methods at 200 (linear fields) to 700 (van der Pol); below they
# take down to half of the time, on oscillators a third. DOP853, without series, took 1.0 to 1.5 times as long.
MILD = 200.0
MILD_ATTEMPTS = 250


def is_mild(compiled: CompiledFlow, p: np.ndarray, y: np.ndarray, first: float, last: float) -> bool:
    """Whether the span is at most `MILD` fast times of the start."""
    border = MILD / abs(last - first)
    return bool(largest_rate(compiled.derivatives_program, first, y, p, border) <= border)


def begins_with_series(compiled: CompiledFlow, rtol: float) -> bool:
    """Whether a run of a flow declared stiff may begin by Taylor series, if its fast times are at most `MILD`."""
    return compiled.has_series(taylor_order(rtol), products=_MOST_PRODUCTS, parts=_MOST_PARTS)
