"""What is proved about a branch: the certificate, and the rounding of what it says."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import sympy as sp

from gsp.algebra.precision import precision
from gsp.critical.branch import Branch
from gsp.proofs import balls
from gsp.proofs.covering import Covering
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.refutation import Witness
from gsp.proofs.sides import written
from gsp.proofs.tangential import tangential_rate
from gsp.proofs.tubes import Box
from gsp.proofs.verdict import ProofVerdict
from gsp.results.bounds import as_given, at_least, at_most, shown_sides
from gsp.results.card import Card


@dataclass(frozen=True, eq=False, repr=False)
class Certificate(Card):
    """What is proved about `branch` over `region`, intervals by name (slow variables, then parameters).

    - PROVED: over the whole region the branch is one smooth graph through `through`, and every matrix D_y g on it has
      `stable` eigenvalues left and `unstable` ones right of the imaginary axis, all at least `gap` from it (fast
      time). With `epsilon` the `rate_ratio` gap/(epsilon tangential) is proved to be at least 1 too.
    - REFUTED: it is not, for the `witness`.
    - UNDECIDED: neither. `undecided` are the boxes that are left, `undecided_volume` their share of the region's
      volume; over the others all of it holds, each by itself. `reason` is one sentence.

    `tried` boxes were looked at, and `boxes` hold what is proved; `is_interrupted` by Ctrl-C.
    """

    branch: Branch
    region: Mapping[str, tuple[float, float]]
    through: Mapping[str, float]
    verdict: ProofVerdict
    reason: str
    gap: float
    stable: int
    unstable: int
    epsilon: float | None
    witness: Witness | None
    undecided: tuple[Box, ...]
    undecided_volume: float
    boxes: tuple[Box, ...]
    tried: int
    _equations: EnclosedEquations
    _slow: tuple[sp.Expr, ...]
    _covering: Covering
    # The tangential rate once it is asked for; it costs more than the proof.
    _rate: dict[str, float] = field(default_factory=dict)
    is_interrupted: bool = False

    @property
    def gaps(self) -> tuple[float, ...]:
        """The proved least |Re lambda| over each of the `boxes`."""
        spectra = [piece.spectrum for piece in self._covering.pieces]
        return tuple(math.nan if found is None else found.gap for found in spectra)

    @property
    def tangential(self) -> float:
        """A proved bound of growth and decay along the slow flow, in slow time; infinite where none is found."""
        if "tangential" not in self._rate:
            enough = 0.0 if self.epsilon is None else self.gap / self.epsilon
            with precision(balls.PRECISION):
                pieces = self._covering.pieces
                self._rate["tangential"] = (
                    tangential_rate(self._equations, self._slow, pieces, enough=enough)
                    if self.stable + self.unstable
                    else math.inf
                )
        return self._rate["tangential"]

    @property
    def rate_ratio(self) -> float:
        """The proved lower bound of r = gap/(epsilon tangential); nan without an epsilon."""
        if self.epsilon is None:
            return math.nan
        if not self.tangential < math.inf:
            return 0.0
        slow = Fraction(written(self.epsilon, self.epsilon)[1]) * Fraction(self.tangential)
        return _rounded_down(Fraction(self.gap) / slow) if slow > 0 else math.inf

    @property
    def kind(self) -> str:
        """ "attracting", "repelling" or "saddle"; empty where nothing is proved."""
        if not self.stable + self.unstable:
            return ""
        if not self.unstable:
            return "attracting"
        return "saddle" if self.stable else "repelling"

    def as_dict(self) -> dict[str, object]:
        """Plain values, for JSON; None for what is not finite."""
        names = list(self.region)
        return {
            "verdict": self.verdict.value,
            "reason": self.reason,
            "region": {name: list(side) for name, side in self.region.items()},
            "through": dict(self.through),
            "kind": self.kind,
            "gap": _finite(self.gap),
            "stable": self.stable,
            "unstable": self.unstable,
            "epsilon": self.epsilon,
            "rate_ratio": _finite(self.rate_ratio),
            "witness": None
            if self.witness is None
            else {
                "kind": self.witness.kind,
                "statement": self.witness.statement,
                "box": {name: list(side) for name, side in self.witness.box.items()},
            },
            "boxes": len(self.boxes),
            "tried": self.tried,
            # The first hundred are listed.
            "undecided": [{n: list(side) for n, side in zip(names, box)} for box in self.undecided[:100]],
            "undecided_volume": self.undecided_volume,
        }

    def save(self, path: str | Path) -> None:
        """Write the proof as JSON, which `gsp verify` checks; raises `GspError` unless the verdict is PROVED."""
        from gsp.proofs.proof_file import write

        write(self, Path(path))

    @property
    def where(self) -> str:
        """The region as text."""
        return shown_sides(self.region)

    def __repr__(self) -> str:
        return f"Certificate({self.verdict.name}, {self.reason})"

    def __str__(self) -> str:
        lines = [f"{self.verdict.value} on {self.where}", f"  {self.reason}"]
        if self.verdict is ProofVerdict.PROVED:
            lines.append(
                f"  {self.kind}, gap at least {at_least(self.gap)} in fast time; {len(self.boxes)} "
                f"{'box' if len(self.boxes) == 1 else 'boxes, glued'}"
            )
            if self.epsilon is not None:
                lines.append(f"  rate along the slow flow at most {at_most(self.tangential)}")
                lines.append(
                    f"  normal against tangential rate at {self.branch.system.epsilon} = {as_given(self.epsilon)}: "
                    f"at least {at_least(self.rate_ratio)}"
                )
        if self.witness is not None:
            lines.append(f"  witness: {self.witness.statement}")
        if self.verdict is ProofVerdict.UNDECIDED:
            lines.append(
                f"  boxes: {len(self.boxes)} proved, {len(self.undecided)} left, which are "
                f"{at_most(self.undecided_volume, 3)} of the volume; {self.tried} tried"
            )
        return "\n".join(lines)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _rounded_down(value: Fraction) -> float:
    """The largest double that is at most a positive number, or nearly."""
    try:
        found = float(value)
    except OverflowError:
        return sys.float_info.max
    return found if Fraction(found) <= value else math.nextafter(found, 0.0)
