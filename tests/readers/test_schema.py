"""The schema of model files, for editors: it takes what the reader takes, and refuses what has not its form."""

from __future__ import annotations

import json
import tomllib
from importlib.resources import files
from pathlib import Path

import jsonschema
import pytest

import gsp
from gsp.errors import ModelFileError
from gsp.readers.loading import import_model
from gsp.readers.toml import _SCENE, _TABLES
from tests.test_documents import ROOT, blocks

SCHEMA = json.loads(files("gsp.readers").joinpath("model.schema.json").read_text(encoding="utf-8"))
TESTS = Path(__file__).parent.parent
MODELS = sorted((TESTS / "systems").glob("*.toml"))
ODES = sorted((Path(__file__).parent / "xppaut").glob("*.ode"))

MODEL = """
[parameters]
a = 1

[definitions]
"f(u)" = "a*u"

[slow]
x = "-x"

[fast]
y = "f(x) - y"

[region]
x = [0, 2]

[start]
x = 1
y = 1

[scene]
span = [0, 1]
epsilon = 0.01
"""


def complaints(text: str) -> list[str]:
    validator = jsonschema.Draft202012Validator(SCHEMA)
    return [error.message for error in validator.iter_errors(tomllib.loads(text))]


def test_it_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)


def test_it_names_what_the_reader_knows() -> None:
    assert set(SCHEMA["properties"]) >= set(_TABLES)
    assert set(SCHEMA["properties"]["scene"]["properties"]) == set(_SCENE)


@pytest.mark.exhaustive
@pytest.mark.parametrize("path", MODELS, ids=lambda path: path.stem)
def test_models_of_the_tests_are_taken(path: Path) -> None:
    assert complaints(path.read_text(encoding="utf-8")) == []


@pytest.mark.exhaustive
def test_the_documented_model_and_imported_ones_are_taken() -> None:
    models = blocks(ROOT / "docs" / "models.md", "toml")
    assert models
    assert ODES
    named = {"hindmarsh_rose": "r", "morris_lecar": "epsilon"}
    models += [import_model(path, small=named.get(path.stem, "eps")).text for path in ODES]
    for text in models:
        assert complaints(text) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[region]\nx = [0, 2]", ""),
        ("[scene]", "[scenes]"),
        ("span = [0, 1]", "spam = [0, 1]"),
        ("span = [0, 1]", "span = [0, 1, 2]"),
        ("epsilon = 0.01", "epsilon = true"),
        ('x = "-x"', 'x = ["-x"]'),
        ('x = "-x"', '"x-" = "-x"'),
        ('"f(u)"', '"f(u"'),
        ("[fast]", "[states]"),
        ("[fast]", "[fast.y]"),
    ],
)
def test_what_the_reader_refuses_for_its_form_the_schema_refuses(tmp_path: Path, old: str, new: str) -> None:
    path = tmp_path / "model.toml"
    path.write_text(MODEL)
    gsp.load(path)
    assert complaints(MODEL) == []
    assert old in MODEL
    wrong = MODEL.replace(old, new)
    path.write_text(wrong)
    with pytest.raises(ModelFileError):
        gsp.load(path)
    assert complaints(wrong)
