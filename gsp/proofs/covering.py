"""A box covered by tubes that hold one smooth branch, with the spectrum of its fast Jacobian.

The box is halved until every part has its tube and its spectrum. The parts are the leaves of a binary tree, and each
pair of halves is glued: at a point of their common face a small tube is proved that lies in the tubes of both
neighbours there. Then the whole tree holds one smooth graph. By induction each half does; on the common face, which
is connected, the set of points where both graphs agree is closed, it is open since the equations have one zero near a
regular one, and it is not empty. Without gluing a proof may change branches from part to part: behind a fold Newton's
method finds another branch and proves it.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from gsp.proofs import balls
from gsp.proofs.equations import EnclosedEquations
from gsp.proofs.spectrum import Spectrum, spectrum_of
from gsp.proofs.tubes import FIRST_ROOM, Box, RootTube, enclose, halved, middle_of

# A side this many units in the last place wide is a point: nothing is gained by cutting it.
THIN = 8
# A doubling of the budget is worth another when it decided so much of what was left.
WORTH = 0.25


@dataclass(frozen=True, eq=False)
class CoveredPart:
    """A part of the region with its tube and the spectrum over it, where that was asked for."""

    tube: RootTube
    spectrum: Spectrum | None


@dataclass(eq=False)
class Part:
    """A node of the tree: a `box`, and either its `piece`, or its two `halves` cut at `at` along `axis` and their
    `glue`.

    A part with neither is undecided; `suspect` is then a place (n,) where the branch seems to end or to change its
    type.
    """

    box: Box
    near: np.ndarray
    piece: CoveredPart | None = None
    suspect: np.ndarray | None = None
    axis: int = -1
    at: float = 0.0
    halves: tuple[Part, Part] | None = None
    glue: RootTube | None = None

    def leaves(self) -> Iterator[Part]:
        """The parts that are not cut."""
        return (part for part in self.nodes() if part.halves is None)

    def nodes(self) -> Iterator[Part]:
        """Every part: this one, then the lower half's and the upper half's."""
        stack: list[Part] = [self]
        while stack:
            part = stack.pop()
            yield part
            if part.halves is not None:
                stack += reversed(part.halves)

    def holding(self, x: np.ndarray, *, upper: bool) -> Part:
        """The leaf that holds a point; on a cut the one above or below it."""
        part = self
        while part.halves is not None:
            beyond = x[part.axis] > part.at or (upper and x[part.axis] == part.at)
            part = part.halves[1 if beyond else 0]
        return part


@dataclass(eq=False)
class Covering:
    """The tree over a region, and what it cost."""

    root: Part
    tried: int = 0
    interrupted: bool = False
    exhausted: bool = False

    @property
    def pieces(self) -> list[CoveredPart]:
        """What is proved."""
        return [part.piece for part in self.root.leaves() if part.piece is not None]

    @property
    def undecided(self) -> list[Box]:
        """The boxes that are left."""
        return [part.box for part in self.root.leaves() if part.piece is None]

    @property
    def undecided_volume(self) -> float:
        """Their share of the region's volume."""
        return float(
            sum(share_of(part.box, self.root.box) for part in self.root.leaves() if part.piece is None)
        )

    @property
    def gap(self) -> float:
        """The least proved |Re lambda|; nan where nothing is proved."""
        return min((p.spectrum.gap for p in self.pieces if p.spectrum is not None), default=float("nan"))


def share_of(box: Box, whole: Box) -> float:
    """The volume of a box as a share of another's, over the sides that have a width."""
    share = 1.0
    for (low, high), (first, last) in zip(box, whole):
        if last > first:
            share *= (high - low) / (last - first)
    return share


def cover(
    equations: EnclosedEquations,
    region: Box,
    near: np.ndarray,
    *,
    most_boxes: int,
    at_most: int | None = None,
    spectral: bool = True,
    least: float = 0.0,
    progress: Callable[[float], object] | None = None,
) -> Covering:
    """Cover `region` from its middle, where the branch is near `near` (m,); not `spectral`, by tubes alone.

    The widest part is looked at first, so that whenever the budget of `most_boxes` ends, or Ctrl-C comes, what is
    left is spread thinly. Sides of at most a share `least` of the region's are not cut. With `at_most` the budget is
    doubled up to it while that decides a `WORTH` of what was left.
    """
    covering = Covering(Part(region, np.asarray(near, dtype=float)))
    order = itertools.count()
    waiting = [(-1.0, next(order), covering.root)]
    decided, left, budget = 0.0, 1.0, most_boxes
    try:
        while waiting:
            if covering.tried >= budget:
                longest = at_most or most_boxes
                if budget >= longest or 1.0 - decided > (1.0 - WORTH) * left:
                    covering.exhausted = True
                    break
                left, budget = 1.0 - decided, min(2 * budget, longest)
            share, _, part = heapq.heappop(waiting)
            covering.tried += 1
            tube = enclose(equations, part.box, part.near)
            spectrum = None if tube is None or not spectral else spectrum_at(equations, tube)
            if tube is not None and (spectrum is not None or not spectral):
                part.piece = CoveredPart(tube, spectrum)
                decided -= share
                if progress is not None:
                    progress(min(decided, 1.0))
                continue
            centre = part.near if tube is None else tube.centre
            axis, part.suspect = _axis(equations, part.box, region, centre, least)
            if axis is None:
                continue
            halves = _halves(equations, part, axis, centre)
            for half in halves:
                heapq.heappush(waiting, (-share_of(half.box, region), next(order), half))
    except KeyboardInterrupt:
        covering.interrupted = True
    return covering


def sharpen(equations: EnclosedEquations, covering: Covering, *, most_boxes: int, gap: float = 0.0) -> None:
    """Cut the part whose gap is proved to be least until that is within a factor of two of the gap in its middle.

    Parts are cut until the branch is proved in each, and wide balls say little of eigenvalues. With `gap` it is cut
    until every gap is proved to be that large, unless one is not. It ends when `most_boxes` are tried, or as many cuts
    again do not bring it nearer by a `WORTH`. What was glued has to be glued again.
    """
    order = itertools.count()
    waiting = [
        (part.piece.spectrum.gap, next(order), part)
        for part in covering.root.leaves()
        if part.piece is not None and part.piece.spectrum is not None
    ]
    heapq.heapify(waiting)
    budget, short = covering.tried + len(waiting), np.inf
    while waiting and covering.tried < most_boxes:
        proved, _, part = heapq.heappop(waiting)
        seen = _middle_gap(equations, part)
        # What is larger by less than a hundredth would take boxes without end.
        wanted = gap if proved < gap < seen / 1.01 else 0.5 * seen
        if not proved < wanted:
            return
        if covering.tried >= budget:
            if wanted - proved > (1.0 - WORTH) * short:
                return
            short, budget = wanted - proved, budget + len(waiting)
        covering.tried += 1
        if not refine(equations, part):
            return
        assert part.halves is not None
        for half in part.halves:
            if half.piece is not None and half.piece.spectrum is not None:
                heapq.heappush(waiting, (half.piece.spectrum.gap, next(order), half))


def _middle_gap(equations: EnclosedEquations, part: Part) -> float:
    """The least |Re lambda| in the middle of a part, in doubles."""
    assert part.piece is not None
    tube = part.piece.tube
    matrix = equations.nearby(tube.middle[None], tube.centre[None])[0][0]
    return float(np.abs(np.linalg.eigvals(matrix).real).min())


def refine(equations: EnclosedEquations, part: Part, *, margin: float = FIRST_ROOM) -> bool:
    """Cut a part that is proved across its most telling side and prove both halves, in tubes with `margin`; whether
    that went well.
    """
    assert part.piece is not None
    near = part.piece.tube.centre
    axis, _ = _axis(equations, part.box, part.box, near)
    if axis is None:
        return False
    trial = Part(part.box, near)
    for half in _halves(equations, trial, axis, near):
        tube = enclose(equations, half.box, near, margin=margin)
        spectrum = None if tube is None else spectrum_at(equations, tube)
        if tube is None or spectrum is None:
            return False
        half.piece = CoveredPart(tube, spectrum)
    part.axis, part.at, part.piece, part.halves = trial.axis, trial.at, None, trial.halves
    return True


def spectrum_at(equations: EnclosedEquations, tube: RootTube) -> Spectrum | None:
    """The spectrum over a tube, where it is proved."""
    return spectrum_of(tube.derivative, equations.nearby(tube.middle[None], tube.centre[None])[0][0])


def _halves(equations: EnclosedEquations, part: Part, axis: int, near: np.ndarray) -> tuple[Part, Part]:
    """Both halves, each with the branch followed to its middle, or `near` where it cannot be."""
    below, above = (Part(half, _followed(equations, part.box, half, near)) for half in halved(part.box, axis))
    part.axis, part.at, part.halves = axis, above.box[axis][0], (below, above)
    return part.halves


@np.errstate(all="ignore")
def _followed(equations: EnclosedEquations, whole: Box, half: Box, near: np.ndarray) -> np.ndarray:
    """The root from the middle of `whole` at that of `half`: Newton's method from afar may come to another one."""
    found = equations.followed(middle_of(whole), middle_of(half), near)
    return found[1] if found is not None and found[0] == 1.0 else near


# On the way to a pole values overflow.
@np.errstate(all="ignore")
def _axis(
    equations: EnclosedEquations, box: Box, region: Box, near: np.ndarray, least: float = 0.0
) -> tuple[int | None, np.ndarray | None]:
    """Where to cut: across which side the Jacobian varies most along the branch; None where cutting is over.

    The variation is seen through the inverse in the middle, as Krawczyk's condition sees it. It is that of doubles: a
    poor choice costs boxes, never truth. With it a place (n,) where a loss is in sight, or None.
    """
    middle = middle_of(box)
    width = np.array([high - low for low, high in box])
    whole = np.array([(high - low) or 1.0 for low, high in region])
    thin = [max(THIN * np.spacing(np.abs(side).max()), least * all_) for side, all_ in zip(box, whole)]
    sides = [i for i in range(len(box)) if width[i] > thin[i]]
    if not sides:
        return None, middle
    widest = max(sides, key=lambda i: width[i] / whole[i])
    # A part with a loss in sight is not cut below this share of a side: its undecided rest is a surface of
    # losses, and every further halving doubles or quadruples the parts (certificates measured: 14 times as many
    # for two halvings).
    small = width[widest] / whole[widest] <= 2.0**-7
    root = equations.root(middle, near)
    seen = None if root is None else _variation(equations, middle, root, width)
    if root is None or seen is None:
        return (None if small else widest), middle
    slope, *variations = seen
    suspect = _suspect(equations, box, root, slope) if small else None
    if suspect is not None:
        return None, suspect
    # Where nothing varies the widest side is cut.
    telling = next((each for each in variations if each.max() > 1e-12), None)
    axis = widest if telling is None else int(np.argmax(telling))
    # Where the side that tells is thin, no cut of another one decides anything.
    return (axis, None) if axis in sides else (None, middle)


def _variation(
    equations: EnclosedEquations, middle: np.ndarray, root: np.ndarray, width: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """The branch's slope (m, n), how much D_y F varies across each side (n,), and how much D_x F does there; None
    where singular.
    """
    by_y, by_x = (part[0] for part in equations.nearby(middle[None], root[None]))
    steps = 0.5 * np.diag(width)
    ends = np.concatenate([steps, -steps])
    try:
        slope = -np.linalg.solve(by_y, by_x)
        x, y = middle + ends, root + ends @ slope.T
        matrices, slopes = equations.nearby(x, y)
        variation = _change(by_y, by_y, matrices)
        # What an end that is a branch point leaves infinite varies most.
        bending = np.nan_to_num(_change(by_y, by_x * width, slopes * width), nan=np.inf)
    except np.linalg.LinAlgError:
        return None
    return (slope, variation, bending) if np.isfinite(variation).all() else None


def _change(by_y: np.ndarray, middle: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """How far matrices at both ends of each side (2 k, m, any) are from one another and from the `middle`'s, seen
    through the inverse of `by_y`: (k,).
    """
    low, high = ends[: len(ends) // 2], ends[len(ends) // 2 :]
    # About a symmetric middle both ends have the same matrix, and yet it varies.
    change = np.linalg.solve(by_y, np.concatenate([low - high, low + high - 2.0 * middle]))
    return np.abs(change).sum(axis=2).max(axis=1).reshape(2, -1).max(axis=0)


def _suspect(equations: EnclosedEquations, box: Box, root: np.ndarray, slope: np.ndarray) -> np.ndarray | None:
    """The middle where it has no type, or a corner where the branch seems to have ended or to be of another one: by
    doubles.
    """
    middle = middle_of(box)
    count = unstable_near(equations, middle, root)
    if count < 0:
        return middle
    # Corners of a box that are looked at.
    for corner in itertools.islice(itertools.product(*box), 64):
        x = np.array(corner)
        y = equations.root(x, root + slope @ (x - middle))
        if y is None or unstable_near(equations, x, y) != count:
            return x
    return None


def unstable_near(equations: EnclosedEquations, x: np.ndarray, y: np.ndarray) -> int:
    """The number of unstable eigenvalues at a point, in doubles; -1 where it has no type, as one is on the axis."""
    matrix = equations.nearby(x[None], y[None])[0][0]
    if not np.isfinite(matrix).all():
        return -1
    real = np.linalg.eigvals(matrix).real
    return int((real > 0.0).sum()) if (real != 0.0).all() else -1


def glue(equations: EnclosedEquations, covering: Covering) -> list[Box]:
    """Glue both halves of every cut; the common faces (as boxes) where that was not proved.

    Called on a covering without undecided parts.
    """
    failed: list[Box] = []
    stack = [covering.root]
    while stack:
        part = stack.pop()
        if part.halves is None:
            continue
        stack += part.halves
        face = tuple((part.at, part.at) if i == part.axis else side for i, side in enumerate(part.box))
        x = middle_of(face)
        below, above = (half.holding(x, upper=bool(k)) for k, half in enumerate(part.halves))
        part.glue = _common(equations, x, below, above)
        if part.glue is None:
            failed.append(face)
    return failed


def _common(equations: EnclosedEquations, x: np.ndarray, below: Part, above: Part) -> RootTube | None:
    """A small tube over the point x that lies in the tubes of both parts."""
    if below.piece is None or above.piece is None:
        return None
    first, second = below.piece.tube, above.piece.tube
    near = first.centre + first.slope @ (x - first.middle)
    point = tuple((float(v), float(v)) for v in x)
    found = enclose(equations, point, near)
    if found is None:
        return None
    over = [balls.exact(float(v)) for v in x]
    values = found.over(over)
    return found if first.holds(over, values) and second.holds(over, values) else None
