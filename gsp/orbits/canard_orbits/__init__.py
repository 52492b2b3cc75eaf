"""Canards of folded nodes: sheets of orbit segments up to a section, and the orbits that lie on both."""

from __future__ import annotations

from gsp.orbits.canard_orbits.canard import Canard, CanardKind
from gsp.orbits.canard_orbits.folded_canards import CanardOrbitError, CanardOrbits, folded_canards
from gsp.orbits.canard_orbits.following import CanardFamily, FamilyEnd, follow_canard
from gsp.orbits.canard_orbits.sheet import Sheet, SheetEnd

__all__ = [
    "Canard",
    "CanardFamily",
    "CanardKind",
    "CanardOrbitError",
    "CanardOrbits",
    "FamilyEnd",
    "Sheet",
    "SheetEnd",
    "folded_canards",
    "follow_canard",
]
