"""Peers that compile: numbalsoda takes our machine code, diffsol a text in its language DiffSL."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy as sp
from forward import Forward
from numba import carray, cfunc, types  # pyright: ignore[reportPrivateImportUsage]
from translation import Language, translate

from gsp.comparison.peers import Peer, PeerRun, Solve
from gsp.kernels.call import call
from gsp.systems.flow import Flow

# No run of a peer takes more steps; one that would is a failure of its own.
MAX_STEPS = 1_000_000

_POINTER = types.CPointer(types.float64)
_SIGNATURE = types.void(types.float64, _POINTER, _POINTER, _POINTER)


@dataclass(frozen=True)
class NumbalsodaPeer(Peer):
    """LSODA in C++ with the field in machine code; its Jacobian is by differences (it takes no other)."""

    name = "numbalsoda LSODA"
    package = "numbalsoda"

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        import numbalsoda  # pyright: ignore[reportMissingImports]

        problem = Forward(flow, p, start, first, grid)
        states, times = np.array(start, dtype=float), problem.times_from_start
        constants = np.array(p, dtype=float)
        callback = _lsoda_callback(problem.field.address, size=len(states), length=len(constants))
        pointer, lsoda = callback.address, numbalsoda.lsoda

        def solve(rtol: float, atol: float) -> PeerRun:
            # Both must live as long as their addresses.
            assert callback is not None
            assert problem is not None
            found, is_done = lsoda(
                pointer, states, times, data=constants, rtol=rtol, atol=atol, mxstep=MAX_STEPS
            )
            if not is_done:
                raise ArithmeticError("LSODA did not reach the end")
            return PeerRun(found[1:].T)

        return solve


def _lsoda_callback(address: int, *, size: int, length: int) -> Any:
    """The field at `address`, of `size` states and `length` parameters, as LSODA calls it: `f(t, u, du, p)`.

    Its own `.address` is good for as long as it lives, and the field with it.
    """

    @cfunc(_SIGNATURE, error_model="numpy")
    def rates(t, u, du, p):
        call(address, t, carray(u, size), carray(p, length), carray(du, size))

    return rates


class _Text:
    """A term of DiffSL: 0 a sum, 1 a product, 2 a name, a number, a call or what stands in brackets."""

    def __init__(self, text: str, level: int = 2) -> None:
        self.text = text
        self.level = level

    def inside(self, level: int) -> str:
        return self.text if self.level >= level else f"({self.text})"

    def __add__(self, other: _Text) -> _Text:
        return _Text(f"{self.text} + {other.inside(1)}", 0)

    def __mul__(self, other: _Text) -> _Text:
        return _Text(f"{self.inside(1)}*{other.inside(2)}", 1)

    def __truediv__(self, other: _Text) -> _Text:
        return _Text(f"{self.inside(1)}/{other.inside(2)}", 1)

    def __neg__(self) -> _Text:
        return _Text(f"(-{self.inside(2)})")


def _called(name: str):
    return lambda *arguments: _Text(f"{name}({', '.join(a.text for a in arguments)})")


def _decimal(value: float) -> _Text:
    return _Text(repr(value) if value >= 0 else f"({value!r})")


_SINE, _COSINE = _called("sin"), _called("cos")
# Only what its compiler is known to differentiate: on others, tan among them, it ends the process.
_DIFFSL = Language(
    name="pydiffsol's DiffSL",
    number=_decimal,
    power=_called("pow"),
    root=_called("sqrt"),
    functions={
        sp.sin: _SINE,
        sp.cos: _COSINE,
        sp.tan: lambda x: _SINE(x) / _COSINE(x),
        sp.exp: _called("exp"),
        sp.log: _called("log"),
        sp.sinh: _called("sinh"),
        sp.cosh: _called("cosh"),
        sp.tanh: _called("tanh"),
        sp.asinh: _called("arcsinh"),
        sp.acosh: _called("arccosh"),
        sp.Abs: _called("abs"),
        sp.Max: _called("max"),
        sp.Min: _called("min"),
    },
)


@dataclass(frozen=True)
class DiffsolPeer(Peer):
    """A method of diffsol (Rust): the model compiled by LLVM, exact Jacobian by automatic differentiation."""

    title: str
    method: str
    matrix: str = "nalgebra_dense"
    package = "pydiffsol"

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """pydiffsol and the method."""
        return f"pydiffsol {self.title}"

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        import pydiffsol  # pyright: ignore[reportMissingImports]

        problem = Forward(flow, p, start, first, grid)
        names = {symbol: _Text(f"s{i}") for i, symbol in enumerate(flow.states)}
        rates = translate(problem.rates, states=names, language=_DIFFSL)
        begin = ",\n".join(f"{name.text} = {float(value)!r}" for name, value in zip(names.values(), start))
        ode = pydiffsol.Ode(
            f"u_i {{\n{begin}\n}}\nF_i {{\n" + ",\n".join(rate.text for rate in rates) + "\n}\n",
            matrix_type=getattr(pydiffsol, self.matrix),
            linear_solver=pydiffsol.lu,
            ode_solver=getattr(pydiffsol, self.method),
        )
        nothing, times = np.array([]), problem.times

        def solve(rtol: float, atol: float) -> PeerRun:
            ode.rtol, ode.atol = rtol, atol
            return PeerRun(np.asarray(ode.solve_dense(nothing, times).ys))

        return solve
