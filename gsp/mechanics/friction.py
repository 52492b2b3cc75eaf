"""Strong friction in place of constraints: section 4 of Eldering (2015) for any Lagrangian system."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, cast, overload

import sympy as sp

from gsp.algebra.ring_elements import RingElement
from gsp.errors import DeclarationError
from gsp.mechanics.algebra import Algebra, entries, within_budget
from gsp.mechanics.constraints import ConstrainedSystem, Constraints
from gsp.mechanics.damping import KINETIC, Damping, check_damping_over, kinetic_damping, read_damping
from gsp.mechanics.dry_friction import DryFrictionSystem, grouped, read_contacts
from gsp.mechanics.frame import moving_frames
from gsp.mechanics.hamel import hamel
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.slipping import SlippingSystem
from gsp.mechanics.slow_momenta import SlowMomenta, geometric_splitting, slow_momenta
from gsp.mechanics.velocity_forms import read_constraints
from gsp.scenes.scene import Scene
from gsp.sliding.law import switch_law
from gsp.splitting.splitting import Splitting
from gsp.systems.arguments import shown
from gsp.systems.flow import Values

# The law of friction that grows with the slip without bound, and the one that is bounded, of phi = r/sqrt(1 + r^2).
VISCOUS, COULOMB = "viscous", "coulomb"
Strength = sp.Expr | float | Sequence[Any]
"""mu or N: a number or an expression for all contacts, or a list with one for each."""


@dataclass(frozen=True, repr=False)
class FrictionSystem(SlippingSystem):
    """A mechanical system with Rayleigh friction |w|^2_B/(2 epsilon) against the slip w = A(q) qdot + c(q).

    `damping` is B (k, k); `limit` the constrained system that it tends to, in the same `frame`.
    """

    limit: ConstrainedSystem
    epsilon: sp.Symbol
    damping: sp.ImmutableMatrix

    @cached_property
    def splitting(self) -> Splitting:
        """Slow and fast variables, from the geometry: momenta along D feel no friction, the slip w is fast.

        Raises `BudgetError` where its formulas are too long to be formed.
        """
        with within_budget():
            fast_parts = self._mobility, self._layer, self._drift
            return geometric_splitting(self.field, self._equations, self._momenta, *fast_parts)

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
        regular = equations.energy_derivative(equations.rates(equations.force), explicit=True)
        pole = equations.energy_derivative(equations.rates(self._rubbing(self._slips)), explicit=False)
        return equations.algebra.write(regular) + equations.algebra.write(pole) / self.epsilon

    @within_budget()
    def slip_defect(self) -> tuple[sp.Expr, ...]:
        """h_1 + B^-1 lambda (k,) in the slow variables: zeros, for w = -epsilon B^-1 lambda + O(epsilon^2).

        h_1 = -g_w^-1 g_epsilon on w = 0 is the first term of the slow manifold of `standard_form`, lambda comes from
        the Lagrange-d'Alembert equations (9).
        """
        system, standard, zeros = self.system, self.standard_form, self._equations.zeros
        still, slow = {**zeros, self.epsilon: sp.Integer(0)}, {**zeros, self.epsilon: sp.Integer(1)}
        # Without differentiation, which takes longer than all else: g is linear in w where epsilon = 0, and in epsilon.
        slopes = sp.Matrix([[g.xreplace({**still, w: sp.Integer(1)}) for w in standard.y] for g in standard.g])
        pushes = [g.xreplace(slow) for g in standard.g]
        on_critical = {z: e.xreplace(zeros) for z, e in self.splitting.inverse.items()}
        multipliers: list[Any] = [e.xreplace(on_critical) for e in self.limit.reduced_multipliers]
        algebra = Algebra(
            (*system.coordinates, *system.clock, *standard.x),
            tuple(system.values),
            [*multipliers, *slopes, *pushes, *entries(self.damping)],
            measured_from=self._equations.algebra.measured_from,
        )

        def solved(matrix: sp.MatrixBase, side: Iterable[sp.Expr]) -> list[RingElement]:
            return algebra.apply(algebra.inverse(algebra.matrix(matrix)), [algebra.read(e) for e in side])

        pairs = zip(solved(self.damping, multipliers), solved(slopes, pushes))
        return tuple(algebra.write(slip - first) for slip, first in pairs)

    # -- parts -------------------------------------------------------------------------------------

    @cached_property
    def _momenta(self) -> SlowMomenta:
        return slow_momenta(self._equations)

    def _rubbing(self, slips: Sequence[RingElement]) -> list[RingElement]:
        """epsilon times the friction (n,) in the frame: (0, -B w)."""
        algebra = self._equations.algebra
        friction = algebra.apply(algebra.matrix(self.damping), slips)
        return [*[algebra.ring.zero] * len(self.frame.along), *(-e for e in friction)]

    @cached_property
    def _mobility(self) -> sp.ImmutableMatrix:
        """eta' = mobility w/epsilon + drift (n, k)."""
        ring, k = self._equations.algebra.ring, range(len(self.frame.across))
        units = ([ring.one if i == j else ring.zero for i in k] for j in k)
        return sp.ImmutableMatrix(list(zip(*(self._equations.written(self._rubbing(unit)) for unit in units))))

    @cached_property
    def _layer(self) -> list[sp.Expr]:
        return self._equations.written(self._rubbing(self._slips))

    @property
    def _slips(self) -> list[RingElement]:
        return [self._equations.algebra.ring.generator(w) for w in self.frame.across]

    def _rates(self) -> tuple[dict[sp.Symbol, sp.Expr], list[sp.Expr]]:
        write = self._equations.algebra.write
        rates = {
            s: drift + layer / self.epsilon
            for s, drift, layer in zip(self.frame.quasi_velocities, self._drift, self._layer)
        }
        # The slow momenta's own coefficients may contain a position that the rates do not.
        return rates, [
            write(e) for rows in (self._momenta.along, self._momenta.across) for row in rows for e in row
        ]

    def _check_over(self, scene: Scene) -> None:
        check_damping_over(self.system, self.damping, scene.region, scene.full_start)

    def __repr__(self) -> str:
        listed = ", ".join(
            f"{w} = {e}" for w, e in list(self.quasi_velocities.items())[len(self.frame.along) :]
        )
        return f"FrictionSystem({self.system.name or 'unnamed'}: friction against {listed})"


@overload
def with_friction(
    system: LagrangianSystem,
    constraints: Constraints,
    *,
    epsilon: sp.Symbol,
    damping: Damping | None = None,
    frame: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> FrictionSystem: ...


@overload
def with_friction(
    system: LagrangianSystem,
    constraints: Constraints | Sequence[sp.Expr | Sequence[sp.Expr]],
    *,
    epsilon: sp.Symbol,
    law: str | sp.Expr,
    mu: Strength,
    normal: Strength,
    frame: Mapping[sp.Symbol, sp.Expr] | None = None,
) -> DryFrictionSystem: ...


def with_friction(
    system: LagrangianSystem,
    constraints: Constraints | Sequence[sp.Expr | Sequence[sp.Expr]],
    *,
    epsilon: sp.Symbol,
    damping: Damping | None = None,
    frame: Mapping[sp.Symbol, sp.Expr] | None = None,
    law: str | sp.Expr = VISCOUS,
    mu: Strength | None = None,
    normal: Strength | None = None,
) -> FrictionSystem | DryFrictionSystem:
    """The system with friction in place of constraints: viscous, or dry in contacts that bear mu N at most.

    Viscous friction has the Rayleigh function |A qdot + c|^2_B/(2 epsilon).
    `damping` is B, symmetric and positive definite: a number, or a matrix of parameters and positions; the
    identity by default, with which the friction depends on how the constraints are scaled; or "kinetic" for
    B = (A M^-1 A^T)^-1, with which it does not (footnote 3 of Eldering 2015).
    `constraints` and `frame` are as for `constrain`; slip velocities are called w, or w1,
    w2, ..., unless named there.

    With `law="coulomb"` each constraint is the slip of a contact with the force -mu N phi(w/epsilon), `mu` and
    `normal` N for all or a list with one for each, of parameters and positions; phi(r) = r/sqrt(1 + r^2). A pair of
    constraints in the list is the slip of one contact in a plane, whose cone is elliptic where its mu is a pair. `law`
    may also name another phi, "linear", "cubic", "tanh", "algebraic", "atan" or "stribeck", or be an expression in one
    symbol. This gives a `DryFrictionSystem`, whose `no_slip(start=..., span=...)` answers whether the constraints hold.

    Raises `DeclarationError` for what `constrain` refuses, for a Lagrangian that
    is not quadratic in the velocities, for a B that is no damping, and for contacts that are none.

    >>> x, xdot, m, eps = sp.symbols("x xdot m epsilon")
    >>> y, ydot = sp.symbols("y ydot")
    >>> cart = LagrangianSystem(m*(xdot**2 + ydot**2)/2 - x*y, [x, y], [xdot, ydot], parameters={m: 2})
    >>> with_friction(cart, [ydot], epsilon=eps).field.rates
    (xdot, w, -y/m, -x/m - w/(epsilon*m))
    >>> with_friction(cart, [ydot], epsilon=eps, law="tanh", mu=0.5, normal=20).field.rates[3]
    -x/m - 10*tanh(w/epsilon)/m
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
    is_viscous = isinstance(law, str) and law == VISCOUS
    wrong = {"mu": mu, "normal": normal} if is_viscous else {"damping": damping}
    for name, value in wrong.items():
        if value is not None:
            raise DeclarationError(
                f"{name} belongs to {'dry' if is_viscous else 'viscous'} friction.",
                'Dry friction takes law="coulomb", mu and normal; viscous friction takes damping.',
                got=f"{name} = {shown(value)}",
            )
    if not is_viscous:
        phi = switch_law("algebraic" if isinstance(law, str) and law == COULOMB else law)
        flat, rows = grouped(constraints)
        forms = read_constraints(system, flat, may_stop=True)
        contacts = read_contacts(system, rows, mu, normal)
        frames = moving_frames(system, forms, frame, reserved=(epsilon,))
        strengths = [e for contact in contacts for e in (*contact.mu, contact.normal)]
        equations = hamel(system, frames, tuple(strengths))
        return DryFrictionSystem(
            ConstrainedSystem(system, forms.expressions, equations.frame, equations), epsilon, phi, contacts
        )
    forms = read_constraints(system, cast("Constraints", constraints))
    is_kinetic = isinstance(damping, str) and damping == KINETIC
    matrix = None if is_kinetic else read_damping(system, damping, forms.count)
    frames = moving_frames(system, forms, frame, reserved=(epsilon,))
    if matrix is None:
        found = hamel(system, frames)
        frames, matrix = [[found.frame]], kinetic_damping(found)
    equations = hamel(system, frames, tuple(entries(matrix)))
    limit = ConstrainedSystem(system, forms.expressions, equations.frame, equations)
    return FrictionSystem(limit, epsilon, matrix)
