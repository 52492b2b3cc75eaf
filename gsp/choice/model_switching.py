"""Changing models in mid-run: when a reduced flow is left for the full system, and when it takes over again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gsp.choice.candidates import INTEGRATION, ModelKind, label_of, left_to_model, run_model
from gsp.choice.forecast import base_start, forecast_of
from gsp.choice.hybrid_run import HybridRun
from gsp.choice.prediction import Failure, Prediction, predict
from gsp.critical.branch import Branch
from gsp.critical.sampling import Sampler
from gsp.fibres.base_points import project
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.restriction import restrict
from gsp.integration.surface_flow import flow_on
from gsp.integration.trajectory import Trajectory
from gsp.lowering.compiled_function import finite_rows
from gsp.scenes.study import Study
from gsp.slow.sampled_manifold import SampledManifold
from gsp.slow.series import SeriesManifold, expand
from gsp.slow.truncation import AHEAD

# After the reduced flow was left its local error has to fall to this share of what it was there before it is taken up
# again: without it a fold would be approached in ever shorter pieces, each with a new allowance.
HYSTERESIS = 0.1
# A reduced piece shorter than so many fast times is not worth the change.
SHORTEST = 10.0
# The full system is run in pieces, each twice as long as the one before, and looked at so often: at most half of what
# is run is thrown away.
LOOKS = 129
# Places at which a run on a solved manifold is checked to be on the piece that was solved.
SOLVED_LOOKS = 1025


def run_solved(run: HybridRun, manifold: SampledManifold) -> None:
    """The flow on a solved manifold, and the full system from where it leaves the piece that was solved."""
    scene = run.scene
    first, last = scene.span
    start = project(
        manifold, run.start, epsilon=scene.epsilon, numeric=True, reconstruction=scene.reconstruction
    )
    flow = flow_on(manifold, reconstruction=scene.reconstruction)
    slow = run_model(flow, start, scene, scene.span, INTEGRATION * scene.tolerance)
    run.count(slow)
    times = np.linspace(first, float(slow.t[-1]), SOLVED_LOOKS)
    there = slow.sample(times)
    inside = np.all(
        [(there[n] >= low) & (there[n] <= high) for n, (low, high) in manifold.region.items()], axis=0
    )
    end = float(times[-1]) if inside.all() else float(times[max(int(np.argmin(inside)) - 1, 0)])
    if end > first:
        run.append(ModelKind.SOLVED, None, first, end, slow)
    if end < last:
        state = run.sampled(slow, end) if run.pieces else run.start
        if run.pieces:
            run.switch(end, state, "solved", "full", "the piece of the manifold that was solved is left")
        run.finish_in_full(state, end)


def run_switched(run: HybridRun, order: int, layer: float) -> None:
    """The reduced flow of `order` wherever it holds, the full system wherever it does not."""
    _Switcher(run, order).go(layer)


@dataclass(eq=False)
class _Sheet:
    """One branch, all sheets of it, with what a reduced flow on it takes."""

    study: Study
    branch: Branch
    order: int

    @cached_property
    def series(self) -> SeriesManifold:
        order = self.study.short_series(self.order + AHEAD, at_least=self.order).order
        everywhere = replace(self.branch, seed=None)
        if self.branch.equations == self.study.branch.equations:
            return self.study.series(order, symbolic=False).over(everywhere)
        return expand(everywhere, order=order, symbolic=False)

    @cached_property
    def flows(self) -> dict[int, ReducedFlow]:
        orders = range(self.order, self.series.order + 1)
        if self.series.branch == self.study.branch:
            return {k: self.study.reduced(k) for k in orders}
        return {
            k: restrict(self.series, order=k, reconstruction=self.study.scene.reconstruction) for k in orders
        }

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
class _Switcher:
    """The reduced flow and the full system in turn."""

    record: HybridRun
    order: int
    scale: dict[str, float] = field(default_factory=dict)
    # Before this time the reduced flow was tried and found not to hold for long.
    barred: float = -np.inf

    def __post_init__(self) -> None:
        self.study = self.record.study
        self.scene = self.record.scene
        self.epsilon = self.scene.epsilon
        self.tolerance = self.scene.tolerance
        self.last = self.scene.span[1]
        self.fast_time = self.epsilon
        branches = self.study.critical.branches
        self.sheets = [_Sheet(self.study, branch, self.order) for branch in branches]

    def go(self, layer: float) -> None:
        """All of the span."""
        t, state, gate, why = self._first(layer)
        while t < self.last and self.record.status.ok:
            landed, t, state = self._until_landed(t, state, gate, why)
            if landed is None:
                break
            t, state, gate, why = self._reduce(landed[0], {}, t, state, t, landed[1])

    # -- the reduced flow ------------------------------------------------------------------------------

    def _first(self, layer: float) -> tuple[float, dict[str, float], float, str]:
        """The reduced piece from the scene's start, if there is one to speak of."""
        t = self.scene.span[0]
        forecast = forecast_of(self.study, (self.order,))
        self.fast_time = self.epsilon / forecast.inner.gap
        sheet = next(s for s in self.sheets if s.branch.equations == self.study.branch.equations)
        starts = {
            k: {**start, **base_start(forecast.inner, self.epsilon, k, names=self._driven)}
            for k, start in forecast.starts.items()
        }
        # Without this piece the full system begins where the scene does.
        return self._reduce(sheet, starts, t, self.record.start, t + layer, "")

    @property
    def _driven(self) -> list[str]:
        return [s.name for s in self.scene.reconstruction]

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
        system = sheet.branch.system
        if not starts:
            starts = dict.fromkeys(sheet.flows, state)
        prediction = predict(
            self.study,
            sheet.series,
            starts,
            flows=sheet.flows,
            orders=(self.order,),
            span=(t, self.last),
            least_scale={s.name: self.scale.get(s.name, 0.0) for s in system.x},
            sampler=sheet.sampler,
        )
        self.record.count(*prediction.runs.values())
        end, failure = self._end(prediction, t, after)
        if failure is not None and end - max(after, t) < SHORTEST * self.fast_time:
            gate = HYSTERESIS * float(self._nearness(sheet, self._row(state)).local[0])
            self.barred = t + SHORTEST * self.fast_time
            return t, state, gate, f"{failure}, and the reduced flow would not hold for long"
        if self.record.pieces and self.record.pieces[-1].kind is ModelKind.FULL:
            entering = label_of(ModelKind.REDUCED, self.order)
            self.record.switch(t, state, str(ModelKind.FULL), entering, why_landed)
        run = prediction.runs[self.order]
        self.record.append(ModelKind.REDUCED, self.order, t, end, run)
        self._rescale(run, t, end)
        reached = self.record.sampled(run, end)
        if failure is None:
            return end, reached, np.inf, ""
        near = self._nearness(sheet, self._row(reached))
        gate = np.inf if failure is Failure.REGION else HYSTERESIS * float(near.local[0])
        return end, reached, gate, str(failure)

    def _end(self, prediction: Prediction, t: float, after: float) -> tuple[float, Failure | None]:
        """Where this piece is left, and why: it may use as much of the tolerance as it takes of the span."""
        if not after < self.last:
            return t, Failure.END
        rate = left_to_model(self.tolerance) / (self.last - self.scene.span[0])
        end, failure = self.last, None
        for _ in range(2):
            limit = rate * (end - t)
            end, failure = prediction.holds_until(self.order, limit, after=after, last=self.last)
            if failure is None:
                break
        return end, failure

    def _rescale(self, run: Trajectory, begin: float, end: float) -> None:
        """Errors are relative to the largest values met so far."""
        there = run.sample(np.linspace(begin, end, LOOKS))
        for s in self.study.system.x:
            self.scale[s.name] = max(self.scale.get(s.name, 0.0), float(np.abs(there[s.name]).max()))

    # -- the full system -------------------------------------------------------------------------------

    def _until_landed(
        self, t: float, state: dict[str, float], gate: float, why: str
    ) -> tuple[tuple[_Sheet, str] | None, float, dict[str, float]]:
        """The full system from `state` until it has landed: ((where, how), when, the state), or None and the end."""
        record = self.record
        # The first piece is of so many fast times.
        length = 30.0 * self.fast_time
        while t < self.last:
            end = self.last if t + 1.5 * length >= self.last else t + length
            run = record.integrate(state, (t, end))
            end = float(run.t[-1])
            if not (end > t and run.status.ok):
                self._append_full(t, end, run, state, why)
                return None, end, state
            times = np.linspace(t, end, LOOKS)
            found = self._landing(run.sample(times), times, gate)
            if found is not None:
                sheet, place, how = found
                t, here = float(times[place]), t
                # Landed at once: the full system has nothing to add.
                if t > here:
                    self._append_full(here, t, run, state, why)
                return (sheet, how), t, record.sampled(run, t)
            self._append_full(t, end, run, state, why)
            state = record.sampled(run, end)
            t, length = end, 2.0 * length
        return None, t, state

    def _append_full(
        self, begin: float, end: float, run: Trajectory, state: dict[str, float], why: str
    ) -> None:
        pieces = self.record.pieces
        if pieces and pieces[-1].kind is ModelKind.REDUCED:
            self.record.switch(begin, state, pieces[-1].label, str(ModelKind.FULL), why)
        self.record.append(ModelKind.FULL, None, begin, end, run)
        if end > begin:
            self._rescale(run, begin, end)

    def _landing(self, run: Trajectory, times: np.ndarray, gate: float) -> tuple[_Sheet, int, str] | None:
        """(sheet, the first of `times` from which on the state stays on it, in words), or None."""
        best: tuple[_Sheet, int, str] | None = None
        for sheet in self.sheets:
            near = self._nearness(sheet, run.y.T)
            landed = near.landed & (near.local <= gate) & (times >= self.barred)
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
            places = [system.states.index(s) for s in sheet.series.coordinates]
            terms = sheet.series.terms_at(z[rows][:, places], self.epsilon)
            sizes = np.linalg.norm(terms, axis=2)
            local[rows] = sizes[:, self.order + 1 : self.order + 1 + AHEAD].max(axis=1)
            distance = np.linalg.norm(y[rows] - terms[:, : self.order + 1].sum(axis=1), axis=1)
            size = 1.0 + np.linalg.norm(y[rows], axis=1)
            # A state has landed when it stays so near for one fast time 1/gap; local errors of h are allowed
            # for so many times.
            landed[rows] = distance <= self.tolerance * size + 3.0 * local[rows]
            landed[rows] &= local[rows] <= size * self.tolerance**0.5
            landed &= sampler.inside(np.hstack([x, y]), self.study.region)
        return _Nearness(landed, local, gap)

    def _row(self, state: Mapping[str, float]) -> np.ndarray:
        return np.array([[state[name] for name in self.record.names]])
