"""The series carried back to raw variables: the sleigh's equation (18), and the invariance equation in them."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.slow.raw_series import RawManifold, carry_back
from gsp.slow.series import expand
from gsp.splitting.splitting import split
from gsp.systems.system import VectorField

v, omega, w, m, inertia, a, eps = sp.symbols("v omega w m I a epsilon")
x, y, z = sp.symbols("x y z")
J = inertia + m * a**2


def sleigh() -> VectorField:
    return VectorField(
        {
            v: omega * w + a * omega**2,
            omega: a * w / (inertia * eps),
            w: -v * omega - J * w / (inertia * m * eps),
        },
        epsilon=eps,
        parameters={m: 1, inertia: 1, a: 0.2},
    )


def carried(field: VectorField, *, order: int, start=None) -> RawManifold | None:
    splitting = split(field)
    manifold = solve_critical(splitting.system)
    branch = manifold.nearest(start) if start else manifold.branches[0]
    return carry_back(expand(branch, order=order), splitting)


def test_the_sleigh_in_v_and_omega_has_the_reference_slip() -> None:
    raw = carried(sleigh(), order=2)
    assert raw.chart == (v, omega)
    assert raw.order == 2
    g1 = -inertia * m * omega * v / J
    g2 = -(inertia**2) * a * m**2 * omega * (-inertia * omega**2 - a**2 * m * omega**2 + m * v**2) / J**3
    assert raw.coefficients[0]["w"] == 0
    assert sp.cancel(raw.coefficients[1]["w"] - g1) == 0
    assert sp.cancel(raw.coefficients[2]["w"] - g2) == 0


def test_equation_18_has_the_minus_sign_in_the_rate_of_v() -> None:
    raw = carried(sleigh(), order=1)
    assert sp.cancel(raw.reduced_field[0]["v"] - a * omega**2) == 0
    assert sp.cancel(raw.reduced_field[1]["v"] + inertia * m * v * omega**2 / J) == 0
    # omega' of (18), with d(v omega)/dt along the flow of order 0.
    along = a * omega**2 * omega + v * (-m * a * v * omega / J)
    assert sp.cancel(raw.reduced_field[0]["omega"] + m * a * v * omega / J) == 0
    assert sp.cancel(raw.reduced_field[1]["omega"] - inertia * m**2 * a / J**2 * along) == 0


def test_the_energy_of_the_sleigh_falls_at_the_first_order() -> None:
    raw = carried(sleigh(), order=1)
    slip = raw.coefficients[1]["w"]
    # 2E = m v^2 + J omega^2 + 2 m a omega w + O(epsilon^2), and E' = -w^2/epsilon = -epsilon w_1^2.
    energy = (m * v**2 + J * omega**2) / 2 + eps * m * a * omega * slip
    rates = {s: sum(raw.reduced_field[k][s] * eps**k for k in range(2)) for s in (v, omega)}
    change = sp.expand(sum(sp.diff(energy, s) * rates[s] for s in (v, omega)))
    assert sp.cancel(change.coeff(eps, 0)) == 0
    assert sp.cancel(change.coeff(eps, 1) + slip**2) == 0


FIELDS = {
    "sleigh": (sleigh(), None, {v: 0.7, omega: -0.9}),
    "linear integral": (
        VectorField({x: (y - 2 * x) / eps + y**2, y: (2 * x - y) / eps - y}, epsilon=eps),
        None,
        {y: 0.6},
    ),
    "nonlinear integral": (
        VectorField({x: x * (z - y) / eps + 1, y: (z - y) / eps, z: -z + x / 4}, epsilon=eps),
        None,
        {x: 0.8, z: 0.3},
    ),
    "two fast variables": (
        VectorField({x: (y - x) / eps + z, y: (x - 2 * y + z) / eps, z: (y - z) / eps - z**2}, epsilon=eps),
        None,
        {x: 0.3, y: 0.3, z: 0.3},
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", FIELDS)
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_the_invariance_equation_holds_in_raw_variables_to_the_order(case: str, order: int) -> None:
    field, start, point = FIELDS[case]
    raw = carried(field, order=order, start=start)
    assert raw is not None
    values = dict(field.parameters)
    others = raw.coefficients[0].symbols
    graph = {s: sum(raw.coefficients[k][s] * eps**k for k in range(order + 1)) for s in others}
    velocity = {s: sum(raw.reduced_field[k][s] * eps**k for k in range(order + 1)) for s in raw.chart}
    chart_point = {s: sp.Float(point.get(s, 0.5), 40) for s in raw.chart}
    defects = []
    for epsilon in (sp.Rational(1, 100), sp.Rational(1, 200)):
        there = {**values, **chart_point, eps: epsilon}
        on_graph = {s: e.subs(there) for s, e in graph.items()}
        rates = {s: e.subs({**there, **on_graph}) for s, e in field.equations.items()}
        defect = [rates[s] - velocity[s].subs(there) for s in raw.chart]
        for s in others:
            along = sum(sp.diff(graph[s], q).subs(there) * velocity[q].subs(there) for q in raw.chart)
            defect.append(rates[s] - along)
        # The pole multiplies the error of the graph, O(epsilon^(order + 1)), by 1/epsilon.
        defects.append(max(abs(epsilon * d) for d in defect))
    slope = float(sp.log(defects[0] / defects[1], 2))
    assert slope == pytest.approx(order + 1, abs=0.15)


def test_a_standard_system_is_its_own_raw_form() -> None:
    field = VectorField({y: (x - y - y**3) / eps, x: -y}, epsilon=eps)
    splitting = split(field)
    series = expand(solve_critical(splitting.system).branches[0], order=2)
    raw = carry_back(series, splitting)
    assert raw.chart == (x,)
    assert raw.coefficients == series.coefficients
    assert raw.reduced_field == series.reduced_field


def test_a_permuted_chart_keeps_names_and_rates_together() -> None:
    field = VectorField({z: x - z, y: (x * z - y) / eps, x: -x * y}, epsilon=eps)
    splitting = split(field)
    raw = carry_back(expand(solve_critical(splitting.system).branches[0], order=1), splitting)
    assert raw.chart == (z, x)
    assert raw.reduced_field[0]["z"] == x - z
    assert sp.expand(raw.reduced_field[0]["x"] + x**2 * z) == 0


def test_a_graph_that_no_formula_inverts_is_not_carried_back() -> None:
    # x = y/(1 + y) on M0, but p = x + y is a root of a quadratic in it.
    field = VectorField({x: (y - x * (1 + y)) / eps, y: (x * (1 + y) - y) / eps - y / 2}, epsilon=eps)
    assert carried(field, order=1) is None


def test_an_implicit_branch_in_new_coordinates_is_not_carried_back() -> None:
    field = VectorField({x: (y - x - x**3) / eps, y: -(y - x - x**3) / eps - y}, epsilon=eps)
    assert carried(field, order=1, start={"p": 0.5, "x": 0.2}) is None


def test_the_graph_over_raw_states_meets_the_graph_over_new_ones() -> None:
    field = sleigh()
    splitting = split(field)
    series = expand(solve_critical(splitting.system).branches[0], order=3)
    raw = carry_back(series, splitting)
    epsilon = 1e-3
    slow = {"v": 0.7, "p": -0.4}
    fast = series.evaluate({"v": [slow["v"]], "p": [slow["p"]]}, epsilon)[0]
    state = splitting.to_raw({**slow, "w": float(fast[0])})
    point = {**field.parameters, v: state["v"], omega: state["omega"]}
    again = sum(float(raw.coefficients[k]["w"].subs(point)) * epsilon**k for k in range(4))
    assert abs(again - state["w"]) < 10 * epsilon**4
    assert np.isfinite(again)
