"""Derivatives as multilinear forms: those of SymPy, in any order of the variables, and no more than are not zero."""

from __future__ import annotations

from functools import partial
from itertools import pairwise, product
from unittest.mock import Mock

import numpy as np
import pytest
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.critical import multilinear_form
from gsp.critical.layer_problem import LayerProblem
from gsp.critical.multilinear_form import Derivatives
from gsp.lowering.compiled_function import compile_function
from gsp.systems.system import SlowFastSystem

STATES = sp.symbols("p q r")
p, q, r = STATES
FIELD = [p**2 * q - sp.exp(q * r) + r, sp.Abs(p) * q**3 / (2 + r), 5 * r - p]


@pytest.mark.exhaustive
@pytest.mark.parametrize("order", [1, 2, 3])
def test_a_form_is_what_its_derivatives_say(order: int) -> None:
    form = Derivatives(FIELD, STATES, order, partial(compile_function, arguments=STATES)).at(
        np.array([0.3, -0.7, 0.4]), np.array([0.0])
    )
    point = {p: 0.3, q: -0.7, r: 0.4}
    smooth = [function.subs(sp.Abs(p), p) for function in FIELD]
    expected = np.array(
        [
            float(sp.diff(function, *symbols).subs(point))
            for function in smooth
            for symbols in product(STATES, repeat=order)
        ]
    ).reshape(3, *[3] * order)
    assert form.dense(3) == pytest.approx(expected, rel=1e-13, abs=1e-15)
    rng = np.random.default_rng(order)
    vectors = [rng.normal(size=3) + 1j * rng.normal(size=3) for _ in range(order)]
    contracted = expected
    for vector in reversed(vectors):
        contracted = contracted @ vector
    assert form(*vectors) == pytest.approx(contracted, rel=1e-13)
    assert form(*(vector.real for vector in vectors)).dtype == float


@pytest.mark.exhaustive
def test_what_a_field_does_not_contain_is_not_differentiated(monkeypatch: pytest.MonkeyPatch) -> None:
    # 1.3 million different derivatives of each of 200 equations, of which all but one or none are zero.
    x, *fast = sp.symbols("x, y0:200")
    chain = [x - fast[0] ** 2, *(a - b - b**3 for a, b in pairwise(fast))]
    system = SlowFastSystem(slow={x: -x}, fast=dict(zip(fast, chain)), epsilon=sp.Symbol("epsilon"))
    problem = LayerProblem(system, (x,), {})
    asked = Mock(wraps=derivative)
    monkeypatch.setattr(multilinear_form, "derivative", asked)
    u = np.linspace(0.5, 1.0, 201)
    third, second = problem.third(u), problem.second(u)
    assert asked.call_count <= 2000
    assert third.values == pytest.approx(np.full(199, -6.0))
    assert third(u[1:], u[1:], u[1:])[1:] == pytest.approx(-6.0 * u[2:] ** 3)
    assert np.count_nonzero(second) == 200
    assert second[0, 1, 1] == -2.0


def test_a_linear_field_has_forms_that_are_zero() -> None:
    form = Derivatives([2 * p - q, r], STATES, 3, partial(compile_function, arguments=STATES)).at(
        np.ones(3), np.array([0.0])
    )
    assert not len(form.values)
    assert form(np.ones(3), np.ones(3), np.ones(3)) == pytest.approx([0.0, 0.0])
