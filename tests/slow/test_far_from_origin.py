"""Systems that are shifted by c: what is found of them is shifted by c, to the rounding of c."""

import numpy as np
import pytest
import sympy as sp

import gsp

x, y, t, epsilon = sp.symbols("x y t epsilon")
# g(x, t, y), and whether the sheet is shifted with t.
SHEETS = [
    (x + t**4 - y, 0),
    (x * sp.exp(-4 * t**2 - t * x / 9) - y, 0),
    (x / (1 + t**2) - y, 0),
    (x + t**2 * x + t - y * (1 + t**2), 0),
    (x + t - y**3 - y, 1),
    (x + 2 + t**2 - y**2, 1),
    (x + (t - y) ** 3 + (t - y), 1),
]


def far(g: sp.Expr, shifted: int, c: int) -> tuple[gsp.SeriesManifold, np.ndarray]:
    """The series of the system at t = c + 1, and the terms of order 0 to 3 there at epsilon = 0.01."""
    moved = g.xreplace({t: t - c, y: y - shifted * c})
    system = gsp.SlowFastSystem(slow={x: -x, t: sp.Integer(1)}, fast={y: moved}, epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0]
    if not branch.is_explicit:
        branch = branch.through({"x": 1, "t": c + 1, "y": shifted * c + 1})
    series = gsp.expand(branch, order=3)
    terms = series.terms([1.0, c + 1.0], 0.01).ravel()
    return series, terms - np.array([shifted * c, 0, 0, 0])


@pytest.mark.parametrize("c", [80, 10**6])
@pytest.mark.parametrize(("g", "shifted"), SHEETS)
def test_a_series_far_from_the_origin_is_the_one_at_it(g: sp.Expr, shifted: int, c: int) -> None:
    """Its terms change by less than 100 there when t does by 1, so that the rounding of t is that many times eps c."""
    at_origin, there = far(g, shifted, 0)[1], far(g, shifted, c)[1]
    assert there == pytest.approx(at_origin, rel=1e-13, abs=100 * c * np.finfo(float).eps)
    assert np.abs(there - at_origin)[1:] == pytest.approx(0, abs=c * np.finfo(float).eps)


def test_a_formula_far_from_the_origin_is_written_about_its_centre() -> None:
    branch = far(SHEETS[0][0], 0, 1000)[0].branch
    assert branch.graph == {y: x + (t - 1000) ** 4}


@pytest.mark.parametrize("c", [0, 10**4, 10**6])
def test_the_sheets_over_a_point_far_from_the_origin_are_all_found(c: int) -> None:
    u = y - c
    system = gsp.SlowFastSystem(slow={x: u}, fast={y: x - c - u**5 / 3 + u**2}, epsilon=epsilon)
    found = gsp.solve_critical(system).branches[0].roots([c - 0.1])
    every = np.roots([-1 / 3, 0, 0, 1, 0, -0.1])
    real = np.sort(every.real[every.imag == 0])
    assert found.ravel() - c == pytest.approx(real, abs=1e-12 + 10 * c * np.finfo(float).eps)


@pytest.mark.parametrize("c", [0, 10**6])
def test_a_delayed_exit_far_from_the_origin_is_the_one_at_it(c: int) -> None:
    """The orbit is known to the rounding of c alone, and one step of the length of c would hold the whole passage."""
    u, v = y - c, x - c
    system = gsp.SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: (v + v**2 / 2) * u}, epsilon=epsilon)
    branch = gsp.solve_critical(system).branches[0]
    passed = gsp.entry_exit(branch, start={"x": c - 0.5})
    # Behind 0 the integral of v + v^2/2 takes the value again that it has at -1/2.
    exit_at = max(root.real for root in np.roots([1 / 6, 1 / 2, 0, -(0.125 - 0.125 / 6)]))
    assert passed.point["x"] - c == pytest.approx(exit_at, abs=1e-9 + 1e3 * c * np.finfo(float).eps)
