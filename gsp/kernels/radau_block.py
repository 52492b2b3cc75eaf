"""The block of doubles that the driver of the Radau methods shares with the code written for one flow.

A few numbers, then rows of n, then the dense output of the attempt: for each state a line of `width_of(stages)`, the
coefficients and after them the rise. What the code alone reads comes after that. The tail of the driver's `memory`
holds the iteration's last theta/(1 - theta), the length of the last step, and such lines for that.
"""

from __future__ import annotations

from gsp.kernels import integrator
from gsp.kernels.compilation import kernel

# Entries of the kernel's program that are the step's code: five functions and the size of the block.
CODE_SIZE = 6

# 1 if the pivots can be used; the norm of the last correction, the error of the step and of its dense output, each over
# the tolerance; the tolerances.
USABLE, NORM, ERROR, GAP, RTOL, ATOL = range(6)
POINT = 8
# The rows that begin at POINT: the point and its rate, the end and its rate, the tolerances inverted, the estimate.
END = 2
WEIGHT = 4
ESTIMATE = 5
ROWS = 6

CONTRACTION = integrator.MEMORY_SIZE
LENGTH = CONTRACTION + 1
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
