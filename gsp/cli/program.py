"""The program `gsp`: its commands, and with which status it ends."""

from __future__ import annotations

import atexit
import gc
import io
import os
import sys
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from gsp import __version__
from gsp.cli.telling import CHECK, WRITTEN
from gsp.errors import GspError, OutputError, one_line, printable
from gsp.results.interrupts import noticing

# With this environment variable a defect shows its traceback, with Python's own status, 1.
DEBUG = "GSP_DEBUG"


class CommandGroup(click.Group):
    """The commands; output that cannot be written, to a full disk, is an error like any other.

    Where nobody reads it any more, as behind `| head`, they end without a word.
    """

    def invoke(self, ctx: click.Context) -> Any:
        try:
            if sys.stdout is None:
                raise OSError("standard output is closed")
            try:
                return super().invoke(ctx)
            finally:
                sys.stdout.flush()
        except OSError as error:
            # Errors of files have the file's name, and are told where the file is written.
            if error.filename is not None:
                raise
            if isinstance(error, BrokenPipeError):
                _stop_writing()
                # What a shell tells of a program that ends because nobody reads its output any more, 128 + SIGPIPE.
                raise SystemExit(141) from None
            raise OutputError(
                f"the output cannot be written: {error.strerror or error}.", "What was printed is not complete."
            ) from None


@click.group(
    cls=CommandGroup, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100}
)
@click.version_option(__version__, prog_name="gsp")
def cli() -> None:
    """Geometric singular perturbation: slow manifolds, their hyperbolicity, and reduced flows, measured.

    MODEL is the name of a built-in scene (see `gsp models`) or the path of a model file: TOML, or a
    foreign model, which is XPPAUT's .ode, SBML (.xml, .sbml) or Antimony (.ant).

    \b
    gsp report chaplygin_sleigh        the whole analysis, as a report to read
    gsp expand van_der_pol --order 5   the slow manifold as a series in epsilon
    gsp check my_model.toml            is it normally hyperbolic in its region?
    gsp choose my_model.toml           the cheapest model that meets its tolerance
    gsp demo van_der_pol               a page in which the model runs, to move and to show
    """


def _tell(message: Any, category: Any, filename: Any, lineno: Any, file: Any = None, line: Any = None) -> None:
    """A warning in one line."""
    with suppress(OSError):
        click.echo(f"gsp: {printable(one_line(message))}", err=True)


def _show(error: click.ClickException) -> None:
    """What Click shows of a wrong call, with names that the user gave made printable."""
    ctx = getattr(error, "ctx", None)
    if ctx is not None:
        click.echo(
            f"{ctx.get_usage()}\nTry '{ctx.command_path} {ctx.help_option_names[-1]}' for help.\n", err=True
        )
    click.echo(f"Error: {printable(one_line(error.format_message()))}", err=True)


def _stop_writing() -> None:
    """Let Python flush what is left of the output to nowhere, where there is nobody to read it."""
    if sys.stdout is None:
        return
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> None:
    """Run the command line and exit with its status."""
    warnings.showwarning = _tell
    if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
        # A path may hold what the terminal has no letters for, or bytes that are none.
        sys.stdout.reconfigure(errors="backslashreplace")
    # Objects made between two looks for cycles. A command makes expressions, which stay, and hardly a cycle:
    # with Python's 700 the looks take 0.8 of the 6 s of a report, with these 0.2 s.
    gc.set_threshold(100_000)
    # Python looks for cycles among all objects as it ends: a seventh of the time of a report.
    atexit.register(gc.freeze)
    written: list[Path] = []
    try:
        with noticing() as check:
            try:
                status = cli.main(standalone_mode=False, obj={CHECK: check, WRITTEN: written})
            except Exception:
                # An interrupt in compiled code can come out as an error of its own, such as that an import failed.
                check()
                raise
            check()
    except GspError as error:
        with suppress(OSError):
            click.echo(f"gsp: {printable(str(error))}", err=True)
        _stop_writing()
        sys.exit(2)
    except click.ClickException as error:
        with suppress(OSError):
            _show(error)
        _stop_writing()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        what = f"{written[0]} was written before" if written else "nothing was written"
        click.echo(f"gsp: interrupted; {what}", err=True)
        sys.exit(130)
    except Exception as error:
        if os.environ.get(DEBUG):
            raise
        click.echo(
            f"gsp: this is a defect of gsp, not of your model: {one_line(error)}. Run again with {DEBUG}=1 for the "
            "traceback, and report both.",
            err=True,
        )
        # EX_SOFTWARE of sysexits.h: no verdict of `check`, which has 1.
        sys.exit(70)
    sys.exit(status if isinstance(status, int) else 0)
