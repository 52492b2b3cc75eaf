"""What tests of several files use."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """The whole suite runs in two processes where pytest-xdist is there and nothing else was asked for.

    Not through `addopts`, whose `-n` is a usage error without pytest-xdist. Each process takes a row of neighbours, so
    that what a file makes once is mostly made once.
    """
    option = config.option
    if (
        config.pluginmanager.hasplugin("xdist")
        and config.args_source is pytest.Config.ArgsSource.TESTPATHS
        and option.numprocesses is None
        and option.dist == "no"
        and not option.usepdb
    ):
        option.numprocesses = 2
        option.dist = "worksteal"


@pytest.fixture
def interruptible() -> Iterator[None]:
    """Ctrl-C raises here, also where the process was started with it ignored, as a script starts background work."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)
