"""How far the full solution is from the reduced one, carried over a step: a centre with its signs, and a radius.

With x = s + epsilon^(n+1) U, y = h_n(x) + epsilon^(n+1) P z about a solution s of the reduced flow, exactly,

    U' = A U + K(x, z) + phi(s),    epsilon z' = Gamma(x, z),

A being a mean value of D_x f(x, h_n(x)) between s and x, epsilon^(n+1) K what z adds to f, and epsilon^(n+1) phi what
f has on the graph over the reduced field. About a point z_m, K = K(x, z_m) + C (z - z_m) and Gamma = Gamma(x, z_m) +
B (z - z_m). In the time tau from the middle of a step each of A, K(x, z_m), phi and Gamma(x, z_m) is its value there
and tau times a derivative along the flow. The centre follows the linear flow with constants near these,

    U_0' = A_0 U_0 + A_1 U_m tau + C_0 (z_0 - z_m) + k_0 + k_1 tau,    epsilon z_0' = epsilon p + B_0 (z_0 - q - p tau),

fast directions that turn among it, by the exponential of one matrix. What is left of U and z, e and w, obeys

    e' = A_0 e + C w + ...,    epsilon w' = B w + ...

and the differences between what was enclosed and the constants, which fall with the square of the step. Logarithmic
norms bound their sizes, that of w in a frame T in which a complex pair turns and shrinks as its real part says. All
this holds as long as U and z stay in the boxes over which everything was taken; they do if what follows lies inside.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from flint import arb, arb_mat

from gsp.proofs import balls
from gsp.slow_tubes.ball_vectors import centre_of, centres, minus, row, times
from gsp.slow_tubes.frame import BALL, FibreBasis, framed
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.isolation import norm
from gsp.slow_tubes.validated_flow import log_norm

# A box that does not hold what follows is widened so often, by this factor.
WIDENINGS, WIDER = 25, 1.2


@dataclass(eq=False)
class Deviation:
    """U within `radius` of `centre`, z within `spread` of `fast` in the norm of `frame`."""

    centre: list[arb]
    radius: arb
    fast: list[arb]
    spread: arb
    frame: FibreBasis

    def slow_box(self) -> list[arb]:
        """A box that holds U."""
        return [c + BALL * self.radius for c in self.centre]

    def fast_box(self) -> list[arb]:
        """A box that holds z."""
        return [c + b for c, b in zip(self.fast, self.frame.box(self.spread))]


@dataclass(frozen=True, eq=False)
class Span:
    """A step of time: its length, and balls that hold s in its middle, over all of it, and s' over all of it."""

    length: arb
    middle: list[arb]
    s: list[arb]
    rates: list[arb]


@dataclass(frozen=True, eq=False)
class _Varying:
    """What is `value` in the middle of a step and changes at a rate in `slope`; both are balls."""

    value: list[arb]
    slope: list[arb]

    @property
    def is_finite(self) -> bool:
        return all(e.is_finite() for e in [*self.value, *self.slope])


@dataclass(frozen=True, eq=False)
class _Coefficients:
    """A, then Gamma and K at z_m, then phi, over a step; B and C all over it, and the frame for B with its decay."""

    A: _Varying
    gamma: _Varying
    push: _Varying
    phi: _Varying
    B: arb_mat
    C: arb_mat
    middle: list[arb]
    frame: FibreBasis
    decay: arb


@dataclass(frozen=True, eq=False)
class _FastPath:
    """z over a step: z_0 = `target` + `slope` tau + what shrinks from `away` on, in the box `centre`.

    |w| goes from `first` towards `last`.
    """

    target: list[arb]
    slope: list[arb]
    away: list[arb]
    centre: list[arb]
    first: arb
    last: arb

    def box(self, frame: FibreBasis) -> list[arb]:
        """A box that holds z all the time: w is largest at one of its ends."""
        return [c + b for c, b in zip(self.centre, frame.box(self.first.max(self.last)))]


def deviation(offset: Sequence[arb], away: Sequence[arb]) -> Deviation:
    """The deviation (U, z) = (offset, away), both balls."""
    centre, fast = centres(offset), centres(away)
    m = len(fast)
    unit = arb_mat(m, m, [arb(int(i == j)) for i in range(m) for j in range(m)])
    return Deviation(
        centre,
        norm(minus(offset, centre)),
        fast,
        norm(minus(away, fast)),
        FibreBasis(unit, unit),
    )


class DeviationFlow:
    """The flow of (U, z) about reduced solutions, for one `epsilon`."""

    def __init__(self, invariance: Invariance, epsilon: arb) -> None:
        self.invariance, self.epsilon = invariance, epsilon
        self.n, self.m = invariance.slow, invariance.m
        self.unit = balls.power(epsilon, invariance.order + 1)

    def step(self, state: Deviation, span: Span) -> tuple[Deviation, arb] | None:
        """The deviation after `span`, and a bound of |U| on the way.

        None where the fast directions are not proved to attract, or no box holds what follows.
        """
        n = self.n
        since = arb(0).union(span.length)
        u = state.slow_box()
        box_u, box_z = u, state.fast_box()
        for _ in range(WIDENINGS):
            wide_u, wide_z = [_widened(b) for b in box_u], [_widened(b) for b in box_z]
            found = self._coefficients(span, wide_u, wide_z, state.frame)
            if found is None:
                return None
            path = self._fast_path(state, found, span.length)
            z = path.box(found.frame)
            tau = BALL * span.length / 2
            A = arb_mat(n, n, [v + d * tau for v, d in zip(found.A.value, found.A.slope)])
            pushed = [
                a + c + k + dk * tau + f + df * tau
                for a, c, k, dk, f, df in zip(
                    times(A, wide_u),
                    times(found.C, minus(z, found.middle)),
                    found.push.value,
                    found.push.slope,
                    found.phi.value,
                    found.phi.slope,
                )
            ]
            image = [a + since * p for a, p in zip(u, pushed)]
            if all(w.contains_interior(i) for w, i in zip([*wide_u, *wide_z], [*image, *z])):
                return self._moved(state, found, path, image, span.length)
            if not all(i.is_finite() for i in [*image, *z]):
                return None
            box_u = [b.union(i) for b, i in zip(box_u, image)]
            box_z = [b.union(i) for b, i in zip(box_z, z)]
        return None

    def _coefficients(self, span: Span, u: list[arb], z: list[arb], frame: FibreBasis) -> _Coefficients | None:
        """For all U and z in the boxes u and z; None where the fast directions do not attract."""
        n, m, inv, small = self.n, self.m, self.invariance, self.epsilon
        away = [b * self.unit for b in u]
        x = [a + b for a, b in zip(span.s, away)]
        then = [a + b for a, b in zip(span.middle, away)]
        rates = inv.rates([*x, *z, small])
        between = [a.union(b) for a, b in zip(span.s, x)]
        still = [arb(0)] * (m + 1)
        middle = centres(z)
        # Along a way from s to x every place moves at a rate between theirs.
        A = _Varying(
            inv.drift.values([*(a.union(b) for a, b in zip(span.middle, then)), small]),
            inv.drift.along([*between, small], [*(a.union(b) for a, b in zip(span.rates, rates)), arb(0)]),
        )
        both = _Varying(
            inv.push.values([*then, *middle, small]), inv.push.along([*x, *middle, small], [*rates, *still])
        )
        phi = _Varying(
            inv.mismatch.values([*span.middle, small]),
            inv.mismatch.along([*span.s, small], [*span.rates, arb(0)]),
        )
        B = arb_mat(m, m, inv.normal([*x, *z, small]))
        C = arb_mat(n, m, inv.forcing([*x, *z, small]))
        if not (A.is_finite and both.is_finite and phi.is_finite) or not all(
            e.is_finite() for e in [*B.entries(), *C.entries()]
        ):
            return None
        frame, decay = framed(frame, B)
        if not decay > 0.0:
            return None
        gamma, push = (_Varying(both.value[part], both.slope[part]) for part in (slice(m), slice(m, None)))
        return _Coefficients(A, gamma, push, phi, B, C, middle, frame, arb(decay))

    def _fast_path(self, state: Deviation, found: _Coefficients, length: arb) -> _FastPath:
        m, frame, eps = self.m, found.frame, self.epsilon
        half = length / 2
        B, gamma, middle = centre_of(found.B), found.gamma, found.middle
        try:
            inverse = B.inv()
        except ZeroDivisionError:
            inverse = arb_mat(m, m, [balls.UNDEFINED] * m**2)
        slope = centres([-b for b in times(inverse, gamma.slope)])
        lag = [eps * p - g for p, g in zip(slope, gamma.value)]
        target = centres([a + b for a, b in zip(middle, times(inverse, lag))])
        away = [a - q + p * half for a, q, p in zip(state.fast, target, slope)]
        size = frame.size(away)
        # |E - 1| is at most 2, and at most the integral of |B_0| over the step.
        steep = norm((frame.inverse * B * frame.matrix).entries()) * length / eps
        about, near = frame.box(size), frame.box(size * steep.min(arb(2)))
        centre = [
            q + p * half * BALL + _both(b, a + c) for q, p, b, a, c in zip(target, slope, about, away, near)
        ]
        # What epsilon w' has over B w.
        rest = [
            d + g + h - eps * p + half * BALL * (s + r)
            for d, g, h, p, s, r in zip(
                times(found.B - B, minus(centre, middle)),
                gamma.value,
                times(B, minus(target, middle)),
                slope,
                gamma.slope,
                times(B, slope),
            )
        ]
        spread = state.spread
        if frame is not state.frame:
            spread = frame.change(state.frame) * spread
        last = frame.size(rest) / found.decay
        return _FastPath(target, slope, away, centre, spread.upper(), last.upper())

    def _moved(
        self, state: Deviation, found: _Coefficients, path: _FastPath, u: list[arb], length: arb
    ) -> tuple[Deviation, arb]:
        n, m, eps, half = self.n, self.m, self.epsilon, length / 2
        ball = arb_mat(n, n, found.A.value)
        A, B, C = centre_of(ball), centre_of(found.B), centre_of(found.C)
        drift = arb_mat(n, n, found.A.slope)
        near = centres(u)
        still = [k + f for k, f in zip(found.push.value, found.phi.value)]
        rates = [k + f + a for k, f, a in zip(found.push.slope, found.phi.slope, times(drift, near))]
        still_0, rates_0 = centres(still), centres(rates)
        push = [p + c for p, c in zip(still_0, times(C, minus(path.target, found.middle)))]
        change = [p + c for p, c in zip(rates_0, times(C, path.slope))]
        # (U_0, z_0 - target - slope tau, tau, 1)' is a matrix times it.
        rows = [
            *[[*row(A, i), *row(C, i), change[i], push[i]] for i in range(n)],
            *[[*[arb(0)] * n, *(b / eps for b in row(B, i)), arb(0), arb(0)] for i in range(m)],
            [*[arb(0)] * (n + m + 1), arb(1)],
            [arb(0)] * (n + m + 2),
        ]
        size = n + m + 2
        ahead = times(
            arb_mat(size, size, [e * length for row in rows for e in row]).exp(),
            [*state.centre, *path.away, -half, arb(1)],
        )
        reached = ahead[:n]
        fast = [a + q + p * half for a, q, p in zip(ahead[n : n + m], path.target, path.slope)]
        centre, at_last = centres(reached), centres(fast)
        # |w| is E of the first, and 1 - E of the last; J is the integral of E.
        E = (-found.decay * length / eps).exp()
        J = (1 - E) * eps / found.decay
        spread = E * path.first + (1 - E) * path.last
        passed = J * path.first + (length - J) * path.last
        aside = minus(path.centre, found.middle)
        defects = [
            a + d * half * BALL + c + s - t + (r - q) * half * BALL
            for a, d, c, s, t, r, q in zip(
                times(ball - A, u),
                times(drift, minus(u, near)),
                times(found.C - C, aside),
                still,
                still_0,
                rates,
                rates_0,
            )
        ]
        growth = (log_norm([row(A, i) for i in range(n)]) * length).exp()
        forced = norm((found.C * found.frame.matrix).entries()) * passed + norm(defects) * length
        most = growth.max(arb(1)) * (state.radius + forced)
        error = (state.radius * growth + growth.max(arb(1)) * forced).upper()
        # U_0 is off the chord by |U_0''| length^2/8 at most.
        box = [b + BALL * most for b in u]
        rate = [
            a + c + s + r * half * BALL for a, c, s, r in zip(times(A, box), times(C, aside), still_0, rates_0)
        ]
        shrinking = times(B, found.frame.box(found.frame.size(path.away)))
        bends = [
            a + c + r
            for a, c, r in zip(
                times(A, rate), times(C, [p + b / eps for p, b in zip(path.slope, shrinking)]), rates_0
            )
        ]
        chord = norm(state.centre).max(norm(reached)) + norm(bends) * length * length / 8 + most
        after = Deviation(
            centre,
            (error + norm(minus(reached, centre))).upper(),
            at_last,
            (spread + found.frame.size(minus(fast, at_last))).upper(),
            found.frame,
        )
        return after, chord.upper().min(norm(u).upper())


def _both(one: arb, two: arb) -> arb:
    return one.intersection(two) if one.overlaps(two) else one


def _widened(ball: arb) -> arb:
    spread = arb(ball.rad()) * (WIDER - 1.0) + (1 + ball.abs_upper()) * arb(1e-12)
    return ball + BALL * spread
