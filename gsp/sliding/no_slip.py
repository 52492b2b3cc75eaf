"""Does no-slip hold here? The multipliers of the constraints along a run, against what friction bears."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError, Status
from gsp.integration.events import Event
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_function import compile_function
from gsp.proofs.ball_functions import BallFunction
from gsp.results.drawn import Drawn
from gsp.results.table import Names
from gsp.results.tabular import Tabular
from gsp.roots import root
from gsp.sliding.between import enclosed, run_to_event
from gsp.sliding.law import LawEndKind, SwitchLaw
from gsp.systems.flow import Point, Values, check_epsilon, in_words, values_by_name
from gsp.systems.system import VectorField
from gsp.systems.tolerances import absolute_tolerance

# Runs are looked at so often in each step; a start slips above this share of its fastest velocity.
BETWEEN, SLIPPING = 8, 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class NoSlip(Drawn, Tabular):
    """Whether no contact slips along the `run` of the constrained system, and how near each comes to it.

    `shares` (contacts, m) at the times `t` (m,) are what each contact is asked for of what it bears before it slips:
    |lambda| over mu N, 1 where it lets go on the way, and more where it does not hold from the start. Where one lets
    go, `loss` says how, `contact` which, `time` when and `place` where; those are None where no-slip holds. `names` are
    the contacts' slip velocities, and `observed` what of the run gives their loads and their reaches, see `Contacts`.
    Where not `is_clear`, enclosures leave room for a strip, passed between the times, in which a contact lets go.
    """

    run: Trajectory
    t: np.ndarray
    shares: np.ndarray
    names: tuple[str, ...]
    law: SwitchLaw
    loss: LossKind | None = None
    contact: int | None = None
    time: float | None = None
    place: Mapping[str, float] | None = None
    observed: tuple[tuple[str, str], ...] = ()
    is_clear: bool = True

    @property
    def holds(self) -> bool:
        """Whether no contact slips from the start to the end of the run."""
        return self.loss is None and self.run.status.ok

    def creep(self, epsilon: float) -> np.ndarray:
        """How fast each contact creeps at the times `t`, (contacts, m): epsilon phi^-1 of its share where mu is the
        same in all directions.
        """
        return self._creep(epsilon, self.t)

    def _creep(self, epsilon: float, t: np.ndarray, *, most: float = np.inf) -> np.ndarray:
        """The same at any times, with shares of `most` where they are larger."""
        small, high = check_epsilon(epsilon), _bears(self.law)
        phi = compile_function(
            (self.law.expression,), arguments=(self.law.symbol,), epsilon=None, parameters=()
        )
        constants = np.array([np.nan])

        def slip(share: float) -> float:
            def gap(w: float) -> float:
                return float(phi(np.array([w]), constants)[0]) - share * high

            end = min(self.law.upper.place, self.law.lower.place)
            if share >= 1.0:
                return end
            wide = float(self.law.unit)
            while wide < end and gap(wide) < 0.0:
                wide *= 2.0
            found = root(gap, 0.0, min(wide, end))
            return np.nan if found is None else found

        seen = self.run.sample(t)
        speeds = []
        for load, reach in self.observed:
            size = np.sqrt(seen[load])
            with np.errstate(invalid="ignore"):
                stretch = np.where(size > 0.0, np.sqrt(seen[reach]) / size, 1.0)
            speeds.append([slip(float(share)) for share in np.minimum(size / high, most)] * stretch)
        return small * np.array(speeds)

    def distance(self, epsilon: float) -> np.ndarray:
        """How far each contact has crept at the end (contacts,): the integral of `creep`.

        Where a contact lets go its speed grows as 1/sqrt(T - t), and so it is summed over sqrt(T - t), by Gauss's rule.
        Intervals are halved until their halves tell no more twice in a row: about a time at which a contact is asked
        for nothing they agree once by chance.
        """
        end = float(self.t[-1])
        edges = np.sqrt(end - self.run.t[self.run.t <= end])
        low, high, total = edges[1:], edges[:-1], np.zeros(len(self.names))
        if not low.size:
            return total
        whole = self._crept(epsilon, end, low, high)
        least = np.sqrt(np.finfo(float).eps) * whole.sum(axis=1, keepdims=True)
        agreed = np.zeros(low.size, dtype=bool)
        while low.size:
            middle = 0.5 * (low + high)
            lower, upper = self._crept(epsilon, end, low, middle), self._crept(epsilon, end, middle, high)
            agrees = (np.abs(lower + upper - whole) <= least).all(axis=0)
            open_ = ~(agrees & agreed) & (low < middle) & (middle < high)
            total += (lower + upper)[:, ~open_].sum(axis=1)
            low = np.append(low[open_], middle[open_])
            high = np.append(middle[open_], high[open_])
            whole = np.append(lower[:, open_], upper[:, open_], axis=1)
            agreed = np.tile(agrees[open_], 2)
        return total

    def _crept(self, epsilon: float, end: float, low: np.ndarray, high: np.ndarray) -> np.ndarray:
        """How far each contact creeps (contacts, m) while sqrt(end - t) is between `low` and `high` (m,)."""
        nodes, weights = np.polynomial.legendre.leggauss(BETWEEN)
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        z = middle[:, None] + half[:, None] * nodes
        # A step that ends where a contact lets go may be so short that shares are 1 to rounding all over it.
        speeds = self._creep(epsilon, end - z.ravel() ** 2, most=1.0 - np.finfo(float).eps)
        return (speeds.reshape(-1, *z.shape) * (2.0 * z * half[:, None] * weights)).sum(axis=2)

    def __repr__(self) -> str:
        answer = "holds" if self.holds else "fails" if self.loss else "open"
        return f"NoSlip({answer}, largest share {self.shares.max():.4g})"

    @property
    def _asked(self) -> str:
        """For how much the contact that lets go is asked there."""
        share = float(self.shares[self.contact, -1])
        return f"{share:.4g} times what it bears" if share > 1.0 + SLIPPING else "all that it bears"

    def __str__(self) -> str:
        if self.loss is not None:
            assert self.contact is not None
            assert self.place is not None
            where = in_words(self.place)
            return (
                f"No-slip fails at t = {self.time:.8g}, where {where}: the contact of {self.names[self.contact]} "
                f"is asked for {self._asked} ({self.loss}). From there on it slips."
            )
        contact, k = np.unravel_index(int(self.shares.argmax()), self.shares.shape)
        share = f"{self.shares[contact, k]:.4g}"
        most = f"the contact of {self.names[contact]} is asked for {share} of what it bears at most"
        if not self.run.status.ok:
            return f"No-slip is open: {self.run.message}. Until then {most}."
        beside = (
            ""
            if self.is_clear
            else " That one lets go in a narrow strip between two such times is not excluded."
        )
        return f"No-slip holds over t = {self.t[0]:.6g} to {self.t[-1]:.6g}: {most}, at t = {self.t[k]:.6g}.{beside}"


@dataclass(frozen=True)
class Contacts:
    """What contacts bear along the runs of the constrained system `field`, and the `law` by which they let go.

    `loads` are the squares of the shares that no-slip takes of each contact's cone, `reaches` those of the slips by
    which a law with the slope 1 would bear them, `grips` mu times the normal forces, in states of the field; `slips`
    name the slip velocities of each contact, `along` the other velocities.
    """

    field: VectorField
    loads: tuple[sp.Expr, ...]
    reaches: tuple[sp.Expr, ...]
    grips: tuple[sp.Expr, ...]
    slips: tuple[tuple[str, ...], ...]
    along: tuple[str, ...]
    law: SwitchLaw

    def with_parameters(self, values: Values) -> Contacts:
        """The same at other values of parameters."""
        own = {p.name: value for p, value in values.items() if p in self.field.parameters}
        return replace(self, field=self.field.with_parameters(**own)) if own else self

    def no_slip(self, *, start: Point, span: tuple[float, float]) -> NoSlip:
        """Whether no contact slips along the run from `start`, up to where one does.

        Slips among the values of `start` have to be 0. Raises `DeclarationError` for a start that slips, for a contact
        that nothing presses there, and for a law that bears more on one side than on the other.
        """
        given = values_by_name(start, what="start")
        slips = {w: given.pop(w, 0.0) for names in self.slips for w in names}
        check_sticks(slips, {name: value for name, value in given.items() if name in self.along})
        if abs(self.law.upper.value - self.law.lower.value) > SLIPPING * self.law.upper.value:
            raise DeclarationError(
                f"the law bears {self.law.upper.value:.6g} on one side and {self.law.lower.value:.6g} on the other, "
                "and shares are of what is borne on both.",
                "Run the system (`run`), which tells the sides apart.",
            )
        at = {s: sp.Float(given[s.name]) for s in self.field.states} | dict(self.field.parameters)
        for names, grip in zip(self.slips, self.grips):
            value = float(grip.xreplace(at))
            if not value > 0.0:
                raise DeclarationError(
                    f"the contact of {', '.join(names)} bears nothing at the start: mu N is {value:.6g}.",
                    "Start where it presses, with friction that resists.",
                    value=value,
                )
        states = {s.name for s in self.field.states}
        return self._watched({name: value for name, value in given.items() if name in states}, span)

    @cached_property
    def _flow(self) -> tuple[VectorField, tuple[tuple[str, str], ...]]:
        """The field with loads and reaches among its observables, and what those of each contact are called."""
        field = self.field
        free = Names(s.name for s in (*field.states, *field.parameters))
        pairs = [(free(f"load_{i + 1}"), free(f"reach_{i + 1}")) for i in range(len(self.loads))]
        observed = {
            sp.Symbol(name): e
            for names, es in zip(pairs, zip(self.loads, self.reaches))
            for name, e in zip(names, es)
        }
        return VectorField(
            field.equations, parameters=field.parameters, name=field.name, observables=observed
        ), tuple(pairs)

    @cached_property
    def _events(self) -> tuple[list[Event], list[BallFunction] | None]:
        """Where a contact lets go, or nothing presses it any more, and the same in balls."""
        square = sp.Rational(str(_bears(self.law))) ** 2
        events = [
            Event(load - square, direction=1, terminal=True, name=f"{i}") for i, load in enumerate(self.loads)
        ]
        events += [
            Event(grip, direction=-1, terminal=True, name=f"{i}.")
            for i, grip in enumerate(self.grips)
            if not grip.free_symbols.isdisjoint(self.field.states)
        ]
        return events, enclosed(self.field, events)

    def _watched(self, values: dict[str, float], span: tuple[float, float]) -> NoSlip:
        field, law = self.field, self.law
        flow, observed = self._flow
        high = _bears(law)
        events, functions = self._events
        rtol = 1e-11
        atol = absolute_tolerance(rtol, {}, values)
        run, is_clear = run_to_event(
            flow, start=values, span=span, rtol=rtol, atol=atol, events=events, functions=functions
        )
        t = run.t[:1]
        if run.t.size > 1:
            inner = np.arange(BETWEEN) / BETWEEN
            t = np.append((run.t[:-1, None] + np.diff(run.t)[:, None] * inner).ravel(), run.t[-1])
        seen = run.sample(t)
        shares = np.sqrt(np.array([seen[load] for load, _ in observed])) / high
        names = tuple(", ".join(slips) for slips in self.slips)
        kind = LossKind.SLIP_ONSET if law.upper.kind is LawEndKind.PEAK else LossKind.CONE_END
        over = np.flatnonzero(shares[:, 0] >= 1.0)
        if over.size:
            first = MappingProxyType(values)
            return NoSlip(
                run, t[:1], shares[:, :1], names, law, kind, int(over[0]), float(t[0]), first, observed
            )
        if run.status is not Status.EVENT_REACHED:
            return NoSlip(run, t, shares, names, law, observed=observed, is_clear=is_clear)
        met = next(name for name, found in run.events.items() if len(found.times))
        place = {s.name: float(run[s.name][-1]) for s in field.states}
        last = MappingProxyType(place)
        return NoSlip(run, t, shares, names, law, kind, int(met.rstrip(".")), float(run.t[-1]), last, observed)


def check_sticks(slips: Mapping[str, float], others: Mapping[str, float]) -> None:
    """Raise `DeclarationError` for slip velocities that are none beside the other velocities of a start."""
    fastest = max((abs(value) for value in others.values()), default=0.0)
    for name, value in slips.items():
        if abs(value) > SLIPPING * fastest:
            raise DeclarationError(
                f"the start slips: {name} = {value:.6g}.",
                "Ask whether no-slip holds from a start without slip.",
                value=value,
            )


def _bears(law: SwitchLaw) -> float:
    """How much of mu N a contact bears before it slips: 1, or the maximum of a law that overshoots."""
    return min(law.upper.value, law.lower.value)
