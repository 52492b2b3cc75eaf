"""How the tests are run: one file in one process, whatever plugins are there."""

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from tests.conftest import pytest_collection_modifyitems

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


class Item:
    def __init__(self, nodeid: str) -> None:
        self.nodeid = nodeid


class Config:
    def __init__(self, share: str | None) -> None:
        self.share, self.hook, self.deselected = share, self, 0

    def getoption(self, name: str) -> str | None:
        return self.share

    def pytest_deselected(self, items: list) -> None:
        self.deselected = len(items)


def test_each_test_is_in_one_share_whatever_stands_beside_it() -> None:
    names = [f"tests/test_a.py::test_b[{i}]" for i in range(60)]
    shares = []
    for which in ("0/3", "1/3", "2/3"):
        config, items = Config(which), [Item(name) for name in names]
        pytest_collection_modifyitems(config, items)  # pyright: ignore[reportArgumentType]
        assert config.deselected == len(names) - len(items)
        shares.append([item.nodeid for item in items])
        fewer = [Item(name) for name in names[::2]]
        pytest_collection_modifyitems(Config(which), fewer)  # pyright: ignore[reportArgumentType]
        assert {item.nodeid for item in fewer} <= set(shares[-1])
    assert sorted(name for share in shares for name in share) == sorted(names)
    assert all(10 < len(share) < 30 for share in shares)
