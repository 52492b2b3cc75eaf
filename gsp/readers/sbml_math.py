"""SBML's mathematics as expressions of model files, from the trees that libSBML makes of MathML and of formulas."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from decimal import Decimal
from functools import reduce
from itertools import pairwise
from typing import Any, NamedTuple

from gsp.errors import ModelFileError
from gsp.readers import conditions

# Level 3 version 1, section 3.4.6: the value of the constant.
AVOGADRO = "6.02214179e23"
_SUM, _PRODUCT, _POWER, _ATOM = range(1, 5)

_FUNCTIONS: Mapping[str, str] = {
    **{
        f"AST_FUNCTION_{name}": name.lower()
        for name in ("ABS", "EXP", "SIN", "COS", "TAN", "SINH", "COSH", "TANH")
    },
    **{f"AST_FUNCTION_ARC{name}": f"a{name.lower()}" for name in ("SIN", "COS", "TAN", "SINH", "COSH", "TANH")},
    "AST_FUNCTION_LN": "log",
}
# One over a function, and functions of one over the argument: arccot(x) = arctan(1/x), as in Abramowitz & Stegun 4.4.8.
_RECIPROCAL = {"SEC": "cos", "CSC": "sin", "COT": "tan", "SECH": "cosh", "CSCH": "sinh", "COTH": "tanh"}
_COMPARED = {
    "AST_RELATIONAL_GT": ">",
    "AST_RELATIONAL_LT": "<",
    "AST_RELATIONAL_GEQ": ">=",
    "AST_RELATIONAL_LEQ": "<=",
    "AST_RELATIONAL_EQ": "==",
    "AST_RELATIONAL_NEQ": "!=",
}
# How conditions are joined, and what none at all are.
_JOINED = {
    "AST_LOGICAL_AND": (conditions.both, "1"),
    "AST_LOGICAL_OR": (conditions.either, "0"),
    "AST_LOGICAL_XOR": (conditions.one_of, "0"),
}
_REFUSED = {
    "AST_FUNCTION_DELAY": "a delay",
    "AST_FUNCTION_FLOOR": "floor, which jumps,",
    "AST_FUNCTION_CEILING": "ceiling, which jumps,",
    "AST_FUNCTION_FACTORIAL": "a factorial",
    "AST_FUNCTION_QUOTIENT": "quotient, which jumps,",
    "AST_FUNCTION_REM": "rem, which jumps,",
    "AST_FUNCTION_RATE_OF": "rateOf, the rate of a quantity,",
}


class Text(NamedTuple):
    """An expression, how tightly its outermost operator binds, and whether it is a condition, one or nothing."""

    text: str
    binding: int
    is_condition: bool = False


class Mathematics:
    """Trees to text. `names` gives what stands for an identifier, `time` what stands for the time.

    `positive` gives the name of the step of `gsp.readers.conditions`; functions that are called are checked by whoever
    reads the text. `condition_functions` are those whose value is a condition.
    """

    def __init__(
        self,
        libsbml: Any,
        names: Callable[[str], str],
        *,
        time: Callable[[], str],
        positive: Callable[[], str],
        condition_functions: frozenset[str] | set[str],
    ) -> None:
        # Several constants share a number: AST_END is one less than an operator's, and is none of ours.
        self.kinds = {getattr(libsbml, name): name for name in sorted(dir(libsbml)) if name.startswith("AST_")}
        self.names, self.time, self.positive = names, time, positive
        self.condition_functions = condition_functions
        self.local: Mapping[str, str] = {}

    def text(self, tree: Any, local: Mapping[str, str] | None = None) -> str:
        """The expression that `tree` is; `local` hides identifiers by others. Raises `ModelFileError`."""
        return self.whole(tree, local).text

    def whole(self, tree: Any, local: Mapping[str, str] | None = None) -> Text:
        self.local = local or {}
        if tree is None:
            raise ModelFileError("an expression is missing.", "Give it one.")
        try:
            return self.node(tree)
        except RecursionError:
            raise ModelFileError("an expression is nested too deeply.", "Split it.") from None

    def kind(self, tree: Any) -> str:
        return self.kinds.get(tree.getType(), "unknown")

    def node(self, tree: Any) -> Text:
        kind = self.kind(tree)
        children = [tree.getChild(i) for i in range(tree.getNumChildren())]
        if kind in ("AST_PLUS", "AST_MINUS", "AST_TIMES", "AST_DIVIDE"):
            return self.arithmetic(tree)
        if kind in ("AST_INTEGER", "AST_REAL", "AST_REAL_E", "AST_RATIONAL"):
            return number(tree, kind)
        if kind in ("AST_POWER", "AST_FUNCTION_POWER"):
            return self.power(self.node(children[0]), self.node(children[1]))
        if kind in _FUNCTIONS:
            return Text(f"{_FUNCTIONS[kind]}({self.node(children[0]).text})", _ATOM)
        if kind == "AST_NAME":
            name = tree.getName()
            return Text(self.local[name] if name in self.local else self.names(name), _ATOM)
        if kind == "AST_FUNCTION":
            name = tree.getName()
            inner = ", ".join(self.node(child).text for child in children)
            call = f"{self.names(name)}({inner})" if children else self.names(name)
            return Text(call, _ATOM, name in self.condition_functions)
        if kind in _COMPARED:
            pieces = [self.node(child).text for child in children]
            step = self.positive()
            pairs = [
                conditions.compared(_COMPARED[kind], left, right, positive=step)
                for left, right in pairwise(pieces)
            ]
            return self.joined(pairs, conditions.both, "1")
        return self.special(tree, kind, children)

    def special(self, tree: Any, kind: str, children: list[Any]) -> Text:
        if kind == "AST_FUNCTION_PIECEWISE":
            return self.piecewise(children)
        if kind == "AST_FUNCTION_ROOT":
            inner = self.node(children[-1])
            if len(children) == 1:
                return Text(f"sqrt({inner.text})", _ATOM)
            degree = self.node(children[0])
            if degree.text == "2":
                return Text(f"sqrt({inner.text})", _ATOM)
            return self.power(inner, Text(f"1/{self.held(degree, _POWER)}", _PRODUCT))
        if kind == "AST_FUNCTION_LOG":
            inner = f"log({self.node(children[-1]).text})"
            base = self.node(children[0]).text if len(children) == 2 else "10"
            return Text(f"{inner}/log({base})", _PRODUCT)
        word = kind.removeprefix("AST_FUNCTION_")
        if word in _RECIPROCAL:
            return Text(f"1/{_RECIPROCAL[word]}({self.node(children[0]).text})", _PRODUCT)
        if word.startswith("ARC") and word[3:] in _RECIPROCAL:
            inner = self.held(self.node(children[0]), _POWER)
            return Text(f"a{_RECIPROCAL[word[3:]]}(1/{inner})", _ATOM)
        if word in ("MIN", "MAX") and children:
            return self.extremum(word.lower(), children)
        if kind in _JOINED:
            return self.joined([self.condition(child) for child in children], *_JOINED[kind])
        if kind == "AST_LOGICAL_NOT":
            return Text(conditions.negated(self.condition(children[0])), _ATOM, True)
        if kind == "AST_LOGICAL_IMPLIES":
            first, second = (self.condition(child) for child in children)
            return Text(conditions.either(conditions.negated(first), second), _ATOM, True)
        constants = {
            "AST_CONSTANT_PI": Text("pi", _ATOM),
            "AST_CONSTANT_E": Text("exp(1)", _ATOM),
            "AST_CONSTANT_TRUE": Text("1", _ATOM, True),
            "AST_CONSTANT_FALSE": Text("0", _ATOM, True),
            "AST_NAME_AVOGADRO": Text(AVOGADRO, _ATOM),
        }
        if kind in constants:
            return constants[kind]
        if kind == "AST_NAME_TIME":
            return Text(self.time(), _ATOM)
        what = _REFUSED.get(kind) or f"{tree.getName() or kind.removeprefix('AST_').lower()}"
        raise ModelFileError(f"{what[:60]} is not read.", "Write the model without it.")

    def arithmetic(self, tree: Any) -> Text:
        """Sums and products; those that grow to the left, as formulas do, without going down into them."""
        spine: list[Any] = []
        while (
            self.kind(tree) in ("AST_PLUS", "AST_MINUS", "AST_TIMES", "AST_DIVIDE")
            and tree.getNumChildren() > 1
        ):
            spine.append(tree)
            tree = tree.getChild(0)
        if not spine or self.kind(tree) in ("AST_PLUS", "AST_MINUS", "AST_TIMES"):
            left = self.short_sum(tree, self.kind(tree))
        else:
            left = self.node(tree)
        for operator in reversed(spine):
            left = self.chain(left, operator)
        return left

    def short_sum(self, tree: Any, kind: str) -> Text:
        """A sum, difference or product of one operand or none."""
        if tree.getNumChildren() == 0:
            return Text("1" if kind == "AST_TIMES" else "0", _ATOM)
        inner = self.node(tree.getChild(0))
        return Text(f"-{self.held(inner, _PRODUCT)}", _SUM) if kind == "AST_MINUS" else inner

    def chain(self, left: Text, tree: Any) -> Text:
        kind = self.kind(tree)
        sign = {"AST_PLUS": " + ", "AST_MINUS": " - ", "AST_TIMES": "*", "AST_DIVIDE": "/"}[kind]
        binding = _SUM if kind in ("AST_PLUS", "AST_MINUS") else _PRODUCT
        # What follows - or / is held together, and so is what begins with a sign.
        inner = _PRODUCT if kind in ("AST_PLUS", "AST_MINUS") else _POWER
        rest = [self.node(tree.getChild(i)) for i in range(1, tree.getNumChildren())]
        return Text(sign.join([self.held(left, binding), *(self.held(node, inner) for node in rest)]), binding)

    def power(self, base: Text, exponent: Text) -> Text:
        return Text(f"{self.held(base, _ATOM)}^{self.held(exponent, _ATOM)}", _POWER)

    def piecewise(self, children: list[Any]) -> Text:
        if len(children) % 2 == 0:
            raise ModelFileError("a piecewise without otherwise has no value everywhere.", "Give it one.")
        result = self.node(children[-1])
        text, is_condition = result.text, result.is_condition
        for i in range(len(children) - 3, -1, -2):
            piece = self.node(children[i])
            is_condition = is_condition and piece.is_condition
            text = conditions.chosen(self.condition(children[i + 1]), piece.text, text)
        return Text(text, _ATOM, is_condition)

    def extremum(self, name: str, children: list[Any]) -> Text:
        text = self.node(children[-1]).text
        for child in reversed(children[:-1]):
            text = f"{name}({self.node(child).text}, {text})"
        return Text(text, _ATOM)

    def condition(self, tree: Any) -> str:
        """A condition as a number; a number stands for whether it is other than zero (Level 3 version 2)."""
        node = self.node(tree)
        return node.text if node.is_condition else conditions.truth(node.text)

    @staticmethod
    def joined(pieces: list[str], join: Callable[[str, str], str], empty: str) -> Text:
        text = reduce(join, pieces) if pieces else empty
        return Text(text if text.startswith("abs(") else f"({text})", _ATOM, True)

    @staticmethod
    def held(node: Text, binding: int) -> str:
        return node.text if node.binding >= binding else f"({node.text})"


def number(tree: Any, kind: str) -> Text:
    """A number as a decimal or a fraction; a double as the shortest decimal that it is nearest to."""
    if kind == "AST_INTEGER":
        text = str(tree.getInteger())
    elif kind == "AST_RATIONAL":
        return Text(f"({tree.getNumerator()}/{tree.getDenominator()})", _ATOM)
    elif kind == "AST_REAL_E":
        text = str(Decimal(repr(tree.getMantissa())).scaleb(tree.getExponent()))
    else:
        text = decimal(tree.getReal(), "a number")
    return Text(text, _SUM if text.startswith("-") else _ATOM)


def decimal(value: float, what: str) -> str:
    """The shortest decimal that `value` is nearest to, without ".0"; raises `ModelFileError` for no finite one."""
    if not math.isfinite(value):
        raise ModelFileError(f"{what} is {value}.", "Give it a finite value.")
    return repr(value).removesuffix(".0")


def names_in(tree: Any) -> Iterator[str]:
    """The identifiers in a tree, those of functions among them."""
    waiting = [tree] if tree is not None else []
    while waiting:
        node = waiting.pop()
        if node.isName() or node.isFunction():
            name = node.getName()
            if name:
                yield name
        waiting.extend(node.getChild(i) for i in range(node.getNumChildren()))
