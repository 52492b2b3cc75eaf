"""Arrays that a kernel uses without counting the references to them.

numba counts each view of an array up and down by atomic instructions, which were a third of the time of a short run. An
array that Python holds for the length of a call need not be counted within it, nor any view of it.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.extending import intrinsic

from gsp.kernels.compilation import inlined_kernel


def _uncounted(typing_context, array):
    def generate(context, builder, signature, arguments):
        result = context.make_array(array)(context, builder, arguments[0])
        # What has no owner is not counted.
        for part in ("meminfo", "parent"):
            setattr(result, part, ir.Constant(getattr(result, part).type, None))
        return result._getvalue()

    return array(array), generate


# Typed as Any because kernels see uncounted(array), without the typing context. Never an array made in compiled code,
# which would be freed behind its last use by its own name.
uncounted: Any = intrinsic(_uncounted)
"""The same array, without its owner."""


@inlined_kernel
def uncounted_record(record):
    """The (times, states, dense) of a record, each uncounted."""
    times, states, dense = record
    return uncounted(times), uncounted(states), uncounted(dense)
