"""Check a proof of normal hyperbolicity: whole numbers, a parser and derivatives of its own, and nothing of the
prover.

The file is untrusted. Its expressions are read by a grammar without names of Python's, its sizes are bounded, and
what it says is checked, never believed: each box by Krawczyk's condition, each spectrum by the inertia theorem, the
cover by cutting the region again, and every glue (the theorems are in `tubes`, `spectrum` and `covering`). A proof
that says less than what it could passes; one that says more is rejected.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from gsp.proofs import intervals as ia
from gsp.proofs import untrusted
from gsp.proofs.file_variables import lettered
from gsp.proofs.interval_matrices import dot, is_positive, solved
from gsp.proofs.intervals import Interval
from gsp.proofs.programs import IntervalProgram, Rejected
from gsp.results.bounds import as_given, at_least, shown_sides

FORMAT = "gsp normal hyperbolicity 1"
# Parts of a tree.
MOST_PARTS = 500_000


@dataclass(frozen=True)
class Checked:
    """What a file proves: over `region` one smooth branch with so many stable and unstable eigenvalues, `gap` from
    the axis.

    `equations` are g = 0 in z0, z1, ..., which stand for `names`, slow variables and parameters before fast
    variables.
    """

    names: tuple[str, ...]
    over: int
    equations: tuple[str, ...]
    region: tuple[tuple[float, float], ...]
    stable: int
    unstable: int
    gap: float
    boxes: int

    def as_dict(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "equations": list(self.equations),
            "variables": {f"z{i}": name for i, name in enumerate(self.names)},
            "region": dict(zip(self.names, map(list, self.region))),
            "stable": self.stable,
            "unstable": self.unstable,
            "gap": self.gap,
            "boxes": self.boxes,
        }

    def __str__(self) -> str:
        box = shown_sides(dict(zip(self.names, self.region)))
        z, *equations = lettered(self.names, *self.equations)
        legend = ", ".join(f"{z}{i} = {name}" for i, name in enumerate(self.names))
        rows = [
            f"the proof holds; boxes checked: {self.boxes}",
            f"  over {box}",
            f"  one smooth branch of {', '.join(f'{e} = 0' for e in equations)} ({legend})",
            f"  {self.stable} stable and {self.unstable} unstable eigenvalues, "
            f"at least {at_least(self.gap)} from the imaginary axis",
        ]
        return "\n".join(rows)


def checked(read: Any) -> Checked:
    """Check the plain values of a file; raises `Rejected` with the reason when the proof does not hold."""
    return untrusted.guarded(lambda: _Proof(read).checked())


def refused(read: Any) -> dict[int, str]:
    """The places in the tree of the pieces whose tube or spectrum does not pass, and why; raises `Rejected` for
    anything else.
    """
    proof = _Proof(read)
    proof.refused = {}
    proof.checked()
    return proof.refused


Box = tuple[tuple[Fraction, Fraction], ...]


@dataclass(frozen=True)
class _Tube:
    middle: list[Fraction]
    centre: list[Fraction]
    slope: list[Fraction]
    radius: list[Fraction]
    inverse: list[Fraction]

    def holds(self, x: list[Fraction], other: _Tube) -> bool:
        """Whether a tube over the one point x lies in this one's interior there: exactly."""
        rows = zip(other.centre, self.line(x), other.radius, self.radius)
        return all(abs(centre - line) + small < radius for centre, line, small, radius in rows)

    def line(self, x: list[Fraction]) -> list[Fraction]:
        """The middle of the tube over x."""
        off = [v - c for v, c in zip(x, self.middle)]
        rows = [self.slope[i : i + len(off)] for i in range(0, len(self.slope), len(off))]
        return [c + sum(s * step for s, step in zip(row, off)) for c, row in zip(self.centre, rows)]


class _Proof:
    def __init__(self, read: Any) -> None:
        if not isinstance(read, dict) or read.get("format") != FORMAT:
            raise Rejected(f'the file is no proof: its format is not "{FORMAT}"')
        if not isinstance(read["equations"], list):
            raise Rejected("equations are a list")
        self.names = untrusted.names(read["names"])
        self.n = untrusted.count(read["over"], untrusted.MOST_VARIABLES)
        self.m = len(self.names) - self.n
        if not (0 < len(self.names) <= untrusted.MOST_VARIABLES and self.n > 0 and self.m > 0):
            raise Rejected(f"there are slow and fast variables, {untrusted.MOST_VARIABLES} at most")
        self.texts = tuple(read["equations"])
        if len(self.texts) != self.m:
            raise Rejected(f"there are as many equations as fast variables. Got {len(self.texts)}")
        self.program = IntervalProgram(self.texts, self.n + self.m)
        self.region: Box = untrusted.region(read["region"], self.n)
        claim = read["claim"]
        self.stable, self.unstable = (untrusted.count(claim[key], self.m) for key in ("stable", "unstable"))
        self.gap = untrusted.number(claim["gap"])
        if self.gap <= 0 or self.stable + self.unstable != self.m:
            raise Rejected("the claim is a positive gap and the numbers of stable and unstable eigenvalues")
        self.through = untrusted.numbers(read["through"], self.n + self.m)
        self.nodes = read["tree"]
        if not isinstance(self.nodes, list) or not 0 < len(self.nodes) <= MOST_PARTS:
            raise Rejected(f"the tree is a list of at most {MOST_PARTS} parts")
        # Pieces that do not pass, where they are asked for.
        self.refused: dict[int, str] | None = None

    def checked(self) -> Checked:
        """The whole proof."""
        leaves: dict[int, tuple[Box, _Tube]] = {}
        # The tree is laid out again from the region, root, lower half, upper half.
        waiting: list[tuple[Box, int | None]] = [(self.region, None)]
        children: dict[int, list[int]] = {}
        place = 0
        while waiting:
            box, parent = waiting.pop()
            if place >= len(self.nodes):
                raise Rejected("the boxes do not cover the region: the tree ends too soon")
            node, here = self.nodes[place], place
            place += 1
            if parent is not None:
                children.setdefault(parent, []).append(here)
            if "axis" in node:
                axis, at = untrusted.count(node["axis"], self.n - 1), untrusted.number(node["at"])
                if not box[axis][0] < at < box[axis][1]:
                    raise Rejected(f"part {here} is cut outside its box")
                for ends in ((at, box[axis][1]), (box[axis][0], at)):
                    half = tuple(ends if k == axis else side for k, side in enumerate(box))
                    waiting.append((half, here))
            else:
                try:
                    leaves[here] = (box, self._piece(node, box, here))
                except (Rejected, ia.OutOfDomain) as error:
                    if self.refused is None:
                        raise
                    self.refused[here] = str(error)
        if self.refused:
            return Checked(self.names, self.n, self.texts, (), 0, 0, 0.0, 0)
        if place != len(self.nodes):
            raise Rejected("the tree has parts that belong to no box")
        halves = {parent: (pair[0], pair[1]) for parent, pair in children.items()}
        boxes = self._glued(leaves, halves)
        self._holds_the_point(leaves)
        return Checked(
            names=self.names,
            over=self.n,
            equations=self.texts,
            region=tuple((float(low), float(high)) for low, high in self.region),
            stable=self.stable,
            unstable=self.unstable,
            gap=float(self.gap),
            boxes=boxes,
        )

    # -- one box -----------------------------------------------------------------------------------

    def _tube(self, node: Any) -> _Tube:
        n, m = self.n, self.m
        lengths = {"middle": n, "centre": m, "slope": m * n, "radius": m, "inverse": m * m}
        tube = _Tube(**{key: untrusted.numbers(node[key], length) for key, length in lengths.items()})
        if any(radius <= 0 for radius in tube.radius):
            raise Rejected("the radius of a tube is positive")
        return tube

    def _piece(self, node: Any, box: Box, here: int) -> _Tube:
        stated = untrusted.numbers(node["box"], 2 * self.n)
        if stated != [end for side in box for end in side]:
            raise Rejected(f"part {here} is not the box that the cuts leave: a box is moved or left out")
        tube = self._tube(node)
        derivative = self._krawczyk(tube, box, here)
        self._spectrum(node, derivative, here)
        return tube

    def _krawczyk(self, tube: _Tube, box: Box, here: int) -> list[list[Interval]]:
        """D_y g over the tube, once Krawczyk's condition is met."""
        n, m = self.n, self.m
        if any(not low <= c <= high for (low, high), c in zip(box, tube.middle)):
            raise Rejected(f"the middle of part {here} is outside its box")
        x = [(ia.of(low)[0], ia.of(high)[1]) for low, high in box]
        c = [ia.of(v) for v in tube.middle]
        b = [ia.of(v) for v in tube.centre]
        slope = [ia.of(v) for v in tube.slope]
        inverse = [ia.of(v) for v in tube.inverse]
        off = [ia.subtract(p, q) for p, q in zip(x, c)]
        line = [dot(slope[i * n : i * n + n], off, b[i]) for i in range(m)]
        radii = [ia.of(r) for r in tube.radius]
        residual = self.program.values(c + b)
        # Over a point, a glue's, nothing is left of the slopes.
        if any(step != ia.ZERO for step in off):
            along = self.program.derivatives(x + line)
            for i in range(m):
                for k in range(n):
                    rate = along[i][k]
                    for j in range(m):
                        rate = ia.add(rate, ia.multiply(along[i][n + j], slope[j * n + k]))
                    residual[i] = ia.add(residual[i], ia.multiply(rate, off[k]))
        ball = [(-r[1], r[1]) for r in radii]
        y = [ia.add(p, r) for p, r in zip(line, ball)]
        derivative = self.program.derivatives(x + y, n)
        for i in range(m):
            image = ia.negative(dot(inverse[i * m : i * m + m], residual))
            for k in range(m):
                product = dot(inverse[i * m : i * m + m], [row[k] for row in derivative])
                factor = ia.subtract(ia.UNIT if i == k else ia.ZERO, product)
                image = ia.add(image, ia.multiply(factor, ball[k]))
            if not (image[1] < radii[i][0] and image[0] > -radii[i][0]):
                raise Rejected(f"Krawczyk's condition fails in part {here}")
        return derivative

    def _spectrum(self, node: Any, derivative: list[list[Interval]], here: int) -> None:
        """z^T H z > gap |z|^2 with H = (S B + B^T S)/2, B = P^-1 M P, by pivots of H - gap."""
        m = self.m
        signs = untrusted.signs(node["signs"], m, f"the signs of part {here}", "fast variable")
        if signs.count(1) != self.unstable:
            raise Rejected(f"part {here} has another number of unstable eigenvalues than is claimed")
        basis = [ia.of(v) for v in untrusted.numbers(node["basis"], m * m)]
        rows = [basis[i * m : i * m + m] for i in range(m)]
        turned = [[dot(derivative[i], [row[k] for row in rows]) for k in range(m)] for i in range(m)]
        inside = solved(rows, turned)
        if inside is None:
            raise Rejected(f"the basis of part {here} is no basis")
        gap = ia.of(self.gap)
        form = [[ia.ZERO] * m for _ in range(m)]
        for i in range(m):
            for j in range(m):
                one = inside[i][j] if signs[i] > 0 else ia.negative(inside[i][j])
                two = inside[j][i] if signs[j] > 0 else ia.negative(inside[j][i])
                total = ia.add(one, two)
                form[i][j] = total[0] >> 1, -(-total[1] >> 1)
            form[i][i] = ia.subtract(form[i][i], gap)
        if not is_positive(form):
            raise Rejected(
                f"the spectrum of part {here} is not {as_given(float(self.gap))} from the imaginary axis"
            )

    # -- the boxes together ------------------------------------------------------------------------

    def _glued(self, leaves: dict[int, tuple[Box, _Tube]], halves: dict[int, tuple[int, int]]) -> int:
        for here, pair in halves.items():
            node = self.nodes[here]
            axis, at = untrusted.count(node["axis"], self.n - 1), untrusted.number(node["at"])
            if "glue" not in node:
                raise Rejected(f"the halves of part {here} are not glued")
            tube = self._tube(node["glue"])
            point: Box = tuple((v, v) for v in tube.middle)
            if tube.middle[axis] != at:
                raise Rejected(f"the glue of part {here} is not on the common face")
            self._krawczyk(tube, point, here)
            for half in pair:
                leaf = self._leaf(half, tube.middle, leaves, halves, here)
                if not leaf.holds(tube.middle, tube):
                    raise Rejected(f"the glue of part {here} is not in the tubes of both neighbours")
        return len(leaves)

    def _leaf(
        self,
        place: int,
        x: list[Fraction],
        leaves: dict[int, tuple[Box, _Tube]],
        halves: dict[int, tuple[int, int]],
        here: int,
    ) -> _Tube:
        """The tube of a leaf below `place` whose box holds x."""
        waiting = [place]
        while waiting:
            found = waiting.pop()
            if found in leaves:
                box, tube = leaves[found]
                if all(low <= v <= high for (low, high), v in zip(box, x)):
                    return tube
                continue
            node = self.nodes[found]
            axis, at = untrusted.count(node["axis"], self.n - 1), untrusted.number(node["at"])
            lower, upper = halves[found]
            if x[axis] <= at:
                waiting.append(lower)
            if x[axis] >= at:
                waiting.append(upper)
        raise Rejected(f"the glue of part {here} is outside its halves")

    def _holds_the_point(self, leaves: dict[int, tuple[Box, _Tube]]) -> None:
        x, y = self.through[: self.n], self.through[self.n :]
        for box, tube in leaves.values():
            near = zip(y, tube.line(x), tube.radius)
            if all(low <= v <= high for (low, high), v in zip(box, x)) and all(
                abs(v - p) < r for v, p, r in near
            ):
                return
        raise Rejected("the point that the branch goes through is not in its tubes")
