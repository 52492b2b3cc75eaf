"""Rates of the slow variables and the phase on the way to the form that is averaged."""

from __future__ import annotations

from typing import NamedTuple

from gsp.systems.flow import Values


class TurningFrame(NamedTuple):
    """Rates by symbol, the same symbols in the states of the field, and those states in them."""

    rates: Values
    coordinates: Values
    inverse: Values
