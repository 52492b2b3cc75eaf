"""How a continuation ended: the reason with its remedy, as `Status` is for integrations."""

from __future__ import annotations

from enum import Enum


class Ending(Enum):
    """Why a continuation ended. The value is (meaning, remedy); both are shown to the user."""

    BOUND_REACHED = ("a bound was reached", "")
    CLOSED = ("the curve closed on itself", "")
    COMPLETE = ("the whole connected piece within the bounds was found", "")
    EQUILIBRIUM_REACHED = ("the cycles shrink to an equilibrium", "")
    TOO_MANY_POINTS = (
        "the allowed number of points was used up",
        "raise max_points, take larger steps, or bound the variables",
    )
    STEP_TOO_SMALL = (
        "the smallest step failed",
        "the curve has an end, a corner or a pole here, or g is not smooth; start on its other side",
    )
    NON_FINITE = (
        "g is not finite beyond the last point",
        "the curve leaves the domain of g; bound it before, or start elsewhere",
    )
    RUNS_AWAY = (
        "the curve leaves for infinity",
        "this may be all of it; bound the variables to stop sooner",
    )
    PERIOD_GROWS = (
        "the period exceeds the largest one allowed",
        "a homoclinic orbit is near, or an equilibrium on the orbit; raise max_period to come nearer",
    )
    INTERRUPTED = ("interrupted by the user", "what was computed before is kept; continue from the last point")

    @property
    def meaning(self) -> str:
        """One clause that says what happened."""
        return self.value[0]

    @property
    def remedy(self) -> str:
        """One clause that says what to do; empty where there is nothing to mend."""
        return self.value[1]

    @property
    def ok(self) -> bool:
        """Whether all there is within the bounds was found."""
        return self in (Ending.BOUND_REACHED, Ending.CLOSED, Ending.COMPLETE, Ending.EQUILIBRIUM_REACHED)

    def __str__(self) -> str:
        return f"{self.name}: {self.meaning}" + (f"; {self.remedy}" if self.remedy else "")
