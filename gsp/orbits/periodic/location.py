"""Folds and other bifurcations of cycles between two rows of a family: told by a change of sign, then located."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gsp.orbits.periodic.family import CycleKind
from gsp.orbits.periodic.orbit import NEUTRAL
from gsp.orbits.periodic.tracing import CycleTracer, Row


def located(tracer: CycleTracer, rows: list[Row], lengths: list[float]) -> list[tuple[CycleKind, int]]:
    """The special orbits, put into `rows` and `lengths` where they belong: kinds and rows."""
    found: list[tuple[CycleKind, int]] = []
    k = 0
    while k + 1 < len(rows):
        kind = _kind_between(rows[k], rows[k + 1])
        if kind is not None:
            test = _test(tracer, kind, rows[k], rows[k + 1])
            # A located point is known to this share of the step.
            special = tracer.located(
                rows[k],
                lengths[k + 1],
                test,
                (test(rows[k]), test(rows[k + 1])),
                apart=1e-10 * lengths[k + 1],
            )
            # A multiplier is on the unit circle at a located point when its logarithm is below this.
            if special is not None and abs(_logarithm(kind, special[0])) < 1e-4:
                row, length = special
                # At a located fold the parameter's share of the direction is below this.
                if kind is CycleKind.BRANCH_POINT and abs(_slope(tracer, row)) < 1e-6:
                    kind = CycleKind.FOLD
                rows.insert(k + 1, row)
                lengths.insert(k + 1, length)
                lengths[k + 2] = max(lengths[k + 2] - length, 0.0)
                found.append((kind, k + 1))
                k += 1
        k += 1
    return found


def _slope(tracer: CycleTracer, row: Row) -> float:
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


def _test(tracer: CycleTracer, kind: CycleKind, a: Row, b: Row) -> Callable[[Row], float]:
    before, after = _slope(tracer, a), _slope(tracer, b)
    # The parameter's share of a tangent below which its sign is rounding.
    if kind is CycleKind.BRANCH_POINT and before * after < 0.0 and min(abs(before), abs(after)) > 1e-9:
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
