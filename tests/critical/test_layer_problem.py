"""The layer problem's values, where they are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.layer_problem import LayerProblem
from gsp.systems.system import SlowFastSystem


def test_eigenvalues_come_rightmost_first_and_of_a_pair_the_upper_one() -> None:
    x, p, q, r, epsilon = sp.symbols("x p q r epsilon")
    fast = {p: -p - 2 * q, q: 2 * p - q, r: (x - 1 / x) * r}
    problem = LayerProblem(SlowFastSystem(slow={x: -x}, fast=fast, epsilon=epsilon), (x,), {})
    found = problem.eigenvalues(np.array([[0.5, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0]]))
    assert found[0] == pytest.approx([-1 + 2j, -1 - 2j, -1.5], rel=1e-13)
    # The pair has the larger sizes and imaginary parts here, and comes last all the same.
    assert found[1] == pytest.approx([1.5, -1 + 2j, -1 - 2j], rel=1e-13)
    assert np.isnan(found[2]).all()
