"""Where normal hyperbolicity is lost, before it is named: eigenvalues that reach the imaginary axis, and poles.

Zero eigenvalues solve {equations of the branch = 0, g_y v = 0, |v| = 1} for (x, y, v), by Gauss-Newton steps of
least norm from the samples nearest to singular. Other changes of type are bisected between linked samples, and
losses too thin to lie between two samples of different type are met when the worst samples are refined.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from gsp.critical.continuation.special_points import most_opposite, pair_test
from gsp.critical.sampling import Sampler
from gsp.critical.sheet_points import Allowance
from gsp.hyperbolicity.losses.diagnosis import Found
from gsp.hyperbolicity.losses.kinds import Contact
from gsp.hyperbolicity.losses.roots import STEPS, STEPS_OF_LARGE, gauss_newton_at_each
from gsp.systems.region import Interval

# The worst samples, from which the gap is refined and losses are located.
REFINED = 4
LOCATED = 24
# An eigenvalue counts as zero below this, relative to its usual size in the region.
ZERO_TOLERANCE = 1e-9
# A point or an eigenvalue this many times larger than at the neighbouring sample has gone to infinity.
INFINITE = 1e6
# Two losses nearer than this, relative to the region's width, are one, and a jump there is the surface's.
SAME = 1e-6
# Continuation steps that one search for the least gap may take. A point that the sheet reaches costs one to 21, one
# beyond a fold about 80, because the sheet is followed up to the fold each time.
SEARCH_STEPS = 1250
# Neutral saddles that are looked at.
SUMS = 6


class Locator:
    """Collects the losses of one branch in one box, each once."""

    def __init__(
        self,
        sampler: Sampler,
        box: Mapping[str, Interval],
        scale: float,
        *,
        samples: np.ndarray,
        usual: float,
    ) -> None:
        self.sampler = sampler
        self.box = box
        # The largest |lambda|, and the size that the one nearest to the axis has on most of the branch.
        self.scale = scale
        self.usual = usual
        # Units of the states, by the region and the samples: volts and shares of channels have no common length.
        widths = [box[s.name][1] - box[s.name][0] for s in sampler.system.x]
        self.units = np.append(widths, sampler.fast_lengths(samples))
        # Samples that say how large the equations are.
        self._some = samples[:: 1 + len(samples) // 16]
        self.found: list[Found] = []
        self.notes: list[str] = []

    def add(self, z: np.ndarray, crossing: Contact, *, only_x: bool = False) -> None:
        """Note a place `z` unless it lies outside the box or is known; `only_x` when y means nothing there."""
        nx = len(self.sampler.system.x)
        checked = np.append(z[:nx], [np.nan] * (len(z) - nx)) if only_x else z
        if not self.sampler.inside(checked[None, :], self.box)[0]:
            return
        if self._is_known(z, slice(nx) if only_x else slice(None)):
            return
        if sum(known.crossing == crossing for known in self.found) < LOCATED:
            self.found.append(Found(z, crossing))

    def _is_known(self, z: np.ndarray, compared: slice = slice(None)) -> bool:
        return any((np.abs(known.z - z) < SAME * self.units)[compared].all() for known in self.found)

    # -- zero eigenvalues --------------------------------------------------------------------------

    def zeros(self, samples: np.ndarray, *, at_end: bool = False, held: Sequence[int] = ()) -> None:
        """Zero eigenvalues on the branch next to `samples`; `at_end` when these are the ends of a sheet. States of
        the indices `held` keep their values.

        Along a sheet that all but ends at its sample no zero can be reached: whether it is the end's is for the caller.
        """
        sampler = self.sampler
        branch = sampler.branch
        points = self._zero_eigenvalues(
            samples, branch.residual, branch.full_jacobian, self._branch_sizes, held
        )
        if branch.is_explicit:
            # A graph such as sqrt(x) has no derivative at its fold, but g has.
            rest = [i for i, point in enumerate(points) if point is None]
            equations = sampler.equilibria, sampler.equilibria_jacobian, self._layer_sizes
            for i, point in zip(rest, self._zero_eigenvalues(samples[rest], *equations, held)):
                points[i] = point
        for z, point in zip(samples, points):
            if point is None or self._is_known(point) or not sampler.inside(point[None], self.box)[0]:
                continue
            if at_end or self._on_sheet(point, z):
                self.add(point, Contact.ZERO)

    def _zero_eigenvalues(
        self, samples: np.ndarray, equations, jacobian, sizes: np.ndarray, held: Sequence[int]
    ) -> list[np.ndarray | None]:
        """The zero eigenvalue on the branch next to each of the `samples` (m, n), or None."""
        sampler = self.sampler
        nx, ny = len(sampler.system.x), len(sampler.system.y)
        n = nx + ny
        found: list[np.ndarray | None] = [None] * len(samples)
        matrices = sampler.fast_jacobian(samples)
        finite = np.flatnonzero(np.isfinite(matrices).all(axis=(1, 2)))
        # The null vector in the variables' own units, in which none is large or small beside the others.
        unit = self.units[nx:]

        def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            points, v = u[:, :n], u[:, n:]
            g_y = sampler.fast_jacobian(points) * unit
            norms = np.einsum("mi,mi->m", v, v)[:, None] - 1.0
            value = np.hstack([equations(points), np.einsum("mij,mj->mi", g_y, v), norms])
            slope = np.zeros((*value.shape, n + ny))
            slope[:, :ny, :n] = jacobian(points)
            slope[:, ny : 2 * ny, :n] = sampler.bent(points, unit * v)
            slope[:, ny : 2 * ny, n:] = g_y
            slope[:, -1, n:] = 2.0 * v
            slope[:, :, list(held)] = 0.0
            return value, slope

        # The matrices of thousands of states would fill the memory.
        for chosen in np.split(finite, max(len(finite), 1) if sampler.is_large else 1):
            null = np.linalg.svd(matrices[chosen] * unit / unit[:, None])[2][:, -1]
            roots = gauss_newton_at_each(
                evaluate,
                np.hstack([samples[chosen], null]),
                steps=STEPS_OF_LARGE if sampler.is_large else STEPS,
                sparse=sampler.is_large,
                scales=np.append(self.units, np.ones(ny)),
                sizes=np.concatenate([sizes, self._eigenvector_sizes, [1.0]]),
            )
            for i, root in zip(chosen, roots):
                # A matrix far from normal has unit vectors that it all but annihilates, and yet no eigenvalue near
                # zero. Where one vanishes it is no larger than this share of its usual size: multiple zeros are
                # inexact.
                if root is not None:
                    least = np.abs(sampler.eigenvalues(root[None, :n])).min()
                    if not least > 0.03 * max(self.usual, ZERO_TOLERANCE * self.scale):
                        found[i] = root[:n]
        return found

    @cached_property
    def _branch_sizes(self) -> np.ndarray:
        return self._sizes(self.sampler.branch.full_jacobian, self.units)

    @cached_property
    def _layer_sizes(self) -> np.ndarray:
        return self._sizes(self.sampler.equilibria_jacobian, self.units)

    @cached_property
    def _eigenvector_sizes(self) -> np.ndarray:
        return self._sizes(self.sampler.fast_jacobian, self.units[len(self.sampler.system.x) :])

    def _sizes(self, jacobian, units: np.ndarray | float) -> np.ndarray:
        """What a unit changes in each equation, as a rule: next to where a graph ends it changes any amount."""
        # One sample at a time: with thousands of states the Jacobians of all would fill the memory.
        rows = np.array([np.max(np.abs(jacobian(z[None, :])[0]) * units, axis=1) for z in self._some])
        finite = np.isfinite(rows).all(axis=1)
        return np.median(rows[finite], axis=0) if finite.any() else np.ones(rows.shape[1])

    def _on_sheet(self, point: np.ndarray, sample: np.ndarray) -> bool:
        """Whether a zero found by Newton's method belongs to the sheet of `sample`, when one sheet is meant.

        The sheet must run into the point as x does: its distance falls like a root of that of x.
        """
        branch, nx = self.sampler.branch, len(self.sampler.system.x)
        if not branch.is_explicit and branch.seed is None:
            return True
        separation = np.linalg.norm((sample[nx:] - point[nx:]) / self.units[nx:])
        # How near to a point, as a share of the way, a sheet is followed to see whether it runs into it.
        near, first = self._towards(point, sample, 0.01)
        if near is None or first <= 0.3 * separation + 1e-6:
            return near is not None
        # A root of high order falls slowly, but it goes on falling.
        return bool(first <= 0.5 * separation and self._towards(point, near, 0.1)[1] <= 0.75 * first)

    def _towards(self, point: np.ndarray, sample: np.ndarray, share: float) -> tuple[np.ndarray | None, float]:
        """The sheet of `sample` over x at that share of the way from `point`, and how far in y, in units, it is."""
        nx = len(self.sampler.system.x)
        x = point[:nx] + share * (sample[:nx] - point[:nx])
        y, good = self.sampler.over(x[None, :], sample[None, :])
        if not good[0]:
            return None, float("inf")
        return np.concatenate([x, y[0]]), float(np.linalg.norm((y[0] - point[nx:]) / self.units[nx:]))

    # -- changes of type ---------------------------------------------------------------------------

    def changes(self, a: np.ndarray, b: np.ndarray) -> None:
        """Every change of type between linked points a and b (m, n), by bisection in x."""
        sampler = self.sampler
        count = unstable(sampler.eigenvalues(a))

        def is_like(z: np.ndarray) -> np.ndarray:
            values = sampler.eigenvalues(z)
            return (unstable(values) == count) & np.isfinite(values).all(axis=1)

        for before, after, from_ in zip(*sampler.bisected(a, b, is_like), a):
            values = np.array([sampler.eigenvalues(z[None, :])[0] for z in (from_, before, after)])
            if np.linalg.norm(before / self.units) > INFINITE * (1.0 + np.linalg.norm(from_ / self.units)):
                self.add(before, Contact.BRANCH_POLE, only_x=True)
            elif np.abs(values[1]).max() > INFINITE * (1.0 + np.abs(values[0]).max()):
                self.add(before, Contact.FIELD_POLE, only_x=True)
            else:
                near = values[2][np.argmin(np.abs(values[2].real))]
                least = np.abs(np.real(values)).min(axis=1)
                # Eigenvalues that stay this far from the axis on both sides of a change of type have jumped
                # across it; relative to their distance at the sample. At a zero all three are rounding, which
                # is none of it.
                jumped = min(least[1], least[2]) > max(1e-3 * least[0], ZERO_TOLERANCE * self.usual)
                still = Contact.PAIR if abs(near.imag) > 1e-6 * self.scale else Contact.ZERO
                self.add(after, Contact.JUMP if jumped else still)

    def sums(self, a: np.ndarray, b: np.ndarray) -> list[Found]:
        """Neutral saddles between linked points a and b (m, n) of one type: real eigenvalues whose sum is zero."""
        sampler = self.sampler
        if len(sampler.system.y) < 2 or not len(a):
            return []
        before, after = sampler.eigenvalues(a), sampler.eigenvalues(b)
        counts = unstable(before)
        # Eigenvalues on one side of the axis have no sum that is zero.
        mixed = (counts > 0) & (counts < before.shape[1])
        same = mixed & (counts == unstable(after)) & np.isfinite(before + after).all(axis=1)
        if not same.any():
            return []
        tests = pair_test(before), pair_test(after)
        zero = np.flatnonzero(same & (np.abs(tests[0]) <= ZERO_TOLERANCE))
        found = [a[i] for i in zero[:SUMS]]
        rows = np.flatnonzero(same & (tests[0] * tests[1] < 0.0))[: SUMS - len(found)]
        signs = np.sign(tests[0][rows])
        saddles, _ = sampler.bisected(
            a[rows], b[rows], lambda z: pair_test(sampler.eigenvalues(z)) * signs > 0.0
        )
        found += [*saddles]
        return [Found(z, Contact.SUM) for z in found if self._is_neutral_saddle(z)]

    def _is_neutral_saddle(self, z: np.ndarray) -> bool:
        first, second = most_opposite(self.sampler.eigenvalues(z[None, :])[0])
        real = max(abs(first.imag), abs(second.imag)) <= 1e-6 * self.scale
        small = abs(first + second) <= 1e-6 * self.scale
        return bool(real and small and min(abs(first), abs(second)) > 1e-6 * self.scale)

    def refine(self, worst: np.ndarray, *, only_gap: bool = False) -> float:
        """The least distance of an eigenvalue from the axis near the samples `worst`, by simplex searches in x.

        The distance is negative where the type is another than at the sample: then the change is located too, but
        with `only_gap`, where it is known that there is none.
        A search ends when it has taken `SEARCH_STEPS` along the sheet, which is noted.
        """
        from scipy.optimize import minimize

        sampler, nx = self.sampler, len(self.sampler.system.x)
        bounds = [self.box[s.name] for s in sampler.system.x]
        widths = np.array([high - low for low, high in bounds])
        best, searched, is_incomplete = float("inf"), [], False
        for z in worst:
            # One search for samples next to one another.
            # Share of the region that one search for the least gap covers.
            if any((np.abs(z[:nx] - x) <= 0.02 * widths).all() for x in searched):
                continue
            searched.append(z[:nx])
            allowance = Allowance(SEARCH_STEPS)
            values = sampler.eigenvalues(z[None, :])
            count = unstable(values)[0]
            # With eigenvalues of one sign those nearest to the axis tell, which are found faster than all.
            follows = sampler.is_large and count in (0, values.shape[1])
            near = complex(values[0, np.argmin(np.abs(values[0].real))])

            def distance(
                x: np.ndarray, z=z, count=count, allowance=allowance, follows=follows, near=near
            ) -> float:
                y, good = sampler.over(x[None, :], z[None, :], allowance=allowance)
                point = np.hstack([x[None, :], y])
                if not good[0] or not sampler.inside(point, self.box)[0]:
                    return float("inf")
                if follows:
                    return float(((1 if count else -1) * np.real(sampler.followed(point[0], near))).min())
                return float(signed_gap(sampler.eigenvalues(point), np.array([count]))[0])

            # How near in x the least gap is found, and with many fast variables as a share of the region.
            found: Any = minimize(
                distance,
                z[:nx],
                method="Nelder-Mead",
                bounds=bounds,
                options={
                    "maxfev": 60 * nx,
                    "xatol": 1e-4 * float(widths.min()) if sampler.is_large else 1e-10,
                },
            )
            is_incomplete = is_incomplete or allowance.spent
            if not np.isfinite(found.fun):
                continue
            if found.fun < 0 and not only_gap:
                y, _ = sampler.over(found.x[None, :], z[None, :])
                self.changes(z[None, :], np.hstack([found.x[None, :], y]))
            if found.fun <= ZERO_TOLERANCE * self.usual and not self.found and not only_gap:
                self.touching(np.append(found.x, sampler.over(found.x[None, :], z[None, :])[0][0]))
            best = min(best, max(float(found.fun), 0.0))
        if is_incomplete:
            self.notes.append(
                f"searches for the least gap ended after {SEARCH_STEPS} steps along the sheet, most of them next to "
                "its end: between the samples the gap may be smaller"
            )
        return best

    def touching(self, z: np.ndarray) -> None:
        """Note a place where an eigenvalue is on the axis without a change of type."""
        values = self.sampler.eigenvalues(z[None, :])[0]
        near = values[np.argmin(np.abs(values.real))]
        self.add(z, Contact.PAIR if abs(near.imag) > 1e-6 * self.scale else Contact.ZERO)


def unstable(eigenvalues: np.ndarray) -> np.ndarray:
    """Number of eigenvalues to the right of the axis, for each row of (m, n)."""
    return (np.real(eigenvalues) > 0).sum(axis=1)


def signed_gap(eigenvalues: np.ndarray, count: np.ndarray) -> np.ndarray:
    """Least distance from the axis; negative when not `count` eigenvalues lie to its right."""
    real = np.sort(np.real(eigenvalues), axis=1)
    place = np.arange(real.shape[1])[None, :]
    stable = place < real.shape[1] - count[:, None]
    return np.where(stable, -real, real).min(axis=1)


def spread(points: np.ndarray, worth: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most `count` of `points` (m, n) far from one another, among the 8 `count` of least `worth`."""
    low = np.argsort(worth, kind="stable")[: 8 * count]
    sizes = np.ptp(points[low], axis=0)
    scaled = points[low] / np.where(sizes > 0.0, sizes, 1.0)
    chosen = [0]
    distance = np.linalg.norm(scaled - scaled[0], axis=1)
    while len(chosen) < min(count, len(low)):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(scaled - scaled[chosen[-1]], axis=1))
    return low[chosen]
