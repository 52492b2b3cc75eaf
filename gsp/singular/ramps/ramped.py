"""A field along a ramp, compiled: x' = f(x, s), s' = r rho(s); its rest points for s at rest, and their branches."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.algebra.centres import centres
from gsp.algebra.differentiation import derivative, jacobian
from gsp.errors import DeclarationError, GspError
from gsp.lowering.compiled_function import CompiledFunction, compile_function
from gsp.systems.arguments import shown
from gsp.systems.declaration import exact
from gsp.systems.flow import check_epsilon, in_words
from gsp.systems.ramp import Ramp
from gsp.systems.region import balancing_units, digits_between
from gsp.systems.system import SlowFastSystem, VectorField

# A branch is followed in steps, shares of the way, over which it hardly turns; it folds where they get as short as the
# second.
LONGEST, SHORTEST = 0.125, 2.0**-40


class RampError(GspError):
    """A ramp whose rates cannot be told: its ends are not what they should be, or the field is of another kind."""


class Rates(NamedTuple):
    """f (m, n), f_x (m, n, n), f_s (m, n), rho and rho_s (m,) at m places."""

    f: np.ndarray
    f_x: np.ndarray
    f_s: np.ndarray
    rho: np.ndarray
    rho_s: np.ndarray


class LocalRates(NamedTuple):
    """f (n,), f_x (n, n), f_s (n,), rho and rho_s at one place."""

    f: np.ndarray
    f_x: np.ndarray
    f_s: np.ndarray
    rho: float
    rho_s: float


class Place(NamedTuple):
    """A state x (n,) at the phase s."""

    s: float
    x: np.ndarray


@dataclass(frozen=True, eq=False)
class Ramped:
    """x' = f(x, s), s' = r rho(s): the `source` along its `ramp`, at `epsilon` where it has a small parameter."""

    source: VectorField | SlowFastSystem
    ramp: Ramp
    epsilon: float | None = None

    @cached_property
    def field(self) -> VectorField:
        """f, with the phase of the ramp as a parameter."""
        return self.ramp.along(at_epsilon(self.source, self.epsilon))

    @cached_property
    def centres(self) -> Mapping[sp.Symbol, sp.Rational]:
        """Where those of the states and the phase are that are far from their origin, from where the ramp begins on."""
        f, phase = [rate.xreplace(self.kept) for rate in self.field.rates], self.ramp.phase
        begun = [rate.xreplace({phase: self.ramp.ends[0]}) for rate in f]
        return centres((*f, *begun, self.ramp.profile.xreplace(self.kept)), (*self.field.states, phase))

    @cached_property
    def centre(self) -> Place:
        """The `centres` as a place."""
        s, *x = (float(self.centres.get(z, 0)) for z in (self.ramp.phase, *self.field.states))
        return Place(s, np.array(x))

    @cached_property
    def about_centres(self) -> Ramped:
        """The same about its `centres`."""
        states = {z: c for z, c in self.centres.items() if z != self.ramp.phase}
        ramp = self.ramp.about(self.centres.get(self.ramp.phase, sp.S.Zero))
        return Ramped(self.source.about(states), ramp, self.epsilon)

    def place(self, point: Mapping[str, float]) -> str:
        """States and parameters that move, by name, as text: to six digits of how far they are from where they were."""
        states = {x.name: point[x.name] for x in self.field.states if x.name in point}
        moved = {name: value for name, value in point.items() if name not in states}
        ends = [e for e in self.ramp.ends if e is not None]
        # Where a ramp comes back its ends differ by rounding only.
        along = self.moved(np.linspace(ends[0], ends[-1], 16)) if moved else {}
        digits = {name: digits_between((values.min(), values.max())) for name, values in along.items()}
        return ", ".join(filter(None, (self.field.place(states), in_words(moved, more=digits))))

    @property
    def first(self) -> float:
        """The end where the ramp begins."""
        return float(self.ramp.ends[0])

    @cached_property
    def ends(self) -> tuple[float, float]:
        """The ends of a ramp that has both."""
        return self.first, float(self.ramp.ends[1])  # pyright: ignore[reportArgumentType]

    @cached_property
    def kept(self) -> Mapping[sp.Symbol, sp.Rational]:
        """The values of all parameters but the phase."""
        return {p: value for p, value in self.field.parameters.items() if p != self.ramp.phase}

    @cached_property
    def _compiled(self) -> tuple[CompiledFunction, list[float]]:
        f, x, s, rho = list(self.field.rates), list(self.field.states), self.ramp.phase, self.ramp.profile
        f_x = jacobian(f, x)
        outputs = (*f, *f_x, *(derivative(e, s) for e in f), rho, derivative(rho, s))
        compiled = compile_function(outputs, arguments=(*x, s), parameters=list(self.kept))
        return compiled, [np.nan, *map(float, self.kept.values())]

    def rates(self, x: np.ndarray, s: np.ndarray) -> Rates:
        """At x (m, n) and s (m,)."""
        compiled, constants = self._compiled
        m, n = x.shape
        found, jacobian_ends = compiled(np.column_stack([x, s]), constants), n + n * n
        f_x = found[:, n:jacobian_ends].reshape(m, n, n)
        return Rates(found[:, :n], f_x, found[:, jacobian_ends : jacobian_ends + n], found[:, -2], found[:, -1])

    def at(self, x: np.ndarray, s: float) -> LocalRates:
        """At one place."""
        f, f_x, f_s, rho, rho_s = self.rates(x[np.newaxis], np.array([s]))
        return LocalRates(f[0], f_x[0], f_s[0], float(rho[0]), float(rho_s[0]))

    def moved(self, s: np.ndarray) -> dict[str, np.ndarray]:
        """The parameters that move, at phases s (m,), by name."""
        put = {q: e.xreplace(self.kept) for q, e in self.ramp.parameters.items()}
        compiled = compile_function(tuple(put.values()), arguments=(self.ramp.phase,))
        return dict(zip((q.name for q in put), compiled(s[:, np.newaxis], [np.nan]).T))

    def rest_point(self, x: np.ndarray, s: float) -> np.ndarray | None:
        """The zero of f next to x, by Newton's method; steps are measured by what rounding of x does to them."""
        rounding = np.finfo(float).eps
        for _ in range(50):
            f, f_x, *_ = self.at(x, s)
            if not (np.isfinite(f).all() and np.isfinite(f_x).all()):
                return None
            try:
                inverse = np.linalg.inv(f_x)
            except np.linalg.LinAlgError:
                return None
            step = inverse @ f
            x = x - step
            moved, blur = np.abs(step), np.abs(inverse) @ (np.abs(f_x) @ np.abs(x))
            if np.all(moved <= 4.0 * rounding * blur) or not f.any():
                return x
        return x if np.all(moved <= 1e-12 * blur) else None

    def growth(self, place: Place) -> np.ndarray:
        """Real parts (n,) of the eigenvalues of f_x, the greatest last."""
        return np.sort(np.real(np.linalg.eigvals(self.at(place.x, place.s).f_x)))

    def followed(self, begin: Place, last: float) -> list[Place]:
        """Places along the branch of rest points from `begin` towards `last`, which it reaches unless it folds."""
        (at, x), share, way = begin, LONGEST, [begin]
        while at != last:
            step = share * (last - begin.s)
            target = last if abs(step) >= abs(last - at) else at + step
            _, f_x, f_s, *_ = self.at(x, at)
            slope = -np.linalg.solve(f_x, f_s)
            found = self.rest_point(x + slope * (target - at), target)
            if found is not None and self._is_next(Place(at, x), slope, Place(target, found)):
                x, at, share = found, target, min(2.0 * share, LONGEST)
                way.append(Place(at, x))
            else:
                share /= 2.0
                if share < SHORTEST:
                    break
        return way

    def _is_next(self, place: Place, slope: np.ndarray, found: Place) -> bool:
        """Whether `found` is on the branch of `place`, along which dx/ds is `slope` there, and not on another one.

        The determinant of f_x stays within a factor of 2, and x moves as the slopes at both places say.
        """
        (_, before, *_), (_, f_x, f_s, *_) = self.at(place.x, place.s), self.at(found.x, found.s)
        if not 0.5 < _determinant(f_x) / _determinant(before) < 2.0:
            return False
        slopes, step = np.array([slope, -np.linalg.solve(f_x, f_s)]), found.s - place.s
        off = np.abs(found.x - place.x - slopes.mean(axis=0) * step)
        # The trapezoidal rule: what it misses is a part of what x moves, or rounding, which a state that is 0 has from
        # the others.
        units = balancing_units(f_x)
        rounding = np.finfo(float).eps ** 0.5 * units * ((np.abs(found.x) + np.abs(place.x)) / units).max()
        return bool((off <= 0.5 * np.abs(slopes * step).max(axis=0) + rounding).all())

    def check_way(self, x: np.ndarray) -> None:
        """Raise unless rho leads from the first end to the last, where it has no multiple zeros."""
        first, last = self.ends
        inside = first + (last - first) * (np.arange(64) + 0.5) / 64.0
        name = self.ramp.phase
        if not (self.rates(np.tile(x, (64, 1)), inside).rho * np.sign(last - first) > 0.0).all():
            raise RampError(
                f"the ramp does not lead from {name} = {first:.6g} to {last:.6g}: its profile vanishes or points "
                "back on the way.",
                "Give the ends between which it has one sign.",
            )
        for s in (first, last):
            if self.rests_at(s) and abs(self.at(x, s).rho_s) * abs(last - first) <= 1e-12 * self.speed(x):
                raise RampError(f"the profile has a multiple zero at {name} = {s:.6g}.", "Take a simple one.")

    def rests_at(self, end: float) -> bool:
        """Whether the phase is at rest at one of the ends."""
        return self._rests[0 if end == self.ends[0] else 1]

    @cached_property
    def _rests(self) -> list[bool]:
        phase, rho = self.ramp.phase, self.ramp.profile.xreplace(self.kept)
        rests = []
        for end, s in zip(self.ramp.ends, self.ends):
            value, slope = (
                abs(float(e.xreplace({phase: sp.sympify(end, strict=True)})))
                for e in (rho, derivative(rho, phase))
            )
            # As far as doubles tell where it vanishes, as at 1/3.
            rests.append(value <= 4.0 * np.finfo(float).eps * slope * abs(s))
        return rests

    def speed(self, x: np.ndarray) -> float:
        """The largest |rho| on the way."""
        first, last = self.ends
        inside = first + (last - first) * (np.arange(16) + 0.5) / 16.0
        return float(np.abs(self.rates(np.tile(x, (16, 1)), inside).rho).max())

    def natural(self, begin: Place) -> float:
        """The rate at which the ramp is as fast as the slowest state at `begin`."""
        first, last = self.ends
        return float(-self.growth(begin)[-1]) * abs(last - first) / self.speed(begin.x)

    def paces(self, x: np.ndarray) -> list[float]:
        """|rho_s| at the ends where the phase is at rest, by which it leaves or comes to them."""
        return [abs(self.at(x, end).rho_s) for end in self.ends if self.rests_at(end)]

    def longest(self, x: np.ndarray) -> float:
        """The rate times the time along the ramp, ample: the way takes the inverse of rho, the slower end its pace."""
        first, last = self.ends
        paces = self.paces(x)
        return (40.0 / min(paces) if paces else 0.0) + 16.0 * abs(last - first) / self.speed(x)


def at_epsilon(field: VectorField | SlowFastSystem, epsilon: float | None) -> VectorField:
    """The field with the value of its small parameter put in."""
    if (field.epsilon is None) != (epsilon is None):
        fact = (
            "has no epsilon, and a value is given" if field.epsilon is None else "has an epsilon, and no value"
        )
        raise DeclarationError(
            f"epsilon: the field {fact}.", "Give both or neither.", got=shown(epsilon), value=epsilon
        )
    if field.epsilon is None and isinstance(field, VectorField):
        return field
    value = exact(check_epsilon(epsilon))  # pyright: ignore[reportArgumentType]
    rates = {x: rate.xreplace({field.epsilon: value}) for x, rate in zip(field.states, field.rates)}
    return VectorField(rates, epsilon=None, parameters=field.parameters, name=field.name)


def _determinant(matrix: np.ndarray) -> float:
    return float(np.linalg.det(matrix)) if len(matrix) > 1 else float(matrix[0, 0])
