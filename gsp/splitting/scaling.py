"""Scalings: powers of a small parameter by which variables and time are measured, so that it stands in simple poles.

z_i = mu^(a_i) Z_i and t = mu^c T turn a term mu^r z^m of the rate of z_i into one of mu^(r + m.a - a_i + c). Wanted are
small exponents, in halves, with which the least power is -s, all others are multiples of it, and epsilon = mu^s is a
small parameter: the fast rows' leading terms are in balance, and their linear part is invertible (Bender and Orszag,
section 3.4). Linear forms that a pole makes stiff, and their rates, take the place of a state first: of
k (q1 - q2)/mu^2 it is q1 - q2, whose scaled value is the spring's force.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.algebra.centres import centres
from gsp.algebra.elimination_over_rationals import generic_point, independent_rows, numbers_at
from gsp.algebra.factorisation import factored
from gsp.algebra.inversion import solve_for
from gsp.algebra.laurent import laurent, pole_order
from gsp.errors import DeclarationError, SplittingError
from gsp.results.card import Card
from gsp.results.table import Names
from gsp.splitting.fast_part import jacobian
from gsp.splitting.layer_rank import layer_rank
from gsp.systems.arguments import check_noun
from gsp.systems.flow import Portable, Values
from gsp.systems.system import VectorField

# Exponents and powers of terms that are looked at, 32 MB of them.
NUMBERS = 4_000_000


@dataclass(frozen=True, eq=False, repr=False)
class Scaling(Portable, Card):
    """Scaled variables in which a field has a simple pole: `field`, in its own small parameter and time.

    `states` maps each state of `field` to what it is in the states of `original`, mu among them, `inverse` those to the
    states of `field` and its epsilon. `exponents`, `time` and `power` are those of mu in each of them, in time and in
    epsilon.
    """

    original: VectorField
    field: VectorField
    states: Mapping[sp.Symbol, sp.Expr]
    inverse: Mapping[sp.Symbol, sp.Expr]
    exponents: Mapping[sp.Symbol, sp.Rational]
    time: sp.Rational
    power: sp.Rational

    def __str__(self) -> str:
        mu, small = self.original.epsilon, self.field.epsilon
        assert small is not None
        told = [f"{new} = {e}" for new, e in self.states.items() if new != e]
        told += [f"{small} = {sp.Pow(mu, self.power)}"] if small != mu else []
        told += [f"time in units of {sp.Pow(mu, self.time)}"] if self.time else []
        fast = [z.name for z, rate in self.field.equations.items() if pole_order(rate, small)]
        return f"{', '.join(told) or 'no scaling'}; fast: {', '.join(fast)}"

    def __repr__(self) -> str:
        return f"Scaling({self})"


def scalings(field: VectorField) -> tuple[Scaling, ...]:
    """Scalings of the variables and of time that bring out a small parameter, those that keep most terms first.

    `field` has a small parameter mu, in poles of any order. Each suggestion has a simple pole, and an invertible linear
    part of the fast rates by the fast variables; it is a distinguished limit, of whose leading terms no other has all
    and more. Empty where no small exponents give one. States that are far from the origin are scaled about their
    centres, those within a function are not scaled. Raises `DeclarationError` for a field without a small parameter.

    >>> x, v, mu = sp.symbols("x v mu")
    >>> scalings(VectorField({x: v, v: -x/mu**2 - v/mu**2}, epsilon=mu))[0]
    Scaling(mu_2 = mu**2; fast: v)
    """
    check_noun(field, VectorField, verb="scalings")
    mu = field.epsilon
    if mu is None:
        raise DeclarationError(
            "the field has no small parameter whose powers could scale it.", "Declare it with epsilon=."
        )
    return _found(field)


# A command splits a field and makes a scene of it, and each asks for the scaling.
@lru_cache(maxsize=8)
def _found(field: VectorField) -> tuple[Scaling, ...]:
    """The scalings in the states as they are; where there are none, with stiff forms in place of some."""
    assert field.epsilon is not None
    here = centres(field.rates, field.states)
    own = field.about(here)
    for changed in _coordinates(own):
        terms = _Terms.of(changed, field.epsilon)
        found = () if terms is None else tuple(_scaled(own, changed, terms))
        if found:
            return tuple(_back_from(here, each, field) for each in found)
    return ()


def _back_from(here: Mapping[sp.Symbol, sp.Rational], scaling: Scaling, field: VectorField) -> Scaling:
    """The scaling of the `field` itself, where this is that about its centres; what is not scaled is as it was."""
    if not here:
        return scaling
    made, counted = scaling.field, {z: z - c for z, c in here.items()}
    inverse = {z: e.xreplace(counted) + here.get(z, 0) for z, e in scaling.inverse.items()}
    observables = {o: inverse.get(o, e.xreplace(counted)) for o, e in made.observables.items()}
    equations = {z: e.xreplace(counted) for z, e in made.equations.items()}
    states = {new: e if new == e else e.xreplace(counted) for new, e in scaling.states.items()}
    return replace(
        scaling,
        original=field,
        field=VectorField(
            equations, epsilon=made.epsilon, parameters=made.parameters, name=made.name, observables=observables
        ),
        states=MappingProxyType(states),
        inverse=MappingProxyType(inverse),
    )


class _Coordinates(NamedTuple):
    """States, some of which are linear `forms` in place of raw ones, their rates, and the raw states in them."""

    rates: Values
    forms: Values
    inverse: Values


def _coordinates(field: VectorField) -> Iterator[_Coordinates]:
    """The states as they are, and with the linear forms that a pole makes stiff in place of some."""
    yield _Coordinates(dict(field.equations), {}, {})
    forms = _stiff_forms(field)
    if not forms:
        return
    stand_in = {z: sp.Dummy(z.name) for z in forms}
    solved = solve_for(list(forms), {stand_in[z]: form for z, form in forms.items()})
    if solved is None:
        return
    rates = {}
    for z, rate in field.equations.items():
        if z in forms:
            rate = sp.Add(*[sp.diff(forms[z], other) * own for other, own in field.equations.items()])
        rates[stand_in.get(z, z)] = rate.xreplace(solved)
    yield _Coordinates(rates, {stand_in[z]: form for z, form in forms.items()}, solved)


def _stiff_forms(field: VectorField) -> dict[sp.Symbol, sp.Expr]:
    """Linear forms of several states that are factors of poles, and their rates, each by the state it replaces."""
    mu, states = field.epsilon, field.states
    assert mu is not None
    waiting: list[sp.Expr] = []
    for rate in field.rates:
        for k, part in laurent(rate, mu, order=-1).items() if pole_order(rate, mu) else ():
            assert k < 0
            waiting += [f.as_base_exp()[0] for f in sp.Mul.make_args(factored(part))]
    forms: dict[sp.Symbol, sp.Expr] = {}
    seen: list[sp.Expr] = []
    while waiting:
        form = waiting.pop(0)
        moving = [z for z in states if form.has(z)]
        slopes = [sp.diff(form, z) for z in moving]
        if len(moving) < 2 or any(slope.has(*states, mu) for slope in slopes):
            continue
        form = sp.expand(form / slopes[0])
        free = [z for z in moving if z not in forms]
        if not free or form in seen:
            continue
        seen.append(form)
        forms[free[-1]] = form
        rate = sp.expand(sp.Add(*[slope / slopes[0] * field.equations[z] for z, slope in zip(moving, slopes)]))
        waiting += [] if pole_order(rate, mu) else [rate]
    return forms


class _Terms(NamedTuple):
    """Terms of all rates: `rows` they belong to, half `powers` of mu, exponents of the states (k, n), coefficients."""

    rows: np.ndarray
    powers: np.ndarray
    exponents: np.ndarray
    coefficients: list[sp.Expr]
    fixed: frozenset[int]

    @classmethod
    def of(cls, changed: _Coordinates, mu: sp.Symbol) -> _Terms | None:
        """None where mu stands in something that is no power of it, and for rates that are too long."""
        states = tuple(changed.rates)
        place = {z: i for i, z in enumerate(states)}
        rows, powers, exponents, coefficients, fixed = [], [], [], [], set()
        # Rates with more operations are not multiplied out into terms.
        if sum(sp.count_ops(rate) for rate in changed.rates.values()) > 2000:
            return None
        for i, rate in enumerate(changed.rates.values()):
            for term in sp.Add.make_args(sp.expand(rate)):
                power, own, rest = 0, [0] * len(states), []
                for factor in sp.Mul.make_args(term):
                    base, exponent = factor.as_base_exp()
                    if base in place and exponent.is_Integer:
                        own[place[base]] += int(exponent)
                    elif base == mu and (2 * exponent).is_Integer:
                        power += int(2 * exponent)
                    elif factor.has(mu):
                        return None
                    else:
                        rest.append(factor)
                        fixed |= {place[z] for z in factor.free_symbols & place.keys()}
                if term != 0:
                    rows.append(i)
                    powers.append(power)
                    exponents.append(own)
                    coefficients.append(sp.Mul(*rest))
        shape = (len(rows), len(states))
        return cls(
            np.array(rows), np.array(powers), np.array(exponents).reshape(shape), coefficients, frozenset(fixed)
        )


def _choices(n: int, fixed: frozenset[int], most: int) -> np.ndarray:
    """Exponents (k, n) in halves, at most so many, the fewest first."""
    free = [i for i in range(n) if i not in fixed]
    rows = [np.zeros((1, n), dtype=int)]
    for size in range(1, min(4, len(free)) + 1):
        # Exponents are counted in halves of a power, up to mu^2 either way, of so many variables at once.
        values = np.array(list(itertools.product((-1, 1, -2, 2, -3, 3, -4, 4), repeat=size)))
        for chosen in itertools.combinations(free, size):
            most -= len(values)
            if most < 0:
                return np.concatenate(rows)
            block = np.zeros((len(values), n), dtype=int)
            block[:, chosen] = values
            rows.append(block)
    return np.concatenate(rows)


def _scaled(field: VectorField, changed: _Coordinates, terms: _Terms) -> Iterator[Scaling]:
    """The distinguished limits in these coordinates, those that keep most terms first."""
    n, count = len(changed.rates), len(terms.rows)
    if not count:
        return
    choices = _choices(n, terms.fixed, NUMBERS // (n + count))
    # Every form is there to be scaled.
    forms = [i for i, z in enumerate(changed.rates) if z in changed.forms]
    choices = choices[(choices[:, forms] != 0).all(axis=1)]
    if not len(choices):
        return
    own = terms.exponents.copy()
    own[np.arange(count), terms.rows] -= 1
    powers = terms.powers + choices @ own.T
    least = powers.min(axis=1, keepdims=True)
    unit = np.gcd(np.gcd.reduce(powers - least, axis=1), np.gcd.reduce(choices, axis=1))
    balanced = powers == least
    fast = np.stack([(balanced & (terms.rows == i)).any(axis=1) for i in range(n)], axis=1)
    kept = powers <= least + unit[:, None]
    time = -unit - least[:, 0]
    possible = (unit > 0) & (fast.sum(axis=1) < n) & (time % np.maximum(unit, 1) == 0)
    # States that stand still to leading order, though they have a rate.
    still = np.sum([~(kept & (terms.rows == i)).any(axis=1) for i in set(terms.rows.tolist())], axis=0)
    size = np.abs(choices).sum(axis=1) + np.abs(time)
    ranks = (size, -balanced.sum(axis=1), (choices != 0).sum(axis=1), -kept.sum(axis=1), still)
    order = np.lexsort(ranks)
    limits: list[np.ndarray] = []
    tried = 0
    for i in order[possible[order]]:
        # Of another with these leading terms and more it is a special case.
        if any((kept[i] <= limit).all() for limit in limits):
            continue
        scaling = _made(field, changed, terms, choices[i], int(unit[i]), int(time[i]))
        tried += 1
        if scaling is not None and _balances(scaling):
            limits.append(kept[i])
            if not _is_given(scaling):
                yield scaling
        if tried == 12:
            return


def _is_given(scaling: Scaling) -> bool:
    return not scaling.time and scaling.power == 1 and not any(scaling.exponents.values())


def _balances(scaling: Scaling) -> bool:
    """Whether the fast rows' leading linear part is invertible by the fast variables, also where these rows vanish."""
    epsilon, states = scaling.field.epsilon, scaling.field.states
    assert epsilon is not None
    layer = [laurent(rate, epsilon, order=-1).get(-1, sp.Integer(0)) for rate in scaling.field.rates]
    fast = [z for z, part in zip(states, layer) if part != 0]
    matrix = jacobian([part for part in layer if part != 0], fast)
    values = numbers_at(matrix, generic_point((*states, *scaling.field.parameters)))
    if values is None or len(independent_rows(values)) < len(fast):
        return False
    try:
        return layer_rank(layer, scaling.field) == len(fast)
    except SplittingError:
        return False


def _made(
    field: VectorField, changed: _Coordinates, terms: _Terms, choice: np.ndarray, unit: int, time: int
) -> Scaling | None:
    """The scaling with the exponents `choice` and `time` in halves, and epsilon = mu^(unit/2)."""
    mu, old = field.epsilon, tuple(changed.rates)
    assert mu is not None
    observables = field.observables
    if 2 % unit and any(e.has(mu) for e in observables.values()):
        return None
    free = Names(s.name for s in (*field.states, *field.parameters, *observables, mu))
    epsilon = mu if unit == 2 else sp.Symbol(free(f"{mu}_{sp.Rational(unit, 2)}".replace("/", "_")))
    replaced = dict(zip(changed.forms, changed.inverse))
    scaled = [z in changed.forms or choice[i] != 0 for i, z in enumerate(old)]
    new = {
        z: sp.Symbol(free(f"{replaced.get(z, z).name}_scaled")) if scaled[i] else z for i, z in enumerate(old)
    }
    steps = [int(a) // unit for a in choice]
    rates: dict[sp.Symbol, list[sp.Expr]] = {new[z]: [] for z in old}
    for row, power, exponents, coefficient in zip(
        terms.rows, terms.powers, terms.exponents, terms.coefficients
    ):
        whole = int(power + exponents @ choice - choice[row] + time) // unit
        states = [new[z] ** int(m) for z, m in zip(old, exponents) if m]
        rates[new[old[row]]].append(sp.Mul(coefficient, epsilon**whole, *states))
    values = {z: new[z] * epsilon ** steps[i] for i, z in enumerate(old)}
    inverse = {z: values[z] for z in old if z in field.states}
    inverse |= {z: e.xreplace(values) for z, e in changed.inverse.items()}
    small = {} if unit == 2 else {mu: epsilon ** (2 // unit)} if not 2 % unit else {}
    watched = {z: e for z, e in inverse.items() if e != z}
    watched |= {o: e.xreplace({**small, **inverse}) for o, e in observables.items()}
    made = VectorField(
        {z: sp.Add(*parts) for z, parts in rates.items()},
        epsilon=epsilon,
        parameters=field.parameters,
        name=field.name,
        observables=watched,
    )
    halves = {new[z]: sp.Rational(int(a), 2) for z, a in zip(old, choice)}
    return Scaling(
        original=field,
        field=made,
        states=MappingProxyType({new[z]: changed.forms.get(z, z) / mu ** halves[new[z]] for z in old}),
        inverse=MappingProxyType({z: inverse[z] for z in field.states}),
        exponents=MappingProxyType(halves),
        time=sp.Rational(time, 2),
        power=sp.Rational(unit, 2),
    )
