"""The slow flow followed from given points, upstream or downstream, in steps that the fast decay measures.

This lays out the mesh of an orbit segment and a first guess of it: x' = f(x, y, epsilon) with 0 = g(x, y, epsilon),
which is off the slow manifold by O(epsilon).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.sheet_points import newton_at_each
from gsp.lowering.compiled_flow import compile_flow, parameter_vector

# Which end: against the slow flow for stable directions, along it for unstable ones.
LEFT = 0
# Powers of e by which the slowest direction decays on one element: Gauss points resolve that.
DECAY = 5.0
LARGEST = 48


@dataclass(frozen=True, eq=False)
class Track:
    """k slow orbits: `lengths` (k, m) of the elements, of which counts[q] are used, and `states`, `rates`
    (k, m + 1, n) at their ends, from the given points outwards.

    `decayed` (k,) are the powers of e that the slowest direction decays by, `drift` (k,) is the distance of
    M_epsilon from M0 at the far end to first order, epsilon |g_y^-1 y'|; `is_cut_short` says which orbits left the
    branch before the decay that was asked for.
    """

    counts: np.ndarray
    lengths: np.ndarray
    states: np.ndarray
    rates: np.ndarray
    decayed: np.ndarray
    drift: np.ndarray
    is_cut_short: np.ndarray

    @staticmethod
    def empty(x: np.ndarray, y: np.ndarray) -> Track:
        """No elements at all."""
        z = np.hstack([x, y])[:, None, :]
        k = len(x)
        nothing = np.zeros(k, dtype=np.int64)
        decayed = np.full(k, np.inf)
        return Track(
            nothing, np.zeros((k, 0)), z, np.zeros_like(z), decayed, np.zeros(k), np.zeros(k, dtype=bool)
        )


class _CriticalFlow:
    """The slow flow on {g = 0}, at many points at once."""

    def __init__(self, branch: Branch, epsilon: float) -> None:
        self.system = branch.system
        self.nx, self.n = len(self.system.x), len(self.system.states)
        self.epsilon = epsilon
        self.flow = compile_flow(self.system)
        self.p = parameter_vector(self.system, epsilon)

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of (f, g) (k, n, n)."""
        J = self.flow.jacobians(z, self.p)
        J[:, self.nx :] *= self.epsilon
        return J

    def rates(self, z: np.ndarray) -> np.ndarray:
        return self.flow.rates(z, self.p)[:, : self.nx]

    def settle(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """y with g(x, y, epsilon) = 0 near `y`, and where Newton's method converged."""
        return newton_at_each(
            lambda z: self.epsilon * self.flow.rates(z, self.p)[:, self.nx :],
            lambda z: self.jacobian(z)[:, self.nx :, self.nx :],
            x, y, tolerance=1e-10, steps=12,
        )  # fmt: skip

    def step(self, x: np.ndarray, y: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """One classical Runge-Kutta step; Newton's method starts on the tangent of {g = 0}.

        Returns x and y at the end, and where y was found and bends no more than a cubic follows.
        """
        good = np.ones(len(x), dtype=bool)
        J = self.jacobian(np.hstack([x, y]))
        slope = -divide(J[:, self.nx :, self.nx :], J[:, self.nx :, : self.nx])
        stage, total = self.rates(np.hstack([x, y])), np.zeros_like(x)
        rise = np.einsum("kij,kj->ki", slope, stage)
        middle = y
        for weight, share in ((1 / 6, 0.5), (1 / 3, 0.5), (1 / 3, 1.0), (1 / 6, 0.0)):
            total += weight * stage
            if share:
                place = x + share * h[:, None] * stage
                y_stage, found = self.settle(place, y + np.einsum("kij,kj->ki", slope, place - x))
                good &= found
                stage = self.rates(np.hstack([place, y_stage]))
                # The second stage is in the middle, to second order.
                middle = y_stage if share == 0.5 else middle
        end = x + h[:, None] * total
        y_end, found = self.settle(end, y + np.einsum("kij,kj->ki", slope, end - x))
        z_end = np.hstack([end, y_end])
        rise_end = _fast_slopes(self, z_end, self.jacobian(z_end))
        cubic = 0.5 * (y + y_end) + h[:, None] / 8 * (rise - rise_end)
        bend = np.linalg.norm(middle - cubic, axis=1)
        # In the middle of an element y is within this share of 1 + |y| of the cubic through its ends: an element does
        # not leap over a pole of the branch, on whose other side another slow manifold lies.
        return end, y_end, good & found & (bend <= 0.1 * (1.0 + np.linalg.norm(middle, axis=1)))


def follow_slow_flow(
    branch: Branch,
    x: np.ndarray,
    y: np.ndarray,
    *,
    epsilon: float,
    goal: np.ndarray,
    side: int,
    unstable: int,
) -> Track:
    """The slow flow from (x, y), upstream (`side` LEFT) or downstream, until the slowest stable, or unstable,
    fast direction has decayed by exp(-goal) on the way back."""
    flow = _CriticalFlow(branch, epsilon)
    nx = flow.nx
    k = len(x)
    sign = -1.0 if side == LEFT else 1.0
    y, alive = flow.settle(x, y)
    z = np.hstack([x, y])
    J = flow.jacobian(z)
    eigenvalues, count = _spectrum(J[:, nx:, nx:])
    alive &= count == unstable
    is_cut_short = ~alive
    decayed = np.zeros(k)
    counts = np.zeros(k, dtype=np.int64)
    shares = np.ones(k)
    decays, drifts = np.zeros((k, LARGEST + 1)), np.full((k, LARGEST + 1), np.inf)
    drifts[:, 0] = _drift(flow, z, J)
    states, lengths = np.empty((k, LARGEST + 1, flow.n)), np.zeros((k, LARGEST))
    states[:, 0] = z
    fastest = np.zeros(k)
    for _ in range(64):
        active = alive & (decayed < goal) & (counts < LARGEST)
        if not active.any():
            break
        rates = np.real(eigenvalues)
        on_side = rates < 0 if side == LEFT else rates > 0
        gap = np.where(on_side, np.abs(rates), np.inf).min(axis=1)
        fastest = np.where(active, np.where(on_side, np.abs(eigenvalues), 0.0).max(axis=1), fastest)
        slow = J[:, :nx, :nx] - J[:, :nx, nx:] @ divide(J[:, nx:, nx:], J[:, nx:, :nx])
        f = flow.rates(z)
        with np.errstate(divide="ignore", invalid="ignore"):
            h = np.minimum(DECAY, goal - decayed + 0.5) * epsilon / gap
            h = np.minimum(h, 1.0 / _least_norms(slow))
            # An element is not longer than 1 over the slow rate, and x does not move by more than half of 1 + |x|.
            h = shares * np.minimum(h, 0.5 * (1.0 + np.linalg.norm(x, axis=1)) / np.linalg.norm(f, axis=1))
        rows = np.flatnonzero(active)
        x_new, y_new, good = flow.step(x[rows], y[rows], sign * h[rows])
        z_new = np.hstack([x_new, y_new])
        J_new = flow.jacobian(z_new)
        values, count = _spectrum(J_new[:, nx:, nx:])
        good &= (count == unstable) & np.isfinite(z_new).all(axis=1)
        # Shorter steps lead nearer to where the branch ends.
        shares[rows[~good]] *= 0.5
        ended = rows[~good & (shares[rows] < 1 / 64)]
        is_cut_short[ended], alive[ended] = True, False
        kept = rows[good]
        x, y, z, J = x.copy(), y.copy(), z.copy(), J.copy()
        x[kept], y[kept], z[kept], J[kept] = x_new[good], y_new[good], z_new[good], J_new[good]
        new_gap = np.where(on_side[kept], np.abs(np.real(values[good])), np.inf).min(axis=1)
        decayed[kept] += h[kept] * np.minimum(gap[kept], new_gap) / epsilon
        eigenvalues = eigenvalues.copy()
        eigenvalues[kept] = values[good]
        lengths[kept, counts[kept]] = h[kept]
        counts[kept] += 1
        place = (kept, counts[kept])
        states[place], decays[place], drifts[place] = z[kept], decayed[kept], _drift(flow, z[kept], J[kept])
    if is_cut_short.any():
        # Towards a fold what is fixed there becomes wrong faster than it decays: end where the product is least.
        # Drifts below a thousandth of epsilon (1 + |y|) vanish by accident.
        floor = 1e-3 * epsilon * (1.0 + np.linalg.norm(states[is_cut_short, :1, nx:], axis=2))
        felt = np.log(np.maximum(drifts[is_cut_short], floor)) - decays[is_cut_short]
        counts[is_cut_short] = np.argmin(felt, axis=1)
    rows, m = np.arange(k), int(counts.max(initial=0))
    decayed, drift = decays[rows, counts], drifts[rows, counts]
    states = np.where(np.arange(m + 1)[:, None] <= counts[:, None, None], states[:, : m + 1], states[:, :1])
    lengths = np.where(np.arange(m) < counts[:, None], lengths[:, :m], 0.0)
    return _graded(flow, states, lengths, counts, fastest, decayed, drift, is_cut_short)


def _least_norms(matrices: np.ndarray) -> np.ndarray:
    """The least Frobenius norms (k,) of T A T^-1 over units T, for stacks A (k, n, n): a rate in no units but time's.

    Rows and columns are made as large, in turn (Osborne, J. ACM 7 (1960) 338).
    """
    squares = matrices**2
    n = matrices.shape[-1]
    own = np.einsum("kii->k", squares)
    squares[:, range(n), range(n)] = 0.0
    for _ in range(100 if n > 1 else 0):
        before = squares.sum(axis=(1, 2))
        for i in range(n):
            row, column = squares[:, i].sum(axis=1), squares[:, :, i].sum(axis=1)
            # What drives nothing, or is driven by nothing, has units in which its entries are nothing.
            coupled = (row > 0.0) & (column > 0.0)
            ratio = np.sqrt(np.where(coupled, column, 1.0) / np.where(coupled, row, 1.0))[:, None]
            squares[:, i] *= np.where(coupled[:, None], ratio, 0.0)
            squares[:, :, i] *= np.where(coupled[:, None], 1.0 / ratio, 0.0)
        # Norms are balanced until a sweep over the variables makes them less by no more than this share.
        if (squares.sum(axis=(1, 2)) >= (1.0 - 1e-3) * before).all():
            break
    return np.sqrt(own + squares.sum(axis=(1, 2)))


def _drift(flow: _CriticalFlow, z: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Distance of M_epsilon from M0 to first order; infinite where there is none."""
    nx = flow.nx
    drift = flow.epsilon * np.linalg.norm(
        divide(J[:, nx:, nx:], _fast_slopes(flow, z, J)[:, :, None])[:, :, 0], axis=1
    )
    return np.where(np.isfinite(drift), drift, np.inf)


def _graded(flow: _CriticalFlow, z, lengths, counts, fastest, decayed, drift, is_cut_short) -> Track:
    """The track with its last element halved towards the end, where the fastest direction's layer lies."""
    k, m = lengths.shape
    if m == 0:
        return Track(counts, lengths, z, np.zeros_like(z), decayed, drift, is_cut_short)
    rates = _all_rates(flow, z.reshape(-1, flow.n)).reshape(z.shape)
    last = np.maximum(counts, 1) - 1
    rows = np.arange(k)
    ratio = lengths[rows, last] * fastest / flow.epsilon / DECAY
    # The last elements are halved until the fastest direction is resolved too, but not more often than this.
    halvings = np.clip(np.ceil(np.log2(np.maximum(ratio, 1.0))), 0, 14).astype(np.int64)
    halvings[counts == 0] = 0
    extra = int(halvings.max(initial=0))
    if extra == 0:
        return Track(counts, lengths, z, rates, decayed, drift, is_cut_short)
    lengths = np.hstack([lengths, np.zeros((k, extra))])
    z = np.concatenate([z, np.repeat(z[:, -1:], extra, axis=1)], axis=1)
    rates = np.concatenate([rates, np.repeat(rates[:, -1:], extra, axis=1)], axis=1)
    for q in np.flatnonzero(halvings):
        e, s, h = int(last[q]), int(halvings[q]), lengths[q, last[q]]
        shares = np.append(0.5 ** np.arange(1, s + 1), 0.5**s)
        place = np.cumsum(shares)[:, None]
        for array in (z, rates):
            a, b = array[q, e].copy(), array[q, e + 1].copy()
            array[q, e + 1 : e + s + 2] = a + place * (b - a)
        lengths[q, e : e + s + 1] = h * shares
    return Track(counts + halvings, lengths, z, rates, decayed, drift, is_cut_short)


def _fast_slopes(flow: _CriticalFlow, z: np.ndarray, J: np.ndarray) -> np.ndarray:
    """dy/dt along the slow flow, -g_y^-1 g_x f."""
    nx = flow.nx
    return -np.einsum("kij,kj->ki", divide(J[:, nx:, nx:], J[:, nx:, :nx]), flow.rates(z))


def _all_rates(flow: _CriticalFlow, z: np.ndarray) -> np.ndarray:
    return np.hstack([flow.rates(z), _fast_slopes(flow, z, flow.jacobian(z))])


def _spectrum(matrices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eigenvalues (k, n) and how many are unstable; -1 where they are not finite or on the imaginary axis."""
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    values = np.linalg.eigvals(np.where(finite[:, None, None], matrices, 0.0)).astype(complex)
    count = np.asarray(np.real(values) > 0).sum(axis=1)
    count[(np.real(values) == 0).any(axis=1) | ~finite] = -1
    return values, count


def divide(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """A^-1 B for stacks of matrices; NaN where A is singular or not finite."""
    if matrices.shape[-1] == 1:
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return right / matrices
    finite = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    sign, logarithm = np.linalg.slogdet(np.where(finite[:, None, None], matrices, 0.0))
    regular = finite & (sign != 0) & np.isfinite(logarithm)
    result = np.full((len(matrices), *right.shape[1:]), np.nan, dtype=np.result_type(matrices, right))
    if regular.any():
        result[regular] = np.linalg.solve(matrices[regular], right[regular])
    return result
