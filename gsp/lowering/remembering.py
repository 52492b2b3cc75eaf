"""What is made once of an object, and forgotten with it."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, wraps
from typing import TypeVar
from weakref import ref

Noun = TypeVar("Noun")
Made = TypeVar("Made")


def remembered(make: Callable[[Noun], Made]) -> Callable[[Noun], Made]:
    """`make`, called once for each object that lives; what it returns must not hold the object, or neither is freed.

    The key is the object itself: to compare two equal flows costs more than a short run, and an equality that leaves
    something out would give one what was made of the other.
    """
    known: dict[int, tuple[ref[Noun], Made]] = {}

    @wraps(make)
    def recall(noun: Noun) -> Made:
        number = id(noun)
        found = known.get(number)
        if found is not None and found[0]() is noun:
            return found[1]
        made = make(noun)
        # The callback is `known.pop(number, the dead reference)`: no line of Python, in which Ctrl-C would be lost.
        known[number] = ref(noun, partial(known.pop, number)), made
        return made

    return recall
