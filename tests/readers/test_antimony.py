"""Antimony: its library makes the SBML, in a process of its own, and opens no file."""

from __future__ import annotations

from pathlib import Path

import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError, ModelFileError
from gsp.readers.loading import import_model, load_noted
from gsp.scenes.settings import ask_again

pytest.importorskip("antimony", reason="antimony is not installed")
pytest.importorskip("libsbml", reason="python-libsbml is not installed")

ENZYME = """
// No import here.
model *enzyme()
  bind: S + E -> C; (k1*S*E - km*C)/eps
  make: C -> P + E; k2*C
  S = 10; E = 1; C = 0; P = 0
  k1 = 0.1; km = 3; k2 = 5; eps = 0.01
end
"""


def read(folder: Path, text: str) -> gsp.Scene:
    path = folder / "model.ant"
    path.write_text(text)
    return gsp.load(path)


def test_a_model_is_read(tmp_path: Path) -> None:
    scene = read(tmp_path, ENZYME)
    S, C, eps = sp.symbols("S C eps")
    values = dict(scene.system.parameters)
    bound = (sp.Rational(1, 10) * S * (1 - C) - 3 * C) / eps
    found = [sp.expand(rate.xreplace(values)) for rate in scene.system.rates]
    assert found == [sp.expand(-bound), sp.expand(bound - 5 * C)]
    assert scene.title == "enzyme"


def test_the_region_of_what_is_conserved_is_all_of_it(tmp_path: Path) -> None:
    # S + C + P = 10 and E + C = 1: there is no more, and no less can be asked about.
    assert read(tmp_path, ENZYME).region == {"S": (0.0, 10.0), "C": (0.0, 1.0)}
    # Two of y make one z, 2 z + y = 5. What only a source makes has no bound, and keeps the guess.
    pairs = """J1: 2 y -> z; k*y^2/eps; J2: z -> 2 y; k*z/eps; J3: -> w; k*z
    y = 4; z = 0.5; w = 1; k = 1; eps = 0.1"""
    kept = read(tmp_path, pairs).region
    assert kept["w"] == (0.0, 2.0)
    assert [kept[name] for name in kept if name != "w"] in ([(0.0, 5.0)], [(0.0, 2.5)])
    # Without a small parameter nothing needs a guess, and a run is not told to end at one.
    without = read(tmp_path, pairs.replace("/eps", "").replace("; eps = 0.1", ""))
    assert not without.has_small
    assert "w" not in without.region
    assert list(without.region.values()) in ([(0.0, 5.0)], [(0.0, 2.5)])


@pytest.mark.parametrize(
    "line",
    [
        'import "secret.ant"',
        'IMPORT "secret.ant"',
        'import/* */"secret.ant"',
        '/* import "secret.ant" */',
        '// */ import "secret.ant"',
        "x = \"// \"; import 'secret.ant'",
        '// \rimport "secret.ant"',
    ],
)
def test_no_file_is_opened(tmp_path: Path, line: str) -> None:
    with pytest.raises(ModelFileError, match=r"line 9: import opens another file"):
        read(tmp_path, ENZYME + line)


def test_submodels_are_written_out(tmp_path: Path) -> None:
    scene = read(
        tmp_path,
        "model part() S -> ; k*S/eps; S = 2; k = 3; eps = 0.1; end\n"
        "model *whole() A: part(); eps = 0.1; A.eps is eps; end",
    )
    assert [z.name for z in scene.system.states] == ["A_S"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("S -> ; S/eps; eps = 0.1; S = 1\x00; S = 2", r"hidden character U\+0000"),
        ("S -> ; (((", "this is no Antimony"),
        ("S -> ; S/eps; eps = 0.1", "S has no initial value"),
        ("S -> ; S/eps; eps = 0.1; S = 1; at (S < 0.5): S = 1", "1 event"),
        ("S -> ; " + "+".join(["S"] * 50_000) + "; S = 1", "broke down|characters|nested"),
        ("model a() A: a(); S -> ; S; S = 1; end", "broke down|no Antimony|nothing|no model|no reaction"),
        ("", "no reaction|no model"),
    ],
)
def test_what_is_not_read_is_refused(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ModelFileError, match=words):
        read(tmp_path, text)


@pytest.mark.parametrize(
    ("text", "title"), [("S -> ; S; S = 1", ""), ("model *decay() S -> ; S; S = 1; end", "decay")]
)
def test_a_model_without_a_name_has_no_title(tmp_path: Path, text: str, title: str) -> None:
    assert read(tmp_path, text).title == title


def test_rounded_numbers_are_told(tmp_path: Path) -> None:
    path = tmp_path / "model.ant"
    path.write_text(ENZYME.replace("k2 = 5", "k2 = 0.12345678901234567"))
    assert any("rounds numbers to 15 digits: 0.12345678901234567" in note for note in load_noted(path)[1])


@pytest.mark.parametrize(
    ("text", "name", "kept"),
    [
        (
            "compartment c1=1, c2=3; species A in c1, B in c2; A=3; B=0; J: A -> B; k*A*c1; k=.5",
            "c1",
            "total_B",
        ),
        (
            "S1 -> S2; k1*S1 - k2*S2; S1 = T - S2; S2 = T/4; T=8; k1=0.1; k2=k1*2",
            "T",
            "the start of S2, total_S1",
        ),
        ("S1 -> S2; k1*S1 - k2*S2; S1 = 8; S2 = 2; k1=0.1; k2=k1*2", "k1", "k2"),
        ("compartment c=2; species $A in c; A=c*3; x'=A-x; x=1", "c", "A"),
        ("R: A -> ; k*A; A=1; k=0.3; z=2*R; x'=z; x=0", "k", "z"),
        ("R: A -> ; g*A; A=1; g:=2*k; k=0.3; z=2*R; x'=z; x=0", "k", "z"),
    ],
)
def test_a_value_is_not_changed_without_what_the_file_works_out_of_it(
    tmp_path: Path, text: str, name: str, kept: str
) -> None:
    (tmp_path / "m.ant").write_text(text, encoding="utf-8")
    scene = gsp.load(tmp_path / "m.ant")
    with pytest.raises(DeclarationError, match=f"when the file was read would stay as it is: {kept}."):
        ask_again(scene, parameters={name: 4})
    words = kept.split(", ")
    if all(word in map(str, scene.system.parameters) for word in words):
        assert ask_again(scene, parameters={name: 4, **dict.fromkeys(words, 1)}).start == scene.start
    for free in {str(p) for p in scene.system.parameters} - scene.worked_out.keys():
        assert ask_again(scene, parameters={free: 4}).start == scene.start
    told = import_model(tmp_path / "m.ant").notes
    # Sizes of compartments are in most totals and starts.
    assert any("worked out once, at the start: " in note for note in told) == (not name.startswith("c"))


def test_a_small_parameter_of_which_something_is_worked_out_is_one(tmp_path: Path) -> None:
    scene = read(tmp_path, "x' = (y - x)/k1; y' = -k2*y; x = 1; y = 1; k1 = 0.01; k2 = k1*50")
    assert str(gsp.take_small(scene, parameter="k1").system.epsilon) == "k1"


@pytest.mark.parametrize("number", ["1d-3", "1.5D2", "0x10", "0b101", "1e3f", "1_000", "2*1e", "3ml"])
def test_a_number_with_a_word_behind_it_is_refused(tmp_path: Path, number: str) -> None:
    """The library takes 0x10 for 0 in a unit x10, and 1d-3 for 1 - 3."""
    with pytest.raises(ModelFileError, match="in a unit of its own"):
        read(tmp_path, f"x' = -k*x; x = 1; k = {number}")


def test_numbers_are_read_beside_units_and_species(tmp_path: Path) -> None:
    text = "A + 2B => 3C; k*A*B; A = 1; B = 2.e0; C = 0  // k=0x10\nk = 5e-1 ml /* or\nk = 3d2 */"
    assert read(tmp_path, text).system.parameters[sp.Symbol("k")] == sp.Rational(1, 2)


@pytest.mark.parametrize("number", ["1e400", "1e-400", "123e400"])
def test_a_number_that_no_double_holds_is_refused(tmp_path: Path, number: str) -> None:
    """The library takes its exponent for a unit."""
    with pytest.raises(ModelFileError, match=f"no double holds the number {number}"):
        read(tmp_path, f"k = {number}\nx' = -k*x\nx = 1\n")
    assert read(tmp_path, "k = 0e-400\nx' = -k*x\nx = 1\n").start == {"x": 1.0}


def test_a_letter_that_the_library_does_not_take_is_named(tmp_path: Path) -> None:
    with pytest.raises(ModelFileError, match="takes no names with letters beyond ASCII"):
        read(tmp_path, "é' = 1\n")


def test_values_that_are_made_of_the_small_parameter_once_are_told(tmp_path: Path) -> None:
    binding = """
model binding()
  A -> B; kf*A - kb*B
  B -> C; k*B%s
  A = 2; B = 0; C = 0; fast = 10/eps; kf = 2*fast; kb = 5/eps; k = 1; eps = 0.02
end
"""
    path = tmp_path / "model.ant"
    path.write_text(binding % "")
    scene, notes = load_noted(path)
    assert scene.epsilon is None
    assert any(note.endswith("only in values that are worked out once: kf, kb, fast") for note in notes)
    with pytest.raises(ModelFileError) as caught:
        import_model(path, small="eps")
    assert caught.value.fact.endswith("only in values that are worked out once: kf, kb, fast")
    assert caught.value.remedy == "Make rules of them, as k := 1/eps is one in Antimony."
    path.write_text(binding % "/eps")
    _, notes = load_noted(path)
    assert "worked out once, for this eps, and kept when it changes: kf, kb, fast" in notes
    path.write_text(
        (binding % "").replace("fast =", "fast :=").replace("kf =", "kf :=").replace("kb =", "kb :=")
    )
    scene, notes = load_noted(path)
    assert not any(note.startswith("worked out") for note in notes)
    A, B, eps = sp.symbols("A B eps")
    assert sp.expand(scene.system.rates[0].subs("default_compartment", 1) - (5 * B - 20 * A) / eps) == 0
