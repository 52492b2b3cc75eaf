"""A ramp: a slow variable that carries parameters from where they rest to where they end, at a rate of its own.

Over its phase s a ramp is autonomous, s' = r rho(s), and the parameters are functions of s: r stretches time and does
not change the way. A phase at rest at an end, rho = 0 there, takes infinite time to leave it or to reach it; tanh(r t)
and sech(r t) have such phases (P. Ashwin, C. Perryman, S. Wieczorek,
Nonlinearity 30 (2017) 2185-2210; S. Wieczorek, C. Xie, C. Jones, Nonlinearity 34 (2021) 2970-3000).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

import sympy as sp

from gsp.errors import DeclarationError
from gsp.results.card import Card
from gsp.systems.arguments import check_each, check_noun, shown
from gsp.systems.declaration import equations_of, exact
from gsp.systems.flow import Values
from gsp.systems.system import VectorField

Number = float | str | sp.Expr
PHASE = sp.Symbol("phase")


@dataclass(frozen=True, repr=False)
class Ramp(Card):
    """Parameters that move with a phase s, s' = r rho(s), from the first of two `ends` to the last.

    `parameters` maps each parameter that moves to an expression in the `phase`, and `profile` is rho; both may hold
    further parameters of the field. `ends` are two numbers, the last one None for a ramp without end. The usual ones
    are `tanh`, `logistic`, `linear`, `linear_with_ends` and `there_and_back`, which take {parameter: (from, to)}; where
    there are several, r is the rate of the first.

    Raises `DeclarationError` for what is not well formed.

    >>> l = sp.Symbol("l")
    >>> Ramp.tanh({l: (0, 3)})
    Ramp(l = 3*phase/2 + 3/2; phase' = r*(1 - phase**2), from -1 to 1)
    """

    parameters: Values
    profile: sp.Expr
    ends: tuple[sp.Expr, sp.Expr | None]
    phase: sp.Symbol = PHASE

    def __post_init__(self) -> None:
        check_noun(self.phase, sp.Symbol, verb="Ramp")
        parameters = equations_of(self.parameters, "parameters")
        if not parameters:
            raise DeclarationError("a ramp moves one parameter or more.", got="none")
        (profile,) = equations_of({self.phase: self.profile}, "profile").values()
        first, last = check_each(
            self.ends,
            lambda end: end,
            what="ends",
            be="the two numbers between which the phase moves",
            length=2,
        )
        ends = (_number(first, "the first end"), None if last is None else _number(last, "the last end"))
        if ends[0] == ends[1]:
            raise DeclarationError("a ramp has two different ends.", got=f"{first} twice", value=first)
        for name, value in (
            ("parameters", MappingProxyType(parameters)), ("profile", profile), ("ends", ends),
        ):  # fmt: skip
            object.__setattr__(self, name, value)

    @classmethod
    def tanh(cls, parameters: Mapping[sp.Symbol, tuple[Number, Number]]) -> Self:
        """a + (b - a) (1 + tanh(r t))/2 from a to b, with the phase tanh(r t)."""
        return cls(_between(parameters, (1 + PHASE) / 2), 1 - PHASE**2, (-sp.S.One, sp.S.One))

    @classmethod
    def logistic(cls, parameters: Mapping[sp.Symbol, tuple[Number, Number]]) -> Self:
        """l' = r (l - a) (b - l) from a to b, with the phase (l - a)/(b - a)."""
        return cls(
            _between(parameters, PHASE), _length(parameters) * PHASE * (1 - PHASE), (sp.S.Zero, sp.S.One)
        )

    @classmethod
    def linear(cls, parameters: Mapping[sp.Symbol, Number | tuple[Number, Number]]) -> Self:
        """l' = r c from a, without end, for (a, c) or a alone, c = 1; the phase is r t."""
        moved = {}
        for p, given in _checked(parameters).items():
            begin, slope = given if isinstance(given, (tuple, list)) else (given, 1)
            moved[p] = exact(begin) + exact(slope) * PHASE
        return cls(moved, sp.S.One, (sp.S.Zero, None))

    @classmethod
    def linear_with_ends(cls, parameters: Mapping[sp.Symbol, tuple[Number, Number]]) -> Self:
        """At a until it starts, then |l'| = r as far as b, where it stops; the phase is (l - a)/(b - a)."""
        return cls(_between(parameters, PHASE), 1 / _length(parameters), (sp.S.Zero, sp.S.One))

    @classmethod
    def there_and_back(cls, parameters: Mapping[sp.Symbol, tuple[Number, Number]]) -> Self:
        """a + (b - a) sech(r t) from a by way of b back to a; with sech(r t) the sine of the phase."""
        return cls(_between(parameters, sp.sin(PHASE)), sp.sin(PHASE), (sp.S.Zero, sp.pi))

    def amplified(self, factor: Number) -> Self:
        """The same with all changes from where it begins times `factor`, a number or a parameter."""
        moved = {}
        by = factor if isinstance(factor, sp.Expr) else exact(factor)
        for p, e in self.parameters.items():
            begin = e.xreplace({self.phase: self.ends[0]})
            moved[p] = begin + by * (e - begin)
        return type(self)(moved, self.profile, self.ends, self.phase)

    def about(self, centre: sp.Expr) -> Self:
        """The same with its phase counted from `centre`."""
        there, (first, last) = {self.phase: self.phase + centre}, self.ends
        moved = {p: e.xreplace(there) for p, e in self.parameters.items()}
        ends = first - centre, None if last is None else last - centre
        return type(self)(moved, self.profile.xreplace(there), ends, self.phase)

    def along(self, field: VectorField) -> VectorField:
        """`field` with the phase in place of the parameters that move: a parameter, whose value is the first end.

        Raises `DeclarationError` where the ramp moves or holds what is no parameter of `field`, or names a state.
        """
        known = set(field.parameters)
        for p in self.parameters:
            if p not in known:
                raise DeclarationError.none_of(
                    [q.name for q in known], p.name, f"the ramp moves {p}, which is no parameter.", "They are"
                )
        held = self.profile.free_symbols.union(*(e.free_symbols for e in self.parameters.values()))
        unknown = sorted(held - {self.phase} - (known - set(self.parameters)), key=str)
        if unknown:
            raise DeclarationError(
                f"the ramp holds {unknown[0]}, which is no parameter.", value=unknown[0].name
            )
        if self.phase in field.states or self.phase in known - set(self.parameters):
            raise DeclarationError(
                f"{self.phase} is a name of the field, and the ramp's phase too.",
                "Give the ramp another `phase`.",
            )
        kept = {p: v for p, v in field.parameters.items() if p not in self.parameters}
        return VectorField(
            {x: rate.xreplace(dict(self.parameters)) for x, rate in field.equations.items()},
            epsilon=field.epsilon,
            parameters={**kept, self.phase: self.ends[0]},
            name=field.name,
        )

    def __hash__(self) -> int:
        return hash((tuple(self.parameters.items()), self.profile, self.ends, self.phase))

    def __repr__(self) -> str:
        return f"Ramp({self})"

    def __str__(self) -> str:
        moved = ", ".join(f"{p} = {e}" for p, e in self.parameters.items())
        last = "without end" if self.ends[1] is None else f"to {self.ends[1]}"
        rho = "r" if self.profile == 1 else f"r*({self.profile})"
        return f"{moved}; {self.phase}' = {rho}, from {self.ends[0]} {last}"


def _number(value: Number, what: str) -> sp.Expr:
    found: sp.Expr = value if isinstance(value, sp.Expr) else exact(value)
    if not (found.is_number and found.is_finite and found.is_real):
        raise DeclarationError(f"{what} of a ramp is a number.", got=shown(value), value=value)
    return found


def _checked(parameters: Mapping) -> Mapping:
    if not isinstance(parameters, Mapping) or not parameters:
        raise DeclarationError(
            "a ramp moves one parameter or more.",
            "Name each with its values, as in {l: (0, 3)}.",
            got=shown(parameters),
            value=parameters,
        )
    return parameters


def _pairs(parameters: Mapping) -> dict[sp.Symbol, tuple[sp.Expr, sp.Expr]]:
    pairs = {}
    for p, given in _checked(parameters).items():
        if not (isinstance(given, (tuple, list)) and len(given) == 2):
            raise DeclarationError(f"{p} of a ramp has two values, (from, to).", got=shown(given), value=given)
        pairs[p] = (_number(given[0], "a value"), _number(given[1], "a value"))
    return pairs


def _between(parameters: Mapping, share: sp.Expr) -> dict[sp.Symbol, sp.Expr]:
    return {p: sp.expand(a + (b - a) * share) for p, (a, b) in _pairs(parameters).items()}


def _length(parameters: Mapping) -> sp.Expr:
    pairs = _pairs(parameters)
    first, (a, b) = next(iter(pairs.items()))
    if a == b:
        raise DeclarationError(f"{first} of a ramp goes from one value to another.", got=f"{a} twice")
    return abs(b - a)
