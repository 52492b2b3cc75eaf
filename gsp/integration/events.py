"""Events: zeros of functions of the state, asked for along a run; `crossings` finds them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.errors import DeclarationError, Named
from gsp.integration.crossings import ROUNDING, settle_event
from gsp.integration.watched import Settled, Watched
from gsp.lowering.compiled_function import compile_over
from gsp.results.card import Card
from gsp.systems.arguments import check_each, check_one_of, check_text, check_whole, shown
from gsp.systems.flow import Flow, frozen


@dataclass(frozen=True, eq=False)
class Event(Card):
    """A zero of `expression` along a trajectory.

    `expression` is a SymPy expression in states, observables, parameters, epsilon and the time t, or the name of a
    state or an observable. `direction` +1 takes rising zeros only, -1 falling ones, in the order in which the run
    passes them. `terminal` ends the run at the first crossing, or, a number k, at the k-th. The `name` is the
    expression's text unless given.

    Raises `DeclarationError` when an argument is not well formed.

    >>> Event("x", direction=1, terminal=3)
    Event(x, direction=1, terminal=3)
    """

    expression: sp.Expr | str
    _: KW_ONLY
    direction: int = 0
    terminal: bool | int = False
    name: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.expression, (str, sp.Expr)):
            raise DeclarationError(
                "an event is a SymPy expression, or the name of a state or an observable.",
                got=shown(self.expression),
                value=self.expression,
            )
        be = "1 for rising, -1 for falling, 0 for all zeros"
        check_one_of(self.direction, (-1, 0, 1), what="direction", be=be)
        if not isinstance(self.terminal, (bool, np.bool_)):
            be = "True, False, or the number of the crossing that ends the run"
            check_whole(self.terminal, what="terminal", be=be)
        check_text(self.name, what="name")
        object.__setattr__(self, "name", self.name or str(self.expression))

    def __repr__(self) -> str:
        parts = [str(self.expression)]
        parts += [f"direction={self.direction}"] * bool(self.direction)
        parts += [f"terminal={self.terminal}"] * bool(self.terminal)
        parts += [f"name={self.name!r}"] * (self.name != str(self.expression))
        return f"Event({', '.join(parts)})"


class Crossings(NamedTuple):
    """Where one event was met: `times` (k,) and `states` (n, k), in the order of the run."""

    times: np.ndarray
    states: np.ndarray

    def within(self, first: float, last: float) -> Crossings:
        """Those between two times, the ends with them."""
        inside = (self.times - first) * (self.times - last) <= 0.0
        return Crossings(self.times[inside], self.states[:, inside])


# Of a run without events.
NOT_MET: Mapping[str, Crossings] = MappingProxyType(Named())


def met_within(met: Mapping[str, Crossings], first: float, last: float) -> Mapping[str, Crossings]:
    """What was met between two times, the ends with them."""
    return MappingProxyType(Named({name: crossings.within(first, last) for name, crossings in met.items()}))


@dataclass(frozen=True, eq=False, repr=False)
class CompiledEvents:
    """The events of a run, compiled: for each g, its rate along the flow, and the size of its terms' variation."""

    events: tuple[Event, ...]
    states: int
    function: Callable[[np.ndarray, np.ndarray], np.ndarray]
    p: np.ndarray

    def values(self, t: np.ndarray, states: np.ndarray) -> np.ndarray:
        """Every g (m, events) at times (m,) and states (m, n)."""
        return self._all(t, states)[:, : len(self.events)]

    def signs(self, t: float, y: np.ndarray, forward: bool) -> np.ndarray:
        """Signs of g just after the start: of its rate where g itself is zero to rounding."""
        count = len(self.events)
        g, rate, size = self._all(np.array([t]), y[np.newaxis])[0].reshape(3, count)
        with np.errstate(invalid="ignore"):
            on = np.abs(g) <= ROUNDING * (size + np.abs(rate * t))
        signs = np.where(on, np.sign(rate) * (1.0 if forward else -1.0), np.sign(g))
        return np.nan_to_num(signs)

    def watched(self) -> list[Watched]:
        """What a search has to know about each."""
        return [
            Watched(e.name, e.direction, int(e.terminal), settle_event, partial(self._size, i))
            for i, e in enumerate(self.events)
        ]

    def met(self, found: Sequence[Sequence[Settled]]) -> Mapping[str, Crossings]:
        """Where each was met, by its name, of what a search has `found`."""
        result = Named()
        for event, crossings in zip(self.events, found):
            states = np.array([one.y for one in crossings]).reshape(-1, self.states).T
            result[event.name] = Crossings(frozen(np.array([one.t for one in crossings])), frozen(states))
        return MappingProxyType(result)

    def _size(self, i: int, t: float, y: np.ndarray) -> float:
        return self._all(np.array([t]), y[np.newaxis])[0, 2 * len(self.events) + i]

    def _all(self, t: np.ndarray, states: np.ndarray) -> np.ndarray:
        return self.function(np.column_stack([states, t]), self.p)


def compile_events(flow: Flow, events: Event | Iterable[Event], p: np.ndarray) -> CompiledEvents | None:
    """Compile `events` over `flow`, None for none.

    Raises `DeclarationError` for unknown names and names given twice.
    """
    given = (events,) if isinstance(events, Event) else _listed(events)
    if not given:
        return None
    names = [event.name for event in given]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise DeclarationError(f'two events are called "{twice[0]}".', "Give each a name=... of its own.")
    time = sp.Symbol("t")
    # A state called t is the state, and time has no name then.
    clock = sp.Dummy("t") if time in flow.states or time in flow.observables else time
    expressions = [_expression(event, flow, clock) for event in given]
    arguments = (*flow.states, clock)
    rates, sizes = [], []
    for g in expressions:
        slopes = [derivative(g, s) for s in arguments]
        rates.append(sp.Add(*[slope * rate for slope, rate in zip(slopes, (*flow.rates, sp.S.One))]))
        sizes.append(sp.Add(*[sp.Abs(slope * s, evaluate=False) for slope, s in zip(slopes, arguments)]))
    function = compile_over(flow, (*expressions, *rates, *sizes), arguments=arguments)
    return CompiledEvents(given, len(flow.states), function, p)


def _listed(events: Iterable[Event]) -> tuple[Event, ...]:
    be, remedy = "a sequence of Event", 'Write events=(Event("x", direction=1),).'

    def checked(event: object) -> Event:
        if isinstance(event, Event):
            return event
        raise DeclarationError(f"events is {be}.", remedy, got=f"{shown(event)} in it", value=event)

    return check_each(events, checked, what="events", be=be, remedy=remedy)


def _expression(event: Event, flow: Flow, clock: sp.Symbol) -> sp.Expr:
    names = {s.name: s for s in (*flow.states, *flow.observables)}
    expression = event.expression
    if isinstance(expression, str):
        if expression not in names:
            raise DeclarationError(
                f'the event "{expression}" is no state and no observable.',
                f"Those are {', '.join(names)}. Write other functions as SymPy expressions.",
                value=expression,
                known=names,
            )
        expression = names[expression]
    expression = expression.xreplace(dict(flow.observables)).xreplace(dict(flow.fixed))
    known = {*flow.states, *flow.parameters, clock, *(() if flow.epsilon is None else (flow.epsilon,))}
    unknown = sorted(s.name for s in expression.free_symbols - known)
    if unknown:
        words = [*names, *(s.name for s in flow.parameters)]
        raise DeclarationError(
            f'the event "{event.name}" contains {unknown[0]}, which is no state, observable or parameter.',
            f"There are {', '.join(words)}, and t for the time.",
            value=unknown[0],
            known=words,
        )
    return expression
