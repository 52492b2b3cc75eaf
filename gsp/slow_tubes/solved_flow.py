"""The flow about a slow manifold that was solved for: a polynomial p(x), and what it leaves of the equation.

With y = p(x) + P z, P a constant matrix, a system x' = f, epsilon y' = g of one slow variable is, exactly,

    x' = f(x, y, epsilon),    epsilon z' = G(x, z, epsilon) = P^-1 (g - epsilon p'(x) f) .

p is the interpolant whose coefficients are the doubles that it has. G is that of `invariance` with epsilon^(n+1)
replaced by 1, and has the same methods, so that the same tests prove a tube about p. The residual G(x, 0) is about
as small as rounding and the difference of large terms: about the middle c of an interval it is enclosed as a Taylor
polynomial, its coefficients with so many bits that nothing of them is lost, and the last one over the whole interval
(Lagrange's remainder).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import sympy as sp
from flint import arb, arb_poly, fmpq, fmpz_poly

from gsp.algebra.differentiation import jacobian
from gsp.algebra.precision import precision
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.equations import without_decimals
from gsp.slow.chebyshev import ChebyshevSurface
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow_tubes.series_function import SeriesFunction

# Coefficients of the residual on an interval, the last of them for the rest.
ORDER = 16


class SolvedFlow:
    """f and G about `manifold`, over x (1,), z (m,) and epsilon, as functions of balls; the methods of `Invariance`.

    `basis` is P (m, m), of fractions. Raises `UnsupportedFunctionError` for a function without an enclosure.
    """

    # y is not divided by a power of epsilon.
    order = -1

    def __init__(self, manifold: SampledManifold, basis: sp.Matrix) -> None:
        system, surface = manifold.branch.system, manifold.surface
        assert surface is not None
        values = {p: without_decimals(v) for p, v in system.parameters.items()}
        f, g = ([without_decimals(e.xreplace(values)) for e in rates] for rates in (system.f, system.g))
        self.n = self.slow = len(system.x)
        self.m = len(system.y)
        self._basis = [_ball(e) for e in basis]
        self._inverse = [_ball(e) for e in basis.inv()]
        arguments = (*system.x, *system.y, system.epsilon)
        self._f = BallFunction(arguments, f)
        # f, then the derivatives of f and of g by x, y and epsilon, row by row.
        self._slopes = BallFunction(arguments, [*f, *jacobian([*f, *g], arguments)])
        degree = surface.coefficients.shape[0] - 1
        # Bits beyond those that a polynomial of degree N may lose, 3 N: those of T_N about 1, and of the shift
        # to c.
        self._precision = 192 + 3 * degree
        with precision(self._precision):
            self._exact = SeriesFunction(arguments, [*f, *g])
            self._p = [_polynomial(surface, i) for i in range(self.m)]
            low, high = (arb(float(end)) for end in surface.box[0])
            self._inner = (low + high) / 2, (high - low) / 2
        self._kept: dict[tuple[float, float], tuple[list[list[arb]], list[list[arb]]]] = {}

    # -- the polynomial ----------------------------------------------------------------------------

    def _about(self, x: arb) -> tuple[float, float, list[list[arb]], list[list[arb]]]:
        """The middle c and the half-width h of the ball x, and Taylor coefficients of p: at c, and over the ball."""
        c = float(x.mid())
        h = balls.magnitude(x - arb(c))
        found = self._kept.get((c, h))
        if found is None:
            with precision(self._precision):
                middle, half = self._inner
                inner = arb_poly([(arb(c) - middle) / half, 1 / half])
                at = [[*p(inner).coeffs(), *[arb(0)] * (ORDER + 2)] for p in self._p]
                over = [_spread(q, h) for q in at]
            # Intervals whose polynomials are kept; each is asked for several times in a row.
            if len(self._kept) >= 4096:
                self._kept.clear()
            found = self._kept[c, h] = at, over
        return c, h, *found

    def _graph(self, x: arb) -> tuple[list[arb], list[arb], list[arb]]:
        """p, p' and p'' (m,) over a ball."""
        over = self._about(x)[3]
        return [q[0] for q in over], [q[1] for q in over], [2 * q[2] for q in over]

    # -- as the tests of a tube ask ----------------------------------------------------------------

    def residual(self, arguments: Sequence[arb]) -> list[arb]:
        """G (m,) at z = 0 over (x, epsilon)."""
        x, epsilon = arguments
        c, h, at, over = self._about(x)
        with precision(self._precision):
            total = self._defects([arb(c), arb(1)], at, epsilon, ORDER)
            if h > 0.0:
                rest = self._defects([x, arb(1)], over, epsilon, ORDER + 1)
                away = balls.hull(-h, h)
                for i, row in enumerate(total):
                    row.append(rest[i][ORDER])
                    for k in range(ORDER, 0, -1):
                        row[k - 1] = row[k - 1] + row[k] * away
            return self._turned([row[0] for row in total])

    def _defects(self, x: list[arb], y: list[list[arb]], epsilon: arb, length: int) -> list[list[arb]]:
        """The Taylor coefficients (m, length) of g - epsilon p' f along the graph."""
        rows = self._exact([x, *y, [epsilon]], length)
        (f,), g = rows[:1], rows[1:]
        found = []
        for row, q in zip(g, y):
            slope = [(k + 1) * q[k + 1] for k in range(length)]
            found.append(
                [
                    row[k] - epsilon * sum((slope[j] * f[k - j] for j in range(k + 1)), balls.ZERO)
                    for k in range(length)
                ]
            )
        return found

    def _turned(self, vector: list[arb]) -> list[arb]:
        """P^-1 of a vector (m,)."""
        m = self.m
        return [sum((self._inverse[i * m + j] * vector[j] for j in range(m)), balls.ZERO) for i in range(m)]

    def _linear(
        self, x: arb, z: Sequence[arb], epsilon: arb
    ) -> tuple[list[arb], list[arb], list[arb], list[arb]]:
        """D_x f, D_z f (m,), D_x G (m,) and D_epsilon G (m,), then D_z G (m m,), over (x, z, epsilon)."""
        m = self.m
        p, slope, bend = self._graph(x)
        y = [b + sum((self._basis[i * m + j] * z[j] for j in range(m)), balls.ZERO) for i, b in enumerate(p)]
        f, *derivatives = self._slopes([x, *y, epsilon])
        width = m + 2
        rows = [derivatives[i * width : (i + 1) * width] for i in range(m + 1)]
        along = [row[0] + sum((row[1 + j] * slope[j] for j in range(m)), balls.ZERO) for row in rows]
        across = [
            [sum((row[1 + k] * self._basis[k * m + j] for k in range(m)), balls.ZERO) for j in range(m)]
            for row in rows
        ]
        by_x = [g - epsilon * (b * f + s * along[0]) for g, b, s in zip(along[1:], bend, slope)]
        by_epsilon = [row[-1] - s * f - epsilon * s * rows[0][-1] for row, s in zip(rows[1:], slope)]
        by_z = [[g[j] - epsilon * s * across[0][j] for j in range(m)] for g, s in zip(across[1:], slope)]
        turned = [self._turned([row[j] for row in by_z]) for j in range(m)]
        slopes = [e for pair in zip(self._turned(by_x), self._turned(by_epsilon)) for e in pair]
        return [along[0]], across[0], slopes, [turned[j][i] for i in range(m) for j in range(m)]

    def residual_slopes(self, arguments: Sequence[arb]) -> list[arb]:
        """The derivatives of G by x and by epsilon, (m 2,), row by row, at z = 0."""
        x, epsilon = arguments
        return self._linear(x, [arb(0)] * self.m, epsilon)[2]

    def normal(self, arguments: Sequence[arb]) -> list[arb]:
        """D_z G (m m,), row by row, over (x, *z, epsilon)."""
        return self._linear(arguments[0], arguments[1:-1], arguments[-1])[3]

    def rates(self, arguments: Sequence[arb]) -> list[arb]:
        """f (1,) over (x, *z, epsilon)."""
        x, z, m = arguments[0], arguments[1:-1], self.m
        p = self._graph(x)[0]
        y = [b + sum((self._basis[i * m + j] * z[j] for j in range(m)), balls.ZERO) for i, b in enumerate(p)]
        return self._f([x, *y, arguments[-1]])

    def linearisation(self, arguments: Sequence[arb]) -> tuple[list[arb], list[arb], list[arb], list[arb]]:
        """D_x f and D_z f (1 + m,), D_z G (m m,), D_x G over all z (m,), and what z adds to it, nothing (m m,)."""
        along, lift, slopes, normal = self._linear(arguments[0], arguments[1:-1], arguments[-1])
        return [*along, *lift], normal, slopes[::2], [arb(0)] * self.m**2

    def turning(self, _: Sequence[arb]) -> list[arb]:
        """P (m m,), row by row."""
        return self._basis


def _ball(value: sp.Expr) -> arb:
    return arb(fmpq(int(value.p), int(value.q)))


def _polynomial(surface: ChebyshevSurface, component: int) -> arb_poly:
    """One component of the interpolant as a polynomial in its inner variable, -1 to 1 over the region.

    In x its coefficients would cancel where the region is far from 0.
    """
    total = arb_poly([])
    for j, value in enumerate(surface.coefficients[:, component]):
        total = total + arb_poly(fmpz_poly.chebyshev_t(j)) * arb(float(value))
    return total


def _spread(q: list[arb], h: float) -> list[arb]:
    """Taylor coefficients of sum q_j t^j over |t| <= h, as many as the rest of a residual asks for."""
    away = balls.hull(-h, h)
    found = []
    for k in range(ORDER + 2):
        total, power = q[k], arb(1)
        for j in range(k + 1, len(q)):
            power = power * away
            total = total + math.comb(j, k) * q[j] * power
        found.append(total)
    return found
