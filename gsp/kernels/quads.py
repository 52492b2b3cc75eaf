"""Four complex numbers side by side: what one vector instruction does to all of them.

A quad is eight doubles of a flat array, four real parts and then four imaginary ones; quad number i begins at 8 i.
numba makes vectors of long loops only, so that products of quads are written as operations on vectors of four, which
LLVM cuts to the width that the processor has. Each is rounded as four single products are.
"""

from __future__ import annotations

import math
from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic

from gsp.kernels.compilation import kernel
from gsp.kernels.sparse_systems import AT

QUAD = 8
LANES = 4


def _multiplying(is_subtracted: bool) -> Any:
    def typed(typing_context, x, i, u, j, v, k):
        signature = types.void(x, types.intp, u, types.intp, v, types.intp)

        def generate(context, builder, signature, arguments):
            vector = ir.VectorType(ir.DoubleType(), LANES)

            def parts(place):
                """Where the real and the imaginary parts of an argument are."""
                array, index = arguments[2 * place : 2 * place + 2]
                data = context.make_array(signature.args[2 * place])(context, builder, array).data
                first = builder.mul(index, ir.Constant(index.type, QUAD))
                starts = first, builder.add(first, ir.Constant(index.type, LANES))
                return [builder.bitcast(builder.gep(data, [at]), vector.as_pointer()) for at in starts]

            target = parts(0)
            a, b, c, d = (builder.load(part, align=8) for place in (1, 2) for part in parts(place))
            real = builder.fsub(builder.fmul(a, c), builder.fmul(b, d))
            imaginary = builder.fadd(builder.fmul(a, d), builder.fmul(b, c))
            for part, value in zip(target, (real, imaginary)):
                whole = builder.fsub(builder.load(part, align=8), value) if is_subtracted else value
                builder.store(whole, part, align=8)
            return context.get_dummy_value()

        return signature, generate

    return intrinsic(typed)


multiply: Any = _multiplying(False)
"""multiply(x, i, u, j, v, k): quad i of `x` becomes the product of quad j of `u` and quad k of `v`."""
subtract_product: Any = _multiplying(True)
"""subtract_product(x, i, u, j, v, k): that product is subtracted from quad i of `x`."""


@kernel
def copy(x, i, v, k):
    """Quad i of `x` becomes quad k of `v`."""
    for m in range(QUAD):
        x[AT(QUAD * i + m)] = v[AT(QUAD * k + m)]


@kernel
def size(v, k):
    """The sum of all |Re| and |Im| of a quad."""
    total = 0.0
    for m in range(QUAD * k, QUAD * (k + 1)):
        total += abs(v[AT(m)])
    return total


@kernel
def invert(v, k):
    """Quad k of `v` becomes its inverse: False if one is 0 or not finite, as of what is too large to be squared."""
    usable = True
    for m in range(QUAD * k, QUAD * k + LANES):
        a, b = v[m], v[m + LANES]
        scale = 1.0 / (a * a + b * b)
        v[m], v[m + LANES] = a * scale, -b * scale
        usable = usable and 0.0 < abs(v[m]) + abs(v[m + LANES]) < math.inf
    return usable
