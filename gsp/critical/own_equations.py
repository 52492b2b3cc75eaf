"""The equations of a branch about the centres of its system and in the branch's units, and their zeros by Newton's
method.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import entries
from gsp.algebra.factorisation import centre, coefficients
from gsp.critical.sheet_points import newton_at_each
from gsp.critical.sheet_roots import roots_about, scattered_roots, size_of
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.systems.region import Interval
from gsp.systems.system import SlowFastSystem


@dataclass(frozen=True, eq=False)
class OwnEquations:
    """`equations` of x and y that stand for c + u z, with the `centres` c of the system and the `units` u (n,) for z.

    Points that are taken and given as x and y are those of the system; what is called own is z.
    """

    system: SlowFastSystem
    equations: tuple[sp.Expr, ...]
    units: np.ndarray

    # -- coordinates -------------------------------------------------------------------------------

    @cached_property
    def scales(self) -> tuple[np.ndarray, np.ndarray]:
        """The units of x (n_slow,) and of y (n_fast,)."""
        return self.units[: len(self.system.x)], self.units[len(self.system.x) :]

    @cached_property
    def _centres(self) -> tuple[np.ndarray, np.ndarray]:
        return self.system.centre[: len(self.system.x)], self.system.centre[len(self.system.x) :]

    def x_in(self, x: np.ndarray) -> np.ndarray:
        """The own numbers of slow values x."""
        return (x - self._centres[0]) / self.scales[0]

    def y_in(self, y: np.ndarray) -> np.ndarray:
        """The own numbers of fast values y."""
        return (y - self._centres[1]) / self.scales[1]

    def y_out(self, y: np.ndarray) -> np.ndarray:
        """Fast values of own numbers."""
        return y * self.scales[1] + self._centres[1]

    def points_in(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The own numbers of points (m, n_slow) and (m, n_fast) of the branch."""
        x, y = self.x_in(x), self.y_in(y)
        if self.system.centres:
            # The rounding of a point that is far from the origin is long about the centres.
            found, good = self.newton(x, y)
            y = np.where(good[:, None], found, y)
        return x, y

    def _bounds_in(self, bounds: Mapping[str, Interval]) -> dict[str, Interval]:
        frame = zip(self.system.y, self._centres[1].tolist(), self.scales[1].tolist())
        return {
            y.name: ((bounds[y.name][0] - c) / unit, (bounds[y.name][1] - c) / unit)
            for y, c, unit in frame
            if y.name in bounds
        }

    # -- values ------------------------------------------------------------------------------------

    @cached_property
    def values(self) -> np.ndarray:
        """The parameters' values, which the compiled functions take."""
        return compile_flow(self.system).constants

    @cached_property
    def _own(self) -> tuple[sp.Expr, ...]:
        centres = self.system.centres
        inner = {
            s: s * sp.Rational(*unit.as_integer_ratio()) + centres.get(s, 0)
            for s, unit in zip(self.system.states, self.units.tolist())
            if unit != 1.0 or s in centres
        }
        return tuple(e.xreplace(inner) for e in self.equations)

    @cached_property
    def residual(self):
        """The equations, compiled over own (x, y)."""
        return self._compiled(self._own, self.system.states)

    @cached_property
    def jacobian(self):
        """Their derivatives by the own y, row by row."""
        return self._compiled(tuple(entries(self._own, self.system.y)), self.system.states)

    @cached_property
    def slow_jacobian(self):
        """Their derivatives by the own x, row by row."""
        return self._compiled(tuple(entries(self._own, self.system.x)), self.system.states)

    def residual_at(self, z: np.ndarray) -> np.ndarray:
        """The equations at points z = (x, y), (m, n): (m, n_fast)."""
        return self.residual((z - self.system.centre) / self.units, self.values)

    def jacobian_at(self, z: np.ndarray) -> np.ndarray:
        """Derivatives of the equations by (x, y) at points z (m, n): (m, n_fast, n)."""
        m, n, own = len(z), len(self.system.y), (z - self.system.centre) / self.units
        parts = [f(own, self.values).reshape(m, n, -1) for f in (self.slow_jacobian, self.jacobian)]
        return np.concatenate(parts, axis=2) / self.units

    @cached_property
    def _polynomial(self):
        """c and the coefficients of the one equation in powers of y - c, y the one fast variable, compiled; or None."""
        if len(self.system.y) != 1:
            return None
        (y,), (equation,) = self.system.y, self._own
        about = centre(equation, y)
        row = coefficients(equation.xreplace({y: y + about}), y)
        return None if row is None else self._compiled((about, *row), self.system.x)

    @property
    def is_polynomial(self) -> bool:
        """Whether one fast variable enters as a polynomial."""
        return self._polynomial is not None

    def _compiled(self, outputs, arguments):
        return compile_over(self.system, outputs, arguments=arguments)

    # -- zeros -------------------------------------------------------------------------------------

    def newton(self, x: np.ndarray, y: np.ndarray, *, size: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
        """Newton's method at all own points at once; returns own y and which points converged."""
        return newton_at_each(
            lambda z: self.residual(z, self.values),
            lambda z: self.jacobian(z, self.values),
            x,
            y,
            size=size,
        )

    def corrected(self, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The same from points x and y to points y."""
        found, good = self.newton(self.x_in(x), self.y_in(y))
        return self.y_out(found), good

    def polynomial_roots(self, point: np.ndarray, bounds: Mapping[str, Interval] | None = None) -> np.ndarray:
        """All real points (k, 1) over one slow point where the equation is a polynomial in the one fast variable."""
        assert self._polynomial is not None
        own, x = self._bounds_in(bounds or {}), self.x_in(point)
        size = size_of(np.array(list(own.values()))) if own else 1.0
        about, *coefficients = self._polynomial(x[None, :], self.values)[0]
        if not np.isfinite(coefficients).all():
            return np.empty((0, 1))
        found = np.roots(np.trim_zeros(coefficients, "f"))
        # Imaginary parts of polynomial roots below this, relative to 1 + |y| in the branch's units, count as
        # rounding.
        real = found.real[np.abs(found.imag) <= 1e-7 * (size + np.abs(found))]
        guess = about + np.sort(real)[:, None]
        polished, good = self.newton(np.broadcast_to(x, (len(guess), len(x))), guess, size=size)
        return self.y_out(np.where(good[:, None], polished, guess))

    def roots_within(self, point: np.ndarray, bounds: Mapping[str, Interval]) -> np.ndarray:
        """Points (k, n_fast) over one slow point to which Newton's method comes from places of all fast `bounds`."""
        own = self._bounds_in(bounds)
        box = np.array([own[y.name] for y in self.system.y])
        return self.y_out(scattered_roots(partial(self._newton_over, point), box, size=size_of(box)))

    def roots_near(self, point: np.ndarray, y: np.ndarray, bounds: Mapping[str, Interval]) -> np.ndarray:
        """Points (k, n_fast) over one slow point: the nearest to `y` (n_fast,), and those in the fast `bounds`."""
        newton, names = partial(self._newton_over, point), [s.name for s in self.system.y]
        return self.y_out(roots_about(newton, self.y_in(y), names, self._bounds_in(bounds)))

    def _newton_over(self, point: np.ndarray, y: np.ndarray, size: float) -> np.ndarray:
        """Own roots (k, n_fast) over one slow point that Newton's method comes to from own y (m, n_fast)."""
        found, good = self.newton(np.broadcast_to(self.x_in(point), (len(y), len(point))), y, size=size)
        return found[good]
