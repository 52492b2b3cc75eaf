"""The layer flow y' = g(x0, y, 0) over one slow point, in units of its own, and where it switches."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.laurent import laurent
from gsp.algebra.switching_functions import switches
from gsp.lowering.compiled_flow import compile_flow
from gsp.lowering.compiled_function import compile_over
from gsp.systems.declaration import exact
from gsp.systems.region import powers_of_two
from gsp.systems.system import SlowFastSystem, VectorField

# A panel of a layer is resolved when its last Chebyshev coefficients are this small, relative to the layer on it.
RESOLVED = 1e-13


@dataclass(frozen=True, eq=False)
class LayerFlow:
    """g(x0, y, 0) and g_y of `system`, both times `direction`, with y in `units` (n_fast,)."""

    system: SlowFastSystem
    x: np.ndarray
    units: np.ndarray
    direction: int = 1

    @classmethod
    def within(cls, system: SlowFastSystem, x: np.ndarray, *places: np.ndarray) -> LayerFlow:
        """The layer in units in which the largest of `places` (n_fast,), each in the system's units, has size one.

        A variable that is 0 in all of them is as large as the others make it within a fast time. So is one that is what
        rounding leaves of these: the rounding of g, over a fast time or times g_y^-1, is more than a layer is resolved
        to.
        """
        sizes = np.abs(places).max(axis=0)
        plain = cls(system, x, np.ones(len(sizes)))
        matrices = [plain.jacobian(place[None, :])[0] for place in places]
        for matrix in matrices:
            coupling = np.abs(matrix)
            fastest = np.abs(np.linalg.eigvals(coupling)).max() if np.isfinite(coupling).all() else 0.0
            if fastest > 0.0:
                for _ in sizes:
                    made = (coupling * sizes).max(axis=1) / fastest
                    sizes = np.where(np.finfo(float).eps * made > RESOLVED * sizes, made, sizes)
        with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError):
            made = np.abs(np.linalg.inv(matrices[0])) @ (np.abs(matrices[0]) @ sizes)
            sizes = np.where(np.finfo(float).eps * made > RESOLVED * sizes, made, sizes)
        return replace(plain, units=powers_of_two(np.where(sizes > 0.0, sizes, 1.0)))

    @property
    def about_centres(self) -> LayerFlow:
        """The layer of the system about its centres; itself where that has none."""
        system = self.system
        if not system.centres:
            return self
        return replace(self, system=system.about_centres, x=self.x - system.centre[: len(self.x)])

    def rates(self, y: np.ndarray) -> np.ndarray:
        return self.direction * self._function(self._rates, y) / self.units

    @property
    def is_affine(self) -> bool:
        """Whether g is affine in y, without switches, so that the linearisation is the layer itself."""
        return not self._switches and not any(entry.has(*self.system.y) for entry in self._derivatives)

    def jacobian(self, y: np.ndarray) -> np.ndarray:
        n = len(self.system.y)
        plain = self._function(self._derivatives, y).reshape(-1, n, n)
        return self.direction * plain * (self.units / self.units[:, None])

    def switching(self, y: np.ndarray) -> np.ndarray:
        """The switching functions of f and g (k,) at `y` (m, n_fast): (m, k)."""
        found = self._switches
        return self._function([s.surface for s in found], y) if found else np.empty((len(y), 0))

    def jumps(self, y: np.ndarray) -> np.ndarray:
        """Which of f and g (n,) jump at `y` (n_fast,), where a switching function vanishes, along the layer."""
        way = self.rates(y[None, :])[0]
        # How far off a switching surface its two sides are compared, in units.
        places = y + 1e-6 * np.outer([-1.0, 1.0], way / np.linalg.norm(way))
        both = self._function([*self._slow_rates, *self._rates], places)
        # A jump is at least this share of the rates.
        return np.abs(both[1] - both[0]) > 1e-3 * np.abs(both).max(axis=0)

    @property
    def _slow_rates(self) -> list[sp.Expr]:
        return self._leading(self.system.f)

    @property
    def _rates(self) -> list[sp.Expr]:
        return self._leading(self.system.g)

    @property
    def _switches(self):
        return switches([*self._slow_rates, *self._rates], self.system.y)

    @property
    def _derivatives(self) -> list[sp.Expr]:
        return [derivative(rate, s) for rate in self._rates for s in self.system.y]

    def _leading(self, rates: Iterable[sp.Expr]) -> list[sp.Expr]:
        return [laurent(rate, self.system.epsilon, order=0).get(0, sp.Integer(0)) for rate in rates]

    def _function(self, outputs: list[sp.Expr], y: np.ndarray) -> np.ndarray:
        function = compile_over(self.system, outputs)
        z = np.hstack([np.broadcast_to(self.x, (len(y), len(self.x))), y * self.units])
        return function(z, compile_flow(self.system).constants)

    def flow(self) -> VectorField:
        values = {s: exact(float(value)) for s, value in zip(self.system.x, self.x)}
        units = {s: sp.Rational(*float(u).as_integer_ratio()) for s, u in zip(self.system.y, self.units)}
        inner = {s: s * unit for s, unit in units.items() if unit != 1}
        return VectorField(
            {
                s: self.direction * rate.xreplace(inner) / units[s]
                for s, rate in zip(self.system.y, self._rates)
            },
            epsilon=None,
            parameters={**self.system.parameters, **values},
        )
