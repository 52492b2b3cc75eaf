"""`Loss`: a place where normal hyperbolicity, or smoothness, is lost, with its name and what follows from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from fractions import Fraction

from gsp.critical.loss_kind import LossKind
from gsp.results.card import Card
from gsp.systems.flow import in_words


class Contact(StrEnum):
    """What reaches the axis, as the search sees it before the place is examined."""

    ZERO = "zero eigenvalue"
    EVERYWHERE = "zero eigenvalue on the whole branch"
    PAIR = "imaginary pair"
    PAIR_EVERYWHERE = "imaginary pair on the whole branch"
    JUMP = "eigenvalue that jumps"
    END = "end of the sheet"
    SUM = "two eigenvalues with sum zero"
    BRANCH_POLE = "pole of the branch"
    FIELD_POLE = "pole of the field"
    SWITCH = "switching surface"
    SATURATION = "end of a switch"

    @property
    def is_everywhere(self) -> bool:
        """Whether it does so on the whole branch, and not at places."""
        return self in (Contact.EVERYWHERE, Contact.PAIR_EVERYWHERE)


# Of v, x and epsilon: what gsp.blow_up computes at generic points of these kinds, and a canard point's.
WEIGHTS = {
    LossKind.FOLD: (1, 2, 3),
    LossKind.SLIP_ONSET: (1, 2, 3),
    LossKind.CUSP: (1, 3, 5),
    LossKind.TRANSCRITICAL: (1, 1, 2),
    LossKind.PITCHFORK: (1, 2, 4),
    LossKind.BOGDANOV_TAKENS: (2, 4, 5),
}
CANARD = (1, 2, 2)
# The coefficient that is there, and not zero, where the slow flow passes the point.
PASSED_IF = {
    LossKind.FOLD: "kappa",
    LossKind.CUSP: "kappa",
    LossKind.TRANSCRITICAL: "lambda",
    LossKind.PITCHFORK: "crossing",
}


@dataclass(frozen=True, repr=False)
class Loss(Card):
    """A place where normal hyperbolicity is lost, or the field is not smooth.

    - `kind`, `point` by name, `eigenvalue` of g_y nearest to the axis there, and `crossing`, what reaches the axis;
    - `test` names the function that vanishes at a loss of this kind, `value` is its value there;
    - `coefficients` decide what it looks like nearby (docs/losses.md has the table), `note` says what is special;
    - `consequence` says what orbits do, `may_reduce` whether reduction may go on through it, and `remedy` how;
    - `samples` counts the points of a curve or surface of such losses that this one stands for, `extent` gives the
      range of each slow variable over them;
    - `on_edge`: the place is on the edge of the region, so that one side of it only was examined;
    - `digits` to which its place is told, by name, so that places of the region can be told apart;
    - `small` is what the small parameter is called.
    """

    point: Mapping[str, float]
    eigenvalue: complex
    crossing: Contact
    kind: LossKind
    test: str
    value: float
    coefficients: Mapping[str, float] = field(default_factory=dict)
    consequence: str = ""
    may_reduce: bool = False
    remedy: str = ""
    note: str = ""
    samples: int = 1
    extent: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    on_edge: bool = False
    digits: Mapping[str, int] = field(default_factory=dict, compare=False, repr=False)
    small: str = "epsilon"

    @property
    def is_pole(self) -> bool:
        """Whether the branch or the field goes to infinity here, rather than an eigenvalue to the axis."""
        return self.kind.is_pole

    @property
    def is_hyperbolic(self) -> bool:
        """Whether the eigenvalues keep off the axis all the same: a kink, or a neutral saddle."""
        if self.kind is LossKind.NON_SMOOTH:
            return self.crossing is Contact.SWITCH
        return self.kind is LossKind.NEUTRAL_SADDLE

    @property
    def weights(self) -> tuple[int, int, int] | None:
        """Weights of v, x and epsilon in the blow-up of a nilpotent point; None where the coefficients do not say them.

        v is along the null direction; where the slow flow vanishes at a fold, x stands on its way to a canard point.
        """
        if self.kind.is_fold and self.coefficients.get("kappa") == 0.0:
            return CANARD
        passed = PASSED_IF.get(self.kind)
        return WEIGHTS.get(self.kind) if passed is None or self.coefficients.get(passed) else None

    @property
    def scaling(self) -> str:
        """The powers of epsilon that the weights give, in words; empty where there are none."""
        if self.weights is None:
            return ""
        along, across, small = self.weights
        first = f"{self.small}^({Fraction(along, small)})"
        second = self.small if across == small else f"{self.small}^({Fraction(across, small)})"
        return (
            f"v ~ {first}, x ~ {second}, by the weights {self.weights} of v, x and {self.small} in the blow-up"
        )

    @property
    def headline(self) -> str:
        """Kind and place, in one line."""
        many = f", one of {self.samples} samples of it" if self.samples > 1 else ""
        edge = ", on the edge of the region" if self.on_edge else ""
        return f"{self.kind}: {self.crossing} at {in_words(self.point, more=self.digits)}{many}{edge}"

    def __repr__(self) -> str:
        return f"Loss({self.headline})"

    def __str__(self) -> str:
        rows = [("test", f"{self.test} = {self.value + 0.0:.3g}, eigenvalue {self.eigenvalue + 0j:.3g}")]
        if self.coefficients:
            shown = in_words(self.coefficients)
            rows.append(("decided by", shown))
        if self.note:
            rows.append(("note", self.note))
        rows.append(("follows", self.consequence))
        if self.scaling:
            rows.append(("because", self.scaling))
        rows.append(("reduction", ("may go on: " if self.may_reduce else "ends here: ") + self.remedy))
        return "\n".join([self.headline, *(f"  {name:10}  {text}" for name, text in rows)])
