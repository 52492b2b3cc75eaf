"""A reduced orbit of order 0 on a branch of M0, sampled to rounding, with the rightmost fast eigenvalue along it.

The orbit is kept on Chebyshev panels. The rightmost real part is smooth except where another eigenvalue takes over
or a pair is born; panels are cut there until what is left does not matter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import sympy as sp
from numpy.polynomial.chebyshev import chebroots

from gsp.algebra.differentiation import entries, jacobian
from gsp.critical.branch import Branch
from gsp.critical.sampling import Sampler
from gsp.errors import BranchError, Status
from gsp.fibres.decaying_signals import chebyshev, coefficients, tail
from gsp.integration.methods import Method
from gsp.integration.trajectory import RunOptions, trajectory_of
from gsp.roots import root
from gsp.singular.passage.failure import PassageError
from gsp.splitting.fast_part import inverse
from gsp.systems.flow import in_words
from gsp.systems.region import EDGE, Interval, in_units
from gsp.systems.system import VectorField

# A panel is resolved when its last Chebyshev coefficients are this small, relative to a state's unit and its largest
# value on it, or to the largest eigenvalue so far.
RESOLVED = 2e-14
# The first panel in units of (1 + |x|)/|f|, x in units, or of the time in which the rightmost eigenvalue changes.
FIRST = 0.05
# As long as an orbit is followed, in units of the larger of the two.
PATIENCE = 100.0


@dataclass(frozen=True, eq=False)
class Panel:
    """Chebyshev nodes `t` (m,) with the orbit `z` (m, n) at them."""

    t: np.ndarray
    z: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """The orbit at times (k,): (k, n)."""
        return interpolate(self.t, self.z, t)


@dataclass(frozen=True, eq=False)
class ResolvedPanel:
    """A panel or part of one on which the rightmost real part is resolved: nodes `t`, `values` of it (m,),
    the eigenvalue itself (m,), and the primitive of `values` from the left end (m,); `has_kink` when not resolved."""

    t: np.ndarray
    values: np.ndarray
    eigenvalue: np.ndarray
    primitive: np.ndarray
    has_kink: bool = False


def time_to_move(x: np.ndarray, rates: np.ndarray, unit: np.ndarray) -> float:
    """A slow time in which an orbit gets somewhere from `x` (m,), where it moves at `rates` (m,), in lengths of `unit`
    (m,); infinite where it stands still.
    """
    speed = float(np.linalg.norm(rates / unit))
    return (1.0 + float(np.linalg.norm(x / unit))) / speed if speed > 0.0 else float("inf")


class SlowOrbit:
    """The reduced orbit through x (n_slow,) on `branch`, forward in slow time from 0, panel after panel.

    States, `branch` and `box` are about the system's `centre` (n,), where numbers keep their digits; the branch that
    was `asked` for is not. Lengths are in the states' `units` (n,): the branch's own, or those of the start and of
    `box`. `equations` E vanish on the branch, and are regular where it is a graph; the `sampler` has f, g and their
    derivatives at epsilon = 0. An orbit is followed for the slow time `patience` unless told otherwise.
    """

    def __init__(self, branch: Branch, x: np.ndarray, box: Mapping[str, Interval] | None = None) -> None:
        z = np.concatenate([x, branch.points(x[None, :])[0]])
        self.centre = branch.system.centre
        self.asked = branch.in_own_units(z, box)
        branch = branch.about_centres
        system = branch.system
        self.box = box and self.asked.system.box_from_centres(box)
        self.end, self.state = 0.0, z - self.centre
        m = len(x)
        if self.centre.any():
            self.state[m:] = _on(branch, self.state[None, :m], self.state[None, m:])
        self.branch = branch = branch.in_own_units(self.state, self.box)
        self.units = np.concatenate(branch.scales)
        self.sampler = sampler = Sampler(branch)
        graph = branch.graph
        self.equations = branch.equations if graph is None else tuple(y - h for y, h in graph.items())
        self._slopes = sampler.compiled(entries(self.equations, system.states))
        self.panels: list[Panel] = []
        unit = branch.scales[0]
        # A slow time in which the orbit gets somewhere, and the largest eigenvalue so far.
        self.time = time_to_move(self.state[:m], sampler.rates(self.state[None, :])[0, :m], unit)
        self.rate = 0.0
        if not np.isfinite(self.time):
            raise PassageError(
                f"the reduced flow stands still at the start, {self.shown(self.state)}.",
                "Start where it moves.",
            )
        fixed = dict(system.parameters)
        if graph is not None:
            rates = {s: f.xreplace(dict(graph)) for s, f in zip(system.x, sampler.f)}
        else:
            E_x, E_y = (jacobian(self.equations, symbols) for symbols in (system.x, system.y))
            # By cofactors, as a pivot may be 0 where the determinant is not.
            moved = inverse(E_y) * E_x * sp.Matrix(sampler.f)
            rates = {**dict(zip(system.x, sampler.f)), **{y: -m for y, m in zip(system.y, moved)}}
        self._flow = _in_units(VectorField(rates, epsilon=None, parameters=fixed), self.units)
        change = self._time_to_change()
        self._length = FIRST * min(self.time, change)
        # From a start next to 0 an orbit gets as far again in no time, and its eigenvalues hardly change.
        self.patience = PATIENCE * (max(self.time, change) if np.isfinite(change) else self.time)
        # Panels this much shorter than the first one run into the end of the branch.
        self._least = 1e-5 * self._length

    def _time_to_change(self) -> float:
        """A slow time in which the rightmost eigenvalue at the start changes by its own size."""
        step = np.finfo(float).eps ** 0.5 * self.time
        first = np.real(self.eigenvalues(self.state[None, :])[0, 0])
        # On a fold nothing has a velocity.
        if first == 0.0:
            return float("inf")
        later = np.real(self.eigenvalues((self.state + step * self.velocity(self.state))[None, :])[0, 0])
        return float(step * abs(first / (later - first))) if later != first else float("inf")

    def shown(self, z: np.ndarray) -> str:
        """A point by name, where it is."""
        return in_words(self.named(z), 8)

    def named(self, z: np.ndarray, rounding: np.ndarray | float = 0.0) -> dict[str, float]:
        """A point by name, where it is; numbers below their `rounding` (n,) are 0."""
        there = z + self.centre
        told = np.where(np.abs(there) < rounding, 0.0, there)
        return {s.name: float(v) for s, v in zip(self.branch.system.states, told)}

    def margin(self, z: np.ndarray) -> float:
        """How far a point (n,) is within the box, by its nearest bound: negative outside, infinite without a box."""
        place = {s.name: float(v) for s, v in zip(self.branch.system.states, z)}
        # To rounding, as the samples of a branch are.
        sides = (
            min(place[name] - low, high - place[name]) + EDGE * (high - low)
            for name, (low, high) in (self.box or {}).items()
        )
        return min(sides, default=float("inf"))

    def advance(self) -> Panel:
        """The next panel. Raises `PassageError` where the branch or the reduced flow ends."""
        nodes = chebyshev()[0]
        while self._length >= self._least:
            times = self.end + 0.5 * self._length * (nodes + 1.0)
            z = self._sampled(times)
            if z is not None:
                scale = self.units + np.abs(z).max(axis=0)
                if (tail(z.T) <= RESOLVED * scale).all():
                    panel = Panel(times, z)
                    self.panels.append(panel)
                    self.end, self.state = float(times[-1]), z[-1]
                    # Panels grow by this factor.
                    self._length *= 1.5
                    return panel
            self._length *= 0.5
        raise PassageError(
            f"the reduced orbit on the branch {self.asked} ends near {self.shown(self.state)}, slow time "
            f"{self.end:.6g}: the branch folds there or the field is singular.",
            "At a fold use fold_passage.",
        )

    def _sampled(self, times: np.ndarray) -> np.ndarray | None:
        system, m = self.branch.system, len(self.branch.system.x)
        units = self.units[: len(self._flow.states)]
        state = self.state[: len(units)] / units
        run = trajectory_of(
            self._flow,
            start=dict(zip((s.name for s in self._flow.states), map(float, state))),
            span=(float(times[0]), float(times[-1])),
            rtol=1e-14,
            atol=1e-16 * (1.0 + float(np.abs(state).max())),
            at=times,
            options=RunOptions(method=Method.DOP853, max_steps=2000),
        )
        if run.status is not Status.SUCCESS:
            return None
        along = units * run.y.T
        x = along[:, :m]
        try:
            y = _on(self.branch, x, along[:, m:])
        except BranchError:
            return None
        if (
            self.branch.graph is None
            and (np.abs(y - along[:, m:]) > 1e-9 * (units[m:] + np.abs(y).max(axis=0))).any()
        ):
            return None
        z = np.hstack([x, y.reshape(len(x), len(system.y))])
        return z if np.isfinite(z).all() else None

    def at(self, t: float) -> np.ndarray:
        """The orbit (n,) at a time that has been reached."""
        ends = [panel.t[-1] for panel in self.panels]
        panel = self.panels[min(int(np.searchsorted(ends, t)), len(ends) - 1)]
        return panel.at(np.array([t]))[0]

    def velocity(self, z: np.ndarray) -> np.ndarray:
        """(x', y') of the reduced flow at a point (n,) of the branch; `PassageError` where it folds."""
        m = len(self.branch.system.x)
        f, slopes = self.sampler.rates(z[None, :])[0, :m], self.slopes(z[None, :])[0]
        try:
            slope = np.linalg.solve(slopes[:, m:], slopes[:, :m] @ f)
        except np.linalg.LinAlgError:
            raise PassageError(
                "the branch folds where the orbit loses stability, as at a canard point, and what follows is not told.",
                "Start beyond the point, or ask `gsp.folded_singularities` or `gsp.canard_value` about it.",
                got=f"{self.named(z)}",
            ) from None
        return np.concatenate([f, -slope])

    def slopes(self, z: np.ndarray) -> np.ndarray:
        """(E_x, E_y) at points (k, n): (k, n_fast, n)."""
        return self._slopes(z, self.sampler.p).reshape(len(z), len(self.equations), -1)

    def eigenvalues(self, z: np.ndarray) -> np.ndarray:
        """Eigenvalues of g_y at points (k, n), the rightmost first, conjugates with positive imaginary part first."""
        matrices = self.sampler.fast_jacobian(z)
        if not np.isfinite(matrices).all():
            raise PassageError(f"the fast Jacobian is not finite along the orbit, near {self.shown(z[0])}.")
        values = np.linalg.eigvals(matrices).astype(complex)
        order = np.lexsort((-np.imag(values), -np.real(values)), axis=1)
        return np.take_along_axis(values, order, axis=1)

    def _noise(self, z: np.ndarray, values: np.ndarray) -> float:
        """What the error of the points (k, n) makes of the rightmost real parts `values` (k,) at most."""
        n = len(self.units)
        moved = z + RESOLVED * np.diag(self.units + np.abs(z).max(axis=0))[:, None, :]
        spectra = self.eigenvalues(moved.reshape(-1, n))
        return float(np.abs(np.real(spectra[:, 0]).reshape(n, -1) - values).sum(axis=0).max())

    def fast_jacobian(self, z: np.ndarray) -> np.ndarray:
        """g_y at one point (n,)."""
        return self.sampler.fast_jacobian(z[None, :])[0]

    def pieces(self, panel: Panel) -> list[ResolvedPanel]:
        """The rightmost eigenvalue over a panel, cut where its real part has kinks."""
        # Panels are halved so often where a rightmost real part has a kink: 2^-24 of a panel, whose square is
        # rounding.
        return self._resolve(panel, float(panel.t[0]), float(panel.t[-1]), 24)

    def _resolve(self, panel: Panel, first: float, last: float, depth: int) -> list[ResolvedPanel]:
        nodes, _, S = chebyshev()
        half = 0.5 * (last - first)
        t = first + half * (nodes + 1.0)
        spectra = self.eigenvalues(panel.at(t))
        leading = spectra[:, 0]
        values = np.real(leading)
        self.rate = max(self.rate, float(np.abs(spectra).max()))
        rest = tail(values[None, :])[0]
        noise = RESOLVED * self.rate
        if rest > noise:
            noise = max(noise, self._noise(panel.at(t), values))
        resolved = rest <= noise and _shows_its_zeros(values, noise)
        if resolved or depth == 0:
            return [ResolvedPanel(t, values, leading, half * (S @ values), not resolved)]
        middle = first + half
        return self._resolve(panel, first, middle, depth - 1) + self._resolve(panel, middle, last, depth - 1)


def _on(branch: Branch, x: np.ndarray, near: np.ndarray) -> np.ndarray:
    """The points (k, n_fast) of the branch over `x`, of an implicit one those next to `near`."""
    return branch.points(x, near=near) if branch.graph is None else branch.graph_values(x)


def _in_units(flow: VectorField, units: np.ndarray) -> VectorField:
    """The field with its states in `units`, powers of two."""
    rates = in_units(flow.equations, dict(zip(flow.states, units)))
    return VectorField(rates, epsilon=None, parameters=dict(flow.parameters))


def interpolate(t: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Values (m, ...) at Chebyshev nodes `t` (m,), at other times (k,), barycentric: (k, ...)."""
    weights = chebyshev()[1]
    distance = at[:, None] - t[None, :]
    hit = distance == 0.0
    ratio = np.where(hit.any(axis=1, keepdims=True), hit, weights / np.where(hit, 1.0, distance))
    return (ratio @ values) / ratio.sum(axis=1).reshape(-1, *([1] * (values.ndim - 1)))


def _shows_its_zeros(values: np.ndarray, noise: float) -> bool:
    """Whether the interpolant of `values` (m,) at the nodes has as many zeros as these have changes of sign.

    Zeros between which it keeps within `noise` are none.
    """
    nodes = chebyshev()[0]
    zeros = chebroots(coefficients(values[None, :])[0])
    zeros = np.sort(zeros.real[(zeros.imag == 0.0) & (np.abs(zeros) < 1.0)])
    middles = np.concatenate([[-1.0], 0.5 * (zeros[1:] + zeros[:-1]), [1.0]])
    between = interpolate(nodes, values, middles)
    between = between[np.abs(between) > noise]
    return int((between[:-1] * between[1:] < 0.0).sum()) <= int((values[:-1] * values[1:] < 0.0).sum())


def crossing(t: np.ndarray, values: np.ndarray, level: float, i: int, after: float = -np.inf) -> float:
    """The time between nodes i - 1 and i, behind `after`, where the interpolant of `values` meets `level`.

    Node i if both are beyond it.
    """

    def above(s: float) -> float:
        return float(interpolate(t, values, np.array([s]))[0]) - level

    begin, end = max(float(t[i - 1]), after), float(t[i])
    at_begin = above(begin) if begin == after else float(values[i - 1]) - level
    found = root(above, begin, end, ends=(at_begin, float(values[i]) - level))
    return end if found is None else found
