"""How near a run stays to where a part of the field is at rest, in any units."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.reductions.fast_parts import fast_parts
from gsp.reductions.screening import defect
from gsp.systems.system import VectorField


@pytest.mark.parametrize("powers", [(0, 0, 0), (-6, 6, 2), (9, -9, -3)])
def test_what_is_near_is_near_in_all_units(powers: tuple[int, ...]) -> None:
    """A voltage and its gates: in units 1e12 apart the rank of their rates was less than their number."""
    a, b, c = states = sp.symbols("a b c")
    rates = {a: 900 * (b + c - 2 * a), b: 700 * (a / 3 + c - b), c: -c * a}
    units = {s: sp.Integer(10) ** power for s, power in zip(states, powers)}
    inner = {s: s * unit for s, unit in units.items()}
    field = VectorField({s: rate.xreplace(inner) / units[s] for s, rate in rates.items()})
    (part,) = [each for each in fast_parts(field) if each.name == "quasi-steady state of a, b"]
    start = {s.name: float(1 / units[s]) for s in states}
    run = gsp.integrate(field, start=start, span=(0, 5), rtol=1e-10, atol=1e-30)
    found = defect(field, part, run, np.linspace(0.0, 5.0, 40))
    # To leading order the lag of a and b is J^-1 (a', b') on the manifold a = 6c/5, b = 7c/5.
    place = run.at(2.5) * np.array([float(units[s]) for s in states])
    lag = np.linalg.solve([[-1800.0, 900.0], [700.0 / 3, -700.0]], np.array([1.2, 1.4]) * -place[2] * place[0])
    assert found == pytest.approx(float(np.abs(lag / np.array([1.2, 1.4])).max()), rel=0.5)


@pytest.mark.parametrize("order", [2, 3])
def test_a_start_from_nothing_hides_no_part(order: int) -> None:
    """A radical that is lost with others of its kind: at 0, where it begins, its rate does not depend on it."""
    x, y = sp.symbols("x y")
    field = VectorField({x: 1000 * (y - x**order), y: -y})
    (part,) = [each for each in fast_parts(field) if each.name == "quasi-steady state of x"]
    run = gsp.integrate(field, start={"x": 0, "y": 1}, span=(0, 2), rtol=1e-9, atol=1e-12)
    found = defect(field, part, run, np.linspace(0.0, 2.0, 41))
    # x lags behind h = y^(1/order) by h'/(1000 order h^(order - 1)), relative to its largest value, 1.
    lag = np.exp(-np.linspace(0.0, 2.0, 41) * (2.0 / order - 1.0)) / (1000 * order**2)
    assert found == pytest.approx(float(np.median(lag)), rel=0.1)


def test_what_attracts_at_half_of_the_places_at_most_is_infinitely_far() -> None:
    x, y = sp.symbols("x y")
    field = VectorField({x: y * x, y: sp.Integer(1)})
    (part,) = [each for each in fast_parts(field) if each.name == "quasi-steady state of x"]
    run = gsp.integrate(field, start={"x": 1, "y": -2}, span=(0, 4), rtol=1e-9, atol=1e-12)
    assert np.isfinite(defect(field, part, run, np.linspace(0.0, 3.0, 41)))
    assert defect(field, part, run, np.linspace(1.5, 4.0, 41)) == np.inf
