"""Declaration of a mechanical system by its Lagrangian; Lagrange's equations (2), (5) of Eldering (2015)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from types import MappingProxyType

import numpy as np
import sympy as sp
from sympy.core.function import AppliedUndef

from gsp.algebra.differentiation import derivative
from gsp.algebra.ring_elements import RingElement
from gsp.errors import DeclarationError, HyperbolicityError
from gsp.mechanics.algebra import Algebra, Matrix, entries, generic_points, numbers
from gsp.systems.arguments import shown
from gsp.systems.flow import Values
from gsp.systems.system import VectorField

# Relative size of the smallest singular value below which a matrix of numbers counts as singular.
SINGULAR = 1e-11


@dataclass(frozen=True)
class HeldMotion:
    """Accelerations (n,), `mobility` (n, n), which maps further forces to what they add, and `tension` (h,), the
    multipliers of the holonomic constraints with a minus sign, in elements of an algebra."""

    accelerations: list[RingElement]
    mobility: Matrix
    tension: list[RingElement]


@dataclass(frozen=True, eq=False, repr=False)
class LagrangianSystem:
    """A system with Lagrangian L(q, qdot, t) and forces F(q, qdot, t): d/dt L_qdot - L_q = F, equation (5).

    `coordinates` and `velocities` are plain symbols, in the same order; `forces` maps coordinates to the force
    along them, friction included, for those that have one; `parameters` gives every other symbol its value,
    `time` names time when L or F depends on it. Angles enter through sin and cos.
    `holonomic` are functions of the coordinates that are zero all the time, by d'Alembert's principle (Remark 2.4):
    the length of a rod, or that of the quaternion of a `rotation`.

    Raises `DeclarationError` for symbols without a role, for a mass matrix L_qdot,qdot that is degenerate along the
    holonomic constraints, and for such constraints that depend on one another.

    >>> x, xdot, m, k = sp.symbols("x xdot m k")
    >>> spring = LagrangianSystem(m*xdot**2/2 - k*x**2/2, [x], [xdot], parameters={m: 2, k: 3})
    >>> spring.euler_lagrange().rates
    (xdot, -k*x/m)
    """

    lagrangian: sp.Expr
    coordinates: Sequence[sp.Symbol]
    velocities: Sequence[sp.Symbol]
    _: KW_ONLY
    forces: Values | None = None
    parameters: Values | None = None
    time: sp.Symbol | None = None
    holonomic: Sequence[sp.Expr] = ()
    name: str = ""
    _right: tuple[sp.Expr, ...] = field(init=False)
    _mass: sp.ImmutableMatrix = field(init=False)

    def __post_init__(self) -> None:
        q, v = _symbols(self.coordinates, "coordinates"), _symbols(self.velocities, "velocities")
        if len(q) != len(v) or not q:
            raise DeclarationError(
                "every coordinate has one velocity.",
                got=f"coordinates {_listed(q)} and velocities {_listed(v)}",
            )
        twice = {s.name for s in (*q, *v) if (*q, *v).count(s) > 1}
        if twice:
            raise DeclarationError(
                f"{', '.join(sorted(twice))} is named twice among coordinates and velocities."
            )
        if self.time is not None and (not isinstance(self.time, sp.Symbol) or self.time in (*q, *v)):
            raise DeclarationError("time is a symbol of its own.", got=f"{self.time!r}", value=self.time)
        object.__setattr__(self, "coordinates", q)
        object.__setattr__(self, "velocities", v)
        parameters = {} if self.parameters is None else self.parameters
        lagrangian, values = self._checked(self.lagrangian, "the Lagrangian", parameters)
        object.__setattr__(self, "parameters", MappingProxyType(dict(values)))
        object.__setattr__(self, "lagrangian", lagrangian)
        forces = self._given_forces()
        object.__setattr__(self, "forces", MappingProxyType(forces))
        object.__setattr__(self, "holonomic", self._given_holonomic())
        gradient = [sp.diff(lagrangian, u) for u in v]
        mass = sp.ImmutableMatrix([[sp.expand(sp.diff(p, u)) for u in v] for p in gradient])
        right = []
        for x, p in zip(q, gradient):
            drift = sp.Add(*[sp.diff(p, y) * u for y, u in zip(q, v)])
            if self.time is not None:
                drift += sp.diff(p, self.time)
            right.append(forces[x] + derivative(lagrangian, x) - drift)
        object.__setattr__(self, "_mass", mass)
        object.__setattr__(self, "_right", tuple(right))
        self._refuse_degenerate()

    # -- what the Lagrangian says ------------------------------------------------------------------

    @cached_property
    def mass_matrix(self) -> sp.ImmutableMatrix:
        """L_qdot,qdot (n, n)."""
        return self._mass.applyfunc(self.algebra.clean)

    @property
    def is_quadratic(self) -> bool:
        """Whether L is quadratic in the velocities."""
        return not self._mass.has(*self.velocities)

    def momenta(self) -> Values:
        """L_qdot by coordinate."""
        return MappingProxyType(
            {
                x: self.algebra.clean(sp.diff(self.lagrangian, v))
                for x, v in zip(self.coordinates, self.velocities)
            }
        )

    def energy(self) -> sp.Expr:
        """H = L_qdot . qdot - L, equation (4)."""
        return self.algebra.clean(self.raw_energy)

    def equations(self, accelerations: Sequence[sp.Symbol]) -> Values:
        """d/dt L_qdot - L_q - F by coordinate, with symbols for the accelerations, as (11) is written."""
        given = _symbols(accelerations, "accelerations")
        if len(given) != len(self.velocities):
            raise DeclarationError("every velocity has one acceleration.", got=_listed(given))
        left = self.mass_matrix * sp.Matrix(list(given))
        return MappingProxyType(
            {x: a - self.algebra.clean(r) for x, a, r in zip(self.coordinates, entries(left), self._right)}
        )

    def euler_lagrange(self) -> VectorField:
        """Lagrange's equations (5) in first order: states (q, qdot), then time with rate 1 when it enters."""
        rates = dict(zip(self.coordinates, self.velocities))
        rates |= {v: self.algebra.write(a) for v, a in zip(self.velocities, self.accelerations)}
        if self.time is not None:
            rates[self.time] = sp.Integer(1)
        return VectorField(rates, epsilon=None, parameters=self.values, name=self.name)

    def energy_rate(self) -> sp.Expr:
        """dH/dt along Lagrange's equations, exactly; 0 without forces and explicit time (Theorem 1.3).

        Of the forces that hold the holonomic constraints nothing is counted, as they do no work on these.
        """
        algebra, ring = self.algebra, self.algebra.ring
        energy = algebra.read(self.raw_energy)
        # Derivation 0 is d/dt at constant velocity, derivation 1 + i that by velocity i.
        rate = ring.derive(energy, 0)
        for i, acceleration in enumerate(self.accelerations):
            rate = rate + ring.derive(energy, 1 + i) * acceleration
        power = [self._motion.tension[j] * form for j, form in enumerate(self._held_velocities(algebra))]
        return algebra.write(sum(power, rate))

    # -- for the stages that follow ----------------------------------------------------------------

    @property
    def values(self) -> Values:
        """The parameters' values, exact."""
        assert self.parameters is not None
        return self.parameters

    @property
    def clock(self) -> tuple[sp.Symbol, ...]:
        """(time,), or () for an autonomous system."""
        return () if self.time is None else (self.time,)

    @property
    def right_hand_sides(self) -> tuple[sp.Expr, ...]:
        """R with M qddot = R, one expression for each coordinate."""
        return self._right

    @property
    def raw_mass_matrix(self) -> sp.ImmutableMatrix:
        """The mass matrix as differentiation gives it."""
        return self._mass

    @cached_property
    def algebra(self) -> Algebra:
        """The algebra of functions of (q, qdot, t) that the Lagrangian and the forces are made of."""
        return self.raw_algebra(())

    def raw_algebra(self, further: Sequence[sp.Expr]) -> Algebra:
        """The algebra of (q, qdot, t) with what `further` expressions need.

        Derivation 0 is d/dt at constant velocity, derivation 1 + i the one by velocity i.
        """
        expressions = [self.lagrangian, *entries(self._mass), *self._right, *self.holonomic, *further]
        algebra = Algebra(
            (*self.coordinates, *self.velocities, *self.clock),
            tuple(self.values),
            expressions,
            derivations=1 + len(self.velocities),
        )
        ring = algebra.ring
        for i, (x, v) in enumerate(zip(self.coordinates, self.velocities)):
            ring.set_derivative(x, 0, ring.generator(v))
            ring.set_derivative(v, 1 + i, ring.one)
        for t in self.clock:
            ring.set_derivative(t, 0, ring.one)
        return algebra

    @cached_property
    def accelerations(self) -> list:
        """qddot as elements of `algebra`."""
        return self._motion.accelerations

    @cached_property
    def holonomic_forms(self) -> sp.ImmutableMatrix:
        """The gradients (h, n) of the holonomic constraints: what is zero of the velocities."""
        n = len(self.coordinates)
        return sp.ImmutableMatrix(
            len(self.holonomic), n, [derivative(F, q) for F in self.holonomic for q in self.coordinates]
        )

    def motion(self, algebra: Algebra) -> HeldMotion:
        """The accelerations on the holonomic constraints, what a force adds to them, and what holds them.

        [[M, A^T], [A, 0]] (qddot, tension) = (R, -A' qdot), A the holonomic forms.
        """
        n, A = len(self.coordinates), algebra.matrix(self.holonomic_forms)
        rows = [[*row, *(a[i] for a in A)] for i, row in enumerate(algebra.matrix(self._mass))]
        zeros = [algebra.ring.zero] * len(A)
        inverse = algebra.inverse([*rows, *([*a, *zeros] for a in A)])
        carried = algebra.derive(self._held_velocities(algebra), 0)
        found = algebra.apply(inverse, [*(algebra.read(r) for r in self._right), *(-c for c in carried)])
        return HeldMotion(found[:n], [row[:n] for row in inverse[:n]], found[n:])

    def _held_velocities(self, algebra: Algebra) -> list:
        velocities = [algebra.ring.generator(v) for v in self.velocities]
        return algebra.apply(algebra.matrix(self.holonomic_forms), velocities)

    def check_holonomic(self, values: Mapping[str, float]) -> None:
        """Raise `DeclarationError` where positions, or velocities, by name violate a holonomic constraint.

        They may do so by what half of a double's digits leave of its terms.
        """
        v = self.velocities if all(u.name in values for u in self.velocities) else ()
        forms = self.holonomic_forms
        conditions = [(F, self.coordinates, forms.row(i)) for i, F in enumerate(self.holonomic)]
        if v:
            conditions += [((row * sp.Matrix(v))[0], v, row) for row in map(forms.row, range(forms.rows))]
        symbols = (*self.coordinates, *v)
        point = np.array([[values[s.name] for s in symbols]])
        for condition, among, slopes in conditions:
            value, *rates = numbers([condition, *slopes], symbols, point, self.values).ravel()
            size = sum(abs(rate * values[s.name]) for rate, s in zip(rates, among))
            if not abs(value) <= math.sqrt(np.finfo(float).eps) * size:
                raise DeclarationError(
                    f"the start violates the holonomic constraint {condition} = 0: it is {value:.6g} there.",
                    "Give positions and velocities that obey it.",
                    got=", ".join(f"{s} = {values[s.name]:.6g}" for s in among),
                )

    def checked(self, expression: sp.Expr, what: str) -> sp.Expr:
        """`expression` with exact numbers; raises `DeclarationError` for symbols that have no role here."""
        return self._checked(expression, what, self.values)[0]

    @cached_property
    def raw_energy(self) -> sp.Expr:
        """H as differentiation gives it."""
        momenta = [sp.diff(self.lagrangian, v) for v in self.velocities]
        return sp.Add(*[p * v for p, v in zip(momenta, self.velocities)]) - self.lagrangian

    @cached_property
    def _motion(self) -> HeldMotion:
        return self.motion(self.algebra)

    def _checked(self, expression: sp.Expr, what: str, parameters: Values) -> tuple[sp.Expr, Values]:
        functions = expression.atoms(AppliedUndef) if isinstance(expression, sp.Expr) else ()
        if functions:
            raise DeclarationError(
                f"{what} is {expression}, which contains {sorted(map(str, functions))[0]}.",
                "Write positions and velocities as plain symbols, not as functions of time.",
            )
        # The field's own checks: undeclared symbols, unknown functions, floats made exact.
        states = dict.fromkeys((*self.coordinates, *self.velocities, *self.clock), expression)
        try:
            probe = VectorField(states, epsilon=None, parameters=parameters)
        except DeclarationError as error:
            raise DeclarationError(f"{what} is {shown(expression)}. {error}") from None
        return probe.rates[0], probe.parameters

    def _given_forces(self) -> dict[sp.Symbol, sp.Expr]:
        forces = {} if self.forces is None else self.forces
        if not isinstance(forces, Mapping):
            raise DeclarationError("forces maps coordinates to expressions.", got=type(forces).__name__)
        for symbol in forces:
            if symbol not in self.coordinates:
                raise DeclarationError(
                    f"forces has an entry for {symbol}, which is no coordinate.",
                    f"The coordinates are {_listed(self.coordinates)}.",
                    value=symbol,
                    known=[x.name for x in self.coordinates],
                )
        return {
            x: self.checked(forces[x], f"the force along {x}") if x in forces else sp.Integer(0)
            for x in self.coordinates
        }

    def _given_holonomic(self) -> tuple[sp.Expr, ...]:
        given = self.holonomic
        if isinstance(given, (str, sp.Basic)) or not isinstance(given, Iterable):
            raise DeclarationError("holonomic is a sequence of expressions.", got=f"{given!r}", value=given)
        found = tuple(self.checked(F, f"holonomic constraint {i + 1}") for i, F in enumerate(given))
        for F in found:
            if F.has(*self.velocities, *self.clock) or not F.has(*self.coordinates):
                raise DeclarationError(
                    f"the holonomic constraint {F} = 0 is not one on the coordinates alone.",
                    "Constraints on velocities go to `constrain` or `with_friction`.",
                )
        return found

    def _refuse_degenerate(self) -> None:
        fact = f"the mass matrix L_qdot,qdot is degenerate: {self._mass.tolist()} for L = {self.lagrangian}"
        remedy = "Give every velocity a kinetic energy, or leave out the coordinate that has none."
        if self.holonomic:
            listed = ", ".join(f"{F} = 0" for F in self.holonomic)
            fact = f"with the holonomic constraints {listed} {fact}"
            remedy += " Constraints must not depend on one another either."
        try:
            self._motion  # noqa: B018 - inverting is the exact test
        except HyperbolicityError:
            raise DeclarationError(f"{fact}.", remedy) from None
        symbols = (*self.coordinates, *self.velocities, *self.clock)
        points = generic_points(3, len(symbols))
        A = self.holonomic_forms
        bordered = self._mass.row_join(A.T).col_join(A.row_join(sp.zeros(A.rows, A.rows)))
        n = bordered.rows
        matrices = numbers(entries(bordered), symbols, points, self.values).reshape(-1, n, n)
        if all(is_singular(matrix) for matrix in matrices):
            listed = ", ".join(f"{s} = {value}" for s, value in self.values.items())
            raise DeclarationError(f"{fact}, at the parameters' values {listed}.", remedy)

    def __repr__(self) -> str:
        label = f"{self.name}: " if self.name else ""
        return f"LagrangianSystem({label}L = {self.lagrangian} in {_listed(self.coordinates)})"

    def __str__(self) -> str:
        lines = [self.name or "Lagrangian system", f"  L = {self.lagrangian}"]
        assert self.forces is not None
        lines += [f"  force along {x}: {force}" for x, force in self.forces.items() if force != 0]
        lines += [f"  {F} = 0" for F in self.holonomic]
        if self.values:
            lines.append("  with " + ", ".join(f"{s} = {value}" for s, value in self.values.items()))
        return "\n".join(lines)

    def _repr_latex_(self) -> str:
        return rf"$\displaystyle L = {sp.latex(self.lagrangian)}$"

    def _key(self) -> tuple:
        assert self.forces is not None
        return (
            self.lagrangian,
            tuple(self.coordinates),
            tuple(self.velocities),
            tuple(self.forces.items()),
            tuple(self.values.items()),
            self.time,
            self.holonomic,
            self.name,
        )

    def __eq__(self, other: object) -> bool:
        return isinstance(other, LagrangianSystem) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


def is_singular(matrix: np.ndarray) -> bool:
    """Whether a matrix of numbers is singular to rounding, in whatever units, or not finite."""
    if not np.isfinite(matrix).all():
        return True
    sizes = np.linalg.svd(balanced(matrix), compute_uv=False)
    return bool(sizes[-1] <= SINGULAR * sizes[0])


def balanced(matrix: np.ndarray) -> np.ndarray:
    """A matrix with rows and columns in units in which their largest entries are about 1; zeros stay."""
    for axis in (1, 0, 1, 0):
        largest = np.abs(matrix).max(axis=axis, keepdims=True)
        matrix = matrix / np.sqrt(np.where(largest > 0.0, largest, 1.0))
    return matrix


def _symbols(symbols: Sequence[sp.Symbol], what: str) -> tuple[sp.Symbol, ...]:
    if isinstance(symbols, (str, sp.Basic)) or not isinstance(symbols, Iterable):
        raise DeclarationError(f"{what} is a sequence of SymPy symbols.", got=f"{symbols!r}", value=symbols)
    for symbol in symbols:
        if not isinstance(symbol, sp.Symbol):
            raise DeclarationError(
                f"{what} are plain SymPy symbols.",
                "Use sp.symbols, not functions of time.",
                got=f"{symbol!r}",
                value=symbol,
            )
    return tuple(symbols)


def _listed(symbols: Sequence[sp.Symbol]) -> str:
    return ", ".join(s.name for s in symbols)
