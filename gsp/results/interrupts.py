"""Ctrl-C: one whose exception was lost ends the command all the same, and none divides the writing of files."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def noticing() -> Iterator[Callable[[], None]]:
    """Gives a check that raises `KeyboardInterrupt` once Ctrl-C has come.

    Python drops an exception that is raised in a finalizer or a callback; what was asked for is asked for all the same.
    Where Ctrl-C is ignored, as under nohup, or handled by the caller, it stays so and the check does nothing.
    """
    came = False

    def note(number: int, frame: object) -> None:
        nonlocal came
        came = True
        raise KeyboardInterrupt

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    # Only the main thread may change handlers, and only there the exception is raised.
    main = threading.current_thread() is threading.main_thread()
    if not main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield check
        return
    signal.signal(signal.SIGINT, note)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ctrl-C is dropped meanwhile: for milliseconds in which what it would stop is being finished."""
    before = signal.getsignal(signal.SIGINT)
    # None is a handler that Python cannot put back.
    if threading.current_thread() is not threading.main_thread() or before is None:
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
