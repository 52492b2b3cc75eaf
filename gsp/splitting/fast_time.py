"""Fields in fast time: the small parameter stands in their rates, and none has a pole in it."""

from __future__ import annotations

import sympy as sp

from gsp.algebra.laurent import misplaced_epsilon, pole_order
from gsp.errors import SplittingError
from gsp.systems.system import SlowFastSystem, VectorField


def is_in_fast_time(system: SlowFastSystem | VectorField) -> bool:
    """Whether it is a field in whose rates the small parameter stands, and none of them has a pole in it."""
    epsilon = system.epsilon
    return (
        isinstance(system, VectorField)
        and epsilon is not None
        and any(rate.has(epsilon) for rate in system.rates)
        and all(misplaced_epsilon(rate, epsilon) is None for rate in system.rates)
        and not any(pole_order(rate, epsilon) for rate in system.rates)
    )


def divided(field: VectorField) -> VectorField:
    """The field with every rate divided by epsilon, term by term.

    Raises `SplittingError` where epsilon is a factor of every rate and stands nowhere else.
    """
    epsilon = field.epsilon
    rates = {
        state: sp.Add(*(term / epsilon for term in sp.Add.make_args(rate)))
        for state, rate in field.equations.items()
    }
    if not any(rate.has(epsilon) for rate in rates.values()):
        raise SplittingError(
            f"{epsilon} is a factor of every rate and stands nowhere else, so that it sets the pace of time and "
            "separates no time scales.",
            "Name another parameter as the small one, or none: a model needs no small parameter.",
        )
    return field.as_field(rates)


def divides(rate: sp.Expr, symbol: sp.Symbol) -> bool:
    """Whether the rate has a pole in the symbol; one inside a function or a root divides nothing."""
    return misplaced_epsilon(rate, symbol) is None and pole_order(rate, symbol) > 0
