"""What of a scene turns fast: a state that is a phase, or a pair of states that turn about one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import sympy as sp

from gsp.errors import DeclarationError
from gsp.results.card import Card
from gsp.systems.arguments import check_among, check_each, check_noun, check_text


@dataclass(frozen=True)
class FastPhase(Card):
    """The state `name` is a phase, or the `pair` turns, u' = b v/epsilon + ..., v' = c u/epsilon + ...; or both near
    resonance. `average` takes what moves slowly over it.

    Raises `DeclarationError` where neither is named.

    >>> FastPhase(pair=("u", "v"))
    FastPhase(name='', pair=('u', 'v'))
    """

    name: str = ""
    pair: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", _name(self.name))
        if self.pair is not None:
            pair = check_each(self.pair, _name, what="pair", be="the names of two states", length=2)
            if pair[0] == pair[1]:
                raise DeclarationError("pair is two different states.", got=f"{pair[0]} twice")
            object.__setattr__(self, "pair", pair)
        if not self.name and self.pair is None:
            raise DeclarationError(
                "a fast phase names what turns.",
                'Give the name of the state that is the phase, or the pair of states, pair=("u", "v").',
            )

    def __str__(self) -> str:
        two = "" if self.pair is None else f"{self.pair[0]} and {self.pair[1]}"
        if not self.name:
            return f"{two}, about one another"
        return self.name if self.pair is None else f"{two}, in the frame of {self.name}"


def _name(given: object) -> str:
    return given.name if isinstance(given, sp.Symbol) else check_text(given, what="the name of a state")


def checked_phase(phase: object, states: Sequence[str]) -> FastPhase | None:
    """A phase of states that there are; raises `DeclarationError` that names what is none."""
    if phase is None:
        return None
    check_noun(phase, FastPhase, verb="the phase of a scene")
    assert isinstance(phase, FastPhase)
    named = [*([phase.name] if phase.name else []), *(phase.pair or ())]
    for name in named:
        check_among(name, states, f"the phase names {name}, which is no state.", "They are")
    if len(set(named)) != len(named):
        raise DeclarationError(
            f"{phase.name} is the phase and one of the pair.", "Name three different states."
        )
    return phase
