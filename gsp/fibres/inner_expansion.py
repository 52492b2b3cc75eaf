"""The solution through any start, as a series in epsilon at fixed fast time tau = t/epsilon.

    X = x0 + epsilon X_1(tau) + ...,   Y = Y_0(tau) + epsilon Y_1(tau) + ...,
    Y_0' = g(x0, Y_0, 0),   X_k' = [f]_(k-1),   Y_k' = g_y(x0, Y_0, 0) Y_k + (the rest of [g]_k) .

In an attracting layer every coefficient tends to a polynomial in tau, the slow flow seen in fast time; what remains
decays. The polynomial of X_k at tau = 0 is the k-th coefficient of the base point of the fast fibre through the
start, and the decaying parts are the boundary layer (A. B. Vasil'eva, V. F. Butuzov and L. V. Kalachev, The Boundary
Function Method for Singular Perturbation Problems, SIAM, 1995; N. Fenichel, Journal of Differential Equations 31
(1979) 53-98, for the fibres).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from types import MappingProxyType
from typing import Any

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.exponential_polynomials import ExponentialRing, NotClosed
from gsp.algebra.factorisation import lowest_terms
from gsp.algebra.functions import JUMPS, NON_SMOOTH
from gsp.algebra.laurent import laurent
from gsp.algebra.power_series import SeriesEnds, SeriesProgram
from gsp.algebra.ring import read
from gsp.critical.branch import Branch
from gsp.errors import DeclarationError, HyperbolicityError
from gsp.fibres.decaying_signals import Signal
from gsp.fibres.layer_orbit import REFINEMENTS, ROUGH, Landing, land, size_of
from gsp.systems.declaration import exact
from gsp.systems.flow import Point, check_epsilon, check_given, values_by_name
from gsp.systems.system import SlowFastSystem

# The order through which no second derivative of a rate, which a kink makes infinite for an instant, is integrated, and
# that through which no first one is, which a jump of a slow rate does.
ACROSS_KINKS, ACROSS_JUMPS = 2, 1


@dataclass(frozen=True, eq=False, repr=False)
class InnerExpansion:
    """The inner series from `start` through `order`.

    `terms[name][k]` is the coefficient of epsilon^k of a state or reconstruction variable, a function of fast time;
    `is_exact` says whether in rational arithmetic. `direction` is 1, or -1 on a repelling branch, where fast time
    runs backward; `gap` is the least |Re lambda| of g_y where the layer ends. `base[name]` are the coefficients of
    the base point, for slow and reconstruction variables. `ending` says why `order` is lower than the one asked for.
    """

    branch: Branch
    start: Mapping[str, float]
    order: int
    slow: tuple[str, ...]
    terms: Mapping[str, tuple[Any, ...]]
    is_exact: bool
    direction: int
    gap: float
    ending: str = ""

    @property
    def base(self) -> dict[str, tuple[Fraction | float, ...]]:
        """Coefficients of the base point, by name: tuples (order + 1,)."""
        return {
            name: tuple(
                term.outer[0] if self.is_exact else float(term.outer[0])
                for term in self.terms[name][: self.order + 1]
            )
            for name in self.slow
        }

    def require(self, order: int) -> InnerExpansion:
        """The expansion itself; raises `DeclarationError` where it ends before `order`."""
        if order > self.order:
            remedy = f"Ask for order {self.order} at most, or move the start."
            raise DeclarationError(f"{self.ending}.", remedy, got=f"order {order}", limit=self.order)
        return self

    def layer(self, tau, epsilon: float, *, order: int) -> dict[str, np.ndarray]:
        """The decaying parts summed through `order`, as far as they are known, by name, at fast times `tau` (m,)."""
        return self._summed(tau, epsilon, order, lambda term, times: term.decaying(times))

    def matched(self, tau, epsilon: float, *, order: int) -> dict[str, np.ndarray]:
        """The polynomials summed through `order`, by name: the part that the slow flow shares."""
        return self._summed(
            tau, epsilon, order, lambda term, times: np.polyval([float(c) for c in term.outer][::-1], times)
        )

    def _summed(
        self, tau, epsilon: float, order: int, part: Callable[[Any, np.ndarray], np.ndarray]
    ) -> dict[str, np.ndarray]:
        times, small = np.atleast_1d(np.asarray(tau, dtype=float)), check_epsilon(epsilon)
        return {
            name: sum(
                (small**k * part(term, times) for k, term in enumerate(terms[: order + 1])),
                np.zeros(len(times)),
            )
            for name, terms in self.terms.items()
        }

    def expression(self, name: str, k: int, tau: sp.Symbol) -> sp.Expr:
        """The coefficient of epsilon^k as an expression in `tau`; raises `DeclarationError` unless exact."""
        if not self.is_exact:
            raise DeclarationError(
                f"the layer from {dict(self.start)} is not linear with rational rates, so it is known by "
                "samples only.",
                "Use layer() and matched().",
            )
        return self.terms[name][k].to_sympy(tau)

    def __repr__(self) -> str:
        return f"InnerExpansion({', '.join(self.terms)}; order={self.order}, {'exact' if self.is_exact else 'sampled'})"


def expand_inner(
    branch: Branch,
    start: Mapping[str, float] | Point,
    *,
    order: int,
    reconstruction: Mapping[sp.Symbol, sp.Expr] | None = None,
    fast_order: int | None = None,
) -> InnerExpansion:
    """The inner series from `start`, fast variables through `fast_order` (default `order`).

    Exact where g is linear in y at epsilon = 0 with rational eigenvalues and the other functions of y are polynomials;
    else sampled to about 13 digits. `start` names every state; reconstruction variables start at 0 unless named.

    Through a kink of f or g it goes to order 2, fast variables to order 1, and an order less through a jump of f:
    beyond, derivatives that jump act at one instant.

    Raises `BranchError` when the layer leads elsewhere than to `branch`, `HyperbolicityError` on a saddle-type branch
    unless the start is on its stable side at every order asked for, `DeclarationError` where the field is not finite.

    >>> from gsp.fibres.inner_expansion import expand_inner
    >>> x, y, eps = sp.symbols("x y epsilon")
    >>> system = SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=eps)
    >>> inner = expand_inner(solve_critical(system).branches[0], {"x": 1, "y": 3}, order=2)
    >>> inner.expression("y", 0, sp.Symbol("tau")), [str(c) for c in inner.base["x"]]
    (1 + 2*exp(-tau), ['1', '-2', '-3'])
    """
    problem = Problem.declare(branch, start, reconstruction or {})
    deepest = order if fast_order is None else fast_order
    try:
        # The exact route multiplies exponential polynomials out; beyond this order their number of terms costs
        # more than the sampled route, which has no such growth.
        if order <= 6:
            try:
                return _exact(problem, order, deepest)
            except NotClosed:
                pass
        with np.errstate(all="ignore"):
            found = _sampled(problem, order, deepest)
    except ZeroDivisionError:
        raise _not_finite(problem) from None
    if not all(np.isfinite(term.outer).all() for series in found.terms.values() for term in series):
        raise _not_finite(problem)
    return found


def _not_finite(problem: Problem) -> DeclarationError:
    return DeclarationError(
        f"the field is not finite along the layer from {problem.place()}: a division by zero, or a root or "
        "logarithm outside its domain.",
        "Move the start.",
    )


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything with parameter values put in; `direction` -1 has all rates reversed."""

    branch: Branch
    start: dict[str, float]
    driven: tuple[sp.Symbol, ...]
    driven_rates: tuple[sp.Expr, ...]
    direction: int = 1

    @classmethod
    def declare(cls, branch: Branch, start, reconstruction: Mapping[sp.Symbol, sp.Expr]) -> Problem:
        if not isinstance(branch, Branch):
            raise DeclarationError("a Branch is needed here.", got=type(branch).__name__)
        system = branch.system
        given = values_by_name(start, what="start")
        states = [s.name for s in system.states]
        extra = [s.name for s in reconstruction]
        for name in given:
            if name not in states and name not in extra:
                raise DeclarationError.none_of(
                    [*states, *extra], name, f'start names "{name}", which is no state.', "The states are"
                )
        remedy = "A fibre passes through a point of the full state space: give every state a value."
        check_given(given, states, what="start", remedy=remedy)
        values = {name: given[name] for name in states} | {name: given.get(name, 0.0) for name in extra}
        observables = dict(system.observables)
        rates = tuple(sp.sympify(r, strict=True).xreplace(observables) for r in reconstruction.values())
        return cls(branch, values, tuple(reconstruction), rates)

    @property
    def system(self) -> SlowFastSystem:
        return self.branch.system

    def reversed(self) -> Problem:
        system = self.system
        backward = SlowFastSystem(
            slow={x: -rate for x, rate in system.slow.items()},
            fast={y: -rate for y, rate in system.fast.items()},
            epsilon=system.epsilon,
            parameters=system.parameters,
            name=system.name,
        )
        return replace(
            self,
            branch=replace(self.branch, system=backward),
            driven_rates=tuple(-rate for rate in self.driven_rates),
            direction=-self.direction,
        )

    @property
    def slow(self) -> tuple[sp.Symbol, ...]:
        """Slow and reconstruction symbols."""
        return (*self.system.x, *self.driven)

    def put(self, expression: sp.Expr) -> sp.Expr:
        return expression.xreplace(dict(self.system.parameters))

    @property
    def slow_rates(self) -> list[sp.Expr]:
        return [self.put(rate) for rate in (*self.system.f, *self.driven_rates)]

    @property
    def layer_rates(self) -> list[sp.Expr]:
        """g(x, y, 0)."""
        return [self.put(laurent(g, self.system.epsilon, order=0).get(0, sp.Integer(0))) for g in self.system.g]

    def place(self) -> str:
        return self.system.place(self.start)


def _exact(problem: Problem, order: int, deepest: int) -> InnerExpansion:
    system = problem.system
    point = {s: exact(problem.start[s.name]) for s in problem.slow}
    rates = [rate.xreplace(point) for rate in problem.layer_rates]
    slopes = [derivative(rate, y) for rate in rates for y in system.y]
    kinks = {kink for rate in rates for kink in rate.atoms(*NON_SMOOTH) if kink.has(*system.y)}
    # The slope of a sign is 0 on both sides of its jump.
    if kinks or any(_varies(slope, problem) for slope in slopes):
        raise NotClosed
    entries = [lowest_terms(slope) for slope in slopes]
    if any(not entry.is_Rational for entry in entries):
        raise NotClosed
    ring = ExponentialRing(sp.Matrix(len(system.y), len(system.y), entries))
    if 0 in ring.rates:
        raise HyperbolicityError(
            f"the fast Jacobian is singular over the start {problem.place()}: it has no fibre.",
            "Move the start.",
        )
    if all(rate > 0 for rate in ring.rates):
        return _exact(problem.reversed(), order, deepest)
    initial = [Fraction(str(exact(problem.start[y.name]))) for y in system.y]
    constant = [lowest_terms(rate.xreplace(dict.fromkeys(system.y, sp.Integer(0)))) for rate in rates]
    if any(not value.is_Rational for value in constant):
        raise NotClosed
    y0 = ring.fast([ring.constant(value) for value in constant], initial)
    x0 = [ring.constant(point[s]) for s in problem.slow]
    terms, ending = _hierarchy(problem, ring, x0, y0, order, deepest)
    if any(rate > 0 for rate in ring.rates):
        _refuse_growth(problem, terms)
    return _expansion(problem, terms, ending, float(min(map(abs, ring.rates))), is_exact=True)


def _varies(slope: sp.Expr, problem: Problem) -> bool:
    """Whether `slope` has two values at two values of y: then g is not linear, and nothing need be simplified."""
    # As decimals: an exact power such as (p/q)^(17/10) has its integers taken apart into primes.
    here = {y: sp.Float(problem.start[y.name]) for y in problem.system.y}
    beside = {y: value + sp.Rational(k + 1, 7) for k, (y, value) in enumerate(here.items())}
    first, second = (sp.N(slope.xreplace(point)) for point in (here, beside))
    if not (first.is_Float or first.is_Rational) or not (second.is_Float or second.is_Rational):
        return False
    # Two values of a slope that differ by more, relative to both, are two: they are known to 15 digits.
    return bool(abs(first - second) > 1e-9 * (abs(first) + abs(second)))


def _refuse_growth(problem: Problem, terms: Mapping[str, list]) -> None:
    for k in range(max(map(len, terms.values()))):
        for name, series in terms.items():
            if k < len(series) and series[k].growing:
                raise HyperbolicityError(
                    f"the branch {problem.branch} is of saddle type, and the start {problem.place()} is not "
                    f"on its stable side: at order {k} in epsilon {name} grows as exp({series[k].growing} "
                    "tau).",
                    "Stable and unstable fibres have different base points; the stable one exists only for "
                    "starts on the stable manifold. Move the start there.",
                )


def _sampled(problem: Problem, order: int, deepest: int) -> InnerExpansion:
    x, y = (np.array([problem.start[s.name] for s in part]) for part in (problem.system.x, problem.system.y))
    landing = land(problem.branch, x, y)
    if landing.direction < 0:
        problem = problem.reversed()
    when, ending = 0.0, ""
    met, most = ("jump", ACROSS_JUMPS) if landing.jumps else ("kink", ACROSS_KINKS)
    if landing.kinks and order > most:
        order, deepest = most, min(deepest, most - 1)
        time = (landing.jumps or landing.kinks)[0]
        ending = (
            f"the layer from {problem.place()} crosses a {met} of the field at fast time {time:.4g}, past which its "
            f"series is known through order {most}"
        )
    for _ in range(REFINEMENTS):
        terms, reached = _along(problem, landing, order, deepest)
        rough = landing.rough(_felt(problem, terms, landing.gap))
        if not rough.any():
            return _expansion(problem, terms, reached or ending, landing.gap, is_exact=False)
        when = landing.panels.ends[:-1][rough].min()
        if not all(
            np.isfinite(term.samples).all() for s in terms.values() for term in s if term.samples is not None
        ):
            break
        landing = landing.halved(rough)
    raise DeclarationError(
        f"the field is singular, or not smooth, along the layer from {problem.place()}, near fast time "
        f"{when:.4g}: the fast motion passes a pole, a kink or a jump of f or g.",
        "Start on the other side of it.",
    )


def _felt(problem: Problem, terms: Mapping[str, list[Signal]], gap: float) -> Iterator[Signal]:
    """The terms whose layer is more than what rounding leaves of zero, beside the others of their order, in units."""
    states = [s.name for s in problem.system.states]
    units = dict(zip(states, problem.branch.units or [1.0] * len(states)))
    for k in range(max(map(len, terms.values()))):
        own = {name: series[k] for name, series in terms.items() if k < len(series)}
        # Polynomials in fast time too, over the time that the layer takes.
        whole = max(
            np.abs(term.outer / gap ** np.arange(len(term.outer))).max(initial=size_of(term))
            / units.get(name, 1.0)
            for name, term in own.items()
        )
        yield from (t for name, t in own.items() if not size_of(t) / units.get(name, 1.0) <= ROUGH * whole)


def _along(problem: Problem, landing: Landing, order: int, deepest: int) -> tuple[dict[str, list], str]:
    """As `_hierarchy`, over the panels of `landing`."""
    system = problem.system
    # g_y along the layer in the arithmetic that keeps small differences small.
    ring = landing.ring()
    environment: dict[sp.Symbol, Any] = {s: ring.constant(problem.start[s.name]) for s in problem.slow}
    environment |= dict(zip(system.y, landing.signals(ring)))
    entries = [
        [read(derivative(rate, s), ring, environment) for s in system.y]  # pyright: ignore[reportArgumentType]
        for rate in problem.layer_rates
    ]
    ring = landing.ring(entries)
    x0 = [ring.constant(problem.start[s.name]) for s in problem.slow]
    return _hierarchy(problem, ring, x0, landing.signals(ring), order, deepest)


def _hierarchy(
    problem: Problem, ring: Any, x0: list, y0: list, order: int, deepest: int
) -> tuple[dict[str, list], str]:
    """The coefficients X_0..X_order and Y_0..Y_deepest over `ring`, by name, and why they end before, if they do.

    Where a rate has no power series from epsilon^k on, they are X_0..X_k and Y_0..Y_(k-1).
    """
    system = problem.system
    X: list[list[Any]] = [[value] for value in x0]
    Y: list[list[Any]] = [[value] for value in y0]
    program = SeriesProgram(
        ring, epsilon=system.epsilon, inputs=dict(zip((*problem.slow, *system.y), [*X, *Y])), constants={}
    )
    f = [program.compile(rate) for rate in problem.slow_rates]
    g = [program.compile(problem.put(rate)) for rate in system.g]
    ending = ""
    program.extend(0)
    for k in range(1, order + 1):
        for series, rate in zip(X, f):
            series.append(ring.slow(rate.coefficients[k - 1], 0))
        if k > deepest:
            break
        for series in Y:
            series.append(ring.zero)
        try:
            # With Y_k = 0 the program gives what the other terms contribute to [g]_k.
            program.extend(k)
            for series, value in zip(Y, ring.fast([rate.coefficients[k] for rate in g], [0] * len(Y))):
                series[k] = value
            program.extend(k)
        except SeriesEnds as error:
            # On a jump not even order 0 is known, for what is taken there is neither side's.
            if any(rate.atoms(*JUMPS) for rate in (*problem.slow_rates, *system.g)):
                raise
            ending = f"the series of the layer from {problem.place()} is known through order {k}: {error.fact}"
            for series in Y:
                del series[k:]
            break
    return {s.name: series for s, series in zip((*problem.slow, *system.y), [*X, *Y])}, ending


def _expansion(
    problem: Problem, terms: Mapping[str, list], ending: str, gap: float, *, is_exact: bool
) -> InnerExpansion:
    slow = tuple(s.name for s in problem.slow)
    return InnerExpansion(
        branch=problem.branch,
        start=MappingProxyType(problem.start),
        order=len(terms[slow[0]]) - 1,
        slow=slow,
        terms=MappingProxyType({name: tuple(series) for name, series in terms.items()}),
        is_exact=is_exact,
        direction=problem.direction,
        gap=gap,
        ending=ending,
    )
