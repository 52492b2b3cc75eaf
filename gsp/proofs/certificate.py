"""`certify`: normal hyperbolicity over a box, proved, refuted or left undecided."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from decimal import Decimal
from enum import StrEnum
from fractions import Fraction
from pathlib import Path

import flint
import numpy as np
import sympy as sp

from gsp.algebra.laurent import laurent
from gsp.critical.branch import Branch
from gsp.errors import BranchError, DeclarationError
from gsp.proofs import balls
from gsp.proofs.covering import Covering, cover, glue
from gsp.proofs.equations import Equations
from gsp.proofs.refutation import Witness, refute
from gsp.proofs.tangential import tangential_rate
from gsp.proofs.tubes import Box, enclose, middle_of
from gsp.systems.flow import check_epsilon
from gsp.systems.region import check_region

# Boxes that are tried unless told otherwise: seconds.
MOST_BOXES = 20_000
# Places from which the branch is looked for, and undecided boxes towards which a witness is.
STARTS, SUSPECTS = 64, 8


class Verdict(StrEnum):
    """What a certificate says."""

    PROVED = "proved"
    REFUTED = "refuted"
    UNDECIDED = "undecided"


@dataclass(frozen=True, eq=False, repr=False)
class Certificate:
    """What is proved about `branch` over `region`, intervals by name (slow variables, then parameters).

    - PROVED: over the whole region the branch is one smooth graph through `through`, and every matrix D_y g on it has
      `stable` eigenvalues left and `unstable` ones right of the imaginary axis, all at least `gap` from it (fast
      time). `tangential` bounds the growth and decay along the slow flow (slow time; infinite where no bound was
      found), and with `epsilon` the `rate_ratio` gap/(epsilon tangential), at least 1, is proved too.
    - REFUTED: it is not, for the `witness`.
    - UNDECIDED: neither. `undecided` are the boxes that are left, `undecided_volume` their share of the region's
      volume; over the others all of it holds, each by itself. `reason` is one sentence.

    `tried` boxes were looked at, and `boxes` hold what is proved.
    """

    branch: Branch
    region: Mapping[str, tuple[float, float]]
    through: Mapping[str, float]
    verdict: Verdict
    reason: str
    gap: float
    stable: int
    unstable: int
    tangential: float
    epsilon: float | None
    witness: Witness | None
    undecided: tuple[Box, ...]
    undecided_volume: float
    boxes: tuple[Box, ...]
    tried: int
    _equations: Equations
    _covering: Covering

    @property
    def rate_ratio(self) -> float:
        """The proved lower bound of r = gap/(epsilon tangential); nan without an epsilon."""
        if self.epsilon is None:
            return math.nan
        return self.gap / (self.epsilon * self.tangential) if self.tangential > 0.0 else math.inf

    @property
    def kind(self) -> str:
        """ "attracting", "repelling" or "saddle"; empty where nothing is proved."""
        if not self.stable + self.unstable:
            return ""
        if not self.unstable:
            return "attracting"
        return "saddle" if self.stable else "repelling"

    def save(self, path: str | Path) -> None:
        """Write the proof as JSON, which `gsp verify` checks; raises `GspError` unless the verdict is PROVED."""
        from gsp.proofs.proof_file import write

        write(self, Path(path))

    def __repr__(self) -> str:
        return f"Certificate({self.verdict.name}, {self.reason})"

    def __str__(self) -> str:
        box = ", ".join(f"{name} in [{low:g}, {high:g}]" for name, (low, high) in self.region.items())
        lines = [f"{self.verdict.value} on {box}", f"  {self.reason}"]
        if self.verdict is Verdict.PROVED:
            lines.append(
                f"  {self.kind}, gap at least {self.gap:.6g} in fast time; {len(self.boxes)} boxes, glued"
            )
            if math.isfinite(self.tangential):
                lines.append(f"  rate along the slow flow at most {self.tangential:.6g}")
            if self.epsilon is not None:
                lines.append(
                    f"  normal against tangential rate at epsilon = {self.epsilon:g}: at least {self.rate_ratio:.6g}"
                )
        if self.witness is not None:
            lines.append(f"  witness: {self.witness.statement}")
        if self.verdict is Verdict.UNDECIDED:
            lines.append(
                f"  {len(self.boxes)} boxes proved, {len(self.undecided)} left, "
                f"{self.undecided_volume:.3g} of the volume; {self.tried} tried"
            )
        return "\n".join(lines)


def certify(
    branch: Branch,
    *,
    region: Mapping[str, object],
    epsilon: float | None = None,
    most_boxes: int = MOST_BOXES,
    progress: Callable[[float], object] | None = None,
) -> Certificate:
    """Prove or refute in ball arithmetic that `branch` is normally hyperbolic over `region`.

    `region` gives every slow variable an interval, and parameters too, which then stand for all their values; other
    parameters keep the values of the system. Bounds on fast variables choose a sheet. Ends that are no doubles, such
    as Fraction(1, 3), are rounded outwards. With `epsilon` the condition of r-normal hyperbolicity is asked for as
    well. Ctrl-C returns what is proved by then.

    The method is that of `tubes`, `spectrum`, `covering` and `refutation`. Raises `DeclarationError` for a region
    that is not one, `BranchError` when the branch has no point in it, `UnsupportedFunctionError` for a function
    without an enclosure.

    >>> y, x, eps = sp.symbols("y x epsilon")
    >>> system = SlowFastSystem(slow={y: -y}, fast={x: y - 2*x}, epsilon=eps)
    >>> certify(solve_critical(system).branches[0], region={"y": (0, 1)}).verdict.name
    'PROVED'
    """
    if not isinstance(branch, Branch):
        raise DeclarationError(
            f"certify takes a Branch. Got {type(branch).__name__}. Use solve_critical(system).branches."
        )
    if isinstance(most_boxes, bool) or not isinstance(most_boxes, int) or most_boxes < 1:
        raise DeclarationError(f"most_boxes is a positive integer. Got {most_boxes!r}.")
    small = None if epsilon is None else check_epsilon(epsilon)
    system = branch.system
    parameters = [p.name for p in system.parameters]
    checked = check_region(
        region, [*(s.name for s in system.states), *parameters], required=[s.name for s in system.x]
    )
    given = {(k.name if isinstance(k, sp.Symbol) else k): v for k, v in region.items()}
    names = [s.name for s in system.x] + [p for p in parameters if p in checked]
    box: Box = tuple(_outward(given[name], checked[name]) for name in names)
    fast = {s.name: checked[s.name] for s in system.y if s.name in checked}
    with flint.ctx.workprec(balls.PRECISION):
        equations, slow = _equations(branch, names)
        start = _start(branch, equations, box, fast)
        covering = _covered(equations, box, start, most_boxes, progress)
        return _judged(branch, equations, slow, covering, dict(zip(names, box)), start, small)


def _outward(given: object, rounded: tuple[float, float]) -> tuple[float, float]:
    low, high = (_fraction(end) for end in tuple(given))  # type: ignore[arg-type]
    first, last = rounded
    if low is not None and Fraction(first) > low:
        first = math.nextafter(first, -math.inf)
    if high is not None and Fraction(last) < high:
        last = math.nextafter(last, math.inf)
    return first, last


def _fraction(value: object) -> Fraction | None:
    if isinstance(value, (int, Fraction, Decimal)):
        return Fraction(value)
    if isinstance(value, sp.Rational):
        return Fraction(int(value.p), int(value.q))
    return None


def _equations(branch: Branch, names: list[str]) -> tuple[Equations, list[sp.Expr]]:
    """g = 0 and the slow rates f, on epsilon = 0, over the symbols of the intervals."""
    system = branch.system
    x = [*system.x, *(p for p in system.parameters if p.name in names)]
    values = {p: _exact(v) for p, v in system.parameters.items() if p not in x}
    zero = sp.Integer(0)
    g, f = (
        [laurent(e, system.epsilon, order=0).get(0, zero).xreplace(values) for e in rates]
        for rates in (system.g, system.f)
    )
    return Equations(x, system.y, g), f


def _exact(value: object) -> sp.Expr:
    number = sp.sympify(value, strict=True)
    return sp.Rational(number) if number.is_Float else number


def _start(
    branch: Branch, equations: Equations, box: Box, fast: Mapping[str, tuple[float, float]]
) -> tuple[np.ndarray, np.ndarray]:
    """A point (x, y) of the branch in the box, as near the middle as it is found, by doubles."""
    from scipy.stats import qmc

    low, high = np.array(box).T
    own = len(branch.system.x)
    defaults = [float(branch.system.parameters[p]) for p in equations.x[own:]]
    unit = qmc.Halton(d=len(box), scramble=False).random(STARTS)
    unit = unit[np.argsort(np.abs(unit - 0.5).max(axis=1), kind="stable")]
    reason: BranchError | None = None
    for x in [middle_of(box), *(low + unit * (high - low))]:
        try:
            y = _point(branch, x[:own], fast)
        except BranchError as error:
            reason = reason or error
            continue
        if y is None:
            continue
        # The branch is known at the system's own parameter values; from there it is followed to those of the box.
        found = equations.followed(np.concatenate([x[:own], defaults]), x, y)
        if found is not None and found[0] == 1.0:
            return x, found[1]
    raise reason or BranchError(
        f"the branch {branch} has no real point that was found in the region. Move the region, or take another branch."
    )


def _point(branch: Branch, x: np.ndarray, fast: Mapping[str, tuple[float, float]]) -> np.ndarray | None:
    if branch.seed is not None or not fast:
        y = branch.points(x[None])[0]
    else:
        roots = branch.roots(x[None], bounds=fast)
        if len(roots) > 1:
            raise BranchError(
                f"the branch {branch} has {len(roots)} sheets within the bounds on {', '.join(fast)}. "
                "Fix one with branch.through({...}), or tighten the bounds."
            )
        if not len(roots):
            return None
        y = roots[0]
    names = [s.name for s in branch.system.y]
    inside = all(fast[n][0] <= v <= fast[n][1] for n, v in zip(names, y) if n in fast)
    return y if inside and np.isfinite(y).all() else None


def _covered(
    equations: Equations,
    box: Box,
    start: tuple[np.ndarray, np.ndarray],
    most_boxes: int,
    progress: Callable[[float], object] | None,
) -> Covering:
    middle = middle_of(box)
    reached = equations.followed(start[0], middle, start[1])
    near = start[1] if reached is None else reached[1]
    return cover(equations, box, near, most_boxes=most_boxes, progress=progress)


def _judged(
    branch: Branch,
    equations: Equations,
    slow: list[sp.Expr],
    covering: Covering,
    region: dict[str, tuple[float, float]],
    start: tuple[np.ndarray, np.ndarray],
    epsilon: float | None,
) -> Certificate:
    pieces = covering.pieces
    counts = {piece.spectrum.counts for piece in pieces if piece.spectrum is not None}
    names = [s.name for s in equations.arguments]
    left = covering.undecided
    certificate = Certificate(
        branch=branch,
        region=region,
        through=dict(zip(names, np.concatenate(start).tolist())),
        verdict=Verdict.UNDECIDED,
        reason="",
        gap=covering.gap,
        stable=0,
        unstable=0,
        tangential=math.inf,
        epsilon=epsilon,
        witness=None,
        undecided=tuple(left),
        undecided_volume=covering.undecided_volume,
        boxes=tuple(piece.tube.box for piece in pieces),
        tried=covering.tried,
        _equations=equations,
        _covering=covering,
    )
    if covering.interrupted:
        return replace(certificate, reason="interrupted; what was proved by then is kept")
    failed = [] if left else glue(equations, covering)
    if not left and not failed and len(counts) == 1 and _is_on(equations, covering, start):
        (stable, unstable) = counts.pop()
        proved = replace(
            certificate,
            verdict=Verdict.PROVED,
            reason="one smooth branch, normally hyperbolic throughout",
            stable=stable,
            unstable=unstable,
            tangential=tangential_rate(equations, slow, pieces),
        )
        if epsilon is not None and not proved.rate_ratio >= 1.0:
            return replace(
                proved,
                verdict=Verdict.UNDECIDED,
                reason=f"normally hyperbolic throughout, but r >= 1 at epsilon = {epsilon:g} is not proved: "
                f"only r >= {proved.rate_ratio:.3g}",
            )
        return proved
    graph = branch.graph
    witness = refute(
        equations,
        tuple(region.values()),
        start,
        _suspects(covering, failed, start[0]),
        graph=None
        if graph is None
        else tuple(
            sp.sympify(graph[y], strict=True).xreplace(
                {p: _exact(v) for p, v in branch.system.parameters.items() if p not in equations.x}
            )
            for y in equations.y
        ),
    )
    if witness is not None:
        return replace(
            certificate, verdict=Verdict.REFUTED, reason="normal hyperbolicity is lost", witness=witness
        )
    return replace(certificate, reason=_why(covering, failed))


def _is_on(equations: Equations, covering: Covering, start: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether the point that the branch was known at is on what was proved."""
    x, y = start
    piece = covering.root.holding(x, upper=False).piece
    point = enclose(equations, tuple((float(v), float(v)) for v in x), y)
    if piece is None or point is None:
        return False
    at = [balls.exact(float(v)) for v in x]
    return piece.tube.holds(at, point.over(at))


def _suspects(covering: Covering, failed: list[Box], start: np.ndarray) -> list[np.ndarray]:
    """Places where the branch may be lost: of the undecided parts and of faces that are not glued, the furthest
    first.
    """
    found = [part.suspect for part in covering.root.leaves() if part.piece is None and part.suspect is not None]
    found += [middle_of(face) for face in failed]
    found += [middle_of(part.box) for part in covering.root.leaves() if part.piece is None]
    if failed:
        found += [np.array(corner) for corner in np.array(covering.root.box).T]
    found.sort(key=lambda x: -float(np.abs(x - start).max()))
    step = max(1, len(found) // SUSPECTS)
    return found[::step][:SUSPECTS]


def _why(covering: Covering, failed: list[Box]) -> str:
    if covering.exhausted:
        return f"the budget of {covering.tried} boxes is spent"
    if failed:
        return f"{len(failed)} common faces of boxes are not glued: the boxes may hold different branches"
    return "the boxes that are left hold a loss, or come too near one to be told"
