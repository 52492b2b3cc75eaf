"""The rate at which neighbouring orbits of the slow flow part or approach, bounded over the proved tubes.

On the branch x' = f(x, h_0(x), 0) with the Jacobian A = D_x f + D_y f Dh_0, Dh_0 = -(D_y g)^-1 D_x g. The modulus of
every eigenvalue of (A + A^T)/2 is bounded over balls.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Iterable, Sequence

import sympy as sp
from flint import arb, arb_mat

from gsp.algebra.differentiation import jacobian
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.covering import Piece
from gsp.proofs.equations import Equations
from gsp.proofs.spectrum import largest_modulus
from gsp.proofs.tubes import Box, Tube

HALVINGS = 2000


def tangential_rate(
    equations: Equations, slow: Sequence[sp.Expr], pieces: Sequence[Piece], *, enough: float = 0.0
) -> float:
    """An upper bound over all `pieces`; infinite where none is found. `slow` are the slow rates f at epsilon = 0.

    Wide balls overestimate, so that the box with the largest bound is halved across its widest side, `HALVINGS` times
    in all or until no bound is above `enough`.
    """
    rates = _Rates(equations, slow)
    waiting = [(-rates.over(piece.tube, piece.tube.box), i, piece.tube.box) for i, piece in enumerate(pieces)]
    heapq.heapify(waiting)
    for _ in range(HALVINGS):
        bound, i, box = waiting[0]
        # As shares of the tube's box: variables have different units.
        sides = [
            (high - low) / (last - first or 1.0) for (low, high), (first, last) in zip(box, pieces[i].tube.box)
        ]
        axis = max(range(len(box)), key=sides.__getitem__)
        if -bound <= enough or not sides[axis] > 0.0:
            break
        heapq.heappop(waiting)
        low, high = box[axis]
        middle = low + 0.5 * (high - low)
        for ends in ((low, middle), (middle, high)):
            half = tuple(ends if k == axis else side for k, side in enumerate(box))
            heapq.heappush(waiting, (-rates.over(pieces[i].tube, half), i, half))
    return -waiting[0][0]


class _Rates:
    def __init__(self, equations: Equations, slow: Sequence[sp.Expr]) -> None:
        self.equations = equations
        self.own = len(slow)
        states = [*equations.x[: self.own], *equations.y]
        self.derivatives = BallFunction(equations.arguments, list(jacobian(slow, states)))

    def over(self, tube: Tube, box: Box) -> float:
        """The bound over a part of a tube's box; infinite where there is none."""
        n, m, own = self.equations.n, self.equations.m, self.own
        x = [balls.hull(low, high) for low, high in box]
        y = tube.over(x)
        by_y, by_x = self.equations.slopes(x, y)
        try:
            graph = arb_mat(m, m, by_y).solve(arb_mat(m, n, by_x))
        except ZeroDivisionError:
            return math.inf
        f = arb_mat(own, own + m, self.derivatives([*x, *y]))
        a = [
            [f[i, k] - _total(f[i, own + j] * graph[j, k] for j in range(m)) for k in range(own)]
            for i in range(own)
        ]
        return largest_modulus([[(a[i][k] + a[k][i]) / 2 for k in range(own)] for i in range(own)])


def _total(terms: Iterable[arb]) -> arb:
    total = arb(0)
    for term in terms:
        total = total + term
    return total
