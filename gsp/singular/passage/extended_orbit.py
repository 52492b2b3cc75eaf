"""Orbits in extended precision, by Taylor series: for passages that double precision cannot hold.

A delayed exit depends on deviations of size exp(-c/epsilon). Each step sums the Taylor series of the orbit, of an order
in proportion to the digits, coefficient by coefficient in ball arithmetic whose radii are dropped after the step
(Jorba and Zou, Experimental Mathematics 14 (2005) 99-117, for the choice of order and step).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import flint
import numpy as np
import sympy as sp

from gsp.algebra.algebraic_numbers import arb
from gsp.algebra.precision import precision
from gsp.algebra.taylor_ring import Balls, Taylor, TaylorRing, midpoint_sum
from gsp.errors import DeclarationError, Status
from gsp.integration.loop import check_span
from gsp.singular.singularities.canard_series import program_of
from gsp.systems.arguments import check_noun, check_number, check_whole, shown
from gsp.systems.declaration import exact
from gsp.systems.flow import Point, check_epsilon, complete
from gsp.systems.system import SlowFastSystem

# Digits carried at most: an orbit takes minutes then.
MOST_DIGITS = 2000
# Places in a step where the sign of `until` is looked at.
LOOKS = 8
# Points recorded in a step.
SAMPLES = 4


@dataclass(frozen=True, eq=False, repr=False)
class ExtendedOrbit:
    """An orbit of `system` to `digits` digits: `t` (k,) and `y` (n, k), rounded to doubles, four points a step.

    `time` and `end` (by name) are the last time and state to all digits, `watched` (k,) by name what was asked to be
    watched, computed in extended precision before it is rounded.
    """

    system: SlowFastSystem
    epsilon: sp.Rational
    digits: int
    t: np.ndarray
    y: np.ndarray
    watched: Mapping[str, np.ndarray]
    time: sp.Float
    end: Mapping[str, sp.Float]
    steps: int
    status: Status
    met: bool

    def __getitem__(self, name: str) -> np.ndarray:
        """Values (k,) of a state, or of what was watched."""
        if name in self.watched:
            return self.watched[name]
        names = [s.name for s in self.system.states]
        if name not in names:
            raise DeclarationError(
                f'"{name}" is no state and was not watched.', f"Those are {[*names, *self.watched]}."
            )
        return self.y[names.index(name)]

    @property
    def message(self) -> str:
        """One line: how it ended and where."""
        place = ", ".join(f"{name} = {sp.N(value, 8)}" for name, value in self.end.items())
        how = "met the condition" if self.met else ("reached the end" if self.status.ok else f"{self.status}")
        return f"{how} after {self.steps} Taylor steps: t = {sp.N(self.time, 12)}, {place}"

    def __repr__(self) -> str:
        return f"ExtendedOrbit({self.digits} digits, {self.message})"


def follow(
    system: SlowFastSystem,
    *,
    start: Mapping[str, float | str | sp.Rational] | Point,
    span: tuple[float, float],
    epsilon: float | sp.Rational,
    digits: int = 30,
    until: sp.Expr | None = None,
    after: float | None = None,
    watch: Mapping[str, sp.Expr] | None = None,
) -> ExtendedOrbit:
    """The orbit from `start` over `span` in extended precision, up to where `until` changes its sign.

    `start` gives numbers, or their digits as text; a float counts as the decimal that prints it. `until` counts only
    from the time `after` on, if that is given; it and the values of `watch` are expressions in the states. Raises
    `DeclarationError` for arguments that are not well formed.

    >>> from gsp import SlowFastSystem
    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={x: 1}, fast={y: x*y}, epsilon=eps)
    >>> orbit = follow(system, start={"x": -1, "y": 1}, span=(0, 3), epsilon=0.005, digits=60, until=y - 1)
    >>> sp.N(orbit.time, 20)
    2.0000000000000000000
    """
    check_noun(system, SlowFastSystem, verb="follow")
    check_epsilon(epsilon)
    first, last = check_span(span)
    check_digits(digits)
    begin = first if after is None else check_number(after, what="after")
    given = exact_start(system, start)
    small = exact(epsilon)
    if watch is not None and not isinstance(watch, Mapping):
        raise DeclarationError("watch maps names to expressions in the states.", got=shown(watch), value=watch)
    for what, e in {"until": until, **{f"watch[{name!r}]": e for name, e in (watch or {}).items()}}.items():
        if e is None and what == "until":
            continue
        if not isinstance(e, sp.Expr):
            raise DeclarationError(f"{what} is a SymPy expression in the states.", got=shown(e), value=e)
        unknown = e.free_symbols - {*system.states, *system.parameters}  # pyright: ignore[reportOptionalMemberAccess]
        if unknown:
            raise DeclarationError(f"{what} contains {', '.join(map(str, unknown))}, which is no state.", got=e)
    with precision(int(digits * 3.33) + 40):
        taylor = _Taylor(system, small, digits, until, dict(watch or {}))
        return taylor.run(given, exact(first), exact(last), exact(begin))


def check_digits(digits: int) -> int:
    """`digits` if it is a number of digits to work with; raises `DeclarationError` otherwise."""
    return check_whole(digits, what="digits", least=5, most=MOST_DIGITS)


def exact_start(system: SlowFastSystem, start: Mapping) -> dict[str, sp.Rational]:
    """Exact values by name of a start that names every state; raises `DeclarationError` otherwise."""
    if not isinstance(start, Mapping):
        raise DeclarationError("start is a mapping of names to numbers.", got=shown(start), value=start)
    given: dict[str, sp.Rational] = {}
    for key, value in start.items():
        name = key.name if isinstance(key, sp.Symbol) else str(key)
        try:
            given[name] = exact(value)
        except DeclarationError as error:
            raise DeclarationError(f"start gives {name} the value {shown(value)}. {error}") from None
    complete(given, system.states, what="start")
    return given


class _Taylor:
    """Taylor steps of one system at one epsilon."""

    def __init__(
        self,
        system: SlowFastSystem,
        epsilon: sp.Rational,
        digits: int,
        until: sp.Expr | None,
        watch: dict[str, sp.Expr],
    ) -> None:
        self.system, self.epsilon, self.digits = system, epsilon, digits
        self.order = max(12, int(1.2 * digits))
        self.ring = TaylorRing(Balls(), 1)
        self.inputs: dict[sp.Symbol, list[Taylor]] = {s: [] for s in system.states}
        self.program = program_of(self.ring, sp.Dummy("time"), self.inputs)
        put_in = {**system.parameters, system.epsilon: epsilon}
        self.rates = [self.program.compile(sp.sympify(r, strict=True).xreplace(put_in)) for r in system.rates]
        self.until = None if until is None else self.program.compile(until.xreplace(put_in))
        self.watch = {name: self.program.compile(e.xreplace(put_in)) for name, e in watch.items()}

    def run(
        self, start: Mapping[str, sp.Rational], first: sp.Rational, last: sp.Rational, after: sp.Rational
    ) -> ExtendedOrbit:
        states = self.system.states
        state = [arb(start[s.name]) for s in states]
        t, end, armed = arb(first), arb(last), arb(after)
        direction = 1 if last > first else -1
        stops = [armed, end] if direction * (after - first) > 0 and direction * (last - after) > 0 else [end]
        times, rows = [float(t.mid())], [[_double(v) for v in state]]
        self._series(state, order=0)
        watched = {name: [_double(self._coefficients(node)[0])] for name, node in self.watch.items()}
        status, met, steps, ahead = Status.TOO_MANY_STEPS, False, 0, state
        sizes, exponent = [flint.arb(0)] * len(state), -self.digits - 5
        # Steps of one orbit at most.
        while steps < 20000:
            steps += 1
            series = self._series(state)
            sizes = [max(size, abs(v.mid())) for size, v in zip(sizes, state)]
            h = direction * self._step(series, sizes, exponent)
            remaining = (stops[0] - t).mid()
            arrived = bool(abs(h) >= abs(remaining))
            h = remaining if arrived else h
            event = self._event(h) if len(stops) == 1 else None
            if arrived and len(stops) > 1:
                stops.pop(0)
                arrived = False
            if event is not None:
                h, met = event, True
            for part in range(1, SAMPLES + 1):
                within = (h * part / SAMPLES).mid()
                ahead = [midpoint_sum(row, within) for row in series]
                times.append(float((t + within).mid()))
                rows.append([_double(v) for v in ahead])
                for name, node in self.watch.items():
                    watched[name].append(_double(midpoint_sum(self._coefficients(node), within)))
            t, state = (t + h).mid(), ahead
            if met or arrived:
                status = Status.SUCCESS
                break
            # An orbit farther from 0 than this has escaped.
            if not all(v.is_finite() and abs(v) < 1e30 for v in state):
                status = Status.NON_FINITE
                break
        return ExtendedOrbit(
            self.system,
            self.epsilon,
            self.digits,
            np.array(times),
            np.array(rows).T,
            {name: np.array(values) for name, values in watched.items()},
            self._float(t),
            {s.name: self._float(v) for s, v in zip(states, state)},
            steps,
            status,
            met,
        )

    def _series(self, state: list[Any], *, order: int | None = None) -> list[list[Any]]:
        """Taylor coefficients in time of every state; the program's nodes are filled on the way."""
        ring, symbols = self.ring, self.system.states
        top = self.order if order is None else order
        for symbol, value in zip(symbols, state):
            self.inputs[symbol][:] = [ring.scalar(value.mid())]
        for k in range(top):
            self.program.extend(k)
            for symbol, node in zip(symbols, self.rates):
                rate: Any = node.coefficients[k]
                self.inputs[symbol].append(ring.scalar(rate[0] / (k + 1)))
        self.program.extend(top)
        return [[c[0] for c in self.inputs[s]] for s in symbols]

    def _step(self, series: list[list[Any]], sizes: list[Any], exponent: int) -> Any:
        """Where the last two terms of each state fall to 10^exponent of its size, or of how far it moves in the step.

        Sizes are the largest so far: a deviation that falls is known to those of its beginning.
        """
        best = float("inf")
        for row, size in zip(series, sizes):
            # Without their radii, within which a term may be 0.
            terms = [term.mid() for term in row]
            first = next((j for j in range(1, self.order) if terms[j] != 0), self.order)
            for k in (k for k in (self.order - 1, self.order) if k > first and terms[k] != 0):
                ratios = {j: abs(a / terms[k]) for j, a in ((0, size), (first, terms[first])) if a != 0}
                shares = [(exponent + float(r.log().mid()) / np.log(10.0)) / (k - j) for j, r in ratios.items()]
                best = min(best, 10.0 ** min(max(shares), 300.0))
        return flint.arb(0.9 * best if np.isfinite(best) else 1e300)

    def _event(self, h: Any) -> Any | None:
        """The first time within the step where `until` changes its sign, by its own Taylor series."""
        if self.until is None:
            return None
        coefficients = self._coefficients(self.until)
        before = coefficients[0]
        for look in range(1, LOOKS + 1):
            ahead = midpoint_sum(coefficients, h * look / LOOKS)
            # A start in the section does not count as meeting it.
            if (before < 0 and ahead >= 0) or (before > 0 and ahead <= 0):
                low, high = (h * (look - 1) / LOOKS).mid(), (h * look / LOOKS).mid()
                for _ in range(12):
                    middle = ((low + high) / 2).mid()
                    if (midpoint_sum(coefficients, middle) < 0) == (before < 0):
                        low = middle
                    else:
                        high = middle
                t = ((low + high) / 2).mid()
                for _ in range(14):
                    slope = midpoint_sum([c * (k + 1) for k, c in enumerate(coefficients[1:])], t)
                    t = (t - midpoint_sum(coefficients, t) / slope).mid()
                return t
            before = ahead
        return None

    def _coefficients(self, node: Any) -> list[Any]:
        return [c[0].mid() for c in node.coefficients[: self.order + 1]]

    def _float(self, value: Any) -> sp.Float:
        return sp.Float(value.mid().str(self.digits + 5, radius=False), self.digits)


def _double(value: Any) -> float:
    return float(value.mid())
