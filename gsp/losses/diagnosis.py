"""Names for the places where an eigenvalue reaches the axis, by the coefficients of the layer problem there.

Coefficients are compared with one another at the size of the region: x moves by its widths, and along the fast fibre
v = <l, y - y*> by as much as the branch does. So the names do not depend on linear changes of the variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gsp.continuation.layer_problem import LayerProblem
from gsp.differentiation import derivative
from gsp.laurent import laurent
from gsp.losses import consequences, kinds
from gsp.losses.consequences import OMEGA_0, Verdict
from gsp.losses.fibre import FibreOrder, order_along
from gsp.losses.kinds import Loss, LossKind
from gsp.normal_forms import (
    bogdanov_takens,
    cubic_coefficient,
    first_lyapunov,
    null_vectors,
    quadratic_coefficient,
)
from gsp.region import Interval
from gsp.sampling import Sampler

# A term is zero when it is below this, relative to the largest one, at the size of the region.
ZERO_TERM = 1e-6
# Singular values and eigenvalues that count as zero, relative to the largest eigenvalue in the region. A double zero
# spreads like the square root of what its place is off.
ZERO_SINGULAR = 1e-6
DOUBLE_ZERO = 1e-4
# What the place of a branch point may be off, relative to the region.
OFF = 1e-9
# Share of the region over which the layer problem is followed along its fast fibre.
ALONG = 0.1
# Losses nearer than this to an edge of the region, relative to its width, are on the edge.
EDGE = 1e-7
TYPICAL = 65
# A motion along the fibre smaller than this share of what the branch moves is none: multiple zeros are inexact points.
INEXACT = 1e-3
# Fast coordinates that differ by less are equal: points of a branch are found to 1e-12 (1 + |y|).
ROUNDING = 1e-10
# Where a cubic coefficient vanishes the place is known to a root of rounding only.
ZERO_CUBIC = 1e-4
CUBIC = 3.0


class Found(NamedTuple):
    """A place that the search met: z = (x, y), and what crosses there."""

    z: np.ndarray
    crossing: str

    @property
    def is_pole(self) -> bool:
        """Whether something goes to infinity here."""
        return self.crossing in (kinds.BRANCH_POLE, kinds.FIELD_POLE)


@dataclass(frozen=True)
class Local:
    """Derivatives of g by z = (x, y) at `z`, the slow rates, and the part of g of order epsilon."""

    z: np.ndarray
    A: np.ndarray
    g_x: np.ndarray
    second: np.ndarray
    third: np.ndarray
    slow: np.ndarray
    push: np.ndarray

    @property
    def g_yy(self) -> np.ndarray:
        """(n_fast, n_fast, n_fast)."""
        nx = self.g_x.shape[1]
        return self.second[:, nx:, nx:]

    @property
    def is_finite(self) -> bool:
        """Whether every derivative exists here."""
        return all(bool(np.isfinite(a).all()) for a in (self.A, self.g_x, self.second, self.third))


class Diagnosis:
    """Names losses of one branch in one box; `samples` (m, n) are points on the branch, `scale` its largest |lambda|."""

    def __init__(
        self, sampler: Sampler, box: Mapping[str, Interval], scale: float, samples: np.ndarray
    ) -> None:
        self.sampler, self.box, self.scale = sampler, box, scale
        system = sampler.system
        fixed = dict(zip(system.parameters, map(float, sampler.p[1:])))
        self.problem = LayerProblem(system, tuple(system.x), fixed)
        self.nx = len(system.x)
        self.widths = np.array([box[s.name][1] - box[s.name][0] for s in system.x])
        chosen = np.linspace(0, len(samples) - 1, min(len(samples), TYPICAL)).astype(int)
        self.samples = samples[chosen]

    @cached_property
    def _rates(self):
        epsilon = self.sampler.system.epsilon
        push = [laurent(g, epsilon, order=1).get(1, 0 * epsilon) for g in self.sampler.system.g]
        return self.sampler.compiled([*self.sampler.f, *push])

    @cached_property
    def _fastest(self) -> np.ndarray:
        """Largest |f| over the samples (nx,)."""
        values = np.abs(self._rates(self.samples, self.sampler.p)[:, : self.nx])
        return np.max(np.where(np.isfinite(values), values, 0.0), axis=0, initial=0.0)

    def local(self, z: np.ndarray) -> Local:
        """Everything that names are decided by, at one point."""
        J = self.problem.jacobian(z)
        rates = self._rates(z, self.sampler.p)
        return Local(
            z,
            J[:, self.nx :],
            J[:, : self.nx],
            self.problem.second(z),
            self.problem.third(z),
            rates[: self.nx],
            rates[self.nx :],
        )

    def push_jacobian(self, z: np.ndarray) -> np.ndarray:
        """dg_1/dy at z (n_fast, n_fast), g = g_0 + epsilon g_1 + ..."""
        system = self.sampler.system
        push = [laurent(g, system.epsilon, order=1).get(1, 0 * system.epsilon) for g in system.g]
        entries = self.sampler.compiled([derivative(e, y) for e in push for y in system.y])
        return entries(z, self.sampler.p).reshape(len(system.y), -1)

    def loss(
        self,
        z: np.ndarray,
        crossing: str,
        kind: LossKind,
        test: str,
        value: float,
        verdict: Verdict,
        *,
        coefficients: Mapping[str, float] | None = None,
        note: str = "",
    ) -> Loss:
        """A `Loss` with its point, eigenvalue and edge filled in."""
        values = self.sampler.eigenvalues(z[None, :])[0]
        by = np.abs(values.real) if crossing in (kinds.PAIR, kinds.PAIR_EVERYWHERE) else np.abs(values)
        eigenvalue = complex(values[np.argmin(np.nan_to_num(by, nan=np.inf))])
        names = [s.name for s in self.sampler.system.states]
        everywhere = crossing in (kinds.EVERYWHERE, kinds.PAIR_EVERYWHERE)
        on_edge = not everywhere and any(
            min(abs(value - low), abs(value - high)) <= EDGE * (high - low)
            for name, value in zip(names, z)
            for low, high in [self.box.get(name, (-np.inf, np.inf))]
            if np.isfinite(high - low)
        )
        return Loss(
            point=dict(zip(names, map(float, z))),
            eigenvalue=eigenvalue,
            crossing=crossing,
            kind=kind,
            test=test,
            value=float(value),
            coefficients=dict(coefficients or {}),
            consequence=verdict.consequence,
            may_reduce=verdict.may_reduce,
            remedy=verdict.remedy,
            note=note,
            on_edge=on_edge,
        )

    # -- zero eigenvalues --------------------------------------------------------------------------

    def zero(self, z: np.ndarray) -> Loss:
        """The loss at z, where g_y is singular."""
        at = self.local(z)
        determinant = float(np.linalg.det(at.A))
        if not at.is_finite:
            return self._degenerate(at, determinant, "g has no second or third derivative here")
        values = np.linalg.eigvals(at.A)
        singular = np.linalg.svd(at.A, compute_uv=False)
        corank = int((singular <= ZERO_SINGULAR * max(self.scale, singular[0])).sum())
        near = np.abs(values) <= DOUBLE_ZERO * self.scale
        on_axis = (np.abs(values.real) <= ZERO_SINGULAR * self.scale) & ~near & (np.abs(values.imag) > 0.0)
        if corank > 1:
            return self._degenerate(at, determinant, f"{corank} zero eigenvalues with {corank} null vectors")
        if on_axis.any():
            return self._degenerate(at, determinant, "a zero eigenvalue and an imaginary pair together")
        if near.sum() == 2:
            return self._double_zero(at, determinant)
        if near.sum() > 2:
            if near.all():
                test = f"det g_y = {determinant:.3g}, largest |lambda|"
                return self.loss(
                    z, kinds.ZERO, LossKind.NILPOTENT, test, np.abs(values).max(), consequences.NILPOTENT
                )
            return self._degenerate(at, determinant, f"{near.sum()} zero eigenvalues with one null vector")
        others = int((values.real > ZERO_SINGULAR * self.scale).sum())
        note = f"{others} of the other fast directions are unstable, so orbits leave anyway" if others else ""
        return self._simple_zero(at, determinant, note)

    def _degenerate(
        self, at: Local, value: float, note: str, coefficients: Mapping[str, float] | None = None
    ) -> Loss:
        verdict = consequences.DEGENERATE
        return self.loss(
            at.z,
            kinds.ZERO,
            LossKind.DEGENERATE,
            "det g_y",
            value,
            verdict,
            coefficients=coefficients,
            note=note,
        )

    def _double_zero(self, at: Local, determinant: float) -> Loss:
        a, b = bogdanov_takens(at.A, at.g_yy)
        size = float(np.abs(at.g_yy).sum())
        coefficients = {"a": a, "b": b, "a/b": a / b} if b else {"a": a, "b": b}
        trace = float(np.trace(at.A))
        test = f"det g_y = {determinant:.3g}, trace of the block"
        if min(abs(a), abs(b)) > ZERO_TERM * size > 0.0:
            kind, verdict, note = LossKind.BOGDANOV_TAKENS, consequences.BOGDANOV_TAKENS, ""
        else:
            kind, verdict = LossKind.DEGENERATE, consequences.DEGENERATE
            note = "a double zero eigenvalue with one null vector, a or b = 0"
            if len(at.A) == 2:
                kind, verdict = LossKind.NILPOTENT, consequences.NILPOTENT
        double = np.sort(np.abs(np.linalg.eigvals(at.A)))[:2].sum() if len(at.A) > 2 else trace
        return self.loss(
            at.z, kinds.ZERO, kind, test, float(double), verdict, coefficients=coefficients, note=note
        )

    def extent(self, z: np.ndarray, left: np.ndarray) -> float:
        """How far the branch moves along the fast fibre, max |<l, y - y*>|, else how far its fast bounds let it; else 0."""
        moved = np.abs((self.samples[:, self.nx :] - z[self.nx :]) @ left)
        along = float(np.max(moved[np.isfinite(moved)], initial=0.0))
        # Less than this is what inexact points are off.
        if along > INEXACT * self.spread(left) and along > ROUNDING * float(np.abs(left).sum()):
            return along
        fast = [self.box.get(s.name) for s in self.sampler.system.y]
        return float(sum(abs(c) * (i[1] - i[0]) for c, i in zip(left, fast) if i)) if all(fast) else 0.0

    def spread(self, left: np.ndarray) -> float:
        """What <l, y> could change by if every fast variable moved as much as it does on the branch."""
        y = self.samples[:, self.nx :]
        y = y[np.isfinite(y).all(axis=1)]
        total = float(np.abs(left) @ np.ptp(y, axis=0)) if len(y) else 0.0
        return total if total > ROUNDING * float(np.abs(left).sum()) else 0.0

    def _simple_zero(self, at: Local, determinant: float, note: str) -> Loss:
        nx = self.nx
        right, left = null_vectors(at.A)
        left = left / (left @ right)
        b, a = left @ at.g_x, quadratic_coefficient(at.g_yy, right, left)
        c = cubic_coefficient(at.A, at.g_yy, at.third, right, left)
        # Directions of the kernel of (g_x, g_y) up to b: (0, r), and (e_j, w_j) with <l, w_j> = 0.
        w = np.linalg.solve(
            np.block([[at.A, right[:, None]], [left[None, :], np.zeros((1, 1))]]),
            np.vstack([-at.g_x, np.zeros((1, nx))]),
        )[:-1]
        kernel = np.vstack([np.append(np.zeros(nx), right), np.hstack([np.eye(nx), w.T])])
        form = np.einsum("i,ijk,aj,bk->ab", left, at.second, kernel, kernel)
        V = self._width(at.z, left, a, b, c, form)
        sizes = np.append(V, self.widths)
        scaled = form * sizes[:, None] * sizes
        bend, tilt, cubic = abs(a) * V**2, np.abs(b) * self.widths, abs(c) * V**3
        mixed, square = float(np.abs(scaled[0, 1:]).max()), float(np.abs(scaled[1:, 1:]).max())
        names = [s.name for s in self.sampler.system.x]
        coefficients = {"a": a, **{f"b_{name}": float(value) for name, value in zip(names, b)}}
        if max(bend, float(tilt.max()), cubic, mixed, square) == 0.0:
            return self._touching(at, determinant, right, left, V, note, {})
        is_zero = ZERO_TERM * max(bend, float(tilt.max()), cubic, mixed)
        # At a branch point b is as large as the square terms times what the place is off.
        if float(tilt.max()) > max(is_zero, OFF * square):
            switching = float(b @ at.slow)
            if abs(switching) <= ZERO_TERM * float(np.abs(b) @ self._fastest):
                switching = 0.0
            if bend > is_zero:
                return self._fold(at, determinant, coefficients, a, switching, note)
            coefficients["c"] = c
            fibre = self.fibre(at.z, right[:, None], left[:, None], V)
            # A second route to the order: near a zero of higher order c is small, not zero.
            if cubic > ZERO_CUBIC / ZERO_TERM * is_zero and (fibre is None or fibre.order == CUBIC):
                coefficients |= {"kappa": c * switching**2}
                verdict = consequences.cusp(coefficients, nx)
                test = f"det g_y = {determinant:.3g}, a"
                return self.loss(
                    at.z, kinds.ZERO, LossKind.CUSP, test, a, verdict, coefficients=coefficients, note=note
                )
            return self._touching(at, determinant, right, left, V, note, coefficients)
        is_zero = max(is_zero, ZERO_TERM * square)
        return self._branch_point(
            at, determinant, form, scaled, kernel, right, left, V,
            flags=(bend > is_zero, cubic > is_zero), a=a, c=c, note=note,
        )  # fmt: skip

    def _width(
        self, z: np.ndarray, left: np.ndarray, a: float, b: np.ndarray, c: float, form: np.ndarray
    ) -> float:
        """The size of v in the region: the branch's own, else its fast bounds', else where two terms balance."""
        moved = self.extent(z, left)
        if moved > 0.0:
            return moved
        mixed = float(np.max(np.abs(form[0, 1:]) * self.widths, initial=0.0))
        if a != 0.0 and mixed > 0.0:
            return mixed / abs(a)
        if c != 0.0 and mixed > 0.0:
            return float(np.sqrt(mixed / abs(c)))
        return self.spread(left) or 1.0

    def _fold(
        self, at: Local, determinant: float, known: dict[str, float], a: float, switching: float, note: str
    ) -> Loss:
        coefficients = {**known, "switching": switching, "kappa": a * switching}
        if coefficients["kappa"] > 0.0:
            coefficients["delay"] = OMEGA_0 * coefficients["kappa"] ** (-1.0 / 3.0)
        verdict = consequences.fold(coefficients, self.nx)
        return self.loss(
            at.z,
            kinds.ZERO,
            LossKind.FOLD,
            "det g_y",
            determinant,
            verdict,
            coefficients=coefficients,
            note=note,
        )

    def _branch_point(
        self, at, determinant, form, scaled, kernel, right, left, V, *, flags, a, c, note
    ) -> Loss:
        """Where (g_x, g_y) loses rank: M0 branches. Decided by the quadratic form on its kernel."""
        spectrum = np.linalg.eigvalsh(scaled)
        zero = ZERO_TERM * float(np.abs(spectrum).max())
        plus, minus = int((spectrum > zero).sum()), int((spectrum < -zero).sum())
        coefficients = {"a": a} if flags[0] else {"c": c} if flags[1] else {}
        test = f"det g_y = {determinant:.3g}, |<l, g_x>|"
        value = float(np.abs(left @ at.g_x).max())
        if (plus, minus) != (1, 1):
            if not flags[0] and plus + minus <= 1:
                return self._touching(at, determinant, right, left, V, note, coefficients)
            text = (
                f"(g_x, g_y) loses rank with {plus} positive and {minus} negative squares of the quadratic form"
            )
            return self._degenerate(at, determinant, text, coefficients)
        along = kernel[1:].T @ at.slow
        moves = bool((np.abs(at.slow) > ZERO_TERM * self._fastest).any())
        cross = float(np.einsum("i,ijk,j,k->", left, at.second, kernel[0], along))
        bent = 0.5 * float(np.einsum("i,ijk,j,k->", left, at.second, along, along))
        push = float(left @ at.push)
        if flags[0]:
            discriminant = 0.25 * cross**2 - a * bent
            coefficients["discriminant"] = discriminant
            if moves and discriminant > 0.0:
                coefficients["lambda"] = (a * push + 0.5 * cross) / float(np.sqrt(discriminant))
            kind, verdict = LossKind.TRANSCRITICAL, consequences.transcritical(coefficients)
        else:
            if moves and cross != 0.0:
                # The tangent of the branch that is a graph over x is along + slope (0, r).
                slope = -bent / cross
                coefficients |= {"crossing": cross, "push": push - slope}
            if flags[1]:
                kind, verdict = LossKind.PITCHFORK, consequences.pitchfork(coefficients)
            else:
                fibre = self.fibre(at.z, right[:, None], left[:, None], V)
                if fibre is None or not fibre.vanishes:
                    return self._touching(at, determinant, right, left, V, note, coefficients)
                kind, verdict = LossKind.RANK_CHANGE, consequences.rank_change(coefficients)
        return self.loss(at.z, kinds.ZERO, kind, test, value, verdict, coefficients=coefficients, note=note)

    def fibre(self, z: np.ndarray, right: np.ndarray, left: np.ndarray, V: float) -> FibreOrder | None:
        """The order of the layer problem along its fast fibre, out to a share of the region."""
        left = np.linalg.qr(left)[0] * np.sign((left * np.linalg.qr(left)[0]).sum(axis=0))
        width = ALONG * (V or self.spread(left[:, 0]) or 1.0)
        moved = self.samples.copy()
        moved[:, self.nx :] += width * np.random.default_rng(0).standard_normal(moved[:, self.nx :].shape)
        sizes = np.abs(self.problem.residual(moved)).max(axis=1)
        typical = float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
        return order_along(self.problem, z, right, left, width=width, typical=typical)

    def _touching(self, at, determinant, right, left, V, note, coefficients) -> Loss:
        """Neither quadratic nor cubic terms decide."""
        fibre = self.fibre(at.z, right[:, None], left[:, None], V)
        if fibre is None:
            text = "the quadratic and cubic coefficients do not decide"
        elif fibre.vanishes:
            text = "g vanishes along the fast fibre and its eigenvalue does not cross zero to first order"
        else:
            text = (
                f"the fast fibre has order {fibre.order:g}: v' = {fibre.plus:.4g} v^{fibre.order:g} for v > 0"
            )
        text = text + (f"; {note}" if note else "")
        return self._degenerate(at, determinant, text, coefficients)

    # -- pairs -------------------------------------------------------------------------------------

    def pair(self, z: np.ndarray) -> Loss:
        """The loss at z, where a pair of eigenvalues is imaginary."""
        at = self.local(z)
        values = np.linalg.eigvals(at.A)
        test = "least |Re lambda| of a pair"
        # The bisection for it ends where rounding does; multiple pairs spread like a root of that.
        axis = np.abs(values.real) <= ZERO_SINGULAR * self.scale
        value = float(np.abs(values.real).min())
        if axis.sum() != 2 or not at.is_finite:
            text = (
                "derivatives do not exist here" if not at.is_finite else f"{axis.sum()} eigenvalues on the axis"
            )
            return self.loss(
                z, kinds.PAIR, LossKind.DEGENERATE, test, value, consequences.DEGENERATE, note=text
            )
        omega = float(np.abs(values[axis].imag).max())
        l1, q, p = first_lyapunov(at.A, at.g_yy, at.third, omega)
        coefficients = {"omega": omega, "l1": l1}
        slope = np.linalg.solve(at.A, at.g_x)
        tangents = np.vstack([np.eye(self.nx), -slope])
        changes = [float(np.vdot(p, (at.second[:, self.nx :, :] @ t) @ q).real) for t in tangents.T]
        reach = float(np.abs(changes) @ self.widths)
        speed = float(np.dot(changes, at.slow))
        notes = []
        if reach <= ZERO_TERM * self.scale:
            notes.append("the pair touches the axis and does not cross it to first order")
        elif abs(speed) <= ZERO_TERM * float(np.abs(changes) @ self._fastest):
            notes.append("the slow flow is tangent to the place, or vanishes there")
            coefficients["crossing"] = 0.0
        else:
            coefficients["crossing"] = speed
        typical = float(np.abs(at.third).sum() + np.abs(at.g_yy).sum() ** 2 / max(self.scale, 1e-300))
        if abs(l1) <= ZERO_TERM * typical / omega or typical == 0.0:
            notes.append("l1 = 0: degenerate, higher terms decide on the cycles")
        others = int((values.real > ZERO_SINGULAR * self.scale).sum())
        if others:
            notes.append(f"{others} of the other fast directions are unstable, so orbits leave anyway")
        kind = LossKind.HOPF if reach > ZERO_TERM * self.scale else LossKind.DEGENERATE
        verdict = consequences.hopf(coefficients) if kind is LossKind.HOPF else consequences.DEGENERATE
        return self.loss(
            z, kinds.PAIR, kind, test, value, verdict, coefficients=coefficients, note="; ".join(notes)
        )

    # -- the rest ----------------------------------------------------------------------------------

    def name(self, found: Found) -> Loss:
        """The named loss at a place that the search met."""
        z, crossing = found
        if crossing == kinds.BRANCH_POLE:
            return self.loss(
                z, crossing, LossKind.BRANCH_POLE, "denominator of the branch", 0.0, consequences.BRANCH_POLE
            )
        if crossing == kinds.FIELD_POLE:
            return self.loss(
                z, crossing, LossKind.FIELD_POLE, "denominator of the field", 0.0, consequences.FIELD_POLE
            )
        if crossing == kinds.PAIR:
            return self.pair(z)
        if crossing == kinds.SUM:
            values = self.sampler.eigenvalues(z[None, :])[0]
            i, j = np.triu_indices(len(values), 1)
            closest = int(np.argmin(np.abs(values[i] + values[j])))
            total = float(abs(values[i[closest]] + values[j[closest]]))
            return self.loss(
                z,
                crossing,
                LossKind.NEUTRAL_SADDLE,
                "sum of two real eigenvalues",
                total,
                consequences.NEUTRAL_SADDLE,
            )
        if crossing == kinds.JUMP:
            value = float(np.abs(self.sampler.eigenvalues(z[None, :])[0].real).min())
            return self.loss(z, crossing, LossKind.NON_SMOOTH, "least |Re lambda|", value, consequences.JUMP)
        return self.zero(z)
