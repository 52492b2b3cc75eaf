"""Taylor series of high order, for flows that are not stiff or barely so: one expansion a step, no stage.

The series come from code written for one flow, `gsp.lowering.steps.taylor`; there are no loops for any flow. The step
is where the last two terms meet the tolerance (Jorba and Zou 2005, section 3.2), and the end of each is checked against
the field: a series may pause, as that of 1/(1 + t^30) does, and its last terms then say nothing. An expansion to
order K counts as K calls of the field, which is about its cost.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import ledger
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.linear_algebra import norm
from gsp.kernels.step_control import accept, all_finite, begin, reject, smallest_step, step_ahead

# Places of the program behind the field's and the Jacobian's.
EXPAND = ledger.CODE
ADVANCE = ledger.CODE + 1
INTERPOLATE = ledger.CODE + 2
ORDER = ledger.CODE + 3
STRIDE = ledger.CODE + 4
# Places behind the coefficients, and how many there are.
FIRST, LAST_BUT_ONE, LAST, RTOL, ATOL, SCALE = range(6)
TAIL = 6
# What the last two terms may have of the tolerance. The terms left out, and what steps add up to, come to it.
SHARE = 0.2
THIRD = 1.0 / 3.0
# h (z' - field) at the end of a step, over the tolerance and the order. It is near K + 1 times the first term left out.
LARGEST_DEFECT = 1.0
# The last term over the first, where the first is below the tolerance.
DECREASE = 1e-2
SAFETY = 0.9
MINIMUM_FACTOR = 0.1
FAILURE_FACTOR = 0.1
OVERFLOW_FACTOR = 1e-3
# Smallest steps to look ahead when there is no step left.
BEYOND = 100.0
# A run that is out of steps is called stiff where its last one is so many fastest times long, over the order. The
# border of stability is at 0.42 to 0.48; an oscillator's steps are at 0.08 to 0.26, tight to the slackest tolerance.
STABILITY = 0.3
POWERS = 10
DIFFERENCE = 1e-7


@kernel
def _root(x, inverse_degree):
    """x^(-1/degree) for x > 0 and a degree of 4 or more, to 0.5 %, which is enough for a step.

    log2 of the mantissa and 2 to a fraction by the parabolas that are exact at both ends: the logarithm errs by
    0.01. The whole step waits for this number, and `pow` takes longer.
    """
    mantissa, exponent = math.frexp(x)
    mantissa *= 2.0
    logarithm = exponent - 1 + ((2.0 - THIRD * mantissa) * mantissa - 5.0 * THIRD)
    power = -logarithm * inverse_degree
    whole = math.floor(power)
    share = power - whole
    return math.ldexp(1.0 + share * (0.6565 + 0.3435 * share), int(whole))


@kernel
def _share(first, before, last, order):
    """The step over the scale at which neither of the last two terms exceeds 1; given the squares of three terms.

    Where the first term is below 1 the last must be smaller still: the tolerance then allows for a last term of any
    size beside the first, and so for a step beyond the radius of the series, over the border of the field's domain.
    """
    share = math.inf
    if before > 0.0:
        share = _root(before, 0.5 / (order - 1))
    # The last term is the smaller one, as a rule.
    if last > 0.0 and not last * share * share <= before:
        share = min(share, _root(last, 0.5 / order))
    if first * share * share < 1.0 and last > 0.0 and first > 0.0:
        share = min(share, _root(last / (DECREASE * DECREASE * first), 0.5 / (order - 1)))
    return share


@kernel
def _why_no_step(field, p, t, y, rate, forward, work, work_rate):
    """What ends a run whose steps are lost in rounding: where the field ends, the steps to there get ever shorter."""
    beyond = math.copysign(BEYOND * smallest_step(t), forward)
    for i in range(y.shape[0]):
        work[i] = y[i] + beyond * rate[i]
    call(field, t + beyond, work, p, work_rate)
    return ledger.STEP_TOO_SMALL if all_finite(work_rate) else ledger.NON_FINITE


@kernel
def _looks_stiff(field, p, t, y, rate, step, order):
    """Whether stability bounds `step`: it is longer than the fastest time, by the power method on differences."""
    n = y.shape[0]
    direction = rate.copy()
    point = np.empty(n)
    there = np.empty(n)
    fastest = 0.0
    for _ in range(POWERS):
        length = norm(direction)
        if not 0.0 < length < math.inf:
            return False
        distance = DIFFERENCE * max(norm(y), abs(step) * norm(rate))
        for i in range(n):
            point[i] = y[i] + distance / length * direction[i]
        call(field, t, point, p, there)
        for i in range(n):
            direction[i] = (there[i] - rate[i]) / distance
        fastest = norm(direction)
    return fastest * abs(step) > STABILITY * order


@kernel
def taylor(program, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense):
    """Advance until the last stop, a full record or a failure; see `ledger` for arguments and codes."""
    n = y.shape[0]
    order = program[ORDER]
    stride = program[STRIDE]
    tail = (order + 1) * stride
    block = np.empty(tail + TAIL)
    point = np.empty(n + 2)
    end = np.empty(2 * stride + 1)
    work = np.empty(n)
    if not begin(
        program[ledger.FIELD], p, y, rate, stops[-1], rtol, atol, order, point[:n], work, memory, counters
    ):
        return ledger.NON_FINITE
    for i in range(n):
        point[i] = y[i]
    point[n] = SHARE * rtol
    point[n + 1] = SHARE * atol
    recorded = 0
    scale = 0.0
    per_scale = 0.0
    while True:
        if recorded == times.shape[0]:
            return ledger.RECORD_FULL
        if counters[ledger.STEPS] + counters[ledger.REJECTED] >= max_steps:
            if _looks_stiff(
                program[ledger.FIELD], p, memory[ledger.TIME], y, rate, memory[ledger.PREVIOUS_STEP], order
            ):
                counters[ledger.STIFF] = 1
            counters[ledger.FIELD_CALLS] += POWERS
            return ledger.TOO_MANY_STEPS
        t = memory[ledger.TIME]
        if scale == 0.0:
            scale = memory[ledger.STEP]
            per_scale = 1.0 / scale
            call(program[EXPAND], scale, point, p, block)
            counters[ledger.FIELD_CALLS] += order
        error = math.inf
        failure = ledger.SINGULAR_JACOBIAN
        factor = FAILURE_FACTOR
        step = scale
        clipped = False
        lands = False
        t_new = t
        first, before, last = block[tail + FIRST], block[tail + LAST_BUT_ONE], block[tail + LAST]
        if first + before + last < math.inf:
            proposal = abs(scale) * _share(first, before, last, order)
            if counters[ledger.JUST_REJECTED] == 1:
                proposal = min(proposal, abs(memory[ledger.STEP]))
            proposal = math.copysign(min(proposal, abs(stops[-1] - t)), scale)
            memory[ledger.STEP] = proposal
            step, t_new, clipped, lands = step_ahead(stops, t, proposal, counters)
            if step == 0.0:
                counters[ledger.FIELD_CALLS] += 1
                return _why_no_step(program[ledger.FIELD], p, t, y, rate, scale, point[:n], work)
            call(program[ADVANCE], step * per_scale, block, p, end)
            counters[ledger.FIELD_CALLS] += 1
            failure = ledger.NON_FINITE
            # Where the state or the field is not finite, the defect is not.
            if end[2 * stride] < math.inf:
                failure = ledger.STEP_TOO_SMALL
                error = math.sqrt(end[2 * stride]) / (LARGEST_DEFECT * order)
        else:
            # The coefficients overflow, or a derivative of the field is infinite here.
            scale = 0.0
            factor = OVERFLOW_FACTOR

        if error <= 1.0:
            times[recorded] = t_new
            for i in range(n):
                value = end[i]
                states[recorded, i] = value
                point[i] = value
                y[i] = value
                rate[i] = end[stride + i]
            if recorded < dense.shape[0]:
                call(program[INTERPOLATE], step * per_scale, block, p, dense[recorded])
            recorded += 1
            accept(t_new, step, clipped, lands, 0.0, 1.0, memory, counters)
            scale = 0.0
            if counters[ledger.NEXT_STOP] == stops.shape[0]:
                return ledger.FINISHED
        else:
            if math.isfinite(error):
                factor = max(MINIMUM_FACTOR, SAFETY * error ** (-1.0 / (order + 1)))
            if not reject(step, factor, memory, counters):
                return failure
