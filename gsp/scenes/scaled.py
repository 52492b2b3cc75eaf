"""A scene in variables and a time that are scaled by powers of its small parameter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import sympy as sp

from gsp.errors import DeclarationError
from gsp.scenes.scene import TIME, Scene
from gsp.splitting.scaling import Scaling
from gsp.systems.arguments import check_noun, shown
from gsp.systems.declaration import exact


def take_scaling(scene: Scene, *, scaling: Scaling) -> Scene:
    """The scene in the variables and the time of `scaling`, which is one of its own field.

    What was a state is an observable. Starts are those of the scene's epsilon; at others of the ladder the scaled
    variables start at the same values. Bounds on linear forms are dropped, and so is what is told in the time that was,
    where that changes. Raises `DeclarationError` for the scaling of another field.
    """
    check_noun(scene, Scene, verb="take_scaling")
    if not isinstance(scaling, Scaling) or scaling.original != scene.system:
        raise DeclarationError("scaling is one of scalings(scene.system).", got=shown(scaling), value=scaling)
    mu, epsilon = scaling.original.epsilon, scaling.field.epsilon
    assert mu is not None
    assert epsilon is not None
    values = {mu: exact(scene.epsilon), **scene.system.parameters}
    states = {s.name: s for s in scene.system.states}
    slower = scene.epsilon ** float(scaling.time)
    steps = int(scaling.time / scaling.power)
    small = {mu: epsilon ** (1 / scaling.power)}

    def moved(start: Mapping[str, float]) -> dict[str, float]:
        place = {**values, **{states[name]: exact(value) for name, value in start.items() if name in states}}
        own = {new.name: float(e.xreplace(place)) for new, e in scaling.states.items()}
        return {**own, **{name: value for name, value in start.items() if name not in states}}

    def driven(rate: sp.Expr) -> sp.Expr:
        return rate.xreplace({**small, **scaling.inverse}) * epsilon**steps

    region = {}
    for new, e in scaling.states.items():
        (old, *others) = e.free_symbols - {mu, *scene.system.parameters}
        if not others and old.name in scene.region:
            ends = (e.xreplace({**values, old: exact(end)}) for end in scene.region[old.name])
            region[new.name] = tuple(map(float, ends))
    return replace(
        scene,
        system=scaling.field,
        region=region,
        start=moved(scene.full_start),
        span=(scene.span[0] / slower, scene.span[1] / slower),
        epsilon=scene.epsilon ** float(scaling.power),
        epsilons=tuple(value ** float(scaling.power) for value in scene.epsilons),
        reconstruction={symbol: driven(rate) for symbol, rate in scene.reconstruction.items()},
        reconstruction_start={},
        starts={name: moved({**scene.full_start, **start}) for name, start in scene.starts.items()},
        claims={},
        views=scene.views if not steps else {},
        units={name: unit for name, unit in scene.units.items() if not steps or name != TIME},
        second="",
        ramps={},
        phase=None,
    )
