"""The field that switches which a smooth switch tends to: X+ and X- where s/epsilon goes to infinity on either side."""

from __future__ import annotations

import sympy as sp

from gsp.algebra.factorisation import lowest_terms
from gsp.errors import GspError
from gsp.sliding.law import FAR, active
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.splitting.switches import by_switch, without_switches
from gsp.systems.arguments import check_noun
from gsp.systems.system import VectorField


class SharpeningError(GspError):
    """A field has no limit as its switch becomes sharp."""


def sharpened(field: VectorField) -> PiecewiseField:
    """The limit of a field with one switch phi(s/epsilon) as epsilon goes to 0: off the surface s = 0 it is one of two.

    What a law bears on the surface beyond its limits, as static friction above kinetic, is not in it. Raises
    `SharpeningError` for a field without a switch, with several, or without a limit, and `DeclarationError` for
    anything but a `VectorField`.

    >>> x, u, epsilon = sp.symbols("x u epsilon")
    >>> sharpened(VectorField({x: u, u: -x + sp.tanh((1 - u)/epsilon)}, epsilon=epsilon)).plus[u]
    1 - x
    """
    check_noun(field, (VectorField,), verb="sharpened")
    switches = () if field.epsilon is None else without_switches(field)[1]
    if len(switches) != 1:
        raise SharpeningError(f"the field has {len(switches)} switches.", "One is made sharp, on one surface.")
    (switch,) = switches
    # With epsilon = s/v what is regular in epsilon falls away.
    rates = {z: by_switch(rate, switch) for z, rate in field.equations.items()}
    plus, minus = ({z: _limit(rate, switch.fast, side) for z, rate in rates.items()} for side in (1, -1))
    return PiecewiseField(plus, minus, switch.surface, field.parameters, field.name)


def _limit(rate: sp.Expr, fast: sp.Symbol, side: int) -> sp.Expr:
    """The limit of a rate as the fast variable goes to infinity on a side."""
    try:
        inner = active(rate, fast, side * FAR[1])[0]
        limit = sp.limit(inner, fast, side * sp.oo)
    except (NotImplementedError, TypeError, ValueError):
        limit = sp.nan
    if limit.has(fast, sp.oo, -sp.oo, sp.zoo, sp.nan, sp.Limit, sp.AccumBounds):
        raise SharpeningError(
            f"no limit of {rate} was found where {fast} goes to {side * sp.oo}.",
            "Give the two fields to PiecewiseField.",
        )
    return lowest_terms(limit)
