"""The benchmarks' page says what the JSON beside it holds, and nothing else; the problems are well posed."""

from __future__ import annotations

import importlib
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

from gsp.integration.trajectory import integrate

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"


@pytest.fixture
def module(monkeypatch):
    """A module of `benchmarks/`, which are scripts beside each other, by name."""
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    names = {path.stem for path in (ROOT / "benchmarks").glob("*.py")}

    def load(name: str) -> ModuleType:
        return importlib.import_module(name)

    yield load
    for name in names & set(sys.modules):
        del sys.modules[name]


def measured() -> dict:
    return json.loads((DOCS / "benchmarks.json").read_text(encoding="utf-8"))


def test_the_page_is_what_the_json_beside_it_gives(module) -> None:
    page = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    assert page == module("page").render(measured())


def test_the_page_says_plainly_what_falls_short(module) -> None:
    page = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    rows = module("page").targets(measured())
    short = [row for row in rows if not row.is_met]
    assert page.count("**short**") == len(short)
    for row in short:
        assert f"- {row.what}: {row.reached}, wanted {row.wanted}." in page


def test_a_target_is_met_or_short(module) -> None:
    page = module("page")
    assert page.at_least("ratio", 2.5, 2.5).is_met
    assert not page.at_least("ratio", 2.4, 2.5).is_met
    assert not page.at_most("time", 16.0, 15, "us").is_met
    assert page.at_most("time", 14.0, 15, "us").reached == "14.0 us"


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "-"), (0.0, "0.00"), (2.504, "2.50"), (123.4, "123"), (3e-7, "3.0e-07"), (9.999, "10.00")],
)
def test_figures_keep_three_digits(module, value, text) -> None:
    assert module("page").figure(value) == text


def test_least_times_are_interpolated_on_a_ladder(module) -> None:
    integrators = module("integrators")
    points = [(1e-2, 1e-2, 1.0), (1e-4, 1e-4, 4.0), (1e-6, float("nan"), 5.0)]
    assert integrators.time_at(points, 1e-3) == pytest.approx(2.0)
    assert integrators.time_at(points, 1e-5) is None
    cell = integrators.cell(
        {"gsp": points, "gsp RADAU9": [(1e-2, 1e-9, 1e-9)], "other": [(1e-3, 1e-6, 6.0)]}, 1e-3
    )
    assert cell["ratio"] == pytest.approx(3.0)
    assert cell["peer"] == "other"


@pytest.mark.exhaustive
def test_every_problem_is_solved(module) -> None:
    problems = module("problems")
    assert len(problems.PROBLEMS) == 9
    assert len(problems.RING.field.states) == 20
    for problem in (*problems.PROBLEMS, problems.RING):
        assert problem.times[-1] == problem.span[1]
        run = integrate(
            problem.field,
            start=problem.start,
            span=problem.span,
            epsilon=problem.epsilon,
            rtol=1e-4,
            atol=1e-4 * problem.floor,
        )
        assert run.status.ok, problem.name


def test_every_part_of_the_page_comes_from_a_run(module) -> None:
    """A block entered by hand would be gone after the next run."""
    run = module("run")
    source = (ROOT / "benchmarks/run.py").read_text(encoding="utf-8")
    for name, part in measured().items():
        assert name in run.PARTS or f'"{name}":' in source or name == "seconds"
        if name in run.PARTS:
            assert {"measured", "load", "rows"} <= part.keys()


@pytest.mark.exhaustive
def test_problems_of_loose_tolerances_are_none_that_methods_were_tuned_on(module) -> None:
    problems = [make() for make in module("loose").PROBLEMS]
    assert len(problems) >= 6
    assert not {p.name for p in problems} & {p.name for p in module("problems").PROBLEMS}
    for problem in problems:
        run = integrate(
            problem.field, start=problem.start, span=problem.span, rtol=1e-4, atol=1e-4 * problem.floor
        )
        assert run.status.ok


def test_a_cell_below_the_goal_is_short(module) -> None:
    page = module("page")
    found = {row.what: row for row in page.targets(measured())}
    loose = measured()["loose"]
    for error, least in zip(loose["errors"], loose["least"]):
        name = f"problems not tuned on, {loose['rival']}'s time over ours at {page.power(error)}"
        assert found[f"{name} over the output grid, least"].is_met == (least >= 1)
