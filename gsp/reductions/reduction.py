"""`Reduction`: one way of leaving something out of a scene, measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.choice.candidates import Candidate
from gsp.results.card import Card
from gsp.scenes.scene import Scene
from gsp.systems.region import Interval


@dataclass(frozen=True, eq=False, repr=False)
class Reduction(Card):
    """One candidate, measured: `scene` has its small parameter, `error` is that of the reduced flow of `order`.

    The error is the largest of a slow variable over `measured`, the span behind the initial layer, relative to the
    largest value of the variable there, of the reduced flow from the base point of the start, against the full run from
    the start. With `counts_fast`, where no slow variable takes notice of the fast ones, or none moves by a tenth of its
    value, these count too. `seconds` are those of a run, and `full_seconds` of one of the full system, measured
    together. `why_not` says why it does not serve. `is_stiff` is whether the reduced flow is run as a stiff one.
    """

    name: str
    scene: Scene
    order: int
    error: float
    measured: Interval
    full_seconds: float
    candidate: Candidate
    why_not: str
    counts_fast: bool = False
    is_stiff: bool = False

    @property
    def seconds(self) -> float:
        """Those of a run over the span, or as far as it holds."""
        return self.candidate.seconds

    @property
    def cost(self) -> float:
        """The same over those of the full system, which runs as far as it goes itself."""
        return self.seconds / (self.full_seconds * self.candidate.share)

    def as_dict(self) -> dict[str, object]:
        """Its name, order, error, cost and why it does not serve, as plain values; None for what is not known."""
        numbers = {"error": self.error, "seconds": self.seconds, "full_seconds": self.full_seconds}
        known = {what: number if np.isfinite(number) else None for what, number in numbers.items()}
        return {"name": self.name, "order": self.order, **known, "why_not": self.why_not}

    def __repr__(self) -> str:
        return f"Reduction({self.name}, order {self.order}: error {self.error:.2g})"
