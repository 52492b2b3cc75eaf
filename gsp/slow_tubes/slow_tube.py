"""How small is small enough: a tube around the series of a slow manifold, proved for all epsilon up to a bound.

`invariance` forms the flow about the series exactly, `isolation` tests a tube; here the tube and epsilon_0 are looked
for, by sampling and bisection, and what is found is stated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import sympy as sp
from flint import arb

from gsp.algebra.precision import precision
from gsp.errors import DeclarationError
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.certification import MOST_BOXES
from gsp.proofs.equations import without_decimals
from gsp.proofs.search_progress import SearchProgress
from gsp.proofs.sides import rounded_sides, written
from gsp.results.bounds import at_least, at_most
from gsp.slow.series import SeriesManifold, expand
from gsp.slow_tubes.adapted_basis import AdaptedBasis, adapted_bases, fast_jacobian
from gsp.slow_tubes.invariance import Invariance, NotInvariantError
from gsp.slow_tubes.isolation import Tally, norm
from gsp.slow_tubes.tube import Tube
from gsp.slow_tubes.tube_search import Cones, ProvedTube, TubeSearch, supremum
from gsp.systems.arguments import check_progress, check_whole
from gsp.systems.flow import check_epsilon
from gsp.systems.region import check_region
from gsp.systems.scattered_points import halton

# epsilon_0 is the largest at which a tube of so many times the first term left out is proved: a tube may be isolating
# and say nothing when it is wide.
LARGEST_RATIO = 2.0
# It is found to this share.
RESOLUTION = 1.02


@dataclass(frozen=True, eq=False)
class TubeProof:
    """What a proof of a tube rests on: its basis, the widths of its blocks and the cones."""

    basis: AdaptedBasis
    widths: np.ndarray
    cones: tuple[Cones, ...]


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SlowTube(Tube):
    """What is proved of a slow manifold near `series` over `region`, for every epsilon in (0, `epsilon_0`].

    - PROVED: the tube |y - h_n| <= c epsilon^(n+1) is isolating, and the cone conditions hold in it, so that a slow
      manifold lies in it; `statement` says what follows. `delta` bounds |y - h_n| at epsilon_0 (Euclidean), `widths`
      each fast variable's part of it, `ratio` is delta over the largest first term left out, infinite where that is 0.
    - REFUTED: the series does not solve the invariance equation; proved.
    - UNDECIDED: neither; `is_isolating` and `has_cones` say what was proved of the tube, if there is one.

    `boundary` is "overflowing" where the slow flow is proved to leave through every side of the region, "inflowing"
    where it enters through every side, else "mixed". `is_unique` where it is overflowing and all fast directions are
    stable, or inflowing and all are unstable: no other locally invariant manifold lies in the tube. Else the one that
    is proved to exist is invariant off a collar of width `collar` at the sides, of the order epsilon_0 |f|/gap, and
    others may lie outside the tube. `tried` boxes were looked at.
    """

    series: SeriesManifold
    epsilon_0: float = math.nan
    ratio: float = math.nan
    _proof: TubeProof | None = None

    def save(self, path: str | Path) -> None:
        """Write the proof as JSON, which `gsp verify` checks; raises `GspError` unless the verdict is PROVED.

        Near the border of what can be proved the file claims a little less: a wider tube or a smaller epsilon_0.
        """
        from gsp.slow_tubes.tube_file import write

        write(self, Path(path))

    def __str__(self) -> str:
        small, n = self.series.branch.system.epsilon.name, self.series.order
        sentences = [
            f"for every {small} in (0, {at_least(self.epsilon_0)}], with h through order {n}",
            f"|y - h| <= {at_most(self.delta)} at {small} = {at_least(self.epsilon_0)}, and in proportion to "
            f"{small}^{n + 1} below",
        ]
        if self.ratio < math.inf:
            # A bound over a bound, which is itself up to a share of SUPREMUM too large.
            sentences.append(f"that is about {self.ratio:.3g} times the largest first term left out")
        return self._card("", sentences)


def certify_tube(
    series: SeriesManifold,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> SlowTube:
    """Prove in ball arithmetic that a slow manifold lies in a tube about `series`, for all epsilon in (0, `epsilon`].

    Without an `epsilon`, the largest epsilon_0 is looked for at which a tube of at most `LARGEST_RATIO` times the first
    term left out is proved. `region` gives every slow variable an interval, and parameters too, which then stand for
    all their values. Each test of a tube may try `most_boxes` boxes. `progress` is called with the share of the search
    that is done. Ctrl-C returns what is proved by then. The theorems are in docs/slow-tubes.md.

    Raises `DeclarationError` for a region that is not one or an implicit branch, `UnsupportedFunctionError` for a field
    that is not rational in the fast variables and epsilon.
    """
    branch = series.branch
    if not branch.is_explicit:
        raise DeclarationError(
            "a tube is proved about an explicit series.",
            "Take certify(solve_manifold(...)), which proves a tube at one epsilon, or certify(branch).",
            got=f"the implicit branch {branch}",
            value=branch,
        )
    most_boxes = check_whole(most_boxes, what="most_boxes", least=1)
    check_progress(progress)
    if epsilon is not None:
        epsilon = written(epsilon, check_epsilon(epsilon))[1]
    system = branch.system
    slow = [s.name for s in system.x]
    checked = check_region(region, [*slow, *(p.name for p in system.parameters)], required=slow)
    box = {name: outwards for name, (outwards, _) in rounded_sides(region, checked).items()}
    with precision(balls.PRECISION):
        return _TubeSearch(series, box, most_boxes, SearchProgress(progress)).result(epsilon)


class _TubeSearch:
    """Tubes about one series over one region."""

    def __init__(
        self,
        series: SeriesManifold,
        box: dict[str, tuple[float, float]],
        most_boxes: int,
        shown: SearchProgress | None = None,
    ) -> None:
        self.series, self.box = series, box
        self.tally = Tally(most_boxes, shown=shown or SearchProgress())
        system = series.branch.system
        self.x = (*system.x, *(p for p in system.parameters if p.name in box))
        self.values = {p: without_decimals(v) for p, v in system.parameters.items() if p not in self.x}
        self.best: ProvedTube | None = None

    def result(self, epsilon: float | None) -> SlowTube:
        """The search, and its outcome as it is reported."""
        nothing = SlowTube(series=self.series, region=self.box)
        reason = nothing.reason
        try:
            problems = self._problems()
            if epsilon is None:
                self._largest(problems)
            else:
                self._least(problems, epsilon)
            if self.best is None and problems:
                small = self.series.branch.system.epsilon.name
                reason = problems[0].why_none(epsilon or 0.0, small, [s.name for s in self.x])
            if self.tally.spent:
                reason += f"; a test spent its {self.tally.most} boxes"
        except NotInvariantError as error:
            verdict, reason = error.verdict_at(self.series.branch.system.epsilon, self._points())
            return replace(nothing, verdict=verdict, reason=reason)
        except KeyboardInterrupt:
            reason = "interrupted; nothing was proved by then"
        if self.best is None:
            return replace(nothing, reason=reason, tried=self.tally.tried)
        self.tally.shown.part(0.9, 1.0)
        found = self._stated(nothing, self.best.problem.narrowed(self.best))
        self.tally.shown.reached(1.0)
        return found

    def _points(self) -> Iterator[list[arb]]:
        """Some points of the region."""
        low, high = np.array([self.box[s.name] for s in self.x]).T
        # Points at which what is left of a residual is looked at.
        for point in low + halton(len(low), 8) * (high - low):
            yield [arb(float(v)) for v in point]

    # -- what is looked for ------------------------------------------------------------------------

    def _problems(self) -> list[TubeSearch]:
        matrix = fast_jacobian(self.series.branch, self.values).applyfunc(sp.cancel)
        middle = {s: sp.Rational(0.5 * sum(self.box[s.name])) for s in self.x}
        parameters = self.x[len(self.series.branch.system.x) :]
        region = tuple(self.box[s.name] for s in self.x)
        return [
            TubeSearch(
                Invariance(self.series, parameters=parameters, values=self.values, basis=basis.matrix),
                basis,
                region,
                self.tally,
            )
            for basis in adapted_bases(matrix, self.x, [middle])
        ]

    def _least(self, problems: list[TubeSearch], epsilon: float) -> None:
        """The least tube at `epsilon`, with cones rather than without."""
        self.tally.shown.part(0.0, 0.9)
        for problem in problems:
            self._keep(problem.least(epsilon))
            if self.best is not None and self.best.cones:
                return

    def _largest(self, problems: list[TubeSearch]) -> None:
        for problem in problems:
            good, bad, small = 0.0, math.inf, 0.125
            known: ProvedTube | None = None
            self.tally.shown.part(0.0, 0.8)
            # A system at this epsilon has no two time scales; the search ends there.
            while small <= 4.0 and small > 1e-9 and not bad <= good * RESOLUTION:
                self.tally.shown.bracketed(good, bad, RESOLUTION)
                tube = problem.within(small, LARGEST_RATIO, known)
                if tube is not None:
                    self._keep(tube)
                    good, known = small, tube
                else:
                    bad = small
                small = (
                    2.0 * good if bad == math.inf else (0.25 * bad if good == 0.0 else math.sqrt(good * bad))
                )
            if self.best is not None:
                self.tally.shown.part(0.8, 0.9)
                self._keep(problem.least(self.best.epsilon, self.best))
                return

    def _keep(self, tube: ProvedTube | None) -> None:
        if tube is not None and (self.best is None or tube.cones or not self.best.cones):
            self.best = tube

    # -- what is reported --------------------------------------------------------------------------

    def _stated(self, nothing: SlowTube, tube: ProvedTube) -> SlowTube:
        problem, following = tube.problem, self._next_term()
        size = balls.magnitude(norm([arb(v) for v in problem.half_widths(tube.widths)]))
        return nothing._with(
            tube,
            self.series.branch.system.y,
            balls.power(arb(tube.epsilon), self.series.order + 1),
            epsilon_0=tube.epsilon,
            ratio=size / following if following > 0.0 else math.inf,
            tried=self.tally.tried,
            _proof=TubeProof(problem.basis, tube.widths, tube.cones),
        )

    def _next_term(self) -> float:
        """The supremum of |h_(n+1)| over the region."""
        order = self.series.order + 1
        following = expand(
            self.series.branch, order=order, symbolic=len(self.x) > len(self.series.branch.system.x)
        )
        h = BallFunction(self.x, [e.xreplace(self.values) for e in following.coefficients[order]])
        return supremum(lambda x: norm(h(x)), tuple(self.box[s.name] for s in self.x))
