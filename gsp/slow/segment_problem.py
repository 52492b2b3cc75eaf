"""Segments of the full flow as boundary-value problems: their arrays, and what fixes each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.collocation.bordered import Conditions, OrbitChange

Point = tuple[np.ndarray, np.ndarray]


def step_length(steps: list[OrbitChange], point: Point) -> float:
    """Largest change of a state, relative to 1 + |z|."""
    return float((np.abs(steps[0].states) / (1.0 + np.abs(point[0]).sum(axis=1))[:, None]).max())


@dataclass(frozen=True, eq=False)
class Held:
    """What fixes a segment: left y = at_left where it begins, x at its `middle`, right y = at_right where it ends."""

    x: np.ndarray
    middle: int
    left: np.ndarray
    at_left: np.ndarray
    right: np.ndarray
    at_right: np.ndarray

    def conditions(self, z: np.ndarray) -> Conditions:
        """As conditions of a step from the states z (m + 1, n): at the left, at the right, in the middle."""
        nx, n = len(self.x), z.shape[1]
        a, b = len(self.left), len(self.right)
        left, right, inner = np.zeros((n, n)), np.zeros((n, n)), np.zeros((nx, len(z), n))
        left[:a, nx:], right[a : a + b, nx:] = self.left, self.right
        inner[:, self.middle, :nx] = np.eye(nx)
        target = np.concatenate([
            self.at_left[:a] - self.left @ z[0, nx:], self.at_right[:b] - self.right @ z[-1, nx:],
            self.x - z[self.middle, :nx],
        ])  # fmt: skip
        return Conditions(left, right, np.zeros((n, 0)), target, inner)


class SegmentProblem:
    """The arrays of k segments that one attempt works on."""

    def __init__(self, *, x, lengths, counts, middles, z, stages, bases) -> None:
        fast = bases[0].shape[1]
        self.x, self.lengths, self.counts, self.middles = x, lengths, counts, middles
        self.z, self.stages, self.bases = z, stages, bases
        self.response = np.zeros((len(x), fast, fast))
        self.moved = np.zeros((len(x), 2))

    def halved(self, rows: np.ndarray, matrix: np.ndarray) -> SegmentProblem:
        """Some of the segments with every element cut in two, by `matrix` (2 s + 1, s + 1)."""
        z, stages = self.z[rows], self.stages[rows]
        k, m, s, n = stages.shape
        inside = np.einsum("ij,kmjn->kmin", matrix, np.concatenate([z[:, :-1, None], stages], axis=2))
        new_z = np.empty((k, 2 * m + 1, n))
        new_z[:, ::2] = z
        new_z[:, 1::2] = inside[:, :, s]
        new_stages = np.stack([inside[:, :, :s], inside[:, :, s + 1 :]], axis=2).reshape(k, 2 * m, s, n)
        return SegmentProblem(
            x=self.x[rows],
            lengths=np.repeat(0.5 * self.lengths[rows], 2, axis=1),
            counts=2 * self.counts[rows],
            middles=2 * self.middles[rows],
            z=new_z,
            stages=np.ascontiguousarray(new_stages),
            bases=tuple(basis[rows] for basis in self.bases),
        )
