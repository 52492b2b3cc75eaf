"""The equations of a value, as they stand on its card and in LaTeX."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import sympy as sp

from gsp.critical.critical_manifold import Branch, CriticalManifold
from gsp.integration.reduced_flow import ReducedFlow
from gsp.report.mathml import Typesetter, dotted, row
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study
from gsp.singular.singularities.canard_value import CanardValue
from gsp.slow.series import SeriesManifold
from gsp.splitting.splitting import Splitting
from gsp.systems.system import SlowFastSystem, VectorField

# Longer coefficients, in terms and in operations, are not set: a card is read at a glance.
TERMS = 30
OPERATIONS = 200


@dataclass(frozen=True)
class Equation:
    """`left` = `right`; with `dotted` the left is a derivative in slow time, and `factor` stands before it.

    More than one expression on the right are the coefficients of the powers of `epsilon`.
    """

    left: sp.Expr
    right: tuple[sp.Expr, ...]
    dotted: bool = False
    factor: sp.Symbol | None = None
    epsilon: sp.Symbol | None = None

    @property
    def is_short(self) -> bool:
        return sum(int(sp.count_ops(e)) for e in self.right) <= OPERATIONS

    def latex(self) -> str:
        left = rf"\dot{{{sp.latex(self.left)}}}" if self.dotted else sp.latex(self.left)
        if self.factor is not None:
            left = rf"{sp.latex(self.factor)}\,{left}"
        if self.epsilon is None:
            return f"{left} &= {sp.latex(self.right[0])}"
        small = sp.latex(self.epsilon)
        powers = ["", small, *(f"{small}^{{{k}}}" for k in range(2, len(self.right)))]
        terms = [
            rf"{power}\left({sp.latex(e)}\right)" if power else sp.latex(e)
            for power, e in zip(powers, self.right)
            if e != 0
        ]
        return f"{left} &= {' + '.join(terms) or '0'} + O({small}^{{{len(self.right)}}})"

    def mathml(self, setter: Typesetter) -> tuple[str, str]:
        left = dotted(setter.row(self.left)) if self.dotted else setter.row(self.left)
        if self.factor is not None:
            left = row(setter.row(self.factor), left)
        right = (
            setter.row(self.right[0]) if self.epsilon is None else setter.power_series(self.right, self.epsilon)
        )
        return left, right


def equations_of(value: object) -> list[Equation]:
    """The equations that say what `value` is, none for results that are numbers, or where one is too long to read."""
    found = _equations(value)
    return found if all(equation.is_short for equation in found) else []


def _equations(value: object) -> list[Equation]:
    match value:
        case Study() | Scene():
            return _equations(value.scene.system if isinstance(value, Study) else value.system)
        case SlowFastSystem():
            return [
                *_rates(value.slow.items()),
                *_rates(value.fast.items(), factor=value.epsilon),
            ]
        case VectorField():
            return _rates(value.equations.items())
        case Splitting() if value.system is not None:
            return [Equation(symbol, (value.coordinates[symbol],)) for symbol in value.system.states]
        case CriticalManifold():
            return [equation for branch in value.branches for equation in _equations(branch)]
        case Branch():
            if value.graph is not None:
                return [Equation(symbol, (e,)) for symbol, e in value.graph.items()]
            return [Equation(e, (sp.Integer(0),)) for e in value.equations]
        case SeriesManifold():
            return _series(value.readable(TERMS))
        case ReducedFlow():
            return _rates(zip(value.states, value.rates))
        case CanardValue():
            parameter = sp.Symbol(str(value.parameter))
            return [Equation(parameter, tuple(value.coefficients), epsilon=value.system.epsilon)]
        case _:
            return []


def _rates(pairs: Iterable[tuple[sp.Symbol, sp.Expr]], factor: sp.Symbol | None = None) -> list[Equation]:
    return [Equation(symbol, (rate,), dotted=True, factor=factor) for symbol, rate in pairs]


def _series(series: SeriesManifold) -> list[Equation]:
    system = series.branch.system
    manifold = [Equation(y, tuple(h[y] for h in series.coefficients), epsilon=system.epsilon) for y in system.y]
    flow = [
        Equation(x, tuple(f[x] for f in series.reduced_field), dotted=True, epsilon=system.epsilon)
        for x in system.x
    ]
    return [*manifold, *flow]


def symbols_of(equations: Iterable[Equation]) -> list[sp.Symbol]:
    """The symbols as they should be written in a product: the small parameter, then the others by name."""
    found: Mapping[sp.Symbol, None] = {
        s: None for equation in equations for e in (equation.left, *equation.right) for s in e.free_symbols
    }
    small = [equation.epsilon or equation.factor for equation in equations]
    return list(dict.fromkeys([*(s for s in small if s is not None), *sorted(found, key=lambda s: s.name)]))
