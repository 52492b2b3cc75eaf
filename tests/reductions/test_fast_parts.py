"""Candidates of what is fast: terms of rates that stand in several of them."""

from __future__ import annotations

import sympy as sp

from gsp.reductions.fast_parts import _terms
from gsp.systems.system import VectorField

x, y, z = sp.symbols("x y z")


def test_a_rate_with_too_many_terms_is_taken_as_it_is_written() -> None:
    """Twenty pulses of a stimulus: multiplied out the rate has a million terms."""
    pulses = sp.Mul(*(1 + (1 + sp.sign(z - k)) * (1 + sp.sign(k + 2 - z)) for k in range(20)))
    field = VectorField({x: pulses * (1 - x) - 2 * y, y: x - y, z: sp.Integer(1)}, epsilon=None)
    terms = {(state, term) for state, term, _, _ in _terms(field)}
    assert terms == {(x, -2 * y), (x, pulses * (1 - x)), (y, x), (y, -y), (z, 1)}
