"""The region of a scene in slow and fast coordinates."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.lowering.compiled_function import compile_function
from gsp.scenes.raw_states import RawStates
from gsp.scenes.scene import Scene
from gsp.splitting.splitting import Splitting
from gsp.systems.declaration import exact
from gsp.systems.flow import Values
from gsp.systems.region import ImageBox, Interval, rounded_outwards
from gsp.systems.system import SlowFastSystem
from gsp.systems.tolerances import RTOL

# Points per axis of a box that is mapped when a slow coordinate is no multilinear function of raw states.
IMAGE_POINTS = 7


def image_of(scene: Scene, splitting: Splitting, system: SlowFastSystem) -> Mapping[str, Interval]:
    """The box of the slow coordinates around the image of the raw region; fast bounds are kept."""
    region: dict[str, Interval] = {}
    for symbol, expression in splitting.coordinates.items():
        used = [z for z in scene.system.states if expression.has(z)]
        missing = [z.name for z in used if z.name not in scene.region]
        if missing and symbol in system.y:
            continue
        if missing:
            raise DeclarationError(
                f"the region gives no interval for {', '.join(missing)}, which the slow coordinate {symbol} "
                f"= {expression} is made of.",
                f"Bound {', '.join(missing)} too.",
            )
        box = {z: scene.region[z.name] for z in used}
        region[symbol.name] = image_interval(symbol, expression, box, scene.system.parameters)
    made_of = [
        e.free_symbols & set(scene.system.states) for x, e in splitting.coordinates.items() if x in system.x
    ]
    if len(set().union(*made_of)) == sum(map(len, made_of)):
        # No two slow coordinates are made of one state: the image is the box.
        return MappingProxyType(region)
    return ImageBox(MappingProxyType(region), RawStates(splitting, scene.region).have)


def image_interval(
    symbol: sp.Symbol, expression: sp.Expr, box: Mapping[sp.Symbol, Interval], parameters: Values
) -> Interval:
    """An interval about the values of `expression`, which `symbol` stands for, over a box of what it is made of.

    Raises `DeclarationError` where it has no finite value.
    """
    # A multilinear function takes its extremes at the corners; others are sampled as well.
    linear = all(expression.is_polynomial(z) and expression.diff(z, 2) == 0 for z in box)
    axes = [np.linspace(low, high, 2 if linear else IMAGE_POINTS) for low, high in box.values()]
    points = np.array(list(itertools.product(*axes)))
    function = compile_function((expression,), arguments=tuple(box), parameters=tuple(parameters))
    values = function(points, np.array([np.nan, *map(float, parameters.values())])).reshape(len(points))
    if not np.isfinite(values).all():
        at = points[int(np.argmin(np.isfinite(values)))]
        raise DeclarationError(
            f"the slow coordinate {symbol} = {expression} has no finite value in a place of the region.",
            "Leave that place out of the region.",
            got=", ".join(f"{z.name} = {value:g}" for z, value in zip(box, at)),
        )
    if linear:
        # Exactly, so that decimals stay decimals: 2.28 and not 2.2800000000000002.
        corners = [points[int(find(values))] for find in (np.argmin, np.argmax)]
        places = [dict(zip(box, map(exact, corner.tolist()))) for corner in corners]
        low, high = (float(expression.xreplace({**parameters, **place})) for place in places)
        return low, high
    low, high = float(values.min()), float(values.max())
    return rounded_outwards(low, high, RTOL * (high - low))
