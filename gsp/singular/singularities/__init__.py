"""Where normal hyperbolicity ends: canard points of planar systems, and folded singularities."""

from __future__ import annotations

from gsp.singular.singularities.canard_matching import match_canard
from gsp.singular.singularities.canards import CanardValue, canard_value
from gsp.singular.singularities.folded import FoldedSingularity, folded_singularities, folded_singularity

__all__ = [
    "CanardValue",
    "FoldedSingularity",
    "canard_value",
    "folded_singularities",
    "folded_singularity",
    "match_canard",
]
