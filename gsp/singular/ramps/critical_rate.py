"""`critical_rate`: the rate of a ramp at which the start's orbit meets the edge state, and on which side it tips."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.singular.ramps import level, one_state, section
from gsp.singular.ramps.connection import Connection
from gsp.singular.ramps.moving_frame import moving_frame
from gsp.singular.ramps.ramp_run import RampRun, run_ramp
from gsp.singular.ramps.ramped import Place, Ramped, RampError, at_epsilon
from gsp.systems.arguments import check_noun, check_number
from gsp.systems.declaration import equations_of, exact
from gsp.systems.flow import Point, in_words, values_by_name
from gsp.systems.ramp import Ramp
from gsp.systems.system import SlowFastSystem, VectorField


class TippingVerdict(StrEnum):
    """On which side of the critical rates a ramp tips."""

    ABOVE = "tips above the rate"
    BELOW = "tips below the rate"
    WINDOWS = "tips in windows of rates"
    ALWAYS = "always tips"
    NEVER = "never tips"
    UNDECIDED = "undecided"


@dataclass(frozen=True, eq=False, repr=False)
class CriticalRate(Drawn, Tabular):
    """The rates at which the orbit from the `start` of a ramp ends in the `edge` state, and what lies between them.

    - `verdict`; `rates` (k,), ascending, and their `errors` (k,), from twice the degree and from rounding;
    - `connections`, the orbits from start to edge, states over the ramp's phase, one for each rate;
    - `start` and `edge` by name, None where the ramp has no edge state; `message` says what else is known;
    - `slow_tips` tells whether slow ramps tip, and `ramped` is the field along the ramp.

    "Always" and "never" are of the limits of slow and fast ramps and of what was found between them: by Newton's method
    from nine rates and several guesses of the orbit, of several states by runs at 61 rates over six decades. Windows
    that these missed are not excluded.
    """

    verdict: TippingVerdict
    rates: tuple[float, ...]
    errors: tuple[float, ...]
    connections: tuple[Connection, ...]
    start: Mapping[str, float]
    edge: Mapping[str, float] | None
    message: str
    slow_tips: bool
    ramped: Ramped

    @property
    def rate(self) -> float | None:
        """The least of the rates that were found; None where there is none."""
        return self.rates[0] if self.rates else None

    @cached_property
    def begin(self) -> Place:
        """Where the ramp starts."""
        return Place(self.ramped.first, self._place(self.start))

    @cached_property
    def end(self) -> Place | None:
        """The edge state; None where there is none."""
        return None if self.edge is None else Place(self.ramped.ends[1], self._place(self.edge))

    def _place(self, values: Mapping[str, float]) -> np.ndarray:
        return np.array([values[x.name] for x in self.ramped.field.states])

    @cached_property
    def about_centres(self) -> CriticalRate:
        """The same about the centres of what is `ramped`, its rest points those of Newton's method there."""
        own, centre = self.ramped.about_centres, self.ramped.centre

        def there(at: Place, s: float) -> Mapping[str, float]:
            x = own.rest_point(at.x - centre.x, s)
            return _named(own, Place(s, at.x - centre.x if x is None else x))

        return replace(
            self,
            ramped=own,
            start=there(self.begin, own.first),
            edge=None if self.end is None else there(self.end, own.ends[1]),
            connections=tuple(c._replace(phase=c.phase - centre.s, x=c.x - centre.x) for c in self.connections),
        )

    def run(self, rate: float, *, after: float | None = None) -> RampRun:
        """The run along the ramp at that rate, and on for the time `after`.

        That is by default twelve of the edge state's, or, without one, of the rest point's to which the start leads.
        """
        check_number(rate, what="rate", be="a positive number", above=0.0)
        if self.ramped.ramp.ends[1] is None:
            raise RampError(
                "a ramp without end has no last state to run to.", "Integrate the field with its ramp."
            )
        own = self.about_centres
        given, begin = own.ramped, own.begin
        if after is None:
            rest = own.end or given.followed(begin, given.ends[1])[-1]
            if rest.s != given.ends[1]:
                raise RampError(
                    "the rest point of the start is lost on the way, so that nothing says how long to run on.",
                    "Give the time beyond the ramp, after=...",
                )
            after = 12.0 / abs(float(given.growth(rest)[-1]))
        return run_ramp(given, begin, rate, after=after).moved_to(self.ramped)

    @property
    def has_chart(self) -> bool:
        """Whether there is a threshold between a rest point and an edge state, which a chart draws."""
        return bool(self.rates) and self.end is not None

    @property
    def error(self) -> float | None:
        """The error of `rate`."""
        return self.errors[0] if self.errors else None

    def _listed(self, point: Mapping[str, float]) -> str:
        first = self.ramped.first
        last = self.ramped.ends[1] if self.edge else first
        along = self.ramped.moved(np.linspace(first, last, 16))
        sizes = {name: np.abs(values).max() for name, values in along.items()}
        told = {}
        for name, value in point.items():
            size = sizes.get(name, max(abs(at[name]) for at in (self.start, self.edge or self.start)))
            # Rounding of where the ramp leads, and of where the start is.
            told[name] = 0.0 if abs(value) <= 4.0 * np.finfo(float).eps * size else value
        return self.ramped.place(told)

    def __repr__(self) -> str:
        return f"CriticalRate({self.verdict}{''.join(f', {rate:.10g}' for rate in self.rates)})"

    def __str__(self) -> str:
        ends = [f"start {self._listed(self.start)}"] + (
            [] if self.edge is None else [f"edge {self._listed(self.edge)}"]
        )
        lines = [str(self.verdict), f"  {'; '.join(ends)}"]
        lines += [f"  rate {rate:.12g}, error {error:.1e}" for rate, error in zip(self.rates, self.errors)]
        return "\n".join([*lines, f"  {self.message}"])


def critical_rate(
    field: VectorField | SlowFastSystem,
    *,
    ramp: Ramp | Mapping[sp.Symbol, sp.Expr],
    start: Point,
    edge: Point | None = None,
    epsilon: float | None = None,
) -> CriticalRate:
    """The rates r at which x' = f(x, l), with l carried along by `ramp`, goes from the rest point at `start` to `edge`.

    `ramp` is a `Ramp`, or maps one parameter l to rho(l), an expression in l and other parameters: l' = r rho(l).
    `start` and `edge` name the states, for a mapping l too: a rest point of x' = f that attracts where the ramp starts,
    and one with one unstable direction where it ends. The ramp stops there, whether rho vanishes or not. Without `edge`
    it has no end: rho is a number and f, of one state, depends on x + c l only, so that x' = f is at rest in a moving
    frame until two rest points meet. An `edge` that names one state of several is a level: a ramp tips that takes it
    there, though the field may be excitable, without an edge state, and come back to rest. So is an edge state that is
    a cycle asked about, by a level beyond it. `epsilon` is the value of a
    small parameter. For tipping by the rate see P. Ashwin, S. Wieczorek, R. Vitolo, P. Cox, Phil. Trans. R. Soc. A 370
    (2012) 1166-1184, for edge states S. Wieczorek, C. Xie, P. Ashwin, Nonlinearity 36 (2023) 3238-3293.

    Raises `RampError` for ends that are no such rest points, a ramp that does not go from one to the other, and one
    without an end in a field that is not the same in a moving frame; `DeclarationError` for what is not well formed.

    >>> x, l = sp.symbols("x l")
    >>> field = VectorField(states={x: (x + l) ** 2 - 1}, epsilon=None, parameters={l: 0})
    >>> critical_rate(field, ramp={l: l * (3 - l)}, start={"x": -1, "l": 0}, edge={"x": -2, "l": 3})
    CriticalRate(tips above the rate, 1.333333333)
    >>> critical_rate(field, ramp=Ramp.linear_with_ends({l: (0, 3)}), start={"x": -1}, edge={"x": -2})
    CriticalRate(tips above the rate, 2.162032263)
    """
    check_noun(field, (VectorField, SlowFastSystem), verb="critical_rate")
    asked, x_0, x_1 = _declared(field, epsilon, ramp, start, edge)
    given, centre = asked.about_centres, asked.centre
    begin = Place(given.first, x_0 - centre.x)
    at_rest = given.rest_point(begin.x, begin.s)
    if at_rest is None or not (given.growth(Place(begin.s, at_rest)) < 0.0).all():
        got = asked.place(_named(given, begin, centre.x))
        raise RampError(
            f"start is no attracting rest point of {_equations(given)}.",
            "Give a place near one that there is where the ramp begins.",
            got=got,
        )
    begin = Place(begin.s, at_rest)
    named = _named(given, begin, centre.x)

    def answer(
        verdict: TippingVerdict,
        message: str,
        *,
        slow_tips: bool = False,
        found: Sequence[Connection] = (),
        edge: Mapping[str, float] | None = None,
    ) -> CriticalRate:
        rates, errors = tuple(c.rate for c in found), tuple(c.error for c in found)
        there = tuple(c._replace(phase=c.phase + centre.s, x=c.x + centre.x) for c in found)
        return CriticalRate(verdict, rates, errors, there, named, edge, message, slow_tips, asked)

    if x_1 is None:
        lost = moving_frame(given, begin)
        if lost is None:
            return answer(TippingVerdict.NEVER, "the rest point of the moving frame meets no other")
        above = answer(TippingVerdict.ABOVE, lost.message)
        return replace(above, rates=(lost.rate,), errors=(lost.error,))
    asked.check_way(x_0)
    last = Place(given.ends[1], x_1 - centre.x)
    way = given.followed(begin, last.s)
    if not np.isfinite(last.x).all():
        tips, found = _escapes(given, begin, way, last)
        verdict, message = _verdict(tips, len(found))
        level_of = [(s, v) for s, v in zip(given.field.states, x_1) if np.isfinite(v)]
        message += f"; one tips that comes to {in_words(level_of)}"
        return answer(verdict, message, slow_tips=tips[0], found=found)
    at_rest = given.rest_point(last.x, last.s)
    saddle = None if at_rest is None else section.edge_at(given, Place(last.s, at_rest))
    if saddle is None:
        if way[-1].s != last.s and len(begin.x) == 1:
            nothing = "there is no edge state where the ramp ends"
            if one_state.comes_back(given, way, last.s):
                text = f"the branch of the start ends in a fold on the way, slow ramps come back to it, and {nothing}"
                return answer(TippingVerdict.NEVER, text)
            text = f"the branch of the start ends in a fold on the way, and {nothing}"
            return answer(TippingVerdict.ALWAYS, text, slow_tips=True)
        kind = "repelling rest point" if len(begin.x) == 1 else "rest point with one unstable direction"
        remedy = "Give a place near one that there is where the ramp ends."
        if len(begin.x) > 1:
            remedy += " Of an edge state that is a cycle name a level of one state beyond it."
        got = asked.place(_named(given, last, centre.x))
        raise RampError(f"edge is no {kind} of {_equations(given)}.", remedy, got=got)
    if len(begin.x) == 1:
        (tips, found), unmatched = one_state.thresholds(given, way, saddle.place), ()
    else:
        if way[-1].s == last.s and not (given.growth(way[-1]) < 0.0).all():
            text = (
                "the rest point of the start does not attract where the ramp ends, so that every ramp leaves it"
            )
            return answer(TippingVerdict.ALWAYS, text, slow_tips=True)
        tips, found, unmatched = section.thresholds(section.Passage(given, begin, saddle), way)
    verdict, message = _verdict(tips, len(found), unmatched)
    ended = _named(given, saddle.place, centre.x)
    return answer(verdict, message, slow_tips=tips[0], found=found, edge=ended)


def _declared(
    source: VectorField | SlowFastSystem,
    epsilon: float | None,
    ramp: Ramp | Mapping[sp.Symbol, sp.Expr],
    start: Point,
    edge: Point | None,
) -> tuple[Ramped, np.ndarray, np.ndarray | None]:
    """The field along the ramp, the state where it starts, and the edge state where there is one."""
    field = at_epsilon(source, epsilon)
    names = [x.name for x in field.states]
    if isinstance(ramp, Ramp):
        begun = values_of(start, names, "start")
        ended = None if edge is None else _edge(edge, names)
    else:
        profiles = equations_of(ramp, "ramp")
        if len(profiles) != 1 or next(iter(profiles)) not in field.parameters:
            raise DeclarationError("ramp maps one parameter of the field to its profile.", got=dict(profiles))
        ((moved, rho),) = profiles.items()
        begun = values_of(start, [*names, moved.name], "start")
        ended = None if edge is None else values_of(edge, [*names, moved.name], "edge")
        # Where the profile of decimal numbers vanishes.
        last = None if ended is None else exact(ended[-1])
        ramp = Ramp({moved: moved}, rho, (exact(begun[-1]), last), phase=moved)
    last, n = ramp.ends[1], len(names)
    if last is None and ended is not None:
        raise RampError(
            "the ramp has no end, and an edge state is given.", "Leave `edge` out, or give it an end."
        )
    if last is not None and ended is None:
        raise RampError("the ramp has an end, and no edge state is given.", "Name one there, edge={...}.")
    if last is None and n > 1:
        raise RampError(
            "a ramp without an end has a critical rate for fields of one state.",
            "Give it an end, and name the edge state there.",
            got=f"{n} states",
        )
    return Ramped(source, ramp, epsilon), np.array(begun[:n]), None if ended is None else np.array(ended[:n])


def _edge(edge: Point, names: list[str]) -> list[float]:
    """The numbers of an edge state; of a level, which is of one state among several, NaN for the others."""
    values = values_by_name(edge, what="edge")
    if len(names) > 1 and len(values) == 1 and values.keys() <= set(names):
        return [values.get(name, np.nan) for name in names]
    return values_of(edge, names, "edge")


def values_of(point: Point, names: list[str], what: str) -> list[float]:
    """The numbers of a point that names these and nothing else."""
    values = values_by_name(point, what=what)
    if set(values) != set(names):
        listed = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
        raise DeclarationError(f"{what} names {listed}.", got=values, value=values)
    return [values[name] for name in names]


def _escapes(
    given: Ramped, begin: Place, way: list[Place], last: Place
) -> tuple[tuple[bool, bool], list[Connection]]:
    """Whether slow ramps pass a level, and fast ones, and the thresholds between."""
    if way[-1].s != last.s or not (given.growth(way[-1]) < 0.0).all():
        raise RampError(
            "the rest point of the start does not attract as far as the ramp leads, so that a level tells nothing: "
            "at any rate the state leaves it."
        )
    i = int(np.flatnonzero(np.isfinite(last.x))[0])
    return level.thresholds(level.Escape(given, begin, way[-1], (i, float(last.x[i]))))


def _equations(given: Ramped) -> str:
    return f"{', '.join(x.name for x in given.field.states)}' = f"


def _named(given: Ramped, place: Place, centre: np.ndarray | float = 0.0) -> Mapping[str, float]:
    """The states there, counted from a `centre` (n,), and the parameters that move."""
    named = {x.name: float(value) for x, value in zip(given.field.states, place.x + centre)}
    p = {**given.field.parameters, given.ramp.phase: sp.Float(place.s, 17)}
    return MappingProxyType(
        {**named, **{q.name: float(e.xreplace(p)) for q, e in given.ramp.parameters.items()}}
    )


def _verdict(
    tips: tuple[bool, bool], count: int, unmatched: Sequence[tuple[float, float]] = ()
) -> tuple[TippingVerdict, str]:
    """From whether slow ramps tip, and fast ones, the number of rates between, and where one was not found."""
    words = ["tip" if t else "do not tip" for t in tips]
    message = f"slow ramps {words[0]}, fast ones {words[1]}"
    if unmatched:
        low, high = unmatched[0][0], unmatched[-1][1]
        message += (
            f"; between {low:.3g} and {high:.3g} runs end differently where no orbit from the start meets the edge: "
            "rounding may decide there, or another edge state"
        )
    if count == 0 and unmatched:
        return TippingVerdict.UNDECIDED, message
    # Where some were not found their number says nothing.
    if not unmatched and count % 2 != (tips[0] != tips[1]):
        return TippingVerdict.UNDECIDED, f"{message}: a rate between them was not found"
    if count == 0:
        return (TippingVerdict.ALWAYS if tips[0] else TippingVerdict.NEVER), message
    if count > 1 or unmatched:
        return TippingVerdict.WINDOWS, f"{message}; windows between the rates that were tried are not excluded"
    return (TippingVerdict.BELOW if tips[0] else TippingVerdict.ABOVE), message
