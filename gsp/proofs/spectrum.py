"""How many eigenvalues of every matrix in a ball matrix are stable and unstable, and their distance from the axis.

With a basis P and signs S = diag(+-1) let B = P^-1 M P and H = (S B + B^T S)/2. If H is positive definite with
z^T H z >= h |z|^2 for every M of the ball matrix, then no M has an imaginary eigenvalue, the numbers of unstable and
stable ones are those of + and - in S (Ostrowski and Schneider 1962, the main inertia theorem, with Q = P^-T S P^-1),
and |Re lambda| >= h: for an eigenvector B z = lambda z, Re lambda (z* S z) = z* H z. Any basis that passes is a
proof; doubles only propose it. Proposed are the real eigenbasis, and for a matrix with all eigenvalues on one side
also the basis in which its Lyapunov equation is the identity, which serves where eigenvectors are nearly parallel.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

from gsp.proofs import balls

# An imaginary part of this share of an eigenvalue is rounding; a poor basis costs boxes, never truth.
IMAGINARY = 1e-12
# A basis nearer to a singular one is left to Lyapunov's: the checker's whole numbers have 29 digits behind the point.
WORST_CONDITION = 1e8


@dataclass(frozen=True, eq=False)
class Spectrum:
    """What is proved of a ball matrix: its numbers of `stable` and `unstable` eigenvalues, and |Re lambda| >= `gap`.

    `basis` (m, m) and `signs` (m,) are the P and S that prove it.
    """

    stable: int
    unstable: int
    gap: float
    basis: np.ndarray
    signs: np.ndarray

    @property
    def counts(self) -> tuple[int, int]:
        """(stable, unstable)."""
        return self.stable, self.unstable


def spectrum_of(matrix: list[arb], near: np.ndarray) -> Spectrum | None:
    """The spectrum of every matrix in `matrix` (m m,), which holds about `near` (m, m); None where it is not
    proved.
    """
    m = len(near)
    if m == 1:
        return _of_number(matrix[0])
    whole = arb_mat(m, m, matrix)
    for basis, signs in _proposals(near):
        gap = _least_gap(whole, basis, signs)
        if gap > 0.0:
            unstable = int((signs > 0).sum())
            return Spectrum(m - unstable, unstable, gap, basis, signs)
    return None


def _of_number(entry: arb) -> Spectrum | None:
    one = np.ones((1, 1))
    if entry < 0:
        return Spectrum(1, 0, -balls.above(entry), one, np.array([-1]))
    if entry > 0:
        return Spectrum(0, 1, balls.below(entry), one, np.array([1]))
    return None


def _proposals(near: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    # Imported where it serves: most systems have one fast variable.
    from scipy.linalg import solve_continuous_lyapunov

    if not np.isfinite(near).all():
        return
    values, vectors = np.linalg.eig(near)
    basis, signs = _real_eigenbasis(values, vectors)
    if basis.shape == near.shape and _condition(basis) < WORST_CONDITION:
        yield basis, signs
    sides = np.sign(np.real(values))
    if (sides == sides[0]).all() and sides[0] != 0.0:
        # Q with M^T Q + Q M = 2 sides Q-positive: z^T Q z grows or falls along every direction.
        with warnings.catch_warnings():
            # Eigenvalues near the axis; a poor proposal is not proved.
            warnings.simplefilter("ignore", RuntimeWarning)
            weight = solve_continuous_lyapunov(near.T, 2.0 * sides[0] * np.eye(len(near)))
        if not np.isfinite(weight).all():
            return
        try:
            factor = np.linalg.cholesky(0.5 * (weight + weight.T))
        except np.linalg.LinAlgError:
            return
        yield np.linalg.inv(factor).T, sides.astype(int)


def _real_eigenbasis(values: np.ndarray, vectors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A real basis (m, m): eigenvectors, and real and imaginary parts of pairs; signs (m,) of their real parts."""
    columns, signs = [], []
    for i in np.argsort(np.real(values), kind="stable"):
        side = 1 if np.real(values[i]) > 0.0 else -1
        if abs(np.imag(values[i])) <= IMAGINARY * abs(values[i]):
            columns.append(np.real(vectors[:, i]))
            signs.append(side)
        elif np.imag(values[i]) > 0.0:
            columns += [np.real(vectors[:, i]), np.imag(vectors[:, i])]
            signs += [side, side]
    return np.array(columns).T, np.array(signs)


def _condition(basis: np.ndarray) -> float:
    """How near the basis is to a singular one, whatever the units of its rows."""
    sizes = np.abs(basis).max(axis=1, keepdims=True)
    return float(np.linalg.cond(basis / sizes)) if sizes.all() else np.inf


def _least_gap(matrix: arb_mat, basis: np.ndarray, signs: np.ndarray) -> float:
    """h of the module's theorem with P = `basis`, a lower bound; 0 or less where the theorem does not apply."""
    m = len(basis)
    if basis.shape != (m, m) or len(signs) != m or not np.isfinite(basis).all():
        return 0.0
    exact = arb_mat(m, m, [balls.exact(float(v)) for v in basis.ravel()])
    try:
        inside = exact.solve(matrix * exact)
    except ZeroDivisionError:
        # The basis is not proved to be one.
        return 0.0
    s = [int(sign) for sign in signs]
    form = [[(inside[i, j] * s[i] + inside[j, i] * s[j]) / 2 for j in range(m)] for i in range(m)]
    return least_eigenvalue(form)


def least_eigenvalue(form: list[list[arb]]) -> float:
    """A lower bound of z^T H z / z^T z over every symmetric H in the ball matrix `form`; nan becomes -inf.

    Gershgorin's theorem, by the rows as they are, and if that is not positive after a rotation to the eigenvectors of
    the midpoint.
    """
    m = len(form)
    bound = _by_rows(form)
    if bound > 0.0 or m == 1:
        return bound
    turned, lengths = _turned(form)
    least = _by_rows(turned)
    # z = V u: u^T (V^T H V) u >= least |u|^2, so that V is regular, and |z|^2 <= longest |u|^2.
    if not least > 0.0:
        return -np.inf
    longest = _row_sum(lengths)
    return balls.below(balls.exact(least) / balls.exact(longest))


def largest_modulus(form: list[list[arb]]) -> float:
    """An upper bound of |z^T H z| / z^T z over every symmetric H in the ball matrix `form`; infinite where none is
    found.

    The largest row sum, as the matrix is or after a rotation to the eigenvectors of the midpoint.
    """
    bound = _row_sum(form)
    if len(form) == 1 or not bound < np.inf:
        return bound
    turned, lengths = _turned(form)
    off = _row_sum(
        [[entry - (1 if i == j else 0) for j, entry in enumerate(row)] for i, row in enumerate(lengths)]
    )
    # z = V u: |z|^2 >= (1 - off) |u|^2, and V is regular.
    if not off < 0.5:
        return bound
    return min(bound, balls.above(balls.exact(_row_sum(turned)) / (1 - balls.exact(off))))


def _turned(form: list[list[arb]]) -> tuple[list[list[arb]], list[list[arb]]]:
    """V^T H V and V^T V, V the eigenvectors of the midpoint in doubles, or the identity where it is not finite."""
    m = len(form)
    middle = np.array([[float(entry.mid()) for entry in row] for row in form])
    vectors = np.linalg.eigh(0.5 * (middle + middle.T))[1] if np.isfinite(middle).all() else np.eye(m)
    rotation = arb_mat(m, m, [balls.exact(float(v)) for v in vectors.ravel()])
    turned, lengths = rotation.transpose() * arb_mat(form) * rotation, rotation.transpose() * rotation
    return turned.table(), lengths.table()


def _row_sum(form: list[list[arb]]) -> float:
    """The largest sum of moduli in a row, or infinity."""
    sums = [balls.above(sum((entry.abs_upper() for entry in row), balls.ZERO)) for row in form]
    return max(sums) if all(value < np.inf for value in sums) else np.inf


def _by_rows(form: list[list[arb]]) -> float:
    bounds = [
        balls.below(sum((-entry.abs_upper() for j, entry in enumerate(row) if j != i), row[i]))
        for i, row in enumerate(form)
    ]
    # Not a number is no bound.
    return -np.inf if np.isnan(bounds).any() else min(bounds)
