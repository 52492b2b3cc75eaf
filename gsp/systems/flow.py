"""What can be integrated: the contract between a declared system and the integrator.

Every noun that `integrate` accepts (a `SlowFastSystem`, a `VectorField`, a `ReducedFlow`) is a `Flow`.
A flow is autonomous; a system that depends on time declares a state t with t' = 1.
"""

from __future__ import annotations

import copyreg
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from math import isfinite
from types import MappingProxyType
from typing import Any

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError, GspError
from gsp.systems.arguments import (
    as_float,
    check_among,
    check_array,
    check_each,
    check_whole,
    shown,
)

Values = Mapping[sp.Symbol, sp.Expr]
Point = Mapping[str, float] | Mapping[sp.Symbol, float]
"""Numbers by name or by symbol."""
# What float() takes without being a number.
_NO_NUMBERS = frozenset(
    {bool, np.bool_, bytes, np.ndarray, np.ma.MaskedArray, type(np.ma.masked), np.complex64, np.complex128}
)
_FLOATS = frozenset({float})
# Series of higher order than any that double precision can use; more would take for ever.
HIGHEST_ORDER = 200

# Third powers of numbers within this factor of 1 are held by double precision.
LARGEST = 1e100


class Portable:
    """What works in another process too: caches stay behind, which may hold addresses of code and hashes."""

    def __getstate__(self) -> dict:
        kind = type(self)
        return {
            name: value
            for name, value in vars(self).items()
            if not isinstance(getattr(kind, name, None), cached_property)
        }


class Flow(Portable):
    """A field z' = F(z, epsilon) in slow time, with its parameters' values and what else can be read off z.

    A concrete flow is frozen and provides every attribute declared here.
    """

    states: tuple[sp.Symbol, ...]
    """The n state symbols, in the order of every state array."""
    rates: tuple[sp.Expr, ...]
    """The n right-hand sides dz/dt, with any 1/epsilon written out."""
    epsilon: sp.Symbol | None
    """The small parameter, or `None` for a field that has none."""
    parameters: Values
    """Values of the parameters, exact."""
    observables: Values
    """Further quantities by symbol, each an expression in the states, the parameters and epsilon."""
    fixed: Values = {}  # noqa: RUF012 - never written to
    """Values of parameters that were put into the rates already, exact."""
    is_stiff: bool = True
    """Whether the field still contains the fast time scale (decides the integrator)."""
    calls: tuple = ()
    """What finds the values of further symbols in the rates; see `gsp.lowering.steps.kernel_call`."""
    is_reduced: bool = False
    """Whether it lives on a slow manifold given as a series, and runs end where that does; see `endings`."""

    centres: Mapping[sp.Symbol, sp.Rational] = {}
    """Where the states that are far from their origin are, exact."""

    @cached_property
    def centre(self) -> np.ndarray:
        """The `centres` of the states (n,), 0 for those that have none."""
        return frozen(np.array([float(self.centres.get(s, 0)) for s in self.states]))

    @property
    def about_centres(self) -> Flow:
        """The same about its `centres`; itself where it has none."""
        return self

    def from_centres(self, start: Point) -> Point:
        """The start as it is counted from the `centres`."""
        if not self.centres:
            return start
        counted = np.array(self.initial(start)) - self.centre
        return {s.name: float(v) for s, v in zip(self.states, counted)}

    def place(self, point: Mapping[Any, float] | Iterable[tuple[Any, float]]) -> str:
        """Values by name, or by symbol, as text, to six digits of how far each is from its centre."""
        return in_words(point)

    @property
    def variables_shown(self) -> tuple[sp.Symbol, ...]:
        """The states or observables in which a run is described in words."""
        return self.states

    def initial(self, start: Point) -> tuple[float, ...]:
        """State tuple from a mapping of names to values; raises `DeclarationError` on wrong names."""
        known = plain(start, self._names_of_states)
        return complete(start, self.states, what="start") if known is None else known

    @cached_property
    def _names_of_states(self) -> tuple[str, ...]:
        return tuple(state.name for state in self.states)

    def initials(self, starts: Mapping[str, np.ndarray]) -> np.ndarray:
        """State array (m, n) from columns (m,) of finite numbers by name; row by row it is what `initial` gives."""
        if type(self).initial is Flow.initial:
            complete(dict.fromkeys(starts, 0.0), self.states, what="starts")
            return np.stack([starts[state.name] for state in self.states], axis=1)
        rows = []
        for i, values in enumerate(zip(*starts.values())):
            try:
                rows.append(self.initial(dict(zip(starts, values))))
            except GspError as error:
                raise error.under(f"member {i}") from None
        return np.array(rows, dtype=float)


class Question:
    """A flow together with where from, for how long and at which epsilon: what `integrate` runs as it stands."""

    full_flow: Flow
    full_start: Mapping[str, float]
    region: Mapping[str, tuple[float, float]]
    span: tuple[float, float]
    epsilon: float

    def setting(
        self, start: Point | None, span: tuple[float, float] | None, epsilon: float | None
    ) -> tuple[Flow, Point, tuple[float, float], float]:
        """Flow, start, span and epsilon, those given in place of its own."""
        return (
            self.full_flow,
            self.full_start if start is None else start,
            self.span if span is None else span,
            self.epsilon if epsilon is None else epsilon,
        )


def complete(point: Point, states: Sequence[sp.Symbol], *, what: str) -> tuple[float, ...]:
    """Values in the order of `states` of a point that names every state and nothing else."""
    known = plain(point, [state.name for state in states])
    if known is not None:
        return known
    # Keyed by symbols, or wrong: `values_by_name` reads the one and names the other.
    given = values_by_name(point, what=what)
    names = [state.name for state in states]
    for name in given:
        check_among(name, names, f'{what} names "{name}", which is no state.', "The states are")
    check_given(given, names, what=what)
    return tuple(given[name] for name in names)


def check_given(
    given: Mapping, names: Iterable[str], *, what: str, remedy: str = "Give every state a value."
) -> None:
    """Raises `DeclarationError` unless `given` has every one of `names`."""
    missing = [name for name in names if name not in given]
    if missing:
        raise DeclarationError(f"{what} gives no value for {', '.join(missing)}.", remedy, got=given)


def plain(point: Point, names: Collection[str]) -> tuple[float, ...] | None:
    """The finite numbers of a point that is keyed by these names and no others; None for one that is not so plain."""
    # The built-in type stands in front because asking the abstract class takes longer than all the rest.
    if isinstance(point, (dict, Mapping)) and len(point) == len(names):
        values: tuple = (*map(point.get, names),)  # pyright: ignore[reportArgumentType]
        if not _FLOATS.issuperset(map(type, values)):
            if not _NO_NUMBERS.isdisjoint(map(type, values)):
                return None
            try:
                values = (*map(float, values),)
            except (TypeError, ValueError, OverflowError):
                return None
        # A sum is finite only when all its terms are.
        if isfinite(sum(values)):
            return values
    return None


def by_name(values: object, *, what: str, of: str = "numbers") -> Iterator[tuple[str, Any]]:
    """What a mapping has for each name, which is text or a symbol; `what` names the argument in errors."""
    if not isinstance(values, Mapping):
        raise DeclarationError(f"{what} is a mapping of names to {of}.", got=shown(values), value=values)
    seen: set[str] = set()
    for key, value in values.items():
        # Text first: it is the usual key, and isinstance with a class of SymPy's is slow.
        name = key if isinstance(key, str) else key.name if isinstance(key, sp.Symbol) else None
        if name is None:
            raise DeclarationError(
                f"{what} is keyed by names or symbols.", got=f"the key {shown(key)}", value=key
            )
        if name in seen:
            raise DeclarationError(f'{what} gives "{name}" twice.', "Give each name one value.")
        seen.add(name)
        yield name, value


def values_by_name(values: Point, *, what: str) -> dict[str, float]:
    """Mapping with names for keys and finite floats for values; `what` names the argument in errors."""
    result: dict[str, float] = {}
    for name, value in by_name(values, what=what):
        number = as_float(value)
        if not isfinite(number):
            if isinstance(value, (int, float, np.floating)) and not isinstance(value, bool):
                raise DeclarationError(
                    f"{what} gives {name} the value {shown(value)}.", "Give a finite number."
                )
            raise DeclarationError(f"{what} gives {name} the value {shown(value)}, which is no real number.")
        result[name] = number
    return result


def in_words(
    values: Mapping[Any, float] | Iterable[tuple[Any, float]],
    digits: int = 6,
    more: Mapping[str, int] = MappingProxyType({}),
) -> str:
    """Numbers by name, or by symbol, in a line of text, such as "x = 0.5, y = -1"; some to `more` digits, by name.

    A zero has no sign.
    """
    pairs = list(values.items() if isinstance(values, Mapping) else values)
    names = [str(getattr(name, "name", name)) for name, _ in pairs]
    return ", ".join(f"{n} = {value + 0.0:.{more.get(n, digits)}g}" for n, (_, value) in zip(names, pairs))


def check_epsilon(value: float, *, what: str = "epsilon") -> float:
    """`value` as a float when it is finite, positive and within 1e100 of 1; raises `DeclarationError` otherwise."""
    number = as_float(value)
    if 1.0 / LARGEST <= number <= LARGEST:
        return number
    if 0.0 < number < float("inf"):
        raise DeclarationError(
            f"{what} lies beyond {LARGEST:g} or below {1.0 / LARGEST:g}, where its powers leave double "
            "precision.",
            "For the limit use the series at order 0.",
            got=f"{number:g}",
            value=number,
        )
    if isinstance(value, (int, float, np.floating)) and not isinstance(value, bool):
        raise DeclarationError(
            f"{what} must be finite and positive.",
            "For the limit use the series at order 0.",
            got=shown(value),
            value=value,
        )
    raise DeclarationError(f"{what} is a positive number.", "Try 0.01.", got=shown(value), value=value)


def check_epsilons(values: Iterable[float], *, what: str = "epsilon") -> tuple[float, ...]:
    """Every one of `values` as `check_epsilon` gives it; raises `DeclarationError` for what is no sequence too."""
    return check_each(
        values,
        lambda value: check_epsilon(value, what=f"every {what}"),
        what=f"{what}s",
        be="a sequence of positive numbers",
        remedy="Try (0.02, 0.01).",
    )


def check_order(value: int, *, what: str = "order") -> int:
    """`value` as an order of a series; raises `DeclarationError` unless it is an integer from 0 to HIGHEST_ORDER."""
    return check_whole(
        value, what=what, most=HIGHEST_ORDER, be=f"a non-negative integer, {HIGHEST_ORDER} at most"
    )


def check_orders(values: Iterable[int], *, what: str = "orders", empty: bool = False) -> tuple[int, ...]:
    """`values` as a tuple of non-negative integers, at least one unless `empty`; raises `DeclarationError` else."""
    be, remedy = "a sequence of non-negative integers", "Try (0, 1, 2, 3)."
    checked = check_each(
        values, lambda order: check_order(order, what=f"every one of {what}"), what=what, be=be, remedy=remedy
    )
    if not (checked or empty):
        raise DeclarationError(f"{what} are non-negative integers, one or more.", remedy, got="none")
    return checked


def as_points(symbols: Sequence[sp.Symbol], values, *, what: str) -> tuple[np.ndarray, bool]:
    """Array (m, n) of points in n `symbols`, and whether a single point was given.

    `values` is a mapping of names or symbols to numbers or arrays (broadcast), or an array: (m, n), or (n,) for
    one point, or for n = 1 a number (one point) or (m,). Raises `DeclarationError` otherwise, and for numbers that are
    not finite.
    """
    array, single = _as_points(symbols, values, what)
    for i, k in np.argwhere(~np.isfinite(array))[:1]:
        where = "" if len(array) == 1 else f" at point {i}"
        raise DeclarationError(f"{what} must be finite.", got=f"{symbols[k].name} = {array[i, k]}{where}")
    return array, single


def _as_points(symbols: Sequence[sp.Symbol], values, what: str) -> tuple[np.ndarray, bool]:
    n = len(symbols)
    names = [symbol.name for symbol in symbols]
    if isinstance(values, Mapping):
        given = {key.name if isinstance(key, sp.Symbol) else key: value for key, value in values.items()}
        for name in given:
            check_among(name, names, f'{what} names "{name}".', "It takes")
        missing = [name for name in names if name not in given]
        if missing:
            raise DeclarationError(f"{what} gives no value for {', '.join(missing)}.", "Give each a number.")
        arrays = [
            check_array(given[name], what=f"{what}[{name!r}]", be="a number or an array of numbers")
            for name in names
        ]
        try:
            columns = np.broadcast_arrays(*arrays)
        except ValueError as error:
            raise DeclarationError(f"{what} takes numbers or arrays of one shape. {error}.") from None
        single = columns[0].ndim == 0
        return np.stack([np.atleast_1d(column).ravel() for column in columns], axis=1), single
    array = check_array(
        values, what=what, be=f"an array of numbers for {', '.join(names)}, or a mapping by name"
    )
    if n == 1 and array.ndim < 2:
        return array.reshape(-1, 1), array.ndim == 0
    if array.ndim == 1 and len(array) == n:
        return array[None, :], True
    if array.ndim == 2 and array.shape[1] == n:
        return array, False
    raise DeclarationError(
        f"{what} has shape {array.shape}.", f"It takes (m, {n}) for {', '.join(names)}, or a mapping by name."
    )


def frozen(array: np.ndarray) -> np.ndarray:
    """The same array, read-only from now on: what a result holds."""
    # By position, which takes half the time: write=False.
    array.setflags(False)  # pyright: ignore[reportCallIssue]
    return array


def read_only(values: Mapping) -> MappingProxyType:
    """A view of a copy of `values` that nobody can write to: what a noun holds of a mapping."""
    return MappingProxyType(dict(values))


def _reduced(view: MappingProxyType) -> tuple:
    return read_only, (dict(view),)


# Python pickles and deeply copies no read-only view by itself, and every noun holds some.
copyreg.pickle(MappingProxyType, _reduced)
