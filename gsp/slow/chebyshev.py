"""Chebyshev interpolants on boxes of one to three dimensions, with values in R^k.

Second-kind points, tensor products, coefficients kept and summed by the Chebyshev polynomials' values (L. N.
Trefethen, "Approximation Theory and Approximation Practice", chapters 2-4 and 19).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import chebyshev


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

    def slopes(self, sizes: Sequence[int]) -> np.ndarray:
        """Derivatives (n_1, ..., n_d, k, d) at the nodes of a grid of `sizes`, no axis of it shorter than ours."""
        result = []
        for c in self._derivatives:
            for axis, size in enumerate(sizes):
                longer = np.zeros((size, *np.delete(c.shape, axis)))
                longer[: c.shape[axis]] = np.moveaxis(c, axis, 0)
                c = np.moveaxis(_to_values(longer), 0, axis)
            result.append(c)
        return np.stack(result, axis=-1)

    def in_units(self, x: np.ndarray, y: np.ndarray) -> ChebyshevSurface:
        """The same surface where a number of ours is `x` (d,) or `y` (k,) of the new ones."""
        return ChebyshevSurface(self.box * x[:, None], self.coefficients * y)

    def moved(self, x: np.ndarray, y: np.ndarray) -> ChebyshevSurface:
        """The same surface, `x` (d,) further along and `y` (k,) higher."""
        coefficients = self.coefficients.copy()
        coefficients[(0,) * len(self.box)] += y
        return ChebyshevSurface(self.box + x[:, None], coefficients)

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
        # What all values have in common is added last, by one rounding, and places are told from both ends.
        rest, first = coefficients.copy(), (0,) * len(self.box)
        rest[first] = 0.0
        low, high = self.box.T
        # For a point the polynomials of one axis, and what is left of the coefficients after the first.
        each = max(*coefficients.shape, coefficients.size // len(coefficients))
        # Numbers that are held at once in sums over many points.
        many = max(1, (2**22) // each)
        for begin in range(0, len(x), many):
            part = x[begin : begin + many]
            unit = ((part - low) - (high - part)) / (high - low)
            total = np.broadcast_to(rest, (1, *rest.shape))
            for axis in range(len(self.box)):
                n = coefficients.shape[axis]
                basis = chebyshev.chebvander(unit[:, axis], n - 1)
                if axis == 0:
                    total = (basis @ rest.reshape(n, -1)).reshape(len(part), *rest.shape[1:])
                else:
                    total = np.einsum("mj,mj...->m...", basis, total)
            result[begin : begin + many] = total + coefficients[first]
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
        c = np.moveaxis(_to_coefficients(np.moveaxis(c, axis, 0)), 0, axis)
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


def _to_coefficients(values: np.ndarray) -> np.ndarray:
    """Coefficients (n, ...) of values (n, ...) at the n points: a discrete cosine transform."""
    m = len(values) - 1
    # Points run from low to high, theta from pi to 0.
    series = np.fft.rfft(_even(values[::-1]), axis=0).real / m
    series[[0, -1]] *= 0.5
    return series


def _to_values(coefficients: np.ndarray) -> np.ndarray:
    """Values (n, ...) at the n points of coefficients (n, ...): the transform back."""
    inner = 0.5 * coefficients
    inner[[0, -1]] *= 2.0
    return np.fft.rfft(_even(inner), axis=0).real[::-1]


def _even(half: np.ndarray) -> np.ndarray:
    """The even sequence (2 n - 2, ...) whose half is (n, ...)."""
    return np.concatenate([half, half[-2:0:-1]])
