"""The nodes of an expression, bounded before SymPy is asked to build them: degrees, digits, calls in each other.

What a short text could blow up to in SymPy's hands, or by itself as 9^9^9^9 does, is refused with the place of the
operator or the function in the text.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from typing import NamedTuple, NoReturn, Protocol

import sympy as sp

from gsp.algebra.canonical import function_of, product_of, sum_of
from gsp.algebra.substitution import BITS, bits_of, is_long_power
from gsp.readers.parts import Parts
from gsp.readers.tokens import Token
from gsp.systems.declaration import DEGREE

CALLS = 120
CALL_DEPTH = 8
COST = {"sinh": 3, "cosh": 4, "tanh": 3, "sqrt": 3}
"""Weight of a call, 1 unless listed: bounded by `CALL_DEPTH` along a nesting, by `CALLS` over an expression,
where a call counts once for itself and once for each unit nested in it.

SymPy asks for signs when it builds a node, in time exponential in nested hyperbolic functions: a sum of 25
terms with four tanh in each other takes 20 s. With these numbers the worst text found takes about half a
second.
"""
EXTREMA = 12
"""SymPy compares the arguments of nested min and max pairwise: 0.3 s for 12, 6 s for 32."""
CONSTANTS = 16
"""Bound on functions and roots of numbers, each of which SymPy factors and evaluates: 1 s for 32 long roots."""
LARGEST = sp.Integer(10) ** 300
# Digits in which a sum of constants must not cancel: fewer, and 1 - tanh(14) would be refused.
CANCELLING = 25

_UNITS: frozenset[sp.Expr] = frozenset({sp.S.Zero, sp.S.One, sp.S.NegativeOne})


class ExpressionNode(NamedTuple):
    """An expression, a bound on its total degree, and the weight of the calls nested in it."""

    expression: sp.Expr
    degree: int = 0
    calls: int = 0


class Fail(Protocol):
    """What raises the error of a fact at a position of the text, with the remedy."""

    def __call__(self, fact: str, position: int, remedy: str) -> NoReturn: ...


class NodeBuilder:
    """Builds the nodes of one expression; the tallies are of all of them. What is refused is told to `fail`.

    `parts` holds what the expressions of the file have in common.
    """

    def __init__(self, fail: Fail, parts: Parts) -> None:
        self.fail = fail
        self.parts = parts
        self.calls = self.extrema = self.constants = self.bits = 0
        self._counted: set[tuple[Hashable, ...]] = set()

    def number(self, value: sp.Rational, token: Token) -> ExpressionNode:
        """A number as it is written."""
        if "e" in token.text or "E" in token.text:
            self._spend(value, token.position)
        return ExpressionNode(value)

    def negated(self, node: ExpressionNode) -> ExpressionNode:
        """Minus `node`."""
        value = node.expression
        return ExpressionNode(self.parts.once(lambda: -value, "-", value), node.degree, node.calls)

    def sum(self, terms: Sequence[ExpressionNode], position: int) -> ExpressionNode:
        """The sum of `terms`."""
        value = self._sum_value([node.expression for node in terms], position)
        return ExpressionNode(value, max(n.degree for n in terms), max(n.calls for n in terms))

    def product(self, factors: Sequence[ExpressionNode], position: int) -> ExpressionNode:
        """The product of `factors`."""
        degree = sum(node.degree for node in factors)
        self._check_degree(degree, position)
        values = [node.expression for node in factors]

        def build() -> sp.Expr:
            value = product_of(values)
            self.check_size(value.as_coeff_Mul()[0], position)
            return value

        return ExpressionNode(self.parts.once(build, "*", *values), degree, max(node.calls for node in factors))

    def inverse(self, node: ExpressionNode, operator: Token) -> ExpressionNode:
        """1/`node`, where `operator` divides by it."""
        if node.expression == 0:
            self.fail("the expression divides by zero", operator.position, "Remove the division.")
        return self.power(node, ExpressionNode(sp.Integer(-1)), operator)

    def call(
        self, function: Callable[..., sp.Expr], arguments: Sequence[ExpressionNode], token: Token
    ) -> ExpressionNode:
        """The `function` that `token` names, of `arguments`."""
        if token.text == "sqrt":
            return self.power(arguments[0], ExpressionNode(sp.Rational(1, 2)), token)
        values = [node.expression for node in arguments]
        self.extrema += len(values) == 2 and (function, *values) not in self._counted
        if self.extrema > EXTREMA:
            self.fail(f"there are more than {EXTREMA} min and max", token.position, "Simplify.")
        calls = self._count_call(function, arguments, token)
        degree = max(1, *(node.degree for node in arguments))
        if token.text == "exp":
            degree *= self._check_exponent(values[0], token.position)
            self._check_degree(degree, token.position)
        if len(values) == 2:
            self._sum_value([values[0], -values[1]], token.position)
        return ExpressionNode(self._checked(function, values, token), degree, calls)

    def power(self, base: ExpressionNode, exponent: ExpressionNode, token: Token) -> ExpressionNode:
        """`base` to the `exponent`, where `token` is the operator or the root."""
        position = token.position
        b: sp.Expr = base.expression
        e: sp.Expr = exponent.expression
        degree = base.degree + exponent.degree
        if e.is_Rational:
            if not b.free_symbols and not e.is_Integer and is_long_power(b, e):
                self.fail("the exponent of a number has too many digits", position, "Round it, or write 1/3.")
            size = _ceiling(e)
            degree = base.degree * size
            coefficient = b.as_coeff_Mul()[0]
            bits = _bits(coefficient)
            if coefficient not in _UNITS:
                # Bounded before it is computed: 9^9^9^9 has more digits than there are atoms.
                if bits * size > BITS:
                    self.fail("a power of a number is too large", position, "Use a smaller exponent.")
                self.bits += bits * size
                self._spend(sp.Integer(0), position)
        else:
            degree *= self._check_exponent(e, position)
            # SymPy works b^(c + x) out as b^c b^x.
            if b.is_Rational and b not in _UNITS and _bits(b) * _ceiling(e.as_coeff_Add()[0]) > BITS:
                self.fail("a power of a number is too large", position, "Use a smaller exponent.")
        self._check_degree(degree, position)
        if b.is_number and b.is_zero is True and not (e.is_Rational and e >= 0):
            self.fail(
                "zero is raised to a power that is not positive", position, "Remove the division by zero."
            )
        if b.is_Rational and e.is_Integer:
            return ExpressionNode(sp.Pow(b, e))
        calls = base.calls if e.is_Integer else self._count_call(sp.Pow, [base, exponent], token)
        return ExpressionNode(self._checked(sp.Pow, [b, e], token), max(1, degree), calls)

    def _count_call(
        self, function: Callable[..., sp.Expr], arguments: Sequence[ExpressionNode], token: Token
    ) -> int:
        """Weight of the calls nested in this one, itself included; an operator counts as a root.

        A call that stands in several places, as behind a definition, is built once and counts once.
        """
        cost = COST["sqrt"] if token.kind == "operator" else COST.get(token.text, 1)
        nested = max(node.calls for node in arguments)
        calls = cost + nested
        key = (function, *(node.expression for node in arguments))
        self.calls += 0 if key in self._counted else cost * (1 + nested)
        self._counted.add(key)
        if self.calls > CALLS:
            self.fail(
                f"there are more than {CALLS} functions (roots, hyperbolic and nested ones count more)",
                token.position,
                "Simplify, or use more states.",
            )
        if calls > CALL_DEPTH:
            self.fail(
                "functions and roots stand too deep in each other",
                token.position,
                "Simplify, or make the inner one a state of its own.",
            )
        return calls

    def _sum_value(self, terms: list[sp.Expr], position: int) -> sp.Expr:
        return self.parts.once(lambda: self._new_sum(terms, position), "+", *terms)

    def _new_sum(self, terms: list[sp.Expr], position: int) -> sp.Expr:
        """The sum, unless its constants cancel to nothing: SymPy would try to prove that they do."""
        value = sum_of(terms)
        constants = [term for term in sp.Add.make_args(value) if term.is_number]
        if any(not term.is_Rational for term in constants):
            sizes = [self._evaluated(term, position, digits=CANCELLING + 5) for term in constants]
            if abs(sum(sizes)) <= sp.Float(10) ** -CANCELLING * sum(abs(size) for size in sizes):
                self.fail("a sum of constants cancels up to rounding", position, "Write 0 in its place.")
        self.check_size(sp.Add.make_args(value)[0], position)
        return value

    def _checked(self, function: Callable[..., sp.Expr], arguments: list[sp.Expr], token: Token) -> sp.Expr:
        """The `function` of `arguments`, once it is known to be real and finite where it is a constant."""
        return self.parts.once(lambda: self._new(function, arguments, token), function, *arguments)

    def _new(self, function: Callable[..., sp.Expr], arguments: list[sp.Expr], token: Token) -> sp.Expr:
        if all(argument.is_number for argument in arguments):
            self.constants += 1
            if self.constants > CONSTANTS:
                self.fail(
                    f"there are more than {CONSTANTS} functions, roots and divisions of constants",
                    token.position,
                    "Work them out, or declare parameters.",
                )
        try:
            value = function_of(function, arguments)
        # AttributeError: SymPy's cache stumbles over the message of a TypeError.
        except (ArithmeticError, AttributeError, NotImplementedError, TypeError, ValueError) as error:
            reason = "" if isinstance(error, AttributeError) else f" ({error})"
            self.fail(
                f"{token.text!r} cannot be worked out here{reason}", token.position, "Correct its argument."
            )
        if not self.parts.is_real(value):
            self.fail(f"{token.text!r} is not real and finite here", token.position, "Correct its argument.")
        if value.is_number and not value.is_Rational:
            self._evaluated(value, token.position)
        return value

    def _evaluated(self, constant: sp.Expr, position: int, *, digits: int = 15) -> sp.Expr:
        try:
            value = constant.evalf(digits)
        except ZeroDivisionError:
            self.fail("a constant cannot be told from a division by 0", position, "Rescale the variables.")
        if not (value.is_Float or value.is_Rational):
            self.fail("a constant is not a real number", position, "Keep roots and logarithms in their domain.")
        if value != 0 and not 1 / LARGEST < abs(value) < LARGEST:
            self.fail("a constant lies beyond 1e300 or below 1e-300", position, "Rescale the variables.")
        return value

    def _check_exponent(self, exponent: sp.Expr, position: int) -> int:
        """Bound on the power hidden in `exponent`: SymPy turns exp(9*log(x)) into x^9 unasked."""
        if not exponent.free_symbols and abs(self._evaluated(exponent, position)) > 690:
            self.fail("an exponential is too large for a double", position, "Rescale the variables.")
        largest = 1
        for term in sp.Add.make_args(exponent):
            if term.has(sp.log):
                largest = max(largest, _ceiling(term.as_coeff_Mul()[0]))
        return largest

    def _check_degree(self, degree: int, position: int) -> None:
        if degree > DEGREE:
            self.fail(
                f"powers and products reach a total degree above {DEGREE}", position, "Use smaller exponents."
            )

    def check_size(self, number: sp.Expr, position: int) -> None:
        """Refuse a rational number of too many digits."""
        if _bits(number) > BITS:
            self.fail("a number worked out to more than 1200 digits", position, "Round it, or rescale.")

    def _spend(self, number: sp.Rational, position: int) -> None:
        """Count digits that an exponent made, so that many large powers are refused as one is."""
        self.bits += 2 * _bits(number)
        if self.bits > 4 * BITS:
            self.fail(
                "the expression holds too many large powers of numbers", position, "Rescale the variables."
            )


def _bits(number: sp.Expr) -> int:
    """Bits of the larger of numerator and denominator; 0 for what is no rational number."""
    return bits_of(number) if isinstance(number, sp.Rational) else 0


def _ceiling(number: sp.Expr) -> int:
    """The magnitude of a rational number, rounded up; 1 for what is none."""
    return -(-abs(int(number.p)) // int(number.q)) if isinstance(number, sp.Rational) else 1
