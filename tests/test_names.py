"""One name for one thing, and functions that take no more than a reader can hold."""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "gsp"
MOST = 8

# Verbs whose keywords are documented one by one, and a command whose options are.
WITH_MORE = {
    "critical_sheet", "continue_critical", "continue_folds", "continue_orbits", "periodic_orbit", "integrate",
    "integrate_many", "SlippingSystem.scene", "sweep", "demo",
}  # fmt: skip


@cache
def declared() -> tuple[dict[str, list[str]], dict[str, tuple[Path, int]]]:
    """Places of classes by name, and the module and the parameters of functions; trees take too much memory to keep."""
    places, counts = defaultdict(list), {}
    for path in sorted(SOURCE.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(f"{path.relative_to(SOURCE)}:{node.lineno}")
        counts |= {name: (path, count) for name, count in functions(tree.body) if count > MOST}
    return places, counts


def functions(body: list[ast.stmt], within: str = "") -> list[tuple[str, int]]:
    """Names of functions, with that of their class, and how many parameters each has beside `self`."""
    found = []
    for node in body:
        if isinstance(node, ast.ClassDef):
            found += functions(node.body, f"{node.name}.")
        elif isinstance(node, ast.FunctionDef):
            given = node.args
            names = [each.arg for each in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
            count = len(names) + bool(given.vararg) + bool(given.kwarg) - (names[:1] in (["self"], ["cls"]))
            found += [(within + node.name, count), *functions(node.body, f"{within}{node.name}.")]
    return found


def test_no_two_classes_share_a_name() -> None:
    places, _ = declared()
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_functions_have_eight_parameters_at_most() -> None:
    _, many = declared()
    assert set(many) == WITH_MORE


def test_parameters_are_counted_without_self_and_within_classes() -> None:
    tree = ast.parse("class A:\n  def f(self, a, /, b, *c, d, **e): pass\ndef g(cls):\n  def h(x): pass")
    assert functions(tree.body) == [("A.f", 5), ("g", 0), ("g.h", 1)]
