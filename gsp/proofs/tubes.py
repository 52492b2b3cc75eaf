"""One smooth root over a box, enclosed in a tilted tube by Krawczyk's method.

Over the box X about the point c the tube is y = b + T (x - c) + R, |R_i| <= radius_i, with T = -(D_y F)^-1 D_x F.
With a matrix C near (D_y F)^-1 let, for every x of X,

    K(x) = -C F(x, b + T (x - c)) + (1 - C D_y F(x, Y)) R,

Y the tube's values. If K(X) lies in the interior of R, then F(x, .) has exactly one zero in the tube over each x of
X, and D_y F is regular there, so that the zeros are one smooth graph (Krawczyk 1969; Neumaier 1990, theorem 5.1.8;
the implicit function theorem). F(x, b + T (x - c)) is enclosed in its mean-value form, which is what the tilt pays
for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from flint import arb

from gsp.proofs import balls
from gsp.proofs.equations import EnclosedEquations

Box = tuple[tuple[float, float], ...]

# The first radius is so much larger than what the residual asks for, and grows so much from round to round.
FIRST_ROOM, ROOM = 1.2, 1.25


@dataclass(frozen=True, eq=False)
class RootTube:
    """One smooth root over `box`: y = `centre` + `slope` (x - `middle`) + R, |R_i| <= `radius`_i.

    `inverse` (m, m) is the C that proves it, and `derivative` (m m,) encloses D_y F over the tube.
    """

    box: Box
    middle: np.ndarray
    centre: np.ndarray
    slope: np.ndarray
    radius: np.ndarray
    inverse: np.ndarray
    derivative: list[arb]

    def over(self, x: list[arb]) -> list[arb]:
        """The tube's values (m,) over balls x (n,) inside the box."""
        return [y + balls.hull(-float(r), float(r)) for y, r in zip(self._line(x), self.radius)]

    def holds(self, x: list[arb], y: list[arb]) -> bool:
        """Whether the box holds the balls x (n,), and the tube's interior has y (m,) over every point of them."""
        if not all(ball >= low and ball <= high for (low, high), ball in zip(self.box, x)):
            return False
        return all(
            inside(value - line, float(radius)) for value, line, radius in zip(y, self._line(x), self.radius)
        )

    def _line(self, x: list[arb]) -> list[arb]:
        off = [a - balls.exact(float(c)) for a, c in zip(x, self.middle)]
        return [
            sum((balls.exact(float(s)) * step for s, step in zip(row, off)), balls.exact(float(centre)))
            for row, centre in zip(self.slope, self.centre)
        ]


def middle_of(box: Box) -> np.ndarray:
    """A point (n,) near the middle of a box, inside it."""
    return np.array([low + 0.5 * (high - low) for low, high in box])


def halved(box: Box, axis: int) -> tuple[Box, Box]:
    """The lower and the upper half of a box along one side."""
    low, high = box[axis]
    middle = low + 0.5 * (high - low)
    before, after = box[:axis], box[axis + 1 :]
    return (*before, (low, middle), *after), (*before, (middle, high), *after)


def enclose(
    equations: EnclosedEquations, box: Box, near: np.ndarray, *, margin: float = FIRST_ROOM
) -> RootTube | None:
    """The tube about the root over `box` that Newton's method finds from `near` (m,); None where it is not proved.

    Its first radius is `margin` times what the residual asks for.
    """
    middle = middle_of(box)
    centre = equations.root(middle, near)
    if centre is None:
        return None
    derivative, by_x = (part[0] for part in equations.nearby(middle[None], centre[None]))
    try:
        slope = -np.linalg.solve(derivative, by_x)
    except np.linalg.LinAlgError:
        return None
    if not np.isfinite(slope).all():
        return None
    return krawczyk(equations, box, middle, centre, slope, margin=margin)


def krawczyk(
    equations: EnclosedEquations,
    box: Box,
    middle: np.ndarray,
    centre: np.ndarray,
    slope: np.ndarray,
    *,
    margin: float = FIRST_ROOM,
) -> RootTube | None:
    """The tube with these data if Krawczyk's condition is met for some radius, else None."""
    n, m = equations.n, equations.m
    x = [balls.hull(low, high) for low, high in box]
    c = [balls.exact(float(v)) for v in middle]
    b = [balls.exact(float(v)) for v in centre]
    tilt = [[balls.exact(float(v)) for v in row] for row in slope]
    off = [p - q for p, q in zip(x, c)]
    line = [b[i] + sum((tilt[i][k] * off[k] for k in range(n)), balls.ZERO) for i in range(m)]
    by_y, by_x = equations.slopes(x, line)
    # The inverse of the ball matrix's midpoint, not of the matrix in the middle: with one fast variable it serves
    # wherever the derivative keeps its sign.
    between = np.array([float(entry.mid()) for entry in by_y]).reshape(m, m)
    if not np.isfinite(between).all():
        return None
    try:
        inverse = np.linalg.inv(between)
    except np.linalg.LinAlgError:
        return None
    approximate = [[balls.exact(float(v)) for v in row] for row in inverse]
    residual = equations.value(c, b)
    for i in range(m):
        for k in range(n):
            along = by_x[i * n + k] + sum((by_y[i * m + j] * tilt[j][k] for j in range(m)), balls.ZERO)
            residual[i] = residual[i] + along * off[k]
    defect = [sum((approximate[i][k] * residual[k] for k in range(m)), balls.ZERO) for i in range(m)]
    # Relative to the size of y and |y|: a tube over one point has to fit into tubes over boxes.
    least = 5 * np.finfo(float).eps if all(low == high for low, high in box) else 1e-12
    sizes = equations.sizes.tolist()
    radius = [
        margin * balls.magnitude(d) + least * (size + abs(float(v)))
        for d, v, size in zip(defect, centre, sizes)
    ]
    # Radii beyond these, relative to the size of y and the largest on the tube's line, are on their way to infinity.
    far = [1e6 * (size + balls.magnitude(y)) for y, size in zip(line, sizes)]
    for _ in range(4):
        # A radius that is not a number fails here as well.
        if not all(r < limit for r, limit in zip(radius, far)):
            return None
        ball = [balls.hull(-r, r) for r in radius]
        y = [p + r for p, r in zip(line, ball)]
        by_y = equations.derivative(x, y)
        image = []
        for i in range(m):
            value = -defect[i]
            for k in range(m):
                product = sum((approximate[i][j] * by_y[j * m + k] for j in range(m)), balls.ZERO)
                value = value + ((1 if i == k else 0) - product) * ball[k]
            image.append(value)
        if all(inside(value, r) for value, r in zip(image, radius)):
            return RootTube(box, middle, centre, slope, np.array(radius), inverse, by_y)
        grown = [ROOM * balls.magnitude(value) for value in image]
        if not all(r < limit for r, limit in zip(grown, far)):
            return None
        radius = [max(wide, r) for wide, r in zip(grown, radius)]
    return None


def inside(value: arb, radius: float) -> bool:
    """Whether the ball lies in the interior of [-radius, radius]; a ball that is not finite does not."""
    return bool(value < radius and value > -radius)
