"""Fourier polynomials: exact means, integrals and harmonics, against SymPy's integrals."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.algebra.fourier_ring import FourierRing
from gsp.algebra.ring import read
from gsp.errors import UnsupportedFunctionError

x, y, theta = sp.symbols("x y theta", real=True)
WAVES = [
    sp.Integer(3) * x,
    sp.cos(theta) ** 6 * x - y,
    (x * sp.cos(theta) + sp.sin(2 * theta)) ** 3 + x * sp.sin(theta) ** 4,
    sp.sin(3 * theta - x) * sp.cos(2 * theta) * sp.exp(y),
    (sp.cos(theta) - y * sp.sin(-theta)) ** 4 / (1 + x**2),
]


@pytest.mark.exhaustive
@pytest.mark.parametrize("wave", WAVES)
def test_mean_and_harmonics_are_those_of_integrals(wave: sp.Expr) -> None:
    ring = FourierRing([x, y], functions=True)
    element = read(ring.harmonics_of(wave, theta), ring, {})
    mean = sp.integrate(sp.expand(wave.rewrite(sp.exp), func=True), (theta, 0, 2 * sp.pi)) / (2 * sp.pi)
    point = {x: sp.Rational(1, 3), y: sp.Rational(-2, 5)}
    assert sp.N((mean - ring.to_sympy(ring.mean(element))).subs(point), 20) == pytest.approx(0, abs=1e-15)
    series = ring.in_harmonics(element, theta)
    for angle in (0, sp.Rational(7, 10), 3):
        assert sp.N((series - wave).subs(point).subs(theta, angle), 20) == pytest.approx(0, abs=1e-15)


@pytest.mark.parametrize("wave", WAVES)
def test_the_integral_is_of_mean_zero_and_gives_back_what_varies(wave: sp.Expr) -> None:
    ring = FourierRing([x, y], functions=True)
    element = read(ring.harmonics_of(wave, theta), ring, {})
    found = ring.integral(element)
    assert ring.mean(found).is_zero
    assert (ring.derive(found, 2) - element + ring.mean(element)).reduced().is_zero


@pytest.mark.parametrize(
    ("wave", "named"),
    [
        (1 / (2 + sp.cos(theta)), "1/(cos(theta) + 2) has no finite Fourier series in theta"),
        (x * sp.exp(sp.cos(theta)), "exp(cos(theta)) has no finite Fourier series"),
        (x + sp.tan(theta), "tan(theta) has no finite Fourier series"),
        (sp.Abs(sp.sin(theta)), "Abs(sin(theta)) has no finite Fourier series"),
        (theta * sp.sin(theta), "theta has no finite Fourier series"),
        (sp.sin(theta / 2), "sin(theta/2) is no harmonic of the phase theta"),
        (sp.cos(theta + sp.sin(theta)), "is no harmonic of the phase theta"),
        (sp.cos(x * theta), "is no harmonic of the phase theta"),
    ],
)
def test_what_has_no_finite_series_is_refused_by_name(wave: sp.Expr, named: str) -> None:
    with pytest.raises(UnsupportedFunctionError) as caught:
        FourierRing([x]).harmonics_of(wave, theta)
    assert named in str(caught.value)
