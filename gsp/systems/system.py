"""Declaration: a slow-fast system in standard form, or any field with poles in epsilon.

x' = f(x, y, epsilon), epsilon y' = g(x, y, epsilon), equation (19) of Eldering (2015): x slow, y fast,
' = d/dt in slow time. All checks are here; later stages trust what they are given.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Self

import numpy as np
import sympy as sp

from gsp.algebra.centres import centres
from gsp.algebra.laurent import pole_order
from gsp.errors import DeclarationError
from gsp.results.card import Card
from gsp.systems.arguments import check_text
from gsp.systems.declaration import checked_parameters, equations_of, updated_parameters
from gsp.systems.flow import Flow, Values, in_words
from gsp.systems.region import Interval, digits_between, in_units


class _Declared(Flow):
    """A flow that was written down: two of one kind are equal when everything that was declared is, in its order."""

    _given: ClassVar[Mapping[str, str]]
    """What the class takes the equations by, and the attributes that hold them."""
    name: str

    def with_parameters(self, **values: float) -> Self:
        """The same with other values for some parameters, given by name."""
        kind: Any = type(self)
        return kind(
            **self._equations,
            epsilon=self.epsilon,
            parameters=updated_parameters(self.parameters, values),
            name=self.name,
            observables=self.observables,
        )

    def as_field(self, equations: Mapping[sp.Symbol, sp.Expr] | None = None) -> VectorField:
        """The field of `equations`, by default its own with any 1/epsilon written out; all else stays as it is."""
        return VectorField(
            dict(zip(self.states, self.rates)) if equations is None else equations,
            epsilon=self.epsilon,
            parameters=self.parameters,
            name=self.name,
            observables=self.observables,
        )

    @cached_property
    def centres(self) -> Mapping[sp.Symbol, sp.Rational]:
        """Where the states that are far from their origin are, at the parameters' values: see `gsp.algebra.centres`."""
        values = dict(self.parameters)
        return centres(
            tuple(e.xreplace(values) for of in self._equations.values() for e in of.values()), self.states
        )

    def box_from_centres(self, box: Mapping[str, Interval]) -> dict[str, Interval]:
        """Intervals by name as they are counted from the `centres`."""
        centre = {s.name: float(c) for s, c in self.centres.items()}
        return {n: (low - centre.get(n, 0.0), high - centre.get(n, 0.0)) for n, (low, high) in box.items()}

    def place(self, point: Mapping[Any, float] | Iterable[tuple[Any, float]]) -> str:
        """Values by name, or by symbol, as text, to six digits of how far each is from its centre."""
        centre = {s.name: float(c) for s, c in self.centres.items()}
        pairs = point.items() if isinstance(point, Mapping) else point
        named = {str(getattr(key, "name", key)): float(value) for key, value in pairs}
        more = {}
        for name, value in named.items():
            c = centre.get(name, 0.0)
            # The centre itself, and what is beside it by six digits.
            whole = next((d for d in range(6, 17) if float(f"{c:.{d}g}") == c), 17)
            more[name] = max(whole, digits_between((min(c, value), max(c, value))))
        return in_words(named, more=more)

    @cached_property
    def about_centres(self) -> Self:
        """The same about its `centres`; itself where it has none."""
        return self.about(self.centres)

    def about(self, centres: Mapping[sp.Symbol, sp.Expr]) -> Self:
        """The same with v + c for each state v that has one of the `centres` c."""
        if not centres:
            return self
        there = {s: s + c for s, c in centres.items()}
        given = {**self._equations, "observables": self.observables}
        kind: Any = type(self)
        return kind(
            **{name: {s: e.xreplace(there) for s, e in of.items()} for name, of in given.items()},
            epsilon=self.epsilon,
            parameters=self.parameters,
            name=self.name,
        )

    @property
    def _equations(self) -> dict[str, Values]:
        """The equations by what the class takes them by."""
        return {argument: getattr(self, part) for argument, part in self._given.items()}

    def __repr__(self) -> str:
        equations = [f"{argument}={_names(of)}" for argument, of in self._equations.items()]
        return (
            f"{type(self).__name__}({', '.join(equations)}, epsilon={self.epsilon}, "
            f"parameters={_listing(self.parameters)})"
        )

    @cached_property
    def _key(self) -> tuple:
        equations = tuple(tuple(of.items()) for of in self._equations.values())
        values = tuple(self.parameters.items()), tuple(self.observables.items())
        return (equations, self.epsilon, *values, self.name)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Declared) and type(self) is type(other) and self._key == other._key

    def __hash__(self) -> int:
        return self._hash

    @cached_property
    def _hash(self) -> int:
        return hash((type(self).__name__, self._key))


@dataclass(frozen=True, eq=False, repr=False)
class SlowFastSystem(_Declared, Card):
    """A system in standard form, x' = f(x, y, epsilon), epsilon y' = g(x, y, epsilon).

    `slow` maps each slow symbol to f, `fast` each fast symbol to g (without the factor 1/epsilon);
    `epsilon` is the small parameter, `parameters` gives every other symbol its value, `observables` are
    further quantities to read off a trajectory. f and g are rational in epsilon and regular at 0.

    Raises `DeclarationError`, naming the fact, the value and the remedy.

    >>> s, c, eps, kappa = sp.symbols("s c epsilon kappa")
    >>> SlowFastSystem(slow={s: -s + s*c}, fast={c: s - (s + kappa)*c}, epsilon=eps, parameters={kappa: 1})
    SlowFastSystem(slow=[s], fast=[c], epsilon=epsilon, parameters={kappa: 1})
    """

    _given = MappingProxyType({"slow": "slow", "fast": "fast"})
    slow: Mapping[sp.Symbol, sp.Expr]
    fast: Mapping[sp.Symbol, sp.Expr]
    epsilon: sp.Symbol
    parameters: Values = field(default_factory=dict)
    name: str = ""
    observables: Values = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_text(self.name, what="name")
        slow, fast = equations_of(self.slow, "slow"), equations_of(self.fast, "fast")
        if not slow or not fast:
            raise DeclarationError(
                "a SlowFastSystem has slow and fast variables.",
                "Declare a VectorField for a field that is not split.",
                got=f"{len(slow)} slow and {len(fast)} fast",
            )
        twice = [symbol.name for symbol in fast if symbol in slow]
        if twice:
            raise DeclarationError(
                f"{', '.join(twice)} is declared slow and fast.", "Keep it in one of the two."
            )
        if self.epsilon is None:
            raise DeclarationError(
                "a SlowFastSystem has a small parameter.",
                "Pass the symbol that multiplies the fast rates.",
                got="epsilon=None",
            )
        observables = equations_of(self.observables, "observables")
        parameters = checked_parameters(
            states=(*slow, *fast),
            expressions=(*slow.values(), *fast.values()),
            observables=observables,
            epsilon=self.epsilon,
            parameters=self.parameters,
        )
        for kind, equations in (("slow", slow), ("fast", fast)):
            for symbol, expression in equations.items():
                order = pole_order(expression, self.epsilon)
                if order:
                    raise DeclarationError(
                        f"the {kind} rate of {symbol} has a pole of order {order} in {self.epsilon}: "
                        f"{expression}.",
                        "Write epsilon y' = g with g regular, or declare a VectorField and split it.",
                    )
        _freeze(self, slow=slow, fast=fast, parameters=parameters, observables=observables)
        object.__setattr__(self, "states", (*slow, *fast))
        object.__setattr__(self, "rates", (*slow.values(), *(g / self.epsilon for g in fast.values())))

    def moved_into(self, units: np.ndarray) -> SlowFastSystem:
        """The same without observables, its states in `units` (n,)."""
        sizes = dict(zip(self.states, units))
        return SlowFastSystem(
            slow=in_units(self.slow, sizes),
            fast=in_units(self.fast, sizes),
            epsilon=self.epsilon,
            parameters=self.parameters,
            name=self.name,
        )

    @property
    def x(self) -> tuple[sp.Symbol, ...]:
        """The slow symbols."""
        return tuple(self.slow)

    @property
    def y(self) -> tuple[sp.Symbol, ...]:
        """The fast symbols."""
        return tuple(self.fast)

    @property
    def stands_still(self) -> bool:
        """Whether the slow rates have a factor epsilon, all of them: at leading order nothing moves along M0."""
        rates = self.slow.values()
        return any(f != 0 for f in rates) and all(f.xreplace({self.epsilon: sp.S.Zero}) == 0 for f in rates)

    @cached_property
    def f(self) -> sp.ImmutableMatrix:
        """Slow rates f(x, y, epsilon), a column."""
        return sp.ImmutableMatrix(list(self.slow.values()))

    @cached_property
    def g(self) -> sp.ImmutableMatrix:
        """Fast rates g(x, y, epsilon), a column; epsilon y' = g."""
        return sp.ImmutableMatrix(list(self.fast.values()))

    def __str__(self) -> str:
        rows = [(f"{symbol}'", expression) for symbol, expression in self.slow.items()]
        rows += [(f"{self.epsilon} {symbol}'", expression) for symbol, expression in self.fast.items()]
        return _card(self.name or "slow-fast system", rows, self.parameters)


@dataclass(frozen=True, eq=False, repr=False, init=False)
class VectorField(_Declared, Card):
    """A field z' = F(z, epsilon); F may have poles in epsilon. Without `epsilon` it has no small parameter.

    F may hold switches, functions of s/epsilon with s a function of the states, such as tanh((V - u)/epsilon).
    A field without a small parameter can be integrated, not split. Raises `DeclarationError` as `SlowFastSystem`
    does, and when `epsilon` is given but appears in no equation.

    >>> v, w, eps = sp.symbols("v w epsilon")
    >>> VectorField(states={v: -w, w: -w/eps + v}, epsilon=eps)
    VectorField(states=[v, w], epsilon=epsilon, parameters={})
    """

    _given = MappingProxyType({"states": "equations"})
    equations: Mapping[sp.Symbol, sp.Expr]
    epsilon: sp.Symbol | None
    parameters: Values
    name: str
    observables: Values

    def __init__(
        self,
        states: Mapping[sp.Symbol, sp.Expr],
        *,
        epsilon: sp.Symbol | None = None,
        parameters: Values | None = None,
        name: str = "",
        observables: Values | None = None,
    ) -> None:
        check_text(name, what="name")
        equations = equations_of(states, "states")
        if not equations:
            raise DeclarationError("a VectorField has at least one state.", got="none")
        watched = equations_of({} if observables is None else observables, "observables")
        values = checked_parameters(
            states=tuple(equations),
            expressions=tuple(equations.values()),
            observables=watched,
            epsilon=epsilon,
            parameters={} if parameters is None else parameters,
            may_switch=True,
        )
        if epsilon is not None and not any(e.has(epsilon) for e in equations.values()):
            shown = ", ".join(f"{s}' = {e}" for s, e in equations.items())
            raise DeclarationError(
                f"{epsilon} does not appear in any equation.",
                "Leave it out: a model needs no small parameter. One that has fast rates divides them by it.",
                got=shown,
            )
        _freeze(self, equations=equations, parameters=values, observables=watched)
        object.__setattr__(self, "states", tuple(equations))
        object.__setattr__(self, "rates", tuple(equations.values()))
        object.__setattr__(self, "epsilon", epsilon)
        object.__setattr__(self, "name", name)

    def __str__(self) -> str:
        rows = [(f"{symbol}'", expression) for symbol, expression in self.equations.items()]
        return _card(self.name or "vector field", rows, self.parameters)


def _freeze(target: object, **mappings: Mapping) -> None:
    for attribute, mapping in mappings.items():
        object.__setattr__(target, attribute, MappingProxyType(dict(mapping)))


def _names(symbols: Iterable[sp.Symbol]) -> str:
    return "[" + ", ".join(s.name for s in symbols) + "]"


def _listing(parameters: Values) -> str:
    return "{" + ", ".join(f"{s}: {v}" for s, v in parameters.items()) + "}"


def _card(title: str, rows: list[tuple[str, sp.Expr]], parameters: Values) -> str:
    width = max(len(left) for left, _ in rows)
    lines = [title, *(f"  {left:>{width}} = {right}" for left, right in rows)]
    if parameters:
        lines.append("  with " + ", ".join(f"{s} = {v}" for s, v in parameters.items()))
    return "\n".join(lines)
