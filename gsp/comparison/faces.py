"""Charts and tables of the nouns of this package, and what a sweep records of its verbs."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from gsp.comparison.comparison import Comparison, compare
from gsp.comparison.failure_map import FailureMap
from gsp.comparison.method_table import MethodTable
from gsp.comparison.survey import EXPLICIT, NOT_REACHED, Claim, demands_of, reduced_name
from gsp.comparison.work_precision import WorkPrecision
from gsp.errors import Status
from gsp.results.point_verbs import Labels, Record, records
from gsp.results.registry import Makers, charts, tables
from gsp.results.table import Column, Table, numbers, texts
from gsp.scenes.study import Study
from gsp.systems.flow import check_orders


@tables.of(Comparison)
def _table_of_comparison(found: Comparison) -> Table:
    """Errors over order and epsilon, those of claims over claim and epsilon."""
    orders = tuple(found.errors)
    each, along = ("order",), ("epsilon",)
    both = each + along
    coordinates = {
        "order": Column(each, np.array(orders)),
        "epsilon": Column(along, np.array(found.epsilons)),
    }
    variables = {
        "error": Column(both, np.array([found.errors[n] for n in orders])),
        "status": Column(both, np.array([texts(s.name for s in found.statuses[n]) for n in orders])),
        "slope": Column(each, np.array([found.slopes[n] for n in orders])),
        "expected": Column(each, numbers(found.expected[n] for n in orders)),
        "exact": Column(each, np.array([found.is_exact(n) for n in orders])),
        "floor": Column(along, np.array(found.floor)),
    }
    if found.claims:
        claims = tuple(found.claims)
        coordinates["claim"] = Column(("claim",), texts(claims))
        errors = np.array([found.claims[name] for name in claims])
        variables["claim_error"] = Column(("claim", "epsilon"), errors)
        variables["claim_slope"] = Column(("claim",), np.array([found.claim_slopes[name] for name in claims]))
    attributes = {
        "scene": found.scene.name, "correction": found.correction, "ending": found.ending, "begins": found.begins,
        "crossed": ", ".join(found.crossed),
    }  # fmt: skip
    return Table("Comparison", coordinates, variables, attributes, both)


@tables.of(FailureMap)
def _table_of_failure_map(found: FailureMap) -> Table:
    """Both maps: over (epsilon, position) and over (epsilon, tolerance), a layer for each method."""
    coordinates = {
        "epsilon": Column(("epsilon",), found.epsilons),
        "position": Column(("position",), found.positions),
        "tolerance": Column(("tolerance",), found.tolerances),
    }
    over = ("order",)
    coordinates["order"] = Column(over, np.array(found.orders))
    variables = {
        "best_order": Column(("epsilon", "position"), found.best_order),
        "least_order": Column(("epsilon", "position"), found.least_order),
        "least_order_demanded": Column(("epsilon", "tolerance"), found.least_order_demanded),
        "holds_over_span": Column(over, numbers(found.holds_over_span(n) for n in found.orders)),
    }
    for name, column, claims in (("place", "position", found.places), ("demand", "tolerance", found.demands)):
        coordinates[f"{name}_method"] = Column((f"{name}_method",), texts(claims))
        variables |= _claimed(name, (f"{name}_method", "epsilon", column), claims)
    attributes = {
        "scene": found.scene.name,
        "axis": found.axis,
        "place_tolerance": found.tolerance,
        "runs": found.runs,
    }
    return Table("FailureMap", coordinates, variables, attributes, records=_cells(found))


@tables.of(MethodTable)
def _table_of_method_table(found: MethodTable) -> Table:
    """Errors over method and epsilon, and what each method costs."""
    each, along = ("method",), ("epsilon",)
    coordinates = {
        "method": Column(each, texts(row.label for row in found.rows)),
        "epsilon": Column(along, np.array(found.epsilons)),
    }
    variables = {
        "error": Column(("method", "epsilon"), np.array([row.errors for row in found.rows])),
        "fitted": Column(each, np.array([row.fitted for row in found.rows])),
        "expected": Column(each, numbers(row.expected for row in found.rows)),
        "microseconds": Column(each, np.array([row.microseconds for row in found.rows])),
        "evaluations": Column(each, np.array([row.evaluations for row in found.rows])),
        "preparation": Column(each, np.array([row.preparation for row in found.rows])),
        "floor": Column(along, np.array(found.floor)),
        "disagreement": Column(along, np.array(found.disagreement)),
        "reference": Column(along, texts(found.references)),
        "points": Column(("point", "slow"), found.points),
    }
    attributes = {
        "scene": found.scene.name,
        "omitted": "; ".join(f"{name}: {reason}" for name, reason in found.omitted.items()),
        "endings": "; ".join(
            f"{name} at {found.scene.system.epsilon} = {e:g}: {how}" for (name, e), how in found.endings.items()
        ),
        "crossed": ", ".join(found.crossed),
    }
    return Table("MethodTable", coordinates, variables, attributes, ("method", "epsilon"))


@tables.of(WorkPrecision)
def _table_of_work_precision(found: WorkPrecision) -> Table:
    """What every curve needed at every tolerance; nan where a curve has no run."""
    rtols = sorted({point.rtol for curve in found.curves for point in curve.points}, reverse=True)
    each, both = ("curve",), ("curve", "rtol")
    runs = [{point.rtol: point for point in curve.points} for curve in found.curves]
    variables = {
        name: Column(
            both,
            np.array([numbers(getattr(run.get(r), name, None) for r in rtols) for run in runs]),
        )
        for name in ("error", "end_error", "seconds", "steps", "field_calls")
    }
    variables["kind"] = Column(each, texts(curve.kind for curve in found.curves))
    variables["version"] = Column(each, texts(curve.version or "" for curve in found.curves))
    variables["model_order"] = Column(each, numbers(curve.order for curve in found.curves))
    variables["preparation"] = Column(each, np.array([curve.preparation for curve in found.curves]))
    variables["ended"] = Column(each, texts(curve.ended for curve in found.curves))
    coordinates = {
        "curve": Column(each, texts(curve.label for curve in found.curves)),
        "rtol": Column(("rtol",), np.array(rtols)),
        "epsilon": Column((), np.array(found.epsilon)),
    }
    attributes = {"scene": found.scene.name, "start": found.start, "reference_error": found.reference_error}
    return Table("WorkPrecision", coordinates, variables, attributes, both)


def _cells(found: FailureMap) -> list[dict[str, object]]:
    """A row for each cell of both maps and each method."""
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
            ("position", found.axis, found.positions, found.places),
            ("tolerance", "tolerance", found.tolerances, found.demands),
        )
        for claim in claims.values()
        for i, e in enumerate(found.epsilons)
        for j, c in enumerate(columns)
    ]


def _claimed(name: str, dimensions: tuple[str, ...], claims: Mapping[str, Claim]) -> dict[str, Column]:
    return {
        f"{name}_measure": Column(dimensions, np.array([claim.measure for claim in claims.values()])),
        f"{name}_holds": Column(dimensions, np.array([claim.holds for claim in claims.values()])),
    }


def _each_order(study: Study, *, orders: tuple[int, ...] = (0, 1, 2, 3), **_: object) -> Labels:
    over = {"order": check_orders(orders)}
    return {"error": over, "ending": over}


ENDINGS = (*(status.name for status in Status), NOT_REACHED)


@records("compare", labels=_each_order, codes={"ending": ENDINGS})
def _record_of_compare(
    study: Study,
    epsilon: float,
    tolerance: float,
    *,
    orders: tuple[int, ...] = (0, 1, 2, 3),
    correction: int | None = None,
) -> Record:
    found = compare(study, orders=orders, epsilons=(epsilon,), correction=correction)
    # An order that the exact algebra does not reach has no error.
    each = check_orders(orders)
    errors = [found.errors[n][0] if n in found.errors else math.nan for n in each]
    endings = [found.statuses[n][0] if n in found.statuses else NOT_REACHED for n in each]
    return {"error": errors, "floor": found.floor[0], "ending": endings}


def _each_method(study: Study, *, orders: tuple[int, ...] = (0, 1, 2, 3), **_: object) -> Labels:
    names = (*(reduced_name(n) for n in check_orders(orders)), EXPLICIT)
    return {key: {"method": names} for key in ("measure", "holds", "ending")}


@records("failure_map", labels=_each_method, codes={"ending": ENDINGS})
def _record_of_failure_map(
    study: Study, epsilon: float, tolerance: float, *, orders: tuple[int, ...] = (0, 1, 2, 3)
) -> Record:
    claims = list(demands_of(study, np.array([epsilon]), np.array([tolerance]), check_orders(orders)))
    return {
        "measure": [claim.measure[0, 0] for claim in claims],
        "holds": [claim.holds[0, 0] for claim in claims],
        "ending": [claim.endings[0, 0] for claim in claims if claim.endings is not None],
    }


@charts.late
def _charts() -> Makers:
    from gsp import charts as drawn

    return {
        Comparison: drawn.error_against_epsilon,
        MethodTable: drawn.method_errors,
        WorkPrecision: drawn.work_precision,
        FailureMap: lambda found, axes: (
            drawn.failure_map(found) if axes is None else drawn.failures_along(found, axes)
        ),
    }
