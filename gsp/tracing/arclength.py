"""Pseudo-arclength continuation of a curve of solutions through its folds (Keller 1977): the one loop of all curves.

From a solution with its unit tangent: the predictor along the tangent, Newton's method in the plane across it, the
bordered tangent there on the side of the one before; steps chosen by the number of corrections and the angle between
tangents, halved when a step is refused. What a solution is, and where its curve ends, the subclasses of `Tracer` say.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Generic, TypeVar

import numpy as np

from gsp.errors import Status
from gsp.roots import root

# A solution of the curve with its tangent and whatever belongs to it.
Node = TypeVar("Node")


@dataclass(frozen=True)
class Pace:
    """Lengths of steps: the first, the longest, and the shortest before giving up, in arclength.

    `corrections` of Newton's method and the angle `turn` between neighbouring tangents are aimed at, `largest_turn` is
    allowed; a step is at most `growth` times the one before.
    """

    first: float
    longest: float
    shortest: float
    corrections: float = np.inf
    turn: float = np.inf
    largest_turn: float = np.inf
    growth: float = 2.0

    def after(self, length: float, corrections: int, turn: float) -> float:
        """The step after one of `length`."""
        by_corrections = 2.0 ** ((self.corrections - corrections) / 2.0)
        # No pair of tangents is nearer than this, for the choice of a step.
        factor = min(by_corrections, self.turn / max(turn, 1e-3))
        return min(length * float(np.clip(factor, 0.5, self.growth)), self.longest)


@dataclass(frozen=True, eq=False)
class Stride(Generic[Node]):
    """One step: the solution reached, the corrections that it took, and the angle between its tangent and the last."""

    node: Node
    corrections: int
    turn: float


@dataclass(frozen=True, eq=False)
class Arrival(Generic[Node]):
    """What a step adds to the curve: solutions with the arclength to each from the one before, and its ending, if any.

    `onward` is the last solution as the next step starts from it, where that is not the same.
    """

    nodes: Sequence[tuple[Node, float]]
    ending: Enum | None = None
    onward: Node | None = None


@dataclass
class Trace(Generic[Node]):
    """One direction of a curve: `nodes`, the `lengths` (one fewer) between them, refused steps, and how it ended."""

    nodes: list[Node]
    lengths: list[float] = field(default_factory=list)
    rejected: int = 0
    ending: Enum = Status.TOO_MANY_POINTS


class Tracer(ABC, Generic[Node]):
    """Follows one curve by steps of `pace`, over at most `most` solutions in one direction."""

    pace: Pace
    most: int

    @abstractmethod
    def predicted(self, here: Node, length: float) -> Any:
        """The guess that far along the tangent of `here`, with its plane; None where there can be no solution."""

    @abstractmethod
    def corrected(self, guess: Any, length: float) -> Any:
        """The solution in the plane of the guess, with its number of corrections; None where Newton's method fails."""

    @abstractmethod
    def oriented(self, here: Node, guess: Any, found: Any) -> Stride[Node] | None:
        """That solution with its tangent, on the side of the one before; None where the bordered system is singular."""

    @abstractmethod
    def arrived(
        self, trace: Trace[Node], here: Node, stride: Stride[Node], length: float
    ) -> Arrival[Node] | None:
        """What a step from `here` adds to the curve; None when it is refused after all."""

    def spent(self) -> Enum | None:
        """An ending when there is no work left for another step."""
        return None

    def stuck(self) -> Enum:
        """The ending where the shortest step was refused."""
        return Status.STEP_TOO_SMALL

    def step(self, here: Node, length: float) -> Stride[Node] | None:
        """The step of that length from `here`; None when it fails, or the curve turns too far in it."""
        guess = self.predicted(here, length)
        found = None if guess is None else self.corrected(guess, length)
        stride = None if found is None else self.oriented(here, guess, found)
        return None if stride is None or not stride.turn <= self.pace.largest_turn else stride

    def follow(self, trace: Trace[Node], *, progress: Callable[[float], object] | None = None) -> None:
        """Add to `trace`, which holds its first solution, until the curve ends: the ending is left in it."""
        here, length = trace.nodes[-1], min(self.pace.first, self.pace.longest)
        while len(trace.nodes) < self.most:
            ending = self.stuck() if length < self.pace.shortest else self.spent()
            if ending is not None:
                trace.ending = ending
                return
            stride = self.step(here, length)
            arrival = None if stride is None else self.arrived(trace, here, stride, length)
            if stride is None or arrival is None:
                trace.rejected += 1
                length *= 0.5
                continue
            for node, distance in arrival.nodes:
                trace.nodes.append(node)
                trace.lengths.append(distance)
            if progress is not None:
                progress(len(trace.nodes) / self.most)
            if arrival.ending is not None:
                trace.ending = arrival.ending
                return
            here = trace.nodes[-1] if arrival.onward is None else arrival.onward
            length = self.pace.after(length, stride.corrections, stride.turn)
        trace.ending = Status.TOO_MANY_POINTS

    def located(
        self,
        here: Node,
        length: float,
        test: Callable[[Node], float],
        ends: tuple[float, float],
        *,
        apart: float,
    ) -> tuple[Node, float] | None:
        """Where `test`, with the values `ends`, changes its sign in the step of `length` from `here`, and how far on.

        To within `apart` of the arclength. Where no step leads, as at a branch point that is met exactly, one beside it
        is taken, and where none leads there either the solution with the least value that was reached on the way; None
        when there is none.
        """
        best: tuple[Node, float] | None = None
        least = np.inf

        def value(distance: float) -> float:
            nonlocal best, least
            strides = (self.step(here, distance + share * apart) for share in (0.0, -0.5, 0.5))
            stride = next((stride for stride in strides if stride is not None), None)
            found = float("nan") if stride is None else test(stride.node)
            if stride is not None and abs(found) < least:
                best, least = (stride.node, distance), abs(found)
            return found

        root(value, 0.0, length, ends=ends, apart=apart)
        return best
