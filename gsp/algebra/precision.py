"""The precision of ball arithmetic, which python-flint keeps once for the whole process."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock

import flint

_ALONE = RLock()


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """python-flint at `bits` bits for a while, in which no other thread sets it; then what it was."""
    with _ALONE:
        before = flint.ctx.prec
        flint.ctx.prec = bits
        try:
            yield
        finally:
            flint.ctx.prec = before


def _in_child() -> None:
    # The thread that held it is not in a process that was forked.
    global _ALONE
    _ALONE = RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_child)
