"""What commands tell while they run and when they are done, and what Ctrl-C has to know of them."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any

import click

from gsp.errors import GspError, printable
from gsp.results.lettering import in_unicode
from gsp.results.tabular import Tabular

NOTE = 160
"""Characters of a note on a foreign model."""
# What Ctrl-C has to know of a command: a check that it has not come yet, and the outputs that were written.
CHECK, WRITTEN = "gsp.check", "gsp.written"


@contextmanager
def compiling_told() -> Iterator[None]:
    """Say so, once, when kernels are compiled: on the first run on a machine, which takes half a minute longer."""
    from gsp.kernels.compiling import told_when_compiling

    def tell() -> None:
        with suppress(OSError):
            click.echo("gsp: compiling its numerics, once on this machine; later runs begin at once", err=True)

    with told_when_compiling(tell):
        yield


@contextmanager
def compiled_by_two() -> Iterator[None]:
    """Have a second process help when kernels that a report needs are compiled, where there is a core for it."""
    from gsp.integration.parallel import check_threads
    from gsp.kernels.ahead import compiled_ahead

    with compiled_ahead() if check_threads(None) > 1 else nullcontext():
        yield


def tell_notes(notes: Iterable[str]) -> None:
    """What a foreign model was taken for, on standard error, cut to a line each."""
    for note in notes:
        with suppress(OSError):
            click.echo(f"gsp: {printable(note if len(note) <= NOTE else note[: NOTE - 3] + '...')}", err=True)


def screenful() -> float:
    """Letters that the terminal shows at once; infinite where standard output is none and everything is wanted."""
    size = shutil.get_terminal_size()
    return size.columns * size.lines if sys.stdout.isatty() else float("inf")


@contextmanager
def progress_bar(description: str, *, left: bool = False) -> Iterator[Callable[..., None]]:
    """A bar as the package's own, which also sees that Ctrl-C has come."""
    from gsp.results import progress

    with progress.progress_bar(description, left=left) as bar:

        def show(share: float, stage: str = description) -> None:
            check_interrupt()
            bar(share, stage)

        yield show


def tell(text: object, *, err: bool = False) -> None:
    """Print words or formulas: with ε and x² on a terminal that has them, and plain to a file or a pipe."""
    shown = str(text)
    stream = sys.stderr if err else sys.stdout
    if stream.isatty():
        with suppress(LookupError, UnicodeEncodeError):
            lettered = in_unicode(shown)
            lettered.encode(stream.encoding or "ascii")
            shown = lettered
    click.echo(shown, err=err)


def print_json(value: object) -> None:
    click.echo(json.dumps(value, indent=2, allow_nan=False))


def give(found: Any, as_json: bool, **beside: object) -> None:
    """`found` in words, or as JSON with what stands `beside` it."""
    if as_json:
        print_json(beside | (found.as_json() if isinstance(found, Tabular) else found.as_dict()))
    else:
        tell(found)


def check_parent(path: Path) -> None:
    """Raises `GspError` where there is no folder for the file `path`."""
    folder = path.absolute().parent
    if not folder.is_dir():
        raise GspError(f"there is no folder {folder}.", "Make it, or give another path.")


def check_interrupt() -> None:
    context = click.get_current_context(silent=True)
    if context is not None and context.obj is not None:
        context.obj[CHECK]()


def wrote(path: Path) -> None:
    context = click.get_current_context(silent=True)
    if context is not None and context.obj is not None:
        context.obj[WRITTEN].append(path)
