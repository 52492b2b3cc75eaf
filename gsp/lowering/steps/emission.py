"""SymPy expressions to values in LLVM's intermediate code: one number, or several side by side in a vector.

Expressions go straight to IR, without numba's front end, in milliseconds. Symbols are looked up as objects; their
names never reach the code. Arithmetic is IEEE double without fast-math: NaN and infinity propagate.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

import sympy as sp
from llvmlite import ir
from sympy.codegen.cfunctions import expm1, log1p
from sympy.logic.boolalg import BooleanFalse, BooleanTrue

from gsp.algebra.bounded_quotients import Written, bounded
from gsp.errors import GspError, UnsupportedFunctionError
from gsp.lowering.instructions import landings
from gsp.lowering.steps.arithmetic import intrinsic
from gsp.lowering.steps.elementary import exponential, sine_and_cosine
from gsp.lowering.steps.values import DOUBLE, constant, lane, spread

_ZERO = ir.Constant(DOUBLE, 0.0)
_ONE = ir.Constant(DOUBLE, 1.0)
_NAN = ir.Constant(DOUBLE, float("nan"))


# Known to SymPy and to the C library by the same name.
_KNOWN = {log1p: "log1p", expm1: "expm1"} | {
    getattr(sp, name): name
    for name in (
        *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "erf"),
        *("sinh", "cosh", "tanh", "asinh", "acosh", "atanh"),
    )
}
# The functions of the C library that the code may call.
LIBRARY = tuple(_KNOWN.values())
_RELATIONS = {sp.Lt: "<", sp.Le: "<=", sp.Gt: ">", sp.Ge: ">=", sp.Eq: "==", sp.Ne: "!="}


class Emitter:
    """Writes expressions at the builder's place: `values` holds the states' values, doubles or vectors of `width`.

    Equal subexpressions are written once: values are kept by expression. `constants`, doubles by expression, are the
    same in every lane; what follows from them alone is added to it, so that emitters that share it in a function
    share that. Code with `constants` runs often: to divide by such a value is to multiply by its inverse, and sin, cos
    and exp are computed in place, within four units in the last place, and exp(-u) from exp(u) where that is known.
    Functions of the C library are called for the first `used` lanes, all by default, and are 0 in the others.
    """

    def __init__(
        self,
        builder: Any,
        values: Mapping[sp.Symbol, Any],
        *,
        constants: dict[sp.Basic, Any] | None = None,
        width: int = 0,
        used: int | None = None,
    ) -> None:
        self.builder = builder
        self.width = width
        self.used = width if used is None else used
        self._values: dict[sp.Basic, Any] = dict(values)
        self._constants = constants
        self._written: dict[sp.Basic, Written] = {}
        self._angles: dict[sp.Basic, tuple[Any, Any]] = {}
        known = (*values, *(e for e in constants or () if isinstance(e, sp.Symbol)))
        self._symbols = ", ".join(map(str, known)) or "none"

    def write(self, expressions: Sequence[sp.Expr]) -> list[Any]:
        """The values of `expressions`, doubles where they are the same in every lane.

        Raises `UnsupportedFunctionError` for a function without machine code, `GspError` for an unknown symbol.
        """
        for landing in landings(*expressions):
            self._value(landing)
        return [self._value(expression) for expression in expressions]

    def _value(self, expression: sp.Basic) -> Any:
        found = self._values.get(expression)
        if found is None and self._constants is not None:
            found = self._constants.get(expression)
        if found is None:
            found = self._fresh(expression)
            if self._constants is not None and self._is_constant(expression):
                self._constants[expression] = found
            else:
                self._values[expression] = found
        return found

    def _is_constant(self, expression: sp.Basic) -> bool:
        known = self._constants
        return known is not None and all(part in known or part.is_number for part in expression.args)

    def _alike(self, *values: Any) -> tuple[Any, ...]:
        """The values, those of one lane copied into all if another has many."""
        if not self.width or not any(isinstance(value.type, ir.VectorType) for value in values):
            return values
        return tuple(
            value if isinstance(value.type, ir.VectorType) else spread(self.builder, value, self.width)
            for value in values
        )

    def _two(self, operation: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
        return operation(*self._alike(a, b))

    def _fresh(self, expression: Any) -> Any:
        if isinstance(expression, sp.Symbol):
            raise GspError(
                f"{expression} is no argument and no parameter.", f"The arguments are {self._symbols}."
            )
        if expression.is_Number or isinstance(expression, sp.NumberSymbol):
            return constant(nearest_double(expression))
        if isinstance(expression, sp.Add):
            return self._sum(expression)
        if (found := bounded(expression, self._written)) is not expression:
            return self._value(found)
        if isinstance(expression, sp.Mul):
            return self._product(expression)
        if isinstance(expression, sp.Pow):
            return self._power(expression)
        if isinstance(expression, sp.Piecewise):
            return self._piecewise(expression)
        return self._function(expression)

    def _sum(self, expression: sp.Add) -> Any:
        total: Any = None
        # A term with a plus sign first saves a negation.
        negated = {term: is_negated(term) for term in expression.args}
        for term in sorted(expression.args, key=negated.__getitem__):
            if total is not None and negated[term]:
                total = self._two(self.builder.fsub, total, self._value(-term))
            else:
                value = self._value(term)
                total = value if total is None else self._two(self.builder.fadd, total, value)
        return total

    def _product(self, expression: sp.Mul) -> Any:
        above: Any = None
        below: Any = None
        for factor in expression.args:
            if factor is sp.S.NegativeOne:
                continue
            divided = isinstance(factor, sp.Pow) and factor.exp.is_Number and factor.exp.is_negative
            if divided and not (self._constants is not None and self._is_constant(factor)):
                value = self._value(sp.Pow(factor.base, -factor.exp))
                below = value if below is None else self._two(self.builder.fmul, below, value)
            else:
                value = self._value(factor)
                above = value if above is None else self._two(self.builder.fmul, above, value)
        above = _ONE if above is None else above
        value = above if below is None else self._two(self.builder.fdiv, above, below)
        return self.builder.fneg(value) if sp.S.NegativeOne in expression.args else value

    def _power(self, expression: Any) -> Any:
        base, exponent = expression.base, expression.exp
        if base.is_number or not exponent.is_Number:
            return self._general(expression)
        if exponent.is_negative:
            return self._two(self.builder.fdiv, _ONE, self._value(sp.Pow(base, -exponent)))
        # Up to here repeated squaring is faster than pow and loses a few units in the last place at most.
        if not (2 * exponent).is_Integer or exponent > 16:
            return self._general(expression)
        x, k = self._value(base), int(exponent)
        result = None if exponent.is_Integer else intrinsic(self.builder, "sqrt", x)
        while k:
            if k & 1:
                result = x if result is None else self.builder.fmul(result, x)
            k >>= 1
            if k:
                x = self.builder.fmul(x, x)
        return _ONE if result is None else result

    def _general(self, expression: Any) -> Any:
        return self._folded(expression, lambda x, k: intrinsic(self.builder, "pow", *self._alike(x, k)))

    def _function(self, expression: sp.Basic) -> Any:
        kind = expression.func
        if kind in (sp.sin, sp.cos, sp.exp) and self._constants is not None:
            return self._folded(expression, lambda x: self._elementary(kind, expression.args[0], x))
        if kind in _KNOWN:
            return self._folded(expression, lambda *x: self._call(_KNOWN[kind], *x))
        if kind is sp.Abs:
            return self._folded(expression, lambda x: intrinsic(self.builder, "fabs", x))
        if kind is sp.sign:
            return self._step(self._value(expression.args[0]), constant(-1.0), _ZERO)
        if kind is sp.Heaviside:
            return self._step(self._value(expression.args[0]), _ZERO, self._value(expression.args[1]))
        if kind is sp.DiracDelta:
            # It comes from differentiating a jump, and is 0 but on a set that a trajectory crosses at once.
            return _ZERO
        if isinstance(expression, (sp.Max, sp.Min)):
            values = [self._value(argument) for argument in expression.args]
            chosen = values[0]
            for value in values[1:]:
                chosen = self._extreme(">" if isinstance(expression, sp.Max) else "<", chosen, value)
            return chosen
        raise UnsupportedFunctionError(
            f"there is no machine code for {kind.__name__}.",
            "Write it in powers, exp, log, trigonometric and hyperbolic functions and their inverses, erf, "
            "Abs, sign, Max, Min, Heaviside and Piecewise.",
            got=expression,
        )

    def _elementary(self, kind: type, argument: sp.Basic, x: Any) -> Any:
        """sin, cos or exp of the value `x` of `argument`; the first two are had together."""
        if kind is sp.exp:
            inverse = self._values.get(sp.exp(-argument))
            if inverse is not None:
                return self._two(self.builder.fdiv, _ONE, inverse)
            return exponential(self.builder, x, self._call)
        if argument not in self._angles:
            self._angles[argument] = sine_and_cosine(self.builder, x, self._call)
        return self._angles[argument][0 if kind is sp.sin else 1]

    def _folded(self, expression: Any, write: Callable[..., Any]) -> Any:
        """What `write` makes of the arguments' values; one rounded constant when they are constant."""
        values = [self._value(argument) for argument in expression.args]
        if all(isinstance(value, ir.Constant) for value in values) and expression.is_number:
            return constant(nearest_double(expression))
        return write(*values)

    def _step(self, x: Any, below: Any, at_zero: Any) -> Any:
        """1 for x > 0, `below` for x < 0, `at_zero` at 0, NaN for NaN."""
        choice = self._select(self._compare("==", x, _ZERO), at_zero, x)
        choice = self._select(self._compare("<", x, _ZERO), below, choice)
        return self._select(self._compare(">", x, _ZERO), _ONE, choice)

    def _extreme(self, relation: str, a: Any, b: Any) -> Any:
        # LLVM's maxnum drops a NaN; a + b keeps it.
        chosen = self._select(self._compare(relation, a, b), a, b)
        a, b = self._alike(a, b)
        return self._select(self.builder.fcmp_unordered("uno", a, b), self.builder.fadd(a, b), chosen)

    def _compare(self, relation: str, a: Any, b: Any) -> Any:
        a, b = self._alike(a, b)
        return self.builder.fcmp_ordered(relation, a, b)

    def _select(self, condition: Any, yes: Any, no: Any) -> Any:
        return self.builder.select(*self._alike(condition, yes, no))

    def _piecewise(self, expression: Any) -> Any:
        # Where no condition holds there is no value.
        result: Any = _NAN
        for value, condition in reversed(expression.args):
            result = self._select(self._condition(condition), self._value(value), result)
        return result

    def _condition(self, condition: Any) -> Any:
        if isinstance(condition, (BooleanTrue, BooleanFalse)):
            return ir.Constant(ir.IntType(1), bool(condition))
        if isinstance(condition, sp.Not):
            return self.builder.not_(self._condition(condition.args[0]))
        if isinstance(condition, (sp.And, sp.Or)):
            join = self.builder.and_ if isinstance(condition, sp.And) else self.builder.or_
            result = self._condition(condition.args[0])
            for part in condition.args[1:]:
                result = self._two(join, result, self._condition(part))
            return result
        relation = _RELATIONS.get(condition.func)
        if relation is None:
            raise UnsupportedFunctionError(
                f"there is no machine code for the condition {condition}.",
                "Write it with <, <=, >, >=, Eq, Ne, And, Or and Not.",
            )
        left, right = (self._value(side) for side in condition.args)
        return self._compare(relation, left, right)

    def _call(self, name: str, *values: Any) -> Any:
        """The value of a function of the C library, lane by lane."""
        values = self._alike(*values)
        function = self.builder.module.globals.get(name)
        if function is None:
            function = ir.Function(self.builder.module, ir.FunctionType(DOUBLE, [DOUBLE] * len(values)), name)
            # No one reads errno: a value that is needed twice is computed once.
            function.attributes.add("readnone")
        if values[0].type == DOUBLE:
            return self.builder.call(function, values)
        result: Any = spread(self.builder, _ZERO, self.width)
        for i in range(self.used):
            each = self.builder.call(function, [self.builder.extract_element(v, lane(i)) for v in values])
            result = self.builder.insert_element(result, each, lane(i))
        return result


def is_negated(term: Any) -> bool:
    number = term.args[0] if term.is_Mul else term
    # SymPy deduces all that may be known of a number before it says its sign.
    return number.p < 0 if number.is_Rational else bool(number.is_Number and number.is_negative)


def nearest_double(number: Any) -> float:
    """The double nearest to an exact real constant; infinite when it is beyond the largest, nan for SymPy's nan."""
    if number is sp.nan:
        return float("nan")
    if isinstance(number, sp.Rational):
        try:
            return float(Fraction(int(number.p), int(number.q)))
        except OverflowError:
            return float("inf") if number > 0 else float("-inf")
    # 25 digits round correctly but for a tie that no such constant is known to hit.
    value = number.evalf(25)
    if not value.is_extended_real:
        raise UnsupportedFunctionError(f"{number} is not a real number.", "Write the expression in real terms.")
    return float(value)
