"""Simulation: the reduced flow while it holds, the full system where it does not, one solution over the whole span.

Fenichel's theorem ends where the gap does. A run on the slow manifold is left when its predicted error has used up its
tolerance, which on the way to a fold happens at a distance of the size of epsilon^(2/3), before the full solution
notices the fold; the full system carries the state across, and the reduced flow takes over where it lands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.choice.candidates import ModelKind
from gsp.choice.choice import Choice, choose
from gsp.choice.hybrid_run import HybridRun, ModelPiece, ModelSwitch
from gsp.choice.model_switching import run_solved, run_switched
from gsp.errors import DeclarationError, GspError, Status
from gsp.results.bounds import as_given
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.systems.arguments import check_times, shown


@dataclass(frozen=True, eq=False, repr=False)
class Simulation(Drawn, Tabular):
    """A solution by `pieces`, with the `switches` between them; it is read like a `Trajectory`.

    `simulation["name"]` is a state, observable or reconstruction variable over `t`, `.at(t)` the states `names` at any
    time covered, `.sample(t)` the same on other times. Until `layer` (slow time) after the start the fast variables of
    a reduced first piece are those of the slow manifold. `steps` and `field_calls` count all runs, those that predict
    errors among them.
    """

    choice: Choice
    pieces: tuple[ModelPiece, ...]
    switches: tuple[ModelSwitch, ...]
    names: tuple[str, ...]
    layer: float
    status: Status
    steps: int
    field_calls: int
    t: np.ndarray

    @property
    def reduced_share(self) -> float:
        """Share of the time covered in which the full system was not run."""
        total = sum(piece.end - piece.begin for piece in self.pieces)
        return sum(p.end - p.begin for p in self.pieces if p.kind is not ModelKind.FULL) / total

    def __getitem__(self, key: str | sp.Symbol) -> np.ndarray:
        """Values (m,) over `t`; raises `GspError` for an unknown name."""
        return self._values([key.name if isinstance(key, sp.Symbol) else key], self.t)[0]

    def at(self, t: ArrayLike) -> np.ndarray:
        """States (n,) at a time, or (n, m) at times (m,), in the order of `names`; raises `GspError` outside."""
        times = check_times(t)
        values = self._values(self.names, np.atleast_1d(times))
        return values if times.ndim else values[:, 0]

    def sample(self, t: ArrayLike) -> Simulation:
        """The same solution with `.t` = `t` (m,)."""
        times = np.atleast_1d(check_times(t))
        self._owners(times)
        times.setflags(write=False)
        return replace(self, t=times)

    def model_at(self, t: ArrayLike) -> np.ndarray:
        """Label (m,) of the model used at times (m,)."""
        times = np.atleast_1d(check_times(t))
        return np.array([self.pieces[i].label for i in self._owners(times)])

    @property
    def message(self) -> str:
        """One line: how it ended, and with what."""
        end = self.pieces[-1].end
        if not self.status.ok:
            return self.pieces[-1].run.message
        changes = len(self.switches)
        return (
            f"reached the end, t = {end:.6g}, with {changes} change{'' if changes == 1 else 's'} of model; reduced for "
            f"{100 * self.reduced_share:.3g} % of the time"
        )

    def _owners(self, times: np.ndarray) -> np.ndarray:
        first, last = self.pieces[0].begin, self.pieces[-1].end
        outside = times[~((times >= first) & (times <= last))]
        if outside.size:
            raise GspError(
                f"the simulation covers [{as_given(first)}, {as_given(last)}].",
                "Ask inside, or simulate a longer span.",
                got=f"t = {as_given(outside[0])}",
            )
        ends = np.array([piece.end for piece in self.pieces[:-1]])
        return np.searchsorted(ends, times, side="left")

    def _values(self, names: Sequence[str], times: np.ndarray) -> np.ndarray:
        flow = self.pieces[0].run.flow
        known = [*self.names, *(s.name for s in flow.observables if s.name not in self.names)]
        for name in names:
            if name not in known:
                raise GspError.none_of(known, name, f"{name!r} is no state and no observable.", "Those are")
        owners = self._owners(times)
        result = np.empty((len(names), len(times)))
        for i in np.unique(owners):
            here = owners == i
            run = self.pieces[i].run.sample(times[here])
            result[:, here] = [run[name] for name in names]
        return result

    def __repr__(self) -> str:
        return (
            f"Simulation([{', '.join(self.names)}], t={self.pieces[0].begin:.6g}..{self.pieces[-1].end:.6g}, "
            f"{len(self.switches)} switches, {self.status.name})"
        )

    def __str__(self) -> str:
        scene = self.choice.scene
        lines = [f"simulation of {scene.name or 'a scene'}, {scene.system.epsilon} = {self.choice.epsilon:g}"]
        lines += [f"  {switch}" for switch in self.switches]
        lines.append(f"  {self.steps} steps, {self.field_calls} calls of a field")
        return "\n".join([*lines, f"  {self.message}"])


def simulate(scene: Scene | Study, *, choice: Choice | None = None) -> Simulation:
    """Run the model chosen for a scene over its span, with the full system wherever that model does not hold.

    `choice` is by default `choose(scene)`. A reduced flow, also one that serves only part of the span, starts at the
    base point of the start's fast fibre. It is left where the gap, the region or the dominance of the normal rate is
    lost, the series passes its best order, or the piece's predicted error passes the choice's tolerance. The full
    system follows from that point of the slow manifold until the state has stayed for one fast time within the
    tolerance of a slow manifold over an attracting branch. A reduced piece may use as much of the tolerance as it
    takes of the span, so that all of them together keep to it.

    >>> from gsp import models
    >>> simulate(models.load("linear"))["y"][-1:].round(4)
    array([0.0498])
    """
    study = study_of(scene, verb="simulate")
    if choice is None:
        choice = choose(study)
    if not isinstance(choice, Choice):
        raise DeclarationError(
            "choice is what choose(scene) returns.",
            "Leave it out, or pass a Choice.",
            got=shown(choice),
            value=choice,
        )
    scene_run = study.scene
    if replace(choice.scene, epsilon=scene_run.epsilon, tolerance=scene_run.tolerance) != scene_run:
        raise DeclarationError(
            f"the choice was made for {choice.scene!r}.",
            "Call choose() with this scene.",
            got=f"{scene_run!r}",
            value=scene_run,
        )
    study, span = choice.study, choice.scene.span
    run = HybridRun(study, _is_reducible(study))
    served = choice.partial if choice.model.kind is ModelKind.FULL else choice.model
    if served is None or not run.is_reducible:
        run.finish_in_full(run.start, span[0])
    elif choice.manifold is not None:
        run_solved(run, choice.manifold)
    else:
        assert served.order is not None
        run_switched(run, served.order, choice.layer)
    times = np.concatenate([run.pieces[0].times, *(piece.times[1:] for piece in run.pieces[1:])])
    times.setflags(write=False)
    return Simulation(
        choice=choice,
        pieces=tuple(run.pieces),
        switches=tuple(run.switches),
        names=run.names,
        layer=0.0 if run.pieces[0].kind is ModelKind.FULL else choice.layer,
        status=run.status,
        steps=run.steps,
        field_calls=run.field_calls,
        t=times,
    )


def _is_reducible(study: Study) -> bool:
    """Whether there is a branch to reduce to, in a standard form with a region."""
    try:
        return study.branch is not None and study.region is not None
    except GspError:
        return False
