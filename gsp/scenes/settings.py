"""Another question about the same scene: other parameters, another epsilon, another region."""

from __future__ import annotations

from collections.abc import Mapping

from gsp.errors import DeclarationError, unknown_name
from gsp.scenes.scene import Scene
from gsp.scenes.small_parameter import no_small_parameter
from gsp.systems.arguments import check_among
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
    have, for a parameter of which its file worked something out that is not given too, and where what results is no
    scene.
    """
    given = parameters or {}
    declared = [parameter.name for parameter in scene.system.parameters]
    for name in given:
        if scene.has_small and name == str(scene.system.epsilon):
            raise DeclarationError(
                f"{name} is the small parameter, whose value is asked for as epsilon.",
                "Use --epsilon VALUE, or epsilon=VALUE in Python.",
            )
        kept = [word for word in scene.worked_out.get(name, ()) if word not in given]
        if kept:
            raise DeclarationError(
                f"what was worked out of {name} when the file was read would stay as it is: {', '.join(kept)[:300]}.",
                f"Write the value of {name} into the file"
                + (", or give these values too." if all(word in declared for word in kept) else "."),
            )
    system = scene.system.with_parameters(**parameters) if parameters else scene.system
    states = [state.name for state in scene.system.states]
    for name in region or {}:
        check_among(name, states, f'the region is given for "{name}", which is no state.', "The states are")
    ladder = scene.epsilons
    if epsilon is not None and not scene.has_small:
        raise no_small_parameter(scene, "its value is asked for")
    if epsilon is not None:
        ladder = tuple(value * (epsilon / scene.epsilon) for value in ladder)
    if start is not None and not scene.starts:
        raise DeclarationError(
            "the model has one start only.", "Give it further ones under [starts].", got=f"{start[:80]!r}"
        )
    if start is not None and start not in scene.starts:
        raise unknown_name(start, scene.starts)
    return scene._from(
        {} if start is None else scene.starts[start],
        system=system,
        epsilon=scene.epsilon if epsilon is None else epsilon,
        epsilons=ladder,
        region={**scene.region, **(region or {})},
    )
