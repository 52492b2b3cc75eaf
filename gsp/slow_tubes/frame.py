"""Norms in which what shrinks and turns shrinks as its eigenvalues say: |w| as |T^-1 w|, T a real eigenbasis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from flint import arb, arb_mat

from gsp.proofs import balls
from gsp.proofs.spectrum import WORST_CONDITION, largest_modulus, least_eigenvalue
from gsp.slow_tubes.ball_vectors import row, times
from gsp.slow_tubes.isolation import norm

BALL = balls.hull(-1.0, 1.0)


@dataclass(frozen=True, eq=False)
class FibreBasis:
    """T (m, m) and its inverse: |w| is taken as |T^-1 w|."""

    matrix: arb_mat
    inverse: arb_mat

    def size(self, vector: Sequence[arb]) -> arb:
        """|T^-1 w|."""
        return norm(times(self.inverse, vector))

    def box(self, size: arb) -> list[arb]:
        """A box that holds every w with |T^-1 w| <= `size`."""
        m = self.matrix.nrows()
        return [BALL * (norm(row(self.matrix, i)) * size) for i in range(m)]

    def change(self, other: FibreBasis) -> arb:
        """A bound of |w| here over |w| in the `other` frame, near 1 for two that hardly differ."""
        between = self.inverse * other.matrix
        square = between.transpose() * between
        return arb(largest_modulus([row(square, i) for i in range(square.nrows())])).sqrt()

    def decay(self, B: arb_mat) -> float:
        """How fast |T^-1 w| falls at least where w' = B w; -inf where no bound is found."""
        turned = self.inverse * B * self.matrix
        m = B.nrows()
        return least_eigenvalue([[-(turned[i, j] + turned[j, i]) / 2 for j in range(m)] for i in range(m)])


def framed(frame: FibreBasis, B: arb_mat) -> tuple[FibreBasis, float]:
    """The frame, or one of B's eigenvectors where the norm in it hardly falls, and the rate at which it falls."""
    decay = frame.decay(B)
    m = B.nrows()
    if m == 1:
        return frame, decay
    middle = np.array([[float(B[i, j].mid()) for j in range(m)] for i in range(m)])
    values, vectors = np.linalg.eig(middle)
    # A frame is kept while the norm in it shrinks at this share of the rate that the eigenvalues have.
    if decay >= 0.8 * -float(np.real(values).max()):
        return frame, decay
    columns = []
    for value, vector in zip(values, vectors.T):
        # Of a complex pair the real and the imaginary part.
        columns.append(np.real(vector) if np.imag(value) >= 0.0 else np.imag(vector))
    turned = np.array(columns).T
    if not np.linalg.cond(turned) < WORST_CONDITION:
        return frame, decay
    matrix = arb_mat(m, m, [arb(float(v)) for v in turned.ravel()])
    other = FibreBasis(matrix, matrix.inv())
    better = other.decay(B)
    return (other, better) if better > decay else (frame, decay)
