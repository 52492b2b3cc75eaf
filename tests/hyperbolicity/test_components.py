"""Places on one curve of folds become one loss, and the cusp on it another, also where a place is the cusp itself."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.losses.components import named_losses
from gsp.hyperbolicity.losses.diagnosis import Diagnosis, Found
from gsp.hyperbolicity.losses.kinds import Contact
from gsp.systems.system import SlowFastSystem

x, u, y, eps = sp.symbols("x u y epsilon")


def on_the_curve(t: float) -> np.ndarray:
    """The fold of x + u y - y^3 at y = t; the cusp is at 0."""
    return np.array([-2 * t**3, 3 * t**2, t])


@pytest.mark.parametrize("places", [(-0.5, 0.0, 0.5), (0.0, 0.3), (-0.5, -0.3)])
def test_a_cusp_is_told_where_folds_lie_on_both_sides_and_where_it_was_located_itself(places: tuple) -> None:
    system = SlowFastSystem(
        slow={x: sp.Integer(1), u: sp.Rational(1, 2)}, fast={y: x + u * y - y**3}, epsilon=eps
    )
    samples = np.array([[b**3 - a * b, a, b] for a in np.linspace(-1, 1, 5) for b in np.linspace(-1, 1, 5)])
    diagnosis = Diagnosis(
        Sampler(solve_critical(system).branches[0]), {"x": (-1.0, 1.0), "u": (-1.0, 1.1)}, 3.0, samples
    )
    fold, *others = named_losses(diagnosis, [Found(on_the_curve(t), Contact.ZERO) for t in places])
    assert fold.kind is LossKind.FOLD
    assert fold.samples == len(places)
    assert f", one of {len(places)} samples of it" in fold.headline
    assert fold.extent["u"] == pytest.approx((3 * min(map(abs, places)) ** 2, 3 * max(map(abs, places)) ** 2))
    has_cusp = min(places) <= 0.0 <= max(places)
    assert [loss.kind for loss in others] == [LossKind.CUSP] * has_cusp
    for cusp in others:
        assert "samples of it" not in cusp.headline
        assert [cusp.point[name] for name in "xuy"] == pytest.approx([0, 0, 0], abs=1e-9)
