"""Where the layer flow y' = g(x0, y, 0) leads from a start, and the layer itself, sampled to rounding."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from gsp.critical.branch import Branch
from gsp.errors import BranchError, HyperbolicityError
from gsp.fibres.decaying_signals import Panels, Signal, SignalRing, chebyshev, tail
from gsp.fibres.layer_flow import RESOLVED, LayerFlow
from gsp.integration.trajectory import Method, RunOptions, trajectory_of
from gsp.roots import root

# Fast times 1/gap after which a start is expected near the branch.
PATIENCE = 40.0
# Distance, in the layer's units, at which the layer is continued by its linearisation: the square is rounding.
LINEAR = 1e-9
# The layer is followed until it is this small, so that powers of tau times it are below rounding too.
GONE = 1e-24
# Length of a panel in fastest times 1/rho while the fastest mode may still be there, and the factor by which panels
# grow afterwards, up to as many slowest times 1/gap: when they are too long for a mode it has decayed.
PANEL_TIMES, GROWTH = 2.0, 1.2
# Ratio of the fast rates above which the fast block counts as having two time scales of its own.
SPREAD = 1e4
NEWTON_STEPS = 8
# A panel that is not resolved, to `RESOLVED` or rounding of the fast variables, is halved.
ROUNDING = 2 * np.finfo(float).eps
# The same for the terms of a series along the layer, relative to their largest value; panels are halved so often.
ROUGH, REFINEMENTS = 1e-11, 8


@dataclass(frozen=True, eq=False)
class Landing:
    """A layer that ends on the branch: `point` y on M0, `panels`, and samples (P, m, n) of Y_0 - y.

    `limit` is g_y at the point and `eigenvalues` its eigenvalues, both after reversal of time when `direction` is
    -1 (a repelling branch). `units` (n,) are the sizes of the fast variables along the layer. `kinks` are the
    fast times at which it crosses a kink of f or g, `jumps` those at which f jumps; panels end there.
    """

    point: np.ndarray
    panels: Panels
    samples: np.ndarray
    limit: np.ndarray
    eigenvalues: np.ndarray
    direction: int
    units: np.ndarray
    kinks: tuple[float, ...] = ()
    jumps: tuple[float, ...] = ()

    @property
    def gap(self) -> float:
        """Least |Re lambda| of g_y at the landing point, in fast time."""
        return float(np.abs(np.real(self.eigenvalues)).min())

    def ring(self, entries: Sequence[Sequence[Any]] | None = None) -> SignalRing:
        """The ring of signals over the panels; `entries` are those of g_y along the layer."""
        n = len(self.point)
        jacobian = np.zeros((*self.panels.tau.shape, n, n))
        for i, row in enumerate(entries or ()):
            for j, entry in enumerate(row):
                if entry.samples is not None:
                    jacobian[:, :, i, j] = entry.samples
        return SignalRing(self.panels, self.limit, jacobian, self.units)

    def rough(self, terms: Iterable[Signal]) -> np.ndarray:
        """Panels (P,) on which some of `terms` is not resolved."""
        found = np.zeros(len(self.samples), dtype=bool)
        for term in terms:
            if term.samples is not None:
                found |= ~(tail(term.samples) <= ROUGH * size_of(term))
        return found

    def halved(self, chosen: np.ndarray) -> Landing:
        """The same layer with the panels `chosen` (P,) cut in two."""
        ends, samples = [0.0], []
        for i, piece in enumerate(self.samples):
            first, last = self.panels.ends[i], self.panels.ends[i + 1]
            if not chosen[i]:
                ends.append(last)
                samples.append(piece)
                continue
            own, middle = Panels(np.array([first, last])), 0.5 * (first + last)
            for left, right in ((first, middle), (middle, last)):
                times = np.clip(Panels(np.array([left, right])).tau[0], first, last)
                ends.append(right)
                samples.append(
                    np.stack([own.interpolate(column[None, :], times) for column in piece.T], axis=1)
                )
        return replace(self, panels=Panels(np.array(ends)), samples=np.array(samples))

    def signals(self, ring: SignalRing) -> list[Signal]:
        """Y_0 as elements of `ring`."""
        return [
            Signal(ring, np.array([value]), self.samples[:, :, i].copy()) for i, value in enumerate(self.point)
        ]


def size_of(term: Signal) -> float:
    """The largest value along the layer, and that which it tends to."""
    return float((0.0 if term.samples is None else np.abs(term.samples).max()) + np.abs(term.outer[0]))


def land(branch: Branch, x: np.ndarray, y: np.ndarray) -> Landing:
    """The layer from (x, y) to `branch`, forward in time on an attracting branch, backward on a repelling one.

    Raises `BranchError` when it leads elsewhere, `HyperbolicityError` on a saddle-type branch, at a singular point, and
    when the fast rates span more than four decades.
    """
    point = _point(branch, LayerFlow.within(branch.system, x, y), y)
    layer = LayerFlow.within(branch.system, x, point, y - point)
    limit = layer.jacobian(point[None, :] / layer.units)[0]
    eigenvalues = np.linalg.eigvals(limit)
    real, scale = eigenvalues.real, np.abs(eigenvalues).max()
    where = branch.system.place(zip(branch.system.x, x))
    neutral = np.abs(real) <= 1e-12 * scale
    if not np.isfinite(limit).all() or neutral.any():
        turns = np.isfinite(limit).all() and (np.abs(eigenvalues[neutral]) > 1e-12 * scale).all()
        raise HyperbolicityError(
            f"the branch {branch} is not normally hyperbolic over {where}: the fast eigenvalues are "
            f"{np.array2string(eigenvalues, precision=4)}.",
            "There is no fibre to project along; "
            + ("what turns fast is averaged, by `gsp average`." if turns else "move the start."),
        )
    if (real > 0).any() and (real < 0).any():
        raise HyperbolicityError(
            f"the branch {branch} is of saddle type over {where}: fast eigenvalues "
            f"{np.array2string(eigenvalues, precision=4)}.",
            "Its stable and unstable fibres differ, and a stable one passes only through starts on the "
            "stable manifold, which rounding leaves at once: where a run lands is told only of layers that are linear "
            "in the fast variables. Give a start on the slow manifold.",
        )
    if scale > SPREAD * np.abs(real).min():
        raise HyperbolicityError(
            f"the fast variables of the branch {branch} over {where} have two time scales of their own: fast "
            f"rates from {np.abs(real).min():.3g} to {scale:.3g}.",
            "Give the slower ones a scale between, or declare them slow.",
        )
    if (real > 0).all():
        layer, limit, eigenvalues = replace(layer, direction=-1), -limit, -eigenvalues
    panels, samples, kinks, jumps = _followed(
        branch, layer, y / layer.units, point / layer.units, limit, eigenvalues
    )
    own = limit / (layer.units / layer.units[:, None])
    samples = samples * layer.units
    return Landing(point, panels, samples, own, eigenvalues, layer.direction, layer.units, kinks, jumps)


def _point(branch: Branch, layer: LayerFlow, y: np.ndarray) -> np.ndarray:
    """The branch's point over x; where an implicit branch has several and no seed, the one the layer leads to."""
    try:
        return branch.points(layer.x[None, :])[0]
    except BranchError:
        if branch.is_explicit or branch.seed is not None:
            raise
    units = layer.units
    scale = np.abs(np.linalg.eigvals(layer.jacobian(y[None, :] / units)[0])).max() or 1.0
    span = PATIENCE / scale
    # The same when the sheet, and with it the gap, is not known yet: from the fastest time on.
    for _ in range(24):
        run = trajectory_of(
            layer.flow(), start=_fast_values(branch, y / units), span=(0.0, span), rtol=1e-8, atol=1e-10
        )
        if not run.status.ok:
            break
        end = run.y[:, -1] * units
        found, good = branch.follow(layer.x[None, :], start=(layer.x, end))
        if good[0] and np.linalg.norm((found[0] - end) / units) < 1e-6:
            return branch.points(layer.x[None, :], near=end)[0]
        span *= 2.0
    raise BranchError(
        f"the branch {branch} has several sheets and the layer from {branch.system.place(_fast_values(branch, y))} "
        f"settles on none of them ({run.message}).",
        "Fix the sheet with branch.through({...}).",
    )


def _followed(branch, layer: LayerFlow, y, point, limit, eigenvalues):
    """Panels, samples (P, m, n) of Y_0 - point, all in the layer's units, and the times of kinks and of jumps of f."""
    gap, fastest = np.abs(eigenvalues.real).min(), np.abs(eigenvalues).max()
    longest = PANEL_TIMES / fastest
    ends, samples, kinks, jumps = [0.0], [], [], []
    eta = y - point
    if np.linalg.norm(eta) > LINEAR and not layer.is_affine:
        ends, samples, kinks, jumps = _nonlinear(branch, layer, y, point, gap, longest)
        eta = samples[-1][-1]
    # The rest by the linearisation.
    S = chebyshev()[2]
    m, n = len(S), len(point)
    end, length = ends[-1] + np.log(max(LINEAR, np.linalg.norm(eta)) / GONE) / gap, longest
    while ends[-1] < end:
        matrix = np.eye(m * n) - 0.5 * length * np.kron(S, limit)
        piece = np.linalg.solve(matrix, np.tile(eta, m)).reshape(m, n)
        samples.append(piece)
        ends.append(ends[-1] + length)
        eta = piece[-1]
        length = min(GROWTH * length, PANEL_TIMES / gap)
    return Panels(np.array(ends)), np.array(samples), tuple(kinks), tuple(jumps)


def _nonlinear(branch, layer: LayerFlow, y, point, gap, longest):
    """Panels and samples of Y_0 - point down to where the layer is linear, and the times of kinks and of jumps of f."""
    span = PATIENCE / gap
    names = _fast_values(branch, y)
    run = None
    options = RunOptions(Method.DOP853)
    for _ in range(7):
        run = trajectory_of(layer.flow(), names, (0.0, span), rtol=1e-13, atol=1e-15, options=options)
        distance = np.linalg.norm(run.y - point[:, None], axis=0)
        if not run.status.ok or distance[-1] <= LINEAR:
            break
        span *= 2.0
    assert run is not None
    if not run.status.ok or distance[-1] > LINEAR:
        raise BranchError(_elsewhere(branch, layer, y, point, run))
    # From here to the end it stays near.
    last = len(distance) - int(np.argmax(distance[::-1] > LINEAR))
    end, length = float(run.t[min(last, len(run.t) - 1)]), longest
    ends, samples, eta = [0.0], [], y - point
    kinks, jumps, found = [], [], _crossings(layer, run, end)
    while ends[-1] < end:
        right = min(ends[-1] + length, end)
        switches = bool(found) and found[0][0] <= right
        if switches:
            right = _kink(layer, point, eta, run, ends[-1], *found.pop(0))
            kinks.append(right)
        pieces = _resolved(layer, point, eta, run, ends[-1], right, 0)
        jumping = layer.jumps(point + pieces[-1][1][-1]) if pieces and switches else np.zeros(1, dtype=bool)
        if jumping.any():
            jumps.append(right)
        if pieces is None or jumping[-len(point) :].any():
            place = branch.system.place(_fast_values(branch, y * layer.units))
            raise BranchError(
                f"the layer from {place} to the branch {branch} could not be resolved "
                f"between the fast times {ends[-1]:.4g} and {right:.4g}: the field is not smooth there.",
                "Move the start.",
            )
        for stop, piece in pieces:
            ends.append(stop)
            samples.append(piece)
        eta = samples[-1][-1]
        length = min(GROWTH * length, PANEL_TIMES / gap)
    return ends, samples, kinks, jumps


def _crossings(layer: LayerFlow, run, end: float) -> list[tuple[float, int]]:
    """When the layer crosses a switching function up to `end`, and which, in order, to the run's accuracy."""
    steps = run.t[: int(np.searchsorted(run.t, end)) + 1]
    # Places in a step at which switching functions are looked at.
    times = np.interp(np.linspace(0, len(steps) - 1, 8 * (len(steps) - 1) + 1), np.arange(len(steps)), steps)
    values = layer.switching(run.at(times).T)
    found = []
    for i, k in np.argwhere(values[:-1] * values[1:] < 0.0):
        time = root(lambda t, k=k: float(layer.switching(run.at(t)[None, :])[0, k]), times[i], times[i + 1])
        if time is not None:
            found.append((time, int(k)))
    return sorted(found)


def _kink(layer: LayerFlow, point, left, run, first: float, time: float, k: int) -> float:
    """The time at which switching function k vanishes, to rounding: secant steps with the panel that ends there."""
    nodes = chebyshev()[0]
    for _ in range(NEWTON_STEPS):
        half = 0.5 * (time - first)
        guess = run.at(np.clip(first + half * (nodes + 1.0), first, time)).T - point
        eta = _collocate(layer, point, left, half, guess)
        if eta is None:
            break
        before, last = layer.switching(point + eta[-2:])[:, k]
        step = last * half * (nodes[-1] - nodes[-2]) / (last - before)
        if not abs(step) < half:
            break
        time -= step
        if abs(step) <= ROUNDING * time:
            break
    return time


def _resolved(
    layer: LayerFlow, point, left, run, first: float, last: float, depth: int
) -> list[tuple[float, np.ndarray]] | None:
    """Right ends and samples of panels from `first` to `last` on which the layer is a polynomial to rounding."""
    nodes, _, _ = chebyshev()
    half = 0.5 * (last - first)
    guess = run.at(np.clip(first + half * (nodes + 1.0), first, last)).T - point
    eta = _collocate(layer, point, left, half, guess)
    if eta is not None and tail(eta.T).max() <= RESOLVED * np.abs(eta).max() + ROUNDING:
        return [(last, eta)]
    if depth == 14:
        return None
    middle = first + half
    before = _resolved(layer, point, left, run, first, middle, depth + 1)
    if before is None:
        return None
    after = _resolved(layer, point, before[-1][1][-1], run, middle, last, depth + 1)
    return None if after is None else before + after


def _collocate(layer: LayerFlow, point, left, half: float, eta: np.ndarray) -> np.ndarray | None:
    """eta = left + half S g(point + eta) by Newton's method, from the integrator's dense output; None if it fails."""
    S = chebyshev()[2]
    m, n = eta.shape
    size = np.inf
    for _ in range(NEWTON_STEPS):
        defect = left + half * (S @ layer.rates(point + eta)) - eta
        jacobian = layer.jacobian(point + eta)
        if not (np.isfinite(defect).all() and np.isfinite(jacobian).all()):
            return None
        matrix = np.eye(m * n) - half * np.einsum("ij,jab->iajb", S, jacobian).reshape(m * n, m * n)
        step = np.linalg.solve(matrix, defect.ravel()).reshape(m, n)
        eta = eta + step
        size = np.abs(step).max()
        if size <= ROUNDING * (np.abs(eta).max() + np.abs(point).max()):
            return eta
    return eta if size <= 1e-13 * (1.0 + np.abs(eta).max()) else None


def _elsewhere(branch: Branch, layer: LayerFlow, y, point, run) -> str:
    start, end, there = (
        branch.system.place(_fast_values(branch, at * layer.units)) for at in (y, run.y[:, -1], point)
    )
    over = branch.system.place(zip(branch.system.x, layer.x))
    backward = "" if layer.direction > 0 else " run backward, as the branch repels,"
    leads, remedy = f"leads to {end}", "Project to the branch it leads to, or move the start."
    if not run.status.ok and np.abs(run.y[:, -1]).max() > np.sqrt(1.0 / ROUNDING):
        leads, remedy = "leads off to infinity", "Move the start."
    elif not run.status.ok:
        leads += f" ({run.status.name})"
    return (
        f"the start is outside the basin of the branch {branch}: over {over} the layer flow from {start}{backward} "
        f"{leads} after fast time {run.t[-1]:.4g}, not to {there}. {remedy}"
    )


def _fast_values(branch: Branch, y: np.ndarray) -> dict[str, float]:
    return {s.name: float(value) for s, value in zip(branch.system.y, y)}
