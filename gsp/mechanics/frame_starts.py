"""Starts and regions of a friction system carried from raw velocities to its states."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsp.errors import DeclarationError
from gsp.mechanics.algebra import numbers
from gsp.mechanics.constraints import ConstrainedSystem
from gsp.mechanics.frame import MovingFrame
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.scenes.image import image_interval
from gsp.splitting.splitting import Splitting
from gsp.systems.flow import Point, Values, check_given, values_by_name
from gsp.systems.region import Interval
from gsp.systems.system import VectorField


def frame_values(
    system: LagrangianSystem,
    frame: MovingFrame,
    field: VectorField,
    reconstruction: Values,
    start: Point,
) -> tuple[dict[str, float], dict[str, float]]:
    """(values of the field's states, values of the reconstructed positions) at `start`, by name.

    Raises `DeclarationError` for unknown names, unless all raw or all quasi-velocities are given, and for a start
    off the holonomic constraints.
    """
    given = values_by_name(start, what="start")
    raw = [v.name for v in system.velocities]
    quasi = [s.name for s in frame.quasi_velocities]
    places = [s.name for s in (*system.coordinates, *system.clock)]
    for name in given:
        if name not in (*raw, *quasi, *places):
            raise DeclarationError(
                f'start names "{name}", which is no position and no velocity.',
                f"Those are {', '.join((*places, *raw))}; or {', '.join(quasi)}.",
                value=name,
                known=[*raw, *quasi, *places],
            )
    needed = [s.name for s in field.states if s.name in places]
    check_given(given, needed, what="start", remedy="Give every position.")
    position = {name: given.get(name, 0.0) for name in places}
    complete = all(name in given for name in quasi)
    mixed = [name for name in raw if name in given and name not in quasi]
    if complete and not mixed:
        values = {name: given[name] for name in quasi}
    elif all(name in given for name in raw) and not [
        name for name in quasi if name in given and name not in raw
    ]:
        symbols = (*system.coordinates, *system.velocities)
        point = np.array([[*(position[q.name] for q in system.coordinates), *(given[name] for name in raw)]])
        shown = frame.expressions(system.velocities)
        row = numbers([shown[s] for s in frame.quasi_velocities], symbols, point, system.values).reshape(-1)
        values = {name: float(value) for name, value in zip(quasi, row)}
    else:
        raise DeclarationError(
            "start gives some velocities.",
            f"Give all of {', '.join(raw)}, or all of {', '.join(quasi)}.",
            got=given,
        )
    system.check_holonomic(position | {name: given[name] for name in raw if name in given and not complete})
    states = {s.name: (position | values)[s.name] for s in field.states}
    return states, {s.name: position[s.name] for s in reconstruction if s.name in given}


def with_slips(system: LagrangianSystem, frame: MovingFrame, start: Point) -> dict[str, float]:
    """`start` by name; where it gives the quasi-velocities along the constraints, slips that it leaves out are 0.

    A start with all raw velocities gives the slips too, also where some of its names are those of quasi-velocities.
    """
    given = values_by_name(start, what="start")
    if all(v.name in given for v in system.velocities) or not all(u.name in given for u in frame.along):
        return dict(given)
    return {**dict.fromkeys((w.name for w in frame.across), 0.0), **given}


def constrained_start(limit: ConstrainedSystem, start: Point) -> dict[str, float]:
    """The states of `limit.full_field` and the slips at `start`; positions and slips that are not given are 0.

    Raises what `frame_values` raises.
    """
    system, frame = limit.system, limit.frame
    given = with_slips(system, frame, start)
    states, places = frame_values(system, frame, limit.reduced, limit.reconstruction, given)
    slips = {w.name: given[w.name] for w in frame.across if w.name in given}
    if len(slips) < len(frame.across):
        shown = frame.expressions(system.velocities)
        symbols = (*system.coordinates, *system.velocities)
        point = np.array([[given.get(s.name, 0.0) for s in symbols]])
        found = numbers([shown[w] for w in frame.across], symbols, point, system.values).ravel()
        slips = {w.name: float(value) for w, value in zip(frame.across, found)}
    return {**dict.fromkeys((s.name for s in limit.full_field.states), 0.0), **states, **places, **slips}


def new_region(splitting: Splitting, region: Mapping[str, Interval]) -> dict[str, Interval]:
    """The box of `splitting.system` that contains the image of a box of the field's states.

    Bounds on the system's own variables are kept. Raises `DeclarationError` when a slow momentum is made of
    states that have no bounds.
    """
    result: dict[str, Interval] = {}
    field = splitting.field
    for symbol, expression in splitting.coordinates.items():
        if symbol.name in region:
            result[symbol.name] = region[symbol.name]
            continue
        used = [z for z in field.states if expression.has(z)]
        missing = [z.name for z in used if z.name not in region]
        if len(missing) == len(used):
            continue
        if missing:
            raise DeclarationError(
                f"the region gives no interval for {', '.join(missing)}, which {symbol} = {expression} is "
                "made of.",
                f"Bound {', '.join(missing)} too, or bound {symbol}.",
            )
        box = {z: region[z.name] for z in used}
        result[symbol.name] = image_interval(symbol, expression, box, field.parameters)
    return result
