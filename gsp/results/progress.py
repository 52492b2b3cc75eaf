"""A bar for long work, where somebody would see it: in a terminal, in Jupyter, in marimo."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from html import escape

from gsp.errors import DeclarationError

# Seconds between two pictures of a bar in a notebook, each of which goes through its server.
REDRAW = 0.2


def progress_bar(description: str = "", *, left: bool = True) -> AbstractContextManager[Callable[..., None]]:
    """A bar on standard error or in the cell of a notebook, gone when the work is done.

    Gives what any `progress` argument takes: a function of the fraction done, which also takes the name of a stage.
    `left` shows the time left as well. Raises `DeclarationError` for a description that is no text.

    >>> with gsp.progress_bar("compare") as show:                                 # doctest: +SKIP
    ...     gsp.compare(gsp.models.load("chaplygin_sleigh"), progress=show)
    """
    from rich.console import Console

    if not isinstance(description, str):
        raise DeclarationError(
            "description is text.", got=f"a {type(description).__name__}", value=type(description).__name__
        )
    if not isinstance(left, bool):
        raise DeclarationError(
            "left is True or False.", got=f"a {type(left).__name__}", value=type(left).__name__
        )
    marimo = sys.modules.get("marimo")
    if marimo is not None and marimo.running_in_notebook():
        return _in_marimo(description, left)
    return _in_jupyter(description, left) if Console().is_jupyter else _in_terminal(description, left)


@contextmanager
def _in_terminal(description: str, left: bool) -> Iterator[Callable[..., None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description:>14}"), BarColumn(), TimeElapsedColumn())
    if left:
        columns = (*columns, TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(description, total=1.0)
        yield lambda share, stage=description: bar.update(task, completed=share, description=stage)


@contextmanager
def _in_jupyter(description: str, left: bool) -> Iterator[Callable[..., None]]:
    from IPython.display import HTML, display  # pyright: ignore[reportMissingImports]

    begun = time.monotonic()
    drawn = begun
    handle = display(HTML(_bar(0.0, description, "")), display_id=True)

    def show(share: float, stage: str = description) -> None:
        nonlocal drawn
        now = time.monotonic()
        if now - drawn >= REDRAW:
            drawn = now
            handle.update(HTML(_bar(share, stage, _remaining(now - begun, share) if left else "")))

    try:
        yield show
    finally:
        handle.update(HTML(""))


def _bar(share: float, stage: str, left: str) -> str:
    return f'<label>{escape(stage)} <progress max="1" value="{share:.4f}"></progress> {100 * share:.0f} %</label>{left}'


def _remaining(spent: float, share: float) -> str:
    # Before this share the time goes into imports and compilation, which tell nothing about the rest.
    if not 0.05 <= share <= 1.0:
        return ""
    seconds = round(spent * (1.0 - share) / share)
    return f", {seconds // 3600}:{seconds // 60 % 60:02d}:{seconds % 60:02d} left"


@contextmanager
def _in_marimo(description: str, left: bool) -> Iterator[Callable[..., None]]:
    import marimo  # pyright: ignore[reportMissingImports]

    parts = 100  # marimo prints both numbers: so many of a hundred
    with marimo.status.progress_bar(total=parts, title=description, remove_on_exit=True, show_eta=left) as bar:
        done = 0

        def show(share: float, stage: str = description) -> None:
            nonlocal done
            step = round(parts * share) - done
            if step > 0:
                done += step
                bar.update(step, title=stage)

        yield show
