"""Coordinates of a standard form: which raw states are fast beside first integrals, their names and their domain."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import sympy as sp

from gsp.algebra.elimination_over_rationals import at_point, generic_point, independent_columns
from gsp.algebra.factorisation import factored
from gsp.splitting.fast_part import jacobian
from gsp.systems.system import VectorField


def fast_choices(integrals, layer, field: VectorField, rank: int) -> Iterator[tuple[sp.Symbol, ...]]:
    """Sets of raw states to serve as fast coordinates, best first: those the layer problem depends on."""
    states = field.states
    gradient = jacobian(integrals, states)
    own = {phi for phi in integrals if phi in states}
    used = set().union(*(component.free_symbols for component in layer))
    values = at_point(gradient, {**generic_point(states), **field.parameters})
    # More sets of fast variables are not compared where first integrals are nonlinear: one is chosen by
    # elimination.
    if values is not None and (gradient.free_symbols.isdisjoint(states) or math.comb(len(states), rank) > 300):
        # What is eliminated is a basis of the columns: first what had better not be fast.
        order = sorted(
            range(len(states)), key=lambda i: (states[i] not in own, states[i] in used, layer[i] != 0, -i)
        )
        eliminated = independent_columns(values, order)
        yield tuple(z for i, z in enumerate(states) if i not in set(eliminated))
        return
    candidates = []
    for chosen in itertools.combinations(range(len(states)), rank):
        if any(states[i] in own for i in chosen):
            continue
        others = [i for i in range(len(states)) if i not in chosen]
        determinant = factored(gradient[:, others].det(method="berkowitz"))
        at_values = determinant.subs(dict(field.parameters))
        if determinant == 0 or at_values == 0:
            continue
        used = sum(any(component.has(states[i]) for component in layer) for i in chosen)
        moving = sum(layer[i] != 0 for i in chosen)
        constant = not determinant.has(*states)
        candidates.append(((-constant, -used, -moving), chosen, determinant))
    for _, chosen, _determinant in sorted(candidates, key=lambda c: c[0]):
        yield tuple(states[i] for i in chosen)


def new_symbols(field: VectorField, integrals: Sequence[sp.Expr]) -> list[sp.Symbol]:
    """A raw state that is an integral keeps its name; the others are p, or p1, p2, ..."""
    taken = {str(s) for s in (*field.states, *field.parameters, *field.observables, field.epsilon)}
    states = set(field.states)
    new = [phi for phi in integrals if phi not in states]
    stems = itertools.chain("pqruxyz", (f"slow{i}" for i in itertools.count()))
    for stem in stems:
        names = [stem] if len(new) == 1 else [f"{stem}{i + 1}" for i in range(len(new))]
        if not taken & set(names):
            break
    fresh = iter(sp.Symbol(name) for name in names)
    return [phi if phi in states else next(fresh) for phi in integrals]


def vanishing_factors(determinant: sp.Expr) -> tuple[sp.Expr, ...]:
    """What has to be nonzero for `determinant` to be: its factors without numbers, powers and exponentials."""
    factors = [f.as_base_exp()[0] if f.is_Pow else f for f in sp.Mul.make_args(determinant)]
    return tuple(f for f in factors if not f.is_number and not isinstance(f, sp.exp))


def singular_factors(integrals: Sequence[sp.Expr], states: Sequence[sp.Symbol]) -> Iterator[sp.Expr]:
    """What of the `states` has to be nonzero for the integrals to be regular: in logarithms and denominators."""
    for phi in integrals:
        within = {p.args[0] for p in phi.atoms(sp.log)}
        within |= {p.base for p in phi.atoms(sp.Pow) if p.exp.could_extract_minus_sign()}
        for expression in sorted(within, key=sp.default_sort_key):
            real = {s: sp.Dummy(s.name, real=True) for s in expression.free_symbols}
            factors = [f for f in vanishing_factors(factored(expression)) if f.has(*states)]
            yield from (f for f in factors if not f.xreplace(real).is_nonzero)


def explain_route(
    coordinates: Mapping[sp.Symbol, sp.Expr], states: Sequence[sp.Symbol], epsilon: sp.Symbol
) -> str:
    """How the coordinates were come by: not at all, or as first integrals, linear or not."""
    new = {s: phi for s, phi in coordinates.items() if s != phi}
    if not new:
        return f"The field is in standard form already: the rates that carry 1/{epsilon} are the fast ones."
    many = len(new) > 1
    integral = "are {} first integrals" if many else "is a {} first integral"
    listed = ", ".join(s.name for s in new)
    if jacobian(new.values(), states).free_symbols.isdisjoint(states):
        return f"The directions N are constant, so {listed} {integral.format('linear')} of the layer problem:"
    return (
        f"The directions N depend on the state; {listed} {integral.format('nonlinear')} of the layer problem:"
    )
