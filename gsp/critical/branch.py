"""One branch of the critical manifold, explicit or implicit, and its points.

A branch is *explicit* when y = h_0(x) is known as an expression, and *implicit* otherwise: then it is given by
its equations and its points are found by Newton's method. Every later stage works on both.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
import sympy as sp

from gsp.algebra.brevity import brief, listed
from gsp.critical.common_units import own_sizes
from gsp.critical.own_equations import OwnEquations
from gsp.critical.sheet_continuation import LEAST_SHARE, PIECES, SheetContinuation
from gsp.critical.sheet_points import (
    NEWTON_STEPS,
    NEWTON_TOLERANCE,
    Allowance,
    guesses,
    place,
)
from gsp.critical.sheet_roots import fast_bounds, within
from gsp.errors import BranchError
from gsp.kernels.sheets import reach_sheet, reach_sheets
from gsp.lowering.compiled_function import compile_over, finite_rows
from gsp.results.card import Card
from gsp.results.tex import tex
from gsp.systems.flow import Point, Portable, as_points
from gsp.systems.region import Interval, check_region, in_units, powers_of_two, state_sizes
from gsp.systems.system import SlowFastSystem


@dataclass(frozen=True)
class Branch(Portable, Card):
    """One branch of the critical manifold of `system`.

    `equations` are as many as there are fast variables and vanish on the branch; `graph` maps each fast symbol
    to h_0(x), or is `None` when the branch is implicit; `seed` is a point (x, y) on the branch, or `None`, that
    singles out one sheet of an implicit branch. `units` are the sizes of the states, powers of two, in which Newton's
    method works; 1 for each unless `through` was told more.
    """

    system: SlowFastSystem
    equations: tuple[sp.Expr, ...]
    graph: Mapping[sp.Symbol, sp.Expr] | None
    seed: tuple[tuple[float, ...], tuple[float, ...]] | None = None
    units: tuple[float, ...] | None = field(default=None, compare=False)

    @property
    def is_explicit(self) -> bool:
        """Whether y = h_0(x) is known as an expression."""
        return self.graph is not None

    def points(self, x, *, near=None) -> np.ndarray:
        """Fast coordinates on the branch over the slow coordinates `x`.

        `x` is a mapping of names to numbers or arrays, or an array (m, n_slow) in the system's order; the
        result has shape (m, n_fast), or (n_fast,) for one point. On an implicit branch Newton's method starts at
        `near` (n_fast,) or (m, n_fast); without it the sheet is followed from the branch's `seed`, and without a
        seed the branch must have exactly one real point over `x`.

        Raises `BranchError` where the branch has no real point, or several and nothing to choose between them.
        """
        array, single = as_points(self.system.x, x, what="x")
        guess = None if near is None else guesses(near, len(array), self.system.y)
        if self.graph is not None:
            y = self.graph_values(array)
        elif guess is not None:
            y, good = self._own.corrected(array, guess)
            self._require(good, array, "Newton's method found no point near the given one")
        elif self.seed is not None:
            if len(array) == 1:
                y = self.over(array[0])[np.newaxis]
                return y[0] if single else y
            y, good = self.follow(array)
            if not good.all():
                self._require(good, array, self._ending(array[np.argmin(good)]))
        else:
            y = np.array([self._only(point) for point in array])
        return y[0] if single else y

    def roots(self, x, *, bounds: Mapping[str, Interval] | None = None) -> np.ndarray:
        """All real points (k, n_fast) of the branch over one slow point `x`, within `bounds` on fast variables.

        Complete when one fast variable enters as a polynomial; otherwise from 64 points of the bounds, required then.
        """
        array, _ = as_points(self.system.x, x, what="x")
        point = array[0]
        if self.graph is not None:
            found = self.graph_values(point[None, :], allow_complex=True)
            found = found[np.isfinite(found).all(axis=1)]
        elif self._own.is_polynomial:
            found = self._own.polynomial_roots(point, bounds)
        else:
            found = self._scattered_roots(point, bounds)
        found = found[within(found, self.system.y, bounds or {})]
        return found

    def nearest(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points over `x` (m, n_slow) that Newton's method reaches from `y` (m, n_fast), and where it does.

        On an explicit branch h_0(x), wherever it is finite.
        """
        if self.graph is not None:
            found = self.graph_values(x, allow_complex=True)
            return found, finite_rows(found)
        return self._own.corrected(x, y)

    def through(self, point: Point, *, region: Mapping[str, object] | None = None) -> Branch:
        """The same branch with its sheet fixed: the one nearest to `point`, which names x and y.

        With `region` it is the nearest within its bounds on fast variables, where one is. Unless one fast variable
        enters as a polynomial, sheets are those to which Newton's method comes: with up to five fast variables from
        places about the point and within the bounds. Raises `BranchError` when there is no real point over x.
        """
        x, y = (part[None, :] for part in place(self.system, point))
        bounds = fast_bounds(self.system, region)
        own = self._in_units_of(dict(zip([s.name for s in self.system.states], [*x[0], *y[0]])), region)
        if self.graph is not None:
            return own
        if own._own.is_polynomial:
            candidates, fact = own._own.polynomial_roots(x[0], bounds), "there is no real point"
        else:
            candidates = own._own.roots_near(x[0], y[0], bounds)
            fact = "Newton's method found no point near the given one"
        self._require(np.array([len(candidates) > 0]), x, fact)
        outside = ~within(candidates, self.system.y, bounds)
        chosen = candidates[np.lexsort((np.linalg.norm((candidates - y) / own.scales[1], axis=1), outside))[0]]
        return replace(own, seed=(tuple(x[0]), tuple(chosen)))

    def _in_units_of(self, point: Mapping[str, float], region: Mapping[str, object] | None) -> Branch:
        """The same branch with the sizes of its states in `region` and at the point, unless it has them.

        A point alone does not tell what is small beside it.
        """
        if self.units is not None or region is None:
            return self
        names = [s.name for s in self.system.states]
        # How far a state is from the origin is no size of what it does.
        centre = dict(zip(names, self.system.centre.tolist()))
        sizes = state_sizes(
            self.system.box_from_centres(check_region(region, names)),
            {name: value - centre[name] for name, value in point.items()},
        )
        return replace(self, units=tuple(powers_of_two([sizes.get(name, 1.0) for name in names]).tolist()))

    def in_own_units(self, point: np.ndarray, bounds: Mapping[str, Interval] | None = None) -> Branch:
        """The same branch with the sizes of its states at `point` (n,) and in bounds, where no region has told them."""
        if self.units is not None:
            return self
        system, centre = self.system.about_centres, self.system.centre
        return replace(self, units=tuple(powers_of_two(own_sizes(system, point - centre, bounds)).tolist()))

    def moved_into(self, units: np.ndarray) -> Branch:
        """The branch of the same system with its states in `units` (n,), powers of two; itself where each is 1."""
        return self if (units == 1.0).all() else _moved_into(self, tuple(units.tolist()))

    @cached_property
    def about_centres(self) -> Branch:
        """The branch of the system about its centres; itself where that has none."""
        system, found, centre = self.system, self.system.centres, self.system.centre
        if not found:
            return self
        there = {s: s + c for s, c in found.items()}
        x, y = np.split(centre, [len(system.x)])
        return replace(
            self,
            system=system.about_centres,
            equations=tuple(e.xreplace(there) for e in self.equations),
            graph=self.graph and {s: h.xreplace(there) - found.get(s, 0) for s, h in self.graph.items()},
            seed=self.seed and (tuple((self.seed[0] - x).tolist()), tuple((self.seed[1] - y).tolist())),
        )

    @property
    def scales(self) -> tuple[np.ndarray, np.ndarray]:
        """The `units` of x (n_slow,) and of y (n_fast,)."""
        return self._own.scales

    @cached_property
    def _own(self) -> OwnEquations:
        units = np.array(self.units or [1.0] * len(self.system.states))
        return OwnEquations(self.system, self.equations, units)

    def follow(
        self,
        x: np.ndarray,
        *,
        start: tuple[np.ndarray, np.ndarray] | None = None,
        allowance: Allowance | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The sheet through `start` over `x` (m, n_slow): y (m, n_fast), and which points it reaches.

        `start` is (x, y), one point (n,) or one for each row (m, n), on the branch; the seed unless given. Euler
        steps and Newton corrections along straight lines in x. A point is given up where the steps vanish, or when
        `allowance` has none left.
        """
        n = len(self.system.y)
        if len(x) == 0:
            return np.empty((0, n)), np.ones(0, dtype=bool)
        given = self.seed if start is None else start
        assert given is not None
        x0 = np.broadcast_to(np.asarray(given[0], dtype=float), x.shape)
        y0 = np.broadcast_to(np.asarray(given[1], dtype=float), (len(x), n))
        own = self._own
        y, good = self._continuation.follow(own.x_in(x), *own.points_in(x0, y0), allowance=allowance)
        return own.y_out(y), good

    def over(self, point: np.ndarray) -> np.ndarray:
        """The sheet of the seed over one slow point (n_slow,): y (n_fast,), as `points` has it."""
        y = np.empty(len(self.system.y))
        # In compiled code as far as the line need not be cut anew.
        if reach_sheet(self._sheet, point, y):
            return y
        rows = point[np.newaxis]
        found, good = self.follow(rows)
        if not good[0]:
            self._require(good, rows, self._ending(point))
        return found[0]

    def over_each(self, points: np.ndarray) -> np.ndarray:
        """`over` at each of `points` (m, n_slow): y (m, n_fast), not a number where the line must be cut anew."""
        y, found = np.empty((len(points), len(self.system.y))), np.empty(len(points), np.bool_)
        reach_sheets(self._sheet, points, y, found)
        y[~found] = np.nan
        return y

    @cached_property
    def _sheet(self) -> np.ndarray:
        """What `reach_sheet` takes of the branch and its seed."""
        assert self.seed is not None
        own = self._own
        addresses = own.residual.address, own.jacobian.address, own.slow_jacobian.address
        x, y = own.points_in(*(np.array([part]) for part in self.seed))
        numbers = np.array([NEWTON_TOLERANCE, *x[0], *y[0], *own.units, *self.system.centre, *own.values])
        return np.array([*addresses, NEWTON_STEPS, len(PIECES), *PIECES, *numbers.view(np.int64)])

    def _ending(self, target: np.ndarray) -> str:
        """Where the seed's sheet ends on the way to `target`."""
        assert self.seed is not None
        x0, y0, own = np.array(self.seed[0]), np.array([self.seed[1]]), self._own
        y, share = self._continuation.walked(*own.points_in(x0[None, :], y0), own.x_in(target[None, :]))
        end = self._shown(x0 + share[0] * (target - x0))
        begun = f"the sheet through {self._shown(x0)}"
        # Even the root of a pole is that large where so little of the way is left.
        if np.abs(y[0]).max() > LEAST_SHARE**-0.5:
            return f"{begun} goes to infinity at {end} and has no point"
        last = self.system.place(zip(self.system.y, own.y_out(y[0])))
        return f"{begun} ends at {end}, {last} (a fold?) and has no point"

    @property
    def _continuation(self) -> SheetContinuation:
        own = self._own
        return SheetContinuation(own.newton, own.jacobian, own.slow_jacobian, own.values)

    # -- evaluation --------------------------------------------------------------------------------

    def residual(self, z: np.ndarray) -> np.ndarray:
        """The branch's equations at points z = (x, y), (m, n): (m, n_fast)."""
        return self._own.residual_at(z)

    def full_jacobian(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of the branch's equations by (x, y) at points z (m, n): (m, n_fast, n)."""
        return self._own.jacobian_at(z)

    @cached_property
    def _graph_function(self):
        assert self.graph is not None
        outputs = tuple(self.graph[y] for y in self.system.y)
        return compile_over(self.system, outputs, arguments=self.system.x)

    def graph_values(self, x: np.ndarray, *, allow_complex: bool = False) -> np.ndarray:
        y = self._graph_function(x, self._own.values)
        if not allow_complex:
            self._require(finite_rows(y), x, "the branch is complex or singular")
        return y

    def _only(self, point: np.ndarray) -> np.ndarray:
        if not self._own.is_polynomial:
            raise BranchError(
                f"the branch {self} is implicit and may have several points over {self._shown(point)}.",
                "Pass near=..., or fix a sheet with branch.through({...}).",
            )
        found = self._own.polynomial_roots(point)
        if len(found) == 1:
            return found[0]
        values = ", ".join(f"{value:.6g}" for value in found[:, 0])
        fact = f"has {len(found)} points" + (f" ({self.system.y[0]} = {values})" if len(found) else "")
        remedy = "Pass near=..., or fix a sheet with branch.through({...})." if len(found) else "Move x."
        raise BranchError(f"the branch {self} {fact} over {self._shown(point)}.", remedy)

    def _scattered_roots(self, point: np.ndarray, bounds) -> np.ndarray:
        missing = [y.name for y in self.system.y if not bounds or y.name not in bounds]
        if missing:
            if self.seed is not None:
                y, good = self.follow(point[None, :])
                return y[good]
            raise BranchError(
                f"the branch {self} is implicit and its points cannot all be found without bounds on "
                f"{', '.join(missing)}.",
                "Give the region an interval for each, or fix a sheet with through().",
            )
        return self._own.roots_within(point, bounds)

    def _shown(self, point: np.ndarray) -> str:
        return self.system.place(zip(self.system.x, point))

    def _require(self, good: np.ndarray, x: np.ndarray, fact: str) -> None:
        if not good.all():
            first = x[np.argmin(good)]
            share = f" ({int((~good).sum())} of {len(good)} points)" if len(good) > 1 else ""
            raise BranchError(
                f"{fact} over {self._shown(first)}{share} on the branch {self}.",
                f"Move or shrink the range of {', '.join(s.name for s in self.system.x)}.",
            )

    def __str__(self) -> str:
        sides = [(e, 0) for e in self.equations] if self.graph is None else self.graph.items()
        return listed(f"{brief(left)} = {brief(right)}" for left, right in sides)

    def __repr__(self) -> str:
        return f"Branch({self})"

    def _repr_latex_(self) -> str:
        sides = [(e, 0) for e in self.equations] if self.graph is None else self.graph.items()
        rows = [f"{tex(left)} = {tex(right)}" for left, right in sides]
        return r"$\displaystyle " + r",\quad ".join(rows) + "$"

    def __hash__(self) -> int:
        return hash((self.system, self.equations, self.seed))


# Points of one manifold are asked for again and again, in units that change with them or not.
@lru_cache(maxsize=16)
def _moved_into(branch: Branch, units: tuple[float, ...]) -> Branch:
    system, own = branch.system, np.array(units)
    sizes = dict(zip(system.states, own))
    x_units, y_units = np.split(own, [len(system.x)])
    return replace(
        branch,
        system=system.moved_into(own),
        # Their zeros are the same, whatever they are divided by.
        equations=tuple(in_units(dict(zip(system.y, branch.equations)), sizes).values()),
        graph=None if branch.graph is None else in_units(branch.graph, sizes),
        seed=branch.seed
        and (tuple((branch.seed[0] / x_units).tolist()), tuple((branch.seed[1] / y_units).tolist())),
        units=branch.units and tuple((np.array(branch.units) / own).tolist()),
    )
