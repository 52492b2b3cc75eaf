"""One solution made of runs of several models: its pieces, the changes between them, and the work that they took."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import sympy as sp

from gsp.choice.candidates import INTEGRATION, ModelKind, label_of, run_model
from gsp.errors import Status
from gsp.integration.trajectory import Trajectory
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study
from gsp.systems.flow import Flow
from gsp.systems.region import Interval


@dataclass(frozen=True)
class ModelSwitch:
    """A change of model at `time`, in `state` (every name), from one model to another, and why."""

    time: float
    state: Mapping[str, float]
    leaving: str
    entering: str
    why: str

    def __str__(self) -> str:
        return f"t = {self.time:<10.6g} {self.leaving} -> {self.entering}: {self.why}"


@dataclass(frozen=True, eq=False)
class ModelPiece:
    """One model's part: its `kind`, its `order` when it is a reduced flow, and its `run` from `begin` to `end`."""

    kind: ModelKind
    order: int | None
    begin: float
    end: float
    run: Trajectory

    @property
    def label(self) -> str:
        """Kind and order."""
        return label_of(self.kind, self.order)

    @cached_property
    def times(self) -> np.ndarray:
        """The ends of its steps, `begin` and `end` among them."""
        inside = self.run.t[(self.run.t > self.begin) & (self.run.t < self.end)]
        return np.unique(np.concatenate([[self.begin], inside, [self.end]]))


def full_flow(study: Study) -> Flow:
    """The full system in the coordinates of the standard form, reconstruction included."""
    scene, system = study.scene, study.system
    observables = dict(system.observables)
    driven = {s: sp.sympify(r, strict=True).xreplace(observables) for s, r in scene.reconstruction.items()}
    return system.as_field({**dict(zip(system.states, system.rates)), **driven})


@dataclass(eq=False)
class HybridRun:
    """A run in the making: pieces are appended while time goes on, and `full` is the flow to fall back to.

    That is the flow in standard form, or as declared when the scene is not reducible.
    """

    study: Study
    is_reducible: bool
    pieces: list[ModelPiece] = field(default_factory=list)
    switches: list[ModelSwitch] = field(default_factory=list)
    steps: int = 0
    field_calls: int = 0

    @property
    def scene(self) -> Scene:
        """The scene that is run."""
        return self.study.scene

    @cached_property
    def full(self) -> Flow:
        """The full system."""
        return full_flow(self.study) if self.is_reducible else self.scene.full_flow

    @property
    def names(self) -> tuple[str, ...]:
        """The states of the full system, reconstruction variables behind them."""
        return tuple(s.name for s in self.full.states)

    @property
    def status(self) -> Status:
        """SUCCESS, or how the full system ended."""
        ended = bool(self.pieces) and self.pieces[-1].kind is ModelKind.FULL
        return self.pieces[-1].run.status if ended else Status.SUCCESS

    @property
    def start(self) -> dict[str, float]:
        """The scene's start, by the names of the full flow."""
        own = self.study.start if self.is_reducible else self.scene.start
        return {**own, **self.scene.reconstruction_start}

    def finish_in_full(self, state: Mapping[str, float], t: float) -> None:
        """The full system from `state` to the end of the span."""
        run = self.integrate(state, (t, self.scene.span[1]))
        self.append(ModelKind.FULL, None, t, float(run.t[-1]), run)

    def integrate(self, state: Mapping[str, float], span: Interval) -> Trajectory:
        """The full system over `span`, at the integrator's share of the tolerance."""
        run = run_model(self.full, state, self.scene, span, INTEGRATION * self.scene.tolerance)
        self.count(run)
        return run

    def count(self, *runs: Trajectory) -> None:
        """Add the work of `runs`."""
        self.steps += sum(run.stats.steps for run in runs)
        self.field_calls += sum(run.stats.field_calls for run in runs)

    def append(self, kind: ModelKind, order: int | None, begin: float, end: float, run: Trajectory) -> None:
        """One more piece; the full system goes on in the piece it has."""
        self.pieces.append(ModelPiece(kind, order, begin, end, run))

    def switch(self, t: float, state: Mapping[str, float], leaving: str, entering: str, why: str) -> None:
        """One more change of model."""
        self.switches.append(ModelSwitch(t, dict(state), leaving, entering, why))

    def sampled(self, run: Trajectory, t: float) -> dict[str, float]:
        """Every name at one time of a run of any model."""
        there = run.sample(t)
        return {name: float(there[name][0]) for name in self.names}
