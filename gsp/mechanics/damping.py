"""The damping matrix B of a Rayleigh function |A qdot|^2_B/(2 epsilon), and the checks that make it one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.mechanics.algebra import numbers
from gsp.mechanics.hamel import HamelEquations
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.systems.region import Interval
from gsp.systems.scattered_points import PLACES

Damping = sp.Expr | float | sp.MatrixBase | Sequence[Sequence[sp.Expr | float]] | str

# The damping that the kinetic metric gives.
KINETIC = "kinetic"


def read_damping(system: LagrangianSystem, damping: Any, count: int) -> sp.ImmutableMatrix:
    """B (count, count): the identity for None, a multiple of it for a scalar.

    Raises `DeclarationError` when B has another size, is not symmetric, depends on velocities or time, or is
    not positive definite: by signs of symbols where they decide it, and at the parameters' values. Where it depends on
    positions, `check_damping_over` tells for the positions of a scene.
    """
    given: Any
    if isinstance(damping, str):
        raise DeclarationError(
            f'damping is a number, a square matrix, or "{KINETIC}".', got=f"{damping!r}", value=damping
        )
    if damping is None:
        return sp.ImmutableMatrix(sp.eye(count))
    if isinstance(damping, (sp.MatrixBase, list, tuple)):
        rows = (
            damping.tolist()
            if isinstance(damping, sp.MatrixBase)
            else [list(_row(row, damping)) for row in damping]
        )
        if len({len(row) for row in rows}) != 1:
            raise DeclarationError("damping is a number or a square matrix.", got=f"{damping!r}", value=damping)
        # Checked before they meet a matrix, which would read text as code.
        given = sp.ImmutableMatrix(
            [[system.checked(e, "an entry of the damping") for e in row] for row in rows]
        )
        if given.shape != (count, count):
            raise DeclarationError(
                f"damping has the shape {given.shape} for {count} constraints.",
                f"Give ({count}, {count}), or a number.",
            )
    else:
        given = sp.ImmutableMatrix(sp.eye(count)) * system.checked(damping, "the damping")
    moving = [s for s in (*system.velocities, *system.clock) if given.has(s)]
    if moving:
        raise DeclarationError(
            f"damping depends on {moving[0]}: {given.tolist()}.",
            "Friction that is not linear in the slip velocity, or changes with time, is not covered; B is a "
            "matrix of parameters and positions.",
        )
    for i in range(count):
        for j in range(i):
            if sp.cancel(given[i, j] - given[j, i]) != 0:
                raise DeclarationError(
                    f"damping is not symmetric: entry ({i + 1}, {j + 1}) is {given[i, j]}, ({j + 1}, {i + 1}"
                    f") is {given[j, i]}.",
                    "Only a symmetric B is a Rayleigh function.",
                )
    for i, minor in enumerate(_minors(given)):
        fixed = not minor.has(*system.coordinates)
        low = float(numbers([minor], (), np.zeros((1, 0)), system.values).item()) if fixed else np.nan
        if sp.cancel(minor).is_nonpositive or (fixed and not low > 0):
            said = f"takes the value {low:.6g} at the parameters' values" if fixed else "is nowhere positive"
            raise DeclarationError(
                f"damping is not positive definite: its leading minor of size {i + 1}, {minor}, {said}.",
                "Friction must take energy from every slip.",
            )
    return given


def kinetic_damping(equations: HamelEquations) -> sp.ImmutableMatrix:
    """B = (A M^-1 A^T)^-1 (k, k), the kinetic metric across the constraints: footnote 3 of Eldering (2015)."""
    algebra = equations.algebra
    return sp.ImmutableMatrix(
        [[algebra.write(e) for e in row] for row in algebra.inverse(equations.schur_inverse)]
    )


def check_damping_over(
    system: LagrangianSystem, damping: sp.MatrixBase, region: Mapping[str, Interval], start: Mapping[str, float]
) -> None:
    """Raise `DeclarationError` where B is not positive definite at a sample of a region's positions.

    A position that `region` does not bound is held at its `start`.
    """
    moving = [q for q in system.coordinates if damping.has(q)]
    if not moving:
        return
    ends = np.array([region.get(q.name, (start[q.name],) * 2) for q in moving], dtype=float)
    corners = np.stack(np.meshgrid(*ends, indexing="ij"), axis=-1).reshape(-1, len(moving))
    inner = ends[:, 0] + np.random.default_rng(20).uniform(size=(PLACES, len(moving))) * (
        ends[:, 1] - ends[:, 0]
    )
    points = np.vstack([corners, inner])
    minors = _minors(damping)
    values = numbers(minors, moving, points, system.values)
    for i, minor in enumerate(minors):
        wrong = np.flatnonzero(~(values[:, i] > 0))
        if wrong.size:
            place = ", ".join(f"{q} = {value:.6g}" for q, value in zip(moving, points[wrong[0]]))
            raise DeclarationError(
                f"damping is not positive definite in the region: its leading minor of size {i + 1}, {minor}, "
                f"takes the value {values[wrong[0], i]:.6g} at {place}.",
                "Friction must take energy from every slip: take a region in which it does.",
            )


def _minors(matrix: sp.MatrixBase) -> list[Any]:
    return [matrix[: i + 1, : i + 1].det(method="berkowitz") for i in range(matrix.shape[0])]


def _row(row: Any, damping: Any) -> Sequence:
    if isinstance(row, (list, tuple)):
        return row
    raise DeclarationError("damping is a number or a square matrix.", got=f"{damping!r}", value=damping)
