"""Gauss-Newton steps of least norm, for equations with more or fewer unknowns than equations."""

from __future__ import annotations

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
    units = np.ones(len(start)) if scales is None else scales
    u = start / units
    limit = 0.5 * (1.0 + np.linalg.norm(u))
    for _ in range(steps):
        value, slope = evaluate(u * units)
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return None
        slope = slope * units
        step = _least_norm(slope, value) if sparse else _least_squares(slope, value)
        # Far from any zero of an exponential a step may be longer than a float.
        with np.errstate(over="ignore", invalid="ignore"):
            length = np.linalg.norm(step)
        if not np.isfinite(length):
            return None
        u = u - (step if length <= limit else step * (limit / length))
        if length < 1e-12 * (1.0 + np.linalg.norm(u)):
            break
    value, _ = evaluate(u * units)
    # A multiple zero is approached linearly; there the steps stay longer than the residual is large.
    return u * units if (np.abs(value) <= 1e-11 * sizes * (1.0 + np.linalg.norm(u))).all() else None


def _least_squares(slope: np.ndarray, value: np.ndarray) -> np.ndarray:
    """The shortest of the best steps; which rows depend on one another must not depend on the equations' factors."""
    largest = np.abs(slope).max(axis=1)
    factors = np.where(largest > 0.0, largest, 1.0)
    return np.linalg.lstsq(slope / factors[:, None], value / factors, rcond=1e-12)[0]


def _least_norm(slope: np.ndarray, value: np.ndarray) -> np.ndarray:
    """The shortest step s with J s = v, by the sparse system s + J^T m = 0, J s = v; not a number without one."""
    from scipy.sparse import bmat, csc_matrix, eye
    from scipy.sparse.linalg import splu

    J, n = csc_matrix(slope), slope.shape[1]
    try:
        decomposed = splu(csc_matrix(bmat([[eye(n), J.T], [J, None]])))
    except RuntimeError:
        return np.full(n, np.nan)
    return decomposed.solve(np.concatenate([np.zeros(n), value]))[:n]
