"""Candidates where no parameter is small: which part of a field may be fast, as N f with constant N.

Each becomes the field N f/epsilon + (F - N f), which is F itself at epsilon = 1. Species in quasi-steady state have
unit vectors for N; a reaction in partial equilibrium has its stoichiometry; a total quasi-steady state has the whole
rate of a complex along the stoichiometry of its binding, so that totals are slow (Borghans, de Boer and Segel 1996).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.scales.conservation import MOST_TERMS, terms_multiplied_out
from gsp.scenes.small_parameter import unused_epsilon
from gsp.systems.flow import Values
from gsp.systems.system import VectorField

# Of sets and of equilibria no more than so many are tried.
MOST = 64

# What a reaction changes, by state: numbers, or ratios of parameters, such as volumes.
Stoichiometry = Mapping[sp.Symbol, sp.Expr]
Direction = tuple[tuple[sp.Symbol, sp.Expr], ...]


@dataclass(frozen=True)
class FastPart:
    """N f of a field: `directions` are the columns of N by state, `rates` the components of f; `name` says which."""

    name: str
    directions: tuple[Stoichiometry, ...]
    rates: tuple[sp.Expr, ...]

    @property
    def count(self) -> int:
        """How many fast directions there are."""
        return len(self.directions)

    @property
    def states(self) -> tuple[sp.Symbol, ...] | None:
        """The states that are fast by themselves; None where a combination of states is."""
        single = [next(iter(d)) for d in self.directions if len(d) == 1]
        return tuple(single) if len(single) == len(self.directions) else None

    def field(self, original: VectorField) -> VectorField:
        """N f/epsilon + (F - N f)."""
        epsilon = unused_epsilon(original)
        parts: dict[sp.Symbol, list[sp.Expr]] = {}
        for direction, rate in zip(self.directions, self.rates):
            for state, number in direction.items():
                parts.setdefault(state, []).append(number * rate)
        rates = dict(original.equations)
        for state, terms in parts.items():
            rates[state] = _divided(rates[state], sp.Add(*terms), epsilon)
        # Of the states of a combination the first is the fast variable: the complex, not what it is made of.
        first = {s: rates[s] for s in (next(iter(d)) for d in self.directions)}
        return VectorField(
            first | rates,
            epsilon=epsilon,
            parameters=original.parameters,
            name=original.name,
            observables=original.observables,
        )


def _divided(whole: sp.Expr, part: sp.Expr, epsilon: sp.Symbol) -> sp.Expr:
    """part/epsilon + (whole - part), where the terms of `part` leave the rest if they are some of those of `whole`."""
    if part == whole:
        # The whole rate is divided as it stands.
        return whole / epsilon
    expanded = sp.expand(whole)
    rest = expanded - sp.expand(part)
    if len(sp.Add.make_args(rest)) < len(sp.Add.make_args(expanded)):
        return sp.factor_terms(part) / epsilon + rest
    return whole + (1 / epsilon - 1) * part


def fast_parts(field: VectorField, *, large: Iterable[Collection[sp.Symbol]] = ()) -> list[FastPart]:
    """The candidates of a field, quasi-steady states of few species first, and those of the `large` sets of states."""
    groups = _reactions(field)
    complexes, bound = _bound(field, groups)
    groups |= _exchanges(field)
    states = field.states

    def quasi_steady(chosen: Collection[sp.Symbol]) -> FastPart:
        kind = "standard " if set(chosen) <= complexes else "reverse " if set(chosen) <= bound else ""
        unit = tuple({s: sp.Integer(1)} for s in chosen)
        rates = tuple(field.equations[s] for s in chosen)
        return FastPart(f"{kind}quasi-steady state of {', '.join(s.name for s in chosen)}", unit, rates)

    found: list[FastPart] = []
    # Sets of up to three states are tried.
    for size in range(1, min(3, len(states) - 1) + 1):
        if len(found) + math.comb(len(states), size) > MOST:
            break
        found += map(quasi_steady, itertools.combinations(states, size))
    listed = {frozenset(part.states or ()) for part in found}
    reversible = {d: rate for d, rate in groups.items() if len(d) > 1 and _is_reversible(rate)}
    found += _equilibria(field, reversible, complexes)
    return [*found, *(quasi_steady(chosen) for chosen in large if frozenset(chosen) not in listed)]


def _equilibria(
    field: VectorField, reversible: Mapping[Direction, sp.Expr], complexes: Collection[sp.Symbol]
) -> list[FastPart]:
    """Reversible reactions in partial equilibrium: one by one, with total quasi-steady states of complexes, in pairs,
    all together, each kind where there is room for all of it."""
    values = dict(field.parameters)
    found: list[FastPart] = []
    for direction, rate in reversible.items() if len(reversible) <= MOST else ():
        told = _told(direction, values)
        found.append(FastPart(f"partial equilibrium of {told}", (dict(direction),), (rate,)))
        for state, number in direction:
            if state in complexes:
                along = {state: sp.Integer(1), **{s: n / number for s, n in direction}}
                name = f"total quasi-steady state of {state.name} in {told}"
                found.append(FastPart(name, (along,), (field.equations[state],)))
    for size in (2, len(reversible)) if len(reversible) > 2 else (2,):
        if len(found) + math.comb(len(reversible), size) > MOST:
            continue
        for several in filter(_are_independent, itertools.combinations(reversible, size)):
            told = " and ".join(_told(direction, values) for direction in several)
            rates = tuple(reversible[d] for d in several)
            found.append(FastPart(f"partial equilibria of {told}", tuple(map(dict, several)), rates))
    return found


def _reactions(field: VectorField) -> dict[Direction, sp.Expr]:
    """Terms of the rates by what they change: {stoichiometry: rate}, where the same term stands in several rates."""
    changes: dict[sp.Expr, dict[sp.Symbol, sp.Expr]] = {}
    for state, _, number, rest in _terms(field):
        changes.setdefault(rest, {})[state] = number
    groups: dict[Direction, sp.Expr] = {}
    for rest, change in changes.items():
        first = abs(next(iter(change.values())))
        _add(groups, tuple((s, n / first) for s, n in change.items()), first * rest)
    return groups


def _exchanges(field: VectorField) -> dict[Direction, sp.Expr]:
    """What two states exchange, each in a unit of its own: {stoichiometry: rate}, there and back.

    Their terms differ by a ratio of parameters, as where compartments have volumes: -Q a/V and Q a/W. Terms that merely
    have the same states in them do not have a way back of the same ratio.
    """
    values, states = dict(field.parameters), frozenset(field.states)
    alike: dict[sp.Expr, list[tuple[sp.Symbol, sp.Expr, float]]] = {}
    for state, term, _, _ in _terms(field):
        factors = sp.Mul.make_args(term)
        part = sp.Mul(*(f for f in factors if f.free_symbols & states))
        coefficient = sp.Mul(*(f for f in factors if not f.free_symbols & states))
        value = coefficient.xreplace(values)
        if value.is_finite and value.is_nonzero:
            alike.setdefault(part, []).append((state, coefficient, float(value)))
    # Pairs whose ratios are equal in numbers, told apart by the symbols below: there are as many as terms cubed.
    pairs: dict[tuple[sp.Symbol, sp.Symbol, str], list[tuple[sp.Expr, sp.Expr, sp.Expr, int]]] = {}
    for part, terms in alike.items():
        held = part.free_symbols
        for (one, own, amount), (other, its, another) in itertools.combinations(terms, 2):
            # What goes over is taken from one of the two.
            if one != other and held & {one, other}:
                sign = 1 if amount > 0 else -1
                pairs.setdefault((one, other, f"{another / amount:.12g}"), []).append((part, own, its, sign))
    groups: dict[Direction, sp.Expr] = {}
    for (one, other, _), found in pairs.items():
        if len({sign for *_, sign in found}) == 1:
            continue
        for part, own, its, sign in found:
            ratio = its / own
            if not ratio.is_Rational:
                _add(groups, ((one, sp.Integer(sign)), (other, sign * ratio)), sign * own * part)
    return {direction: rate for direction, rate in groups.items() if _is_reversible(rate)}


def _terms(field: VectorField) -> Iterator[tuple[sp.Symbol, sp.Expr, sp.Rational, sp.Expr]]:
    """(state, term of its rate, the term's number, the rest of it); of a rate with too many as it is written."""
    for state, rate in field.equations.items():
        for term in sp.Add.make_args(sp.expand(rate) if terms_multiplied_out(rate) <= MOST_TERMS else rate):
            number, rest = term.as_coeff_Mul()
            if number.is_Rational and number != 0:
                yield state, term, number, rest


def _add(groups: dict[Direction, sp.Expr], direction: Direction, rate: sp.Expr) -> None:
    """Add to the reaction of this stoichiometry, or take from that of the opposite one."""
    opposite = tuple((s, -n) for s, n in direction)
    sign = -1 if opposite in groups else 1
    key = opposite if sign == -1 else direction
    groups[key] = groups.get(key, sp.Integer(0)) + sign * rate


def _is_reversible(rate: sp.Expr) -> bool:
    signs = {term.as_coeff_Mul()[0].is_positive for term in sp.Add.make_args(rate)}
    return signs == {True, False}


def _bound(field: VectorField, groups: Mapping[Direction, sp.Expr]) -> tuple[set[sp.Symbol], set[sp.Symbol]]:
    """(complexes, what they are made of): products and reactants of bindings, which are the bilinear terms.

    Where the free enzyme is written as its total less the complex, the bilinear term unbinds: it takes the complex.
    """
    complexes: set[sp.Symbol] = set()
    parts: set[sp.Symbol] = set()
    for direction, rate in groups.items():
        if len(direction) < 2 or not _is_reversible(rate):
            continue
        change = dict(direction)
        for term in sp.Add.make_args(rate):
            among = [s for s in field.states if term.has(s)]
            if len(among) != 2:
                continue
            number, _ = term.as_coeff_Mul()
            moved = {s: n * (1 if number > 0 else -1) for s, n in change.items()}
            losing = [s for s in among if moved.get(s, 0) < 0]
            if len(losing) == 2:
                complexes |= {s for s, n in moved.items() if n > 0}
                parts |= set(losing)
            elif len(losing) == 1:
                complexes |= set(losing)
                parts |= {s for s, n in moved.items() if n > 0}
    return complexes, parts - complexes


def _are_independent(directions: Sequence[Direction]) -> bool:
    states = list(dict.fromkeys(s for d in directions for s, _ in d))
    return sp.Matrix([[dict(d).get(s, 0) for s in states] for d in directions]).rank() == len(directions)


def _told(direction: Direction, values: Values) -> str:
    def amount(state: sp.Symbol, number: sp.Expr) -> str:
        size = number if number.xreplace(values) > 0 else -number
        return state.name if size == 1 else f"{size} {state}" if size.is_Rational else f"({size}) {state}"

    def side(sign: int) -> str:
        return " + ".join(amount(s, n) for s, n in direction if n.xreplace(values) * sign > 0) or "0"

    return f"{side(-1)} <-> {side(1)}"
