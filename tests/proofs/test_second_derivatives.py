"""Derivatives along a line, over intervals and exactly, against SymPy's."""

from __future__ import annotations

import itertools
from fractions import Fraction
from typing import Any

import mpmath
import pytest
import sympy as sp

from gsp.proofs import intervals as ia
from gsp.proofs.programs import IntervalProgram, Rejected
from gsp.proofs.second_derivatives import along, exactly
from tests.proofs.test_programs import MIDDLE, RADII, RATIONAL, within

F = Fraction
t = sp.Symbol("t")
WAY = (F(1, 2), F(-3), F(2))
# Without a constant alone, of which the derivatives are not SymPy's to take, and negative powers, which are refused.
SMOOTH = [text for text in RATIONAL if text not in ("5", "7*z1**0", "z0**-2*-z1")]


@pytest.mark.exhaustive
@pytest.mark.parametrize("text", SMOOTH)
def test_rational_functions_have_the_derivatives_of_their_quotients(text: str) -> None:
    program = IntervalProgram(("z0", text), 3)
    whole = [(int((m - r) * ia.ONE), int((m + r) * ia.ONE)) for m, r in zip(MIDDLE, RADII)]
    over = along(program, 1, whole, [ia.of(w) for w in WAY])
    for shares in ((-1, -1, -1), (1, F(1, 3), -1), (F(1, 3), 1, 1)):
        point = [m + share * r for m, share, r in zip(MIDDLE, shares, RADII)]
        line = RATIONAL[text](*(sp.Rational(p) + sp.Rational(w) * t for p, w in zip(point, WAY)))
        exact = [_fraction(sp.diff(line, t, k)) for k in range(3)]
        assert list(exactly(program, 1, point, list(WAY))) == exact
        assert all(map(within, over, exact))
        found = along(program, 1, [ia.of(p) for p in point], [ia.of(w) for w in WAY])
        assert all(map(within, found, exact))
        assert max(high - low for low, high in found) < 1 << 20


def _fraction(expression: sp.Expr) -> Fraction:
    value = sp.Rational(expression.subs(t, 0))
    return F(int(value.p), int(value.q))


@pytest.mark.parametrize("name", ["exp", "sin", "cos", "tanh", "sinh", "cosh", "atan"])
def test_functions_have_their_derivatives(name: str) -> None:
    program = IntervalProgram((f"{name}(z0*(z0 + 2))",), 1)
    written: Any = getattr(sp, name)((2 * t) * (2 * t + 2))
    assert list(exactly(program, 0, [F(0)], [F(2)])) == [_fraction(sp.diff(written, t, k)) for k in range(3)]
    with pytest.raises(Rejected):
        exactly(program, 0, [F(1)], [F(2)])
    with mpmath.workprec(400):
        for radius, at in itertools.product((F(0), F(1, 64)), (F(1, 4), F(-3, 8))):
            box = (int((at - radius) * ia.ONE), int((at + radius) * ia.ONE))
            found = along(program, 0, [box], [ia.of(F(2))])
            for share in (-1, 1):
                place = mpmath.mpf(int(64 * (at + share * radius))) / 64
                for k, held in enumerate(found):
                    value = mpmath.diff(lambda v: getattr(mpmath, name)(v * (v + 2)), place, k) * 2**k
                    assert within(held, value)
                    assert radius or held[1] - held[0] < 1 << 14


@pytest.mark.parametrize("text", ["z0**-2", "sqrt(z0)", "z0**(1/2)", "log(z0)"])
def test_what_is_not_smooth_where_branches_meet_is_refused(text: str) -> None:
    with pytest.raises(Rejected):
        exactly(IntervalProgram((text,), 1), 0, [F(1)], [F(1)])
