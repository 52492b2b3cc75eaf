"""Critical rates at which a state passes a level: for systems that are excitable, and come back to rest in the end.

Such a ramp has no edge state to end in. What divides orbits is a canard, and the rates of different levels differ by as
little as orbits beside it do, exp(-c/epsilon) where there is a small parameter (S. Wieczorek, P. Ashwin, C. Luke,
P. Cox, Proc. R. Soc. A 467 (2011) 1243-1269).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gsp.errors import Status
from gsp.roots import root
from gsp.singular.ramps.connection import Connection, zero_error
from gsp.singular.ramps.ramp_run import RampRun, run_ramp
from gsp.singular.ramps.ramped import Place, Ramped
from gsp.singular.ramps.section import DECADES, PER_DECADE, SETTLING

# Runs are this accurate, and errors are told by others that are less so.
FINE, COARSE = 1e-11, 1e-9


@dataclass(frozen=True, eq=False)
class Escape:
    """Runs along a ramp from `begin`, and on to the rest point `home`, which pass a `level` or not."""

    given: Ramped
    begin: Place
    home: Place
    level: tuple[int, float]

    @cached_property
    def settling(self) -> float:
        """The time after the ramp by which a run has passed the level, or never does."""
        return (
            2.0
            * SETTLING
            / float(min(np.abs(self.given.growth(place)).min() for place in (self.begin, self.home)))
        )

    def run(self, rate: float, rtol: float = FINE) -> RampRun:
        """A run along the ramp, which ends at the level."""
        return run_ramp(self.given, self.begin, rate, after=self.settling, rtol=rtol, level=self.level)

    def side(self, rate: float, rtol: float = FINE) -> float:
        """1 for a run that passes the level, -1 for one that does not."""
        return -1.0 if self.run(rate, rtol).status is Status.SUCCESS else 1.0


def thresholds(escape: Escape) -> tuple[tuple[bool, bool], list[Connection]]:
    """Whether slow ramps tip, and fast ones, and the orbits on the thresholds between, as far as they are one."""
    natural = escape.given.natural(escape.begin)
    tried = natural * np.logspace(-DECADES, DECADES, 2 * DECADES * PER_DECADE + 1)
    sides = [escape.side(rate) for rate in tried]
    found = [_matched(escape, a, b) for a, b, i, j in zip(tried, tried[1:], sides, sides[1:]) if i != j]
    return (sides[0] > 0, sides[-1] > 0), [c for c in found if c is not None]


def _matched(escape: Escape, a: float, b: float) -> Connection | None:
    fine = root(escape.side, a, b)
    if fine is None:
        return None
    error = zero_error(escape.side, fine, COARSE)
    low, high = (escape.run(fine + sign * error) for sign in (-1.0, 1.0))
    common = low.phase[low.phase <= high.phase.max()]
    x = np.array([np.interp(common, high.phase, column) for column in high.x.T]).T
    apart = np.abs(low.x[: len(common)] - x) / np.ptp(low.x[: len(common)], axis=0)
    # Orbits on both sides of a threshold are one as far as they are no further apart, in shares of what they
    # move.
    split = np.flatnonzero(apart.max(axis=1) > 1e-3)
    stays = slice(0, int(split[0]) if len(split) else len(common))
    return Connection(fine, error, common[stays], low.x[stays])
