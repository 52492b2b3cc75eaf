"""Where the layer flow y' = g(x0, y, 0) leads from a start, and the layer itself, sampled to rounding."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.critical.branch import Branch
from gsp.errors import BranchError, HyperbolicityError
from gsp.fibres.decaying_signals import Panels, Signal, SignalRing, chebyshev, tail
from gsp.integration.trajectory import Method, trajectory_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.systems.declaration import exact
from gsp.systems.system import SlowFastSystem, VectorField

# Fast times 1/gap after which a start is expected near the branch, and how often that is doubled.
PATIENCE, DOUBLINGS = 40.0, 7
# The same when the sheet, and with it the gap, is not known yet: from the fastest time on.
SEARCH_DOUBLINGS = 24
# Distance, relative to 1 + |y|, at which the layer is continued by its linearisation: the square is rounding.
LINEAR = 1e-9
# The layer is followed until it is this small, so that powers of tau times it are below rounding too.
GONE = 1e-24
# Length of a panel in fastest times 1/rho while the fastest mode may still be there, and the factor by which panels
# grow afterwards, up to as many slowest times 1/gap: when they are too long for a mode it has decayed.
PANEL_TIMES, GROWTH = 2.0, 1.2
# Ratio of the fast rates above which the fast block counts as having two time scales of its own.
SPREAD = 1e4
NEWTON_STEPS = 8
# A panel is resolved when its last Chebyshev coefficients are this small, relative to the layer on it, or rounding of
# the fast variables; else it is halved, at most so often.
RESOLVED, ROUNDING, DEEPEST = 1e-13, 2 * np.finfo(float).eps, 14
# The same for the terms of a series along the layer, relative to their largest value; panels are halved so often.
ROUGH, REFINEMENTS = 1e-11, 8


@dataclass(frozen=True, eq=False)
class Landing:
    """A layer that ends on the branch: `point` y on M0, `panels`, and samples (P, m, n) of Y_0 - y.

    `limit` is g_y at the point and `eigenvalues` its eigenvalues, both after reversal of time when `direction` is
    -1 (a repelling branch).
    """

    point: np.ndarray
    panels: Panels
    samples: np.ndarray
    limit: np.ndarray
    eigenvalues: np.ndarray
    direction: int

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
        return SignalRing(self.panels, self.limit, jacobian)

    def rough(self, terms: Iterable[Signal]) -> np.ndarray:
        """Panels (P,) on which some of `terms` is not resolved."""
        found = np.zeros(len(self.samples), dtype=bool)
        for term in terms:
            if term.samples is not None:
                scale = np.abs(term.samples).max() + np.abs(term.outer[0])
                found |= ~(tail(term.samples) <= ROUGH * scale)
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


@dataclass(frozen=True, eq=False)
class _Layer:
    """g(x0, y, 0) and g_y of `system`, both times `direction`."""

    system: SlowFastSystem
    x: np.ndarray
    direction: int = 1

    def rates(self, y: np.ndarray) -> np.ndarray:
        return self.direction * self._function(self._rates, y)

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        n = len(self.system.y)
        entries = [derivative(rate, s) for rate in self._rates for s in self.system.y]
        return self.direction * self._function(entries, y).reshape(-1, n, n)

    @property
    def _rates(self) -> list[sp.Expr]:
        return [laurent(g, self.system.epsilon, order=0).get(0, sp.Integer(0)) for g in self.system.g]

    def _function(self, outputs: list[sp.Expr], y: np.ndarray) -> np.ndarray:
        function = compile_over(self.system, outputs)
        z = np.hstack([np.broadcast_to(self.x, (len(y), len(self.x))), y])
        return function(z, compile_flow(self.system).constants)

    def flow(self) -> VectorField:
        values = {s: exact(float(value)) for s, value in zip(self.system.x, self.x)}
        return VectorField(
            {s: self.direction * rate for s, rate in zip(self.system.y, self._rates)},
            epsilon=None,
            parameters={**self.system.parameters, **values},
        )


def land(branch: Branch, x: np.ndarray, y: np.ndarray) -> Landing:
    """The layer from (x, y) to `branch`, forward in time on an attracting branch, backward on a repelling one.

    Raises `BranchError` when it leads elsewhere, `HyperbolicityError` on a saddle-type branch, at a singular point, and
    when the fast rates span more than four decades.
    """
    layer = _Layer(branch.system, x)
    point = _point(branch, layer, y)
    limit = layer.jacobian(point[None, :])[0]
    eigenvalues = np.linalg.eigvals(limit)
    real, scale = eigenvalues.real, np.abs(eigenvalues).max()
    where = ", ".join(f"{s.name} = {v:.6g}" for s, v in zip(branch.system.x, x))
    if not np.isfinite(limit).all() or np.abs(real).min() <= 1e-12 * scale:
        raise HyperbolicityError(
            f"the branch {branch} is not normally hyperbolic over {where}: the fast eigenvalues are "
            f"{np.array2string(eigenvalues, precision=4)}.",
            "There is no fibre to project along; move the start.",
        )
    if (real > 0).any() and (real < 0).any():
        raise HyperbolicityError(
            f"the branch {branch} is of saddle type over {where}: fast eigenvalues "
            f"{np.array2string(eigenvalues, precision=4)}.",
            "Its stable and unstable fibres differ, and a stable one passes only through starts on the "
            "stable manifold, which rounding leaves at once. This is computed exactly, for layers that are "
            "linear in the fast variables; here give a start on the slow manifold.",
        )
    if scale > SPREAD * np.abs(real).min():
        raise HyperbolicityError(
            f"the fast variables of the branch {branch} over {where} have two time scales of their own: fast "
            f"rates from {np.abs(real).min():.3g} to {scale:.3g}.",
            "Give the slower ones a scale between, or declare them slow.",
        )
    if (real > 0).all():
        layer, limit, eigenvalues = replace(layer, direction=-1), -limit, -eigenvalues
    panels, samples = _followed(branch, layer, y, point, limit, eigenvalues)
    return Landing(point, panels, samples, limit, eigenvalues, layer.direction)


def _point(branch: Branch, layer: _Layer, y: np.ndarray) -> np.ndarray:
    """The branch's point over x; where an implicit branch has several and no seed, the one the layer leads to."""
    try:
        return branch.points(layer.x[None, :])[0]
    except BranchError:
        if branch.is_explicit or branch.seed is not None:
            raise
    scale = np.abs(np.linalg.eigvals(layer.jacobian(y[None, :])[0])).max() or 1.0
    span = PATIENCE / scale
    for _ in range(SEARCH_DOUBLINGS):
        atol = 1e-10 * min(1.0, float(np.abs(y).max()) or 1.0)
        run = trajectory_of(layer.flow(), start=_fast_values(branch, y), span=(0.0, span), rtol=1e-8, atol=atol)
        if not run.status.ok:
            break
        found, good = branch.follow(layer.x[None, :], start=(layer.x, run.y[:, -1]))
        if good[0] and np.linalg.norm(found[0] - run.y[:, -1]) < 1e-6 * _size(found[0], y):
            return branch.points(layer.x[None, :], near=run.y[:, -1])[0]
        span *= 2.0
    raise BranchError(
        f"the branch {branch} has several sheets and the layer from {_fast_values(branch, y)} settles on none of "
        f"them ({run.message}).",
        "Fix the sheet with branch.through({...}).",
    )


def _size(point: np.ndarray, y: np.ndarray) -> float:
    """What is small beside it is small on the layer from y to `point`: 1 and the point's size, less in tiny units."""
    far = float(np.linalg.norm(point))
    return min(1.0 + far, far + float(np.linalg.norm(y - point)))


def _followed(branch, layer: _Layer, y, point, limit, eigenvalues) -> tuple[Panels, np.ndarray]:
    gap, fastest = np.abs(eigenvalues.real).min(), np.abs(eigenvalues).max()
    scale = _size(point, y)
    longest = PANEL_TIMES / fastest
    ends, samples = [0.0], []
    eta = y - point
    if np.linalg.norm(eta) > LINEAR * scale:
        ends, samples = _nonlinear(branch, layer, y, point, gap, scale, longest)
        eta = samples[-1][-1]
    # The rest by the linearisation.
    S = chebyshev()[2]
    m, n = len(S), len(point)
    end, length = ends[-1] + np.log(LINEAR / GONE) / gap, longest
    while ends[-1] < end:
        matrix = np.eye(m * n) - 0.5 * length * np.kron(S, limit)
        piece = np.linalg.solve(matrix, np.tile(eta, m)).reshape(m, n)
        samples.append(piece)
        ends.append(ends[-1] + length)
        eta = piece[-1]
        length = min(GROWTH * length, PANEL_TIMES / gap)
    return Panels(np.array(ends)), np.array(samples)


def _nonlinear(branch, layer: _Layer, y, point, gap, scale, longest) -> tuple[list[float], list[np.ndarray]]:
    """Panels and samples of Y_0 - point down to where the layer is linear."""
    span = PATIENCE / gap
    names = _fast_values(branch, y)
    run = None
    for _ in range(DOUBLINGS):
        run = trajectory_of(
            layer.flow(), start=names, span=(0.0, span), rtol=1e-13, atol=1e-15 * scale, method=Method.DOP853
        )
        distance = np.linalg.norm(run.y - point[:, None], axis=0)
        if not run.status.ok or distance[-1] <= LINEAR * scale:
            break
        span *= 2.0
    assert run is not None
    if not run.status.ok or distance[-1] > LINEAR * scale:
        raise BranchError(_elsewhere(branch, layer, names, point, run))
    # From here to the end it stays near.
    last = len(distance) - int(np.argmax(distance[::-1] > LINEAR * scale))
    end, length = float(run.t[min(last, len(run.t) - 1)]), longest
    ends, samples, eta = [0.0], [], y - point
    while ends[-1] < end:
        right = min(ends[-1] + length, end)
        pieces = _resolved(layer, point, scale, eta, run, ends[-1], right, 0)
        if pieces is None:
            place = ", ".join(f"{name} = {value:g}" for name, value in names.items())
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
    return ends, samples


def _resolved(
    layer: _Layer, point, scale: float, left, run, first: float, last: float, depth: int
) -> list[tuple[float, np.ndarray]] | None:
    """Right ends and samples of panels from `first` to `last` on which the layer is a polynomial to rounding."""
    nodes, _, _ = chebyshev()
    half = 0.5 * (last - first)
    guess = run.at(np.clip(first + half * (nodes + 1.0), first, last)).T - point
    eta = _collocate(layer, point, scale, left, half, guess)
    if eta is not None and tail(eta.T).max() <= RESOLVED * np.abs(eta).max() + ROUNDING * scale:
        return [(last, eta)]
    if depth == DEEPEST:
        return None
    middle = first + half
    before = _resolved(layer, point, scale, left, run, first, middle, depth + 1)
    if before is None:
        return None
    after = _resolved(layer, point, scale, before[-1][1][-1], run, middle, last, depth + 1)
    return None if after is None else before + after


def _collocate(layer: _Layer, point, scale: float, left, half: float, eta: np.ndarray) -> np.ndarray | None:
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
    return eta if size <= 1e-13 * (scale + np.abs(eta).max()) else None


def _elsewhere(branch: Branch, layer: _Layer, start, point, run) -> str:
    end = ", ".join(f"{s.name} = {v:.6g}" for s, v in zip(branch.system.y, run.y[:, -1]))
    there = ", ".join(f"{s.name} = {v:.6g}" for s, v in zip(branch.system.y, point))
    over = ", ".join(f"{s.name} = {v:.6g}" for s, v in zip(branch.system.x, layer.x))
    backward = "" if layer.direction > 0 else " run backward, as the branch repels,"
    how = "" if run.status.ok else f" ({run.status.name})"
    return (
        f"the start is outside the basin of the branch {branch}: over {over} the layer flow from {start}{backward} "
        f"leads to {end}{how} after fast time {run.t[-1]:.4g}, not to {there}. "
        "Project to the branch it leads to, or move the start."
    )


def _fast_values(branch: Branch, y: np.ndarray) -> dict[str, float]:
    return {s.name: float(value) for s, value in zip(branch.system.y, y)}
