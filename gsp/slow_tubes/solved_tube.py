"""A slow manifold that was solved for, proved: a tube about its interpolant at one epsilon.

The field may hold any function that has an enclosure, and the branch may be implicit: what the tests of `isolation`
ask for comes from the interpolant (`solved_flow`) in place of a series.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp
from flint import arb

from gsp.algebra.differentiation import jacobian
from gsp.algebra.precision import precision
from gsp.errors import DeclarationError
from gsp.proofs import balls
from gsp.proofs.certification import MOST_BOXES
from gsp.proofs.equations import without_decimals
from gsp.proofs.search_progress import SearchProgress
from gsp.proofs.sides import rounded_sides
from gsp.proofs.tubes import Box
from gsp.results.bounds import as_given, at_most
from gsp.slow.chebyshev import ChebyshevSurface
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow_tubes.adapted_basis import AdaptedBasis, adapted_bases
from gsp.slow_tubes.isolation import Tally
from gsp.slow_tubes.solved_flow import SolvedFlow
from gsp.slow_tubes.tube import Tube
from gsp.slow_tubes.tube_search import ProvedTube, TubeSearch
from gsp.systems.arguments import check_progress, check_whole
from gsp.systems.flow import check_epsilon
from gsp.systems.region import check_region


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SolvedTube(Tube):
    """What is proved of a slow manifold near the interpolant of `manifold` over `region`, at its `epsilon`.

    - PROVED: the tube |y - p(x)| <= `delta` about the interpolant p is isolating, and the cone conditions hold in it,
      so that a slow manifold lies in it; `statement` says what follows. `widths` are each fast variable's part of
      delta.
    - UNDECIDED: `is_isolating` and `has_cones` say what was proved of the tube, if there is one.

    It holds for all epsilon within a rounding of the double, the decimal that it stands for among them. p has exactly
    the coefficients in doubles that `manifold.surface` has; to evaluate it rounds once more. `boundary`, `is_unique`,
    `collar` and `tried` are those of `SlowTube`.
    """

    manifold: SampledManifold

    @property
    def epsilon(self) -> float:
        """The epsilon that the manifold was solved for."""
        return self.manifold.epsilon

    def __str__(self) -> str:
        at = f" at {self.manifold.branch.system.epsilon.name} = {as_given(self.epsilon)}"
        return self._card(
            at, [f"|y - p| <= {at_most(self.delta)}, p being the interpolant that was solved for"]
        )


def certify_solved(
    manifold: SampledManifold,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> SolvedTube:
    """Prove in ball arithmetic that a slow manifold lies in a tube about the interpolant of `manifold`.

    `region` lies in that of the manifold and may be smaller; intervals for fast variables in it choose a sheet only,
    and nothing hangs on them. `epsilon` is the manifold's or None. Each test of a tube may try `most_boxes` boxes.
    `progress` is called with the share of the search that is done. The theorems are in docs/slow-tubes.md.

    Raises `DeclarationError` for another epsilon, a region beyond the manifold's, several slow variables, or a manifold
    without a surface, `UnsupportedFunctionError` for a function without an enclosure.
    """
    system, surface = manifold.branch.system, manifold.surface
    most_boxes = check_whole(most_boxes, what="most_boxes", least=1)
    check_progress(progress)
    if len(system.x) != 1:
        raise DeclarationError(
            "a tube about a solved manifold is proved over one slow variable.",
            "Take certify(series), which proves one for several.",
            got=len(system.x),
        )
    if surface is None:
        raise DeclarationError(
            "a tube is proved about a surface, and this manifold has none.",
            "Lower epsilon, or shrink the region, and solve it again.",
            got=f"the status {manifold.status.name}",
            value=manifold.status.name,
        )
    if epsilon is not None and check_epsilon(epsilon) != manifold.epsilon:
        raise DeclarationError(
            f"the manifold was solved for epsilon = {manifold.epsilon!r}.",
            "Leave epsilon out, or solve it for that one.",
            got=f"{epsilon!r}",
            value=epsilon,
        )
    names = [s.name for s in system.x]
    checked = check_region(region, [s.name for s in system.states], required=names)
    sides = rounded_sides(region, checked)
    box = {name: sides[name][0] for name in names}
    for (name, (low, high)), (first, last) in zip(box.items(), surface.box.tolist()):
        if low < first or high > last:
            raise DeclarationError(
                f"the manifold was solved over {name} in [{first!r}, {last!r}].",
                "Shrink the region, or solve it over a larger one.",
                got=f"[{low!r}, {high!r}]",
            )
    with precision(balls.PRECISION):
        return _proved(manifold, surface, box, Tally(most_boxes, shown=SearchProgress(progress)))


def _proved(
    manifold: SampledManifold, surface: ChebyshevSurface, box: dict[str, tuple[float, float]], tally: Tally
) -> SolvedTube:
    result = SolvedTube(manifold=manifold, region=box)
    tally.shown.part(0.0, 0.9)
    low, high = (math.nextafter(manifold.epsilon, toward) for toward in (0.0, math.inf))
    found: ProvedTube | None = None
    try:
        for basis in _bases(manifold, surface, box):
            flow = SolvedFlow(manifold, basis.matrix)
            region: Box = tuple(box.values())
            tube = TubeSearch(flow, basis, region, tally, first=low).least(high)
            if tube is not None and (found is None or tube.cones):
                found = tube
            if found is not None and found.cones:
                break
        if tally.spent:
            result = replace(result, reason=f"{result.reason}; a test spent its {tally.most} boxes")
    except KeyboardInterrupt:
        if found is None:
            result = replace(result, reason="interrupted; nothing was proved by then")
    if found is None:
        return replace(result, tried=tally.tried)
    tally.shown.part(0.9, 1.0)
    narrowed = found.problem.narrowed(found)
    tally.shown.reached(1.0)
    return result._with(narrowed, manifold.branch.system.y, arb(1), tried=tally.tried)


def _bases(
    manifold: SampledManifold, surface: ChebyshevSurface, box: dict[str, tuple[float, float]]
) -> Iterator[AdaptedBasis]:
    """Constant bases in which D_y g parts on the surface in the middle of the region."""
    system = manifold.branch.system
    values = {p: without_decimals(v) for p, v in system.parameters.items()}
    g = [without_decimals(e.xreplace(values)) for e in system.g]
    x = np.array([[0.5 * sum(side) for side in box.values()]])
    point = [*x[0], *surface(x)[0], manifold.epsilon]
    at = dict(zip((*system.x, *system.y, system.epsilon), map(sp.Rational, point)))
    return adapted_bases(jacobian(g, system.y), (), [at])
