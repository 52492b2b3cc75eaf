"""A scene placed in standard form: its system, start and region in slow and fast coordinates, and its branch."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType

import numpy as np

from gsp.critical.critical_manifold import Branch, CriticalManifold, solve_critical
from gsp.errors import DeclarationError, SplittingError
from gsp.lowering.compiled_flow import compile_flow, compile_function
from gsp.scenes.scene import Scene
from gsp.splitting.splitting import Splitting, split
from gsp.systems.region import Interval
from gsp.systems.system import SlowFastSystem

# Points per axis of the box that is mapped when a slow coordinate is no multilinear function of raw states.
IMAGE_POINTS = 7


@dataclass(frozen=True, eq=False)
class Placement:
    """`scene` with its `splitting` (None when declared in standard form), `system`, and in the system's
    coordinates `start` and `region`; `branch` is the one nearest to the start, its sheet fixed.
    """

    scene: Scene
    splitting: Splitting | None
    system: SlowFastSystem
    start: Mapping[str, float]
    region: Mapping[str, Interval]
    critical: CriticalManifold
    branch: Branch


def place_splitting(scene: Scene) -> tuple[Splitting | None, SlowFastSystem]:
    """The splitting of the scene's field, and the system in standard form.

    Raises `SplittingError` when the field stays non-standard: there is no series to expand then.
    """
    if isinstance(scene.system, SlowFastSystem):
        return None, scene.system
    splitting = split(scene.system)
    if splitting.system is None:
        raise SplittingError(
            f"the field of {scene.name or 'this scene'} has no standard form: {splitting.explain()} "
            "Declare it in slow and fast variables, or use split(field).reduced_field for the leading order."
        )
    return splitting, splitting.system


@lru_cache(maxsize=16)
def place(scene: Scene) -> Placement:
    """The scene in standard form, remembered per scene.

    Raises `SplittingError`, `BranchError` or `DeclarationError` as the stages do, and when the region does not
    bound every raw state that a slow coordinate is made of.
    """
    splitting, system = place_splitting(scene)
    start = dict(scene.start) if splitting is None else splitting.to_new(scene.start)
    region = dict(scene.region) if splitting is None else _image(scene, splitting, system)
    critical = solve_critical(system)
    branch = critical.nearest(start)
    return Placement(
        scene, splitting, system, MappingProxyType(start), MappingProxyType(region), critical, branch
    )


def _image(scene: Scene, splitting: Splitting, system: SlowFastSystem) -> dict[str, Interval]:
    """The box of the slow coordinates that contains the image of the raw region; fast bounds are kept."""
    region: dict[str, Interval] = {}
    for symbol, expression in splitting.coordinates.items():
        used = [z for z in scene.system.states if expression.has(z)]
        missing = [z.name for z in used if z.name not in scene.region]
        if missing and symbol in system.y:
            continue
        if missing:
            raise DeclarationError(
                f"the region gives no interval for {', '.join(missing)}, which the slow coordinate "
                f"{symbol} = {expression} is made of. Bound {', '.join(missing)} too."
            )
        box = [scene.region[z.name] for z in used]
        # A multilinear function takes its extremes at the corners; others are sampled as well.
        linear = all(expression.is_polynomial(z) and expression.diff(z, 2) == 0 for z in used)
        axes = [np.linspace(low, high, 2 if linear else IMAGE_POINTS) for low, high in box]
        points = np.array(list(itertools.product(*axes)))
        function = compile_function(
            (expression,), arguments=tuple(used), epsilon=None, parameters=tuple(scene.system.parameters)
        )
        values = function(points, compile_flow(scene.system).constants)
        region[symbol.name] = (float(values.min()), float(values.max()))
    return region
