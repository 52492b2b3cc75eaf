"""Folds and other bifurcations of cycles between two rows of a family: told by a change of sign, then located."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gsp.orbits.periodic.family import CycleKind
from gsp.orbits.periodic.orbit import NEUTRAL
from gsp.orbits.periodic.tracing import Row, Tracer

# The parameter's share of a tangent below which its sign is rounding.
NOISE = 1e-9
# False position: evaluations, and the arclength share and test value at which it ends.
EVALUATIONS = 40
LOCATED = 1e-10
# A multiplier is on the unit circle at a located point when its logarithm is below this.
ON_CIRCLE = 1e-4
# At a located fold the parameter's share of the direction is below this.
STANDS_STILL = 1e-6


def located(tracer: Tracer, rows: list[Row], lengths: list[float]) -> list[tuple[CycleKind, int]]:
    """The special orbits, put into `rows` and `lengths` where they belong: kinds and rows."""
    found: list[tuple[CycleKind, int]] = []
    k = 0
    while k + 1 < len(rows):
        kind = _kind_between(rows[k], rows[k + 1])
        if kind is not None:
            test = _test(tracer, kind, rows[k], rows[k + 1])
            special = _located(tracer, rows[k], rows[k + 1], lengths[k + 1], test)
            if special is not None and abs(_logarithm(kind, special[0])) < ON_CIRCLE:
                row, length = special
                if kind is CycleKind.BRANCH_POINT and abs(_slope(tracer, row)) < STANDS_STILL:
                    kind = CycleKind.FOLD
                rows.insert(k + 1, row)
                lengths.insert(k + 1, length)
                lengths[k + 2] = max(lengths[k + 2] - length, 0.0)
                found.append((kind, k + 1))
                k += 1
        k += 1
    return found


def _slope(tracer: Tracer, row: Row) -> float:
    """The parameter's share of the family's direction."""
    return row.moving.parameter / tracer.width


def _kind_between(a: Row, b: Row) -> CycleKind | None:
    """What is passed between two rows, told by the multipliers; a fold is a branch point until it is located.

    The parameter alone does not tell a fold: in an explosion it goes to and fro by rounding.
    """
    counts = [_counts(row) for row in (a, b)]
    if sum(counts[0]) == sum(counts[1]):
        # A pair that has become real, or complex, has crossed nothing.
        return None
    kinds = (CycleKind.BRANCH_POINT, CycleKind.PERIOD_DOUBLING, CycleKind.TORUS)
    return next((kind for kind, one, other in zip(kinds, *counts) if one != other), None)


def _counts(row: Row) -> tuple[int, int, int]:
    """Multipliers beyond 1, beyond -1, and complex ones outside the unit circle."""
    others = row.multipliers[1:]
    outside = np.abs(others) > 1.0 + NEUTRAL
    real = np.abs(np.imag(others)) <= 1e-12 * np.abs(others)
    return (
        int((outside & real & (np.real(others) > 0.0)).sum()),
        int((outside & real & (np.real(others) < 0.0)).sum()),
        int((outside & ~real).sum()),
    )


def _test(tracer: Tracer, kind: CycleKind, a: Row, b: Row) -> Callable[[Row], float]:
    before, after = _slope(tracer, a), _slope(tracer, b)
    if kind is CycleKind.BRANCH_POINT and before * after < 0.0 and min(abs(before), abs(after)) > NOISE:
        return lambda row: _slope(tracer, row)
    return lambda row: _logarithm(kind, row)


def _logarithm(kind: CycleKind, row: Row) -> float:
    """log |mu| of the multiplier of that kind nearest to the unit circle; NaN when there is none."""
    others = row.multipliers[1:]
    real = np.abs(np.imag(others)) <= 1e-12 * np.abs(others)
    chosen = {
        CycleKind.BRANCH_POINT: real & (np.real(others) > 0.0),
        CycleKind.PERIOD_DOUBLING: real & (np.real(others) < 0.0),
        CycleKind.TORUS: ~real,
    }[kind]
    values = np.log(np.abs(others[chosen]))
    return float(values[np.argmin(np.abs(values))]) if values.size else float("nan")


def _located(
    tracer: Tracer, a: Row, b: Row, length: float, test: Callable[[Row], float]
) -> tuple[Row, float] | None:
    """The row between `a` and `b` where the test vanishes, and its arclength from `a`; the Illinois method."""
    low, high, f_low, f_high = 0.0, length, test(a), test(b)
    best: tuple[Row, float] | None = None
    value = np.inf
    for _ in range(EVALUATIONS):
        if not (np.isfinite(f_low) and np.isfinite(f_high)) or f_low * f_high > 0.0:
            return best
        middle = (low * f_high - high * f_low) / (f_high - f_low)
        if not low < middle < high:
            middle = 0.5 * (low + high)
        row = tracer.step(a, middle)
        if row is None:
            # Exactly at a branch point the bordered matrix is singular; beside it, it is not.
            middle = 0.5 * (low + middle)
            row = tracer.step(a, middle)
            if row is None:
                return best
        f = test(row)
        if abs(f) < value:
            best, value = (row, middle), abs(f)
        if abs(f) <= LOCATED or high - low <= LOCATED * length:
            break
        if f * f_high < 0.0:
            low, f_low = high, f_high
        else:
            f_low *= 0.5
        high, f_high = middle, f
        if low > high:
            low, high, f_low, f_high = high, low, f_high, f_low
    return best
