"""Control of the simplified Newton iteration of the Radau methods: when it has converged, and when it will not."""

from __future__ import annotations

import math

from gsp.kernels import integrator
from gsp.kernels.compilation import kernel

# After a value that is not finite or a pivot of 0 there is no estimate; a tenth is RODAS's choice for a bad first step.
FAILURE_FACTOR = 0.1


# No round counts as contracting by less, whatever the norms of two say. Where a linear layer is most of the first, the
# ratio of the second to it is that of the layer alone, and with it the nonlinear remainder of a slow variable was
# believed to be gone: at rtol 1e-10 it was 260 tolerances, and more at tighter ones.
LEAST_CONTRACTION = 1e-3

GOING_ON, CONVERGED, DIVERGED, UNDEFINED = range(4)


@kernel
def most_rounds(stages):
    """12, 17, as in RADAU."""
    return 7 + 5 * (stages - 3) // 2


@kernel
def opening(contraction):
    """What `judge` takes before the first round, from what the step before left."""
    # A first round counts as contracting by this at best, whatever the step before did: by 1e-12 in a transient
    # where only linear terms act, and not at all in the next step, where slow variables move on and fast ones
    # follow a round late. Without it fast variables were off by up to 170 tolerances. `radau.ITERATION_SHARE`
    # is 0.002: a single round is then believed for two tolerances. With 2e-4, 7 of 2610 runs of twenty problems
    # ended 2 to 6 tolerances off and now and then one 13 to 16, as BLAS decided; now none by more than one.
    # RADAU9 takes 1 % more calls of the field for it and RADAU13 11 % fewer.
    return 0.0, 0.0, max(contraction**0.8, LEAST_CONTRACTION)


@kernel
def failure_of(verdict):
    """What is wrong with an attempt whose iteration ended so, and not by converging."""
    return integrator.NON_FINITE if verdict == UNDEFINED else integrator.STEP_TOO_SMALL


@kernel
def estimates_twice(counters):
    """Whether a large estimate is made again, (8.20): at the start, and after a step that was rejected."""
    return counters[integrator.STEPS] == 0 or counters[integrator.JUST_REJECTED] == 1


@kernel
def change_allowed(theta):
    """How many times as long the next step may be, after one in which the iteration contracted by `theta`."""
    # Steps do not grow beyond the one in which theta would be 0.2, as if theta went with the step's square, and one
    # that failed is shortened to that, by half at least. At loose tolerances the iteration is what fails: at rtol
    # 1e-2 a third of all attempts did, after steps whose error let them grow eightfold. From 0.1 to 0.3 the work is
    # the same.
    return math.sqrt(0.2 / theta)


@kernel
def judge(k, most, norm, before, tolerance):
    """What follows from the correction's `norm` in round `k` of `most`: (verdict, factor for the next attempt, now).

    `before` and `now` are (norm, rate, theta/(1 - theta)); the last is what the error is over the correction.
    """
    last_norm, last_rate, contraction = before
    shorter = FAILURE_FACTOR
    if not math.isfinite(norm):
        return UNDEFINED, FAILURE_FACTOR, before
    rate = last_rate
    if k > 1 and norm > 0.0:
        rate = norm / last_norm
        theta = rate if k == 2 else math.sqrt(rate * last_rate)
        shorter = min(0.5, max(FAILURE_FACTOR, change_allowed(theta)))
        # As in RADAU: slower than 0.99 is divergence.
        if theta >= 0.99:
            return DIVERGED, shorter, before
        foretold = theta / (1.0 - theta)
        if k < most:
            left = most - 1 - k
            if foretold * norm * theta**left >= tolerance:
                # Too slow to be done in time.
                return DIVERGED, shorter, before
        contraction = max(foretold, LEAST_CONTRACTION)
    if contraction * norm <= tolerance:
        return CONVERGED, 1.0, (norm, rate, contraction)
    return (GOING_ON if k < most else DIVERGED), shorter, (norm, rate, contraction)
