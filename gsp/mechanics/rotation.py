"""The rotations of a body as coordinates of mechanics, by unit quaternions: nowhere singular, unlike angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp

from gsp.errors import DeclarationError


@dataclass(frozen=True)
class Rotation:
    """The four coordinates of a rotation, their velocities, and what follows from them.

    `holonomic` is zero on rotations, |q|^2 - 1: it belongs among the holonomic constraints of a `LagrangianSystem`.
    `matrix` (3, 3) carries the body's axes into space. `body` and `space` are the angular velocity along the axes of
    the body and of space, linear in `velocities`.
    """

    coordinates: tuple[sp.Symbol, ...]
    velocities: tuple[sp.Symbol, ...]
    holonomic: sp.Expr
    matrix: sp.ImmutableMatrix
    body: tuple[sp.Expr, ...]
    space: tuple[sp.Expr, ...]

    def about(self, axis: Sequence[float], angle: float) -> dict[str, float]:
        """Values of the coordinates, by name, for the rotation by `angle` radians about `axis`.

        Raises `DeclarationError` for an axis that is no direction.

        >>> rotation("q").about((0, 0, 1), 0.0)
        {'q0': 1.0, 'q1': 0.0, 'q2': 0.0, 'q3': 0.0}
        """
        length = math.hypot(*axis)
        if len(axis) != 3 or not 0 < length < math.inf or not math.isfinite(angle):
            raise DeclarationError(
                "a rotation is given by an axis of three numbers, not all zero, and an angle.",
                got=f"axis {tuple(axis)}, angle {angle}",
            )
        values = (math.cos(angle / 2), *(math.sin(angle / 2) * a / length for a in axis))
        return {q.name: value for q, value in zip(self.coordinates, values)}


def rotation(name: str) -> Rotation:
    """A `Rotation` with the coordinates NAME0 to NAME3 and the velocities NAME0dot to NAME3dot.

    With q = q0 + q1 i + q2 j + q3 k a vector v of the body is q v q^-1 in space, and the angular velocity is
    2 qdot q^-1 in space, 2 q^-1 qdot in the body.

    >>> turn = rotation("q")
    >>> turn.matrix[2, 2]
    q0**2 - q1**2 - q2**2 + q3**2
    """
    if not isinstance(name, str) or not name.isidentifier():
        raise DeclarationError("a rotation has a name, as q.", got=f"{name!r}", value=name)
    q = tuple(sp.Symbol(f"{name}{i}") for i in range(4))
    rates = tuple(sp.Symbol(f"{name}{i}dot") for i in range(4))
    conjugate = (q[0], *(-c for c in q[1:]))
    length = sp.Add(*[c**2 for c in q])
    images = [_product(_product(q, (0, *(int(i == j) for i in range(3)))), conjugate)[1:] for j in range(3)]
    # Divided by |q|^2, which is 1, so that the velocities are polynomials in q and the angular velocity.
    space = tuple(2 * c / length for c in _product(rates, conjugate)[1:])
    body = tuple(2 * c / length for c in _product(conjugate, rates)[1:])
    matrix = sp.ImmutableMatrix(3, 3, lambda i, j: sp.expand(images[j][i]))
    return Rotation(q, rates, length - 1, matrix, body, space)


def _product(a: Sequence[Any], b: Sequence[Any]) -> tuple[Any, ...]:
    """The product of two quaternions."""
    return (
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    )
