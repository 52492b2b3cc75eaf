"""Where sliding ends beside a fold of one field, and how late orbits of the smooth field leave: at a power of epsilon.

At a fold Y+ = 0 with beta = L_(X+) Y+. For beta > 0 the fold is visible, orbits of X+ bend away, and sliding ends. With
1 - phi = C u^n for u = w_e - v, gamma = Y- > 0 and t the time from the fold,

    epsilon u' = -beta t - (C gamma/2) u^n + ...,                                                            (1)

so that u = 0, where the orbit leaves, at

    t = T_n (epsilon beta^(1/n - 1) (C gamma/2)^(-1/n))^(n/(2n - 1)),                                        (2)

T_n the zero of the solution of U' = -T - U^n that comes from U = (-T)^(1/n): T_1 = 1, and T_2 = 1.0188, minus the first
zero of Ai'. (C. Bonet-Reves and T. M. Seara, Regularization of sliding global bifurcations derived from the local
fold singularity of Filippov systems, 2016, for the power.) Along an algebraic tail, 1 - phi = C v^-m, the power is that
with n = -m, and no coefficient is claimed; along a tail that falls faster than any power there is none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.critical.layer_problem import least_norm_newton, natural_scales
from gsp.critical.loss_kind import LossKind
from gsp.errors import GspError
from gsp.integration.events import Event
from gsp.integration.trajectory import RunOptions, trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import CompiledFunction, compile_over
from gsp.results.card import Card
from gsp.sliding.law import LawEnd, SwitchLaw, switch_law
from gsp.sliding.piecewise_field import PiecewiseField
from gsp.systems.arguments import check_noun
from gsp.systems.flow import Point, check_epsilon, complete, in_words
from gsp.systems.system import VectorField

# T_n is reached from here; before T = -20 solutions differ by less than rounding but for n = 1, which begins exactly.
EARLY = -20.0
# How small the last Newton step to the fold is, and how near two points of it are one, in the states' sizes.
CLOSE, ZERO = 1e-13, 1e-9


class SlidingExitError(GspError):
    """There is no exit from sliding at the point asked about."""


@dataclass(frozen=True, eq=False, repr=False)
class SlidingExit(Card):
    """A fold of one field on the surface: its `kind`, the `point` by name, and the `side` whose field is tangent.

    `side` is 1 for X+ and -1 for X-; `bending` is beta and `push` gamma of (1), both counted away from the side; `end`
    is that of the law there. `velocity` (n,) is that of the tangent field, and `lift` (n,) where its fold goes as |s|
    grows there: orbits leave from s = w_e epsilon.
    """

    kind: LossKind
    point: Mapping[str, float]
    side: int
    bending: float
    push: float
    end: LawEnd
    velocity: np.ndarray
    lift: np.ndarray

    @property
    def exponent(self) -> sp.Rational | None:
        """n/(2n - 1), the power of epsilon after which orbits leave; None where nothing leaves, or by no power."""
        return self.end.exponent if self.kind is LossKind.VISIBLE_FOLD else None

    @property
    def prefactor(self) -> float | None:
        """What multiplies the power in (2), in slow time; None where there is no power, or along a tail."""
        n, C = self.end.order, self.end.coefficient
        if self.exponent is None or n is None or C is None or n < 1:
            return None
        power = float(1 / n)
        scale = self.bending ** (power - 1.0) * (C * self.push / 2.0) ** -power
        return latest(n) * scale ** float(self.exponent)

    def time(self, epsilon: float) -> float:
        """Slow time from the fold to the exit, to leading order; nan where it is not known."""
        small = check_epsilon(epsilon)
        if self.prefactor is None or self.exponent is None:
            return float("nan")
        return self.prefactor * small ** float(self.exponent)

    def exit(self, epsilon: float) -> dict[str, float]:
        """The point at which orbits leave, by name, to leading order."""
        # Where n = 1 both are of the order epsilon.
        moved = self.time(epsilon) * self.velocity + epsilon * self.end.place * self.lift
        return {name: value + float(more) for (name, value), more in zip(self.point.items(), moved)}

    def __repr__(self) -> str:
        return f"SlidingExit({self.kind} of X{'+' if self.side > 0 else '-'} at {in_words(self.point)})"

    def __str__(self) -> str:
        lines = [
            repr(self),
            f"  {in_words({'beta': self.bending, 'gamma': self.push}, 8)}; phi ends with {self.end.kind}",
        ]
        if self.prefactor is not None:
            lines.append(f"  orbits leave {self.prefactor:.8g} epsilon^({self.exponent}) later in slow time")
        elif self.exponent is not None:
            lines.append(f"  orbits leave over a slow time that goes as epsilon^({self.exponent})")
        elif self.kind is LossKind.VISIBLE_FOLD:
            lines.append("  how late orbits leave is no power of epsilon")
        return "\n".join(lines)


def sliding_exit(field: PiecewiseField, fold: Point, *, phi: str | sp.Expr | SwitchLaw) -> SlidingExit:
    """The fold of X+ or X- next to the point `fold`, and how orbits of the field smoothed by `phi` leave there.

    Raises `SlidingExitError` where there is no fold next to the point, and `DeclarationError` for arguments that are
    not well formed. A two-fold is named, and has no exit of its own.

    >>> x, y = sp.symbols("x y")
    >>> field = PiecewiseField(plus={x: 1, y: x}, minus={x: 1, y: 1}, surface=y)
    >>> found = sliding_exit(field, {"x": 0, "y": 0}, phi="cubic")
    >>> found.kind, found.exponent, round(found.prefactor, 9)
    (<LossKind.VISIBLE_FOLD: 'visible fold'>, 2/3, 1.121326758)
    """
    check_noun(field, PiecewiseField, verb="sliding_exit")
    law = switch_law(phi)
    given = np.array(complete(fold, field.states, what="fold"))
    above, below = field.normal_rates
    tangencies = [_Tangency(field, (field.surface, rate)) for rate in (above, below)]
    both = _Tangency(field, (field.surface, above, below))
    sizes = _sizes(both, given)
    found = [least_norm_newton(tangency, given, sizes, CLOSE) for tangency in tangencies]
    distances = [np.inf if place is None else float((np.abs(place - given) / sizes).max()) for place in found]
    side = 1 if distances[0] <= distances[1] else -1
    place = found[0 if side > 0 else 1]
    if place is None:
        raise SlidingExitError(
            "there is no fold next to the point: neither field is tangent to the surface there.",
            "Give a point next to one, such as the end of a sliding piece of run_piecewise.",
            got=f"{dict(zip((s.name for s in field.states), map(float, given)))}",
        )
    own, rates, other = (above, field.plus, below) if side > 0 else (below, field.minus, above)
    flow = field.flow(rates)
    values = compile_over(flow, [field.rate_of(own, rates), other, *rates.values()])(
        place, compile_flow(flow).constants
    )
    bending, push, velocity = float(side * values[0]), float(side * values[1]), values[2:]
    slopes = tangencies[0 if side > 0 else 1].jacobian(place)
    lift = sizes * np.linalg.lstsq(slopes * sizes, np.array([side, 0.0]))[0]
    two = least_norm_newton(both, place, sizes, CLOSE)
    kind = LossKind.VISIBLE_FOLD if bending > 0.0 else LossKind.INVISIBLE_FOLD
    if two is not None and (np.abs(two - place) <= ZERO * sizes).all():
        kind = LossKind.TWO_FOLD
    elif abs(bending) <= ZERO * push * (np.abs(velocity) / sizes).max():
        raise SlidingExitError(
            "the tangency is of a higher order than that of a fold, and (2) says nothing of it.",
            "Give a point next to a fold, where the rate of the tangent field's Y is not 0.",
            got=f"beta = {bending:.3g} at {in_words(zip((s.name for s in field.states), place))}",
        )
    elif push <= 0.0:
        raise SlidingExitError(
            "no orbit slides beside this fold: the other field leads away from the surface there.",
            "Sliding ends only where the other field pushes towards the surface.",
            got=f"Y of the other field is {push * side:.3g}",
        )
    point = MappingProxyType({s.name: float(v) for s, v in zip(field.states, place)})
    return SlidingExit(kind, point, side, bending, push, law.upper if side > 0 else law.lower, velocity, lift)


def _sizes(both: _Tangency, given: np.ndarray) -> np.ndarray:
    """|u| of each state (N,), or how far it moves Y+ and Y- by what they are where that is more."""
    rates, slopes = (np.abs(part[1:]).sum(axis=0) for part in (both.residual(given), both.jacobian(given)))
    reach = np.divide(rates, slopes, out=np.zeros_like(slopes), where=slopes > 0.0)
    sizes = np.maximum(np.abs(given), reach)
    return np.where(sizes > 0.0, sizes, natural_scales(both, given, {}))


@dataclass(frozen=True, eq=False)
class _Tangency:
    """`equations` in the states of a field that switches, compiled with their derivatives."""

    field: PiecewiseField
    equations: tuple[sp.Expr, ...]

    @property
    def unknowns(self) -> tuple[sp.Symbol, ...]:
        return self.field.states

    def residual(self, z: np.ndarray) -> np.ndarray:
        return self._values(z)[: len(self.equations)]

    def jacobian(self, z: np.ndarray) -> np.ndarray:
        n, N = len(self.equations), len(self.unknowns)
        return self._values(z)[n : n + n * N].reshape(n, N)

    def second(self, z: np.ndarray) -> np.ndarray:
        n, N = len(self.equations), len(self.unknowns)
        return self._values(z)[n + n * N :].reshape(n, N, N)

    def _values(self, z: np.ndarray) -> np.ndarray:
        return self._compiled(z, compile_flow(self.field.flow(self.field.plus)).constants)

    @cached_property
    def _compiled(self) -> CompiledFunction:
        slopes = [sp.diff(e, s) for e in self.equations for s in self.unknowns]
        bends = [sp.diff(e, s) for e in slopes for s in self.unknowns]
        return compile_over(self.field.flow(self.field.plus), [*self.equations, *slopes, *bends])


@lru_cache(maxsize=64)
def latest(n: sp.Rational) -> float:
    """T_n of (2)."""
    U, T = sp.symbols("U T")
    order = float(n)
    root = (-EARLY) ** (1.0 / order)
    # The second term of the outer solution: n s^(n-1) delta = -ds/dT.
    delta = root / (-order * EARLY) / (order * root ** (order - 1.0))
    run = trajectory_of(
        VectorField({U: -T - U**n, T: sp.S.One}),
        start={"U": root + delta, "T": EARLY},
        span=(0.0, -2.0 * EARLY),
        rtol=1e-12,
        atol=1e-14,
        options=RunOptions(events=Event(U, direction=-1, terminal=True)),
    )
    return float(run["T"][-1])
