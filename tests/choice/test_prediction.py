"""What reduced runs are told to be wrong by, beside closed forms: in what sizes, when, and up to which order."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from gsp.choice.choice import choose
from gsp.choice.forecast import forecast_of
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.systems.system import SlowFastSystem

x, y, z, clock, eps = sp.symbols("x y z clock epsilon")


def scene(slow, fast, start, last: float, epsilon: float, tolerance: float) -> Scene:
    system = SlowFastSystem(slow=slow, fast=fast, epsilon=eps)
    region = {s.name: (-100, 100) for s in system.x}
    return Scene(system, region, start, (0, last), epsilon, tolerance=tolerance)


def test_errors_are_relative_to_the_most_exact_run() -> None:
    """x = t/100 + 0.099 (1 - exp(-10 t)): most of it comes from the layer, of which order 0 knows nothing."""
    asked = scene({x: y}, {y: sp.Rational(1, 100) - y}, {"x": 0, "y": 1}, 2, 0.1, 1e-3)
    assert choose(asked, orders=(0,), solve=False).candidates[0].predicted == pytest.approx(
        0.099 / 0.119, rel=0.01
    )


def test_sizes_are_looked_for_within_steps() -> None:
    """A dose goes from nothing to nothing within one step of the slow run."""
    dose = sp.Max(0, 1 - 4 * (clock - 2) ** 2)
    rates = {clock: 1, x: -x * y / 10_000}
    asked = scene(rates, {y: dose - y}, {"clock": 0, "x": 1, "y": 0}, 20, 0.01, 0.02)
    assert forecast_of(asked, (0,)).fast.scale["y"] == pytest.approx(1.0, rel=0.02)


def test_what_a_layer_adds_later_than_at_its_start_is_seen() -> None:
    """y = (1 - tau) exp(-tau): x goes off by epsilon tau exp(-tau), and its base point is where it starts."""
    asked = scene({x: 1 - x + y}, {y: -y - z, z: -z}, {"x": 1, "y": 1, "z": 1}, 30, 0.01, 0.05)
    found = choose(asked, orders=(1, 2), solve=False)
    assert found.layer == 0.0
    for candidate in found.candidates[:2]:
        assert candidate.predicted == pytest.approx(0.01 / np.e, rel=0.1)


def test_at_rest_no_series_is_past_its_best_order() -> None:
    """Of the terms there, all of which vanish, the last two are rounding and the others 0."""
    asked = scene({x: 6 - y - x / 2, y: 10 * (x - y / 2)}, {z: y - z}, dict.fromkeys("xyz", 0), 200, 0.01, 0.05)
    assert all(c.valid for c in choose(replace(study_of(asked), is_stiff=True), fast=True).candidates[:4])
