"""The ledger of a sweep: which chunks are done, with a checksum each, and who is at work on which.

A chunk is done once its entry stands in the ledger, which comes last and by renaming, so that a process may end at any
moment. A claim only spares two processes the same work: results do not depend on who computes them, and each file is
written whole. So a claim whose process has ended, or has not been heard of for `PATIENCE`, is taken over.
"""

from __future__ import annotations

import json
import os
import socket
import threading
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path

# Seconds between two signs of life, and after how many without one a claim is taken over.
HEARTBEAT = 5.0
PATIENCE = 60.0


@dataclass(frozen=True)
class Entry:
    """What the ledger says of a chunk: the checksum of its files, and why points of it failed, by their number."""

    checksum: str
    messages: Mapping[int, str]


def write_whole(path: Path, content: bytes) -> None:
    """Write `content` by renaming, so that a reader sees all of it or nothing."""
    built = path.with_name(f"{path.name}.{uuid.uuid4().hex}.partial")
    try:
        built.write_bytes(content)
        os.replace(built, path)
    except BaseException:
        built.unlink(missing_ok=True)
        raise


class Ledger:
    """The ledger in `folder`."""

    def __init__(self, folder: Path) -> None:
        self._entries = folder / "ledger"
        self._claims = folder / "claims"

    def create(self) -> None:
        """Make its folders where there are none."""
        self._entries.mkdir(exist_ok=True)
        self._claims.mkdir(exist_ok=True)

    def done(self) -> dict[int, int]:
        """The chunks that are done, each with the number of its points that failed."""
        found = {}
        for shelf in os.scandir(self._entries):
            for name in os.listdir(shelf.path):
                if name.endswith(".json"):
                    chunk, failed = name.removesuffix(".json").split("-")
                    found[int(chunk)] = int(failed)
        return found

    def entry(self, chunk: int) -> Entry | None:
        """What the ledger says of a chunk, None when it is not done."""
        path = self._find(chunk)
        if path is None:
            return None
        saved = json.loads(path.read_text(encoding="utf-8"))
        return Entry(saved["checksum"], {int(k): v for k, v in saved["messages"].items()})

    def enter(self, chunk: int, entry: Entry) -> None:
        """Enter a chunk as done."""
        shelf = self._shelf(chunk)
        shelf.mkdir(exist_ok=True)
        # The name tells how many failed, so that progress is a listing.
        saved = json.dumps({"checksum": entry.checksum, "messages": entry.messages}, indent=1)
        write_whole(shelf / f"{chunk:06d}-{len(entry.messages)}.json", saved.encode())

    def strike(self, chunk: int) -> None:
        """Take a chunk out, so that it is computed again."""
        path = self._find(chunk)
        if path is not None:
            path.unlink(missing_ok=True)

    @contextmanager
    def claimed(self, chunk: int) -> Iterator[bool]:
        """Whether the chunk is this process's to compute; signs of life are given meanwhile."""
        path = self._claims / f"{chunk:06d}"
        if not self._take(path):
            yield False
            return
        over = threading.Event()
        beat = threading.Thread(target=_signs_of_life, args=(path, over), daemon=True)
        beat.start()
        try:
            yield True
        finally:
            over.set()
            beat.join()
            path.unlink(missing_ok=True)

    def tidy(self) -> None:
        """Remove claims and what killed processes left half written, once every chunk is done."""
        for path in (*self._claims.iterdir(), *self._entries.glob("*/*.partial")):
            path.unlink(missing_ok=True)

    def _shelf(self, chunk: int) -> Path:
        return self._entries / f"{chunk // 1000:03d}"

    def _find(self, chunk: int) -> Path | None:
        return next(self._shelf(chunk).glob(f"{chunk:06d}-*.json"), None)

    def _take(self, path: Path) -> bool:
        owner = f"{this_host()} {os.getpid()}"
        try:
            with path.open("x") as file:
                file.write(owner)
            return True
        except FileExistsError:
            if not self._abandoned(path):
                return False
        # Two that take over the same claim at once both compute the chunk, which does no harm.
        write_whole(path, owner.encode())
        return True

    def _abandoned(self, path: Path) -> bool:
        try:
            host, _, process = path.read_text().partition(" ")
            heard = path.stat().st_mtime
        except FileNotFoundError:
            return True
        if is_gone(host, process):
            return True
        # The clock is that of the file system, which all hosts share.
        now = path.with_name(f"now.{uuid.uuid4().hex}.partial")
        now.touch()
        try:
            return now.stat().st_mtime - heard > PATIENCE
        finally:
            now.unlink(missing_ok=True)


@cache
def this_host() -> str:
    """This host by its name and, where the system tells, its process table: containers may share the one."""
    table = Path("/proc/self/ns/pid")
    return f"{socket.gethostname()}-{table.stat().st_ino}" if table.exists() else socket.gethostname()


def is_gone(host: str, process: str) -> bool:
    """Whether a process is known to have ended: it was on this host and is there no more."""
    if host != this_host() or not process.isdigit():
        return False
    try:
        os.kill(int(process), 0)
    except (ProcessLookupError, OverflowError):
        return True
    except OSError:
        pass
    return False


def _signs_of_life(path: Path, over: threading.Event) -> None:
    while not over.wait(HEARTBEAT):
        with suppress(OSError):
            os.utime(path)
