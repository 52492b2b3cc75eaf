"""The small parameter of a foreign model: its name alone makes no parameter small."""

from __future__ import annotations

from pathlib import Path

import pytest

from gsp.readers.loading import import_model, load_noted

LEVEL = "x' = {x}\ny' = {y}\npar {parameters}\ninit x=1, y=2\ndone\n"


def written(folder: Path, x: str, y: str, parameters: str) -> Path:
    path = folder / "model.ode"
    path.write_text(LEVEL.format(x=x, y=y, parameters=parameters))
    return path


@pytest.mark.parametrize(
    ("value", "x", "why"),
    [
        ("6.81", "(y - x)/{0}", "a small one is above 0 and at most 0.1"),
        ("1", "(y - x)/{0}", "a small one is above 0 and at most 0.1"),
        ("0", "{0}*(y - x)", "a small one is above 0 and at most 0.1"),
        ("-.01", "{0}*(y - x)", "a small one is above 0 and at most 0.1"),
        ("1e-16", "(y - x)/(x + {0})", "it is no pole and no factor of a whole rate"),
        (".01", "y - {0}*x", "it is no pole and no factor of a whole rate"),
        (".01", "y - exp({0}*x)", "it stands inside exp"),
        (".01", "(y - exp(-x/{0}))/{0}", "it stands inside exp"),
        (".01", "y - x", "it stands in no rate"),
    ],
)
@pytest.mark.parametrize("name", ["epsilon", "eps"])
def test_what_is_not_small_is_an_ordinary_parameter(
    tmp_path: Path, name: str, value: str, x: str, why: str
) -> None:
    path = written(tmp_path, x.format(name), "-y", f"{name}={value}, k=2")
    scene, notes = load_noted(path)
    assert scene.epsilon is None
    assert name in map(str, scene.system.parameters)
    assert any(note.startswith(f"{name} = {value} is an ordinary parameter: {why}") for note in notes), notes


@pytest.mark.parametrize(
    ("x", "factor"),
    [("k*(1 - x)", "0.002"), ("k/10*(1 - x)", "0.0002"), (".005*(1 - x*k)", "0.005"), ("(1 - x)*k*3", "0.006")],
)
def test_what_is_slower_still_makes_it_an_ordinary_parameter(tmp_path: Path, x: str, factor: str) -> None:
    """y' = eps (..) and x' = k (..) with k below eps: in the time of y the rate of x has a pole, and x is slower."""
    scene, notes = load_noted(written(tmp_path, x, "eps*(x - y)", "eps=0.01, k=0.002"))
    assert scene.epsilon is None
    assert (
        f"eps = 0.01 is an ordinary parameter: x would be fast, and its rate has a factor that is no larger, {factor}"
        in notes
    )


@pytest.mark.parametrize(
    ("value", "x", "y"),
    [
        (".1", "(y - x)/eps", "-y"),
        (".01", "(y - x)*20*eps + eps*k", "eps*k*y"),
        (".01", "k*20*(y - x)", "eps*y"),
        ("1e-3", "y - x", "eps*(1 - y)"),
        (".01", "(y - x)/eps + eps*x", "-y/(1 + eps)"),
        (".01", "y - x + eps*x", "eps*x - eps*y"),
        (".01", "y - x", "-y/(1 + 1/eps)"),
    ],
)
def test_a_pole_or_a_factor_of_a_whole_rate_is_small(tmp_path: Path, value: str, x: str, y: str) -> None:
    scene, notes = load_noted(written(tmp_path, x, y, f"eps={value}, k=.002"))
    assert scene.system.epsilon.name == "eps"
    assert scene.epsilon == float(value)
    assert not any("ordinary" in note for note in notes)


def test_the_other_name_is_taken_where_one_is_ordinary_and_the_notes_say_so(tmp_path: Path) -> None:
    scene, notes = load_noted(written(tmp_path, "(y - epsilon*x)/eps", "-y", "epsilon=6.81, eps=.02"))
    assert (scene.system.epsilon.name, scene.epsilon) == ("eps", 0.02)
    assert {s.name: float(v) for s, v in scene.system.parameters.items()} == {"epsilon": 6.81}
    assert "epsilon = 6.81 is an ordinary parameter: a small one is above 0 and at most 0.1" in notes
    assert "epsilon = 6.81 is an ordinary parameter" in scene.description


def test_who_names_the_parameter_knows_that_it_is_small(tmp_path: Path) -> None:
    path = written(tmp_path, "(y - epsilon*x)/k", "-y", "epsilon=6.81, k=.5")
    assert 'epsilon = "k"' in import_model(path, small="k").text
    assert (
        'epsilon = "epsilon"'
        in import_model(written(tmp_path, "(y - x)/epsilon", "-y", "epsilon=1"), small="epsilon").text
    )
