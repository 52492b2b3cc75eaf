"""The grammar of model files: text from a stranger to a SymPy expression, built node by node.

    sum     := product (("+" | "-") product)*
    product := signed (("*" | "/") signed)*
    signed  := ("+" | "-")* power
    power   := atom (("^" | "**") signed)?                  right associative; -x^2 is -(x^2)
    atom    := number | "pi" | name | function "(" sum ("," sum)* ")" | "(" sum ")"

Text never reaches `eval`, `sympify` or `parse_expr`, and no `Symbol` is made from it: names come from the
caller. Numbers stay exact rationals. What a short text could blow up to is bounded before SymPy is asked to
build it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import islice
from typing import NamedTuple, NoReturn

import sympy as sp

from gsp.algebra.substitution import BITS, bits_of, is_long_power
from gsp.errors import ModelFileError, nearest
from gsp.readers.tokens import NumberError, Token, fail_at, parse_number, tokenise
from gsp.systems.declaration import DEGREE

CHARACTERS = 10_000
DEPTH = 100
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
WRITTEN = 20_000
"""Bound on the symbols of an expression with its definitions written out: a few lines can double ten times over."""
ALL_WRITTEN, ALL_CALLS = 400_000, 10_000
"""The same for all expressions of a file that use definitions, and their weighted calls."""
LARGEST = sp.Integer(10) ** 300
# Digits in which a sum of constants must not cancel: fewer, and 1 - tanh(14) would be refused.
CANCELLING = 25

FUNCTIONS: Mapping[str, tuple[int, Callable[..., sp.Expr]]] = {
    "sin": (1, sp.sin),
    "cos": (1, sp.cos),
    "tan": (1, sp.tan),
    "asin": (1, sp.asin),
    "acos": (1, sp.acos),
    "atan": (1, sp.atan),
    "sinh": (1, sp.sinh),
    "cosh": (1, sp.cosh),
    "tanh": (1, sp.tanh),
    "asinh": (1, sp.asinh),
    "acosh": (1, sp.acosh),
    "atanh": (1, sp.atanh),
    "exp": (1, sp.exp),
    "log": (1, sp.log),
    "ln": (1, sp.log),
    "sqrt": (1, sp.sqrt),
    "abs": (1, sp.Abs),
    "sign": (1, sp.sign),
    "min": (2, sp.Min),
    "max": (2, sp.Max),
}
RESERVED = frozenset(FUNCTIONS) - {"ln"} | {"pi"}
"""Words of the grammar, which cannot be names of states or parameters; `ln`, the second name of log, can."""

_UNITS: frozenset[sp.Expr] = frozenset({sp.S.Zero, sp.S.One, sp.S.NegativeOne})
_SUM, _PRODUCT, _POWER = 1, 2, 3
_BINDING = {"+": _SUM, "-": _SUM, "*": _PRODUCT, "/": _PRODUCT, "^": _POWER, "**": _POWER}


class Definition(NamedTuple):
    """A named expression or function of a model file: its `head` as written, its arguments, its text and words."""

    head: str
    arguments: tuple[str, ...]
    text: str
    tokens: tuple[Token, ...]


class Definitions(dict[str, Definition]):
    """The definitions of one file by name, and what all expressions together have made of them."""

    def __init__(self, *given: Mapping[str, Definition]) -> None:
        super().__init__(*given)
        self.written = self.calls = 0

    def spend(self, written: int, calls: int) -> None:
        """Count the symbols and functions of an expression with definitions; raise beyond what a file may have."""
        self.written += written
        self.calls += calls
        if self.written > ALL_WRITTEN or self.calls > ALL_CALLS:
            raise ModelFileError(
                f"with the definitions written out the file has more than {ALL_WRITTEN} symbols or {ALL_CALLS} "
                "functions. Make one of them a state, or shorten them."
            )


class _Node(NamedTuple):
    """An expression, a bound on its total degree, and the weight of the calls nested in it."""

    expression: sp.Expr
    degree: int
    calls: int


def parse_expression(
    text: str, *, symbols: Mapping[str, sp.Symbol], definitions: Definitions | None = None
) -> sp.Expr:
    """SymPy expression of `text`, whose names are those of `symbols` and of `definitions`, which are written out.

    Decimals are exact, 0.1 is 1/10. `^` and `**` are the same power, right associative and tighter than a sign
    before it. The functions are those of `FUNCTIONS`, the one constant is pi. Raises `ModelFileError` with the
    place in the text and the remedy for anything else, and for text too long, deep, or large when multiplied
    out.

    >>> parse_expression("-0.5*v^2 + sin(v)", symbols={"v": sp.Symbol("v")})
    -v**2/2 + sin(v)
    """
    if not isinstance(text, str):
        raise ModelFileError(f"an expression is text or a number. Got a {type(text).__name__}.")
    if len(text) > CHARACTERS:
        raise ModelFileError(
            f"the expression is {len(text)} characters long; {CHARACTERS} are allowed. "
            "Split it: give repeated parts a parameter or a state of their own."
        )
    try:
        return _Parser(text, symbols, Definitions() if definitions is None else definitions).result()
    except RecursionError:
        raise ModelFileError("the expression is nested too deeply. Remove parentheses.") from None


class _Parser:
    """One pass over one text; `position` and the tallies are all that changes."""

    def __init__(self, text: str, symbols: Mapping[str, sp.Symbol], definitions: Definitions) -> None:
        self.text = text
        self.symbols = symbols
        self.definitions = definitions
        # What the arguments of the definition that is being written out stand for, and how much has been written out.
        self.arguments: Mapping[str, _Node] = {}
        self.written = 0
        self.depth = self.calls = self.extrema = self.constants = self.bits = 0
        self.index = 0
        self.tokens = tokenise(text, FUNCTIONS)

    def fail(self, fact: str, position: int, remedy: str) -> NoReturn:
        fail_at(self.text, fact, position, remedy)

    @property
    def token(self) -> Token:
        return self.tokens[self.index]

    def accept(self, *texts: str) -> Token | None:
        token = self.token
        if token.kind == "operator" and token.text in texts:
            self.index += 1
            return token
        return None

    def result(self) -> sp.Expr:
        if self.token.kind == "end":
            raise ModelFileError("the expression is empty. Write 0 for a rate that vanishes.")
        node = self.whole()
        for number in node.expression.atoms(sp.Rational):
            self.check_size(number, 0)
        if self.written:
            self.definitions.spend(self.written, self.calls)
        return node.expression

    def whole(self) -> _Node:
        node = self.expression(_SUM)
        token = self.token
        if token.kind != "end":
            self.unexpected(token)
        return node

    def unexpected(self, token: Token) -> NoReturn:
        before = self.tokens[self.index - 1] if self.index else None
        if token.kind in ("number", "name") or token.text == "(":
            left = before.text if before else ""
            self.fail(
                f"there is no operator between {left[:40]!r} and {token.text[:40]!r}",
                token.position,
                "Multiplication is written out: 2*x, x*(y + 1).",
            )
        if token.text == ")":
            self.fail("a parenthesis closes that was never opened", token.position, "Remove it or open one.")
        self.fail(f"{token.text!r} stands where an operator belongs", token.position, "Remove it.")

    def enter(self, position: int) -> None:
        self.depth += 1
        if self.depth > DEPTH:
            self.fail(f"the expression is nested more than {DEPTH} deep", position, "Remove parentheses.")

    def expression(self, minimum: int) -> _Node:
        """Operators that bind at least as tightly as `minimum`; runs of + and of * are built in one call."""
        left = self.operand()
        while (token := self.token).kind == "operator":
            binding = _BINDING.get(token.text, 0)
            if binding < max(minimum, _SUM):
                break
            if binding == _POWER:
                self.index += 1
                self.enter(token.position)
                left = self.power(left, self.expression(_POWER), token)
                self.depth -= 1
            elif binding == _PRODUCT:
                left = self.product(left)
            else:
                left = self.sum(left)
        return left

    def operand(self) -> _Node:
        token = self.token
        negative = False
        while sign := self.accept("+", "-"):
            negative ^= sign.text == "-"
        if self.token is not token:
            node = self.expression(_POWER)
            return node._replace(expression=-node.expression) if negative else node
        self.index += 1
        if token.kind == "number":
            return self.number(token)
        if token.kind == "name":
            return self.name(token)
        if token.text == "(":
            self.enter(token.position)
            node = self.expression(_SUM)
            self.close(token)
            self.depth -= 1
            return node
        self.index -= 1
        if token.kind == "end":
            self.fail("the expression ends too early", token.position, "Complete it.")
        self.fail(
            f"{token.text!r} stands where a value belongs", token.position, "Put a number or a name there."
        )

    def close(self, opening: Token) -> None:
        if self.accept(")"):
            return
        if self.token.kind == "end" or self.token.text == ",":
            self.fail("this parenthesis is not closed", opening.position, "Add the missing ).")
        self.unexpected(self.token)

    def number(self, token: Token) -> _Node:
        try:
            value = parse_number(token.text)
        except NumberError as error:
            self.fail(error.fact, token.position, error.remedy)
        if "e" in token.text or "E" in token.text:
            self.spend(value, token.position)
        return _Node(value, 0, 0)

    def name(self, token: Token) -> _Node:
        follows = self.token.kind == "operator" and self.token.text == "("
        if token.text in self.arguments and not follows:
            return self.arguments[token.text]
        if token.text in self.definitions:
            return self.defined(token, follows)
        is_function = token.text in FUNCTIONS and token.text not in self.symbols
        if is_function and follows:
            return self.call(token)
        if is_function:
            self.fail(f"{token.text} is a function", token.position, f"Give it an argument: {token.text}(x).")
        if token.text == "pi":
            return _Node(sp.pi, 1, 0)
        if token.text in self.symbols:
            return _Node(self.symbols[token.text], 1, 0)
        shown, known = token.text[:64], [*self.symbols, *self.definitions, *FUNCTIONS, "pi"]
        if follows:
            self.fail(
                f"{shown} is no function of this grammar",
                token.position,
                f"The functions are {', '.join(sorted(FUNCTIONS))}."
                + nearest(shown, [*FUNCTIONS, *self.definitions]),
            )
        remedy = f"Declare it as a parameter, or correct it.{nearest(shown, known)}"
        if shown in ("e", "E"):
            remedy = "Write exp(1) for Euler's number, or declare it as a parameter."
        self.fail(f'the name "{shown}" is not declared', token.position, remedy)

    def defined(self, token: Token, follows: bool) -> _Node:
        """The definition that `token` names, written out: its text is read with the arguments in their places."""
        definition = self.definitions[token.text]
        wanted = definition.arguments
        given = self.given(token) if follows and wanted else []
        if len(given) != len(wanted) or (follows and not wanted):
            self.fail(
                f"{token.text} is defined as {definition.head}",
                token.position,
                f"Give it {len(wanted)} argument{'' if len(wanted) == 1 else 's'}."
                if wanted
                else "Leave out (.",
            )
        places = dict(zip(wanted, given))
        used = [word.text for word in definition.tokens if word.kind == "name"]
        self.written += len(definition.tokens)
        for name, node in places.items():
            limit = WRITTEN + 1
            size = sum(1 for _ in islice(sp.preorder_traversal(node.expression), limit))
            self.written += size * used.count(name)
        if self.written > WRITTEN:
            self.fail(
                f"with its definitions written out the expression has more than {WRITTEN} symbols",
                token.position,
                "Make one of them a state, or shorten them.",
            )
        self.enter(token.position)
        outer = self.text, self.tokens, self.index, self.arguments
        self.text, self.tokens, self.index, self.arguments = definition.text, [*definition.tokens], 0, places
        try:
            node = self.whole()
        except ModelFileError as error:
            raise ModelFileError(f"in {definition.head}: {error}") from None
        self.text, self.tokens, self.index, self.arguments = outer
        self.depth -= 1
        return node

    def given(self, token: Token) -> list[_Node]:
        """The arguments that stand in parentheses behind `token`."""
        opening = self.token
        self.index += 1
        self.enter(token.position)
        arguments = [self.expression(_SUM)]
        while self.accept(","):
            arguments.append(self.expression(_SUM))
        self.close(opening)
        self.depth -= 1
        return arguments

    def call(self, token: Token) -> _Node:
        count, function = FUNCTIONS[token.text]
        arguments = self.given(token)
        if len(arguments) != count:
            self.fail(
                f"{token.text} takes {count} argument{'s' if count > 1 else ''} and got {len(arguments)}",
                token.position,
                f"Write {token.text}({', '.join('xyz'[:count])}).",
            )
        if token.text == "sqrt":
            return self.power(arguments[0], _Node(sp.Rational(1, 2), 0, 0), token)
        self.extrema += count == 2
        if self.extrema > EXTREMA:
            self.fail(f"there are more than {EXTREMA} min and max", token.position, "Simplify.")
        calls = self.count_call(arguments, token)
        values = [node.expression for node in arguments]
        degree = max(1, *(node.degree for node in arguments))
        if token.text == "exp":
            degree *= self.check_exponent(values[0], token.position)
            self.check_degree(degree, token.position)
        if count == 2:
            self.sum_value([values[0], -values[1]], token.position)
        return _Node(self.checked(lambda: function(*values), values, token), degree, calls)

    def count_call(self, arguments: list[_Node], token: Token) -> int:
        """Weight of the calls nested in this one, itself included; an operator counts as a root."""
        cost = COST["sqrt"] if token.kind == "operator" else COST.get(token.text, 1)
        nested = max(node.calls for node in arguments)
        calls = cost + nested
        self.calls += cost * (1 + nested)
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

    def sum(self, first: _Node) -> _Node:
        position = self.token.position
        terms = [first]
        while sign := self.accept("+", "-"):
            node = self.expression(_PRODUCT)
            terms.append(node._replace(expression=-node.expression) if sign.text == "-" else node)
        value = self.sum_value([node.expression for node in terms], position)
        return _Node(value, max(n.degree for n in terms), max(n.calls for n in terms))

    def sum_value(self, terms: list[sp.Expr], position: int) -> sp.Expr:
        """The sum, unless its constants cancel to nothing: SymPy would try to prove that they do."""
        value = sp.Add(*terms)
        constants = [term for term in sp.Add.make_args(value) if term.is_number]
        if any(not term.is_Rational for term in constants):
            sizes = [self.evaluated(term, position, digits=CANCELLING + 5) for term in constants]
            if abs(sum(sizes)) <= sp.Float(10) ** -CANCELLING * sum(abs(size) for size in sizes):
                self.fail("a sum of constants cancels up to rounding", position, "Write 0 in its place.")
        self.check_size(sp.Add.make_args(value)[0], position)
        return value

    def product(self, first: _Node) -> _Node:
        position = self.token.position
        factors = [first]
        while operator := self.accept("*", "/"):
            node = self.expression(_POWER)
            if operator.text == "/":
                if node.expression == 0:
                    self.fail("the expression divides by zero", operator.position, "Remove the division.")
                node = self.power(node, _Node(sp.Integer(-1), 0, 0), operator)
            factors.append(node)
        degree = sum(node.degree for node in factors)
        self.check_degree(degree, position)
        value = sp.Mul(*(node.expression for node in factors))
        self.check_size(value.as_coeff_Mul()[0], position)
        return _Node(value, degree, max(node.calls for node in factors))

    def power(self, base: _Node, exponent: _Node, token: Token) -> _Node:
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
                self.spend(sp.Integer(0), position)
        else:
            degree *= self.check_exponent(e, position)
            # SymPy works b^(c + x) out as b^c b^x.
            if b.is_Rational and b not in _UNITS and _bits(b) * _ceiling(e.as_coeff_Add()[0]) > BITS:
                self.fail("a power of a number is too large", position, "Use a smaller exponent.")
        self.check_degree(degree, position)
        if b.is_number and b.is_zero is True and not (e.is_Rational and e >= 0):
            self.fail(
                "zero is raised to a power that is not positive", position, "Remove the division by zero."
            )
        if b.is_Rational and e.is_Integer:
            return _Node(sp.Pow(b, e), 0, 0)
        calls = base.calls if e.is_Integer else self.count_call([base, exponent], token)
        return _Node(self.checked(lambda: sp.Pow(b, e), [b, e], token), max(1, degree), calls)

    def checked(self, build: Callable[[], sp.Expr], arguments: list[sp.Expr], token: Token) -> sp.Expr:
        """What `build` returns, once it is known to be real and finite where it is a constant."""
        constant = all(argument.is_number for argument in arguments)
        if constant:
            self.constants += 1
            if self.constants > CONSTANTS:
                self.fail(
                    f"there are more than {CONSTANTS} functions, roots and divisions of constants",
                    token.position,
                    "Work them out, or declare parameters.",
                )
        try:
            value = build()
        # AttributeError: SymPy's cache stumbles over the message of a TypeError.
        except (ArithmeticError, AttributeError, NotImplementedError, TypeError, ValueError) as error:
            reason = "" if isinstance(error, AttributeError) else f" ({error})"
            self.fail(
                f"{token.text!r} cannot be worked out here{reason}", token.position, "Correct its argument."
            )
        if value.has(sp.nan, sp.zoo, sp.oo, -sp.oo, sp.I):
            self.fail(f"{token.text!r} is not real and finite here", token.position, "Correct its argument.")
        if value.is_number and not value.is_Rational:
            self.evaluated(value, token.position)
        return value

    def evaluated(self, constant: sp.Expr, position: int, *, digits: int = 15) -> sp.Expr:
        value = constant.evalf(digits)
        if not (value.is_Float or value.is_Rational):
            self.fail("a constant is not a real number", position, "Keep roots and logarithms in their domain.")
        if value != 0 and not 1 / LARGEST < abs(value) < LARGEST:
            self.fail("a constant lies beyond 1e300 or below 1e-300", position, "Rescale the variables.")
        return value

    def check_exponent(self, exponent: sp.Expr, position: int) -> int:
        """Bound on the power hidden in `exponent`: SymPy turns exp(9*log(x)) into x^9 unasked."""
        if not exponent.free_symbols and abs(self.evaluated(exponent, position)) > 690:
            self.fail("an exponential is too large for a double", position, "Rescale the variables.")
        largest = 1
        for term in sp.Add.make_args(exponent):
            if term.has(sp.log):
                largest = max(largest, _ceiling(term.as_coeff_Mul()[0]))
        return largest

    def check_degree(self, degree: int, position: int) -> None:
        if degree > DEGREE:
            self.fail(
                f"powers and products reach a total degree above {DEGREE}", position, "Use smaller exponents."
            )

    def check_size(self, number: sp.Expr, position: int) -> None:
        if _bits(number) > BITS:
            self.fail("a number worked out to more than 1200 digits", position, "Round it, or rescale.")

    def spend(self, number: sp.Rational, position: int) -> None:
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
