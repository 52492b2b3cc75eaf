"""Arrays in XPPAUT's files, written out: x[1..9]' = ... with [j] and [j+1], blocks from %[1..9] to %, sums over shifts.

As in XPPAUT an index is put in as text: x[3] is x3, and 0.[j] is 0.3 where j is 3. What XPPAUT would take for
something else than it looks like is refused: a second range in a line, an index below 0, a shift past the last state.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from gsp.errors import ModelFileError
from gsp.readers.expressions import parse_expression
from gsp.readers.xppaut_lines import fail

# The most members of an array, and the most lines and characters of a file written out.
MEMBERS, LINES, WRITTEN = 2000, 20_000, 1_000_000

_RANGE = re.compile(r"\[\s*(-?[0-9]{1,6})\s*\.{2,3}\s*(-?[0-9]{1,6})\s*\]")
_INDEX = re.compile(r"(?<!int)\[([^][]*)\]")
_PLACE = re.compile(r"j(?:([-+*])([0-9]{1,6}))?")
_BLOCK = re.compile(r"%\s*\[\s*(-?[0-9]{1,6})\s*\.{2,3}\s*(-?[0-9]{1,6})\s*\]")
_SUM = re.compile(r"(?<![a-z0-9_.])sum\s*\(")
_SHIFT = re.compile(r"(?<![a-z0-9_.])shift\s*\(")
_RUNNING = re.compile(r"(?<![a-z0-9_.])i'")
# Two * are a power, and none has a sign before it.
_INTEGERS = re.compile(r"(?:[-+()0-9]|(?<!\*)\*)+")
_OPERATORS: Mapping[str, Callable[[int, int], int]] = {"+": operator.add, "-": operator.sub, "*": operator.mul}

Line = tuple[int, str]


def written_out(lines: Iterable[Line]) -> Iterator[Line]:
    """The lines (number, text) with every array and block written out.

    Raises `ModelFileError` with the number of the line for what XPPAUT would read differently, or not at all.
    """
    held: list[Line] | None = None
    block, counts = range(0), [0, 0]

    def counted(number: int, text: str) -> Line:
        counts[0] += 1
        counts[1] += len(text)
        if counts[0] > LINES or counts[1] > WRITTEN:
            fail(
                number,
                f"with its arrays written out the file has more than {LINES} lines or {WRITTEN} characters",
                "Use fewer members.",
            )
        return number, text

    for number, text in lines:
        if text[0] == "%":
            opening = _BLOCK.fullmatch(text)
            if opening is not None and held is None:
                held, block = [], _members(number, opening[1], opening[2])
            elif held is not None and ".." not in text:
                for k in block:
                    for at, line in held:
                        yield counted(at, _placed(at, line, k))
                held = None
            elif ".." not in text:
                # XPPAUT takes it for a command that it does not know, and people for a comment.
                yield counted(number, text)
            else:
                fail(
                    number,
                    f"{text[:40]!r} opens or closes no block",
                    "A block goes from %[1..9] to %, in no other.",
                )
        elif held is not None:
            if _RANGE.search(text):
                fail(number, "a range within a block is not read", "Take it out of the block.")
            held.append((number, text))
        elif text[0] in '@"' or "[" not in text:
            yield counted(number, text)
        elif (found := _RANGE.search(text)) is None:
            yield counted(number, _placed(number, text, None))
        else:
            rest = f"{text[: found.start()]}[j]{text[found.end() :]}"
            if _RANGE.search(rest):
                fail(
                    number,
                    "the line has a second range, of which XPPAUT takes the first member alone",
                    "Split it.",
                )
            for k in _members(number, found[1], found[2]):
                yield counted(number, _placed(number, rest, k))
    if held is not None:
        fail(held[0][0] if held else 0, "a block is not closed", "End it with a line that is %.")


def _members(number: int, first: str, last: str) -> range:
    low, high = int(first), int(last)
    if low < 0 or high < low:
        fail(number, f"the range [{low}..{high}] has a negative index or no member", "Write [1..9].")
    if high - low >= MEMBERS:
        fail(number, f"the range [{low}..{high}] has more than {MEMBERS} members", "Use fewer.")
    return range(low, high + 1)


def _placed(number: int, text: str, k: int | None) -> str:
    """The text with its indices put in; `k` is that of [j]."""

    def index(match: re.Match[str]) -> str:
        inside = "".join(match[1].split())
        if re.fullmatch("[0-9]{1,6}", inside):
            return str(int(inside))
        place = _PLACE.fullmatch(inside)
        if place is None:
            fail(
                number,
                f"the index [{match[1][:20]}] is not understood",
                "Write [3], [j], [j+1], [j-1] or [j*2].",
            )
        if k is None:
            fail(number, "[j] stands outside of an array", "Give the line a range, such as x[1..9]' = ... .")
        value = k if place[1] is None else _OPERATORS[place[1]](k, int(place[2]))
        if value < 0:
            fail(number, f"the index [{inside}] is {value} for j = {k}", "Write the members at the ends out.")
        return str(value)

    placed = _INDEX.sub(index, text)
    if re.search(r"(?<!int)\[", placed):
        fail(number, "a bracket is not closed", "Close it.")
    return placed


def without_sums(text: str, states: Sequence[str], *, longest: int) -> str:
    """An expression with sum(a,b)of(...) and shift(x, k) written out; `states` are in the order of their equations.

    Raises `ModelFileError` for bounds and shifts that are no whole numbers, for what lies past the states, and for what
    gets longer than `longest` characters.
    """
    while found := _SUM.search(text):
        (low, high), end = _arguments(text, found.end(), 2)
        rest = re.compile(r"\s*of\s*\(").match(text, end)
        if rest is None:
            raise ModelFileError("a sum is written sum(0,9)of(...).", "Complete it.")
        (body,), end = _arguments(text, rest.end(), 1)
        if _SUM.search(body):
            raise ModelFileError(
                "a sum within a sum is not read.", "Write the inner one as a quantity of its own."
            )
        first, last = _whole(low), _whole(high)
        if last - first >= MEMBERS or len(text) + (last - first + 1) * len(body) > longest:
            raise ModelFileError(
                f"a sum from {first} to {last} is too long to be written out.", "Use fewer terms."
            )
        terms = [f"({_RUNNING.sub(f'({i})', body)})" for i in range(first, last + 1)]
        text = f"{text[: found.start()]}({'+'.join(terms) or '0'}){text[end:]}"
    if _SHIFT.search(text) is None:
        return text
    places, pieces, done = {name: place for place, name in enumerate(states)}, [], 0
    while found := _SHIFT.search(text, done):
        (name, by), end = _arguments(text, found.end(), 2)
        place = _whole(by)
        if name.strip() not in places:
            raise ModelFileError("shift goes from a state to another.", got=f"shift({name.strip()[:40]}, ...)")
        there = places[name.strip()] + place
        if not 0 <= there < len(states):
            raise ModelFileError(
                f"shift({name.strip()},{place}) lies past the first or the last state.",
                "Correct its second argument.",
            )
        pieces += [text[done : found.start()], states[there]]
        done = end
    return "".join([*pieces, text[done:]])


def _arguments(text: str, begin: int, count: int) -> tuple[list[str], int]:
    """The arguments behind an opening parenthesis that ends at `begin`, and where its partner ends."""
    depth, last, found = 1, begin, []
    for i in range(begin, len(text)):
        depth += (text[i] == "(") - (text[i] == ")")
        if depth == 0 or (depth == 1 and text[i] == ","):
            found.append(text[last:i])
            last = i + 1
        if depth == 0:
            if len(found) != count:
                raise ModelFileError(
                    "sum and shift take two arguments, and of one.", got=f"{text[begin:i][:60]!r}"
                )
            return found, i + 1
    raise ModelFileError("a parenthesis is not closed.", "Close it.")


def _whole(text: str) -> int:
    """A whole number written with + - * mod and parentheses."""
    plain = "".join(text.split())
    try:
        # The last one holds no other.
        while (begin := plain.rfind("mod(")) >= 0:
            arguments, end = _arguments(plain, begin + len("mod("), 2)
            left, right = map(_whole, arguments)
            # XPPAUT's is at least 0.
            plain = f"{plain[:begin]}({left % right if right > 0 else ''}){plain[end:]}"
        value = parse_expression(plain, symbols={}) if _INTEGERS.fullmatch(plain) else None
    except ModelFileError:
        value = None
    if value is None or abs(value) > 10**9:
        raise ModelFileError(
            "bounds of sums and shifts are whole numbers, of digits, i', + - * and mod.",
            got=f"{text.strip()[:60]!r}",
        )
    return int(value)
