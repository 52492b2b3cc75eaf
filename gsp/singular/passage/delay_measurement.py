"""A delayed exit, measured: the full system in double precision, and to as many digits as the passage takes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.errors import Status
from gsp.integration.methods import Method
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.roots import root
from gsp.singular.passage.delayed_exit import UNDERFLOW, DelayedExit, ExitKind
from gsp.singular.passage.extended_orbit import MOST_DIGITS, ExtendedOrbit, check_digits, exact_start, follow
from gsp.singular.passage.failure import PassageError
from gsp.systems.arguments import check_noun, check_number
from gsp.systems.declaration import exact
from gsp.systems.flow import check_epsilon

# Digits kept below the least deviation of the passage.
SPARE = 20
_SQUARED = "squared distance"


@dataclass(frozen=True, eq=False, repr=False)
class MeasuredDelay:
    """When orbits of the full system at `epsilon` leave the branch: first reach `radius` from it after the loss.

    `exit` is the slow time in extended precision (`digits` of them), `double_exit` in double precision, None where it
    does not leave; `expected` and `expected_double` are the theory's, and `expected_double_band` holds `double_exit` on
    any processor. `extended` and `double` are the runs, with the distances (k,) from the branch along them. `why` and
    `double_why` say why there is no exit; empty where there is.
    """

    delayed: DelayedExit
    epsilon: float
    radius: float
    digits: int
    exit: sp.Float | None
    double_exit: float | None
    expected: float
    expected_double: float | None
    expected_double_band: tuple[float, float] | None
    extended: ExtendedOrbit
    double: Trajectory

    @property
    def extended_distance(self) -> tuple[np.ndarray, np.ndarray]:
        """Slow times (k,) and distances from the branch (k,) along the extended run."""
        return self.extended.t, np.sqrt(np.maximum(self.extended[_SQUARED], 0.0))

    @property
    def double_distance(self) -> tuple[np.ndarray, np.ndarray]:
        """Slow times (k,) and distances from the branch (k,) along the run in double precision."""
        return self.double.t, _distances(self.delayed, self.double)

    @property
    def why(self) -> str:
        """Why the extended run shows no exit; empty where it does."""
        return "" if self.exit is not None else self._reason(*self.extended_distance, self.extended.status)

    @property
    def double_why(self) -> str:
        """Why the run in double precision shows no exit; empty where it does."""
        return "" if self.double_exit is not None else self._reason(*self.double_distance, self.double.status)

    def _reason(self, t: np.ndarray, distance: np.ndarray, status: Status) -> str:
        ended = "" if status.ok else status.meaning
        loss = self.delayed.loss.t
        before, after = distance[t <= loss], distance[t > loss]
        if not before.min() < self.radius:
            least = before.min()
            return f"the run starts outside the branch's basin: it comes no nearer than {least:.3g} before the loss"
        if not before[-1] < self.radius:
            return (
                f"the run has left the neighbourhood before the loss, where it is at distance {before[-1]:.3g}"
            )
        if not after.size:
            return f"the run ends before the loss, at t = {t[-1]:.6g}: {ended}"
        tail = f", where it ends: {ended}" if ended else ""
        return (
            f"the run never reaches the radius: distance {after.max():.3g} at most up to t = {t[-1]:.6g}{tail}"
        )

    def __repr__(self) -> str:
        return f"MeasuredDelay(epsilon={self.epsilon:g}, exit={self.exit}, double_exit={self.double_exit})"

    def __str__(self) -> str:
        band = self.expected_double_band
        foreseen = (
            "no early exit expected"
            if band is None
            else f"expected to leave early, from {band[0]:.6g} to {band[1]:.6g} as rounding decides"
        )
        shown = f"none: {self.why}" if self.exit is None else sp.N(self.exit, 15)
        double = f"none: {self.double_why}" if self.double_exit is None else f"{self.double_exit:.8g}"
        small = self.delayed.branch.system.epsilon
        return (
            f"exit at distance {self.radius:g} for {small} = {self.epsilon:g}, in slow time\n"
            f"  as epsilon -> 0      {self.expected:.8g}\n"
            f"  {self.digits:>4} digits          {shown}\n"
            f"  double precision     {double}  ({foreseen})"
        )


def measure_delay(
    delayed: DelayedExit,
    *,
    epsilon: float,
    radius: float,
    start: Mapping[str, float | str | sp.Rational] | None = None,
    digits: int | None = None,
) -> MeasuredDelay:
    """Both runs from `delayed.start`, or from `start` (every state), to the first distance `radius` after the loss.

    Without `start` the fast variables begin on the branch, or, where it is invariant, at distance `radius` from it
    along the first of them. `digits` are chosen from the passage's depth unless given. The branch must be explicit.
    Raises `PassageError` for a passage without an exit, for an implicit branch, and for one that takes too many digits.
    """
    check_noun(delayed, DelayedExit, verb="measure_delay")
    small = check_epsilon(epsilon)
    radius = check_number(radius, what="radius", be="a positive distance", above=0.0)
    if digits is not None:
        check_digits(digits)
    if start is not None:
        exact_start(delayed.branch.system, start)
    if delayed.branch.graph is None:
        raise PassageError(
            f"the branch {delayed.branch} is implicit, and a distance from it is not defined.",
            "Integrate with follow(system, ..., until=...) to a section of your own.",
        )
    if delayed.kind is ExitKind.NONE:
        raise PassageError(f"there is nothing to measure: {delayed.message}")
    system = delayed.branch.system
    if start is None:
        begin: dict[str, float | str | sp.Rational] = dict(delayed.start)
        if delayed.invariant:
            name = system.y[0].name
            begin[name] = delayed.start[name] + radius
    else:
        begin = dict(start)
    loss = delayed.loss.t
    # At a loss without delay the scale of what happens is (2 epsilon/kappa)^(1/2).
    # The runs go on beyond the expected exit for half of the slow time since the loss, and for so many natural times.
    natural = 8.0 * np.sqrt(2.0 * small / abs(delayed.loss.crossing))
    last = float(delayed.t + max(0.5 * (delayed.t - loss), natural))
    if digits is None:
        # Below the least limit of the losses deviations do not matter.
        rise = min([delayed.depth, *(loss.limit for loss in delayed.losses)])
        needed = rise / small / np.log(10.0) + SPARE
        if needed > MOST_DIGITS:
            least = rise / ((MOST_DIGITS - SPARE) * np.log(10.0))
            raise PassageError(
                f"the passage at {system.epsilon} = {small:g} takes {needed:.0f} digits, since a deviation falls to "
                f"exp(-{rise / small:.0f}); at most {MOST_DIGITS} are carried.",
                f"Measure at an epsilon of {1.01 * least:.2g} or more, or start nearer to the loss.",
            )
        digits = int(needed)
    squared = sp.Add(*[(y - h) ** 2 for y, h in delayed.branch.graph.items()])
    run = follow(
        system,
        start=begin,
        span=(0.0, last),
        epsilon=small,
        digits=digits,
        until=squared - sp.Rational(str(radius)) ** 2,
        after=loss,
        # A square, as the root of a series that vanishes is none.
        watch={_SQUARED: squared},
    )
    # A fast variable that falls to 0 beside others that do not is known to their rounding, of what epsilon moves.
    vanishing = delayed.rounding == UNDERFLOW
    double = trajectory_of(
        system,
        start={name: float(exact(value)) for name, value in begin.items()},
        span=(0.0, last),
        epsilon=small,
        rtol=1e-13,
        atol=1e-300 if vanishing else np.finfo(float).eps * small * radius,
        options=RunOptions(method=Method.RADAU13),
    )
    distance = _distances(delayed, double)
    beyond = (double.t > loss) & (distance >= radius)
    early = None
    # A run that is out there at the loss already does not leave after it.
    inside = double.t[-1] > loss and _distances(delayed, double.sample([loss]))[0] < radius
    if inside and beyond.any():
        i = int(np.argmax(beyond))
        low, high = max(float(double.t[i - 1]), loss), float(double.t[i])

        def apart(t: float) -> float:
            distance = float(_distances(delayed, double.sample([t]))[0])
            return (distance if np.isfinite(distance) else np.inf) - radius

        early = root(apart, low, high, ends=(min(apart(low), 0.0), max(apart(high), 0.0)))
    return MeasuredDelay(
        delayed,
        small,
        radius,
        digits,
        run.time if run.met else None,
        early,
        delayed.t,
        delayed.double_exit(small),
        delayed.double_exit_band(small),
        run,
        double,
    )


def _distances(delayed: DelayedExit, run: Trajectory) -> np.ndarray:
    """Distance from the branch at every step of a run (k,)."""
    system, graph = delayed.branch.system, delayed.branch.graph
    assert graph is not None
    function = compile_over(system, [y - h for y, h in graph.items()])
    # A run that escapes may be too far away for its square.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.linalg.norm(function(run.y.T, compile_flow(system).constants), axis=1)
