"""Switches become fast variables: v = s(z)/epsilon stands in the place of a state that s = epsilon v is solved for.

In z' = F(z, phi(s/epsilon), epsilon) the new variable has epsilon v' = Ds F, without an approximation. Where no state
can be eliminated, v stands beside all of them, and s = epsilon v is kept by the flow.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.factorisation import lowest_terms
from gsp.algebra.inversion import solve_for
from gsp.algebra.switches import in_fast, misplaced_pieces, surface_of
from gsp.errors import DeclarationError
from gsp.results.card import Card
from gsp.systems.flow import Values
from gsp.systems.system import VectorField


@dataclass(frozen=True)
class Switch(Card):
    """A fast variable made of a switch: `fast` = `surface`/epsilon.

    `state` is the state in whose place it stands and `value` what that is, in the others and `fast`; both are None
    where `fast` stands beside all states.
    """

    surface: sp.Expr
    fast: sp.Symbol
    epsilon: sp.Symbol
    state: sp.Symbol | None = None
    value: sp.Expr | None = None

    def __str__(self) -> str:
        what = f"{self.fast} = {self.surface / self.epsilon} is a fast variable"
        if self.state is None:
            return f"{what} beside the states, none of which it can be solved for."
        return f"{what} in place of {self.state} = {self.value}."


def has_switches(field: VectorField) -> bool:
    """Whether epsilon stands in a function, so that a new variable makes the field rational in it."""
    epsilon = field.epsilon
    return epsilon is not None and next(misplaced_pieces(field.rates, epsilon), None) is not None


def without_switches(field: VectorField) -> tuple[VectorField, tuple[Switch, ...]]:
    """The same field with a fast variable for each of its switches, eliminated states among its observables."""
    epsilon = field.epsilon
    assert epsilon is not None
    rates, observables = dict(field.equations), dict(field.observables)
    switches: list[Switch] = []
    names = _fresh(field)
    while (
        piece := next(misplaced_pieces([*rates.values(), *observables.values()], epsilon), None)
    ) is not None:
        surface = surface_of(piece, epsilon, tuple(rates))
        assert surface is not None
        switch, rates, observables = _changed(rates, observables, surface, next(names), epsilon)
        switches.append(switch)
    changed = VectorField(
        rates, epsilon=epsilon, parameters=field.parameters, name=field.name, observables=observables
    )
    return changed, tuple(switches)


def put(expression: sp.Expr, switches: tuple[Switch, ...]) -> sp.Expr:
    """`expression` of the states before in the variables after."""
    for switch in switches:
        expression = _in_fast(expression, switch.surface, switch.fast, switch.epsilon)
        if switch.state is not None:
            expression = expression.xreplace({switch.state: switch.value})
    return expression


def by_switch(expression: sp.Expr, switch: Switch) -> sp.Expr:
    """`expression` of the states before with the fast variable in its switch, surface/fast for other epsilons."""
    inside = _in_fast(expression, switch.surface, switch.fast, switch.epsilon)
    return lowest_terms(inside.xreplace({switch.epsilon: switch.surface / switch.fast}))


def _changed(
    rates: Values, observables: Values, surface: sp.Expr, fast: sp.Symbol, epsilon: sp.Symbol
) -> tuple[Switch, dict[sp.Symbol, sp.Expr], dict[sp.Symbol, sp.Expr]]:
    """The rates and observables with `fast` for surface/epsilon in place of a state, or beside them."""

    def in_new(given: Values) -> dict[sp.Symbol, sp.Expr]:
        return {z: _in_fast(e, surface, fast, epsilon) for z, e in given.items()}

    rates, observables = in_new(rates), in_new(observables)
    slopes = {z: derivative(surface, z) for z in rates}
    # Surfaces linear in a state first.
    for state in sorted(slopes, key=lambda z: not slopes[z].free_symbols.isdisjoint(rates)):
        value = None if slopes[state] == 0 else _solved(surface, state, fast, epsilon)
        if value is None:
            continue
        new = _eliminated(rates, slopes, state, value, fast, epsilon)
        shown = {state: value, **{z: e.xreplace({state: value}) for z, e in observables.items()}}
        left = misplaced_pieces([*new.values(), *shown.values()], epsilon)
        if all(surface_of(piece, epsilon, tuple(new)) is not None for piece in left):
            return Switch(surface, fast, epsilon, state, value), new, shown
    moving = sp.Add(*(slope * rates[z] for z, slope in slopes.items()))
    return Switch(surface, fast, epsilon), {**rates, fast: moving / epsilon}, observables


def _in_fast(expression: sp.Expr, surface: sp.Expr, fast: sp.Symbol, epsilon: sp.Symbol) -> sp.Expr:
    pieces = {
        piece: in_fast(piece, epsilon, surface, fast) for piece in misplaced_pieces([expression], epsilon)
    }
    return expression.xreplace({piece: new for piece, new in pieces.items() if new is not None})


def _solved(surface: sp.Expr, state: sp.Symbol, fast: sp.Symbol, epsilon: sp.Symbol) -> sp.Expr | None:
    value = sp.Dummy("value")
    solved = solve_for([state], {value: surface})
    return None if solved is None else solved[state].xreplace({value: epsilon * fast})


def _eliminated(
    rates: Values, slopes: Values, state: sp.Symbol, value: sp.Expr, fast: sp.Symbol, epsilon: sp.Symbol
) -> dict[sp.Symbol, sp.Expr]:
    moving = sp.Add(*(slope * rates[z] for z, slope in slopes.items()))
    new = {fast if z == state else z: moving / epsilon if z == state else rate for z, rate in rates.items()}
    return {z: rate.xreplace({state: value}) for z, rate in new.items()}


def _fresh(field: VectorField):
    """Names of fast variables that nothing in the field has: v, w, then v1, v2, ..."""
    taken = {str(s) for s in (*field.states, *field.parameters, *field.observables, field.epsilon)}
    names = itertools.chain("vw", (f"v{k}" for k in itertools.count(1)))
    return (sp.Symbol(name) for name in names if name not in taken)


def with_fast(
    switches: tuple[Switch, ...], values: Mapping[str, float], epsilon: float, parameters: Values
) -> dict[str, float]:
    """Values by name of the states before with those of the fast variables, eliminated states left out."""
    found = dict(values)
    for switch in switches:
        unknown = switch.surface.free_symbols
        place = {
            **parameters,
            switch.epsilon: epsilon,
            **{s: found[s.name] for s in unknown if s.name in found},
        }
        missing = sorted(str(s) for s in unknown - place.keys())
        if missing:
            raise DeclarationError(
                f"no value for {', '.join(missing)}.", "Give each a number.", got=dict(values)
            )
        found[switch.fast.name] = float(switch.surface.xreplace(place)) / epsilon
    gone = {switch.state.name for switch in switches if switch.state is not None}
    return {name: value for name, value in found.items() if name not in gone}
