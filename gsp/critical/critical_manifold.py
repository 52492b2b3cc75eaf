"""The critical manifold M0 = {g(x, y, 0) = 0}, branch by branch; a branch is an irreducible piece of M0."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

import numpy as np
import sympy as sp

from gsp.algebra.brevity import brief
from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.critical.branch import Branch
from gsp.critical.elimination import pieces
from gsp.critical.layer_problem import LayerProblem
from gsp.critical.saturation import saturates
from gsp.critical.sheet_points import place
from gsp.critical.sheet_roots import fast_bounds, within
from gsp.errors import BranchError, GspError
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.results.card import Card
from gsp.splitting.splitting import split
from gsp.systems.arguments import check_noun
from gsp.systems.declaration import exact
from gsp.systems.flow import Point
from gsp.systems.region import check_region
from gsp.systems.system import SlowFastSystem, VectorField

# A start counts as on a fold when the equations and their slopes are this small there, relative to their terms.
ON_FOLD = 1e-6


@dataclass(frozen=True)
class CriticalManifold(Card):
    """M0 of `system`: its `branches`, and in `unsolved` the equations of pieces that are no graph over x.

    Such a piece is an expression that vanishes on it, or a `Tuple` of several that all do: a surface where there should
    be a line, or what lies over a part of x only. Pieces without real points over any open set of x (such as
    y^2 + 1 = 0) are in neither; they are listed in `complex`.
    """

    system: SlowFastSystem
    branches: tuple[Branch, ...]
    unsolved: tuple[sp.Basic, ...] = ()
    complex: tuple[sp.Expr, ...] = ()

    @property
    def no_graph(self) -> str:
        """The equations of the `unsolved` pieces in a line of text; empty where there are none."""
        return _shown(self.unsolved)

    def nearest(self, point: Point, *, region: Mapping[str, object] | None = None) -> Branch:
        """The branch (on implicit branches the sheet) nearest to `point` in the fast direction.

        With `region` it is the nearest within its bounds on fast variables, and the nearest of all where none is.
        """
        x, y = place(self.system, point)
        bounds = fast_bounds(self.system, region)
        best: tuple[tuple[bool, float], Branch] | None = None
        reasons = []
        for branch in self.branches:
            try:
                sheet = branch.through(point, region=region)
                height = sheet.points(x[None, :], near=None if sheet.seed is None else sheet.seed[1])
                outside = not within(height, self.system.y, bounds)[0]
                distance = (outside, math.hypot(*((height[0] - y) / sheet.scales[1])))
            except BranchError as error:
                reasons.append(error.reason)
                continue
            if best is None or distance < best[0]:
                best = (distance, sheet)
        # On a fold Newton's method comes to no end, where beside it it finds the sheet.
        # Then its sheets are about a root of that away.
        lost = best is None or (best[0][1] <= 1e-2 and not best[1].nearest(x[None, :], y[None, :])[1][0])
        if lost and any(_is_fold(branch, x, y) for branch in self.branches):
            raise BranchError(
                "the start lies on a fold of the critical manifold, where two sheets meet and none is nearest.",
                "Move the start along one of the sheets.",
                got=self._told(x, y),
            )
        middle = _between_fields(self.system, x, y) if best is None else None
        if middle is not None:
            return self.nearest(middle, region=region)
        if best is None:
            raise BranchError(
                f"no branch of the critical manifold is real near the start: {'; '.join(r.fact for r in reasons)}.",
                "Move the start's slow variables to where one is.",
            )
        self._refuse_far_branch(x, y, best[0][1])
        sheet = self._with_its_digits(best[1], x, region)
        if sheet.seed is not None:
            y = sheet.points(x[None, :], near=sheet.seed[1])[0]
            if _is_fold(sheet, x, y):
                raise BranchError(
                    "the nearest sheet of the critical manifold ends right over the start, in a fold.",
                    "Move the start's slow variables to where the sheet goes on.",
                    got=self._told(x, y),
                )
        return sheet

    def _with_its_digits(self, branch: Branch, x: np.ndarray, region: Mapping[str, object] | None) -> Branch:
        """The branch without its formula where that loses digits, as -b + sqrt(b^2 - 4 a c) does beside a large b."""
        graph = branch.graph or {}
        if all(power.exp.is_integer for h in graph.values() for power in h.atoms(sp.Pow)):
            return branch
        box = {} if region is None else check_region(region, [s.name for s in self.system.states])
        places = [x]
        for column, s in enumerate(self.system.x):
            for side in box.get(s.name, ()):
                places.append(np.where(np.arange(len(x)) == column, side, x))
        if not _loses_digits(branch, np.array(places)):
            return branch
        layer = [laurent(g, self.system.epsilon, order=0).get(0, sp.Integer(0)) for g in self.system.g]
        whole = Branch(self.system, tuple(sp.together(g).as_numer_denom()[0] for g in layer), None)
        here = (*x, *branch.graph_values(x[None, :])[0])
        try:
            return whole.through({s.name: float(v) for s, v in zip(self.system.states, here)}, region=region)
        except BranchError:
            # Where Newton's method comes to nothing either, the conditions say how far the formula is off.
            return branch

    def _told(self, x: np.ndarray, y: np.ndarray) -> str:
        return self.system.place(zip(self.system.states, (*x, *y)))

    def _refuse_far_branch(self, x: np.ndarray, y: np.ndarray, distance: float) -> None:
        """Raise `BranchError` when a piece that is no graph over x passes nearer to the point than every branch."""
        system = self.system
        for piece in self.unsolved:
            equations = _equations(piece)
            slopes = [derivative(equation, s) for equation in equations for s in system.y]
            values = _values([*equations, *slopes], system, x, y)
            if not np.isfinite(values).all():
                continue
            height, matrix = values[: len(equations)], values[len(equations) :].reshape(len(equations), -1)
            # To first order, and in the fast directions, as the distance of a branch is meant.
            step = np.linalg.lstsq(matrix, -height)[0]
            left = np.linalg.norm(height + matrix @ step)
            if matrix.any() and left <= ON_FOLD * np.linalg.norm(height) and np.linalg.norm(step) < distance:
                raise BranchError(
                    f"the start is nearest to the piece {_shown([piece])} of the critical manifold, which is no graph "
                    f"of {', '.join(map(str, system.y))} over the slow variables {', '.join(map(str, system.x))}; the "
                    f"nearest branch is {distance:.3g} away.",
                    _hidden_time_scale(system),
                )

    def __repr__(self) -> str:
        no_graph = f"; no graph: {self.no_graph}" if self.unsolved else ""
        return f"CriticalManifold({', '.join(map(str, self.branches))}{no_graph})"

    __str__ = __repr__


def _values(expressions: Sequence[sp.Expr], system: SlowFastSystem, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Values (k,) at one point, not a number where an expression is not real there."""
    function = compile_over(system, expressions)
    return function(np.concatenate([x, y]), compile_flow(system).constants)


def _between_fields(system: SlowFastSystem, x: np.ndarray, y: np.ndarray) -> dict[str, float] | None:
    """The point with 0 for fast variables that g saturates in, as for v = s/epsilon far off a switch; None for no such.

    Far off nothing leads to where the field slides, at 0 all does.
    """
    problem, u = LayerProblem.over_all(system), np.concatenate([x, y])
    moved = u.copy()
    for column in range(len(x), len(u)):
        if saturates(problem, u, column):
            moved[column] = 0.0
    if np.array_equal(moved, u):
        return None
    return dict(zip((s.name for s in system.states), moved.tolist()))


def _loses_digits(branch: Branch, places: np.ndarray) -> bool:
    """Whether doubles lose more than five digits of the graph over `places` (m, n_slow), by its largest value."""
    assert branch.graph is not None
    parameters = dict(branch.system.parameters)
    found = branch.graph_values(places, allow_complex=True)
    for column, h in zip(found.T.tolist(), branch.graph.values()):
        points = [{s: exact(v) for s, v in zip(branch.system.x, place)} for place in places.tolist()]
        precise = [sp.N(h.xreplace(point | parameters), 40) for point in points]
        pairs = [(v, e) for v, e in zip(column, precise) if np.isfinite(v) and e.is_real]
        largest = max((abs(e) for _, e in pairs), default=0)
        if any(abs(value - e) > 1e-11 * largest for value, e in pairs):
            return True
    return False


def _is_fold(branch: Branch, x: np.ndarray, y: np.ndarray) -> bool:
    """Whether the branch's equations E and E_y are both singular at a point, to `ON_FOLD` of their terms' sizes."""
    centre, branch = branch.system.centre, branch.about_centres
    system = branch.system
    x, y = x - centre[: len(x)], y - centre[len(x) :]

    def at(expressions: Sequence[sp.Expr]) -> tuple[np.ndarray, np.ndarray]:
        """Values of sums, and the sums of their terms' magnitudes."""
        terms = [sp.Add.make_args(e) for e in expressions]
        values = _values([term for row in terms for term in row], system, x, y)
        rows = np.split(values, np.cumsum([len(row) for row in terms])[:-1])
        return np.array([row.sum() for row in rows]), np.array([np.abs(row).sum() for row in rows])

    residuals, sizes = at(branch.equations)
    if not (np.abs(residuals) <= ON_FOLD * sizes).all():
        return False
    slopes, sizes = at([derivative(e, s) for e in branch.equations for s in system.y])
    if not np.isfinite(slopes).all():
        return False
    matrix, sizes = (m.reshape(len(branch.equations), -1) for m in (slopes, sizes))
    # By the largest term of each equation, and then of each variable: units and factors decide nothing.
    for axis in (1, 0):
        largest = sizes.max(axis=axis, keepdims=True)
        matrix, sizes = (m / np.where(largest > 0.0, largest, 1.0) for m in (matrix, sizes))
    return bool(np.linalg.svd(matrix, compute_uv=False)[-1] <= ON_FOLD)


@np.errstate(all="ignore")
def solve_critical(system: SlowFastSystem) -> CriticalManifold:
    """The critical manifold of a system in standard form.

    Rational and quadratic equations, and equations that one inverse function solves, give explicit branches;
    the rest (a cubic, say: Cardano's formula is complex on the real sheets) give implicit ones.
    Raises `BranchError` when g has no real zeros, or none that are a graph over x.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> solve_critical(SlowFastSystem(slow={x: y}, fast={y: y**2 - x**2}, epsilon=eps))
    CriticalManifold(y = x, y = -x)
    """
    check_noun(system, SlowFastSystem, verb="solve_critical")
    _refuse_constants(system)
    found = pieces(system)
    branches = tuple(
        Branch(system, equations, None if graph is None else MappingProxyType({y: graph[y] for y in system.y}))
        for equations, graph in found.solved
    )
    if not branches:
        unknown = ", ".join(map(str, system.y))
        if found.unsolved:
            raise BranchError(
                f"the critical manifold {{{_shown(found.unsolved)}}} is no graph of {unknown} over the slow "
                f"variables {', '.join(map(str, system.x))}.",
                _hidden_time_scale(system),
            )
        shown = _shown(found.vanished) if found.vanished else ", ".join(f"{g} = 0" for g in system.g)
        raise BranchError(
            f"g has no real zeros over the slow variables: {shown} has no real solution for {unknown} at "
            "which the rates are defined.",
            "There is no critical manifold to reduce to.",
        )
    return CriticalManifold(system, branches, tuple(found.unsolved), tuple(found.vanished))


def _hidden_time_scale(system: SlowFastSystem) -> str:
    """What to declare instead: when some of the fast variables are slow in disguise, their slow combinations."""
    field = VectorField(
        dict(zip(system.states, system.rates)), epsilon=system.epsilon, parameters=system.parameters
    )
    try:
        better = split(field)
    except GspError:
        better = None
    if better is None or better.system is None or len(better.system.y) >= len(system.y):
        return "Take other variables as slow, or rescale."
    slow = [
        f"{s} = {phi}" if s != phi else str(s) for s, phi in better.coordinates.items() if s in better.system.x
    ]
    fast = len(better.system.y)
    return (
        f"A time scale is hidden in the fast block: of its {len(system.y)} directions {fast} "
        f"{'is' if fast == 1 else 'are'} fast. Declare {', '.join(slow)} as slow, or split the VectorField."
    )


def _equations(piece: sp.Basic) -> tuple[Any, ...]:
    return tuple(piece) if isinstance(piece, sp.Tuple) else (piece,)


def _shown(pieces: Sequence[sp.Basic]) -> str:
    return ", ".join(" and ".join(f"{brief(e)} = 0" for e in _equations(piece)) for piece in pieces)


def _refuse_constants(system: SlowFastSystem) -> None:
    for y, rate in system.fast.items():
        if not laurent(rate, system.epsilon, order=0):
            raise BranchError(
                f"the fast rate of {y} vanishes identically at {system.epsilon} = 0.",
                f"Declare {y} as slow, with the rate divided by {system.epsilon}.",
                got=f"g = {rate}",
                value=rate,
            )
