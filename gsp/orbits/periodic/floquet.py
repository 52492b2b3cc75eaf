"""Floquet multipliers from the transfer matrices of a cycle, without forming their product.

The product of transfers over one period overflows, and loses its small eigenvalues, where a cycle follows an attracting
or a repelling manifold. Two relations C_1 z_1 = B_1 z_0 and C_2 z_2 = B_2 z_1 are joined to one by an orthogonal
elimination of z_1, which keeps every matrix bounded; at the end C z_N = B z_0, and the multipliers are the
eigenvalues of the pencil (B, C). After T. F. Fairgrieve, A. D. Jepson, "O.K. Floquet multipliers", SIAM J. Numer.
Anal. 28 (1991) 1446-1462.
"""

from __future__ import annotations

import numpy as np


def multipliers(transfers: np.ndarray, divergence: float, scales: np.ndarray) -> np.ndarray:
    """Multipliers (n,) of transfers (N, n, n), the trivial one first, then by decreasing size.

    In the plane the other one is exp(divergence), by Liouville's formula, accurate at any size. `scales` (n,) are the
    units of the states.
    """
    from scipy.linalg import eig

    n = transfers.shape[1]
    pencil = joined(transfers * scales / scales[:, None])
    # Asked for no vectors, SciPy returns the eigenvalues alone, as a pair of rows.
    alpha, beta = np.asarray(eig(*pencil, right=False, homogeneous_eigvals=True))
    with np.errstate(all="ignore"):
        values = np.where(beta == 0.0, complex(np.inf), alpha / np.where(beta == 0.0, 1.0, beta))
    trivial = int(np.argmin(np.abs(alpha - beta) / np.hypot(np.abs(alpha), np.abs(beta))))
    others = np.delete(values, trivial)
    others = others[np.lexsort((-np.imag(others), -np.abs(others)))]
    if n == 2:
        with np.errstate(over="ignore"):
            others = np.array([np.exp(divergence)], dtype=complex)
    return np.append(values[trivial], others)


def isolation(transfers: np.ndarray, rates: np.ndarray, scales: np.ndarray) -> float:
    """How far a cycle is from having neighbours, from 0, where it belongs to a family of cycles, to about 1.

    A neighbour is a start z_0 and a change of the period that close as well: M dz_0 + F(z_0) dT = dz_0. That has no
    solution across the flow for an isolated cycle; the answer is the least singular value of these n equations, in
    rows that are orthonormal for the graph {(z_0, z_N)} of M, so that no growth or decay on the way enters. `rates`
    (N, n) is F at the mesh points, from the slowest of which the lap is taken, and `scales` (n,) are the units.
    """
    n = len(scales)
    along = rates / scales
    speeds = np.linalg.norm(along, axis=1)
    first = int(np.argmin(speeds))
    B, C = joined(np.roll(transfers * scales / scales[:, None], -first, axis=0))
    rows = np.linalg.qr(np.hstack([B, -C]).T)[0].T
    shift = rows[:, n:] @ (along[first] / speeds[first])
    closing = np.column_stack([rows[:, :n] + rows[:, n:], shift])
    return float(np.linalg.svd(closing, compute_uv=False)[-1])


def joined(transfers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(B, C) with C z_N = B z_0 from z_(j+1) = transfers[j] z_j, joining neighbours in pairs."""
    n = transfers.shape[1]
    B, C = transfers, np.broadcast_to(np.eye(n), transfers.shape)
    while len(B) > 1:
        if len(B) % 2:
            B = np.concatenate([B, np.eye(n)[None]])
            C = np.concatenate([C, np.eye(n)[None]])
        # The last n columns of Q are orthogonal to those of [C_1; -B_2].
        Q = np.linalg.qr(np.concatenate([C[::2], -B[1::2]], axis=1), mode="complete")[0][:, :, n:]
        B, C = (
            Q[:, :n].transpose(0, 2, 1) @ B[::2],
            Q[:, n:].transpose(0, 2, 1) @ C[1::2],
        )
        # Each relation in units of its own size.
        size = np.maximum(np.abs(B).max(axis=(1, 2)), np.abs(C).max(axis=(1, 2)))[:, None, None]
        B, C = B / size, C / size
    return B[0], C[0]
