"""What follows from each kind of loss, and whether reduction may go on: one sentence each, with the exponent.

The exponents are those of the local scalings: M. Krupa and P. Szmolyan, SIAM J. Math. Anal. 33 (2001) 286-314 for
folds, Nonlinearity 14 (2001) 1473-1491 for transcritical points and pitchforks; H. W. Broer, T. J. Kaper and
M. Krupa, J. Dynam. Differential Equations 25 (2013) 925-958 for cusps; A. I. Neishtadt, Differential Equations 23
(1987) 1385-1391 for Hopf points.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from fractions import Fraction
from typing import NamedTuple

from gsp.critical.loss_kind import LossKind

# The smallest positive zero of Ai(-s): the passage of v' = v^2 + t (Mishchenko and Rozov 1980).
OMEGA_0 = 2.3381074104597670385
# A number that decides between two cases counts as on their boundary when nearer than this.
BOUNDARY = 1e-6


class LossConsequence(NamedTuple):
    """What orbits do, whether reduction may go on through the place, and how."""

    consequence: str
    may_reduce: bool
    remedy: str

    def in_terms_of(self, small: str) -> LossConsequence:
        """The same where the small parameter is called `small`."""
        consequence, remedy = (re.sub(r"\bepsilon\b", small, told) for told in (self.consequence, self.remedy))
        return self._replace(consequence=consequence, remedy=remedy)


NOTHING_PASSES = LossConsequence(
    "the slow flow vanishes here, so nothing passes", False, "move the region off it"
)
STANDS_STILL = LossConsequence(
    "every slow rate vanishes at epsilon = 0, so nothing comes here at leading order; terms in epsilon decide",
    False,
    "leave the factor epsilon out of the slow rates, or give rates in fast time as one field, [states]",
)
STOP_OR_CROSS = "stop the reduced flow here, or integrate the full system across"
EXIT = "entry_exit tells which, and where the exit is"
# Coefficients at the loss do not say whether the branch is invariant for epsilon > 0.
DELAY = (
    "with delay, until the integral of the eigenvalue is zero, where the branch is invariant for epsilon > 0; else "
    "higher orders in epsilon push orbits off it within (epsilon ln(1/epsilon))^(1/2)"
)


def fold(coefficients: Mapping[str, float], slow: int) -> LossConsequence:
    """A fold, by the sign of kappa = a <l, g_x f>; zero where the normal switching condition fails."""
    kappa = coefficients["kappa"]
    if kappa > 0.0:
        return LossConsequence(
            f"orbits that reach it jump, {coefficients['delay']:.4g} epsilon^(2/3) later in slow time than M0 ends; "
            "errors there go as epsilon^(2/3)",
            False,
            "stop the reduced flow at the fold and start again on the sheet the fast fibre leads to, or integrate "
            "the full system across",
        )
    if kappa < 0.0:
        return LossConsequence(
            "slow orbits leave it on both sheets and none reaches it; within epsilon^(2/3) of it the slow manifold "
            "is not attracting",
            False,
            "keep the region off it; orbits that start away from it never come back to it",
        )
    where = "the slow flow vanishes here" if slow == 1 else "the slow flow is tangent to the fold here"
    return LossConsequence(
        f"{where}: canards are possible, orbits may follow the repelling sheet for a time of order 1",
        False,
        "canard_value gives the parameter for which orbits go through; canards live in widths exp(-c/epsilon)"
        if slow == 1
        else "folded_singularities says how many canards go through",
    )


def cusp(coefficients: Mapping[str, float], slow: int) -> LossConsequence:
    """A cusp: two curves of folds meet, or for one slow variable a fold of third order."""
    attracting = coefficients["c"] < 0.0
    kind = "attracts only algebraically, v' = c v^3" if attracting else "repels algebraically, v' = c v^3"
    meeting = "two folds meet; " if slow > 1 else ""
    return LossConsequence(
        f"{meeting}the fast fibre {kind}: the inner region is epsilon^(1/5) wide in v and epsilon^(3/5) in x",
        False,
        "integrate the full system across; M0 goes on" + (" and orbits do not jump" if attracting else ""),
    )


def transcritical(coefficients: Mapping[str, float]) -> LossConsequence:
    """A crossing of two branches, by lambda (Krupa and Szmolyan): 1 is the canard case."""
    if "lambda" not in coefficients:
        return NOTHING_PASSES
    value = coefficients["lambda"]
    if abs(value - 1.0) <= BOUNDARY:
        return LossConsequence(
            f"the branches exchange their stability {DELAY}",
            False,
            EXIT,
        )
    if value < 1.0:
        return LossConsequence(
            "the branches exchange their stability: orbits change to the other, attracting one within epsilon^(1/2)",
            True,
            "change to the other branch at the crossing; errors there go as epsilon^(1/2)",
        )
    return LossConsequence(
        "orbits leave along the fast fibre within epsilon^(1/2) of the crossing: they jump",
        False,
        "stop the reduced flow at the crossing, or integrate the full system across",
    )


def pitchfork(coefficients: Mapping[str, float]) -> LossConsequence:
    """A pitchfork, by the sign of its cubic coefficient and the push of order epsilon along the fibre."""
    if "crossing" not in coefficients:
        return NOTHING_PASSES
    if coefficients["c"] > 0.0:
        return LossConsequence(
            "subcritical: orbits that pass jump along the fast fibre, with delay when nothing pushes them off",
            False,
            STOP_OR_CROSS,
        )
    if coefficients["push"] == 0.0:
        return LossConsequence(f"supercritical: orbits leave the repelling branch {DELAY}", False, EXIT)
    return LossConsequence(
        "supercritical: orbits go over to one of the two outer branches within epsilon^(1/2), the inner region "
        "being epsilon^(1/4) wide in v",
        True,
        "change to the outer branch on the side of `push`; errors there go as epsilon^(1/4)",
    )


def rank_change(coefficients: Mapping[str, float]) -> LossConsequence:
    """g vanishes along the fast fibre: the eigenvalue passes zero and nothing bends."""
    if "crossing" not in coefficients:
        return NOTHING_PASSES
    if coefficients["crossing"] < 0.0:
        return LossConsequence(
            "the fast fibre consists of equilibria; orbits come from where the direction repels and the branch gains "
            "its attraction here",
            False,
            "keep the region on the attracting side",
        )
    if coefficients["push"] == 0.0:
        return LossConsequence(f"the fast fibre consists of equilibria; orbits leave {DELAY}", False, EXIT)
    return LossConsequence(
        "the fast fibre consists of equilibria; orbits leave it after a time (epsilon ln(1/epsilon))^(1/2)",
        False,
        STOP_OR_CROSS,
    )


def hopf(coefficients: Mapping[str, float]) -> LossConsequence:
    """A Hopf point of the layer problem, by the speed of its pair along the slow flow."""
    crossing, l1 = coefficients.get("crossing", 0.0), coefficients["l1"]
    after = "small cycles of the layer problem" if l1 < 0.0 else "a jump to large oscillations"
    if l1 == 0.0:
        after = "what higher terms decide"
    if crossing == 0.0:
        return LossConsequence("the pair does not cross along the slow flow", False, "move the region off it")
    if crossing < 0.0:
        return LossConsequence(
            "the slow flow carries orbits from oscillating repulsion to attraction",
            False,
            "keep the region on the attracting side",
        )
    return LossConsequence(
        "delayed exit: orbits leave a time of order 1 later, where the integral of Re lambda is back to zero or at "
        f"the buffer point of an analytic system, then {after}; noise above exp(-c/epsilon) removes the delay",
        False,
        "where orbits leave is decided by the entry-exit function",
    )


def of_switch(kind: LossKind, exponent: Fraction | None) -> LossConsequence:
    """Where the sheet of a switch ends; `exponent` is the power of epsilon after which orbits leave a visible fold."""
    if kind is LossKind.TWO_FOLD:
        return LossConsequence(
            "the fields of both sides are tangent to the surface: what orbits do is not decided by them",
            False,
            "keep the region off it, or integrate the full system",
        )
    if kind is LossKind.INVISIBLE_FOLD:
        return LossConsequence(
            "the field of that side bends back to the surface: orbits begin to slide here",
            True,
            "from here on, on the side where both fields push towards the surface",
        )
    late = "by no power of epsilon" if exponent is None else f"after a slow time of order epsilon^({exponent})"
    return LossConsequence(
        f"sliding ends, as at the end of a friction cone: orbits leave along the field of that side, {late}",
        False,
        "stop the reduced flow there and go on with the field of that side; run_piecewise does both, and sliding_exit "
        "says how late orbits leave",
    )


BOGDANOV_TAKENS = LossConsequence(
    "a fold and a Hopf curve of the layer problem meet; passage takes a slow time of order epsilon^(4/5) and orbits "
    "leave along the nilpotent block",
    False,
    STOP_OR_CROSS,
)
NEUTRAL_SADDLE = LossConsequence("nothing: one eigenvalue on each side of the axis", True, "no change")
NILPOTENT = LossConsequence(
    "no exponential rate along the block: orbits drift algebraically and no slow manifold of Fenichel's persists",
    False,
    "rescale the fast variables by powers of epsilon so that the block becomes hyperbolic, or declare them slow",
)
CENTRE = LossConsequence(
    "fast oscillations neither decay nor grow at leading order", False, "average over them; do not reduce"
)
DEGENERATE = LossConsequence(
    "the coefficients do not decide: what orbits do depends on terms of higher order or on more than one direction",
    False,
    "integrate the full system near here, or unfold it with a parameter",
)
JUMP = LossConsequence(
    "an eigenvalue jumps across the axis: the branch is of another type on the other side",
    False,
    "shrink the region to one side, or treat the switching surface by Filippov's rule",
)
BRANCH_POLE = LossConsequence("the branch goes to infinity", False, "shrink the region to one side of the pole")
FIELD_POLE = LossConsequence(
    "the field goes to infinity on the branch", False, "shrink the region to one side of the pole"
)
