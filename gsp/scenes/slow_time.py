"""A scene whose field is given in fast time, in slow time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import sympy as sp

from gsp.errors import SplittingError
from gsp.scenes.scene import TIME, Scene
from gsp.scenes.view import View
from gsp.splitting.fast_time import divided, is_in_fast_time
from gsp.splitting.splitting import split
from gsp.systems.region import shown_ends
from gsp.systems.system import SlowFastSystem, VectorField


def has_slow_time(system: SlowFastSystem | VectorField) -> bool:
    """Whether it is a field in fast time that has slow and fast variables; else its time is its own."""
    if not (isinstance(system, VectorField) and is_in_fast_time(system)):
        return False
    try:
        split(system)
    except SplittingError:
        return False
    return True


def in_slow_time(scene: Scene) -> Scene:
    """A scene in fast time with every rate divided by epsilon and the span multiplied by it, at the scene's value."""
    system = scene.system
    assert isinstance(system, VectorField)
    assert system.epsilon is not None
    return replace(scene, system=divided(system), **told_in_slow_time(scene, system.epsilon, scene.epsilon))


def explain_slow_time(scene: Scene, before: Scene) -> str:
    """What was made of the scene `before`, which was in fast time."""
    epsilon = scene.system.epsilon
    ends = " becomes ".join(" to ".join(shown_ends(each.span)) for each in (before, scene))
    return (
        f"no rate has a pole in {epsilon}, so the time of the model is the fast one: rates are divided by "
        f"{epsilon}, and the span {ends}"
    )


def told_in_slow_time(scene: Scene, symbol: sp.Symbol, value: float) -> dict[str, Any]:
    """What of a scene is told in its time, besides its field, with t*symbol in place of t."""

    def slower(view: View) -> View:
        is_time = {name: name == TIME and TIME not in scene.start for name in view.ranges}
        scaled = {
            name: (low * value, high * value) if is_time[name] else (low, high)
            for name, (low, high) in view.ranges.items()
        }
        return replace(view, ranges=scaled)

    def each(rates: Mapping[sp.Symbol, sp.Expr]) -> dict[sp.Symbol, sp.Expr]:
        return {state: rate / symbol for state, rate in rates.items()}

    return {
        "span": (scene.span[0] * value, scene.span[1] * value),
        "reconstruction": each(scene.reconstruction),
        "claims": {name: each(rates) for name, rates in scene.claims.items()},
        "units": {name: unit for name, unit in scene.units.items() if name != TIME},
        "views": {name: slower(view) for name, view in scene.views.items()},
    }
