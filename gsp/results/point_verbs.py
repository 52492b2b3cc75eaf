"""The verbs that a sweep can do at a point, and what each records there, given by the module `faces` of its package.

They record what does not depend on the machine or its load, so that the same point gives the same numbers anywhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from gsp.results.registry import enter_every_package

Record = Mapping[str, Any]
Labels = Mapping[str, Mapping[str, tuple[str | int, ...]]]


@dataclass(frozen=True)
class PointVerb:
    """A verb at one point: `record` gives the numbers, `labels` the labels of their axes by variable.

    `record` takes the study at the parameters and the start of the point, its epsilon, its tolerance, and the options
    of the verb. `codes` has the meanings of what is one of a few words; `needs_small` that epsilon is not None.
    """

    record: Callable[..., Record]
    labels: Callable[..., Labels]
    codes: Mapping[str, tuple[str, ...]]
    needs_small: bool


_given: dict[str, PointVerb] = {}


def records(
    name: str,
    *,
    labels: Callable[..., Labels] = lambda study, **_: {},
    codes: Mapping[str, tuple[str, ...]] | None = None,
    needs_small: bool = True,
) -> Callable[[Callable[..., Record]], Callable[..., Record]]:
    """Enter the decorated function as what the verb `name` records at a point."""

    def enter(record: Callable[..., Record]) -> Callable[..., Record]:
        _given[name] = PointVerb(record, labels, codes or {}, needs_small)
        return record

    return enter


@cache
def point_verbs() -> Mapping[str, PointVerb]:
    """All of them by name; most of the package is imported for it."""
    enter_every_package()
    return dict(sorted(_given.items()))
