"""Kernels by their addresses: compiled once each, and no part of the kernels that call them.

A kernel that calls another one by name has its machine code in it: what starts a run, lands on a time or goes through
an ensemble would hold every integrator again, and an integrator the loops that next to no run needs. By address they
are compiled when something asks for them, and what calls any of them is compiled once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

_REAL, _WHOLE, _TRUTH = types.float64, types.int64, types.boolean
_REALS, _WHOLES = types.Array(_REAL, 1, "C"), types.Array(_WHOLE, 1, "C")
_ROWS, _LAYERS = types.Array(_REAL, 2, "C"), types.Array(_REAL, 3, "C")

STATE: Any = types.Tuple((_REALS, _REALS, _REALS, _WHOLES))
RECORD: Any = types.Tuple((_REALS, _ROWS, _LAYERS))

METHOD: Any = _WHOLE(
    types.Tuple((_WHOLES, _REALS)), _REALS, types.Tuple((_REAL, _REAL, _WHOLE)), STATE, RECORD
)  # fmt: skip
"""That of an integrator, as `integrator` says."""
COLLOCATION_LOOPS: Any = types.Tuple((_REAL, _WHOLE, _REAL, _WHOLE))(
    types.Tuple((_WHOLE, _WHOLE, _WHOLES, _REALS)), _REAL, _WHOLE, STATE, types.UniTuple(_REAL, 4), _REALS
)
"""That of `radau_loops.attempt_by_loops`."""

JET: Any = types.void(
    types.Tuple((types.Array(_WHOLE, 2, "C"), _REALS, _WHOLES, _REAL, _WHOLE)),
    _REALS,
    _REALS,
    _WHOLE,
    _ROWS,
    _LAYERS,
)
"""That of `jets.flow_jet_with_tangents`."""
SHEET: Any = types.boolean(_WHOLES, _REALS, _REALS)
"""That of `sheets.reach_sheet`."""


def _at(address: Any, signature: Any) -> tuple[Any, Callable[..., Any]]:
    """What numba asks of an intrinsic (address, *arguments) that calls a kernel with this signature."""

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        kinds = [context.get_value_type(kind) for kind in signature.args]
        function_type = ir.FunctionType(context.get_value_type(signature.return_type), kinds)
        function = builder.inttoptr(arguments[0], function_type.as_pointer())
        return builder.call(function, arguments[1:])

    return signature.return_type(address, *signature.args), generate


def _call_method(context, address, flow, stops, control, state, record):
    return _at(address, METHOD)


def _call_collocation_loops(context, address, flow, step, stages, state, control, block):
    return _at(address, COLLOCATION_LOOPS)


def _call_jet(context, address, flow, x, y, order, v, d):
    return _at(address, JET)


def _call_sheet(context, address, sheet, target, y):
    return _at(address, SHEET)


# Typed as Any because kernels see them without the typing context.
call_method: Any = intrinsic(_call_method)
call_collocation_loops: Any = intrinsic(_call_collocation_loops)
call_jet: Any = intrinsic(_call_jet)
call_sheet: Any = intrinsic(_call_sheet)
