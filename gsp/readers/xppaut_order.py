"""When XPPAUT works a quantity out: `!` ones once, at the start, the others at every step, in the order of the file.

What a model file would give at every time, XPPAUT gives as it was at the start, or one step ago. Both are refused.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping

from gsp.errors import ModelFileError

_NAMES = re.compile(r"(?<![a-z0-9_.])[a-z_][a-z0-9_]*")

Quantities = Mapping[str, tuple[int, tuple[str, ...], str]]


def check_order_of_quantities(
    quantities: Quantities, derived: Collection[str], moving: Collection[str]
) -> None:
    """Raise `ModelFileError` for a `!` quantity that uses what moves, and for one that uses a later one.

    `quantities` are (line, arguments, text) by name, in order; `derived` those with `!`, `moving` the states and t.
    """
    uses = {name: _used(arguments, text) for name, (_, arguments, text) in quantities.items()}
    places = {name: place for place, name in enumerate(quantities)}
    for name, (number, arguments, _) in quantities.items():
        if arguments:
            continue
        reached = _reached(name, uses, quantities)
        if name in derived and (states := sorted((reached | _reached(name, uses, None)) & set(moving))):
            raise ModelFileError(
                f"line {number}: !{name} is a constant for XPPAUT, worked out at the start, and uses {states[0]}. "
                "Take ! away where it is to move."
            )
        late = [
            other
            for other in sorted(reached & quantities.keys())
            if not quantities[other][1]
            and places[other] > places[name]
            and (other in derived) == (name in derived)
        ]
        if late:
            raise ModelFileError(
                f"line {number}: {name} uses {late[0]}, which stands below it; XPPAUT takes its value of the step "
                f"before. Put {late[0]} above."
            )


def _used(arguments: Collection[str], text: str) -> set[str]:
    return set(_NAMES.findall(text)) - set(arguments)


def _reached(name: str, uses: Mapping[str, set[str]], quantities: Quantities | None) -> set[str]:
    """What a quantity uses, by way of functions, and without `quantities` by way of everything."""
    waiting, reached = [name], set()
    while waiting:
        for word in uses[waiting.pop()] - reached:
            reached.add(word)
            if word in uses and (quantities is None or quantities[word][1]):
                waiting.append(word)
    return reached
