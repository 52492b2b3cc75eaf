"""The faces of a noun: its chart, its table and its equations, given by the module `faces` of its own package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Any

from gsp.errors import DeclarationError

Maker = Callable[..., Any]
Makers = Mapping[type, Maker]


class Faces:
    """Faces of one kind, noun by noun. A package's are entered when one of its nouns is first asked for its face."""

    def __init__(self) -> None:
        self._made: dict[type, Maker] = {}
        self._late: list[Callable[[], Makers]] = []

    def of(self, *nouns: type) -> Callable[[Maker], Maker]:
        """Enter the decorated function as the face of `nouns`."""

        def enter(make: Maker) -> Maker:
            self._made.update(dict.fromkeys(nouns, make))
            return make

        return enter

    def late(self, give: Callable[[], Makers]) -> None:
        """Enter what the decorated function gives, once a face of this kind is wanted: it may import what is heavy."""
        self._late.append(give)

    def find(self, value: object) -> Maker | None:
        """What makes the face of `value`, or of the nearest noun that it inherits from; None where there is none."""
        for noun in type(value).__mro__:
            _enter(*noun.__module__.split(".")[:2])
            for give in self._late:
                self._made.update(give())
            if noun in self._made:
                return self._made[noun]
        return None


charts, tables, equations = Faces(), Faces(), Faces()


def draw(result: object, axes: Any = None) -> Any:
    """The chart of a result, whatever kind it is, on `axes` or Axes of its own; what `result.plot()` calls.

    Raises `DeclarationError` for an object that has no chart.
    """
    make = charts.find(result)
    if make is None:
        raise DeclarationError(
            f"there is no chart of a {type(result).__name__}.",
            "Results that have one have the method `plot`.",
        )
    return make(result, axes)


def enter_every_package() -> None:
    """Enter the faces of all packages, for what is looked for without a noun."""
    root = import_module(__name__.partition(".")[0])
    for module in iter_modules(root.__path__):
        if module.ispkg:
            _enter(root.__name__, module.name)


@cache
def _enter(root: str, package: str = "") -> None:
    # The one place where a module is found by a convention; nobody imports a module `faces`.
    if root != __name__.partition(".")[0] or not package:
        return
    found = find_spec(f"{root}.{package}")
    if found is not None and found.submodule_search_locations and find_spec(f"{root}.{package}.faces"):
        import_module(f"{root}.{package}.faces")
