"""What describes the package agrees: pyproject.toml, CITATION.cff, .zenodo.json, the conda recipe and the paper."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml

import gsp

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
ZENODO = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
RECIPE = yaml.safe_load((ROOT / "packaging" / "recipe.yaml").read_text(encoding="utf-8"))
PAPER = (ROOT / "docs" / "paper" / "paper.md").read_text(encoding="utf-8")
PAPER_HEAD = yaml.safe_load(PAPER.split("---")[1])
# Conda splits Matplotlib in two, of which the smaller has all that a program needs.
CONDA_NAMES = {"matplotlib": "matplotlib-base", "flit_core": "flit-core"}


def entries(path: Path) -> dict[str, str]:
    """The entries of a BibTeX file by their keys."""
    text = path.read_text(encoding="utf-8")
    return {
        found[1]: found[0]
        for found in re.finditer(r"^@\w+\{([\w-]+),\n.*?^\}$", text, re.MULTILINE | re.DOTALL)
    }


def conda(requirement: str) -> str:
    """A requirement of pip as conda writes it."""
    name, bounds = re.fullmatch(r"([\w-]+)(.*)", requirement).groups()  # pyright: ignore[reportOptionalMemberAccess]
    return f"{CONDA_NAMES.get(name, name)} {bounds}"


def test_versions_and_licences_are_the_same_everywhere() -> None:
    assert CITATION["version"] == RECIPE["context"]["version"] == gsp.__version__
    licence = PROJECT["project"]["license"]
    assert CITATION["license"] == ZENODO["license"] == RECIPE["about"]["license"] == licence == "BSD-3-Clause"
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").startswith("BSD 3-Clause License")


def test_names_and_words_are_the_same_everywhere() -> None:
    assert CITATION["title"] == ZENODO["title"] == PAPER_HEAD["title"]
    assert " ".join(CITATION["abstract"].split()) == ZENODO["description"]
    authors = [author["name"] for author in PROJECT["project"]["authors"]]
    assert [author["name"] for author in CITATION["authors"]] == authors
    assert [creator["name"] for creator in ZENODO["creators"]] == authors
    assert [author["name"] for author in PAPER_HEAD["authors"]] == authors
    assert CITATION["keywords"] == ZENODO["keywords"] == PROJECT["project"]["keywords"]
    assert RECIPE["package"]["name"] == PROJECT["project"]["name"]
    assert RECIPE["about"]["summary"] == PROJECT["project"]["description"]


def test_the_recipe_asks_for_what_the_package_asks_for() -> None:
    least = PROJECT["project"]["requires-python"].removeprefix(">=")
    assert RECIPE["context"]["python_min"] == least
    run = [line for line in RECIPE["requirements"]["run"] if not line.startswith("python ")]
    assert run == [conda(requirement) for requirement in PROJECT["project"]["dependencies"]]
    (backend,) = PROJECT["build-system"]["requires"]
    assert conda(backend) in RECIPE["requirements"]["host"]
    scripts = [f"{name} = {target}" for name, target in PROJECT["project"]["scripts"].items()]
    assert RECIPE["build"]["python"]["entry_points"] == scripts


def test_the_paper_cites_what_is_in_its_bibliography() -> None:
    cited = set(re.findall(r"@([a-z]+\d{4})", PAPER.split("---", 2)[2]))
    assert cited == set(entries(ROOT / "docs" / "paper" / "paper.bib"))


def test_what_two_bibliographies_share_is_the_same() -> None:
    ours, reports = (
        entries(ROOT / "docs" / "paper" / "paper.bib"),
        entries(ROOT / "gsp/report/templates/report.bib"),
    )
    shared = set(ours) & set(reports)
    assert len(shared) > 3
    assert {key: ours[key] for key in shared} == {key: reports[key] for key in shared}


@pytest.mark.parametrize("number", sorted(set(re.findall(r"\d+\.\d+", PAPER.split("---", 2)[2]))))
def test_every_number_of_the_paper_is_measured(number: str) -> None:
    """In a table of the benchmarks, or in the tutorial, whose output is compared with what is printed there."""
    pages = "".join(
        (ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("benchmarks.md", "tutorial.md")
    )
    assert re.search(rf"(?<![\d.]){re.escape(number)}(?![\d.])", pages)
