"""A delayed loss of stability: theorem 11 of docs/proofs.md.

Along an invariant sheet, v = 0 in x' = f, epsilon v' = v k, the logarithm of |v| has the rate k/(epsilon f) over x.
Bounds of the integral of k/f over a tube |v| <= width say how far every orbit stays in it, and where all have left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from flint import arb

from gsp.cycles.enclosed_field import exact_rates
from gsp.cycles.outline import NoOutline
from gsp.cycles.sectors import NotProved
from gsp.proofs import balls
from gsp.proofs.ball_functions import BallFunction
from gsp.proofs.equations import without_decimals
from gsp.singular.passage.delayed_exit import DelayedExit

# Strips along the sheet, and how many are left to spare at both ends: the checker encloses in its own way.
STRIPS, SPARE = 400, 4


@dataclass(frozen=True, eq=False, repr=False)
class ProvedDelay:
    """What holds for every epsilon in (0, `epsilon`] of orbits that begin with 0 < |v| <= `width` over `grid`[0].

    They stay in |v| <= `width` at least to grid[`kept`], in a slow time of at least `time`[0]. Those that begin with
    |v| = `width` have left by grid[`left`], in a time of at most `time`[1]; None where that is not proved, and then the
    time is that to grid[`kept`]. The deepest |v| is at most exp(-`depth`/epsilon) times the first. `growth` bounds what
    the integral of v k_v + epsilon f_x adds on the way. Only v > 0 is meant where they are `above`.
    """

    epsilon: float
    width: float
    grid: np.ndarray
    kept: int
    left: int | None
    time: tuple[float, float]
    depth: float
    above: bool = False
    growth: float = 0.0

    @property
    def stays_to(self) -> float:
        """x up to which orbits stay."""
        return float(self.grid[self.kept])

    @property
    def leaves_by(self) -> float:
        """x by which those from the edge of the tube have left; infinite, with the sign of the way, where unknown."""
        way = float(np.sign(self.grid[1] - self.grid[0]))
        return way * float("inf") if self.left is None else float(self.grid[self.left])


class DelayField:
    """f and k of (x, v, epsilon), as balls: with k/f and its slopes."""

    def __init__(self, arguments: Sequence[sp.Symbol], f: sp.Expr, k: sp.Expr) -> None:
        x, v, _ = self.arguments = tuple(arguments)
        self.rates = f, k
        ratio = k / f
        self._all = BallFunction(self.arguments, [f, ratio, sp.diff(ratio, x), sp.diff(ratio, v)])
        self._growth = BallFunction(self.arguments, [v * sp.diff(k, v), sp.diff(f, x)])

    def over(self, x: arb, v: arb, epsilon: arb) -> list[arb]:
        """f, k/f and the slopes of k/f by x and v."""
        return self._all([x, v, epsilon])

    def growth(self, x: arb, v: arb, epsilon: arb) -> arb:
        """v k_v + epsilon f_x: the divergence but for k, times epsilon."""
        stretched, slow = self._growth([x, v, epsilon])
        return stretched + epsilon * slow


def proved_delay(
    field: DelayField, grid: np.ndarray, width: float, epsilon: float, *, above: bool = False
) -> ProvedDelay:
    """How far along `grid`, from its first x to its last, orbits stay; only those with v > 0 where they are `above`.

    Raises `NotProved` where f is not proved to keep its sign, or the sheet is not proved to attract at the start.
    """
    small = balls.hull(0.0, epsilon)
    tube = balls.hull(0.0 if above else -width, width)
    way = 1 if grid[-1] > grid[0] else -1
    upper = lower = deepest = growth = arb(0)
    least, most = [arb(0)], [arb(0)]
    kept, left, going = 0, None, True
    for i, (one, two) in enumerate(zip(grid[:-1].tolist(), grid[1:].tolist()), start=1):
        w, middle = way * (arb(two) - arb(one)), arb(0.5 * (one + two))
        strip = balls.hull(min(one, two), max(one, two))
        f, ratio, by_x, by_v = field.over(strip, tube, small)
        if not (way * f > 0 and all(b.is_finite() for b in (f, ratio, by_x, by_v))):
            if going or kept == 0:
                raise NotProved("the slow rate is not proved to keep its sign along the sheet")
            break
        at = field.over(middle, arb(0), small)[1]
        # Over a strip, orbits at v: at most |v| times the slope from v = 0, and half^2/2 times the range of that by x.
        half = (w / 2).upper()
        error = (half**2 / 2 * (by_x.upper() - by_x.lower()) + w * width * abs(by_v)).upper()
        error += w.upper() * abs(middle - (arb(one) + arb(two)) / 2) * abs(by_x)
        change = way * w * at + error * balls.hull(-1.0, 1.0)
        crude = way * w * ratio
        if going:
            # Within the strip the sum is below its start plus what it may gain.
            going = bool(upper + crude.upper().max(arb(0)) < 0) if i > 1 else bool(crude < 0)
        upper += change.upper().min(crude.upper())
        lower += change.lower().max(crude.lower())
        going = going and bool(upper < 0)
        if going:
            kept = i
            deepest = deepest.min(upper.upper())
        least.append(least[-1] + w / (way * f).upper())
        most.append(most[-1] + w / (way * f).lower())
        growth += (w * field.growth(strip, tube, small) / (way * f)).upper().max(arb(0))
        if left is None and lower > 0:
            left = i + SPARE
        if i == left:
            break
    # The grid, or the sign of the slow rate, may end before.
    left = None if left is None or left >= len(most) else left
    kept -= SPARE
    if kept <= 0:
        raise NotProved("the sheet is not proved to attract at the entry")
    return ProvedDelay(
        epsilon, width, grid, kept, left,
        (balls.below(least[kept]), balls.above(most[left or kept])), -balls.above(deepest), above,
        balls.above(growth),
    )  # fmt: skip


def exact_sheet(exit: DelayedExit) -> sp.Expr:
    """h_0(x) with fractions for decimals and for parameters; raises `NoOutline` where it has no formula."""
    (y,), values = exit.branch.system.y, exit.branch.system.parameters
    if exit.branch.graph is None:
        raise NoOutline("the sheet has no formula")
    return without_decimals(exit.branch.graph[y].xreplace({p: without_decimals(v) for p, v in values.items()}))


def delay_field(exit: DelayedExit) -> DelayField:
    """The field in x and v = y - h_0(x), where it is v k exactly; raises `NoOutline`."""
    system, sheet = exit.branch.system, exact_sheet(exit)
    (x,), (y,) = system.x, system.y
    f, g, h = exact_rates(system)
    beside = {y: sheet + y}
    f = f.xreplace(beside)
    rate = (g + system.epsilon * h).xreplace(beside) - system.epsilon * sp.diff(sheet, x) * f
    # Multiplied out about the origin, a slow variable that is far from it would lose what enclosures know of its terms.
    c = system.centres.get(x, sp.S.Zero)

    def divided_out(expression: sp.Expr) -> sp.Expr:
        return sp.cancel(expression.xreplace({x: x + c})).xreplace({x: x - c})

    k = divided_out(rate / y)
    if sp.denom(k).xreplace({y: sp.S.Zero}) == 0:
        raise NoOutline("the sheet is not seen to be invariant exactly")
    return DelayField((x, y, system.epsilon), divided_out(f) if f.is_rational_function() else f, k)
