"""Equations of the nouns of this package."""

from __future__ import annotations

from gsp.results.equations import Equation, rates_of
from gsp.results.registry import equations
from gsp.systems.system import SlowFastSystem, VectorField


@equations.of(SlowFastSystem)
def _equations_of_slow_fast_system(value: SlowFastSystem) -> list[Equation]:
    return [*rates_of(value.slow.items()), *rates_of(value.fast.items(), factor=value.epsilon)]


@equations.of(VectorField)
def _equations_of_vector_field(value: VectorField) -> list[Equation]:
    return rates_of(value.equations.items())
