"""What tests of several files use."""

from __future__ import annotations

import gc
import os
import signal
from collections.abc import Generator, Iterator

import pytest

from tests.demos.browser import Page, windows

# A session of so many tests asks for every kernel.
MANY = 2000


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Load everything, and compile, without a look for cycles: what is loaded stays, and is more with every file."""
    gc.disable()
    try:
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
