"""Simulation: the reduced flow while it holds, the full system where it does not, one solution over the whole span.

Fenichel's theorem ends where the gap does. A run on the slow manifold is left when its predicted error has reached the
tolerance, which on the way to a fold happens at a distance of the size of epsilon^(2/3), before the full solution notices
the fold; the full system carries the state across, and the reduced flow takes over on the branch where it lands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.branch import Branch
from gsp.choice import INTEGRATION, MAX_STEPS, SMALLEST_SHARE, Choice, choose, foresee
from gsp.errors import DeclarationError, GspError, Status, nearest
from gsp.flow import Flow
from gsp.lowering import compile_flow, finite_rows
from gsp.placement import Placement, place
from gsp.prediction import AHEAD, SMALLEST_RTOL, Failure, Prediction, predict
from gsp.reduced import ReducedFlow, restrict
from gsp.sampling import Sampler
from gsp.scene import Scene
from gsp.series import SeriesManifold, expand
from gsp.system import VectorField
from gsp.trajectory import Trajectory, integrate

# After the reduced flow was left its local error has to fall to this share of what it was there before it is taken up
# again: without it a fold would be approached in ever shorter pieces, each with a new allowance.
HYSTERESIS = 0.1
# A state has landed when it stays so near for one fast time 1/gap; local errors of h are allowed for so many times.
NEAR_ERRORS = 3.0
# A reduced piece shorter than so many fast times is not worth the change.
SHORTEST = 10.0
# The full system is run in pieces, the first of so many fast times, each twice as long as the one before, and looked at
# so often: at most half of what is run is thrown away.
FIRST_PIECE, LOOKS = 30.0, 129
# More changes than this are a sign of chattering: the full system finishes.
MOST_SWITCHES = 10_000


@dataclass(frozen=True)
class Switch:
    """A change of model at `time`, in `state` (every name), from one model to another, and why."""

    time: float
    state: Mapping[str, float]
    leaving: str
    entering: str
    why: str

    def __str__(self) -> str:
        return f"t = {self.time:<10.6g} {self.leaving} -> {self.entering}: {self.why}"


@dataclass(frozen=True, eq=False)
class Piece:
    """One model's part: `label`, its `order` (None for the full system), and its `run` from `begin` to `end`."""

    label: str
    order: int | None
    begin: float
    end: float
    run: Trajectory

    @cached_property
    def times(self) -> np.ndarray:
        """The ends of its steps, `begin` and `end` among them."""
        inside = self.run.t[(self.run.t > self.begin) & (self.run.t < self.end)]
        return np.unique(np.concatenate([[self.begin], inside, [self.end]]))


@dataclass(frozen=True, eq=False, repr=False)
class Simulation:
    """A solution by `pieces`, with the `switches` between them; it is read like a `Trajectory`.

    `simulation["name"]` is a state, observable or reconstruction variable over `t`, `.at(t)` the states `names` at any
    time covered, `.sample(t)` the same on other times. Until `layer` (slow time) after the start the fast variables of
    a reduced first piece are those of the slow manifold. `steps` and `field_calls` count all runs, those that predict
    errors among them.
    """

    choice: Choice
    pieces: tuple[Piece, ...]
    switches: tuple[Switch, ...]
    names: tuple[str, ...]
    layer: float
    status: Status
    steps: int
    field_calls: int
    t: np.ndarray

    @property
    def reduced_share(self) -> float:
        """Share of the time covered in which a reduced flow was used."""
        total = sum(piece.end - piece.begin for piece in self.pieces)
        return sum(piece.end - piece.begin for piece in self.pieces if piece.order is not None) / total

    def __getitem__(self, key: str | sp.Symbol) -> np.ndarray:
        """Values (m,) over `t`; raises `GspError` for an unknown name."""
        return self._values([key.name if isinstance(key, sp.Symbol) else key], self.t)[0]

    def at(self, t: ArrayLike) -> np.ndarray:
        """States (n,) at a time, or (n, m) at times (m,), in the order of `names`; raises `GspError` outside."""
        times = np.array(t, dtype=float)
        values = self._values(self.names, np.atleast_1d(times))
        return values if times.ndim else values[:, 0]

    def sample(self, t: ArrayLike) -> Simulation:
        """The same solution with `.t` = `t` (m,)."""
        times = np.array(t, dtype=float, ndmin=1)
        self._owners(times)
        times.setflags(write=False)
        return replace(self, t=times)

    def model_at(self, t: ArrayLike) -> np.ndarray:
        """Label (m,) of the model used at times (m,)."""
        times = np.array(t, dtype=float, ndmin=1)
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
                f"the simulation covers [{first:.17g}, {last:.17g}]. Got t = {outside[0]:.17g}. "
                "Ask inside, or simulate a longer span."
            )
        ends = np.array([piece.end for piece in self.pieces[:-1]])
        return np.searchsorted(ends, times, side="left")

    def _values(self, names: Sequence[str], times: np.ndarray) -> np.ndarray:
        flow = self.pieces[0].run.flow
        known = [*self.names, *(s.name for s in flow.observables if s.name not in self.names)]
        for name in names:
            if name not in known:
                raise GspError(
                    f"{name!r} is no state and no observable. Those are {', '.join(known)}."
                    + nearest(str(name), known)
                )
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
        lines = [f"simulation of {self.choice.scene.name or 'a scene'}, epsilon = {self.choice.epsilon:g}"]
        lines += [f"  {switch}" for switch in self.switches]
        lines.append(f"  {self.steps} steps, {self.field_calls} calls of a field")
        return "\n".join([*lines, f"  {self.message}"])


def simulate(scene: Scene, *, choice: Choice | None = None) -> Simulation:
    """Run the model chosen for a scene over its span, with the full system wherever that model does not hold.

    `choice` is by default `choose(scene)`. A reduced flow, also one that serves only part of the span, starts at the
    base point of the start's fast fibre. It is left where the gap, the region or the dominance of the normal rate is
    lost, the series passes its best order, or the piece's predicted error passes the choice's tolerance. The full
    system follows from that point of the slow manifold until the state has stayed for one fast time within the
    tolerance of a slow manifold over an attracting branch. A reduced piece may use as much of the tolerance as it
    takes of the span, so that all of them together keep to it.

    >>> from gsp import models
    >>> simulate(models.load("linear")).message
    'reached the end, t = 3, with 0 changes of model; reduced for 100 % of the time'
    """
    if choice is None:
        choice = choose(scene)
    if not isinstance(choice, Choice):
        raise DeclarationError(
            f"choice is what choose(scene) returns. Got {type(choice).__name__}. Leave it out, or pass a Choice."
        )
    if replace(choice.scene, epsilon=scene.epsilon, tolerance=scene.tolerance) != scene:
        raise DeclarationError(
            f"the choice was made for {choice.scene!r}. Got {scene!r}. Call choose() with this scene."
        )
    served = choice.model if choice.model.order is not None else choice.partial
    try:
        placement = place(choice.scene)
    except GspError:
        placement = None
    order = None if placement is None or served is None else served.order
    return _Runner(choice, placement, order).run()


@dataclass(eq=False)
class _Sheet:
    """One branch, all sheets of it, with what a reduced flow on it takes."""

    branch: Branch
    order: int
    reconstruction: Mapping[sp.Symbol, sp.Expr]

    @cached_property
    def series(self) -> SeriesManifold:
        return expand(replace(self.branch, seed=None), order=self.order + AHEAD, symbolic=False)

    @cached_property
    def flows(self) -> dict[int, ReducedFlow]:
        orders = range(self.order, self.order + AHEAD + 1)
        return {k: restrict(self.series, order=k, reconstruction=self.reconstruction) for k in orders}

    @cached_property
    def sampler(self) -> Sampler:
        return Sampler(self.series.branch)


@dataclass(frozen=True, eq=False)
class _Nearness:
    """How states lie to one branch: `landed` (m,), the `local` error of h there and the `gap`."""

    landed: np.ndarray
    local: np.ndarray
    gap: np.ndarray


@dataclass(eq=False)
class _Runner:
    """The state machine: pieces are appended while time goes on."""

    choice: Choice
    placement: Placement | None
    order: int | None
    pieces: list[Piece] = field(default_factory=list)
    switches: list[Switch] = field(default_factory=list)
    steps: int = 0
    field_calls: int = 0
    scale: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.scene = self.choice.scene
        self.epsilon = self.scene.epsilon
        self.tolerance = self.scene.tolerance
        self.last = self.scene.span[1]
        self.reduced_label = f"reduced {self.order}"
        self.fast_time = self.epsilon
        if self.placement is None:
            self.full: Flow = self.scene.full_flow
            return
        system = self.placement.system
        observables = dict(system.observables)
        driven = {s: sp.sympify(r, strict=True).xreplace(observables) for s, r in self.scene.reconstruction.items()}
        self.full = VectorField(
            {**dict(zip(system.states, system.rates)), **driven},
            epsilon=system.epsilon,
            parameters=system.parameters,
            observables=system.observables,
            name=system.name,
        )
        if self.order is not None:
            self.sheets = [
                _Sheet(branch, self.order, self.scene.reconstruction)
                for branch in self.placement.critical.branches
            ]

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(s.name for s in self.full.states)

    def run(self) -> Simulation:
        t = self.scene.span[0]
        base = self.scene.start if self.placement is None else self.placement.start
        state = {**base, **self.scene.reconstruction_start}
        layer = 0.0
        if self.order is None:
            self._append(self._integrate(state, (t, self.last)), None, t, self.last)
            return self._result(0.0)
        state, t, gate, why, begun = self._first(state)
        layer = self.choice.layer if begun else 0.0
        while t < self.last and self._ok:
            sheet, t, state, why_landed = self._until_landed(t, state, gate, why)
            if sheet is None or not self._ok:
                break
            t, state, gate, why = self._reduce(sheet, {}, t, state, t, why_landed)
        return self._result(layer)

    @property
    def _ok(self) -> bool:
        return not self.pieces or self.pieces[-1].order is not None or self.pieces[-1].run.status.ok

    # -- the reduced flow ------------------------------------------------------------------------------

    def _first(self, state: dict[str, float]) -> tuple[dict[str, float], float, float, str, bool]:
        """The reduced piece from the scene's start, if there is one to speak of."""
        assert self.placement is not None and self.order is not None
        t = self.scene.span[0]
        outlook = foresee(self.scene, (self.order,))
        self.fast_time = self.epsilon / outlook.inner.gap
        sheet = next(s for s in self.sheets if s.branch.equations == self.placement.branch.equations)
        starts = {
            k: {
                **outlook.starts[k],
                **{
                    s.name: sum(
                        float(c) * self.epsilon**i for i, c in enumerate(outlook.inner.base[s.name][: k + 1])
                    )
                    for s in self.scene.reconstruction
                },
            }
            for k in outlook.starts
        }
        # Without this piece the full system begins where the scene does.
        here, left, gate, why = self._reduce(sheet, starts, t, state, t + outlook.layer, "")
        return left, here, gate, why, bool(self.pieces)

    def _reduce(
        self,
        sheet: _Sheet,
        starts: Mapping[int, Mapping[str, float]],
        t: float,
        state: dict[str, float],
        after: float,
        why_landed: str,
    ) -> tuple[float, dict[str, float], float, str]:
        """A reduced piece from `t`: (where it ends, the state, the gate, why); nothing is appended if it is too short.

        The gate is the local error that the next reduced piece must begin below.
        """
        assert self.order is not None
        system = sheet.branch.system
        if not starts:
            known = {*(s.name for s in self.scene.reconstruction), *(s.name for s in system.states)}
            start = {name: value for name, value in state.items() if name in known}
            starts = dict.fromkeys(sheet.flows, start)
        prediction = predict(
            sheet.series,
            starts,
            flows=sheet.flows,
            orders=(self.order,),
            span=(t, self.last),
            epsilon=self.epsilon,
            tolerance=self.tolerance,
            region=self._region,
            names=[s.name for s in system.x],
            least_scale=self.scale,
            sampler=sheet.sampler,
        )
        self._count(*prediction.runs.values())
        end, failure = self._end(prediction, t, after)
        if failure is not None and end - max(after, t) < SHORTEST * self.fast_time:
            gate = HYSTERESIS * float(self._nearness(sheet, self._row(state)).local[0])
            return t, state, gate, f"{failure}, and the reduced flow would not hold for long"
        if self.pieces:
            self._switch(t, state, "full", self.reduced_label, why_landed)
        run = prediction.runs[self.order]
        self._append(run, self.order, t, end)
        sampled = run.sample(end)
        reached = {name: float(sampled[name][0]) for name in self.names}
        if failure is None:
            return end, reached, np.inf, ""
        near = self._nearness(sheet, self._row(reached))
        gate = np.inf if failure is Failure.REGION else HYSTERESIS * float(near.local[0])
        return end, reached, gate, str(failure)

    def _end(self, prediction: Prediction, t: float, after: float) -> tuple[float, Failure | None]:
        """Where this piece is left, and why: it may use as much of the tolerance as it takes of the span."""
        assert self.order is not None
        if not after < self.last:
            return t, Failure.END
        rate = (1.0 - INTEGRATION) * self.tolerance / (self.last - self.scene.span[0])
        end, failure = self.last, None
        for _ in range(2):
            end, failure = leave(prediction, self.order, rate * (end - t), after=after, last=self.last)
            if failure is None:
                break
        return end, failure

    def _row(self, state: Mapping[str, float]) -> np.ndarray:
        return np.array([[state[name] for name in self.names]])

    @property
    def _region(self):
        assert self.placement is not None
        return self.placement.region

    # -- the full system -------------------------------------------------------------------------------

    def _until_landed(
        self, t: float, state: dict[str, float], gate: float, why: str
    ) -> tuple[_Sheet | None, float, dict[str, float], str]:
        """The full system from `state` until it has landed: (where, when, the state, how); None when it does not."""
        if self.pieces:
            self._switch(t, state, self.reduced_label, "full", why)
        length = FIRST_PIECE * self.fast_time
        while t < self.last:
            end = self.last if t + 1.5 * length >= self.last else t + length
            run = self._integrate(state, (t, end))
            end = float(run.t[-1])
            if end <= t or len(self.switches) > MOST_SWITCHES or not run.status.ok:
                self._append(run, None, t, end)
                return None, end, state, ""
            times = np.linspace(t, end, LOOKS)
            found = self._landing(run.sample(times), times, gate)
            if found is not None:
                sheet, place, how = found
                self._append(run, None, t, float(times[place]))
                here = run.sample(times[place])
                return sheet, float(times[place]), {n: float(here[n][0]) for n in self.names}, how
            self._append(run, None, t, end)
            state = {name: float(value) for name, value in zip(self.names, run.at(end))}
            t, length = end, 2.0 * length
        return None, t, state, ""

    def _landing(self, run: Trajectory, times: np.ndarray, gate: float) -> tuple[_Sheet, int, str] | None:
        """(sheet, the first of `times` from which on the state stays on it, in words), or None."""
        best: tuple[_Sheet, int, str] | None = None
        for sheet in self.sheets:
            near = self._nearness(sheet, run.y.T)
            landed = near.landed & (near.local <= gate)
            for i in np.flatnonzero(landed):
                if best is not None and i >= best[1]:
                    break
                dwell = self.epsilon / near.gap[i]
                stop = int(np.searchsorted(times, times[i] + dwell))
                if stop >= len(times):
                    break
                if landed[i : max(stop, i + 2) + 1].all():
                    best = (sheet, int(i), f"landed where the gap is {near.gap[i]:.3g}")
                    self.fast_time = dwell
                    break
        return best

    def _nearness(self, sheet: _Sheet, states: np.ndarray) -> _Nearness:
        """How `states` (m, n), in the order of `names`, lie to a branch."""
        assert self.order is not None
        system, sampler = sheet.branch.system, sheet.sampler
        nx, n = len(system.x), len(system.states)
        x, y = states[:, :nx].copy(), states[:, nx:n].copy()
        y0, good = sheet.series.branch.nearest(x, y)
        z = np.hstack([x, np.where(good[:, None], y0, np.nan)])
        with np.errstate(all="ignore"):
            gap = -np.nan_to_num(np.real(sampler.eigenvalues(z)), nan=np.inf).max(axis=1)
            usable = (gap > 0.0) & finite_rows(z)
            usable[usable] &= gap[usable] >= self.epsilon * sampler.tangential_rates(z[usable])
        landed, local = np.zeros(len(x), dtype=bool), np.full(len(x), np.inf)
        rows = np.flatnonzero(usable)
        if rows.size:
            terms = sheet.series.terms(x[rows], self.epsilon, near=y0[rows])
            sizes = np.linalg.norm(terms, axis=2)
            local[rows] = sizes[:, self.order + 1 : self.order + 1 + AHEAD].max(axis=1)
            distance = np.linalg.norm(y[rows] - terms[:, : self.order + 1].sum(axis=1), axis=1)
            size = 1.0 + np.linalg.norm(y[rows], axis=1)
            landed[rows] = distance <= self.tolerance * size + NEAR_ERRORS * local[rows]
            landed[rows] &= local[rows] <= size * self.tolerance**0.5
            landed &= sampler.inside(np.hstack([x, y]), self._region)
        return _Nearness(landed, local, gap)

    def _integrate(self, state: Mapping[str, float], span: tuple[float, float]) -> Trajectory:
        rtol = max(INTEGRATION * self.tolerance, SMALLEST_RTOL)
        run = integrate(
            self.full,
            start=state,
            span=span,
            epsilon=self.epsilon,
            rtol=rtol,
            atol=1e-2 * rtol,
            max_steps=MAX_STEPS,
        )
        self._count(run)
        return run

    # -- the record ------------------------------------------------------------------------------------

    def _count(self, *runs: Trajectory) -> None:
        self.steps += sum(run.stats.steps for run in runs)
        self.field_calls += sum(run.stats.field_calls for run in runs)

    def _append(self, run: Trajectory, order: int | None, begin: float, end: float) -> None:
        label = "full" if order is None else self.reduced_label
        self.pieces.append(Piece(label, order, begin, end, run))
        if self.placement is not None:
            times = self.pieces[-1].times
            sampled = run.sample(times)
            for s in self.placement.system.x:
                size = float(np.abs(sampled[s.name]).max())
                self.scale[s.name] = max(self.scale.get(s.name, 0.0), size)

    def _switch(self, t: float, state: Mapping[str, float], leaving: str, entering: str, why: str) -> None:
        self.switches.append(Switch(t, dict(state), leaving, entering, why))

    def _result(self, layer: float) -> Simulation:
        times = np.concatenate([self.pieces[0].times, *(piece.times[1:] for piece in self.pieces[1:])])
        times.setflags(write=False)
        status = Status.SUCCESS if self._ok else self.pieces[-1].run.status
        return Simulation(
            choice=self.choice,
            pieces=tuple(self.pieces),
            switches=tuple(self.switches),
            names=self.names,
            layer=layer,
            status=status,
            steps=self.steps,
            field_calls=self.field_calls,
            t=times,
        )


def leave(
    prediction: Prediction, order: int, limit: float, *, after: float, last: float
) -> tuple[float, Failure | None]:
    """Where a reduced run is left, and why; `last` and None when it holds to the end.

    The only place that looks for this event.
    """
    return prediction.holds_until(order, limit, after=after, last=last)
