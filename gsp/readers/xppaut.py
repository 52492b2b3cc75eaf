"""XPPAUT's `.ode` files: their lines become a model file in TOML, which is read, with all its limits, like any other.

Everything in an .ode file is lower case for XPPAUT. Arrays are written out first. What this package has no place for
(tables, delays, `global` events, noise, difference and integral equations) is refused by name with its line's number.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from gsp.errors import ModelFileError, met_at
from gsp.readers.expressions import CHARACTERS, FUNCTIONS
from gsp.readers.foreign import WORDS, ForeignModel, fresh_name, names_in, number_in
from gsp.readers.xppaut_arrays import WRITTEN, without_sums, written_out
from gsp.readers.xppaut_conditions import without_conditions
from gsp.readers.xppaut_functions import Helpers
from gsp.readers.xppaut_lines import (
    MISSING,
    WORD,
    LineKind,
    Statement,
    fail,
    lines_of,
    number_at,
    pieces_of,
    start_at,
    statement_of,
)
from gsp.readers.xppaut_order import taken_a_step_late
from gsp.systems.arguments import counted

# XPPAUT's own, where a file does not say.
TOTAL = "20"
NAMES = 4000

# Settings of which XPPAUT takes the number that they begin with.
_NUMBERS = ("total", "t0", "xlo", "xhi", "ylo", "yhi")
# First letters of the methods that take the rates for a flow; with any other XPPAUT iterates them as a map.
_FLOWS = "abceglmqrsvy258"
_SETTING = re.compile(rf"(?<![^ ,])({WORD})=([^ ,]+)")
_SPACED = re.compile(r"(?<![^ ,=])[^ ,=]+(?: = ?|= )[^ ,]+")
_VALUE = re.compile(rf"({WORD})\s*=\s*([-+]?[0-9.]+(?:e[-+]?[0-9]+)?)(?=[\s,]|$)")
_TOKENS = re.compile(r"[a-z0-9_.]+|[^\sa-z0-9_.]")
_SET = re.compile(rf"set\w* ({WORD}) ?\{{([^{{}}]*)\}}")
_NO_FUNCTIONS = {
    **dict.fromkeys(("delay", "del_shft"), "a delay"),
    **dict.fromkeys(("ran", "normal"), "noise"),
    "atan2": "a jump",
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
    missing: dict[str, tuple[int, str]] = field(default_factory=dict)
    passed_over: dict[str, int] = field(default_factory=dict)
    shortened: list[str] = field(default_factory=list)
    spaced: list[str] = field(default_factory=list)


def read_ode(text: str) -> ForeignModel:
    """What the `.ode` file `text` says; raises `ModelFileError` with the line for what is refused."""
    file = _read(text)
    own = {*file.states, *file.parameters, *file.definitions}
    taken = {*own, *file.observables}
    unknown = [name for name in file.starts if name not in file.states]
    if unknown:
        raise ModelFileError(
            f"{unknown[0]} has an initial value and no rate.",
            "Give it one.",
            value=unknown[0],
            known=file.states,
        )
    late = taken_a_step_late(file.definitions, file.derived, {*file.states, "t"})
    model = ForeignModel("an .ode file of XPPAUT", parameters=file.parameters)
    model.starts = {name: file.starts.get(name, "0") for name in file.states}

    bodies = {name: text for name, (_, _, text) in file.definitions.items()}
    live = names_in((text for _, text in file.states.values()), bodies)
    arguments = {word for _, words, _ in file.definitions.values() for word in words}
    for text, number in file.passed_over.items():
        name = text.partition(" ")[0]
        if name in live - own - arguments - {"t", *FUNCTIONS} and "=" in text:
            fail(
                number, f"XPPAUT passes over {text[:40]!r}, and a rate uses {name}", "Write it without blanks."
            )
    for name, (number, reason) in file.missing.items():
        if name in live:
            fail(number, reason, "Remove it.")
        file.left_out.append(f"{name} (line {number})")
    helpers = Helpers(model.definitions, taken)
    order = tuple(file.states)
    model.states = {name: _expression(*rate, helpers, order) for name, rate in file.states.items()}
    dropped: set[str] = set(file.missing)
    for name, (number, arguments, text) in file.definitions.items():
        try:
            _check_kept(name, number, text, dropped)
            renamed = {word: fresh_name(word, taken) for word in arguments if word in taken or word == "t"}
            body = _expression(number, text, helpers, order)
            body = WORDS.sub(lambda match, new=renamed: new.get(match[0], match[0]), body)
            head = f"{name}({', '.join(renamed.get(word, word) for word in arguments)})" if arguments else name
            model.definitions[head] = body
        except ModelFileError as error:
            if name in live:
                raise
            _leave_out(file, name, error, dropped)
    for name, (number, text) in file.observables.items():
        try:
            _check_kept(name, number, text, dropped)
            body = _expression(number, text, helpers, order)
            model.observables[fresh_name(name, taken) if name in own else name] = body
        except ModelFileError as error:
            _leave_out(file, f"aux {name}", error, dropped)
    written = [*model.states.values(), *model.definitions.values(), *model.observables.values()]
    if sum(map(len, written)) > WRITTEN:
        raise ModelFileError(
            f"with its arrays and sums written out the file has more than {WRITTEN} characters.",
            "Use fewer members.",
        )
    used = {word for text in written for word in WORDS.findall(text)}
    model.total = file.settings.get("total", TOTAL)
    if "t" in used and "t" not in taken:
        model.states["t"], model.starts["t"] = "1", file.settings.get("t0", "0")
        begin = number_in(model.starts["t"], "t0")
        model.windows["t"] = begin, begin + number_in(model.total, "total")
    _take_view(file, model)
    _take_sets(file, model)
    _take_windows(file, model)
    _take_notes(file, model, late)
    return model


def _check_kept(name: str, number: int, text: str, dropped: set[str]) -> None:
    lost = sorted(dropped & {*WORDS.findall(text)})
    if lost:
        fail(number, f"{name} uses {lost[0]}, which is left out", "Remove it.")


def _leave_out(file: _File, name: str, error: ModelFileError, dropped: set[str]) -> None:
    """Leave a quantity out that cannot be read and that no rate needs."""
    dropped.add(name)
    file.left_out.append(f"{name} ({error!s:.100})")


def _read(text: str) -> _File:
    if re.match(r"\s*\+?0*[1-9]", text):
        fail(
            1,
            "the file begins with a number, which is XPPAUT's old form",
            "Write it in the new one, x' = ... .",
        )
    file = _File()
    for number, line in written_out(lines_of(text)):
        statement = statement_of(number, line)
        if statement.kind is LineKind.END:
            if line not in ("done", "d"):
                file.left_out.append(f"what stands behind line {number} ({line[:40]!r} ends the file)")
            break
        _take(file, number, statement)
    if not file.states:
        raise ModelFileError("the file has no differential equation.", "Write x' = ... or dx/dt = ... .")
    if sum(map(len, (file.states, file.parameters, file.definitions, file.observables))) > NAMES:
        raise ModelFileError(f"the file has more than {NAMES} names.", "Use a smaller model.")
    return file


def _take(file: _File, number: int, statement: Statement) -> None:
    kind, name, text, arguments = statement
    match kind:
        case LineKind.SETTINGS:
            found = dict(_SETTING.findall(text))
            for key, value in found.items():
                if key.startswith("meth") and value[0] not in _FLOWS:
                    fail(
                        number,
                        f"{key}={value[:40]} makes a map of the rates, which is no flow",
                        "Give rates of a flow.",
                    )
            file.settings |= {
                key: number_at(value) if key in _NUMBERS else value for key, value in found.items()
            }
            file.shortened += [f"nothing of {words[:40]!r} (line {number})" for words in _SPACED.findall(text)]
        case LineKind.PARAMETERS:
            _assign(file, file.parameters, text, number, "a parameter")
        case LineKind.STARTS:
            _assign(file, file.starts, text, number, "an initial value")
        case LineKind.START:
            file.starts[name] = found = start_at(text)
            if found != text.strip():
                file.shortened.append(f"{name}(0) = {found} of {text[:40]!r} (line {number})")
        case LineKind.AUXILIARY:
            file.observables[_plain(name, file.observables)] = number, text
        case LineKind.RATE if name in file.states:
            fail(number, f"{name} has two rates", "Keep one.")
        case LineKind.RATE:
            file.states[name] = number, text
        case LineKind.FUNCTION | LineKind.QUANTITY | LineKind.CONSTANT:
            if name in file.definitions:
                fail(number, f"{name} is defined twice", "Keep one.")
            file.definitions[name] = number, arguments, text
            file.derived |= {name} if kind is LineKind.CONSTANT else set()
        case LineKind.SET if found := _SET.fullmatch(text):
            file.sets[found[1]] = number, found[2]
        case LineKind.MISSING:
            reason = number, f"{name} is {MISSING['ta' if name[0] == 't' else 'w']}, which no model here has"
            file.missing |= dict.fromkeys(text.split(), reason)
        case LineKind.SET | LineKind.LEFT_OUT:
            file.left_out.append(f"{name} (line {number})")
        case _ if text[0] != "%":
            file.passed_over.setdefault(text, number)


def _plain(name: str, taken: Collection[str]) -> str:
    """A plain word for the name of an auxiliary quantity, which no expression can use."""
    word = re.sub(r"[^a-z0-9_]", "_", name)[:60]
    word = word if re.match("[a-z]", word) else f"aux{'' if word[:1] == '_' else '_'}{word}"
    return fresh_name(word, {*taken}) if word in taken and word != name else word


def _assign(file: _File, table: dict[str, str], text: str, number: int, what: str) -> None:
    """Take name=value: of a value XPPAUT takes the number that it begins with, and a name alone has 0."""
    file.spaced += [f"{words[:40]!r} (line {number})" for words in _SPACED.findall(text)]
    for name, value in pieces_of(text):
        if name[0] == "#":
            file.passed_over.setdefault(name, number)
            continue
        given = (value or "").rstrip(";")
        found = number_at(given)
        begins = given[:1] in "0.+-" or table is file.starts
        if not re.fullmatch(WORD, name) or (value is not None and found == "0" and not begins):
            said = name if value is None else f"{name}={value}"
            fail(
                number,
                f"{said[:60]!r} is not {what} with a number",
                "Write name=0.5, or !name=... for an expression.",
            )
        if table is file.parameters and name in table:
            fail(number, f"the parameter {name} is given twice", "Keep one.")
        if found != given and value:
            file.shortened.append(f"{name} = {found} of {given[:40]!r} (line {number})")
        table[name] = found


def _take_sets(file: _File, model: ForeignModel) -> None:
    """The sets of values that name states alone are further starts; those that change more are left out."""
    for name, (number, text) in file.sets.items():
        values = dict(_VALUE.findall(text))
        rest = _VALUE.sub("", text).replace(",", " ").strip()
        if values and not rest and values.keys() <= file.states.keys():
            model.other_starts[name] = values
        else:
            file.left_out.append(f"set {name} (line {number})")


def _take_view(file: _File, model: ForeignModel) -> None:
    """What is plotted, as a view, and as the path where that is a plane; for XPPAUT it is t and the first state."""
    plotted = {axis: file.settings.get(f"{axis}p", "").rstrip(",") for axis in "xyz"}
    if not plotted["x"] and not plotted["y"]:
        return
    x, y = plotted["x"] or "t", plotted["y"] or next(iter(model.states))
    solid = file.settings.get("axes", "")[:1] == "3"
    names = (x, y, plotted["z"]) if solid and plotted["z"] else (x, y)
    shown = {*model.states, *model.observables, "t"}
    if len(set(names)) < len(names) or not shown.issuperset(names):
        return
    ranges = {}
    for axis, name in zip("xyz", names, strict=False):
        ends = [file.settings.get(f"{axis}{end}") for end in ("lo", "hi")] if len(names) == 2 else []
        if all(ends) and ends and number_in(ends[0] or "", "lo") < number_in(ends[1] or "", "hi"):
            ranges[name] = ends[0] or "", ends[1] or ""
    model.views["plot"] = names, ranges
    if len(names) == 2 and "t" not in names:
        model.path = x, y


def _take_windows(file: _File, model: ForeignModel) -> None:
    """The plotted window of a state, where it holds the start."""
    for axis, low, high in (("xp", "xlo", "xhi"), ("yp", "ylo", "yhi")):
        name = file.settings.get(axis, "")
        if name in model.starts and low in file.settings and high in file.settings:
            ends = number_in(file.settings[low], low), number_in(file.settings[high], high)
            value = number_in(model.starts[name], f"the initial value of {name}")
            if ends[0] <= value <= ends[1] and ends[0] < ends[1]:
                model.windows[name] = ends


def _expression(number: int, text: str, helpers: Helpers, order: tuple[str, ...]) -> str:
    """An expression in the grammar of model files, which is checked when the result is read."""
    if len(text) > CHARACTERS:
        fail(number, f"an expression has {len(text)} characters; {CHARACTERS} are allowed", "Split it.")
    with met_at(f"line {number}"):
        text = without_sums(text, order, longest=CHARACTERS)
    for word in WORDS.findall(text):
        if word in _NO_FUNCTIONS:
            fail(
                number,
                f"{word} is {_NO_FUNCTIONS[word]}, and the analysis needs smooth rates",
                "Write a smooth one.",
            )
    if _is_chain(text):
        fail(
            number, "a power of a power reads differently from program to program", "Put parentheses: (x^y)^z."
        )
    try:
        with met_at(f"line {number}"):
            text = without_conditions(text, positive=lambda: helpers.name("positive"))
    except RecursionError:
        fail(number, "an expression is nested too deeply", "Remove parentheses.")
    return helpers.written(text)


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


def _take_notes(file: _File, model: ForeignModel, late: Mapping[str, str]) -> None:
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
    if late:
        reason = ", ".join(
            f"{name} (line {file.definitions[name][0]}) uses {other}" for name, other in late.items()
        )
        model.notes.append(
            f"quantities above one that they use: {reason[:300]}; XPPAUT takes its value of the step before, and here "
            "both are of one time, which XPPAUT's runs tend to as its steps get small"
        )
    if file.shortened:
        model.notes.append("values that XPPAUT does not take as they stand: " + "; ".join(file.shortened)[:300])
    if file.spaced:
        words = ", ".join(file.spaced)[:300]
        model.notes.append(f"values with a blank beside =, where XPPAUT 6 has 0 or stops: {words}")
    if file.passed_over:
        lines = ", ".join(f"{text[:40]!r} (line {number})" for text, number in file.passed_over.items())
        model.notes.append(f"lines that XPPAUT passes over: {lines[:300]}")
    model.left_out = file.left_out
    known = (*_NUMBERS, "xp", "yp", "zp", "axes")
    ignored = [key for key in file.settings if key not in known]
    if ignored:
        model.notes.append("settings left out: " + ", ".join(ignored)[:300])
