"""What `choose` measures on a piece of the span, against solutions in closed form."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from gsp.choice.candidates import PIECE, Candidate, ModelKind
from gsp.choice.choice import _OnPiece
from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem, VectorField

x, y, eps = sp.symbols("x y epsilon")
SYSTEM = SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=eps)
START = {"x": 1.0, "y": 1.0}
SCENE = Scene(
    SYSTEM, region={"x": (0, 2)}, start=START, span=(0, 2), epsilon=0.01, epsilons=(0.01, 0.005), tolerance=1e-6
)


def measured(rate: sp.Expr, begin: float, *, layer: float = 0.0) -> tuple[float, float]:
    """Of a model x' = `rate` from x = `begin` over one unit of time, in units of x = 2."""
    forecast = SimpleNamespace(
        flows={1: VectorField({x: rate}, epsilon=None)},
        starts={1: {"x": begin}},
        errors=lambda order, times: 1e-3 * order * times,
        prediction=SimpleNamespace(scale={"x": 2.0}, names=("x",)),
        study=SimpleNamespace(system=SYSTEM, start=START),
        layer=layer,
    )
    model = Candidate(ModelKind.REDUCED, 1)
    piece = (0.0, 1.0)
    return _OnPiece(SCENE, forecast, piece).errors(model, None)  # pyright: ignore


@pytest.mark.parametrize(("layer", "begun"), [(0.0, 0.0), (0.3, 0.3), (5.0, 1.0 - PIECE)])
def test_the_error_is_the_largest_after_the_layer_in_units_of_the_state(layer: float, begun: float) -> None:
    # The full system has x = exp(-t).
    predicted, error = measured(-x, 1.2, layer=layer)
    assert error == pytest.approx(0.1 * np.exp(-begun), rel=1e-6)
    assert predicted == pytest.approx(1e-3)


def test_of_a_model_that_ends_early_nothing_is_measured() -> None:
    # 1/(1 - 2 t) ends at t = 1/2, where the full system goes on.
    predicted, error = measured(2 * x**2, 1.0)
    assert np.isnan(error)
    assert predicted == pytest.approx(1e-3)


def test_of_a_full_system_that_ends_early_nothing_is_measured() -> None:
    ends = SlowFastSystem(slow={x: 2 * x**2}, fast={y: x - y}, epsilon=eps)
    model = Candidate(ModelKind.FULL, None)
    piece, ending = (0.0, 1.0), replace(SCENE, system=ends)
    found = _OnPiece(ending, None, piece).errors(model, None)
    assert np.isnan(found[1])
    found = _OnPiece(SCENE, None, piece).errors(model, None)
    assert 0 < found[1] < 1e-6
    assert found[0] == 1e-7
