"""A parameter stands for its value: every analysis of a system says the same of the system with the numbers put in."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.integration.surface_flow import _basis
from gsp.singular.passage.fold_measurement import fold_exit, upstream
from gsp.singular.passage.fold_passage import fold_passage
from gsp.singular.singular_orbit import singular_orbit
from gsp.systems.system import SlowFastSystem

x, y, z, p, q, r, eps = sp.symbols("x y z p q r epsilon")
VALUES = {p: sp.Rational(3, 2), q: sp.Rational(1, 2), r: sp.Rational(5, 4)}


def both(slow: dict, fast: dict) -> tuple[SlowFastSystem, SlowFastSystem]:
    """The system with parameters, and with their values in place of them."""
    put_in = [{s: sp.sympify(e).xreplace(VALUES) for s, e in rates.items()} for rates in (slow, fast)]
    return (
        SlowFastSystem(slow=slow, fast=fast, epsilon=eps, parameters=VALUES),
        SlowFastSystem(slow=put_in[0], fast=put_in[1], epsilon=eps),
    )


# Folds at x = +-1 where p y = -+1, so y = -+2/3; the slow rate has a term in the fast variable's square.
OSCILLATOR = both({y: -r * x + q * y / 5}, {x: p * y - q * x**3 + 3 * q * x})


def folded(system: SlowFastSystem) -> list[float]:
    passage = fold_passage(system, {"x": 1, "y": -2 / 3})
    return [
        *passage.point.values(), passage.a, passage.b, passage.c, passage.d, *passage.leading, *passage.logarithmic,
        *passage.slow_rate, *passage.along, *passage.drop.point.values(), passage.delay(1e-3),
        *passage.exit(1e-3).values(),
    ]  # fmt: skip


def measured(system: SlowFastSystem) -> list[float]:
    passage = fold_passage(system, {"x": 1, "y": -2 / 3})
    start, time, attraction = upstream(passage, 1e-2)
    found = fold_exit(passage, epsilon=1e-2)
    # Half way to where it lands.
    assert found.point["x"] == pytest.approx(0.5 * (1 + passage.drop.point["x"]), abs=1e-9)
    return [*start, time, attraction, *found.point.values()]


def relaxing(system: SlowFastSystem) -> list[float]:
    orbit = singular_orbit(solve_critical(system).branches[0], {"x": 2, "y": 2 / 3})
    assert orbit.coefficients is not None
    return list(orbit.coefficients)


ANALYSES: dict[str, tuple[tuple[SlowFastSystem, SlowFastSystem], Callable]] = {
    "the passage of a fold": (OSCILLATOR, folded),
    "a measured passage": (OSCILLATOR, measured),
    "a relaxation orbit": (OSCILLATOR, relaxing),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", ANALYSES)
def test_parameters_and_their_values_say_the_same(case: str) -> None:
    systems, analysis = ANALYSES[case]
    with_parameters, with_numbers = (analysis(system) for system in systems)
    assert np.array(with_parameters) == pytest.approx(np.array(with_numbers), rel=1e-9, abs=1e-12)


def test_upstream_lies_on_the_branch_where_the_attraction_is_what_it_says() -> None:
    """The reduced orbit into the fold of van der Pol: t and the attraction have formulas in x."""
    passage = fold_passage(
        SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=eps), {"x": 1, "y": -2 / 3}
    )
    start, time, attraction = upstream(passage, 1e-3)
    at, below = float(start[1]), float(start[0])
    assert below == pytest.approx(at**3 / 3 - at, abs=1e-7)
    # dt = -(x^2 - 1)/x dx, and |lambda| = x^2 - 1.
    assert time == pytest.approx((at**2 - 1) / 2 - np.log(at), rel=1e-3)
    integral = sp.lambdify(x, sp.integrate((x**2 - 1) ** 2 / x, x))
    assert attraction == pytest.approx(integral(at) - integral(1.0), rel=1e-2)


def test_the_bases_of_surfaces_are_chebyshevs_polynomials() -> None:
    unit = (x - 3) / 2
    for k, found in enumerate(_basis(x, 1.0, 5.0, 10)):
        assert sp.expand(sp.nsimplify(found) - sp.chebyshevt(k, unit)) == 0
    assert [len(_basis(x, 1.0, 5.0, size)) for size in (1, 2, 3)] == [1, 2, 3]
