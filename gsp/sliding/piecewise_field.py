"""Fields that switch: X+ where s > 0 and X- where s < 0, Filippov's sliding field between them, and a smooth switch.

With Y = L_X s the rate at which each field crosses the surface, sliding is the convex combination that stays on it,

    X_s = (Y- X+ - Y+ X-)/(Y- - Y+) = (1 + c)/2 X+ + (1 - c)/2 X-,   c = (Y- + Y+)/(Y- - Y+)                    (1)

(A. F. Filippov, Differential Equations with Discontinuous Righthand Sides, 1988). With phi(s/epsilon) in place of c the
field is smooth; v = s/epsilon is fast, phi(v) = c is its critical manifold, and (1) its reduced flow of order 0
(M. A. Teixeira and P. R. da Silva, Physica D 241 (2012) 1948-1955).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import sympy as sp

from gsp.algebra.brevity import brief, in_factors, in_lowest_terms
from gsp.algebra.differentiation import derivative
from gsp.algebra.factorisation import lowest_terms
from gsp.errors import DeclarationError, met_at
from gsp.results.card import Card
from gsp.sliding.crossing_field import CrossingField
from gsp.sliding.law import SwitchLaw, switch_law
from gsp.systems.arguments import shown
from gsp.systems.declaration import checked_parameters, equations_of
from gsp.systems.flow import Values
from gsp.systems.system import VectorField


@dataclass(frozen=True, eq=False, repr=False)
class PiecewiseField(Card):
    """z' = X+ where `surface` > 0 and X- where it is < 0; `plus` and `minus` map each state to its rate.

    Raises `DeclarationError`, naming the fact, the value and the remedy.

    >>> x, y = sp.symbols("x y")
    >>> PiecewiseField(plus={x: 1, y: x - 1}, minus={x: 1, y: 1}, surface=y).sliding.equations[x]
    1
    """

    plus: Mapping[sp.Symbol, sp.Expr]
    minus: Mapping[sp.Symbol, sp.Expr]
    surface: sp.Expr
    parameters: Values = field(default_factory=dict)
    name: str = ""

    def __post_init__(self) -> None:
        plus, minus = equations_of(self.plus, "plus"), equations_of(self.minus, "minus")
        if not plus or set(plus) != set(minus):
            raise DeclarationError(
                "plus and minus have the same states, at least one.",
                got=" and ".join(", ".join(s.name for s in rates) or "none" for rates in (plus, minus)),
            )
        if not isinstance(self.surface, sp.Expr):
            raise DeclarationError(
                "surface is an expression, zero where the field switches.", got=shown(self.surface)
            )
        surface = equations_of({next(iter(plus)): self.surface}, "surface")
        for name, rates in (("plus", plus), ("minus", minus), ("surface", surface)):
            with met_at(name):
                parameters = checked_parameters(
                    states=tuple(plus),
                    expressions=tuple(rates.values()),
                    observables={},
                    epsilon=None,
                    parameters=self.parameters,
                )
        (crossed,) = surface.values()
        if crossed.free_symbols.isdisjoint(plus):
            raise DeclarationError("the surface depends on no state.", got=str(crossed), value=crossed)
        for attribute, value in (
            ("plus", plus),
            ("minus", {z: minus[z] for z in plus}),
            ("parameters", parameters),
        ):
            object.__setattr__(self, attribute, MappingProxyType(value))
        object.__setattr__(self, "surface", crossed)

    @property
    def states(self) -> tuple[sp.Symbol, ...]:
        """The state symbols."""
        return tuple(self.plus)

    @cached_property
    def normal_rates(self) -> tuple[sp.Expr, sp.Expr]:
        """Y+ and Y-, the rates of the surface's function along X+ and X-."""
        return self.rate_of(self.surface, self.plus), self.rate_of(self.surface, self.minus)

    @cached_property
    def crossing(self) -> CrossingField:
        """The same as (X+ + X-)/2 + phi (X+ - X-)/2."""
        return CrossingField(
            {z: (self.plus[z] + self.minus[z]) / 2 for z in self.plus},
            [{z: (self.plus[z] - self.minus[z]) / 2 for z in self.plus}],
            [self.surface],
            self.parameters,
            self.name,
        )

    @cached_property
    def share(self) -> sp.Expr:
        """c of (1): from -1, where X- alone stays on the surface, to 1, where X+ does."""
        above, below = self.normal_rates
        return in_lowest_terms((below + above) / self._closing)

    @cached_property
    def sliding(self) -> VectorField:
        """X_s of (1), tangent to the surface; it slides where Y+ < 0 < Y-."""
        above, below = self.normal_rates
        closing = self._closing
        return self.flow(
            {z: in_factors((below * self.plus[z] - above * self.minus[z]) / closing) for z in self.plus}
        )

    @cached_property
    def _closing(self) -> sp.Expr:
        """Y- - Y+, by which the two fields lead to the surface together."""
        above, below = self.normal_rates
        if lowest_terms(below - above) == 0:
            raise DeclarationError(
                f"both fields cross the surface at the same rate, {brief(above)}, so that no run slides on it.",
                "Run the field with run_piecewise.",
            )
        return below - above

    def rate_of(self, expression: sp.Expr, rates: Values) -> sp.Expr:
        """The rate of an expression in the states along a field."""
        return sp.Add(*(derivative(expression, z) * rate for z, rate in rates.items()))

    def flow(self, rates: Values) -> VectorField:
        """A field in the same states and parameters."""
        return VectorField(rates, parameters=self.parameters, name=self.name)

    def smooth(self, law: SwitchLaw, epsilon: sp.Symbol) -> VectorField:
        """The field with phi(surface/epsilon) for c; `switching` is this for a declaration in one line."""
        phi = law.at(self.surface / epsilon)
        rates = {
            z: (self.plus[z] + self.minus[z]) / 2 + phi * (self.plus[z] - self.minus[z]) / 2 for z in self.plus
        }
        return VectorField(rates, epsilon=epsilon, parameters=self.parameters, name=self.name)

    def __repr__(self) -> str:
        return f"PiecewiseField({', '.join(s.name for s in self.states)}; surface {self.surface} = 0)"

    def __str__(self) -> str:
        rows = [f"  {z}' = {self.plus[z]}   or   {self.minus[z]}" for z in self.plus]
        return "\n".join([f"{self.name or 'piecewise field'}, {self.surface} > 0 or < 0", *rows])


def switching(
    plus: Values,
    *,
    minus: Values,
    surface: sp.Expr,
    phi: str | sp.Expr | SwitchLaw,
    epsilon: sp.Symbol,
    parameters: Values | None = None,
    name: str = "",
) -> VectorField:
    """X+ (1 + phi)/2 + X- (1 - phi)/2 with phi(surface/epsilon): a field that switches, made smooth.

    `plus` and `minus` map states to their rates where `surface` > 0 and < 0. `phi` is the name of a law, "linear",
    "cubic" (both clipped), "tanh", "algebraic", "atan" or "stribeck", or an expression in one symbol that tends to -1
    and 1; it may overshoot, as Stribeck's. `split` makes v = surface/epsilon a fast variable; the reduced flow of order
    0 is Filippov's sliding field, `PiecewiseField.sliding`. Raises `DeclarationError` for what makes no such field.

    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> switching({x: 1, y: x}, minus={x: 1, y: 1}, surface=y, phi="tanh", epsilon=epsilon).rates
    (1, x/2 + (x - 1)*tanh(y/epsilon)/2 + 1/2)
    """
    law = switch_law(phi)
    if not isinstance(epsilon, sp.Symbol):
        raise DeclarationError("epsilon is a SymPy symbol.", got=f"{shown(epsilon)}; its value is given later")
    given = PiecewiseField(plus, minus, surface, {} if parameters is None else parameters, name)
    return given.smooth(law, epsilon)
