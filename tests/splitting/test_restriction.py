"""A field split twice: in its small parameter, and the flow on the critical manifold in a second one."""

from __future__ import annotations

import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError, DegenerateError, SplittingError

z, y, x, eps, delta = sp.symbols("z y x epsilon delta")


def field(fast: sp.Expr, middle: sp.Expr, slow: sp.Expr = -z * (1 + x)) -> gsp.VectorField:
    """z' = slow, delta y' = middle, epsilon delta x' = fast."""
    rates = {z: slow, y: middle / delta, x: fast / (eps * delta)}
    return gsp.VectorField(rates, epsilon=eps, parameters={delta: sp.Rational(1, 10)})


def test_a_field_with_three_time_scales_is_split_twice() -> None:
    found = gsp.split(field(y - x, z - y + x**2 / 4), second="delta")
    assert found.system.y == (x,)
    then = found.second
    assert (then.system.x, then.system.y, then.system.epsilon) == ((z,), (y,), delta)
    # On x = y: delta y' = z - y + y^2/4, z' = -z (1 + y).
    assert sp.expand(then.system.fast[y] - (z - y + y**2 / 4)) == 0
    assert sp.expand(then.system.slow[z] + z * (1 + y)) == 0
    (near, _) = sorted(sp.solve(then.system.fast[y].subs(z, sp.Rational(3, 4)), y))
    assert near == 2 - 2 * sp.sqrt(1 - sp.Rational(3, 4))
    assert "On {f = 0}, to leading order in epsilon:" in str(found)
    assert "; then Splitting(slow: z = z; fast: y)" in repr(found)


def test_the_second_parameter_may_be_that_of_the_slow_time() -> None:
    """epsilon x' = y - x, y' = z - y, z' = -delta z: the flow on x = y is in fast time."""
    given = gsp.VectorField({x: (y - x) / eps, y: z - y, z: -delta * z}, epsilon=eps, parameters={delta: 1})
    then = gsp.split(given, second=delta).second
    assert then.rescaled
    assert (then.system.x, then.system.y) == ((z,), (y,))


def test_fast_variables_of_the_first_may_be_combinations() -> None:
    """x and y exchange fastest, z follows their sum, which feels z."""
    given = gsp.VectorField(
        {x: (y - x) / (eps * delta), y: (x - y) / (eps * delta) - y, z: (x + y - z) / delta},
        epsilon=eps, parameters={delta: 1},
    )  # fmt: skip
    found = gsp.split(given, second="delta")
    (total,) = found.second.system.x
    assert found.coordinates[total] == x + y
    assert found.second.system.slow[total].subs({found.second.system.y[0]: 0}) == -total / 2


def test_what_cannot_be_split_again_is_refused_by_name() -> None:
    with pytest.raises(DeclarationError, match="second is d, and no parameter"):
        gsp.split(field(y - x, z - y), second="d")
    with pytest.raises(DegenerateError, match="a time scale is hidden"):
        gsp.split(field(y - x, x - y, z), second="delta")
    with pytest.raises(SplittingError, match="has no formula") as caught:
        gsp.split(field(y - x - x**5, z - y), second="delta")
    assert 'nest(scene, small=["epsilon", "delta"])' in caught.value.remedy
    other = gsp.VectorField({z: -z, y: z - y, x: (delta * y - x) / eps}, epsilon=eps, parameters={delta: 1})
    with pytest.raises(SplittingError, match="no rate on the critical manifold of epsilon carries delta"):
        gsp.split(other, second="delta")
