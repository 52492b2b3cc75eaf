"""Nonholonomic constraints: the Lagrange-d'Alembert equations (8), (9) of Eldering (2015), two ways."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np
import sympy as sp

from gsp.algebra.ring_elements import RingElement
from gsp.errors import DeclarationError
from gsp.integration.trajectory import Trajectory
from gsp.mechanics.algebra import Algebra, entries, numbers
from gsp.mechanics.distribution import Flag, flag
from gsp.mechanics.frame import MovingFrame, moving_frames
from gsp.mechanics.hamel import HamelEquations, clocked, extended, hamel, split_positions
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.velocity_forms import read_constraints
from gsp.systems.flow import Values
from gsp.systems.system import VectorField

Constraints = Sequence[sp.Expr] | Mapping[sp.Symbol, sp.Expr]


@dataclass(frozen=True, repr=False)
class ConstrainedSystem:
    """A mechanical system that obeys A(q) qdot + c(q) = 0 by d'Alembert's principle.

    `matrix` is A (k, n) and `offset` c (k,). `frame` is a moving frame with quasi-velocities u on the
    distribution D; `reduced` is the flow on D in it.
    """

    system: LagrangianSystem
    constraints: tuple[sp.Expr, ...]
    frame: MovingFrame
    hamel: HamelEquations = field(compare=False)

    @property
    def matrix(self) -> sp.ImmutableMatrix:
        """A (k, n)."""
        return self.frame.slip_forms

    @property
    def offset(self) -> tuple[sp.Expr, ...]:
        """c (k,); zeros for linear constraints."""
        return self.frame.offset

    # -- in the raw velocities, with multipliers ---------------------------------------------------

    @cached_property
    def multipliers(self) -> tuple[sp.Expr, ...]:
        """lambda (k,) of (9), in (q, qdot): M qddot = R + A^T lambda keeps A qdot + c constant."""
        algebra, _, multipliers = self._raw
        return tuple(algebra.write(e) for e in multipliers)

    @cached_property
    def constraint_forces(self) -> Values:
        """A^T lambda by coordinate, in (q, qdot)."""
        algebra, _, multipliers = self._raw
        columns = algebra.matrix(self.matrix.T)
        forces = algebra.apply(columns, multipliers)
        return MappingProxyType({q: algebra.write(f) for q, f in zip(self.system.coordinates, forces)})

    @cached_property
    def field(self) -> VectorField:
        """The equations (9) in (q, qdot), time last when it enters; a start on D stays on D."""
        system = self.system
        algebra, accelerations, _ = self._raw
        rates = dict(zip(system.coordinates, system.velocities))
        rates |= {v: algebra.write(a) for v, a in zip(system.velocities, accelerations)}
        rates |= dict.fromkeys(system.clock, sp.Integer(1))
        return VectorField(rates, epsilon=None, parameters=system.values, name=system.name)

    @cached_property
    def _raw(self) -> tuple[Algebra, list[RingElement], list[RingElement]]:
        system = self.system
        algebra = system.raw_algebra([*entries(self.matrix), *self.offset])
        ring = algebra.ring
        motion = system.motion(algebra)
        inverse, free = motion.mobility, motion.accelerations
        A = algebra.matrix(self.matrix)
        v = [ring.generator(s) for s in system.velocities]
        residual = [x + algebra.read(c) for x, c in zip(algebra.apply(A, v), self.offset)]
        # d/dt (A qdot + c) = A qddot + (its derivative at constant velocity) = 0.
        carried = algebra.derive(residual, 0)
        columns = [list(column) for column in zip(*A)]
        mobility = algebra.inverse(algebra.multiply(A, algebra.multiply(inverse, columns)))
        right_side = [-(x + y) for x, y in zip(algebra.apply(A, free), carried)]
        multipliers = algebra.apply(mobility, right_side)
        kicks = algebra.apply(inverse, algebra.apply(columns, multipliers))
        return algebra, [(f + k).reduced() for f, k in zip(free, kicks)], multipliers

    # -- in the moving frame, without --------------------------------------------------------------

    @cached_property
    def reduced(self) -> VectorField:
        """Hamel's equations on D: u', and the rates of the positions that matter to them; time last."""
        matter, _, rates = self._split
        return clocked(self.system, matter, dict(zip(self.frame.along, rates)), epsilon=None)

    @cached_property
    def reconstruction(self) -> Values:
        """Rates, in u, of the positions that no other rate depends on."""
        return MappingProxyType(self._split[1])

    @property
    def full_field(self) -> VectorField:
        """`reduced` with the reconstruction variables behind its states."""
        return extended(self.reduced, self.reconstruction)

    @cached_property
    def reduced_multipliers(self) -> tuple[sp.Expr, ...]:
        """lambda (k,) on D, in (q, u)."""
        return tuple(self.hamel.algebra.write(e) for e in self.hamel.on_distribution[1])

    @property
    def quasi_velocities(self) -> Values:
        """u in terms of (q, qdot)."""
        shown = self.frame.expressions(self.system.velocities)
        return MappingProxyType({s: shown[s] for s in self.frame.along})

    @property
    def velocities(self) -> Values:
        """qdot in terms of (q, u), on D."""
        return self.hamel.raw_velocities(on_distribution=True)

    @cached_property
    def _split(self) -> tuple[dict, dict, list[sp.Expr]]:
        write = self.hamel.algebra.write
        rates = [write(e) for e in self.hamel.on_distribution[0]]
        positions = {q: write(e) for q, e in self.hamel.positions(on_distribution=True).items()}
        if not rates:
            # Every velocity is held: the positions are what is left to be followed, at rest.
            return positions, {}, rates
        matter, driven = split_positions(positions, rates, self.system.clock)
        return matter, driven, rates

    # -- integrability -----------------------------------------------------------------------------

    @cached_property
    def flag(self) -> Flag:
        """The flag of brackets of D (in space-time for affine constraints)."""
        return flag(self.system, self.frame)

    @property
    def is_holonomic(self) -> bool:
        """Whether all constraints integrate to constraints on positions (Frobenius, Remark 2.4)."""
        return self.flag.is_holonomic

    @property
    def integrable(self) -> tuple[bool, ...]:
        """For each constraint whether it vanishes on all iterated brackets of D, so is holonomic by itself."""
        return self.flag.integrable

    @property
    def growth_vector(self) -> tuple[int, ...]:
        """Ranks of D, D + [D, D], ... at a generic point."""
        return self.flag.growth

    # -- checks ------------------------------------------------------------------------------------

    def energy(self) -> sp.Expr:
        """H (4) on D, in (q, u)."""
        algebra = self.hamel.algebra
        return algebra.write(algebra.put(self.hamel.energy, self.hamel.zeros))

    def energy_rate(self) -> sp.Expr:
        """dH/dt along the flow on D, exactly, in (q, u).

        0 for linear constraints without forces and explicit time (Theorem 2.5); -lambda . c for affine ones.
        """
        equations = self.hamel
        rates = [*equations.on_distribution[0], *([equations.algebra.ring.zero] * len(self.frame.across))]
        total = equations.energy_derivative(rates, explicit=True)
        return equations.algebra.write(equations.algebra.put(total, equations.zeros))

    def virtual_work(self) -> tuple[sp.Expr, ...]:
        """Work of the constraint forces along each vector of the frame of D: zeros (Hypothesis 2.3)."""
        a = len(self.frame.along)
        pushes = self.constraint_forces.values()
        algebra = self.system.raw_algebra([*entries(self.frame.forms), *self.offset, *pushes])
        forces = [algebra.read(f) for f in pushes]
        psi = algebra.inverse(algebra.matrix(self.frame.forms))
        columns = [list(column) for column in zip(*psi)][:a]
        return tuple(algebra.write(e) for e in algebra.apply(columns, forces))

    def constraint_residual(self, trajectory: Trajectory) -> np.ndarray:
        """A qdot + c (k, m) along a trajectory of `field` (m times)."""
        symbols = (*self.system.coordinates, *self.system.velocities)
        points = np.stack([trajectory[s] for s in symbols], axis=1)
        shown = self.frame.expressions(self.system.velocities)
        return numbers([shown[w] for w in self.frame.across], symbols, points, self.system.values).T

    def __repr__(self) -> str:
        listed = ", ".join(f"{c} = 0" for c in self.constraints)
        return f"ConstrainedSystem({self.system.name or 'unnamed'}: {listed})"

    def __str__(self) -> str:
        lines = [str(self.reduced)]
        lines += [f"  {u} = {e}" for u, e in self.quasi_velocities.items()]
        lines += [f"  {q}' = {rate}" for q, rate in self.reconstruction.items()]
        lines += [f"  lambda of {c}: {e}" for c, e in zip(self.constraints, self.reduced_multipliers)]
        return "\n".join(lines)


def constrain(
    system: LagrangianSystem, constraints: Constraints, *, frame: Mapping[sp.Symbol, sp.Expr] | None = None
) -> ConstrainedSystem:
    """The system under velocity constraints A(q) qdot + c(q) = 0, by the Lagrange-d'Alembert equations (9).

    `constraints` are expressions that vanish, or a mapping that names them. `frame` names quasi-velocities u on
    the distribution D, {symbol: expression linear in the velocities}; without it raw velocities that stay free
    keep their names and others are called u1, u2, ... Raises `DeclarationError` for constraints that are not
    affine in the velocities, depend on time, depend on one another or contradict one another, and for a frame
    that is none. A system with holonomic constraints takes none here too: `constrain(system, [])`.

    >>> x, y, phi, xdot, ydot, turn = sp.symbols("x y phi xdot ydot turn")
    >>> edge = LagrangianSystem((xdot**2 + ydot**2 + turn**2)/2, [x, y, phi], [xdot, ydot, turn])
    >>> constrain(edge, [ydot*sp.cos(phi) - xdot*sp.sin(phi)]).reconstruction[x]
    u1*cos(phi)
    """
    if not isinstance(system, LagrangianSystem):
        raise DeclarationError("constrain takes a LagrangianSystem.", got=type(system).__name__)
    forms = read_constraints(system, constraints)
    equations = hamel(system, moving_frames(system, forms, frame))
    return ConstrainedSystem(system, forms.expressions, equations.frame, equations)
