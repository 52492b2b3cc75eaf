"""SymPy expressions to machine code: the only file that imports both SymPy and the compiled side.

Expressions go straight to LLVM IR, without numba's front end, in milliseconds. Every compiled function has the
signature `void f(double t, double* z, double* p, double* out)` with p = (epsilon, *parameters), so that kernels
take any model, and another epsilon or parameter value compiles nothing. Symbols are looked up as objects; their
names never reach the code. Arithmetic is IEEE double without fast-math: NaN and infinity propagate.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import sympy as sp
from llvmlite import ir
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from gsp.differentiation import derivative
from gsp.errors import DeclarationError, GspError, UnsupportedFunctionError
from gsp.flow import Flow, check_epsilon
from gsp.kernels.engine import Engine, build
from gsp.kernels.evaluate import evaluate_many
from gsp.straight_line import FEWEST_STATES, Decomposition, decompose

_DOUBLE = ir.DoubleType()
_POINTER = _DOUBLE.as_pointer()
_INDEX = ir.IntType(64)
_SIGNATURE = ir.FunctionType(ir.VoidType(), [_DOUBLE, _POINTER, _POINTER, _POINTER])
_ZERO = ir.Constant(_DOUBLE, 0.0)
_ONE = ir.Constant(_DOUBLE, 1.0)
_NAN = ir.Constant(_DOUBLE, float("nan"))

# Up to here repeated squaring is faster than pow and loses a few units in the last place at most.
_LARGEST_UNROLLED_POWER = 16
# Levels of nesting that are written by recursion, three calls each.
_DEEPEST = 80


# Known to SymPy and to the C library by the same name.
_LIBRARY = {
    getattr(sp, name): name
    for name in (
        *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "erf"),
        *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    )
}
_RELATIONS = {sp.Lt: "<", sp.Le: "<=", sp.Gt: ">", sp.Ge: ">=", sp.Eq: "==", sp.Ne: "!="}


@dataclass(frozen=True, eq=False, repr=False)
class CompiledFunction:
    """Machine code for a tuple of expressions, callable from kernels by `address` and from Python by value.

    `arguments` are the symbols of z, `parameters` those of p after epsilon. The address is good for as long as
    this object lives.

    >>> x, y = sp.symbols("x y")
    >>> f = compile_function([x * y, x - y], arguments=[x, y], epsilon=None, parameters=[])
    >>> f([[2.0, 3.0], [1.0, 5.0]], [float("nan")])
    array([[ 6., -1.],
           [ 5., -4.]])
    """

    address: int
    arguments: tuple[sp.Symbol, ...]
    parameters: tuple[sp.Symbol, ...]
    outputs: int
    _engine: Engine = field(repr=False)

    def __call__(self, points: np.typing.ArrayLike, p: np.typing.ArrayLike) -> np.ndarray:
        """Values (m, outputs) at `points` (m, n), or (outputs,) at one (n,); `p` is (epsilon, *parameters).

        Raises `GspError` when a shape does not fit.
        """
        # Copies: compiled code takes writable contiguous arrays only.
        z = np.array(points, dtype=float, order="C")
        constants = np.array(p, dtype=float, order="C")
        size, length = len(self.arguments), 1 + len(self.parameters)
        if z.ndim not in (1, 2) or z.shape[-1] != size:
            raise GspError(
                f"points have shape (m, {size}) or ({size},), one column for each argument. Got {z.shape}."
            )
        if constants.shape != (length,):
            raise GspError(f"p has shape ({length},): epsilon, then the parameters. Got {constants.shape}.")
        rows = z if z.ndim == 2 else z[np.newaxis]
        out = np.empty((rows.shape[0], self.outputs))
        if out.size:
            evaluate_many(self.address, rows, constants, out)
        return out if z.ndim == 2 else out[0]

    def __repr__(self) -> str:
        names = ", ".join(symbol.name for symbol in self.arguments)
        return f"CompiledFunction(arguments=({names}), outputs={self.outputs})"


def compile_function(
    outputs: Sequence[sp.Expr],
    *,
    arguments: Sequence[sp.Symbol],
    epsilon: sp.Symbol | None,
    parameters: Sequence[sp.Symbol],
) -> CompiledFunction:
    """Compile `outputs` as functions of `arguments`, `epsilon` and `parameters`; equal calls compile once.

    Raises `UnsupportedFunctionError` for a function without machine code, `GspError` for an unknown symbol.
    """
    return _compile(
        tuple(sp.sympify(e, strict=True) for e in outputs), tuple(arguments), epsilon, tuple(parameters)
    )


@dataclass(frozen=True, eq=False, repr=False)
class CompiledFlow:
    """Machine code of a flow: addresses of its field (n,) and its Jacobian (n, n), and its observables.

    Each is compiled when first asked for, so that an explicit method never pays for the Jacobian. The addresses
    are good for as long as this object lives.
    """

    flow: Flow

    @property
    def size(self) -> int:
        """Number of states, n."""
        return len(self.flow.states)

    @property
    def field(self) -> int:
        """Address of the rates z'."""
        return self.rates.address

    @property
    def jacobian(self) -> int:
        """Address of the derivatives d z'_i/d z_j, row by row, exact."""
        return self.derivatives.address

    @cached_property
    def rates(self) -> CompiledFunction:
        """The rates as a function with n outputs."""
        return self._compiled(self.flow.rates)

    @cached_property
    def derivatives(self) -> CompiledFunction:
        """The Jacobian as a function with n*n outputs, row by row."""
        return self._compiled(
            [derivative(rate, state) for rate in self.flow.rates for state in self.flow.states]
        )

    @cached_property
    def decomposition(self) -> Decomposition | None:
        """LU decomposition for the zeros of the Jacobian, or None where the kernels' loops are as good."""
        if self.size < FEWEST_STATES:
            return None
        entries = [derivative(rate, state) != 0 for rate in self.flow.rates for state in self.flow.states]
        return decompose([entries[i : i + self.size] for i in range(0, len(entries), self.size)])

    @cached_property
    def observables(self) -> CompiledFunction:
        """The flow's observables, in their order."""
        return self._compiled(list(self.flow.observables.values()))

    @cached_property
    def constants(self) -> np.ndarray:
        """(nan, *parameter values), read-only; see `parameter_vector`."""
        values = [_nearest_double(sp.sympify(value, strict=True)) for value in self.flow.parameters.values()]
        vector = np.array([float("nan"), *values])
        vector.setflags(write=False)
        return vector

    def _compiled(self, outputs: Sequence[sp.Expr]) -> CompiledFunction:
        return compile_function(
            outputs,
            arguments=self.flow.states,
            epsilon=self.flow.epsilon,
            parameters=tuple(self.flow.parameters),
        )


def compile_flow(flow: Flow) -> CompiledFlow:
    """Compiled form of a flow; flows that are equal or differ in parameter values only share their code."""
    known = _KNOWN.get(id(flow))
    if known is not None and known[0]() is flow:
        return known[1]
    compiled = _compiled_once(flow)
    if len(_KNOWN) >= _MOST_KNOWN:
        _KNOWN.clear()
    _KNOWN[id(flow)] = weakref.ref(flow), compiled
    return compiled


@lru_cache(maxsize=1024)
def _compiled_once(flow: Flow) -> CompiledFlow:
    return CompiledFlow(flow)


# The flows asked for last, by identity: to compare two equal flows costs more than a short run.
_KNOWN: dict[int, tuple[weakref.ref[Flow], CompiledFlow]] = {}
_MOST_KNOWN = 4096


def finite_rows(values: np.ndarray) -> np.ndarray:
    """Which rows of `values` (m, ...) are finite throughout: booleans (m,)."""
    return np.asarray(np.isfinite(values).all(axis=tuple(range(1, values.ndim))))


def parameter_vector(flow: Flow, epsilon: float | None) -> np.ndarray:
    """p = (epsilon, *parameter values) for the compiled functions of `flow`, a fresh array; NaN for no epsilon.

    Raises `DeclarationError` when `epsilon` is missing, superfluous, or not finite and positive.
    """
    vector = compile_flow(flow).constants.copy()
    if flow.epsilon is None:
        if epsilon is not None:
            raise DeclarationError(
                f"this flow has no small parameter. Got epsilon={epsilon!r}. "
                "Leave epsilon out, or declare the field with one."
            )
        return vector
    if epsilon is None:
        raise DeclarationError(
            f"this flow depends on {flow.epsilon}. Got epsilon=None. Give its value, as in epsilon=0.01."
        )
    vector[0] = check_epsilon(epsilon)
    return vector


@lru_cache(maxsize=1024)
def _compile(
    outputs: tuple[sp.Expr, ...],
    arguments: tuple[sp.Symbol, ...],
    epsilon: sp.Symbol | None,
    parameters: tuple[sp.Symbol, ...],
) -> CompiledFunction:
    module = ir.Module()
    constants = (*(() if epsilon is None else ((epsilon, 0),)), *((s, 1 + i) for i, s in enumerate(parameters)))
    _Writer(module, arguments, constants).write(outputs)
    engine = build(str(module), library=tuple(_LIBRARY.values()))
    return CompiledFunction(engine.get_function_address("f"), arguments, parameters, len(outputs), engine)


class _Writer:
    """Writes one function of IR. Equal subexpressions are written once: values are kept by expression."""

    def __init__(
        self,
        module: ir.Module,
        arguments: Sequence[sp.Symbol],
        constants: Sequence[tuple[sp.Symbol, int]],
    ) -> None:
        self.module = module
        function = ir.Function(module, _SIGNATURE, "f")
        self.builder: Any = ir.IRBuilder(function.append_basic_block())
        _, z, p, self.out = function.args
        self.values: dict[sp.Basic, ir.Value] = {}
        # All loads come before any store, so that `out` may overlap the arguments.
        for i, symbol in enumerate(arguments):
            self.values[symbol] = self.builder.load(self.builder.gep(z, [ir.Constant(_INDEX, i)]))
        for symbol, i in constants:
            self.values[symbol] = self.builder.load(self.builder.gep(p, [ir.Constant(_INDEX, i)]))

    def write(self, outputs: Sequence[sp.Expr]) -> None:
        for i, expression in enumerate(outputs):
            for landing in _landings(expression):
                self.value(landing)
            value = self.value(expression)
            self.builder.store(value, self.builder.gep(self.out, [ir.Constant(_INDEX, i)]))
        self.builder.ret_void()

    def value(self, expression: sp.Basic) -> ir.Value:
        found = self.values.get(expression)
        if found is None:
            found = self.values[expression] = self._fresh(expression)
        return found

    def _fresh(self, expression: Any) -> ir.Value:
        if isinstance(expression, sp.Symbol):
            raise GspError(
                f"{expression} is no argument and no parameter. "
                f"The arguments are {', '.join(map(str, self.values)) or 'none'}."
            )
        if expression.is_Number or isinstance(expression, sp.NumberSymbol):
            return ir.Constant(_DOUBLE, _nearest_double(expression))
        if isinstance(expression, sp.Add):
            return self._sum(expression)
        if isinstance(expression, sp.Mul):
            return self._product(expression)
        if isinstance(expression, sp.Pow):
            return self._power(expression)
        if isinstance(expression, sp.Piecewise):
            return self._piecewise(expression)
        return self._function(expression)

    def _sum(self, expression: sp.Add) -> ir.Value:
        total: Any = None
        # A term with a plus sign first saves a negation.
        for term in sorted(expression.args, key=_is_negated):
            if total is not None and _is_negated(term):
                total = self.builder.fsub(total, self.value(-term))
            else:
                value = self.value(term)
                total = value if total is None else self.builder.fadd(total, value)
        return total

    def _product(self, expression: sp.Mul) -> ir.Value:
        above, below = _ONE, None
        for factor in expression.args:
            if isinstance(factor, sp.Pow) and factor.exp.is_Number and factor.exp.is_negative:
                value = self.value(sp.Pow(factor.base, -factor.exp))
                below = value if below is None else self.builder.fmul(below, value)
            elif factor is not sp.S.NegativeOne:
                value = self.value(factor)
                above = value if above is _ONE else self.builder.fmul(above, value)
        value = above if below is None else self.builder.fdiv(above, below)
        return self.builder.fneg(value) if sp.S.NegativeOne in expression.args else value

    def _power(self, expression: Any) -> ir.Value:
        base, exponent = expression.base, expression.exp
        if base.is_number or not exponent.is_Number:
            return self._general(expression)
        if exponent.is_negative:
            return self.builder.fdiv(_ONE, self.value(sp.Pow(base, -exponent)))
        if not (2 * exponent).is_Integer or exponent > _LARGEST_UNROLLED_POWER:
            return self._general(expression)
        x, k = self.value(base), int(exponent)
        result = None if exponent.is_Integer else self._call("llvm.sqrt.f64", x)
        while k:
            if k & 1:
                result = x if result is None else self.builder.fmul(result, x)
            k >>= 1
            if k:
                x = self.builder.fmul(x, x)
        return _ONE if result is None else result

    def _general(self, expression: Any) -> ir.Value:
        return self._folded(expression, lambda x, k: self._call("llvm.pow.f64", x, k))

    def _function(self, expression: sp.Basic) -> ir.Value:
        kind = expression.func
        if kind in _LIBRARY:
            return self._folded(expression, lambda *x: self._call(_LIBRARY[kind], *x))
        if kind is sp.Abs:
            return self._folded(expression, lambda x: self._call("llvm.fabs.f64", x))
        if kind is sp.sign:
            return self._step(self.value(expression.args[0]), ir.Constant(_DOUBLE, -1.0), _ZERO)
        if kind is sp.Heaviside:
            return self._step(self.value(expression.args[0]), _ZERO, self.value(expression.args[1]))
        if kind is sp.DiracDelta:
            # It comes from differentiating a jump, and is 0 but on a set that a trajectory crosses at once.
            return _ZERO
        if kind in (sp.Max, sp.Min):
            values = [self.value(argument) for argument in expression.args]
            chosen = values[0]
            for value in values[1:]:
                chosen = self._extreme(">" if kind is sp.Max else "<", chosen, value)
            return chosen
        raise UnsupportedFunctionError(
            f"there is no machine code for {kind.__name__}. Got {expression}. "
            "Write it in powers, exp, log, trigonometric and hyperbolic functions and their inverses, erf, "
            "Abs, sign, Max, Min, Heaviside and Piecewise."
        )

    def _folded(self, expression: Any, write: Callable[..., ir.Value]) -> ir.Value:
        """What `write` makes of the arguments' values; one rounded constant when they are constant."""
        values = [self.value(argument) for argument in expression.args]
        if all(isinstance(value, ir.Constant) for value in values) and expression.is_number:
            return ir.Constant(_DOUBLE, _nearest_double(expression))
        return write(*values)

    def _step(self, x: ir.Value, below: ir.Value, at_zero: ir.Value) -> ir.Value:
        """1 for x > 0, `below` for x < 0, `at_zero` at 0, NaN for NaN."""
        choose, compare = self.builder.select, self.builder.fcmp_ordered
        return choose(
            compare(">", x, _ZERO),
            _ONE,
            choose(compare("<", x, _ZERO), below, choose(compare("==", x, _ZERO), at_zero, x)),
        )

    def _extreme(self, relation: str, a: ir.Value, b: ir.Value) -> ir.Value:
        # LLVM's maxnum drops a NaN; a + b keeps it.
        chosen = self.builder.select(self.builder.fcmp_ordered(relation, a, b), a, b)
        return self.builder.select(self.builder.fcmp_unordered("uno", a, b), self.builder.fadd(a, b), chosen)

    def _piecewise(self, expression: Any) -> ir.Value:
        # Where no condition holds there is no value.
        result = _NAN
        for value, condition in reversed(expression.args):
            result = self.builder.select(self._condition(condition), self.value(value), result)
        return result

    def _condition(self, condition: Any) -> ir.Value:
        if isinstance(condition, (BooleanTrue, BooleanFalse)):
            return ir.Constant(ir.IntType(1), bool(condition))
        if isinstance(condition, sp.Not):
            return self.builder.not_(self._condition(condition.args[0]))
        if isinstance(condition, (sp.And, sp.Or)):
            join = self.builder.and_ if isinstance(condition, sp.And) else self.builder.or_
            result = self._condition(condition.args[0])
            for part in condition.args[1:]:
                result = join(result, self._condition(part))
            return result
        relation = _RELATIONS.get(condition.func)
        if relation is None:
            raise UnsupportedFunctionError(
                f"there is no machine code for the condition {condition}. "
                "Write it with <, <=, >, >=, Eq, Ne, And, Or and Not."
            )
        left, right = (self.value(side) for side in condition.args)
        return self.builder.fcmp_ordered(relation, left, right)

    def _call(self, name: str, *values: ir.Value) -> ir.Value:
        function = self.module.globals.get(name)
        if function is None:
            function = ir.Function(self.module, ir.FunctionType(_DOUBLE, [_DOUBLE] * len(values)), name)
        return self.builder.call(function, values)


def _landings(expression: sp.Expr) -> list[sp.Expr]:
    """Subexpressions, lowest first, such that between one and the next nothing is nested deeper than `_DEEPEST`.

    Horner forms of long series are nested a thousand deep, beyond what Python's stack holds.
    """
    heights: dict[sp.Basic, int] = {}
    stack: list[Any] = [expression]
    while stack:
        top = stack[-1]
        pending = [part for part in top.args if part not in heights]
        if pending:
            stack.extend(pending)
            continue
        stack.pop()
        heights[top] = 1 + max((heights[part] for part in top.args), default=0)
    arithmetic = (sp.Add, sp.Mul, sp.Pow)
    found = [e for e, height in heights.items() if height % _DEEPEST == 0 and isinstance(e, arithmetic)]
    return sorted(found, key=heights.__getitem__)


def _is_negated(term: Any) -> bool:
    return bool(term.as_coeff_Mul()[0].is_negative)


def _nearest_double(number: Any) -> float:
    """The double nearest to an exact real constant; infinite when it is beyond the largest."""
    if isinstance(number, sp.Rational):
        try:
            return float(Fraction(int(number.p), int(number.q)))
        except OverflowError:
            return float("inf") if number > 0 else float("-inf")
    # 25 digits round correctly but for a tie that no such constant is known to hit.
    value = number.evalf(25)
    if not value.is_extended_real:
        raise UnsupportedFunctionError(f"{number} is not a real number. Write the expression in real terms.")
    return float(value)
