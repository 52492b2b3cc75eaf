"""The metric of the slow variables in which the reduced flow parts and draws together neighbours least.

Between orbits of x' = f_0(x) a difference e obeys e' = A e with A = D f_0, and in the metric |e|^2 = e'Pe its rate of
growth or decay is at most |S_P(A)|, the largest |eigenvalue| of the symmetric part of T A T^-1, P = T'T (Dahlquist's
logarithmic norm). Over a region one constant P bounds the growth along every orbit that stays: max_x |S_P(A(x))|. Its
least value over all P is the tangential rate here. It is the same for every linear change of the slow variables, so in
all units, and for a constant A it is the largest |Re lambda|, as it has to be: [[0, c], [0, 0]] is one flow in many
units, c times anything.

Common quadratic Lyapunov functions: Boyd, El Ghaoui, Feron, Balakrishnan, Linear matrix inequalities in system and
control theory, SIAM 1994, section 5.1; balancing: Osborne, J. ACM 7 (1960) 338.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gsp.algebra.triangular_blocks import triangular_blocks

# Rates below so many roundings of what they are made of are 0.
ROUNDING = 64 * float(np.finfo(float).eps)

# A rate this near the least possible is it.
NEAR = 1e-4
# Above so many variables coupled to one another only their units are chosen.
MOST_COUPLED = 12


@dataclass(frozen=True, eq=False)
class SlowMetric:
    """Blocks `T` (n, n) of the metric, one for each of `parts`, the variables that drive one another; no part drives an
    earlier one, and each is measured in units next to which those that drive it are 0.
    """

    T: np.ndarray
    parts: tuple[np.ndarray, ...]

    def seen(self, A: np.ndarray) -> np.ndarray:
        """T A T^-1 (m, n, n) for `A` (m, n, n)."""
        return self.T @ _undriven(A, self.parts) @ np.linalg.inv(self.T)

    def rates(self, A: np.ndarray) -> np.ndarray:
        """Largest rate (m,) of growth or decay of differences under each of `A` (m, n, n); 0 as far as doubles go."""
        B = self.seen(A)
        rates = np.abs(np.linalg.eigvalsh(_symmetric(B))).max(axis=1)
        return np.where(rates > ROUNDING * B.shape[1] * np.abs(B).max(axis=(1, 2)), rates, 0.0)

    def extreme(self, A: np.ndarray) -> tuple[int, float, np.ndarray]:
        """(i, rate, direction (n,)): the largest rate is that of A[i], below 0 where differences decay.

        The direction is that of the eigenvector of A[i] whose own rate is nearest to it.
        """
        i = int(self.rates(A).argmax())
        found = np.linalg.eigvalsh(_symmetric(self.seen(A[i : i + 1]))[0])
        rate = float(found[np.abs(found).argmax()])
        values, vectors = np.linalg.eig(A[i])
        return i, rate, np.real(vectors[:, np.abs(np.real(values) - rate).argmin()])

    def written(self, A: np.ndarray, *, least: float) -> np.ndarray:
        """T (n, n) with the units of the parts in it, in which no drive matters next to rates of `least`."""
        # In a metric that is written down, parts of the slow variables that are driven by others and do not
        # drive them back are measured in units in which the drive is this share of the rates; the least rate
        # itself has it 0.
        aim = 1e-6 * max(least, float(self.rates(A).max()))
        T, scale = self.T, np.ones(len(self.T))
        if not aim > 0.0:
            return T
        for place, part in enumerate(self.parts[1:], 1):
            before = np.concatenate(self.parts[:place])
            back = np.linalg.inv(scale[before, None] * T[np.ix_(before, before)])
            drive = float(np.abs(T[np.ix_(part, part)] @ A[:, part][:, :, before] @ back).max())
            scale[part] = aim / drive if drive > 0.0 else 1.0
        return scale[:, None] * T


def frozen_rates(A: np.ndarray) -> np.ndarray:
    """The least rates (m,) of each of `A` (m, n, n) in a metric of its own: the largest |Re lambda|."""
    return np.abs(np.real(np.linalg.eigvals(A))).max(axis=1)


def least_metric(A: np.ndarray) -> SlowMetric:
    """The metric in which the largest rate over all of `A` (m, n, n), finite, is least, or nearly."""
    # Constant rates are the same everywhere.
    A, n = np.unique(A, axis=0), A.shape[1]
    # Entry (i, k): variable k drives i.
    parts = tuple(map(np.array, triangular_blocks((A != 0.0).any(axis=0))))
    T = np.eye(n)
    for part in parts:
        if len(part) > 1:
            T[np.ix_(part, part)] = _coupled(A[:, part][:, :, part])
    return SlowMetric(T, parts)


def _symmetric(B: np.ndarray) -> np.ndarray:
    return (B + B.transpose(0, 2, 1)) / 2


def _rate_in(A: np.ndarray, T: np.ndarray) -> float:
    return float(np.abs(np.linalg.eigvalsh(_symmetric(T @ A @ np.linalg.inv(T)))).max())


def _undriven(A: np.ndarray, parts: Sequence[np.ndarray]) -> np.ndarray:
    """`A` without what drives one part from another."""
    kept = np.zeros_like(A)
    for part in parts:
        kept[:, part[:, None], part] = A[:, part[:, None], part]
    return kept


def _coupled(A: np.ndarray) -> np.ndarray:
    """T (n, n) for variables that all drive one another."""
    T = np.diag(_balanced(np.sqrt((A**2).mean(axis=0))))
    enough = (1.0 + NEAR) * float(frozen_rates(A).max())
    # Sharpness of the smooth maximum, in steps.
    for sharp in (30.0, 300.0, 3000.0) if len(T) <= MOST_COUPLED else ():
        if _rate_in(A, T) <= enough:
            break
        T = _descended(A, T, sharp)
    return T


def _balanced(sizes: np.ndarray) -> np.ndarray:
    """Units d (n,) in which sum (d_i sizes_ik/d_k)^2 is least: rows and columns are as large."""
    squares, d = sizes**2, np.ones(len(sizes))
    np.fill_diagonal(squares, 0.0)
    for _ in range(200):
        worst = 0.0
        for i in range(len(d)):
            ratio = (squares[:, i].sum() / squares[i].sum()) ** 0.25
            d[i] *= ratio
            squares[i] *= ratio**2
            squares[:, i] /= ratio**2
            worst = max(worst, abs(np.log(ratio)))
        if worst < NEAR:
            break
    return d


def _descended(A: np.ndarray, T: np.ndarray, sharp: float) -> np.ndarray:
    """T moved down the slope of a smooth maximum of the rates; T itself where that is no better."""
    from scipy.optimize import minimize

    n, start = len(T), T
    B = T @ A @ np.linalg.inv(T)
    unit = _rate_in(A, T)

    def value(w: np.ndarray) -> tuple[float, np.ndarray]:
        W = w.reshape(n, n)
        try:
            inverse = np.linalg.inv(W)
        except np.linalg.LinAlgError:
            return np.inf, np.zeros(n * n)
        C = W @ B @ inverse
        if not np.isfinite(C).all():
            return np.inf, np.zeros(n * n)
        rates, along = np.linalg.eigh((C + C.transpose(0, 2, 1)) / (2.0 * unit))
        both = np.concatenate([rates, -rates], axis=1)
        top = float(both.max())
        shares = np.exp(sharp * (both - top))
        total = float(shares.sum())
        weights = (shares[:, :n] - shares[:, n:]) / (total * unit)
        G = (along * weights[:, None, :]) @ along.transpose(0, 2, 1)
        slope = (inverse @ (C @ G - G @ C).sum(axis=0)).T
        return top + float(np.log(total)) / sharp, slope.ravel()

    found = minimize(value, np.eye(n).ravel(), jac=True, method="L-BFGS-B", options={"maxiter": 60}).x
    T = found.reshape(n, n) @ start
    return T if np.isfinite(T).all() and _rate_in(A, T) < unit else start
