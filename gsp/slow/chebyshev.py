"""Chebyshev interpolants on boxes of one to three dimensions, with values in R^k.

Second-kind points, tensor products, coefficients kept and summed by the Chebyshev polynomials' values (L. N.
Trefethen, "Approximation Theory and Approximation Practice", chapters 2-4 and 19).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.polynomial import chebyshev

# Points evaluated at once: bounds the memory of the partial sums.
CHUNK = 4096


@dataclass(frozen=True, eq=False)
class ChebyshevSurface:
    """A polynomial on `box` (d, 2): `coefficients` (n_1, ..., n_d, k) of products of Chebyshev polynomials."""

    box: np.ndarray
    coefficients: np.ndarray

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """Values (m, k) at `x` (m, d)."""
        return self._sum(self.coefficients, x)

    def derivative(self, x: np.ndarray) -> np.ndarray:
        """Derivatives (m, k, d) at `x` (m, d)."""
        return np.stack([self._sum(c, x) for c in self._derivatives], axis=2)

    @cached_property
    def _derivatives(self) -> list[np.ndarray]:
        scale = 2.0 / (self.box[:, 1] - self.box[:, 0])
        result = []
        for axis in range(len(self.box)):
            if self.coefficients.shape[axis] == 1:
                result.append(np.zeros_like(self.coefficients))
            else:
                result.append(scale[axis] * chebyshev.chebder(self.coefficients, axis=axis))
        return result

    def _sum(self, coefficients: np.ndarray, x: np.ndarray) -> np.ndarray:
        k = coefficients.shape[-1]
        result = np.empty((len(x), k))
        for begin in range(0, len(x), CHUNK):
            part = x[begin : begin + CHUNK]
            unit = (2.0 * part - self.box.sum(axis=1)) / (self.box[:, 1] - self.box[:, 0])
            total = np.broadcast_to(coefficients, (1, *coefficients.shape))
            for axis in range(len(self.box)):
                n = coefficients.shape[axis]
                basis = chebyshev.chebvander(unit[:, axis], n - 1)
                if axis == 0:
                    total = (basis @ coefficients.reshape(n, -1)).reshape(len(part), *coefficients.shape[1:])
                else:
                    total = np.einsum("mj,mj...->m...", basis, total)
            result[begin : begin + CHUNK] = total
        return result

    def tails(self) -> np.ndarray:
        """For each axis the size of its last coefficients, as large as the error of interpolation or larger."""
        sizes = np.abs(self.coefficients).max(axis=-1)
        result = np.empty(len(self.box))
        for axis in range(len(self.box)):
            n = sizes.shape[axis]
            # Several at once: those of one parity may vanish.
            last = np.take(sizes, range(n - max(2, n // 8), n), axis=axis)
            result[axis] = last.max()
        return result

    def chopped(self, tolerance: float) -> ChebyshevSurface:
        """The same without trailing coefficients whose sum is below `tolerance`."""
        c = self.coefficients
        for axis in range(len(self.box)):
            others = tuple(i for i in range(c.ndim) if i != axis)
            rest = np.cumsum(np.abs(c).sum(axis=others)[::-1])[::-1]
            kept = max(1, int((rest > tolerance).sum()))
            c = np.take(c, range(kept), axis=axis)
        return ChebyshevSurface(self.box, np.ascontiguousarray(c))


def interpolate(box: np.ndarray, values: np.ndarray) -> ChebyshevSurface:
    """The interpolant of `values` (n_1, ..., n_d, k) at `nodes(box, (n_1, ..., n_d))`."""
    c = values
    for axis in range(len(box)):
        c = np.moveaxis(np.tensordot(_to_coefficients(values.shape[axis]), c, axes=(1, axis)), 0, axis)
    return ChebyshevSurface(box, np.ascontiguousarray(c))


def nodes(box: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """The tensor grid (n_1, ..., n_d, d) of second-kind points, from low to high; those of n are in those of
    2 n - 1."""
    axes = []
    for (low, high), n in zip(box, sizes):
        unit = _points(n)
        # Exact at both ends.
        axes.append(0.5 * (low * (1.0 - unit) + high * (1.0 + unit)))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _points(n: int) -> np.ndarray:
    # The sine is odd to the last digit, the cosine is not.
    return np.sin(0.5 * np.pi * np.arange(1 - n, n, 2) / (n - 1))


@lru_cache(maxsize=64)
def _to_coefficients(n: int) -> np.ndarray:
    """Matrix from values at the n points to coefficients, a discrete cosine transform."""
    m = n - 1
    # Points run from low to high, theta from pi to 0.
    theta = np.pi * (m - np.arange(n)) / m
    matrix = (2.0 / m) * np.cos(np.outer(np.arange(n), theta))
    matrix[:, [0, -1]] *= 0.5
    matrix[[0, -1]] *= 0.5
    return matrix
