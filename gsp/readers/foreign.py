"""Foreign models, whatever their format: what one says, and the model file in TOML that says the same.

A parameter called epsilon or eps is the small parameter, unless another is named, if it is at most 1/10 and stands as
a pole or as a factor of a whole rate; else it is a parameter like others, and the model has no small one. Time stays
the file's own, fast or slow.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field, replace

import sympy as sp

from gsp.algebra.laurent import misplaced_epsilon, pole_order
from gsp.errors import ModelFileError, nearest
from gsp.scenes.scene import Scene

SMALL = ("epsilon", "eps")
# A parameter that is larger is not small by its name alone.
LARGEST = 0.1
WORDS = re.compile(r"(?<![A-Za-z0-9_.])[A-Za-z_][A-Za-z0-9_]*")


@dataclass
class Import:
    """A foreign model: the TOML `text` that says the same, and `notes` on what was understood, renamed and left out."""

    text: str
    notes: list[str]


@dataclass
class ForeignModel:
    """What a foreign file says, in words of the grammar of model files.

    `states` maps names to rates, `parameters` to numbers, `definitions` heads to expressions, `starts` states to
    numbers; `other_starts` are further ones by name; `bounds` are intervals that no run leaves, and `windows` those
    that the file draws, or that are guessed better here than around the start: they make a region where one is needed;
    `views` are names of axes with their ranges; `worked_out` maps what the file works out once, at the start, to
    the names that it is made of, `sizes` of compartments among them. `understood` and `notes` are for the reader;
    `small` is set where the format itself says what is fast.
    """

    origin: str
    states: dict[str, str] = field(default_factory=dict)
    parameters: dict[str, str] = field(default_factory=dict)
    definitions: dict[str, str] = field(default_factory=dict)
    observables: dict[str, str] = field(default_factory=dict)
    starts: dict[str, str] = field(default_factory=dict)
    other_starts: dict[str, dict[str, str]] = field(default_factory=dict)
    bounds: dict[str, tuple[float, float]] = field(default_factory=dict)
    windows: dict[str, tuple[float, float]] = field(default_factory=dict)
    total: str = "20"
    path: tuple[str, str] | None = None
    views: dict[str, tuple[tuple[str, ...], dict[str, tuple[str, str]]]] = field(default_factory=dict)
    worked_out: dict[str, frozenset[str]] = field(default_factory=dict)
    sizes: Collection[str] = ()
    small: str | None = None
    title: str = ""
    understood: str = ""
    notes: list[str] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)


def imported(model: ForeignModel, *, small: str | None, read: Callable[[str], Scene]) -> tuple[Import, Scene]:
    """`model` as a model file, and the scene that it is; `small` names its small parameter.

    `read` gives the scene of a model file. Raises `ModelFileError` when `small` can be none.
    """
    name, ordinary = _small(model, small, read)
    worked_out = {p: tuple(words) for p in model.parameters if p != name and (words := _made_of(model, p))}
    if name is None:
        notes = [model.understood, *ordinary, *_told(model)]
        text = _written(model, None, notes, fast=())
        return Import(text, notes), replace(read(text), worked_out=worked_out)
    kept = _kept(model, name)
    if name not in _reached(model):
        if kept:
            raise ModelFileError(
                f"{name} is to be the small parameter, and stands in no rate, only in values that are worked out once: "
                f"{kept}.",
                f"Make rules of them, as k := 1/{name} is one in Antimony.",
            )
        raise ModelFileError(
            f"{name} is to be the small parameter, and stands in no rate.",
            f"Name the one that is small: gsp import FILE --small NAME. There are {_others(model, name)}; "
            "where none is small, write the factor that separates the time scales into the rates first.",
        )
    notes = [
        model.understood,
        f"small parameter: {name} = {model.parameters[name]}",
        *ordinary,
        *([f"worked out once, for this {name}, and kept when it changes: {kept}"] if kept else []),
        *_told(model),
        "region: what the file says of bounds and windows, else a guess around the start",
    ]
    scene = read(_written(model, name, notes, fast=()))
    system = scene.system
    assert system.epsilon is not None
    # Without a pole the file's time is the fast one.
    slow = any(pole_order(rate, system.epsilon) for rate in system.rates)
    rates = [rate if slow else rate / system.epsilon for rate in system.rates]
    fast = [state.name for state, rate in zip(system.states, rates) if pole_order(rate, system.epsilon)]
    # What differs from the text that was read is not read again.
    scene = replace(scene, region=_region(model, fast), worked_out=worked_out)
    return Import(_written(model, name, notes, fast=fast), notes), scene


def _told(model: ForeignModel) -> list[str]:
    """What the file's reader has to say, what it worked out once, and what it left out."""
    once = [
        f"{word} (of {', '.join(sorted(made_of))})"
        for word, parts in model.worked_out.items()
        if (made_of := parts & model.parameters.keys() - {*model.sizes})
    ]
    return [
        *model.notes,
        *(["worked out once, at the start: " + ", ".join(once)[:300]] if once else []),
        *(["left out: " + ", ".join(model.left_out)[:300]] if model.left_out else []),
    ]


def free_name(name: str, taken: set[str]) -> str:
    """`name`, or one like it where it is taken or too long; it is taken from now on."""
    if name in taken or len(name) > 64:
        return fresh_name(name, taken)
    taken.add(name)
    return name


def fresh_name(name: str, taken: set[str]) -> str:
    """A name like `name` that nothing has yet, and that is taken from now on."""
    new = next(new for new in (f"{name[:58]}_{k}" for k in range(1, len(taken) + 2)) if new not in taken)
    taken.add(new)
    return new


def _small(
    model: ForeignModel, small_name: str | None, read: Callable[[str], Scene]
) -> tuple[str | None, list[str]]:
    """The small parameter, None where nothing says which, and why others with its name are ordinary ones."""
    if model.small is not None:
        if small_name is not None:
            raise ModelFileError(
                f"fast reactions have a small parameter of their own, {model.small}.",
                "Leave it out, or take the reactions' attribute away.",
                got=f"--small {small_name[:64]}",
            )
        return model.small, []
    if small_name is not None:
        if small_name not in model.parameters:
            raise ModelFileError(
                f"there is no parameter {small_name[:64]!r} to be the small one."
                + nearest(small_name[:64], model.parameters),
                f"There are {_others(model, small_name)}.",
            )
        return small_name, []
    called = [name for name in SMALL if name in model.parameters]
    ordinary: list[str] = []
    for name in called:
        why = _why_ordinary(model, name, read)
        if why is None:
            return name, ordinary
        ordinary.append(f"{name} = {model.parameters[name]} is an ordinary parameter: {why}")
    return None, ordinary


def _why_ordinary(model: ForeignModel, name: str, read: Callable[[str], Scene]) -> str | None:
    """Why the parameter `name` does not separate time scales, or `None`."""
    value = number_in(model.parameters[name], f"the value of {name}")
    if not 0 < value <= LARGEST:
        return f"a small one is above 0 and at most {LARGEST:g}"
    if name not in _reached(model):
        kept = _kept(model, name)
        return "it stands in no rate" + (f", only in values that are worked out once: {kept}" if kept else "")
    # Read as an ordinary parameter, it may stand anywhere.
    system = read(_written(model, None, (), fast=())).system
    symbol = next(s for s in system.parameters if s.name == name)
    for rate in system.rates:
        wrong = misplaced_epsilon(rate, symbol)
        if wrong is not None:
            return f"it stands inside {str(wrong)[:100]}"
    scales = (
        pole_order(e, symbol) or not pole_order(e / symbol, symbol) for e in system.rates if e.has(symbol)
    )
    if not any(scales):
        return "it is no pole and no factor of a whole rate"
    if any(pole_order(rate, symbol) > 0 for rate in system.rates):
        return None
    for state, rate in zip(system.states, system.rates):
        # Without a pole what it is no factor of would be fast.
        factor = 1.0 if pole_order(rate / symbol, symbol) <= 0 else _factor(rate, system.parameters)
        if factor <= value:
            return f"{state} would be fast, and its rate has a factor that is no larger, {factor:g}"
    return None


def _factor(rate: sp.Expr, parameters: Mapping[sp.Symbol, sp.Rational]) -> float:
    """The number, and the positive parameters, of which a whole rate is a multiple."""
    factor = abs(float(rate.as_content_primitive()[0]))
    for parameter, value in parameters.items():
        if value > 0 and rate.has(parameter) and misplaced_epsilon(rate, parameter) is None:
            factor *= float(value) if pole_order(rate / parameter, parameter) <= 0 else 1.0
    return factor


def _kept(model: ForeignModel, name: str) -> str:
    """The values that are worked out once, at the start, and made of `name`."""
    return ", ".join(_made_of(model, name))[:300]


def _made_of(model: ForeignModel, name: str) -> list[str]:
    return [word for word, made_of in model.worked_out.items() if name in made_of]


def _others(model: ForeignModel, name: str) -> str:
    return ", ".join(other for other in model.parameters if other != name)[:300] or "none"


def names_in(rates: Iterable[str], bodies: Mapping[str, str]) -> set[str]:
    """The names in `rates`, by way of definitions too, of which `bodies` has the texts."""
    waiting, reached = list(rates), set[str]()
    while waiting:
        new = set(WORDS.findall(waiting.pop())) - reached
        reached |= new
        waiting += [bodies[name] for name in new if name in bodies]
    return reached


def _reached(model: ForeignModel) -> set[str]:
    bodies = {head.partition("(")[0].strip(): text for head, text in model.definitions.items()}
    return names_in(model.states.values(), bodies)


def _written(model: ForeignModel, small: str | None, notes: Collection[str], *, fast: Collection[str]) -> str:
    """The model as TOML."""
    lines = [
        f"# Read from {model.origin}.",
        *([] if small is None else [f"epsilon = {json.dumps(small)}"]),
        *([f"title = {json.dumps(model.title)}"] if model.title else []),
        f"description = {json.dumps('; '.join(notes)[:5000])}",
        "",
        "[parameters]",
    ]
    lines += [f"{name} = {json.dumps(number)}" for name, number in model.parameters.items() if name != small]
    # Without a small parameter a region comes from a run, where one is needed.
    region = model.bounds if small is None else _region(model, fast)
    tables = {
        "definitions": _quoted(model.definitions),
        "states": _quoted(model.states),
        "observables": _quoted(model.observables),
        "region": {name: f"[{low}, {high}]" for name, (low, high) in region.items()},
        "start": _quoted(model.starts),
        **{f"starts.{title}": _quoted(start) for title, start in model.other_starts.items()},
    }
    for title, table in tables.items():
        if table:
            lines += ["", f"[{title}]", *(f"{json.dumps(key)} = {value}" for key, value in table.items())]
    for title, (axes, ranges) in model.views.items():
        lines += ["", f"[views.{title}]", *(f"{axis} = {json.dumps(name)}" for axis, name in zip("xyz", axes))]
        inner = ", ".join(f"{name} = [{', '.join(map(json.dumps, ends))}]" for name, ends in ranges.items())
        lines += [f"ranges = {{{inner}}}"] if inner else []
    lines += ["", "[scene]", f'span = ["0", {json.dumps(model.total)}]']
    lines += [] if small is None else [f"epsilon = {json.dumps(model.parameters[small])}"]
    if model.path is not None:
        lines.append(f"path = {json.dumps(list(model.path))}")
    return "\n".join(lines) + "\n"


def _quoted(table: Mapping[str, str]) -> dict[str, str]:
    return {key: json.dumps(text) for key, text in table.items()}


def _region(model: ForeignModel, fast: Collection[str]) -> dict[str, tuple[float, float]]:
    """Bounds and windows of the states, else a box around the start.

    A box around a fast state would choose a sheet that the file says nothing about: it has none, unless all are fast.
    """
    free = [name for name in model.starts if name not in fast] or list(model.starts)
    region: dict[str, tuple[float, float]] = {}
    known = {**model.windows, **model.bounds}
    for name in model.starts:
        if name in known:
            region[name] = known[name]
        elif name in free:
            value = number_in(model.starts[name], f"the initial value of {name}")
            region[name] = value - 1.0 - abs(value), value + 1.0 + abs(value)
    return region


def number_in(text: str, what: str) -> float:
    """The number that `text` is, a fraction p/q too; `what` names it in the error."""
    top, slash, bottom = text.partition("/")
    try:
        return float(top) / float(bottom) if slash else float(text)
    except (ValueError, ZeroDivisionError):
        raise ModelFileError(f"{what} is a number.", got=f"{text[:60]!r}") from None
