"""What is proved about a tube, whatever it lies about."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import sympy as sp
from flint import arb

from gsp.proofs import balls
from gsp.proofs.verdict import ProofVerdict
from gsp.results.bounds import at_most, shown_sides
from gsp.results.card import Card
from gsp.slow_tubes.isolation import norm
from gsp.slow_tubes.tube_search import ProvedTube


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Tube(Card):
    """A tube over `region`: what `SlowTube` and `SolvedTube` have in common. Nothing is proved unless it is said."""

    region: Mapping[str, tuple[float, float]]
    verdict: ProofVerdict = ProofVerdict.UNDECIDED
    reason: str = "no tube was proved isolating"
    delta: float = math.nan
    widths: Mapping[str, float] = field(default_factory=dict)
    is_isolating: bool = False
    has_cones: bool = False
    boundary: str = "mixed"
    is_unique: bool = False
    collar: float = math.nan
    signs: tuple[int, ...] = ()
    tried: int = 0

    @property
    def statement(self) -> tuple[str, ...]:
        """What is proved, in sentences."""
        if not self.is_isolating:
            return ()
        if 1 in self.signs:
            lines = ["the flow crosses every face of the tube, out of it along the unstable directions only"]
        elif self.boundary == "inflowing":
            lines = ["a solution that starts in the tube stays in it for ever"]
        else:
            lines = [
                "a solution that starts in the tube stays in it while its slow variables are in the region"
            ]
        if not self.has_cones:
            return (*lines, "no Lipschitz manifold in it is proved")
        lines.append("a manifold lies in the tube, the graph of a Lipschitz map over the whole region")
        if self.is_unique:
            return (*lines, "it is locally invariant and unique: no other one over the region lies in the tube")
        return (
            *lines,
            f"it is locally invariant off a collar of width {at_most(self.collar, 3)} at the sides, "
            "in which the slow flow is cut off",
            "in general it is not unique: each cut-off gives one, and others may lie outside the tube",
        )

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.verdict.name}, {self.reason})"

    def _card(self, at: str, sentences: Sequence[str]) -> str:
        """The verdict on the region and the reason; of an isolating tube what is `sentences`, and the statement."""
        lines = [f"{self.verdict.value} on {shown_sides(self.region)}{at}", f"  {self.reason}"]
        if self.is_isolating:
            lines += [f"  {line}" for line in (*sentences, *self.statement)]
        return "\n".join(lines)

    def _with(self, found: ProvedTube, fast: Sequence[sp.Symbol], power: arb, **own: Any) -> Self:
        """This tube with what was `found`, whose half-widths are `power` times those of the search."""
        search, proved = found.problem, bool(found.cones)
        boundary = search.sides_of(found)
        scaled = [arb(width) for width in search.half_widths(found.widths)]
        return replace(
            self,
            verdict=ProofVerdict.PROVED if proved else ProofVerdict.UNDECIDED,
            reason="a slow manifold is in the tube"
            if proved
            else "the tube is isolating, but the cone conditions are not proved"
            + (
                ""
                if search.leaves_interior(boundary)
                else " with a cut-off that leaves something of the region: lower epsilon, or take a wider region"
            ),
            delta=balls.magnitude(norm(scaled) * power),
            widths={y.name: balls.magnitude(width * power) for y, width in zip(fast, scaled)},
            is_isolating=True,
            has_cones=proved,
            boundary=boundary,
            is_unique=found.is_kept,
            collar=found.collar,
            signs=search.basis.signs,
            **own,
        )
