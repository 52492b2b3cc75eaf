"""Charts of the nouns of this package."""

from __future__ import annotations

from gsp.analysis.analysis import Analysis
from gsp.results.registry import Makers, charts


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {Analysis: drawn.phase_portrait}
