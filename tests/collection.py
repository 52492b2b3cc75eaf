"""A folder of model files, each read, run and asked for its time scales, as a user of the command line would.

    OPENBLAS_NUM_THREADS=1 python -m tests.collection FOLDER [FOLDER ...] [--every 10] [--workers 2] [--only PART]

Collections of published models are, for instance, github.com/sys-bio/BiomodelsStore (SBML) and the examples of
github.com/Ermentrout/xppaut (.ode). A file is counted once, whatever its name. Each has a process of its own, which is
ended after a minute and may take a gigabyte. Seconds are those of a processor, so that what else runs does not count.
The table that is printed stands in docs/models.md; refusals are counted by their reason, and every traceback, every
file that takes too long or too much, is named.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib
import multiprocessing
import re
import resource
import signal
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path

from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import GspError
from gsp.readers.loading import FORMATS

SECONDS, BYTES = 60, 1 << 30
# Of the clock, for a process that waits for something.
PATIENCE = 1200.0
# What `gsp scales` may take of a published model.
SCALES_SECONDS = 5.0
STAGES = ("read", "run", "scales")


@dataclass
class Outcome:
    """What became of one file: seconds of each stage that it passed, and what ended it."""

    file: Path
    seconds: dict[str, float] = field(default_factory=dict)
    refused: tuple[str, str] | None = None
    fault: str = ""
    peak: int = 0


def examine(file: Path, answer: Connection) -> None:
    """Do the stages and tell of each; the process ends with it."""
    # Address space is more than memory: compiled code and libraries are mapped.
    resource.setrlimit(resource.RLIMIT_AS, (4 * BYTES, 4 * BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
    for stage in STAGES:
        begun = time.process_time()
        try:
            if stage == "read":
                gsp.load(file)
            elif stage in cli.commands:
                found = CliRunner().invoke(cli, [stage, str(file)])
                if found.exception is not None and not isinstance(found.exception, SystemExit):
                    raise found.exception
        except GspError as error:
            answer.send(("refused", stage, str(error)))
            # What cannot be run may have time scales.
            if stage == "read":
                break
        except BaseException:
            answer.send(("fault", stage, traceback.format_exc()))
        else:
            answer.send(("passed", stage, time.process_time() - begun))
    answer.send(("peak", "", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024))


def outcome_of(file: Path) -> Outcome:
    """What becomes of a file in a process of its own."""
    outcome = Outcome(file)
    own, other = multiprocessing.get_context("fork").Pipe()
    process = multiprocessing.get_context("fork").Process(target=examine, args=(file, other), daemon=True)
    process.start()
    other.close()
    try:
        while own.poll(PATIENCE):
            kind, stage, value = own.recv()
            if kind == "passed":
                outcome.seconds[stage] = value
            elif kind == "refused":
                outcome.refused = outcome.refused or (stage, value)
            elif kind == "fault":
                outcome.fault = f"{stage}: {value}"
            else:
                outcome.peak = value
                break
        else:
            outcome.fault = f"the process waits after {', '.join(outcome.seconds) or 'nothing'}"
    except EOFError:
        process.join()
        ended = f"over {SECONDS} s," if process.exitcode == -signal.SIGXCPU else "the process died"
        outcome.fault = f"{ended} after {', '.join(outcome.seconds) or 'nothing'}"
    if outcome.fault:
        process.kill()
    process.join()
    if outcome.peak > BYTES and not outcome.fault:
        outcome.fault = f"over 1 GB: {outcome.peak / BYTES:.2f}"
    return outcome


def reason_of(message: str, file: Path) -> str:
    """A message without the names and numbers of this file, cut to its fact."""
    text = message.removeprefix(f"{file.name}: ").splitlines()[0]
    text = re.sub(r"'[^']*'|\"[^\"]*\"", "...", text.split(". ")[0])
    text = re.sub(r"^(states|definitions|parameters|start|region|observables)\.\S+:", r"\1:", text)
    return re.sub(r"[-+]?\d[\d.]*(e[-+]?\d+)?", "n", text)[:110]


def files_in(folders: Iterable[Path], every: int, only: str) -> list[Path]:
    """Every one of so many different model files of the folders."""
    found: dict[str, Path] = {}
    for folder in folders:
        for path in sorted(folder.rglob("*")):
            if path.is_file() and path.suffix.lower() in FORMATS and only in str(path):
                found.setdefault(hashlib.sha256(path.read_bytes()).hexdigest(), path)
    return list(found.values())[::every]


def table(outcomes: list[Outcome]) -> str:
    """What became of them all, in lines."""
    read = [o for o in outcomes if "read" in o.seconds]
    scales = [o.seconds["scales"] for o in outcomes if "scales" in o.seconds]
    rows = [
        ("files", len(outcomes)),
        ("read", len(read)),
        ("run", sum("run" in o.seconds for o in outcomes)),
        ("scales", len(scales)),
        (f"scales in {SCALES_SECONDS:g} s", sum(s <= SCALES_SECONDS for s in scales)),
        ("tracebacks", sum("Traceback" in o.fault for o in outcomes)),
        (f"over {SECONDS} s", sum(o.fault.startswith(f"over {SECONDS} s") for o in outcomes)),
        ("over 1 GB, or died", sum(o.fault.startswith(("over 1", "the process")) for o in outcomes)),
    ]
    lines = [f"| {name} | {number} |" for name, number in rows]
    counted = Counter((o.refused[0], reason_of(o.refused[1], o.file)) for o in outcomes if o.refused)
    lines += [f"{number:5} {stage}: {reason}" for (stage, reason), number in counted.most_common()]
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--only", default="")
    asked = parser.parse_args()
    files = files_in(asked.folders, asked.every, asked.only)
    # Imported and compiled once, before the processes part.
    importlib.import_module("libsbml")
    for stage in STAGES[1:]:
        CliRunner().invoke(cli, [stage, "linear"])
    with ThreadPoolExecutor(asked.workers) as pool:
        outcomes = []
        for outcome in pool.map(outcome_of, files):
            outcomes.append(outcome)
            if outcome.fault:
                print(f"{outcome.file}: {outcome.fault}", flush=True)
            elif max(outcome.seconds.values(), default=0.0) > SCALES_SECONDS:
                print(f"{outcome.file}: slow {outcome.seconds}", flush=True)
    print(table(outcomes))
    return int(any(outcome.fault for outcome in outcomes))


if __name__ == "__main__":
    sys.exit(main())
