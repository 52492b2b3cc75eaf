"""Another question about the same scene: other parameters, another epsilon, another region."""

from __future__ import annotations

from collections.abc import Mapping

from gsp.errors import DeclarationError, unknown_name
from gsp.scenes.scene import Scene
from gsp.scenes.small_parameter import no_small_parameter
from gsp.systems.region import Interval


def ask_again(
    scene: Scene,
    *,
    parameters: Mapping[str, float] | None = None,
    epsilon: float | None = None,
    region: Mapping[str, Interval] | None = None,
    start: str | None = None,
) -> Scene:
    """The scene with other exact values of `parameters`, at another `epsilon`, with other intervals in its `region`,
    and from another of its `starts`.

    The ladder of epsilons moves along in proportion. Raises `DeclarationError` for a name that the scene does not
    have, and where what results is no scene.
    """
    system = scene.system.with_parameters(**parameters) if parameters else scene.system
    states = [state.name for state in scene.system.states]
    for name in region or {}:
        if name not in states:
            raise DeclarationError.none_of(
                states, name, f'the region is given for "{name}", which is no state.', "The states are"
            )
    ladder = scene.epsilons
    if epsilon is not None and not scene.has_small:
        raise no_small_parameter(scene, "its value is asked for")
    if epsilon is not None:
        ladder = tuple(value * (epsilon / scene.epsilon) for value in ladder)
    if start is not None and start not in scene.starts:
        raise unknown_name(start, scene.starts)
    return scene._from(
        {} if start is None else scene.starts[start],
        system=system,
        epsilon=scene.epsilon if epsilon is None else epsilon,
        epsilons=ladder,
        region={**scene.region, **(region or {})},
    )
