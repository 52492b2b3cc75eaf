"""What an integrator keeps between two calls, and how a call ends.

An integrator is resumable: all it knows lies in arrays of the caller's. Each one has the signature

    method((program, p), stops, (rtol, atol, max_steps), (y, rate, memory, counters), (times, states, dense))

and advances `y` (n,), its rate `rate` (n,), `memory` (MEMORY_SIZE,) and `counters` (COUNTERS_SIZE,) in place.
Every accepted step fills one row of the record: its end in `times` (k,), its state in `states` (k, n), the
coefficients of its dense output in `dense` (k, rows, n), or nothing there when that has the shape (0, rows, n).
The record starts afresh at each call; a step starts at the row before it. `stops` (s,) are monotone, ahead of the
start, and hit exactly; the last one is the end. To one that stands twice leads a step over a jump: it is
taken whatever its error, which no shorter one would lessen.
The code that comes back is one of those below. Before the first call `memory[TIME]` and `y` hold the start, all
else is 0. `program` (k,) holds addresses: the field, its Jacobian or 0 for a method that asks for none, the method
itself, by which `launch`, `landing` and `ensemble` call it, its loops for any flow or 0, and what `gsp.lowering.steps`
wrote of the method for this flow, or 0. Behind a 0 there the pattern of a sparse Jacobian may follow, as
`sparse_systems` says: its function then gives the entries of the pattern alone, in place of n*n.

A written step that finds a pivot that it cannot use, or something that is not finite, leaves it to the loops; where
their address is 0 the call ends with LOOPS_WANTED, as if the step had not been tried, and goes on once the address is
there. A method may keep more in a longer `memory`, as `radau_block.memory_size` says for the Radau methods.
"""

from __future__ import annotations

# program.
FIELD, JACOBIAN, METHOD, LOOPS, CODE, PATTERN = range(6)

# Codes.
(
    RECORD_FULL,
    FINISHED,
    STEP_TOO_SMALL,
    TOO_MANY_STEPS,
    NON_FINITE,
    SINGULAR_JACOBIAN,
    LOOPS_WANTED,
    # Of a run that is watched, `launch.launch_watched`.
    LOOK_WANTED,
) = range(8)
# None of them: the call goes on.
GOING_ON = -1

# memory: time, the step proposed next, and the last unclipped accepted step with (its error)^(-exponent).
TIME, STEP, PREVIOUS_STEP, PREVIOUS_GROWTH, MEMORY_SIZE = range(5)

# counters; the last four are the integrator's own.
(
    STEPS,
    REJECTED,
    FIELD_CALLS,
    JACOBIAN_CALLS,
    DECOMPOSITIONS,
    STIFF,
    NEXT_STOP,
    JUST_REJECTED,
    STIFF_SIGNS,
    NON_STIFF_SIGNS,
    COUNTERS_SIZE,
) = range(11)
