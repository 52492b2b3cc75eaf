"""Comparison: reduced flows of several orders against full trajectories, over a ladder of epsilons.

The full system starts on M_epsilon over the scene's slow start, so that no initial layer is crossed. A reduced
field through order N is then in error by O(epsilon^(N+1)) on a time span that does not depend on epsilon.
On a repelling branch both run backward in time.
With a correction it starts anywhere, and the reduced runs at the base point of the fast fibre through that start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from gsp.critical.sampling import Sampler
from gsp.errors import DeclarationError, GspError, HyperbolicityError, Status
from gsp.fibres.inner_expansion import InnerExpansion, expand_inner
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.nested.nesting import Nesting
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.slow.series import SeriesManifold, best_sum
from gsp.systems.arguments import check_progress
from gsp.systems.flow import check_epsilons, check_order, check_orders
from gsp.systems.system import VectorField
from gsp.systems.tolerances import absolute_tolerance

# The grid on which errors are measured, and the tolerances of the runs compared.
GRID_POINTS = 49
RTOL = 1e-12
# A second full run at this many times the tolerance shows how far the reference itself can be trusted: its error is
# about proportional to the tolerance, so so many times smaller than the difference, and never below rounding.
CHECK = 10.0
ROUNDING = 4 * np.finfo(float).eps
# Errors must stand this far above the reference's own error to enter a slope.
CLEARANCE = 30.0


@dataclass(frozen=True, eq=False)
class Comparison(Drawn, Tabular):
    """Errors of the reduced flows, measured.

    `errors[N][i]` is the largest error of the order-N run at `epsilons[i]` over the grid, each slow variable
    relative to its largest value; `slopes[N]` is the fitted power of epsilon, nan when every error is at rounding
    (the reduction is exact there); `expected[N]` is N + 1, or min(N, k) + 1 with the start corrected through
    epsilon^k, k = `correction`. `floor[i]` estimates the reference's own error. The same for rival reduced fields
    of the scene in `claims` and `claim_slopes`. `ending` says why the highest orders asked for are left out, where the
    exact algebra did not reach them. `begins` says where both runs begin, where that is not over the slow start.
    """

    scene: Scene
    epsilons: tuple[float, ...]
    errors: Mapping[int, tuple[float, ...]]
    slopes: Mapping[int, float]
    expected: Mapping[int, int]
    floor: tuple[float, ...]
    statuses: Mapping[int, tuple[Status, ...]]
    claims: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    claim_slopes: Mapping[str, float] = field(default_factory=dict)
    correction: int | None = None
    ending: str = ""
    begins: str = ""

    def is_exact(self, order: int) -> bool:
        """Whether every error of this order is within the reference's own error."""
        return all(e <= CLEARANCE * f for e, f in zip(self.errors[order], self.floor))

    def __repr__(self) -> str:
        slopes = ", ".join(f"{n}: {s:.3g}" for n, s in self.slopes.items())
        return f"Comparison({self.scene.name}, slopes {{{slopes}}})"

    def __str__(self) -> str:
        head = "  order  slope  expected  " + "  ".join(f"{e:>9.3g}" for e in self.epsilons)
        rows = [
            f"  {n:5d}  {self.slopes[n]:5.2f}  {self.expected[n]:8d}  "
            + "  ".join(f"{e:9.2e}" for e in self.errors[n])
            for n in self.errors
        ]
        rows += [
            f"  {name}: slope {self.claim_slopes[name]:.2f}  " + "  ".join(f"{e:9.2e}" for e in values)
            for name, values in self.claims.items()
        ]
        if self.begins:
            start = self.begins
        elif self.correction is None:
            start = "both runs begin on the slow manifold, over the scene's slow start"
        else:
            base = f"the reduced one at its base point through epsilon^{self.correction}"
            start = f"the full run begins off the slow manifold, {base}"
        title = (
            f"largest relative error of the reduced run, by {self.scene.system.epsilon or 'epsilon'}; {start}"
        )
        ending = [f"  {self.ending}"] if self.ending else []
        return "\n".join([title, head, *rows, *self._missing(), *ending])

    def _missing(self) -> list[str]:
        """Lines that say why errors or slopes are no numbers."""
        ended: dict[Status, list[str]] = {}
        for n, statuses in self.statuses.items():
            for status in dict.fromkeys(s for s in statuses if not s.ok):
                where = [f"{e:.3g}" for e, s in zip(self.epsilons, statuses) if s is status]
                everywhere = len(where) == len(self.epsilons)
                ended.setdefault(status, []).append(f"{n} at {'each' if everywhere else ', '.join(where)}")
        lines = [f"  nan of order {'; '.join(w)}: a run ended early, {status}" for status, w in ended.items()]
        without = [n for n in self.errors if not np.isfinite(self.slopes[n])]
        if exact := [str(n) for n in without if self.is_exact(n)]:
            lines.append(f"  no slope of order {', '.join(exact)}: the errors are within the reference's own")
        if short := [str(n) for n in without if not self.is_exact(n)]:
            lines.append(
                f"  no slope of order {', '.join(short)}: fewer than two errors stand clear of the reference's"
            )
        return lines


def compare(
    scene: Scene | Study | Nesting,
    *,
    orders: Sequence[int] = (0, 1, 2, 3),
    epsilons: Sequence[float] | None = None,
    correction: int | None = None,
    progress: Callable[[float], object] | None = None,
) -> Comparison:
    """Error of the reduced flow of each order against the full system, over the scene's ladder of epsilons.

    Without `correction` both start on M_epsilon over the scene's slow start, or over its base point through order 1
    where all errors are rounding there, as they are where the slow start is at rest; on a repelling branch they run
    backward in time, and on one of saddle type a full run leaves the manifold either way, which the errors show. With
    it the full system starts at the scene's own start, off the manifold, and the reduced runs at the base point of the
    fast fibre through it, through the power `correction` of epsilon; errors are measured outside the layer, from
    (M + 3) epsilon/gap ln(1/epsilon) on, M = min(correction, highest order). With 0 only the slow coordinates are kept.

    Of a `Nesting` the flows through the total order N in its two small parameters are compared with the whole system,
    over sigma, which scales both; orders below that of its series are, and there is no `correction`. In one of the two
    alone compare `nesting.alone[name]`.

    A run that stops early gives nan for its epsilon, and its `Status` is kept. Orders that the exact algebra does not
    reach are left out, and `ending` says why; it is an error where it reaches none of them. Raises what the stages
    before raise for a scene that cannot be split, solved or expanded, and what `project` raises for a start without a
    base point; `DeclarationError` when the layer takes more than half of the span.
    """
    nesting = scene if isinstance(scene, Nesting) else None
    study = study_of(scene.second if isinstance(scene, Nesting) else scene, verb="compare")
    scene = study.scene
    valid_orders = tuple(dict.fromkeys(check_orders(orders)))
    ladder = scene.epsilons if epsilons is None else tuple(sorted(check_epsilons(epsilons), reverse=True))
    if not ladder:
        raise DeclarationError("epsilons has no value.", "Give one or more, such as (0.02, 0.01).")
    if correction is not None:
        check_order(correction, what="correction")
    check_progress(progress)
    if nesting is not None:
        valid_orders = _below(nesting, valid_orders, correction)
    reached, ending = study.run_within_budget(max(valid_orders))
    reached_orders = tuple(n for n in valid_orders if n <= reached.order)
    if not reached_orders:
        # Says which order was reached, and what helps.
        study.run_series(min(valid_orders))
    # One order more than compared: an error in the start of the fast variable is felt one order later still.
    series = study.short_series(max(reached_orders) + 1, at_least=max(reached_orders))
    flows = {n: study.reduced(n, reconstructed=False) for n in reached_orders}
    rivals = _rivals(scene, study)
    inner = None if correction is None else _inner(study, correction)
    direction = sense(study)
    full, slow = (
        (study.system, [x.name for x in study.system.x]) if nesting is None else (nesting.ray, nesting.watched)
    )
    expected = {n: 1 + (n if correction is None else min(n, correction)) for n in reached_orders}

    def measured(origin: Mapping[str, float], begins: str = "") -> Comparison:
        errors: dict[int, list[float]] = {n: [] for n in reached_orders}
        statuses: dict[int, list[Status]] = {n: [] for n in reached_orders}
        claimed: dict[str, list[float]] = {name: [] for name in rivals}
        floor: list[float] = []
        for i, epsilon in enumerate(ladder):
            if inner is None:
                start = slow_start = on_manifold(series, origin, epsilon)
                first = scene.span[0]
                last = first + direction * (scene.span[1] - first)
            else:
                start = study.start
                slow_start = {
                    n: sum(float(c) * epsilon**k for k, c in enumerate(b)) for n, b in inner.base.items()
                }
                first = scene.span[0] + layer_time(inner, scene, epsilon, max(reached_orders))
                last = scene.span[1]
            grid = np.linspace(first, last, GRID_POINTS)
            begin = start if nesting is None else nesting.whole(start, epsilon)
            if not np.isfinite([*begin.values(), *slow_start.values()]).all():
                # At so large an epsilon the series leads out of the domain of what it stands in.
                floor.append(ROUNDING)
                for n in flows:
                    errors[n].append(float("nan"))
                    statuses[n].append(Status.SERIES_ENDS)
                for name in rivals:
                    claimed[name].append(float("nan"))
                continue
            reference = run_on(full, begin, scene, epsilon, grid)
            check = run_on(full, begin, scene, epsilon, grid, loosened=CHECK)
            floor.append(max(largest_error(check, reference, slow) / CHECK, ROUNDING))
            for n, flow in flows.items():
                run = run_on(flow, slow_start, scene, epsilon, grid)
                errors[n].append(largest_error(run, reference, slow))
                statuses[n].append(run.status if not run.status.ok else reference.status)
            for name, rival in rivals.items():
                names = [z.name for z in rival.states]
                there = {z: float(reference[z][0]) for z in names}
                run = run_on(rival, there, scene, epsilon, grid, begin=first)
                claimed[name].append(largest_error(run, reference, names))
            if progress is not None:
                progress((i + 1) / len(ladder))
        highest = max(reached_orders)
        floor = with_rounding(ladder, errors[highest], floor, power=expected[highest])
        return Comparison(
            scene=scene,
            epsilons=ladder,
            errors=MappingProxyType({n: tuple(values) for n, values in errors.items()}),
            slopes=MappingProxyType({n: slope(ladder, values, floor) for n, values in errors.items()}),
            expected=MappingProxyType(expected),
            floor=tuple(floor),
            statuses=MappingProxyType({n: tuple(values) for n, values in statuses.items()}),
            claims=MappingProxyType({name: tuple(values) for name, values in claimed.items()}),
            claim_slopes=MappingProxyType({name: slope(ladder, v, floor) for name, v in claimed.items()}),
            correction=correction,
            ending=ending,
            begins=begins,
        )

    found = measured(study.start)
    if inner is None and nesting is None and not rivals and all(map(found.is_exact, reached_orders)):
        # A start at rest, as without a single one infected, would say so of any reduction.
        base = _base_of(study)
        if base is not None:
            return measured(
                base, "both runs begin on the slow manifold, over the base point of the scene's start"
            )
    return found


def _base_of(study: Study) -> Mapping[str, float] | None:
    """The study's start with its base point through order 1 for slow values; None where that is no other place."""
    try:
        base = study.base_point(1)
    except GspError:
        return None
    return None if all(base[x.name] == study.start[x.name] for x in study.system.x) else {**study.start, **base}


def _below(nesting: Nesting, orders: tuple[int, ...], correction: int | None) -> tuple[int, ...]:
    """Of `orders` those below that of the nested series: the whole system starts by one order more than compared."""
    if correction is not None:
        raise DeclarationError(
            "a nested reduction is compared on its slow manifold.", "Leave the correction out.", got=correction
        )
    below = tuple(n for n in orders if n < nesting.order)
    if not below:
        raise DeclarationError(
            f"the nested series is known through order {nesting.order}, and lower orders are compared.",
            "Give nest() a higher order.",
            got=f"orders {', '.join(map(str, orders))}",
            value=orders,
        )
    return below


def on_manifold(series: SeriesManifold, start: Mapping[str, float], epsilon: float) -> dict[str, float]:
    """The point of M_epsilon over the slow part of `start`, by the series at its optimal order."""
    system = series.branch.system
    x = {s.name: start[s.name] for s in system.x}
    y = best_sum(series, x, epsilon)[0][0]
    return {**x, **{s.name: float(value) for s, value in zip(system.y, y)}}


def slope(epsilons: Sequence[float], errors: Sequence[float], floor: Sequence[float]) -> float:
    """Least-squares power of epsilon over the smallest epsilons whose error stands clear of the reference's.

    nan when fewer than two do.
    """
    # The slope is fitted to this many of the smallest epsilons that stand clear.
    clear = [
        (e, error)
        for e, error, low in sorted(zip(epsilons, errors, floor))
        if np.isfinite(error) and error > CLEARANCE * low
    ][:3]
    if len(clear) < 2:
        return float("nan")
    x, y = np.log([e for e, _ in clear]), np.log([error for _, error in clear])
    return float(np.polyfit(x, y, 1)[0])


def with_rounding(
    epsilons: Sequence[float], errors: Sequence[float], floor: Sequence[float], *, power: int
) -> list[float]:
    """The floor, raised to the errors of the highest order where these fall no more: what is left is rounding.

    `epsilons` fall. Errors finer than the reference's tolerance that fall by less than half the power of epsilon that
    they should fall by are rounding of either run, which a second run of the full system alone does not show.
    """
    first = last = len(epsilons) - 1
    while first > 0:
        share = (epsilons[first - 1] / epsilons[first]) ** (power / 2)
        if not errors[first - 1] < share * errors[first]:
            break
        first -= 1
    left = errors[first:]
    if first == last or not max(left) <= RTOL:
        return list(floor)
    return [*floor[:first], *(max(low, *left) for low in floor[first:])]


def sense(study: Study) -> int:
    """-1 where the branch repels: only backward in time does a full run stay on its slow manifold; else 1."""
    x = np.array([[study.start[s.name] for s in study.system.x]])
    y = study.branch.points(x)
    eigenvalues = Sampler(study.branch).eigenvalues(np.hstack([x, y]))
    return -1 if (np.real(eigenvalues) > 0).all() else 1


def _inner(study: Study, correction: int) -> InnerExpansion:
    inner = expand_inner(study.branch, study.start, order=correction, fast_order=max(correction - 1, 0))
    inner.require(correction)
    if inner.direction < 0:
        raise HyperbolicityError(
            f"the branch {study.branch} repels, so a run from off the slow manifold leaves it.",
            "Use correction=None, which starts on the manifold.",
        )
    return inner


def layer_time(inner: InnerExpansion, scene: Scene, epsilon: float, highest: int) -> float:
    """Slow time until the layer is out of the way of the errors measured."""
    # With a correction errors are measured after (M + 3) epsilon/gap ln(1/epsilon), M the highest power of
    # epsilon corrected for: what is left of the layer is then epsilon^2 times smaller than the smallest error
    # expected.
    power = min(highest, inner.order) + 3
    time = power * epsilon / inner.gap * max(float(np.log(1.0 / epsilon)), 1.0)
    length = scene.span[1] - scene.span[0]
    if time > 0.5 * length:
        raise DeclarationError(
            f"the initial layer takes {time:.3g} of slow time at epsilon = {epsilon:g} (gap {inner.gap:.3g}"
            f"), more than half of the span {scene.span}.",
            "Take smaller epsilons or a longer span.",
        )
    return time


def run_on(
    flow,
    start,
    scene: Scene,
    epsilon: float,
    grid,
    *,
    loosened: float = 1.0,
    begin: float | None = None,
) -> Trajectory:
    """A run over `grid`, from `begin` or the scene's first time, at the tolerances that are compared."""
    # A run that leaves a manifold of saddle type ends somewhere; it is not followed for ever.
    return trajectory_of(
        flow,
        start=start,
        span=(scene.span[0] if begin is None else begin, float(grid[-1])),
        epsilon=None if flow.epsilon is None else epsilon,
        rtol=RTOL * loosened,
        atol=absolute_tolerance(RTOL * loosened, scene.region, scene.start),
        at=grid,
        options=RunOptions(stops_at_times=True, max_steps=100_000),
    )


def largest_error(run: Trajectory, reference: Trajectory, names: Sequence[str]) -> float:
    """Largest |difference| over the grid and the quantities `names`, each relative to its largest value."""
    if not (run.status.ok and reference.status.ok):
        return float("nan")
    worst = 0.0
    for name in names:
        expected = reference[name]
        size = np.abs(expected).max() or 1.0
        worst = max(worst, float(np.abs(run[name] - expected).max() / size))
    return worst


def _rivals(scene: Scene, study: Study) -> dict[str, VectorField]:
    """The scene's claims as fields of their own."""
    epsilon = study.system.epsilon
    return {
        name: VectorField(
            rates,
            epsilon=epsilon if any(rate.has(epsilon) for rate in rates.values()) else None,
            parameters=study.system.parameters,
            name=name,
        )
        for name, rates in scene.claims.items()
    }
