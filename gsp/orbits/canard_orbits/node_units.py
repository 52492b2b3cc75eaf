"""The canards of a folded node in units of its own, and back in those of the model.

Lengths are compared with 1 and with one another where orbits are run, corrected and followed: it is done with every
state in the power of two next to its size about the node, and about the system's centre, beside which it keeps its
digits.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from gsp.orbits.canard_orbits.canard import Canard
from gsp.orbits.canard_orbits.collocation import OrbitSegment
from gsp.orbits.canard_orbits.frame import FoldedNodeFrame, Plane, Units, frame_at
from gsp.orbits.canard_orbits.sheet import Sheet
from gsp.systems.region import powers_of_two


def in_own_units(frame: FoldedNodeFrame) -> FoldedNodeFrame:
    """The frame with its states in units of its own."""
    units = Units(frame.system.centre, powers_of_two(frame.sizes))
    return frame_at(frame.singularity, epsilon=frame.epsilon, units=units)


def plane_in(plane: Plane, units: Units) -> Plane:
    """A plane with its state in these `units`, as with all below."""
    return replace(plane, value=float(units.of(plane.value)[plane.index]))


def orbit_in(orbit: OrbitSegment, units: Units) -> OrbitSegment:
    """An orbit."""
    return replace(orbit, states=units.of(orbit.states), stages=units.of(orbit.stages))


def sheet_in(sheet: Sheet, units: Units) -> Sheet:
    """A sheet."""
    columns = [1 - sheet.section.index, 2]
    own = Units(units.centre[columns], units.sizes[columns])
    return replace(
        sheet,
        line=plane_in(sheet.line, units),
        section=plane_in(sheet.section, units),
        segments=tuple(orbit_in(segment, units) for segment in sheet.segments),
        ends=own.of(sheet.ends),
        slopes=sheet.slopes / own.sizes,
    )


def canard_in(canard: Canard, units: Units, frame: FoldedNodeFrame) -> Canard:
    """A canard, whose `frame` is then that."""
    names = [s.name for s in frame.system.states]
    place = units.of(np.array([canard.point[name] for name in names])).tolist()
    return replace(
        canard,
        system=frame.system,
        point=MappingProxyType(dict(zip(names, place))),
        orbit=orbit_in(canard.orbit, units),
        attracting_line=plane_in(canard.attracting_line, units),
        repelling_line=plane_in(canard.repelling_line, units),
        section=plane_in(canard.section, units),
        frame=frame,
    )
