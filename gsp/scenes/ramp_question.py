"""What a scene asks of a ramp: by which rates it leads from where the scene starts to an edge state."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import sympy as sp

from gsp.errors import DeclarationError
from gsp.systems.arguments import check_among, check_noun, check_plain_word, shown
from gsp.systems.flow import complete
from gsp.systems.ramp import Ramp


@dataclass(frozen=True)
class RampQuestion:
    """A `ramp` of a scene's parameters, near which rest point it starts, and near which edge state it ends.

    `start` is the scene's own where it is empty; `edge` is empty for a ramp without end.
    """

    ramp: Ramp
    edge: Mapping[str, float] = field(default_factory=dict)
    start: Mapping[str, float] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, object]:
        return {**self.__dict__, "edge": dict(self.edge), "start": dict(self.start)}

    def __hash__(self) -> int:
        return hash((self.ramp, tuple(self.edge.items()), tuple(self.start.items())))


def checked_ramps(
    ramps: object, states: Iterable[sp.Symbol], parameters: Iterable[sp.Symbol]
) -> dict[str, RampQuestion]:
    """Questions by name, of parameters and states that there are; raises `DeclarationError` that names what is none."""
    if not isinstance(ramps, Mapping):
        raise DeclarationError("ramps maps names to ramps.", got=shown(ramps), value=ramps)
    own, moving = list(states), list(parameters)
    checked = {}
    for name, asked in ramps.items():
        check_plain_word(name, what="the name of a ramp")
        check_noun(asked, RampQuestion, verb=f"the ramp {name}")
        for p in asked.ramp.parameters:
            check_among(p, moving, f"the ramp {name} moves {p}, which is no parameter.", "They are")
        points = {}
        for what, point in (("edge", asked.edge), ("start", asked.start)):
            # An edge that names one state of several is a level.
            is_level = what == "edge" and isinstance(point, Mapping) and len(point) == 1
            named = [s for s in own if is_level and s.name in {str(key) for key in point}] or own
            given = complete(point, named, what=f"the {what} of the ramp {name}") if point else ()
            points[what] = MappingProxyType(dict(zip((s.name for s in named), given)))
        checked[name] = RampQuestion(asked.ramp, **points)
    return checked
