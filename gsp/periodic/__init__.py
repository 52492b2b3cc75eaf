"""Periodic orbits of any flow: found, refined by collocation, continued in a parameter."""

from __future__ import annotations

from gsp.periodic.continuing import continue_orbits
from gsp.periodic.explosion import Explosion
from gsp.periodic.family import CycleKind, OrbitFamily, SpecialOrbit
from gsp.periodic.finding import periodic_orbit
from gsp.periodic.hopf import HopfPoint, hopf_points
from gsp.periodic.orbit import PeriodicOrbit
from gsp.periodic.settling import OrbitError
from gsp.periodic.shooting import Shot, shoot

__all__ = [
    "CycleKind",
    "Explosion",
    "HopfPoint",
    "OrbitError",
    "OrbitFamily",
    "PeriodicOrbit",
    "Shot",
    "SpecialOrbit",
    "continue_orbits",
    "hopf_points",
    "periodic_orbit",
    "shoot",
]
