"""Fields that switch: Filippov's sliding field is the reduced flow of the smooth field, exactly."""

from __future__ import annotations

import random

import pytest
import sympy as sp

from gsp.comparison.comparison import compare
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError
from gsp.scenes.scene import Scene
from gsp.sliding.piecewise_field import PiecewiseField, switching
from gsp.slow.series import expand
from gsp.splitting.splitting import split

x, y, z, a, eps = sp.symbols("x y z a epsilon")


def random_field(seed: int) -> PiecewiseField:
    """Random polynomials of degree two in two or three states, and a surface linear in y with a random tilt."""
    chance = random.Random(seed)
    states = (x, y, z)[: 2 + seed % 2]
    terms = [sp.S.One, *states, *(p * q for p in states for q in states)]

    def polynomial() -> sp.Expr:
        return sp.Add(*(chance.randint(-3, 3) * term for term in chance.sample(terms, 4)), chance.randint(1, 4))

    plus, minus = ({s: polynomial() for s in states} for _ in range(2))
    return PiecewiseField(plus, minus, y + chance.randint(0, 2) * x - sp.Rational(chance.randint(0, 3), 2))


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(20))
def test_the_reduced_flow_of_order_0_is_filippovs_sliding_field(seed: int) -> None:
    given = random_field(seed)
    above, below = given.normal_rates
    # By Filippov's words, not by the class: the combination of both fields that is tangent to the surface.
    share = sp.Symbol("share")
    (weight,) = sp.solve(share * above + (1 - share) * below, share)
    sliding = {s: weight * given.plus[s] + (1 - weight) * given.minus[s] for s in given.states}
    assert all(sp.cancel(given.sliding.equations[s] - sliding[s]) == 0 for s in given.states)
    field = switching(given.plus, minus=given.minus, surface=given.surface, phi="tanh", epsilon=eps)
    splitting = split(field)
    (switch,) = splitting.switches
    assert splitting.system is not None
    (branch,) = solve_critical(splitting.system).branches
    found = expand(branch, order=0).reduced_field[0].as_dict()
    on_surface = {switch.state: switch.value.xreplace({eps: sp.S.Zero})}
    assert set(found) == set(given.states) - {switch.state}
    for s, rate in found.items():
        assert sp.cancel(rate - sliding[s].xreplace(on_surface)) == 0


@pytest.mark.exhaustive
def test_the_corrections_have_the_slopes_of_the_theory() -> None:
    field = switching(
        plus={x: 1 + y, y: -1 - x**2, z: x},
        minus={x: -z, y: 1 + z / 2, z: 1},
        surface=y,
        phi="algebraic",
        epsilon=eps,
    )
    scene = Scene(field, {"x": (-3, 3), "z": (-1, 3)}, {"x": 0.2, "y": 0.0, "z": 0.1}, (0, 1), 0.01)
    found = compare(scene, orders=(0, 1, 2, 3))
    for order in range(4):
        assert found.slopes[order] == pytest.approx(order + 1, abs=0.15)


def test_the_share_says_which_field_stays_on_the_surface() -> None:
    given = PiecewiseField({x: 1, y: x}, {x: 1, y: 1}, y)
    assert given.normal_rates == (x, 1)
    assert sp.cancel(given.share - (1 + x) / (1 - x)) == 0
    for rates, side in ((given.plus, 1), (given.minus, -1)):
        stays = sp.solve(given.rate_of(y, rates), x)
        assert all(given.share.xreplace({x: place}) == side for place in stays)


def test_parameters_are_those_of_both_fields() -> None:
    given = PiecewiseField({x: a, y: -1}, {x: 1, y: a}, y - a, {a: 2}, "belt")
    assert given.sliding.equations[x].equals((a * a + 1) / (a + 1))
    assert "belt, -a + y > 0 or < 0" in str(given)
    assert switching(
        given.plus, minus=given.minus, surface=y - a, phi="linear", epsilon=eps, parameters={a: 2}
    ).parameters == {a: 2}


@pytest.mark.parametrize(
    ("plus", "minus", "surface", "says"),
    [
        ({x: 1}, {x: 1, y: 1}, x, "the same states, at least one. Got x and x, y"),
        ({x: 1}, {x: -1}, sp.S.One, "depends on no state"),
        ({x: 1}, {x: -1}, "x", "surface is an expression"),
        ({x: a}, {x: -1}, x, "a has no value"),
        ({x: 1}, {x: -1}, x - a, "a has no value"),
        (3, {x: -1}, x, "plus maps symbols"),
    ],
)
def test_what_makes_no_such_field_is_refused(plus, minus, surface, says) -> None:
    with pytest.raises(DeclarationError, match=says):
        PiecewiseField(plus, minus, surface)
