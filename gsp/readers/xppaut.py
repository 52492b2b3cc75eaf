"""XPPAUT's `.ode` files: their lines become a model file in TOML, which is read, with all its limits, like any other.

Everything in an .ode file is lower case for XPPAUT. Arrays are written out first. What this package has no place for
(tables, delays, `global` events, noise, difference and integral equations) is refused by name with its line's number.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NoReturn

from gsp.errors import ModelFileError, nearest
from gsp.readers.conditions import POSITIVE
from gsp.readers.expressions import CHARACTERS
from gsp.readers.foreign import ForeignModel, counted, fresh_name, number_in
from gsp.readers.xppaut_arrays import without_sums, written_out
from gsp.readers.xppaut_conditions import without_conditions
from gsp.readers.xppaut_order import check_order_of_quantities

# XPPAUT's own, where a file does not say.
TOTAL = "20"
NAMES = 4000
LINE = 20_000
# Characters of all expressions, arrays and sums written out.
WRITTEN = 1_000_000

_WORD = r"[a-z][a-z0-9_]{0,63}"
_PARAMETERS = re.compile(r"(?:p|par|param|params|parameter|parameters|number|num)\s+(.*)", re.DOTALL)
_INITIAL = re.compile(r"(?:i|init)\s+(.*)", re.DOTALL)
_AUXILIARY = re.compile(rf"aux\s+({_WORD})\s*=(.*)", re.DOTALL)
_RATE = re.compile(rf"(?:d({_WORD})\s*/\s*dt|({_WORD})\s*')\s*=(.*)", re.DOTALL)
_START = re.compile(rf"({_WORD})\s*\(\s*0\s*\)\s*=(.*)", re.DOTALL)
_FUNCTION = re.compile(rf"({_WORD})\s*\(\s*({_WORD}(?:\s*,\s*{_WORD})*)\s*\)\s*=(.*)", re.DOTALL)
_FIXED = re.compile(rf"!?\s*({_WORD})\s*=(.*)", re.DOTALL)
_SETTING = re.compile(rf"({_WORD})\s*=\s*([^\s,]+)")
_ASSIGNED = re.compile(rf"({_WORD})\s*=\s*([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)(?=[\s,]|$)|({_WORD})(?=[\s,]|$)")
_VALUE = re.compile(rf"({_WORD})\s*=\s*([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)(?=[\s,]|$)")
_TOKENS = re.compile(r"[a-z0-9_.]+|[^\sa-z0-9_.]")
_SET = re.compile(rf"set\s+({_WORD})\s*\{{([^{{}}]*)\}}")
_WORDS = re.compile(r"(?<![a-z0-9_.])[a-z_][a-z0-9_]*")

_REFUSED: dict[str, str] = {
    "global": "an event that changes the state",
    "table": "a table of numbers",
    "markov": "a Markov process",
    "wiener": "noise",
    "w": "noise",
    "volt": "an integral equation",
    "volterra": "an integral equation",
    "bdry": "a boundary-value problem",
    "bndry": "a boundary-value problem",
    "b": "a boundary-value problem",
    "solv": "an algebraic equation",
    "solve": "an algebraic equation",
    "special": "a sum over a network",
    "export": "a call of a library",
    "vector": "an array",
    "#include": "another file",
    "include": "another file",
}
_LEFT_OUT = ("set", "only", "options")
_NO_FUNCTIONS = {
    **dict.fromkeys(("delay", "del_shft"), "a delay"),
    **dict.fromkeys(("ran", "normal"), "noise"),
    **dict.fromkeys(("mod", "flr", "atan2"), "a jump"),
    "ishift": "an array of tables",
    **dict.fromkeys(("besselj", "bessely", "lgamma"), "a special function"),
    "int": "an integral",
    "hom_bcs": "a boundary condition",
}


@dataclass
class _File:
    """What the lines of a file said so far; every expression stands with its line's number."""

    states: dict[str, tuple[int, str]] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    definitions: dict[str, tuple[int, tuple[str, ...], str]] = field(default_factory=dict)
    derived: set[str] = field(default_factory=set)
    observables: dict[str, tuple[int, str]] = field(default_factory=dict)
    starts: dict[str, str] = field(default_factory=dict)
    settings: dict[str, str] = field(default_factory=dict)
    sets: dict[str, tuple[int, str]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def read_ode(text: str) -> ForeignModel:
    """What the `.ode` file `text` says; raises `ModelFileError` with the line for what is refused."""
    file = _read(text)
    own = {*file.states, *file.parameters, *file.definitions}
    taken = {*own, *file.observables}
    unknown = [name for name in file.starts if name not in file.states]
    if unknown:
        raise ModelFileError(
            f"{unknown[0]} has an initial value and no rate. Give it one." + nearest(unknown[0], file.states)
        )
    check_order_of_quantities(file.definitions, file.derived, {*file.states, "t"})
    model = ForeignModel("an .ode file of XPPAUT", parameters=file.parameters)
    model.starts = {name: file.starts.get(name, "0") for name in file.states}

    def step() -> str:
        if not positive:
            positive.append("positive" if "positive" not in taken else fresh_name("positive", taken))
            taken.add(positive[0])
            argument = "u" if "u" not in taken else fresh_name("u", taken)
            model.definitions[f"{positive[0]}({argument})"] = re.sub(r"\bu\b", argument, POSITIVE)
        return positive[0]

    positive: list[str] = []
    order = tuple(file.states)
    model.states = {name: _expression(*rate, step, order) for name, rate in file.states.items()}
    for name, (number, arguments, text) in file.definitions.items():
        renamed = {word: fresh_name(word, taken) for word in arguments if word in taken}
        body = _expression(number, text, step, order)
        body = _WORDS.sub(lambda match, new=renamed: new.get(match[0], match[0]), body)
        head = f"{name}({', '.join(renamed.get(word, word) for word in arguments)})" if arguments else name
        model.definitions[head] = body
    for name, (number, text) in file.observables.items():
        model.observables[fresh_name(name, taken) if name in own else name] = _expression(
            number, text, step, order
        )
    written = [*model.states.values(), *model.definitions.values(), *model.observables.values()]
    if sum(map(len, written)) > WRITTEN:
        raise ModelFileError(
            f"with its arrays and sums written out the file has more than {WRITTEN} characters. Use fewer members."
        )
    used = {word for text in written for word in _WORDS.findall(text)}
    model.total = file.settings.get("total", TOTAL)
    if "t" in used and "t" not in taken:
        model.states["t"], model.starts["t"] = "1", file.settings.get("t0", "0")
        begin = number_in(model.starts["t"], "t0")
        model.windows["t"] = begin, begin + number_in(model.total, "total")
    x, y = (file.settings.get(axis, "") for axis in ("xp", "yp"))
    if x != y and {x, y} <= {*model.states, *model.observables}:
        model.path = x, y
    _take_sets(file, model)
    _take_windows(file, model)
    _take_notes(file, model)
    return model


def _fail(number: int, fact: str, remedy: str) -> NoReturn:
    raise ModelFileError(f"line {number}: {fact}. {remedy}")


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """The lines that say something, in lower case, continued ones in one, with the number of the first."""
    first, held = 0, ""
    for number, line in enumerate(text.splitlines(), 1):
        # One blank for many: patterns with several runs of blanks would take quadratic time.
        words = " ".join(line.split())
        first = first or number
        if words.endswith("\\"):
            held += words[:-1] + " "
            if len(held) > LINE:
                _fail(first, f"a continued line is longer than {LINE} characters", "Split it.")
            continue
        whole, held, at = (held + words).strip().lower(), "", first
        first = 0
        if whole.startswith("#include") or (whole and whole[0] not in '#"'):
            yield at, whole
    if held.strip():
        yield first, held.strip().lower()


def _read(text: str) -> _File:
    file = _File()
    for number, line in written_out(_lines(text)):
        if line in ("done", "d"):
            break
        _take(file, number, line)
    if not file.states:
        raise ModelFileError("the file has no differential equation. Write x' = ... or dx/dt = ... .")
    if sum(map(len, (file.states, file.parameters, file.definitions, file.observables))) > NAMES:
        raise ModelFileError(f"the file has more than {NAMES} names. Use a smaller model.")
    return file


def _take(file: _File, number: int, line: str) -> None:
    first = re.split(r"[\s(={]", line, maxsplit=1)[0]
    plain = "=" not in line.split(None, 1)[0] and not re.match(rf"{_WORD}\s*(?:\([^)]*\)\s*)?'?\s*=", line)
    if line[0] == "@":
        file.settings.update(dict(_SETTING.findall(line[1:])))
    elif first in _REFUSED and plain:
        _fail(number, f"{first} is {_REFUSED[first]}, which no model here has", "Remove it.")
    elif first == "set" and (found := _SET.fullmatch(line)):
        file.sets[found[1]] = number, found[2]
    elif first in _LEFT_OUT and plain:
        file.left_out.append(f"{first} (line {number})")
    elif line[0] in "0123456789":
        _fail(number, "an equation without a name is not read", "Write x' = ... for a state.")
    elif found := _PARAMETERS.fullmatch(line) if plain else None:
        _assign(file.parameters, found[1], number, "a parameter")
    elif found := _INITIAL.fullmatch(line) if plain else None:
        _assign(file.starts, found[1], number, "an initial value")
    elif found := _AUXILIARY.fullmatch(line):
        file.observables[found[1]] = number, found[2].strip()
    elif found := _RATE.fullmatch(line):
        name = found[1] or found[2]
        if name in file.states:
            _fail(number, f"{name} has two rates", "Keep one.")
        file.states[name] = number, found[3].strip()
    elif found := _START.fullmatch(line):
        _assign(file.starts, f"{found[1]}={found[2].strip()}", number, "an initial value")
    elif re.match(rf"{_WORD}\s*\(\s*t\s*(\+\s*1\s*)?\)\s*=", line):
        _fail(number, "a difference or integral equation is no flow", "Write a differential equation.")
    elif found := _FUNCTION.fullmatch(line):
        _define(file, number, found[1], tuple(word.strip() for word in found[2].split(",")), found[3])
    elif found := _FIXED.fullmatch(line):
        _define(file, number, found[1], (), found[2])
        file.derived |= {found[1]} if line[0] == "!" else set()
    else:
        _fail(number, f"{line[:60]!r} is not understood", "Correct it, or remove it.")


def _define(file: _File, number: int, name: str, arguments: tuple[str, ...], text: str) -> None:
    if name in file.definitions:
        _fail(number, f"{name} is defined twice", "Keep one.")
    file.definitions[name] = number, arguments, text.strip()


def _assign(table: dict[str, str], text: str, number: int, what: str) -> None:
    rest = _ASSIGNED.sub("", text).replace(",", " ").strip()
    if rest:
        _fail(
            number,
            f"{rest[:40]!r} is not {what} with a number",
            "Write name=0.5, or !name=... for an expression.",
        )
    for name, value, bare in _ASSIGNED.findall(text):
        table[name or bare] = value or "0"


def _take_sets(file: _File, model: ForeignModel) -> None:
    """The sets of values that name states alone are further starts; those that change more are left out."""
    for name, (number, text) in file.sets.items():
        values = dict(_VALUE.findall(text))
        rest = _VALUE.sub("", text).replace(",", " ").strip()
        if values and not rest and values.keys() <= file.states.keys():
            model.other_starts[name] = values
        else:
            file.left_out.append(f"set {name} (line {number})")


def _take_windows(file: _File, model: ForeignModel) -> None:
    """The plotted window of a state, where it holds the start."""
    for axis, low, high in (("xp", "xlo", "xhi"), ("yp", "ylo", "yhi")):
        name = file.settings.get(axis, "")
        if name in model.starts and low in file.settings and high in file.settings:
            ends = number_in(file.settings[low], low), number_in(file.settings[high], high)
            value = number_in(model.starts[name], f"the initial value of {name}")
            if ends[0] <= value <= ends[1] and ends[0] < ends[1]:
                model.windows[name] = ends


def _expression(number: int, text: str, positive: Callable[[], str], order: tuple[str, ...]) -> str:
    """An expression in the grammar of model files, which is checked when the result is read."""
    if len(text) > CHARACTERS:
        _fail(number, f"an expression has {len(text)} characters; {CHARACTERS} are allowed", "Split it.")
    try:
        text = without_sums(text, order, longest=CHARACTERS)
    except ModelFileError as error:
        raise ModelFileError(f"line {number}: {error}") from None
    for word in _WORDS.findall(text):
        if word in _NO_FUNCTIONS:
            _fail(
                number,
                f"{word} is {_NO_FUNCTIONS[word]}, and the analysis needs smooth rates",
                "Write a smooth one.",
            )
    if _is_chain(text):
        _fail(
            number, "a power of a power reads differently from program to program", "Put parentheses: (x^y)^z."
        )
    try:
        text = without_conditions(text, positive=positive)
    except ModelFileError as error:
        raise ModelFileError(f"line {number}: {error}") from None
    except RecursionError:
        _fail(number, "an expression is nested too deeply", "Remove parentheses.")
    return re.sub(r"(?<![a-z0-9_.])log10\s*\(", "(1/log(10))*log(", text)


def _is_chain(text: str) -> bool:
    """Whether the base of a power is a power itself: XPPAUT reads 2^3^2 from the left, model files from the right."""
    words = _TOKENS.findall(text.replace("**", "^"))
    for power in (i for i, word in enumerate(words) if word == "^"):
        base = power - 1
        if base >= 0 and words[base] == ")":
            depth = 0
            while base >= 0:
                depth += (words[base] == ")") - (words[base] == "(")
                if depth == 0:
                    break
                base -= 1
            if base > 0 and words[base - 1][0].isalpha():
                base -= 1
        if base > 0 and words[base - 1] == "^":
            return True
    return False


def _take_notes(file: _File, model: ForeignModel) -> None:
    renamed = sorted(set(file.observables) & {*file.states, *file.parameters, *file.definitions})
    model.understood = "understood: " + ", ".join(
        counted(len(table), noun)
        for table, noun in (
            (file.states, "state"),
            (file.parameters, "parameter"),
            (file.definitions, "definition"),
            (file.observables, "auxiliary quantity"),
        )
    )
    if renamed:
        model.notes.append(f"renamed, for they mean something already: {', '.join(renamed)[:300]}")
    model.notes.append(
        "region: the plotted window where the file has one, else a guess, a box around a slow one's start"
    )
    model.left_out = file.left_out
    known = ("total", "t0", "xp", "yp", "xlo", "xhi", "ylo", "yhi")
    ignored = [key for key in file.settings if key not in known]
    if ignored:
        model.notes.append("settings left out: " + ", ".join(ignored)[:300])
