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
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_function import compile_function
from gsp.results.drawn import Drawn
from gsp.results.table import Names
from gsp.results.tabular import Tabular
from gsp.roots import root
from gsp.sliding.law import LawEndKind, SwitchLaw
from gsp.systems.flow import Point, Values, check_epsilon, values_by_name
from gsp.systems.system import VectorField

# Runs are looked at so often in each step, an even number; a start slips above this share of its fastest velocity.
BETWEEN, SLIPPING = 8, 1e-9
RTOL, ATOL = 1e-11, 1e-13


@dataclass(frozen=True, eq=False, repr=False)
class NoSlip(Drawn, Tabular):
    """Whether no contact slips along the `run` of the constrained system, and how near each comes to it.

    `shares` (contacts, m) at the times `t` (m,) are what each contact bears of what it can before it slips: |lambda|
    over mu N, and 1 where it lets go. Where one does, `loss` says how, `contact` which, `time` when and `place` where;
    those are None where no-slip holds. `names` are the contacts' slip velocities.
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

    @property
    def holds(self) -> bool:
        """Whether no contact slips from the start to the end of the run."""
        return self.loss is None and self.run.status.ok

    def creep(self, epsilon: float) -> np.ndarray:
        """How fast each contact creeps at the times `t`, (contacts, m): epsilon phi^-1 of its share."""
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
            wide = 1.0
            while wide < end and gap(wide) < 0.0:
                wide *= 2.0
            found = root(gap, 0.0, min(wide, end))
            return np.nan if found is None else found

        return small * np.array([[slip(float(share)) for share in row] for row in self.shares])

    def distance(self, epsilon: float) -> np.ndarray:
        """How far each contact has crept at the end (contacts,): the integral of `creep`, by Simpson's rule."""
        speeds = self.creep(epsilon)
        weights = np.zeros(self.t.size)
        for first in range(0, self.t.size - 1, 2):
            weights[first : first + 3] += np.array([1.0, 4.0, 1.0]) * (self.t[first + 2] - self.t[first]) / 6.0
        return speeds @ weights

    def __repr__(self) -> str:
        answer = "holds" if self.holds else "fails" if self.loss else "open"
        return f"NoSlip({answer}, largest share {self.shares.max():.4g})"

    def __str__(self) -> str:
        if self.loss is not None:
            assert self.contact is not None
            assert self.place is not None
            where = ", ".join(f"{name} = {value:.6g}" for name, value in self.place.items())
            return (
                f"No-slip fails at t = {self.time:.8g}, where {where}: the contact of {self.names[self.contact]} "
                f"is asked for all that it bears ({self.loss}). From there on it slips."
            )
        contact, k = np.unravel_index(int(self.shares.argmax()), self.shares.shape)
        share = f"{self.shares[contact, k]:.4g}"
        most = f"the contact of {self.names[contact]} is asked for {share} of what it bears at most"
        if not self.run.status.ok:
            return f"No-slip is open: {self.run.message}. Until then {most}."
        return f"No-slip holds over t = {self.t[0]:.6g} to {self.t[-1]:.6g}: {most}, at t = {self.t[k]:.6g}."


@dataclass(frozen=True)
class Contacts:
    """What contacts bear along the runs of the constrained system `field`, and the `law` by which they let go.

    `loads` are the squares of the shares that no-slip takes of what each contact bears, `normals` the normal forces,
    both in states of the field; `slips` name the slip velocities of each contact.
    """

    field: VectorField
    loads: tuple[sp.Expr, ...]
    normals: tuple[sp.Expr, ...]
    slips: tuple[tuple[str, ...], ...]
    law: SwitchLaw

    def with_parameters(self, values: Values) -> Contacts:
        """The same at other values of parameters."""
        own = {p.name: value for p, value in values.items() if p in self.field.parameters}
        return replace(self, field=self.field.with_parameters(**own)) if own else self

    def no_slip(self, *, start: Point, span: tuple[float, float]) -> NoSlip:
        """Whether no contact slips along the run from `start`, up to where one does.

        Slips among the values of `start` have to be 0. Raises `DeclarationError` for a start that slips.
        """
        given = values_by_name(start, what="start")
        check_sticks({w: given.pop(w, 0.0) for names in self.slips for w in names}, given)
        states = {s.name for s in self.field.states}
        return self._watched({name: value for name, value in given.items() if name in states}, span)

    @cached_property
    def _flow(self) -> tuple[VectorField, list[sp.Symbol]]:
        """The field with the loads among its observables, and what they are called."""
        field = self.field
        free = Names(s.name for s in (*field.states, *field.parameters))
        symbols = [sp.Symbol(free(f"load_{i + 1}")) for i in range(len(self.loads))]
        loads = dict(zip(symbols, self.loads))
        return VectorField(
            field.equations, parameters=field.parameters, name=field.name, observables=loads
        ), symbols

    def _watched(self, values: dict[str, float], span: tuple[float, float]) -> NoSlip:
        field, law = self.field, self.law
        flow, symbols = self._flow
        high = _bears(law)
        square = sp.Rational(str(high)) ** 2
        events = [
            Event(load - square, direction=1, terminal=True, name=f"{i}") for i, load in enumerate(self.loads)
        ]
        events += [
            Event(normal, direction=-1, terminal=True, name=f"{i}.")
            for i, normal in enumerate(self.normals)
            if not normal.free_symbols.isdisjoint(field.states)
        ]
        run = trajectory_of(
            flow, start=values, span=span, rtol=RTOL, atol=ATOL, options=RunOptions(events=events)
        )
        t = run.t[:1]
        if run.t.size > 1:
            inner = np.arange(BETWEEN) / BETWEEN
            t = np.append((run.t[:-1, None] + np.diff(run.t)[:, None] * inner).ravel(), run.t[-1])
        seen = run.sample(t)
        shares = np.sqrt(np.array([seen[symbol.name] for symbol in symbols])) / high
        names = tuple(", ".join(slips) for slips in self.slips)
        kind = LossKind.SLIP_ONSET if law.upper.kind is LawEndKind.PEAK else LossKind.CONE_END
        over = np.flatnonzero(shares[:, 0] >= 1.0)
        if over.size:
            return NoSlip(run, t, shares, names, law, kind, int(over[0]), float(t[0]), MappingProxyType(values))
        if run.status is not Status.EVENT_REACHED:
            return NoSlip(run, t, shares, names, law)
        met = next(name for name, found in run.events.items() if len(found.times))
        place = {s.name: float(run[s.name][-1]) for s in field.states}
        return NoSlip(
            run, t, shares, names, law, kind, int(met.rstrip(".")), float(run.t[-1]), MappingProxyType(place)
        )


def check_sticks(slips: Mapping[str, float], others: Mapping[str, float]) -> None:
    """Raise `DeclarationError` for slip velocities that are none beside the other values of a start."""
    fastest = max((abs(value) for value in others.values()), default=0.0)
    for name, value in slips.items():
        if abs(value) > SLIPPING * (1.0 + fastest):
            raise DeclarationError(
                f"the start slips: {name} = {value:.6g}.",
                "Ask whether no-slip holds from a start without slip.",
                value=value,
            )


def _bears(law: SwitchLaw) -> float:
    """How much of mu N a contact bears before it slips: 1, or the maximum of a law that overshoots."""
    return min(law.upper.value, law.lower.value)
