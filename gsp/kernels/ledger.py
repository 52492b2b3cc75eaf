"""What an integrator keeps between two calls, and how a call ends.

An integrator is resumable: all it knows lies in arrays of the caller's. Each one has the signature

    method(program, p, stops, rtol, atol, max_steps, y, rate, memory, counters, times, states, dense)

and advances `y` (n,), its rate `rate` (n,), `memory` (MEMORY_SIZE,) and `counters` (COUNTERS_SIZE,) in place.
Every accepted step fills one row of the record: its end in `times` (k,), its state in `states` (k, n), the
coefficients of its dense output in `dense` (k, rows, n), or nothing there when that has the shape (0, rows, n).
The record starts afresh at each call; a step starts at the row before it. `stops` (s,) are monotone, ahead of the
start, and hit exactly; the last one is the end.
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
FIELD = 0
JACOBIAN = 1
METHOD = 2
LOOPS = 3
CODE = 4
PATTERN = 5

# Codes.
RECORD_FULL = 0
FINISHED = 1
STEP_TOO_SMALL = 2
TOO_MANY_STEPS = 3
NON_FINITE = 4
SINGULAR_JACOBIAN = 5
LOOPS_WANTED = 6
# Of a run that is watched, `launch.launch_watched`.
LOOK_WANTED = 7
# None of them: the call goes on.
GOING_ON = -1

# memory: time, the step proposed next, and the last unclipped accepted step with (its error)^(-exponent).
TIME = 0
STEP = 1
PREVIOUS_STEP = 2
PREVIOUS_GROWTH = 3
MEMORY_SIZE = 4

# counters; the last four are the integrator's own.
STEPS = 0
REJECTED = 1
FIELD_CALLS = 2
JACOBIAN_CALLS = 3
DECOMPOSITIONS = 4
STIFF = 5
NEXT_STOP = 6
JUST_REJECTED = 7
STIFF_SIGNS = 8
NON_STIFF_SIGNS = 9
COUNTERS_SIZE = 10
