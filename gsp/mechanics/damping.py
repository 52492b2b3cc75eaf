"""The damping matrix B of a Rayleigh function |A qdot|^2_B/(2 epsilon), and the checks that make it one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import sympy as sp

from gsp.errors import DeclarationError
from gsp.mechanics.algebra import generic_points, numbers
from gsp.mechanics.lagrangian import LagrangianSystem

Damping = sp.Expr | float | sp.MatrixBase | Sequence[Sequence[sp.Expr | float]]

# Places at which a damping that depends on positions is tried.
PLACES = 64


def read_damping(system: LagrangianSystem, damping: Any, count: int) -> sp.ImmutableMatrix:
    """B (count, count): the identity for None, a multiple of it for a scalar.

    Raises `DeclarationError` when B has another size, is not symmetric, depends on velocities or time, or is
    not positive definite: by signs of symbols where they decide it, and at the parameters' values.
    """
    given: Any
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
    minors = [given[: i + 1, : i + 1].det(method="berkowitz") for i in range(count)]
    points = generic_points(PLACES, len(system.coordinates)) * 6 - 4
    values = numbers(minors, system.coordinates, points, system.values)
    for i, minor in enumerate(minors):
        column = values[:, i]
        refuted = sp.cancel(minor).is_nonpositive or not (column > 0).all()
        if refuted:
            low = f"{column.min():.6g}"
            raise DeclarationError(
                f"damping is not positive definite: its leading minor of size {i + 1}, {minor}, takes the "
                f"value {low} at the parameters' values.",
                "Friction must take energy from every slip.",
            )
    return given


def _row(row: Any, damping: Any) -> Sequence:
    if isinstance(row, (list, tuple)):
        return row
    raise DeclarationError("damping is a number or a square matrix.", got=f"{damping!r}", value=damping)
