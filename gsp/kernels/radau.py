"""Radau IIA with 5 or 7 stages, for stiff flows: orders 9 and 13, L-stable.

Hairer, Wanner II, section IV.8, and the paper named in `radau_tableau`: simplified Newton iteration, transformed to
one real and (stages - 1)/2 complex systems of n unknowns; collocation polynomials as first guess and as dense output.
The Jacobian is that of the guess at one of the last stages, `radau_tableau.LINEARISED`, not of the step's start, and so
nearer to those of all stages: the iteration contracts faster.

The driver's contract in `integrator` holds with additions. The number of stages is that of the rows of `dense`, and
`memory` has `memory_size(stages, n)` entries: the tail keeps what the next step starts from.
"""

from __future__ import annotations

import math

import numpy as np

from gsp.kernels import integrator
from gsp.kernels.addresses import call_collocation_loops
from gsp.kernels.call import call
from gsp.kernels.compilation import kernel
from gsp.kernels.radau_block import (
    ATOL,
    CODE_SIZE,
    CONTRACTION,
    END,
    ERROR,
    GAP,
    LENGTH,
    LINES,
    NORM,
    POINT,
    RTOL,
    USABLE,
    lines_of,
    width_of,
)
from gsp.kernels.radau_iteration import (
    CONVERGED,
    FAILURE_FACTOR,
    GOING_ON,
    change_allowed,
    estimates_twice,
    failure_of,
    judge,
    most_rounds,
    opening,
)
from gsp.kernels.sparse_systems import pattern_of
from gsp.kernels.step_control import accept, begin, next_step, reject

# Control of the step as in RADAU: change between 1/5 and 8, estimate of local order stages + 1. Its safety is 0.9: with
# 0.75 fewer steps are rejected, and on the stiff problems of `benchmarks` an error takes 1 to 8 % less work.
SAFETY = 0.75
MINIMUM_FACTOR = 0.2
MAXIMUM_FACTOR = 8.0
ROUNDING = 10 * 2.0**-52

# The estimate is O(h^(s+1)) for s stages, the error of the dense output O(h^(s+2)), that of a step O(h^(2s)). A
# step is controlled with rtol^TRANSFORM in place of rtol, which brings the dense output to the tolerance and the
# end below it: on five stiff problems at rtol 1e-4 to 1e-12 to 1.4 and 0.03 times rtol in geometric mean. RADAU's
# 0.1 rtol^((s+1)/(2s)) cares for the end alone. A factor of 0.3 before the power gained nothing at equal cost.
TRANSFORM = np.array([6.0 / 7.0, 8.0 / 9.0])


@kernel
def _control(rtol, atol, stages):
    """(rtol, atol, tolerance of the iteration, share of the gap) for a number of stages."""
    family = (stages - 5) // 2
    controlled = rtol ** TRANSFORM[family]
    # The iteration ends where its error is lost beside the tolerance asked for, or in rounding.
    # At 0.02 of what is asked for the steps' errors, all of one sign, outweigh those of the collocation.
    tolerance = max(ROUNDING / controlled, min(0.03, 0.002 * rtol / controlled))
    # What is foreseen of the polynomial's error is too large, since the series falls off faster. With this
    # share what is read between the steps meets the tolerance on linear problems with rates of 1e2 to 1e8 and
    # forcing that grows, decays or turns, and three times that on twenty stiff ones. With 0.07 some are off by
    # 2 and 10, with 0.02 by 26 and 36.
    return controlled, atol * controlled / rtol, tolerance, 0.1 * controlled / rtol


@kernel
def _keep_what_falls(memory, step, n, stages):
    """Leave of the last step's polynomial, for each state, a cubic and what further terms are smaller each than the one
    before at the end of a long `step`.

    At loose tolerances they often are not: a guess that is far off leads the iteration nowhere. Out of a transient,
    where steps grow eightfold, they are.
    """
    far = step / memory[LENGTH]
    for i in range(n):
        line = LINES + i * width_of(stages)
        falls = True
        for k in range(2, stages):
            growth = far if k % 2 == 0 else 1.0 + far
            falls = falls and abs(memory[line + k]) * growth <= abs(memory[line + k - 1])
            if not falls:
                memory[line + k] = 0.0


@kernel
def _attempt_by_code(flow, step, stages, state, control, block):
    """`radau_loops.attempt_by_loops` by the flow's own code, the functions of `lowering.steps.collocation` on `block`.

    Where the pivots cannot be used or something is not finite it says so by `integrator.NON_FINITE`.
    """
    program, p = flow
    _, _, memory, counters = state
    _, _, tolerance, gap_share = control
    begin_code = program[integrator.CODE]
    round_code = program[integrator.CODE + 1]
    call(begin_code, step, memory, p, block)
    if block[USABLE] != 1.0:
        return math.inf, 0, FAILURE_FACTOR, integrator.NON_FINITE
    most = most_rounds(stages)
    now = opening(memory[CONTRACTION])
    verdict = GOING_ON
    factor = FAILURE_FACTOR
    rounds = 0
    while verdict == GOING_ON:
        rounds += 1
        call(round_code, step, memory, p, block)
        verdict, factor, now = judge(rounds, most, block[NORM], now, tolerance)
    counters[integrator.FIELD_CALLS] += rounds * stages
    if verdict != CONVERGED:
        return math.inf, rounds, factor, failure_of(verdict)
    call(program[integrator.CODE + 2], step, memory, p, block)
    counters[integrator.FIELD_CALLS] += 1
    if block[ERROR] >= 1.0 and estimates_twice(counters):
        call(program[integrator.CODE + 3], step, memory, p, block)
        counters[integrator.FIELD_CALLS] += 1
    error = max(block[ERROR], gap_share * block[GAP])
    if not math.isfinite(error):
        return math.inf, rounds, FAILURE_FACTOR, integrator.NON_FINITE
    memory[CONTRACTION] = now[2]
    return error, rounds, 1.0, integrator.STEP_TOO_SMALL


@kernel
def radau(flow, stops, control, state, record):
    """Advance until the last stop, a full record or a failure; see `integrator` for arguments and codes."""
    program, p = flow
    rtol, atol, max_steps = control
    y, rate, memory, counters = state
    times, states, dense = record
    field = program[integrator.FIELD]
    stages = dense.shape[1]
    n = y.shape[0]
    lines = lines_of(n)
    width = width_of(stages)
    coded = program[integrator.CODE] != 0
    size = lines + n * width
    if coded:
        size = max(size, program[integrator.CODE + CODE_SIZE - 1])
    # At the start of a cache line, so that no vector lies in two.
    padded = np.empty(size + 7)
    skipped = -(padded.ctypes.data // 8) % 8
    block = padded[skipped : skipped + size]
    equations = (field, program[integrator.JACOBIAN], pattern_of(program), p)
    end = POINT + END * n

    if memory[CONTRACTION] == 0.0:
        memory[CONTRACTION] = 1.0
    controlled = _control(rtol, atol, stages)
    block[RTOL], block[ATOL] = controlled[0], controlled[1]
    exponent = -1.0 / (stages + 1)
    # Gustafsson's memory never falls below this (RADAU).
    largest_growth = 1e-2**exponent
    most = most_rounds(stages)
    work = block[POINT : POINT + n]
    work_rate = block[end : end + n]
    if not begin((field, p), state, stops[-1], controlled[:2], stages, (work, work_rate)):
        return integrator.NON_FINITE
    for i in range(n):
        block[POINT + i] = y[i]
        block[POINT + n + i] = rate[i]
    recorded = 0
    while True:
        code, _, step, t_new, clipped, hits_stop, crosses = next_step(
            stops, max_steps, recorded, times.shape[0], memory, counters
        )
        if code != integrator.GOING_ON:
            return code

        # A step more than this many times as long as the last is guessed from those terms of the last one's
        # polynomial that fall where it ends; see `_keep_what_falls`.
        if abs(step) > 2.0 * abs(memory[LENGTH]):
            _keep_what_falls(memory, step, n, stages)
        counters[integrator.JACOBIAN_CALLS] += 1
        counters[integrator.DECOMPOSITIONS] += 1
        error = math.inf
        rounds = 0
        factor = FAILURE_FACTOR
        failure = integrator.NON_FINITE
        field_calls = counters[integrator.FIELD_CALLS]
        if coded:
            error, rounds, factor, failure = _attempt_by_code(flow, step, stages, state, controlled, block)
        if failure == integrator.NON_FINITE:
            # The loops pivot, and say what is wrong where that does not help.
            if program[integrator.LOOPS] == 0:
                counters[integrator.JACOBIAN_CALLS] -= 1
                counters[integrator.DECOMPOSITIONS] -= 1
                counters[integrator.FIELD_CALLS] = field_calls
                return integrator.LOOPS_WANTED
            error, rounds, factor, failure = call_collocation_loops(
                program[integrator.LOOPS], equations, step, stages, state, controlled, block
            )
        safety = SAFETY * (2 * most + 1) / (2 * most + rounds)

        if error <= 1.0 or (crosses and error < math.inf):
            times[recorded] = t_new
            for i in range(n):
                states[recorded, i] = y[i] = block[end + i]
                rate[i] = block[end + n + i]
            if recorded < dense.shape[0]:
                for k in range(stages):
                    for i in range(n):
                        dense[recorded, k, i] = block[lines + i * width + k]
            if coded:
                call(program[integrator.CODE + 4], step, memory, p, block)
            else:
                memory[LENGTH] = step
                for k in range(n * width):
                    memory[LINES + k] = block[lines + k]
            recorded += 1
            factor = MAXIMUM_FACTOR
            growth = largest_growth
            if error > 0.0:
                growth = error**exponent
                factor = safety * growth
                previous = memory[integrator.PREVIOUS_STEP]
                if previous != 0.0 and not clipped:
                    # Gustafsson's predictive controller, (8.25).
                    trend = growth / memory[integrator.PREVIOUS_GROWTH]
                    factor = min(factor, SAFETY * growth * (step / previous) * trend)
            if rounds > 1:
                theta = memory[CONTRACTION] / (1.0 + memory[CONTRACTION])
                factor = min(factor, change_allowed(theta))
            factor = min(MAXIMUM_FACTOR, max(MINIMUM_FACTOR, factor))
            accept(t_new, step, clipped, hits_stop, min(growth, largest_growth), factor, memory, counters)
            if t_new == stops[-1]:
                return integrator.FINISHED
        else:
            if math.isfinite(error):
                factor = max(MINIMUM_FACTOR, safety * error**exponent)
            if not reject(step, factor, memory, counters):
                return failure
