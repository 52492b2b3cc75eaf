"""Comparison: reduced flows of several orders against full trajectories, over a ladder of epsilons.

The full system starts on M_epsilon over the scene's slow start, so that no initial layer is crossed. A reduced
field through order N is then in error by O(epsilon^(N+1)) on a time span that does not depend on epsilon.
With a correction it starts anywhere, and the reduced runs at the base point of the fast fibre through that start.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from gsp.comparison.compared_runs import RTOL, ComparedRuns, relative, sense
from gsp.errors import DeclarationError, GspError, HyperbolicityError, Status
from gsp.fibres.inner_expansion import InnerExpansion, expand_inner
from gsp.nested.nesting import Nesting
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.systems.arguments import check_progress
from gsp.systems.flow import check_epsilons, check_order, check_orders
from gsp.systems.system import VectorField

# Errors must stand this far above the reference's own error to enter a slope.
CLEARANCE = 30.0


@dataclass(frozen=True, eq=False)
class Comparison(Drawn, Tabular):
    """Errors of the reduced flows, measured.

    `errors[N][i]` is the largest error of the order-N run at `epsilons[i]` over the grid, each slow variable
    relative to its largest value there, or at any of `epsilons` if the lowest order does not move it; `slopes[N]` is
    the fitted power of epsilon, nan when every error is at rounding; `expected[N]` is
    N + 1, or min(N, k) + 1 with the start corrected through epsilon^k, k = `correction`; from order 1 on it is None
    where the full run crosses surfaces on which the field is not smooth, `crossed`. `floor[i]` estimates the
    reference's own error. The same for rival reduced fields of the scene in `claims` and `claim_slopes`. `ending` says
    why the highest orders asked for are left out, where the exact algebra did not reach them. `begins` says where both
    runs begin, where that is not over the slow start.
    """

    scene: Scene
    epsilons: tuple[float, ...]
    errors: Mapping[int, tuple[float, ...]]
    slopes: Mapping[int, float]
    expected: Mapping[int, int | None]
    floor: tuple[float, ...]
    statuses: Mapping[int, tuple[Status, ...]]
    claims: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    claim_slopes: Mapping[str, float] = field(default_factory=dict)
    correction: int | None = None
    ending: str = ""
    begins: str = ""
    crossed: tuple[str, ...] = ()

    def is_exact(self, order: int) -> bool:
        """Whether every error of this order is within the reference's own error."""
        return all(e <= CLEARANCE * f for e, f in zip(self.errors[order], self.floor))

    def __repr__(self) -> str:
        slopes = ", ".join(f"{n}: {s:.3g}" for n, s in self.slopes.items())
        return f"Comparison({self.scene.name}, slopes {{{slopes}}})"

    def __str__(self) -> str:
        head = "  order  slope  expected  " + "  ".join(f"{e:>9.3g}" for e in self.epsilons)
        rows = [
            f"  {n:5d}  {self.slopes[n]:5.2f}  {'-' if self.expected[n] is None else self.expected[n]:>8}  "
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
        if self.crossed:
            places = ", ".join(f"{surface} = 0" for surface in self.crossed)
            ending.append(
                f"  from order 1 on no power is expected: the run crosses {places}, where the field is not smooth"
            )
        return "\n".join([title, head, *rows, *self._missing(), *ending])

    @property
    def ended(self) -> dict[Status, str]:
        """How runs ended early, with the orders and epsilons at which they did, as "0 to 2 at each; 3 at 0.01"."""
        ended: dict[Status, dict[str, list[int]]] = {}
        for n, statuses in self.statuses.items():
            for status in dict.fromkeys(s for s in statuses if not s.ok):
                where = [f"{e:.6g}" for e, s in zip(self.epsilons, statuses) if s is status]
                places = "each" if len(where) == len(self.epsilons) else ", ".join(where)
                ended.setdefault(status, {}).setdefault(places, []).append(n)
        return {
            status: "; ".join(f"{_orders(orders)} at {places}" for places, orders in by_place.items())
            for status, by_place in ended.items()
        }

    def _missing(self) -> list[str]:
        """Lines that say why errors or slopes are no numbers."""
        lines = [
            f"  nan of order {orders}: a run ended early, {status}" for status, orders in self.ended.items()
        ]
        without = [n for n in self.errors if not np.isfinite(self.slopes[n])]
        if exact := [n for n in without if self.is_exact(n)]:
            lines.append(f"  no slope of order {_orders(exact)}: the errors are within the reference's own")
        if short := [n for n in without if not self.is_exact(n)]:
            lines.append(
                f"  no slope of order {_orders(short)}: fewer than two errors stand clear of the reference's"
            )
        return lines


def _orders(orders: list[int]) -> str:
    """Ascending orders for a message, "0, 2, 4 to 9"."""
    runs: list[list[int]] = []
    for n in orders:
        if runs and n == runs[-1][-1] + 1:
            runs[-1].append(n)
        else:
            runs.append([n])
    return ", ".join(f"{run[0]} to {run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs)


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
    done = 0

    def advance() -> None:
        nonlocal done
        done += 1
        if progress is not None:
            # Of each order: the flow, and its run at every epsilon.
            progress(min(done / (len(reached_orders) * (1 + len(ladder))), 1.0))

    flows = {}
    for n in reached_orders:
        flows[n] = study.reduced(n, reconstructed=False)
        advance()
    rivals = _rivals(scene, study)
    inner = None if correction is None else _inner(study, correction)
    full, slow = (
        (study.system, [x.name for x in study.system.x]) if nesting is None else (nesting.ray, nesting.watched)
    )
    powers = {n: 1 + (n if correction is None else min(n, correction)) for n in reached_orders}
    runs = ComparedRuns(scene, full, slow, flows, rivals, series, inner, sense(study), nesting)

    def measured(origin: Mapping[str, float], begins: str = "") -> Comparison:
        rows = [runs.at(epsilon, origin, advance) for epsilon in ladder]
        # What a correction alone moves is itself of the size of epsilon, which would take a power off its error.
        most = {name: max(row.sizes[name] for row in rows) for name in slow}
        sizes = [{name: row.sizes[name] if name in row.moved else most[name] for name in slow} for row in rows]
        errors = {n: tuple(relative(row.errors[n], size) for row, size in zip(rows, sizes)) for n in flows}
        claimed = {name: tuple(row.claimed[name] for row in rows) for name in rivals}
        highest = max(reached_orders)
        floor = with_rounding(ladder, errors[highest], [row.floor for row in rows], power=powers[highest])
        crossed = tuple(dict.fromkeys(surface for row in rows for surface in row.crossed))
        return Comparison(
            scene=scene,
            epsilons=ladder,
            errors=MappingProxyType(errors),
            slopes=MappingProxyType({n: slope(ladder, values, floor) for n, values in errors.items()}),
            expected=MappingProxyType({n: None if n and crossed else power for n, power in powers.items()}),
            floor=tuple(floor),
            statuses=MappingProxyType({n: tuple(row.statuses[n] for row in rows) for n in flows}),
            claims=MappingProxyType(claimed),
            claim_slopes=MappingProxyType({name: slope(ladder, v, floor) for name, v in claimed.items()}),
            correction=correction,
            ending=ending,
            begins=begins,
            crossed=crossed,
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


def _inner(study: Study, correction: int) -> InnerExpansion:
    inner = expand_inner(study.branch, study.start, order=correction, fast_order=max(correction - 1, 0))
    inner.require(correction)
    if inner.direction < 0:
        raise HyperbolicityError(
            f"the branch {study.branch} repels, so a run from off the slow manifold leaves it.",
            "Use correction=None, which starts on the manifold.",
        )
    return inner


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
