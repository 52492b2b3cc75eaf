"""The limit epsilon = 0 of a ramp from rest: the rate from which the reduced flow along it meets a fold.

From rest one orbit of the reduced flow leaves with the phase. In the desingularised flow

    x' = -g_y f,   s' = -g_y q rho(s),   y' = g_x f + g_s q rho                                                    (1)

it comes home at some rates q and meets the fold g_y = 0 at others. The rate between is one of two kinds. Either the
orbit ends in a folded saddle, whose canard divides the two. Or folded points are born there, a folded saddle-node of
type I: beyond it the orbit lies in the funnel of the folded node (E. O'Sullivan, K. Mulchrone, S. Wieczorek, Proc. R.
Soc. A 479 (2023) 20220647), and for small epsilon the rate departs from it by a length of order sqrt(epsilon).
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.integration.events import Event
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.roots import root
from gsp.singular.ramps.ramp_run import RATE, leaving
from gsp.singular.ramps.ramped import Place, Ramped
from gsp.singular.singularities.desingularised import desingularise
from gsp.singular.singularities.folded_singularities import (
    FoldedSingularity,
    folded_saddle_node,
    folded_singularity,
)
from gsp.systems.declaration import exact
from gsp.systems.system import SlowFastSystem, VectorField

# An orbit has met the fold where g_y is this share of what it is at the start: those that end in a folded point are
# there after an infinite time of (1).
MET = 1e-6
ACCURACY = 1e-11


class RestingLimit(NamedTuple):
    """The rate `q` with its `error`, the `orbit` (k, n), states over the `phase` (k,), and where it ends."""

    q: float
    error: float
    phase: np.ndarray
    orbit: np.ndarray
    singularity: FoldedSingularity


def along(given: Ramped, q: sp.Expr) -> SlowFastSystem:
    """A slow-fast system along its ramp with the phase as a slow variable, and the rate as the last where `q` is it."""
    source, moved = given.source, dict(given.ramp.parameters)
    assert isinstance(source, SlowFastSystem)
    slow = {s: e.xreplace(moved) for s, e in source.slow.items()}
    return SlowFastSystem(
        slow={**slow, given.ramp.phase: q * given.ramp.profile, **({RATE: sp.S.Zero} if q == RATE else {})},
        fast={y: e.xreplace(moved) for y, e in source.fast.items()},
        epsilon=source.epsilon,
        parameters=given.kept,
    )


class ReducedRamp:
    """Orbits of (1) from the rest point where a ramp begins."""

    def __init__(self, given: Ramped, begin: Place) -> None:
        self.given, self.begin = given, begin
        self.flow = desingularise(along(given, RATE))

    @cached_property
    def fold(self) -> float:
        """g_y at the start."""
        own = {s: sp.Float(v, 17) for s, v in zip(self.given.field.states, self.begin.x)}
        return float(self.flow.fold.xreplace({**own, self.given.ramp.phase: self.given.ramp.ends[0]}))

    @cached_property
    def _field(self) -> VectorField:
        rates = {s: e for s, e in self.flow.rates.items() if s != RATE}
        return VectorField(rates, epsilon=RATE)

    @cached_property
    def _frozen(self) -> VectorField:
        """The flow where the ramp has ended and the phase stands still."""
        return VectorField({**self._field.equations, self.given.ramp.phase: sp.S.Zero}, epsilon=RATE)

    def run(self, q: float) -> Trajectory:
        """The orbit at the rate q, which ends where it meets the fold."""
        given, phase, names = self.given, self.given.ramp.phase, [s.name for s in self.given.field.states]
        x, s = leaving(given, self.begin, q, [name == self.flow.y.name for name in names])
        _, last = given.ends
        met = Event(self.flow.fold - sp.Float(MET * self.fold, 17), terminal=True, name="fold")
        ended = () if given.rests_at(last) else (Event(phase - sp.Float(last, 17), terminal=True, name="end"),)
        start = {**dict(zip(names, x)), phase.name: s}
        # In time of (1) near folds, a hundred times along the ramp at the pace of the start.
        span = (0.0, 100.0 * given.longest(self.begin.x) / q / abs(self.fold))
        options = RunOptions(events=(met, *ended))
        found = trajectory_of(self._field, start, span, q, ACCURACY, 1e-2 * ACCURACY, options=options)
        if ended and len(found.events["end"].times):
            start = dict(zip([z.name for z in self._field.states], found.y[:, -1]))
            found = trajectory_of(
                self._frozen, start, span, q, ACCURACY, 1e-2 * ACCURACY, options=RunOptions(events=(met,))
            )
        return found

    def meets(self, q: float) -> float:
        """1 for a rate at which the orbit meets the fold, -1 for one at which it does not."""
        return 1.0 if len(self.run(q).events["fold"].times) else -1.0

    def limit(self, near: float) -> RestingLimit | None:
        """The rate next to `near` that divides orbits which meet the fold from those that do not.

        None where none of the rates that are tried do so, or no folded point is at its end.
        """
        between = self._between(near)
        if between is None or (q := root(self.meets, *between)) is None:
            return None
        # A little on the side where the orbit does meet the fold.
        beyond = q * (1.0 + (10.0 if self.meets(max(between)) > 0.0 else -10.0) * MET)
        run = self.run(beyond)
        end = dict(zip([s.name for s in self._field.states], run.y[:, -1]))
        orbit = np.array([run[s.name] for s in self.given.field.states]).T
        phase = run[self.given.ramp.phase.name]
        born = folded_saddle_node(along(self.given, RATE), near={**end, RATE.name: beyond})
        if born is not None and abs(float(born[RATE.name]) - q) <= 10.0 * MET * q:
            q = float(born[RATE.name])
            return RestingLimit(q, 4.0 * np.finfo(float).eps * q, phase, orbit, born)
        passed = folded_singularity(along(self.given, exact(q)), near=end)
        return RestingLimit(q, 10.0 * MET**2 * q, phase, orbit, passed)

    def _between(self, near: float) -> tuple[float, float] | None:
        """Two rates next to `near` of which the orbit of one meets the fold."""
        own = self.meets(near)
        # Rates are tried by factors of sqrt(2), eight on both sides of the one that was found.
        for k in range(1, 9):
            for sign in (-1, 1):
                a, b = (near * 2.0 ** (sign * 0.5 * j) for j in (k - 1, k))
                if self.meets(b) != own:
                    return min(a, b), max(a, b)
        return None
