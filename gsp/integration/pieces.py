"""Pieces of a run: consecutive steps with their dense output, and the times at which functions are looked at there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gsp.kernels.dense_output import interpolate_many
from gsp.kernels.scan import SUBDIVISIONS

# Parts of a step beyond which what is not smooth, such as a jump, is not looked at more closely: its signs are settled.
MOST_SUBDIVISIONS = 32 * SUBDIVISIONS
# Parts beyond which signs that do not settle are taken for rounding about zero.
MOST_UNSETTLED = 32 * MOST_SUBDIVISIONS


@dataclass(frozen=True)
class RunPiece:
    """Consecutive steps of a run: `times` (k + 1,), `states` (k + 1, n), `dense` (k, rows, n)."""

    times: np.ndarray
    states: np.ndarray
    dense: np.ndarray

    def at(self, t: np.ndarray) -> np.ndarray:
        """States (m, n) at times (m,) inside."""
        out = np.empty((self.states.shape[1], len(t)))
        interpolate_many(self.times, self.states, self.dense, t, out)
        return out.T

    def step(self, t: float) -> int:
        """The step that `t` lies in."""
        sign = 1.0 if self.times[-1] >= self.times[0] else -1.0
        found = int(np.searchsorted(sign * self.times, sign * t, side="right")) - 1
        return min(max(found, 0), len(self.times) - 2)

    def sample(self, values: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Times (m,) at which the steps are looked at, and the functions (m, w) there.

        Those are `values(t, states)` at times (m,) and states (m, n). Every step has `SUBDIVISIONS` parts, or twice as
        many until the points tell what lies between them. What is not smooth keeps its first points where more of them
        tell no other signs: that of a jump or a kink. Where they do, as an oscillation's, more points are taken.
        """
        parts = SUBDIVISIONS
        t = np.append(
            self._inside(np.arange(len(self.times) - 1), np.arange(parts) / parts).ravel(), self.times[-1]
        )
        g = values(t, self.at(t))
        steps = np.arange(len(self.times) - 1)
        # Of each step its own points, both ends among them.
        places = parts * steps[:, None] + np.arange(parts + 1)
        times, found = t[places], g[places]
        looked: list[tuple[np.ndarray, np.ndarray]] = []

        def keep(chosen: np.ndarray, of_times: np.ndarray, of_values: np.ndarray) -> None:
            # The end of a step is the beginning of the next.
            looked.append((of_times[chosen, :-1].ravel(), of_values[chosen, :-1].reshape(-1, g.shape[1])))

        while True:
            left = ~_is_resolved(found)
            if not left.any() and not looked:
                return t, g
            keep(~left, times, found)
            if parts >= MOST_SUBDIVISIONS:
                first = places[steps]
                signs = _changes(found)
                settled = signs == _changes(found[:, ::2])
                # Rounding about zero has twice as many signs each time; an oscillation may come into its own at last.
                if parts < MOST_UNSETTLED:
                    settled &= signs == _changes(found[:, ::4])
                finer = left & settled & (signs != _changes(g[first]))
                coarse = left & ~finer & (settled | (parts == MOST_UNSETTLED))
                keep(finer, times, found)
                keep(coarse, t[first], g[first])
                left &= ~(finer | coarse)
            steps = steps[left]
            if len(steps) == 0:
                break
            middles = self._inside(steps, (np.arange(parts) + 0.5) / parts)
            new = values(middles.ravel(), self.at(middles.ravel())).reshape(*middles.shape, -1)
            times, found = _interleaved(times[left], middles), _interleaved(found[left], new)
            parts *= 2
        known, of = (np.concatenate(column) for column in zip(*looked))
        order = np.argsort(known if t[-1] >= t[0] else -known)
        return np.append(known[order], t[-1]), np.concatenate([of[order], g[-1:]])

    def _inside(self, steps: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Times (k, m) within steps (k,) at the skewed shares `u` (m,)."""
        begun = self.times[steps, None]
        # No oscillation stays in time with points at skewed shares; 0.382 is the golden section's smaller part.
        return begun + (u + 0.382 * u * (1.0 - u)) * (self.times[steps + 1, None] - begun)


def _changes(g: np.ndarray) -> np.ndarray:
    """How often (k,) the functions change their signs along the points g (k, m, w) of each step, all together."""
    with np.errstate(invalid="ignore"):
        return (np.sign(g[:, 1:]) * np.sign(g[:, :-1]) < 0.0).sum(axis=(1, 2))


def _interleaved(points: np.ndarray, between: np.ndarray) -> np.ndarray:
    """Along the second axis the points (k, m + 1, ...) with those between them (k, m, ...)."""
    out = np.empty((len(points), points.shape[1] + between.shape[1], *points.shape[2:]))
    out[:, ::2], out[:, 1::2] = points, between
    return out


def _is_resolved(g: np.ndarray) -> np.ndarray:
    """Of each step (k,) whether its points g (k, m + 1, w) tell where each function changes its sign.

    They do where cubics through every second point come to those between, and where these are too small to matter.
    """
    known, between = g[:, ::2], g[:, 1::2]
    last = known.shape[1] - 1
    first = np.clip(np.arange(last) - 1, 0, last - 3)
    # Weights of the four points around a middle, and beside the ends.
    weights = np.where(
        (np.arange(last) == 0)[:, None], [5, 15, -5, 1],
        np.where((np.arange(last) == last - 1)[:, None], [1, -5, 15, 5], [-1, 9, 9, -1]),
    ) / 16  # fmt: skip
    with np.errstate(invalid="ignore"):
        guess = sum(weights[:, q, None] * known[:, first + q] for q in range(4))
        missed = np.abs(between - guess).max(axis=1)
        size = np.abs(g)
        is_clear = (g > 0.0).all(axis=1) | (g < 0.0).all(axis=1)
        # A cubic through every second point of a step may miss those between by this share of the largest:
        # through all of them it misses a sixteenth of that, less than what an extreme between two crossings
        # amounts to that are to be told apart.
        good = (missed <= 1e-3 * size.max(axis=1)) | (is_clear & (missed <= size.min(axis=1) / SUBDIVISIONS))
    # What is not a number is not resolved by more points.
    return (good | ~np.isfinite(g).all(axis=1)).all(axis=1)
