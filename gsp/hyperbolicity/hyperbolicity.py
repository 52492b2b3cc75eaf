"""Normal hyperbolicity of a branch over a region: the conditions of Fenichel's theorem, with their numbers.

The fast Jacobian g_y(x, h_0(x), 0) must have no eigenvalue on the imaginary axis (Eldering 2015, section 4.1).
The verdict is *sampled*: a finite set of points is examined, the worst of them refined. Between them losses are
excluded as far as `exclusion` goes, and the verdict says how far; `gsp.certify` proves.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gsp.critical.branch import Branch
from gsp.critical.loss_kind import LossKind
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.domination import Shortfall, dominated, shortfall
from gsp.hyperbolicity.exclusion import Exclusion, exclude
from gsp.hyperbolicity.losses.kinds import Loss
from gsp.hyperbolicity.losses.shrinking import SubRegion, largest_sub_region
from gsp.hyperbolicity.samples import Judged, Kind, is_worse, judged_samples, kind_of, sampled
from gsp.results.bounds import at_least
from gsp.results.card import Card
from gsp.systems.arguments import check_flag, check_noun
from gsp.systems.flow import as_points, check_epsilon
from gsp.systems.region import Interval, check_region

if TYPE_CHECKING:
    from gsp.proofs.certificate import Certificate

EQUILIBRIUM_TOLERANCE = 1e-9
# Conditions whose numbers a proof has too.
HYPERBOLIC, DOMINATES = "hyperbolic equilibria", "normal rate dominates"


@dataclass(frozen=True)
class Condition:
    """One condition: what is required, the number that decides it, and whether it holds.

    With `is_proved` the number is no less than `value`, which is proved.
    """

    name: str
    statement: str
    value: float
    requirement: str
    holds: bool
    is_proved: bool = False

    @property
    def fact(self) -> str:
        """The number beside what is required of it."""
        shown = f"at least {at_least(self.value)}" if self.is_proved else f"{self.value:.6g}"
        return f"{self.name}: {shown} ({self.requirement})"

    def __str__(self) -> str:
        return f"{'holds' if self.holds else 'FAILS':5}  {self.fact}"


@dataclass(frozen=True)
class NormalRates:
    """Normal rate in fast time against the tangential rate in slow time.

    `normal` is the gap, the least |Re lambda| of g_y; `tangential` bounds the growth and decay of differences along the
    slow flow on M0 (Eldering 2013, definition 1.1) at the samples, in the constant metric over the region in which that
    bound is least. Units and linear changes of the slow variables do not change it; see `gsp.critical.slow_metric`.
    """

    normal: float
    tangential: float

    def r(self, epsilon: float) -> float:
        """The r of r-normal hyperbolicity: normal rate per tangential rate, normal/(epsilon tangential)."""
        small = check_epsilon(epsilon)
        if not self.tangential:
            return float("inf") if self.normal else 0.0
        return self.normal / (small * self.tangential)


@dataclass(frozen=True, eq=False)
class Hyperbolicity(Card):
    """The verdict on `branch` over `region`: `kind`, `gap` (least |Re lambda| in fast time: a bound, if it `is_proved`,
    else the `sampled_gap`, what was met at the samples), `rates`, `losses`, and the `conditions` one by one. `samples`
    points (x, y) were examined; `evidence` says how. `looked_at` are neutral saddles and the like, which are no losses,
    and `notes` what else was seen and does no harm. `exclusion` says
    where between the samples a loss is not excluded; None when one was found at them. `shortfall` says where and in
    which direction the normal rate does not dominate the tangential one; None where it does, on a lost branch, and
    without an epsilon.
    `certificate` is what is proved, when that was asked for: a REFUTED one makes the kind "lost". `epsilon` is where
    the condition r >= 1 was decided, if it was.
    """

    branch: Branch
    region: Mapping[str, Interval]
    kind: Kind
    gap: float
    rates: NormalRates
    losses: tuple[Loss, ...]
    conditions: tuple[Condition, ...]
    samples: int
    evidence: str
    looked_at: tuple[Loss, ...] = ()
    notes: tuple[str, ...] = ()
    exclusion: Exclusion | None = None
    certificate: Certificate | None = None
    shortfall: Shortfall | None = None
    epsilon: float | None = None
    sampled_gap: float = float("nan")

    @property
    def holds(self) -> bool:
        """Whether every condition holds at the samples, and no loss is left between them: none is refuted, and what
        enclosures do not exclude is proved. Where nothing has an enclosure the samples decide.
        """
        refuted = self.certificate is not None and self.certificate.verdict.name == "REFUTED"
        return not refuted and not self.is_open and all(condition.holds for condition in self.conditions)

    @property
    def failing(self) -> tuple[Mapping[str, float], ...]:
        """Points at which a condition fails: the losses, else where the tangential rate is too large."""
        found = tuple(loss.point for loss in self.losses)
        return found if found or self.shortfall is None else (self.shortfall.point,)

    @property
    def is_open(self) -> bool:
        """Whether enclosures leave room for a loss between the samples."""
        found = self.exclusion
        return found is not None and not (found.is_complete or found.reason or self.is_proved)

    @property
    def is_proved(self) -> bool:
        """Whether the kind is proved over the region, with the `gap`."""
        return (
            self.certificate is not None
            and self.certificate.verdict.name == "PROVED"
            and self.kind is not Kind.LOST
        )

    def shown_gap(self, digits: int = 6) -> str:
        """The gap as text: "at least" it, rounded down, where it is proved."""
        return f"at least {at_least(self.gap, digits)}" if self.is_proved else f"{self.gap:.{digits}g}"

    def with_proof(self, *, epsilon: float | None = None, most_boxes: int | None = None) -> Hyperbolicity:
        """The verdict with its `certificate`: what `certify` proves over the region with `most_boxes` boxes.

        With `epsilon` the condition r >= 1 is to be proved there too. Ctrl-C goes on upwards. Raises
        `UnsupportedFunctionError` for a function without an enclosure, `BranchError` for more than one sheet.
        """
        from gsp.proofs.certification import MOST_BOXES, certify_branch

        budget = MOST_BOXES if most_boxes is None else most_boxes
        found = certify_branch(self.branch, region=self.region, epsilon=epsilon, most_boxes=budget)
        if found.is_interrupted:
            raise KeyboardInterrupt
        if found.verdict.name == "REFUTED" and found.witness is not None:
            evidence = f"refuted on {found.where}: {found.witness.statement}"
            return replace(self, kind=Kind.LOST, certificate=found, evidence=evidence)
        judged = self
        if found.verdict.name == "PROVED" and self.kind is Kind.LOST:
            # Doubles took for on the axis what is proved to be off it.
            judged = _judged(self.branch, self.region, self.epsilon, distance=found.gap)
        if found.verdict.name == "PROVED" and judged.kind is not Kind.LOST:
            return replace(
                judged,
                gap=found.gap,
                rates=replace(judged.rates, normal=found.gap),
                conditions=tuple(_by_proof(condition, found, judged) for condition in judged.conditions),
                certificate=found,
                evidence=f"proved on {found.where}",
            )
        return replace(judged, certificate=found, evidence=f"{judged.evidence}; {found.reason}")

    @cached_property
    def sub_region(self) -> SubRegion | None:
        """The largest part of the region found, cut along one slow axis, over which the conditions hold.

        Cuts are tried at the losses, else where the tangential rate is too large, and judged by `classify`; None where
        there is neither, and when no part holds.
        """
        if self.losses:
            return largest_sub_region(self.branch, self.region, self.losses, judge=classify)
        if self.shortfall is None:
            return None
        return dominated(self.branch, self.region, self.shortfall, judge=classify)

    def eigenvalues(self, x, *, near=None) -> np.ndarray:
        """Eigenvalues of g_y at the branch's points over `x`: complex (m, n_fast), or (n_fast,) for one."""
        array, single = as_points(self.branch.system.x, x, what="x")
        y = self.branch.points(array, near=near)
        values = Sampler(self.branch).eigenvalues(np.hstack([array, y]))
        return values[0] if single else values

    def __repr__(self) -> str:
        shown = f">={at_least(self.gap)}" if self.is_proved else f"={self.gap:.6g}"
        return f"Hyperbolicity({self.kind}, gap{shown}, {self.evidence})"

    def __str__(self) -> str:
        newline = "\n"
        sampled = f" ({self.sampled_gap:.6g} at the samples)" if self.is_proved else ""
        lines = [f"{self.kind}, gap {self.shown_gap()} in fast time{sampled}; {self.evidence}"]
        lines += [f"  {condition}" for condition in self.conditions]
        lines += [f"  lost: {str(loss).replace(newline, newline + '        ')}" for loss in self.losses]
        lines += [f"  looked at: {loss.headline}" for loss in self.looked_at]
        if self.shortfall is not None:
            lines.append(f"  falls short: {self.shortfall}")
        lines += [f"  note: {note}" for note in self.notes]
        if self.certificate is not None:
            lines.append(f"  {str(self.certificate).replace(newline, newline + '  ')}")
        elif self.exclusion is not None and self.exclusion.is_complete and self.kind is not Kind.LOST:
            lines.append(f"  samples: {self.exclusion}")
        if self.sub_region is not None:
            lines.append(f"  holds: {self.sub_region}")
        return "\n".join(lines)


@np.errstate(all="ignore")
def classify(
    branch: Branch, *, region: Mapping[str, Interval], epsilon: float | None = None, prove: bool = False
) -> Hyperbolicity:
    """Where and how strongly `branch` is normally hyperbolic over `region`.

    `region` bounds every slow variable, and fast ones where a sheet of an implicit branch is meant; with
    `epsilon` the condition r >= 1 is decided at that value too. A loss is knowledge, not an error: the kind is
    then "lost", and `losses` name each, with its coefficients, what follows, and whether reduction may go on. With
    `prove` the verdict has a `certificate` beside it, what `certify` proves over the region.
    Raises `DeclarationError` for a region that is not one and `BranchError` when the branch has no real point in it.

    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -y}, fast={x: y - 2*x}, epsilon=eps)
    >>> classify(solve_critical(system).branches[0], region={"y": (0, 1)})
    Hyperbolicity(attracting, gap=2, sampled at 257 points)
    """
    check_noun(branch, Branch, verb="classify")
    epsilon = None if epsilon is None else check_epsilon(epsilon)
    prove = check_flag(prove, what="prove")
    system = branch.system
    box = check_region(region, [s.name for s in system.states], required=[s.name for s in system.x])
    verdict = _judged(branch, box, epsilon)
    return verdict.with_proof(epsilon=epsilon) if prove else verdict


def _judged(
    branch: Branch, box: Mapping[str, Interval], epsilon: float | None, *, distance: float = 0.0
) -> Hyperbolicity:
    """The verdict by samples and by what enclosures exclude between them, no eigenvalue being nearer to the imaginary
    axis than a proved `distance`.
    """
    system = branch.system
    sampler = Sampler(branch)
    samples = sampled(sampler, box)
    judged = judged_samples(sampler, box, samples, epsilon, distance=distance)
    exclusion = None
    if len(judged.kinds) == 1 and judged.may_touch and not samples.missing:
        # Doubles cannot tell an eigenvalue that vanishes from one that nearly does; enclosures of its sheet may.
        touched = [[loss.point[s.name] for s in system.states] for loss in judged.losses]
        exclusion = exclude(sampler, box, np.vstack([samples.z, touched]))
        if exclusion.distance:
            judged = judged_samples(sampler, box, samples, epsilon, distance=exclusion.distance)
        else:
            exclusion = None
    elif len(judged.kinds) == 1 and not judged.lost and not distance:
        exclusion = exclude(sampler, box, samples.z)
        if is_worse(sampler, exclusion, judged):
            samples = samples.with_more(sampler, exclusion)
            judged = judged_samples(sampler, box, samples, epsilon)
    z, kinds = samples.z, judged.kinds
    lost = judged.lost or len(kinds) != 1
    evidence, bound = f"sampled at {len(z)} points", ""
    if exclusion is not None and not lost:
        if not exclusion.is_complete:
            evidence += f"; {exclusion}"
        elif exclusion.by_discriminant and not exclusion.gap:
            bound = "between them no eigenvalue vanishes, and nothing bounds the gap"
        # Enclosures that bound the gap by less than this share of the sampled one leave room for one that samples
        # missed.
        elif exclusion.gap < 0.5 * judged.gap:
            bound = f"between them enclosures bound the gap by {at_least(exclusion.gap)} only"
    evidence = "; ".join(filter(None, (evidence, bound)))
    rates = NormalRates(judged.gap, sampler.tangential_rate(z))
    found = judged.found
    return Hyperbolicity(
        branch=branch,
        region=box,
        kind=Kind.LOST if lost else kind_of(int(kinds[0]), len(system.y)),
        gap=judged.gap,
        sampled_gap=judged.gap,
        rates=rates,
        losses=judged.losses,
        conditions=tuple(_conditions(sampler, z, samples.missing, judged, rates, epsilon, bound)),
        samples=len(z),
        evidence=evidence,
        looked_at=found.looked_at,
        notes=judged.notes,
        exclusion=exclusion,
        shortfall=None
        if epsilon is None or lost or rates.r(epsilon) >= 1.0
        else shortfall(sampler, z, box, gap=judged.gap, epsilon=epsilon),
        epsilon=epsilon,
    )


def _conditions(
    sampler: Sampler,
    z: np.ndarray,
    missing: int,
    judged: Judged,
    rates: NormalRates,
    epsilon: float | None,
    bound: str,
) -> Iterator[Condition]:
    kinds, losses = judged.kinds, judged.losses
    rough = (LossKind.NON_SMOOTH, LossKind.FIELD_POLE)
    non_smooth = sum(loss.kind in rough for loss in losses)
    missing += sum(loss.kind is LossKind.BRANCH_POLE for loss in losses)
    yield Condition(
        "smooth field",
        f"f and g depend smoothly on x, y and {sampler.branch.system.epsilon}",
        float(non_smooth),
        "switching surfaces and poles that the branch meets, 0 needed",
        non_smooth == 0,
    )
    total = len(z) + missing
    branch = "it" if sampler.branch.seed is None else "the sheet"
    yield Condition(
        "graph",
        "the branch is a graph over the whole region",
        missing / total,
        f"share of points of the region over which {branch} has no real point, 0 needed",
        missing == 0,
    )
    residual = sampler.residual(z) if len(z) else float("inf")
    # No point far from the origin is known to be nearer to the branch than its own rounding.
    rounding = sampler.rounding(z) if EQUILIBRIUM_TOLERANCE < residual < float("inf") else 0.0
    most = max(EQUILIBRIUM_TOLERANCE, rounding)
    yield Condition(
        "equilibria",
        "g(x, h_0(x), 0) = 0: the fast system has an equilibrium for every x",
        residual,
        f"largest residual, at most {most:.3g} needed",
        residual <= most,
    )
    yield Condition(
        HYPERBOLIC,
        "every eigenvalue of g_y(x, h_0(x), 0) is off the imaginary axis",
        rates.normal,
        "; ".join(filter(None, ("least |Re lambda| at the samples, above 0 needed", bound))),
        rates.normal > judged.found.zero,
    )
    yield Condition(
        "one type",
        "the number of unstable fast directions is the same everywhere",
        float(np.ptp(kinds)) if len(kinds) else 0.0,
        "difference between the most and the fewest unstable fast directions, 0 needed",
        len(kinds) <= 1,
    )
    variation = sampler.jacobian_variation(z)
    yield Condition(
        "smooth Jacobian",
        "g_y(x, h_0(x), 0) depends smoothly on x",
        variation,
        "largest derivative along the branch, finite needed",
        bool(np.isfinite(variation)),
    )
    if epsilon is not None:
        r = rates.r(epsilon)
        yield Condition(
            DOMINATES,
            f"normal against tangential rate at {sampler.branch.system.epsilon} = {epsilon:g}: "
            "the r of r-normal hyperbolicity",
            r,
            "at the samples, at least 1 needed for a C^1 manifold",
            r >= 1.0,
        )


def _by_proof(condition: Condition, found: Certificate, judged: Hyperbolicity) -> Condition:
    """The condition with its number as it is proved, where it is; r is not, without an epsilon of the proof's own."""
    if condition.name == HYPERBOLIC:
        needed, value = "least |Re lambda|, proved; above 0 needed", found.gap
    elif condition.name == DOMINATES and found.epsilon == judged.epsilon:
        needed, value = "proved; at least 1 needed for a C^1 manifold", found.rate_ratio
    elif condition.name == DOMINATES and judged.epsilon is not None and judged.rates.tangential:
        r = at_least(replace(judged.rates, normal=found.gap).r(judged.epsilon))
        needed = f"at the samples, {r} with the proved gap; at least 1 needed for a C^1 manifold"
        return replace(condition, requirement=needed)
    else:
        return condition
    return replace(condition, value=value, requirement=needed, holds=True, is_proved=True)
