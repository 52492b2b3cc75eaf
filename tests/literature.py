"""Systems from the literature through the command line, each verb in a process with bounds on CPU time and memory.

`python -m tests.literature` runs every file of tests/systems through every verb, or the named ones, prints a line for
each, and ends with status 1 when one of them neither gave a result nor refused with a reason. `--processes 2` runs two
at a time, and `--every 5` takes the first of the files by name and every fifth after it.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import re
import sys
import tempfile
import traceback
from dataclasses import dataclass
from pathlib import Path

from tests.children import in_child

FOLDER = Path(__file__).parent / "systems"
VERBS = ("check", "expand", "folds", "choose", "report")
SECONDS = 60
"""Of CPU time, for a verb on a system."""
MEMORY = 1536 * 2**20
"""Bytes resident at the peak, for a verb on a system."""


@dataclass(frozen=True)
class Ending:
    """How `verb` ended on `system`: exit `status` (negative: a signal), output, CPU `seconds` and peak `memory`."""

    system: str
    verb: str
    status: int
    output: str
    errors: str
    seconds: float
    memory: int

    @property
    def complaint(self) -> str:
        """What is wrong with this ending, empty when it is a result or a refusal with its reason."""
        if self.status < 0 or self.status not in (0, 1, 2, 3):
            return f"ended with status {self.status}"
        if "Traceback" in self.errors or "Traceback" in self.output:
            return "ended in a traceback"
        if self.status == 2 and not re.search(r"gsp: \S+ .{20,}", self.errors):
            return "refused without a reason"
        if self.status != 2 and not self.output.strip():
            return "printed nothing"
        if self.status in (1, 3) and self.verb != "check":
            return "failed without a refusal"
        if self.seconds > SECONDS:
            return f"took {self.seconds:.0f} s of CPU time"
        if self.memory > MEMORY:
            return f"took {self.memory / 2**20:.0f} MB"
        return ""

    def __str__(self) -> str:
        head = f"{self.verb:6} {self.system:24} {self.status:4d} {self.seconds:6.1f} s {self.memory / 2**20:6.0f} MB"
        lines = (self.errors if self.status == 2 or self.complaint else self.output).strip().splitlines()
        last = (lines[-1] if self.status == 2 or self.complaint else lines[0]) if lines else ""
        return f"{head}  {self.complaint + ': ' if self.complaint else ''}{last[:200]}"


def systems() -> list[str]:
    """Names of the files, sorted."""
    return sorted(path.stem for path in FOLDER.glob("*.toml"))


def run(system: str, verb: str, *options: str) -> Ending:
    """`gsp VERB SYSTEM` in a child of this process, which has loaded the libraries already."""
    import gsp.cli

    def work() -> int:
        try:
            with files[0].open("w") as output, files[1].open("w") as errors:
                os.dup2(output.fileno(), 1)
                os.dup2(errors.fileno(), 2)
                sys.argv = ["gsp", verb, str(FOLDER / f"{system}.toml"), *options]
                # pytest and notebooks put their own objects there, which know nothing of the descriptors.
                sys.stdout, sys.stderr = (os.fdopen(k, "w", buffering=1, closefd=False) for k in (1, 2))
                status = 70
                try:
                    gsp.cli.main()
                except SystemExit as end:
                    status = int(end.code or 0)
                sys.stdout.flush()
                sys.stderr.flush()
                return status
        except BaseException:
            files[1].write_text(files[1].read_text() + traceback.format_exc())
            raise

    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder) / name for name in ("output", "errors")]
        if verb == "report":
            options = (*options, "-o", str(Path(folder) / "report"))
        status, seconds, memory = in_child(work, SECONDS)
        said = (file.read_text(errors="replace") for file in files)
        return Ending(system, verb, status, *said, seconds, memory)


def _run(task: tuple[str, str]) -> Ending:
    return run(*task)


def tasks(words: list[str], every: int) -> list[tuple[str, str]]:
    """(system, verb) of every run that `words`, systems and verbs in any order, ask for: each verb on all systems."""
    verbs = [word for word in words if word in VERBS] or list(VERBS)
    names = [word for word in words if word not in VERBS] or systems()
    return [(name, verb) for verb in verbs for name in names[::every]]


def main(arguments: list[str]) -> int:
    """Run what `arguments` ask for; the number of complaints, at most 1."""
    parser = argparse.ArgumentParser(prog="python -m tests.literature")
    parser.add_argument("words", nargs="*", metavar="system or verb")
    parser.add_argument("--processes", type=int, default=1, help="runs at a time")
    parser.add_argument("--every", type=int, default=1, help="the first system by name and every N-th after it")
    options = parser.parse_args(arguments)
    if unknown := set(options.words) - {*VERBS, *systems()}:
        parser.error(f"no system and no verb: {', '.join(sorted(unknown))}")
    if min(options.processes, options.every) < 1:
        parser.error("--processes and --every are at least 1")

    import gsp.analysis.analysis
    import gsp.report  # noqa: F401  Loaded here, once, for all children.

    asked = tasks(options.words, options.every)
    wrong = 0
    # Forked and each with one thread, as the process is from which `run` forks; endings come in the order of the tasks.
    with multiprocessing.get_context("fork").Pool(options.processes) as pool:
        for ending in pool.imap(_run, asked):
            wrong += bool(ending.complaint)
            print(ending, flush=True)
    print(f"{len(asked)} systems, {wrong} with a complaint", flush=True)
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
