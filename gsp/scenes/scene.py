"""A scene: one question about one system - where, from where, for how long, at which epsilon, how well."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import KW_ONLY, dataclass, field, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, cast

import sympy as sp

from gsp.errors import DeclarationError, is_hidden, printable, unknown_name
from gsp.results.card import Card
from gsp.scenes.fast_phase import FastPhase, checked_phase
from gsp.scenes.ramp_question import RampQuestion, checked_ramps
from gsp.scenes.view import View, checked_views
from gsp.sliding.no_slip import Contacts
from gsp.systems.arguments import (
    PLAIN_WORD,
    check_among,
    check_each,
    check_noun,
    check_number,
    check_plain_word,
    check_text,
    shown,
)
from gsp.systems.declaration import reconstruction_of
from gsp.systems.flow import (
    Question,
    Values,
    check_epsilon,
    check_epsilons,
    check_given,
    read_only,
    values_by_name,
)
from gsp.systems.region import Interval, check_interval, check_region, shown_ends, shown_region
from gsp.systems.system import SlowFastSystem, VectorField

# A run at a tenth of the tolerance is judged by one at 1e-13, the tightest; they have to differ to be compared.
FINEST = 1e-11
# The ladder of a scene that gives none, over `epsilon`: around the value asked about, and enough to fit a slope.
LADDER = (2.0, 1.0, 0.5, 0.25)
# What units call the time, and how long a unit may be.
TIME, LONGEST_UNIT = "t", 40


@dataclass(frozen=True, eq=False, repr=False)
class Scene(Question, Card):
    """One question about one system; what the whole pipeline needs to answer it.

    A system without a small parameter makes a scene too, for whatever needs none: its `epsilon` is None, its `epsilons`
    are empty, and its `region` may be. `take_small` and `take_fast` make a scene of it that has one.

    `region` bounds states by name, {name: (low, high)}; bounds on fast variables select a sheet of the critical
    manifold. `start` gives every state a value, `span` = (t0, t1) is in slow time, for a field in the time of its
    equations; `epsilon` is the value asked about, `epsilons` the ladder for convergence studies (kept in descending
    order; `epsilon` times 2, 1, 1/2 and 1/4 unless given), `tolerance` the relative accuracy wanted. `reconstruction`
    maps further symbols to rates that are driven by the states and by each other, as position is by velocity: no state
    depends on them, so they are left out of the reduction; they start at 0 unless `start` or `reconstruction_start`
    says otherwise. `path` names two quantities (states, observables or reconstruction variables) that draw a path in
    the plane. `starts` are further starts by name, each what differs from `start`; `starting(name)` asks from there.
    `units` are text for names of states, parameters, observables and t, which is shown and not computed with. `views`
    are what its author wants to see, `gsp.scenes.view.View` by name: the report draws each, and a demo begins with the
    first of two states. `second` names a parameter that is small too, after epsilon: `nest` takes both, everything else
    its value. `contacts` have dry friction, and say whether no-slip holds.
    `ramps` are `gsp.scenes.ramp_question.RampQuestion` by name: how parameters move, and near which edge state.
    `phase` says which states turn fast, `gsp.FastPhase`: what moves slowly is averaged over it.
    `worked_out` says what a foreign file works out of a parameter once, when it is read: another value of that alone
    would ask about another model than the file's. It is no part of what the scene asks, and is not written; nor are
    `found_bounds`, those of the region that `take_small` and `take_fast` found from a run.

    Stored: `region` {name: (float, float)}, `start` {state name: float}, `reconstruction_start` {name: float}.
    Raises `DeclarationError`, naming the fact, the value and the remedy.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=eps, name="decay")
    >>> Scene(system, {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01, (0.02, 0.01), 1e-6)
    Scene(decay: SlowFastSystem in x, y; epsilon=0.01, span=(0.0, 3.0), tolerance=1e-06)
    """

    system: SlowFastSystem | VectorField
    region: Mapping[str, Interval]
    start: Mapping[str, float]
    span: Interval
    epsilon: float = cast("float", None)
    epsilons: tuple[float, ...] = cast("tuple[float, ...]", None)
    tolerance: float = 1e-6
    _: KW_ONLY
    name: str = ""
    title: str = ""
    source: str = ""
    description: str = ""
    reconstruction: Values = field(default_factory=dict)
    reconstruction_start: Mapping[str, float] = field(default_factory=dict)
    path: tuple[str, str] | None = None
    claims: Mapping[str, Values] = field(default_factory=dict)
    starts: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    views: Mapping[str, View] = field(default_factory=dict)
    second: str = ""
    contacts: Contacts | None = None
    ramps: Mapping[str, RampQuestion] = field(default_factory=dict)
    phase: FastPhase | None = None
    worked_out: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    found_bounds: Mapping[str, Interval] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_noun(self.system, (SlowFastSystem, VectorField), verb="Scene")
        if not isinstance(self.contacts, (Contacts, type(None))):
            raise DeclarationError(
                "contacts are those of a system with dry friction.", got=shown(self.contacts)
            )
        for attribute in ("name", "title", "source", "description"):
            check_text(getattr(self, attribute), what=attribute)
            check_words(getattr(self, attribute), what=attribute)
        if self.name and not PLAIN_WORD.fullmatch(self.name):
            raise DeclarationError(
                f"the scene's name is {self.name[:80]!r}, which is no plain word (it names files).",
                "Use letters, digits, _ and -, at most 64; `title` takes any text.",
            )
        states = [state.name for state in self.system.states]
        empty = isinstance(self.region, Mapping) and not self.region
        # Only what needs a small parameter needs a region, and bounds are found for it then.
        region = MappingProxyType({}) if empty and not self.has_small else check_region(self.region, states)
        drivers = reconstruction_of(self.system, self.reconstruction)
        start, driven = _start(self.start, self.reconstruction_start, states, [s.name for s in drivers])
        for state, (low, high) in region.items():
            if not low <= start[state] <= high:
                raise DeclarationError(
                    f"the start is outside the region: {state} = {start[state]:g}, not in [{low:g}, {high:g}].",
                    f"Move the start or widen the region in {state}.",
                    value=start[state],
                    point=start,
                )
        self._set("region", region)
        if not isinstance(self.found_bounds, Mapping) or self.found_bounds:
            self._set("found_bounds", check_region(self.found_bounds, states, what="found_bounds"))
        self._set("reconstruction", MappingProxyType(drivers))
        self._set("start", MappingProxyType(start))
        self._set("reconstruction_start", MappingProxyType(driven))
        self._set("span", check_interval(self.span, what="span", remedy="Give (t0, t1) with t0 < t1."))
        self._set("epsilons", self._checked_epsilons())
        self._set("tolerance", _tolerance(self.tolerance))
        if drivers:
            # The field's own checks see undeclared symbols and misplaced epsilon in the reconstruction rates.
            rates = self.full_flow.equations
            self._set("reconstruction", MappingProxyType({symbol: rates[symbol] for symbol in drivers}))
        self._set("claims", MappingProxyType(_claims(self.claims, self.system)))
        watched = [*states, *(s.name for s in self.system.observables), *(s.name for s in drivers)]
        self._set("path", _path(self.path, watched))
        self._set("starts", MappingProxyType(_starts(self.starts, [*states, *driven])))
        self._set("views", MappingProxyType(checked_views(self.views, watched)))
        known = [*watched, *(s.name for s in self.system.parameters), TIME]
        known += [str(self.system.epsilon)] if self.has_small else []
        self._set("units", MappingProxyType(_units(self.units, known)))
        self._set("ramps", read_only(checked_ramps(self.ramps, self.system.states, self.system.parameters)))
        self._set("phase", checked_phase(self.phase, states))
        if not isinstance(self.worked_out, Mapping) or not all(
            isinstance(name, str) and isinstance(words, tuple) and all(isinstance(word, str) for word in words)
            for name, words in self.worked_out.items()
        ):
            raise DeclarationError(
                "worked_out maps parameters to what is worked out of them.", got=shown(self.worked_out)
            )
        parameters = [s.name for s in self.system.parameters]
        if check_text(self.second, what="second") and not (self.has_small and self.second in parameters):
            raise DeclarationError.none_of(
                parameters if self.has_small else (),
                self.second,
                f"second is {shown(self.second)}, and the second small parameter is a parameter of the system that "
                "is not its epsilon.",
                "The parameters are",
            )

    @property
    def has_small(self) -> bool:
        """Whether the system has a small parameter; where it has none, `epsilon` is None and `epsilons` is empty."""
        return self.system.epsilon is not None

    @property
    def limits(self) -> Mapping[str, Interval]:
        """The bounds of the region that somebody gave: a run that leaves these goes where nobody asked about."""
        return {name: ends for name, ends in self.region.items() if self.found_bounds.get(name) != ends}

    def _checked_epsilons(self) -> tuple[float, ...]:
        """The ladder, once `epsilon` is checked."""
        given = cast("tuple[float, ...] | None", self.epsilons)
        if self.has_small:
            self._set("epsilon", check_epsilon(self.epsilon))
            return _ladder([self.epsilon * k for k in LADDER] if given is None else given)
        if self.epsilon is not None or given:
            raise DeclarationError(
                "the system has no small parameter whose value could be given.",
                "Leave the value out, or declare the system with its epsilon.",
                got=shown(given if self.epsilon is None else self.epsilon),
                value=self.epsilon,
            )
        return ()

    @cached_property
    def full_flow(self) -> VectorField:
        """The field with reconstruction variables behind the states, and any 1/epsilon written out."""
        system = self.system
        return system.as_field({**dict(zip(system.states, system.rates)), **self.reconstruction})

    @cached_property
    def full_start(self) -> Mapping[str, float]:
        """Start of `full_flow`: {name: value} for the states, then the reconstruction variables."""
        return MappingProxyType({**self.start, **self.reconstruction_start})

    def starting(self, name: str) -> Scene:
        """The scene from another of its `starts`; raises `UnknownNameError` for a name that is none of them.

        A start outside the region is refused, as in any scene.
        """
        if not isinstance(name, str) or name not in self.starts:
            raise unknown_name(name, self.starts)
        return self._from(self.starts[name])

    def _from(self, start: Mapping[str, float], **others: Any) -> Scene:
        given = {**self.full_start, **start}
        own = {name: given.pop(name) for name in self.start}
        return replace(self, start=own, reconstruction_start=given, **others)

    def __repr__(self) -> str:
        states = ", ".join(state.name for state in self.system.states)
        epsilon = f"epsilon={self.epsilon:g}, " if self.has_small else ""
        return (
            f"Scene({self.name or self.system.name or 'unnamed'}: {type(self.system).__name__} in {states}; "
            f"{epsilon}span={self.span}, tolerance={self.tolerance:g})"
        )

    def __str__(self) -> str:
        ladder = ", ".join(f"{value:g}" for value in self.epsilons)
        slow = " in slow time" if isinstance(self.system, SlowFastSystem) else ""
        rows = [
            *([("region", shown_region(self.region))] if self.region else []),
            ("start", self._shown(self.full_start)),
            *((f"start {name}", self._shown(start)) for name, start in self.starts.items()),
            ("span", f"{' to '.join(shown_ends(self.span))}{slow}"),
            *([("epsilon", f"{self.epsilon:g}; ladder {ladder}")] if self.has_small else []),
            ("tolerance", f"{self.tolerance:g}"),
            *((f"{symbol}'", str(rate)) for symbol, rate in self.reconstruction.items()),
        ]
        for name, view in self.views.items():
            rows.append((f"view {name}", " against ".join(reversed(view.names))))
        rows += [] if self.phase is None else [("turning", str(self.phase))]
        rows += [(f"ramp {name}", str(asked.ramp)) for name, asked in self.ramps.items()]
        if self.units:
            rows.append(("units", ", ".join(f"{name} in {unit}" for name, unit in self.units.items())))
        width = max(len(left) for left, _ in rows)
        head = [self.title, str(self.system)] if self.title else [str(self.system)]
        return "\n".join([*head, *(f"  {left:>{width}}  {right}" for left, right in rows)])

    def _shown(self, values: Mapping[str, float]) -> str:
        return ", ".join(
            f"{name} = {value:g} {self.units.get(name, '')}".rstrip() for name, value in values.items()
        )

    def _set(self, attribute: str, value: object) -> None:
        object.__setattr__(self, attribute, value)

    def _key(self) -> tuple:
        own = (self.system, self.span, self.epsilon, self.epsilons, self.tolerance, self.path, self.second)
        texts = (self.name, self.title, self.source, self.description)
        named = (self.region, self.full_start, self.reconstruction, self.units, self.views, self.ramps)
        rows = tuple(tuple(each.items()) for each in named)
        deeper = (tuple((k, tuple(v.items())) for k, v in each.items()) for each in (self.claims, self.starts))
        return own, self.contacts, self.phase, texts, rows, *deeper

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Scene) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


def check_words(text: str, *, what: str) -> None:
    """Refuse characters that are not seen and change what is: controls, and marks of the direction of writing."""
    hidden = next((c for c in text if is_hidden(c) and c not in "\n\r\t"), None)
    if hidden is not None:
        raise DeclarationError(
            f"{what} holds the hidden character U+{ord(hidden):04X}.",
            "Remove it.",
            got=f"{printable(text[:60])!r}",
        )


def _start(
    start: Mapping, extra: Mapping, states: list[str], drivers: list[str]
) -> tuple[dict[str, float], dict[str, float]]:
    given = values_by_name(extra, what="reconstruction_start")
    for name in given:
        fact = f'reconstruction_start names "{name}", which is no reconstruction variable.'
        check_among(name, drivers, fact, "There are")
    given |= values_by_name(start, what="start")
    for name in given:
        if name not in states and name not in drivers:
            known = ", ".join(states) + (f"; reconstruction variables {', '.join(drivers)}" if drivers else "")
            raise DeclarationError(
                f'start names "{name}", which is no state.',
                f"The states are {known}.",
                value=name,
                known=[*states, *drivers],
            )
    check_given(given, states, what="start")
    return {name: given[name] for name in states}, {name: given.get(name, 0.0) for name in drivers}


def _starts(starts: Mapping, known: list[str]) -> dict[str, Mapping[str, float]]:
    if not isinstance(starts, Mapping):
        raise DeclarationError("starts maps names to starts.", got=shown(starts), value=starts)
    checked: dict[str, Mapping[str, float]] = {}
    for name, start in starts.items():
        check_plain_word(name, what="the name of a start")
        given = values_by_name(start, what=f"the start {name}")
        for state in given:
            fact = f'the start {name} names "{state}", which is no state.'
            check_among(state, known, fact, "The states are")
        checked[name] = MappingProxyType(given)
    return checked


def _units(units: Mapping, known: list[str]) -> dict[str, str]:
    if not isinstance(units, Mapping):
        raise DeclarationError("units maps names to text.", got=shown(units), value=units)
    for name, unit in units.items():
        check_among(name, known, f"units names {shown(name)}, which is nothing here.", "There are")
        check_text(unit, what=f"the unit of {name}")
        if not unit.strip() or len(unit) > LONGEST_UNIT or not unit.isprintable():
            raise DeclarationError(
                f"the unit of {name} is text of 1 to {LONGEST_UNIT} characters on one line.",
                got=shown(unit),
                value=unit,
            )
        check_words(unit, what=f"the unit of {name}")
    # A number's unit is 1, and is not written behind it.
    return {name: unit for name, unit in units.items() if unit.strip() != "1"}


def _claims(claims: Mapping, system: SlowFastSystem | VectorField) -> dict[str, Values]:
    if not isinstance(claims, Mapping):
        raise DeclarationError("claims maps names to reduced fields.", got=type(claims).__name__)
    known = [*system.states, *system.observables]
    checked: dict[str, Values] = {}
    for name, rates in claims.items():
        if not isinstance(name, str) or not isinstance(rates, Mapping) or not rates:
            raise DeclarationError(
                "a claim is a name and a mapping of states to rates.", got=f"{name!r}: {rates!r}"
            )
        small = system.epsilon
        epsilon = (
            small if small and any(sp.sympify(r, strict=True).has(small) for r in rates.values()) else None
        )
        check_words(name, what="the name of a claim")
        # The field's own checks: undeclared symbols, states that the claim uses without giving them a rate.
        field_ = VectorField(rates, epsilon=epsilon, parameters=system.parameters, name=name)
        for symbol in field_.states:
            fact = f'the claim "{name}" gives a rate to {symbol}, which is no state.'
            check_among(symbol, known, fact, "The states are")
        checked[name] = field_.equations
    return checked


def _ladder(epsilons: Iterable[float]) -> tuple[float, ...]:
    remedy = "Give at least two different positive values, such as (0.04, 0.02, 0.01)."
    values = list(check_epsilons(epsilons))
    if len(values) < 2 or len(set(values)) < len(values):
        raise DeclarationError("epsilons has too few values, or repeats one.", remedy, got=values)
    return tuple(sorted(values, reverse=True))


def _tolerance(tolerance: float) -> float:
    be = "a relative accuracy between 0 and 1"
    value = check_number(tolerance, what="tolerance", be=be, above=0.0, below=1.0, remedy="Try 1e-6.")
    if value < FINEST:
        raise DeclarationError(
            f"the tolerance is finer than {FINEST:g}, beyond which no run in double precision could be found "
            "wrong.",
            f"Give {FINEST:g} or more.",
            got=f"{value:g}",
            value=value,
        )
    return value


def _path(path: Iterable[str] | None, known: list[str]) -> tuple[str, str] | None:
    if path is None:
        return None
    remedy = 'Give a pair such as ("x", "y").'

    def plain(name: Any) -> Any:
        return name.name if isinstance(name, sp.Symbol) else name

    names = check_each(path, plain, what="path", be="a pair of names", remedy=remedy, length=2)
    if names[0] == names[1]:
        raise DeclarationError("path is a pair of different names.", remedy, got=f"{names!r}", value=names)
    for name in names:
        fact = f'path names "{name}", which is no state, observable or reconstruction variable.'
        check_among(name, known, fact, "There are")
    return names[0], names[1]
