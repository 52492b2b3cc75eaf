"""Fields that change over a narrow range: judged as written, not by what overflows or by what lies between samples."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.algebra import factorisation
from gsp.algebra.differentiation import derivative
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.hyperbolicity.hyperbolicity import Kind, classify
from gsp.hyperbolicity.losses.poles import denominators
from gsp.lowering.compiled_function import compile_function
from gsp.systems.system import SlowFastSystem
from tests.cases import crossed

x, y, a, w, eps = sp.symbols("x y a w epsilon")
Q = sp.Rational
U = (x - a) / w
DIPS = {
    "Gauss": 1 - Q(9, 10) * sp.exp(-(U**2)),
    "Gauss in decimals": 1 - sp.Float("0.9") * sp.exp(-(U**2)),
    "cosh": 1 - Q(9, 10) / sp.cosh(U) ** 2,
    "Cauchy": 1 - Q(9, 10) / (1 + U**2),
    "gate": 1 - Q(36, 10) * sp.exp(U) / (1 + sp.exp(U)) ** 2,
    "gates": 1 - Q(36, 10) / (1 + sp.exp(U)) * (1 - 1 / (1 + sp.exp(U))),
}


def judge(factor, region, values=None):
    system = SlowFastSystem(slow={x: 1 + 0 * y}, fast={y: -y * factor}, epsilon=eps, parameters=values or {})
    (branch,) = solve_critical(system).branches
    return classify(branch, region=region)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("name", "width", "region"),
    crossed(["Gauss", "Gauss in decimals", "cosh", "Cauchy"], [1e-2, 1e-3], [(0, 1), (0.5, 1), (-2, 2)]),
)
def test_a_narrow_dip_is_attracting_and_holds(name, width, region) -> None:
    found = judge(DIPS[name], {"x": region}, {a: 0.3, w: width})
    assert found.kind is Kind.ATTRACTING, found
    assert found.holds, found
    assert found.losses == ()
    if region[0] <= 0.3:
        assert found.gap == pytest.approx(0.1, rel=1e-6)
    else:
        assert found.gap >= 0.99


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(6))
def test_a_steep_gate_is_attracting_and_holds(seed) -> None:
    rng = np.random.default_rng(seed)
    width, middle = 10.0 ** rng.uniform(-5, -3), rng.uniform(0.2, 0.8)
    gate = 1 / (1 + sp.exp(-U))
    found = judge(1 + gate, {"x": (0, 1)}, {a: middle, w: width})
    assert found.kind is Kind.ATTRACTING, found
    assert found.holds, found
    assert found.gap == pytest.approx(1.0)


@pytest.mark.parametrize("steep", [1000, 2000, -30000])
@pytest.mark.parametrize("power", [1, 2])
def test_a_steep_gate_of_plain_numbers_holds(steep, power) -> None:
    """exp(1000 - 2000 x) overflows where the gate and all its slopes are 0 to rounding."""
    gate = (1 + sp.exp(-steep * (x - Q(1, 2)))) ** -power
    found = judge(1 + gate, {"x": (0, 1)}, {})
    assert found.kind is Kind.ATTRACTING, found
    assert found.holds, found


@pytest.mark.parametrize("part", DIPS.values(), ids=DIPS)
def test_slopes_that_do_not_overflow_are_those_that_are_written(part) -> None:
    for expression in (derivative(part, x), derivative(derivative(part, x), x)):
        compiled = compile_function([expression], arguments=[x], parameters=[a, w])
        for at in (-0.4, 0.29, 0.3, 0.37, 1.2):
            exact = expression.subs({a: Q(3, 10), w: Q(1, 10), x: Q(str(at))})
            assert compiled([at], [np.nan, 0.3, 0.1])[0] == pytest.approx(float(exact), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("steep", [1000, 2000, -30000])
@pytest.mark.parametrize("power", [1, 2])
def test_slopes_of_a_steep_gate_have_all_digits(steep, power) -> None:
    slope = derivative((1 + sp.exp(-steep * (x - Q(1, 2)))) ** -power, x)
    compiled = compile_function([slope], arguments=[x])
    for at in (Q(1, 20), Q(49, 100), Q(51, 100), Q(19, 20)):
        exact = sp.N(slope.subs(x, at), 30)
        assert compiled([float(at)], [np.nan])[0] == pytest.approx(float(exact), rel=1e-9, abs=1e-300)


@pytest.mark.exhaustive
@pytest.mark.parametrize("depth", [Q(11, 10), Q(101, 100)])
@pytest.mark.parametrize("width", [Q(1, 1000), Q(1, 10**4), Q(1, 10**5)])
def test_a_smooth_dip_that_crosses_zero_is_not_called_rough(width, depth) -> None:
    found = judge(1 - depth / (1 + ((x - Q(3, 10)) / width) ** 2), {"x": (0, 1)})
    assert found.kind is Kind.LOST
    assert found.losses
    edge = float(width) * (float(depth) - 1.0) ** 0.5
    for loss in found.losses:
        assert loss.kind is LossKind.RANK_CHANGE
        assert abs(loss.point["x"] - 0.3) == pytest.approx(edge, rel=1e-6)


def test_exponentials_and_hyperbolic_cosines_are_no_poles_and_others_are() -> None:
    assert denominators([sp.exp(-(x**2)) / sp.cosh(x)], (x,)) == []
    assert denominators([y / (x - 1) + sp.exp(-x)], (x, y)) == [x - 1]
    assert denominators([1 / (sp.exp(-x) - 2)], (x,)) == [sp.exp(-x) - 2]


def test_denominators_beyond_the_budget_are_what_stands_below_a_line(monkeypatch):
    monkeypatch.setattr(factorisation, "TERM_PRODUCTS", 2)
    found = denominators([y / (x - 1) + 1 / (sp.exp(-x) - 2) ** 2 + x**2 + 1 / (y + 3)], (x,))
    assert set(found) == {x - 1, sp.exp(-x) - 2}


def test_a_pole_between_exponentials_is_found_and_a_removable_one_is_not() -> None:
    found = judge(1 + Q(1, 10) / (sp.exp(x) - 2), {"x": (0, 1)})
    assert [loss.kind for loss in found.losses if loss.is_pole] == [LossKind.FIELD_POLE]
    removable = judge((sp.exp(2 * x) - 1) / (sp.exp(x) - 1), {"x": (-1.1, 1)})
    assert removable.losses == ()
    assert removable.kind is Kind.ATTRACTING
