"""Which decomposition a kernel uses: the dense loops, or straight-line code for the Jacobian's pattern of zeros.

`code` is None for the loops, or the tuple (size, factorise, solve, factorise_complex, solve_complex) of
`straight_line.Decomposition`: the type decides when a kernel is compiled, so that the loops pay nothing. With code, a
matrix whose fixed pivots cannot be trusted falls back to the loops, with partial pivoting: `pivots[0]`, the loops'
first row, is SPARSE where the code's factors are in use.
"""

from __future__ import annotations

from typing import Any

from numba import njit, types
from numba.extending import overload

from gsp.kernels.call import call
from gsp.kernels.linear_algebra import factorise_inline, solve_inline
from gsp.kernels.shape import sizes

SPARSE = -1


def factors_size(code) -> Any:
    """Doubles that the code's real factors take, flag included; 0 for the loops."""
    raise NotImplementedError("for compiled code only")


def factorise_sparse(code, jacobian_flat, shift, scratch, sparse) -> Any:
    """Factors of the real `shift` - J into `sparse` (size,), and whether they can be used; False without code."""
    raise NotImplementedError("for compiled code only")


def factorise_sparse_pair(code, jacobian_flat, shift, scratch, sparse) -> Any:
    """The same for a complex `shift`, into pairs `sparse` (2 size,)."""
    raise NotImplementedError("for compiled code only")


def solve_with(code, sparse, factors, pivots, b, shape) -> Any:
    """Overwrite `b` (n,) by the solution, with the factors that `pivots[0]` says."""
    raise NotImplementedError("for compiled code only")


def solve_sparse_pair(code, sparse, pairs, b) -> Any:
    """Overwrite the complex `b` (n,) by the solution with the code's factors; `pairs` (2n,) is scratch."""
    raise NotImplementedError("for compiled code only")


@overload(factors_size)
def _factors_size(code):
    if isinstance(code, types.BaseTuple):
        return lambda code: code[0]
    return lambda code: 0


@overload(factorise_sparse)
def _factorise_sparse(code, jacobian_flat, shift, scratch, sparse):
    if not isinstance(code, types.BaseTuple):
        return lambda code, jacobian_flat, shift, scratch, sparse: False

    def run(code, jacobian_flat, shift, scratch, sparse):
        call(code[1], shift, jacobian_flat, scratch, sparse)
        return sparse[code[0] - 1] == 1.0

    return run


@overload(factorise_sparse_pair)
def _factorise_sparse_pair(code, jacobian_flat, shift, scratch, sparse):
    if not isinstance(code, types.BaseTuple):
        return lambda code, jacobian_flat, shift, scratch, sparse: False

    def run(code, jacobian_flat, shift, scratch, sparse):
        scratch[0] = shift.imag
        call(code[3], shift.real, jacobian_flat, scratch, sparse)
        return sparse[2 * (code[0] - 1)] == 1.0

    return run


@overload(solve_with)
def _solve_with(code, sparse, factors, pivots, b, shape):
    if not isinstance(code, types.BaseTuple):
        return lambda code, sparse, factors, pivots, b, shape: solve_inline(factors, pivots, b, shape)

    def run(code, sparse, factors, pivots, b, shape):
        if pivots[0] == SPARSE:
            call(code[2], 0.0, sparse, sparse, b)
        else:
            solve_inline(factors, pivots, b, shape)

    return run


@overload(solve_sparse_pair)
def _solve_sparse_pair(code, sparse, pairs, b):
    if not isinstance(code, types.BaseTuple):
        return lambda code, sparse, pairs, b: None

    def run(code, sparse, pairs, b):
        for i in range(b.shape[0]):
            pairs[2 * i] = b[i].real
            pairs[2 * i + 1] = b[i].imag
        call(code[4], 0.0, sparse, sparse, pairs)
        for i in range(b.shape[0]):
            b[i] = complex(pairs[2 * i], pairs[2 * i + 1])

    return run


@njit(cache=True, error_model="numpy", nogil=True, forceinline=True)
def decompose_with(code, jacobian_flat, shift, sparse, scratch, factors, pivots, shape):
    """Factors of `shift` - J, by the code where there is one and its pivots can be trusted; False when singular."""
    _, n = sizes(shape)
    if factorise_sparse(code, jacobian_flat, shift, scratch, sparse):
        pivots[0] = SPARSE
        return True
    for i in range(n):
        for j in range(n):
            factors[i, j] = -jacobian_flat[i * n + j]
        factors[i, i] += shift
    return factorise_inline(factors, pivots, shape)
