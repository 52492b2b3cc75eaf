"""TOML model files: a scene that a user writes in two minutes.

    title = "An enzyme and its substrate"    # optional, as are name, source and description
    epsilon = "epsilon"                      # name of the small parameter; this is the default where there is one;
                                             # ["epsilon", "delta"] names a second, which is one of the parameters

    [parameters]                             # optional
    kappa = 1
    lambda = 0.5                             # exact, 1/2; text such as "1/3" is allowed wherever a number is

    [slow]                                   # s' = ...
    s = "-s + (s + kappa - lambda)*c"

    [fast]                                   # epsilon c' = ...
    c = "s - (s + kappa)*c"

    [region]                                 # at least one state; a bound on a fast one selects a sheet; optional
                                             # without a small parameter
    s = [0.1, 2]

    [start]                                  # every state; reconstruction variables start at 0 unless given
    s = 1
    c = 0.5

    [scene]
    span = [0, 5]                            # slow time
    epsilon = 0.01                           # the value asked about; without it a model has no small parameter
    epsilons = [0.04, 0.02, 0.01, 0.005]     # optional ladder; default epsilon * (2, 1, 1/2, 1/4)
    tolerance = 1e-6                         # optional relative accuracy, this is the default
    path = ["s", "c"]                        # optional pair of names, drawn as a path in the plane

    [starts.empty]                           # optional: another start by name, what differs from [start]
    c = 0

    [views.phase]                            # optional: what to show against what, in the report and the demo
    x = "s"                                  # states, observables, reconstruction variables or t; z makes it solid
    y = "c"
    title = "Substrate and complex"          # optional
    ranges = {s = [0, 2], c = [0, 1]}        # optional

    [phase]                                  # optional: what turns fast, and is averaged over
    name = "theta"                           # a state that turns, or
    pair = ["u", "v"]                        # two that turn about one another; both for a pair near resonance

    [units]                                  # optional text for names of the model and for t
    s = "mM"

    [definitions]                            # optional: names for expressions, and functions of arguments
    total = "s + c"
    "rate(u)" = "u/(kappa + u)"

In place of `[slow]` and `[fast]`, `[states]` takes any field with its poles written out, as in
`omega = "a*w/(I*epsilon)"`, and with its switches, as in `u = "-x + tanh((V - u)/epsilon)"`. `[mechanics]` takes a
Lagrangian, constraints and the friction in their place, as `gsp.readers.mechanics_table` shows.
`[observables]` gives names to further expressions, `[reconstruction]` holds rates of variables that the states
drive, such as positions. Expressions follow the grammar of `gsp.readers.expressions`. The keys before the first
table belong at the top of the file.

A file is untrusted: it is bounded in size, names are plain words, and no text in it is ever run.
"""

from __future__ import annotations

import re
import stat
import tomllib
from collections.abc import Mapping
from decimal import Decimal
from pathlib import Path
from typing import Any

import sympy as sp

from gsp.errors import ModelFileError, nearest
from gsp.readers import toml_values as values
from gsp.readers.definitions import read_definitions
from gsp.readers.expressions import Definitions
from gsp.readers.limits import at_most
from gsp.readers.mechanics_table import with_equations
from gsp.readers.phase_table import read_phase
from gsp.readers.ramps_table import read_ramps
from gsp.scenes.scene import Scene
from gsp.scenes.view import View
from gsp.systems.system import SlowFastSystem, VectorField

BYTES = 256 * 1024
NAMES = 2000
TEXT = {"name": 64, "title": 200, "source": 1000, "description": 5000}
DOTS = 40
"""Bound on dots in what could be a key: tomllib takes quadratic time and memory in a dotted key."""
_NO_KEYS = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'|#.*')
CLAIMS = 8

_TABLES = (
    "parameters",
    "mechanics",
    "definitions",
    "slow",
    "fast",
    "states",
    "observables",
    "reconstruction",
    "region",
    "start",
    "scene",
    "claims",
    "starts",
    "units",
    "views",
    "ramps",
    "phase",
)
_SCENE = ("span", "epsilon", "epsilons", "tolerance", "path")


def read_model(text: str, *, name: str) -> Scene:
    """`Scene` from the text of a model file; raises `ModelFileError` and `DeclarationError` as `load` does."""
    return scene_of(parsed(text), Path(f"{name or 'scene'}.toml"))


def read_document(file: Path) -> dict:
    """Tables of a TOML file, decimals exact; raises `ModelFileError` for one unreadable or too large."""
    return parsed(text_of(file))


def text_of(file: Path, *, other_bytes: bool = False, most: int = BYTES) -> str:
    """The text of a model file; raises `ModelFileError` for one that is unreadable, too large or no UTF-8.

    With `other_bytes` what is no UTF-8 becomes U+FFFD, which no expression may hold and any comment.
    """
    data = bytes_of(file, most=most)
    try:
        return data.decode("utf-8-sig", "replace" if other_bytes else "strict")
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        raise ModelFileError(f"the file is not UTF-8 text (line {line}).", "Save it as UTF-8.") from None


def bytes_of(file: Path, *, most: int = BYTES) -> bytes:
    """What a model file holds; raises `ModelFileError` for one that is no regular file, unreadable or too large."""
    try:
        # Checked before it is opened: opening a named pipe waits for ever, and a device has no end.
        if not stat.S_ISREG(file.stat().st_mode):
            raise ModelFileError("this is no regular file.", "Give the path of a model file.")
        with file.open("rb") as stream:
            data = stream.read(most + 1)
    except ModelFileError:
        raise
    except FileNotFoundError:
        if str(file) == file.name:
            # A bare name stands in front of the message already.
            raise ModelFileError("there is no such file.", "Check the path.") from None
        raise ModelFileError("there is no such file.", "Check the path.", got=str(file)[:200]) from None
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ModelFileError(f"the file cannot be read ({reason}).", "Check its permissions.") from None
    if len(data) > most:
        raise ModelFileError(
            f"the file is larger than {most // 1024} KiB.", "A model file holds equations only."
        )
    return data


def parsed(text: str) -> dict:
    """The tables of TOML, decimals exact; raises `ModelFileError` for what is none."""
    for number, line in enumerate(text.splitlines(), 1):
        if line.count(".") > DOTS and any(piece.count(".") > DOTS for piece in re.split("[={,]", _keys(line))):
            raise ModelFileError(
                f"line {number} has more than {DOTS} dots in a row of words.", "Break the line.", limit=DOTS
            )
    try:
        return tomllib.loads(text, parse_float=Decimal)
    except RecursionError:
        raise ModelFileError(
            "the file nests arrays or tables too deeply.", "The format needs one level."
        ) from None
    except (ValueError, ArithmeticError) as error:
        raise ModelFileError(f"the file is not valid TOML: {error!s:.300}.", "Correct that line.") from None


def _keys(line: str) -> str:
    """`line` without its strings and its comment, which hold no keys; as it is where a string may go over lines."""
    return line if '"""' in line or "'''" in line else _NO_KEYS.sub(" ", line)


# What every scene says, with a line to write, and what one says that names a small parameter or fast variables.
NEEDED = {"span": "span = [0, 5]"}
NEEDED_OF_SMALL = {**NEEDED, "epsilon": "epsilon = 0.01"}


def scene_of(document: dict, file: Path) -> Scene:
    """The scene that a document says; its name is that of `file` unless it has one. Raises `ModelFileError`."""
    # Before the keys are looked at: who has the rates in a table of another name is told where they stand.
    _check_form(document)
    values.check_keys(document, ("epsilon", *TEXT, *_TABLES), elsewhere={"scene": _SCENE})
    texts = {key: values.text(document.get(key, ""), key, limit) for key, limit in TEXT.items()}
    name = texts["name"] or re.sub(r"[^A-Za-z0-9]+", "_", file.stem).strip("_")[:64] or "scene"
    document, second = values.small(document)
    contacts = None
    if "mechanics" in document:
        document, contacts, meanings = with_equations(document, name)
        if len(meanings) <= TEXT["description"]:
            texts["description"] = texts["description"] or meanings
    tables = {key: values.table(document, key) for key in _TABLES}
    scene = tables["scene"]
    if isinstance(scene.get("epsilon"), str) and scene["epsilon"] in tables["parameters"]:
        raise ModelFileError(
            f"scene.epsilon is a number, the value of the small parameter, and {scene['epsilon']} is a parameter.",
            f'Write epsilon = "{scene["epsilon"]}" at the top of the file and its value here, not under [parameters].',
        )
    system, symbols, definitions = _system(document, tables, name)
    values.check_keys(scene, _SCENE, "scene.", elsewhere={"": TEXT}, tables=_TABLES)
    small = system.epsilon is not None
    missing = {key: line for key, line in (NEEDED_OF_SMALL if small else NEEDED).items() if key not in scene}
    if missing:
        raise ModelFileError(
            f"{' and '.join(f'scene.{key}' for key in missing)} {('are' if len(missing) > 1 else 'is')} "
            "missing.",
            f"Write {' and '.join(missing.values())} under [scene].",
        )
    given: dict[str, Any] = {}
    if "epsilon" in scene:
        given["epsilon"] = float(values.number(scene["epsilon"], "scene.epsilon"))
    if "epsilons" in scene:
        given["epsilons"] = tuple(map(float, values.numbers(scene["epsilons"], "scene.epsilons")))
    if "tolerance" in scene:
        given["tolerance"] = float(values.number(scene["tolerance"], "scene.tolerance"))
    drivers = tables["reconstruction"]
    return Scene(
        system=system,
        region=values.box(tables, "region"),
        start=values.point(tables, "start"),
        span=values.pair(scene["span"], "scene.span"),
        **given,
        reconstruction={
            symbols[key]: values.expression(value, f"reconstruction.{key}", symbols, definitions)
            for key, value in drivers.items()
        },
        path=values.path(scene.get("path")),
        claims=_claims(tables["claims"], symbols, definitions),
        starts={
            name: values.point(tables["starts"], name, key)
            for name, key, _ in values.named_tables("starts", tables["starts"], 64, holds=" of numbers")
        },
        views=_views(tables["views"]),
        second=second,
        ramps=read_ramps(tables["ramps"], symbols, definitions),
        phase=read_phase(tables["phase"]),
        units={
            key: values.text(value, f"units.{key[:64]}", TEXT["name"]) for key, value in tables["units"].items()
        },
        name=name,
        title=texts["title"],
        source=texts["source"],
        description=texts["description"],
        contacts=contacts,
    )


def _check_form(document: dict) -> None:
    """Refuse a file whose rates stand in both forms, or in none; those of [mechanics] are derived."""
    standard = "slow" in document or "fast" in document
    if standard != ("states" in document) or "mechanics" in document:
        return
    verb, got = ("Keep", "both") if standard else ("Write", "neither")
    others = [f"[{key[:64]}]" for key, value in document.items() if isinstance(value, dict)]
    if not standard and others:
        got += f", but {', '.join(others[: values.LISTED])}"
    raise ModelFileError("a file has [slow] and [fast], or [states].", f"{verb} one of the two forms.", got=got)


def _system(
    document: dict, tables: dict[str, dict], name: str
) -> tuple[SlowFastSystem | VectorField, dict[str, sp.Symbol], Definitions]:
    standard = "slow" in document or "fast" in document
    has_small = standard or _names_small(document, tables)
    epsilon = document.get("epsilon", "epsilon")
    if not isinstance(epsilon, str):
        raise ModelFileError(
            "epsilon, at the top of the file, names the symbol of the small parameter and is text.",
            "Its value belongs under [scene].",
            got=f"a {values.kind(epsilon)}",
        )
    for key in ("slow", "fast") if standard else ("states",):
        if not tables[key]:
            raise ModelFileError(f"[{key}] is missing or empty.", "Give it an equation for each variable.")
    equations = {key: tables[key] for key in ("slow", "fast", "states", "reconstruction", "observables")}
    for kinds, limit in ((tuple(equations), NAMES), (("parameters",), NAMES)):
        count = sum(len(tables[kind]) for kind in kinds)
        at_most(limit, count, f"{', '.join(kinds)} hold", "names", "Use a smaller model.")
    small = {epsilon: ""} if has_small else {}
    symbols = values.symbols_of({"epsilon": small, "parameters": tables["parameters"], **equations})
    definitions = read_definitions(tables["definitions"], symbols)
    driven = {symbols[key] for key in tables["reconstruction"]}

    def rates(kind: str) -> dict[sp.Symbol, sp.Expr]:
        result = {}
        for key, value in tables[kind].items():
            result[symbols[key]] = rate = values.expression(value, f"{kind}.{key}", symbols, definitions)
            for symbol in rate.free_symbols & driven if driven else ():
                raise ModelFileError(
                    f"{kind}.{key} depends on {symbol}, which is a reconstruction variable: those are left "
                    "out of the reduction.",
                    f"Move {symbol} from [reconstruction] to the states.",
                )
        return result

    parameters = {
        symbols[key]: values.number(value, f"parameters.{key}") for key, value in tables["parameters"].items()
    }
    observables = rates("observables")
    if standard:
        return (
            SlowFastSystem(
                slow=rates("slow"),
                fast=rates("fast"),
                epsilon=symbols[epsilon],
                parameters=parameters,
                name=name,
                observables=observables,
            ),
            symbols,
            definitions,
        )
    field = VectorField(
        rates("states"),
        epsilon=symbols[epsilon] if has_small else None,
        parameters=parameters,
        name=name,
        observables=observables,
    )
    return field, symbols, definitions


def _names_small(document: dict, tables: dict[str, dict]) -> bool:
    """Whether a file with [states] says that it has a small parameter: by its name, its value, or the usual name."""
    if "epsilon" in document or not tables["scene"].keys().isdisjoint(("epsilon", "epsilons")):
        return True
    declared = {
        head.partition("(")[0].strip()
        for kind in ("parameters", "states", "reconstruction", "definitions")
        for head in tables[kind]
    }
    texts = [
        text for kind in ("states", "definitions") for text in tables[kind].values() if isinstance(text, str)
    ]
    return "epsilon" not in declared and any(re.search(r"\bepsilon\b", text) for text in texts)


def _claims(
    tables: Mapping[str, object], symbols: Mapping[str, sp.Symbol], definitions: Definitions
) -> dict[str, dict]:
    """Rival reduced fields, [claims.NAME] each: rates by state."""
    claims: dict[str, dict] = {}
    for name, key, rates in values.named_tables("claims", tables, CLAIMS, plural="fields", holds=" of rates"):
        at_most(TEXT["name"], len(name), f"{key}: the name has", "characters")
        claims[name] = {}
        for state, rate in rates.items():
            if state not in symbols:
                raise ModelFileError(
                    f"{key}.{state[:64]} is unknown. A claim gives rates of states.{nearest(state[:64], symbols)}"
                )
            claims[name][symbols[state]] = values.expression(rate, f"{key}.{state}", symbols, definitions)
    return claims


def _views(tables: Mapping[str, object]) -> dict[str, View]:
    """What to show, [views.NAME] each."""
    found = {}
    for name, key, table in values.named_tables("views", tables, 16):
        values.check_keys(table, ("x", "y", "z", "title", "ranges"), f"{key}.")
        for axis in ("x", "y"):
            if axis not in table:
                raise ModelFileError(f"{key}.{axis} is missing.", f'Name what to show, such as {axis} = "t".')
        axes = [
            values.text(table[axis], f"{key}.{axis}", TEXT["name"]) for axis in ("x", "y", "z") if axis in table
        ]
        found[name] = View(
            *axes,
            title=values.text(table.get("title", ""), f"{key}.title", TEXT["title"]),
            ranges=values.box(table, "ranges", f"{key}.ranges"),
        )
    return found
