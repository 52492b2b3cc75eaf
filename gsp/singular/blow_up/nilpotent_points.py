"""Where the fast Jacobian is singular, exactly: the solution of g = 0, det g_y = 0 next to a point in doubles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NoReturn

import numpy as np
import sympy as sp

from gsp.algebra.algebraic_numbers import AlgebraicPoint, InfinitelyManyPoints, rational_point
from gsp.algebra.differentiation import jacobian
from gsp.algebra.laurent import laurent
from gsp.algebra.local_series import BITS, DENOMINATOR
from gsp.critical.layer_problem import NOTHING, LayerProblem, natural_scales
from gsp.critical.loss_kind import LossKind
from gsp.hyperbolicity.losses.roots import gauss_newton
from gsp.singular.blow_up.local_form import BlowUpError
from gsp.singular.passage.fold_passage import NEAR
from gsp.singular.singularities.located_points import locate, with_slopes
from gsp.systems.declaration import exact
from gsp.systems.flow import in_words
from gsp.systems.system import SlowFastSystem

ExactPoint = AlgebraicPoint | Mapping[sp.Symbol, sp.Rational]


def nilpotent_point(system: SlowFastSystem, near: Mapping[str, float], kind: object = None) -> ExactPoint:
    """The singular point of g_y next to `near`, which names every state: exact, or rational numbers of 60 digits.

    With several slow variables such points are not isolated: those that the `kind` does not fix are held at the values
    given. Raises `BlowUpError` where there is none.
    """
    put_in = dict(system.parameters)
    zero = sp.Integer(0)
    f, g = (
        [laurent(e, system.epsilon, order=0).get(0, zero).xreplace(put_in) for e in rates]
        for rates in (system.f, system.g)
    )
    g_y = jacobian(g, system.y)
    given = {s: exact(near[s.name]) for s in system.states}
    guess = {s: sp.Rational(value).limit_denominator(DENOMINATOR) for s, value in given.items()}
    sizes = _sizes(system, np.array([float(given[s]) for s in system.states]))
    close = all(abs(guess[s] - value) * DENOMINATOR**2 <= sizes[s] for s, value in given.items())
    if close and _solves([*g], guess) and _solves([g_y.xreplace(guess).det()], {}):
        return rational_point(guess)
    equations = [*g, g_y.det(method="berkowitz"), *_more(system, f, g, g_y, given, kind)]
    held = _held(system, g, given, sizes, len(equations))
    free = [s for s in system.states if s not in held]
    start, units = (np.array([float(of[s]) for s in free]) for of in (given, sizes))
    try:
        found = locate([e.xreplace(held) for e in equations], free, starts=[start], units=units)
    except InfinitelyManyPoints:
        # Complex solutions may be a curve where there is no real one.
        if not _reached([e.xreplace(held) for e in equations], free, start, units):
            _refuse(g, g_y, given, near)
        raise BlowUpError(
            f"nilpotent points are not isolated near {in_words(near)}.",
            "Give a point with rational coordinates on them, exactly.",
        ) from None
    distances = [np.abs(np.array([p.numbers()[s] for s in free]) - start) / units for p in found]
    best, apart = min(zip(found, distances), key=lambda pair: float(pair[1].max()), default=(None, np.inf))
    if best is None or np.max(apart) > NEAR:
        _refuse(g, g_y, given, near)
    if best.exact is not None:
        values = dict(best.exact.values)
        values |= {s: rational_point({s: value}).values[s] for s, value in held.items()}
        point = AlgebraicPoint(best.exact.field, values)
        # Over a double, as half way along a curve of folds, the numbers of the field have hundreds of digits each.
        return point.near(BITS + 64) if any(v.q > DENOMINATOR for v in held.values()) else point
    return {s: held.get(s, sp.Rational(best.near.get(s, zero))) for s in system.states}


def _sizes(system: SlowFastSystem, point: np.ndarray) -> dict[sp.Symbol, float]:
    """How large states are at the point (n,), where it may be an error that one of them is not 0: |z| or what matters
    as much in g, whichever is larger. A point that is rounding of 0 tells no size."""
    if (np.abs(point) <= NOTHING).all():
        return dict.fromkeys(system.states, 1.0)
    problem, own = LayerProblem.over_all(system), np.eye(len(point), dtype=bool)
    without = [natural_scales(problem, np.where(row, 0.0, point), {})[row][0] for row in own]
    return dict(zip(system.states, np.maximum(np.abs(point), without).tolist()))


def _solves(equations: Sequence[sp.Expr], values: Mapping[sp.Symbol, sp.Rational]) -> bool:
    for equation in equations:
        value = equation.xreplace(values) if values else equation
        # What is seen not to be 0 is not simplified, which may take for ever with functions of long numbers.
        if not value.is_number or abs(value.evalf()) > sp.Rational(1, 2**BITS) or sp.simplify(value) != 0:
            return False
    return True


def _more(
    system: SlowFastSystem,
    f: Sequence[sp.Expr],
    g: Sequence[sp.Expr],
    g_y: sp.Matrix,
    given: Mapping[sp.Symbol, sp.Rational],
    kind: object,
) -> list[sp.Expr]:
    """What vanishes besides at points of a `kind`, where several slow variables leave room for it."""
    if len(system.x) < 2:
        return []
    if kind is LossKind.BOGDANOV_TAKENS and len(g) == 2:
        return [g_y.trace()]
    if kind not in (LossKind.CUSP, LossKind.FOLDED_SINGULARITY):
        return []
    # Where g_y is singular its adjugate is r l^T, of its null vectors: one column or row of it, where that is largest.
    left, _, right = np.linalg.svd(np.array(g_y.xreplace(dict(given)).evalf(20), dtype=float))
    i, j = int(np.argmax(np.abs(right[-1]))), int(np.argmax(np.abs(left[:, -1])))
    places = range(len(g))
    if kind is LossKind.CUSP:
        slopes = jacobian([g_y.det(method="berkowitz")], system.y)
        return [(slopes * sp.Matrix([g_y.cofactor(j, k, method="berkowitz") for k in places]))[0]]
    row = sp.Matrix([[g_y.cofactor(k, i, method="berkowitz") for k in places]])
    return [(row * jacobian(g, system.x) * sp.Matrix(f))[0]]


def _held(
    system: SlowFastSystem,
    g: Sequence[sp.Expr],
    given: Mapping[sp.Symbol, sp.Rational],
    sizes: Mapping[sp.Symbol, float],
    count: int,
) -> dict[sp.Symbol, sp.Rational]:
    """The slow variables that `count` equations leave free, with their values: those along which g changes least.

    Changes are those that the states' `sizes` make.
    """
    excess = len(system.states) - count
    if excess <= 0:
        return {}
    slopes = jacobian(g, system.x).xreplace(dict(given))
    changes = [
        float(sp.N(sum(abs(e) * sizes[s] / sizes[y] for e, y in zip(slopes.col(i), system.y))))
        for i, s in enumerate(system.x)
    ]
    order = sorted(range(len(system.x)), key=lambda i: (changes[i], -i))
    return {system.x[i]: given[system.x[i]] for i in order[:excess]}


def _reached(
    equations: Sequence[sp.Expr], unknowns: Sequence[sp.Symbol], start: np.ndarray, units: np.ndarray
) -> bool:
    """Whether Newton's method finds a real solution near by."""
    evaluate = with_slopes(equations, unknowns)
    value, slope = evaluate(start)
    found = gauss_newton(evaluate, start, scales=units, sizes=np.abs(value) + np.abs(slope * units).max(axis=1))
    return found is not None and bool((np.abs(found - start) <= NEAR * units).all())


def _refuse(
    g: Sequence[sp.Expr], g_y: sp.Matrix, given: Mapping[sp.Symbol, sp.Rational], near: Mapping[str, float]
) -> NoReturn:
    """Raise what says what is there instead."""
    values = np.linalg.eigvals(np.array(g_y.xreplace(dict(given)).evalf(20), dtype=float))
    residual = ", ".join(f"{float(sp.N(e.xreplace(dict(given)))):.3g}" for e in g)
    shown = ", ".join(f"{value:.4g}" for value in values)
    raise BlowUpError(
        f"there is no nilpotent point near {in_words(near)}: the fast Jacobian is regular there.",
        "Nothing has to be blown up where no fast eigenvalue is zero. Take a fold, a branch point or a double zero "
        "that classify or continue_critical names.",
        got=f"fast eigenvalues {shown}, and g = {residual}",
        value=tuple(values),
        point=dict(near),
    )
