"""When XPPAUT works a quantity out: `!` ones once, at the start, the others at every step, in the order of the file.

What a model file gives at every time, XPPAUT gives as it was at the start, which is refused, or one step ago, which
is told: as the steps get small, XPPAUT's runs tend to those of the model file.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import suppress
from graphlib import CycleError, TopologicalSorter

from gsp.errors import ModelFileError
from gsp.readers.foreign import WORDS

Quantities = Mapping[str, tuple[int, tuple[str, ...], str]]
Uses = Mapping[str, set[str]]


def taken_a_step_late(
    quantities: Quantities, derived: Collection[str], moving: Collection[str]
) -> dict[str, str]:
    """For each quantity that uses one below it, which XPPAUT takes from the step before, the last of these.

    `quantities` are (line, arguments, text) by name, in order; `derived` those with `!`, `moving` the states and t.
    Raises `ModelFileError` for a `!` quantity that uses what moves, or another `!` quantity below it.
    """
    uses = {name: set(WORDS.findall(text)) - set(own) for name, (_, own, text) in quantities.items()}
    carried = _carried(uses, moving)
    for name in quantities:
        if name in derived and name in carried:
            raise ModelFileError(
                f"line {quantities[name][0]}: !{name} is a constant for XPPAUT, worked out at the start, and "
                f"uses {carried[name]}.",
                "Take ! away where it is to move.",
            )
    functions = {name for name, (_, own, _) in quantities.items() if own}
    for name, other in _below(quantities, uses, functions, set(derived)).items():
        raise ModelFileError(
            f"line {quantities[name][0]}: !{name} uses !{other}, which stands below it; XPPAUT has no value "
            "for it then.",
            f"Put !{other} above.",
        )
    return _below(quantities, uses, functions, set(quantities) - functions - set(derived))


def _below(quantities: Quantities, uses: Uses, functions: set[str], names: Collection[str]) -> dict[str, str]:
    """Those of `names` that use, themselves or by way of functions, another of them below: the last of these."""
    places = {name: place for place, name in enumerate(quantities)}
    # The lowest of `names` that a function uses, by way of other functions too.
    lowest: dict[str, str | None] = {}

    def below(used: Collection[str]) -> str | None:
        found = [word if word in names else lowest.get(word) for word in used]
        return max(filter(None, found), key=places.__getitem__, default=None)

    for function in _innermost_first(functions, uses):
        lowest[function] = below(uses[function])
    found = {name: below(uses[name]) for name in quantities if name in names}
    return {name: other for name, other in found.items() if other is not None and places[other] > places[name]}


def _innermost_first(functions: Collection[str], uses: Uses) -> Iterator[str]:
    """The functions, each behind those that it uses; without a circle, which is refused elsewhere, and what uses it."""
    order = TopologicalSorter({name: uses[name].intersection(functions) for name in functions})
    with suppress(CycleError):
        order.prepare()
    while ready := order.get_ready():
        yield from ready
        order.done(*ready)


def _carried(uses: Uses, moving: Collection[str]) -> dict[str, str]:
    """For each quantity that moves what it moves with."""
    users: dict[str, list[str]] = {}
    for name in sorted(uses):
        for word in uses[name]:
            users.setdefault(word, []).append(name)
    carried: dict[str, str] = {}
    waiting = [(word, name) for word in sorted(moving) for name in users.get(word, ())]
    while waiting:
        word, name = waiting.pop()
        if name not in carried:
            carried[name] = word
            waiting += [(word, other) for other in users.get(name, ())]
    return carried
