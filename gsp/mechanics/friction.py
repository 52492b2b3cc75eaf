"""Strong friction in place of constraints: section 4 of Eldering (2015) for any Lagrangian system."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any, cast

import numpy as np
import sympy as sp

from gsp.algebra.ring_elements import RingElement
from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError
from gsp.integration.trajectory import Trajectory
from gsp.mechanics.algebra import Algebra, Matrix, entries
from gsp.mechanics.constraints import ConstrainedSystem, Constraints
from gsp.mechanics.damping import KINETIC, Damping, check_damping_over, kinetic_damping, read_damping
from gsp.mechanics.frame import MovingFrame, moving_frame
from gsp.mechanics.frame_starts import frame_values, new_region
from gsp.mechanics.hamel import HamelEquations, clocked, extended, hamel, split_positions
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.slow_momenta import SlowMomenta, geometric_splitting, slow_momenta
from gsp.mechanics.velocity_forms import read_constraints
from gsp.scenes.scene import Scene
from gsp.slow.series import expand
from gsp.splitting.splitting import Splitting
from gsp.systems.flow import Point, Values
from gsp.systems.region import Interval, check_region
from gsp.systems.system import SlowFastSystem, VectorField


@dataclass(frozen=True, eq=False, repr=False)
class FrictionSystem:
    """A mechanical system with Rayleigh friction |w|^2_B/(2 epsilon) against the slip w = A(q) qdot + c(q).

    `damping` is B (k, k); `limit` the constrained system that it tends to, in the same `frame`.
    """

    limit: ConstrainedSystem
    epsilon: sp.Symbol
    damping: sp.ImmutableMatrix

    @property
    def system(self) -> LagrangianSystem:
        """The system without friction."""
        return self.limit.system

    @property
    def constraints(self) -> tuple[sp.Expr, ...]:
        """The constraints, in (q, qdot)."""
        return self.limit.constraints

    @property
    def frame(self) -> MovingFrame:
        """The moving frame: quasi-velocities u along D, slip velocities w across it."""
        return self.limit.frame

    @property
    def quasi_velocities(self) -> Values:
        """u and w in terms of (q, qdot)."""
        return MappingProxyType(self.frame.expressions(self.system.velocities))

    @property
    def velocities(self) -> Values:
        """qdot in terms of (q, u, w)."""
        return self._equations.raw_velocities()

    @cached_property
    def field(self) -> VectorField:
        """q', u', w' for the positions that matter, time last; the poles are those of the friction."""
        matter, _, rates = self._split
        return clocked(self.system, matter, rates, epsilon=self.epsilon)

    @cached_property
    def reconstruction(self) -> Values:
        """Rates, in (u, w), of the positions that no other rate depends on."""
        return MappingProxyType(self._split[1])

    @property
    def full_field(self) -> VectorField:
        """`field` with the reconstruction variables behind its states."""
        return extended(self.field, self.reconstruction)

    @cached_property
    def splitting(self) -> Splitting:
        """Slow and fast variables, from the geometry: momenta along D feel no friction, the slip w is fast."""
        return geometric_splitting(self.field, self._equations, self._momenta, self._mobility, self._layer)

    @property
    def standard_form(self) -> SlowFastSystem:
        """`splitting.system`."""
        system = self.splitting.system
        assert system is not None
        return system

    @property
    def has_constant_fibres(self) -> bool:
        """Whether the slow momenta have coefficients without positions, so that `gsp.split` finds them too."""
        return all(self._momenta.constant)

    @cached_property
    def friction_forces(self) -> Values:
        """-A^T B (A qdot + c)/epsilon by coordinate, in (q, qdot): (14) over epsilon."""
        shown = self.quasi_velocities
        slip = sp.Matrix([shown[w] for w in self.frame.across])
        forces = entries(self.limit.matrix.T * self.damping * slip)
        algebra = self.system.raw_algebra(forces)
        return MappingProxyType(
            {q: -algebra.clean(f) / self.epsilon for q, f in zip(self.system.coordinates, forces)}
        )

    # -- checks ------------------------------------------------------------------------------------

    def energy(self) -> sp.Expr:
        """H (4) in (q, u, w)."""
        return self._equations.algebra.write(self._equations.energy)

    def dissipation(self) -> sp.Expr:
        """-(A qdot)^T B w/epsilon, the power of the friction; -|A qdot|^2_B/epsilon for linear constraints."""
        w = sp.Matrix(list(self.frame.across))
        sliding = w - sp.Matrix(list(self.frame.offset))
        algebra = self._equations.algebra
        return -algebra.clean((sliding.T * self.damping * w)[0]) / self.epsilon

    def energy_rate(self) -> sp.Expr:
        """dH/dt along `field`, exactly: `dissipation()` and the power of forces and explicit time."""
        equations = self._equations
        regular = equations.energy_derivative(equations.drift, explicit=True)
        pole = equations.energy_derivative(self._layer, explicit=False)
        return equations.algebra.write(regular) + equations.algebra.write(pole) / self.epsilon

    def constraint_residual(self, trajectory: Trajectory) -> np.ndarray:
        """w = A qdot + c (k, m) along a trajectory of `field`, `full_field` or `standard_form`."""
        return np.stack([trajectory[w] for w in self.frame.across])

    def slip_defect(self) -> tuple[sp.Expr, ...]:
        """h_1 + B^-1 lambda (k,) in the slow variables: zeros, for w = -epsilon B^-1 lambda + O(epsilon^2).

        h_1 comes from the series of the slow manifold, lambda from the Lagrange-d'Alembert equations (9).
        """
        branch = solve_critical(self.standard_form).branches[0]
        first = expand(branch, order=1).coefficients[1]
        on_critical = {z: e.xreplace(self._equations.zeros) for z, e in self.splitting.inverse.items()}
        multipliers: list[Any] = [e.xreplace(on_critical) for e in self.limit.reduced_multipliers]
        system = self.system
        algebra = Algebra(
            (*system.coordinates, *system.clock, *self.standard_form.x),
            tuple(system.values),
            [*multipliers, *first, *entries(self.damping)],
        )
        slip = algebra.apply(
            algebra.inverse(algebra.matrix(self.damping)), [algebra.read(e) for e in multipliers]
        )
        return tuple(algebra.write(algebra.read(h) + s) for h, s in zip(first, slip))

    # -- a question about it -----------------------------------------------------------------------

    def scene(
        self,
        *,
        region: Mapping[str, Interval] | Mapping[sp.Symbol, Interval],
        start: Point,
        span: Interval,
        epsilon: float,
        epsilons: Iterable[float] | None = None,
        tolerance: float = 1e-6,
        path: tuple[str, str] | None = None,
        name: str = "",
        title: str = "",
        source: str = "",
        description: str = "",
        claims: Mapping[str, Values] | None = None,
        observables: Values | None = None,
    ) -> Scene:
        """A scene about this system, positions that nothing depends on as its reconstruction.

        `start` gives raw velocities, or quasi-velocities, and positions; reconstructed positions start at 0
        unless given. `region` bounds states of `field`. The scene is about `field` where `gsp.split` finds the
        slow momenta, else about `standard_form`, with the region's image, the other quasi-velocities among its
        observables. `observables` are further ones in the states of `field`, as `{H: system.energy()}`. Raises
        `DeclarationError` where a damping that depends on positions is not positive definite in the region.
        """
        states, positions = frame_values(self.system, self.frame, self.field, self.reconstruction, start)
        field = self.field
        system: VectorField | SlowFastSystem = VectorField(
            field.equations,
            epsilon=self.epsilon,
            parameters=field.parameters,
            name=field.name,
            observables=observables,
        )
        box: Mapping = region
        reconstruction = dict(self.reconstruction)
        if not self.has_constant_fibres:
            bounds = check_region(region, [s.name for s in (*self.field.states, *self.standard_form.states)])
            inverse = dict(self.splitting.inverse)
            given = {s: _put(e, inverse) for s, e in system.observables.items()}
            standard = self.standard_form
            system = replace(standard, observables={**standard.observables, **given})
            box = new_region(self.splitting, bounds)
            states = self.splitting.to_new(states)
            reconstruction = {q: _put(rate, inverse) for q, rate in reconstruction.items()}
        scene = Scene(
            system,
            box,
            states,
            span,
            epsilon,
            cast("tuple[float, ...]", epsilons),
            tolerance,
            name=name,
            title=title,
            source=source,
            description=description,
            reconstruction=reconstruction,
            reconstruction_start=positions,
            path=path,
            claims=claims or {},
        )
        check_damping_over(self.system, self.damping, scene.region, scene.full_start)
        return scene

    # -- parts -------------------------------------------------------------------------------------

    @property
    def _equations(self) -> HamelEquations:
        return self.limit.hamel

    @cached_property
    def _momenta(self) -> SlowMomenta:
        return slow_momenta(self._equations)

    @cached_property
    def _mobility(self) -> Matrix:
        """eta' = mobility w/epsilon + drift."""
        equations, algebra = self._equations, self._equations.algebra
        B = algebra.matrix(self.damping)
        slip = [[-e for e in row] for row in algebra.multiply(equations.schur_inverse, B)]
        along = [[-e for e in row] for row in algebra.multiply(equations.coupling, slip)]
        return [*along, *slip]

    @cached_property
    def _layer(self) -> list[RingElement]:
        algebra = self._equations.algebra
        return algebra.apply(self._mobility, [algebra.ring.generator(w) for w in self.frame.across])

    @cached_property
    def _split(self) -> tuple[dict, dict, dict]:
        equations, write = self._equations, self._equations.algebra.write
        rates = {
            s: write(drift) + write(layer) / self.epsilon
            for s, drift, layer in zip(self.frame.quasi_velocities, equations.drift, self._layer)
        }
        positions = {q: write(e) for q, e in equations.positions().items()}
        # The slow momenta's own coefficients may contain a position that the rates do not.
        metric = [write(e) for rows in (self._momenta.along, self._momenta.across) for row in rows for e in row]
        matter, driven = split_positions(positions, [*rates.values(), *metric], self.system.clock)
        return matter, driven, rates

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FrictionSystem) and (
            (self.limit, self.epsilon, self.damping) == (other.limit, other.epsilon, other.damping)
        )

    def __hash__(self) -> int:
        return hash((self.limit, self.epsilon, self.damping))

    def __repr__(self) -> str:
        listed = ", ".join(
            f"{w} = {e}" for w, e in list(self.quasi_velocities.items())[len(self.frame.along) :]
        )
        return f"FrictionSystem({self.system.name or 'unnamed'}: friction against {listed})"

    def __str__(self) -> str:
        lines = [str(self.field)]
        lines += [f"  {u} = {e}" for u, e in self.quasi_velocities.items()]
        lines += [f"  {q}' = {rate}" for q, rate in self.reconstruction.items()]
        return "\n".join(lines)


def _put(expression: Any, values: Mapping[sp.Symbol, sp.Expr]) -> Any:
    return expression.xreplace(values)


def with_friction(
    system: LagrangianSystem,
    constraints: Constraints,
    *,
    epsilon: sp.Symbol,
    damping: Damping | None = None,
    frame: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> FrictionSystem:
    """The system with friction from the Rayleigh function |A qdot + c|^2_B/(2 epsilon) in place of constraints.

    `damping` is B, symmetric and positive definite: a number, or a matrix of parameters and positions; the
    identity by default, with which the friction depends on how the constraints are scaled; or "kinetic" for
    B = (A M^-1 A^T)^-1, with which it does not (footnote 3 of Eldering 2015).
    `constraints` and `frame` are as for `constrain`; slip velocities are called w, or w1,
    w2, ..., unless named there. Raises `DeclarationError` for what `constrain` refuses, for a Lagrangian that
    is not quadratic in the velocities, and for a B that is no damping.

    >>> x, xdot, m, eps = sp.symbols("x xdot m epsilon")
    >>> y, ydot = sp.symbols("y ydot")
    >>> cart = LagrangianSystem(m*(xdot**2 + ydot**2)/2 - x*y, [x, y], [xdot, ydot], parameters={m: 2})
    >>> with_friction(cart, [ydot], epsilon=eps).field.rates
    (xdot, w, -y/m, -x/m - w/(epsilon*m))
    """
    if not isinstance(system, LagrangianSystem):
        raise DeclarationError("with_friction takes a LagrangianSystem.", got=type(system).__name__)
    names = {s.name for s in (*system.coordinates, *system.velocities, *system.values, *system.clock)}
    if not isinstance(epsilon, sp.Symbol) or epsilon.name in names:
        raise DeclarationError(
            "epsilon is a symbol of its own.", got=f"{epsilon!r}; its value is given later", value=epsilon
        )
    if not system.is_quadratic:
        raise DeclarationError(
            f"the Lagrangian is not quadratic in the velocities: L = {system.lagrangian}.",
            "The slow momenta of the friction limit need a kinetic metric; `constrain` does without.",
        )
    forms = read_constraints(system, constraints)
    is_kinetic = isinstance(damping, str) and damping == KINETIC
    matrix = None if is_kinetic else read_damping(system, damping, forms.count)
    adapted = moving_frame(system, forms, frame, reserved=(epsilon,))
    if matrix is None:
        matrix = kinetic_damping(hamel(system, adapted))
    equations = hamel(system, adapted, tuple(entries(matrix)))
    return FrictionSystem(ConstrainedSystem(system, forms.expressions, adapted, equations), epsilon, matrix)
