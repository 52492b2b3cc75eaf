"""Work in a child of this process, which has loaded the libraries already, with a bound on its CPU time."""

from __future__ import annotations

import os
import resource
from collections.abc import Callable


def in_child(work: Callable[[], int], seconds: int) -> tuple[int, float, int]:
    """How it ended: the status that `work` returns (70: it raised; negative: a signal), CPU seconds, peak memory."""
    child = os.fork()
    if child == 0:
        status = 70
        try:
            # One second more, so that the count of seconds says what happened and not the signal.
            resource.setrlimit(resource.RLIMIT_CPU, (seconds + 1, seconds + 2))
            status = work()
        finally:
            os._exit(status)
    _, raw, usage = os.wait4(child, 0)
    return os.waitstatus_to_exitcode(raw), usage.ru_utime + usage.ru_stime, usage.ru_maxrss * 1024
