"""A periodic orbit: period, states by phase, Floquet multipliers, and how far all of it can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from gsp.errors import DeclarationError, GspError, Status
from gsp.lowering.compiled_flow import compile_flow
from gsp.orbits.periodic.collocation import Cycle
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular
from gsp.roots import roots
from gsp.systems.arguments import check_array, shown
from gsp.systems.flow import Flow

# A multiplier inside the unit circle by more than the trivial one misses 1, and by more than this, is stable.
NEUTRAL = 1e-6
PHASES = "a finite number or a one-dimensional array"


@dataclass(frozen=True)
class OrbitStats:
    """What an orbit cost: Newton iterations, meshes, and intervals of the last one."""

    iterations: int
    meshes: int
    intervals: int


@dataclass(frozen=True, eq=False, repr=False)
class PeriodicOrbit(Drawn, Tabular):
    """A closed orbit u(s), s in [0, 1), of `flow` at `epsilon` and `parameters`, all of them by name.

    `period` is in the flow's time. `orbit["x"]` are values (m,) of a state or an observable at the phases `phases`
    (m,), from 0 to 1, both included; `.at(s)` the state at any phase. `multipliers` (n,) are Floquet's, the trivial
    one first, which is 1 but for errors (large ones along a canard, where growth and decay cancel), then by decreasing
    size; `divergence` is the integral of div F over the period, the logarithm of their product. `error` estimates
    the error of u in units of the amplitudes, or relative to u in a state whose rate vanishes with it, `period_error`
    the relative one of the period (NaN in a family, where it is not estimated); `residual` is the largest defect of the
    discrete equations in units of the amplitudes. `status`
    says how it ended. At MESH_LIMIT the errors are those that were reached; at any other but SUCCESS the values are the
    last iterate, no orbit, and are not printed.
    """

    flow: Flow
    epsilon: float | None
    parameters: Mapping[str, float]
    period: float
    multipliers: np.ndarray
    divergence: float
    error: float
    period_error: float
    residual: float
    status: Status
    stats: OrbitStats
    # About the centres of the flow.
    _cycle: Cycle = field(repr=False)
    _constants: np.ndarray = field(repr=False)

    @property
    def constants(self) -> Mapping[str, float]:
        """Epsilon, if there is one, and the parameters, by name."""
        return ({} if self.epsilon is None else {str(self.flow.epsilon): self.epsilon}) | dict(self.parameters)

    @property
    def phases(self) -> np.ndarray:
        """The mesh and the Gauss points of its intervals, from 0 to 1 (m,)."""
        cycle = self._cycle
        inner = cycle.mesh[:-1, None] + cycle.widths[:, None] * cycle.scheme.x
        return np.append(inner.ravel(), 1.0)

    @property
    def mesh(self) -> np.ndarray:
        """The ends of the collocation intervals, phases from 0 to 1 (N + 1,)."""
        return self._cycle.mesh

    @property
    def degree(self) -> int:
        """Degree of the polynomials on an interval."""
        return self._cycle.scheme.degree

    def at(self, phase: ArrayLike) -> np.ndarray:
        """State (n,) at a phase, or (n, k) at phases (k,); a phase counts modulo 1."""
        s = check_array(phase, what="phase", be=PHASES)
        if s.ndim > 1 or not np.isfinite(s).all():
            raise GspError(
                f"phase is {PHASES}.",
                got=f"the shape {s.shape}",
                value=s.shape,
            )
        values = (self._cycle.at(np.mod(np.atleast_1d(s), 1.0)) + self.flow.centre).T
        return values if s.ndim else values[:, 0]

    def __getitem__(self, key: str | sp.Symbol) -> np.ndarray:
        """Values (m,) over `phases` of a state or an observable; raises `GspError` for any other name."""
        return self.values(key, self.phases)

    def values(self, key: str | sp.Symbol, phase: ArrayLike) -> np.ndarray:
        """Values (k,) at phases (k,) of a state or an observable; raises `GspError` for any other name."""
        name = key.name if isinstance(key, sp.Symbol) else key
        states = [symbol.name for symbol in self.flow.states]
        observables = [symbol.name for symbol in self.flow.observables]
        points = self.at(np.atleast_1d(check_array(phase, what="phase", be=PHASES)))
        if name in states:
            return points[states.index(name)]
        if name in observables:
            found = compile_flow(self.flow).observables(points.T, self._constants)
            return found[:, observables.index(name)]
        known = [*states, *observables]
        raise GspError.none_of(known, name, f"{name!r} is no state and no observable.", "Those are")

    def crossings(self, key: str | sp.Symbol, level: float = 0.0) -> np.ndarray:
        """Phases (k,) at which a state or an observable passes `level`, in order; they come in pairs, up and down."""
        # Between these a polynomial that is resolved crosses once.
        s = np.interp(
            np.linspace(0.0, 1.0, 4 * (len(self.phases) - 1) + 1),
            np.linspace(0.0, 1.0, len(self.phases)),
            self.phases,
        )
        values = self.values(key, s) - level
        above = values > 0.0
        places = np.flatnonzero(above[1:] != above[:-1])
        ends = values[places], values[places + 1]
        return roots(lambda at: self.values(key, at) - level, s[places], s[places + 1], ends=ends)

    @cached_property
    def minimum(self) -> Mapping[str, float]:
        """Least value of each state, of the polynomials themselves."""
        return self._about_origin(self._extremes[0])

    @cached_property
    def maximum(self) -> Mapping[str, float]:
        """Largest value of each state, of the polynomials themselves."""
        return self._about_origin(self._extremes[1])

    @property
    def amplitude(self) -> Mapping[str, float]:
        """Largest minus least value of each state."""
        low, high = self._extremes
        return {s.name: float(b - a) for s, a, b in zip(self.flow.states, low, high)}

    def _about_origin(self, values: np.ndarray) -> dict[str, float]:
        return {s.name: float(v) for s, v in zip(self.flow.states, values + self.flow.centre)}

    @cached_property
    def _extremes(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest values of the states (n,), about the centres."""
        return self._most(-1.0), self._most(1.0)

    def _most(self, sign: float) -> np.ndarray:
        cycle, result = self._cycle, np.empty(len(self.flow.states))
        s = np.linspace(0.0, 1.0, 4 * cycle.scheme.degree + 1)
        sampled = np.einsum("ki,jin->jkn", cycle.scheme.basis(s), cycle.values)
        for i in range(len(result)):
            values = sign * sampled[:, :, i]
            j = int(np.argmax(values.max(axis=1)))
            best = float(values[j].max())
            for k in (j - 1, j, (j + 1) % len(values)):
                polynomial = np.polynomial.Polynomial.fit(
                    cycle.scheme.x, sign * cycle.values[k, :, i], cycle.scheme.degree, domain=[0.0, 1.0]
                )
                roots = polynomial.deriv().roots()
                real = roots[np.abs(roots.imag) < 1e-6].real
                inside = real[(real >= 0.0) & (real <= 1.0)]
                best = max(best, float(polynomial(inside).max(initial=-np.inf)))
            result[i] = sign * best
        return result

    @property
    def is_stable(self) -> bool:
        """Whether every multiplier but the trivial one is inside the unit circle."""
        return bool((np.abs(self.multipliers[1:]) < 1.0 - NEUTRAL).all())

    @property
    def unstable(self) -> int:
        """Number of multipliers outside the unit circle, the trivial one left out."""
        return int((np.abs(self.multipliers[1:]) > 1.0 + NEUTRAL).sum())

    @property
    def is_found(self) -> bool:
        """Whether the values solve the equations, if only to the `error` that the mesh allows."""
        return self.status in (Status.SUCCESS, Status.MESH_LIMIT)

    @property
    def message(self) -> str:
        """One line: how it ended, and what to do about it."""
        stats = self.stats
        done = f"{stats.iterations} Newton steps on {stats.meshes} meshes"
        if self.status.ok:
            return f"converged after {done}, error {self.error:.1e}"
        reached = f", error {self.error:.1e}" if self.is_found else ""
        return f"stopped after {done}: {self.status.name}{reached}; {self.status.remedy}"

    @property
    def _period_shown(self) -> str:
        """The period to the digits that its error leaves."""
        known = self.period_error if self.period_error > 0.0 else 1e-15
        return f"{self.period:.{int(min(max(-np.log10(known), 1.0), 15.0))}g}"

    def __repr__(self) -> str:
        names = ", ".join(symbol.name for symbol in self.flow.states)
        if not self.is_found:
            return f"PeriodicOrbit([{names}], none found, {self.status.name})"
        stability = "stable" if self.is_stable else "unstable"
        return f"PeriodicOrbit([{names}], period={self.period:.10g}, {stability}, {self.status.name})"

    def __str__(self) -> str:
        width = max(len(symbol.name) for symbol in self.flow.states)
        at = "".join(f", {name} = {value:.10g}" for name, value in self.constants.items())
        if not self.is_found:
            return f"no periodic orbit found{at}\n  {self.message}"
        lines = [
            f"periodic orbit{at}",
            f"  period {self._period_shown}"
            + ("" if np.isnan(self.period_error) else f" (relative error {self.period_error:.1e})"),
            *(
                f"  {symbol.name:>{width}}  from {self.minimum[symbol.name]:.6g} to {self.maximum[symbol.name]:.6g}"
                for symbol in self.flow.states
            ),
            "  multipliers " + ", ".join(_complex(value) for value in self.multipliers),
            f"  {self.stats.intervals} intervals of degree {self.degree}",
            f"  {self.message}",
        ]
        return "\n".join(lines)


def check_name(flow: Flow, parameter: sp.Symbol | str, *, epsilon: bool = False) -> sp.Symbol:
    """The parameter of the flow with that name, or `epsilon` too; raises `DeclarationError` when there is none."""
    name = parameter.name if isinstance(parameter, sp.Symbol) else parameter
    names = {symbol.name: symbol for symbol in flow.parameters}
    if epsilon and flow.epsilon is not None:
        names[flow.epsilon.name] = flow.epsilon
    if not isinstance(name, str) or name not in names:
        raise DeclarationError.none_of(
            names, name, f"there is no parameter {shown(name)}.", "The parameters are"
        )
    return names[name]


def _complex(value: complex) -> str:
    return f"{value.real:.6g}" if value.imag == 0.0 else f"{value.real:.6g} {value.imag:+.6g}i"
