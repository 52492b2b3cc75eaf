"""Work on numbered items shared by threads, for compiled code that releases the interpreter's lock."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, SimpleQueue

import numpy as np

from gsp.systems.arguments import check_whole

# Items that a thread takes at once: enough that a call costs little (10 us against 0.6 ms of the sleigh's runs), and
# at the end ever fewer, a share of those left, so that the threads finish together.
LARGEST_CHUNK = 64

Work = Callable[[int, int, np.ndarray], object]
"""Work on the items low to high - 1 that leaves off once its last argument, `halt` (1,), is not 0."""


def share(
    worker: Callable[[], Work],
    count: int,
    *,
    threads: int,
    progress: Callable[[float], object] | None = None,
) -> bool:
    """Do the items 0 to `count` - 1, each once, in `threads` threads; False when Ctrl-C came before the end.

    `worker` is called once in each thread, where it may lay out scratch. The calling thread only waits, so that Ctrl-C
    is seen at once; it calls `progress` with the fraction done. What `worker` or `progress` raise ends the rest.
    """
    halt = np.zeros(1, dtype=np.int64)
    finished: SimpleQueue[int] = SimpleQueue()
    lock = threading.Lock()
    left_off = threading.Condition()
    begun = inside = 0

    def take() -> tuple[int, int]:
        nonlocal begun
        with lock:
            low = begun
            # One thread has none to finish together with.
            shares = 1 if threads == 1 else 4 * threads
            begun += min(count - low, max(1, min(LARGEST_CHUNK, (count - low) // shares)))
            return low, begun

    def run() -> None:
        nonlocal inside
        with left_off:
            inside += 1
        try:
            work = worker()
            low, high = take()
            while low < high and not halt[0]:
                work(low, high, halt)
                if progress is not None:
                    # Else the calling thread would wake for nothing.
                    finished.put(high - low)
                low, high = take()
        except BaseException:
            halt[0] = 1
            raise
        finally:
            finished.put(0)
            with left_off:
                inside -= 1
                left_off.notify_all()

    def stop() -> None:
        """End the work: who has begun is waited for, who begins later finds `halt`."""
        halt[0] = 1
        # The pool does not wait for a thread in whose start an interrupt came.
        with left_off:
            left_off.wait_for(lambda: inside == 0)

    futures = []
    with ThreadPoolExecutor(threads) as pool:
        try:
            futures += [pool.submit(run) for _ in range(threads)]
            done, left = 0, threads
            while left:
                try:
                    # Seconds between two looks for Ctrl-C, which on some systems does not end the wait for a
                    # thread.
                    new = finished.get(timeout=0.05)
                except Empty:
                    continue
                left -= new == 0
                done += new
                if new and progress is not None:
                    progress(done / count)
        except KeyboardInterrupt:
            stop()
            return False
        except BaseException:
            stop()
            raise
    for future in futures:
        future.result()
    return True


def check_threads(threads: int | None) -> int:
    """The number of threads, one for each core unless given; raises `DeclarationError` unless positive."""
    if threads is None:
        # The cores that this process may use, where the system tells.
        usable = getattr(os, "sched_getaffinity", None)
        return len(usable(0)) if usable else os.cpu_count() or 1
    return check_whole(threads, what="threads", least=1, be="an integer, 1 or more")
