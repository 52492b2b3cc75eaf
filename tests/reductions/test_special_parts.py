"""Errors of the reductions at special values of parameters: of what counts, and behind layers that leave something."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.integration.trajectory import trajectory_of
from gsp.reductions.special_parts import Layers, _layer, with_errors
from gsp.scales.special_values import small_parameters

u, v, a, b, k, x, y = sp.symbols("u v a b k x y")


def errors(rates: dict, values: dict, start: dict, end: float) -> dict[tuple[str, ...], float | None]:
    """By what vanishes, the error of the reduction to one dimension over a span."""
    field = gsp.VectorField(rates, parameters=values)
    scene = gsp.Scene(field, {}, start, (0, end), tolerance=1e-3)
    run = trajectory_of(field, start=start, span=scene.span, epsilon=None, rtol=1e-10, atol=1e-12)
    found = with_errors(scene, run, small_parameters(field, dimensions=[1]))
    # What the exact algebra forms for a reduction is most of the work.
    assert all(np.isfinite(each.error) for each in found if each.error is not None and "reduced" in vars(each))
    return {each.vanishing: each.error for each in found}


def test_where_nothing_depends_on_what_is_left_out_its_own_error_counts() -> None:
    """u' = -a u is exact whatever v is; v' = b (u - v) is off by a/(b - a) (exp(-a t) - exp(-b t)), not by 0."""
    found = errors({u: -a * u, v: b * (u - v)}, {a: 0.1, b: 5}, {"u": 1, "v": 1}, 10)
    times = np.linspace(0, 10, 2001)
    assert found["a",] == pytest.approx(
        (0.1 / 4.9 * (np.exp(-0.1 * times) - np.exp(-5 * times))).max(), rel=0.02
    )


def test_the_states_that_stay_count_where_they_depend_on_the_others() -> None:
    """u' = -a v with v = u to leading order: u is off by the second order of a/b in its rate."""
    found = errors({u: -a * v, v: b * (u - v)}, {a: 0.1, b: 5}, {"u": 1, "v": 1}, 10)
    times = np.linspace(0, 10, 2001)
    slow, fast = np.roots([1, 5, 0.5])[::-1]
    first = (-0.1 - fast) / (slow - fast)
    exact = first * np.exp(slow * times) + (1 - first) * np.exp(fast * times)
    assert found["a",] == pytest.approx(np.abs(np.exp(-0.1 * times) - exact).max(), rel=0.02)


def test_behind_a_layer_of_more_than_half_the_span_nothing_is_told() -> None:
    rates = {u: -a * v, v: b * (u - v)}
    layer = np.log(1 / (0.1 * 1e-3)) / 0.5
    for end, told in ((3 * layer, True), (1.5 * layer, False)):
        found = errors(rates, {a: 0.01, b: 0.5}, {"u": 1, "v": 0}, end)["a",]
        assert found is not None
        assert np.isfinite(found) is np.bool_(told)


@pytest.mark.exhaustive
def test_a_reduction_that_divides_by_zero_at_the_own_values_is_not_told() -> None:
    """Where b v = u the rates leave u' = a u/(a - b): a = b is no such place, and no error is told there."""
    rates = {u: -u, v: (a * v - b * v + u) * 50 * b}
    found = errors(rates, {a: 1, b: 1}, {"u": 1, "v": 1}, 5)
    assert all(error is None or not np.isfinite(error) for error in found.values())


@pytest.mark.parametrize(
    "rates",
    [
        {x: (y - x) / a - b * x * y, y: b * (1 - y) - k * x},
        {x: a / (a + b) * (y - x), y: k * (1 - y)},
        {x: (y - x) * a / b**2 - k * x, y: a * x - y},
    ],
    ids=["one that divides", "a ratio of two", "a ratio to a square"],
)
def test_the_layer_is_the_leading_part_along_the_ray_whatever_was_known_before(rates) -> None:
    field = gsp.VectorField(rates, parameters={a: 0.1, b: 0.2, k: 0.3})
    known: Layers = {}
    found = small_parameters(field)
    for each in found:
        layer = _layer(each, known)
        for z, rate in each.field.equations.items():
            leading = sp.limit(each.epsilon * rate, each.epsilon, 0).xreplace(dict(field.parameters))
            assert sp.simplify(layer.equations[z].xreplace(dict(layer.parameters)) - leading) == 0
    assert found
    assert len(known) <= len({each.vanishing for each in found})
