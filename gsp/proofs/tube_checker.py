"""Check a proof about a slow manifold: whole numbers, a parser, derivatives and polynomials of its own.

The file holds a system x' = f, epsilon y' = g, a series h_0, ..., h_n, a basis P(x), and Gamma(x, z, epsilon) with
which, y being h_0 + ... + epsilon^n h_n + epsilon^(n+1) P z, it claims that epsilon z' = Gamma. Nothing is believed:

- the identity epsilon^(n+1) P Gamma = g - epsilon D_x y f is checked between rational functions, exactly;
- f, g, y and Gamma are defined and P is regular all over the tube, by enclosures over boxes;
- the faces of the tube and the cones in it, over boxes of x and epsilon that are cut anew (theorems A and C of
  docs/slow-tubes.md; the notation is that of this page);
- that |y_i - h_i| is at most what is claimed, and what the slow flow does at the sides;
- that the manifold is unique, where that is claimed: backward solutions stay over the region where all fast directions
  are stable and the slow flow leaves through every side, forward ones where all are unstable and it enters;
- else that the slow flow can be cut off in the collar, and that the collar leaves something of the region.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from functools import partial
from typing import Any

from gsp.proofs import interval_matrices as im
from gsp.proofs import intervals as ia
from gsp.proofs import untrusted
from gsp.proofs.checked_tube import CheckedTube
from gsp.proofs.intervals import Interval
from gsp.proofs.programs import IntervalProgram, Rejected
from gsp.proofs.rational_functions import RationalFunctions

# The first version claimed that every locally invariant manifold lies in the tube, and uniqueness of saddles.
KIND = "gsp slow manifold"
FORMAT = f"{KIND} 2"
# Bounds: the order of the series, boxes of one test, operations on intervals in all, and the least share of a side.
MOST_ORDER, MOST_BOXES, MOST_OPERATIONS, NARROWEST = 20, 50_000, 10_000_000, Fraction(1, 2**16)
Box = tuple[tuple[Fraction, Fraction], ...]


def check(read: Any) -> CheckedTube:
    """Check the plain values of a file; raises `Rejected` with the reason when the proof does not hold."""
    return untrusted.guarded(lambda: _TubeProof(read).checked())


class _TubeProof:
    def __init__(self, read: Any) -> None:
        if not isinstance(read, dict) or read.get("format") != FORMAT:
            raise Rejected(f'the format of the file is not "{FORMAT}". Prove the tube and save it again')
        self.slow, self.parameters, self.fast = (
            untrusted.names(read[key]) for key in ("slow", "parameters", "fast")
        )
        (self.small,) = untrusted.names([read["epsilon_name"]])
        untrusted.names([*self.slow, *self.parameters, *self.fast, self.small])
        self.k, self.n, self.m = len(self.slow), len(self.slow) + len(self.parameters), len(self.fast)
        if not (self.k > 0 and self.m > 0 and self.n + self.m < untrusted.MOST_VARIABLES):
            raise Rejected(f"there are slow and fast variables, fewer than {untrusted.MOST_VARIABLES}")
        self.count = self.n + self.m + 1
        self.rates = _texts(read["rates"], self.k)
        self.equations = _texts(read["equations"], self.m)
        if not isinstance(read["series"], list) or not 0 < len(read["series"]) <= MOST_ORDER + 1:
            raise Rejected(f"the series has from 1 to {MOST_ORDER + 1} terms")
        self.series = tuple(_texts(row, self.m) for row in read["series"])
        self.order = len(self.series) - 1
        basis = _texts(read["basis"], self.m**2)
        remainder = _texts(read["remainder"], self.m)
        self.region = untrusted.region(read["region"], self.n)
        self.epsilon = untrusted.number(read["epsilon"])
        if not self.epsilon > 0:
            raise Rejected("epsilon is positive")
        self._read_tube(read)
        # Of x alone; a term of a series or of the basis that names more is no such thing.
        self.terms = IntervalProgram(tuple(text for row in self.series for text in row), self.n)
        self.basis = IntervalProgram(basis, self.n)
        # Of (x, y, epsilon), of (x, z, epsilon).
        self.field = IntervalProgram((*self.rates, *self.equations), self.count)
        self.flow = IntervalProgram(self.rates, self.count)
        self.gamma = IntervalProgram(remainder, self.count)
        self.graph = IntervalProgram(tuple(self._graph(i, basis) for i in range(self.m)), self.count)
        # Operations of eliminations.
        self.boxes = self.work = 0

    def _read_tube(self, read: Any) -> None:
        blocks = read["blocks"]
        if not isinstance(blocks, list) or not all(isinstance(block, list) and block for block in blocks):
            raise Rejected("the blocks are lists of places")
        self.blocks = [[untrusted.count(i, self.m - 1) for i in block] for block in blocks]
        if sorted(i for block in self.blocks for i in block) != list(range(self.m)):
            raise Rejected("every fast direction is in one block")
        self.signs = untrusted.signs(read["signs"], len(blocks), "the signs", "block")
        widths = untrusted.numbers(read["widths"], len(blocks))
        self.reach = untrusted.numbers(read["reach"], self.m)
        if any(width <= 0 for width in widths):
            raise Rejected("the widths of a tube are positive")
        self.widths = [ia.of(width)[1] for width in widths]
        self.boundary = read["boundary"]
        if self.boundary not in ("overflowing", "inflowing", "mixed"):
            raise Rejected("the slow flow at the sides is overflowing, inflowing or mixed")
        self.cones = [
            tuple(untrusted.number(cone[key]) for key in ("low", "high", "slope", "collar"))
            for cone in untrusted.few(read["cones"], 100, "steps of cones")
        ]
        end = Fraction(0)
        for low, high, slope, collar in self.cones:
            if low != end or not high > low or not slope > 0 or collar < 0:
                raise Rejected("the steps of the cones follow one another, with positive slopes")
            end = high
        self._read_collar(read)
        if end != self.epsilon:
            raise Rejected("the cones do not reach from 0 to epsilon")

    def _read_collar(self, read: Any) -> None:
        self.unique, self.collar = read["unique"], untrusted.number(read["collar"])
        if type(self.unique) is not bool or self.collar < 0 or (self.unique and self.collar):
            raise Rejected("a manifold is unique without a collar, or it has one")
        stays = {"overflowing": -1, "inflowing": 1}.get(self.boundary)
        if self.unique and any(sign != stays for sign in self.signs):
            raise Rejected(
                "a manifold is unique where all fast directions are stable and the slow flow is overflowing, or "
                f"unstable and inflowing. The signs are {self.signs}, the slow flow is {self.boundary}"
            )
        if any(2 * self.collar >= high - low for low, high in self.region[: self.k]):
            raise Rejected("the collar leaves nothing of the region")

    def _graph(self, i: int, basis: tuple[str, ...]) -> str:
        """y_i as an expression in (x, z, epsilon)."""
        small = f"z{self.n + self.m}"
        parts = [f"({row[i]})*{small}**{k}" if k else f"({row[i]})" for k, row in enumerate(self.series)]
        parts += [f"({basis[i * self.m + j]})*z{self.n + j}*{small}**{self.order + 1}" for j in range(self.m)]
        return " + ".join(parts)

    def checked(self) -> CheckedTube:
        """The whole proof."""
        self._identity()
        whole = (*self.region, (Fraction(0), self.epsilon))
        self._everywhere(self.region, self._reaches, "the tube is wider than is claimed, or P is no basis")
        self._everywhere(whole, self._faces, "a face of the tube is not crossed strictly")
        self._sides(whole)
        for low, high, slope, collar in self.cones:
            part = (*self.region, (low, high))
            sides = sorted(set(self.signs))

            def holds(box: Box, slope=slope, collar=collar, sides=sides) -> bool:
                return all(self._cone(box, slope, collar, side) for side in sides)

            self._everywhere(part, holds, f"the cones do not hold for epsilon up to {float(high):g}")
            if not self.unique:
                cuts_off = partial(self._cuts_off, collar=collar)
                self._everywhere(part, cuts_off, "the collar is narrower than the cones allow")
        unstable = sum(len(block) for block, sign in zip(self.blocks, self.signs) if sign > 0)
        return CheckedTube(
            slow=self.slow,
            parameters=self.parameters,
            fast=self.fast,
            small=self.small,
            rates=self.rates,
            equations=self.equations,
            series=self.series,
            region=tuple((float(low), float(high)) for low, high in self.region),
            epsilon=float(self.epsilon),
            reach=tuple(float(value) for value in self.reach),
            stable=self.m - unstable,
            unstable=unstable,
            boundary=self.boundary,
            unique=self.unique,
            collar=float(self.collar),
            boxes=self.boxes,
        )

    # -- the identity ------------------------------------------------------------------------------

    def _identity(self) -> None:
        """epsilon^(n+1) P Gamma = g - epsilon D_x y f, as rational functions of (x, z, epsilon)."""
        ring = RationalFunctions(self.count)
        arguments = [ring.variable(i) for i in range(self.count)]
        small = arguments[-1]
        y = ring.evaluate(self.graph, arguments)
        found = ring.evaluate(self.field, [*arguments[: self.n], *y, small])
        rates, equations = found[: self.k], found[self.k :]
        gamma = ring.evaluate(self.gamma, arguments)
        basis = ring.evaluate(self.basis, arguments[: self.n])
        power = ring.power(small, self.order + 1)
        for i in range(self.m):
            left = ring.constant(Fraction(0))
            for j in range(self.m):
                left = ring.add(left, ring.multiply(basis[i * self.m + j], gamma[j]))
            right = equations[i]
            for place, rate in enumerate(rates):
                along = ring.multiply(small, ring.multiply(ring.derivative(y[i], place), rate))
                right = ring.add(right, along, -1)
            if ring.add(ring.multiply(power, left), right, -1).numerator:
                raise Rejected("the flow about the series is not what the file says")

    # -- boxes -------------------------------------------------------------------------------------

    def _everywhere(self, region: Box, holds: Callable[[Box], bool], fails: str) -> None:
        """`holds` on parts that fill the region; raises `Rejected` saying that it `fails` on one too small to cut."""
        sides = [high - low for low, high in region]
        waiting, tried = [region], 0
        while waiting:
            box = waiting.pop()
            tried += 1
            self.boxes += 1
            if tried > MOST_BOXES:
                raise Rejected(f"{fails}, or it takes more than {MOST_BOXES} boxes to see that it is")
            if self._operations() > MOST_OPERATIONS:
                raise Rejected(
                    f"{fails}, or the proof takes more than {MOST_OPERATIONS} operations on intervals"
                )
            try:
                if holds(box):
                    continue
            except ia.OutOfDomain as error:
                reason = f"{fails}: {error}"
            else:
                reason = fails
            shares = [(high - low) / side if side else Fraction(0) for (low, high), side in zip(box, sides)]
            if max(shares) < NARROWEST:
                raise Rejected(reason)
            axis = self._axis(box, shares)
            low, high = box[axis]
            middle = (low + high) / 2
            for ends in ((low, middle), (middle, high)):
                waiting.append(tuple(ends if k == axis else side for k, side in enumerate(box)))

    def _operations(self) -> int:
        """Operations on intervals so far: of the programs, of the matrices, and 32 for cutting a box."""
        programs = (self.basis, self.field, self.flow, self.gamma, self.graph)
        return sum(program.work for program in programs) + self.work + 32 * self.boxes

    def _axis(self, box: Box, shares: list[Fraction]) -> int:
        """Where to cut: across which side Gamma at z = 0 varies most; a poor choice costs boxes, never truth."""
        longest = max(shares)
        if len(box) > self.n:
            try:
                rows = self.gamma.derivatives(self._arguments(box, at_zero=True))
            except ia.OutOfDomain:
                return shares.index(longest)
            places = [*range(self.n), self.count - 1]
            smear = [
                float(high - low) * max(_size(row[place]) for row in rows) if 64 * share >= longest else 0.0
                for place, (low, high), share in zip(places, box, shares)
            ]
            if 0.0 < max(smear) < math.inf:
                return smear.index(max(smear))
        return shares.index(longest)

    def _arguments(self, box: Box, *, at_zero: bool = False) -> list[Interval]:
        """(x, z, epsilon) over a box of x and epsilon, z in the tube or 0."""
        *x, small = [(ia.of(low)[0], ia.of(high)[1]) for low, high in box]
        z = [ia.ZERO] * self.m
        if not at_zero:
            for block, width in zip(self.blocks, self.widths):
                for i in block:
                    z[i] = (-width, width)
        return [*x, *z, small]

    # -- the tests ---------------------------------------------------------------------------------

    def _reaches(self, box: Box) -> bool:
        """|(P z)_i| <= reach_i, and P is regular."""
        m = self.m
        self.work += m**3
        values = self.basis.values([(ia.of(low)[0], ia.of(high)[1]) for low, high in box])
        rows = [values[i * m : i * m + m] for i in range(m)]
        for row, reach in zip(rows, self.reach):
            total = 0
            for block, width in zip(self.blocks, self.widths):
                total += im.up(im.norm([row[j] for j in block]) * width)
            if total > ia.of(reach)[0]:
                return False
        return im.is_regular(rows)

    def _faces(self, box: Box) -> bool:
        """lambda_min(Sym(s B_ii)) d_i - sum |B_ij| d_j - |rho_i| > 0 for every block."""
        self.work += self.m**2 + sum(len(block) ** 3 for block in self.blocks)
        arguments = self._arguments(box)
        # What the identity is about is defined here.
        self.field.values([*arguments[: self.n], *self.graph.values(arguments), arguments[-1]])
        rho = self._rho(box)
        matrix = [row[self.n : self.n + self.m] for row in self.gamma.derivatives(arguments)]
        for i, (block, sign) in enumerate(zip(self.blocks, self.signs)):
            margin = im.down(im.decay(matrix, block, sign) * self.widths[i]) - im.norm([rho[k] for k in block])
            for j, other in enumerate(self.blocks):
                if j != i:
                    margin -= im.up(im.norm([matrix[k][q] for k in block for q in other]) * self.widths[j])
            if not margin > 0:
                return False
        return True

    def _rho(self, box: Box) -> list[Interval]:
        """Gamma at z = 0: as it is and by the mean value theorem, whichever is the smaller."""
        arguments = self._arguments(box, at_zero=True)
        natural = self.gamma.values(arguments)
        middle: Box = tuple(((low + high) / 2, (low + high) / 2) for low, high in box)
        at = self._arguments(middle, at_zero=True)
        centred, slopes = self.gamma.values(at), self.gamma.derivatives(arguments)
        found = []
        for value, total, row in zip(natural, centred, slopes):
            for place in (*range(self.n), self.count - 1):
                total = ia.add(total, ia.multiply(row[place], ia.subtract(arguments[place], at[place])))
            found.append(total if ia.magnitude(total) < ia.magnitude(value) else value)
        return found

    def _cone(self, box: Box, slope: Fraction, collar: Fraction, side: int) -> bool:
        """s (W^T Q + Q W) - tau Q > 0 for one tau > 0, z in units of L = slope, with and without the slow flow."""
        n, m, k = self.n, self.m, self.k
        self.work += n * (n + m) * m + (n + m) ** 3 // 3
        arguments = self._arguments(box)
        small = arguments[-1]
        rows = self.graph.derivatives(arguments)
        y = self.graph.values(arguments)
        field = self.flow.derivatives([*arguments[:n], *y, small])
        length = ia.of(slope)
        w: im.Matrix = []
        for row in field:
            along = [im.dot(row[n : n + m], [other[j] for other in rows], ia.ZERO) for j in range(n + m)]
            by_x = [ia.multiply(small, ia.add(row[j], along[j])) for j in range(n)]
            by_z = [ia.multiply(ia.multiply(small, along[n + j]), length) for j in range(m)]
            w.append(by_x + by_z)
        w += [[ia.ZERO] * (n + m) for _ in range(n - k)]
        normal: im.Matrix = []
        for row in self.gamma.derivatives(arguments):
            normal.append(row[n : n + m])
            w.append([ia.divide(row[j], length) for j in range(n)] + row[n : n + m])
        q = [-2] * n + [0] * m
        decays = []
        for block, sign in zip(self.blocks, self.signs):
            for i in block:
                q[n + i] = 2 if sign == side else -1
            if sign == side:
                decays.append(im.decay(normal, block, sign))
        cut_off = ia.multiply(ia.of(2 * collar), (0, small[1]))[1]
        # Any tau is a proof: between twice the slow rate and twice the fast one.
        slowest = 0
        for i in range(n):
            twice = w[i][i] if side > 0 else ia.negative(w[i][i])
            rate = 2 * twice[1]
            for j in range(n):
                if j != i:
                    rate += ia.magnitude(ia.add(w[i][j], w[j][i]))
            slowest = max(slowest, rate)
        tau = (slowest + cut_off) // 2 + min(decays)
        if not tau > 0:
            return False
        still = [[ia.ZERO] * (n + m) for _ in range(n)] + w[n:]
        for version in (w, still) if collar else (w,):
            form = [[im.symmetric(version, q, side, i, j) for j in range(n + m)] for i in range(n + m)]
            for i in range(n + m):
                # Q has halves: the entries of q are twice those of Q, and those of the form twice the theorem's.
                less = tau * q[i] + (2 * cut_off if i < n else 0)
                form[i][i] = form[i][i][0] - less, form[i][i][1] - less
            if not im.is_positive(form):
                return False
        return True

    def _cuts_off(self, box: Box, collar: Fraction) -> bool:
        """|grad chi| |f| <= collar with |grad chi| = 1/width of the collar."""
        arguments = self._arguments(box)
        rates = self.flow.values([*arguments[: self.n], *self.graph.values(arguments), arguments[-1]])
        return im.norm(rates) <= ia.of(collar * self.collar)[0]

    def _sides(self, whole: Box) -> None:
        """What is claimed of the slow flow at the sides."""
        if self.boundary == "mixed":
            return
        for axis in range(self.k):
            for upper in (False, True):
                end = whole[axis][upper]
                face = tuple((end, end) if i == axis else side for i, side in enumerate(whole))
                outwards = upper == (self.boundary == "overflowing")

                def leaves(box: Box, axis=axis, outwards=outwards) -> bool:
                    arguments = self._arguments(box)
                    y = self.graph.values(arguments)
                    rate = self.flow.values([*arguments[: self.n], *y, arguments[-1]])[axis]
                    return rate[0] > 0 if outwards else rate[1] < 0

                self._everywhere(face, leaves, f"the slow flow is not {self.boundary} at every side")


def _texts(rows: Any, length: int) -> tuple[str, ...]:
    if not isinstance(rows, list) or len(rows) != length or not all(isinstance(row, str) for row in rows):
        raise Rejected(f"a list of {length} expressions is text. Got {str(rows)[:60]!r}")
    return tuple(rows)


def _size(interval: Interval) -> float:
    try:
        return ia.magnitude(interval) / ia.ONE
    except OverflowError:
        return math.inf
