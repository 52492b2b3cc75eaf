"""What the proof of a passage says, once it is checked."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from gsp.proofs.checked_cycle import whole_rate
from gsp.proofs.file_variables import lettered
from gsp.results.bounds import as_given, at_least, at_most, inside, outside

Side = tuple[float, float]


@dataclass(frozen=True)
class CheckedStrip:
    """For every epsilon in (0, `epsilon`] every orbit through the `entry` section leaves through the `exit` section,
    both as intervals of the slow and of the fast variable, after a slow time within `time`. `contraction` is not below
    the integral of epsilon times the divergence.
    """

    epsilon: float
    entry: tuple[Side, Side]
    exit: tuple[Side, Side]
    time: Side
    contraction: float


@dataclass(frozen=True)
class CheckedDelay:
    """For every epsilon in (0, `epsilon`] orbits within `width` of v = 0 over x = `entry`, of those `above` it where
    that is true, stay so to `stays_to`; those that begin at `width` have left by `leaves_by`, unless that is None.
    """

    epsilon: float
    width: float
    entry: float
    stays_to: float
    leaves_by: float | None
    time: Side
    depth: float
    above: bool


@dataclass(frozen=True)
class CheckedPassage:
    """What a file proves: of x' = f, epsilon y' = g + epsilon h in a strip, of x' = f, epsilon v' = v k beside v = 0.

    `names` are those of x, y and epsilon, `rates` f, g and h, or f and k, and `origin` is what was taken off x and y.
    """

    names: tuple[str, ...]
    rates: tuple[str, ...]
    origin: tuple[Fraction, ...]
    found: CheckedStrip | CheckedDelay

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        one = self.found
        plain: dict[str, Any] = {
            "rates": list(self.rates), "variables": {f"z{i}": name for i, name in enumerate(self.names)},
            "origin": [str(v) for v in self.origin], "epsilon": one.epsilon, "time": list(one.time),
        }  # fmt: skip
        if isinstance(one, CheckedStrip):
            return plain | {
                "entry": list(map(list, one.entry)), "exit": list(map(list, one.exit)), "contraction": one.contraction
            }  # fmt: skip
        return plain | {
            "width": one.width, "entry": one.entry, "stays_to": one.stays_to, "leaves_by": one.leaves_by,
            "depth": one.depth, "above": one.above,
        }  # fmt: skip

    def __str__(self) -> str:
        x, y, small = self.names
        one = self.found
        rate = whole_rate(self.rates) if isinstance(one, CheckedStrip) else f"z1 ({self.rates[1]})"
        z, f, g = lettered(self.names, self.rates[0], rate)
        shift = [f" - ({offset})" if offset else "" for offset in self.origin]
        lines = [
            "the proof holds",
            f"  of {x}` = {f}, {small} {y}` = {g}",
            f"  ({z}0 = {x}{shift[0]}, {z}1 = {y}{shift[1]}, {z}2 = {small}; ` is the derivative by time)",
        ]
        up_to = f"for every {small} in (0, {at_least(one.epsilon)}]"
        if isinstance(one, CheckedStrip):
            for what, sides, told in (
                (f"{up_to} every orbit through", one.entry, inside),
                ("leaves through", one.exit, outside),
            ):
                shown = [
                    f"{n} = {as_given(a)}" if a == b else f"{n} from {' to '.join(told(a, b))}"
                    for n, (a, b) in zip((f"{z}0", f"{z}1"), sides)
                ]
                lines.append(f"  {what} {', '.join(shown)}")
            lines.append(f"    after a slow time from {' to '.join(outside(*one.time))}")
        else:
            early, late = (at_least, at_most) if one.stays_to > one.entry else (at_most, at_least)
            where = f"0 <= {z}1" if one.above else f"|{z}1|"
            lines.append(
                f"  {up_to} orbits with {where} <= {at_least(one.width)} over {z}0 = {as_given(one.entry)} stay so to "
                f"{z}0 = {early(one.stays_to)}"
            )
            if one.leaves_by is not None:
                lines.append(f"    those that begin at this bound have left by {z}0 = {late(one.leaves_by)}")
        return "\n".join(lines)
