"""Splitting: from any field z' = F(z, epsilon) with a simple pole to slow and fast variables.

F = N(z) f(z)/epsilon + G(z, epsilon). The slow coordinates are first integrals of the layer problem z' = N f
(for constant N, linear ones); fast coordinates are raw states. Where no integrals are found the splitting is
coordinate-free: the leading-order reduced field is Pi G with Pi = 1 - N (Df N)^-1 Df on {f = 0}
(Fenichel 1979; Wechselberger 2020, chapter 3).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.algebra.brevity import brief_list
from gsp.algebra.centres import centres
from gsp.algebra.factorisation import factored
from gsp.algebra.first_integrals import first_integrals
from gsp.algebra.inversion import solve_for
from gsp.algebra.laurent import laurent, pole_order
from gsp.errors import DeclarationError, SplittingError
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_function
from gsp.results.card import Card
from gsp.splitting.fast_part import (
    factorised,
    inverse,
    jacobian,
    principal_part,
    reduced,
    shown,
    tidy,
)
from gsp.splitting.fast_time import divided, is_in_fast_time
from gsp.splitting.layer_rank import layer_rank
from gsp.splitting.restriction import restricted
from gsp.splitting.scaling import Scaling, scalings
from gsp.splitting.slow_coordinates import (
    explain_route,
    fast_choices,
    new_symbols,
    singular_factors,
    vanishing_factors,
)
from gsp.splitting.switches import Switch, has_switches, with_fast, without_switches
from gsp.systems.arguments import check_noun
from gsp.systems.flow import values_by_name
from gsp.systems.system import SlowFastSystem, VectorField

NON_STANDARD = (
    "No full set of first integrals of the layer problem z' = N f was found (linear, polynomial to degree 3, one "
    "quadrature)"
)


@dataclass(frozen=True, eq=False)
class Splitting(Card):
    """How a field splits into slow and fast variables.

    `system` is the standard form, or `None` when the field stays non-standard. `coordinates` maps each new symbol
    to its expression in the raw states, `inverse` each raw state to its expression in the new ones. F = N f/epsilon + G
    with `N` (n, k), `layer` f (k, 1), `drift` G (n, 1). `route` names how the slow coordinates were found.

    Where the field has switches phi(s/epsilon), `field` is the one in which v = s/epsilon is a state, `switches` says
    in place of which, and that state is among the observables. Where it has a pole of higher order, `field` is the one
    in the variables and the time of `scaling`. Where a second small parameter was named, `second` is how the flow on
    {f = 0} splits in that, to leading order.
    """

    field: VectorField
    system: SlowFastSystem | None
    coordinates: Mapping[sp.Symbol, sp.Expr]
    inverse: Mapping[sp.Symbol, sp.Expr]
    N: sp.ImmutableMatrix
    layer: sp.ImmutableMatrix
    drift: sp.ImmutableMatrix
    route: str
    nonzero: tuple[sp.Expr, ...] = ()
    rescaled: bool = False
    switches: tuple[Switch, ...] = ()
    scaling: Scaling | None = None
    second: Splitting | None = None

    @property
    def is_standard(self) -> bool:
        """Whether a standard form x' = f, epsilon y' = g was reached."""
        return self.system is not None

    @property
    def conserved(self) -> tuple[sp.Symbol, ...]:
        """The slow variables that do not move at all: conserved quantities of the field, not only of its fast part."""
        return () if self.system is None else tuple(x for x, rate in self.system.slow.items() if rate == 0)

    @cached_property
    def fast_jacobian(self) -> sp.ImmutableMatrix:
        """Df N (k, k) on {f = 0}: its eigenvalues decide normal hyperbolicity, whatever the coordinates."""
        return reduced(jacobian(self.layer, self.field.states) * self.N).as_immutable()

    @cached_property
    def projection(self) -> sp.ImmutableMatrix:
        """Pi = 1 - N (Df N)^-1 Df (n, n), valid on {f = 0}: the projection along the fast fibres."""
        Df = jacobian(self.layer, self.field.states)
        identity = sp.eye(len(self.field.states))
        return reduced(identity - self.N * inverse(self.fast_jacobian) * Df).as_immutable()

    @cached_property
    def reduced_field(self) -> sp.ImmutableMatrix:
        """Pi G at epsilon = 0 (n, 1): the leading-order reduced field in raw states, valid on {f = 0}."""
        epsilon = self.field.epsilon
        assert epsilon is not None
        drift = self.drift.applyfunc(lambda e: laurent(e, epsilon, order=0).get(0, sp.Integer(0)))
        along = inverse(self.fast_jacobian) * (jacobian(self.layer, self.field.states) * drift)
        return reduced(drift - self.N * along).as_immutable()

    def to_new(self, values: Mapping[str, float], *, epsilon: float | None = None) -> dict[str, float]:
        """New coordinates, by name, of raw values given by name; where the field has switches at a value of epsilon."""
        known = self._with_fast(values_by_name(values, what="values"), epsilon)
        return _evaluated(self.coordinates, known, self.field)

    def to_raw(self, values: Mapping[str, float]) -> dict[str, float]:
        """Raw states, by name, of new coordinates given by name."""
        return _evaluated(self.inverse, values_by_name(values, what="values"), self.field)

    def _with_fast(self, values: Mapping[str, float], epsilon: float | None) -> Mapping[str, float]:
        """Raw values with those of the switches' fast variables in place of the states that they replace."""
        return values if epsilon is None else with_fast(self.switches, values, epsilon, self.field.parameters)

    def explain(self) -> str:
        """The reasons, in words."""
        states = ", ".join(s.name for s in self.field.states)
        epsilon = self.field.epsilon
        lines = [f"Switches of {epsilon}: {switch}" for switch in self.switches]
        if self.scaling is not None:
            mu = self.scaling.original.epsilon
            lines.append(
                f"The pole in {mu} is of higher order; it is simple in scaled variables, {self.scaling}."
            )
        lines += [f"The field in ({states}) is F = N f/{epsilon} + G with"]
        if self.rescaled:
            lines.insert(0, f"The field is given in fast time; it was divided by {epsilon} to be in slow time.")
        rows = ", ".join(map(brief_list, self.N.tolist()))
        lines += [f"  f = {brief_list(self.layer)}", f"  N = [{rows}]"]
        if self.system is None:
            lines.append(
                f"{NON_STANDARD}, so the system stays non-standard. The leading-order reduced field is "
                f"Pi G = {brief_list(self.reduced_field)} on {{f = 0}}."
            )
            return "\n".join(lines)
        lines.append(self.route)
        lines += [f"  slow {x} = {self.coordinates[x]}" for x in self.system.x]
        lines += [f"  fast {y} = {self.coordinates[y]}" for y in self.system.y]
        lines += [f"Conserved: {x} = {self.coordinates[x]}, for {x}' = 0." for x in self.conserved]
        if self.nonzero:
            conditions = ", ".join(f"{e} != 0" for e in self.nonzero)
            lines.append(f"The change of coordinates is invertible where {conditions}.")
        if self.second is not None:
            lines += [f"On {{f = 0}}, to leading order in {epsilon}:", self.second.explain()]
        return "\n".join(lines)

    def __repr__(self) -> str:
        if self.system is None:
            return f"Splitting(non-standard, f = {brief_list(self.layer)})"
        slow = ", ".join(f"{x} = {self.coordinates[x]}" for x in self.system.x)
        then = "" if self.second is None else f"; then {self.second!r}"
        return f"Splitting(slow: {slow}; fast: {', '.join(y.name for y in self.system.y)}{then})"

    def __str__(self) -> str:
        return self.explain()


@np.errstate(all="ignore")
def split(field: VectorField | SlowFastSystem, *, second: str | sp.Symbol | None = None) -> Splitting:
    """Slow and fast variables of a field z' = F(z, epsilon) with a simple pole in epsilon.

    A field in fast time, F = F_0 + epsilon F_1, is first divided by epsilon. In one with switches phi(s/epsilon) a new
    variable v = s/epsilon, which is fast, takes the place of a state: `Splitting.switches` says which. One with a pole
    of higher order is split in scaled variables where the pole is simple: `Splitting.scaling` says which. With a
    `second` small parameter, a name, the flow on the critical manifold is split in that one: three time scales, of
    which `nest` gives the series. Raises `SplittingError`, naming the offending term, when no scaling makes a pole
    simple, when the fast part has no equilibria, vanishes to second order, or leaves no slow variable, and when the
    critical manifold of the first has no formula; `DegenerateError` where a time scale is hidden.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> split(VectorField({x: (y - x)/eps, y: (x - y)/eps - y}, epsilon=eps))
    Splitting(slow: p = x + y; fast: x)
    """
    if second is not None:
        found = split(field)
        if found.system is None:
            raise SplittingError(
                f"the field has no standard form, so that the flow on its critical manifold is not split in {second}.",
                "Put it into slow and fast variables first.",
            )
        return replace(found, second=split(restricted(found.system, second)))
    if isinstance(field, SlowFastSystem):
        field = field.as_field()
    check_noun(field, (VectorField, SlowFastSystem), verb="split")
    epsilon = field.epsilon
    if epsilon is None:
        raise SplittingError(
            f"the field in {', '.join(s.name for s in field.states)} has no small parameter.",
            "It can be integrated, not split. Declare it with epsilon=, the symbol of its small parameter.",
        )
    if has_switches(field):
        changed, switches = without_switches(field)
        return replace(split(changed), switches=switches)
    if has_higher_pole(field):
        return _split_scaled(field)
    if here := centres(field.rates, field.states):
        return _back_from(here, split(field.about(here)), field)
    rescaled = is_in_fast_time(field)
    field = divided(field) if rescaled else field
    layer, drift = principal_part(field)
    rank = layer_rank(layer, field)
    n = len(field.states)
    if rank == n:
        raise SplittingError(
            f"every state is fast: the fast part {shown(field, layer)} has isolated equilibria, so there is "
            "no slow variable and no slow manifold.",
            "Check which rates carry 1/epsilon. Two states that turn about one another are averaged, by `average`.",
        )
    integrals = first_integrals(layer, field.states, count=n - rank, parameters=field.parameters)
    if len(integrals) == n - rank:
        # The first choice that is invertible without roots and logarithms, whose domains are restricted.
        choices = fast_choices(integrals, layer, field, rank)
        forms = (_standard_form(field, layer, drift, integrals, fast, rescaled) for fast in choices)
        found: Splitting | None = None
        for form in forms:
            if form is not None and (found is None or not _is_restricted(form)):
                found = form
            if found is not None and not _is_restricted(found):
                break
        if found is not None:
            return found
    N, f = factorised(layer, field, rank)
    return Splitting(
        field=field,
        system=None,
        coordinates=MappingProxyType({}),
        inverse=MappingProxyType({}),
        N=N,
        layer=f,
        drift=sp.ImmutableMatrix(drift),
        route="coordinate-free",
        rescaled=rescaled,
    )


def has_higher_pole(field: VectorField) -> bool:
    """Whether the field has a pole in epsilon that is not simple."""
    epsilon = field.epsilon
    if epsilon is None or has_switches(field):
        return False
    return any(pole_order(rate, epsilon) > 1 for rate in field.rates)


def _split_scaled(field: VectorField) -> Splitting:
    """The splitting in the first scaled variables in which there is a standard form."""
    for scaling in scalings(field):
        if scaling.time > 0:
            # In a faster time what the model does stands still.
            continue
        try:
            found = split(scaling.field)
        except SplittingError:
            continue
        if found.is_standard:
            return replace(found, scaling=scaling)
    epsilon = field.epsilon
    assert epsilon is not None
    orders = {z: pole_order(rate, epsilon) for z, rate in field.equations.items()}
    state = max(orders, key=lambda z: orders[z])
    terms = sp.Add.make_args(sp.expand(field.equations[state]))
    term = max(terms, key=lambda part: pole_order(part, epsilon))
    raise SplittingError(
        f"the rate of {state} has a pole of order {orders[state]} in {epsilon}: the term {term}.",
        "Only simple poles split into two time scales, and no scaling of variables and time by small powers of "
        f"{epsilon} leaves a fast part that is hyperbolic and something slow. Where there are three time "
        f'scales take nest(scene, small=["{epsilon}", "{epsilon}"]).',
    )


def _back_from(centres: Mapping[sp.Symbol, sp.Expr], found: Splitting, field: VectorField) -> Splitting:
    """The splitting of the `field` itself, where `found` is that about its `centres`."""
    less = {s: s - c for s, c in centres.items()}
    origin = dict.fromkeys(field.states, sp.S.Zero)
    coordinates = {s: phi.xreplace(less) for s, phi in found.coordinates.items()}
    # Linear coordinates are counted from the origin: x + y, and not x + y - 2000.
    offsets = {
        s: phi.xreplace(origin)
        for s, phi in coordinates.items()
        if all(phi.diff(z).free_symbols.isdisjoint(field.states) for z in phi.free_symbols)
    }
    there = {s: s + offset for s, offset in offsets.items()}
    inverse = {z: e.xreplace(there) + centres.get(z, 0) for z, e in found.inverse.items()}
    system = found.system and SlowFastSystem(
        slow={s: rate.xreplace(there) for s, rate in found.system.slow.items()},
        fast={s: rate.xreplace(there) for s, rate in found.system.fast.items()},
        epsilon=found.system.epsilon,
        parameters=field.parameters,
        name=field.name,
        observables={o: inverse.get(o, e.xreplace(there)) for o, e in found.system.observables.items()},
    )
    return replace(
        found,
        field=divided(field) if found.rescaled else field,
        system=system,
        coordinates=MappingProxyType({s: e - offsets.get(s, 0) for s, e in coordinates.items()}),
        inverse=MappingProxyType(inverse),
        N=found.N.xreplace(less),
        layer=found.layer.xreplace(less),
        drift=found.drift.xreplace(less),
        nonzero=tuple(e.xreplace(less) for e in found.nonzero),
    )


def _standard_form(field, layer, drift, integrals, fast, rescaled) -> Splitting | None:
    states = field.states
    epsilon = field.epsilon
    names = new_symbols(field, integrals)
    # Each integral takes the place of one raw state; a state that is itself an integral keeps its own.
    coordinates = dict(zip(names, integrals))
    kept = {*fast, *coordinates}
    unknown = [z for z in states if z not in kept]
    equations = {symbol: phi for symbol, phi in coordinates.items() if symbol != phi}
    solved = solve_for(unknown, equations)
    if solved is None:
        return None
    inverse = {z: solved.get(z, z) for z in states}
    slow = {}
    for symbol, phi in coordinates.items():
        moving = phi.free_symbols
        raw = sp.Add(*[sp.diff(phi, z) * rate for z, rate in zip(states, drift) if z in moving])
        slow[symbol] = tidy(tidy(raw).xreplace(solved))
    place = {z: i for i, z in enumerate(states)}
    fast_rates = {}
    for y in fast:
        i = place[y]
        fast_rates[y] = tidy(layer[i].xreplace(solved)) + sp.Add(
            *[epsilon * term for term in sp.Add.make_args(tidy(drift[i].xreplace(solved)))]
        )
    order = sorted(slow, key=lambda s: min(place[z] for z in coordinates[s].free_symbols if z in place))
    observables = {z: e for z, e in inverse.items() if z not in kept}
    observables |= {o: e.xreplace(inverse) for o, e in field.observables.items()}
    system = SlowFastSystem(
        slow={s: slow[s] for s in order},
        fast=fast_rates,
        epsilon=epsilon,
        parameters=field.parameters,
        name=field.name,
        observables=observables,
    )
    N, f = factorised(layer, field, len(fast))
    gradient = jacobian([coordinates[s] for s in equations], unknown)
    # A number is no condition.
    determinant = factored(gradient.det(method="berkowitz")) if gradient.free_symbols else sp.Integer(1)
    return Splitting(
        field=field,
        system=system,
        coordinates=MappingProxyType({**{s: coordinates[s] for s in order}, **{y: y for y in fast}}),
        inverse=MappingProxyType(inverse),
        N=N,
        layer=f,
        drift=sp.ImmutableMatrix(drift),
        route=explain_route(coordinates, states, field.epsilon),
        nonzero=tuple(dict.fromkeys((*vanishing_factors(determinant), *singular_factors(integrals, states)))),
        rescaled=rescaled,
    )


def _is_restricted(splitting: Splitting) -> bool:
    pieces = {p for e in splitting.inverse.values() for p in e.atoms(sp.log, sp.atanh, sp.sign, sp.Pow)}
    return any(not p.is_Pow or (p.exp.is_Rational and not p.exp.is_Integer) for p in pieces)


def _evaluated(mapping: Mapping[sp.Symbol, sp.Expr], values: Mapping[str, float], field: VectorField):
    symbols = sorted({s for e in mapping.values() for s in e.free_symbols} - set(field.parameters), key=str)
    missing = [s.name for s in symbols if s.name not in values]
    if missing:
        raise DeclarationError(f"no value for {', '.join(missing)}.", "Give each a number.", got=dict(values))
    function = compile_function(tuple(mapping.values()), arguments=symbols, parameters=tuple(field.parameters))
    numbers = function(np.array([values[s.name] for s in symbols], dtype=float), compile_flow(field).constants)
    return {symbol.name: float(number) for symbol, number in zip(mapping, numbers)}
