"""Analyses of built-in scenes that tests of several files look at."""

from __future__ import annotations

from functools import lru_cache

from gsp import analyse, models
from gsp.analysis.analysis import Analysis


# As many as the default run asks for. `pytest -m exhaustive` goes through all scenes.
@lru_cache(maxsize=8)
def analysis_of(name: str) -> Analysis:
    """The scene `name`, analysed once in a process by whichever test asks first; it is frozen, and so is its study."""
    return analyse(models.load(name))
