"""Passage through a fold of the critical manifold: the delay of the slow variables and the drop that follows.

Let g_y have a simple eigenvalue 0 at the fold, l . g_y = 0, g_y r = 0, l . r = 1, |r| = 1, and v = l . (y - y_0),
s = l . g_x (x - x_0). On the centre manifold

    epsilon v' = a v^2 + s + c v^3 + ...,   s' = b + d v + ...,   x' = f + F v + ...,                          (1)

with a = l . g_yy(r, r)/2, b = l . g_x f, F = f_y r, d = l . g_x F. To leading order w = a v, sigma = a s solve
epsilon w' = w^2 + sigma, sigma' = a b, a Riccati equation that Airy's function solves: w escapes where
Ai(-(ab/epsilon^2)^(1/3) t) = 0, at t = Omega_0 (ab)^(-1/3) epsilon^(2/3), -Omega_0 the first zero of Ai. In any section
beyond the fold

    x = x_0 + f Omega_0 (ab)^(-1/3) epsilon^(2/3) + q epsilon ln epsilon + O(epsilon),                          (2)
    q = (f/b) (b c/a^2 - d/a)/3 - (F - f d/b)/(6a).

The first part of q comes from the growth of s with ln v after the escape, the second, absent for one slow variable,
from int v dt = -(epsilon/a) ln Ai along the fold: there x_0 is where the reduced orbit through the start meets the
fold. (Mishchenko and Rozov 1980, for the planar case; Krupa and Szmolyan, SIAM J. Math. Anal. 33 (2001) 286-314,
Theorem 2.1, for the transition map.)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.critical.continuation.special_points import SpecialPoint, fold_vectors
from gsp.critical.layer_problem import LayerProblem, least_norm_newton, natural_scales
from gsp.critical.minimally_augmented import identity, singular_near
from gsp.critical.normal_forms import bordered
from gsp.errors import met_at
from gsp.fibres.layer_flow import LayerFlow
from gsp.hyperbolicity.losses.consequences import OMEGA_0
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.results.card import Card
from gsp.results.tabular import Tabular
from gsp.singular.passage.drop import Drop, drop_from
from gsp.singular.passage.failure import PassageError
from gsp.systems.arguments import check_noun
from gsp.systems.flow import Point, check_epsilon, complete, in_words, values_by_name
from gsp.systems.region import Interval, check_region, powers_of_two
from gsp.systems.system import SlowFastSystem

# A point given for the fold may miss it by this, relative to the states' sizes.
NEAR = 1e-2
# It is found to this, relative to the same sizes.
POLISHED = 1e-13
# Coefficients count as zero below this, relative to what they are made of, the states in units of their sizes.
ZERO = 1e-8


@dataclass(frozen=True, eq=False, repr=False)
class FoldPassage(Card, Tabular):
    """What happens at a fold that the slow flow runs into: equations (1) and (2), and the drop.

    `point` is the fold (x_0, y_0) by name; `right` and `left` (n_fast,) are r and l; `a`, `b`, `c`, `d` the numbers of
    (1); `slow_rate` and `along` (n_slow,) are f and F; `leading` and `logarithmic` (n_slow,) multiply epsilon^(2/3) and
    epsilon ln epsilon in (2); `drop` says where the layer flow leads.
    """

    system: SlowFastSystem
    point: Mapping[str, float]
    right: np.ndarray
    left: np.ndarray
    a: float
    b: float
    c: float
    d: float
    slow_rate: np.ndarray
    along: np.ndarray
    leading: np.ndarray
    logarithmic: np.ndarray
    drop: Drop
    region: Mapping[str, Interval] | None = None

    @property
    def x0(self) -> np.ndarray:
        """The slow coordinates of the fold (n_slow,)."""
        return np.array([self.point[s.name] for s in self.system.x])

    @property
    def y0(self) -> np.ndarray:
        """The fast coordinates of the fold (n_fast,)."""
        return np.array([self.point[s.name] for s in self.system.y])

    def delay(self, epsilon: float) -> float:
        """Slow time between the fold and the escape, to leading order: Omega_0 (ab)^(-1/3) epsilon^(2/3)."""
        return OMEGA_0 * (self.a * self.b) ** (-1.0 / 3.0) * check_epsilon(epsilon) ** (2.0 / 3.0)

    def exit(self, epsilon: float) -> dict[str, float]:
        """Slow coordinates after the escape, by name, through epsilon ln epsilon; the error is O(epsilon)."""
        small = check_epsilon(epsilon)
        x = self.x0 + self.leading * small ** (2.0 / 3.0) + self.logarithmic * small * np.log(small)
        return {s.name: float(v) for s, v in zip(self.system.x, x)}

    def __repr__(self) -> str:
        return f"FoldPassage({in_words(self.point)}; a = {self.a:.6g}, b = {self.b:.6g})"

    def __str__(self) -> str:
        names, small = [s.name for s in self.system.x], self.system.epsilon.name
        width = max(map(len, names))
        lines = ["passage through the fold at " + in_words(self.point, 10)]
        lines.append(f"  a = {self.a:.8g}, b = {self.b:.8g}, Omega_0 = {OMEGA_0:.12g}")
        for name, start, first, second in zip(names, self.x0, self.leading, self.logarithmic):
            terms = f"{start:.8g} {first:+.8g} {small}^(2/3) {second:+.8g} {small} ln {small}"
            lines.append(f"  {name:>{width}} = {terms} + O({small})")
        lines.append(f"  {self.drop}")
        return "\n".join(lines)


def fold_passage(
    system: SlowFastSystem,
    fold: SpecialPoint | Point,
    *,
    region: Mapping[str, Interval] | None = None,
) -> FoldPassage:
    """The passage through `fold`, a special point of `continue_critical` or a point (every state named) next to one.

    With several slow variables the fold's point is where the reduced orbit arrives. `region` bounds states by name:
    the fold must be inside, and a drop that leaves it escapes.

    Raises `PassageError` where there is no fold, at a cusp, at a branch point, at a canard point or a folded
    singularity (b = 0), where the slow flow leads away from the fold, where the sheet that ends is not attracting,
    and at the region's edge; `DeclarationError` for points that are not well formed.

    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={y: 1}, fast={x: x**2 + y}, epsilon=epsilon)
    >>> fold_passage(system, {"x": 0, "y": 0}).exit(0.001)
    {'y': 0.02338107410459...}
    """
    check_noun(system, SlowFastSystem, verb="fold_passage")
    return passage_at(system, fold, region)


def passage_at(
    system: SlowFastSystem,
    fold: SpecialPoint | Point,
    region: Mapping[str, Interval] | None = None,
    sizes: Sequence[float] | None = None,
) -> FoldPassage:
    """`fold_passage` where the states' `sizes` (n,) are known, as of a branch; else the fold has to tell them."""
    box = None if region is None else check_region(region, [s.name for s in system.states])
    given = dict(fold.point) if isinstance(fold, SpecialPoint) else values_by_name(fold, what="fold")
    if not system.centres:
        return _passage(system, given, box, sizes)
    # The fold of a number that is rounded far from the origin is none: beside it the layer has rest points, or a gap.
    far = {s.name: float(c) for s, c in system.centres.items()}
    # Of a state that is far from the origin its size there says nothing.
    near = None if sizes is None else np.where(system.centre == 0.0, np.array(sizes), np.nan).tolist()
    with met_at(f"about {system.place(far)}"):
        found = _passage(
            system.about_centres,
            {name: value - far.get(name, 0.0) for name, value in given.items()},
            box and system.box_from_centres(box),
            near,
        )

    def there(point: Mapping[str, float]) -> Mapping[str, float]:
        return MappingProxyType({name: value + far.get(name, 0.0) for name, value in point.items()})

    drop = replace(found.drop, point=there(found.drop.point))
    return replace(found, system=system, point=there(found.point), drop=drop, region=box)


def _passage(
    system: SlowFastSystem,
    given: dict[str, float],
    box: Mapping[str, Interval] | None,
    sizes: Sequence[float] | None,
) -> FoldPassage:
    """The passage about the system's centres; `sizes` that are NaN, or not given, the fold has to tell."""
    problem, u, units = _located(system, given, box or {}, sizes)
    m, n = len(system.x), len(system.y)
    x, y = u[:m], u[m:]
    where = in_words(problem.point(u), 8)
    if box is not None:
        _check_inside(problem.point(u), box, where)
    jacobian = problem.jacobian(u)
    g_x, g_y = jacobian[:, :m], jacobian[:, m:]
    X, Y = units[:m], units[m:]
    r, left = _null_vectors(g_y, problem, u, Y, where)
    # Their lengths in units.
    length, weight = float(np.linalg.norm(r / Y)), float(np.linalg.norm(left * Y))
    second = problem.second(u)
    bending = np.einsum("ijk,j,k->i", second[:, m:, m:], r, r)
    slope = left @ g_x
    if np.abs(slope * X).max() <= ZERO * weight * (np.abs(g_x * X / Y[:, None]).max() or 1.0):
        raise PassageError(
            f"two branches of the critical manifold meet at {where}: l . g_x = 0.",
            "This is no fold. Use entry_exit along the branch that goes on.",
        )
    a = 0.5 * float(left @ bending)
    size = weight * length**2 * np.abs(second[:, m:, m:] * Y[:, None] * Y / Y[:, None, None]).max()
    if abs(a) <= ZERO * size or size == 0.0:
        raise PassageError(
            f"the fold at {where} is degenerate, a cusp: a = l . g_yy(r, r)/2 = {a:.3g}.",
            "The passage takes other powers of epsilon there; move to a point of the fold that is not a cusp.",
        )
    if system.stands_still:
        raise PassageError(
            f"every slow rate vanishes at {system.epsilon} = 0, so nothing passes the fold at {where} at leading "
            "order.",
            f"Leave the factor {system.epsilon} out of the slow rates, or split rates in fast time as one field.",
        )
    f, along = _slow_rates(system, u, r)
    b, d = float(slope @ f), float(slope @ along)
    if abs(b) <= ZERO * np.linalg.norm(slope * X) * max(map(np.linalg.norm, (f / X, along / X / length))):
        remedy = "canard_value" if m == 1 else "folded_singularities"
        raise PassageError(
            f"the slow flow does not cross the fold at {where}: b = l . g_x f = {b:.3g}, a "
            f"{('canard point' if m == 1 else 'folded singularity')}.",
            f"Use {remedy}.",
        )
    if a * b < 0.0:
        raise PassageError(
            f"the slow flow leads away from the fold at {where}: a b = {a * b:.3g} < 0 with b = l . g_x f, so that "
            "both sheets are left there.",
            "A passage needs a b > 0; reverse the slow flow, or take another fold.",
        )
    values = np.linalg.eigvals(g_y)
    others = np.delete(values, np.argmin(np.abs(values)))
    if others.size and others.real.max() >= 0.0:
        raise PassageError(
            f"the sheet that ends in the fold at {where} is not attracting: fast eigenvalues "
            f"{np.array2string(np.append(0.0, others), precision=4)}.",
            "Orbits leave it before they reach the fold.",
        )
    # The centre manifold y = y_0 + r v + h v^2/2 with l . h = 0: g_y h = 2 a r - g_yy(r, r).
    h = np.linalg.solve(bordered(g_y, r, left), np.append(2.0 * a * r - bending, 0.0))[:n]
    cubic = problem.third(u)(r, r, r) / 6.0
    c = float(left @ (cubic + 0.5 * np.einsum("ijk,j,k->i", second[:, m:, m:], r, h)))
    leading = f * OMEGA_0 * (a * b) ** (-1.0 / 3.0)
    logarithmic = f / b * (b * c / a**2 - d / a) / 3.0
    if m > 1:
        logarithmic = logarithmic - (along - f * d / b) / (6.0 * a)
    return FoldPassage(
        system=system,
        point=MappingProxyType(problem.point(u)),
        right=r,
        left=left,
        a=a,
        b=b,
        c=c,
        d=d,
        slow_rate=f,
        along=along,
        leading=leading,
        logarithmic=logarithmic,
        drop=drop_from(
            LayerFlow(system, x, powers_of_two(Y)), y, r * np.sign(a), 0.5 * h, rate=abs(a), region=box
        ),
        region=box,
    )


def _located(
    system: SlowFastSystem,
    given: dict[str, float],
    box: Mapping[str, Interval],
    sizes: Sequence[float] | None,
) -> tuple[LayerProblem, np.ndarray, np.ndarray]:
    """The layer problem over all slow variables, the fold next to the given point, polished, and the states' sizes."""
    problem = LayerProblem.over_all(system)
    for symbol, value in problem.fixed.items():
        if symbol.name in given and given.pop(symbol.name) != value:
            raise PassageError(
                f"the fold lies at another value of the parameter {symbol}.",
                f"Pass system.with_parameters({symbol}=...) with the fold's value.",
                got=f"{value!r} in the system",
                value=value,
            )
    u = np.array(complete(given, system.states, what="fold"))
    scales = np.full(len(u), np.nan) if sizes is None else np.array(sizes)
    if np.isnan(scales).any():
        scales = np.where(np.isnan(scales), natural_scales(problem, u, box), scales)
    where = in_words(problem.point(u), 8)
    found = None
    try:
        near = singular_near(problem, identity, u, scales)
        found = least_norm_newton(near, u, scales, POLISHED)
    except np.linalg.LinAlgError:
        pass
    if found is None or np.abs((found - u) / scales).max() > NEAR:
        values = np.array2string(problem.eigenvalues(u[None, :])[0], precision=4)
        g = ", ".join(f"{v:.3g}" for v in problem.residual(u))
        raise PassageError(
            f"there is no fold at {where}: g = {g}, fast eigenvalues {values}.",
            "Take a point of continue_critical(system, start=...).special.",
        )
    # What is left of a coordinate that is 0 has no digits.
    return problem, np.where(np.abs(found) <= POLISHED * scales, 0.0, found), scales


def _null_vectors(
    g_y: np.ndarray, problem: LayerProblem, u: np.ndarray, scales: np.ndarray, where: str
) -> tuple[np.ndarray, np.ndarray]:
    """r and l with |r| = 1, its largest component positive, l . r = 1; raises `PassageError` at double zeros."""
    sizes = np.linalg.svd(g_y * scales / scales[:, None], compute_uv=False)
    r, left = fold_vectors(problem, u, scales)
    product = float(left @ r)
    if len(sizes) > 1 and (sizes[-2] <= ZERO * sizes[0] or abs(product) < 1e-6):
        values = np.array2string(problem.eigenvalues(u[None, :])[0], precision=4)
        raise PassageError(
            f"more than one fast eigenvalue vanishes at {where}: {values}.", "A fold passage has exactly one."
        )
    length = float(np.linalg.norm(r)) * np.sign(r[np.argmax(np.abs(r))])
    return r / length, left / product * length


def _slow_rates(system: SlowFastSystem, u: np.ndarray, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """f and F = f_y r at epsilon = 0."""
    rates = [laurent(rate, system.epsilon, order=0).get(0, 0) for rate in system.f]
    m, n = len(system.x), len(system.y)
    outputs = [*rates, *(0 if rate == 0 else derivative(rate, s) for rate in rates for s in system.y)]
    compiled = compile_over(system, outputs)
    values = compiled(u, compile_flow(system).constants)
    return values[:m], values[m:].reshape(m, n) @ r


def _check_inside(point: Mapping[str, float], box: Mapping[str, Interval], where: str) -> None:
    for name, (low, high) in box.items():
        # A fold counts as on the region's edge within this share of its width.
        margin = 1e-6 * (high - low)
        if not low - margin <= point[name] <= high + margin:
            raise PassageError(
                f"the fold at {where} lies outside the region: {name} in ({low:g}, {high:g}).", "Enlarge it."
            )
        if not low + margin < point[name] < high - margin:
            raise PassageError(
                f"the fold lies on the edge of the region, {name} = {point[name]:.6g}.",
                "The passage leaves the region there; enlarge it.",
                got=f"{name} in ({low:g}, {high:g})",
            )
