"""Every estimate of an error against what the error is, on one battery of random systems and by an independent run.

The run that tells the truth is of the full system, from off the slow manifold: behind its layer it is on it.
"""

from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np
import pytest

from gsp.choice.forecast import Forecast, forecast_of
from gsp.choice.simulation import simulate
from gsp.integration.trajectory import Trajectory, integrate
from gsp.scenes.scene import Scene
from gsp.slow.slow_points import zero_derivative
from gsp.slow.solved_manifold import solve_manifold
from tests.cases import sampled
from tests.choice.test_choice import random_scene

SEEDS = sampled(range(20, 32), always=(21, 27))
EPSILONS = (0.1, 0.03, 0.01)
# The reference's own tolerance, and what is left of the layer where it is looked at.
TIGHT, SETTLED = 1e-13, 1e-14
# Errors below this are the reference's.
CLEAR = 1e-11


@dataclass(frozen=True)
class Case:
    """A random scene, what is foreseen of it, and its full run on times behind the layer."""

    scene: Scene
    forecast: Forecast
    run: Trajectory

    @property
    def on(self) -> tuple[np.ndarray, np.ndarray]:
        """Points x (m, n_slow) of the run and y (m, n_fast) on the slow manifold over them."""
        system = self.forecast.study.system
        x, y = (np.stack([self.run[s.name] for s in part], axis=1) for part in (system.x, system.y))
        return x, y


@cache
def case(seed: int) -> Case:
    scene = random_scene(seed, EPSILONS[seed % 3])
    forecast = forecast_of(scene, (0, 1))
    settled = scene.epsilon / forecast.inner.gap * np.log(1 / SETTLED)
    run = integrate(
        scene.system,
        start=scene.start,
        span=(0, settled + 2),
        epsilon=scene.epsilon,
        rtol=TIGHT,
        atol=1e-15,
        at=np.linspace(settled, settled + 2, 41),
    )
    return Case(scene, forecast, run)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", SEEDS)
def test_a_solved_manifold_is_no_further_off_than_it_says(seed: int) -> None:
    found = case(seed)
    x, y = found.on
    box = {s.name: (low, high) for s, low, high in zip(found.scene.system.x, x.min(axis=0), x.max(axis=0))}
    for tolerance in (1e-4, 1e-7):
        solved = solve_manifold(
            found.forecast.study.branch, region=box, epsilon=found.scene.epsilon, tolerance=tolerance
        )
        if solved.surface is None:
            assert not solved.status.ok
            continue
        error = np.linalg.norm(solved.evaluate(x) - y, axis=1).max()
        assert error <= solved.error_estimate + CLEAR


@pytest.mark.parametrize("seed", SEEDS)
def test_a_zero_derivative_point_is_little_further_off_than_it_says(seed: int) -> None:
    found = case(seed)
    x, y = found.on
    for tolerance in (1e-4, 1e-7, 1e-10):
        points = zero_derivative(
            found.forecast.study.branch, x, epsilon=found.scene.epsilon, tolerance=tolerance, near=y
        )
        error = np.linalg.norm(points.y - y, axis=1)
        assert (error <= 3 * points.error + CLEAR).all()


@pytest.mark.exhaustive
@pytest.mark.parametrize(("seed", "tolerance"), list(product(range(20, 32), [1e-3, 1e-6])))
def test_a_simulation_keeps_to_its_tolerance(seed: int, tolerance: float) -> None:
    found = case(seed)
    scene = replace(found.scene, tolerance=tolerance)
    run = simulate(scene)
    assert run.status.ok
    times = np.linspace(run.layer, 2, 97)
    reference = integrate(
        scene.system,
        start=scene.start,
        span=(0, 2),
        epsilon=scene.epsilon,
        rtol=TIGHT,
        atol=1e-15,
        at=times,
    )
    sampled = run.sample(times)
    for s in scene.system.x:
        size = np.abs(reference[s.name]).max()
        error = np.abs(sampled[s.name] - reference[s.name]).max()
        assert error <= tolerance * size
