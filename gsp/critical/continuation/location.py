"""Locating the special points of a traced curve: brackets from the test functions, then Newton's method."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from gsp import roots
from gsp.critical.continuation.arclength import SAME_PLACE, CurveTrace, PointTracer
from gsp.critical.continuation.special_points import (
    NONE,
    VERTICAL,
    CurveCrossing,
    SpecialPoint,
    branch_point,
    curvature,
    fold_coefficient,
    fold_point,
    pair_point,
    pair_test,
    polished,
)
from gsp.critical.layer_problem import LayerProblem, eigenvalue_sizes
from gsp.critical.minimally_augmented import bialternate, identity, singular_near

# A test function below this is zero by rounding and has no sign.
NO_SIGN = 1e-11
# The cubic's basis (value, slope, value, slope) at points between the rows.
_S = np.linspace(0.0, 1.0, 17)[1:-1]
HERMITE = np.stack(
    [(1 + 2 * _S) * (1 - _S) ** 2, _S * (1 - _S) ** 2, _S**2 * (3 - 2 * _S), _S**2 * (_S - 1)], axis=1
)
# Slopes of test functions are central differences over this arclength, which leaves the curve by its square.
OFFSET = 1e-5
# A test that turns back has touched zero when it is below this share of its values at the rows beside.
TOUCH = 1e-7
# Rows on either side of a fold that show how large second derivatives are.
AROUND = 8


def sign_changes(values: np.ndarray) -> Iterator[tuple[int, int]]:
    """Pairs of rows (a, b) between which `values` changes its sign; (a, a) for a zero at an end.

    One row without a sign is stepped over; several together mean a test that vanishes identically, and are left
    alone.
    """
    sign = np.where(np.abs(values) > NO_SIGN, np.sign(values), 0.0)
    sign[~np.isfinite(values)] = np.nan
    for i in range(len(sign) - 1):
        if sign[i] * sign[i + 1] < 0.0:
            yield i, i + 1
        elif i > 0 and sign[i] == 0.0 and sign[i - 1] * sign[i + 1] < 0.0:
            yield i - 1, i + 1
    if len(sign) > 1:
        for end, beside in ((0, 1), (len(sign) - 1, len(sign) - 2)):
            if sign[end] == 0.0 and abs(sign[beside]) == 1.0:
                yield end, end


def touches(values: np.ndarray, slopes: np.ndarray, lengths: np.ndarray) -> Iterator[tuple[int, int]]:
    """Pairs of rows between which `values` may reach zero and turn back: the cubic through both says so.

    `slopes` (m,) are by arclength, `lengths` (m - 1,) those of the chords.
    """
    for i in range(len(values) - 1):
        start, end = values[i], values[i + 1]
        if abs(end) <= NO_SIGN and i + 2 < len(values) and start * values[i + 2] > 0.0:
            yield i, i + 2
        if not start * end > 0.0 or min(abs(start), abs(end)) <= NO_SIGN:
            continue
        cubic = HERMITE @ np.array([start, lengths[i] * slopes[i], end, lengths[i] * slopes[i + 1]])
        # A zero is looked for where the cubic between two rows goes below half of the lesser of them.
        if (np.sign(start) * cubic).min() < 0.5 * min(abs(start), abs(end)):
            yield i, i + 1


def least_between(
    tracer: PointTracer, rows: np.ndarray, test: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, float]:
    """Where `test`, of one sign at the first and the last of `rows` (m, N), is least in size between, and its size.

    It ends at the first point of the other sign, with a negative size.
    """
    tracer.counters.located += 1
    at_rows = test(rows)
    sign = np.sign(at_rows[0])
    least = int(np.argmin(sign * at_rows))
    best = (rows[least], float(sign * at_rows[least]))

    def size(share: float) -> float:
        u = tracer.between(rows[0], rows[-1], share)
        if u is None:
            return float("inf")
        value = float(sign * test(u[None, :])[0])
        nonlocal best
        if value < best[1]:
            best = (u, value)
        return value

    if best[1] >= 0.0:
        roots.least(size, 0.0, 1.0, below=0.0)
    return best


def locate(
    problem: LayerProblem, tracer: PointTracer, trace: CurveTrace, known: tuple[SpecialPoint, ...] = ()
) -> tuple[np.ndarray, tuple[SpecialPoint, ...], np.ndarray]:
    """Points (m, N) of a trace with its special points among them, these, and the arclength (m,).

    `known` are branch points that the curve starts from.
    """
    last = tracer.scales
    search = _SpecialPointSearch(problem, tracer, trace)
    search.run(trace.crossings, known)
    tracer.scales = last
    return inserted(search.points, search.scales, search.found)


def place_between(points: np.ndarray, a: int, b: int, u: np.ndarray, scales: np.ndarray) -> float:
    """Where u stands along the rows: a, or a fraction of the way from row a to row b."""
    if a == b:
        return float(a)
    chord = (points[b] - points[a]) / scales
    share = float((u - points[a]) / scales @ chord / (chord @ chord))
    return a + (b - a) * min(max(share, 1e-9), 1.0 - 1e-9)


def inserted(
    points: np.ndarray, scales: np.ndarray, found: Sequence[tuple[float, SpecialPoint]]
) -> tuple[np.ndarray, tuple[SpecialPoint, ...], np.ndarray]:
    """Rows (m, N) with the special points at their places among them, these with their rows, and the arclength.

    A point that coincides with a row takes its place.
    """
    keys, rows, sizes = list(map(float, range(len(points)))), list(points), list(scales)
    special: list[tuple[float, SpecialPoint]] = []
    for place, point in sorted(found, key=lambda pair: pair[0]):
        near = round(place)
        if np.linalg.norm((points[near] - point.unknowns) / scales[near]) < SAME_PLACE:
            place = float(near)
            rows[keys.index(place)] = point.unknowns
        else:
            at = bisect_left(keys, place)
            keys.insert(at, place)
            rows.insert(at, point.unknowns)
            sizes.insert(at, scales[near])
        special.append((place, point))
    steps = np.linalg.norm(np.diff(np.array(rows), axis=0) / np.array(sizes)[1:], axis=1)
    numbered = tuple(replace(point, row=keys.index(place)) for place, point in special)
    return np.array(rows), numbered, np.append(0.0, np.cumsum(steps))


class _SpecialPointSearch:
    def __init__(self, problem: LayerProblem, tracer: PointTracer, trace: CurveTrace) -> None:
        self.problem = problem
        self.tracer = tracer
        self.points, self.tangents, self.scales = map(np.array, (trace.points, trace.tangents, trace.scales))
        # (place along the rows, point); the place of a point between rows a and b is a fraction.
        self.found: list[tuple[float, SpecialPoint]] = []
        self.crossings: set[int] = set()

    def run(self, crossings: dict[int, object], known: tuple[SpecialPoint, ...]) -> None:
        for row, crossing in crossings.items():
            assert isinstance(crossing, CurveCrossing)
            self.found.append((row, branch_point(self.problem, self.points[row], crossing)))
        for point in known:
            row = int(np.argmin(np.linalg.norm((self.points - point.unknowns) / self.scales, axis=1)))
            crossing = CurveCrossing(point.coefficients.get("discriminant", 0.0), point.directions[::-1])
            self.found.append((row, branch_point(self.problem, point.unknowns, crossing)))
        self.crossings = {round(row) for row, _ in self.found}
        self._contacts()
        self._folds()
        if self.problem.size > 1:
            self._pairs()

    def _folds(self) -> None:
        for a, b in sign_changes(self.tangents[:, 0]):
            if not self.crossings.issuperset((a, b)):
                self._fold(a, b, self.points[a], self.points[b])
        for a, b, ends in self._turns(self._determinants):
            if self.crossings.isdisjoint(range(a, b + 1)):
                u, value = self._least(a, b, self._determinants)
                if value < 0.0:
                    self._fold(a, b, self.points[a], u)
                    self._fold(a, b, u, self.points[b])
                elif value <= TOUCH * ends:
                    self._touch(a, b, u)

    def _contacts(self) -> None:
        """Branch points of higher order, as where curves touch: g_u vanishes there faster than g_uu."""
        # Each row in the sizes that its variables have there: where one runs away it has another at the ends.
        units = self.scales[:, -self.problem.size :, None]
        slopes = np.array([self.problem.jacobian(u) for u in self.points]) * self.scales[:, None, :] / units
        # At the end of its domain, as of a root, g may have no slopes.
        finite, sizes = np.isfinite(slopes).all(axis=(1, 2)), np.full(len(slopes), np.nan)
        sizes[finite] = np.linalg.svd(slopes[finite], compute_uv=False)[:, -1]
        reach = np.full(len(sizes), np.inf)
        before, after = np.fmax.accumulate(sizes), np.fmax.accumulate(sizes[::-1])[::-1]
        for row in np.flatnonzero(sizes < SAME_PLACE * np.minimum(before, after)):
            size = np.multiply.outer(self.scales[row], self.scales[row])
            bent = self.problem.second(self.points[row]) * size / units[row][:, None]
            reach[row] = sizes[row] / (np.abs(bent).max() or np.inf)
        edges = np.flatnonzero(np.diff(reach < SAME_PLACE, prepend=False, append=False))
        for a, b in edges.reshape(-1, 2):
            if self.crossings.isdisjoint(range(a - 1, b + 1)):
                row = a + int(np.argmin(reach[a:b]))
                self.found.append((row, branch_point(self.problem, self.points[row], CurveCrossing(0.0, NONE))))
                self.crossings.update(range(a - 1, b + 1))

    def _determinants(self, u: np.ndarray) -> np.ndarray:
        return np.linalg.det(self.problem.fast_jacobians(u))

    def _turns(self, test: Callable[[np.ndarray], np.ndarray]) -> Iterator[tuple[int, int, float]]:
        """Pairs of rows between which `test` may touch zero, and its least size at these rows."""
        values, along = test(self.points), OFFSET * self.tangents * self.scales
        slopes = (test(self.points + along) - test(self.points - along)) / (2.0 * OFFSET)
        lengths = np.linalg.norm(np.diff(self.points, axis=0) / self.scales[1:], axis=1)
        for a, b in touches(values, slopes, lengths):
            yield a, b, float(min(abs(values[a]), abs(values[b])))

    def _fold(self, a: int, b: int, low: np.ndarray, high: np.ndarray) -> None:
        """The fold between two points, which lie between rows a and b."""
        tracer, across = self.tracer, self._chord(a, b)
        u = self._root(a, low, high, lambda u: float(tracer.tangent(u, across)[0]))
        if u is not None:
            u = polished(tracer, self.problem, identity, u)
            if self._is_new(u):
                self._add_fold(a, b, u)

    def _touch(self, a: int, b: int, u: np.ndarray) -> None:
        """det g_y touches zero at u: a cusp of the layer problem where M0 is vertical, else a branch point."""
        if abs(self.tracer.tangent(u, self._chord(a, b))[0]) > VERTICAL:
            if self._is_new(u):
                place = self._place(a, b, u)
                self.found.append((place, branch_point(self.problem, u, CurveCrossing(0.0, NONE))))
            return
        try:
            system = singular_near(self.problem, identity, u, self.scales[a])
        except np.linalg.LinAlgError:
            return
        low, high = self.points[a], self.points[b]
        cusp = self._root(a, low, high, lambda u: fold_coefficient(system, u))
        if self._is_new(u):
            self._add_fold(a, b, u if cusp is None else cusp)

    def _least(self, a: int, b: int, test: Callable[[np.ndarray], np.ndarray]) -> tuple[np.ndarray, float]:
        self.tracer.scales = self.scales[a]
        return least_between(self.tracer, self.points[a : b + 1], test)

    def _add_fold(self, a: int, b: int, u: np.ndarray) -> None:
        around = self.points[max(a - AROUND, 0) : b + AROUND + 1]
        scales = self.tracer.scales
        bent = curvature(self.problem, around, scales)
        point = fold_point(self.problem, u, scales=scales, curvature=bent, sizes=self.sizes)
        self.found.append((self._place(a, b, u), point))

    def _pairs(self) -> None:
        tests = self._pair_tests(self.points)
        # Where some eigenvalues are much smaller than others all along the curve, so is the product.
        for a, b in sign_changes(tests / min(np.max(np.abs(tests), initial=0.0) or 1.0, 1.0)):
            self._pair(a, b, self.points[a], self.points[b])
        for a, b, ends in self._turns(self._pair_tests):
            u, value = self._least(a, b, self._pair_tests)
            if value < 0.0:
                self._pair(a, b, self.points[a], u)
                self._pair(a, b, u, self.points[b])
            elif value <= TOUCH * ends:
                self._pair(a, b, u, u)

    @cached_property
    def sizes(self) -> np.ndarray:
        """Sizes of the eigenvalues along the curve (n_fast,)."""
        return eigenvalue_sizes(self.problem.eigenvalues(self.points))

    def _pair_tests(self, u: np.ndarray) -> np.ndarray:
        return pair_test(self.problem.eigenvalues(u))

    def _pair(self, a: int, b: int, low: np.ndarray, high: np.ndarray) -> None:
        """The Hopf point or neutral saddle between two points, which lie between rows a and b."""
        tracer = self.tracer
        u = self._root(a, low, high, lambda u: float(self._pair_tests(u[None, :])[0]))
        if u is None or not self._is_new(u):
            return
        u = polished(tracer, self.problem, bialternate, u)
        tangent = tracer.tangent(u, self._chord(a, b)) * tracer.scales
        point = pair_point(self.problem, u, tangent, self.sizes)
        if point is not None and self._is_new(u):
            self.found.append((self._place(a, b, u), point))

    # -- rows --------------------------------------------------------------------------------------

    def _chord(self, a: int, b: int) -> np.ndarray:
        if a == b:
            return self.tangents[a]
        chord = (self.points[b] - self.points[a]) / self.scales[a]
        return chord / np.linalg.norm(chord)

    def _root(
        self, a: int, low: np.ndarray, high: np.ndarray, test: Callable[[np.ndarray], float]
    ) -> np.ndarray | None:
        self.tracer.scales = self.scales[a]
        self.tracer.counters.located += 1
        return low if low is high else self.tracer.root(low, high, test)

    def _place(self, a: int, b: int, u: np.ndarray) -> float:
        return place_between(self.points, a, b, u, self.tracer.scales)

    def _is_new(self, u: np.ndarray) -> bool:
        return all(np.linalg.norm((p.unknowns - u) / self.tracer.scales) > SAME_PLACE for _, p in self.found)
