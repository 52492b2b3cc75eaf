"""The lines of XPPAUT's files, told apart as XPPAUT tells them apart: by the first of blank, =, /, ' and ( in them.

A line whose first word is followed by a blank is a command, and its first letters say which: `para` and `p` are
`par`, `initial` is `init`, whatever begins with d ends the file, and a letter that means nothing is passed over.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from decimal import Decimal
from enum import Enum, auto
from typing import NamedTuple, NoReturn

from gsp.errors import ModelFileError

LINE = 20_000

WORD = r"[a-z][a-z0-9_]{0,63}"
_SEPARATORS = re.compile(r"[ =/'(]")
_START = re.compile(rf"({WORD}) ?\( ?0 ?\) ?=(.*)", re.DOTALL)
_FUNCTION = re.compile(rf"({WORD}) ?\( ?({WORD}(?: ?, ?{WORD})*) ?\) ?=(.*)", re.DOTALL)
_STEP = re.compile(r"[^()=]*\( ?t ?(\+ ?1 ?)?\) ?=")
_PIECE = re.compile(r"\s*(\S[^=\s,]*)\s*(?:=\s*([^\s,]*)\s*,?|,)?")
_NUMBER = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[-+]?[0-9]+)?")
_HEXADECIMAL = re.compile(r"[-+]?0x(?:[0-9a-f]+\.?[0-9a-f]*|\.[0-9a-f]+)(?:p[-+]?[0-9]{1,2})?")


class LineKind(Enum):
    """What a line is."""

    SETTINGS = auto()
    PARAMETERS = auto()
    STARTS = auto()
    START = auto()
    AUXILIARY = auto()
    RATE = auto()
    FUNCTION = auto()
    QUANTITY = auto()
    CONSTANT = auto()
    SET = auto()
    MISSING = auto()
    LEFT_OUT = auto()
    PASSED_OVER = auto()
    END = auto()


class Statement(NamedTuple):
    """A line: its `kind`, the `name` and the `arguments` that it gives a meaning to, and the `text` of that."""

    kind: LineKind
    name: str
    text: str
    arguments: tuple[str, ...] = ()


# The first letters of commands, the longer ones first; what is refused says what it is.
_REFUSED = (
    ("ma", "a Markov process"),
    ("so", "an algebraic equation"),
    ("ex", "a call of a library"),
    ("include", "another file"),
    ("vec", "an array"),
    ("gr", "a group of plots"),
    ("g", "an event that changes the state"),
    ("v", "an integral equation"),
)
# What has no value here, which matters where a rate uses it.
MISSING = {"ta": "a table of numbers", "w": "noise"}
_TAKEN = (
    ("au", LineKind.AUXILIARY),
    ("se", LineKind.SET),
    *((letters, LineKind.MISSING) for letters in MISSING),
    ("o", LineKind.LEFT_OUT),
    ("b", LineKind.LEFT_OUT),
    ("p", LineKind.PARAMETERS),
    ("n", LineKind.PARAMETERS),
    ("i", LineKind.STARTS),
    ("d", LineKind.END),
)
# What a command of such a kind is called; with other words it has to give values.
_WRITTEN_OUT = re.compile(r"p(?:ar(?:am(?:s|eters?)?)?)?|n(?:um(?:ber)?)?|i(?:nit(?:ial)?)?")


def fail(number: int, fact: str, remedy: str) -> NoReturn:
    """Raise `ModelFileError` about the line `number`."""
    raise ModelFileError(f"line {number}: {fact}.", remedy)


def lines_of(text: str) -> Iterator[tuple[int, str]]:
    """The lines that say something, in lower case, continued ones in one, with the number of the first.

    A line goes on where it has a \\, whatever follows that; comments do too.
    """
    first, held = 0, ""
    for number, line in enumerate(text.splitlines(), 1):
        begin, continued, _ = line.partition("\\")
        first = first or number
        held += begin
        if continued:
            if len(held) > LINE:
                fail(first, f"a continued line is longer than {LINE} characters", "Split it.")
            continue
        if words := _words(held):
            yield first, words
        first, held = 0, ""
    if words := _words(held):
        yield first, words


def _words(line: str) -> str:
    """The words of a line, "" for a comment: one blank for many, as several runs of blanks take quadratic time."""
    words = " ".join(line.split()).lower()
    is_comment = words[:1] in ("#", '"') and not words.startswith("#include")
    return "" if is_comment else words


def statement_of(number: int, line: str) -> Statement:
    """What a line says; raises `ModelFileError` for what no model here has, and for what XPPAUT would not take."""
    if line[0] == "@":
        return Statement(LineKind.SETTINGS, "", line[1:])
    if line.startswith("#include"):
        fail(number, "#include is another file, which no model here has", "Remove it.")
    if line[0] == "%" or not line.strip("-=*~_+. "):
        return _struck_out(number, line)
    if re.match("0 ?=", line):
        fail(number, "an equation without a name is not read", "Write x' = ... for a state.")
    found = _SEPARATORS.search(line)
    place, sign = (found.start(), found[0]) if found else (len(line), " ")
    head, rest = line[:place], line[place:].lstrip()
    if sign == " " and not rest.startswith("="):
        return _command(number, line, head, rest)
    if sign in " =":
        name = head.removeprefix("!")
        if re.fullmatch(WORD, name):
            kind = LineKind.CONSTANT if head != name else LineKind.QUANTITY
            return Statement(kind, name, rest[1:].strip())
    elif sign == "(":
        return _called(number, line)
    elif "=" in rest and (sign == "'" or line[0] == "d"):
        name = head if sign == "'" else head[1:]
        if re.fullmatch(WORD, name):
            return Statement(LineKind.RATE, name, rest.partition("=")[2].strip())
    _not_understood(number, line)


def _called(number: int, line: str) -> Statement:
    """`name(...) = ...`: an initial value, or a function, of t too."""
    if found := _START.fullmatch(line):
        return Statement(LineKind.START, found[1], found[2])
    step = _STEP.match(line)
    if step and (step[1] or re.search(r"int ?[{[]", line)):
        fail(number, "a difference or integral equation is no flow", "Write a differential equation.")
    if found := _FUNCTION.fullmatch(line):
        arguments = tuple(word.strip() for word in found[2].split(","))
        return Statement(LineKind.FUNCTION, found[1], found[3].strip(), arguments)
    _not_understood(number, line)


def _command(number: int, line: str, head: str, rest: str) -> Statement:
    if head[:2] == "sp" and head[5:6] == "a":
        fail(number, f"{head} is a sum over a network, which no model here has", "Remove it.")
    kind = next((kind for letters, kind in _TAKEN if head.startswith(letters)), LineKind.PASSED_OVER)
    if head[:2] == "in" and head.startswith("include"):
        kind = LineKind.PASSED_OVER
    for letters, what in _REFUSED:
        if head.startswith(letters):
            fail(number, f"{head[:40]} is {what}, which no model here has", "Remove it.")
    is_guessed = kind in (LineKind.PARAMETERS, LineKind.STARTS) and not _WRITTEN_OUT.fullmatch(head)
    if is_guessed and any(value is None for _, value in pieces_of(rest)):
        _not_understood(number, line)
    if kind is LineKind.PASSED_OVER and not line.isprintable():
        _not_understood(number, line)
    if kind is LineKind.AUXILIARY:
        name, equals, text = rest.partition("=")
        if not equals:
            _not_understood(number, line)
        return Statement(kind, "".join(name.split()), text.strip())
    if kind is LineKind.MISSING:
        names = [name for name, _ in pieces_of(rest)]
        return Statement(kind, head, " ".join(names[:1] if head[0] == "t" else names))
    return Statement(kind, head, line if kind in (LineKind.SET, LineKind.PASSED_OVER) else rest)


def _struck_out(number: int, line: str) -> Statement:
    """A line that begins with %: a name with % in it, which nothing uses, unless it has a rate."""
    found = _SEPARATORS.search(line)
    if found and found[0] in "'/" and "=" in line:
        fail(
            number, f"{line[:40]!r} is no comment: XPPAUT gives {line[: found.start()][:20]} a rate", "Write #."
        )
    return Statement(LineKind.PASSED_OVER, "", line)


def _not_understood(number: int, line: str) -> NoReturn:
    fail(number, f"{line[:60]!r} is not understood", "Correct it, or remove it.")


def pieces_of(text: str) -> list[tuple[str, str | None]]:
    """`name=value`, between blanks or commas, with blanks around = or none; the value is None where = is not there."""
    return [(found[1], found[2]) for found in _PIECE.finditer(text)]


def start_at(text: str) -> str:
    """The number that XPPAUT takes for x(0)=`text`, which is 0 where the text begins with a sign behind a blank."""
    return "0" if text.strip()[:1] in ("+", "-") and text[0] != "-" else _decimal_at("".join(text.split()))


def number_at(text: str) -> str:
    """The number that `text` begins with, "0" where it begins with none: what C's atof makes of it."""
    found = _HEXADECIMAL.match(text)
    return str(Decimal(float.fromhex(found[0]))) if found else _decimal_at(text)


def _decimal_at(text: str) -> str:
    found = _NUMBER.match(text)
    return found[0] if found else "0"
