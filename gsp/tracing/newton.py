"""Newton's method for orbits, and whatever else one linear system corrects: when it goes on and when it ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from gsp.errors import Status

Point = TypeVar("Point")
Step = TypeVar("Step")


@dataclass(frozen=True)
class Rules:
    """When Newton's method ends; lengths are those of steps, in the units of their problem.

    A step of at most `rounding` is rounding. One of at most `last` is the one before the last, as the next is its
    square; when it, or one of at most `blurred`, is not below `stagnant` times the one before, it is rounding as well.
    A step of more than `growth` times the one before and more than `hopeless` is a setback, of which `setbacks` end the
    iteration; longer steps than `longest` are shortened to it.
    """

    steps: int
    rounding: float
    last: float = 0.0
    blurred: float = 0.0
    stagnant: float = 0.3
    growth: float = np.inf
    hopeless: float = 0.0
    setbacks: int = 1
    longest: float = np.inf


@dataclass(frozen=True, eq=False)
class Solution(Generic[Point]):
    """The last iterate, how the iteration ended, and after how many steps."""

    point: Point
    status: Status
    iterations: int


def newton(
    point: Point,
    step_of: Callable[[Point], Step],
    *,
    length: Callable[[Step, Point], float],
    moved: Callable[[Point, Step, float], Point | None],
    rules: Rules,
) -> Solution[Point]:
    """Newton's method from `point`: `step_of` raises `numpy.linalg.LinAlgError` where the system is singular.

    `moved` is the point some share of a step on, None where the equations are not defined.
    """
    previous, setbacks = np.inf, 0
    for iteration in range(1, rules.steps + 1):
        try:
            step = step_of(point)
        except np.linalg.LinAlgError:
            return Solution(point, Status.SINGULAR_JACOBIAN, iteration)
        size = length(step, point)
        if not np.isfinite(size):
            return Solution(point, Status.NON_FINITE, iteration)
        if size > max(rules.growth * previous, rules.hopeless):
            setbacks += 1
            if setbacks == rules.setbacks:
                return Solution(point, Status.NOT_CONVERGED, iteration)
        new = moved(point, step, min(1.0, rules.longest / size) if size > 0.0 else 1.0)
        if new is None:
            return Solution(point, Status.NON_FINITE, iteration)
        point = new
        is_stuck = size <= max(rules.last, rules.blurred) and size >= rules.stagnant * previous
        settled = previous <= rules.last or is_stuck
        if size <= rules.rounding or settled:
            return Solution(point, Status.SUCCESS, iteration)
        previous = size
    return Solution(point, Status.NOT_CONVERGED, rules.steps)
