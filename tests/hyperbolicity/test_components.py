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


TURNS = "the slow flow changes its direction across it: folded singularities lie on it"


@pytest.mark.parametrize(
    ("slow", "rate", "sign", "expected"),
    [
        ({x: 1, u: sp.Rational(1, 2)}, x + u * y - y**3, 1, "kappa changes its sign at a cusp on it"),
        ({x: 1, u: sp.Rational(1, 2)}, x + u * y - y**3, -1, "kappa changes its sign at a cusp on it"),
        ({x: y, u: 0}, x + u * y - y**3, 1, TURNS),
        (
            {x: u - sp.Rational(1, 2), u: 0},
            x + u * y - y**3,
            1,
            f"{TURNS}; kappa changes its sign at a cusp on it",
        ),
        ({x: u, u: 1}, x + y**2, 1, TURNS),
        ({x: 1, u: u}, x + y**2, 1, ""),
    ],
)
def test_only_a_slow_flow_that_turns_puts_folded_singularities_on_folds_and_not_a_cusp(
    slow: dict, rate: sp.Expr, sign: int, expected: str
) -> None:
    system = SlowFastSystem(slow=slow, fast={y: sign * rate}, epsilon=eps)
    samples = np.array(
        [
            [-float(rate.subs({x: 0, u: a, y: b})), a, b]
            for a in np.linspace(-1, 1, 5)
            for b in np.linspace(-1, 1, 5)
        ]
    )
    diagnosis = Diagnosis(
        Sampler(solve_critical(system).branches[0]), {"x": (-1.0, 1.0), "u": (-1.0, 1.1)}, 3.0, samples
    )
    along = np.array([-0.5, -0.3, 0.2, 0.45])
    places = [np.array([0.0, t, 0.0]) for t in along] if rate.has(y**2) else [on_the_curve(t) for t in along]
    (fold,) = [
        loss
        for loss in named_losses(diagnosis, [Found(place, Contact.ZERO) for place in places])
        if loss.kind is LossKind.FOLD
    ]
    assert fold.samples == len(along)
    assert fold.note == expected


@pytest.mark.parametrize("beside", [1e-4, -1e-4])
def test_a_double_zero_is_told_where_it_is_and_not_at_a_fold_beside_it_that_looks_like_one(
    beside: float,
) -> None:
    z = sp.Symbol("z")
    system = SlowFastSystem(
        slow={x: sp.Integer(1), u: sp.Integer(1)}, fast={y: z, z: x + u * z + y**2 + 3 * y * z}, epsilon=eps
    )
    samples = np.array([[-(b**2), a, b, 0.0] for a in np.linspace(-1, 1, 5) for b in np.linspace(-1, 1, 5)])
    diagnosis = Diagnosis(
        Sampler(solve_critical(system).branches[0]), {"x": (-1.0, 1.0), "u": (-1.0, 1.1)}, 3.0, samples
    )
    places = [np.array([0.0, t, 0.0, 0.0]) for t in (-0.5, beside, 0.5)]
    losses = named_losses(diagnosis, [Found(place, Contact.ZERO) for place in places])
    (double,) = [loss for loss in losses if loss.kind is LossKind.BOGDANOV_TAKENS]
    assert double.point["u"] == pytest.approx(0.0, abs=1e-9)
