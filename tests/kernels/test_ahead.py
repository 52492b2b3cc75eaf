"""A second process compiles a report's kernels from the last to the first, and ends with the first process."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit, types

from gsp.kernels import ahead


@njit
def halved(x):
    return 0.5 * x


def run(text: str, cache: Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache)}
    return subprocess.run(
        [sys.executable, "-c", text],
        env=environment, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip


def test_a_process_is_begun_only_when_something_is_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "IN_ORDER", ())
    with ahead.compiled_ahead():
        assert multiprocessing.active_children() == []
        for kind in (types.float32, types.float64):
            halved.compile((kind,))
            assert len(multiprocessing.active_children()) == 1
    assert multiprocessing.active_children() == []


@pytest.mark.exhaustive
def test_the_second_process_ends_when_the_first_is_killed(tmp_path: Path) -> None:
    # It holds the pipe of the output, which is read to its end.
    found = run(
        "import os, signal\n"
        "from gsp.kernels.ahead import compiled_ahead\n"
        "if __name__ == '__main__':\n"
        "    import numba\n"
        "    with compiled_ahead():\n"
        "        numba.njit(lambda x: x)(1)\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n",
        tmp_path,
    )
    assert found.returncode < 0, found.stderr
    assert not list(tmp_path.rglob("*evaluate_many*.nbc"))


@pytest.mark.exhaustive
def test_what_is_compiled_ahead_is_what_a_report_compiles(tmp_path: Path) -> None:
    found = run("from gsp.kernels import ahead\nahead.compile_backwards()", tmp_path)
    assert found.returncode == 0, found.stderr
    kept = {path.name.partition("-")[0].rpartition(".")[2] for path in tmp_path.rglob("*.nbc")}
    assert {kernel.py_func.__name__ for kernel, _ in ahead.IN_ORDER} <= kept
    found = run(
        "from numba.core import event\n"
        "class Names(event.Listener):\n"
        "    def on_start(self, event): print('compiled', event.data['dispatcher'].py_func.__name__)\n"
        "    def on_end(self, event): pass\n"
        "event.register('numba:compile', Names())\n"
        "from gsp.cli import cli\n"
        f"cli(['report', 'chaplygin_sleigh', '--output', {str(tmp_path / 'report')!r}], standalone_mode=False)\n",
        tmp_path,
    )
    assert (tmp_path / "report" / "report.html").exists(), found.stderr
    assert [line for line in found.stdout.splitlines() if line.startswith("compiled")] == []
