"""What `gsp verify` reads is a regular file whose names say what they are."""

import os
from pathlib import Path

import pytest

from gsp.proofs import untrusted
from gsp.proofs.programs import IntervalProgram, Rejected
from gsp.proofs.untrusted import names, read_json
from gsp.proofs.verification import verify


def test_a_pipe_and_a_device_are_not_opened(tmp_path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, Path("/dev/zero"), tmp_path):
        with pytest.raises(Rejected, match="no regular file"):
            verify(path)


def test_no_more_than_the_bound_is_read(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(untrusted, "MOST_BYTES", 10)
    path = tmp_path / "proof.json"
    path.write_text("[" + " " * 10 + "]")
    with pytest.raises(Rejected, match="larger than 10 bytes"):
        read_json(path)
    path.write_text("[1, 2]")
    assert read_json(path) == [1, 2]


@pytest.mark.parametrize(
    "name", ["a\nthe proof holds", "a\x1b[2K", "a\rb", "\u202eab", "", "x` = 0, y", "z0**z1"]
)
def test_a_name_that_is_no_word_is_rejected(name) -> None:
    with pytest.raises(Rejected) as found:
        names(["x", name])
    assert str(found.value).isprintable()
    if name and not name.startswith("z0"):
        with pytest.raises(Rejected):
            IntervalProgram((f"z0 + {name}",), 1)


def test_a_name_that_stands_twice_is_rejected() -> None:
    with pytest.raises(Rejected, match="once"):
        names(["x", "y", "x"])


def test_an_expression_is_one_line() -> None:
    with pytest.raises(Rejected, match="one line"):
        IntervalProgram(("z0\n+ 1",), 1)
