"""`gsp check --prove` and `gsp verify`: their exit statuses, as text and as JSON."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from gsp.cli import cli, main
from tests.proofs.test_tube_checker import proof


def run(*arguments: str):
    return CliRunner().invoke(cli, arguments)


def test_a_proof_is_written_and_verified_and_a_changed_one_is_not(tmp_path: Path) -> None:
    file = tmp_path / "proof.json"
    proved = run("check", "van_der_pol", "--prove", "-o", str(file), "--json")
    assert proved.exit_code == 0
    assert json.loads(proved.stdout)["verdict"] == "proved"
    held = run("verify", str(file))
    assert held.exit_code == 0
    assert "the proof holds" in held.stdout
    assert json.loads(run("verify", str(file), "--json").stdout)["stable"] == 1
    file.write_text(file.read_text(encoding="utf-8").replace("z1**3", "z1**5"), encoding="utf-8")
    broken = run("verify", str(file), "--json")
    assert broken.exit_code == 1
    assert json.loads(broken.stdout)["holds"] is False


def test_what_is_refuted_has_status_1_and_leaves_no_file(tmp_path: Path) -> None:
    file = tmp_path / "proof.json"
    refuted = run("check", "van_der_pol", "--prove", "--region", "y=-1:2", "-o", str(file))
    assert refuted.exit_code == 1
    assert "witness" in refuted.stdout
    assert not file.exists()


@pytest.mark.exhaustive
def test_what_is_undecided_has_status_3() -> None:
    slow = run("check", "fitzhugh_nagumo", "--prove", "--epsilon", "5", "--json")
    assert slow.exit_code == 3
    assert "r >= 1" in json.loads(slow.stdout)["reason"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("verify", "no_such_file.json"), "cannot be read"),
        (("check", "van_der_pol", "-o", "proof.json"), "--prove"),
    ],
)
def test_bad_input_has_status_2(arguments, words, monkeypatch, capsys) -> None:
    monkeypatch.setattr("sys.argv", ["gsp", *arguments])
    with pytest.raises(SystemExit) as caught:
        main()
    assert caught.value.code == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("name", ["x\nthe proof holds", "x\r\x1b[2Kthe proof holds", "y", "\u202ex"])
def test_a_name_forges_no_line_and_stands_once(name: str, tmp_path: Path) -> None:
    file = tmp_path / "proof.json"
    assert run("check", "van_der_pol", "--prove", "-o", str(file)).exit_code == 0
    box = json.loads(file.read_text(encoding="utf-8")) | {"names": [name, "y"]}
    for plain in (box, proof(slow=[name])):
        file.write_text(json.dumps(plain), encoding="utf-8")
        for more in ((), ("--json",)):
            refused = run("verify", str(file), *more)
            assert refused.exit_code == 1
            lines = refused.output.split("\n")
            assert all(line.isprintable() for line in lines)
            assert not any(line.startswith("the proof holds") for line in lines)
