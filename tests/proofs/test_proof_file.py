"""Proof files: the checker accepts what was proved, and no file that was changed to say more or something else."""

import copy
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import sympy as sp

import gsp
from gsp.errors import GspError, OutputError
from gsp.proofs import untrusted
from gsp.proofs.checker import Rejected
from gsp.proofs.verification import verify
from gsp.slow_tubes.certify import certify
from tests.proof_files import SCENES, changed, counted_products, number, written
from tests.proofs.test_certify import branch, van_der_pol

x, y, z, c = sp.symbols("x y z c")


@pytest.fixture(scope="module")
def proof(tmp_path_factory: pytest.TempPathFactory) -> dict:
    found = certify(van_der_pol(), region={"x": (-0.6, 1.2)})
    return written(found, tmp_path_factory.mktemp("proof") / "proof.json")


def rejected(text: str, path: Path) -> str:
    path.write_text(text, encoding="utf-8")
    with pytest.raises(Rejected) as caught:
        verify(path)
    return str(caught.value)


def pieces(proof: dict) -> list[dict]:
    return [node for node in proof["tree"] if "axis" not in node]


def cuts(proof: dict) -> list[dict]:
    return [node for node in proof["tree"] if "axis" in node]


def of_piece(i: int, key: str, change: Callable) -> Callable[[dict], None]:
    def mutate(proof: dict) -> None:
        pieces(proof)[i][key] = change(pieces(proof)[i][key])

    return mutate


def of_cut(i: int, change: Callable[[dict], object]) -> Callable[[dict], None]:
    return lambda proof: change(cuts(proof)[i])


def each(change: Callable[[float], float]) -> Callable[[list[str]], list[str]]:
    return lambda row: [number(text, change) for text in row]


def digit(row: list[str]) -> list[str]:
    """The first hexadecimal digit behind the point is another one."""
    return [
        t[: t.index(".") + 1] + ("7" if t[t.index(".") + 1] != "7" else "2") + t[t.index(".") + 2 :]
        for t in row
    ]


MUTATIONS: dict[str, Callable[[dict], object]] = {
    "another sign in the field": changed(["equations", 0], lambda t: t.replace("+ z1", "- z1")),
    "another coefficient": changed(["equations", 0], lambda t: t.replace("/3", "/2")),
    "another field": changed(["equations", 0], "z0 - z1"),
    "a field with a pole": changed(["equations", 0], lambda t: t + " + 1/(z1 - z1)"),
    "code as a field": changed(["equations", 0], "__import__('os').getcwd()"),
    "a gap claimed larger": changed(["claim", "gap"], lambda t: number(t, lambda v: v * 1.001)),
    "a gap that is no number": changed(["claim", "gap"], "nan"),
    "an infinite gap": changed(["claim", "gap"], "inf"),
    "a gap as a JSON number": changed(["claim", "gap"], 0.1),
    "unstable for stable": changed(["claim"], lambda claim: {**claim, "stable": 0, "unstable": 1}),
    "a truth value as a count": changed(["claim", "stable"], True),
    "a wider region": changed(["region", 0], lambda side: [number(side[0], lambda v: v - 1e-3), side[1]]),
    "a region a little wider": changed(["region", 0], lambda side: [side[0], number(side[1], lambda v: v + 1e-15)]),
    "a region across the fold": changed(["region", 0], lambda side: [(-1.0).hex(), side[1]]),
    "a reversed region": changed(["region", 0], lambda side: side[::-1]),
    "no region": changed(["region"], []),
    "a point on another sheet": changed(["through", 1], (-1.7).hex()),
    "a box moved": of_piece(0, "box", each(lambda v: v + 1e-9)),
    "a middle outside its box": of_piece(0, "middle", each(lambda v: v + 10.0)),
    "a centre moved": of_piece(0, "centre", each(lambda v: v + 0.5)),
    "a centre on another sheet": of_piece(0, "centre", each(lambda v: -v)),
    "a digit of a centre": of_piece(0, "centre", digit),
    "a slope of another sign": of_piece(0, "slope", each(lambda v: -5.0 - v)),
    "a radius smaller": of_piece(0, "radius", each(lambda v: v * 1e-6)),
    "a radius much larger": of_piece(0, "radius", each(lambda v: v * 1e4)),
    "a negative radius": of_piece(0, "radius", each(lambda v: -v)),
    "a radius of zero": of_piece(0, "radius", each(lambda v: 0.0)),
    "an inverse of another sign": of_piece(0, "inverse", each(lambda v: -v)),
    "a basis that is none": of_piece(0, "basis", each(lambda v: 0.0)),
    "another sign": of_piece(0, "signs", lambda signs: [-s for s in signs]),
    "a sign that is none": of_piece(0, "signs", lambda signs: [0]),
    "too many signs": of_piece(0, "signs", lambda signs: signs * 2),
    "a number that is text": of_piece(0, "centre", lambda row: ["one"]),
    "a very long number": of_piece(0, "centre", lambda row: ["0x1." + "0" * 1000 + "p0"]),
    "a number too large": of_piece(0, "centre", lambda row: ["0x1p99999"]),
    "a glue missing": of_cut(0, lambda cut: cut.pop("glue")),
    "a glue on another sheet": of_cut(0, lambda cut: cut["glue"].update(centre=[(-1.9).hex()])),
    "a glue too wide": of_cut(0, lambda cut: cut["glue"].update(radius=["0x1p+2"])),
    "a cut moved": of_cut(0, lambda cut: cut.update(at=number(cut["at"], lambda v: v + 1e-9))),
    "a cut outside": of_cut(0, lambda cut: cut.update(at=(9.0).hex())),
    "a cut along no axis": of_cut(0, lambda cut: cut.update(axis=1)),
    "a negative axis": of_cut(0, lambda cut: cut.update(axis=-1)),
    "an axis that is no number": of_cut(0, lambda cut: cut.update(axis="0")),
    "names that are no list": changed(["names"], "xy"),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTATIONS)
def test_a_changed_proof_is_rejected(name: str, proof: dict, tmp_path: Path) -> None:
    mutant = copy.deepcopy(proof)
    MUTATIONS[name](mutant)
    assert json.dumps(mutant) != json.dumps(proof)
    assert rejected(json.dumps(mutant), tmp_path / "proof.json")


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "null",
        '{"format": 1}',
        "[" * 100_000,
        '{"format": "gsp normal hyperbolicity 1"}',
        '{"format": "gsp normal hyperbolicity 1", "names": ["x", "y"], "over": 1e999}',
        '{"format": "gsp normal hyperbolicity 1", "names": ["x", "y"], "over": NaN}',
        '{"format": "gsp normal hyperbolicity 1", "names": ["x", "y"], "over": ' + "9" * 10_000 + "}",
    ],
)
def test_a_file_that_is_no_proof_is_rejected(text: str, tmp_path: Path) -> None:
    assert rejected(text, tmp_path / "proof.json")


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        ("(" * 5000 + "z0" + ")" * 5000, "nested"),
        ("2**" * 5000 + "z0", "nested"),
        ("9" * 5000, "digits"),
        ("z1**99999", "exponent"),
        ("((((z1 + 1000)**999)**999)**999)**999", "too large"),
        ("z1" + " " * 300_000, "characters"),
        ("exp(exp(exp(exp(z1 + 9))))", "large"),
        ("z\u00b2", "unknown sign"),
        ("sin z0", "brackets"),
    ],
)
def test_huge_expressions_are_refused_by_name(expression: str, words: str, proof: dict, tmp_path: Path) -> None:
    mutant = copy.deepcopy(proof)
    mutant["equations"] = [expression]
    assert words in rejected(json.dumps(mutant), tmp_path / "proof.json")


def test_what_was_proved_is_accepted_and_a_lesser_claim_too(proof: dict, tmp_path: Path) -> None:
    path = tmp_path / "proof.json"
    path.write_text(json.dumps(proof), encoding="utf-8")
    found = verify(path)
    assert (found.stable, found.unstable) == (1, 0)
    assert found.gap > 0.5
    assert found.boxes == len(pieces(proof))
    proof = copy.deepcopy(proof)
    proof["claim"]["gap"] = (0.25).hex()
    path.write_text(json.dumps(proof), encoding="utf-8")
    assert verify(path).gap == 0.25


@pytest.mark.parametrize(
    "rate",
    [
        2 + sp.sin(x) + sp.cos(3 * x) / 2,
        1 + sp.tan(x / 2) ** 2,
        sp.pi + sp.atan(x) + sp.tanh(x),
        sp.E + sp.exp(-x) + sp.log(3 + x),
        sp.sqrt(2 + x) + sp.cosh(x) - sp.sinh(x) / 3,
        (2 + x) ** (1 + x / 4),
        (x + 2) ** sp.Rational(-2, 3),
    ],
)
def test_every_function_that_is_proved_is_checked(rate: sp.Expr, tmp_path: Path) -> None:
    path = tmp_path / "proof.json"
    certify(branch({y: x - rate * y}), region={"x": (-1, 1)}).save(path)
    found = verify(path)
    assert found.stable == 1
    values = [float(rate.subs(x, sp.Rational(k, 50)).evalf()) for k in range(-50, 51)]
    assert 0.3 * min(values) < found.gap <= min(values)


def test_two_fast_variables_are_checked(tmp_path: Path) -> None:
    path = tmp_path / "proof.json"
    certify(branch({y: -y + 2 * z + x, z: -2 * y - z}), region={"x": (-1, 1)}).save(path)
    found = verify(path)
    assert (found.stable, found.unstable) == (2, 0)
    assert 0.99 < found.gap <= 1.0


@pytest.mark.parametrize("name", SCENES)
def test_the_proof_of_every_built_in_scene_is_accepted(name: str, tmp_path: Path) -> None:
    from gsp.scenes.study import study_of

    study = study_of(gsp.models.load(name))
    found = certify(study.branch, region=study.region, epsilon=study.scene.epsilon)
    assert found.rate_ratio >= 1.0
    assert found.tried < 50
    found.save(tmp_path / "proof.json")
    checked = verify(tmp_path / "proof.json")
    assert (checked.stable, checked.unstable) == (found.stable, found.unstable)
    assert 0.49 * found.gap < checked.gap <= found.gap


def test_only_proofs_are_saved_and_only_to_files(tmp_path: Path) -> None:
    refuted = certify(van_der_pol(), region={"x": (-1, 1)})
    with pytest.raises(GspError, match="only a proof"):
        refuted.save(tmp_path / "proof.json")
    with pytest.raises(OutputError):
        certify(van_der_pol(), region={"x": (0, 1)}).save(tmp_path / "none" / "proof.json")
    assert not list(tmp_path.iterdir())


def test_no_file_is_written_that_is_too_large_to_verify(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = certify(van_der_pol(), region={"x": (-0.6, 1.2)})
    found.save(tmp_path / "proof.json")
    size = (tmp_path / "proof.json").stat().st_size
    monkeypatch.setattr(untrusted, "MOST_BYTES", size)
    found.save(tmp_path / "again.json")
    verify(tmp_path / "again.json")
    monkeypatch.setattr(untrusted, "MOST_BYTES", size - 1)
    with pytest.raises(GspError, match="bytes"):
        found.save(tmp_path / "large.json")
    assert not (tmp_path / "large.json").exists()


@pytest.mark.exhaustive
def test_a_box_of_two_fast_variables_is_checked_by_few_operations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # A proof of some hundred boxes: what each costs, its glue included, in products of intervals.
    found_branch = branch(
        {y: -y + x**2 + y * z / 4 - 3 * z / 2, z: z - x * c + y**2 / 4 - y / 4},
        slow={x: -x, c: -c},
        through={"x": 0, "c": 0, "y": 0, "z": 0},
    )
    path = tmp_path / "proof.json"
    certify(found_branch, region={"x": (-1, 1), "c": (-1, 1)}).save(path)
    calls = counted_products(monkeypatch)
    found = verify(path)
    assert found.boxes > 100
    assert (found.stable, found.unstable) == (1, 1)
    # 135; it was half as many again when every derivative was taken for every box and every glue.
    assert calls[0] < 145 * found.boxes


def test_the_checker_loads_nothing_of_the_prover() -> None:
    code = (
        "import sys, gsp.proofs.verification;"
        "own = {'band_checker', 'checked_cycle', 'checked_passage', 'checked_tube', 'checker', 'circuit_checker',"
        " 'cycle_checker', 'file_variables', 'passage_checker', 'second_derivatives', 'interval_matrices', 'intervals',"
        " 'programs', 'quotients', 'rational_functions', 'tube_checker', 'untrusted', 'verification'};"
        "found = {name.split('.')[2] for name in sys.modules if name.startswith('gsp.proofs.')};"
        "assert found == own, found ^ own;"
        "assert not {'flint', 'numpy', 'sympy'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.exhaustive
def test_what_the_checker_refuses_is_told_with_its_place_its_reason_and_the_remedy(tmp_path: Path) -> None:
    # States of 1e-56, near what the checker rounds to.
    small = branch({y: x - y - 10**56 * y**2}, through={"x": 1e-57, "y": 1e-57})
    found = certify(small, region={"x": (0, 1e-56)})
    assert found.verdict is gsp.ProofVerdict.PROVED
    with pytest.raises(GspError) as caught:
        found.save(tmp_path / "proof.json")
    told = str(caught.value)
    assert "over x in [0, 9.765625e-60], it says: Krawczyk's condition fails" in told
    assert "larger units" in told
    assert "2^-192" in told
