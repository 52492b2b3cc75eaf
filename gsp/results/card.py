"""Results in a notebook: a card with the mathematics, the words and the figure, made when a cell shows it."""

from __future__ import annotations


class Card:
    """Gives a value its card in notebooks; nothing is imported before one is shown."""

    __slots__ = ()

    def _repr_html_(self) -> str:
        from gsp.results.card_html import html

        return html(self)

    def _repr_latex_(self) -> str | None:
        from gsp.results.card_html import latex

        return latex(self)
