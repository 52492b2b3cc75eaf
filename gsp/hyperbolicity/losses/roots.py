"""Gauss-Newton steps of least norm, for equations with more or fewer unknowns than equations."""

from __future__ import annotations

import contextlib
from collections.abc import Callable

import numpy as np

# Steps towards a zero, and with many fast variables, where each takes milliseconds.
STEPS, STEPS_OF_LARGE = 60, 20


def gauss_newton(
    evaluate: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    start: np.ndarray,
    *,
    steps: int = STEPS,
    sparse: bool = False,
    scales: np.ndarray | None = None,
    sizes: np.ndarray | float = 1.0,
) -> np.ndarray | None:
    """The zero of `evaluate` (value, Jacobian) next to `start` by damped steps of least norm, or None.

    Lengths are in units of `scales`, one for each unknown: which zero of many is nearest depends on them. Values are
    small beside `sizes`, what a unit changes in each as a rule.
    A large Jacobian with few entries is taken apart as a `sparse` matrix; where its rows depend on one another there
    is no step then.
    """

    def at_one(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        value, slope = evaluate(u[0])
        return np.asarray(value)[None], np.asarray(slope)[None]

    return gauss_newton_at_each(at_one, start[None], steps=steps, sparse=sparse, scales=scales, sizes=sizes)[0]


def gauss_newton_at_each(
    evaluate: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    starts: np.ndarray,
    *,
    steps: int = STEPS,
    sparse: bool = False,
    scales: np.ndarray | None = None,
    sizes: np.ndarray | float = 1.0,
) -> list[np.ndarray | None]:
    """What `gauss_newton` finds from each of the `starts` (m, n); `evaluate` takes points (k, n) at once."""
    units = np.ones(starts.shape[1]) if scales is None else scales
    u = starts / units
    limit = 0.5 * (1.0 + np.linalg.norm(u, axis=1))
    lost = np.zeros(len(u), dtype=bool)
    moving = np.arange(len(u))
    for _ in range(steps):
        if not len(moving):
            break
        value, slope = evaluate(u[moving] * units)
        # Beside an exponential slopes may leave the floats in these units only.
        with np.errstate(over="ignore", invalid="ignore"):
            slope = slope * units
        finite = np.isfinite(value).all(axis=1) & np.isfinite(slope).all(axis=(1, 2))
        lost[moving[~finite]] = True
        moving, value, slope = moving[finite], value[finite], slope[finite]
        step = _least_norm(slope, value) if sparse else _least_squares(slope, value)
        # Far from any zero of an exponential a step may be longer than a float.
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(step, axis=1)
        finite = np.isfinite(length)
        lost[moving[~finite]] = True
        moving, step, length = moving[finite], step[finite], length[finite]
        longest = limit[moving]
        u[moving] -= step * np.where(length <= longest, 1.0, longest / np.maximum(length, longest))[:, None]
        moving = moving[length >= 1e-12 * (1.0 + np.linalg.norm(u[moving], axis=1))]
    found: list[np.ndarray | None] = [None] * len(u)
    arrived = np.flatnonzero(~lost)
    if len(arrived):
        points = u[arrived] * units
        # A multiple zero is approached linearly; there the steps stay longer than the residual is large.
        small = 1e-11 * np.multiply.outer(1.0 + np.linalg.norm(u[arrived], axis=1), sizes)
        value = np.abs(evaluate(points)[0])
        for i, point, size, least in zip(arrived, points, value, small):
            if (size <= least).all():
                found[i] = point
    return found


def _least_squares(slope: np.ndarray, value: np.ndarray) -> np.ndarray:
    """The shortest of the best steps; which rows depend on one another must not depend on the equations' factors."""
    largest = np.abs(slope).max(axis=2)
    factors = np.where(largest > 0.0, largest, 1.0)
    inverse = np.linalg.pinv(slope / factors[:, :, None], rcond=1e-12)
    return np.einsum("mij,mj->mi", inverse, value / factors)


def _least_norm(slopes: np.ndarray, values: np.ndarray) -> np.ndarray:
    """The shortest steps s with J s = v, by the sparse systems s + J^T m = 0, J s = v; not a number without one."""
    from scipy.sparse import bmat, csc_matrix, eye
    from scipy.sparse.linalg import splu

    n = slopes.shape[2]
    steps = np.full((len(slopes), n), np.nan)
    for step, slope, value in zip(steps, slopes, values):
        J = csc_matrix(slope)
        # Rows that depend on one another have no decomposition.
        with contextlib.suppress(RuntimeError):
            decomposed = splu(csc_matrix(bmat([[eye(n), J.T], [J, None]])))
            step[:] = decomposed.solve(np.concatenate([np.zeros(n), value]))[:n]
    return steps
