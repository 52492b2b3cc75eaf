"""What is written is whole or an error in one line, and holds no character that a terminal or a page would act on."""

from __future__ import annotations

import io
import os
import shlex
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from gsp import load
from gsp.cli import main
from gsp.cli import program as command
from gsp.errors import ModelFileError, OutputError, printable
from gsp.results.files import write_file, write_rows
from tests.analyses import analysis_of

MODEL = """
title = {title}
[slow]
x = "-x"
[fast]
y = "x - y"
[region]
x = [0, 2]
[start]
x = 1
y = 1
[scene]
span = [0, 1]
epsilon = 0.01
{more}
"""
FULL = Path("/dev/full")
full_disk = pytest.mark.skipif(not FULL.exists(), reason="no device that is always full")


def gsp(*arguments: str, **keywords) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "gsp.cli", *arguments],
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        **keywords,
    )


@full_disk
def test_a_full_disk_ends_with_one_line():
    with FULL.open("w") as full:
        done = gsp("models", stdout=full)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "cannot be written: No space left" in done.stderr


@pytest.mark.parametrize("arguments", [["models", "--json"], ["models"], ["demo"]])
def test_a_pipe_that_nobody_reads_ends_without_a_word(arguments):
    read, write = os.pipe()
    os.close(read)
    try:
        done = gsp(*arguments, stdout=write)
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (141, "")


@pytest.mark.parametrize("arguments", [["models"], ["split", "linear"]])
def test_closed_standard_output_ends_with_one_line(arguments):
    line = shlex.join([sys.executable, "-m", "gsp.cli", *arguments])
    done = subprocess.run(f"{line} >&-", shell=True, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "standard output is closed" in done.stderr


@pytest.mark.parametrize(("encoding", "shown"), [("latin-1", r"mod\u2603.toml"), ("utf-8", r"mod☃.toml")])
def test_a_path_of_any_letters_is_told(encoding: str, shown: str, tmp_path, monkeypatch):
    source = tmp_path / "mod☃.ode"
    source.write_text("x'=-x\n")
    monkeypatch.setattr(sys, "argv", ["gsp", "import", str(source)])
    monkeypatch.setattr(sys, "stdout", stream := io.TextIOWrapper(io.BytesIO(), encoding=encoding))
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 0
    assert shown in stream.buffer.getvalue().decode(encoding)


@full_disk
def test_a_full_disk_for_messages_too_leaves_the_status():
    with FULL.open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "gsp.cli", "models", "--nonsense"], stdout=full, stderr=full, check=False
        )
    assert done.returncode == 2


def test_a_file_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    target = tmp_path / "rows.csv"
    write_rows([{"a": 1, "b": "ä"}], target)
    assert target.read_bytes().splitlines() == [b"a,b", "1,ä".encode()]
    written = Path.write_bytes

    def half(path, content):
        written(path, content[: len(content) // 2])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", half)
    with pytest.raises(OutputError, match="No space left"):
        write_file(b"something longer", target)
    with pytest.raises(OutputError):
        write_file(b"something longer", tmp_path / "new.csv")
    assert target.read_bytes().splitlines() == [b"a,b", "1,ä".encode()]
    assert [path.name for path in tmp_path.iterdir()] == ["rows.csv"]


@full_disk
def test_a_full_device_is_an_output_error():
    with pytest.raises(OutputError, match="No space left"):
        write_rows([{"a": 1}], FULL)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("kind", "begin"), [("png", b"\x89PNG"), ("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_a_chart_is_written_as_its_ending_says(kind, begin, tmp_path):
    from gsp import charts

    found = analysis_of("linear").comparison
    first, second = (
        charts.save(charts.error_against_epsilon(found), tmp_path / f"{n}.{kind}").read_bytes() for n in "ab"
    )
    assert first.startswith(begin)
    assert first == second
    with pytest.raises(OutputError, match=r"\.png, \.pdf or \.svg. Got c\.jpeg"):
        charts.save(charts.error_against_epsilon(found), tmp_path / "c.jpeg")
    assert not (tmp_path / "c.jpeg").exists()


@pytest.mark.exhaustive
@pytest.mark.parametrize("key", ["\\u001b[31mred", "\\u0000", "\\u202eabc", "a\\u0007"])
def test_an_unknown_key_reaches_no_terminal(key, tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(MODEL.format(title='"x"', more=f'"{key}" = 1'))
    done = gsp("check", str(file), stdout=subprocess.DEVNULL)
    assert done.returncode == 2
    assert "is unknown" in done.stderr
    assert all(c == "\n" or c.isprintable() for c in done.stderr)


@pytest.mark.parametrize(
    "hidden", ["\\u0000", "\\u001b[2J", "\\u202e", "\\u2066", "\\u200f", "\\u0085", "\\u2028"]
)
def test_a_title_with_hidden_characters_is_refused(hidden, tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(MODEL.format(title=f'"a{hidden}b"', more=""))
    with pytest.raises(ModelFileError, match=r"hidden character U\+") as refused:
        load(file)
    assert all(c.isprintable() for c in str(refused.value))


def test_ordinary_words_of_any_language_stay(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(
        MODEL.format(title='"Lotka–Volterra: Räuber, 捕食者, می‌خواهم, e\\u0301"', more=""), encoding="utf-8"
    )
    assert load(file).title.startswith("Lotka–Volterra: Räuber, 捕食者")
    assert printable("two\nlines \x1b[0m \u202e") == "two\nlines \\x1b[0m \\u202e"


@pytest.mark.parametrize("tolerance", ["1e-300", "1e-20", "9e-12"])
def test_a_tolerance_that_no_run_could_be_found_to_miss_is_refused(tolerance, tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(MODEL.format(title='"x"', more=f"tolerance = {tolerance}"))
    with pytest.raises(ValueError, match="no run in double precision"):
        load(file)


def test_a_warning_is_one_line(capsys):
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = command._tell
        warnings.warn("two\nlines \x1b[0m", UserWarning, stacklevel=1)
    assert capsys.readouterr().err == "gsp: two lines \\x1b[0m\n"


def test_compilation_is_told_once():
    from numba import njit

    from gsp.kernels.compiling import told_when_compiling

    told: list[str] = []
    with told_when_compiling(lambda: told.append("compiling")):
        assert told == []
        for add in (1, 2):
            assert njit(lambda x, add=add: x + add)(1) == 1 + add
    assert told == ["compiling"]
    njit(lambda x: x)(1)
    assert told == ["compiling"]


@pytest.mark.exhaustive
@pytest.mark.parametrize("encoding", ["utf-8", "ascii"])
def test_a_terminal_shows_the_letters_that_it_has(encoding: str) -> None:
    """Through a pseudo-terminal, whose other end is read here; what goes to a pipe is plain."""
    import pty

    ours, theirs = pty.openpty()
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    arguments = [sys.executable, "-m", "gsp.cli", "split", "michaelis_menten"]
    done = subprocess.run(arguments, stdout=theirs, env=environment, check=False)
    os.close(theirs)
    shown = os.read(ours, 65536).decode()
    os.close(ours)
    assert done.returncode == 0
    assert ("ε c'" in shown, "κ" in shown) == (encoding == "utf-8",) * 2
    assert ("epsilon" in shown) == (encoding == "ascii")
    assert "epsilon c'" in gsp("split", "michaelis_menten", stdout=subprocess.PIPE).stdout
