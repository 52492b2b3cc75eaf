"""Results that can be drawn: `.plot()` gives the chart of a result, and nothing is imported before it is asked for."""

from __future__ import annotations

import importlib
from typing import Any

from gsp.results.card import Card


class Drawn(Card):
    """Gives a result its picture."""

    __slots__ = ()

    def plot(self, axes: Any = None, /) -> Any:
        """The chart of this result, on `axes` or on Axes of its own; returns the Axes."""
        return importlib.import_module("gsp.charts").draw(self, axes)
