"""The failure map: where in (epsilon, position) and in (epsilon, tolerance) each method holds, every claim measured.

Over positions along one slow axis every method is run from the point of the slow manifold there, for a short piece of
slow time, and compared with a full run at a tight tolerance. Over tolerances the reduced models are run from the
scene's start over its whole span. Nothing is inferred from eigenvalues or from estimates: a cell says what happened.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from gsp.comparison import compare, sense
from gsp.errors import DeclarationError, GspError, nearest
from gsp.flow import Flow, check_epsilon
from gsp.integrators import Method
from gsp.lowering import finite_rows
from gsp.placement import Placement, place
from gsp.reduced import restrict
from gsp.sampling import Sampler
from gsp.scene import Scene
from gsp.series import SeriesManifold, expand
from gsp.slow_points import zero_derivative
from gsp.tables import write_rows
from gsp.trajectory import Trajectory, integrate

ORDERS = (0, 1, 2, 3)
# Cells of the maps, unless asked for otherwise.
EPSILONS, POSITIONS, TOLERANCES = 17, 41, 15
# Epsilons reach so far beyond the scene's ladder on both sides, positions so many widths beyond its region.
BEYOND, WIDENED = 10.0, 0.5
# Share of the span for which a run follows a position.
HORIZON = 0.04
# The full run that everything is compared with.
RTOL, ATOL = 1e-11, 1e-13
# Explicit steps against implicit ones: with so many times the field calls stability holds them back.
RIVALS, WASTE = (Method.RADAU9, Method.DOP853), 4.0
MAX_STEPS = 20_000
LOOSEST, TIGHTEST = 1e-1, 1e-12

MANIFOLD = "slow manifold"
NEWTON = "Newton's method"
EXPLICIT = "explicit steps"
IMPLICIT = "implicit steps"


@dataclass(frozen=True, eq=False, repr=False)
class Claim:
    """What one method did: `measure` (n_epsilons, n_columns), which holds where it is at most `bound` and finite.

    `requirement` says what was measured. NaN stands for "could not be run here", which does not hold.
    """

    method: str
    requirement: str
    measure: np.ndarray
    bound: float | np.ndarray

    @property
    def holds(self) -> np.ndarray:
        """Booleans (n_epsilons, n_columns)."""
        with np.errstate(invalid="ignore"):
            return np.isfinite(self.measure) & (self.measure <= self.bound)

    @property
    def share(self) -> float:
        """Share of the cells in which it holds."""
        return float(self.holds.mean())

    def __repr__(self) -> str:
        return f"Claim({self.method}: holds in {100 * self.share:.0f} % of {self.measure.size} cells)"


@dataclass(frozen=True, eq=False, repr=False)
class FailureMap:
    """Where each method holds for one scene.

    `epsilons` (k,) ascend. `places[method]` are claims over `positions` (m,) along the slow variable `axis`, the
    others at the scene's start, at `tolerance`; `demands[method]` claims over `tolerances` (l,), descending, from the
    scene's start over its whole span. `best_order` (k, m) is the order at which the series came nearest to the slow
    manifold, -1 where there is none: above it the series is past its optimal order. `runs` counts integrations.
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
                f"no position of the map lies between {between[0]:g} and {between[1]:g}. Got positions from "
                f"{self.positions[0]:g} to {self.positions[-1]:g}. Widen the interval."
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
                f"the map has the orders {', '.join(map(str, self.orders))}. Got {order!r}. Ask for one of them."
            )

    def as_rows(self) -> list[dict[str, object]]:
        """One dictionary for each cell and method, of numbers and text, for JSON or CSV."""
        return [
            {
                "map": name,
                "method": claim.method,
                "epsilon": float(e),
                "along": along,
                "at": float(c),
                "measure": float(claim.measure[i, j]),
                "holds": bool(claim.holds[i, j]),
            }
            for name, along, columns, claims in (
                ("position", self.axis, self.positions, self.places),
                ("tolerance", "tolerance", self.tolerances, self.demands),
            )
            for claim in claims.values()
            for i, e in enumerate(self.epsilons)
            for j, c in enumerate(columns)
        ]

    def write_csv(self, path: str | Path) -> Path:
        """Write the rows to `path`; raises `OutputError` when that cannot be done."""
        return write_rows(self.as_rows(), path)

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
            f"  from the scene's start, tolerances {self.tolerances[0]:.0e} to {self.tolerances[-1]:.0e}"
        )
        lines += [f"    {_row(claim, width)}" for claim in self.demands.values()]
        return "\n".join(lines)


def failure_map(
    scene: Scene,
    *,
    axis: str | None = None,
    positions: Sequence[float] | None = None,
    epsilons: Sequence[float] | None = None,
    tolerances: Sequence[float] | None = None,
    orders: Sequence[int] = ORDERS,
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
    - implicit steps: reach the end of the piece.

    `tolerance` is the scene's unless given. Raises `DeclarationError` for arguments that are not well formed, and what
    the stages raise for a scene that cannot be split, solved or expanded.
    """
    if not isinstance(scene, Scene):
        raise DeclarationError(
            f"failure_map takes a Scene. Got {type(scene).__name__}. Use gsp.models.load(name)."
        )
    wanted = tuple(sorted(set(orders)))
    if not wanted or any(isinstance(n, bool) or not isinstance(n, int) or n < 0 for n in wanted):
        raise DeclarationError(f"orders are non-negative integers. Got {orders!r}. Try (0, 1, 2, 3).")
    allowed = scene.tolerance if tolerance is None else check_epsilon(tolerance, what="tolerance")
    placement = place(scene)
    name = _axis(placement, axis)
    along = _positions(placement, name, positions)
    ladder = _epsilons(scene, epsilons)
    asked = _tolerances(tolerances)
    series = expand(placement.branch, order=max(wanted) + 1, symbolic=False)
    survey = _Survey(placement, series, name, along, ladder, wanted, allowed)
    for i in range(ladder.size):
        survey.visit(i)
        if progress is not None:
            progress(0.8 * (i + 1) / ladder.size)
    demands = _demands(placement, ladder, asked, wanted)
    if progress is not None:
        progress(1.0)
    return FailureMap(
        scene=scene,
        axis=name,
        epsilons=ladder,
        positions=along,
        tolerances=asked,
        tolerance=allowed,
        orders=wanted,
        places=survey.claims(),
        demands={claim.method: claim for claim in demands},
        best_order=survey.best_order,
        runs=survey.runs + ladder.size * (2 * asked.size + len(wanted) + 2),
    )


def reduced_name(order: int) -> str:
    """The name of the claim on the reduced flow of this order."""
    return f"reduced flow {order}"


def series_name(order: int) -> str:
    """The name of the claim on the series through this order."""
    return f"series {order}"


class _Survey:
    """Fills the maps over positions, one epsilon at a time."""

    def __init__(
        self,
        placement: Placement,
        series: SeriesManifold,
        axis: str,
        positions: np.ndarray,
        epsilons: np.ndarray,
        orders: tuple[int, ...],
        tolerance: float,
    ) -> None:
        self.placement = placement
        self.series = series
        self.epsilons = epsilons
        self.orders = orders
        self.tolerance = tolerance
        self.system = placement.system
        self.branch = placement.branch
        self.slow = [s.name for s in self.system.x]
        self.x = np.tile([placement.start[s] for s in self.slow], (positions.size, 1))
        self.x[:, self.slow.index(axis)] = positions
        self.y, self.there = self._sheet()
        span = placement.scene.span
        self.piece = sense(placement) * HORIZON * (span[1] - span[0])
        self.width = float(positions[-1] - positions[0])
        self.flows = {n: restrict(series, order=n) for n in orders}
        cells = (epsilons.size, positions.size)
        names = (NEWTON, MANIFOLD, *map(series_name, orders), *map(reduced_name, orders), EXPLICIT, IMPLICIT)
        self.measures = {name: np.full(cells, np.nan) for name in names}
        self.best_order = np.full(cells, -1)
        self.measures[NEWTON][:] = self._newton()
        self.runs = 0

    def _sheet(self) -> tuple[np.ndarray, np.ndarray]:
        """Points of M0 on the scene's sheet over the positions, and where there are any."""
        if self.branch.is_explicit:
            y = self.branch.graph_values(self.x, allow_complex=True)
            return y, finite_rows(y)
        return self.branch.follow(self.x)

    def _newton(self) -> np.ndarray:
        """Distance of what Newton's method finds from the scene's start from the sheet; nan where it finds nothing."""
        start = [self.placement.start[s.name] for s in self.system.y]
        result = np.full(len(self.x), np.nan)
        sampler = Sampler(self.branch)
        for j, (x, y) in enumerate(zip(self.x, self.y)):
            if not self.there[j]:
                continue
            found = newton(sampler, x, np.array(start))
            if found is not None:
                result[j] = np.abs(found - y).max() / (1.0 + np.abs(y).max())
        return result

    def visit(self, i: int) -> None:
        epsilon = float(self.epsilons[i])
        rows = np.flatnonzero(self.there)
        if rows.size == 0:
            return
        y = np.full_like(self.y, np.nan)
        points = zero_derivative(self.branch, self.x[rows], epsilon=epsilon, tolerance=1e-13, near=self.y[rows])
        y[rows] = points.y
        for j in map(int, rows):
            if np.isfinite(y[j]).all():
                self._series(i, j, y[j], epsilon)
                self._runs(i, j, y[j], epsilon)

    def _series(self, i: int, j: int, y: np.ndarray, epsilon: float) -> None:
        terms = self.series.terms(self.x[j][None, :], epsilon, near=self.y[j])[0]
        errors = np.abs(np.cumsum(terms, axis=0) - y).max(axis=1) / (1.0 + np.abs(y).max())
        for n in self.orders:
            self.measures[series_name(n)][i, j] = errors[n]
        if np.isfinite(errors).any():
            self.best_order[i, j] = int(np.nanargmin(errors))

    def _runs(self, i: int, j: int, y: np.ndarray, epsilon: float) -> None:
        start = dict(zip(self.slow, map(float, self.x[j])))
        full, explicit = (
            self._run(self.system, {**start, **_named(self.system.y, y)}, epsilon, method=method)
            for method in RIVALS
        )
        if full is None or not full.status.ok:
            return
        end = full.y[:, -1]
        nx = len(self.slow)
        self.measures[IMPLICIT][i, j] = full.stats.rejected / full.stats.steps
        if explicit is not None:
            self.measures[EXPLICIT][i, j] = (
                explicit.stats.field_calls / full.stats.field_calls if explicit.status.ok else np.inf
            )
        self.measures[MANIFOLD][i, j] = self._distance(end, epsilon)
        for n, flow in self.flows.items():
            reduced = self._run(flow, start, epsilon)
            if reduced is not None and reduced.status.ok:
                reached = np.array([reduced[name][-1] for name in self.slow])
                self.measures[reduced_name(n)][i, j] = np.abs(reached - end[:nx]).max() / self.width

    def _distance(self, z: np.ndarray, epsilon: float) -> float:
        """Distance in y of a state from the slow manifold, by the zero-derivative principle next to it."""
        nx = len(self.slow)
        try:
            found = zero_derivative(
                self.branch, z[None, :nx], epsilon=epsilon, tolerance=1e-13, near=z[None, nx:]
            )
        except GspError:
            return float("nan")
        return float(np.abs(found.y[0] - z[nx:]).max() / (1.0 + np.abs(z[nx:]).max()))

    def _run(
        self, flow: Flow, start: Mapping[str, float], epsilon: float, *, method: Method | None = None
    ) -> Trajectory | None:
        self.runs += 1
        try:
            return integrate(
                flow,
                start=start,
                span=(0.0, self.piece),
                epsilon=epsilon,
                rtol=RTOL,
                atol=ATOL,
                method=method,
                max_steps=MAX_STEPS,
            )
        except GspError:
            return None

    def claims(self) -> dict[str, Claim]:
        """The measures with what is asked of them."""
        asked = {
            NEWTON: ("distance from the sheet of what Newton's method finds from the scene's start", 1e-8),
            MANIFOLD: ("distance of a full run from the slow manifold it began on", self.tolerance),
            EXPLICIT: ("field calls of DOP853 to those of Radau IIA, order 9", WASTE),
            IMPLICIT: ("rejected steps to accepted ones, where the run reached its end", np.inf),
        }
        asked |= {
            series_name(n): ("distance of the series from the slow manifold", self.tolerance)
            for n in self.orders
        }
        asked |= {
            reduced_name(n): (
                "difference of the slow variables from the full run, over the axis' length",
                self.tolerance,
            )
            for n in self.orders
        }
        return {
            name: Claim(name, asked[name][0], values, asked[name][1]) for name, values in self.measures.items()
        }


def newton(sampler: Sampler, x: np.ndarray, y: np.ndarray, *, most: int = 50) -> np.ndarray | None:
    """Plain Newton's method for g(x, y, 0) = 0 in y from `y` (n_fast,) at fixed x; None when it does not converge."""
    nx = x.size
    for _ in range(most):
        z = np.concatenate([x, y])[None, :]
        value, slope = sampler.equilibria(z)[0], sampler.equilibria_jacobian(z)[0][:, nx:]
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return None
        try:
            step = np.linalg.solve(slope, value)
        except np.linalg.LinAlgError:
            return None
        y = y - step
        if np.abs(step).max() <= 1e-12 * (1.0 + np.abs(y).max()):
            return y
    return None


def _demands(
    placement: Placement, epsilons: np.ndarray, tolerances: np.ndarray, orders: tuple[int, ...]
) -> Iterator[Claim]:
    """Over (epsilon, tolerance): reduced flows against the full one over the span, and explicit against implicit."""
    cells = (epsilons.size, tolerances.size)
    errors = {n: np.full(cells, np.nan) for n in orders}
    ratios = np.full(cells, np.nan)
    try:
        found = compare(placement.scene, orders=orders, epsilons=tuple(map(float, epsilons)))
    except GspError:
        found = None
    if found is not None:
        for n in orders:
            by_epsilon = dict(zip(found.epsilons, found.errors[n]))
            errors[n][:] = np.array([by_epsilon[float(e)] for e in epsilons])[:, None]
    start, span = placement.start, placement.scene.span
    for i, epsilon in enumerate(epsilons):
        for j, tolerance in enumerate(tolerances):
            calls = []
            for method in RIVALS:
                run = integrate(
                    placement.system,
                    start=start,
                    span=span,
                    epsilon=float(epsilon),
                    rtol=tolerance,
                    atol=1e-2 * tolerance,
                    method=method,
                    max_steps=MAX_STEPS,
                )
                calls.append(run.stats.field_calls if run.status.ok else np.nan)
            ratios[i, j] = calls[1] / calls[0]
    for n in orders:
        text = "largest relative error of the slow variables over the span"
        yield Claim(reduced_name(n), text, errors[n], np.broadcast_to(tolerances, cells))
    yield Claim(EXPLICIT, "field calls of DOP853 to those of Radau IIA, order 9", ratios, WASTE)


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
    return f"{claim.method:<{width}}  {100 * claim.share:5.1f} %  {claim.requirement}"


def _named(symbols, values) -> dict[str, float]:
    return {s.name: float(v) for s, v in zip(symbols, values)}


def _axis(placement: Placement, axis: str | None) -> str:
    slow = [s.name for s in placement.system.x]
    bounded = [name for name in slow if name in placement.region]
    if axis is None:
        if not bounded:
            raise DeclarationError(
                f"the region bounds none of the slow variables {', '.join(slow)}. Bound one, "
                "or give axis and positions."
            )
        return bounded[0]
    if axis not in slow:
        raise DeclarationError(
            f"axis is a slow variable, one of {', '.join(slow)}. Got {axis!r}." + nearest(axis, slow)
        )
    return axis


def _positions(placement: Placement, axis: str, positions: Sequence[float] | None) -> np.ndarray:
    if positions is None:
        if axis not in placement.region:
            raise DeclarationError(f"the region gives no interval for {axis}. Bound it, or give positions.")
        low, high = placement.region[axis]
        return np.linspace(low - WIDENED * (high - low), high + WIDENED * (high - low), POSITIONS)
    values = np.unique(np.asarray(positions, dtype=float))
    if values.size < 2 or not np.isfinite(values).all():
        raise DeclarationError(f"positions are two finite numbers or more. Got {positions!r}.")
    return values


def _tolerances(tolerances: Sequence[float] | None) -> np.ndarray:
    if tolerances is None:
        return np.geomspace(LOOSEST, TIGHTEST, TOLERANCES)
    values = np.unique([check_epsilon(t, what="every tolerance") for t in tolerances])[::-1]
    if values.size < 2:
        raise DeclarationError(f"tolerances are two numbers or more. Got {tolerances!r}. Try (1e-2, 1e-6).")
    return values


def _epsilons(scene: Scene, epsilons: Sequence[float] | None) -> np.ndarray:
    if epsilons is None:
        return np.geomspace(scene.epsilons[-1] / BEYOND, scene.epsilons[0] * BEYOND, EPSILONS)
    values = np.unique([check_epsilon(e, what="every epsilon") for e in epsilons])
    if values.size < 2:
        raise DeclarationError(f"epsilons are two numbers or more. Got {epsilons!r}. Try (0.1, 0.01, 0.001).")
    return values
