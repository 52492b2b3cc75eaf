"""What tests of several files use."""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import signal
import sys
import zlib
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.demos.browser import Page, windows

# The same examples on every run, each for as long as it takes: anywhere as in CI. Loaded before collection ends, since
# hypothesis asks who refers to the generators of plugins, which what is left to itself no longer tells.
settings.load_profile("ci")

HERE = Path(__file__).parent
# A session of so many tests asks for every kernel.
MANY = 2000

# Bytecode is kept as kernels are; without it every process of the tests would compile all modules anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--share", metavar="K/N", help="run the K-th of N shares of the tests, as their names fall"
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep one share of the tests. What a test is called decides, so that another one beside it moves none."""
    share = config.getoption("--share")
    if share is None:
        return
    which, shares = map(int, share.split("/"))
    rest = [item for item in items if zlib.crc32(item.nodeid.encode()) % shares != which % shares]
    config.hook.pytest_deselected(items=rest)
    left_out = set(rest)
    items[:] = [item for item in items if item not in left_out]


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Load everything, and compile, without a look for cycles: what is loaded stays, and is more with every file."""
    gc.disable()
    try:
        if session.config.args == session.config.getini("testpaths"):
            load_together(os.environ.get("PYTEST_XDIST_WORKER", ""))
        return (yield)
    finally:
        gc.enable()


def pytest_collection_finish(session: pytest.Session) -> None:
    """Leave what is loaded to itself: a pass over all of it costs as much as a test, and came after every few tests.

    What tests make is looked through less often too: expressions are many, and few of them lie in cycles.
    """
    if len(session.items) > MANY:
        compile_together(os.environ.get("PYTEST_XDIST_WORKER", ""))
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)


def load_together(worker: str) -> None:
    """Have the second of two processes load the tests from the last file on: either rewrites asserts and compiles
    modules that the other then reads."""
    for path in sorted(HERE.rglob("test_*.py"), reverse=True) if worker == "gw1" else ():
        # What cannot be loaded here says so where it is collected.
        with contextlib.suppress(Exception, pytest.skip.Exception):
            importlib.import_module(".".join(path.relative_to(HERE.parent).with_suffix("").parts))


def compile_together(worker: str) -> None:
    """Have two processes compile the kernels from both ends, and not each of them all as their tests come to them."""
    if worker in ("gw0", "gw1"):
        from gsp.kernels import ahead

        for kernel, arguments in ahead.IN_ORDER if worker == "gw0" else reversed(ahead.IN_ORDER):
            kernel.compile(arguments)


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C raises here, also where the process was started with it ignored, as a script starts background work."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session")
def page() -> Iterator[Page]:
    """One browser window for all tests of pages."""
    yield from windows()
