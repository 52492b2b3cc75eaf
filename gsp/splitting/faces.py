"""Equations of the nouns of this package."""

from __future__ import annotations

from gsp.results.equations import Equation
from gsp.results.registry import equations
from gsp.splitting.splitting import Splitting


@equations.of(Splitting)
def _equations_of_splitting(value: Splitting) -> list[Equation]:
    if value.system is None:
        return []
    return [Equation(symbol, (value.coordinates[symbol],)) for symbol in value.system.states]
