"""The members of an ensemble: starts, values of epsilon and of parameters, broadcast to one length and checked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError
from gsp.lowering.compiled_flow import parameter_vector
from gsp.systems.arguments import check_array
from gsp.systems.declaration import updated_parameters
from gsp.systems.flow import Flow, Point, as_points, by_name, check_epsilon, values_by_name

Column = ArrayLike
"""A number for all members, or one for each, (m,)."""
Starts = Mapping[str, Column] | Mapping[sp.Symbol, Column] | Sequence[Point] | ArrayLike
"""Columns by name, a mapping for each member, or an array (m, n) in the order of the flow's states."""
Columns = Mapping[str, Column] | Mapping[sp.Symbol, Column]


@dataclass(frozen=True, eq=False)
class Members:
    """What tells m runs of one flow apart, row i of each array being member i's, in the order given.

    `starts` (m, n) are states of the flow, `constants` (m, 1 + parameters) are (epsilon, *parameters) for its
    compiled functions; NaN stands for no epsilon.
    """

    starts: np.ndarray
    constants: np.ndarray

    def __len__(self) -> int:
        return len(self.starts)


def members_of(flow: Flow, starts: Starts, *, epsilon: Column | None, parameters: Columns | None) -> Members:
    """The members that the arguments of `integrate_many` describe; raises `DeclarationError`, naming the member."""
    sources: dict[str, np.ndarray] = {}
    if isinstance(starts, Mapping):
        columns = _columns(starts, "starts")
        sources |= {f"starts[{name!r}]": column for name, column in columns.items()}
        m = _length(sources)
        rows = flow.initials({name: np.broadcast_to(column, m) for name, column in columns.items()})
    elif isinstance(starts, Sequence) and any(isinstance(start, Mapping) for start in starts):
        rows = flow.initials(_gathered(starts))
        sources["starts"] = rows[:, 0]
    else:
        rows, _ = as_points(flow.states, starts, what="starts")
        sources["starts"] = rows[:, 0]
    given = _parameters(flow, parameters)
    sources |= {f"parameters[{name!r}]": column for name, column in given.items()}
    values = None if epsilon is None else _column(epsilon, "epsilon")
    constant = parameter_vector(flow, None if values is None else _checked(values))
    if values is not None:
        sources["epsilon"] = values
    m = _length(sources)
    constants = np.tile(constant, (m, 1))
    if values is not None:
        constants[:, 0] = values
    names = [symbol.name for symbol in flow.parameters]
    for name, column in given.items():
        constants[:, 1 + names.index(name)] = column
    states = np.array(np.broadcast_to(rows, (m, len(flow.states))))
    for array in (states, constants):
        array.setflags(write=False)
    return Members(states, constants)


def _parameters(flow: Flow, parameters: Columns | None) -> dict[str, np.ndarray]:
    given = _columns({} if parameters is None else parameters, "parameters")
    if given and not flow.parameters:
        raise DeclarationError(
            "this flow has no parameters; in a reduced flow their values are put in.",
            "Restrict a manifold of the system with each value.",
            got=", ".join(given),
        )
    updated_parameters(flow.parameters, dict.fromkeys(given, 0.0))
    return given


def _columns(values: Columns, what: str) -> dict[str, np.ndarray]:
    pairs = by_name(values, what=what, of="numbers or arrays")
    return {name: _column(value, f"{what}[{name!r}]") for name, value in pairs}


def _column(value: Column, what: str) -> np.ndarray:
    """`value` as finite floats (m,), or (1,) of a number."""
    array = check_array(value, what=what, be="a number or a sequence of numbers")
    if array.ndim > 1:
        raise DeclarationError(
            f"{what} is a number or one number for each member.",
            "Flatten it with .ravel().",
            got=f"the shape {array.shape}",
            value=array.shape,
        )
    column = np.atleast_1d(array)
    wrong = np.flatnonzero(~np.isfinite(column))
    if wrong.size:
        raise DeclarationError(f"{what} is {column[wrong[0]]} for member {wrong[0]}.", "Give finite numbers.")
    return column


def _checked(epsilons: np.ndarray) -> float:
    """The first value, once all are positive."""
    if not epsilons.size:
        raise DeclarationError("an ensemble has one member or more.", got="no value in epsilon")
    wrong = np.flatnonzero(~(epsilons > 0.0))
    i = int(wrong[0]) if wrong.size else 0
    return check_epsilon(float(epsilons[i]), what=f"epsilon of member {i}")


def _length(sources: Mapping[str, np.ndarray]) -> int:
    """How many members arrays of one or m entries describe; the keys name them in errors."""
    first: dict[int, str] = {}
    for name, values in sources.items():
        first.setdefault(len(values), name)
    if 0 in first:
        raise DeclarationError("an ensemble has one member or more.", got=f"no value in {first[0]}")
    several = {length: name for length, name in first.items() if length > 1}
    if len(several) > 1:
        shown = " and ".join(f"{length} in {name}" for length, name in several.items())
        raise DeclarationError(
            "each argument gives one value for all members or one for each.",
            "For all pairs use np.meshgrid and .ravel().",
            got=shown,
        )
    return max(first, default=1)


def _gathered(starts: Sequence[Any]) -> dict[str, np.ndarray]:
    """Columns from a mapping for each member, which all name the same."""
    rows = [values_by_name(start, what=f"starts[{i}]") for i, start in enumerate(starts)]
    names = list(rows[0])
    for i, row in enumerate(rows):
        if row.keys() != rows[0].keys():
            raise DeclarationError(
                "every start names the same quantities.",
                got=f"{', '.join(names)} in starts[0] and {', '.join(row) or 'none'} in starts[{i}]",
            )
    return {name: np.array([row[name] for row in rows]) for name in names}
