"""`[mechanics]` of a model file: a Lagrangian, constraints, and the friction in their place.

    [mechanics]
    lagrangian = "m*(xdot^2 + ydot^2)/2 + J*phidot^2/2"
    coordinates = ["x", "y", "phi"]
    velocities = ["xdot", "ydot", "phidot"]          # optional, these are the names without it
    constraints = ["-xdot*sin(phi) + ydot*cos(phi)"] # what vanishes; or a table that names the slips; a pair in the
                                                     # list is one contact in a plane
    frame = {v = "xdot*cos(phi) + ydot*sin(phi)", omega = "phidot"}   # optional quasi-velocities
    forces = {x = "F"}                               # optional, by coordinate
    holonomic = ["x^2 + y^2 - l^2"]                  # optional, constraints on the coordinates alone
    time = "t"                                       # optional name of time, where it enters
    law = "coulomb"                                  # dry friction, with mu and normal for all contacts or a list
    mu = 0.3                                         # with one for each; or damping, of viscous friction: a number, an
    normal = "m*g"                                   # expression, a square matrix or "kinetic"

`[start]` gives positions and velocities, or quasi-velocities; positions that nothing depends on are reconstructed. The
other tables are as ever, in the states that the friction leaves: positions that matter, quasi-velocities and slips.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import sympy as sp

from gsp.errors import ModelFileError
from gsp.mechanics.friction import COULOMB, with_friction
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.readers import toml_values as values
from gsp.readers.definitions import read_definitions
from gsp.readers.expressions import Definitions
from gsp.readers.limits import at_most
from gsp.scenes.scene import Scene
from gsp.sliding.law import LAWS
from gsp.sliding.no_slip import Contacts
from gsp.systems.system import SlowFastSystem

KEYS = (
    "lagrangian",
    "coordinates",
    "velocities",
    "constraints",
    "frame",
    "forces",
    "holonomic",
    "time",
    "damping",
    "law",
    "mu",
    "normal",
)
# The laws that are called by a name; others are expressions in w.
NAMED = (COULOMB, *LAWS)
EQUATIONS = ("slow", "fast", "states")
WORDS = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def with_equations(document: dict, name: str) -> tuple[dict, Contacts | None, str]:
    """The document with the equations of its `[mechanics]` in their place, the contacts, and what its states are.

    Raises `ModelFileError`.
    """
    both = [key for key in EQUATIONS if key in document]
    if both:
        raise ModelFileError(
            f"a file with [mechanics] has no [{both[0]}].", "Keep one of the two.", got=f"{', '.join(both)}"
        )
    return _Mechanics(document, name).document()


class _Mechanics:
    """One file's `[mechanics]`, read name by name."""

    def __init__(self, document: dict, name: str) -> None:
        self.whole, self.name = document, name
        self.table = values.table(document, "mechanics")
        values.check_keys(self.table, KEYS, "mechanics.")
        for key in ("lagrangian", "coordinates", "constraints"):
            if key not in self.table:
                raise ModelFileError(
                    f"mechanics.{key} is missing.", "Give the Lagrangian, its coordinates and constraints."
                )
        self.coordinates = self._words("coordinates")
        # The equations of more coordinates are too long to be written out.
        at_most(12, len(self.coordinates), "mechanics.coordinates has", "names", "Use fewer.")
        self.velocities = (
            self._words("velocities") if "velocities" in self.table else [f"{q}dot" for q in self.coordinates]
        )
        self.parameters = values.table(document, "parameters")
        self.frame = values.table(self.table, "frame")
        given = self.table["constraints"]
        self.slips = list(given) if isinstance(given, dict) else []
        self.clock = [values.text(self.table["time"], "mechanics.time", 64)] if "time" in self.table else []
        self.epsilon = values.text(document.get("epsilon", "epsilon"), "epsilon", 64)
        self.symbols = values.symbols_of({
            "parameters": self.parameters, "coordinates": self.coordinates, "velocities": self.velocities,
            # A quasi-velocity may be a velocity.
            "frame": [u for u in self.frame if u not in self.velocities], "constraints": self.slips,
            "time": self.clock, "epsilon": [self.epsilon],
        })  # fmt: skip
        self.definitions: Definitions = read_definitions(values.table(document, "definitions"), self.symbols)

    def document(self) -> tuple[dict, Contacts | None, str]:
        """The file with its equations written out, what its contacts bear, and what its velocities and momenta are."""
        scene = self._scene()
        system = scene.system
        tables: dict[str, Any] = (
            {"slow": _named(system.slow), "fast": _named(system.fast)}
            if isinstance(system, SlowFastSystem)
            else {"states": _named(dict(zip(system.states, system.rates)))}
        )
        tables["observables"] = {**_named(system.observables), **values.table(self.whole, "observables")}
        tables["reconstruction"] = {
            **_named(scene.reconstruction),
            **values.table(self.whole, "reconstruction"),
        }
        tables["region"] = {name: [repr(end) for end in box] for name, box in scene.region.items()}
        tables["start"] = {name: repr(value) for name, value in scene.full_start.items()}
        left = {
            *map(str, system.states),
            *tables["observables"],
            *tables["reconstruction"],
            *self.parameters,
            self.epsilon,
        }
        tables["definitions"] = _without(values.table(self.whole, "definitions"), set(self.symbols) - left)
        kept = {key: value for key, value in self.whole.items() if key not in ("mechanics", "definitions")}
        return (
            {**kept, **{key: table for key, table in tables.items() if table}},
            scene.contacts,
            scene.description,
        )

    def _scene(self) -> Scene:
        table, symbols = self.table, self.symbols
        system = LagrangianSystem(
            self._expression(table["lagrangian"], "lagrangian"),
            [symbols[q] for q in self.coordinates],
            [symbols[v] for v in self.velocities],
            forces=self._expressions("forces"),
            parameters={
                symbols[p]: values.number(value, f"parameters.{p}") for p, value in self.parameters.items()
            },
            time=symbols[self.clock[0]] if self.clock else None,
            holonomic=self._holonomic(),
            name=self.name,
        )
        given: dict[str, Any] = {
            "epsilon": symbols[self.epsilon], "frame": self._expressions("frame") or None
        }  # fmt: skip
        if "law" in table:
            law = table["law"]
            given["law"] = law if law in NAMED else self._expression(law, "law", {"w": sp.Symbol("w")})
        for key in ("mu", "normal", "damping"):
            if key in table:
                value = table[key]
                given[key] = value if key == "damping" and value == "kinetic" else self._nested(value, key)
        friction = with_friction(system, self._constraints(), **given)
        scene = values.table(self.whole, "scene")
        for key in ("span", "epsilon"):
            if key not in scene:
                raise ModelFileError(f"scene.{key} is missing.", "Give span and epsilon under [scene].")
        return friction.scene(
            region=values.box(self.whole, "region"),
            start=values.point(self.whole, "start"),
            span=values.pair(scene["span"], "scene.span"),
            epsilon=float(values.number(scene["epsilon"], "scene.epsilon")),
            name=self.name,
        )

    def _constraints(self) -> Any:
        given = self.table["constraints"]
        if isinstance(given, dict):
            return {self.symbols[w]: self._expression(e, f"constraints.{w}") for w, e in given.items()}
        if not isinstance(given, list):
            raise ModelFileError(
                "mechanics.constraints is a list, or a table of slips.", got=f"a {values.kind(given)}"
            )
        return [self._nested(entry, "constraints") for entry in given]

    def _holonomic(self) -> list[sp.Expr]:
        given = self.table.get("holonomic", [])
        if not isinstance(given, list):
            raise ModelFileError("mechanics.holonomic is a list of expressions.", got=f"a {values.kind(given)}")
        return [self._expression(each, "holonomic") for each in given]

    def _words(self, key: str) -> list[str]:
        given = self.table[key]
        if not isinstance(given, list) or not all(isinstance(word, str) for word in given):
            raise ModelFileError(f"mechanics.{key} is a list of names.", got=f"a {values.kind(given)}")
        return given

    def _expression(self, value: object, key: str, more: Mapping[str, sp.Symbol] | None = None) -> sp.Expr:
        return values.expression(value, f"mechanics.{key}", {**self.symbols, **(more or {})}, self.definitions)

    def _expressions(self, key: str) -> dict[sp.Symbol, sp.Expr]:
        found = values.table(self.table, key)
        for word in found:
            if word not in self.symbols:
                raise ModelFileError(f"mechanics.{key}: {word[:64]} is no name of the model.")
        return {self.symbols[word]: self._expression(value, f"{key}.{word}") for word, value in found.items()}

    def _nested(self, value: object, key: str) -> Any:
        """An expression, or a list of such."""
        return (
            [self._nested(each, key) for each in value]
            if isinstance(value, list)
            else self._expression(value, key)
        )


def _named(table: Mapping[sp.Symbol, sp.Expr]) -> dict[str, sp.Expr]:
    return {symbol.name: expression for symbol, expression in table.items()}


def _without(definitions: dict, gone: set[str]) -> dict:
    """The definitions that do not rest on names which are `gone`, velocities say that are none of the states."""
    kept = dict(definitions)
    while True:
        lost = [head for head, text in kept.items() if gone & set(WORDS.findall(str(text)))]
        if not lost:
            return kept
        for head in lost:
            del kept[head]
        gone = gone | {WORDS.findall(head)[0] for head in lost if WORDS.findall(head)}
