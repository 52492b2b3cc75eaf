"""A scene that is saved is read back as the same scene, or is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError, OutputError
from gsp.readers import writing
from gsp.readers.writing import as_toml

SYSTEMS = sorted(Path(__file__).parents[1].joinpath("systems").glob("*.toml"))


def decay(rate: sp.Expr, **changes: object) -> gsp.Scene:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = gsp.SlowFastSystem(slow={x: -x}, fast={y: rate}, epsilon=epsilon, name="decay")
    scene = gsp.Scene(system, {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01, (0.02, 0.01), 1e-6, name="decay")
    return replace(scene, **changes)


def same(scene: gsp.Scene, path: Path) -> gsp.Scene:
    """What is read back, once its text is what reading and writing again gives, and its numbers are the same."""
    back = gsp.load(gsp.save(scene, path / "kept.toml"))
    assert as_toml(gsp.load(gsp.save(back, path / "again.toml"))) == as_toml(back)
    assert type(back.system) is type(scene.system)
    for attribute in (
        "region",
        "full_start",
        "span",
        "epsilon",
        "epsilons",
        "tolerance",
        "path",
        "title",
        "name",
    ):
        assert getattr(back, attribute) == getattr(scene, attribute), attribute
    return back


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", gsp.models.names())
def test_built_in_scenes_return(name, tmp_path):
    scene = gsp.models.load(name)
    back = same(scene, tmp_path)
    # A second route: the fields at the start.
    place = {**{k.name: v for k, v in scene.full_flow.parameters.items()}, **scene.full_start, "epsilon": 0.25}
    for told, found in zip(scene.full_flow.equations.values(), back.full_flow.equations.values(), strict=True):
        expected, got = (e.subs({s: place[s.name] for s in e.free_symbols}).evalf() for e in (told, found))
        assert got == pytest.approx(expected, rel=1e-13, abs=1e-13)


@pytest.mark.exhaustive
@pytest.mark.parametrize("path", SYSTEMS, ids=lambda path: path.stem)
def test_systems_from_the_literature_return(path, tmp_path):
    same(gsp.load(path), tmp_path)


def test_words_of_the_grammar_that_sympy_prints_otherwise(tmp_path):
    x, y = sp.symbols("x y")
    rate = (
        -y * sp.E + sp.Abs(x) + sp.Max(x, y, 2) * sp.Min(x, 1) + sp.exp(sp.sqrt(2) * x) - x ** sp.Rational(3, 2)
    )
    assert same(decay(rate), tmp_path).system.fast == {y: rate}


@pytest.mark.parametrize("text", ['"; [start] \\', "v̇ ≈ 𝜀", "a # b = 'c'", "two\nlines"])
def test_texts_return_as_they_are(text, tmp_path):
    assert same(decay(-sp.Symbol("y"), title=text), tmp_path).title == text


@pytest.mark.parametrize("number", ["1e-300", "1e300", '"10^200"', '"3^200"', '"-1/7^80"', '"2^170/3^170"'])
@pytest.mark.parametrize("place", ["k = {}", "k = 1"])
def test_numbers_that_were_read_are_written(number, place, tmp_path):
    rate = f"-k*x*({number})".replace('"', "") if place == "k = 1" else "-k*x"
    path = tmp_path / "model.toml"
    path.write_text(
        f'[parameters]\n{place.format(number)}\n[slow]\nx = "{rate}"\n[fast]\ny = "x - y"\n[region]\nx = [-1, 1]\n'
        "[start]\nx = 1\ny = 0\n[scene]\nspan = [0, 1]\nepsilon = 0.1\n"
    )
    scene = gsp.load(path)
    gsp.save(scene, tmp_path / "again.toml")
    again = gsp.load(tmp_path / "again.toml")
    assert again.full_flow.equations == scene.full_flow.equations
    assert list(again.system.parameters.values()) == list(scene.system.parameters.values())


def test_symbols_with_assumptions_are_known_by_name(tmp_path):
    x, y, epsilon = sp.symbols("x y epsilon", positive=True)
    system = gsp.SlowFastSystem(slow={x: -x}, fast={y: sp.log(x) - y}, epsilon=epsilon)
    scene = gsp.Scene(system, {"x": (1, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01, (0.02, 0.01), 1e-6, name="named")
    assert same(scene, tmp_path).system.fast == {sp.Symbol("y"): sp.log(sp.Symbol("x")) - sp.Symbol("y")}


def test_what_the_grammar_does_not_have_is_refused(tmp_path):
    y = sp.Symbol("y")
    with pytest.raises(DeclarationError, match="cannot be kept in a model file"):
        gsp.save(decay(sp.floor(y) - 2 * y), tmp_path / "kept.toml")
    assert not list(tmp_path.iterdir())


X, Y = sp.symbols("x y")


@pytest.mark.parametrize(
    "found",
    [
        decay(X - Y, title="another"),
        decay(X - Y, span=(0.0, 4.0)),
        decay(sp.Rational(1 + 10**9, 10**9) * X - Y),
        decay(sp.Rational(1 + 10**20, 10**20) * X - Y),
        decay(X - Y * X),
        decay(-Y),
    ],
    ids=["title", "span", "ninth digit", "twentieth digit", "product", "symbols"],
)
def test_a_text_that_is_read_as_another_scene_is_refused(found, monkeypatch):
    monkeypatch.setattr(writing, "read_model", lambda text, name: found)
    with pytest.raises(DeclarationError, match="is read back as"):
        as_toml(decay(X - Y))


def test_a_text_that_is_read_as_a_scene_with_more_in_it_is_refused(monkeypatch):
    told = decay(X - Y)
    found = replace(told, claims={"claim": {X: -X}})
    monkeypatch.setattr(writing, "read_model", lambda text, name: found)
    with pytest.raises(ValueError, match="zip"):
        as_toml(told)


def test_a_number_that_is_multiplied_into_a_sum_is_no_other_scene(monkeypatch):
    found = decay(X / 3 - Y / 3)
    monkeypatch.setattr(writing, "read_model", lambda text, name: found)
    as_toml(decay(sp.Mul(sp.Rational(1, 3), X - Y, evaluate=False)))


def test_a_path_that_is_no_model_file_is_refused(tmp_path):
    scene = decay(-sp.Symbol("y"))
    with pytest.raises(DeclarationError, match=r"ends in \.toml"):
        gsp.save(scene, tmp_path / "kept.txt")
    with pytest.raises(OutputError, match="cannot be written"):
        gsp.save(scene, tmp_path / "nowhere" / "kept.toml")


def test_a_letter_that_a_model_file_has_not_is_refused_by_its_name(tmp_path: Path) -> None:
    x, y, k, epsilon = sp.symbols("x y κ epsilon")
    system = gsp.SlowFastSystem(slow={x: -k * x}, fast={y: x - y}, epsilon=epsilon, parameters={k: 1})
    scene = gsp.Scene(system, {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01)
    with pytest.raises(
        DeclarationError, match="kept in a model file: parameters: the name 'κ' is no plain word"
    ):
        gsp.save(scene, tmp_path / "kept.toml")
