"""The canard value by integration: attracting and repelling slow manifolds carried to the fold and matched there.

One orbit starts on the attracting branch of M0 and runs forward, one on the repelling branch and runs backward, both
to the section {y = y of the fold}. Each forgets its start at the rate exp(-C/epsilon), C the integral of |g_y| along
its branch, so that the parameter at which they meet is a maximal canard up to that. Orbits are integrated by Taylor
series in extended precision. (Guckenheimer, Hoffman and Weckesser, Int. J. Bifurcation Chaos 10 (2000) 2669-2687,
compute canards from both sides in this way.)
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import flint
import sympy as sp

from gsp.algebra.algebraic_numbers import arb
from gsp.algebra.differentiation import derivative
from gsp.algebra.precision import precision
from gsp.algebra.taylor_ring import Balls, Taylor, TaylorRing, midpoint_sum
from gsp.singular.singularities.canard_points import CanardError
from gsp.singular.singularities.canard_series import PlanarField, program_of
from gsp.singular.singularities.canard_value import CanardValue
from gsp.systems.arguments import check_each, check_noun, check_number, check_whole
from gsp.systems.declaration import exact
from gsp.systems.flow import check_epsilon

# Steps of the secant method at most.
SECANT_LIMIT = 30
# Taylor steps of one orbit at most.
STEP_LIMIT = 20000


@dataclass(frozen=True, eq=False)
class CanardMatch:
    """A maximal canard found by integration: `value` of the parameter at `epsilon`, and how well it is defined.

    `mismatch` is the distance of the two manifolds in the section; `resolution` estimates how far other choices of
    the two starts move `value`, exp(-C/epsilon) with the smaller of the two C. `steps` counts Taylor steps.
    """

    value: sp.Float
    epsilon: sp.Rational
    mismatch: float
    resolution: float
    steps: int


def match_canard(
    canard: CanardValue, epsilon: float | sp.Rational, *, reach: tuple[float, float], digits: int = 30
) -> CanardMatch:
    """The parameter where the attracting and the repelling slow manifold meet in the section through the fold.

    `reach` gives how far from the fold the orbits start in the fast variable, on the attracting and on the repelling
    branch: inside the branches, short of their next fold or equilibrium. Raises `CanardError` where a branch ends
    before, and when an orbit does not arrive at the section.

    >>> from gsp import SlowFastSystem
    >>> from gsp.singular.singularities.canard_value import canard_value
    >>> x, y, a, eps = sp.symbols("x y a epsilon")
    >>> c = canard_value(SlowFastSystem(
    ...     slow={y: a - x}, fast={x: y - x**3/3 + x}, epsilon=eps, parameters={a: 1}), parameter=a)
    >>> match = match_canard(c, 0.05, reach=(1.2, 1.9), digits=15)
    >>> sp.N(match.value, 10), sp.N(match.resolution, 2)
    (0.9934909325, 2.7e-12)
    """
    check_noun(canard, CanardValue, verb="match_canard")
    check_epsilon(epsilon)
    check_each(
        reach,
        lambda distance: check_number(distance, what="every reach", be="a positive distance", above=0.0),
        what="reach",
        be="two positive distances from the fold",
        length=2,
    )
    check_whole(digits, what="digits", least=5, most=300)
    small = exact(epsilon)
    with precision(int(digits * 3.33) + 40):
        shooting = _Shooting(canard, small, digits, reach)
        decays = shooting.contractions(reach)
        ends = shooting.starts(reach)
        guess = arb(sp.Rational(str(sp.N(canard.partial_sum(small, order=min(2, canard.order)), digits))))
        unit = shooting.units[canard.field.a]
        spread = (arb(small) / min(decays, key=_middle)) ** 2 * unit / 16
        closest = max(abs(guess), unit, key=_middle) * arb(sp.Rational(1, 10**digits))
        a, b = guess, guess + spread
        at_a, at_b = shooting.gap(a, ends), shooting.gap(b, ends)
        for _ in range(SECANT_LIMIT):
            if at_a == at_b:
                break
            a, b, at_a = b, (b - at_b * (b - a) / (at_b - at_a)).mid(), at_b
            at_b = shooting.gap(b, ends)
            if abs(b - a) < closest:
                break
        else:
            raise CanardError(
                f"the two slow manifolds were not matched in {SECANT_LIMIT} secant steps at "
                f"{canard.system.epsilon} = {epsilon}.",
                "Take a smaller epsilon or a shorter reach.",
                got=f"reach={reach}",
                value=reach,
            )
        value = sp.Float(b.mid().str(digits + 5, radius=False), digits)
        resolution = max(float((-c / arb(small)).exp().mid()) for c in decays)
        return CanardMatch(value, small, abs(float(at_b.mid())), resolution, shooting.steps)


class _Shooting:
    """Orbits of one planar field at one epsilon, with the parameter as an argument.

    `units` are those in which the fold and the parameter have coefficients of 1 where y is as far as the shorter
    `reach`.
    """

    def __init__(
        self, canard: CanardValue, epsilon: sp.Rational, digits: int, reach: tuple[float, float]
    ) -> None:
        field = canard.field
        self.field, self.epsilon = field, epsilon
        self.digits = digits
        self.steps = 0
        self.ring = TaylorRing(Balls(), 1)
        self.order = max(12, int(digits * 1.2))
        x, y, a = field.symbols
        time = sp.Dummy("time")
        self.inputs: dict[sp.Symbol, list[Taylor]] = {x: [], y: [], a: []}
        program = program_of(self.ring, time, self.inputs)
        put_in = {field.epsilon: epsilon}
        self.nodes = {
            x: program.compile(field.f.xreplace(put_in)),
            y: program.compile((field.g / field.epsilon).xreplace(put_in)),
        }
        self.program = program
        g_x, g_yy, f_y, d = (
            arb(sp.Rational(str(sp.N(canard.genericity[k], 15)))) for k in ("g_x", "g_yy", "f_y", "d")
        )
        length, self.farthest = flint.arb(min(map(float, reach))), 1e6 * max(map(float, reach))
        self.units = {x: abs(g_yy / g_x) * length**2, y: length, a: abs(f_y / d) * length}
        self.critical = _Critical(field, self.ring, self.units[x])
        self.fold = {s: arb(sp.Rational(str(sp.N(canard.point[s.name], digits + 10)))) for s in (x, y, a)}
        self.attracting = -1 if sp.N(canard.genericity["g_yy"]) > 0 else 1

    def starts(self, reach: tuple[float, float]) -> list[tuple[Mapping[sp.Symbol, Any], int]]:
        """Starts on the attracting and the repelling branch of M0, with the direction of time."""
        points = []
        for distance, side, direction in zip(reach, (self.attracting, -self.attracting), (1, -1)):
            points.append((self.critical.point(self.fold, side * float(distance))[-1], direction))
        return points

    def contractions(self, reach: tuple[float, float]) -> list[Any]:
        """The integrals of |g_y| dt along both branches at epsilon = 0, dt = X_0' dy/f."""
        return [
            self.critical.contraction(self.fold, side * float(distance))
            for distance, side in zip(reach, (self.attracting, -self.attracting))
        ]

    def gap(self, a: Any, ends: list[tuple[Mapping[sp.Symbol, Any], int]]) -> Any:
        """Distance in x of the two manifolds in the section."""
        first, second = (self.carry(point, a, direction) for point, direction in ends)
        return (first - second).mid()

    def carry(self, start: Mapping[sp.Symbol, Any], a: Any, direction: int) -> Any:
        """x where the orbit from `start` meets the section."""
        x, y, _ = self.field.symbols
        state = {x: start[x], y: start[y]}
        target = self.fold[y]
        side = state[y] > target
        for _ in range(STEP_LIMIT):
            series = self._series(state, a)
            # Where the last two terms fall to the tolerance; they are of about equal size there.
            sizes = [
                (
                    float(
                        max((abs(series[s][self.order - k]) / self.units[s] for s in (x, y)), key=_middle).mid()
                    ),
                    self.order - k,
                )
                for k in (0, 1)
            ]
            lengths = [(10.0 ** (-self.digits - 5) / size) ** (1.0 / k) for size, k in sizes if size > 0.0]
            step = direction * min([0.9 * length for length in lengths] or [0.1])
            ahead = {s: midpoint_sum(series[s], flint.arb(step)) for s in (x, y)}
            self.steps += 1
            if (ahead[y] > target) != side:
                t = flint.arb(step) * (target - state[y]) / (ahead[y] - state[y])
                for _ in range(12):
                    rate = midpoint_sum([c * (k + 1) for k, c in enumerate(series[y][1:])], t)
                    t = (t - (midpoint_sum(series[y], t) - target) / rate).mid()
                return midpoint_sum(series[x], t)
            state = ahead
            if not abs(state[y] - target) < self.farthest:
                break
        else:
            raise CanardError(
                f"an orbit from {y} = {float(start[y].mid()):.6g} takes more than {STEP_LIMIT} Taylor steps to the "
                f"fold, {y} = {float(target.mid()):.6g}, at {self.field.epsilon} = {float(self.epsilon):g}.",
                f"Shorten a long reach, or raise {self.field.epsilon}: the series of `value` is the better the "
                "smaller that is.",
            )
        raise CanardError(
            f"an orbit from {x} = {float(start[x].mid()):.6g}, {y} = {float(start[y].mid()):.6g} does not "
            f"arrive at the fold, {y} = {float(target.mid()):.6g}.",
            "Start nearer to the fold (reach), or lower epsilon.",
        )

    def _series(self, state: Mapping[sp.Symbol, Any], a: Any) -> dict[sp.Symbol, list[Any]]:
        x, y, parameter = self.field.symbols
        ring, inputs = self.ring, self.inputs
        for symbol, value in ((x, state[x]), (y, state[y]), (parameter, a)):
            inputs[symbol][:] = [ring.scalar(value.mid())]
        for k in range(self.order):
            self.program.extend(k)
            for symbol in (x, y):
                rate: Any = self.nodes[symbol].coefficients[k]
                inputs[symbol].append(ring.scalar(rate[0] / (k + 1)))
            inputs[parameter].append(ring.zero)
        return {symbol: [series[0] for series in inputs[symbol]] for symbol in (x, y)}


class _Critical:
    """M0 as a graph over y, by Newton's method in x, in the unit `size`, along a ladder of y."""

    def __init__(self, field: PlanarField, ring: TaylorRing, size: Any) -> None:
        self.field, self.ring, self.rungs, self.size = field, ring, 64, size
        x, y, a = field.symbols
        self.inputs: dict[sp.Symbol, list[Taylor]] = {x: [ring.zero], y: [ring.zero], a: [ring.zero]}
        program = program_of(ring, field.epsilon, self.inputs)
        g = field.g
        expressions = (g, derivative(g, x), derivative(g, y), field.f)
        self.nodes = [program.compile(e) for e in expressions]
        self.program = program

    def values(self, point: Mapping[sp.Symbol, Any]) -> list[Any]:
        """(g, g_x, g_y, f) at epsilon = 0."""
        for symbol in self.inputs:
            self.inputs[symbol][0] = self.ring.scalar(point[symbol])
        self.program.extend(0)
        return [_first(node) for node in self.nodes]

    def point(self, fold: Mapping[sp.Symbol, Any], reach: float) -> list[dict[sp.Symbol, Any]]:
        """Points of M0 from the fold to `reach` away from it in y."""
        x, y, a = self.field.symbols
        here = {x: fold[x], y: fold[y], a: fold[a]}
        points = [dict(here)]
        for rung in range(1, self.rungs + 1):
            here[y] = (fold[y] + flint.arb(reach) * rung / self.rungs).mid()
            for _ in range(60):
                g, g_x, _, _ = self.values(here)
                step = (g / g_x).mid()
                here[x] = (here[x] - step).mid()
                if not abs(step) > 1e-12 * self.size:
                    break
            points.append(dict(here))
        return points

    def contraction(self, fold: Mapping[sp.Symbol, Any], reach: float) -> Any:
        """|integral of g_y X_0'/f dy| by the trapezium rule, X_0' = -g_y/g_x; the integrand is 0 at the fold.

        Raises `CanardError` where g_y or f vanishes on the way.
        """
        total = flint.arb(0)
        points = self.point(fold, reach)
        y, before = self.field.y, None
        for place, point in enumerate(points[1:], start=1):
            _, g_x, g_y, f = self.values(point)
            signs = [float(v.mid()) > 0.0 for v in (g_y, f)]
            before = before or signs
            if g_y == 0 or f == 0 or signs != before:
                what = "equilibrium" if signs[0] == before[0] and g_y != 0 else "fold"
                raise CanardError(
                    f"the orbit from {y} = {float((fold[y] + reach).mid()):.6g} does not begin on the branch at the "
                    f"fold {y} = {float(fold[y].mid()):.6g}: that has its next {what} before {y} = "
                    f"{float(point[y].mid()):.6g}.",
                    "Start nearer to the fold (reach).",
                    got=f"a reach of {abs(reach):g}",
                    value=abs(reach),
                )
            total = total + g_y * g_y / (g_x * f) * (0.5 if place == self.rungs else 1)
        return abs(total * flint.arb(reach) / self.rungs)


def _first(node: Any) -> Any:
    return node.coefficients[0][0]


def _middle(value: Any) -> float:
    return float(value.mid())
