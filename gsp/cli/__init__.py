"""The command line: `gsp models`, `gsp split`, `gsp expand`, `gsp check`, `gsp verify`, `gsp choose`, `gsp report`,
`gsp run`, `gsp compare`, `gsp demo`, `gsp export`, `gsp scales`, `gsp nest`, `gsp ramp`, `gsp average`.

Exit status 0 when all is well, 1 when `check` finds that normal hyperbolicity does not hold or `verify` that a
proof does not, 2 on bad input or when the output cannot be written, 3 when `check --prove` leaves it undecided, 70 on
a defect of gsp, 130 when interrupted, 141 when nobody reads the output any more. Heavy modules are imported by the
command that needs them, so that help is quick.
"""

# Nothing is imported here but within `main`, which answers Ctrl-C: a tenth of a second goes by with imports.
import os
import sys

__all__ = ["main"]


def main() -> None:
    """Run the command line and exit with its status."""
    # NumPy reads it when imported. Matrices are small here, and threads that wait for each other take ten times the
    # processor's time of one where other programs run.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        program = _complete()
    except KeyboardInterrupt:
        # While modules were imported.
        print("gsp: interrupted; nothing was written", file=sys.stderr)
        sys.exit(130)
    program.main()


def _complete():
    """The program with all its commands."""
    from gsp.cli import (  # noqa: F401
        averaging,
        checking,
        comparing,
        declaring,
        deriving,
        nesting,
        program,
        ramping,
        running,
        scaling,
        writing,
    )

    return program


def __getattr__(name: str):
    if name == "cli":
        return _complete().cli
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
