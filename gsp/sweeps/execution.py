"""The chunks of a sweep handed out: to this process, to others of this machine, or to the workers of a Dask cluster."""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

from gsp.errors import OutputError
from gsp.sweeps.plan import Plan
from gsp.sweeps.store import Store
from gsp.sweeps.tasks import Record
from gsp.sweeps.worker import compute_chunk, compute_point, fill, subject_of
from gsp.systems.arguments import shown

# Seconds between two looks at what other processes have done.
LOOK = 1.0
# A chunk that was at work whenever so many pools died is computed point by point, and a point that takes so many
# processes with it has died.
DEATHS = 3

Progress = Callable[[float], object]


def run_here(store: Store, progress: Progress | None) -> None:
    """Compute what is left, one chunk after the other, in this process."""
    root, data = str(store.folder.parent), store.folder.name
    _until_done(store, progress, lambda chunk: compute_chunk(root, data, chunk))


def run_in_processes(store: Store, workers: int, progress: Progress | None) -> None:
    """Compute what is left in `workers` processes of this machine; those that die are replaced."""

    with _pool(1) as first:
        try:
            first.submit(os.getpid).result()
        except BrokenProcessPool:
            raise OutputError(
                "processes for the work do not start.",
                'A script that asks for them keeps its own work below if __name__ == "__main__":; or give '
                "workers=1.",
            ) from None
    _hand_out(store, lambda: _pool(workers), 2 * workers, progress)


def run_on_cluster(store: Store, client: Any, progress: Progress | None) -> None:
    """Compute what is left on the workers of a Dask client, which see the same folder."""
    threads = max(1, sum(client.nthreads().values()))
    _hand_out(store, lambda: client.get_executor(pure=False, retries=DEATHS), 2 * threads, progress)


def _pool(workers: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(
        workers, mp_context=multiprocessing.get_context("spawn"), initializer=_begin_worker
    )


def _begin_worker() -> None:
    """Ctrl-C is the parent's to answer, and a worker ends with its parent, however that ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: Any) -> None:
    parent.join()
    os._exit(1)


def _until_done(store: Store, progress: Progress | None, attempt: Callable[[int], bool]) -> None:
    """Go through what is left until all is done; what others are at work on is looked at again."""
    tally = _Tally(store, progress)
    left = _left(store)
    while left:
        moved = False
        for chunk in left:
            mine = attempt(chunk)
            moved |= mine
            tally.tell(mine)
        left = _left(store)
        if left and not moved:
            time.sleep(LOOK)
    tally.tell(0, look=True)


def _left(store: Store) -> list[int]:
    done = store.ledger.done()
    return [chunk for chunk in range(store.plan.chunks) if chunk not in done]


class _Tally:
    """How far it is, for `progress`: the ledger is listed so seldom that it costs a hundredth, and counted between."""

    def __init__(self, store: Store, progress: Progress | None) -> None:
        self._store, self._progress = store, progress
        self._done, self._next = 0, -math.inf

    def tell(self, finished: int, *, look: bool = False) -> None:
        """Tell the share that is done, `finished` more than at the last time."""
        if self._progress is None:
            return
        begun = time.monotonic()
        if look or begun >= self._next:
            self._done = max(self._done, len(self._store.ledger.done()))
            now = time.monotonic()
            self._next = now + 100.0 * (now - begun)
        else:
            self._done = min(self._done + finished, self._store.plan.chunks)
        self._progress(self._done / self._store.plan.chunks)


def _hand_out(store: Store, begin: Callable[[], Executor], most: int, progress: Progress | None) -> None:
    """Keep `most` chunks at work in executors that `begin` makes, until all is done."""
    deaths: Counter[int] = Counter()
    tally = _Tally(store, progress)
    executor = begin()
    try:
        waiting = deque(_left(store))
        at_work: dict[Future, int] = {}
        while waiting or at_work:
            broken: list[int] = []
            while waiting and len(at_work) < most and not broken:
                chunk = waiting.popleft()
                if deaths[chunk] >= DEATHS:
                    _point_by_point(store, chunk)
                    continue
                try:
                    at_work[
                        executor.submit(compute_chunk, str(store.folder.parent), store.folder.name, chunk)
                    ] = chunk
                except BrokenProcessPool:
                    broken.append(chunk)
            finished, _ = wait(at_work, timeout=LOOK, return_when=FIRST_COMPLETED)
            busy, entered = [], 0
            for future in finished:
                chunk = at_work.pop(future)
                try:
                    if future.result():
                        entered += 1
                    else:
                        busy.append(chunk)
                except (BrokenProcessPool, CancelledError):
                    broken.append(chunk)
                except Exception as error:
                    if type(error).__name__ != "KilledWorker":
                        raise
                    broken.append(chunk)
            if broken:
                # Who brought the pool down is not known, so that all that were at work count.
                broken += at_work.values()
                at_work.clear()
                deaths.update(broken)
                executor.shutdown(wait=False, cancel_futures=True)
                executor = begin()
                waiting.extendleft(sorted(broken, reverse=True))
            tally.tell(entered)
            if not waiting and not at_work:
                # What others were at work on is theirs, unless they have ended.
                waiting = deque(_left(store))
                if waiting and busy:
                    time.sleep(LOOK)
    except BaseException:
        # What is at work ends its chunk first, a second at most as a rule.
        executor.shutdown(wait=True, cancel_futures=True)
        raise
    executor.shutdown()
    tally.tell(0, look=True)


def _point_by_point(store: Store, chunk: int) -> None:
    """Compute a chunk in a process that may die; the points that take it with them have died, the others have not."""
    with store.ledger.claimed(chunk) as mine:
        if not mine:
            return
        pools = [_pool(1)]

        def found(point: tuple[int, ...]) -> Record | str:
            for _ in range(DEATHS):
                try:
                    asked = (str(store.folder.parent), store.folder.name, store.plan.coordinates(point))
                    return pools[0].submit(_compute_apart, *asked).result()
                except BrokenProcessPool:
                    pools[0].shutdown(wait=False)
                    pools[0] = _pool(1)
            return f"the process that computed it died, {DEATHS} times"

        try:
            fill(store, chunk, found)
        finally:
            pools[0].shutdown(cancel_futures=True)


def _compute_apart(folder: str, data: str, coordinates: dict[str, float]) -> Record:
    plan: Plan = Store.open(Path(folder, data)).plan
    return compute_point(plan, subject_of(Path(folder), plan.model), coordinates)


def connect(address: str) -> Any:
    """A Dask client of the scheduler at `address`; raises `OutputError` where Dask is not installed or not there."""
    try:
        from distributed import Client  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise OutputError(
            "a cluster is reached by dask.distributed, which is not installed.",
            "Install it with pip install 'gsp-toolkit[dask]'.",
        ) from None
    try:
        return Client(address, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        raise OutputError(
            f"there is no Dask scheduler at {shown(address)} for client ({error}).",
            "Start one, or give its address.",
        ) from None
