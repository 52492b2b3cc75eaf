"""python -m tests.sweeps.kills [--count N] [--seed N] [--way WAY]: SIGKILL at random moments, then compare every byte.

`processes`: the client of a pool of two, or one of its workers. `cluster`: the client of a Dask cluster, one of its
workers or its scheduler. `files`: one of two processes that share nothing but the folder. `hosts`: the same, each on a
host of its own by name and table of processes, so that it sees of the other only what the folder tells (as root).
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path

from tests.sweeps.work import contents

WAYS = ("processes", "cluster", "files", "hosts")
POINTS, CHUNK = 1600, 16
"""Of a sweep that is long beside the start of a process: many kills find it at work."""
CLIENT = """
import os, socket, sys
from gsp.sweeps.sweep import sweep
from tests.sweeps.work import slow_wave
if __name__ == "__main__":
    way, into, points, chunk = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
    if way == "hosts":
        socket.sethostname("node" + os.urandom(4).hex())
    call = dict(over={"x": [0.01 * i for i in range(points // 2)], "k": (1.0, 2.0)}, into=into, points_per_chunk=chunk)
    if way == "cluster":
        from distributed import Client, LocalCluster
        with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster:
            with Client(cluster) as client:
                sweep(slow_wave, client=client, **call)
    else:
        sweep(slow_wave, workers=2 if way == "processes" else 1, **call)
"""


def start(way: str, into: Path, points: int) -> subprocess.Popen:
    """A client in a process group of its own."""
    # A new name and a new table of processes, in which the client is the first.
    apart = ["unshare", "--uts", "--pid", "--fork", "--kill-child", "--mount-proc"] if way == "hosts" else []
    return subprocess.Popen(
        [*apart, sys.executable, "-c", CLIENT, way, str(into), str(points), str(CHUNK)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
    )  # fmt: skip


def family(process: int) -> list[int]:
    """A process and those that it started, as far as they live."""
    found = [process]
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(path.read_text().rpartition(")")[2].split()[1])
        except (OSError, IndexError, ValueError):
            continue
        if parent == process:
            found += family(int(path.parent.name))
    return found


def progress(into: Path) -> int:
    """Chunks that are done."""
    # `os.walk` passes over a folder that another process renames meanwhile; `Path.glob` raises.
    ledgers = [
        file for data in into.glob("data-*") for _, _, files in os.walk(data / "ledger") for file in files
    ]
    return sum(file.endswith(".json") for file in ledgers)


def finish(way: str, into: Path, points: int = POINTS) -> None:
    """Run until it is done, undisturbed."""
    client = start(way, into, points)
    try:
        assert client.wait(timeout=600) == 0
    finally:
        end(client)


def end(client: subprocess.Popen) -> None:
    """Kill a client and all that it started."""
    for process in reversed(family(client.pid)):
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
    client.wait()


def kill_some(
    clients: list[subprocess.Popen],
    way: str,
    into: Path,
    points: int,
    done: int,
    kills: int,
    dice: random.Random,
) -> int:
    """Kill, from `done` up to `kills` in all, at a random number of chunks done, as long as there is something to do,
    and put a new client in the place of each; how many are killed then."""
    chunks = points // CHUNK
    while done < kills:
        wanted = progress(into) + dice.randint(0, chunks // 5)
        while progress(into) < min(wanted, chunks) and any(c.poll() is None for c in clients):
            time.sleep(0.002)
        time.sleep(0.05 * dice.random())
        living = [c for c in clients if c.poll() is None]
        if not living or progress(into) == chunks:
            break
        victim = dice.choice(living)
        # Half of the time the client itself, which takes its workers along.
        process = victim.pid if dice.random() < 0.5 else dice.choice(family(victim.pid))
        try:
            os.kill(process, signal.SIGKILL)
        except ProcessLookupError:
            continue
        done += 1
        if process == victim.pid:
            victim.wait()
            clients.remove(victim)
            clients.append(start(way, into, points))
    return done


def disturb(
    scratch: Path, *, way: str, kills: int, seed: int, calm: Path, points: int = POINTS
) -> tuple[int, list[str]]:
    """Kill `kills` processes of sweeps at random moments; how many it were, and the files that differ in the end from
    those of `calm`, an undisturbed sweep of as many points."""
    dice = random.Random(seed)
    done, wrong, round_ = 0, [], 0
    while done < kills:
        into = scratch / f"disturbed-{round_}"
        round_ += 1
        clients = [start(way, into, points) for _ in range(2 if way in ("files", "hosts") else 1)]
        try:
            done = kill_some(clients, way, into, points, done, kills, dice)
            for client in clients:
                try:
                    client.wait(timeout=600)
                except subprocess.TimeoutExpired:
                    wrong.append(f"{into.name}: no end")
        finally:
            for client in clients:
                end(client)
        finish("files", into, points)
        found, expected = contents(into), contents(calm)
        differing = [name for name in found.keys() | expected.keys() if found.get(name) != expected.get(name)]
        wrong += [f"{into.name}/{name}" for name in sorted(differing)]
    return done, wrong


def main() -> int:
    """Ends with 1 when a byte differs."""
    parser = argparse.ArgumentParser(prog="python -m tests.sweeps.kills")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--way", choices=WAYS)
    options = parser.parse_args()
    bad = 0
    for way in WAYS[:3] if options.way is None else (options.way,):
        with tempfile.TemporaryDirectory() as scratch:
            begun = time.monotonic()
            calm = Path(scratch) / "calm"
            finish("files", calm)
            kills, wrong = disturb(Path(scratch), way=way, kills=options.count, seed=options.seed, calm=calm)
            print(
                f"{way}: {kills} kills, {len(wrong)} files differ, {time.monotonic() - begun:.0f} s",
                *wrong[:10],
            )
            bad += len(wrong)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
