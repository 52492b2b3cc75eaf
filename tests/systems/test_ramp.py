"""Ramps: each profile against its formula in time, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError
from gsp.systems.ramp import PHASE, Ramp

l, m, t, r, x = sp.symbols("l m t r x", positive=True)  # noqa: E741
FORMULAS = {
    "tanh": (Ramp.tanh({l: (2, 5)}), 2 + 3 * (1 + sp.tanh(r * t)) / 2, sp.tanh(r * t)),
    "logistic": (Ramp.logistic({l: (5, 2)}), 5 - 3 / (1 + sp.exp(-3 * r * t)), 1 / (1 + sp.exp(-3 * r * t))),
    "linear": (Ramp.linear({l: (2, -1)}), 2 - r * t, r * t),
    "linear with ends": (Ramp.linear_with_ends({l: (5, 2)}), 5 - r * t, r * t / 3),
    "there and back": (Ramp.there_and_back({l: (2, 5)}), 2 + 3 / sp.cosh(r * t), 2 * sp.atan(sp.exp(r * t))),
}


@pytest.mark.parametrize("name", FORMULAS)
def test_profiles_are_these_functions_of_time(name: str) -> None:
    ramp, value, phase = FORMULAS[name]
    moved = sp.lambdify((r, t), [value, ramp.parameters[l].xreplace({PHASE: phase})])
    speed = sp.lambdify((r, t), [sp.diff(phase, t), r * ramp.profile.xreplace({PHASE: phase})])
    for at in (0.1, 0.5, 0.9):
        assert np.ptp(moved(0.7, at)) < 1e-12
        assert np.ptp(speed(0.7, at)) < 1e-12


def test_several_parameters_move_together() -> None:
    ramp = Ramp.linear_with_ends({l: (0, 2), m: (5, 1)})
    assert ramp.parameters == {l: 2 * PHASE, m: 5 - 4 * PHASE}
    assert ramp.profile == sp.Rational(1, 2)


def test_amplified_changes_start_where_they_did() -> None:
    ramp = Ramp.tanh({l: (2, 5)}).amplified(0.5)
    assert [ramp.parameters[l].xreplace({PHASE: e}) for e in ramp.ends] == [2, sp.Rational(7, 2)]


def test_a_field_along_a_ramp_has_the_phase_for_a_parameter() -> None:
    field = gsp.VectorField({x: l * x + m}, epsilon=None, parameters={l: 1, m: 3})
    along = Ramp.tanh({l: (0, 2)}).along(field)
    assert along.rates == (x * (PHASE + 1) + m,)
    assert dict(along.parameters) == {m: 3, PHASE: -1}


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: Ramp.tanh({l: 3}), "two values"),
        (lambda: Ramp.tanh({}), "one parameter or more"),
        (lambda: Ramp.logistic({}), "one parameter or more"),
        (lambda: Ramp.linear(None), "one parameter or more"),
        (lambda: Ramp.there_and_back([(l, 0, 3)]), "one parameter or more"),
        (lambda: Ramp({l: PHASE}, 1, 3), "the two numbers"),
        (lambda: Ramp({l: PHASE}, 1, (0, 1, 2)), "the two numbers"),
        (lambda: Ramp.logistic({l: (2, 2)}), "from one value to another"),
        (lambda: Ramp({l: PHASE}, 1, (0, 0)), "two different ends"),
        (lambda: Ramp({l: PHASE}, 1, (0, x)), "is a number"),
        (lambda: Ramp.tanh({m: (0, 1)}).along(gsp.VectorField({x: -x}, epsilon=None)), "no parameter"),
        (
            lambda: Ramp({l: r * PHASE}, 1, (0, 1)).along(
                gsp.VectorField({x: -l * x}, epsilon=None, parameters={l: 1})
            ),
            "holds r",
        ),
        (
            lambda: Ramp.tanh({l: (0, 1)}).along(
                gsp.VectorField({PHASE: -l * PHASE}, epsilon=None, parameters={l: 1})
            ),
            "another `phase`",
        ),
    ],
)
def test_what_is_not_well_formed_is_refused_by_name(make, said: str) -> None:
    with pytest.raises(DeclarationError, match=said):
        make()
