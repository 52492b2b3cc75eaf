"""Gauss collocation of periodic orbits: the scheme, a discrete cycle, its linearisation and bordered solves.

In the phase s in [0, 1] an orbit is u' = T F(u, lambda), u(1) = u(0), approximated on each of N mesh intervals by a
polynomial of degree m that satisfies the equation at the m Gauss points [dBS73]. Its error is O(h^(m+1)) between the
mesh points and O(h^(2m)) at them and in T. The polynomials' inner values are eliminated interval by interval; what
is left is almost block diagonal, bordered by a phase condition and, along a family, the arclength.

[dBS73] C. de Boor, B. Swartz, SIAM J. Numer. Anal. 10 (1973) 582-606. The bordered form is that of AUTO: E. J. Doedel,
H. B. Keller, J. P. Kernevez, Int. J. Bifurcation and Chaos 1 (1991) 745-772.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import factorial

import numpy as np
import sympy as sp
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu

from gsp.algebra.differentiation import derivative
from gsp.lowering.compiled_flow import CompiledFunction, compile_flow, compile_function
from gsp.systems.flow import Flow


@dataclass(frozen=True, eq=False)
class Scheme:
    """The Gauss method with m stages: nodes c (m,), weights b (m,), matrix A (m, m), and what polynomials need.

    `x` (m + 1,) are 0 and the nodes, `barycentric` their weights; `slopes` (m, m + 1) takes a polynomial's values
    at x to its derivatives at c; `leading` (m + 1,) to its m-th derivative; `constant` is the maximum over an
    interval of length 1 of the error for u^(m+1) = 1.
    """

    c: np.ndarray
    b: np.ndarray
    A: np.ndarray
    x: np.ndarray
    barycentric: np.ndarray
    slopes: np.ndarray
    leading: np.ndarray
    constant: float

    @property
    def degree(self) -> int:
        """Number of stages and degree of the polynomials, m."""
        return len(self.c)

    def basis(self, s: np.ndarray) -> np.ndarray:
        """Lagrange polynomials on x at places s (k,) of [0, 1]: (k, m + 1)."""
        difference = s[:, None] - self.x
        exact = difference == 0.0
        terms = self.barycentric / np.where(exact, 1.0, difference)
        values = terms / terms.sum(axis=1, keepdims=True)
        hit = exact.any(axis=1)
        values[hit] = exact[hit]
        return values


@lru_cache(maxsize=16)
def gauss(m: int) -> Scheme:
    """The scheme with m stages."""
    points, weights = np.polynomial.legendre.leggauss(m)
    c, b = (1.0 + points) / 2.0, weights / 2.0
    x = np.append(0.0, c)
    gaps = x[:, None] - x + np.eye(m + 1)
    barycentric = 1.0 / gaps.prod(axis=1)
    differentiation = (barycentric / barycentric[:, None]) / gaps
    np.fill_diagonal(differentiation, 0.0)
    np.fill_diagonal(differentiation, -differentiation.sum(axis=1))
    slopes = differentiation[1:]
    # A is the inverse of the derivatives' dependence on the inner values.
    A = np.linalg.inv(slopes[:, 1:])
    # For u^(m+1) = 1 the derivative is off by the product of (s - c_i) over m!.
    error = np.polynomial.Polynomial.fromroots(c).integ() / factorial(m)
    constant = float(np.abs(error(np.linspace(0.0, 1.0, 2001))).max())
    return Scheme(c, b, A, x, barycentric, slopes, barycentric * factorial(m), constant)


@dataclass(frozen=True, eq=False)
class Cycle:
    """A discrete cycle: `mesh` (N + 1,) of phases from 0 to 1, `values` (N, m + 1, n), period and parameter.

    The values are those at the left end and at the m Gauss points of each interval; the parameter is the one that
    is free along a family, NaN without one. Differences of cycles on one mesh are kept in the same form.
    """

    mesh: np.ndarray
    values: np.ndarray
    period: float
    parameter: float = float("nan")

    @property
    def widths(self) -> np.ndarray:
        """Interval lengths (N,)."""
        return np.diff(self.mesh)

    @property
    def scheme(self) -> Scheme:
        """The Gauss method whose polynomials these are."""
        return gauss(self.values.shape[1] - 1)

    def at(self, s: np.ndarray) -> np.ndarray:
        """States (k, n) at phases s (k,) in [0, 1]."""
        j = np.clip(np.searchsorted(self.mesh, s, side="right") - 1, 0, len(self.mesh) - 2)
        local = (s - self.mesh[j]) / self.widths[j]
        return np.einsum("ki,kin->kn", self.scheme.basis(local), self.values[j])

    def on(self, mesh: np.ndarray) -> Cycle:
        """The same function on another mesh."""
        places = mesh[:-1, None] + np.diff(mesh)[:, None] * self.scheme.x
        values = self.at(places.ravel()).reshape(*places.shape, self.values.shape[2])
        return Cycle(mesh, values, self.period, self.parameter)

    def moved(self, step: Cycle, share: float = 1.0) -> Cycle:
        """This plus `share` times `step`."""
        return Cycle(
            self.mesh,
            self.values + share * step.values,
            self.period + share * step.period,
            self.parameter + share * step.parameter,
        )

    def times(self, factor: float) -> Cycle:
        """Every number times `factor`; for differences of cycles."""
        return replace(
            self, values=factor * self.values, period=factor * self.period, parameter=factor * self.parameter
        )

    @property
    def slopes(self) -> np.ndarray:
        """du/ds at the Gauss points (N, m, n)."""
        return np.einsum("ik,jkn->jin", self.scheme.slopes, self.values) / self.widths[:, None, None]

    @property
    def amplitudes(self) -> np.ndarray:
        """max - min of each state over the stored values (n,)."""
        return np.ptp(self.values, axis=(0, 1))


@dataclass(frozen=True, eq=False)
class Condition:
    """One linear equation for a step: the integral of <weights, du> + period dT + parameter dlambda = value."""

    weights: np.ndarray
    period: float
    parameter: float
    value: float


class OrbitProblem:
    """The equation of a cycle for one flow: F, its derivatives, and `free`, the parameter that may vary."""

    def __init__(self, flow: Flow, p: np.ndarray, free: sp.Symbol | None = None) -> None:
        self.flow = flow
        self.compiled = compile_flow(flow)
        self.p = p
        self.free = free
        # Where p = (epsilon, *parameters) holds it; epsilon itself may be free.
        self.place = 0 if free is None or free == flow.epsilon else 1 + list(flow.parameters).index(free)
        self.by_parameter: CompiledFunction | None = None
        if free is not None:
            self.by_parameter = compile_function(
                [derivative(rate, free) for rate in flow.rates],
                arguments=flow.states,
                epsilon=flow.epsilon,
                parameters=tuple(flow.parameters),
            )

    @property
    def size(self) -> int:
        """Number of states, n."""
        return len(self.flow.states)

    def constants(self, cycle: Cycle) -> np.ndarray:
        """p = (epsilon, *parameters) at this cycle."""
        p = self.p.copy()
        if self.free is not None:
            p[self.place] = cycle.parameter
        return p

    def rates(self, cycle: Cycle) -> np.ndarray:
        """F at the Gauss points (N, m, n)."""
        inner = cycle.values[:, 1:]
        return self.compiled.rates(inner.reshape(-1, self.size), self.constants(cycle)).reshape(inner.shape)

    def jacobians(self, cycle: Cycle) -> np.ndarray:
        """F_u at the Gauss points (N, m, n, n)."""
        inner = cycle.values[:, 1:]
        J = self.compiled.derivatives(inner.reshape(-1, self.size), self.constants(cycle))
        return J.reshape(*inner.shape, self.size)

    def linearise(self, cycle: Cycle) -> Linearisation:
        """Everything about `cycle` to first order, the inner values eliminated."""
        N, m, n = *cycle.values[:, 1:].shape[:2], self.size
        scheme = cycle.scheme
        h = cycle.widths[:, None, None]
        left, inner = cycle.values[:, 0], cycle.values[:, 1:]
        F, J = self.rates(cycle), self.jacobians(cycle)
        columns = [F]
        if self.by_parameter is not None:
            by = self.by_parameter(inner.reshape(-1, n), self.constants(cycle)).reshape(F.shape)
            columns.append(cycle.period * by)
        # Z_i = z + T h sum_k a_ik F(Z_k), and z_next = z + T h sum_k b_k F(Z_k).
        step = cycle.period * h
        W = -(step[..., None, None] * scheme.A[None, :, None, :, None]) * J.transpose(0, 2, 1, 3)[:, None]
        W = W.reshape(N, m * n, m * n)
        W[:, np.arange(m * n), np.arange(m * n)] += 1.0
        right = np.empty((N, m, n, n + len(columns) + 1))
        right[..., :n] = np.eye(n)
        for k, column in enumerate(columns):
            right[..., n + k] = h * np.einsum("ik,jkn->jin", scheme.A, column)
        right[..., -1] = left[:, None] + step * np.einsum("ik,jkn->jin", scheme.A, F) - inner
        inside = np.linalg.solve(W, right.reshape(N, m * n, -1)).reshape(right.shape)
        across = np.einsum("i,jikl,jilc->jkc", scheme.b, J, inside) * step
        across[:, :, :n] += np.eye(n)
        for k, column in enumerate(columns):
            across[:, :, n + k] += h[:, 0] * np.einsum("k,jkn->jn", scheme.b, column)
        following = np.roll(left, -1, axis=0)
        across[:, :, -1] += left + step[:, 0] * np.einsum("k,jkn->jn", scheme.b, F) - following
        divergence = float(cycle.period * np.einsum("j,i,jikk->", cycle.widths, scheme.b, J))
        return Linearisation(cycle, inside, across, divergence, self.free is not None)

    def residual(self, cycle: Cycle, scales: np.ndarray) -> float:
        """Largest defect of the discrete equations, in units of `scales` (n,)."""
        scheme, step = cycle.scheme, cycle.period * cycle.widths[:, None, None]
        F = self.rates(cycle)
        left = cycle.values[:, :1]
        inner = left + step * np.einsum("ik,jkn->jin", scheme.A, F) - cycle.values[:, 1:]
        ends = left[:, 0] + step[:, 0] * np.einsum("k,jkn->jn", scheme.b, F) - np.roll(left[:, 0], -1, axis=0)
        worst = max(np.abs(inner / scales).max(), np.abs(ends / scales).max())
        return float(worst) if np.isfinite(worst) else float("inf")


@dataclass(frozen=True, eq=False)
class Linearisation:
    """A cycle to first order: `inside` (N, m, n, k) takes (dz_j, dT, dlambda, 1) to the steps of the inner values,
    `across` (N, n, k) to that of the next mesh point. `divergence` is the integral of div F over a period."""

    cycle: Cycle
    inside: np.ndarray
    across: np.ndarray
    divergence: float
    has_parameter: bool

    @property
    def transfers(self) -> np.ndarray:
        """Derivatives (N, n, n) of each mesh point by the one before."""
        return self.across[:, :, : self.across.shape[1]]

    def solve(self, conditions: Sequence[Condition], scales: np.ndarray, directions: np.ndarray) -> list[Cycle]:
        """Steps as differences of cycles: Newton's with the conditions' values, then one for each of `directions`.

        A direction (c,) is a right-hand side of the conditions with no defect elsewhere. There are as many conditions
        as there are free scalars. Raises `numpy.linalg.LinAlgError` when the bordered matrix is singular.
        """
        N, n = len(self.inside), self.inside.shape[2]
        scalars = 2 if self.has_parameter else 1
        size = N * n + scalars
        weight = self.cycle.scheme.b[:, None] * self.cycle.widths[:, None, None]
        # Unknowns are dz in units of `scales`, dT of T and dlambda.
        unit = np.array([self.cycle.period, 1.0][:scalars])
        G = -self.transfers * scales / scales[:, None]
        tails = -self.across[:, :, n : n + scalars] * unit / scales[:, None]
        j, a, b = np.meshgrid(np.arange(N), np.arange(n), np.arange(n), indexing="ij")
        rows = [(j * n + a).ravel(), np.arange(N * n)]
        columns = [(j * n + b).ravel(), (np.arange(N * n) + n) % (N * n)]
        entries = [G.ravel(), np.ones(N * n)]
        j, a, b = np.meshgrid(np.arange(N), np.arange(n), np.arange(scalars), indexing="ij")
        rows.append((j * n + a).ravel())
        columns.append((N * n + b).ravel())
        entries.append(tails.ravel())
        right = np.zeros((size, 1 + len(directions)))
        right[: N * n, 0] = (self.across[:, :, -1] / scales).ravel()
        for c, condition in enumerate(conditions):
            through = np.einsum("jin,jink->jk", weight * condition.weights, self.inside)
            row = np.empty(size)
            row[: N * n] = (through[:, :n] * scales).ravel()
            own = np.array([condition.period, condition.parameter][:scalars])
            row[N * n :] = (through[:, n : n + scalars].sum(axis=0) + own) * unit
            rows.append(np.full(size, N * n + c))
            columns.append(np.arange(size))
            entries.append(row)
            right[N * n + c, 0] = condition.value - through[:, -1].sum()
            right[N * n + c, 1:] = [direction[c] for direction in directions]
        matrix = csc_array(
            (np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=(size, size)
        )
        if not np.isfinite(matrix.data).all() or not np.isfinite(right).all():
            raise np.linalg.LinAlgError("not finite")
        try:
            solution = splu(matrix).solve(right)
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error)) from None
        found = []
        for k in range(right.shape[1]):
            dz = solution[: N * n, k].reshape(N, n) * scales
            tail = solution[N * n :, k] * unit
            factors = np.hstack([dz, np.broadcast_to(tail, (N, scalars)), np.full((N, 1), float(k == 0))])
            inner = np.einsum("jink,jk->jin", self.inside, factors)
            parameter = float(tail[1]) if scalars == 2 else 0.0
            found.append(
                Cycle(self.cycle.mesh, np.concatenate([dz[:, None], inner], axis=1), float(tail[0]), parameter)
            )
        return found


def phase_condition(cycle: Cycle, reference: Cycle, scales: np.ndarray) -> Condition:
    """The integral of <u - reference, reference'> = 0 in units of `scales`, for a step from `cycle`."""
    weights = reference.slopes / scales**2
    # Of order one, so that the border is as large as the rest of the matrix.
    weight = cycle.scheme.b[:, None] * cycle.widths[:, None, None]
    norm = float(np.sqrt(np.sum(weight * (weights * scales) ** 2)))
    weights = weights / norm
    value = -float(np.sum(weight * weights * (cycle.values[:, 1:] - reference.values[:, 1:])))
    return Condition(weights, 0.0, 0.0, value)
