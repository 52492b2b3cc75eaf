"""Periodic orbits of any flow: found, refined by collocation, continued in a parameter."""

from __future__ import annotations

from gsp.orbits.periodic.continuing import continue_orbits
from gsp.orbits.periodic.explosion import Explosion
from gsp.orbits.periodic.family import CycleKind, OrbitFamily, SpecialOrbit
from gsp.orbits.periodic.finding import periodic_orbit
from gsp.orbits.periodic.hopf import HopfPoint, hopf_points
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.orbits.periodic.settling import OrbitError
from gsp.orbits.periodic.shooting import Shot, shoot

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
