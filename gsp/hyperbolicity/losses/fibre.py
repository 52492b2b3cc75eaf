"""The layer problem along its fast fibre where g_y is singular: Lyapunov and Schmidt's bifurcation function.

With R, L the null vectors of g_y at (x, y*), L^T R = 1, and w transversal, y = y* + R s + w and

    g(x, y) = L' phi(s),  R^T w = 0,

phi(s) is what is left of g after the regular directions have been solved for (L' spans the cokernel). A fold has
phi = a s^2 + ..., a cusp c s^3 + ...; phi identically zero says that the zeros of g extend along the fibre.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.critical.layer_problem import LayerProblem

ROUNDED = 0.1


@dataclass(frozen=True)
class FibreOrder:
    """phi(s) = +-coefficient |s|^order on the two sides of 0: `plus`, `minus` its values over |s|^order.

    `vanishes`: phi is zero along the fibre, near 0 at least, and `order` is 0 then, as it is when the two sides could
    not be followed.
    """

    order: float
    plus: float
    minus: float
    vanishes: bool

    @property
    def attracts(self) -> tuple[bool, bool]:
        """Whether v' = phi(v) leads back to 0 from v > 0, and from v < 0."""
        return self.plus < 0.0, self.minus > 0.0

    def at(self, s: float) -> float:
        """The larger of |phi(s)| and |phi(-s)|, s > 0."""
        return max(abs(self.plus), abs(self.minus)) * s**self.order


def bifurcation_function(
    problem: LayerProblem, z: np.ndarray, right: np.ndarray, left: np.ndarray, s: np.ndarray
) -> np.ndarray | None:
    """phi(s) (m,) for R = `right`, `left` (n, m), orthonormal columns each; None when Newton's method fails.

    In the coordinates of `left`: phi = left^T g at the corrected point.
    """
    k, n, m = len(problem.free), problem.size, right.shape[1]
    x, start = z[:k], z[k:]
    y, t = start + right @ s, np.zeros(m)
    for _ in range(30):
        u = np.concatenate([x, y])
        value = np.concatenate([problem.residual(u) - left @ t, right.T @ (y - start) - s])
        matrix = np.block([[problem.jacobian(u)[:, k:], -left], [right.T, np.zeros((m, m))]])
        if not (np.isfinite(value).all() and np.isfinite(matrix).all()):
            return None
        try:
            step = np.linalg.solve(matrix, value)
        except np.linalg.LinAlgError:
            return None
        y, t = y - step[:n], t - step[n:]
        if np.abs(step).max() <= 1e-14 * (1.0 + np.abs(y).max()):
            return t
    return t if np.abs(value).max() <= 1e-12 * (1.0 + np.abs(y).max()) else None


def order_along(
    problem: LayerProblem, z: np.ndarray, right: np.ndarray, left: np.ndarray, *, width: float, typical: float
) -> FibreOrder | None:
    """The order of phi along one null direction, out to `width`; None when it cannot be followed.

    `typical` is the size of g nearby, in the region: what is zero is told by it.
    `right` and `left` are (n, m) with the direction first; phi is measured by its component along it, normalised
    to <l, r> = 1 when they are not orthogonal.
    """
    product = float(left[:, 0] @ right[:, 0])
    weight = 1.0 / product if abs(product) > 1e-8 else 1.0
    # phi is zero along the fibre when it is below this, relative to the size of g nearby.
    noise = 1e-11 * max(typical, 1e-300) * abs(weight)
    best: tuple[float, FibreOrder] | None = None
    # The order is measured over distances that shrink by 4; the one whose order is nearest to a whole number counts.
    for level in range(4):
        sizes = width * 0.25**level * np.array([1.0, 0.5])
        values = _values(problem, z, right, left, sizes, weight)
        if values is None:
            continue
        if np.abs(values).max() <= noise:
            # A power may fall below the noise; where the one measured further out would not, it was none: phi is
            # zero up to where the field switches.
            # What a power measured further out leaves here is told from noise when it is larger by this.
            if best is None or best[1].at(sizes[0]) > 10.0 * noise:
                return FibreOrder(0.0, 0.0, 0.0, True)
            break
        found = _fitted(values, sizes)
        if found is not None and (best is None or found[0] < best[0]):
            best = found
    return None if best is None else best[1]


def _values(
    problem: LayerProblem,
    z: np.ndarray,
    right: np.ndarray,
    left: np.ndarray,
    sizes: np.ndarray,
    weight: float,
) -> np.ndarray | None:
    """phi along the first direction at +- the two `sizes`: (2, 2), the positive side first."""
    e = np.eye(right.shape[1])[0]
    values = np.empty((2, 2))
    for i, sign in enumerate((1.0, -1.0)):
        for j, size in enumerate(sizes):
            t = bifurcation_function(problem, z, right, left, sign * size * e)
            if t is None:
                return None
            values[i, j] = weight * (t[0] if len(t) == 1 else np.linalg.norm(t) * np.sign(t[0] or 1.0))
    return values


def _fitted(values: np.ndarray, sizes: np.ndarray) -> tuple[float, FibreOrder] | None:
    """How far the measured order is from the one it is rounded to, and the fit, its coefficients extrapolated."""
    with np.errstate(divide="ignore", invalid="ignore"):
        orders = np.log2(np.abs(values[:, 0] / values[:, 1]))
    good = np.isfinite(orders)
    if not good.any():
        return None
    measured = float(np.mean(orders[good]))
    order = float(round(measured)) if abs(measured - round(measured)) <= ROUNDED else round(measured, 3)
    coarse, fine = values[:, 0] / sizes[0] ** order, values[:, 1] / sizes[1] ** order
    # Richardson: the next power changes the coefficient in proportion to s.
    plus, minus = 2.0 * fine - coarse
    error = float(np.abs(orders[good] - order).max())
    # Every measurement agrees with itself: a whole number near by is preferred.
    error = error if order == round(order) else max(error, ROUNDED)
    return error, FibreOrder(order, float(plus), float(minus), False)
