"""What tests of several files use."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from tests.demos.browser import Page, windows


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
