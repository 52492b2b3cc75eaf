"""Conditions in XPPAUT's expressions: comparisons, `if()then()else()`, `&`, `|`, `not` and `heav`, as numbers.

XPPAUT's comparisons bind more tightly than its sums, products, signs and `not`: it takes v+40>0 for v+(40>0). What
reads differently from what it looks like is refused; parentheses make it plain.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import reduce
from typing import NamedTuple

from gsp.errors import ModelFileError
from gsp.readers import conditions

_TOKENS = re.compile(
    r"\s*((?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[-+]?[0-9]+)?|[a-z_][a-z0-9_]*|<=|>=|==|!=|\*\*|[^\s])"
)
_COMPARED = ("<", ">", "<=", ">=", "==", "!=")
_JOINED = ("&", "|")
_OPERATORS = (*_COMPARED, *_JOINED, "+", "-", "*", "/", "^", "**")


def without_conditions(text: str, *, positive: Callable[[], str]) -> str:
    """`text` with its conditions written as numbers, 1 where they hold and 0 where not.

    `positive` gives the name of the step of `gsp.readers.conditions`. Raises `ModelFileError` for an ambiguous one.
    """
    if not re.search(r"[<>&|]|==|!=|(?<![a-z0-9_.])(?:if|heav|not)\s*\(", text):
        return text
    return _ConditionReader([match[1] for match in _TOKENS.finditer(text)], positive).whole()


class _Item(NamedTuple):
    """What it becomes here, whether it is a condition, and how the file writes it."""

    text: str
    is_condition: bool
    written: str


class _ConditionReader:
    """One pass over the words of an expression."""

    def __init__(self, words: list[str], positive: Callable[[], str]) -> None:
        self.words, self.positive, self.at = words, positive, 0

    def whole(self) -> str:
        text, _ = self.part()
        if self.at < len(self.words):
            raise ModelFileError(
                f"{self.words[self.at][:20]!r} stands where nothing is open.", "Correct the parentheses."
            )
        return text

    def next(self) -> str:
        return self.words[self.at] if self.at < len(self.words) else ""

    def part(self) -> tuple[str, bool]:
        """What stands up to a comma, a closing parenthesis or the end, and whether it is a condition."""
        items: list[_Item] = []
        while self.next() not in ("", ",", ")"):
            begin = self.at
            text, is_condition = self.item()
            items.append(_Item(text, is_condition, "".join(self.words[begin : self.at])))
        for operator in _JOINED:
            if any(item.text == operator for item in items):
                return self.joined(items, operator), True
        if any(item.text in _COMPARED for item in items):
            return self.compared(items), True
        if len(items) == 1:
            return items[0][:2]
        return "".join(item.text for item in items), False

    def item(self) -> tuple[str, bool]:
        word, begin = self.words[self.at], self.at
        self.at += 1
        if word == "(":
            text, is_condition = self.part()
            self.close()
            return f"({text})", is_condition
        if self.next() != "(" or not re.match("[a-z_]", word):
            return word, False
        if word == "if":
            return self.chosen(), False
        arguments = self.arguments()
        if word in ("heav", "not") and len(arguments) != 1:
            raise ModelFileError(f"{word} takes one argument.", got=len(arguments))
        if word == "heav":
            # XPPAUT's heav is 1 at 0.
            return conditions.compared(">=", arguments[0][0], "0", positive=self.positive()), False
        if word == "not":
            self.check_not(begin)
            return conditions.negated(self.truth(*arguments[0])), True
        return f"{word}({', '.join(text for text, _ in arguments)})", False

    def check_not(self, at: int) -> None:
        """Refuse a `not` behind an operator that XPPAUT works out before it has the `not`."""
        first, last = ["(", "(", *self.words[:at]][-2:]
        if last in (*_COMPARED, "&", "*", "/", "^", "**") or (last == "-" and first in (*_OPERATORS, "(", ",")):
            raise ModelFileError(
                f"not behind {last} is another number in XPPAUT, which takes {last} first.",
                "Put parentheses: 2*(not(v>1)).",
            )

    def arguments(self) -> list[tuple[str, bool]]:
        self.at += 1
        found = [self.part()]
        while self.next() == ",":
            self.at += 1
            found.append(self.part())
        self.close()
        return found

    def close(self) -> None:
        if self.next() != ")":
            raise ModelFileError("a parenthesis is not closed.", "Close it.")
        self.at += 1

    def chosen(self) -> str:
        """`if(condition)then(value)else(value)`."""
        parts: list[tuple[str, bool]] = []
        for word in ("then", "else", ""):
            if self.next() != "(":
                raise ModelFileError("if is written if(condition)then(value)else(value).", "Complete it.")
            arguments = self.arguments()
            if len(arguments) != 1 or (word and self.next() != word):
                raise ModelFileError("if is written if(condition)then(value)else(value).", "Complete it.")
            parts += arguments
            self.at += bool(word)
        return conditions.chosen(self.truth(*parts[0]), parts[1][0], parts[2][0])

    @staticmethod
    def truth(text: str, is_condition: bool) -> str:
        return text if is_condition else conditions.truth(text)

    def compared(self, items: list[_Item]) -> str:
        texts = [item.text for item in items]
        is_one = len(texts) == 3 and texts[1] in _COMPARED and not {texts[0], texts[2]} & {*_OPERATORS}
        if not is_one or items[0].written.startswith("not("):
            raise ModelFileError(
                f"{_shown(items)!r} reads differently in XPPAUT from what it looks like: a comparison "
                "binds more tightly there than a sum, a product, a sign or a not.",
                "Put parentheses: (v+40)>0, v>(-40).",
            )
        return conditions.compared(texts[1], texts[0], texts[2], positive=self.positive())

    def joined(self, items: list[_Item], operator: str) -> str:
        pieces: list[list[_Item]] = [[]]
        for item in items:
            if item.text == operator:
                pieces.append([])
            else:
                pieces[-1].append(item)
        join = conditions.both if operator == "&" else conditions.either
        texts = []
        for piece in pieces:
            if {*_COMPARED} & (words := {item.text for item in piece}) and not {*_JOINED} & words:
                texts.append(self.compared(piece))
            elif len(piece) == 1:
                texts.append(self.truth(*piece[0][:2]))
            else:
                raise ModelFileError(
                    f"{_shown(items)!r} has & or | beside other operators.", "Put parentheses around each side."
                )
        return reduce(join, texts)


def _shown(items: list[_Item]) -> str:
    return " ".join(item.written for item in items)[:80]
