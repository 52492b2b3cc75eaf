"""What the names of losses are decided by: derivatives at one place, and the sizes that they are compared at.

Coefficients are compared with one another at the size of the region: x moves by its widths, and along the fast fibre
v = <l, y - y*> by as much as the branch does. So the names do not depend on linear changes of the variables.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gsp.algebra.differentiation import entries
from gsp.algebra.laurent import laurent
from gsp.critical.layer_problem import LayerProblem, eigenvalue_sizes, sizes_beside
from gsp.critical.loss_kind import LossKind
from gsp.critical.multilinear_form import MultilinearForm
from gsp.critical.sampling import Sampler
from gsp.critical.sheet_points import EQUAL
from gsp.hyperbolicity.losses.consequences import LossConsequence
from gsp.hyperbolicity.losses.fibre import FibreOrder, order_along
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.systems.region import Interval, digits_between

# Losses nearer than this to an edge of the region, relative to its width, are on the edge.
EDGE = 1e-7


class Found(NamedTuple):
    """A place that the search met: z = (x, y), and what crosses there."""

    z: np.ndarray
    crossing: Contact

    @property
    def is_pole(self) -> bool:
        """Whether something goes to infinity here."""
        return self.crossing in (Contact.BRANCH_POLE, Contact.FIELD_POLE)


@dataclass(frozen=True)
class Local:
    """Derivatives of g by z = (x, y) at `z`, the slow rates, and the part of g of order epsilon."""

    z: np.ndarray
    A: np.ndarray
    g_x: np.ndarray
    second: np.ndarray
    third: MultilinearForm
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
        return all(bool(np.isfinite(a).all()) for a in (self.A, self.g_x, self.second, self.third.values))


class Diagnosis:
    """One branch in one box, to name its losses in; `samples` (m, n) lie on it, `scale` is its largest |lambda|."""

    def __init__(
        self, sampler: Sampler, box: Mapping[str, Interval], scale: float, samples: np.ndarray
    ) -> None:
        self.sampler, self.box, self.scale = sampler, box, scale
        system = sampler.system
        self.problem = LayerProblem.over_all(system)
        self.nx = len(system.x)
        self.widths = np.array([box[s.name][1] - box[s.name][0] for s in system.x])
        chosen = np.linspace(0, len(samples) - 1, min(len(samples), 65)).astype(int)
        self.samples = samples[chosen]

    @cached_property
    def units(self) -> np.ndarray:
        """The sizes (n,) that states are compared at: the region's widths, and how far the branch reaches beside it."""
        return np.append(self.widths, self.sampler.fast_lengths(self.samples))

    def in_units(self, matrices: np.ndarray) -> np.ndarray:
        """g_y (..., n_fast, n_fast) with the fast variables in their units: its eigenvalues are the same."""
        units = self.units[self.nx :]
        return matrices * (units / units[:, None])

    def sizes_beside(self, values: np.ndarray) -> np.ndarray:
        """What eigenvalues (n_fast,) at one place count as 0 beside: their like in the region."""
        return sizes_beside(self._sizes, values)

    def near_zero(self, values: np.ndarray) -> np.ndarray:
        """Which eigenvalues (n_fast,) at one place may be 0: a double zero is known to a root of rounding."""
        return np.abs(values) <= 1e-4 * self.sizes_beside(values)

    @cached_property
    def _sizes(self) -> np.ndarray:
        return eigenvalue_sizes(self.sampler.eigenvalues(self.samples))

    @cached_property
    def singular_sizes(self) -> np.ndarray:
        """The same of singular values in units, the largest first (n_fast,)."""
        matrices = self.in_units(self.sampler.fast_jacobian(self.samples))
        finite = np.isfinite(matrices).all(axis=(1, 2))
        return eigenvalue_sizes(np.linalg.svd(matrices[finite], compute_uv=False))[::-1]

    @cached_property
    def _push(self):
        """g_1 of g = g_0 + epsilon g_1 + ..."""
        epsilon = self.sampler.system.epsilon
        return [laurent(g, epsilon, order=1).get(1, 0 * epsilon) for g in self.sampler.system.g]

    @cached_property
    def _rates(self):
        return self.sampler.compiled([*self.sampler.f, *self._push])

    @cached_property
    def fastest(self) -> np.ndarray:
        """Largest |f| over the samples (nx,)."""
        values = np.abs(self._rates(self.samples, self.sampler.p)[:, : self.nx])
        return np.max(np.where(np.isfinite(values), values, 0.0), axis=0, initial=0.0)

    def largest_push(self, left: np.ndarray) -> float:
        """Largest |<l, g_1>|, term by term, over the samples."""
        pushes = np.abs(self._rates(self.samples, self.sampler.p)[:, self.nx :]) @ np.abs(left)
        return float(np.max(pushes[np.isfinite(pushes)], initial=0.0))

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
        fast = self.sampler.system.y
        return self.sampler.compiled(entries(self._push, fast))(z, self.sampler.p).reshape(len(fast), -1)

    def loss(
        self,
        z: np.ndarray,
        crossing: Contact,
        kind: LossKind,
        test: str,
        value: float,
        verdict: LossConsequence,
        *,
        coefficients: Mapping[str, float] | None = None,
        note: str = "",
    ) -> Loss:
        """A `Loss` with its point, eigenvalue and edge filled in."""
        values = self.sampler.eigenvalues(z[None, :])[0]
        by = np.abs(values.real) if crossing in (Contact.PAIR, Contact.PAIR_EVERYWHERE) else np.abs(values)
        eigenvalue = complex(values[np.argmin(np.nan_to_num(by, nan=np.inf))])
        names = [s.name for s in self.sampler.system.states]
        everywhere = crossing.is_everywhere
        on_edge = not everywhere and any(
            min(abs(value - low), abs(value - high)) <= EDGE * (high - low)
            for name, value in zip(names, z)
            for low, high in [self.box.get(name, (-np.inf, np.inf))]
            if np.isfinite(high - low)
        )
        small = self.sampler.system.epsilon.name
        verdict = verdict.in_terms_of(small)
        # What is rounding of the region is 0.
        rounded = np.where(np.abs(z) <= np.finfo(float).eps * self.units, 0.0, z)
        return Loss(
            point=dict(zip(names, map(float, rounded))),
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
            digits=self._digits,
            small=small,
        )

    @cached_property
    def _digits(self) -> dict[str, int]:
        """To how many digits places are told, by state, so that those of the samples can be told apart."""
        names = [s.name for s in self.sampler.system.states]
        known = self.samples[np.isfinite(self.samples).all(axis=1)]
        ends = zip(known.min(axis=0, initial=np.inf), known.max(axis=0, initial=-np.inf))
        # A state that is the same at all of them is told beside 1.
        return {
            name: digits_between((low, high if high > low else low + 1.0))
            for name, (low, high) in zip(names, ends)
            if np.isfinite(low)
        }

    def extent(self, z: np.ndarray, left: np.ndarray) -> float:
        """How far the branch moves along the fast fibre, max |<l, y - y*>|; else as fast bounds let it; else 0."""
        moved = np.abs((self.samples[:, self.nx :] - z[self.nx :]) @ left)
        along = float(np.max(moved[np.isfinite(moved)], initial=0.0))
        # Less than this is what inexact points are off.
        # A motion along the fibre smaller than this share of what the branch moves is none: multiple zeros are
        # inexact points.
        if along > 1e-3 * self.spread(left) and along > EQUAL * float(np.abs(left).sum()):
            return along
        fast = [self.box.get(s.name) for s in self.sampler.system.y]
        return float(sum(abs(c) * (i[1] - i[0]) for c, i in zip(left, fast) if i)) if all(fast) else 0.0

    def spread(self, left: np.ndarray) -> float:
        """What <l, y> could change by if every fast variable moved as much as it does on the branch."""
        y = self.samples[:, self.nx :]
        y = y[np.isfinite(y).all(axis=1)]
        total = float(np.abs(left) @ np.ptp(y, axis=0)) if len(y) else 0.0
        return total if total > EQUAL * float(np.abs(left).sum()) else 0.0

    def fibre(self, z: np.ndarray, right: np.ndarray, left: np.ndarray, V: float) -> FibreOrder | None:
        """The order of the layer problem along its fast fibre, out to a share of the region."""
        left = np.linalg.qr(left)[0] * np.sign((left * np.linalg.qr(left)[0]).sum(axis=0))
        # Share of the region over which the layer problem is followed along its fast fibre.
        width = 0.1 * (V or self.spread(left[:, 0]) or 1.0)
        moved = self.samples.copy()
        moved[:, self.nx :] += width * np.random.default_rng(0).standard_normal(moved[:, self.nx :].shape)
        sizes = np.abs(self.problem.residual(moved)).max(axis=1)
        typical = float(np.max(sizes[np.isfinite(sizes)], initial=0.0))
        return order_along(self.problem, z, right, left, width=width, typical=typical)
