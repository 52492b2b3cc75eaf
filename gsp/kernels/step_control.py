"""What every integrator does about its step: the first, the next stop, acceptance, rejection."""

from __future__ import annotations

import math

from gsp.kernels import integrator
from gsp.kernels.call import call
from gsp.kernels.compilation import inlined_kernel, kernel


@kernel
def all_finite(values):
    """True when no entry of `values` (n,) is NaN or infinite."""
    # Counted to the end: without a way out the loop is vectorised, and there is next to never anything to find.
    bad = 0
    for i in range(values.shape[0]):
        bad += 0 if abs(values[i]) < math.inf else 1
    return bad == 0


@kernel
def smallest_step(t):
    """Length of the shortest step from `t` that is not lost in rounding."""
    # At t = 0 there is no last place; this keeps 1/h finite.
    # 10 units in the last place of t: below this t + c h no longer tells the stages apart.
    return max((10 * 2.0**-52) * abs(t), 1e-290)


@kernel
def step_towards(stop, t, h):
    """The step to take for the proposal `h`: all that remains to `stop`, half of it, or `h` itself.

    Halving costs no step more than clipping would and leaves no crumb before the stop.
    """
    remaining = stop - t
    # Hairer stretches a step by 1 % to reach the end (DOP853, RODAS) rather than leave a crumb.
    if 1.01 * abs(h) >= abs(remaining):
        return remaining
    if 2.0 * abs(h) > abs(remaining):
        return 0.5 * remaining
    return h


@inlined_kernel
def next_step(stops, max_steps, recorded, capacity, memory, counters):
    """(code, t, step, its end, clipped, hits_stop, crosses) of the step that comes next.

    A code but GOING_ON ends the call. Of a step that crosses a jump there is no error to be told.
    """
    t = memory[integrator.TIME]
    if recorded == capacity:
        return integrator.RECORD_FULL, t, 0.0, t, False, False, False
    if counters[integrator.STEPS] + counters[integrator.REJECTED] >= max_steps:
        return integrator.TOO_MANY_STEPS, t, 0.0, t, False, False, False
    proposal = memory[integrator.STEP]
    step, t_new, clipped, hits_stop, crosses = step_ahead(stops, t, proposal, counters)
    if step == 0.0:
        return integrator.STEP_TOO_SMALL, t, step, t_new, clipped, hits_stop, crosses
    return integrator.GOING_ON, t, step, t_new, clipped, hits_stop, crosses


@inlined_kernel
def step_ahead(stops, t, proposal, counters):
    """(step, its end, clipped, hits_stop, crosses) from `t` for a `proposal`; 0 where it is lost in rounding."""
    if stops[counters[integrator.NEXT_STOP]] == t:
        counters[integrator.NEXT_STOP] += 1
    following = counters[integrator.NEXT_STOP] + 1
    stop = stops[following - 1]
    step = step_towards(stop, t, proposal)
    clipped = abs(step) < abs(proposal)
    hits_stop = step == stop - t
    crosses = hits_stop and following < stops.shape[0] and stops[following] == stop
    t_new = stop if hits_stop else t + step
    # What t really advances by, so that the record of times alone tells the steps.
    return t_new - t, t_new, clipped, hits_stop, crosses


@kernel
def initial_step(flow, t, start, end, tolerances, order, work):
    """First step, signed, from `t` towards `end`; costs one call of the field.

    Hairer, Norsett, Wanner (1993), section II.4, "starting step size" (hinit), with time in units of |y|/|y'|:
    the printed rule h^order max(|y'|, |y''|) = 0.01 mixes units, this one scales with time.
    `flow` is (field, p), `start` (y, rate), `tolerances` (rtol, atol), and `work` room for a state and a rate.
    """
    field, p = flow
    y, rate = start
    rtol, atol = tolerances
    ahead, work_rate = work
    n = y.shape[0]
    size = 0.0
    speed = 0.0
    for i in range(n):
        scale = atol + rtol * abs(y[i])
        size += (y[i] / scale) ** 2
        speed += (rate[i] / scale) ** 2
    size = math.sqrt(size / n)
    speed = math.sqrt(speed / n)
    span = abs(end - t)
    # 1e-5 and 1e-6 are Hairer's: a start at (nearly) 0 or at rest says nothing about time.
    h = 0.01 * size / speed
    if size < 1e-5 or speed * span < 1e-5 or not h > 0.0:
        h = 1e-6 * span
    h = min(h, span)
    unit = 100.0 * h
    forward = math.copysign(h, end - t)
    for i in range(n):
        ahead[i] = y[i] + forward * rate[i]
    call(field, t + forward, ahead, p, work_rate)
    bend = 0.0
    for i in range(n):
        bend += ((work_rate[i] - rate[i]) / (atol + rtol * abs(y[i]))) ** 2
    bend = math.sqrt(bend / n) / h
    steepest = max(unit * speed, unit * unit * bend)
    if not math.isfinite(steepest):
        better = 1e-3 * h
    elif steepest <= 1e-15:
        better = unit
    else:
        better = unit * (0.01 / steepest) ** (1.0 / order)
    return math.copysign(min(unit, better, span), end - t)


@kernel
def begin(flow, state, end, tolerances, order, work):
    """Fill the rate and the first step if there is none yet; False when the field is not finite at the start."""
    field, p = flow
    y, rate, memory, counters = state
    if memory[integrator.STEP] != 0.0:
        return True
    t = memory[integrator.TIME]
    call(field, t, y, p, rate)
    counters[integrator.FIELD_CALLS] += 1
    if not all_finite(rate):
        return False
    h = initial_step(flow, t, (y, rate), end, tolerances, order, work)
    memory[integrator.STEP] = math.copysign(max(abs(h), smallest_step(t)), h)
    counters[integrator.FIELD_CALLS] += 1
    return True


@kernel
def accept(t, step, clipped, hits_stop, growth, factor, memory, counters):
    """Enter an accepted step that ends at `t`; the next is `factor` times as long, where that can be told.

    `growth`, a power of the step's error, is for the next call of the method's controller.
    """
    if counters[integrator.JUST_REJECTED] == 1:
        factor = min(factor, 1.0)
    proposal = step * factor
    if clipped:
        # A step cut short for a stop says little about the next one, and must not shrink it.
        proposal = math.copysign(max(abs(proposal), abs(memory[integrator.STEP])), step)
    else:
        memory[integrator.PREVIOUS_STEP] = step
        memory[integrator.PREVIOUS_GROWTH] = growth
    memory[integrator.TIME] = t
    memory[integrator.STEP] = proposal
    counters[integrator.STEPS] += 1
    counters[integrator.JUST_REJECTED] = 0
    if hits_stop:
        counters[integrator.NEXT_STOP] += 1


@kernel
def reject(step, factor, memory, counters):
    """Enter a rejected step and shorten it; False when what is left is lost in rounding."""
    h = step * factor
    memory[integrator.STEP] = h
    counters[integrator.REJECTED] += 1
    counters[integrator.JUST_REJECTED] = 1
    return abs(h) > smallest_step(memory[integrator.TIME])
