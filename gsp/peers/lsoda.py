"""A compiled field with the signature that LSODA's C++ translation calls: `f(t, u, du, p)`, pointers all three."""

from __future__ import annotations

from typing import Any

from numba import cfunc, types
from numba.np.numpy_support import carray

from gsp.kernels.call import call

_POINTER = types.CPointer(types.float64)
_SIGNATURE = types.void(types.float64, _POINTER, _POINTER, _POINTER)


def lsoda_callback(address: int, *, size: int, length: int) -> Any:
    """A callback around the field at `address` with `size` states and `length` parameters.

    Its own `.address` is good for as long as it lives, and the field with it.
    """

    @cfunc(_SIGNATURE, error_model="numpy")
    def rates(t, u, du, p):
        call(address, t, carray(u, size), carray(p, length), carray(du, size))

    return rates
