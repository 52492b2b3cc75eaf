"""Definitions of a model file: names for expressions and for functions of one or more arguments.

    [definitions]
    beta = "v1 + v2"
    "minf(v)" = "0.5*(1 + tanh((v - beta)/v2))"

A definition may use those before and behind it, but not itself, not even by way of others.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from graphlib import CycleError, TopologicalSorter

import sympy as sp

from gsp.errors import ModelFileError, met_at
from gsp.readers.expressions import FUNCTIONS, RESERVED, Definition, Definitions, parse_expression
from gsp.readers.limits import at_most
from gsp.readers.tokens import tokenise
from gsp.readers.toml_values import body

ARGUMENTS = 32

_WORD = r"[A-Za-z][A-Za-z0-9_]{0,63}"
_HEAD = re.compile(rf"({_WORD})\s*(?:\(\s*({_WORD}(?:\s*,\s*{_WORD})*)\s*\))?")


def read_definitions(table: Mapping[str, object], symbols: Mapping[str, sp.Symbol]) -> Definitions:
    """The definitions of `table`, {"name" or "name(argument, ...)": text or number}, over the `symbols` of the model.

    Raises `ModelFileError` for a name or an argument that means something already, for one that is not declared, and
    for a circle, which is named.
    """
    at_most(2000, len(table), "definitions holds", "names", "Keep fewer.")
    definitions = Definitions()
    for head, value in table.items():
        name, arguments = _head(head)
        key = f"definitions.{head}"
        for word in (name, *arguments):
            if word in RESERVED or word in FUNCTIONS:
                raise ModelFileError(f"{key}: {word} is a word of the grammar.", "Choose another name.")
            if word in symbols:
                raise ModelFileError(
                    f"{key}: {word} is a name of the model too, which it would hide.", "Choose another name."
                )
        if name in definitions:
            raise ModelFileError(f"{key}: {name} is defined twice.", "Keep one of the two.")
        text = body(value, f"definitions.{head[:80]}")
        with met_at(key):
            definitions[name] = Definition(head, arguments, text, tuple(tokenise(text, FUNCTIONS)))
    for definition in definitions.values():
        hidden = [word for word in definition.arguments if word in definitions]
        if hidden:
            raise ModelFileError(
                f"definitions.{definition.head}: {hidden[0]} is defined too, which it would hide.",
                "Choose another name.",
            )
    _refuse_circles(definitions)
    for definition in definitions.values():
        own = {word: sp.Symbol(word) for word in definition.arguments}
        with met_at(f"definitions.{definition.head}"):
            parse_expression(definition.text, symbols={**symbols, **own}, definitions=definitions)
    return definitions


def _head(head: str) -> tuple[str, tuple[str, ...]]:
    match = _HEAD.fullmatch(head)
    if match is None:
        raise ModelFileError(
            f"definitions: {head[:80]!r} is neither a name nor a function.",
            'Write beta, or "minf(v)" in quotes.',
        )
    arguments = tuple(word.strip() for word in match[2].split(",")) if match[2] else ()
    if len(arguments) > ARGUMENTS or len(set(arguments)) < len(arguments):
        raise ModelFileError(
            f"definitions.{head[:80]}: a function has at most {ARGUMENTS} arguments, each once.",
            got=", ".join(arguments)[:80],
            limit=ARGUMENTS,
        )
    return match[1], arguments


def _refuse_circles(definitions: Mapping[str, Definition]) -> None:
    uses = {
        name: [t.text for t in definition.tokens if t.kind == "name" and t.text in definitions]
        for name, definition in definitions.items()
    }
    try:
        TopologicalSorter(uses).prepare()
    except CycleError as error:
        # A sentence, and the circle, where each is used by the next.
        _, found = error.args
        circle = " -> ".join(reversed(found))
        raise ModelFileError(
            f"definitions: {circle[:300]} is a circle.", "Write one of them out without the others."
        ) from None
