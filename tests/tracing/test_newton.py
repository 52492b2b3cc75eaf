"""When Newton's method ends: every rule at its border, told with steps whose lengths a test chooses."""

from __future__ import annotations

import numpy as np
import pytest

from gsp.errors import Status
from gsp.tracing.newton import Rules, Solution, newton


def ended(*lengths: float, steps: int | None = None, rounding: float = 1e-3, **rules: float) -> Solution[float]:
    """The end of an iteration from 0 whose steps are so long; NaN for a singular system."""
    taken = iter(lengths)

    def step_of(_: float) -> float:
        length = next(taken)
        if np.isnan(length):
            raise np.linalg.LinAlgError
        return length

    return newton(
        0.0,
        step_of,
        length=lambda step, _: step,
        moved=lambda point, step, share: point + share * step,
        rules=Rules(len(lengths) if steps is None else steps, rounding, **rules),  # pyright: ignore[reportArgumentType]
    )


def how(solution: Solution[float]) -> tuple[Status, int]:
    return solution.status, solution.iterations


def test_a_step_of_rounding_ends_it_and_is_taken() -> None:
    solution = ended(1.0, 0.5, 1e-3, 9.0)
    assert how(solution) == (Status.SUCCESS, 3)
    assert solution.point == 1.0 + 0.5 + 1e-3
    assert how(ended(1.0, 0.5, 1.001e-3)) == (Status.NOT_CONVERGED, 3)
    assert how(ended(0.0, 9.0)) == (Status.SUCCESS, 1)


def test_as_many_steps_as_allowed_are_taken_and_no_more() -> None:
    assert how(ended(1.0, 1.0, 1.0, 1e-9, steps=3)) == (Status.NOT_CONVERGED, 3)
    assert how(ended(1.0, 1.0, 1e-9, steps=3)) == (Status.SUCCESS, 3)


def test_the_step_after_a_last_one_ends_it_whatever_its_length() -> None:
    solution = ended(1.0, 0.1, 0.05, 7.0, last=0.1)
    assert how(solution) == (Status.SUCCESS, 3)
    assert solution.point == pytest.approx(1.15)
    assert how(ended(1.0, 0.101, 0.02, 0.01, 7.0, last=0.1)) == (Status.SUCCESS, 4)


def test_a_small_step_that_falls_no_more_is_rounding() -> None:
    # 0.03 is 0.3 of 0.1 and ends it; 0.029 is less, and is the last but one; 0.3 is not small.
    assert how(ended(0.1, 0.03, 7.0, last=0.05, stagnant=0.3)) == (Status.SUCCESS, 2)
    assert how(ended(0.1, 0.029, 0.02, last=0.05, stagnant=0.3)) == (Status.SUCCESS, 3)
    assert how(ended(0.31, 0.3, 0.2, last=0.05, stagnant=0.3)) == (Status.NOT_CONVERGED, 3)
    # The first step has none before it.
    assert how(ended(0.04, 0.02, last=0.05, stagnant=0.3)) == (Status.SUCCESS, 2)


def test_unless_asked_for_no_step_is_the_last_but_one_and_none_is_hopeless() -> None:
    assert how(ended(1e-10, 1e-10, 1e-10, rounding=1e-15)) == (Status.NOT_CONVERGED, 3)
    assert how(ended(1e-12, 1e-10, 1e-16, rounding=1e-15, growth=2.0)) == (Status.NOT_CONVERGED, 2)
    assert how(ended(1.0, 1e9, 1e-16, rounding=1e-15)) == (Status.SUCCESS, 3)
    # A third of the step before is what stagnation is told by.
    assert how(ended(0.1, 0.031, 7.0, last=0.05)) == (Status.SUCCESS, 2)
    assert how(ended(0.1, 0.029, 7.0, last=0.05)) == (Status.SUCCESS, 3)


def test_so_many_setbacks_end_it() -> None:
    assert how(ended(1.0, 2.1, 9.0, growth=2.0)) == (Status.NOT_CONVERGED, 2)
    assert how(ended(1.0, 2.0, 4.0, 8.0, 1e-9, growth=2.0)) == (Status.SUCCESS, 5)
    assert how(ended(1.0, 2.1, 1.0, 2.1, 1.0, 1e-9, growth=2.0, setbacks=2)) == (Status.NOT_CONVERGED, 4)
    assert how(ended(1.0, 2.1, 1.0, 2.1, 1.0, 1e-9, growth=2.0, setbacks=3)) == (Status.SUCCESS, 6)
    # What is not longer than hopeless is no setback, and the first step is none.
    assert how(ended(1.0, 5.0, 1e-9, growth=2.0, hopeless=5.0)) == (Status.SUCCESS, 3)
    assert how(ended(1.0, 5.1, 1e-9, growth=2.0, hopeless=5.0)) == (Status.NOT_CONVERGED, 2)
    assert how(ended(99.0, 1e-9, growth=2.0, hopeless=5.0)) == (Status.SUCCESS, 2)
    # The step of a setback that does not end it is taken; that of the last is not.
    assert ended(1.0, 2.5, 1.0, 1e-9, growth=2.0, setbacks=2).point == pytest.approx(4.5)
    assert ended(1.0, 2.5, growth=2.0).point == 1.0


def test_long_steps_are_shortened() -> None:
    assert ended(4.0, 1.0, 0.5, longest=1.0).point == pytest.approx(2.5)
    assert ended(4.0, 1.0, 0.5).point == pytest.approx(5.5)


def test_what_is_singular_or_not_finite_ends_it_before_the_step() -> None:
    assert how(ended(1.0, np.nan)) == (Status.SINGULAR_JACOBIAN, 2)
    infinite = ended(1.0, np.inf)
    assert (how(infinite), infinite.point) == ((Status.NON_FINITE, 2), 1.0)
    nowhere = newton(3.0, lambda _: 1.0, length=lambda *_: 1.0, moved=lambda *_: None, rules=Rules(5, 1e-3))
    assert (how(nowhere), nowhere.point) == ((Status.NON_FINITE, 1), 3.0)


def test_a_root_is_found_as_fast_as_its_square() -> None:
    solution = newton(
        1.0,
        lambda z: (2.0 - z * z) / (2.0 * z),
        length=lambda step, _: abs(step),
        moved=lambda z, step, share: z + share * step,
        rules=Rules(20, 1e-15, last=1e-8),
    )
    assert how(solution) == (Status.SUCCESS, 6)
    assert solution.point == pytest.approx(2**0.5, rel=1e-15)
