"""What a notebook shows of a value: its equations, what it prints, and its figure where it has one."""

from gsp.cards.card import html, latex

__all__ = ["html", "latex"]
