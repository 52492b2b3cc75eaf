"""Points of the slow manifold by the zero-derivative principle, one after another.

Order m is y with d^(m+1) y/dtau^(m+1) = 0 along the flow (Gear, Kaper, Kevrekidis and Zagaris 2005; Zagaris,
Gear, Kaper and Kevrekidis 2009: its error is O(epsilon^(m+1))). One jet with tangents at y gives the Newton step
to the solution of every order at once, so that orders are compared at no further cost.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels.addresses import call_jet
from gsp.kernels.compilation import inlined_kernel, kernel
from gsp.kernels.linear_algebra import factorise, norm, solve

CONVERGED, NOT_CONVERGED, NON_FINITE, ILL_CONDITIONED = range(4)

# Newton's method: a step below ROUNDING, relative to 1 + |y|, changes nothing; after one below QUADRATIC the
# next would be below rounding.
ROUNDING = 4e-16
QUADRATIC = 1e-9
# Beyond this the Jacobian's digits in one fast direction are lost under another's: fast rates l and L apart lead
# to (L/l)^(m+1), and what Newton's method then takes for a solution is none.
CONDITION = 1e13
# Iterations after which the highest order is halved and Newton's method starts again: far past optimal truncation
# high orders may have no solution near M0.
PATIENCE = 8


@inlined_kernel
def _jet(flow, x, y, order, v, d):
    call_jet(flow[0], flow[1:], x, y, order, v, d)


@kernel
def _jacobian(d, slow, m, matrix, pivots):
    """LU factors of d(y^(m+1))/dy."""
    n = matrix.shape[0]
    for i in range(n):
        for j in range(n):
            matrix[i, j] = d[j, slow + i, m + 1]
    return factorise(matrix, pivots)


@kernel
def _condition(d, slow, m, factors, pivots, column):
    """Largest diagonal entry of |J^-1| |J|, which does not depend on the units of y."""
    n = factors.shape[0]
    if n == 1:
        return 1.0
    largest = 0.0
    total = np.zeros(n)
    for k in range(n):
        for i in range(n):
            column[i] = 1.0 if i == k else 0.0
        solve(factors, pivots, column)
        for i in range(n):
            total[i] += abs(column[i]) * abs(d[i, slow + k, m + 1])
    for i in range(n):
        # Written so that what is not a number stays.
        if not (total[i] <= largest or math.isnan(largest)):
            largest = total[i]
    return largest


@kernel
def _newton(v, slow, m, matrix, pivots, step):
    n = matrix.shape[0]
    for i in range(n):
        step[i] = -v[slow + i, m + 1]
    solve(matrix, pivots, step)


@kernel
def _move(y, step):
    """Add the step, cut to length 1 + |y|; returns its full length over 1 + |y|."""
    scale = 1.0 + norm(y)
    length = norm(step) / scale
    factor = 1.0 if length <= 1.0 else 1.0 / length
    for i in range(y.shape[0]):
        y[i] += factor * step[i]
    return length


@kernel
def _remainder(length):
    """What Newton's method may still be off after its last step, which rounding ended unless it was short."""
    return 0.0 if length <= QUADRATIC else length


@kernel
def _climb(flow, x, y, order, v, d, newton):
    """One Newton step each at the orders 1, 3, 7, ... well below `order`: each squares the error before it."""
    slow = flow[-1]
    matrix, pivots, step = newton
    m = 1
    while m < 0.6 * order:
        _jet(flow, x, y, m + 1, v, d)
        if not _jacobian(d, slow, m, matrix, pivots):
            return
        if not _condition(d, slow, m, matrix, pivots, step) <= CONDITION:
            return
        _newton(v, slow, m, matrix, pivots, step)
        _move(y, step)
        m = 2 * m + 1


@kernel
def at_order(flow, xs, ys, order, errors, codes):
    """Overwrite the starts `ys` (m, n_fast) by the points of one order; `errors` by the change to the next.

    `flow` is (jet, tape, constants, rates, epsilon, slow): the address of `jets.flow_jet_with_tangents`, which both
    ways to the points call, and what that takes first. Returns the number of jets computed, with tangents and without.
    """
    fast, slow, symbols = ys.shape[1], flow[-1], flow[1].shape[0]
    v = np.empty((symbols, order + 3))
    d = np.empty((fast, symbols, order + 3))
    no_tangents = d[:0]
    matrix = np.empty((fast, fast))
    pivots = np.empty(fast, dtype=np.int64)
    step = np.empty(fast)
    following = np.empty(fast)
    full = 0
    plain = 0
    for point in range(xs.shape[0]):
        x = xs[point]
        y = ys[point]
        _climb(flow, x, y, order, v, d, (matrix, pivots, step))
        codes[point] = NOT_CONVERGED
        errors[point] = math.nan
        previous = math.inf
        change = math.inf
        fresh = True
        for _ in range(25):
            if fresh:
                _jet(flow, x, y, order + 2, v, d)
                full += 1
                if _jacobian(d, slow, order + 1, matrix, pivots):
                    _newton(v, slow, order + 1, matrix, pivots, following)
                else:
                    following[0] = math.nan
                if not _jacobian(d, slow, order, matrix, pivots):
                    codes[point] = NON_FINITE
                    break
                if not _condition(d, slow, order, matrix, pivots, step) <= CONDITION:
                    codes[point] = ILL_CONDITIONED
                    break
            else:
                _jet(flow, x, y, order + 1, v, no_tangents)
                plain += 1
            _newton(v, slow, order, matrix, pivots, step)
            if fresh:
                for i in range(fast):
                    following[i] -= step[i]
                change = norm(following)
            length = _move(y, step)
            if not math.isfinite(length):
                codes[point] = NON_FINITE
                break
            # The step is as long as its rounding when it no longer shrinks with a Jacobian of this very point. A chord
            # step is followed by one that is shorter in the same ratio.
            if (
                length <= ROUNDING
                or (not fresh and length * length <= ROUNDING * previous)
                or (fresh and length <= QUADRATIC)
                or (fresh and 0.5 * previous < length < 1e-6)
            ):
                codes[point] = CONVERGED
                errors[point] = change + (_remainder(length) + ROUNDING) * (1.0 + norm(y))
                break
            # A chord step that is not this much shorter than the one before wants a new Jacobian.
            fresh = length > 0.02 * previous or length > 1e-4
            previous = length
        if codes[point] != CONVERGED:
            for i in range(fast):
                y[i] = math.nan
    return full, plain


@kernel
def to_tolerance(flow, xs, ys, tolerance, largest, orders, errors, codes):
    """Overwrite the starts `ys` by the points of the lowest order whose estimated error is below `tolerance`.

    The estimate is the larger of the changes to the next order and on to the one after it: a single term that
    happens to vanish says nothing. Where it starts to grow first, the order of its least value is taken (optimal
    truncation). Returns the number of jets computed, all with tangents.
    """
    fast, slow, symbols = ys.shape[1], flow[-1], flow[1].shape[0]
    v = np.empty((symbols, largest + 4))
    d = np.empty((fast, symbols, largest + 4))
    matrix = np.empty((fast, fast))
    pivots = np.empty(fast, dtype=np.int64)
    steps = np.empty((largest + 3, fast))
    difference = np.empty(fast)
    changes = np.empty(largest + 2)
    begin = np.empty(fast)
    full = 0
    for point in range(xs.shape[0]):
        x = xs[point]
        y = ys[point]
        # Orders looked at first, when the order is to be chosen.
        top = min(8, largest)
        limit = largest
        for i in range(fast):
            begin[i] = y[i]
        _climb(flow, x, y, top, v, d, (matrix, pivots, steps[0]))
        codes[point] = NOT_CONVERGED
        errors[point] = math.nan
        previous = math.inf
        for iteration in range(5 * PATIENCE):
            if iteration > 0 and iteration % PATIENCE == 0:
                limit = max(1, top // 2)
                top = limit
                previous = math.inf
                for i in range(fast):
                    y[i] = begin[i]
            _jet(flow, x, y, top + 3, v, d)
            full += 1
            scale = 1.0 + norm(y)
            known = 0
            for m in range(top + 3):
                if not _jacobian(d, slow, m, matrix, pivots):
                    break
                if not _condition(d, slow, m, matrix, pivots, difference) <= CONDITION:
                    break
                _newton(v, slow, m, matrix, pivots, steps[m])
                if not math.isfinite(norm(steps[m])):
                    break
                known += 1
            if known < 3:
                codes[point] = NON_FINITE
                break
            for m in range(known - 1):
                for i in range(fast):
                    difference[i] = steps[m + 1, i] - steps[m, i]
                changes[m] = norm(difference)
            chosen = 0
            error = math.inf
            met = False
            last = math.inf
            for m in range(known - 1):
                if m + 1 < known - 1:
                    last = max(changes[m], changes[m + 1])
                elif known == top + 3:
                    break
                else:
                    last = changes[m]
                if last < error:
                    error = last
                    chosen = m
                if error <= tolerance * scale:
                    met = True
                    break
            length = _move(y, steps[chosen])
            if not math.isfinite(length):
                codes[point] = NON_FINITE
                break
            # Orders past the smallest change are looked at until it has grown by this much.
            if not met and known == top + 3 and top < limit and last < 30.0 * error:
                top = min(2 * top, limit)
                continue
            if length <= QUADRATIC or length <= 1e-3 * error or 0.5 * previous < length < 1e-6:
                codes[point] = CONVERGED
                orders[point] = chosen
                errors[point] = error + (_remainder(length) + ROUNDING) * scale
                break
            previous = length
        if codes[point] != CONVERGED:
            orders[point] = -1
            for i in range(fast):
                y[i] = math.nan
    return full
