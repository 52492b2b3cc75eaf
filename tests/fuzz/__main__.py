"""python -m tests.fuzz [--seed N] [--count N] [--seconds N] [--read-only]: ends with 1 when something was found."""

from __future__ import annotations

import argparse
import hashlib
import itertools
import signal
import sys
import tempfile
import time
import traceback
import warnings
from pathlib import Path

from gsp.errors import GspError
from tests.fuzz.inputs import inputs
from tests.fuzz.run import check, read

# Seconds of processor after which an input counts as unanswered: some take 7 on a fast machine that is quiet.
LIMIT = 60


class NoAnswer(BaseException):
    """An input took longer than `LIMIT`; no Exception, so that nothing on the way catches it."""


def stopped(number: int, frame: object) -> None:
    raise NoAnswer


def main() -> int:
    """Run the fuzzer; every finding is printed and its input kept in the folder that is named."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, help="inputs; endless by default")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--read-only", action="store_true", help="the reader alone")
    parser.add_argument("--keep", type=Path, help="folder for the inputs of findings")
    options = parser.parse_args()
    signal.signal(signal.SIGVTALRM, stopped)
    # What is not finite is an answer to look at; a user has no use for NumPy's word on it.
    warnings.simplefilter("error", RuntimeWarning)
    begun = time.monotonic()
    counts = {"read": 0, "refused": 0, "found": 0}
    seen: set[str] = set()
    with tempfile.TemporaryDirectory() as folder:
        for text in itertools.islice(inputs(options.seed), options.count):
            if time.monotonic() - begun > options.seconds:
                break
            try:
                signal.setitimer(signal.ITIMER_VIRTUAL, LIMIT)
                scene = read(text, Path(folder))
                if isinstance(scene, GspError):
                    counts["refused"] += 1
                    continue
                counts["read"] += 1
                if not options.read_only:
                    check(scene)
            except (Exception, NoAnswer) as error:
                counts["found"] += 1
                place = traceback.extract_tb(error.__traceback__)
                own = [f for f in place if "/gsp/" in f.filename] or list(place)
                what = f"{type(error).__name__}: {str(error)[:100]} at {Path(own[-1].filename).name}:{own[-1].lineno}"
                if what not in seen:
                    seen.add(what)
                    name = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:12]
                    print(f"{what}\n{text if options.keep is None else name}\n", flush=True)
                    if options.keep is not None:
                        options.keep.mkdir(parents=True, exist_ok=True)
                        (options.keep / f"{name}.toml").write_text(
                            text, encoding="utf-8", errors="surrogatepass"
                        )
            finally:
                signal.setitimer(signal.ITIMER_VIRTUAL, 0)
    print(
        ", ".join(f"{count} {what}" for what, count in counts.items()), f"in {time.monotonic() - begun:.0f} s"
    )
    return 1 if counts["found"] else 0


if __name__ == "__main__":
    sys.exit(main())
