"""What tests of several files use."""

from __future__ import annotations

import gc
import signal
from collections.abc import Iterator

import pytest

from tests.demos.browser import Page, windows


def pytest_collection_finish() -> None:
    """Leave what is loaded to itself: a pass over all of it costs as much as a test, and came after every few tests.

    What tests make is looked through less often too: expressions are many, and few of them lie in cycles.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 10, 10)


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
