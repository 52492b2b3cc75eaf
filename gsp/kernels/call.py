"""Calling a compiled field by its address."""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.extending import intrinsic


def _call(typing_context, address, t, z, p, out):
    """Run `void f(double t, double* z, double* p, double* out)` at `address`; the arrays are contiguous."""
    signature = types.void(types.int64, types.float64, z, p, out)

    def generate(context, builder, signature, arguments):
        double = ir.DoubleType()
        pointer = double.as_pointer()
        function_type = ir.FunctionType(ir.VoidType(), [double, pointer, pointer, pointer])
        function = builder.inttoptr(arguments[0], function_type.as_pointer())
        data = [
            context.make_array(kind)(context, builder, array).data
            for kind, array in zip(signature.args[2:], arguments[2:])
        ]
        builder.call(function, [arguments[1], *data])
        return context.get_dummy_value()

    return signature, generate


# Typed as Any because kernels see call(address, t, z, p, out), without the typing context.
call: Any = intrinsic(_call)
