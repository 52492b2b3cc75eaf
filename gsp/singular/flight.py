"""Flights: what an orbit does that leaves a switch at a fold and for which v = s/epsilon goes to infinity.

Off the surface the field is one of the two that the smooth switch tends to. The orbit follows it until it is back on
the surface, and comes down on the sheet that the layer flow from infinity leads to.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp

from gsp.algebra.laurent import laurent
from gsp.errors import GspError, Status
from gsp.integration.events import Event
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.roots import root
from gsp.sliding.sharpened import sharpened
from gsp.splitting.switches import without_switches
from gsp.systems.system import SlowFastSystem, VectorField
from gsp.systems.tolerances import absolute_tolerance


@dataclass(frozen=True, eq=False, repr=False)
class Flight:
    """An orbit off the surface: its `runs` between crossings, in the states of the switched field.

    `point` is where it comes down, in slow and fast variables.
    """

    runs: tuple[Trajectory, ...]
    point: Mapping[str, float]

    @property
    def duration(self) -> float:
        """Slow time."""
        return float(self.runs[-1].t[-1] - self.runs[0].t[0])


class Flights:
    """The flights of a field with one switch, whose fast variable is the only one of `system`."""

    def __init__(self, field: VectorField, system: SlowFastSystem) -> None:
        sharp = sharpened(field)
        (self._switch,) = without_switches(field)[1]
        if system.y != (self._switch.fast,):
            raise GspError(
                f"a flight takes a system whose fast variable is the switch's, {self._switch.fast}.",
                "Give the field that the system was split from.",
                got=", ".join(y.name for y in system.y),
            )
        self._system, self._states = system, field.states
        self._flows = {1: sharp.flow(sharp.plus), -1: sharp.flow(sharp.minus)}
        self._events = {side: Event(sharp.surface, direction=-side, terminal=True) for side in self._flows}
        self._layer = compile_over(system, [laurent(system.g[0], system.epsilon, order=0).get(0, sp.S.Zero)])

    def after(self, point: Mapping[str, float], *, beyond: float, longest: float, rtol: float) -> Flight | None:
        """The flight of an orbit that leaves M0 at `point` for v = `beyond`; None where it is not back after `longest`,
        in slow time.
        """
        left = point[self._switch.fast.name]
        side = 1 if beyond > left else -1
        state, t = self._on_surface(point), 0.0
        atol = absolute_tolerance(rtol, {}, state)
        runs: list[Trajectory] = []
        # A flight crosses the surface so often at most.
        while len(runs) < 100:
            run = trajectory_of(
                self._flows[side],
                start=state,
                span=(t, longest),
                rtol=rtol,
                atol=atol,
                options=RunOptions(events=self._events[side]),
            )
            runs.append(run)
            if run.status is not Status.EVENT_REACHED:
                return None
            t, state = float(run.t[-1]), {s.name: float(run[s.name][-1]) for s in self._states}
            x = [state[s.name] for s in self._system.x]
            landed = self._first_sheet(x, side, abs(left) or 1.0)
            if landed is not None:
                return Flight(
                    tuple(runs),
                    {**{s.name: state[s.name] for s in self._system.x}, self._switch.fast.name: landed},
                )
            side = -side
        return None

    def _on_surface(self, point: Mapping[str, float]) -> dict[str, float]:
        """The states of the field at a point of M0, where epsilon is 0."""
        switch, found = self._switch, dict(point)
        if switch.state is not None:
            assert switch.value is not None
            place = {
                **self._system.parameters,
                switch.epsilon: sp.S.Zero,
                **{s: point[s.name] for s in switch.value.free_symbols if s.name in point},
            }
            found[switch.state.name] = float(switch.value.xreplace(place))
        return {s.name: found[s.name] for s in self._states}

    def _first_sheet(self, x: list[float], side: int, unit: float) -> float | None:
        """The v at which the layer flow from infinity on a side comes to rest; None where it goes through.

        `unit` is how large v is where the flight begins.
        """
        constants = compile_flow(self._system).constants

        def rate(angle: float) -> float:
            return float(self._layer(np.array([*x, unit * np.tan(angle)]), constants)[0])

        # Sheets are looked for between 4096 places, even in the angle whose tangent is v in its unit.
        angles = side * np.linspace(np.pi / 2, -np.pi / 2, 4097)[1:-1]
        points = np.column_stack([np.tile(x, (angles.size, 1)), unit * np.tan(angles)])
        rates = self._layer(points, constants)[:, 0]
        stops = np.flatnonzero(np.sign(rates) == side)
        if not stops.size or stops[0] == 0:
            return None
        found = root(rate, float(angles[stops[0] - 1]), float(angles[stops[0]]))
        return None if found is None else float(unit * np.tan(found))
