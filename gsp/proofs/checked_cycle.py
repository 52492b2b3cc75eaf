"""What the proof of a relaxation cycle says, once it is checked."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from gsp.proofs.file_variables import lettered
from gsp.results.bounds import at_least, outside


@dataclass(frozen=True)
class CheckedAnnulus:
    """For every epsilon in (0, `epsilon`] a closed orbit lies in an annulus; `unique`: it is the only one there, and
    attracts.

    `period` holds the periods of all closed orbits in it. Where the orbit is unique, `contraction` is not below the
    integral of epsilon times the divergence over it. `sides` are, for the slow and the fast variable, where its least
    and its largest value lie.
    """

    epsilon: float
    unique: bool
    period: tuple[float, float]
    contraction: float
    sides: tuple[tuple[tuple[float, float], ...], ...]
    vertices: tuple[int, int]


def whole_rate(rates: tuple[str, ...]) -> str:
    """g + epsilon h as text."""
    return rates[1] if rates[2] == "0" else f"{rates[1]} + z2 ({rates[2]})"


@dataclass(frozen=True)
class CheckedCycle:
    """What a file proves of x' = f, epsilon y' = g + epsilon h; `names` are those of x, y and epsilon, `rates` f, g
    and h. With a `level` the fast variable is y - level, and cycles pass a strip and the tube of a delay.
    """

    names: tuple[str, ...]
    rates: tuple[str, ...]
    annuli: tuple[CheckedAnnulus, ...]
    level: Fraction | None = None

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "rates": list(self.rates),
            "variables": {f"z{i}": name for i, name in enumerate(self.names)},
            "level": None if self.level is None else str(self.level),
            "annuli": [
                {
                    "epsilon": one.epsilon,
                    "unique": one.unique,
                    "period": list(one.period),
                    # Of others it is not checked.
                    "contraction": one.contraction if one.unique else None,
                    "amplitude": {n: [list(end) for end in side] for n, side in zip(self.names, one.sides)},
                    "vertices": list(one.vertices),
                }
                for one in self.annuli
            ],
        }

    def __str__(self) -> str:
        x, y, small = self.names
        z, f, g = lettered(self.names, self.rates[0], whole_rate(self.rates))
        shift = f" - ({self.level})" if self.level else ""
        lines = [
            f"the proof holds: {sum(sum(one.vertices) for one in self.annuli)} edges were checked",
            f"  of {x}` = {f}, {small} {y}` = {g}",
            f"  ({z}0 = {x}, {z}1 = {y}{shift}, {z}2 = {small}; ` is the derivative by time)",
        ]
        where = "in an annulus" if self.level is None else "in a strip and the tube of a delay"
        for one in self.annuli:
            what = "just one closed orbit lies, and attracts," if one.unique else "a closed orbit lies"
            lines.append(f"  for every {small} in (0, {at_least(one.epsilon)}] {what} {where}")
            lines.append(f"    its period is from {' to '.join(outside(*one.period))}")
            shown = self.names if self.level is None else (x, f"{z}1")
            for name, (low, high) in zip(shown, one.sides):
                lines.append(
                    f"    {name} goes down to between {' and '.join(outside(*low))}, "
                    f"up to between {' and '.join(outside(*high))}"
                )
        return "\n".join(lines)
