"""Check a proof about cycles that leave an invariant sheet by a delay: theorem 12 of docs/proofs.md.

The file holds f and k of x' = f, epsilon v' = v k, and circuits: a strip from v = width to v = width, and two delays
from the ends of its exit section, which lead into its entry section. Nothing of the prover is used.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

from gsp.proofs import untrusted
from gsp.proofs.band_checker import Vertex
from gsp.proofs.checked_cycle import CheckedAnnulus, CheckedCycle
from gsp.proofs.passage_checker import DelayChecker, StripChecker, read_field, read_fraction
from gsp.proofs.programs import IntervalProgram, Rejected

FORMAT = "gsp cycle by a delay 1"


def check(read: Any) -> CheckedCycle:
    """Check the plain values of a file; raises `Rejected` with the reason when the proof does not hold."""
    return untrusted.guarded(lambda: _checked(read))


def _checked(read: Any) -> CheckedCycle:
    untrusted.of_format(read, FORMAT)
    names, rates, tube = read_field(read)
    # The text of k is an expression by now: in brackets it stays one.
    whole = (rates[0], f"z1*({rates[1]})", "0")
    strip = IntervalProgram(whole, 3)
    found = tuple(_circuit(one, strip, tube) for one in untrusted.few(read["circuits"], 4, "circuits"))
    return CheckedCycle(names, whole, found, read_fraction(read["level"]))


def _circuit(read: Any, program: IntervalProgram, tube: IntervalProgram) -> CheckedAnnulus:
    strip = StripChecker(read["strip"], program)
    strip.checked()
    rows = read["delays"]
    if not isinstance(rows, list) or len(rows) != 2:
        raise Rejected("there are two delays")
    sooner, later = (DelayChecker(row, tube) for row in rows)
    for one in (sooner, later):
        one.checked()
        if not (one.above and one.left is not None):
            raise Rejected("orbits leave a delay above the sheet")
        if (one.width, one.epsilon, one.way) != (sooner.width, strip.epsilon, sooner.way):
            raise Rejected("the strip and the delays belong together")
    assert later.left is not None
    way, width = sooner.way, sooner.width
    if strip.cornered or strip.slow_first or len(strip.sides) % 2 == 0:
        raise Rejected("the fast rate keeps its sign first and last")
    lines = [[_point(strip, v) for v in line] for line in (strip.outer, strip.inner)]
    if any(line[place][1] != width for line in lines for place in (0, -1)):
        raise Rejected("the strip leads from v = width to v = width")
    if min(v for line in lines for _, v in line) < width:
        raise Rejected("the strip is outside the tube")
    # The line from further on is about the other one.
    inner, outer = sorted(lines, key=lambda line: way * line[0][0])
    if [one.grid[0] for one in (sooner, later)] != sorted(
        (line[-1][0] for line in lines), key=lambda u: -way * u
    ):
        raise Rejected("the delays begin at the ends of the exit section")
    if not (
        way * inner[0][0] < way * sooner.grid[sooner.kept] and way * later.grid[later.left] < way * outer[0][0]
    ):
        raise Rejected("the delays do not lead into the entry section")
    unique, contraction = read["unique"], untrusted.number(read["contraction"])
    if type(unique) is not bool or (unique and not contraction < 0):
        raise Rejected("a cycle is unique where the integral of the divergence is negative")
    if unique and not strip.contraction + later.growth <= contraction:
        raise Rejected("the integral of the divergence is not below its bound")
    period = untrusted.numbers(read["period"], 2)
    if not (period[0] <= strip.period[0] + sooner.time[0] and strip.period[1] + later.time[1] <= period[1]):
        raise Rejected("the period is not within its bounds")
    (x_out, v_out), (x_in, v_in) = (tuple(zip(*line)) for line in (outer, inner))
    sides = (
        ((float(min(x_out)), float(min(x_in))), (float(max(x_in)), float(max(x_out)))),
        ((0.0, float(width)), (float(max(v_in)), float(max(v_out)))),
    )
    return CheckedAnnulus(
        float(strip.epsilon), unique, (float(period[0]), float(period[1])), float(contraction), sides,
        (len(outer), len(inner)),
    )  # fmt: skip


def _point(strip: StripChecker, vertex: Vertex) -> tuple[Fraction, Fraction]:
    return Fraction(vertex[0]) / strip.scale, Fraction(vertex[1]) / strip.scale
