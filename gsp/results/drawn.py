"""Results that can be drawn: `.plot()` gives the chart of a result, and nothing is imported before it is asked for."""

from __future__ import annotations

from typing import Any

from gsp.results.card import Card
from gsp.results.registry import draw


class Drawn(Card):
    """Gives a result its picture."""

    __slots__ = ()

    def plot(self, axes: Any = None, /) -> Any:
        """The chart of this result, on `axes` or on Axes of its own; returns the Axes."""
        return draw(self, axes)
