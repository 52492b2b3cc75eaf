"""The canards of a folded node in units of its own, and back in those of the model.

Lengths are compared with 1 and with one another where orbits are run, corrected and followed: it is done with every
state in the power of two next to its size about the node, which leaves every digit as it is.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from gsp.orbits.canard_orbits.canard import Canard
from gsp.orbits.canard_orbits.collocation import OrbitSegment
from gsp.orbits.canard_orbits.frame import FoldedNodeFrame, Plane, frame_at
from gsp.orbits.canard_orbits.sheet import Sheet
from gsp.systems.region import powers_of_two


def in_own_units(frame: FoldedNodeFrame) -> FoldedNodeFrame:
    """The frame with its states in units of its own."""
    return frame_at(frame.singularity, epsilon=frame.epsilon, units=powers_of_two(frame.sizes))


def plane_in(plane: Plane, units: np.ndarray) -> Plane:
    """A plane with its state in one of the `units` (3,), as with all below."""
    return replace(plane, value=float(plane.value / units[plane.index]))


def orbit_in(orbit: OrbitSegment, units: np.ndarray) -> OrbitSegment:
    """An orbit."""
    return replace(orbit, states=orbit.states / units, stages=orbit.stages / units)


def sheet_in(sheet: Sheet, units: np.ndarray) -> Sheet:
    """A sheet."""
    own = units[[1 - sheet.section.index, 2]]
    return replace(
        sheet,
        line=plane_in(sheet.line, units),
        section=plane_in(sheet.section, units),
        segments=tuple(orbit_in(segment, units) for segment in sheet.segments),
        ends=sheet.ends / own,
        slopes=sheet.slopes / own,
    )


def canard_in(canard: Canard, units: np.ndarray, frame: FoldedNodeFrame) -> Canard:
    """A canard, whose `frame` is then that."""
    names = [s.name for s in frame.system.states]
    return replace(
        canard,
        system=frame.system,
        point=MappingProxyType({name: canard.point[name] / float(u) for name, u in zip(names, units)}),
        orbit=orbit_in(canard.orbit, units),
        attracting_line=plane_in(canard.attracting_line, units),
        repelling_line=plane_in(canard.repelling_line, units),
        section=plane_in(canard.section, units),
        frame=frame,
    )
