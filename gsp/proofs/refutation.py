"""Proofs that a branch is not normally hyperbolic over a region: a witness, and why it belongs to the branch.

The branch is followed along a straight line in x, inside the region, from its anchor (a ball that holds its point
over one x) towards a place where it seems to be lost. Tubes along the line are a chain when they are glued and the
first one holds the anchor.

- *Another type.* Two points of the branch are joined by a chain, or by the graph of an explicit branch on which D_y F
  is continuous, and their proved numbers of unstable eigenvalues differ. Eigenvalues depend continuously on the
  point, so that one of them is on the imaginary axis in between. The witness is the piece of the line between two
  such points.
- *A fold.* A zero of (F, D_y F v, v.v - 1) for (y, t, v) is proved along x = x_0 + t d: a point of the critical
  manifold with a singular D_y F. A curve of zeros, followed by arclength from there, runs into the chain and stays
  over the line. Were the branch one regular graph over the region, it would hold the chain; what it holds of the
  curve is closed, and open, for no other zeros are near a regular one; so it would hold the fold, which is not
  regular.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import sympy as sp
from flint import arb

from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.covering import Covering, cover, glue, spectrum_at
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.spectrum import Spectrum, spectrum_of
from gsp.proofs.tubes import Box, RootTube, enclose, krawczyk

# Boxes along a line.
LINE_BOXES = 400


@dataclass(frozen=True)
class Witness:
    """Where normal hyperbolicity is lost: the loss is inside `box`, intervals by the name of each variable.

    `kind` is "fold" or "type"; `statement` says what was proved there.
    """

    kind: str
    box: dict[str, tuple[float, float]]
    statement: str


@dataclass(frozen=True, eq=False)
class LineSegment:
    """x = `start` + t `way`, t from 0 to 1, and the equations along it."""

    start: np.ndarray
    way: np.ndarray
    t: sp.Symbol
    equations: EnclosedEquations

    def at(self, t: arb) -> list[arb]:
        """x (n,) over a ball of t."""
        return [balls.exact(float(a)) + balls.exact(float(b)) * t for a, b in zip(self.start, self.way)]


def refute(
    equations: EnclosedEquations,
    region: Box,
    anchor: tuple[np.ndarray, list[arb]],
    suspects: list[np.ndarray],
    *,
    graph: tuple[sp.Expr, ...] | None = None,
) -> Witness | None:
    """A witness against normal hyperbolicity over `region`, sought towards each of `suspects` (n,); None without one.

    `anchor` is a point x (n,) and a ball (m,) that holds the branch's point over it; `graph` the branch's expressions
    where it is explicit.
    """
    start, heights = anchor
    for suspect in suspects:
        if not np.abs(suspect - start).max() > 0.0:
            continue
        line = _line(equations, start, suspect)
        if not _is_inside(line, region):
            continue
        found = None if graph is None else _another_type_of_graph(equations, line, graph)
        if found is None:
            found = _along(equations, line, heights)
        if found is not None:
            return found
    return None


def _line(equations: EnclosedEquations, start: np.ndarray, end: np.ndarray) -> LineSegment:
    # Shortened by more than rounding, so that it ends inside where `end` is on the border.
    way = (end - start) * (1.0 - 2.0**-50)
    t = sp.Dummy("t")
    on = {x: sp.Rational(float(a)) + sp.Rational(float(b)) * t for x, a, b in zip(equations.x, start, way)}
    return LineSegment(start, way, t, equations.along(on, t))


def _is_inside(line: LineSegment, region: Box) -> bool:
    """Whether both ends, and so the whole line, are in the region."""
    for a, b, (low, high) in zip(line.start, line.way, region):
        end = Fraction(float(a)) + Fraction(float(b))
        if not (low <= a <= high and low <= end <= high):
            return False
    return True


# -- another type ----------------------------------------------------------------------------------


def _another_type_of_graph(
    equations: EnclosedEquations, line: LineSegment, graph: tuple[sp.Expr, ...]
) -> Witness | None:
    """Two points of an explicit branch with different numbers of unstable eigenvalues."""
    heights = BallFunction(equations.x, graph)

    def spectrum(t: float) -> Spectrum | None:
        x = line.at(balls.exact(t))
        y = heights(x)
        matrix = equations.derivative(x, y)
        if not all(entry.is_finite() for entry in matrix):
            return None
        near = np.array([float(entry.mid()) for entry in matrix]).reshape(equations.m, -1)
        return spectrum_of(matrix, near)

    # At a pole an eigenvalue changes its sign without being on the axis.
    if not _is_continuous_along(equations, line, heights):
        return None
    return _between(equations, line, spectrum, heights)


def _is_continuous_along(equations: EnclosedEquations, line: LineSegment, heights: BallFunction) -> bool:
    """Whether the graph and D_y F on it are finite over boxes that cover the line."""
    waiting = [(0.0, 1.0)]
    for _ in range(LINE_BOXES):
        if not waiting:
            return True
        low, high = waiting.pop()
        x = line.at(balls.hull(low, high))
        y = heights(x)
        if not all(value.is_finite() for value in [*y, *equations.derivative(x, y)]):
            middle = 0.5 * (low + high)
            waiting += [(low, middle), (middle, high)]
    return False


def _between(
    equations: EnclosedEquations,
    line: LineSegment,
    spectrum: Callable[[float], Spectrum | None],
    heights: BallFunction | None,
) -> Witness | None:
    """The change of type between t = 0 and 1, narrowed down by halving as long as the middle's type is proved."""
    first, last = spectrum(0.0), spectrum(1.0)
    if first is None or last is None or first.counts == last.counts:
        return None
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        found = spectrum(middle)
        if found is None:
            break
        low, high = (middle, high) if found.counts == first.counts else (low, middle)
        last = last if found.counts == first.counts else found
    x = line.at(balls.hull(low, high))
    names = [s.name for s in equations.arguments]
    ends = [(balls.below(v), balls.above(v)) for v in [*x, *(heights(x) if heights else ())]]
    statement = (
        f"between two points of the branch the number of unstable eigenvalues goes from {first.unstable} to "
        f"{last.unstable}, so that one of them is on the imaginary axis"
    )
    return Witness("type", dict(zip(names, ends)), statement)


def _along(equations: EnclosedEquations, line: LineSegment, anchor: list[arb]) -> Witness | None:
    """A change of type at the end of a chain along the line, or a fold where the chain ends."""
    chain = _chain(line, anchor, 1.0)
    if chain is not None:

        def spectrum(t: float) -> Spectrum | None:
            tube = _at(line.equations, chain, t)
            return None if tube is None else spectrum_at(line.equations, tube)

        return _between(equations, line, spectrum, None)
    return _fold(equations, line, anchor)


def _chain(line: LineSegment, anchor: list[arb], end: float) -> Covering | None:
    """Glued tubes over t from 0 to `end`, the first of which holds the anchor; None where that is not proved."""
    near = np.array([float(y.mid()) for y in anchor])
    on = line.equations
    reached = on.followed(np.zeros(1), np.array([0.5 * end]), near)
    found = cover(
        on, ((0.0, end),), near if reached is None else reached[1], most_boxes=LINE_BOXES, spectral=False
    )
    if found.undecided or glue(on, found):
        return None
    first = found.root.holding(np.zeros(1), upper=False).piece
    return found if first is not None and first.tube.holds([arb(0)], anchor) else None


def _at(equations: EnclosedEquations, chain: Covering, t: float) -> RootTube | None:
    """A small tube over t whose zero is the chain's."""
    piece = chain.root.holding(np.array([t]), upper=False).piece
    if piece is None:
        return None
    near = piece.tube.centre + piece.tube.slope @ (np.array([t]) - piece.tube.middle)
    found = enclose(equations, ((t, t),), near)
    at = [balls.exact(t)]
    return found if found is not None and piece.tube.holds(at, found.over(at)) else None


# -- a fold ----------------------------------------------------------------------------------------


def _fold(equations: EnclosedEquations, line: LineSegment, anchor: list[arb]) -> Witness | None:
    """A singular point of D_y F that a curve of zeros joins to a chain from t = 0."""
    m = equations.m
    on = line.equations
    near = np.array([float(y.mid()) for y in anchor])
    reached = on.followed(np.zeros(1), np.ones(1), near)
    if reached is None:
        return None
    end, last = reached
    v = sp.symbols(f"v:{m}", cls=sp.Dummy)
    by_y = sp.Matrix(m, m, on.derivatives_by_y)
    singular = EnclosedEquations(
        (),
        (*on.y, line.t, *v),
        (*on.equations, *(by_y * sp.Matrix(v)), sum(a * a for a in v) - 1),
    )
    slope = on.nearby(np.array([[end]]), last[None])[0][0]
    direction = np.linalg.svd(slope)[2][-1]
    found = singular.root(np.empty(0), np.concatenate([last, [end], direction]))
    if found is None:
        return None
    point = krawczyk(singular, (), np.empty(0), found, np.empty((2 * m + 1, 0)))
    if point is None:
        return None
    place = point.over([])
    y, t = place[:m], place[m]
    if not (t > 0 and t < 1):
        return None
    # The arc from a fold to the chain is tried with these lengths, as shares of the line's way in y.
    joined = any(
        _joins(line, anchor, found, share * side * float(np.abs(last - near).max() or 1.0), y, t)
        for share in (0.3, 0.1, 0.03, 0.01)
        for side in (1.0, -1.0)
    )
    if not joined:
        return None
    x = line.at(t)
    names = [s.name for s in equations.arguments]
    box = {name: (balls.below(b), balls.above(b)) for name, b in zip(names, [*x, *y])}
    where = ", ".join(f"{name} = {0.5 * (low + high):.12g}" for name, (low, high) in box.items())
    return Witness("fold", box, f"the fast Jacobian is singular on the branch at {where}")


def _joins(line: LineSegment, anchor: list[arb], fold: np.ndarray, arc: float, y: list[arb], t: arb) -> bool:
    """Whether a curve of zeros from the fold, of length `arc` along its null vector, stays over the line and ends in
    a chain from t = 0.
    """
    on = line.equations
    m = on.m
    centre, direction = fold[:m], fold[m + 1 :]
    sigma = sp.Dummy("sigma")
    section = sum(
        sp.Rational(float(a)) * (s - sp.Rational(float(c))) for s, a, c in zip(on.y, direction, centre)
    )
    curve = EnclosedEquations((sigma,), (*on.y, line.t), (*on.equations, section - sigma))
    overlap = 1e-3 * abs(arc)
    low, high = sorted((-overlap if arc > 0 else overlap, arc))
    covering = cover(curve, ((low, high),), fold[: m + 1], most_boxes=LINE_BOXES, spectral=False)
    if covering.undecided or glue(curve, covering):
        return False
    # The fold is on this curve.
    along = sum(
        (balls.exact(float(a)) * (p - balls.exact(float(c))) for a, p, c in zip(direction, y, centre)), arb(0)
    )
    if not (along > low and along < high):
        return False
    if not any(piece.tube.holds([along], [*y, t]) for piece in covering.pieces):
        return False
    # All of it is over the line, and so in the region.
    for piece in covering.pieces:
        over = piece.tube.over([balls.hull(*piece.tube.box[0])])[m]
        if not (over > 0 and over < 1):
            return False
    end = _at(curve, covering, arc)
    if end is None:
        return False
    values = end.over([balls.exact(arc)])
    last = values[m]
    chain = _chain(line, anchor, balls.above(last))
    if chain is None:
        return False
    piece = chain.root.holding(np.array([balls.below(last)]), upper=False).piece
    return piece is not None and piece.tube.holds([last], values[:m])
