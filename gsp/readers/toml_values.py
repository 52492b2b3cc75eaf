"""The values of a TOML file, each checked for its kind and size; errors begin with the key it stands under."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from decimal import Decimal

import sympy as sp

from gsp.errors import ModelFileError, met_at, nearest
from gsp.readers.expressions import CHARACTERS, RESERVED, Definitions, parse_expression
from gsp.readers.limits import at_most
from gsp.readers.tokens import parse_number

LISTED = 64
WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")


def check_keys(
    table: Iterable[str],
    known: Sequence[str],
    prefix: str = "",
    *,
    elsewhere: Mapping[str, Iterable[str]] = {},
    tables: Iterable[str] = (),
) -> None:
    """Refuse a key of `table` that is none of `known`; `elsewhere` tells the keys of other tables, named so; "" is the
    top of the file. `tables` are those of the file."""
    for key in table:
        if key in known:
            continue
        remedy = nearest(key[:64], known)
        for other in (other for other, keys in elsewhere.items() if key in keys):
            remedy = (
                f" It belongs under [{other}]: {other}.{key}."
                if other
                else " It belongs above the first table."
            )
        if key in tables:
            remedy = f" It is a table of its own: write [{key}] on a line, and its keys below."
        raise ModelFileError(f"{prefix}{key[:64]} is unknown.{remedy} The keys here are {', '.join(known)}.")


def table(document: dict, key: str) -> dict:
    """The table under `key`; empty where there is none."""
    found = document.get(key, {})
    if not isinstance(found, dict):
        raise ModelFileError(
            f"{key} is a table.", f"Write [{key}] on a line of its own.", got=f"a {kind(found)}"
        )
    return found


def named_tables(
    group: str, tables: Mapping[str, object], most: int, *, plural: str = "tables", holds: str = ""
) -> Iterator[tuple[str, str, dict]]:
    """The name, the key and the content of each table [group.NAME], of which there are at most `most`."""
    at_most(most, len(tables), f"{group} holds", plural, "Keep fewer.")
    for name, found in tables.items():
        key = f"{group}.{name[:64]}"
        if not isinstance(found, dict):
            raise ModelFileError(f"{key} is a table{holds}.", f"Write [{key}].", got=f"a {kind(found)}")
        yield name, key, found


def text(value: object, key: str, limit: int) -> str:
    """Text of at most `limit` characters."""
    if not isinstance(value, str):
        raise ModelFileError(f"{key} is text.", "Put it in quotes.", got=f"a {kind(value)}")
    at_most(limit, len(value), f"{key} has", "characters", "Shorten it.")
    return value


def number(value: object, key: str) -> sp.Expr:
    """Exact value of a number of the file, or of constant text such as "1/3".

    >>> number("0.1", "epsilon")
    1/10
    """
    try:
        if isinstance(value, str):
            return parse_expression(value, symbols={})
        if isinstance(value, (int, Decimal)) and not isinstance(value, bool):
            if not Decimal(value).is_finite():
                raise ModelFileError(f"Got {value}.", "Give a finite number.")
            magnitude = parse_number(str(value.copy_abs() if isinstance(value, Decimal) else abs(value)))
            return -magnitude if value < 0 else magnitude
    except ModelFileError as error:
        raise error.under(key) from None
    except ValueError as error:
        raise ModelFileError(f"{key}: {error}") from None
    remedy = (
        "In TOML a dot makes a table: write a name as one plain word, k_on." if isinstance(value, dict) else ""
    )
    raise ModelFileError(f"{key} is a number, or text to be worked out.", remedy, got=f"a {kind(value)}")


def numbers(value: object, key: str) -> list[sp.Expr]:
    """Exact values of a list of numbers."""
    if not isinstance(value, list):
        raise ModelFileError(
            f"{key} is a list of numbers.", f"Write {key.split('.')[-1]} = [1, 2].", got=f"a {kind(value)}"
        )
    at_most(LISTED, len(value), f"{key} has", "numbers", "Shorten it.")
    return [number(item, key) for item in value]


def pair(value: object, key: str) -> tuple[float, float]:
    """Two numbers, low and high as they stand."""
    found = numbers(value, key)
    if len(found) != 2:
        raise ModelFileError(f"{key} is a pair of numbers.", "Write [low, high].", got=f"{len(found)} of them")
    return float(found[0]), float(found[1])


def point(document: dict, key: str, place: str = "") -> dict[str, float]:
    """The numbers by name of the table under `key`, which is that of `place`."""
    place = place or key
    return {name: float(number(value, f"{place}.{name[:64]}")) for name, value in table(document, key).items()}


def box(document: dict, key: str, place: str = "") -> dict[str, tuple[float, float]]:
    """The pairs of numbers by name of the table under `key`, which is that of `place`."""
    place = place or key
    return {name: pair(value, f"{place}.{name[:64]}") for name, value in table(document, key).items()}


def path(value: object, key: str = "scene.path") -> tuple[str, str] | None:
    """A pair of names, or None."""
    if value is None:
        return None
    if not isinstance(value, list) or len(value) != 2 or not all(isinstance(item, str) for item in value):
        raise ModelFileError(f"{key} is a pair of names.", f'Write {key.rpartition(".")[2]} = ["x", "y"].')
    return value[0], value[1]


def kind(value: object) -> str:
    """What a value of a TOML file is, in a word for errors."""
    kinds = {str: "text", bool: "boolean", int: "number", Decimal: "number", list: "list", dict: "table"}
    return kinds.get(type(value), type(value).__name__)


def small(document: dict) -> tuple[dict, str]:
    """The document with one small parameter, and the name of a second that it may have."""
    named = document.get("epsilon")
    if not isinstance(named, list):
        return document, ""
    if len(named) != 2 or not all(isinstance(name, str) for name in named):
        raise ModelFileError(
            "epsilon, at the top of the file, names one small parameter or two, that of the fastest scale first.",
            'Write epsilon = ["epsilon", "delta"].',
        )
    if named[0] == named[1]:
        raise ModelFileError(
            f"epsilon, at the top of the file, names {named[0]} twice.",
            f"Name it once; `gsp nest --small {named[0]},{named[0]}` takes it for both.",
        )
    return {**document, "epsilon": named[0]}, named[1]


def symbols_of(tables: Mapping[str, Iterable[str]]) -> dict[str, sp.Symbol]:
    """A symbol for each name in `tables`, once it is known to be a plain word that is used once."""
    roles: dict[str, str] = {}
    for role, table in tables.items():
        for name in table:
            if not WORD.fullmatch(name):
                raise ModelFileError(
                    f"{role}: the name {name[:80]!r} is no plain word.",
                    "Use the letters A to Z and a to z, digits and _, a letter first, at most 64.",
                )
            if name in RESERVED:
                raise ModelFileError(f"{role}.{name}: {name} is a word of the grammar.", "Choose another name.")
            if name in roles:
                raise ModelFileError(
                    f"{role}.{name}: {name} is declared under {roles[name]} too.", "Keep one of the two."
                )
            roles[name] = role
    return {name: sp.Symbol(name) for name in roles}


def body(value: object, key: str) -> str:
    """Text of a definition."""
    if isinstance(value, str):
        return text(value, key, CHARACTERS)
    found = number(value, key)
    return f"{found.p}/{found.q}" if isinstance(found, sp.Rational) else str(found)


def expression(value: object, key: str, symbols: Mapping[str, sp.Symbol], definitions: Definitions) -> sp.Expr:
    """An expression given as text or as a number; one that another reader made stands as it is."""
    if isinstance(value, sp.Expr):
        return value
    if isinstance(value, str):
        with met_at(key):
            return parse_expression(value, symbols=symbols, definitions=definitions)
    return number(value, key)
