"""The rate at which neighbouring orbits of the slow flow part or approach, bounded over the proved tubes.

On the branch x' = f(x, h_0(x), 0) with the Jacobian A = D_x f + D_y f Dh_0, Dh_0 = -(D_y g)^-1 D_x g. In a metric T^T T
the rate is the largest modulus of an eigenvalue of the symmetric part of T A T^-1, which is bounded over balls. Any
regular T serves a proof; it is chosen in doubles as `gsp.critical.slow_metric` has it, so that units do not matter.
"""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np
import sympy as sp
from flint import arb_mat

from gsp.algebra.differentiation import jacobian
from gsp.critical.slow_metric import least_metric
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.covering import CoveredPart
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.spectrum import largest_modulus
from gsp.proofs.tubes import Box, RootTube, enclose, halved, middle_of
from gsp.systems.scattered_points import PLACES


def tangential_rate(
    equations: EnclosedEquations, slow: Sequence[sp.Expr], pieces: Sequence[CoveredPart], *, enough: float = 0.0
) -> float:
    """An upper bound over all `pieces`; infinite where none is found. `slow` are the slow rates f at epsilon = 0.

    Wide balls overestimate, so that the box with the largest bound is halved across its widest side, `HALVINGS` times
    in all or until no bound is above `enough`.
    """
    rates = _Rates(equations, slow)
    rates.measure(pieces, least=enough if enough < math.inf else 0.0)
    order = itertools.count()
    waiting = [
        (-rates.over(tube, tube.box), next(order), tube.box, tube, tube.box)
        for tube in (p.tube for p in pieces)
    ]
    heapq.heapify(waiting)
    for _ in range(2000):
        bound, _, box, tube, whole = waiting[0]
        # As shares of the piece's box: variables have different units.
        sides = [(high - low) / (last - first or 1.0) for (low, high), (first, last) in zip(box, whole)]
        axis = max(range(len(box)), key=sides.__getitem__)
        if -bound <= enough or not sides[axis] > 0.0:
            break
        heapq.heappop(waiting)
        for half in halved(box, axis):
            own = narrowed(equations, tube, half)
            heapq.heappush(waiting, (-rates.over(own, half), next(order), half, own, whole))
    return -waiting[0][0]


def narrowed(equations: EnclosedEquations, tube: RootTube, box: Box) -> RootTube:
    """A tube over a part of a tube's box that lies in it, and so holds the same root; itself where none is found."""
    found = enclose(equations, box, tube.centre + tube.slope @ (middle_of(box) - tube.middle))
    x = [balls.hull(low, high) for low, high in box]
    return found if found is not None and tube.holds(x, found.over(x)) else tube


class _Rates:
    def __init__(self, equations: EnclosedEquations, slow: Sequence[sp.Expr]) -> None:
        self.equations = equations
        self.own = len(slow)
        states = [*equations.x[: self.own], *equations.y]
        self.derivatives = BallFunction(equations.arguments, list(jacobian(slow, states)))
        self.metric = self.inverse = arb_mat(np.eye(self.own).tolist())

    def measure(self, pieces: Sequence[CoveredPart], *, least: float) -> None:
        """Take the metric in which the rates at some points of the pieces are least."""
        unit = np.random.default_rng(0).random((max(PLACES // len(pieces), 1), self.equations.n))
        found = []
        for piece in pieces[:: max(len(pieces) // PLACES, 1)]:
            low, high = np.array(piece.tube.box).T
            for point in low + unit * (high - low):
                place = tuple((v, v) for v in map(float, point))
                a = self.matrix(narrowed(self.equations, piece.tube, place), place)
                if a is not None:
                    # What is 0 to rounding is 0.
                    entries = [0.0 if entry.contains(0) else float(entry.mid()) for entry in a.entries()]
                    found.append(np.reshape(entries, (self.own, self.own)))
        A = np.array([a for a in found if np.isfinite(a).all()])
        if len(A):
            T = arb_mat(least_metric(A).written(A, least=least).tolist())
            with suppress(ZeroDivisionError):
                self.inverse, self.metric = T.inv(), T

    def matrix(self, tube: RootTube, box: Box) -> arb_mat | None:
        """A over a part of a tube's box; None where D_y g may be singular."""
        n, m, own = self.equations.n, self.equations.m, self.own
        x = [balls.hull(low, high) for low, high in box]
        y = tube.over(x)
        by_y, by_x = self.equations.slopes(x, y)
        try:
            graph = arb_mat(m, m, by_y).solve(arb_mat(m, n, by_x))
        except ZeroDivisionError:
            return None
        f = arb_mat(own, own + m, self.derivatives([*x, *y]))
        return arb_mat(
            [
                [f[i, k] - sum((f[i, own + j] * graph[j, k] for j in range(m)), balls.ZERO) for k in range(own)]
                for i in range(own)
            ]
        )

    def over(self, tube: RootTube, box: Box) -> float:
        """The bound over a part of a tube's box; infinite where there is none."""
        a = self.matrix(tube, box)
        if a is None:
            return math.inf
        b = self.metric * a * self.inverse
        return largest_modulus([[(b[i, k] + b[k, i]) / 2 for k in range(self.own)] for i in range(self.own)])
