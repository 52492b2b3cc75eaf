"""The failure map: where in (epsilon, position) and in (epsilon, tolerance) each method holds, every claim measured.

Over positions along one slow axis every method is run from the point of the slow manifold there, for a short piece of
slow time, and compared with a full run at a tight tolerance. Over tolerances the reduced models are run over
the scene's whole span, beside a full run, both begun on the slow manifold. Nothing is inferred from eigenvalues or
from estimates: a cell says what happened.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gsp.comparison.survey import Claim, Survey, demands_of, no_slip_along, reduced_name
from gsp.errors import DeclarationError, Named
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.systems.arguments import check_array, check_progress, shown
from gsp.systems.flow import check_epsilon, check_epsilons, check_orders

# Epsilons reach so far beyond the scene's ladder on both sides, positions so many widths beyond its region.
BEYOND, WIDENED = 10.0, 0.5
LOOSEST, TIGHTEST = 1e-1, 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class FailureMap(Drawn, Tabular):
    """Where each method holds for one scene.

    `epsilons` (k,) ascend. `places[method]` are claims over `positions` (m,) along the slow variable `axis`, the
    others at the scene's start, at `tolerance`; `demands[method]` claims over `tolerances` (l,), descending, over the
    scene's whole span. `best_order` (k, m) is the order at which the series came nearest to the slow
    manifold, the highest of those within rounding of it, -1 where there is none: above it the series is past its
    optimal order. `runs` counts integrations.
    """

    scene: Scene
    axis: str
    epsilons: np.ndarray
    positions: np.ndarray
    tolerances: np.ndarray
    tolerance: float
    orders: tuple[int, ...]
    places: Mapping[str, Claim]
    demands: Mapping[str, Claim]
    best_order: np.ndarray
    runs: int

    @property
    def least_order(self) -> np.ndarray:
        """The lowest order whose reduced flow holds in each cell (k, m); -1 where none does."""
        return _least(self.places, self.orders)

    @property
    def least_order_demanded(self) -> np.ndarray:
        """The same over tolerances (k, l)."""
        return _least(self.demands, self.orders)

    @property
    def unmeasured(self) -> str:
        """Why no reduced flow was compared over the span, as when all end before it does; empty where one was."""
        claims = [self.demands[reduced_name(n)] for n in self.orders]
        if any(claim.is_measured for claim in claims):
            return ""
        return next((claim.reason for claim in claims if claim.reason), "no run reached the end of the span")

    def holds_up_to(self, order: int, *, between: tuple[float, float]) -> float:
        """The largest of `epsilons` up to which the reduced flow of `order` holds at all positions in the interval.

        Zero when it does not hold at the smallest. Positions count as inside to rounding. Raises `DeclarationError` for
        an order that is not in the map, and when no position is in the interval.
        """
        self._require(order)
        slack = 1e-9 * float(np.ptp(self.positions))
        inside = (self.positions >= between[0] - slack) & (self.positions <= between[1] + slack)
        if not inside.any():
            raise DeclarationError(
                f"no position of the map lies between {between[0]:g} and {between[1]:g}.",
                "Widen the interval.",
                got=f"positions from {self.positions[0]:g} to {self.positions[-1]:g}",
            )
        return _up_to(self.epsilons, np.all(self.places[reduced_name(order)].holds[:, inside], axis=1))

    def holds_over_span(self, order: int, *, tolerance: float | None = None) -> float:
        """The largest of `epsilons` up to which it meets `tolerance`, the map's own unless given, over the span."""
        self._require(order)
        bound = self.tolerance if tolerance is None else tolerance
        errors = self.demands[reduced_name(order)].measure[:, 0]
        with np.errstate(invalid="ignore"):
            holds = np.isfinite(errors) & (errors <= bound)
        return _up_to(self.epsilons, holds)

    def _require(self, order: int) -> None:
        if order not in self.orders:
            raise DeclarationError(
                f"the map has the orders {', '.join(map(str, self.orders))}.",
                "Ask for one of them.",
                got=f"{order!r}",
                value=order,
            )

    def __repr__(self) -> str:
        return (
            f"FailureMap({self.scene.name}: {self.epsilons.size} epsilons, {self.positions.size} positions along "
            f"{self.axis}, {self.runs} runs)"
        )

    def __str__(self) -> str:
        width = max(map(len, (*self.places, *self.demands)))
        lines = [
            f"where methods hold: {self.epsilons.size} epsilons from {self.epsilons[0]:.2g} to "
            f"{self.epsilons[-1]:.2g}, {self.runs} runs",
            f"  along {self.axis} from {self.positions[0]:.4g} to {self.positions[-1]:.4g}, "
            f"tolerance {self.tolerance:g}",
        ]
        lines += [f"    {_row(claim, width)}" for claim in self.places.values()]
        lines.append(
            f"  over the scene's span, tolerances {self.tolerances[0]:.0e} to {self.tolerances[-1]:.0e}"
        )
        lines += [f"    {_row(claim, width)}" for claim in self.demands.values()]
        if self.unmeasured:
            lines.append(f"    no reduced flow could be measured over the span: {self.unmeasured}")
        return "\n".join(lines)


def failure_map(
    scene: Scene | Study,
    *,
    axis: str | None = None,
    positions: Sequence[float] | None = None,
    epsilons: Sequence[float] | None = None,
    tolerances: Sequence[float] | None = None,
    orders: Sequence[int] = (0, 1, 2, 3),
    tolerance: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> FailureMap:
    """Run every method over a grid of epsilons, positions and tolerances, and note where it holds.

    `positions` are values of the slow variable `axis` (the first that the region bounds), by default over its interval
    and half as much on either side; `epsilons` by default reach ten times beyond the scene's ladder; `tolerances` go
    from 1e-1 to 1e-12. The methods:

    - Newton's method for M0, from the fast variables at the scene's start: reaches the branch's own sheet;
    - the slow manifold, by the zero-derivative principle: a full run from it stays on it to `tolerance`;
    - the series through each of `orders`: is as near to the slow manifold as `tolerance`;
    - the reduced flow of each order: its slow variables, over a piece of the span, agree with the full run;
    - explicit steps (DOP853): take at most four times the field calls of implicit ones (Radau IIA of order 9);
    - implicit steps: reach the end of the piece;
    - no-slip, where contacts have dry friction: none lets go along the piece.

    `tolerance` is the scene's unless given. Raises `DeclarationError` for arguments that are not well formed, and what
    the stages raise for a scene that cannot be split, solved or expanded.
    """
    study = study_of(scene, verb="failure_map")
    scene = study.scene
    valid_orders = tuple(sorted(set(check_orders(orders))))
    check_progress(progress)
    allowed = scene.tolerance if tolerance is None else check_epsilon(tolerance, what="tolerance")
    ladder = np.geomspace(scene.epsilons[-1] / BEYOND, scene.epsilons[0] * BEYOND, 17)
    if epsilons is not None:
        ladder = _two_or_more(epsilons, "epsilon", "Try (0.1, 0.01, 0.001).")
    checked_tolerances = np.geomspace(LOOSEST, TIGHTEST, 15)
    if tolerances is not None:
        checked_tolerances = _two_or_more(tolerances, "tolerance", "Try (1e-2, 1e-6).")[::-1]
    name = _axis(study, axis)
    along = _positions(study, name, positions)
    series = study.short_series(max(valid_orders) + 1, at_least=max(valid_orders))
    survey = Survey(study, series, name, along, ladder, valid_orders, allowed)
    show = (lambda share: None) if progress is None else progress
    along_positions = 0.8
    for i in range(ladder.size):
        survey.visit(i)
        show(along_positions * (i + 1) / ladder.size)
    demands = demands_of(
        study,
        ladder,
        checked_tolerances,
        valid_orders,
        lambda share: show(along_positions + (1.0 - along_positions) * share),
    )
    return FailureMap(
        scene=scene,
        axis=name,
        epsilons=ladder,
        positions=along,
        tolerances=checked_tolerances,
        tolerance=allowed,
        orders=valid_orders,
        places=Named(survey.claims() | no_slip_along(study, survey)),
        demands=Named({claim.method: claim for claim in demands}),
        best_order=survey.best_order,
        runs=survey.runs + ladder.size * (2 * checked_tolerances.size + len(valid_orders) + 2) + 1,
    )


def _up_to(epsilons: np.ndarray, holds: np.ndarray) -> float:
    """The largest epsilon below which all hold; zero when the smallest does not."""
    count = int(np.argmin(holds)) if not holds.all() else holds.size
    return float(epsilons[count - 1]) if count else 0.0


def _least(claims: Mapping[str, Claim], orders: tuple[int, ...]) -> np.ndarray:
    result: np.ndarray | None = None
    for n in reversed(orders):
        holds = claims[reduced_name(n)].holds
        result = np.where(holds, n, np.full(holds.shape, -1) if result is None else result)
    assert result is not None
    return result


def _row(claim: Claim, width: int) -> str:
    share = f"{100 * claim.share:5.1f} %" if claim.is_measured else "      -"
    return f"{claim.method:<{width}}  {share}  {claim.requirement}"


def _axis(study: Study, axis: str | None) -> str:
    slow = [s.name for s in study.system.x]
    bounded = [name for name in slow if name in study.region]
    if axis is None:
        if not bounded:
            raise DeclarationError(
                f"the region bounds none of the slow variables {', '.join(slow)}.",
                "Bound one, or give axis and positions.",
            )
        return bounded[0]
    if not isinstance(axis, str) or axis not in slow:
        raise DeclarationError(
            f"axis is a slow variable, one of {', '.join(slow)}.", got=shown(axis), value=axis, known=slow
        )
    return axis


def _positions(study: Study, axis: str, positions: Sequence[float] | None) -> np.ndarray:
    if positions is None:
        if axis not in study.region:
            raise DeclarationError(f"the region gives no interval for {axis}.", "Bound it, or give positions.")
        low, high = study.region[axis]
        return np.linspace(low - WIDENED * (high - low), high + WIDENED * (high - low), 41)
    be = "two finite numbers or more"
    given = check_array(positions, what="positions", be=be)
    values = np.unique(given)
    if given.ndim != 1 or values.size < 2 or not np.isfinite(values).all():
        raise DeclarationError(f"positions are {be}.", got=shown(positions), value=positions)
    return values


def _two_or_more(values: Sequence[float], what: str, remedy: str) -> np.ndarray:
    """The different ones, ascending."""
    found = np.unique(check_epsilons(values, what=what))
    if found.size < 2:
        raise DeclarationError(f"{what}s are two numbers or more.", remedy, got=shown(values), value=values)
    return found
