"""Functions of fast time along a layer: a polynomial plus a part that decays, sampled on Chebyshev panels.

The polynomial is what the slow flow looks like in fast time, the decaying part is the layer. Products keep the
two apart, so that the decaying part keeps its relative accuracy while the polynomials grow. Elements and ring
have the operations of `gsp.algebra.ring`, so that a `SeriesProgram` runs over them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import sympy as sp

from gsp.algebra.differences import Subtractable
from gsp.algebra.functions import CONSTANTS

# Nodes per panel: a panel as long as a step of an order-8 method at rtol 1e-13 is resolved to rounding.
DEGREE = 16


@lru_cache(maxsize=1)
def chebyshev() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes c (m,) on [-1, 1], ascending, barycentric weights (m,), and S (m, m): (S f)_i = int_(-1)^(c_i) f."""
    n = DEGREE
    nodes = -np.cos(np.pi * np.arange(n + 1) / n)
    weights = (-1.0) ** np.arange(n + 1)
    weights[[0, -1]] *= 0.5
    polynomials = np.polynomial.chebyshev.chebvander(nodes, n)
    integrals = np.empty((n + 1, n + 1))
    for j in range(n + 1):
        coefficients = np.polynomial.chebyshev.chebint(np.eye(n + 1)[j], lbnd=-1)
        integrals[:, j] = np.polynomial.chebyshev.chebval(nodes, coefficients)
    return nodes, weights, integrals @ np.linalg.inv(polynomials)


@lru_cache(maxsize=1)
def _from_samples() -> np.ndarray:
    nodes, _, _ = chebyshev()
    return np.linalg.inv(np.polynomial.chebyshev.chebvander(nodes, DEGREE))


def coefficients(samples: np.ndarray) -> np.ndarray:
    """Chebyshev coefficients of each row of `samples` (k, m): (k, m)."""
    return samples @ _from_samples().T


def tail(samples: np.ndarray) -> np.ndarray:
    """Size of the last three Chebyshev coefficients of each row of `samples` (k, m): (k,)."""
    return np.abs(samples @ _from_samples()[-3:].T).max(axis=1)


@dataclass(frozen=True, eq=False)
class Panels:
    """A grid in fast time: panel ends `ends` (P + 1,) from 0, and `tau` (P, m), the nodes of each panel."""

    ends: np.ndarray

    @cached_property
    def tau(self) -> np.ndarray:
        nodes, _, _ = chebyshev()
        return self.ends[:-1, None] + 0.5 * self.lengths[:, None] * (nodes + 1.0)

    @cached_property
    def lengths(self) -> np.ndarray:
        return np.diff(self.ends)

    def remaining(self, values: np.ndarray) -> np.ndarray:
        """int_tau^end of sampled values (P, m), at the nodes."""
        S = chebyshev()[2]
        within = 0.5 * self.lengths[:, None] * (values @ S.T)
        # Added from the small end, so that the tail keeps its relative accuracy.
        after = np.append(np.cumsum(within[::-1, -1])[::-1][1:], 0.0)
        return after[:, None] + (within[:, -1:] - within)

    def interpolate(self, values: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Sampled values (P, m) at times (k,); 0 beyond the last panel."""
        nodes, weights, _ = chebyshev()
        inside = tau <= self.ends[-1]
        panel = np.clip(np.searchsorted(self.ends, tau, side="right") - 1, 0, len(self.lengths) - 1)
        local = np.minimum(2.0 * (tau - self.ends[panel]) / self.lengths[panel] - 1.0, 1.0)
        distance = local[:, None] - nodes
        hit = np.abs(distance) < 1e-15
        # At a node all the weight is the node's.
        on_node = np.any(hit, axis=1, keepdims=True)
        ratio = np.where(on_node, hit, weights / np.where(hit, 1.0, distance))
        result = (ratio * values[panel]).sum(axis=1) / ratio.sum(axis=1)
        return np.where(inside, result, 0.0)


class Signal(Subtractable):
    """`outer`, coefficients (d,) of a polynomial in tau, plus `samples` (P, m) of a decaying part, or None for 0."""

    __slots__ = ("_values", "outer", "ring", "samples")

    def __init__(self, ring: SignalRing, outer: np.ndarray, samples: np.ndarray | None = None) -> None:
        self.ring = ring
        self.outer = outer
        self.samples = samples
        self._values: np.ndarray | float | None = None

    @property
    def values(self) -> np.ndarray | float:
        """The polynomial at the nodes."""
        if self._values is None:
            if len(self.outer) == 1:
                self._values = float(self.outer[0])
            else:
                self._values = np.polyval(self.outer[::-1], self.ring.panels.tau)
        return self._values

    def __add__(self, other: Signal | int) -> Signal:
        if isinstance(other, int):
            other = self.ring.constant(other)
        outer = np.zeros(max(len(self.outer), len(other.outer)))
        outer[: len(self.outer)] += self.outer
        outer[: len(other.outer)] += other.outer
        if self.samples is None or other.samples is None:
            return Signal(self.ring, outer, other.samples if self.samples is None else self.samples)
        return Signal(self.ring, outer, self.samples + other.samples)

    def __mul__(self, other: Signal | float | sp.Rational) -> Signal:
        if not isinstance(other, Signal):
            # The rules of the functions multiply by SymPy's numbers, which would make arrays of objects.
            number = float(other)
            samples = None if self.samples is None else self.samples * number
            return Signal(self.ring, self.outer * number, samples)
        outer = np.convolve(self.outer, other.outer)
        samples = None
        if self.samples is not None:
            samples = self.samples * other.values
        if other.samples is not None:
            part = other.samples * self.values
            if self.samples is not None:
                part = part + other.samples * self.samples
            samples = part if samples is None else samples + part
        return Signal(self.ring, outer, samples)

    __rmul__ = __mul__

    @property
    def is_zero(self) -> bool:
        """Whether it is the constant 0."""
        return self.samples is None and not self.outer.any()

    @property
    def key(self) -> tuple:
        """A hashable identity."""
        return (self.outer.tobytes(), None if self.samples is None else id(self.samples))

    def reduced(self) -> Signal:
        """The element itself."""
        return self

    def inverse(self) -> Signal:
        """1/self of an element whose polynomial is constant, as all are at order 0."""
        a = self._constant()
        samples = None if self.samples is None else -self.samples / (a * (a + self.samples))
        return Signal(self.ring, np.array([1.0 / a]), samples)

    def apply(self, name: str, exponent: Signal | None = None) -> Signal:
        """An elementary function of such an element."""
        if name in CONSTANTS:
            return self.ring.constant(float(CONSTANTS[name]))
        a = self._constant()
        if name == "pow":
            assert exponent is not None
            power = exponent._constant()

            def function(u):
                return np.power(u, power)

        else:
            function = FUNCTIONS[name]
        value = float(function(a))
        if self.samples is None:
            return self.ring.constant(value)
        if name == "sign":
            return Signal(self.ring, np.array([value]), _signs(a + self.samples) - value)
        if name == "exp":
            return Signal(self.ring, np.array([value]), value * np.expm1(self.samples))
        return Signal(self.ring, np.array([value]), function(a + self.samples) - value)

    def decaying(self, tau: np.ndarray) -> np.ndarray:
        """Values (m,) of the decaying part."""
        return np.zeros(len(tau)) if self.samples is None else self.ring.panels.interpolate(self.samples, tau)

    def _constant(self) -> float:
        assert len(self.outer) == 1, "functions are applied at order 0 only, where polynomials are constant"
        return float(self.outer[0])


def _signs(values: np.ndarray) -> np.ndarray:
    """Signs of `values` (P, m); at the ends of a panel, which may lie on the zero, those within it where they agree."""
    signs = np.sign(values)
    within = signs[:, 1:-1]
    agree = (within == within[:, :1]).all(axis=1)
    signs[agree] = signs[agree, 1:2]
    return signs


FUNCTIONS: dict[str, Callable] = {
    **{name: getattr(np, name) for name in ("exp", "log", "sqrt", "sin", "cos", "tan", "sinh", "cosh", "tanh")},
    **{"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan},
    **{"asinh": np.arcsinh, "acosh": np.arccosh, "atanh": np.arctanh},
    **{"erf": np.vectorize(math.erf, otypes=[float]), "sign": np.sign, "Abs": np.abs},
}


class SignalRing:
    """The ring of signals over `panels`, with the solution of the linear problem Y' = A(tau) Y + R.

    A tends to `limit` (n, n), all of whose eigenvalues have negative real part; `jacobian` (P, m, n, n) samples
    A - limit. It is solved with Y in `units` (n,), in which the entries of A are of a size.
    """

    def __init__(self, panels: Panels, limit: np.ndarray, jacobian: np.ndarray, units: np.ndarray) -> None:
        self.panels = panels
        self.units = units
        self.limit, self.jacobian = (matrix * (units / units[:, None]) for matrix in (limit, jacobian))
        self.zero = self.constant(0)
        self.one = self.constant(1)

    def constant(self, value) -> Signal:
        """A number as an element."""
        return Signal(self, np.array([float(value)]))

    def slow(self, rate: Signal, initial: float) -> Signal:
        """X with X' = rate and X(0) = initial: its polynomial starts at initial + int_0^inf of the decaying rate."""
        powers = np.append(0.0, rate.outer / np.arange(1, len(rate.outer) + 1))
        powers[0] = float(initial)
        if rate.samples is None:
            return Signal(self, powers)
        left = self.panels.remaining(rate.samples)
        powers[0] += left[0, 0]
        return Signal(self, powers, -left)

    def fast(self, rest: Sequence[Signal], initial: Sequence[float]) -> list[Signal]:
        """Y with Y' = A Y + rest and Y(0) = initial."""
        n, depth = len(rest), max(len(r.outer) for r in rest)
        known = np.zeros((depth, n))
        for i, r in enumerate(rest):
            known[: len(r.outer), i] = r.outer / self.units[i]
        # The polynomial solves Q' = limit Q + known, from the highest power down.
        Q = np.zeros((depth + 1, n))
        for power in reversed(range(depth)):
            Q[power] = np.linalg.solve(self.limit, (power + 1) * Q[power + 1] - known[power])
        outer = [Signal(self, Q[:depth, i].copy()) for i in range(n)]  # In units, as all that follows.
        values = np.stack([np.broadcast_to(s.values, self.panels.tau.shape) for s in outer], axis=-1)
        source = np.einsum("pmij,pmj->pmi", self.jacobian, values)
        for i, r in enumerate(rest):
            if r.samples is not None:
                source[:, :, i] += r.samples / self.units[i]
        solution = self._march(source, np.array([float(v) for v in initial]) / self.units - Q[0])
        return [
            Signal(self, outer[i].outer * unit, solution[:, :, i] * unit) for i, unit in enumerate(self.units)
        ]

    @cached_property
    def _inverses(self) -> np.ndarray:
        S = chebyshev()[2]
        m, n = len(S), len(self.limit)
        A = self.limit + self.jacobian
        half = 0.5 * self.panels.lengths
        blocks = np.eye(m * n) - np.einsum("p,ij,pjab->piajb", half, S, A).reshape(-1, m * n, m * n)
        return np.linalg.inv(blocks)

    def _march(self, source: np.ndarray, left: np.ndarray) -> np.ndarray:
        """Y' = A Y + source from Y(0) = left, panel by panel: (P, m, n)."""
        S = chebyshev()[2]
        result = np.empty_like(source)
        for i, inverse in enumerate(self._inverses):
            right = left + 0.5 * self.panels.lengths[i] * (S @ source[i])
            result[i] = (inverse @ right.ravel()).reshape(right.shape)
            left = result[i, -1]
        return result
