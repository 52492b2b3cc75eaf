"""One browser for all tests of pages."""

from collections.abc import Iterator

import pytest

from tests.demos.browser import Page, windows


@pytest.fixture(scope="session")
def page() -> Iterator[Page]:
    yield from windows()
