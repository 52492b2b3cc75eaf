"""A scene whose field has switches phi(s/epsilon), in the variables in which they are fast."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

from gsp.errors import DeclarationError
from gsp.scenes.scene import Scene
from gsp.splitting.switches import Switch, put, with_fast, without_switches
from gsp.systems.system import VectorField


def in_fast_variables(scene: Scene) -> tuple[Scene, tuple[Switch, ...]]:
    """The same question with v = s/epsilon as a state, and what became of the switches.

    States that v replaces are observables, and bounds on them are dropped: v is bounded by no multiple of 1/epsilon.
    Starts are those of the scene's epsilon; at others of the ladder v starts at the same value.
    """
    field = scene.system
    assert isinstance(field, VectorField)
    changed, switches = without_switches(field)
    gone = {switch.state.name for switch in switches if switch.state is not None}
    if scene.region and gone.issuperset(scene.region):
        raise DeclarationError(
            f"the region bounds {', '.join(scene.region)} alone: {' '.join(map(str, switches))}",
            f"Bound {', '.join(s.name for s in field.states if s.name not in gone)}.",
            got=dict(scene.region),
        )
    states = [s.name for s in field.states]

    def moved(start: dict[str, float]) -> dict[str, float]:
        own = {name: start[name] for name in states}
        others = {name: value for name, value in start.items() if name not in own}
        return {**with_fast(switches, own, scene.epsilon, field.parameters), **others}

    start = moved(dict(scene.full_start))
    driven = {symbol: put(rate, switches) for symbol, rate in scene.reconstruction.items()}
    return replace(
        scene,
        system=changed,
        region={name: box for name, box in scene.region.items() if name not in gone},
        start=start,
        reconstruction_start={},
        reconstruction=MappingProxyType(driven),
        starts={name: moved({**scene.full_start, **other}) for name, other in scene.starts.items()},
        claims={
            name: {symbol: put(rate, switches) for symbol, rate in rates.items()}
            for name, rates in scene.claims.items()
        },
        ramps={},
        phase=None,
    ), switches
