"""What a scene's ramps lead to: their critical rates, each found once."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType

from gsp.errors import GspError
from gsp.scenes.scene import Scene
from gsp.singular.ramps.critical_rate import CriticalRate, critical_rate


@lru_cache(maxsize=4)
def ramp_answers(scene: Scene) -> Mapping[str, CriticalRate | GspError]:
    """The answer for each of the ramps of `scene` by name, or why there is none."""
    found: dict[str, CriticalRate | GspError] = {}
    for name, asked in scene.ramps.items():
        start = asked.start or {state.name: scene.start[state.name] for state in scene.system.states}
        try:
            found[name] = critical_rate(
                scene.system, ramp=asked.ramp, start=start, edge=asked.edge or None, epsilon=scene.epsilon
            )
        except GspError as error:
            found[name] = error
    return MappingProxyType(found)


def drawn_ramp(scene: Scene) -> CriticalRate | None:
    """The first answer with a threshold between a rest point and an edge state, which can be drawn."""
    answers = [a for a in ramp_answers(scene).values() if isinstance(a, CriticalRate)]
    return next((a for a in answers if a.has_chart), None)
