"""Mixed-mode oscillations: large and small swings of one variable, counted and put into the usual notation.

L^s stands for L large swings followed by s small ones (Desroches, Guckenheimer, Krauskopf, Kuehn, Osinga and
Wechselberger, SIAM Review 54 (2012) 211-288). A swing is the rise from a minimum to the next maximum; both are located
as events on the run, where the variable's rate is zero. Large and small are told apart by the widest gap between
the sizes of swings.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np
import sympy as sp

from gsp.errors import DeclarationError
from gsp.integration.events import Event
from gsp.integration.loop import check_span
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.systems.arguments import check_noun, check_number, check_positive, shown
from gsp.systems.flow import Flow, Point, values_by_name
from gsp.systems.tolerances import absolute_tolerance

# Neighbours in size that differ by this factor are of different kind; less is one kind of swing, changing slowly.
APART = 3.0


@dataclass(frozen=True, eq=False, repr=False)
class MixedMode(Drawn, Tabular):
    """Swings of the variable `name` along `run`: `times` (k,) of the maxima, `sizes` (k,) of the rises before them.

    `is_large` (k,) tells large from small. `pattern` is the repeating unit ((L, s), ...) of what follows the first
    large swing, and `repeats` says how often it was seen in a row; an empty pattern means that nothing repeated.
    """

    name: str
    run: Trajectory
    times: np.ndarray
    sizes: np.ndarray
    is_large: np.ndarray
    pattern: tuple[tuple[int, int], ...]
    repeats: int

    @property
    def signature(self) -> str:
        """The pattern in words, such as "1^4" or "1^2 1^3"; empty when nothing repeated."""
        return " ".join(f"{large}^{small}" for large, small in self.pattern)

    def __repr__(self) -> str:
        return f"MixedMode({self.name}: {self.signature or 'no pattern'}, {self.sizes.size} swings)"

    def __str__(self) -> str:
        large, small = self.sizes[self.is_large], self.sizes[~self.is_large]
        seen = f", seen {self.repeats} times in a row" if self.pattern else ""
        lines = [f"{self.signature or 'no repeating pattern'} in {self.name}{seen}"]
        for what, sizes in (("large", large), ("small", small)):
            if sizes.size:
                lines.append(f"  {sizes.size} {what} swings, sizes {sizes.min():.4g} to {sizes.max():.4g}")
        if not self.run.status.ok:
            lines.append(f"  the run ended early: {self.run.message}")
        return "\n".join(lines)


def mixed_mode(
    flow: Flow,
    name: str,
    *,
    start: Point,
    span: tuple[float, float],
    epsilon: float | None = None,
    rtol: float = 1e-9,
    atol: float | None = None,
    settle: float = 0.5,
) -> MixedMode:
    """Count large and small swings of the state `name` along a run of `flow`, after the share `settle` of the span.

    Without `atol` it is a hundredth of `rtol` times the size of the smallest state at the start. Sizes, and
    errors with them, are counted from the system's centres.

    Raises `DeclarationError` for a name that is no state, a share outside [0, 1) or a span that does not ascend, and
    what `integrate` raises. A run that ends early is used as far as it went; its `status` says so.

    >>> x, y, epsilon = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    >>> mixed_mode(system, "x", start={"x": 2, "y": 0.6}, span=(0, 30), epsilon=0.01).signature
    '1^0'
    """
    check_noun(flow, Flow, verb="mixed_mode")
    names = [s.name for s in flow.states]
    if not isinstance(name, str) or name not in names:
        raise DeclarationError.none_of(
            names, name, f"name is {shown(name)}, which is no state's.", "The states are"
        )
    check_number(settle, what="settle", be="a share of the span, from 0 to below 1", least=0.0, below=1.0)
    begun, ended = check_span(span)
    if ended <= begun:
        raise DeclarationError(
            "swings are counted forward in time.",
            "Give (t0, t1) with t0 < t1.",
            got=f"span = {span!r}",
            value=span,
        )
    own, counted = flow.about_centres, flow.from_centres(start)
    rate = own.rates[names.index(name)]
    if flow.epsilon is not None:
        # Its zeros are those of the rate; without a pole in epsilon they are located to the same share of its size.
        rate = sp.expand(rate * flow.epsilon)
    events = (Event(rate, direction=-1, name="maximum"), Event(rate, direction=+1, name="minimum"))
    if atol is None:
        atol = absolute_tolerance(check_positive(rtol, what="rtol"), {}, values_by_name(counted, what="start"))
    run = trajectory_of(own, counted, span, epsilon, rtol, atol, options=RunOptions(events=events))
    column = names.index(name)
    (high_t, high), (low_t, low) = (
        (run.events[which].times, run.events[which].states[column]) for which in ("maximum", "minimum")
    )
    begin = begun + settle * (ended - begun)
    after = (high_t >= begin) & (np.searchsorted(low_t, high_t) > 0)
    times, tops = high_t[after], high[after]
    sizes = tops - low[np.searchsorted(low_t, times) - 1]
    # Swings below this share of the largest are the noise of integration.
    audible = sizes > 1e-6 * sizes.max(initial=0.0)
    times, sizes = times[audible], sizes[audible]
    is_large = _large(sizes)
    pattern, repeats = _pattern(is_large)
    if is_large.all() and sizes.max(initial=0.0) >= APART * sizes.min(initial=np.inf):
        # They change their kind little by little, as those of a damped oscillation do, and none comes back.
        pattern, repeats = (), 0
    return MixedMode(
        name,
        run.moved_to(flow, flow.centre, flow.place(flow.centres)),
        times,
        sizes,
        is_large,
        pattern,
        repeats,
    )


def _large(sizes: np.ndarray) -> np.ndarray:
    """Which swings lie above the widest gap of logarithmic sizes; all of them where there is no gap."""
    if sizes.size < 2:
        return np.ones(sizes.size, dtype=bool)
    ordered = np.sort(sizes)
    ratios = ordered[1:] / ordered[:-1]
    widest = int(np.argmax(ratios))
    if ratios[widest] < APART:
        return np.ones(sizes.size, dtype=bool)
    return sizes > np.sqrt(ordered[widest] * ordered[widest + 1])


def _pattern(is_large: np.ndarray) -> tuple[tuple[tuple[int, int], ...], int]:
    """The shortest unit ((L, s), ...) that repeats to the end of what was seen, and how often; at least twice."""
    first = np.flatnonzero(is_large[1:] & ~is_large[:-1]) + 1
    if not first.size:
        # One kind of swing only: each is a unit of its own.
        return (((1, 0),), int(is_large.size)) if is_large.size > 1 and is_large.all() else ((), 0)
    runs = [(bool(kind), len(list(group))) for kind, group in groupby(is_large[first[0] :].tolist())]
    # The last group may have been cut by the end of the run.
    runs = runs[:-1]
    pairs = [(runs[i][1], runs[i + 1][1]) for i in range(0, len(runs) - 1, 2)]
    for length in range(1, len(pairs) // 2 + 1):
        if all(pairs[i] == pairs[i - length] for i in range(length, len(pairs))):
            return tuple(pairs[:length]), len(pairs) // length
    return (), 0
