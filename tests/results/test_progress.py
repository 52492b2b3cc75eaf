"""A bar shows the share that is done where it runs, and goes when the work is over."""

from __future__ import annotations

import sys
import types
from contextlib import contextmanager

import pytest

from gsp.errors import DeclarationError
from gsp.results import progress


def test_a_terminal_sees_it_on_standard_error(capsys, monkeypatch):
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with progress.progress_bar("map") as show:
        show(0.25)
        show(1.0, "the end")
    captured = capsys.readouterr()
    assert captured.out == ""
    last = captured.err.rpartition("the end")[2]
    bar, _, after = last.partition("━" * 40)
    assert "━" not in bar + after
    assert after.endswith("\x1b[1A\x1b[2K")


def test_a_pipe_is_not_filled_with_control_characters(capsys, monkeypatch):
    monkeypatch.delenv("FORCE_COLOR", raising=False)
    with progress.progress_bar("map") as show:
        show(0.5)
    assert "\x1b" not in capsys.readouterr().err


@pytest.fixture
def jupyter(monkeypatch):
    """A stand-in for IPython's display: what a cell has shown, one after the other."""
    shown: list[str] = []
    handle = types.SimpleNamespace(update=lambda html: shown.append(html))

    def display(html: str, *, display_id: bool) -> object:
        assert display_id
        shown.append(html)
        return handle

    module = types.ModuleType("IPython.display")
    module.__dict__.update(HTML=str, display=display)
    monkeypatch.setitem(sys.modules, "IPython", types.ModuleType("IPython"))
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    monkeypatch.setattr("rich.console._is_jupyter", lambda: True)
    monkeypatch.setattr(progress, "REDRAW", 0.0)
    return shown


def test_a_notebook_shows_one_bar_and_clears_it(jupyter):
    with progress.progress_bar("map") as show:
        show(0.5, "<runs>")
    assert len(jupyter) == 3
    assert 'value="0.5000"' in jupyter[1]
    assert "&lt;runs&gt;" in jupyter[1]
    assert "left" in jupyter[1]
    assert jupyter[2] == ""


def test_no_time_is_told_before_there_is_one_to_go_by(jupyter):
    with progress.progress_bar("map") as show:
        show(0.02)
        show(0.06)
    assert ["left" in bar for bar in jupyter] == [False, False, True, False]


def test_a_notebook_is_cleared_after_an_error(jupyter):
    with pytest.raises(DeclarationError), progress.progress_bar("map"):
        raise DeclarationError("no")
    assert jupyter[-1] == ""


def test_marimo_counts_in_hundredths(monkeypatch):
    moves = []

    @contextmanager
    def bar(**told):
        assert told["total"] == 100
        yield types.SimpleNamespace(update=lambda step, title: moves.append((step, title)))

    module = types.ModuleType("marimo")
    module.__dict__.update(running_in_notebook=lambda: True, status=types.SimpleNamespace(progress_bar=bar))
    monkeypatch.setitem(sys.modules, "marimo", module)
    with progress.progress_bar("map") as show:
        show(0.25)
        show(0.25)
        show(1.0, "end")
    assert moves == [(25, "map"), (75, "end")]
