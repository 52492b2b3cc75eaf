"""The errors of an averaged field: its runs against those of the whole system, over a ladder of epsilons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import MappingProxyType

import numpy as np

from gsp.averaging.averaging import Averaging
from gsp.comparison.compared_runs import CHECK, GRID_POINTS, ROUNDING, largest_error, run_on, surfaces_crossed
from gsp.comparison.comparison import Comparison, slope, with_rounding
from gsp.errors import DeclarationError, Status
from gsp.systems.arguments import check_noun, check_progress
from gsp.systems.flow import check_epsilons, check_orders


def compare_averaged(
    averaging: Averaging,
    *,
    orders: Sequence[int] | None = None,
    epsilons: Sequence[float] | None = None,
    progress: Callable[[float], object] | None = None,
) -> Comparison:
    """Error of the averaged field of each order, all that are known unless given, over the scene's ladder of epsilons.

    The whole system runs from the scene's start and the averaged one from its base point through the same order;
    compared are the slow variables before averaging. The error of order N is O(epsilon^(N+1)); where the run crosses a
    surface on which the rates are not smooth no power is expected from order 1 on. Raises `DeclarationError` for an
    averaging without a scene, or an order that is not known.
    """
    check_noun(averaging, Averaging, verb="compare_averaged")
    scene = averaging.scene
    if scene is None:
        raise DeclarationError(
            "an averaging of a scene is compared, which says from where and for how long.",
            "Give average() the scene.",
            got=repr(averaging),
        )
    asked = tuple(range(averaging.order + 1)) if orders is None else tuple(dict.fromkeys(check_orders(orders)))
    ladder = scene.epsilons if epsilons is None else tuple(sorted(check_epsilons(epsilons), reverse=True))
    if not ladder:
        raise DeclarationError("epsilons has no value.", "Give one or more, such as (0.02, 0.01).")
    check_progress(progress)
    flows = {n: averaging.with_phase(n) for n in asked}
    names = [averaging.named_in_full[x].name for x in averaging.form.rates]
    # The errors oscillate with the phase, and what is compared is the largest: the grid is so many times finer.
    grid = np.linspace(*scene.span, 10 * (GRID_POINTS - 1) + 1)
    errors: dict[int, list[float]] = {n: [] for n in asked}
    statuses: dict[int, list[Status]] = {n: [] for n in asked}
    floor, crossed = [], {}
    for i, epsilon in enumerate(ladder):
        reference = run_on(averaging.watched, scene.start, scene, epsilon, grid)
        check = run_on(averaging.watched, scene.start, scene, epsilon, grid, loosened=CHECK)
        floor.append(max(largest_error(check, reference, names) / CHECK, ROUNDING))
        crossed |= dict.fromkeys(surfaces_crossed(averaging.watched, reference, epsilon))
        for n, flow in flows.items():
            run = run_on(
                flow, averaging.base_point(scene.start, epsilon=epsilon, order=n), scene, epsilon, grid
            )
            errors[n].append(largest_error(run, reference, names))
            statuses[n].append(run.status if not run.status.ok else reference.status)
        if progress is not None:
            progress((i + 1) / len(ladder))
    floor = with_rounding(ladder, errors[max(asked)], floor, power=max(asked) + 1)
    return Comparison(
        scene=scene,
        epsilons=ladder,
        errors=MappingProxyType({n: tuple(values) for n, values in errors.items()}),
        slopes=MappingProxyType({n: slope(ladder, values, floor) for n, values in errors.items()}),
        expected=MappingProxyType({n: None if n and crossed else n + 1 for n in asked}),
        floor=tuple(floor),
        statuses=MappingProxyType({n: tuple(values) for n, values in statuses.items()}),
        begins="the averaged one begins at its base point",
        crossed=tuple(crossed),
    )
