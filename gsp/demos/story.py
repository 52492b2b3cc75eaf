"""A story: what a demo tells in steps, read from a TOML file and checked against the model that it tells.

Names are checked against what the page has, numbers against their ranges; an error begins with the place in the file.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import sympy as sp

from gsp.demos.prose import markup
from gsp.errors import ModelFileError, met_at, printable
from gsp.readers.expressions import parse_expression
from gsp.readers.limits import at_most
from gsp.readers.toml import parsed, text_of
from gsp.readers.toml_values import WORD, check_keys, kind, number, numbers, pair, table, text
from gsp.results.lettering import in_unicode
from gsp.scenes.scene import Scene

TOP = (
    "title", "axes", "trace", "space", "frame", "window", "ranges", "logarithmic", "work", "compared", "quantities",
    "body", "steps",
)  # fmt: skip
STEP = (
    "text", "epsilon", "parameters", "start", "end", "orders", "rivals", "axes", "trace", "play", "marks", "tolerance",
    "fixed", "views", "highlight", "flow", "near",
)  # fmt: skip
BODY = ("name", "angle", "at", "reach", "parts")
MARK = ("axis", "at", "name")
# What a part of a body is, by the key that says so, and the keys beside it.
PARTS: Mapping[str, tuple[str, ...]] = {
    "points": ("closed", "strong", "fixed"),
    "wheel": ("at", "angle", "strong", "fixed"),
    "spring": ("coils", "strong", "fixed"),
    "dot": ("name", "strong", "fixed"),
    "length": ("name", "fixed"),
    "arrow": ("name", "strong", "fixed"),
    "turn": ("name", "at"),
}
PICTURES = ("path", "plane", "space", "trace", "scales", "work", "errors")
NAME = 120


def read_story(path: str | Path) -> dict:
    """The tables of a story's file, decimals exact; raises `ModelFileError` for one that is unreadable or no TOML."""
    file = Path(path)
    with met_at(file.name):
        return parsed(text_of(file))


def quantities_of(document: Mapping[str, Any], scene: Scene) -> dict[sp.Symbol, sp.Expr]:
    """What a story adds to the quantities of the page: expressions in states, parameters and the small parameter."""
    system = scene.system
    small = () if system.epsilon is None else (system.epsilon,)
    symbols = {s.name: s for s in (*scene.full_flow.states, *system.parameters, *small)}
    taken = {*symbols, *(s.name for s in system.observables), "t"}
    found = {}
    for name, value in table(dict(document), "quantities").items():
        place = f"quantities.{name[:64]}"
        if not WORD.fullmatch(name):
            raise ModelFileError(f"{place} is no name.", "A name is a letter, then letters, digits and _.")
        if name in taken:
            raise ModelFileError(f"{place} is a name of the model already.", "Choose another name.", value=name)
        with met_at(place):
            found[sp.Symbol(name)] = parse_expression(value, symbols=symbols)
    return found


def story_of(document: Mapping[str, Any], scene: Scene, parts: Mapping[str, Any]) -> dict[str, Any]:
    """What the scripts of the page read of a story; `parts` says what quantities and parameters the page has.

    Raises `ModelFileError` for a key, a name or a number that the page cannot have.
    """
    return _Reader(scene, parts).story(dict(document))


def body_in(document: Mapping[str, Any], scene: Scene) -> dict[str, Any] | None:
    """The body of a story, where no page has been made: its names are those of the scene; None where it has none."""
    names = {"states": scene.full_flow.states, "driven": (), "parameters": scene.system.parameters}
    parts: dict[str, Any] = {key: [s.name for s in symbols] for key, symbols in names.items()}
    parts |= {"quantities": parts["states"] + [s.name for s in scene.full_flow.observables], "claims": ()}
    return _Reader(scene, parts).body(table(dict(document), "body")) if "body" in document else None


class _Reader:
    """The checks of one story against the names of one page."""

    def __init__(self, scene: Scene, parts: Mapping[str, Any]) -> None:
        self.scene = scene
        self.quantities: list[str] = parts["quantities"]
        self.parameters: list[str] = parts["parameters"]
        self.started: list[str] = [*parts["states"], *parts["driven"]]
        self.has_claims = bool(parts["claims"])
        self.ranges: dict[str, tuple[float, float]] = {}
        self.has_body = False

    def story(self, document: dict) -> dict[str, Any]:
        check_keys(document, TOP)
        told = {key: table(document, key) for key in ("frame", "window", "ranges")}
        self.has_body = "body" in document
        self.ranges = {
            self.name(n, self.parameters, "ranges", "parameter"): _range(v, f"ranges.{n}")
            for n, v in told["ranges"].items()
        }
        found: dict[str, Any] = {"ranges": self.ranges}
        for key in ("frame", "window"):
            found[key] = {self.quantity(n, key): _range(v, f"{key}.{n}") for n, v in told[key].items()}
        for key in ("space", "work", "compared"):
            if key in document:
                found[key] = _boolean(document[key], key)
        found["logarithmic"] = [self.quantity(n, "logarithmic") for n in _listed(document, "logarithmic")]
        found |= self.looks(document, "")
        if "title" in document:
            found["title"] = printable(text(document["title"], "title", NAME))
        if "body" in document:
            found["body"] = self.body(table(document, "body"))
        steps = document.get("steps", [])
        if not isinstance(steps, list) or not steps or not all(isinstance(step, dict) for step in steps):
            raise ModelFileError("a story has steps.", "Begin each with [[steps]] on a line of its own.")
        # A story that is longer is told by nobody.
        at_most(64, len(steps), "the story has", "steps", "Make two of it.")
        found["steps"] = []
        for k, step in enumerate(steps, 1):
            with met_at(f"step {k}"):
                found["steps"].append(self.step(step, bool(found.get("work"))))
        return found

    def step(self, step: dict, works: bool) -> dict[str, Any]:
        check_keys(step, STEP)
        if "text" not in step:
            raise ModelFileError("a step has a text.", 'Write text = "What is seen."')
        found: dict[str, Any] = {"text": markup(text(step["text"], "text", 2000))}
        for key in ("epsilon", "tolerance", "fixed"):
            if key in step:
                found[key] = _positive(step[key], key)
        if "epsilon" in step and self.scene.system.epsilon is None:
            raise ModelFileError("epsilon is set, and the model has no small parameter.", "Leave it out.")
        if not works and {"tolerance", "fixed"} & set(step):
            raise ModelFileError(
                "tolerance and fixed belong to a story with work = true.", "Set it at the top."
            )
        if "end" in step:
            found["end"] = _number(step["end"], "end")
            if found["end"] <= self.scene.span[0]:
                first = self.scene.span[0]
                raise ModelFileError(
                    f"end is not after the start, {first:g}.", "Take a later time.", got=step["end"]
                )
        if "orders" in step:
            found["orders"] = [int(n) for n in numbers(step["orders"], "orders")]
            if not set(numbers(step["orders"], "orders")) <= set(range(4)):
                raise ModelFileError(
                    "orders are among 0, 1, 2, 3.", "Write orders = [0, 1].", got=found["orders"]
                )
        values = table(step, "parameters")
        found["parameters"] = {
            self.name(n, self.parameters, "parameters", "parameter"): self.within(n, v)
            for n, v in values.items()
        }
        found["start"] = {
            self.name(n, self.started, "start", "state"): _number(v, f"start.{n}")
            for n, v in table(step, "start").items()
        }
        for key in ("rivals", "play", "flow", "near"):
            if key in step:
                found[key] = _boolean(step[key], key)
        if found.get("near") and not self.has_body:
            raise ModelFileError("near shows the body, and the story has none.", "Draw one under [body].")
        if found.get("rivals") and not self.has_claims:
            raise ModelFileError("rivals are shown, and the model has no [claims].", "Leave rivals out.")
        remedy = 'Write marks = [{ axis = "x", at = 1, name = "here" }].'
        marks = _tables(step.get("marks", []), "marks", remedy)
        at_most(16, len(marks), "marks has", "entries", "Keep the ones that are spoken of.")
        found["marks"] = [self.mark(mark) for mark in marks]
        found["views"] = [self.name(n, PICTURES, "views", "picture") for n in _listed(step, "views")]
        seen = (*PICTURES, *self.parameters, "epsilon", "length", "start", "orders", "notes")
        found["highlight"] = [
            self.name(n, seen, "highlight", "picture or slider") for n in _listed(step, "highlight")
        ]
        return found | self.looks(step, "")

    def mark(self, mark: dict) -> dict[str, Any]:
        check_keys(mark, MARK, "marks.")
        return {
            "axis": self.quantity(mark.get("axis"), "marks.axis"),
            "at": _number(mark.get("at"), "marks.at"),
            "name": in_unicode(printable(text(mark.get("name", ""), "marks.name", NAME))),
        }

    def looks(self, document: Mapping[str, Any], prefix: str) -> dict[str, Any]:
        """The plane and the quantity against time."""
        found: dict[str, Any] = {}
        if "axes" in document:
            found["axes"] = [self.quantity(n, f"{prefix}axes") for n in _listed(document, "axes")]
            if len(set(found["axes"])) != 2:
                raise ModelFileError("axes are two quantities.", 'Write axes = ["x", "y"].', got=found["axes"])
        if "trace" in document:
            found["trace"] = self.quantity(document["trace"], f"{prefix}trace")
        return found

    def body(self, body: dict) -> dict[str, Any]:
        """The body: its parts in its own frame, which is at `at` and turned by `angle`."""
        check_keys(body, BODY, "body.")
        remedy = "Write parts = [{ points = [[0, 0], [1, 0]] }]."
        parts = _tables(body.get("parts"), "body.parts", remedy)
        at = body.get("at", list(self.scene.path or ()))
        if not at:
            raise ModelFileError(
                "the body is nowhere: the model has no path.", 'Write at = ["x", 0] under [body].'
            )
        return {
            "name": in_unicode(printable(text(body.get("name", "the body"), "body.name", NAME))),
            "angle": self.value(body.get("angle", 0), "body.angle"),
            "at": self.point(at, "body.at"),
            "reach": _positive(body["reach"], "body.reach") if "reach" in body else 1.0,
            "parts": [self.part(part, f"body.parts {k}") for k, part in enumerate(parts, 1)],
        }

    def part(self, part: dict, place: str) -> dict[str, Any]:
        kinds = [key for key in PARTS if key in part]
        if len(kinds) != 1:
            raise ModelFileError(f"{place} is one of {', '.join(PARTS)}.", "Give it one of these keys.")
        (what,) = kinds
        check_keys(part, (what, *PARTS[what]), f"{place}.")
        found: dict[str, Any] = {"kind": what}
        if what in ("points", "spring", "length", "arrow"):
            found["points"] = [self.point(point, place) for point in _points(part[what], place)]
            if what != "points" and len(found["points"]) != 2:
                raise ModelFileError(
                    f"{place} goes from one point to another.", f"Write {what} = [[0, 0], [1, 0]]."
                )
        elif what == "dot":
            found["points"] = [self.point(part["dot"], place)]
        else:
            found["points"] = [self.point(part.get("at", [0, 0]), place)]
            found["radius" if what == "wheel" else "to"] = (
                _positive(part[what], place) if what == "wheel" else self.value(part[what], place)
            )
        if "angle" in part:
            found["angle"] = self.value(part["angle"], f"{place}.angle")
        if "coils" in part:
            found["coils"] = min(40, max(1, round(_positive(part["coils"], f"{place}.coils"))))
        if "name" in part:
            found["name"] = in_unicode(printable(text(part["name"], f"{place}.name", NAME)))
        for key in ("closed", "strong", "fixed"):
            found[key] = _boolean(part[key], f"{place}.{key}") if key in part else False
        return found

    def point(self, point: object, place: str) -> list[float | str]:
        if not isinstance(point, list) or len(point) != 2:
            raise ModelFileError(f"{place}: a point is a pair.", 'Write [0, 1] or ["x", 0].', value=point)
        return [self.value(each, place) for each in point]

    def value(self, value: object, place: str) -> float | str:
        """A number, or the name of a quantity or of a parameter."""
        if isinstance(value, str):
            return self.name(value, [*self.quantities, *self.parameters], place, "quantity or parameter")
        return _number(value, place)

    def within(self, name: str, value: object) -> float:
        """The value of a parameter, which its slider must reach."""
        found = _number(value, f"parameters.{name}")
        low, high = self.ranges.get(name, (-float("inf"), float("inf")))
        if not low <= found <= high:
            bounds = f"[{low:g}, {high:g}]"
            raise ModelFileError(
                f"parameters.{name} is outside its range {bounds}.", "Widen [ranges].", got=f"{found:g}"
            )
        return found

    def quantity(self, name: object, place: str) -> str:
        return self.name(name, self.quantities, place, "quantity")

    def name(self, name: object, known: Iterable[str], place: str, what: str) -> str:
        if name not in (names := list(known)):
            shown = str(name)[:64]
            raise ModelFileError.none_of(names, shown, f"{place}: there is no {what} {shown}.", "There are")
        return str(name)


def _listed(document: Mapping[str, Any], key: str) -> list:
    found = document.get(key, [])
    if not isinstance(found, list):
        raise ModelFileError(f"{key} is a list of names.", f'Write {key} = ["x"].', got=f"a {kind(found)}")
    return found


def _tables(value: object, key: str, remedy: str) -> list[dict]:
    if not isinstance(value, list) or not all(isinstance(each, dict) for each in value):
        raise ModelFileError(f"{key} is a list of tables.", remedy)
    return value


def _points(value: object, place: str) -> list:
    if not isinstance(value, list):
        raise ModelFileError(f"{place}: points are a list of pairs.", "Write [[0, 0], [1, 0]].")
    at_most(400, len(value), f"{place} has", "points", "Draw it more coarsely.")
    return value


def _boolean(value: object, key: str) -> bool:
    if not isinstance(value, bool):
        raise ModelFileError(f"{key} is true or false.", f"Write {key} = true.", got=f"a {kind(value)}")
    return value


def _number(value: object, key: str) -> float:
    return float(number(value, key))


def _positive(value: object, key: str) -> float:
    found = _number(value, key)
    if not found > 0:
        raise ModelFileError(f"{key} is above 0.", "Take a positive number.", got=f"{found:g}", value=found)
    return found


def _range(value: object, key: str) -> tuple[float, float]:
    low, high = pair(value, key)
    if not low < high:
        raise ModelFileError(
            f"{key} is [low, high] with low below high.", "Exchange them.", got=f"[{low:g}, {high:g}]"
        )
    return low, high
