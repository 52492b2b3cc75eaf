"""What the documents say is run: README, first steps, examples, and the docstrings' examples."""

import ast
import contextlib
import doctest
import importlib
import io
import pkgutil
import re
import tomllib
from pathlib import Path

import pytest
import sympy as sp

import gsp
from gsp.sweeps.plan_file import read_plan_file
from tests.cases import sampled

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*/*.py"))
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(document: Path, language: str) -> list[str]:
    return re.findall(
        rf"^```{language}\n(.*?)^```", document.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )


def test_readme_begins_with_the_two_commands() -> None:
    first = blocks(ROOT / "README.md", "sh")[0].splitlines()
    assert first == [
        "pip install --no-compile . && gsp report chaplygin_sleigh",
        "pip install '.[test]' && pytest",
    ]


def test_the_version_is_one_in_the_package_the_citation_and_the_changelog() -> None:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (version,) = re.findall(r"^version: (\S+)$", citation, re.MULTILINE)
    (released,) = re.findall(r'^date-released: "(\S+)"$', citation, re.MULTILINE)
    headings = re.findall(r"^## (.+)$", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert version == gsp.__version__
    assert headings[:2] == ["Unreleased", f"{version} - {released}"]
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    # The back end reads it from the package.
    assert declared["project"]["dynamic"] == ["version"]
    assert declared["tool"]["flit"]["module"] == {"name": "gsp"}


def test_ruff_has_one_version() -> None:
    pins = {
        name: re.findall(r"ruff==([0-9.]+)", (ROOT / name).read_text(encoding="utf-8"))
        for name in ("pyproject.toml", ".pre-commit-config.yaml")
    }
    (version,) = pins["pyproject.toml"]
    assert pins[".pre-commit-config.yaml"] == [version, version]


@pytest.mark.parametrize("name", ["CONTRIBUTING.md", "README.md", "docs/architecture.md", ".ci/run"])
def test_paths_that_a_document_names_are_there(name: str) -> None:
    text = (ROOT / name).read_text(encoding="utf-8")
    paths = re.findall(r"(?<![\w./])(?:gsp|tests|docs|benchmarks|examples)/[\w./-]*\w", text)
    assert paths
    # What sphinx-build writes is there only where it was run.
    kept = [path for path in paths if not path.startswith("docs/_build")]
    assert [path for path in kept if not (ROOT / path).exists()] == []


@pytest.mark.parametrize("document", sampled(DOCUMENTS, always=DOCUMENTS[:1]), ids=lambda path: path.name)
def test_the_python_in_a_document_runs_from_top_to_bottom(
    document: Path, capsys, monkeypatch, tmp_path
) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    for block in blocks(document, "python"):
        exec(compile(block, document.name, "exec"), names)
    printed = capsys.readouterr().out
    if document.name == "README.md":
        assert "kappa*lambda*s/(kappa + s)**4" in printed
        assert "0.50303" in printed


NUMBER = re.compile(r"-?\b\d+\.\d+(?:e[-+]\d+)?")


def test_the_tutorial_shows_what_its_code_prints() -> None:
    """Word for word, and numbers to one in a hundred, for the last digits are the processor's."""
    names: dict = {}
    shown = 0
    text = (ROOT / "docs/tutorial.md").read_text(encoding="utf-8")
    for code, _, expected in re.findall(
        r"^```python\n(.*?)^```\n(\n```text\n(.*?)^```)?", text, re.DOTALL | re.MULTILINE
    ):
        with contextlib.redirect_stdout(io.StringIO()) as printed:
            exec(compile(code, "tutorial.md", "exec"), names)
        found = printed.getvalue().strip()
        assert NUMBER.sub("#", found) == NUMBER.sub("#", expected.strip())
        assert [*map(float, NUMBER.findall(found))] == pytest.approx(
            [*map(float, NUMBER.findall(expected))], rel=0.01
        )
        shown += bool(expected)
    assert shown == 8


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_every_model_file_in_a_document_loads_and_compares(document: Path, tmp_path) -> None:
    scene: gsp.Scene | None = None
    for i, block in enumerate(blocks(document, "toml")):
        file = tmp_path / f"model_{i}.toml"
        file.write_text(block, encoding="utf-8")
        if block.startswith("task"):
            # A plan of a sweep, of which one point is done.
            plan = read_plan_file(file)
            one = {name: values[:1] for name, values in plan["over"].items()}
            assert gsp.sweep(**{**plan, "over": one}, into=tmp_path / f"sweep_{i}", workers=1).failed == 0
            continue
        if block.startswith("axes"):
            # A story of the model before it.
            assert scene is not None
            assert gsp.demo(scene, story=file).html
            continue
        scene = gsp.load(file)
        if not scene.has_small:
            assert gsp.integrate(scene).status.ok
            continue
        comparison = gsp.compare(scene, orders=(0, 1))
        assert comparison.slopes[1] == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_between_documents_lead_somewhere(document: Path) -> None:
    for target in re.findall(r"\]\(([^)#]+)\)", document.read_text(encoding="utf-8")):
        assert (document.parent / target).exists(), target


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_and_has_a_title_a_figure_and_a_number_that_is_checked(script: Path) -> None:
    """They are run where the site is built (`.ci/run`), which ends at the first that fails."""
    text = script.read_text(encoding="utf-8")
    assert len(text.splitlines()) < 100
    tree = ast.parse(text)
    title, line, *_ = (ast.get_docstring(tree) or "").splitlines()
    assert line == "=" * len(title)
    assert len(title) > 0
    drawn = [
        node for node in tree.body if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "axes"
    ]
    assert drawn
    checked = [
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Assert) and "is not None" not in ast.unparse(node)
    ]
    assert checked


def test_the_reference_has_every_public_name_once() -> None:
    pages = sorted((ROOT / "docs" / "reference").glob("*.md"))
    text = "\n".join(page.read_text(encoding="utf-8") for page in pages)
    named = re.findall(r"^\.\. auto(?:class|function):: gsp\.(\w+)", text, re.MULTILINE)
    modules = set(re.findall(r"^\.\. automodule:: gsp\.(\w+)", text, re.MULTILINE))
    assert sorted(named) == sorted(set(gsp.__all__) - modules - {"readers"})
    assert {"charts", "mechanics", "models"} <= modules


def test_a_decision_takes_three_lines() -> None:
    """What, why and what was rejected: the page stays one that can be read."""
    lines = (ROOT / "docs/decisions.md").read_text(encoding="utf-8").splitlines()
    heads = [i for i, line in enumerate(lines) if re.search(r"^[^`]{0,5}2026-\d\d-\d\d\.", line)]
    assert len(heads) > 100
    assert [lines[i] for i in heads if not lines[i].startswith("- **")] == []
    ends = [i for i, line in enumerate(lines) if not line.startswith("  ")] + [len(lines)]
    assert [lines[i] for i in heads if min(end for end in ends if end > i) - i > 3] == []


def test_the_readme_is_read_in_a_minute() -> None:
    """It sells; everything else is on the site."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    prose = re.sub(r"^```.*?^```|<[^>]*>|\]\([^)]*\)", " ", text, flags=re.DOTALL | re.MULTILINE)
    assert len(prose.split()) < 250
    assert len(re.findall(r"images/thumbnail-\S+\.png", text)) == 6


def test_every_page_is_in_the_contents_of_the_site() -> None:
    """Pages that no contents name are not found by a reader, and end the strict build."""
    (listed,) = re.findall(
        r"<!-- contents\n(.*?)-->", (ROOT / "docs/index.md").read_text(encoding="utf-8"), re.DOTALL
    )
    names = {name for line in listed.splitlines() for name in line.partition(": ")[2].split()}
    pages = {page.stem for page in (ROOT / "docs").glob("*.md")}
    assert names - {"gallery/index", "reference/index"} == pages - {"index"}


def test_every_module_of_the_tests_that_a_document_calls_is_imported() -> None:
    texts = [document.read_text(encoding="utf-8") for document in sorted(ROOT.glob("docs/*.md"))]
    names = {name for text in texts for name in re.findall(r"python -m (tests[.\w]+)", text)}
    assert "tests.ode_collection" in names
    for name in names:
        importlib.import_module(name)


def module_names() -> list[str]:
    return [
        info.name for info in pkgutil.walk_packages(gsp.__path__, "gsp.") if not info.name.endswith("__main__")
    ]


@pytest.mark.parametrize("name", module_names())
def test_the_examples_in_docstrings_print_what_they_say(name: str) -> None:
    module = importlib.import_module(name)
    public = {key: getattr(gsp, key) for key in gsp.__all__}
    globals_ = {**public, "sp": sp, **vars(module)}
    finder = doctest.DocTestFinder(exclude_empty=True)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS)
    for test in finder.find(module, name, globs=globals_):
        runner.run(test)
    assert runner.summarize(verbose=False).failed == 0
