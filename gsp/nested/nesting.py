"""Three time scales: a slow manifold within a slow manifold, of a scene with two small parameters.

x' = f, delta y' = g, epsilon delta z' = h: the fast z slaves to C1 = {h = 0}, and on it y to C2 = {g = 0} within C1
(Cardin and Teixeira, Fenichel theory for multiple time scale singular perturbation problems, 2017). The flow on the
slow manifold over C1, a series in epsilon, is a field with the small parameter delta. Both are put on one ray,
epsilon -> sigma epsilon and delta -> sigma delta, so that its series in sigma has homogeneous polynomials in epsilon
and delta for coefficients: the double series.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.algebra.brevity import brief
from gsp.algebra.factorisation import factor_list, factored, factors
from gsp.algebra.laurent import laurent, misplaced_epsilon, pole_order
from gsp.errors import BudgetError, DegenerateError, SplittingError
from gsp.integration.reduced_flow import ReducedFlow
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import compile_over
from gsp.nested.refusals import asked, hidden_scale, refuse_other_way, refuse_values, second_of
from gsp.results.drawn import Drawn
from gsp.results.table import Names
from gsp.scenes.scene import Scene
from gsp.scenes.small_parameter import BOOKKEEPING, take_small, without_small
from gsp.scenes.study import Study, study
from gsp.slow.composition import compose
from gsp.slow.coordinates import set_apart
from gsp.slow.series import SeriesManifold
from gsp.systems.arguments import check_noun
from gsp.systems.declaration import exact
from gsp.systems.flow import Portable, check_order
from gsp.systems.system import SlowFastSystem, VectorField

Powers = tuple[int, int]
Values = dict[sp.Symbol, sp.Expr]


@dataclass(frozen=True, eq=False, repr=False)
class Nesting(Portable, Drawn):
    """A scene with three time scales, reduced twice.

    `small` are the small parameters, the one of the fastest scale first. `first` is the study of the scene in the first
    of them: its branch is C1. `second` is the study of the flow on the slow manifold over C1, whose small parameter
    sigma scales both, first -> sigma^w first, w the `weight`, and second -> sigma second; sigma = 1 is the model, and
    its branch is C2. All verbs take `first` and `second` as any study. `in_fast_time` says that no rate has a pole in
    the second, so that they are divided by sigma.
    """

    first: Study
    second: Study
    small: tuple[sp.Symbol, sp.Symbol]
    weight: int
    order: int
    in_fast_time: bool

    @property
    def scene(self) -> Scene:
        """The scene that was reduced; its small parameter is the first."""
        return self.first.scene

    @cached_property
    def ray(self) -> VectorField:
        """The whole field with both parameters on the ray; all new coordinates are among its observables."""
        splitting, second = self.first.splitting, self.second.splitting
        # In slow time, which the field of a splitting is in.
        system = self.scene.system if splitting is None else splitting.field
        ray = _Ray(*self.small, self.second.system.epsilon, self.weight, self.order)
        new = {} if splitting is None else {s: e for s, e in splitting.coordinates.items() if s != e}
        assert second is not None
        known = {*system.states, *new}
        # A coordinate of C1 itself, y0 in place of y, is no function of the state off it.
        own = {*self.first.system.states, *system.parameters}
        new |= {
            s: e.xreplace(new)
            for s, e in second.coordinates.items()
            if s not in known and e.free_symbols <= own
        }
        slower = ray.sigma if self.in_fast_time else sp.Integer(1)
        return VectorField(
            {z: ray.put(rate) / slower for z, rate in zip(system.states, system.rates)},
            epsilon=ray.sigma,
            parameters={**system.parameters, ray.epsilon: exact(self.scene.epsilon)},
            name=system.name,
            observables={o: ray.put(e) for o, e in {**new, **system.observables}.items()},
        )

    @cached_property
    def series(self) -> SeriesManifold:
        """The slow manifold over C2 in powers of sigma, through `order`."""
        return _series(self.second, self.order)

    @cached_property
    def manifold(self) -> Mapping[Powers, Mapping[sp.Symbol, sp.Expr]]:
        """Coefficients of first^i second^j, by (i, j), of all variables that are not slow, without those that are 0."""
        others = {o: e for o, e in self.second.system.observables.items() if o in self.first.system.states}
        fast = compose(self.series, others)
        rows = [{**h.as_dict(), **more.as_dict()} for h, more in zip(self.series.coefficients, fast)]
        return self._by_powers(rows)

    @cached_property
    def reduced_field(self) -> Mapping[Powers, Mapping[sp.Symbol, sp.Expr]]:
        """Coefficients of first^i second^j, by (i, j), of the slow variables' rates, without those that are 0."""
        return self._by_powers([f.as_dict() for f in self.series.reduced_field])

    def reduced(self, order: int) -> ReducedFlow:
        """The flow on the slow manifold over C2 through `order` in sigma; at sigma = 1 it is that of the model."""
        check_order(order)
        return self.second.reduced(order)

    @cached_property
    def alone(self) -> Mapping[str, Study]:
        """The scene in each of its two small parameters alone, by name: the other stays, or the first's ratio to the
        power of the second beside which it is small.
        """
        first, second = self.small
        plain = without_small(self.scene)
        system, beside = plain.system, second ** (self.weight - 1)
        ratio = system.parameters[first] / beside.xreplace(dict(system.parameters))
        field = VectorField(
            {z: rate.xreplace({first: first * beside}) for z, rate in zip(system.states, system.rates)},
            parameters={**system.parameters, first: ratio},
            name=system.name,
        )
        other = take_small(replace(plain, system=field, claims={}), parameter=second.name)
        return MappingProxyType({first.name: self.first, second.name: study(other)})

    @cached_property
    def watched(self) -> list[str]:
        """Names of what is slow and known along runs of `ray` and of the reduced flows."""
        known = {*self.ray.states, *self.ray.observables}
        slow = [x.name for x in self.second.system.x if x in known]
        return slow or [x.name for x in self.first.system.x]

    def whole(self, point: Mapping[str, float], sigma: float) -> dict[str, float]:
        """The state of the whole field, by name, on the slow manifold over C1 at a `point` of `second`, by name."""
        system = self.second.system
        values = compile_over(system, tuple(self._raw.values()))(
            np.array([point[s.name] for s in system.states]), parameter_vector(system, sigma)
        )
        return {z.name: float(value) for z, value in zip(self._raw, values)}

    @cached_property
    def _raw(self) -> Values:
        """The raw states in the variables of `second`."""
        splitting, known = self.first.splitting, dict(self.second.system.observables)
        states = self.first.system.states
        raw = {z: z for z in states} if splitting is None else splitting.inverse
        return {z: e.xreplace(known) for z, e in raw.items()}

    def _by_powers(self, rows: Iterable[Values]) -> Mapping[Powers, Mapping[sp.Symbol, sp.Expr]]:
        first, second = self.small
        # What vanishes on an implicit C2, and all multiples of it.
        held = [factors(e, self.second.system.y) for e in self.second.branch.equations]
        gone = {each[0] for each in held if len(each) == 1}
        found: dict[Powers, dict[sp.Symbol, sp.Expr]] = {}
        for n, row in enumerate(rows):
            for symbol, value in row.items():
                # Of the degree n in sigma, so that the power of the first says that of the second.
                for i, coefficient in laurent(value, first, order=n).items():
                    told = factored(coefficient.xreplace({second: sp.Integer(1)}))
                    if gone.isdisjoint(e for e, _ in factor_list(told)[1]):
                        found.setdefault((i, n - self.weight * i), {})[symbol] = told
        return MappingProxyType(
            {k: MappingProxyType(found[k]) for k in sorted(found, key=lambda k: (sum(k), k))}
        )

    @property
    def gaps(self) -> Mapping[str, float]:
        """The gaps of both manifolds in slow time, in which they can be compared."""
        studies = {"C1": self.first, "C2": self.second}
        return {name: each.hyperbolicity.gap / each.scene.epsilon for name, each in studies.items()}

    def as_dict(self) -> dict[str, object]:
        """Both manifolds with their kinds, and the double series, as plain values."""
        studies = {"C1": self.first, "C2": self.second}
        series = {"manifold": self.manifold, "reduced_field": self.reduced_field}
        return {
            "small": [s.name for s in self.small],
            **{name: str(study_.branch) for name, study_ in studies.items()},
            "kinds": {name: str(study_.hyperbolicity.kind) for name, study_ in studies.items()},
            **{
                name: [
                    {"powers": list(k), **{s.name: str(e) for s, e in row.items()}} for k, row in part.items()
                ]
                for name, part in series.items()
            },
        }

    def explain(self) -> str:
        """What is fast, what is slow, and on which manifolds, in words."""
        first, second = self.small
        fastest = ", ".join(y.name for y in self.first.system.y)
        middle = ", ".join(y.name for y in self.second.system.y)
        slow = ", ".join(x.name for x in self.second.system.x)
        beside = "" if self.weight == 1 else f", where {first} is small beside {second ** (self.weight - 1)}"
        lines = [
            f"Three time scales, of {first} and {second}{beside}: {fastest} the fastest, then {middle}, then {slow}.",
            f"  C1: {self.first.branch}",
            f"  C2, within C1: {self.second.branch}",
        ]
        renamed = set_apart(self.first.series(0).chart)
        lines += [f"  {new} is {old} on C1, one of the coordinates there" for old, new in renamed.items()]
        if not self.second.branch.is_explicit:
            be = "is" if len(self.second.system.y) == 1 else "are"
            lines.append(
                f"  {middle} on the right of what follows {be} of the point of C2 over {slow}, on the left of the slow "
                "manifold"
            )
        for study_, name in ((self.first, "C1"), (self.second, "C2")):
            new = {} if study_.splitting is None else study_.splitting.coordinates
            told = [f"{s} = {e}" for s, e in new.items() if s != e]
            lines += [f"  new coordinates on the way to {name}: {', '.join(told)}"] if told else []
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"Nesting({self.first.branch}; {self.second.branch})"

    def __str__(self) -> str:
        lines = [self.explain()]
        for parts, prime in ((self.manifold, ""), (self.reduced_field, "'")):
            names = dict.fromkeys(s for row in parts.values() for s in row)
            for s in names:
                terms = [self._term(k, row[s]) for k, row in parts.items() if s in row]
                lines.append(f"  {s}{prime} = {' + '.join(terms)} + ...")
        return "\n".join(lines)

    def _term(self, powers: Powers, coefficient: sp.Expr) -> str:
        power, told = sp.Mul(*[symbol**k for symbol, k in zip(self.small, powers)]), brief(coefficient)
        if 1 in (power, coefficient):
            return told if power == 1 else str(power)
        is_plain = not coefficient.is_Add and not coefficient.could_extract_minus_sign()
        return f"{power}*{told}" if is_plain else f"{power}*({told})"


def nest(scene: Scene, *, small: Iterable[str | Iterable[str]] | None = None, order: int = 2) -> Nesting:
    """The slow manifold within the slow manifold of a scene with two small parameters, and the flow on it.

    `small` names the two, that of the fastest scale first; those that the scene names where none are given. In place of
    a name there may be several, of parameters that vanish in proportion: a special value and one on it, as
    `small_parameters` finds them. One name twice is a parameter that stands in poles of the orders one and two. Series
    and reduced flows come through the total `order` in the two. Raises `SplittingError`, naming them, where they are
    nested the other way round, and where the leading nested reduction is degenerate: a time scale is hidden then, which
    depends on how the two are related; and what the stages raise.

    >>> z, y, x, eps, delta = sp.symbols("z y x epsilon delta")
    >>> field = VectorField({z: -z, y: (z - y)/delta, x: (y - x)/(eps*delta)}, epsilon=eps, parameters={delta: 0.1})
    >>> scene = Scene(field, {"z": (0, 1), "y": (0, 1)}, {"z": 1, "y": 1, "x": 1}, (0, 1), 0.1)
    >>> print(nest(scene, small=["epsilon", "delta"], order=1).manifold[0, 1])
    {y: z, x: z}
    """
    check_noun(scene, Scene, verb="nest")
    check_order(order)
    scene, *names = asked(scene, small)
    first_scene = scene if str(scene.system.epsilon) == names[0] else take_small(scene, parameter=names[0])
    second = second_of(first_scene, names[1])
    first = study(first_scene)
    epsilon = first.system.epsilon
    refuse_other_way(first, second)
    in_fast_time = not any(pole_order(rate, second) for rate in first.system.slow.values())
    series = _series(first, order + in_fast_time)
    poles = [max(pole_order(rate, second) for rate in row) for row in series.coordinate_field]
    if poles[0] > 1:
        raise SplittingError(
            f"the flow on {first.branch} has a pole of order {poles[0]} in {second}, which is a fourth time scale.",
            "Only simple poles split into two time scales.",
        )
    if not in_fast_time and not poles[0]:
        raise hidden_scale(
            first,
            second,
            f"no rate carries 1/{second} any more on {first.branch}, where the leading terms cancel",
        )
    # The terms of the rates stay at a simple pole, and those of the manifold vanish with sigma.
    bent = [max(pole_order(e, second) for e in row) + 1 for row in series.coefficients]
    weight = max([1, *(-(-max(p, q) // k) for k, (p, q) in enumerate(zip(poles, bent)) if k)])
    refuse_values(first_scene, second, weight)
    ray = _Ray(epsilon, second, _new_symbol(first.system), weight, order)
    found = Nesting(
        first=first,
        second=study(_on_first(first, series, ray, in_fast_time)),
        small=(epsilon, second),
        weight=weight,
        order=order,
        in_fast_time=in_fast_time,
    )
    try:
        system = found.second.system
    except DegenerateError as error:
        raise hidden_scale(first, second, f"on {first.branch} {error.fact}") from None
    for symbol, rate in (*system.slow.items(), *system.fast.items()):
        if laurent(rate, ray.sigma, order=0).get(0, sp.Integer(0)).has(epsilon):
            fact = f"the rate of {symbol} carries {epsilon}/{second} on {first.branch}, and no 1/{second}"
            raise hidden_scale(first, second, fact)
    return found


def _series(study: Study, order: int) -> SeriesManifold:
    try:
        return study.series(order)
    except BudgetError as error:
        # Both small parameters stay symbols, so that values in place of the others are no remedy.
        raise BudgetError(
            f"{error.fact}.", "Take a lower order, or fewer variables.", limit=error.limit, value=error.spent
        ) from None


@dataclass(frozen=True)
class _Ray:
    """epsilon -> sigma^weight epsilon, delta -> sigma delta; what is on it is known through sigma^order."""

    epsilon: sp.Symbol
    delta: sp.Symbol
    sigma: sp.Symbol
    weight: int
    order: int

    def put(self, expression: sp.Expr) -> sp.Expr:
        """`expression` on the ray."""
        return expression.xreplace(
            {self.epsilon: self.sigma**self.weight * self.epsilon, self.delta: self.sigma * self.delta}
        )

    def total(self, parts: Iterable[sp.Expr], *, slower: bool = False) -> sp.Expr:
        """The sum of epsilon^k `parts` on the ray, through its order; divided by sigma where it is to be `slower`."""
        whole = sp.Add(*[self.put(part * self.epsilon**k) for k, part in enumerate(parts)])
        known = laurent(whole, self.sigma, order=self.order + slower)
        return sp.Add(*[self.sigma ** (n - slower) * part for n, part in known.items()])


def _on_first(first: Study, series: SeriesManifold, ray: _Ray, slower: bool) -> Scene:
    """The flow on the slow manifold over C1 as a scene, whose small parameter is sigma and whose value is 1."""
    scene, system, ring = first.scene, first.system, series.chart.ring
    renamed = set_apart(series.chart)
    names = {c: renamed.get(c, c) for c in series.coordinates}
    fast = {y: ray.total(h[y] for h in series.coefficients) for y in system.y}
    fast |= {
        x: ray.put(ring.to_sympy(series.chart.elements[x])) for x in system.x if x not in series.coordinates
    }
    watched = {**fast, **{o: ray.put(e).xreplace(fast) for o, e in system.observables.items()}}
    # A function of a series in sigma stands in no field; its own series does.
    bent = {o for o, e in watched.items() if misplaced_epsilon(e, ray.sigma) is not None}
    along = compose(series, {o: system.observables[o] for o in bent}) if bent else ()
    watched |= {o: ray.total(row[o] for row in along) for o in bent}
    field = VectorField(
        {
            name: ray.total((f[c] for f in series.coordinate_field), slower=slower).xreplace(renamed)
            for c, name in names.items()
        },
        epsilon=ray.sigma,
        parameters={**system.parameters, ray.epsilon: exact(scene.epsilon)},
        name=system.name,
        observables={o: e.xreplace(renamed) for o, e in watched.items()},
    )
    x = np.array([[first.start[s.name] for s in system.x]])
    point = {**first.start, **dict(zip([y.name for y in system.y], first.branch.points(x)[0].tolist()))}
    start = {name.name: float(point[c.name]) for c, name in names.items()}
    region = {name.name: first.region[c.name] for c, name in names.items() if c.name in first.region}
    # A bound on a fast variable is for the start of the whole system, not for the point of C1 under it.
    region = {name: (low, high) for name, (low, high) in region.items() if low <= start[name] <= high}
    return Scene(
        field,
        region,
        start,
        scene.span,
        BOOKKEEPING,
        tolerance=scene.tolerance,
        name=scene.name,
        title=scene.title,
    )


def _new_symbol(system: SlowFastSystem) -> sp.Symbol:
    named = (*system.states, *system.parameters, *system.observables, system.epsilon)
    return sp.Symbol(Names(s.name for s in named)("sigma"))
