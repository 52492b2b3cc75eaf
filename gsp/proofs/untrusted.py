"""Reading what is not trusted: a file's JSON, its numbers and counts, each within bounds."""

from __future__ import annotations

import json
import math
import stat
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

from gsp.errors import one_line
from gsp.proofs.intervals import OutOfDomain
from gsp.proofs.programs import Rejected

Found = TypeVar("Found")

# Bounds on what is read: bytes, variables. 20,000 boxes of two slow and five fast variables fill so many bytes; twenty
# times as many hold what JSON makes of them.
MOST_BYTES, MOST_VARIABLES = 64_000_000, 64


def read_json(path: Path) -> Any:
    """The plain values of a file; raises `Rejected` when it is no JSON or too large, OSError when it cannot be read."""
    # Looked at before it is opened: opening a named pipe waits for ever, and a device has no end.
    if not stat.S_ISREG(path.stat().st_mode):
        raise Rejected("this is no regular file")
    with path.open("rb") as stream:
        data = stream.read(MOST_BYTES + 1)
    if len(data) > MOST_BYTES:
        raise Rejected(f"the file is larger than {MOST_BYTES} bytes")
    try:
        return json.loads(data.decode(), parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise Rejected(f"the file is no JSON: {error}") from None


def _no_constant(name: str) -> None:
    raise ValueError(f"{name} is no number")


def number(text: Any) -> Fraction:
    """A finite hexadecimal double."""
    if not isinstance(text, str) or len(text) > 40:
        raise Rejected(f"a number is a hexadecimal double. Got {str(text)[:60]!r}")
    try:
        value = float.fromhex(text)
    except (ValueError, OverflowError):
        raise Rejected(f"a number is a hexadecimal double. Got {text[:60]!r}") from None
    if not math.isfinite(value):
        raise Rejected(f"a number is finite. Got {text!r}")
    return Fraction(value)


def count(value: Any, most: int) -> int:
    """A whole number from 0 to `most`."""
    if type(value) is not int or not 0 <= value <= most:
        raise Rejected(f"a count is a whole number from 0 to {most}. Got {str(value)[:60]!r}")
    return value


def numbers(texts: Any, length: int) -> list[Fraction]:
    """A row of hexadecimal doubles."""
    if not isinstance(texts, list) or len(texts) != length:
        raise Rejected(f"a row has {length} numbers. Got {str(texts)[:60]!r}")
    return [number(text) for text in texts]


def signs(rows: Any, length: int, what: str, of: str) -> list[int]:
    """A row of 1 and -1."""
    if (
        not isinstance(rows, list)
        or len(rows) != length
        or any(type(s) is not int or abs(s) != 1 for s in rows)
    ):
        raise Rejected(f"{what} are 1 and -1, one for each {of}")
    return rows


def names(texts: Any) -> tuple[str, ...]:
    """A list of names: each once, and a word, so that a sentence says nothing else with it."""
    if not isinstance(texts, list) or not all(isinstance(name, str) and len(name) <= 200 for name in texts):
        raise Rejected("names are a list of text")
    if not all(name.isidentifier() for name in texts):
        raise Rejected(f"names are words. Got {str(texts)[:60]!r}")
    if len(set(texts)) != len(texts):
        raise Rejected(f"every name stands once. Got {str(texts)[:60]!r}")
    return tuple(texts)


def region(sides: Any, length: int) -> tuple[tuple[Fraction, Fraction], ...]:
    """So many intervals, the lower end first."""
    rows = [numbers(side, 2) for side in sides] if isinstance(sides, list) else []
    if len(rows) != length or any(low > high for low, high in rows):
        raise Rejected("the region has one interval for each slow variable and parameter, the lower end first")
    return tuple((low, high) for low, high in rows)


def of_format(read: Any, name: str) -> None:
    """Refuse what is not the table of a file of this format."""
    if not isinstance(read, dict) or read.get("format") != name:
        raise Rejected(f'the format of the file is not "{name}"')


def few(rows: Any, most: int, what: str) -> list:
    """A list of one entry to `most`."""
    if not isinstance(rows, list) or not 0 < len(rows) <= most:
        raise Rejected(f"there are from 1 to {most} {what}")
    return rows


def guarded(check: Callable[[], Found]) -> Found:
    """What `check` returns; whatever else a malformed file leads to becomes `Rejected`."""
    try:
        return check()
    except Rejected:
        raise
    except OutOfDomain as error:
        raise Rejected(f"an expression is not defined over a box: {error}") from None
    except (LookupError, TypeError, AttributeError, ArithmeticError, ValueError, RecursionError) as error:
        raise Rejected(f"the file is malformed: {one_line(error, 80)!r}") from None
