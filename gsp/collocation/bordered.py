"""Orbits by Gauss collocation to first order, bordered by conditions: Newton's steps and tangents of families.

One system serves orbits with any conditions: closed ones, segments between two surfaces, segments held in their
middle. Their conditions are rows of `Conditions`, as many as there are states and free parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.collocation.gauss import Scheme
from gsp.kernels.bordered_collocation import border, condense


@dataclass(frozen=True, eq=False)
class FlowEquations:
    """z' = F(z; p) by machine code: addresses of F, of its Jacobian, and of dF/dq_1 (0 when q_1 is not free).

    `free` is the number of free parameters: 0, 1 (the time) or 2 (the time and one that F depends on).
    """

    field: int
    jacobian: int
    sensitivity: int
    free: int


@dataclass(frozen=True, eq=False)
class OrbitChange:
    """A change of an orbit: of its states (N + 1, n), its stages (N, s, n) and its free parameters."""

    states: np.ndarray
    stages: np.ndarray
    parameters: np.ndarray

    def times(self, factor: float) -> OrbitChange:
        """The step, longer or turned round."""
        return OrbitChange(factor * self.states, factor * self.stages, factor * self.parameters)


@dataclass(frozen=True, eq=False)
class Conditions:
    """Linearised conditions on an orbit: `left` dz_0 + `right` dz_N + `across` dq = `target`, row by row.

    The last rows also count `inner` (k, N + 1, n) at the ends of the elements in between, or `inside` (k, N, s, n) at
    the stages, when these are given.
    """

    left: np.ndarray
    right: np.ndarray
    across: np.ndarray
    target: np.ndarray
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
    ) -> list[OrbitChange]:
        """Newton's step, with the conditions' values, and one step for each column of `tangents` (rows, k).

        A column of `tangents` is a right-hand side of the conditions with no defect elsewhere. `units` (n + free,) are
        those of the states and of the free parameters, in which rows are exchanged. Raises `numpy.linalg.LinAlgError`
        when the bordered matrix is singular.
        """
        N, n, width = self.relations.shape
        free = width - n - 1
        stages = self.columns.shape[2] // n
        cases = 1 if tangents is None else 1 + tangents.shape[1]
        target = np.empty((n + free, cases))
        target[:, 0], shares = conditions.target, np.zeros(cases)
        shares[0] = 1.0
        if tangents is not None:
            target[:, 1:] = tangents
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
            target[-k:, 0] -= through[:, :, -1].sum(axis=1)
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
        dz, dq = np.empty((cases, N + 1, n)), np.empty((cases, free))
        dstages = np.empty((cases, N, stages, n))
        rows = tuple(map(np.ascontiguousarray, (left, right, across, inner, target)))
        relations, columns = np.ascontiguousarray(relations), np.ascontiguousarray(columns)
        if not border(relations, columns, rows, shares, (dz, dstages, dq)) or not (
            np.isfinite(dz).all() and np.isfinite(dq).all()
        ):
            raise np.linalg.LinAlgError("singular")
        if units is not None:
            dz, dq = dz * units[:n], dq * units[n:]
        return [OrbitChange(*step) for step in zip(dz, dstages, dq)]


def linearise(
    equations: FlowEquations,
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
    width = n + equations.free + 1
    columns, relations = np.empty((N, width, s * n)), np.empty((N, n, width))
    orbit = tuple(map(np.ascontiguousarray, (widths, states, stages)))
    rule = tuple(map(np.ascontiguousarray, (scheme.A, scheme.b)))
    functions = (equations.field, equations.jacobian, equations.sensitivity)
    if not condense(functions, p, time, orbit, rule, equations.free, columns, relations):
        raise np.linalg.LinAlgError("singular")
    return Linearisation(columns, relations)
