"""The methods for slow manifolds side by side: error, measured order in epsilon, and cost.

Quasi-steady state, ILDM, CSP, Fraser-Roussel, the zero-derivative principle, the series, and the solved manifold,
at the same points against the same reference. The orders that theorems promise stand beside the measured ones.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from gsp.comparison.classical_methods import (
    MOST_NODES,
    FraserRoussel,
    Points,
    box_around,
    csp,
    ildm,
    quasi_steady_state,
)
from gsp.comparison.compared_runs import surfaces_between
from gsp.comparison.comparison import slope
from gsp.comparison.references import reference_at
from gsp.critical.branch import Branch
from gsp.errors import BudgetError, DeclarationError, unknown_name
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.series import LONGEST, SeriesManifold, length
from gsp.slow.slow_points import zero_derivative
from gsp.slow.solved_manifold import solve_manifold
from gsp.systems.arguments import shown
from gsp.systems.flow import as_points, check_epsilons, check_orders

# The share of the region left free at its ends, where the slow manifold is not determined by what is inside.
MARGIN = 0.05
# Points at which the solved manifold may be solved for at each epsilon, before it is told as far as it is resolved.
MOST_POINTS = 1100

# Methods that need a grid of the slow variables take at most this many of them.
LARGEST_GRID = 3

Evaluator = Callable[[np.ndarray], Points]


@dataclass(frozen=True)
class MethodRow:
    """One method: `errors`, the largest at each epsilon, absolute; `fitted` and `expected` orders in epsilon.

    `order` is its order parameter (refinements, iterates, m, n), None where it has none. `expected` is what a theorem
    promises in general; `fitted` is nan where the errors are at rounding, or at what interpolation of iterates leaves.
    A point takes `microseconds` after a preparation of `preparation` seconds, and `evaluations` of the model.
    """

    method: str
    order: int | None
    errors: tuple[float, ...]
    fitted: float
    expected: int | None
    microseconds: float
    evaluations: float
    preparation: float

    @property
    def label(self) -> str:
        """Method and order."""
        return self.method if self.order is None else f"{self.method} {self.order}"


@dataclass(frozen=True, eq=False, repr=False)
class MethodTable(Drawn, Tabular):
    """`rows` of methods over `epsilons` at `points` (m, n_slow); `floor[i]` is the reference's own error.

    `references[i]` says what the reference was at `epsilons[i]`, and `disagreement[i]` how far the zero-derivative
    principle at its best order is from it: much more than its floor where that principle has reached its limit, or
    where a kink is near. Of points on both sides of surfaces where the field is not smooth, `crossed`, no theorem
    expects more than order 1. `omitted` says of methods that are left out why: too many slow variables for them, or too
    long a series; `endings`, by method and epsilon, how those ended that solve over the whole box and fell short of
    their tolerance.
    """

    scene: Scene
    points: np.ndarray
    epsilons: tuple[float, ...]
    rows: tuple[MethodRow, ...]
    floor: tuple[float, ...]
    references: tuple[str, ...]
    disagreement: tuple[float, ...]
    omitted: Mapping[str, str] = field(default_factory=dict)
    endings: Mapping[tuple[str, float], str] = field(default_factory=dict)
    crossed: tuple[str, ...] = ()

    def __getitem__(self, label: str) -> MethodRow:
        for row in self.rows:
            if row.label == label:
                return row
        raise unknown_name(label, (row.label for row in self.rows))

    def __repr__(self) -> str:
        return f"MethodTable({self.scene.name}: {len(self.rows)} methods, {len(self.points)} points)"

    def __str__(self) -> str:
        width = max(len(row.label) for row in self.rows)
        head = (
            f"  {'method':<{width}}  order  theory  "
            + "  ".join(f"{e:>8.3g}" for e in self.epsilons)
            + "   us/point   calls   prepare"
        )
        lines = [f"largest error of h at {len(self.points)} points, by {self.scene.system.epsilon}", head]
        for row in self.rows:
            expected = "" if row.expected is None else str(row.expected)
            fitted = "" if np.isnan(row.fitted) else f"{row.fitted:.2f}"
            lines.append(
                f"  {row.label:<{width}}  {fitted:>5}  {expected:>6}  "
                + "  ".join(f"{e:8.1e}" for e in row.errors)
                + f"  {row.microseconds:9.3g}  {row.evaluations:6.1f}  {row.preparation:7.2g}s"
            )
        kinds = "; ".join(dict.fromkeys(self.references))
        indent = " " * (width + 17)
        lines.append(f"  reference: {kinds}")
        for name, values in (("its error", self.floor), ("second route", self.disagreement)):
            lines.append(f"  {name:<{len(indent) - 2}}" + "  ".join(f"{value:8.1e}" for value in values))
        if self.crossed:
            places = ", ".join(f"{surface} = 0" for surface in self.crossed)
            lines.append(
                f"  no order above 1 is expected: points lie on both sides of {places}, where the field is not smooth"
            )
        lines += [f"  omitted: {name}: {reason}" for name, reason in self.omitted.items()]
        lines += [
            f"  {name} at {self.scene.system.epsilon} = {e:g}: {ending}"
            for (name, e), ending in self.endings.items()
        ]
        return "\n".join(lines)


def method_table(
    scene: Scene | Study,
    *,
    points=None,
    epsilons: Sequence[float] | None = None,
    refinements: Sequence[int] = (0, 1, 2),
    iterates: Sequence[int] = (1, 2, 3),
    orders: Sequence[int] = (0, 1, 2, 3),
) -> MethodTable:
    """All methods on one scene's branch, at `points` (m, n_slow) or a grid in its region, over its ladder of epsilons.

    CSP is refined as often as `refinements` says, Fraser-Roussel iterated as `iterates`; the zero-derivative
    principle and the series go through `orders`. The reference are orbit segments through the very points, their error
    estimate checked against the zero-derivative principle; where they cannot be solved, the latter. The solved manifold
    takes at most `MOST_POINTS` points at each epsilon; `endings` says how far that resolves it. Raises
    what the stages raise.

    >>> from gsp import models
    >>> from gsp.comparison.method_table import method_table
    >>> table = method_table(models.load("michaelis_menten"), epsilons=(0.02, 0.01), orders=(0, 1))
    >>> round(table["ILDM"].fitted), round(table["CSP 2"].fitted), round(table["series 1"].fitted)
    (2, 3, 2)
    """
    study = study_of(scene, verb="method_table")
    scene = study.scene
    given = {"refinements": refinements, "iterates": iterates, "orders": orders}
    chosen = {name: check_orders(values, what=name, empty=True) for name, values in given.items()}
    ladder = scene.epsilons if epsilons is None else tuple(sorted(check_epsilons(epsilons), reverse=True))
    if len(ladder) < 2:
        raise DeclarationError("an order needs two epsilons or more.", "Try (0.02, 0.01, 0.005).", got=ladder)
    branch = study.branch
    if points is not None:
        points = as_points(branch.system.x, points, what="points")[0]
        if not points.size:
            raise DeclarationError("points are one point or more.", got=shown(points), value=points)
    box = {s.name: study.region[s.name] for s in branch.system.x if s.name in study.region}
    x = _grid(branch, box) if points is None else points
    gridded = len(branch.system.x) <= LARGEST_GRID
    solved = {e: _solved(branch, x, e) for e in ladder} if gridded else {}
    iterated = {e: _iterated(branch, x, e, chosen["iterates"]) for e in ladder} if gridded else {}
    references = [reference_at(branch, x, e) for e in ladder]
    crossed = surfaces_between(branch.system, np.hstack([x, branch.points(x)]), ladder[-1])
    floor = tuple(reference.error for reference in references)
    rows = []
    for method in _methods(study, solved, iterated, floor, **chosen):
        errors = []
        for e, reference in zip(ladder, references):
            found = method.prepare(e)(x).y
            errors.append(
                float(np.abs(found - reference.y).max()) if np.isfinite(found).all() else float("nan")
            )
        cost, evaluations, preparation = _cost(method, x, ladder[-1])
        rows.append(
            MethodRow(
                method=method.name,
                order=method.order,
                errors=tuple(errors),
                fitted=float("nan")
                if method.expected is None
                else slope(ladder, errors, method.floor or floor),
                expected=None if crossed and method.expected != 1 else method.expected,
                microseconds=cost,
                evaluations=evaluations,
                preparation=preparation,
            )
        )
    return MethodTable(
        scene,
        x,
        ladder,
        tuple(rows),
        floor,
        tuple(reference.source for reference in references),
        tuple(reference.second_route for reference in references),
        MappingProxyType(_omitted(study, gridded, chosen["orders"])),
        MappingProxyType(_endings(solved, iterated)),
        tuple(crossed),
    )


def _endings(
    solved: Mapping[float, _SolvedMethod], iterated: Mapping[float, _Iterated]
) -> dict[tuple[str, float], str]:
    """What fell short of its tolerance, by method and epsilon, and how."""
    unresolved = f"{MOST_NODES} points do not resolve the iterates, from which the slopes are taken"
    rough = {("Fraser-Roussel", e): unresolved for e, made in iterated.items() if not made.found.resolved}
    short = {("solved", e): s.manifold for e, s in solved.items() if not s.manifold.status.ok}
    return rough | {key: manifold.message for key, manifold in short.items()}


def _omitted(study: Study, gridded: bool, orders: Sequence[int]) -> dict[str, str]:
    """The methods that are left out, and why."""
    many = f"it takes at most {LARGEST_GRID} slow variables"
    found = {} if gridded else {"Fraser-Roussel": many, "solved": many}
    short = _short(study, orders)
    left = [n for n in orders if short is None or n > short.order]
    for n in left:
        try:
            longest = length(study.run_series(n))
        except BudgetError as error:
            found[f"series {n}"] = str(error)
            continue
        found[f"series {n}"] = f"its coefficients have up to {longest}, more than {LONGEST}"
    return found


def _short(study: Study, orders: Sequence[int]) -> SeriesManifold | None:
    """The series through those of `orders` that are short enough to be run; None where the least is not."""
    if not orders or max((found := study.short_series(max(orders))).sizes) > LONGEST:
        return None
    return found


@dataclass(frozen=True)
class _Method:
    """`prepare(epsilon)` gives the function of points; whatever it computes once counts as preparation.

    `floor` is, at each epsilon, an error at which it shows no order, where that is not the reference's.
    """

    name: str
    order: int | None
    expected: int | None
    prepare: Callable[[float], Evaluator]
    preparation: float | None = None
    floor: tuple[float, ...] = ()


@dataclass(frozen=True)
class _SolvedMethod:
    """The solved manifold over the box of the points, and the seconds it took."""

    manifold: SampledManifold
    seconds: float

    def evaluate(self, x: np.ndarray) -> Points:
        return Points(self.manifold.evaluate(x), 0.0)


@dataclass(frozen=True)
class _Iterated:
    """The Fraser-Roussel iterates over the box of the points, all on one grid, the seconds they took, their noise."""

    found: FraserRoussel
    seconds: float
    noise: list[float]


def _methods(
    study: Study,
    solved: Mapping[float, _SolvedMethod],
    iterated: Mapping[float, _Iterated],
    floor: tuple[float, ...],
    *,
    refinements,
    iterates,
    orders,
) -> Iterator[_Method]:
    branch, series = study.branch, _short(study, orders)

    def direct(function, **fixed):
        return lambda epsilon: lambda x: function(branch, x, epsilon=epsilon, **fixed)

    yield _Method("QSS", None, 1, lambda epsilon: lambda x: quasi_steady_state(branch, x))
    yield _Method("ILDM", None, 2, direct(ildm))
    for q in refinements:
        yield _Method("CSP", q, q + 1, direct(csp, refinements=q))
    for k in iterates if iterated else ():
        spent = iterated[min(iterated)].seconds
        clear = tuple(max(low, made.noise[k]) for low, made in zip(floor, iterated.values()))
        yield _Method(
            "Fraser-Roussel", k, k + 1, lambda e, k=k: lambda x: iterated[e].found.points(x, k), spent, clear
        )
    for m in orders:
        yield _Method("zero-derivative", m, m + 1, lambda epsilon, m=m: _zero_derivative(branch, epsilon, m))
    for n in orders:
        if series is not None and n <= series.order:
            truncated, spent = series.at_order(n), sum(study.spent("numeric series", k) for k in range(n + 1))
            yield _Method(
                "series", n, n + 1, lambda epsilon, truncated=truncated: _series(truncated, epsilon), spent
            )
    if solved:
        last = solved[min(solved)].seconds
        yield _Method("solved", None, None, lambda epsilon: solved[epsilon].evaluate, last)


def _zero_derivative(branch: Branch, epsilon: float, order: int) -> Evaluator:
    def evaluate(x: np.ndarray) -> Points:
        found = zero_derivative(branch, x, epsilon=epsilon, order=order)
        return Points(found.y, found.jets / len(x))

    return evaluate


def _series(series: SeriesManifold, epsilon: float) -> Evaluator:
    # What is wrong with it is measured here, so that its own check is not wanted.
    return lambda x: Points(series.terms(x, epsilon).sum(axis=1), 1.0)


def _solved(branch: Branch, x: np.ndarray, epsilon: float) -> _SolvedMethod:
    begun = time.perf_counter()
    region = dict(zip((s.name for s in branch.system.x), box_around(branch, x)))
    manifold = solve_manifold(branch, region=region, epsilon=epsilon, max_points=MOST_POINTS)
    return _SolvedMethod(manifold, time.perf_counter() - begun)


def _iterated(branch: Branch, x: np.ndarray, epsilon: float, iterates: Sequence[int]) -> _Iterated:
    begun = time.perf_counter()
    found = FraserRoussel.over(branch, x, epsilon=epsilon, iterates=max(iterates, default=0))
    return _Iterated(found, time.perf_counter() - begun, found.noise(x))


def _cost(method: _Method, x: np.ndarray, epsilon: float) -> tuple[float, float, float]:
    # Costs are measured on a thousand points at least, as the best of three runs.
    many = np.tile(x, (-(-1000 // len(x)), 1))
    begun = time.perf_counter()
    evaluate = method.prepare(epsilon)
    prepared = time.perf_counter() - begun if method.preparation is None else method.preparation
    evaluations = evaluate(x).evaluations
    best = float("inf")
    for _ in range(3):
        begun = time.perf_counter()
        evaluate(many)
        best = min(best, time.perf_counter() - begun)
    return 1e6 * best / len(many), evaluations, prepared


def _grid(branch: Branch, box) -> np.ndarray:
    names = [s.name for s in branch.system.x]
    missing = [name for name in names if name not in box]
    if missing:
        raise DeclarationError(
            f"the region gives no interval for {', '.join(missing)}.",
            f"Give points, or bound {', '.join(missing)}.",
        )
    # Points an axis, by the number of slow variables.
    n = {1: 33, 2: 9, 3: 5}.get(len(names), 3)
    axes = [
        np.linspace(low + MARGIN * (high - low), high - MARGIN * (high - low), n)
        for low, high in (box[name] for name in names)
    ]
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(names))
