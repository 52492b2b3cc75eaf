"""What is fast beside first integrals, what the coordinates are called, and where they serve."""

import sympy as sp

from gsp.splitting.slow_coordinates import (
    explain_route,
    fast_choices,
    new_symbols,
    singular_factors,
    vanishing_factors,
)
from gsp.systems.system import VectorField

x, y, z, p, k, epsilon = sp.symbols("x y z p k epsilon")


def field_of(rates: dict, **parameters: float) -> VectorField:
    values = {sp.Symbol(name): value for name, value in parameters.items()}
    return VectorField(rates, epsilon=epsilon, parameters=values)


def test_a_state_that_the_layer_moves_is_fast_and_one_that_is_an_integral_is_not() -> None:
    field = field_of({x: -y / epsilon, y: y, z: (z - y) / epsilon})
    assert list(fast_choices([y, x], [-y, sp.S.Zero, z - y], field, 1)) == [(z,)]


def test_of_nonlinear_integrals_every_state_is_tried_off_which_they_are_regular() -> None:
    field = field_of({x: x * y / epsilon, y: -x * y / epsilon + x})
    assert set(fast_choices([x * y], [x * y, -x * y], field, 1)) == {(x,), (y,)}


def test_new_coordinates_have_names_that_are_not_taken() -> None:
    field = field_of({x: x / epsilon, y: y, z: x}, p=1.0)
    assert new_symbols(field, [x + y]) == [sp.Symbol("q")]
    assert new_symbols(field, [x + y, z]) == [sp.Symbol("q"), z]
    assert new_symbols(field, [x + y, x + z]) == list(sp.symbols("p1 p2"))


def test_what_has_to_be_nonzero_is_told_without_what_always_is() -> None:
    assert set(vanishing_factors(-3 * x**2 * sp.exp(y) * (1 + x) * k**-3)) == {x, 1 + x, k}
    assert list(singular_factors([sp.log(x) + y / (1 + z**2), 1 / (x - y)], [x, y, z])) == [x, x - y]


def test_the_route_tells_linear_integrals_from_others() -> None:
    assert "standard form already" in explain_route({x: x}, (x, y), epsilon)
    assert "p is a linear first integral" in explain_route({p: x + k * y}, (x, y), epsilon)
    assert "p is a nonlinear first integral" in explain_route({p: x * y}, (x, y), epsilon)
