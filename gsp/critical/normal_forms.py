"""Coefficients that decide what a degenerate equilibrium looks like nearby: folds, cusps, Hopf, double zeros.

Everything is computed from the derivatives at one point: A = g_y (n, n) and B = g_yy (n, n, n), the first index that of
the equation, and the form C(u, v, w) of g_yyy. Null vectors have |r| = 1 and <l, r> = 1. Under y -> T y a coefficient
of degree k in r is divided by s^(k-1), s = |T r|: signs are invariant, and so are the combinations that the docstrings
name.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gsp.critical.multilinear_form import MultilinearForm

# A term is zero when it is below this, relative to the largest one: places are known to a root of rounding.
ZERO_TERM = 1e-6

Trilinear = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]


def significant(value: float, terms: float, *, zero: float = ZERO_TERM) -> float:
    """The value, or 0 where it is below the share `zero` of the terms that it is made of."""
    return value if abs(value) > zero * terms else 0.0


def null_vectors(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular vectors (r, l) of A for its least singular value, of unit length; r's largest component is positive."""
    left, _, rows = np.linalg.svd(A)
    right = rows[-1]
    return right * np.sign(right[np.argmax(np.abs(right))]), left[:, -1]


def quadratic_coefficient(B: np.ndarray, right: np.ndarray, left: np.ndarray) -> float:
    """a = <l, B r r>/2 of v' = a v^2 + ...: not zero at a fold (Kuznetsov 2004, 5.4)."""
    return 0.5 * float(np.einsum("i,ijk,j,k->", left, B, right, right))


def cubic_coefficient(A: np.ndarray, B: np.ndarray, C: Trilinear, right: np.ndarray, left: np.ndarray) -> float:
    """c = <l, C(r, r, r) + 3 B r h>/6 with A h = -B r r, of v' = c v^3 + ...: not zero at a cusp (ibid., 8.7)."""
    n = len(A)
    bending = np.einsum("ijk,j,k->i", B, right, right)
    h = np.linalg.solve(bordered(A, left, right), np.append(-bending, 0.0))[:n]
    cubic = C(right, right, right)
    return float(left @ (cubic + 3.0 * np.einsum("ijk,j,k->i", B, right, h))) / 6.0


def bordered(A: np.ndarray, column: np.ndarray, row: np.ndarray) -> np.ndarray:
    """[[A, column], [row^T, 0]], regular with a simple null vector on each side, r and l, and with l and r."""
    return np.block([[A, column[:, None]], [row[None, :], np.zeros((1, 1))]])


def first_lyapunov(
    A: np.ndarray, B: np.ndarray, C: MultilinearForm, omega: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """(l1, q, p) with A q = i omega q, A^T p = -i omega p, |q| = 1, <p, q> = 1 (ibid., (5.62)).

    The sign of l1 is invariant, and so is whether it is 0, which it is where its terms cancel; its size goes with q.
    """
    n = len(A)
    values, vectors = np.linalg.eig(A)
    q = vectors[:, np.argmin(np.abs(values - 1j * omega))]
    transposed, adjoints = np.linalg.eig(A.T)
    p = adjoints[:, np.argmin(np.abs(transposed + 1j * omega))]
    q = q / np.linalg.norm(q)
    p = p / np.conj(np.vdot(p, q))

    def quadratic(v: np.ndarray, w: np.ndarray, form: np.ndarray = B) -> np.ndarray:
        return np.einsum("ijk,j,k->i", form, v, w)

    steady = np.linalg.solve(A, quadratic(q, q.conj()))
    double = np.linalg.solve(2j * omega * np.eye(n) - A, quadratic(q, q))
    total = C(q, q, q.conj()) - 2.0 * quadratic(q, steady) + quadratic(q.conj(), double)
    value = float(np.vdot(p, total).real)
    size, bent = np.abs(q), 2.0 * np.abs(steady) + np.abs(double)
    terms = np.abs(p) @ (abs(C)(size, size, size) + quadratic(size, bent, np.abs(B)))
    return significant(value, terms) / (2.0 * omega), q, p


def bogdanov_takens(A: np.ndarray, B: np.ndarray) -> tuple[float, float]:
    """(a, b) of v'' = a v^2 + b v v' on the centre manifold of a double zero (ibid., 8.7); a/b is invariant.

    a = <p1, B q0 q0>/2, b = <p0, B q0 q0> + <p1, B q0 q1> with A q0 = 0, A q1 = q0, A^T p1 = 0, A^T p0 = p1.
    """
    q0, p1 = null_vectors(A)
    q1 = np.linalg.lstsq(A, q0, rcond=1e-6)[0]
    p1 = p1 / (p1 @ q1)
    p0 = np.linalg.lstsq(A.T, p1, rcond=1e-6)[0]
    p0 = p0 - (p0 @ q1) * p1
    bent, mixed = np.einsum("ijk,j,k->i", B, q0, q0), np.einsum("ijk,j,k->i", B, q0, q1)
    return 0.5 * float(p1 @ bent), float(p0 @ bent + p1 @ mixed)
