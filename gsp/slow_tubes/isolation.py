"""Two tests about a tube |z_i| <= d_i around a slow manifold's series, over boxes of x and epsilon.

z is cut into blocks, each stable or unstable by its sign s_i; eps z' = Gamma = rho(x, epsilon) + B(x, z, epsilon) z.

Faces: the flow crosses every face strictly, into the tube where s_i = -1 and out of it where s_i = 1, if over all x

    lambda_min(Sym(s_i B_ii)) d_i - sum_(j != i) |B_ij| d_j - |rho_i| > 0 .

Cones: with W the Jacobian of (epsilon f, Gamma) and s = 1 where there are unstable blocks, s = -1 where stable ones,

    s (W^T Q + Q W) - tau Q > 0,  tau > 0,
    Q = |z_i|^2/L^2 over the blocks with s_i = s, less |x|^2, less |z_i|^2/(2 L^2) over the others,

so that Q of the difference of two orbits in the tube, once it is positive, grows at least as exp(tau t) for ever,
forwards (s = 1) or backwards (s = -1). No two orbits that stay in the tube do that, so they have Q <= 0: what stays
is the graph of a map of x with Lipschitz constant L, or 2 L where blocks of both signs are (by the halves in Q). The
form is linear in W, so that it is enough to test the boxes, over all of which Q is the same and the tube convex; tau
may differ from box to box. A collar, by which f is cut off towards the sides of the region, adds a matrix of norm at
most collar to D_x f and a factor between 0 and 1 to f; as the form is linear in that factor, 0 and 1 are tested.

Nothing is claimed of a comparison unless it is proved True.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from flint import arb

from gsp.proofs import balls
from gsp.proofs.covering import THIN
from gsp.proofs.search_progress import SearchProgress
from gsp.proofs.spectrum import least_eigenvalue
from gsp.proofs.tubes import Box, halved
from gsp.slow_tubes.adapted_basis import AdaptedBasis
from gsp.slow_tubes.invariance import Invariance
from gsp.slow_tubes.solved_flow import SolvedFlow

Widths = Sequence[float] | np.ndarray
# A part is not halved below this share of the region's side: what fails there fails.
NARROWEST = 2.0**-10


@dataclass(eq=False)
class Tally:
    """Boxes that were tried, of those that may be; `spent` when one test has used up all. Each box is `shown`."""

    most: int
    tried: int = 0
    spent: bool = False
    shown: SearchProgress = field(default_factory=SearchProgress)


@dataclass(eq=False)
class Isolation:
    """The tests for `invariance` in `basis` over `region`, the box of x, then epsilon."""

    invariance: Invariance | SolvedFlow
    basis: AdaptedBasis
    region: Box
    tally: Tally
    _residuals: dict[Box, list[arb]] = field(default_factory=dict)
    _slopes: dict[Box, list[arb]] = field(default_factory=dict)

    def faces(self, widths: Widths) -> bool:
        """Whether the tube of `widths`, one for each block, is proved isolating."""
        return _proved(
            self.region,
            lambda box: self._faces_of(box, widths),
            self.tally,
            self._steepest,
            lambda box: not self._faces_of(tuple((v, v) for v in map(_middle, box)), widths),
        )

    def cones(self, widths: Widths, slope: float, collar: float) -> bool:
        """Whether the cone conditions with L = `slope` are proved in the tube."""
        sides = [s for s in (-1, 1) if s in self.basis.signs]
        return _proved(
            self.region,
            lambda box: all(self._cone_of(box, widths, slope, collar, side) for side in sides),
            self.tally,
            self._steepest,
        )

    def side(self, axis: int, upper: bool, widths: Widths) -> int:
        """1 where the slow flow is proved to leave through a side of the region all over it, -1 to enter, else 0."""
        end = self.region[axis][1 if upper else 0]
        face = tuple((end, end) if k == axis else ends for k, ends in enumerate(self.region))

        def sign(box: Box) -> int:
            rate = self.invariance.rates(self._arguments(box, widths))[axis]
            return 1 if rate > 0 else (-1 if rate < 0 else 0)

        # The signs at the corners say which way to try, if any.
        ways = {sign(tuple((v, v) for v in corner)) for corner in itertools.product(*face)}
        # Boxes that decide a side of the region; what they do not decide is called mixed.
        if len(ways) == 1 and (way := ways.pop()) and _proved(face, lambda box: sign(box) == way, Tally(256)):
            return way if upper else -way
        return 0

    def rates(self, x: list[arb], widths: Widths) -> list[arb]:
        """f (slow,) over the part of the tube above the balls x, the last of them epsilon."""
        return self.invariance.rates([*x[:-1], *self._tube(widths), x[-1]])

    # -- boxes -------------------------------------------------------------------------------------

    def _steepest(self, box: Box) -> list[float]:
        """How much rho varies along each side of a box."""
        slopes = self._residual_slopes(box)
        n = len(box)
        return [
            (high - low) * max(balls.magnitude(slopes[i * n + k]) for i in range(self.invariance.m))
            for k, (low, high) in enumerate(box)
        ]

    def _tube(self, widths: Widths) -> list[arb]:
        z = [arb(0)] * self.invariance.m
        for block, width in zip(self.basis.blocks, widths):
            for i in block:
                z[i] = balls.hull(-width, width)
        return z

    def _arguments(self, box: Box, widths: Widths) -> list[arb]:
        *x, small = [balls.hull(low, high) for low, high in box]
        return [*x, *self._tube(widths), small]

    def _residual_slopes(self, box: Box) -> list[arb]:
        found = self._slopes.get(box)
        if found is None:
            found = self._slopes[box] = self.invariance.residual_slopes(
                [balls.hull(low, high) for low, high in box]
            )
        return found

    def _residual(self, box: Box) -> list[arb]:
        """rho over a box: its natural enclosure or the mean-value form, whichever is the smaller."""
        known = self._residuals.get(box)
        if known is not None:
            return known
        x = [balls.hull(low, high) for low, high in box]
        middle = [arb(_middle(ends)) for ends in box]
        natural = self.invariance.residual(x)
        n = len(box)
        if all(low == high for low, high in box):
            return natural
        centred = self.invariance.residual(middle)
        slopes = self._residual_slopes(box)
        for i in range(len(natural)):
            value = centred[i]
            for k in range(n):
                value = value + slopes[i * n + k] * (x[k] - middle[k])
            if value.abs_upper() < natural[i].abs_upper():
                natural[i] = value
        self._residuals[box] = natural
        return natural

    def _faces_of(self, box: Box, widths: Widths) -> bool:
        rho = self._residual(box)
        matrix = self.invariance.normal(self._arguments(box, widths))
        margins = self._margins(rho, matrix, widths)
        return all(margin > 0 for margin in margins)

    def _margins(self, rho: list[arb], matrix: list[arb], widths: Widths) -> list[arb]:
        m, margins = self.invariance.m, []
        for i, (block, sign) in enumerate(zip(self.basis.blocks, self.basis.signs)):
            margin = self._decay(matrix, block, sign) * arb(widths[i]) - norm([rho[k] for k in block])
            for j, other in enumerate(self.basis.blocks):
                if j != i:
                    margin = margin - norm([matrix[k * m + q] for k in block for q in other]) * arb(widths[j])
            margins.append(margin)
        return margins

    def _decay(self, matrix: list[arb], block: tuple[int, ...], sign: int) -> arb:
        """A ball whose numbers are at most lambda_min(Sym(s B_ii))."""
        m = self.invariance.m
        if len(block) == 1:
            return matrix[block[0] * (m + 1)] * sign
        form = [[(matrix[k * m + q] + matrix[q * m + k]) * sign / 2 for q in block] for k in block]
        return arb(least_eigenvalue(form))

    def _cone_of(self, box: Box, widths: Widths, slope: float, collar: float, side: int) -> bool:
        n, m, slow = self.invariance.n, self.invariance.m, self.invariance.slow
        arguments = self._arguments(box, widths)
        small = arguments[-1]
        z, length = arguments[n : n + m], arb(slope)
        rates, matrix, along, bends = self.invariance.linearisation(arguments)
        # z is measured in units of L, so that Q has the entries 1 and -1.
        slopes = [[along[i * n + k] for k in range(n)] for i in range(m)]
        for i in range(m):
            for k in range(n):
                for j in range(m):
                    slopes[i][k] = slopes[i][k] + bends[(i * m + j) * n + k] * z[j]
                slopes[i][k] = slopes[i][k] / length
        drift = [[small * rates[i * n + k] for k in range(n)] for i in range(slow)]
        drift += [[arb(0)] * n for _ in range(n - slow)]
        lift = [[small * rates[slow * n + i * m + j] * length for j in range(m)] for i in range(slow)]
        lift += [[arb(0)] * m for _ in range(n - slow)]
        normal = [[matrix[i * m + j] for j in range(m)] for i in range(m)]
        signs = [arb(-1)] * n + [arb(0)] * m
        decays = []
        for block, sign in zip(self.basis.blocks, self.basis.signs):
            for i in block:
                signs[n + i] = arb(1) if sign == side else arb(-0.5)
            if sign == side:
                decays.append(balls.below(self._decay(matrix, block, sign)))
        cut_off = 2.0 * collar * balls.exact(box[-1][1])
        # Between what the slow directions need and what the normal ones give; any tau > 0 that passes is a proof.
        needed = max(
            sum(
                balls.above(2 * side * e) if i == k else balls.magnitude(e + drift[k][i])
                for k, e in enumerate(row)
            )
            for i, row in enumerate(drift)
        )
        tau = 0.5 * (max(needed, 0.0) + balls.above(cut_off)) + min(decays)
        if not (tau > 0.0 and math.isfinite(tau)):
            return False
        zero_drift, zero_lift = [[arb(0)] * n for _ in range(n)], [[arb(0)] * m for _ in range(n)]
        versions = [(drift, lift)] + ([(zero_drift, zero_lift)] if collar > 0.0 else [])
        for across, up in versions:
            w = [[*across[i], *up[i]] for i in range(n)] + [[*slopes[i], *normal[i]] for i in range(m)]
            form = [
                [(w[j][i] * signs[j] + signs[i] * w[i][j]) * side for j in range(n + m)] for i in range(n + m)
            ]
            for i in range(n + m):
                form[i][i] = form[i][i] - arb(tau) * signs[i] - (cut_off if i < n else 0)
            if not least_eigenvalue(form) > 0.0:
                return False
        return True

    # -- proposals, by sampling --------------------------------------------------------------------

    def shape(self, points: Sequence[np.ndarray]) -> np.ndarray | None:
        """Widths (blocks,) of the least tube that passes the face test at `points` (n + 1,); None without one."""
        m, blocks = self.invariance.m, self.basis.blocks
        rows = []
        for point in points:
            box = tuple((float(v), float(v)) for v in point)
            rho = self._residual(box)
            matrix = self.invariance.normal(self._arguments(box, [0.0] * len(blocks)))
            decay = [
                balls.below(self._decay(matrix, block, sign)) for block, sign in zip(blocks, self.basis.signs)
            ]
            sizes = [balls.magnitude(norm([rho[k] for k in block])) for block in blocks]
            cross = [
                [
                    0.0 if i == j else balls.magnitude(norm([matrix[k * m + q] for k in a for q in b]))
                    for j, b in enumerate(blocks)
                ]
                for i, a in enumerate(blocks)
            ]
            if not all(value > 0.0 for value in decay) or not np.isfinite([*sizes, *np.ravel(cross)]).all():
                return None
            rows.append((np.array(decay), np.array(sizes), np.array(cross)))
        widths = np.zeros(len(blocks))
        # The least fixed point, from below; it is reached geometrically where it exists.
        for _ in range(50):
            widths = np.max([(sizes + cross @ widths) / decay for decay, sizes, cross in rows], axis=0)
        largest = widths.max()
        if not np.isfinite(largest) or largest > 1e100:
            return None
        return np.maximum(widths, 1e-3 * largest) if largest > 0.0 else np.full(len(blocks), 2.0**-20)

    def steepness(self, points: Sequence[np.ndarray]) -> float:
        """The largest slope of the slaved z at `points`: |D_x rho| over the decay."""
        largest = 0.0
        for point in points:
            at = [arb(float(v)) for v in point]
            slopes = self.invariance.residual_slopes(at)
            by_x = [slope for i, slope in enumerate(slopes) if (i + 1) % len(at)]
            largest = max(largest, balls.magnitude(norm(by_x)) / self.decay(point))
        return largest

    def pull(self, points: Sequence[np.ndarray]) -> float:
        """The largest part of the slow rates that is due to z at `points`: |D_z f| over the decay."""
        largest = 0.0
        for point in points:
            at = [arb(float(v)) for v in point]
            rates = self.invariance.linearisation([*at[:-1], *([arb(0)] * self.invariance.m), at[-1]])[0]
            by_z = rates[self.invariance.slow * self.invariance.n :]
            largest = max(largest, balls.magnitude(norm(by_z)) / self.decay(point))
        return largest

    def decay(self, point: np.ndarray) -> float:
        """The least rate of a fast direction in the middle of the tube at a point (n + 1,)."""
        at = [arb(float(v)) for v in point]
        matrix = self.invariance.normal([*at[:-1], *([arb(0)] * self.invariance.m), at[-1]])
        return min(
            balls.below(self._decay(matrix, block, sign))
            for block, sign in zip(self.basis.blocks, self.basis.signs)
        )


def norm(entries: Sequence[arb]) -> arb:
    """A ball whose upper end bounds the Euclidean norm of every vector (or Frobenius' of a matrix) with these
    entries.
    """
    if len(entries) == 1:
        return entries[0].abs_upper()
    return sum((balls.power(entry.abs_upper(), 2) for entry in entries), balls.ZERO).sqrt()


def _proved(
    region: Box,
    holds: Callable[[Box], bool],
    tally: Tally,
    variation: Callable[[Box], list[float]] | None = None,
    is_hopeless: Callable[[Box], bool] | None = None,
) -> bool:
    """Whether `holds` is True on parts that fill the region.

    A part is cut across its largest `variation`, or across its longest side where none is known, unless it is known to
    be hopeless. All parts of one generation come before the next: what the budget does not reach is known by their
    number.
    """
    # A side of a few roundings is a point: a decimal between doubles. Nothing is gained by cutting it.
    sides = [
        high - low if high - low > THIN * math.ulp(max(abs(low), abs(high))) else 0.0 for low, high in region
    ]
    generation, left = [region], tally.most
    while generation:
        if len(generation) > left:
            tally.spent = True
            return False
        left -= len(generation)
        following: list[Box] = []
        for box in generation:
            tally.tried += 1
            tally.shown.looked()
            if holds(box):
                continue
            if is_hopeless is not None and is_hopeless(box):
                return False
            halves = _halves(box, sides, variation)
            if halves is None:
                return False
            following += halves
        generation = following
    return True


def _middle(ends: tuple[float, float]) -> float:
    low, high = ends
    return low + 0.5 * (high - low)


def _halves(
    box: Box, sides: list[float], variation: Callable[[Box], list[float]] | None
) -> tuple[Box, Box] | None:
    """The box cut in two; None where it is as narrow as may be."""
    shares = [(high - low) / side if side > 0.0 else 0.0 for (low, high), side in zip(box, sides)]
    if max(shares) < NARROWEST:
        return None
    axis = max(range(len(box)), key=shares.__getitem__)
    if variation is not None:
        # No side is cut to a smaller share than that of the longest one over this.
        smear = [v if share >= max(shares) / 64.0 else 0.0 for v, share in zip(variation(box), shares)]
        if 0.0 < max(smear) < math.inf:
            axis = max(range(len(box)), key=smear.__getitem__)
    low, high = box[axis]
    return halved(box, axis) if low < _middle(box[axis]) < high else None
