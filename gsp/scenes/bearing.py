"""Does no-slip hold? The question that a scene with contacts puts to them, from its start or from places beside it."""

from __future__ import annotations

from collections.abc import Mapping

from gsp.scenes.study import Study
from gsp.sliding.no_slip import NoSlip


def no_slip_of(
    study: Study, *, start: Mapping[str, float] | None = None, span: tuple[float, float] | None = None
) -> NoSlip | None:
    """Whether no contact of the scene slips over its span, or over `span`; None for a scene without dry friction.

    The run begins at the scene's start, with the slow variables of `start` where they are given, which does not slip.
    Raises `DeclarationError` for a scene whose own start slips.
    """
    scene = study.scene
    if scene.contacts is None:
        return None
    values = {**scene.full_start, **(start or {})}
    for switch in study.switches if start is None else ():
        if switch.state is not None and switch.value is not None:
            place = {s: values[s.name] for s in switch.value.free_symbols if s.name in values}
            at = {**scene.system.parameters, **place, switch.epsilon: scene.epsilon}
            values[switch.state.name] = float(switch.value.xreplace(at))
    contacts = scene.contacts.with_parameters(scene.system.parameters)
    return contacts.no_slip(start=values, span=scene.span if span is None else span)
