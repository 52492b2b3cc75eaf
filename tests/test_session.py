"""How the tests are run: one file in one process, whatever plugins are there."""

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]


@pytest.mark.exhaustive
@pytest.mark.parametrize("debugger", [(), ("--pdb",)])
def test_one_file_runs_in_one_process_where_a_plugin_has_loaded_trio(debugger: tuple[str, ...]) -> None:
    # trio has a generator of its own, which hypothesis looks after, and without `-n 0` no process sees both.
    pytest.importorskip("trio")
    command = (
        "-m",
        "pytest",
        "-p",
        "trio",
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        *debugger,
        "tests/test_roots.py",
    )
    done = subprocess.run(
        [sys.executable, *command],
        cwd=ROOT,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_examples_are_the_same_on_every_run_and_are_not_timed() -> None:
    assert settings().derandomize
    assert settings().deadline is None
