"""Canard points of planar slow-fast systems: folds where a parameter makes the slow rate vanish.

epsilon y' = g(x, y, a, epsilon), x' = f(x, y, a, epsilon), both scalar, have a canard point at (x, y, a) when, at
epsilon = 0,

    g = g_y = f = 0,   g_x != 0,  g_yy != 0,  f_y g_x < 0,  d = f_a + f_x X_a + f_y Y_a != 0,

(Krupa and Szmolyan, SIAM J. Math. Anal. 33 (2001) 286-314, section 3), with (X_a, Y_a) the rate of the fold with a,
X_a = -g_a/g_x and Y_a = -(g_ya + g_yx X_a)/g_yy. The sign of f_y g_x lets the slow flow cross the fold from the
attracting to the repelling side; with the other sign it crosses back, for every a near by.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.algebra.algebraic_numbers import InfinitelyManyPoints
from gsp.algebra.differentiation import derivative
from gsp.algebra.functions import are_rational
from gsp.algebra.laurent import laurent, vanishes
from gsp.algebra.switching_functions import switches
from gsp.errors import DeclarationError, GspError
from gsp.singular.singularities.canard_series import PlanarField
from gsp.singular.singularities.fold_starts import fold_starts
from gsp.singular.singularities.located_points import Located, locate, with_slopes
from gsp.systems.arguments import check_noun, shown
from gsp.systems.flow import Point, values_by_name
from gsp.systems.system import SlowFastSystem

# Starts of Newton's method for equations that are not rational, in each of the states and the parameter.
STARTS = (-3.0, -1.1, -0.2, 0.3, 1.2, 3.1)


class CanardError(GspError):
    """There is no canard where one was asked for; the message names what is there instead."""


@dataclass(frozen=True, eq=False)
class CanardPoint:
    """A candidate: `point` by name, the parameter among them, `fault`, empty for a canard point, and the coefficients.

    `coefficients` are g_x, g_yy, f_y and d of the definition; x is slow and y fast there, whatever their names.
    """

    located: Located
    point: Mapping[str, sp.Expr]
    coefficients: Mapping[str, sp.Expr]
    fault: str


def planar_field(system: SlowFastSystem, parameter: sp.Symbol | str) -> PlanarField:
    """f and g with every parameter but one put in; raises `DeclarationError` for what is not planar."""
    check_noun(system, SlowFastSystem, verb="canard_value")
    if len(system.x) != 1 or len(system.y) != 1:
        raise CanardError(
            "canard_value takes one slow and one fast variable.",
            "With one fast and two slow variables use folded_singularities.",
            got=f"{len(system.x)} slow and {len(system.y)} fast",
        )
    names = {symbol.name: symbol for symbol in system.parameters}
    name = parameter.name if isinstance(parameter, sp.Symbol) else parameter
    if not isinstance(name, str) or name not in names:
        raise DeclarationError(
            f"there is no parameter {shown(name)}.",
            f"The parameters are {', '.join(names) or 'none'}. Declare the one that moves the equilibrium "
            "across the fold.",
            value=name,
            known=names,
        )
    a = names[name]
    values = {symbol: value for symbol, value in system.parameters.items() if symbol != a}
    f, g = (e.xreplace(values) for e in (system.f[0], system.g[0]))
    return PlanarField(f=f, g=g, x=system.x[0], y=system.y[0], a=a, epsilon=system.epsilon)


def canard_point(
    field: PlanarField, *, declared: sp.Rational, near: Point | None
) -> tuple[CanardPoint, tuple[CanardPoint, ...]]:
    """The canard point nearest to `near`, by default nearest to the declared parameter value, and the other ones.

    Of two equally near in the parameter, the one where it is larger. Raises `CanardError` when there is none.
    """
    target = None if near is None else values_by_name(near, what="near")
    known = [symbol.name for symbol in field.symbols]
    for name in target or {}:
        if name not in known:
            raise DeclarationError.none_of(known, name, f'near names "{name}".', "It takes")
    candidates = _candidates(field, declared, target)
    given = {field.a.name: float(declared)} if target is None else target
    wanted = {s: given[s.name] for s in field.symbols if s.name in given}
    # In these units of each, distances do not depend on those of the system.
    units = {s: max(abs(v), *(abs(_number(c, s)) for c in candidates)) or 1.0 for s, v in wanted.items()}

    def rank(c: CanardPoint) -> tuple[float, float]:
        apart = sum(((_number(c, s) - v) / units[s]) ** 2 for s, v in wanted.items())
        return round(apart**0.5, 12), -_number(c, field.a)

    good = [c for c in candidates if not c.fault] if target is None else []
    chosen = min(good or candidates, key=rank)
    if chosen.fault:
        raise CanardError(chosen.fault)
    return chosen, tuple(c for c in candidates if not c.fault and c is not chosen)


def _number(candidate: CanardPoint, symbol: sp.Symbol) -> float:
    return candidate.located.numbers()[symbol]


def _candidates(
    field: PlanarField, declared: sp.Rational, target: Mapping[str, float] | None
) -> list[CanardPoint]:
    f0, g0 = (laurent(e, field.epsilon, order=0).get(0, sp.Integer(0)) for e in (field.f, field.g))
    x, y, a = field.symbols
    fold = (g0, derivative(g0, y))
    if vanishes(fold[1]):
        raise CanardError(
            f"there is no fold: the fast rate does not depend on {y}.", got=f"g = {g0} at {field.epsilon} = 0"
        )
    if not (f0.has(a) or g0.has(a)):
        raise CanardError(
            f"{a} does not appear in the equations at {field.epsilon} = 0, so it cannot move the equilibrium "
            "across the fold.",
            f"Choose another parameter, or rescale {a} by {field.epsilon}.",
            got=f"f = {f0}, g = {g0}",
        )
    # What `near` names is where to begin; the other canard points are looked for all the same.
    known_values = target or {}
    axes = [[known_values[s.name]] if s.name in known_values else STARTS for s in (x, y, a)]
    levels = {float(declared), known_values.get(a.name, float(declared))}
    beside = known_values.get(y.name)
    folds = [start for level in sorted(levels) for start in fold_starts(g0, x, y, a, level, beside)]
    places = [*folds, [known_values.get(s.name, 0.0) for s in (x, y, a)]]
    units = _units((g0, f0), (x, y, a), places)
    starts: list[Sequence[float]] = [
        *(itertools.product(*axes) if known_values else ()),
        *folds,
        *itertools.product(STARTS, STARTS, sorted({*levels, *STARTS})),
        *(np.array(list(itertools.product(STARTS, repeat=3))) * units if (units != 1.0).any() else ()),
    ]
    try:
        points = locate((*fold, f0), (x, y, a), starts=starts, units=units)
    except InfinitelyManyPoints:
        raise CanardError(
            f"{a} does not move the equilibrium across the fold: g = g_{y} = f = 0 along a whole curve.",
            "Choose another parameter.",
            got=f"f = {f0}, g = {g0}",
        ) from None
    if not points:
        _explain_none(field, fold, f0, declared)
    return [_judged(field, f0, g0, located) for located in points]


def _units(
    equations: Sequence[sp.Expr], unknowns: Sequence[sp.Symbol], places: Sequence[Sequence[float]]
) -> np.ndarray:
    """Powers of ten, as large as unknowns are at `places` (k, 3), or else as what matters as much in the equations."""
    at = np.array(places)
    sizes = np.abs(at).max(axis=0)
    slopes = np.abs(with_slopes(equations, unknowns)(at[np.argmax((at != 0.0).sum(axis=1))])[1])
    with np.errstate(all="ignore"):
        balance = (slopes @ sizes)[:, None] / slopes
    balance = np.where(np.isfinite(balance) & (balance > 0.0), balance, np.inf).min(axis=0)
    sizes = np.where(sizes > 0.0, sizes, balance)
    return 10.0 ** np.round(np.log10(np.where(np.isfinite(sizes), sizes, 1.0)))


def _explain_none(
    field: PlanarField, fold: tuple[sp.Expr, sp.Expr], f0: sp.Expr, declared: sp.Rational
) -> None:
    x, y, a = field.symbols
    at = [e.xreplace({a: declared}) for e in fold]
    try:
        folds = locate(at, (x, y), starts=itertools.product(STARTS, STARTS))
        shown = ", ".join(
            f"({x}, {y}) = ({', '.join(sp.sstr(v) for v in p.expressions().values())})" for p in folds[:3]
        )
    except InfinitelyManyPoints:
        folds, shown = [None], "a whole curve of points"
    if not folds:
        known = f"g = g_{y} = 0 has no real solution"
        fact, remedy = (
            f"there is no fold at a finite point: {known}",
            "A canard needs a fold of the critical manifold.",
        )
        if not are_rational((*at, f0)):
            fact, remedy = "no fold was found", f"Say where to look for one, near={{'{y}': ...}}."
        raise CanardError(f"{fact} at {a} = {declared}.", remedy, got=f"g = {fold[0]}")
    got = f"f = {f0}, and at {a} = {declared} the fold {shown}"
    if not are_rational((*at, f0)):
        raise CanardError(
            f"no {a} was found for which the slow rate vanishes at the fold.",
            f"Say where to look for it, near={{'{y}': ..., '{a}': ...}}; where there is none the fold is a jump point.",
            got=got,
        )
    raise CanardError(
        f"the fold is a jump point: the slow rate does not vanish there for any real {a}.",
        "Choose a parameter that brings an equilibrium to the fold.",
        got=got,
    )


def _judged(field: PlanarField, f0: sp.Expr, g0: sp.Expr, located: Located) -> CanardPoint:
    x, y, a = field.symbols
    point = MappingProxyType({s.name: value for s, value in located.expressions().items()})
    where = "at " + ", ".join(
        f"{name} = {sp.sstr(sp.N(v, 10) if not v.is_Rational else v)}" for name, v in point.items()
    )
    g_x, g_yy, f_y = derivative(g0, x), derivative(derivative(g0, y), y), derivative(f0, y)
    values = {"g_x": g_x, "g_yy": g_yy, "f_y": f_y}
    fault = ""
    crossing = 0
    switching = [s.source for s in switches((f0, g0), (x, y, a)) if located.sign(s.surface) == 0]
    if switching:
        fault = f"the rates are not smooth {where}, where {switching[0]} switches: there is no expansion."
    elif located.sign(g_x) == 0:
        fault = (
            f"the critical manifold is singular {where}: g_{x} = 0, two of its branches meet. This is no fold."
        )
    elif located.sign(g_yy) == 0:
        fault = f"the fold {where} is degenerate, a cusp: g_{y}{y} = 0. A canard point needs a quadratic fold."
    else:
        crossing = located.sign(f_y * g_x)
        X_a = -derivative(g0, a) / g_x
        Y_a = -(derivative(derivative(g0, y), a) + derivative(derivative(g0, y), x) * X_a) / g_yy
        values["d"] = derivative(f0, a) + derivative(f0, x) * X_a + f_y * Y_a
        if crossing == 0:
            fault = f"the canard point {where} is degenerate: f_{y} = 0, the equilibrium is not simple there."
        elif located.sign(values["d"]) == 0:
            fault = (
                f"{a} does not move the equilibrium across the fold {where}: the transversality coefficient "
                "f_a + f_x X_a + f_y Y_a is 0. Choose another parameter."
            )
        elif crossing > 0:
            fault = (
                f"the slow flow crosses the fold {where} from the repelling to the attracting side "
                f"(f_{y} g_{x} > 0, a faux canard): such orbits exist for every {a} near by, and there is no canard "
                "value. Look at the other folds, or reverse the slow flow."
            )
    exact = {name: located.value(e) for name, e in values.items()}
    return CanardPoint(located, point, MappingProxyType(exact), fault)
