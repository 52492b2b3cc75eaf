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
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

from gsp.errors import OutputError
from gsp.results.point_verbs import Record
from gsp.results.table import library
from gsp.sweeps.store import Store
from gsp.sweeps.worker import compute_chunk, compute_point, fill, subject_of
from gsp.systems.arguments import shown

# Seconds between two looks at what other processes have done.
LOOK = 1.0
# Seconds in which what is at work may end its chunk after Ctrl-C.
GRACE = 5.0
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

    _hand_out(store, lambda: Processes(workers), 2 * workers, progress)


def run_on_cluster(store: Store, client: Any, progress: Progress | None) -> None:
    """Compute what is left on the workers of a Dask client, which see the same folder."""
    threads = max(1, sum(client.nthreads().values()))
    _hand_out(store, lambda: client.get_executor(pure=False, retries=DEATHS), 2 * threads, progress)


def one_process() -> Apart:
    """A process of this machine; raises `OutputError` where none starts."""
    apart = Apart(lambda: Processes(1))
    try:
        apart.compute(os.getpid)
    except ProcessDied:
        apart.end()
        raise OutputError(
            "processes for the work do not start.",
            'A script that asks for them keeps its own work below if __name__ == "__main__":; or give workers=1.',
        ) from None
    return apart


def one_worker(client: Any) -> Apart:
    """A worker of a Dask client, whichever is free."""
    return Apart(lambda: client.get_executor(pure=False, retries=0))


class Processes(ProcessPoolExecutor):
    """`count` processes of this machine: Ctrl-C is their parent's to answer, and they end with it, however it ended."""

    def __init__(self, count: int) -> None:
        context = multiprocessing.get_context("spawn")
        self._numbers = context.SimpleQueue()
        super().__init__(count, mp_context=context, initializer=_begin_worker, initargs=(self._numbers,))

    def end(self) -> None:
        """End them in the middle of their work, which may go on for ever."""
        numbers = set()
        while not self._numbers.empty():
            numbers.add(self._numbers.get())
        for child in multiprocessing.active_children():
            if child.pid in numbers:
                child.terminate()
        self.shutdown(cancel_futures=True)


def _begin_worker(numbers: Any) -> None:
    numbers.put(os.getpid())
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
            has_moved = attempt(chunk)
            moved |= has_moved
            tally.tell(has_moved)
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
                except Exception as error:
                    if not _is_death(error):
                        raise
                    broken.append(chunk)
            if broken:
                # Who brought the pool down is not known, so that all that were at work count.
                broken += at_work.values()
                at_work.clear()
                deaths.update(broken)
                executor.shutdown(wait=False)
                executor = begin()
                waiting.extendleft(sorted(broken, reverse=True))
            tally.tell(entered)
            if not waiting and not at_work:
                # What others were at work on is theirs, unless they have ended.
                waiting = deque(_left(store))
                if waiting and busy:
                    time.sleep(LOOK)
    except BaseException:
        # What is at work ends its chunk first, a second as a rule, unless it takes many times that.
        for future in at_work:
            future.cancel()
        wait(at_work, timeout=GRACE)
        _end(executor)
        raise
    executor.shutdown()
    tally.tell(0, look=True)


def _point_by_point(store: Store, chunk: int) -> None:
    """Compute a chunk in a process that may die; the points that take it with them have died, the others have not."""
    with store.ledger.claimed(chunk) as has_moved:
        if not has_moved:
            return
        with Apart(lambda: Processes(1)) as apart:

            def found(point: tuple[int, ...]) -> Record | str:
                chunk_arguments = (str(store.folder.parent), store.folder.name, store.plan.coordinates(point))
                for _ in range(DEATHS):
                    try:
                        return apart.compute(_compute_apart, *chunk_arguments)
                    except ProcessDied:
                        continue
                return f"the process that computed it died, {DEATHS} times"

            fill(store, chunk, found)


def _compute_apart(folder: str, data: str, coordinates: dict[str, float]) -> Record:
    plan = Store.open(Path(folder, data)).plan
    return compute_point(plan, subject_of(Path(folder), plan.model), coordinates)


class ProcessDied(Exception):
    """The process that computed a point ended before it had."""


class Apart(AbstractContextManager):
    """One executor at a time that `begin` makes, each replaced when a call has taken its process with it."""

    def __init__(self, begin: Callable[[], Executor]) -> None:
        self._begin = begin
        self._executor = begin()

    def compute(self, function: Callable[..., Any], *arguments: object) -> Any:
        """What `function` gives there; raises what it raises, and `ProcessDied`."""
        try:
            return self._executor.submit(function, *arguments).result()
        except Exception as error:
            if not _is_death(error):
                raise
            self._executor.shutdown(wait=False)
            self._executor = self._begin()
            raise ProcessDied(f"the process that computed it died ({type(error).__name__})") from None

    def end(self) -> None:
        """End it, in the middle of its work after Ctrl-C."""
        _end(self._executor)

    def __exit__(self, *_: object) -> None:
        self.end()


def _end(executor: Executor) -> None:
    if isinstance(executor, Processes):
        executor.end()
    else:
        # The workers of a cluster are not ours to end.
        executor.shutdown(wait=False)


def _is_death(error: Exception) -> bool:
    """Whether a process or a worker of Dask, which need not be installed, has ended before its work."""
    return isinstance(error, (BrokenProcessPool, CancelledError)) or type(error).__name__ == "KilledWorker"


def connect(address: str) -> Any:
    """A Dask client of the scheduler at `address`; raises `OutputError` where Dask is not installed or not there."""
    distributed = library("distributed", "a cluster is reached by", extra="dask")
    try:
        return distributed.Client(address, timeout=10)
    except (OSError, ValueError, TypeError) as error:
        raise OutputError(
            f"there is no Dask scheduler at {shown(address)} for client ({error}).",
            "Start one, or give its address.",
        ) from None
