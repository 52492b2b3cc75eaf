"""The time scales of a flow along a run, and how many of them are exhausted: computational singular perturbation.

At each time the modes of the Jacobian, fastest first, z' = sum_r a_r (b^r . F). The first M of them are exhausted where
all that they do in the time scale of the next is within the tolerance (Lam and Goussis 1989),

    |sum_(r <= M) a_r (b^r . F) tau_(M+1)| < rtol |z| + atol    in each state.                                    (1)

Beside a clock, whose rate no state moves, no tau but those of conserved sums is longer than the run: a clock has no
other.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError, Status
from gsp.integration.trajectory import PLAIN, RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.scales.conservation import Reactions, conserved_by, reactions_of
from gsp.scales.modes import Modes, ends_of, modes_of
from gsp.systems.arguments import check_flag, check_noun, check_positive, check_progress
from gsp.systems.flow import Flow, Point, Portable, Question, frozen, values_by_name
from gsp.systems.region import Interval
from gsp.systems.tolerances import RTOL, absolute_tolerance

# Products of a matrix that the times may take at which a flow is looked at.
PRODUCTS = 5e8


@dataclass(frozen=True, eq=False, repr=False)
class TimeScales(Portable, Drawn, Tabular):
    """Rates and modes along a run at `t` (k,): `rates` (k, n), complex, fastest first; those of conserved sums are 0.

    `exhausted` (k,) is how many modes are exhausted, `gap` (k,) the ratio of the slowest of them to the next, 1 where
    none is. `pointers` (k, n modes, n states) say how much each state moves with each mode: for each state they add up
    to 1. `groups` (k, n) number the modes that are one subspace: complex pairs, repeated rates, what is conserved.
    """

    run: Trajectory
    t: np.ndarray
    states: np.ndarray
    """z (k, n)."""
    rates: np.ndarray
    groups: np.ndarray
    exhausted: np.ndarray
    gap: np.ndarray
    pointers: np.ndarray
    right: np.ndarray
    """a_r (k, n modes, n states)."""
    left: np.ndarray
    """b^r (k, n modes, n states)."""
    conserved: tuple[sp.Expr, ...]

    @property
    def flow(self) -> Flow:
        """What was run."""
        return self.run.flow

    @property
    def status(self) -> Status:
        """How the run ended."""
        return self.run.status

    @cached_property
    def times(self) -> np.ndarray:
        """tau_r = 1/|lambda_r| (k, n), infinite for conserved sums; beside a clock the others are at most the run's."""
        return frozen(_times(self.run, self.rates, len(self.conserved)))

    @cached_property
    def separated(self) -> np.ndarray:
        """How many modes (k,) are exhausted and at least ten times as fast as the next."""
        found = np.zeros(len(self.t), dtype=int)
        tau = self.times
        for i, most in enumerate(self.exhausted):
            ends = ends_of(self.groups[i])
            # Neighbouring rates that are further apart than this are two time scales: a reduction to leading
            # order is off by about the reciprocal.
            wide = [m for m in ends[ends <= most] if m < tau.shape[1] and tau[i, m] >= 10.0 * tau[i, m - 1]]
            found[i] = max(wide, default=0)
        return frozen(found)

    @cached_property
    def separates_from(self) -> float | None:
        """The time from which on to the end some modes are exhausted and ten times as fast; None if there is none."""
        without = np.flatnonzero(self.separated == 0)
        first = 0 if not without.size else int(without[-1]) + 1
        return None if first >= len(self.t) else float(self.t[first])

    @cached_property
    def fast_shares(self) -> np.ndarray:
        """How much of each state (k, n) lies in the modes that are separated: sums of pointers."""
        inside = np.arange(self.rates.shape[1]) < self.separated[:, None]
        return frozen(np.einsum("kr,kri->ki", inside.astype(float), self.pointers))

    @cached_property
    def reactions(self) -> Reactions:
        """The terms of the rates, z' = S R: what `participation` and `importance` are shared among."""
        return reactions_of(self.flow.rates)

    @cached_property
    def participation(self) -> np.ndarray:
        """P^r_k (k times, n modes, reactions): the share of each reaction in what drives or brakes a mode.

        b^r . S_k R_k over the sum of all their moduli (Lam and Goussis 1994). In a group of modes, whose vectors are
        arbitrary, the norm of what the group moves by each reaction, in units of the largest |z| of each state.
        """
        moved = self._moved
        found = np.zeros((len(self.t), self.rates.shape[1], moved.shape[2]))
        units = np.abs(self.states).max(axis=0)
        units = np.where(units > 0.0, units, 1.0)
        for i, (groups, left, right) in enumerate(zip(self.groups, self.left, self.right)):
            amplitudes = left @ moved[i]
            for group in range(groups[-1] + 1):
                inside = groups == group
                if inside.sum() > 1:
                    projected = right[inside].T @ amplitudes[inside]
                    amplitudes[inside] = np.linalg.norm(projected / units[:, None], axis=0)
            found[i] = _shares(amplitudes)
        return frozen(found)

    def importance(self, *, fast: bool = False) -> np.ndarray:
        """I^i_k (k times, n states, reactions): the share of each reaction in the slow rate of a state.

        [sum_s a_s b^s . S_k R_k]^i over the sum of all their moduli, s over the modes that are not exhausted, or with
        `fast` over those that are (Valorani and others 2006).
        """
        inside = np.arange(self.rates.shape[1]) < self.exhausted[:, None]
        chosen = (inside if check_flag(fast, what="fast") else ~inside).astype(float)
        projected = np.einsum("ti,tia,tib,tbk->tak", chosen, self.right, self.left, self._moved, optimize=True)
        return frozen(_shares(projected))

    @cached_property
    def _moved(self) -> np.ndarray:
        """S_k R_k (times, n, reactions)."""
        values = compile_over(self.flow, self.reactions.rates)(
            np.ascontiguousarray(self.states), compile_flow(self.flow).parameters(self.run.epsilon)
        )
        return self.reactions.matrix * values[:, None, :]

    def fast(self, i: int) -> tuple[str, ...]:
        """Names of the states that move most with the separated modes at `t[i]`, as many as there are such modes."""
        order = np.argsort(-self.fast_shares[i], kind="stable")[: self.separated[i]]
        return tuple(self.flow.states[j].name for j in sorted(order))

    @property
    def message(self) -> str:
        """One or two sentences: whether there are several time scales, from when on, and what is fast."""
        start = self.separates_from
        if start is None:
            some = np.flatnonzero(self.separated)
            if not some.size:
                return "No separation: no exhausted modes are ten times as fast as the rest."
            return (
                f"No lasting separation: modes are exhausted and ten times as fast as the rest at {some.size} of "
                f"{len(self.t)} times, and not at the end."
            )
        counts = self.separated[self.t >= start] if self.t[-1] >= self.t[0] else self.separated[self.t <= start]
        least = int(counts.min())
        i = len(self.t) - 1
        gap = float(self.times[i, self.separated[i]] / self.times[i, self.separated[i] - 1])
        ratio = (
            "by any factor: nothing else moves"
            if not np.isfinite(gap)
            else f"{gap:.3g} times as fast as the rest"
        )
        return (
            f"From t = {start:.3g} on at least {least} of {self.rates.shape[1]} modes {'is' if least == 1 else 'are'} "
            f"exhausted; at the end {self.separated[i]}, {ratio}. Fast there: {', '.join(self.fast(i))}."
        )

    def __repr__(self) -> str:
        return f"TimeScales({len(self.t)} times, {self.rates.shape[1]} modes, exhausted {self.exhausted.max()} at most)"

    def __str__(self) -> str:
        rows = [f"{'t':>10}  {'exhausted':>9}  {'gap':>9}  time scales"]
        for i in np.unique(np.linspace(0, len(self.t) - 1, 8).round().astype(int)):
            tau = "  ".join(f"{value:.2e}" for value in self.times[i, :6])
            more = "  ..." if self.times.shape[1] > 6 else ""
            rows.append(f"{self.t[i]:>10.4g}  {self.exhausted[i]:>9}  {self.gap[i]:>9.3g}  {tau}{more}")
        if self.conserved:
            rows.append(f"Conserved: {', '.join(map(str, self.conserved))}.")
        if not self.status.ok:
            rows.append(f"The run ended early. {self.run.message}")
        return "\n".join([*rows, self.message])


def time_scales(
    flow: Flow | Question,
    *,
    start: Point | None = None,
    span: tuple[float, float] | None = None,
    epsilon: float | None = None,
    rtol: float = 0.1,
    at: ArrayLike | None = None,
    progress: Callable[[float], object] | None = None,
) -> TimeScales:
    """The time scales of `flow`, or of a `Scene`, along the run from `start` over `span`.

    Modes count as exhausted by equation (1) with `rtol`, and for atol with its square times the largest |z| of each
    state along the run; they must decay, and neither complex pairs nor repeated rates are divided. A reduction that
    leaves them out is off by about `rtol`, since modes turn as the state moves: a smaller one finds them exhausted
    later, or not at all. `at` are times to look at; without them some 200 are spread over the steps of the run, which
    follow its layers, and fewer for hundreds of states. Raises `DeclarationError` for arguments that are not well
    formed.

    >>> x, y = sp.symbols("x y")
    >>> from gsp import VectorField
    >>> field = VectorField({x: -x, y: -100*(y - x)})
    >>> int(time_scales(field, start={"x": 1, "y": 0}, span=(0, 1)).exhausted[-1])
    1
    """
    region: Mapping[str, Interval] = {}
    if isinstance(flow, Question):
        region = flow.region
        flow, start, span, epsilon = flow.setting(start, span, epsilon)
    check_noun(flow, Flow, verb="time_scales")
    if start is None or span is None:
        missing = "start" if start is None else "span"
        raise DeclarationError(f"{missing} is missing.", "Only a Scene has one of its own.", got="None")
    rtol = check_positive(rtol, what="rtol")
    check_progress(progress)
    show = progress or (lambda share: None)
    options = PLAIN if progress is None else RunOptions(progress=lambda share: show(share / 2))
    atol = absolute_tolerance(RTOL, region, values_by_name(start, what="start"))
    run = trajectory_of(flow, start, span, epsilon, RTOL, atol, at, options)
    n = len(flow.states)
    if at is None:
        count = int(np.clip(PRODUCTS / n**3, 16, 200))
        t = np.interp(np.linspace(0, len(run.t) - 1, count), np.arange(len(run.t)), run.t)
        states = run.at(t).T
    else:
        t, states = run.t, run.y.T
    compiled = compile_flow(flow)
    p = compiled.parameters(epsilon)
    states = np.ascontiguousarray(states)
    forces, jacobians = compiled.rates(states, p), compiled.jacobians(states, p)
    usable = np.isfinite(forces).all(axis=1) & np.isfinite(jacobians).all(axis=(1, 2))
    if not usable.any():
        bad = np.argwhere(~np.isfinite(jacobians[0]))
        names = [[flow.states[k].name for k in pair] for pair in bad[:1]]
        what = "the rates are" if not names else "the derivative of the rate of {} by {} is".format(*names[0])
        raise DeclarationError(
            f"The field and its Jacobian are finite at no time of the run; at the start {what} not.",
            "Start where they are, or look at a shorter span.",
            got=f"{usable.size} times",
        )
    t, states, forces, jacobians = t[usable], states[usable], forces[usable], jacobians[usable]
    coordinates, laws = conserved_by(flow, epsilon)
    largest = np.abs(states).max(axis=0)
    sizes = np.where(largest > 0.0, largest, 1.0)
    tolerance = rtol * np.abs(states) + rtol**2 * largest
    found: list[Modes] = []
    for i, jacobian in enumerate(jacobians):
        show((1 + i / len(jacobians)) / 2)
        found.append(modes_of(jacobian, coordinates, sizes))
    rates = np.array([modes.rates for modes in found])
    times = _times(run, rates, len(laws))
    exhausted = [_exhausted(*given) for given in zip(found, times, forces, tolerance)]
    return TimeScales(
        run=run,
        t=frozen(t),
        states=frozen(states),
        rates=frozen(rates),
        groups=frozen(np.array([modes.groups for modes in found])),
        exhausted=frozen(np.array(exhausted)),
        gap=frozen(np.array([_gap(tau, m) for tau, m in zip(times, exhausted)])),
        pointers=frozen(np.array([modes.pointers for modes in found])),
        right=frozen(np.array([modes.right.T for modes in found])),
        left=frozen(np.array([modes.left for modes in found])),
        conserved=laws,
    )


def _times(run: Trajectory, rates: np.ndarray, conserved: int) -> np.ndarray:
    """tau_r (k, n) of rates whose last ones are those of conserved sums."""
    with np.errstate(divide="ignore"):
        tau = 1.0 / np.abs(rates)
    if any(rate != 0 and rate.free_symbols.isdisjoint(run.flow.states) for rate in run.flow.rates):
        moving = slice(tau.shape[1] - conserved)
        tau[:, moving] = np.minimum(tau[:, moving], np.ptp(run.t))
    return tau


def _exhausted(modes: Modes, tau: np.ndarray, force: np.ndarray, tolerance: np.ndarray) -> int:
    """The largest M with (1), all of whose modes decay and whose next one moves."""
    amplitudes = modes.left @ force
    moved = np.abs(np.cumsum(modes.right * amplitudes, axis=1))
    best = 0
    for m in modes.ends[:-1]:
        if np.real(modes.rates[m - 1]) >= 0.0:
            break
        if np.isfinite(tau[m]) and (moved[:, m - 1] * tau[m] < tolerance).all():
            best = int(m)
    return best


def _shares(amounts: np.ndarray) -> np.ndarray:
    """Over the sum of the moduli along the last axis, 0 where that is."""
    total = np.abs(amounts).sum(axis=-1, keepdims=True)
    return np.divide(amounts, total, out=np.zeros_like(amounts), where=total > 0.0)


def _gap(tau: np.ndarray, m: int) -> float:
    return float(tau[m] / tau[m - 1]) if m else 1.0
