"""The grammar of model files: text from a stranger to a SymPy expression, built node by node.

    sum     := product (("+" | "-") product)*
    product := signed (("*" | "/") signed)*
    signed  := ("+" | "-")* power
    power   := atom (("^" | "**") signed)?                  right associative; -x^2 is -(x^2)
    atom    := number | "pi" | name | function "(" sum ("," sum)* ")" | "(" sum ")"

Text never reaches `eval`, `sympify` or `parse_expr`, and no `Symbol` is made from it: names come from the
caller. Numbers stay exact rationals. What a short text could blow up to is bounded before SymPy is asked to
build it, in `gsp.readers.nodes`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import islice
from typing import NamedTuple, NoReturn

import sympy as sp

from gsp.errors import ModelFileError, met_at, nearest
from gsp.readers.limits import at_most
from gsp.readers.nodes import ExpressionNode, NodeBuilder
from gsp.readers.parts import Parts
from gsp.readers.tokens import NumberError, Token, fail_at, parse_number, tokenise

CHARACTERS = 10_000
DEPTH = 100
WRITTEN = 20_000
"""Bound on the symbols of an expression with its definitions written out: a few lines can double ten times over."""
ALL_WRITTEN, ALL_CALLS = 400_000, 10_000
"""The same for all expressions of a file that use definitions, and their weighted calls."""
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
    "erf": (1, sp.erf),
    "abs": (1, sp.Abs),
    "sign": (1, sp.sign),
    "min": (2, sp.Min),
    "max": (2, sp.Max),
}
RESERVED = frozenset(FUNCTIONS) - {"ln"} | {"pi"}
"""Words of the grammar, which cannot be names of states or parameters; `ln`, the second name of log, can."""

_SUM, _PRODUCT, _POWER = range(1, 4)
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
        self.parts = Parts()

    def spend(self, written: int, calls: int) -> None:
        """Count the symbols and functions of an expression with definitions; raise beyond what a file may have."""
        self.written += written
        self.calls += calls
        if self.written > ALL_WRITTEN or self.calls > ALL_CALLS:
            raise ModelFileError(
                f"with the definitions written out the file has more than {ALL_WRITTEN} symbols or "
                f"{ALL_CALLS} functions.",
                "Make one of them a state, or shorten them.",
                limit=ALL_WRITTEN,
            )


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
        raise ModelFileError(
            "an expression is text or a number.", got=f"a {type(text).__name__}", value=type(text).__name__
        )
    remedy = "Split it: give repeated parts a parameter or a state of their own."
    at_most(CHARACTERS, len(text), "the expression is", "characters long", remedy)
    try:
        return _Parser(text, symbols, Definitions() if definitions is None else definitions).result()
    except RecursionError:
        raise ModelFileError("the expression is nested too deeply.", "Remove parentheses.") from None


class _Parser:
    """One pass over one text; `position` and the tallies are all that changes."""

    def __init__(self, text: str, symbols: Mapping[str, sp.Symbol], definitions: Definitions) -> None:
        self.text = text
        self.symbols = symbols
        self.definitions = definitions
        # What the arguments of the definition that is being written out stand for, and how much has been written out.
        self.arguments: Mapping[str, ExpressionNode] = {}
        self.written = 0
        self.depth = 0
        self.nodes = NodeBuilder(self.fail, definitions.parts)
        self.index = 0
        self.tokens = tokenise(text, FUNCTIONS)

    def fail(self, fact: str, position: int, remedy: str) -> NoReturn:
        fail_at(self.text, fact, position, remedy)

    @property
    def token(self) -> Token:
        return self.tokens[self.index]

    def accept(self, *texts: str) -> Token | None:
        token = self.tokens[self.index]
        if token.text in texts:
            self.index += 1
            return token
        return None

    def result(self) -> sp.Expr:
        if self.token.kind == "end":
            raise ModelFileError("the expression is empty.", "Write 0 for a rate that vanishes.")
        node = self.whole()
        for number in self.definitions.parts.new_numbers(node.expression):
            self.nodes.check_size(number, 0)
        if self.written:
            self.definitions.spend(self.written, self.nodes.calls)
        return node.expression

    def whole(self) -> ExpressionNode:
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

    def expression(self, minimum: int) -> ExpressionNode:
        """Operators that bind at least as tightly as `minimum`; runs of + and of * are built in one call."""
        left = self.operand()
        while (binding := _BINDING.get((token := self.tokens[self.index]).text, 0)) >= minimum:
            if binding == _POWER:
                self.index += 1
                self.enter(token.position)
                left = self.nodes.power(left, self.expression(_POWER), token)
                self.depth -= 1
            elif binding == _PRODUCT:
                left = self.product(left)
            else:
                left = self.sum(left)
        return left

    def operand(self) -> ExpressionNode:
        token = self.tokens[self.index]
        self.index += 1
        if token.kind == "name":
            return self.name(token)
        if token.kind == "number":
            return self.number(token)
        if token.text == "(":
            self.enter(token.position)
            node = self.expression(_SUM)
            self.close(token)
            self.depth -= 1
            return node
        self.index -= 1
        if token.text in ("+", "-"):
            negative = False
            while sign := self.accept("+", "-"):
                negative ^= sign.text == "-"
            node = self.expression(_POWER)
            return self.nodes.negated(node) if negative else node
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

    def number(self, token: Token) -> ExpressionNode:
        try:
            value = parse_number(token.text)
        except NumberError as error:
            self.fail(error.fact, token.position, error.remedy)
        return self.nodes.number(value, token)

    def name(self, token: Token) -> ExpressionNode:
        follows = self.tokens[self.index].text == "("
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
            return ExpressionNode(sp.pi, 1)
        if token.text in self.symbols:
            return ExpressionNode(self.symbols[token.text], 1)
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
        elif not (self.symbols or self.definitions):
            remedy = "Give a number, such as 0.1 or 3/10."
        elif shown in ("t", "time"):
            remedy = 'Time enters as a state of rate 1, such as clock = "1", with a start: write that.'
        self.fail(f'the name "{shown}" is not declared', token.position, remedy)

    def defined(self, token: Token, follows: bool) -> ExpressionNode:
        """The definition that `token` names, written out: its text is read with the arguments in their places."""
        definition = self.definitions[token.text]
        expected = definition.arguments
        given = self.given(token) if follows and expected else []
        if len(given) != len(expected) or (follows and not expected):
            self.fail(
                f"{token.text} is defined as {definition.head}",
                token.position,
                f"Give it {len(expected)} argument{'' if len(expected) == 1 else 's'}."
                if expected
                else "Leave out (.",
            )
        places = dict(zip(expected, given))
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
        with met_at(f"in {definition.head}"):
            node = self.whole()
        self.text, self.tokens, self.index, self.arguments = outer
        self.depth -= 1
        return node

    def given(self, token: Token) -> list[ExpressionNode]:
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

    def call(self, token: Token) -> ExpressionNode:
        count, function = FUNCTIONS[token.text]
        arguments = self.given(token)
        if len(arguments) != count:
            self.fail(
                f"{token.text} takes {count} argument{'s' if count > 1 else ''} and got {len(arguments)}",
                token.position,
                f"Write {token.text}({', '.join('xyz'[:count])}).",
            )
        return self.nodes.call(function, arguments, token)

    def sum(self, first: ExpressionNode) -> ExpressionNode:
        position = self.token.position
        terms = [first]
        while sign := self.accept("+", "-"):
            node = self.expression(_PRODUCT)
            terms.append(self.nodes.negated(node) if sign.text == "-" else node)
        return self.nodes.sum(terms, position)

    def product(self, first: ExpressionNode) -> ExpressionNode:
        position = self.token.position
        factors = [first]
        while operator := self.accept("*", "/"):
            node = self.expression(_POWER)
            factors.append(self.nodes.inverse(node, operator) if operator.text == "/" else node)
        return self.nodes.product(factors, position)
