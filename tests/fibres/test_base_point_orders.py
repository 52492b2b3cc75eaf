"""Which order of a base point's series is taken, and the error that it is given."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import sympy as sp

from gsp import SlowFastSystem
from gsp.fibres.base_points import base_point_of
from gsp.fibres.inner_expansion import InnerExpansion


def point(
    coefficients: dict[str, list[float]], epsilon: float, order: int | None = None, *, is_exact: bool = True
):
    fast = sp.Symbol("fast")
    system = SlowFastSystem(
        slow={sp.Symbol(n): 0 for n in coefficients}, fast={fast: -fast}, epsilon=sp.Symbol("epsilon")
    )
    inner = InnerExpansion(
        branch=SimpleNamespace(is_explicit=True, system=system),  # pyright: ignore[reportArgumentType]
        start={**dict.fromkeys(coefficients, 1.0), "fast": 1.0},
        order=len(next(iter(coefficients.values()))) - 1,
        slow=tuple(coefficients),
        terms={name: tuple(SimpleNamespace(outer=[c]) for c in of) for name, of in coefficients.items()},
        is_exact=is_exact,
        direction=1,
        gap=1.0,
    )
    return base_point_of(inner, epsilon, order)


def test_values_are_summed_through_the_order_and_the_error_is_the_larger_of_the_next_two_terms() -> None:
    series = {"x": [1.0, 2.0, 3.0, 4.0], "y": [-1.0, 0.0, 0.0, 50.0]}
    found = point(series, 0.1, 1)
    assert (found["x"], found["y"]) == pytest.approx((1.2, -1.0))
    # 3 epsilon^2 = 0.03 against 50 epsilon^3 = 0.05.
    assert found.error == pytest.approx(0.05)
    assert point(series, 0.01, 1).error == pytest.approx(3e-4)
    assert point(series, 0.1, 0).error == pytest.approx(0.2)
    assert (found.order, dict(found.coefficients)) == (1, {"x": (1.0, 2.0), "y": (-1.0, 0.0)})
    assert found.route == "exact series through order 1"
    assert point(series, 0.1, 1, is_exact=False).route == "sampled series through order 1"


def test_without_an_order_the_least_error_decides_and_a_term_that_vanishes_by_chance_does_not() -> None:
    growing = {"x": [1.0, 0.0, 8.0, 0.0, 900.0, 10**5]}
    # Terms at 0.1: 0, 0.08, 0, 0.09, 1; the pairs after each order: 0.08, 0.08, 0.09, 1.
    assert point(growing, 0.1).order == 0
    # At 0.01 they are 0, 8e-4, 0, 9e-6, 1e-5: after order 2 come 0 and 9e-6.
    assert point(growing, 0.01).order == 2
    assert point(growing, 0.01).error == pytest.approx(9e-6)


@pytest.mark.parametrize(("is_exact", "unit"), [(True, 4e-16), (False, 1e-14)])
def test_no_error_is_below_rounding_of_the_largest_term(is_exact: bool, unit: float) -> None:
    assert point({"x": [3.0, 0.0, 0.0]}, 0.1, 0, is_exact=is_exact).error == pytest.approx(3 * unit)
    assert point({"x": [0.0, 50.0, 0.0, 0.0]}, 0.1, 1, is_exact=is_exact).error == pytest.approx(5 * unit)
