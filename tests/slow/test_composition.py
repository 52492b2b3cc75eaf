"""What is composed with a slow manifold has the coefficients that its Taylor expansion in epsilon gives."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.slow.composition import compose
from gsp.slow.series import expand
from gsp.systems.system import SlowFastSystem

x, w, y, z, eps = sp.symbols("x w y z epsilon")
VALUES = (
    1 / (3 + sp.sqrt(9 - x * y)),
    sp.sqrt(9 - x * y),
    sp.exp(y) / (1 + y**4 * x),
    sp.sqrt(2 + y) / (3 * x + w**2),
)
# The critical manifold of the first is implicit, and x = y + y^3 makes 9 - x y of degree four in the coordinate left.
# In the second 3 x + w^2 is a denominator before any function is there; its leading term is another one then.
IMPLICIT = SlowFastSystem(slow={x: -y, w: -w}, fast={y: x - y - y**3}, epsilon=eps)
DENOMINATORS = SlowFastSystem(slow={x: -y, w: -w}, fast={y: 1 - y * (3 * x + w**2)}, epsilon=eps)
PLACES = [(IMPLICIT, {x: "5/8", w: "1/3", y: "1/2"}), (DENOMINATORS, {x: "1/2", w: "1/2"})]


@pytest.mark.exhaustive
@pytest.mark.parametrize(("system", "place"), PLACES, ids=("implicit", "denominators first"))
@pytest.mark.parametrize("value", VALUES, ids=str)
def test_functions_of_a_rational_system_are_composed(
    system: SlowFastSystem, place: dict, value: sp.Expr
) -> None:
    series = expand(solve_critical(system).branches[0], order=2)
    found = compose(series, {z: value, x: value * value})
    point = {s: sp.Rational(v) for s, v in place.items()}
    own = [sp.N(h[0].subs(point), 40) for h in series.coefficients]
    along = {**{s: v for s, v in point.items() if s != y}, y: sp.Add(*(h * eps**k for k, h in enumerate(own)))}
    for j, whole in enumerate((value, value * value)):
        for k in range(3):
            expected = sp.diff(whole.subs(along), eps, k).subs(eps, 0) / sp.factorial(k)
            assert abs(sp.N(found[k][j].subs(point), 40) - sp.N(expected, 40)) < 1e-30
    # However often the ordering changed, equal denominators are one.
    below = series.chart.ring.denominators
    assert len({str(p / p.leading_coefficient()) for p in below}) == len(below)
