"""Fields that switch on several surfaces at once, such as bodies with several contacts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.errors import DeclarationError
from gsp.results.card import Card
from gsp.systems.arguments import shown
from gsp.systems.declaration import checked_parameters, equations_of
from gsp.systems.flow import Values
from gsp.systems.system import VectorField

# The ways in which so many surfaces can be slid on are counted one by one.
MOST_SURFACES = 6


@dataclass(frozen=True, eq=False, repr=False)
class CrossingField(Card):
    """z' = X_0 + sum_c phi_c X_c, where phi_c is 1 where s_c > 0, -1 where s_c < 0, and between where s_c = 0.

    `surfaces` are the s_c, `drift` is X_0 and `jumps` the X_c, each a mapping of states to rates; states that a jump
    leaves alone may be left out of it. A law that overshoots may bear more than 1 on its surface. Raises
    `DeclarationError`, naming the fact, the value and the remedy.

    >>> x, u, w = sp.symbols("x u w")
    >>> CrossingField(drift={u: 1, w: -u}, jumps=[{u: -2}, {w: -3}], surfaces=[u, w])
    CrossingField(u, w; surfaces u = 0, w = 0)
    """

    drift: Mapping[sp.Symbol, sp.Expr]
    jumps: Sequence[Mapping[sp.Symbol, sp.Expr]]
    surfaces: Sequence[sp.Expr]
    parameters: Values = field(default_factory=dict)
    name: str = ""

    def __post_init__(self) -> None:
        drift = equations_of(self.drift, "drift")
        for name, value in (("jumps", self.jumps), ("surfaces", self.surfaces)):
            if not isinstance(value, (list, tuple)) or len(value) != len(self.surfaces) or not value:
                raise DeclarationError(f"{name} is a list, with one entry for each surface.", got=shown(value))
        if len(self.surfaces) > MOST_SURFACES:
            raise DeclarationError(
                f"there are {len(self.surfaces)} surfaces, of which {MOST_SURFACES} are taken.",
                "Keep fewer contacts.",
            )
        jumps = []
        for given in self.jumps:
            jump = equations_of(given, "jumps")
            if not set(jump) <= set(drift):
                raise DeclarationError("jumps have rates for states of drift only.", got=shown(given))
            jumps.append(MappingProxyType({z: jump.get(z, sp.S.Zero) for z in drift}))
        # Keyed by what are symbols in any case, so that errors name them.
        surfaces: list[Any] = [equations_of({next(iter(drift)): s}, "surfaces") for s in self.surfaces]
        crossed = tuple(next(iter(entry.values())) for entry in surfaces)
        expressions = (*drift.values(), *(e for jump in jumps for e in jump.values()), *crossed)
        parameters = checked_parameters(
            states=tuple(drift),
            expressions=expressions,
            observables={},
            epsilon=None,
            parameters=self.parameters,
        )
        for surface in crossed:
            if surface.free_symbols.isdisjoint(drift):
                raise DeclarationError("a surface depends on no state.", got=str(surface), value=surface)
        for attribute, value in (
            ("drift", MappingProxyType(drift)), ("jumps", tuple(jumps)), ("surfaces", crossed),
            ("parameters", MappingProxyType(parameters)),
        ):  # fmt: skip
            object.__setattr__(self, attribute, value)

    @property
    def states(self) -> tuple[sp.Symbol, ...]:
        """The state symbols."""
        return tuple(self.drift)

    def rate_of(self, expression: sp.Expr, rates: Values) -> sp.Expr:
        """The rate of an expression in the states along a field."""
        return sp.Add(*(derivative(expression, z) * rate for z, rate in rates.items()))

    def flow(self, rates: Values) -> VectorField:
        """A field in the same states and parameters."""
        return VectorField(rates, parameters=self.parameters, name=self.name)

    def __repr__(self) -> str:
        listed = ", ".join(f"{surface} = 0" for surface in self.surfaces)
        return f"{type(self).__name__}({', '.join(s.name for s in self.states)}; surfaces {listed})"
