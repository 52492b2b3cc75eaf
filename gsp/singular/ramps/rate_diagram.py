"""`rate_diagram`: critical rates against the amplitude of a ramp, with the windows between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import sympy as sp

from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.singular.ramps.critical_rate import CriticalRate, TippingVerdict, critical_rate, values_of
from gsp.singular.ramps.ramped import Place, Ramped, RampError, at_epsilon
from gsp.systems.arguments import check_noun, check_progress, check_whole
from gsp.systems.flow import Point
from gsp.systems.ramp import Ramp
from gsp.systems.region import Interval, check_interval
from gsp.systems.system import SlowFastSystem, VectorField

AMPLITUDE = sp.Symbol("amplitude")


@dataclass(frozen=True, eq=False, repr=False)
class RateDiagram(Drawn, Tabular):
    """Critical rates at `amplitudes` (k,), factors of the changes that `ramp` makes; `found` (k,) are the answers.

    An amplitude for which the edge state could not be followed is left out.
    """

    ramp: Ramp
    amplitudes: np.ndarray
    found: tuple[CriticalRate, ...]

    @property
    def rates(self) -> np.ndarray:
        """The rates (k, m), NaN behind the last of each amplitude."""
        most = max((len(each.rates) for each in self.found), default=0)
        return np.array([[*each.rates, *[np.nan] * (most - len(each.rates))] for each in self.found]).reshape(
            -1, most
        )

    def tips(self, amplitude: int, rate: float) -> bool | None:
        """Whether a rate at one of the amplitudes, by its number, tips; None where that is undecided."""
        each = self.found[amplitude]
        if each.verdict is TippingVerdict.UNDECIDED:
            return None
        passed = sum(r < rate for r in each.rates)
        return each.slow_tips != bool(passed % 2)

    def __repr__(self) -> str:
        low, high = self.amplitudes[[0, -1]]
        return f"RateDiagram({len(self.amplitudes)} amplitudes from {low:.4g} to {high:.4g})"

    def __str__(self) -> str:
        lines = [repr(self), f"  {self.ramp}"]
        for amplitude, each in zip(self.amplitudes, self.found):
            rates = ", ".join(f"{rate:.6g}" for rate in each.rates)
            lines.append(f"  {amplitude:>10.6g}  {each.verdict}{': ' if rates else ''}{rates}")
        return "\n".join(lines)


def rate_diagram(
    field: VectorField | SlowFastSystem,
    *,
    ramp: Ramp,
    start: Point,
    edge: Point,
    amplitudes: Interval,
    points: int = 24,
    epsilon: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> RateDiagram:
    """Critical rates of `ramp` with all its changes times factors between the two `amplitudes`.

    `start` and `edge` are as `critical_rate` takes them, the edge state at the factor 1, from where it is followed.
    `points` amplitudes are spread evenly, and more are put where the number of rates changes. `progress` is called with
    the share done. Raises what `critical_rate` raises, `RampError` where no amplitude has an edge state.

    >>> x, l = sp.symbols("x l")
    >>> field = VectorField(states={x: (x + l) ** 2 - 1}, epsilon=None, parameters={l: 0})
    >>> ramp = Ramp.logistic({l: (0, 3)})
    >>> found = rate_diagram(field, ramp=ramp, start={"x": -1}, edge={"x": -2}, amplitudes=(0.5, 1.5), points=3)
    >>> found.found[0], found.found[-1]
    (CriticalRate(never tips), CriticalRate(tips above the rate, 0.5333333333))
    """
    low, high = check_interval(
        amplitudes, what="amplitudes", remedy="Give (low, high), factors of the changes."
    )
    check_whole(points, what="points", least=2, most=1000)
    check_progress(progress)
    check_noun(field, (VectorField, SlowFastSystem), verb="rate_diagram")
    check_noun(ramp, Ramp, verb="the ramp of rate_diagram")
    plain = at_epsilon(field, epsilon)
    field = VectorField(
        plain.equations, epsilon=None, parameters={**plain.parameters, AMPLITUDE: 1}, name=plain.name
    )
    amplified = ramp.amplified(AMPLITUDE)
    edges = _edges(field, ramp, edge, (low, high))
    found: dict[float, CriticalRate] = {}

    def ask(amplitude: float) -> None:
        place = edges(amplitude)
        if place is not None and amplitude not in found:
            at = field.with_parameters(amplitude=amplitude)
            found[amplitude] = critical_rate(at, ramp=amplified, start=start, edge=place)

    for i, amplitude in enumerate(np.linspace(low, high, points)):
        ask(float(amplitude))
        if progress is not None:
            progress((i + 1) / points)
    for a, b in pairwise(sorted(found)):
        # Between amplitudes with different numbers of rates more are looked at, halving the way so often.
        for _ in range(6):
            counts = [(len(found[k].rates), found[k].slow_tips) for k in (a, b)]
            middle = 0.5 * (a + b)
            ask(middle)
            if counts[0] == counts[1] or middle not in found:
                break
            same = (len(found[middle].rates), found[middle].slow_tips) == counts[0]
            a, b = (middle, b) if same else (a, middle)
    if not found:
        raise RampError("the edge state was followed to none of the amplitudes.", "Take some nearer to 1.")
    known = np.array(sorted(found))
    return RateDiagram(ramp, known, tuple(found[k] for k in known.tolist()))


def _edges(
    field: VectorField, ramp: Ramp, edge: Point, amplitudes: Interval
) -> Callable[[float], dict[str, float] | None]:
    """The edge state at an amplitude, by name, followed from the factor 1; None beyond where it folds."""
    phase, (first, last) = ramp.phase, ramp.ends
    if last is None:
        raise RampError("a ramp without end has no amplitude.", "Give it an end.", got=str(ramp))
    changes = {p: (e.xreplace({phase: first}), e.xreplace({phase: last})) for p, e in ramp.parameters.items()}
    moved = Ramp(
        {p: a + phase * (b - a) for p, (a, b) in changes.items()}, sp.S.One, (sp.S.One, sp.Integer(2)), phase
    )
    asked = Ramped(field, moved)
    given, centre = asked.about_centres, asked.centre
    begun = np.array(values_of(edge, [x.name for x in field.states], "edge")) - centre.x
    known = {}
    for end in amplitudes:
        place = given.rest_point(begun, given.first)
        way = (
            []
            if place is None
            else given.followed(Place(given.first, place), end - centre.s)
            if end != 1.0
            else [Place(given.first, place)]
        )
        known |= {s + centre.s: x for s, x in way}
    places = sorted(known)

    def at(amplitude: float) -> dict[str, float] | None:
        if not places or not places[0] <= amplitude <= places[-1]:
            return None
        columns = np.array([known[s] for s in places]).T
        x = given.rest_point(
            np.array([np.interp(amplitude, places, column) for column in columns]), amplitude - centre.s
        )
        return None if x is None else dict(zip((s.name for s in field.states), x + centre.x))

    return at
