"""Folded singularities: where slow orbits cross a fold of the critical manifold, and how many ways there are.

The folded singularities of epsilon y' = g(x, y, epsilon), x' = f(x, y, epsilon), one fast y and slow x, are the
equilibria on the fold of the desingularised reduced flow: g = g_y = 0, q = g_x . f = 0 (Szmolyan and Wechselberger,
J. Differential Equations 177 (2001) 419-453; Wechselberger, Trans. Amer. Math. Soc. 364 (2012) 3289-3309). Its two
eigenvalues there that are not 0 for structural reasons decide how orbits cross.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.algebra.algebraic_numbers import InfinitelyManyPoints
from gsp.algebra.differentiation import derivative
from gsp.algebra.switching_functions import switches
from gsp.critical.sampling import grid
from gsp.lowering.compiled_function import compile_function
from gsp.results.card import Card
from gsp.singular.singularities.desingularised import Desingularised, FoldedError, desingularise
from gsp.singular.singularities.located_points import Located, locate
from gsp.systems.declaration import exact
from gsp.systems.flow import in_words
from gsp.systems.region import Interval, check_region, is_within
from gsp.systems.system import SlowFastSystem


class FoldedKind(StrEnum):
    """What the desingularised reduced flow has on the fold."""

    NODE = "folded node"
    SADDLE = "folded saddle"
    FOCUS = "folded focus"
    SADDLE_NODE_I = "folded saddle-node I"
    SADDLE_NODE_II = "folded saddle-node II"
    DEGENERATE = "degenerate folded singularity"

    @property
    def has_canards(self) -> bool:
        """Whether orbits cross the fold here in finite time."""
        return self in (FoldedKind.NODE, FoldedKind.SADDLE, FoldedKind.SADDLE_NODE_I, FoldedKind.SADDLE_NODE_II)


@dataclass(frozen=True, eq=False, repr=False)
class FoldedSingularity(Card):
    """A folded singularity: its `kind`, `point` by name, `eigenvalues` and what follows.

    - `eigenvalues` are the two of `Desingularised`, the larger in modulus first; `trace` and `determinant` T and D;
    - `mu` is lambda_w/lambda_s in (0, 1] at a node, 0 at a saddle-node, `None` elsewhere;
    - `s_max` = floor((mu + 1)/(2 mu)) at a node, else `None`: how often the sheets twist about the weak canard
      (Wechselberger, SIAM J. Appl. Dyn. Syst. 4 (2005) 101-139; Brons, Krupa and Wechselberger, 2006);
    - `secondary_canards` = s_max - 1 at a node with negative eigenvalues, else 0;
    - `is_resonant`: 1/mu is an odd whole number from 3 on, where the last secondary canard leaves the weak one;
    - `to_repelling`: whether orbits go from the attracting to the repelling sheet along the canards: at nodes and
      saddle-nodes with negative eigenvalues, and along one of the two directions of a saddle. At a node with
      positive eigenvalues there are faux canards only;
    - `is_exact`: point and eigenvalues are exact numbers; floats of many digits otherwise;
    - `reason` says what is degenerate, and is empty otherwise.
    """

    system: SlowFastSystem
    kind: FoldedKind
    point: Mapping[str, sp.Expr]
    eigenvalues: tuple[sp.Expr, sp.Expr]
    trace: sp.Expr
    determinant: sp.Expr
    mu: sp.Expr | None
    s_max: int | None
    secondary_canards: int
    is_resonant: bool
    to_repelling: bool
    is_exact: bool
    reason: str

    def __getitem__(self, name: str) -> sp.Expr:
        return self.point[name]

    def is_in(self, region: Mapping[str, Interval]) -> bool:
        """Whether no variable that the region bounds is outside it."""
        return is_within(self.numbers(), region)

    def numbers(self) -> dict[str, float]:
        """The point in doubles."""
        return {name: float(value) for name, value in self.point.items()}

    def moved_to(self, system: SlowFastSystem, centres: Mapping[sp.Symbol, sp.Expr]) -> FoldedSingularity:
        """The same as one of `system`, where this is one about the `centres`."""
        far = {s.name: c for s, c in centres.items()}
        point = {name: value + far.get(name, 0) for name, value in self.point.items()}
        return replace(self, system=system, point=MappingProxyType(point))

    def as_dict(self) -> dict[str, object]:
        """Its numbers in plain values."""
        return {
            "kind": str(self.kind),
            "point": self.numbers(),
            "eigenvalues": [[float(sp.re(v)), float(sp.im(v))] for v in self.eigenvalues],
            "mu": None if self.mu is None else float(self.mu),
            "s_max": self.s_max,
            "secondary_canards": self.secondary_canards,
            "to_repelling": self.to_repelling,
            "reason": self.reason,
        }

    def __repr__(self) -> str:
        tail = "" if self.mu is None else f", mu = {float(self.mu):.6g}"
        return f"FoldedSingularity({self.kind.value} at {in_words(self.numbers())}{tail})"

    def __str__(self) -> str:
        lines = [f"{self.kind.value} at " + ", ".join(f"{n} = {sp.N(v, 10)}" for n, v in self.point.items())]
        lines.append("  eigenvalues " + ", ".join(str(sp.N(v, 10)) for v in self.eigenvalues))
        if self.mu is not None:
            lines.append(f"  mu = {sp.N(self.mu, 10)}")
        if self.kind is FoldedKind.NODE and not self.to_repelling:
            lines.append("  its canards lead from the repelling to the attracting sheet: faux canards only")
        elif self.s_max is not None:
            lines.append(f"  s_max = {self.s_max}, secondary canards: {self.secondary_canards}")
        if self.reason:
            lines.append(f"  {self.reason}")
        return "\n".join(lines)


def folded_singularities(
    system: SlowFastSystem, *, region: Mapping[str, Interval] | Mapping[sp.Symbol, Interval]
) -> tuple[FoldedSingularity, ...]:
    """The folded singularities in a region of a system with one fast and two slow variables.

    `region` bounds states by (low, high); for rational systems with few solutions, found exactly, some suffice.
    Others need every state bounded: Newton's method starts from samples of the box, and singularities that no start
    leads to are missed. Points on the edge of the region count. Empty when every fold in the region is a jump.

    Raises `FoldedError` when there is no fold, with one slow variable (use `canard_value`), and when the
    singularities are not isolated, as with more than two slow variables; `folded_singularity` classifies one of those.

    >>> x, z, y, eps = sp.symbols("x z y epsilon")
    >>> node = SlowFastSystem(
    ...     slow={x: z/18 - 10*y/9, z: 1}, fast={y: x + y**2}, epsilon=eps)
    >>> folded_singularities(node, region={"y": (-1, 1)})
    (FoldedSingularity(folded node at x = 0, z = 0, y = 0, mu = 0.111111),)
    """
    flow = desingularise(system)
    if len(flow.x) == 1:
        raise FoldedError(
            "with one slow variable an equilibrium meets the fold only for single parameter values.",
            "Use canard_value.",
        )
    names = [s.name for s in system.states]
    box = check_region(region, names)
    if len(flow.x) > 2:
        raise FoldedError(
            f"with {len(flow.x)} slow variables the folded singularities form a manifold of dimension "
            f"{len(flow.x) - 2}; they are not isolated.",
            "Classify single ones with folded_singularity(system, near=...) of "
            "gsp.singular.singularities.folded_singularities.",
        )
    if system.centres:
        own = folded_singularities(system.about_centres, region=system.box_from_centres(box))
        return tuple(found.moved_to(system, system.centres) for found in own)
    sides = [box.get(name, (0.0, 1.0)) for name in names]
    units = np.array([high - low for low, high in sides])

    def points_of(g: sp.Expr) -> list[Located]:
        q = sp.Add(*[derivative(g, s) * rate for s, rate in zip(flow.x, flow.f)])
        starts = _starts(flow, region, names)
        return locate((g, derivative(g, flow.y), q), system.states, starts=starts, units=units)

    try:
        try:
            points = points_of(flow.g)
        except InfinitelyManyPoints:
            # Where sheets cross, g = g_y = q = 0 all along, and there is no fold: each is looked at by itself.
            sheets = _sheets(flow)
            points = [
                point
                for sheet in sheets
                for point in points_of(sheet)
                if all(point.sign(other) for other in sheets if other is not sheet)
            ]
    except InfinitelyManyPoints:
        raise _along_a_curve(flow) from None
    found = tuple(_classified(system, flow, p) for p in points if _inside(p, box))
    # A zero eigenvalue is a coincidence; several that Newton's method finds are places on a curve.
    single = (FoldedKind.SADDLE, FoldedKind.NODE, FoldedKind.FOCUS)
    if sum(not (p.is_exact or p.kind in single) for p in found) > 1:
        raise _along_a_curve(flow)
    return found


def _sheets(flow: Desingularised) -> tuple[sp.Expr, ...]:
    """The factors of g, one for each sheet of the critical manifold, where g is rational and none is there twice."""
    numerator = sp.fraction(sp.together(flow.g))[0]
    try:
        factors = sp.factor_list(numerator, *flow.x, flow.y)[1]
    except sp.PolynomialError:
        return (flow.g,)
    return (flow.g,) if any(power > 1 for _, power in factors) else tuple(factor for factor, _ in factors)


def _along_a_curve(flow: Desingularised) -> FoldedError:
    return FoldedError(
        f"the folded singularities are not isolated: g = g_{flow.y} = g_x f = 0 along a curve.",
        "The slow flow is tangent to the fold all along, or sheets that cannot be told apart cross there.",
        got=f"g = {flow.g}, f = {', '.join(map(str, flow.f))}",
    )


def folded_singularity(
    system: SlowFastSystem, *, near: Mapping[str, float] | Mapping[sp.Symbol, float]
) -> FoldedSingularity:
    """The folded singularity over the slow values given in `near`, for one fast and any number of slow variables.

    With n slow variables `near` names every state: n - 2 slow ones are held at the exact values given (the last
    ones declared), and the others and the fast one are solved for from there. Raises `FoldedError` when Newton's
    method finds none.

    >>> x, z, u, y, eps = sp.symbols("x z u y epsilon")
    >>> system = SlowFastSystem(slow={x: u*z - y, z: 1, u: y}, fast={y: -x + y**2}, epsilon=eps)
    >>> folded_singularity(system, near={"x": 0, "z": 0, "u": -0.1, "y": 0}).kind
    <FoldedKind.NODE: 'folded node'>
    """
    flow = desingularise(system)
    start = dict(zip([s.name for s in system.states], system.initial(near)))
    if len(flow.x) < 2:
        raise FoldedError("with one slow variable there are canard points instead.", "Use canard_value.")
    held = {s: exact(start[s.name]) for s in flow.x[2:]}
    free = (*flow.x[:2], flow.y)
    equations = [e.xreplace(held) for e in (flow.g, flow.fold, flow.q)]
    try:
        points = locate(equations, free, starts=[[start[s.name] for s in free]])
    except InfinitelyManyPoints:
        raise FoldedError(
            f"the folded singularities over {held} are not isolated.",
            "Declare other slow variables last, to be held.",
        ) from None
    if not points:
        raise FoldedError(
            f"there is no folded singularity near {start}: g = g_{flow.y} = g_x f = 0 has no real solution "
            "there.",
            "The folds near by are jump points.",
        )
    point = min(points, key=lambda p: sum((p.numbers()[s] - start[s.name]) ** 2 for s in free))
    return _classified(system, flow, point, held=held)


def folded_saddle_node(system: SlowFastSystem, *, near: Mapping[str, float]) -> FoldedSingularity | None:
    """Where folded singularities meet as the third slow variable changes, which is at rest; None where they do not.

    One fast variable, `near` names every state. Solved are g = g_y = q = 0 with D = 0 of `Desingularised`.
    """
    flow = desingularise(system)
    start = dict(zip([s.name for s in system.states], system.initial(near)))
    unknowns = (*flow.x, flow.y)
    begun = np.array([start[s.name] for s in unknowns])
    units = np.where(begun != 0.0, np.abs(begun), 1.0)
    try:
        points = locate((flow.g, flow.fold, flow.q, flow.determinant), unknowns, starts=[begun], units=units)
    except InfinitelyManyPoints:
        return None
    if not points:
        return None

    def distance(point: Located) -> float:
        at = point.numbers()
        return max(abs(at[s] - b) / unit for s, b, unit in zip(unknowns, begun, units))

    return _classified(system, flow, min(points, key=distance))


def _starts(
    flow: Desingularised, region: Mapping[str, Interval] | Mapping[sp.Symbol, Interval], names: list[str]
) -> Iterator[np.ndarray]:
    """Samples of a region that bounds every state, those nearest to the fold first; not asked for by algebra."""
    box = check_region(region, names, required=names)
    samples = grid(np.array([box[name] for name in names], dtype=float))
    compiled = compile_function([flow.g, flow.fold, flow.q], arguments=(*flow.x, flow.y))
    values = np.abs(compiled(samples, [0.0]))
    scale = np.nanmedian(np.where(np.isfinite(values), values, np.nan), axis=0)
    size = np.where(np.isfinite(values), values, np.inf) / np.where(scale > 0.0, scale, 1.0)
    # Starts of Newton's method at most, for equations that are not rational.
    yield from samples[np.argsort(size.sum(axis=1))[:1500]]


def _inside(point: Located, box: Mapping[str, Interval]) -> bool:
    values = {symbol.name: value for symbol, value in point.numbers().items()}
    return all(
        low - 1e-12 * (high - low) <= values[name] <= high + 1e-12 * (high - low)
        for name, (low, high) in box.items()
    )


def _classified(
    system: SlowFastSystem,
    flow: Desingularised,
    located: Located,
    held: Mapping[sp.Symbol, sp.Rational] | None = None,
) -> FoldedSingularity:
    put = dict(held or {})

    def at(expression: sp.Expr) -> sp.Expr:
        return expression.xreplace(put)

    def sign(expression: sp.Expr) -> int:
        return located.sign(at(expression))

    T, D = flow.trace, flow.determinant
    trace, determinant = sign(T), sign(D)
    discriminant = sign(T**2 - 4 * D)
    kind, reason = FoldedKind.DEGENERATE, ""
    switching = [s.source for s in switches((*flow.f, flow.g), (*flow.x, flow.y)) if sign(s.surface) == 0]
    if switching:
        reason = f"the rates are not smooth here, where {switching[0]} switches"
    elif sign(derivative(derivative(flow.g, flow.y), flow.y)) == 0:
        reason = f"the fold is degenerate here, a cusp: g_{flow.y}{flow.y} = 0"
    elif all(sign(derivative(flow.g, s)) == 0 for s in flow.x):
        reason = "the critical manifold is singular here: g_x = 0"
    elif determinant < 0:
        kind = FoldedKind.SADDLE
    elif determinant > 0:
        kind = FoldedKind.NODE if discriminant >= 0 else FoldedKind.FOCUS
        if trace == 0:
            kind, reason = FoldedKind.DEGENERATE, "a folded centre: the eigenvalues are imaginary"
    elif trace == 0:
        reason = "both eigenvalues are 0"
    else:
        at_rest = all(sign(rate) == 0 for rate in flow.f)
        kind = FoldedKind.SADDLE_NODE_II if at_rest else FoldedKind.SADDLE_NODE_I
    values = {**{s: sp.sympify(v, strict=True) for s, v in put.items()}, **located.expressions()}
    t, d = located.value(at(T)), located.value(at(D))
    root = sp.sqrt(located.value(at(T**2 - 4 * D)))
    strong, weak = ((t - root) / 2, (t + root) / 2) if trace <= 0 else ((t + root) / 2, (t - root) / 2)
    if determinant == 0:
        strong, weak = t, sp.Integer(0)
    mu: sp.Expr | None = None
    s_max, resonant = None, False
    if kind in (FoldedKind.SADDLE_NODE_I, FoldedKind.SADDLE_NODE_II):
        mu = sp.Integer(0)
    elif kind is FoldedKind.NODE:
        mu = sp.Integer(1) if discriminant == 0 else weak / strong
        mu = sp.radsimp(mu) if t.is_Rational and d.is_Rational else mu
        s_max, resonant = _twists(located, at(T), at(D), discriminant)
    crossing = kind.has_canards and (trace < 0 or kind is FoldedKind.SADDLE)
    return FoldedSingularity(
        system=system,
        kind=kind,
        point=MappingProxyType({s.name: values[s] for s in system.states}),
        eigenvalues=(strong, weak),
        trace=t,
        determinant=d,
        mu=mu,
        s_max=s_max,
        secondary_canards=s_max - 1 if s_max is not None and crossing else 0,
        is_resonant=resonant,
        to_repelling=crossing,
        is_exact=located.exact is not None,
        reason=reason,
    )


def _twists(located: Located, T: sp.Expr, D: sp.Expr, discriminant: int) -> tuple[int, bool]:
    """s_max and whether 1/mu is an odd whole number, by comparing T^2/D = 1/mu + 2 + mu with its boundary values.

    s_max >= s exactly when 1/mu >= m = 2 s - 1, that is (T^2/D) m >= (m + 1)^2: no root is taken.
    """
    if discriminant <= 0:
        return 1, False
    ratio = float(sp.N(located.value(T), 30) ** 2 / sp.N(located.value(D), 30))
    inverse = (ratio - 2 + (max(ratio * (ratio - 4), 0.0)) ** 0.5) / 2
    s = max(1, int((inverse + 1) / 2) - 1)

    def reaches(s: int) -> int:
        m = 2 * s - 1
        return located.sign(m * T**2 - (m + 1) ** 2 * D)

    while reaches(s + 1) >= 0:
        s += 1
    return s, s > 1 and reaches(s) == 0
