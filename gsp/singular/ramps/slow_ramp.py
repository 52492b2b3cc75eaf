"""`slow_ramp`: the threshold of slow ramps as a series, by the canard that carries it.

Of a slow ramp the orbit on the threshold is a canard: it follows an attracting sheet of rest points, passes where that
loses its hyperbolicity, and follows the repelling one. Over the phase s it is smooth, and so are its terms in the small
number d, for only one value q of what is free:

    x' = f(x, l(s)):                    d rho dx/ds = f,        d the rate, q the amplitude of the ramp,            (1)
    epsilon x' = g(x, y, l(s)), y' = f:  d q rho dx/ds = g,  q rho dy/ds = f,   d epsilon, q the rate.               (2)

At d = 0 the sheets cross, or meet in a folded singularity, and q is where they do, or where the canard begins at the
start of the ramp. Polynomials x(s) that meet (1) or (2) at one point more than they have coefficients are smooth, and
exist for one q; they are solved by least squares for d on both sides of 0, which gives the series of q in d.

From a start at rest orbits that track are as smooth as the canard: there `reduced_ramp` finds q at d = 0 first, and the
orbit up to the folded singularity. Where that is a folded saddle-node of type I, q departs from it by sqrt(epsilon).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.polynomial import chebyshev

from gsp.algebra.differentiation import jacobian
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.results.card import Card
from gsp.singular.ramps.connection import matrices, nodes, places, refined
from gsp.singular.ramps.critical_rate import CriticalRate
from gsp.singular.ramps.ramped import Ramped, RampError
from gsp.singular.ramps.reduced_ramp import ReducedRamp, RestingLimit, along
from gsp.singular.singularities.folded_singularities import FoldedKind, FoldedSingularity, folded_singularity
from gsp.systems.arguments import check_noun, check_whole
from gsp.systems.declaration import exact
from gsp.systems.flow import in_words
from gsp.systems.system import SlowFastSystem

# Degrees: the first, too low to resolve what is fast, and the last at which q has to have settled, to this.
FIRST, LAST, SETTLED = 12, 200, 1e-11
# Values of d beyond the order of a series, from which its terms are interpolated.
MORE = 4


@dataclass(frozen=True, eq=False, repr=False)
class SlowRamp(Card):
    """q = c_0 + c_1 d + ..., c_k the `coefficients`, which is the threshold of slow ramps.

    For a field d is the rate and q the critical amplitude, a factor of the changes that the ramp makes; for a slow-fast
    system d is epsilon and q the critical rate. `errors` (k,) are those of the coefficients, by interpolation;
    `number` is q as it was found at `small`, the d of `found`, and `difference` that of the series from it.
    `singularity` is the folded one that the canard passes, of a slow-fast system with one fast and one slow variable;
    of a field there is none: two branches of rest points cross over the phase. A folded saddle-node I is where c_0 ends
    that series: the number departs from it by a length of order sqrt(epsilon).
    """

    found: CriticalRate
    coefficients: np.ndarray
    errors: np.ndarray
    small: float
    number: float
    singularity: FoldedSingularity | None

    @property
    def is_amplitude(self) -> bool:
        """Whether the series is of the amplitude in the rate, and not of the rate in epsilon."""
        return self.found.ramped.epsilon is None

    def value(self, small: float) -> float:
        """The sum of the series there."""
        return float(np.polynomial.polynomial.polyval(small, self.coefficients))

    @property
    def difference(self) -> float:
        """The series less the number."""
        return self.value(self.small) - self.number

    def __repr__(self) -> str:
        name = "rate" if self.is_amplitude else "epsilon"
        terms = [
            f"{c:.8g}{f'*{name}^{k}' if k > 1 else f'*{name}' if k else ''}"
            for k, c in enumerate(self.coefficients)
        ]
        return f"{'amplitude' if self.is_amplitude else 'rate'} = {' + '.join(terms).replace('+ -', '- ')}"

    def __str__(self) -> str:
        name = "rate" if self.is_amplitude else "epsilon"
        passed = (
            ""
            if self.singularity is None
            else f"\n  through a {self.singularity.kind} at {in_words(self.singularity.numbers())}"
        )
        if self.singularity is not None and self.singularity.kind is FoldedKind.SADDLE_NODE_I:
            by = -self.difference / self.small**0.5
            passed += f"\n  from which the rate departs with sqrt({name}), here by {by:.4g} times that"
        told = f"{self.value(self.small):.10g}, found {self.number:.10g}"
        return f"{self!r}{passed}\n  at {name} = {self.small:.8g}: {told}"


def slow_ramp(found: CriticalRate, *, order: int = 3, threshold: int = 0) -> SlowRamp:
    """The threshold of slow ramps as a series through `order`, from one that was found at a small rate or epsilon.

    Of a slow-fast system whose ramp sets out at once, phase' not 0, `found` starts off its slow manifold by a length of
    order epsilon, and its rate differs from the series by epsilon^2.

    Where the ramp starts at rest the reduced flow says which orbit is the canard, of one fast and one slow variable:
    it ends in a folded saddle, or where folded points are born, in a folded saddle-node I. From that the rate departs
    with sqrt(epsilon), and the series is c_0 alone, whatever the order.

    Raises `RampError` where nothing was found to start from, where no smooth orbit is reached from there, and for more
    variables in a slow-fast system whose ramp starts at rest.

    >>> import gsp
    >>> x, l = sp.symbols("x l")
    >>> field = gsp.VectorField(states={x: x**2 + l - 1}, epsilon=None, parameters={l: 0})
    >>> over = gsp.Ramp.there_and_back({l: (0, sp.Rational(101, 100))})
    >>> slow_ramp(gsp.critical_rate(field, ramp=over, start={"x": -1}, edge={"x": 1}), order=1)
    amplitude = 0.99009901 + 0.70010572*rate
    """
    check_noun(found, CriticalRate, verb="slow_ramp")
    check_whole(order, what="order", most=12)
    if not found.connections:
        raise RampError(
            "there is no threshold to start from.", "Ask critical_rate of a slow ramp.", got=repr(found)
        )
    check_whole(threshold, what="threshold", most=len(found.connections) - 1)
    own = found.about_centres
    resting = _resting(own, threshold)
    if resting is not None and resting.singularity.kind is FoldedKind.SADDLE_NODE_I:
        number, small = found.rates[threshold], found.ramped.epsilon
        assert small is not None
        c, error = np.array([resting.q]), np.array([resting.error])
        return SlowRamp(found, c, error, small, number, _moved_back(resting.singularity, found.ramped))
    problem = _Problem(own, threshold, resting)
    here = problem.limit()
    if here is None:
        raise RampError(
            "no smooth orbit was reached from the one on the threshold.", "Start at a smaller rate."
        )
    coefficients = [problem.series(*here, order, order + more) for more in (MORE, MORE + 2)]
    errors = np.abs(coefficients[1] - coefficients[0])
    passed = problem.singularity(*here)
    there = None if passed is None else _moved_back(passed, found.ramped)
    return SlowRamp(found, coefficients[1], errors, problem.small, problem.number, there)


def _moved_back(singularity: FoldedSingularity, asked: Ramped) -> FoldedSingularity:
    """One about the centres of what was asked, where it is."""
    system = singularity.system.about({z: -c for z, c in asked.centres.items()})
    return singularity.moved_to(system, asked.centres)


def _resting(found: CriticalRate, threshold: int) -> RestingLimit | None:
    """The limit of a slow-fast system whose ramp starts at rest; None of any other."""
    given = found.ramped
    source = given.source
    if not isinstance(source, SlowFastSystem) or not given.rests_at(given.ends[0]):
        return None
    if (len(source.fast), len(source.slow)) != (1, 1):
        raise RampError(
            "the ramp starts at rest, from where orbits that track are as smooth as the canard: it is singled out of "
            "one fast and one slow variable.",
            "Take a ramp that sets out at once, `Ramp.linear_with_ends`, or ask critical_rate at smaller epsilons.",
            got=f"{len(source.fast)} fast and {len(source.slow)} slow ones",
        )
    limit = ReducedRamp(given, found.begin).limit(found.rates[threshold])
    if limit is None:
        raise RampError(
            "no rate near the one that was found divides orbits of the reduced flow that meet a fold from those that "
            "do not.",
            "Start at a smaller epsilon.",
            got=found.rates[threshold],
        )
    return limit


class _Problem:
    """Equations (1) or (2) about one threshold, as rows R(z, dz/ds, s, q, d)."""

    def __init__(self, found: CriticalRate, threshold: int, resting: RestingLimit | None) -> None:
        given, orbit = found.ramped, found.connections[threshold]
        source, ramp = given.source, given.ramp
        self.orbit, self.begin, self.resting = orbit, found.begin, resting
        first, last = given.ends[0], float(orbit.phase[-1])
        if resting is not None:
            at = float(resting.singularity[ramp.phase.name])
            # From a start at rest a canard is followed past the folded singularity by this share of the way to it,
            # over which a polynomial of degree FIRST that fits it before is a guess.
            last = at + 0.1 * (at - first)
        self.given, self.ends = given, (first, last)
        z = [*given.field.states]
        zp = [sp.Dummy(f"{s}_s") for s in z]
        q, d = sp.Dummy("q"), sp.Dummy("d")
        if isinstance(source, SlowFastSystem):
            assert given.epsilon is not None
            self.small, self.number = given.epsilon, orbit.rate
            moved = {**ramp.parameters, source.epsilon: d}
            self.held = [i for i, s in enumerate(z) if s in source.slow]
            rows = [
                q * ramp.profile * zp[i] * (1 if i in self.held else d)
                - (source.slow[s] if i in self.held else source.fast[s]).xreplace(moved)
                for i, s in enumerate(z)
            ]
        else:
            self.small, self.number = orbit.rate, 1.0
            moved, self.held = dict(ramp.amplified(q).parameters), []
            # With the parameters themselves put in, whose values along the ramp are functions of q.
            rows = [d * ramp.profile * p - e.xreplace(moved) for p, e in zip(zp, source.rates)]
        rows = [row.xreplace(given.kept) for row in rows]
        slopes = jacobian(rows, [*z, *zp, q])
        self.compiled: CompiledFunction = compile_function(
            (*rows, *slopes), arguments=(*z, *zp, ramp.phase, q), parameters=[d]
        )
        self.n = len(z)

    @cached_property
    def guess(self) -> Callable[[np.ndarray], np.ndarray]:
        """z (m, n) of the orbit on the threshold at phases (m,)."""
        if self.resting is not None:
            s, x = self.resting.phase, self.resting.orbit
            fitted = chebyshev.Chebyshev.fit
            columns = [fitted(s, column, FIRST, domain=[s[0], s[-1]]) for column in x.T]
            return lambda at: np.array([column(at) for column in columns]).T
        order = np.argsort(self.orbit.phase)
        x = self.orbit.x.reshape(len(order), -1)[order]
        return lambda s: np.array([np.interp(s, self.orbit.phase[order], column) for column in x.T]).T

    def limit(self) -> tuple[np.ndarray, float] | None:
        """The solution at d = 0, by way of the d that was found: values (k, n) at the nodes, and q."""
        degree = FIRST
        x = self.guess(places(*self.ends, nodes(degree)))
        here = (x, self.number) if self.resting is None else (x, self.resting.q)
        # On the way to d = 0 it is halved.
        for d in [0.5**k * self.small for k in range(4)] if self.resting is None else []:
            here = None if here is None else self.at(*here, d)
        here = None if here is None else self.at(*here, 0.0)
        # There nothing is fast, and more coefficients resolve nothing else.
        while here is not None and degree < LAST:
            x, q = here
            degree += 4
            here = self.at(refined(x, degree), q, 0.0)
            if here is not None and abs(here[1] - q) <= SETTLED * abs(q):
                return here if self.is_canard(*here) else None
        return None

    def is_canard(self, x: np.ndarray, q: float) -> bool:
        """Whether what is fast attracts where the limit begins, and does not where it ends.

        Of a sheet that loses nothing every q has a smooth solution, and of a ramp that moves nothing, q = 0.
        """
        ends = np.column_stack([x[[0, -1]], np.zeros((2, self.n)), self.ends, [q, q]])
        slopes = self.compiled(ends, [np.nan, 0.0])[:, self.n :].reshape(2, self.n, 2 * self.n + 1)
        fast = [i for i in range(self.n) if i not in self.held]
        growth = [np.linalg.eigvals(-J[np.ix_(fast, fast)]).real.max() for J in slopes]
        return bool(growth[0] < 0.0 < growth[1])

    def singularity(self, x: np.ndarray, q: float) -> FoldedSingularity | None:
        """The folded singularity on the limit (k, n), of one fast and one slow variable."""
        given, source = self.given, self.given.source
        if not isinstance(source, SlowFastSystem) or (len(source.fast), len(source.slow)) != (1, 1):
            return None
        s, fast = places(*self.ends, nodes(len(x) - 1)), 1 - self.held[0]
        k = int(np.argmin(np.abs(given.rates(x, s).f_x[:, fast, fast])))
        near = {**dict(zip((z.name for z in given.field.states), x[k])), given.ramp.phase.name: float(s[k])}
        return folded_singularity(along(given, exact(q)), near=near)

    def at(self, x: np.ndarray, q: float, d: float) -> tuple[np.ndarray, float] | None:
        """The smooth solution at d, by Newton's method with least squares."""
        degree, m, n = len(x) - 1, len(x) + 1, self.n
        c = -np.cos(np.pi * (2 * np.arange(m) + 1) / (2 * m))
        values, slopes = matrices(degree, c)
        slopes *= 2.0 / (self.ends[1] - self.ends[0])
        s, before = places(*self.ends, c), np.inf
        for _ in range(40):
            place = np.column_stack([values @ x, slopes @ x, s, np.full(m, q)])
            out = self.compiled(place, [np.nan, d])
            if not np.isfinite(out).all():
                return None
            R, J = out[:, :n], out[:, n:].reshape(m, n, 2 * n + 1)
            blocks = [
                [J[:, i, j, None] * values + J[:, i, n + j, None] * slopes for j in range(n)] for i in range(n)
            ]
            matrix = np.hstack([np.block(blocks), J[:, :, 2 * n].T.reshape(-1, 1)])
            target = R.T.ravel()
            for i in self.held:
                row = np.zeros(matrix.shape[1])
                row[i * (degree + 1)] = 1.0
                matrix, target = np.vstack([matrix, row]), np.append(target, x[0, i] - self.begin.x[i])
            # Rows and columns in units of their own, lest those of one state outweigh another's.
            columns = np.append(
                np.repeat(np.maximum(np.abs(x).max(axis=0), np.finfo(float).tiny), degree + 1), abs(q)
            )
            matrix = matrix * columns
            rows = np.abs(matrix).max(axis=1)
            step = np.linalg.lstsq(matrix / rows[:, None], target / rows, rcond=None)[0] * columns
            x, q = x - step[:-1].reshape(n, degree + 1).T, float(q - step[-1])
            moved = float(np.abs(step / columns).max())
            if moved <= 1e-11 or (before <= 1e-6 and moved >= 0.3 * before):
                return x, q
            before = moved
        return None

    def series(self, x: np.ndarray, q: float, order: int, more: int) -> np.ndarray:
        """Coefficients (order + 1,) of q in d, by interpolation in `more` + 1 values of d on both sides of 0."""
        # The series is interpolated over this share of the d that was found.
        at, reach, values = np.cos(np.pi * (np.arange(more + 1) + 0.5) / (more + 1)), 0.125 * self.small, []
        for share in at:
            here = self.at(x, q, float(reach * share))
            if here is None:
                raise RampError(
                    "a smooth orbit was lost near the limit of slow ramps.", "Start at a smaller rate."
                )
            values.append(here[1])
        power = chebyshev.cheb2poly(chebyshev.chebfit(at, np.array(values), more))
        return power[: order + 1] / reach ** np.arange(order + 1)
