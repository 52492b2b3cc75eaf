"""`certify` of a passage: through a fold, or past a point where branches meet, for every epsilon in (0, epsilon_0].

The theorems and their proofs are in docs/proofs.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp
from flint import arb

from gsp.algebra.precision import precision
from gsp.cycles.annulus import Strip
from gsp.cycles.band_search import BandSearch
from gsp.cycles.delay import STRIPS, DelayField, ProvedDelay, delay_field, proved_delay
from gsp.cycles.enclosed_field import EnclosedField, exact_rates
from gsp.cycles.outline import Frame, NoOutline
from gsp.cycles.passage_outline import Crossing, CrossingOutliner, fold_strip
from gsp.cycles.proof_up_to import ProofUpTo
from gsp.cycles.sectors import NotProved, Turn
from gsp.errors import DeclarationError
from gsp.proofs import balls
from gsp.proofs.search_progress import SearchProgress
from gsp.proofs.sides import written
from gsp.proofs.verdict import ProofVerdict
from gsp.results.bounds import as_given, at_least, at_most, inside, outside
from gsp.singular.passage.delayed_exit import DelayedExit, ExitKind
from gsp.singular.passage.fold_passage import FoldPassage
from gsp.singular.passage.losses_met import Outcome
from gsp.systems.arguments import check_number, check_progress
from gsp.systems.flow import check_epsilon
from gsp.systems.system import SlowFastSystem

# Points along a sheet on the way to its fold.
SHEET = 65


@dataclass(frozen=True, eq=False, repr=False)
class ProvedStrip:
    """A strip that every orbit passes from its entry section to its exit section, for every epsilon in (0, `epsilon`].

    `turn` bounds the slow time and the integral of epsilon times the divergence. Coordinates are those of the
    system less `origin`, exactly; `rates` are f, g and h in them.
    """

    strip: Strip
    epsilon: float
    turn: Turn
    fineness: int
    rates: tuple[sp.Expr, ...]
    origin: tuple[Fraction, Fraction] = (Fraction(0), Fraction(0))

    @property
    def entry(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Intervals of the slow and the fast variable on the entry section, rounded inwards; one that both ends have in
        common is the nearest double.
        """
        return self._section(0, balls.above, balls.below)

    @property
    def exit(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Intervals of the slow and the fast variable on the exit section, rounded outwards; one that both ends have in
        common is the nearest double.
        """
        return self._section(-1, balls.below, balls.above)

    def exactly(self, place: int) -> tuple[str, str]:
        """What the slow and the fast variable are on the first section (0) or the last (-1), as decimals that stand for
        doubles, and "" for the one that is an interval.
        """

        def written(one: float, two: float, offset: Fraction) -> str:
            value = Fraction(one) + offset
            if one != two:
                return ""
            if Fraction(float(value)) == value:
                return as_given(float(value))
            return f"{offset} {'-' if one < 0.0 else '+'} {as_given(abs(one))}"

        x, y = map(written, *self._ends(place), self.origin)
        return x, y

    def _ends(self, place: int) -> tuple[list[float], list[float]]:
        outer, inner = (line[place].tolist() for line in (self.strip.outer, self.strip.inner))
        return outer, inner

    def _section(
        self, place: int, lower: Callable[[arb], float], upper: Callable[[arb], float]
    ) -> tuple[tuple[float, float], tuple[float, float]]:
        def side(one: float, two: float, offset: Fraction) -> tuple[float, float]:
            if one == two:
                return (near := float(Fraction(one) + offset)), near
            c = balls.exact(offset)
            return lower(c + min(one, two)), upper(c + max(one, two))

        x, y = map(side, *self._ends(place), self.origin)
        return x, y


@dataclass(frozen=True, eq=False, repr=False)
class PassageCertificate(ProofUpTo):
    """What is proved about orbits that pass a loss of hyperbolicity, a `FoldPassage` or a `DelayedExit`.

    - PROVED, with a `strip`: for every epsilon in (0, `epsilon_0`] every orbit through its entry section leaves it
      through its exit section.
    - PROVED, with a `delay`: they stay beside the sheet that has lost its stability; see `ProvedDelay`. `sheet_rates`
      are f and k, v being the distance from the sheet.
    - UNDECIDED: neither; `reason` says why.
    """

    passage: FoldPassage | DelayedExit
    verdict: ProofVerdict
    reason: str
    strip: ProvedStrip | None = None
    delay: ProvedDelay | None = None
    sheet_rates: tuple[sp.Expr, ...] = ()

    @property
    def system(self) -> SlowFastSystem:
        """The system that orbits belong to."""
        return self.passage.system if isinstance(self.passage, FoldPassage) else self.passage.branch.system

    @property
    def epsilon_0(self) -> float:
        """It holds for every epsilon up to this; 0 where nothing is proved."""
        found = self.strip or self.delay
        return found.epsilon if found else 0.0

    @property
    def names(self) -> tuple[str, str]:
        """The slow and the fast variable."""
        (x,), (y,) = self.system.x, self.system.y
        return x.name, y.name

    def as_dict(self) -> dict[str, object]:
        """Plain values, for JSON."""
        plain: dict[str, object] = {
            "verdict": self.verdict.value, "reason": self.reason, "epsilon_0": self.epsilon_0
        }  # fmt: skip
        if self.strip is not None:
            sections = {"entry": self.strip.entry, "exit": self.strip.exit}
            plain |= {key: dict(zip(self.names, map(list, ends))) for key, ends in sections.items()}
            plain |= {"time": list(self.strip.turn.period), "contraction": self.strip.turn.contraction}
        if self.delay is not None:
            one = self.delay
            plain |= {
                "width": one.width, "entry": float(one.grid[0]), "stays_to": one.stays_to, "depth": one.depth,
                "leaves_by": None if one.left is None else one.leaves_by, "time": list(one.time),
            }  # fmt: skip
        return plain

    def _plain(self) -> dict[str, Any]:
        from gsp.cycles.passage_file import plain

        return plain(self)

    def __str__(self) -> str:
        (x, y), small = self.names, self.system.epsilon.name
        lines = [f"{self.verdict.value}: {self.reason}"]
        if self.strip is not None:
            one = self.strip
            # Those through less than the entry section come out within more than the exit section.
            for what, place, ends, told in (
                ("every orbit through", 0, one.entry, inside),
                ("leaves the strip through", -1, one.exit, outside),
            ):
                places = [
                    f"{name} = {exact}" if exact else f"{name} from {' to '.join(told(*sides))}"
                    for name, sides, exact in zip((x, y), ends, one.exactly(place))
                ]
                lines.append(f"  {what} {', '.join(places)}")
            lines.append(f"  after a slow time from {' to '.join(outside(*one.turn.period))}")
            lines.append(
                f"  the integral of {small} times the divergence is at most {at_most(one.turn.contraction)}"
            )
        if self.delay is not None:
            one = self.delay
            early, late = (at_least, at_most) if one.grid[-1] > one.grid[0] else (at_most, at_least)
            lines.append(
                f"  every orbit that is within {at_least(one.width)} of the sheet over {x} = {as_given(one.grid[0])} "
                f"stays so at least to {x} = {early(one.stays_to)}"
            )
            lines.append(
                f"    and comes as near to it as exp(-{at_least(one.depth)}/{small}) times its first distance"
            )
            if one.left is not None:
                lines.append(f"  those that begin at this distance have left by {x} = {late(one.leaves_by)}")
        return "\n".join(lines)


def certify_passage(
    passage: FoldPassage | DelayedExit,
    *,
    start: Mapping[str, float] | None = None,
    epsilon: float | None = None,
    progress: Callable[[float], object] | None = None,
) -> PassageCertificate:
    """Prove that orbits pass a fold, a transcritical or a pitchfork point, from an entry to an exit section.

    It is proved for every epsilon in (0, `epsilon`], or up to the largest one that is found; a delayed loss of
    stability up to the `epsilon` that is given. Orbits pass a fold from over the slow variable of `start` on; a
    `DelayedExit` has its own. `progress` is called with the share of the search that is done.

    Raises `DeclarationError` unless there are one slow and one fast variable, and for a start or an epsilon that is
    missing or not well formed; `UnsupportedFunctionError` for a function without an enclosure.

    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={y: 1}, fast={x: x**2 + y}, epsilon=eps)
    >>> found = certify_passage(fold_passage(system, {"x": 0, "y": 0}), start={"y": -1}, epsilon=0.001)
    >>> (low, high), _ = found.strip.exit
    >>> low < 0.02338 < high
    True
    """
    system = passage.system if isinstance(passage, FoldPassage) else passage.branch.system
    if len(system.x) != 1 or len(system.y) != 1:
        raise DeclarationError(
            "a passage is proved in the plane of one slow and one fast variable.",
            "Measure passages of larger systems by runs.",
            got=f"{len(system.x)} slow and {len(system.y)} fast variables",
        )
    check_progress(progress)
    shown = SearchProgress(progress)
    if epsilon is not None:
        _, epsilon = written(epsilon, check_epsilon(epsilon))
    try:
        with precision(balls.PRECISION):
            if isinstance(passage, FoldPassage):
                return _through_fold(passage, start, epsilon, shown)
            if passage.kind is ExitKind.NONE and not passage.losses:
                raise NoOutline(passage.message)
            return _delayed(passage, epsilon) if passage.invariant else _past_crossing(passage, epsilon, shown)
    except (NoOutline, NotProved) as error:
        return PassageCertificate(passage, ProofVerdict.UNDECIDED, f"no proof was found: {error}")
    finally:
        shown.reached(1.0)


def _searched(
    passage: FoldPassage | DelayedExit,
    field: EnclosedField,
    outlined: Callable[[float], Strip],
    begin: float,
    epsilon: float | None,
    what: str,
    shown: SearchProgress,
    origin: tuple[Fraction, Fraction] = (Fraction(0), Fraction(0)),
) -> PassageCertificate:

    def make(strip: Strip, small: float, turn: Turn, fineness: int) -> ProvedStrip:
        return ProvedStrip(strip, small, turn, fineness, field.rates, origin)

    search = BandSearch(field, outlined, make)
    search.shown = shown
    # Up to where orbits no longer come together on the way.
    found = search.largest(begin, attracts=True) if epsilon is None else search.within(epsilon)
    (small,) = {s.name for s in field.arguments[2:]}
    if found is None:
        raise NoOutline(f"{small} = {at_least(search.last)}: {search.why}")
    reason = f"{what} for every {small} in (0, {at_least(found.epsilon)}]"
    return PassageCertificate(passage, ProofVerdict.PROVED, reason, found)


# -- a fold --------------------------------------------------------------------------------------------


def _through_fold(
    passage: FoldPassage, start: Mapping[str, float] | None, epsilon: float | None, shown: SearchProgress
) -> PassageCertificate:
    (x,) = passage.system.x
    if start is None or x.name not in start:
        raise DeclarationError(
            "a passage through a fold is proved from an entry section on.",
            f'Give its slow variable, as start={{"{x.name}": 0}}.',
            got=f"start={start!r}",
        )
    begin = float(check_number(start.get(x.name), what=x.name, be="a finite number"))
    field = EnclosedField.of(passage.system)
    frame = _fold_frame(field, passage, begin)
    return _searched(
        passage, field, lambda small: fold_strip(field, frame, small), float((frame.sizes[0] / frame.late) ** 1.5),
        epsilon, "orbits pass the fold and jump", shown,
    )  # fmt: skip


def _fold_frame(field: EnclosedField, passage: FoldPassage, begin: float) -> Frame:
    """The sheet from over `begin` to the fold, by Newton's method from the fold on."""
    slow, fast = float(np.sign(passage.slow_rate[0])), float(np.sign(passage.right[0] * passage.a))
    fold = np.array([passage.x0[0], passage.y0[0]])
    length = slow * (fold[0] - begin)
    if not length > 0.0:
        raise DeclarationError(
            "orbits come to the fold from its other side.",
            "Start before the fold.",
            got=f"{begin:g}, the fold {fold[0]:g}",
        )
    # A parabola, to begin with, and beside every place.
    sheet = []
    y = -fast * float(np.sqrt(abs(passage.b / passage.slow_rate[0] * length / passage.a))) / (SHEET - 1)
    for i in range(1, SHEET):
        share = i / (SHEET - 1)
        at = begin + (fold[0] - begin) * (1.0 - share**2)
        y *= i / max(i - 1, 1)
        for _ in range(60):
            _, g, _, _, _, slope, *_ = field.nearby([[at, fold[1] + y]], 0.0)[:, 0]
            step = g / slope if slope < 0.0 else np.nan
            y -= step
            if not abs(step) > 1e-13 * abs(y):
                break
        if not np.isfinite(y) or fast * y > 0.0:
            raise NoOutline(f"the attracting sheet is not followed from the fold back to {begin:g}")
        sheet.append((at, fold[1] + y))
    signs = np.array([slow, fast])
    drop = passage.drop
    name = passage.system.y[0].name
    # Where nothing is landed on, as high above the fold as the sheet is below.
    height = abs(float(drop.point[name]) - fold[1]) if drop.lands else abs(y)
    points = np.array([*sheet[::-1], tuple(fold)]) * signs
    return Frame(slow, fast, points, fold * signs, abs(float(passage.leading[0])), np.array([length, height]))


# -- where branches meet -------------------------------------------------------------------------------


def _past_crossing(exit: DelayedExit, epsilon: float | None, shown: SearchProgress) -> PassageCertificate:
    system, loss = exit.branch.system, exit.losses[0]
    (x,), (y,) = system.x, system.y
    if loss.outcome not in (Outcome.EXCHANGE, Outcome.ESCAPE):
        raise NoOutline(f"what follows the {loss.kind} is {loss.outcome}")
    rates = exact_rates(system)
    origin = _exact_point(
        rates[1].xreplace({system.epsilon: sp.S.Zero}), (x, y), [loss.point[s.name] for s in (x, y)]
    )
    moved = {s: s + sp.Rational(c.numerator, c.denominator) for s, c in zip((x, y), origin)}
    shifted = [e.xreplace(moved) for e in rates]
    field = EnclosedField(
        (x, y, system.epsilon), [sp.expand(e) if e.is_polynomial(x, y) else e for e in shifted]
    )
    f = float(field.nearby([[0.0, 0.0]], 0.0)[0, 0])
    q, rho = loss.coefficients["q"], loss.coefficients["rho"]
    slow, fast = float(np.sign(f)), float(np.sign(rho))
    centre = [float(c) for c in origin]
    kappa = loss.crossing / abs(f)
    slope = 0.5 * abs(rho / f)
    if q and loss.outcome is Outcome.EXCHANGE:
        slope = min(slope, 0.5 * kappa / abs(q))
    reach = abs(float(exit.start[x.name]) - centre[0])

    def along(at: np.ndarray) -> np.ndarray:
        return fast * (exit.branch.points((centre[0] + slow * at)[:, None])[:, 0] - centre[1])

    frame = Frame(slow, fast, np.zeros((0, 2)), np.zeros(2), 1.0, np.array([reach, reach * slope]))
    crossing = Crossing(frame, along, slope, kappa / abs(f), reach, loss.outcome is Outcome.ESCAPE)
    what = "orbits escape from the" if crossing.escapes else "orbits go on along another sheet past the"
    return _searched(
        passage=exit, field=field, outlined=lambda small: CrossingOutliner(field, crossing, small).strip(),
        begin=kappa / abs(f) * reach**2, epsilon=epsilon, what=f"{what} {loss.kind}", shown=shown, origin=origin,
    )  # fmt: skip


def _exact_point(
    g: sp.Expr, symbols: tuple[sp.Symbol, sp.Symbol], near: list[float]
) -> tuple[Fraction, Fraction]:
    """The fractions near a point at which g and its slopes vanish."""
    # A point where branches meet is looked for among fractions with denominators up to these.
    for most in (100, 10_000, 1_000_000):
        point = tuple(Fraction(v).limit_denominator(most) for v in near)
        at = {s: sp.Rational(c.numerator, c.denominator) for s, c in zip(symbols, point)}
        if all(e.xreplace(at) == 0 for e in (g, *(sp.diff(g, s) for s in symbols))):
            return point[0], point[1]
    raise NoOutline(
        "the point where branches meet is not known as fractions, so that it cannot be on a line exactly"
    )


# -- a delay -------------------------------------------------------------------------------------------


def _delayed(exit: DelayedExit, epsilon: float | None) -> PassageCertificate:
    if epsilon is None:
        raise DeclarationError(
            "a delay is proved for every epsilon up to one that is given.", "Give it, as epsilon=0.01."
        )
    field = delay_field(exit)
    (x,) = exit.branch.system.x
    begin, end = float(exit.start[x.name]), float(exit.point[x.name])
    width = _width(field, np.linspace(begin, end, SHEET), epsilon)
    # By this share of the way to the predicted exit a delay is looked at beyond it.
    grid = np.linspace(begin, end + 0.5 * (end - begin), STRIPS + 1)
    found = proved_delay(field, grid, width, epsilon)
    small = exit.branch.system.epsilon.name
    reason = f"a delayed loss of stability for every {small} in (0, {at_least(epsilon)}]"
    return PassageCertificate(exit, ProofVerdict.PROVED, reason, delay=found, sheet_rates=field.rates)


def _width(field: DelayField, x: np.ndarray, epsilon: float) -> float:
    """Half the width of a tube in which k/f changes by a small share of its size; no more than the way."""
    small, way = balls.hull(0.0, epsilon), float(abs(x[-1] - x[0]))

    def ratios(v: float) -> np.ndarray:
        return np.array([float(field.over(balls.exact(u), balls.exact(v), small)[1].mid()) for u in x.tolist()])

    on_sheet = ratios(0.0)
    for power in range(64):
        width = way * 0.5**power
        changes = [np.abs(ratios(v) - on_sheet).max() for v in (width, -width)]
        # The rate k of a delay may change by this share of its size over the width of the tube.
        if max(changes) <= 0.01 * np.abs(on_sheet).max():
            return width
    raise NoOutline("the rate of approach changes too fast beside the sheet")
