"""Calls of a kernel between the expressions of a compiled function, for what has no code of bearable length."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import sympy as sp
from llvmlite import ir

from gsp.kernels.compilation import address_of
from gsp.kernels.fast_determinants import KERNELS, SIGNATURE
from gsp.lowering.steps.emission import Emitter
from gsp.lowering.steps.values import DOUBLE, WHOLE, load, store


@dataclass(frozen=True)
class Call:
    """A kernel of `gsp.kernels.fast_determinants` by its name, over a fixed `pattern`.

    It takes the values of the expressions `given` and finds those of the symbols `results`.
    """

    kernel: str
    pattern: tuple[int, ...]
    given: tuple[sp.Expr, ...]
    results: tuple[sp.Symbol, ...]


def write_calls(builder: Any, calls: Sequence[Call], values: Mapping[sp.Symbol, Any]) -> dict[sp.Symbol, Any]:
    """`values`, and those of the results of `calls`, one after the other."""
    known = dict(values)
    for number, call in enumerate(calls):
        kind = ir.ArrayType(WHOLE, len(call.pattern))
        pattern: Any = ir.GlobalVariable(builder.module, kind, f"pattern{number}")
        pattern.global_constant = True
        pattern.linkage = "private"
        pattern.initializer = ir.Constant(kind, list(call.pattern))
        # On the stack: the same code runs on several threads.
        given, results = (builder.alloca(DOUBLE, size) for size in (len(call.given), len(call.results)))
        for i, value in enumerate(Emitter(builder, known).write(call.given)):
            store(builder, value, given, i)
        arguments = [builder.bitcast(pattern, WHOLE.as_pointer()), given, results]
        signature = ir.FunctionType(ir.VoidType(), [value.type for value in arguments])
        address = ir.Constant(WHOLE, address_of(KERNELS[call.kernel], SIGNATURE))
        builder.call(builder.inttoptr(address, signature.as_pointer()), arguments)
        known |= {symbol: load(builder, results, i) for i, symbol in enumerate(call.results)}
    return known
