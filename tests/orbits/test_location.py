"""Bifurcations of cycles between two rows: told by multipliers that pass the unit circle, and put where they are."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from gsp.orbits.periodic.family import CycleKind
from gsp.orbits.periodic.location import _kind_between, located
from gsp.orbits.periodic.orbit import NEUTRAL


def row(*multipliers: complex, slope: float = 1.0) -> SimpleNamespace:
    """A row with these multipliers beside the trivial one, the parameter having that share of its direction."""
    return SimpleNamespace(
        multipliers=np.array([1.0, *multipliers], dtype=complex), moving=SimpleNamespace(parameter=2.0 * slope)
    )


@pytest.mark.parametrize(
    ("before", "after", "kind"),
    [
        ((0.9,), (1.1,), CycleKind.BRANCH_POINT),
        ((1.1,), (0.9,), CycleKind.BRANCH_POINT),
        ((-0.9,), (-1.1,), CycleKind.PERIOD_DOUBLING),
        ((0.9j, -0.9j), (1.1j, -1.1j), CycleKind.TORUS),
        ((0.9, -0.9), (1.1, -0.9), CycleKind.BRANCH_POINT),
        ((0.5,), (0.6,), None),
        ((1.5,), (2.5,), None),
        # Nothing is passed by a pair that turns real outside the circle, nor by one within rounding of it.
        ((1.1 + 0.1j, 1.1 - 0.1j), (1.2, 1.3), None),
        ((1.0 - NEUTRAL / 2,), (1.0 + NEUTRAL / 2,), None),
        ((1.0,), (1.0 + 2 * NEUTRAL,), CycleKind.BRANCH_POINT),
    ],
)
def test_what_is_passed_is_told_by_the_multipliers(before, after, kind) -> None:
    assert _kind_between(row(*before), row(*after)) is kind  # pyright: ignore[reportArgumentType]


class Family:
    """A family over its arclength, whose rows are made by a function of it; steps are located by bisection."""

    width = 2.0

    def __init__(self, at) -> None:
        self.at, self.tests = at, []

    def located(self, here, length, test, ends, *, apart):
        self.tests.append(ends)
        low, high = 0.0, length
        for _ in range(60):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if test(self.at(here.s + middle)) * ends[0] > 0 else (low, middle)
        return self.at(here.s + high), high


def family(multiplier, slope=lambda s: 1.0) -> Family:
    def at(s: float) -> SimpleNamespace:
        made = row(multiplier(s), slope=slope(s))
        made.s = s
        return made

    return Family(at)


@pytest.mark.parametrize(
    ("multiplier", "slope", "kind", "place"),
    [
        (lambda s: -0.8 * s, lambda s: 1.0, CycleKind.PERIOD_DOUBLING, 1.25),
        (lambda s: 0.4 * s, lambda s: 1.0, CycleKind.BRANCH_POINT, 2.5),
        # At a fold the parameter turns where the multiplier is 1.
        (lambda s: 0.4 * s, lambda s: 2.5 - s, CycleKind.FOLD, 2.5),
    ],
)
def test_a_special_orbit_is_put_between_the_rows_that_it_lies_between(multiplier, slope, kind, place) -> None:
    tracer = family(multiplier, slope)
    rows, lengths = [tracer.at(float(s)) for s in range(4)], [0.0, 1.0, 1.0, 1.0]
    found = located(tracer, rows, lengths)  # pyright: ignore[reportArgumentType]
    assert [k for k, _ in found] == [kind]
    (_, where), *_ = found
    assert rows[where].s == pytest.approx(place)
    assert [r.s for r in rows] == sorted(r.s for r in rows)
    assert len(rows) == len(lengths) == 5
    # The lengths still add up, and each is that from the row before.
    assert np.cumsum(lengths) == pytest.approx([r.s for r in rows])
    # The ends of the test are those of the step.
    assert tracer.tests[0][0] * tracer.tests[0][1] < 0


def test_a_multiplier_that_jumps_over_the_circle_is_no_bifurcation() -> None:
    tracer = family(lambda s: 0.5 if s < 1.5 else 2.0)
    rows, lengths = [tracer.at(float(s)) for s in range(4)], [0.0, 1.0, 1.0, 1.0]
    assert located(tracer, rows, lengths) == []  # pyright: ignore[reportArgumentType]
    assert len(rows) == len(lengths) == 4
