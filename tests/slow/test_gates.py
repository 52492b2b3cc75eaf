"""Boltzmann gates, channel rates and Arrhenius terms, through the stages; the series is checked by its exact defect."""

import mpmath
import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.hyperbolicity.hyperbolicity import Kind, classify
from gsp.slow.series import SeriesManifold, expand
from gsp.systems.system import SlowFastSystem

x, y, a, b, eps = sp.symbols("x y a b epsilon")
half = sp.Rational(1, 2)

# Functions of u; with numbers, and with the symbolic parameters a = 3/10 and b = 2.
FORMS = {
    "boltzmann": 1 / (1 + sp.exp(-x)),
    "boltzmann of half activation": 1 / (1 + sp.exp(1 - x)),
    "boltzmann with a slope": 1 / (1 + sp.exp(-(x + a) / b)),
    "boltzmann with decimals": 1 / (1 + sp.exp(sp.Rational(-3, 2) - x / 9)),
    "two gates of one slope": 1 / (1 + sp.exp((a - x) / b)) + 1 / (1 + sp.exp((x - a) / b)) ** 2,
    "gates of commensurable slopes": 1 / (1 + sp.exp(-x / 10)) - 1 / (2 + sp.exp(-x / 20)) ** 3,
    "tanh gate": (1 + sp.tanh((x - a) / b)) / 2,
    "sech rate": 1 / sp.cosh((x - a) / (2 * b)),
    "gate and sech rate": (1 + sp.tanh((x - a) / b)) / 2 * sp.cosh((x - a) / (2 * b)),
    "sodium activation": (x + 4) / 10 / (1 - sp.exp(-(x + 4) / 10)) / 10,
    "sodium decay": 4 * sp.exp(-(x + 6) / 18) / 10,
    "rates in a quotient": sp.exp(x / 8) / (sp.exp(x / 8) + 4 * sp.exp(-(x + a) / 18)),
    "arrhenius": sp.exp(2 - 2 / x),
    "arrhenius with parameters": sp.exp(b - b / x),
    "arrhenius in the other variable": x * sp.exp(20 - 20 / x) / 3,
    "gaussian": 1 - 3 * sp.exp(-(((x - a) / b) ** 2)) / 4,
    "hill": x**4 / (a**4 + x**4),
    "hill with an exponent": x**b / (a**b + x**b) / 2,
    "root": sp.sqrt(1 + x**2) / (1 + sp.exp(-x / b)),
    "logistic of a logarithm": 1 / (1 + sp.exp(-sp.log(1 + x**2) / b)),
    "error function": (1 + sp.erf((x - a) / b)) / 2,
}


def defect(series: SeriesManifold, at: float, value: float) -> mpmath.mpf:
    """epsilon Dh f - g of the printed coefficients at x = `at`, in 100 digits at epsilon = 1e-10.

    Nothing of the package but the printed coefficients goes in: slopes are central differences along M0, whose
    points Newton's method finds from `value`.
    """
    system = series.branch.system
    values = dict(system.parameters)

    def function(expression: sp.Expr):
        return sp.lambdify((x, y, eps), expression.xreplace(values), "mpmath")

    f, g = function(system.f[0]), function(system.g[0])
    h = [function(row[0]) for row in series.coefficients]

    def manifold(place: mpmath.mpf, small: mpmath.mpf) -> mpmath.mpf:
        point = mpmath.findroot(lambda v: g(place, v, mpmath.mpf(0)), value, tol=mpmath.mpf(10) ** -180)
        return sum(small**k * e(place, point, small) for k, e in enumerate(h))

    with mpmath.workdps(100):
        place, small, step = mpmath.mpf(at), mpmath.mpf(10) ** -10, mpmath.mpf(10) ** -30
        slope = (manifold(place + step, small) - manifold(place - step, small)) / (2 * step)
        Y = manifold(place, small)
        return abs(small * slope * f(place, Y, small) - g(place, Y, small))


def check(system: SlowFastSystem, region, start, *, symbolic: int = 1, numbers: int = 2) -> None:
    branch = solve_critical(system).nearest(start)
    verdict = classify(branch, region=region)
    assert verdict.kind is Kind.ATTRACTING
    assert verdict.holds, verdict
    # A wrong h_n would leave about 10^(-10 n).
    for series in (expand(branch, order=symbolic), expand(branch, order=numbers, symbolic=False)):
        at = sum(region["x"]) / 2 + 0.1
        (value,) = branch.points({"x": at})
        assert defect(series, at, value) < 10.0 ** (-10 * series.order - 5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", FORMS)
def test_a_gate_on_an_explicit_branch(name: str) -> None:
    system = SlowFastSystem(
        slow={x: -x * y / 3 + half}, fast={y: FORMS[name] - y}, epsilon=eps, parameters={a: 0.3, b: 2}
    )
    check(system, {"x": (0.5, 1.5)}, {"x": 1, "y": 0.5})


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", FORMS)
def test_a_gate_on_an_implicit_branch(name: str) -> None:
    system = SlowFastSystem(
        slow={x: half - y},
        fast={y: FORMS[name].subs(x, y / 2 + half) / 20 + x - y - y**3 / 3},
        epsilon=eps,
        parameters={a: 0.3, b: 2},
    )
    check(system, {"x": (0.5, 1.5), "y": (0, 2)}, {"x": 1, "y": 0.8})


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", FORMS)
def test_a_gate_that_multiplies_the_fast_variable(name: str) -> None:
    system = SlowFastSystem(
        slow={x: y - x},
        fast={y: -y * (1 + FORMS[name] ** 2) + FORMS[name] * (1 - y) ** 2 / 9 + eps * x},
        epsilon=eps,
        parameters={a: 0.3, b: 2},
    )
    check(system, {"x": (0.5, 1.5), "y": (-0.1, 2)}, {"x": 1, "y": 0.1}, symbolic=0, numbers=1)


@pytest.mark.exhaustive
def test_morris_lecar_expands_with_symbolic_parameters() -> None:
    V, w, V1, V2, V3, V4, phi, current = sp.symbols("V w V1 V2 V3 V4 phi I")
    m = (1 + sp.tanh((V - V1) / V2)) / 2
    gate = 1 / (1 + sp.exp(-2 * (V - V3) / V4))
    system = SlowFastSystem(
        slow={w: phi * (gate - w) * sp.cosh((V - V3) / (2 * V4))},
        fast={V: current - 2 * (V + 60) - 4 * m * (V - 120) - 8 * w * (V + 84)},
        epsilon=eps,
        parameters={V1: -1.2, V2: 18, V3: 12, V4: 17.4, phi: 1, current: 60},
    )
    branch = solve_critical(system).nearest({"w": 0.1, "V": -40})
    verdict = classify(branch, region={"w": (0.1, 0.2), "V": (-60, -20)})
    assert verdict.kind is Kind.ATTRACTING
    series = expand(branch, order=1)
    ratios = [np.abs(series.residual({"w": 0.15}, e)).max() for e in (0.02, 0.01)]
    assert ratios[0] / ratios[1] == pytest.approx(4, rel=0.2)
