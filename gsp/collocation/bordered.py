"""Orbits by Gauss collocation to first order, bordered by conditions: Newton's steps and tangents of families.

One system serves orbits with any conditions: closed ones, segments between two surfaces, segments held in their
middle. Their conditions are rows of `Conditions`, as many as there are states and free parameters.

An orbit z(sigma), 0 <= sigma <= 1, of z' = q_0 F(z; q_1) has elements between the points sigma_0 = 0, ..., sigma_N = 1
and on each the stages Z_j = z_i + h sum_k A_jk F(Z_k), h = q_0 (sigma_(i+1) - sigma_i), with
z_(i+1) = z_i + h sum_k b_k F(Z_k) (Ascher, Mattheij and Russell 1995, section 5.4). The free parameters q are none, the
length of time q_0, or that and one which the field depends on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.collocation.gauss import Scheme
from gsp.kernels.bordered_collocation import eliminate, substitute
from gsp.kernels.evaluate import evaluate_many


@dataclass(frozen=True, eq=False)
class Equations:
    """z' = F(z; p) by machine code: addresses of F, of its Jacobian, and of dF/dq_1 (0 when q_1 is not free).

    `free` is the number of free parameters: 0, 1 (the time) or 2 (the time and one that F depends on).
    """

    field: int
    jacobian: int
    sensitivity: int
    free: int


@dataclass(frozen=True, eq=False)
class Step:
    """A change of an orbit: of its states (N + 1, n), its stages (N, s, n) and its free parameters."""

    states: np.ndarray
    stages: np.ndarray
    parameters: np.ndarray

    def times(self, factor: float) -> Step:
        """The step, longer or turned round."""
        return Step(factor * self.states, factor * self.stages, factor * self.parameters)


@dataclass(frozen=True, eq=False)
class Conditions:
    """Linearised conditions on an orbit: `left` dz_0 + `right` dz_N + `across` dq = `wanted`, row by row.

    The last rows also count `inner` (k, N + 1, n) at the ends of the elements in between, or `inside` (k, N, s, n) at
    the stages, when these are given.
    """

    left: np.ndarray
    right: np.ndarray
    across: np.ndarray
    wanted: np.ndarray
    inner: np.ndarray | None = None
    inside: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Linearisation:
    """An orbit to first order: `columns` (N, n + free + 1, s n) takes (dz_j, dq, 1) to the steps of the stages,
    `relations` (N, n, n + free + 1) to that of the next mesh point."""

    columns: np.ndarray
    relations: np.ndarray

    @property
    def transfers(self) -> np.ndarray:
        """Derivatives (N, n, n) of each mesh point by the one before."""
        return self.relations[:, :, : self.relations.shape[1]]

    def solve(
        self, conditions: Conditions, *, tangents: np.ndarray | None = None, units: np.ndarray | None = None
    ) -> list[Step]:
        """Newton's step, with the conditions' values, and one step for each column of `tangents` (rows, k).

        A column of `tangents` is a right-hand side of the conditions with no defect elsewhere. `units` (n + free,) are
        those of the states and of the free parameters, in which rows are exchanged. Raises `numpy.linalg.LinAlgError`
        when the bordered matrix is singular.
        """
        N, n, width = self.relations.shape
        free = width - n - 1
        stages = self.columns.shape[2] // n
        cases = 1 if tangents is None else 1 + tangents.shape[1]
        wanted = np.empty((n + free, cases))
        wanted[:, 0], shares = conditions.wanted, np.zeros(cases)
        shares[0] = 1.0
        if tangents is not None:
            wanted[:, 1:] = tangents
        left, right, across = (
            np.array(part) for part in (conditions.left, conditions.right, conditions.across)
        )
        inner = np.empty((0, N + 1, n)) if conditions.inner is None else conditions.inner
        if conditions.inside is not None:
            # Weights at the stages, through what these change by.
            k = len(conditions.inside)
            through = np.einsum("bjr,jcr->bjc", conditions.inside.reshape(k, N, stages * n), self.columns)
            inner = np.concatenate([through[:, :, :n], np.zeros((k, 1, n))], axis=1)
            across[-k:] += through[:, :, n : n + free].sum(axis=1)
            wanted[-k:, 0] -= through[:, :, -1].sum(axis=1)
        if len(inner):
            left[-len(inner) :] += inner[:, 0]
            if N:
                right[-len(inner) :] += inner[:, -1]
        relations, columns = self.relations, self.columns
        if units is not None:
            each = np.append(units, 1.0)
            relations, columns = relations * each / units[:n, None], columns * each[:, None]
            left, right, across, inner = (
                left * units[:n],
                right * units[:n],
                across * units[n:],
                inner * units[:n],
            )
        dz, dq = _border(relations, np.hstack([left, right, across]), inner, wanted, shares)
        known = np.concatenate(
            [
                dz[:, :-1],
                np.broadcast_to(dq[:, None], (cases, N, free)),
                np.broadcast_to(shares[:, None, None], (cases, N, 1)),
            ],
            axis=2,
        )
        dstages = np.einsum("cew,ewr->cer", known, columns).reshape(cases, N, stages, n)
        if units is not None:
            dz, dq = dz * units[:n], dq * units[n:]
        return [Step(*step) for step in zip(dz, dstages, dq)]


def linearise(
    equations: Equations,
    scheme: Scheme,
    p: np.ndarray,
    time: float,
    widths: np.ndarray,
    states: np.ndarray,
    stages: np.ndarray,
) -> Linearisation:
    """The orbit with `states` (N + 1, n) and `stages` (N, s, n), whose elements take `widths` (N,) times `time`.

    Raises `numpy.linalg.LinAlgError` when the stages of an element cannot be eliminated.
    """
    N, s, n = stages.shape
    free = equations.free
    rate, slopes, drift = (
        _at_stages(address, stages, p, outputs)
        for address, outputs in (
            (equations.field, n),
            (equations.jacobian, n * n),
            (equations.sensitivity if free > 1 else 0, n),
        )
    )
    h = time * widths
    A, b = h[:, None, None] * scheme.A, h[:, None] * scheme.b
    slopes = slopes.reshape(N, s, n, n)
    matrix = np.eye(s * n) - np.einsum("ejk,ekic->ejikc", A, slopes).reshape(N, s * n, s * n)
    # Columns over (dz_i, dq, 1), of the stages and of the end.
    starts = np.broadcast_to(np.tile(np.eye(n), (s, 1)), (N, s * n, n))
    along = (widths[:, None, None] * (scheme.A @ rate), A @ drift)[:free]
    defects = states[:-1, None] - stages + A @ rate
    wanted = np.concatenate([starts, *(part.reshape(N, s * n, 1) for part in (*along, defects))], axis=2)
    # Raises numpy's own error where a matrix is singular.
    columns = np.linalg.solve(matrix, wanted)
    if not np.isfinite(columns).all():
        raise np.linalg.LinAlgError("singular")
    relations = np.einsum("ek,ekiq->eikq", b, slopes).reshape(N, n, s * n) @ columns
    relations[:, :, :n] += np.eye(n)
    if free > 0:
        relations[:, :, n] += widths[:, None] * (scheme.b @ rate)
    if free > 1:
        relations[:, :, n + 1] += np.einsum("ek,eki->ei", b, drift)
    relations[:, :, -1] += states[:-1] - states[1:] + np.einsum("ek,eki->ei", b, rate)
    return Linearisation(columns.transpose(0, 2, 1), relations)


def _at_stages(address: int, stages: np.ndarray, p: np.ndarray, outputs: int) -> np.ndarray:
    """Values (N, s, outputs) of the machine code at `address`; zeros where that is 0."""
    N, s, n = stages.shape
    values = np.zeros((N * s, outputs))
    if address and values.size:
        evaluate_many(address, np.array(stages, order="C").reshape(N * s, n), p, values)
    return values.reshape(N, s, outputs)


def _border(
    relations: np.ndarray, conditions: np.ndarray, inner: np.ndarray, wanted: np.ndarray, shares: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """dz (R, N + 1, n) and dq (R, free) from the relations (N, n, n + free + 1) and the `conditions`, a matrix
    (n + free, 2n + free) over (dz_0, dz_N, dq), for every column of `wanted` (n + free, R).

    The defects of the orbit count shares[c] times in column c: 1 in Newton's method, 0 for a tangent. `inner`
    (k, N + 1, n) belongs to the last k conditions. Raises `numpy.linalg.LinAlgError` when the system is singular.
    """
    N, n, width = relations.shape
    free, cases, inners = width - n - 1, wanted.shape[1], len(inner)
    rows = np.zeros((N, n, 3 * n + free + 1))
    rows[:, :, n : 2 * n] = -relations[:, :, :n]
    rows[:, :, 2 * n : 3 * n] = np.eye(n)
    rows[:, :, 3 * n : -1] = -relations[:, :, n:-1]
    rows[:, :, -1] = relations[:, :, -1]
    pair = np.zeros((2 * n, rows.shape[2]))
    if N:
        # The first relation begins at dz_0.
        pair[:n, : 2 * n], pair[:n, 3 * n :] = rows[0, :, n : 3 * n], rows[0, :, 3 * n :]
    else:
        # A segment without elements ends where it begins.
        pair[:n, : 2 * n] = np.hstack([-np.eye(n), np.eye(n)])
    spread, kept = np.zeros((inners, rows.shape[2])), np.zeros_like(rows)
    if not eliminate(rows, np.ascontiguousarray(inner), pair, spread, kept):
        raise np.linalg.LinAlgError("singular")
    ends = [*range(2 * n), *range(3 * n, 3 * n + free)]
    final = np.concatenate([pair[:n, ends], conditions])
    unknown = np.concatenate([pair[:n, -1:] * shares, wanted])
    if inners:
        final[-inners:] += spread[:, ends]
        unknown[-inners:] += spread[:, -1:] * shares
    largest = np.abs(final).max(axis=1, keepdims=True)
    if not (largest > 0.0).all():
        raise np.linalg.LinAlgError("singular")
    unknown = np.linalg.solve(final / largest, unknown / largest).T
    dz, dq = np.empty((cases, N + 1, n)), np.ascontiguousarray(unknown[:, 2 * n :])
    # In this order: a segment without elements has one point, its end.
    dz[:, 0], dz[:, N] = unknown[:, :n], unknown[:, n : 2 * n]
    substitute(kept, shares, dz, dq)
    if not (np.isfinite(dz).all() and np.isfinite(dq).all()):
        raise np.linalg.LinAlgError("singular")
    return dz, dq
