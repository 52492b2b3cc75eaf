"""What the proof of a tube about a slow manifold says, once it is checked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gsp.proofs.file_variables import lettered
from gsp.results.bounds import at_least, at_most, shown_sides


@dataclass(frozen=True)
class CheckedTube:
    """What a file proves: for every epsilon in (0, `epsilon`] there is a Lipschitz graph over `region` on which
    |y - h| <= `reach` epsilon^(n+1), h being the series through order n.

    `unique`: it is locally invariant, and no other such graph lies there. Else it is locally invariant off a `collar`
    at the sides, and others may lie outside.
    """

    slow: tuple[str, ...]
    parameters: tuple[str, ...]
    fast: tuple[str, ...]
    small: str
    rates: tuple[str, ...]
    equations: tuple[str, ...]
    series: tuple[tuple[str, ...], ...]
    region: tuple[tuple[float, float], ...]
    epsilon: float
    reach: tuple[float, ...]
    stable: int
    unstable: int
    boundary: str
    unique: bool
    collar: float
    boxes: int

    @property
    def variables(self) -> tuple[str, ...]:
        """The names of z0, z1, ... in the expressions."""
        return (*self.slow, *self.parameters, *self.fast, self.small)

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        over = (*self.slow, *self.parameters)
        return {
            "rates": list(self.rates),
            "equations": list(self.equations),
            "series": [list(row) for row in self.series],
            "variables": {f"z{i}": name for i, name in enumerate(self.variables)},
            "region": dict(zip(over, map(list, self.region))),
            "epsilon": self.epsilon,
            "reach": dict(zip(self.fast, self.reach)),
            "order": len(self.series) - 1,
            "stable": self.stable,
            "unstable": self.unstable,
            "boundary": self.boundary,
            "unique": self.unique,
            "collar": self.collar,
            "boxes": self.boxes,
        }

    def __str__(self) -> str:
        over, n = (*self.slow, *self.parameters), len(self.series) - 1
        box = shown_sides(dict(zip(over, self.region)))
        z, *rates = lettered(self.variables, *self.rates)
        _, *equations = lettered(self.variables, *self.equations)
        series = [lettered(self.variables, *row)[1:] for row in self.series]
        legend = ", ".join(f"{z}{i} = {name}" for i, name in enumerate(self.variables))
        rows = [
            f"the proof holds; boxes checked: {self.boxes}",
            f"  over {box}, for every {self.small} in (0, {at_least(self.epsilon)}]",
            f"  of {', '.join(f'{name}` = {rate}' for name, rate in zip(self.slow, rates))},",
            f"  {', '.join(f'{self.small} {name}` = {rate}' for name, rate in zip(self.fast, equations))}",
            f"  ({legend}; ` is the derivative by time)",
            *(f"  h_{k} = ({', '.join(row)})" for k, row in enumerate(series)),
            *(
                f"  |{name} - h| <= {at_most(reach)} {self.small}^{n + 1} on the graph of a Lipschitz map"
                for name, reach in zip(self.fast, self.reach)
            ),
            f"  {self.stable} stable and {self.unstable} unstable fast directions, "
            f"the slow flow at the sides: {self.boundary}",
            *(
                ["  it is locally invariant and unique: no other one over the region lies in the tube"]
                if self.unique
                else [
                    f"  it is locally invariant off a collar of width {at_most(self.collar)} at the sides, "
                    "in which the slow flow is cut off",
                    "  in general it is not unique: each cut-off gives one, and others may lie outside the tube",
                ]
            ),
        ]
        return "\n".join(rows)
