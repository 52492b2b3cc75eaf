"""Straight-line LU decompositions, written for the sparsity pattern of one Jacobian.

The integrators solve (shift - J) x = b many times with one pattern of zeros in J. From about eight states on,
code without a loop that touches nothing but the entries that fill in is faster than any loop, dense or sparse.
Pivots are taken from the diagonal in an order fixed beforehand (Markowitz 1957: the least fill), so that nothing is
decided at run time; where a multiplier grows beyond `LARGEST_MULTIPLIER` the code says so, and the caller falls back
to partial pivoting.

The functions have the one signature of `lowering`, `void f(double t, double* z, double* p, double* out)`:

    factorise            t = shift, z = J (n, n), finite, out = factors and a flag, 1 when they can be used
    solve                z = factors, out = b (n,), overwritten by the solution
    factorise_complex    t = Re shift, p[0] = Im shift; a complex number is a pair of doubles
    solve_complex        b as n pairs
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product
from typing import Any

from llvmlite import ir

from gsp.kernels.engine import Engine, build

# Below this many states models are many and the compiling, 30 ms a pattern and more, is not worth it; above this
# many operations it takes seconds. Neither border was tuned. A ring of 20 neurons takes 113 operations.
FEWEST_STATES = 8
MOST_OPERATIONS = 20_000
# Straight-line code pays when it does this share of the dense operations, 2 n^3/3, or less: on full patterns of 8 to
# 14 states it was still 1.7 to 2.1 times as fast in real, 0.8 to 1.5 times in complex arithmetic.
LARGEST_SHARE = 0.5
# A multiplier of this size costs so many units in the last place. Partial pivoting keeps it at 1.
LARGEST_MULTIPLIER = 1e3

_DOUBLE = ir.DoubleType()
_POINTER = _DOUBLE.as_pointer()
_INDEX = ir.IntType(64)
_SIGNATURE = ir.FunctionType(ir.VoidType(), [_DOUBLE, _POINTER, _POINTER, _POINTER])
_ZERO = ir.Constant(_DOUBLE, 0.0)
_ONE = ir.Constant(_DOUBLE, 1.0)

Pattern = tuple[tuple[bool, ...], ...]


@dataclass(frozen=True)
class Elimination:
    """Which entries Gaussian elimination meets: the pivots' `order`, and for each the rows and columns it changes.

    `rows[k]` and `columns[k]` are what is left of column and row `order[k]`; `position` numbers the entries of L
    and U as they are stored; `operations` counts multiplications and additions.
    """

    order: tuple[int, ...]
    rows: tuple[tuple[int, ...], ...]
    columns: tuple[tuple[int, ...], ...]
    position: dict[tuple[int, int], int] = field(repr=False)

    @property
    def operations(self) -> int:
        """Multiplications and additions of one decomposition."""
        return sum(len(r) * (1 + 2 * len(c)) for r, c in zip(self.rows, self.columns))


@dataclass(frozen=True)
class Decomposition:
    """Machine code for one pattern, by address; `size` doubles hold real factors and the flag behind them."""

    elimination: Elimination
    factorise: int
    solve: int
    factorise_complex: int
    solve_complex: int
    _engine: Engine = field(repr=False)

    @property
    def size(self) -> int:
        """Doubles that `factorise` fills: the entries of L and U, and the flag."""
        return len(self.elimination.position) + 1

    @property
    def code(self) -> tuple[int, int, int, int, int]:
        """What a kernel takes: the size and the four addresses."""
        return self.size, self.factorise, self.solve, self.factorise_complex, self.solve_complex


def eliminate(pattern: Sequence[Sequence[bool]]) -> Elimination:
    """The elimination with pivots on the diagonal in Markowitz's order; `pattern` (n, n) says what is not zero.

    The diagonal counts as not zero.

    >>> eliminate([[1, 1, 1], [1, 1, 0], [1, 0, 1]]).order
    (1, 0, 2)
    """
    n = len(pattern)
    below = [{i for i in range(n) if i != j and pattern[i][j]} for j in range(n)]
    right = [{j for j in range(n) if j != i and pattern[i][j]} for i in range(n)]
    order, rows, columns = [], [], []
    position: dict[tuple[int, int], int] = {}
    left = set(range(n))
    while left:
        k = min(left, key=lambda i: (len(below[i]) * len(right[i]), i))
        left.remove(k)
        order.append(k)
        rows.append(tuple(sorted(below[k])))
        columns.append(tuple(sorted(right[k])))
        for entry in ((k, k), *((i, k) for i in rows[-1]), *((k, j) for j in columns[-1])):
            position[entry] = len(position)
        for i in rows[-1]:
            right[i] = (right[i] | right[k]) - {i, k}
        for j in columns[-1]:
            below[j] = (below[j] | below[k]) - {j, k}
    return Elimination(tuple(order), tuple(rows), tuple(columns), position)


def decompose(pattern: Sequence[Sequence[bool]]) -> Decomposition | None:
    """Code for shift - J with J of this `pattern` (n, n), or None where the dense loops are as good.

    Compiled once for each pattern.
    """
    return _decompose(tuple(tuple(bool(entry) for entry in row) for row in pattern))


@lru_cache(maxsize=256)
def _decompose(pattern: Pattern) -> Decomposition | None:
    n = len(pattern)
    if n < FEWEST_STATES:
        return None
    elimination = eliminate(pattern)
    if elimination.operations > min(MOST_OPERATIONS, LARGEST_SHARE * 2 * n**3 / 3):
        return None
    module = ir.Module()
    for suffix, kind in (("", _Real), ("_complex", _Complex)):
        _write_factorise(module, "factorise" + suffix, kind, pattern, elimination)
        _write_solve(module, "solve" + suffix, kind, elimination)
    engine = build(str(module), library=())
    address = engine.get_function_address
    return Decomposition(
        elimination=elimination,
        factorise=address("factorise"),
        solve=address("solve"),
        factorise_complex=address("factorise_complex"),
        solve_complex=address("solve_complex"),
        _engine=engine,
    )


class _Real:
    """Arithmetic on single doubles."""

    def __init__(self, builder: Any) -> None:
        self.builder = builder

    def load(self, array: ir.Value, i: int) -> Any:
        return self.builder.load(self.builder.gep(array, [ir.Constant(_INDEX, i)]))

    def store(self, array: ir.Value, i: int, value: Any) -> None:
        self.builder.store(value, self.builder.gep(array, [ir.Constant(_INDEX, i)]))

    def shift(self, t: ir.Value, p: ir.Value) -> Any:
        return t

    def entry(self, jacobian: ir.Value, i: int) -> Any:
        """An entry of -J."""
        return self.builder.fneg(self.load(jacobian, i))

    def add(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a, b)

    def subtract_product(self, total: Any, a: Any, b: Any) -> Any:
        builder = self.builder
        product_ = builder.fmul(a, b)
        return builder.fneg(product_) if total is None else builder.fsub(total, product_)

    def multiply(self, a: Any, b: Any) -> Any:
        return self.builder.fmul(a, b)

    def reciprocal(self, a: Any) -> Any:
        return self.builder.fdiv(_ONE, a)

    def size(self, a: Any) -> ir.Value:
        function = self.builder.module.globals.get("llvm.fabs.f64")
        if function is None:
            function = ir.Function(self.builder.module, ir.FunctionType(_DOUBLE, [_DOUBLE]), "llvm.fabs.f64")
        return self.builder.call(function, [a])


class _Complex(_Real):
    """Arithmetic on pairs (real, imaginary)."""

    def load(self, array: ir.Value, i: int) -> Any:
        return _Real.load(self, array, 2 * i), _Real.load(self, array, 2 * i + 1)

    def store(self, array: ir.Value, i: int, value: Any) -> None:
        _Real.store(self, array, 2 * i, value[0])
        _Real.store(self, array, 2 * i + 1, value[1])

    def shift(self, t: ir.Value, p: ir.Value) -> Any:
        return t, _Real.load(self, p, 0)

    def entry(self, jacobian: ir.Value, i: int) -> Any:
        return self.builder.fneg(_Real.load(self, jacobian, i)), _ZERO

    def add(self, a: Any, b: Any) -> Any:
        return self.builder.fadd(a[0], b[0]), self.builder.fadd(a[1], b[1])

    def subtract_product(self, total: Any, a: Any, b: Any) -> Any:
        real, imaginary = self.multiply(a, b)
        builder = self.builder
        if total is None:
            return builder.fneg(real), builder.fneg(imaginary)
        return builder.fsub(total[0], real), builder.fsub(total[1], imaginary)

    def multiply(self, a: Any, b: Any) -> Any:
        builder = self.builder
        real = builder.fsub(builder.fmul(a[0], b[0]), builder.fmul(a[1], b[1]))
        return real, builder.fadd(builder.fmul(a[0], b[1]), builder.fmul(a[1], b[0]))

    def reciprocal(self, a: Any) -> Any:
        builder = self.builder
        norm = builder.fadd(builder.fmul(a[0], a[0]), builder.fmul(a[1], a[1]))
        inverse = builder.fdiv(_ONE, norm)
        return builder.fmul(a[0], inverse), builder.fneg(builder.fmul(a[1], inverse))

    def size(self, a: Any) -> ir.Value:
        # |Re| + |Im|: the modulus would cost a root.
        return self.builder.fadd(_Real.size(self, a[0]), _Real.size(self, a[1]))


def _write_factorise(module: ir.Module, name: str, kind: type, pattern: Pattern, e: Elimination) -> None:
    function = ir.Function(module, _SIGNATURE, name)
    builder: Any = ir.IRBuilder(function.append_basic_block())
    t, jacobian, p, out = function.args
    arithmetic = kind(builder)
    n = len(pattern)
    entries = {
        (i, j): arithmetic.entry(jacobian, i * n + j) for i, j in product(range(n), repeat=2) if pattern[i][j]
    }
    shift = arithmetic.shift(t, p)
    for i in range(n):
        entries[i, i] = arithmetic.add(entries[i, i], shift) if (i, i) in entries else shift
    usable: Any = ir.Constant(ir.IntType(1), 1)
    limit = ir.Constant(_DOUBLE, LARGEST_MULTIPLIER)
    for k, rows, columns in zip(e.order, e.rows, e.columns):
        inverse = entries[k, k] = arithmetic.reciprocal(entries[k, k])
        # A pivot of 0 or of no number leaves no finite inverse; where it has multipliers they show it too.
        finite = builder.fcmp_ordered("<", arithmetic.size(inverse), ir.Constant(_DOUBLE, float("inf")))
        usable = builder.and_(usable, finite)
        for i in rows:
            multiplier = entries[i, k] = arithmetic.multiply(entries[i, k], inverse)
            small = builder.fcmp_ordered("<=", arithmetic.size(multiplier), limit)
            usable = builder.and_(usable, small)
            for j in columns:
                entries[i, j] = arithmetic.subtract_product(entries.get((i, j)), multiplier, entries[k, j])
    for entry, place in e.position.items():
        arithmetic.store(out, place, entries[entry])
    flag = builder.uitofp(usable, _DOUBLE)
    width = 2 if kind is _Complex else 1
    builder.store(flag, builder.gep(out, [ir.Constant(_INDEX, width * len(e.position))]))
    builder.ret_void()


def _write_solve(module: ir.Module, name: str, kind: type, e: Elimination) -> None:
    function = ir.Function(module, _SIGNATURE, name)
    builder: Any = ir.IRBuilder(function.append_basic_block())
    _, factors, _, b = function.args
    arithmetic = kind(builder)
    x = [arithmetic.load(b, i) for i in range(len(e.order))]
    for k, rows in zip(e.order, e.rows):
        for i in rows:
            x[i] = arithmetic.subtract_product(x[i], arithmetic.load(factors, e.position[i, k]), x[k])
    for k, columns in zip(reversed(e.order), reversed(e.columns)):
        for j in columns:
            x[k] = arithmetic.subtract_product(x[k], arithmetic.load(factors, e.position[k, j]), x[j])
        x[k] = arithmetic.multiply(x[k], arithmetic.load(factors, e.position[k, k]))
    for i, value in enumerate(x):
        arithmetic.store(b, i, value)
    builder.ret_void()
