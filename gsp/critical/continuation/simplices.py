"""Simplicial continuation of a surface {F(u) = 0}, F: R^(n+2) -> R^n, through the cubes of a grid.

Every cube is cut into d! simplices, d = n + 2, by Kuhn's triangulation, which fits from cube to cube. The surface
crosses a simplex in a polygon, whose corners lie on n-faces and whose sides lie in (n+1)-faces; both are found
from F at the nodes alone, and the cubes are followed from neighbour to neighbour (Allgower and Georg 1990, 12).
Faces of the grid's boundary lie in it, so that the surface ends exactly on the bounds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations, permutations

import numpy as np

# Cubes at one end of an axis are longer than those at the other by twice this share; no pedigree.
WARP = 0.0437


@dataclass(frozen=True)
class Kuhn:
    """Kuhn's triangulation of the d-cube, corners as bit masks: d = n + 2.

    `faces` (F, n+1) are the corners of the n-faces, `facets` (Q, n+2) the n-faces of each (n+1)-face, `simplices`
    (S, d+1) the (n+1)-faces of each simplex, `members` (S, M) its n-faces. `kinds` (F,) numbers the faces that
    differ by a translation alike, and `lowest` (F, d) is their lowest corner.
    """

    corners: np.ndarray
    faces: np.ndarray
    facets: np.ndarray
    simplices: np.ndarray
    members: np.ndarray
    kinds: np.ndarray
    lowest: np.ndarray


@lru_cache(maxsize=8)
def kuhn(n: int) -> Kuhn:
    """The tables for n equations in n + 2 unknowns."""
    d = n + 2
    maximal = []
    for order in permutations(range(d)):
        chain = [0]
        for axis in order:
            chain.append(chain[-1] | 1 << axis)
        maximal.append(tuple(chain))
    faces = sorted({face for chain in maximal for face in combinations(chain, n + 1)})
    facets = sorted({face for chain in maximal for face in combinations(chain, n + 2)})
    place = {face: i for i, face in enumerate(faces)}
    facet_place = {face: i for i, face in enumerate(facets)}
    shapes: dict[tuple[int, ...], int] = {}
    kinds = [shapes.setdefault(tuple(c ^ face[0] for c in face), len(shapes)) for face in faces]
    corners = (np.arange(2**d)[:, None] >> np.arange(d)) & 1
    return Kuhn(
        corners=corners,
        faces=np.array(faces),
        facets=np.array([[place[face] for face in combinations(facet, n + 1)] for facet in facets]),
        simplices=np.array([[facet_place[f] for f in combinations(chain, n + 2)] for chain in maximal]),
        members=np.array([[place[f] for f in combinations(chain, n + 1)] for chain in maximal]),
        kinds=np.array(kinds),
        lowest=corners[[face[0] for face in faces]],
    )


@dataclass(frozen=True)
class Grid:
    """Cubes of about the given `size` (d,) from `origin`, `counts` (d,) of them along each axis; -1 for no end."""

    origin: np.ndarray
    size: np.ndarray
    counts: np.ndarray

    def nodes(self, index: np.ndarray) -> np.ndarray:
        """Points (..., d) of nodes by index; the first and last node of an axis are on its bounds.

        Between bounds the nodes are not evenly spaced, lest a plane of symmetry of the surface be one of nodes.
        """
        share = index / np.where(self.counts > 0, self.counts, 1)
        warped = np.where(self.counts > 0, share * (1.0 + WARP * (1.0 - share)) * self.counts, index)
        return self.origin + self.size * warped

    def cell(self, point: np.ndarray) -> np.ndarray:
        """Index (d,) of the cube that holds a point."""
        share = (point - self.origin) / (self.size * np.where(self.counts > 0, self.counts, 1))
        root = np.sqrt(np.maximum((1.0 + WARP) ** 2 - 4.0 * WARP * share, 0.0))
        index = np.where(self.counts > 0, self.counts * 2.0 * share / (1.0 + WARP + root), share)
        return np.floor(index).astype(np.int64)

    def inside(self, cells: np.ndarray) -> np.ndarray:
        """Which cells (m, d) belong to the grid."""
        bounded = self.counts >= 0
        return np.all(~bounded | ((cells >= 0) & (cells < self.counts)), axis=1)


@dataclass(frozen=True)
class Mesh:
    """The crossing: for each vertex the `nodes` (m, n+1, d) of its face by index and their `weights` (m, n+1).

    `triangles` (k, 3) are rows of these; `cells` cubes are crossed, `skipped` ones are not finite.
    """

    nodes: np.ndarray
    weights: np.ndarray
    triangles: np.ndarray
    cells: int
    skipped: int
    complete: bool


def march(
    function: Callable[[np.ndarray], np.ndarray],
    grid: Grid,
    start: np.ndarray,
    *,
    n: int,
    most: int,
    progress: Callable[[float], None] | None = None,
) -> Mesh:
    """The connected piece of {function = 0} through the cubes next to `start` (d,), at most `most` cubes of it.

    `function` takes points (m, d) to values (m, n).
    """
    table, d = kuhn(n), n + 2
    around = np.array(np.meshgrid(*[(-1, 0, 1)] * d, indexing="ij")).reshape(d, -1).T
    frontier = grid.cell(start) + around
    frontier = frontier[grid.inside(frontier)]
    seen = set(map(tuple, frontier.tolist()))
    # Numbers in the largest array of one batch.
    batch = max(1, 2_000_000 // (len(table.faces) * (n + 1) * n))
    cells, crossed, weights, skipped, complete = [], [], [], 0, True
    total = 0
    while len(frontier):
        now, frontier = frontier[:batch], frontier[batch:]
        active, share, bad = _crossings(function, grid, now, table, n)
        skipped += bad
        used = active.any(axis=1)
        cells.append(now[used])
        crossed.append(active[used])
        weights.append(share[used])
        total += int(used.sum())
        if progress is not None:
            progress(min(1.0, total / most))
        if total >= most:
            complete = False
            break
        fresh = []
        for axis in range(d):
            bits = table.corners[table.faces][:, :, axis]
            for side, step in ((0, -1), (1, 1)):
                touching = (bits == side).all(axis=1)
                over = now[active[:, touching].any(axis=1)].copy()
                over[:, axis] += step
                fresh += [c for c in map(tuple, over[grid.inside(over)].tolist()) if c not in seen]
                seen.update(fresh)
        if fresh:
            frontier = np.vstack([frontier, np.array(sorted(set(fresh)))])
    return _assembled(table, np.vstack(cells), np.vstack(crossed), np.vstack(weights), skipped, complete)


def _crossings(
    function, grid: Grid, cells: np.ndarray, table: Kuhn, n: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Which faces of the cells are crossed (m, F), with weights (m, F, n+1), and how many cells are not finite."""
    points = grid.nodes(cells[:, None, :] + table.corners[None, :, :])
    values = function(points.reshape(-1, points.shape[-1])).reshape(*points.shape[:2], n)
    finite = np.isfinite(values).all(axis=(1, 2))
    values = np.where(finite[:, None, None], values, 1.0)
    # As a rule: beside a pole the largest would shift the surface by more than a cube.
    sizes = np.abs(values[finite]).reshape(-1, n) if finite.any() else np.ones((1, n))
    usual = np.median(sizes, axis=0)
    size = np.where(usual > 0.0, usual, sizes.max(axis=0))
    # The surface is shifted by this share of |F|, differently in each component, off nodes that it passes exactly.
    values = values - 1e-9 * size * np.sqrt(np.arange(2, n + 2))
    # A face is crossed only where every component has both signs at its corners: one in hundreds for four of them.
    signs = ((values > 0.0) << np.arange(n)).sum(axis=2).astype(np.uint8)[:, table.faces]
    both = np.bitwise_or.reduce(signs, axis=2) & ~np.bitwise_and.reduce(signs, axis=2)
    cell, face = np.nonzero((both == 2**n - 1) & finite[:, None])
    on_faces = values[cell[:, None], table.faces[face]]
    # Cramer's rule for sum w = 1, sum w F = 0.
    minors = np.stack([(-1) ** i * np.linalg.det(np.delete(on_faces, i, axis=1)) for i in range(n + 1)], axis=1)
    crossed = (minors > 0.0).all(axis=1) | (minors < 0.0).all(axis=1)
    cell, face, minors = cell[crossed], face[crossed], minors[crossed]
    active = np.zeros((len(cells), len(table.faces)), dtype=bool)
    weights = np.zeros((*active.shape, n + 1))
    active[cell, face] = True
    weights[cell, face] = minors / minors.sum(axis=1, keepdims=True)
    return active, weights, int((~finite).sum())


def _assembled(
    table: Kuhn,
    cells: np.ndarray,
    crossed: np.ndarray,
    weights: np.ndarray,
    skipped: int,
    complete: bool,
) -> Mesh:
    cell, face = np.nonzero(crossed)
    keys = np.column_stack([cells[cell] + table.lowest[face], table.kinds[face]])
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    number = np.full(crossed.shape, -1)
    number[cell, face] = inverse.ravel()
    nodes = cells[cell[first], None, :] + table.corners[table.faces[face[first]]]
    triangles = []
    on_facets = crossed[:, table.facets]
    pairs = on_facets.sum(axis=2) == 2
    low = on_facets.argmax(axis=2)
    high = on_facets.shape[2] - 1 - on_facets[:, :, ::-1].argmax(axis=2)
    everything = np.arange(len(table.facets))
    ends = np.stack([table.facets[everything, low], table.facets[everything, high]], axis=2)
    for facets, members in zip(table.simplices, table.members):
        inside = crossed[:, members]
        pivot = members[inside.argmax(axis=1)]
        for facet in facets:
            a, b = ends[:, facet, 0], ends[:, facet, 1]
            # A polygon is fanned out from its first corner; its sides need no order for that.
            rows = np.flatnonzero(pairs[:, facet] & (a != pivot) & (b != pivot))
            triangles.append(
                np.column_stack([number[rows, pivot[rows]], number[rows, a[rows]], number[rows, b[rows]]])
            )
    return Mesh(
        nodes, weights[cell[first], face[first]], np.vstack(triangles), len(cells), skipped, complete
    )  # fmt: skip
