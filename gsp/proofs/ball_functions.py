"""Expressions as straight-line programs over balls.

An expression becomes a list of ball operations, each with the registers that it reads. Constants are enclosed
exactly: a fraction is a ball about it, a decimal that was declared exactly stays exact. Functions without an
enclosure are refused by name, kinks among them: the theorems ask for smooth fields.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from typing import Any

import sympy as sp
from flint import arb, fmpq

from gsp.algebra.functions import NON_SMOOTH
from gsp.errors import UnsupportedFunctionError
from gsp.proofs import balls


class _Logistic(sp.Function):
    """1/(1 + exp(u))."""

    nargs = 1


_FUNCTIONS: dict[Any, Callable[[arb], arb]] = {
    sp.exp: balls.exp,
    sp.log: balls.log,
    sp.sin: balls.sin,
    sp.cos: balls.cos,
    sp.tanh: balls.tanh,
    sp.sinh: balls.sinh,
    sp.cosh: balls.cosh,
    sp.sech: balls.sech,
    _Logistic: balls.logistic,
    sp.atan: balls.atan,
}
_CONSTANTS = {sp.pi: arb.pi, sp.E: arb.const_e}
KNOWN = ", ".join(sorted(f.__name__ for f in _FUNCTIONS if f is not _Logistic)) + ", sqrt, tan and powers"


def without_enclosure(expression: Any, over: str) -> UnsupportedFunctionError:
    """The error for a function that no enclosure is known for, `over` balls or power series."""
    if isinstance(expression, NON_SMOOTH):
        return UnsupportedFunctionError(
            f"a function with a kink or a jump has no enclosure over {over}.",
            "Write a smooth one, as sqrt(u^2 + a^2) for abs(u), or check at samples.",
            got="abs, sign, min or max among the rates, or the derivative of one",
        )
    name = expression.func.__name__
    return UnsupportedFunctionError(
        f"{name} has no enclosure over {over}.",
        f"What is proved may hold {KNOWN}.",
        got=str(expression),
    )


class BallProgram:
    """Expressions as operations on registers, each value written once; how to write sums, products and powers is the
    subclass's, and what `functions` it has `over` its values.
    """

    functions: Mapping[Any, Callable[[Any], Any]]
    over: str

    def __init__(self, arguments: Sequence[sp.Symbol], shared: tuple[list[tuple[Any, Any]], list[Any]]) -> None:
        self.arguments = tuple(arguments)
        self._registers: list[arb | None] = [None] * len(self.arguments)
        self._code: list[tuple[int, Callable[..., Any], int, int]] = []
        self._places: dict[Any, int] = {symbol: i for i, symbol in enumerate(self.arguments)}
        replaced, reduced = shared
        for symbol, expression in replaced:
            self._places[symbol] = self._written(expression)
        self._outputs = [self._written(expression) for expression in reduced]

    def _written(self, expression: Any) -> int:
        place = self._places.get(expression)
        if place is None:
            place = self._places[expression] = self._new(expression)
        return place

    def _new(self, expression: Any) -> int:
        """What is no sum, product or power."""
        if expression.is_Rational or expression.is_Float:
            # Of a decimal the number that it holds, not what it was made from.
            value = sp.Rational(expression)
            return self._register(arb(fmpq(int(value.p), int(value.q))))
        if expression in _CONSTANTS:
            return self._register(_CONSTANTS[expression]())
        if expression.func in self.functions:
            return self._operation(self.functions[expression.func], self._written(expression.args[0]))
        if expression.is_Symbol:
            raise UnsupportedFunctionError(
                f"{expression} is no argument of this function and has no value.",
                "Give it an interval.",
                got=f"it among {', '.join(map(str, self.arguments))}",
            )
        raise without_enclosure(expression, self.over)

    def _register(self, value: arb | None) -> int:
        self._registers.append(value)
        return len(self._registers) - 1

    def _operation(self, function: Callable[..., Any], one: int, two: int = -1) -> int:
        out = self._register(None)
        self._code.append((out, function, one, two))
        return out


class BallFunction(BallProgram):
    """A tuple of expressions as a function of balls, by the order of `arguments`.

    Calling it with as many balls returns a list of balls, one for each of `outputs`. Raises
    `UnsupportedFunctionError` for a function that has no enclosure here, and for a symbol that is no argument.

    >>> x = sp.Symbol("x")
    >>> square = BallFunction([x], [x**2])
    >>> float(square([balls.exact(3)])[0].mid())
    9.0
    """

    functions, over = _FUNCTIONS, "balls"

    def __init__(self, arguments: Sequence[sp.Symbol], outputs: Sequence[sp.Expr]) -> None:
        bounded = [_bounded(e) if e.has(sp.cosh, sp.exp) else e for e in outputs]
        super().__init__(arguments, sp.cse(bounded, optimizations="basic", order="none"))

    @property
    def operations(self) -> int:
        """How many ball operations a call takes."""
        return len(self._code)

    def __call__(self, values: Sequence[arb]) -> list[arb]:
        registers: list[Any] = self._registers.copy()
        registers[: len(values)] = values
        for out, function, one, two in self._code:
            registers[out] = function(registers[one]) if two < 0 else function(registers[one], registers[two])
        return [registers[place] for place in self._outputs]

    def among(self, wanted: Sequence[int]) -> BallFunction:
        """The function with these outputs only, and no operation that none of them needs."""
        found = copy(self)
        found._outputs = [self._outputs[i] for i in wanted]
        needed, code = set(found._outputs), []
        for operation in reversed(self._code):
            if operation[0] in needed:
                needed.update(operation[2:])
                code.append(operation)
        found._code = code[::-1]
        return found

    def given(self, values: Sequence[arb | None]) -> BallFunction:
        """The function for arguments of which some are known, the others None: what hangs on those only is computed
        once. It is called with all of them.
        """
        found = copy(self)
        registers: list[Any] = [*values, *self._registers[len(values) :]]
        found._registers, found._code = registers, []
        for operation in self._code:
            out, function, one, two = operation
            if registers[one] is None or (two >= 0 and registers[two] is None):
                found._code.append(operation)
            else:
                registers[out] = (
                    function(registers[one]) if two < 0 else function(registers[one], registers[two])
                )
        return found

    # -- writing -----------------------------------------------------------------------------------

    def _new(self, expression: Any) -> int:
        if expression.is_Add:
            return self._sum(expression)
        if expression.is_Mul:
            return self._product(expression)
        if expression.is_Pow:
            return self._power(*expression.args)
        if expression.func is sp.tan:
            (argument,) = expression.args
            return self._operation(
                balls.quotient, self._written(sp.sin(argument)), self._written(sp.cos(argument))
            )
        return super()._new(expression)

    def _sum(self, expression: Any) -> int:
        total: int | None = None
        for term in expression.args:
            negative = term.could_extract_minus_sign()
            place = self._written(-term if negative else term)
            if total is None:
                total = self._operation(balls.negative, place) if negative else place
            else:
                total = self._operation(operator.sub if negative else operator.add, total, place)
        assert total is not None
        return total

    def _product(self, expression: Any) -> int:
        above, below = _fraction(expression) if expression.has(sp.exp) else expression.as_numer_denom()
        if below != 1 and above != expression:
            one, two = self._written(above), self._written(below)
            # Nothing is lost by a constant.
            exact = self._registers[two] is not None
            return self._operation(operator.truediv if exact else balls.quotient, one, two)
        coefficient, rest = expression.as_coeff_Mul()
        if coefficient == -1:
            return self._operation(balls.negative, self._written(rest))
        places = [self._written(factor) for factor in expression.args]
        product = places[0]
        for place in places[1:]:
            exact = self._registers[product] is not None or self._registers[place] is not None
            product = self._operation(operator.mul if exact else balls.product, product, place)
        return product

    def _power(self, base: Any, exponent: Any) -> int:
        if exponent.is_Integer:
            n = int(exponent)
            return self._operation(lambda ball: balls.power(ball, n), self._written(base))
        if exponent.is_Rational:
            p, q = int(exponent.p), int(exponent.q)
            return self._operation(lambda ball: balls.root_power(ball, p, q), self._written(base))
        inside = self._operation(balls.product, self._written(exponent), self._written(sp.log(base)))
        return self._operation(balls.exp, inside)


def _bounded(expression: sp.Expr) -> sp.Expr:
    """With functions that are finite over wide balls: sech(u) for 1/cosh(u), tanh(u) for sinh(u)/cosh(u), and the
    logistic function L(u) for 1/(1 + exp(u)), L(-u) for exp(u) L(u). Sums of exp(u) and exp(-u) are cosh and sinh.
    """

    def reciprocal(power: sp.Pow) -> sp.Expr:
        if power.base.func is sp.cosh:
            return sp.sech(power.base.args[0]) ** -power.exp
        constant, rest = power.base.as_coeff_Add()
        factor, function = rest.as_coeff_Mul()
        if function.func is sp.exp and all(c.is_Rational and c.is_positive for c in (constant, factor)):
            return (_Logistic(function.args[0] + sp.log(factor / constant)) / constant) ** -power.exp
        return power

    def joined(product: sp.Mul) -> sp.Expr:
        functions = {f for f in (p.as_base_exp()[0] for p in product.args) if f.func in (sp.sech, _Logistic)}
        for function in functions:
            (u,) = function.args
            for factor in product.args:
                base, power = factor.as_base_exp()
                if function.func is sp.sech and base == sp.sinh(u) and power.is_Integer and power > 0:
                    shared = min(power, product.as_powers_dict()[function])
                    product *= (sp.tanh(u) / (function * base)) ** shared
                elif function.func is _Logistic and factor.func is sp.exp and (factor.args[0] - u).is_number:
                    product *= _Logistic(-u) * sp.exp(factor.args[0] - u) / (function * factor)
        return product

    found = expression.replace(lambda e: e.is_Add and len(e.args) == 2 and e.has(sp.exp), _hyperbolic)
    found = found.replace(lambda e: e.is_Pow and e.exp.is_Integer and e.exp.is_negative, reciprocal)
    return found.replace(lambda e: e.is_Mul and e.has(sp.sech, _Logistic), joined)


def _hyperbolic(total: sp.Add) -> sp.Expr:
    """a exp(u) + b exp(c - u) as 2 (a b)^(1/2) exp(c/2) cosh(u - c/2 + log(a/b)/2), a difference as sinh."""
    (a, first), (b, second) = (term.as_coeff_Mul() for term in total.args)
    if first.func is not sp.exp or second.func is not sp.exp or (a.is_negative and b.is_negative):
        return total
    u, v = first.args[0], second.args[0]
    both = sp.expand(u + v)
    if not (a.is_Rational and b.is_Rational and both.is_number):
        return total
    size = 2 * sp.sqrt(abs(a * b)) * sp.exp(both / 2)
    w = sp.expand((u - v) / 2) + sp.log(abs(a / b)) / 2
    if a.is_positive and b.is_positive:
        return size * sp.cosh(w)
    return size * sp.sinh(w) if a.is_positive else -size * sp.sinh(w)


def _fraction(product: sp.Expr) -> tuple[sp.Expr, sp.Expr]:
    """Numerator and denominator as they are written: exp(-u) as 1/exp(u) would be a ball about 0 for a large u."""
    above, below = [], []
    for factor in sp.Mul.make_args(product):
        if factor.is_Rational:
            above.append(sp.Integer(factor.p))
            below.append(sp.Integer(factor.q))
        elif factor.is_Pow and factor.exp.is_Rational and factor.exp.is_negative:
            below.append(factor.base**-factor.exp)
        else:
            above.append(factor)
    return sp.Mul(*above), sp.Mul(*below)


def undefined_within(
    expressions: Iterable[sp.Expr], arguments: Sequence[sp.Symbol], values: Sequence[arb]
) -> sp.Expr | None:
    """The first part of the expressions, innermost first, that is not finite over balls; None where all are, or one
    has no enclosure.
    """
    for expression in expressions:
        for part in sp.postorder_traversal(expression):
            try:
                (value,) = BallFunction(arguments, [part])(values)
            except UnsupportedFunctionError:
                return None
            if not value.is_finite():
                return part
    return None
