"""What a smooth switch tends to off its surface."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.sliding.law import LAWS, W
from gsp.sliding.piecewise_field import PiecewiseField, switching
from gsp.sliding.sharpened import SharpeningError, sharpened
from gsp.systems.system import VectorField

x, u, eps = sp.symbols("x u epsilon")
given = PiecewiseField({x: u, u: 1 - x}, {x: -u + x, u: x * u}, u - x / 2)


@pytest.mark.exhaustive
@pytest.mark.parametrize("phi", [*LAWS, W / sp.sqrt(1 + W**2) + 3 * W / (1 + W**2)])
def test_a_field_made_smooth_tends_to_the_field_that_it_was_made_of(phi) -> None:
    found = sharpened(switching(given.plus, minus=given.minus, surface=given.surface, phi=phi, epsilon=eps))
    sign = sp.cancel(found.surface / given.surface)
    assert sign.is_number
    plus, minus = (found.plus, found.minus) if sign > 0 else (found.minus, found.plus)
    for rates, wanted in ((plus, given.plus), (minus, given.minus)):
        assert all(sp.cancel(rates[z] - wanted[z]) == 0 for z in wanted)


def test_what_is_regular_in_epsilon_falls_away() -> None:
    field = VectorField({x: u + eps * x, u: x * u / sp.sqrt(u**2 + eps**2) - x}, epsilon=eps)
    found = sharpened(field)
    assert (found.plus[x], found.plus[u], found.minus[u]) == (u, 0, -2 * x)


@pytest.mark.parametrize(
    ("rates", "says"),
    [
        ({x: u / eps, u: -x}, "0 switches"),
        ({x: sp.tanh(u / eps), u: sp.tanh(x / eps)}, "2 switches"),
        ({x: sp.sinh(u / eps), u: -x}, "no limit"),
        ({x: x / eps, u: sp.tanh(u / eps)}, "no limit"),
    ],
)
def test_a_field_without_a_limit_is_refused(rates, says) -> None:
    with pytest.raises(SharpeningError, match=says):
        sharpened(VectorField(rates, epsilon=eps))
