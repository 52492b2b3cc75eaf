"""The integrators that there are, and which of them is taken."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, EnumType
from operator import attrgetter, methodcaller
from typing import Any, NamedTuple, Never

import numpy as np

from gsp.errors import DeclarationError, UnknownNameError
from gsp.kernels import dop853_tableau, integrator, radau_tableau
from gsp.kernels.compilation import address_of
from gsp.kernels.dop853 import dop853
from gsp.kernels.radau import radau
from gsp.kernels.radau_block import memory_size
from gsp.lowering.compiled_flow import COLLOCATION_LOOPS, CompiledFlow, Loops
from gsp.systems.arguments import shown

# What serves in place of the methods of earlier versions.
_REMOVED = {"rodas5p": "radau9", "radau5": "radau9", "taylor": "dop853"}


class _Methods(EnumType):
    """An enumeration that says of a member of earlier versions what serves in its place."""

    def __getattr__(cls, name: str) -> Never:
        fact, remedy = cls._explain(name)
        raise AttributeError(f"{fact} {remedy}", name=name, obj=cls)

    def __getitem__(cls, name: str) -> Any:
        if name in cls.__members__:
            return cls.__members__[name]
        fact, remedy = cls._explain(str(name))
        raise UnknownNameError(fact, remedy, value=name, known=tuple(cls.__members__))

    def _explain(cls, name: str) -> tuple[str, str]:
        """Why there is no method of this name, and what to take."""
        serves = _REMOVED.get(name.lower())
        if serves is None:
            return f"{cls.__name__} has no {name}.", f"The methods are {', '.join(cls.__members__)}."
        return f"Method.{name} was removed.", f"Take Method.{serves.upper()}, or leave method out."


class Method(Enum, metaclass=_Methods):
    """How to integrate.

    RADAU9, RADAU13: Radau IIA, implicit Runge-Kutta, order 9 and 13; for fields with a fast time scale.
    DOP853: explicit Runge-Kutta, order 8; for reduced flows and other fields on one time scale.
    """

    RADAU9 = "radau9"
    RADAU13 = "radau13"
    DOP853 = "dop853"

    # There is one of each: their identity serves as the key of the tables below, and costs less than their text.
    __hash__ = object.__hash__


class Solver(NamedTuple):
    """A kernel, the rows of its dense output, and the program of a flow that it takes.

    Where it `corrects`, values between the steps are what `kernels.landing` makes of its dense output, which elsewhere
    is as good as the steps. `loops` stand behind the code for a flow.
    """

    kernel: Callable[..., int]
    rows: int
    program: Callable[[CompiledFlow], np.ndarray]
    corrects: bool = False
    loops: Loops | None = None

    def memory_size(self, n: int) -> int:
        """Entries of `memory` for `n` states."""
        return memory_size(self.rows, n) if self.kernel is radau else integrator.MEMORY_SIZE

    def give_loops(self, program: np.ndarray) -> None:
        """Enter the loops for any flow into `program`, which next to no run needs where there is code for the flow."""
        if self.loops is not None:
            program[integrator.LOOPS] = address_of(*self.loops)


SOLVERS = {
    **{
        method: Solver(radau, stages, methodcaller("collocation_program", stages), loops=COLLOCATION_LOOPS)
        for method, stages in zip((Method.RADAU9, Method.RADAU13), radau_tableau.STAGES)
    },
    Method.DOP853: Solver(dop853, dop853_tableau.DENSE_ROWS, attrgetter("explicit_program"), corrects=True),
}


def choose_method(compiled: CompiledFlow, rtol: float) -> Method:
    """What was measured to be fastest for such a flow at this tolerance."""
    if not compiled.is_stiff:
        return Method.DOP853
    # Order 13 takes as long as order 9 at the same tolerance from 1e-5 on, and errs by a tenth: on the eight
    # stiff problems of `benchmarks/problems.py` targets of 1e-6 to 1e-9 take up to 6 % less with this border
    # than with 1e-6.
    return Method.RADAU9 if rtol >= 2e-5 else Method.RADAU13


def check_method(method: Method | str | None) -> Method | None:
    """The method asked for; raises `DeclarationError` when there is none such, or none any more."""
    if method is None or isinstance(method, Method):
        return method
    try:
        return Method(method)
    except (ValueError, TypeError):
        if isinstance(method, str) and method.lower() in _REMOVED:
            remedy = f'Take "{_REMOVED[method.lower()]}", or leave method out.'
            raise DeclarationError(f"{shown(method)} was removed.", remedy, value=method) from None
        names = [member.value for member in Method]
        raise DeclarationError.none_of(
            names, method, f"{shown(method)} is no method.", "The methods are"
        ) from None
