"""The block of doubles that the driver of the Radau methods shares with the code written for one flow.

A few numbers, then rows of n: the point and its rate, the step's end and its rate, and the end's dense output in the
order of the tail of `memory`. What the code alone reads comes after that.
"""

from __future__ import annotations

# 1 if the pivots can be used; the norm of the last correction, the error of the step and of its dense output, each over
# the tolerance; the tolerances.
USABLE = 0
NORM = 1
ERROR = 2
GAP = 3
RTOL = 4
ATOL = 5
POINT = 8

# The rows that begin at POINT: the point and its rate, the end and its rate, then `stages` + 1 of the dense output.
END = 2
PIECE = 4
