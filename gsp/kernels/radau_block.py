"""The block of doubles that the driver of the Radau methods shares with the code written for one flow.

A few numbers, then rows of n, then the dense output of the attempt: for each state a line of `width_of(stages)`, the
coefficients and after them the rise. What the code alone reads comes after that. The tail of the driver's `memory`
holds the iteration's last theta/(1 - theta), the number of stages and for how many steps it has been that, the length
of the last step, and such lines for that.
"""

from __future__ import annotations

from gsp.kernels import ledger
from gsp.kernels.compilation import kernel

# Entries of the kernel's program for one number of stages: five functions and the size of the block.
CODE_SIZE = 6

# 1 if the pivots can be used; the norm of the last correction, the error of the step and of its dense output, each over
# the tolerance; the tolerances.
USABLE = 0
NORM = 1
ERROR = 2
GAP = 3
RTOL = 4
ATOL = 5
POINT = 8
# The rows that begin at POINT: the point and its rate, the end and its rate, the tolerances inverted, the estimate.
END = 2
WEIGHT = 4
ESTIMATE = 5
ROWS = 6

CONTRACTION = ledger.MEMORY_SIZE
STAGES = CONTRACTION + 1
AGE = STAGES + 1
LENGTH = AGE + 1
LINES = LENGTH + 1


@kernel
def width_of(stages):
    """Doubles of a line: the power of 2 above the number of stages."""
    return 4 if stages == 3 else 8


@kernel
def lines_of(n):
    """Where the lines begin in the block, at a multiple of 8."""
    return (POINT + ROWS * n + 7) // 8 * 8


def memory_size(stages: int, n: int) -> int:
    """Entries of `memory` for `n` states."""
    return LINES + n * width_of.py_func(stages)


@kernel
def change_stages(memory, n, stages):
    """Go on with another number of `stages`: lines are rewritten, higher coefficients being 0 or left out."""
    before = int(memory[STAGES])
    width, new = width_of(before), width_of(stages)
    for j in range(n):
        # From the side that is not overwritten.
        i = j if new <= width else n - 1 - j
        rise = memory[LINES + i * width + before]
        for q in range(stages):
            k = q if new <= width else stages - 1 - q
            memory[LINES + i * new + k] = memory[LINES + i * width + k] if k < before else 0.0
        memory[LINES + i * new + stages] = rise
    memory[STAGES] = stages
    memory[AGE] = 0.0
    # Of another controller.
    memory[ledger.PREVIOUS_STEP] = 0.0
