"""Word of it when a kernel is compiled, and not read from numba's cache."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event


class _First(event.Listener):
    """Calls `tell` when the first compilation begins, and then never again."""

    def __init__(self, tell: Callable[[], object]) -> None:
        self.tell = tell
        self.was_said = False

    def on_start(self, event: event.Event) -> None:
        if not self.was_said:
            self.was_said = True
            self.tell()

    def on_end(self, event: event.Event) -> None:
        pass


@contextmanager
def told_when_compiling(tell: Callable[[], object]) -> Iterator[None]:
    """Call `tell()` once, when the first of the package's kernels is compiled inside the context."""
    with event.install_listener("numba:compile", _First(tell)):
        yield
