"""Dry friction: each contact bears mu N at most, and slips beyond; while it bears, the constraints hold but for creep.

A contact with the slip w has the force -mu N phi(w/epsilon), phi a law of a switch, and one in the plane
-(mu_i^2/mu_1) N (w_i/r) phi(r/epsilon), r^2 = sum (mu_j/mu_1)^2 w_j^2, from the cone sum (f_i/mu_i)^2 <= N^2. With
w = epsilon v it is slow-fast, and on M0 the friction is the multiplier lambda of (9) of Eldering (2015): no-slip is its
limit where lambda lies within the cone, and w = epsilon phi^-1(|lambda|/(mu N)) is what contacts creep by.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import sympy as sp

from gsp.errors import DeclarationError
from gsp.mechanics.constraints import ConstrainedSystem
from gsp.mechanics.frame_starts import constrained_start, frame_values, with_slips
from gsp.mechanics.lagrangian import LagrangianSystem
from gsp.mechanics.slipping import SlippingSystem
from gsp.scenes.scene import Scene
from gsp.sliding.crossing_field import CrossingField
from gsp.sliding.law import SwitchLaw
from gsp.sliding.no_slip import Contacts, NoSlip
from gsp.sliding.piecewise_run import PiecewiseRun, run_piecewise
from gsp.splitting.splitting import Splitting, split
from gsp.systems.arguments import shown
from gsp.systems.flow import Point, values_by_name
from gsp.systems.system import VectorField


@dataclass(frozen=True)
class DryContact:
    """The `rows` of the constraints that are the slip of one contact, `mu` in each direction, and the normal force."""

    rows: tuple[int, ...]
    mu: tuple[sp.Expr, ...]
    normal: sp.Expr

    def forces(self, slips: Sequence[sp.Expr], law: SwitchLaw, epsilon: sp.Symbol) -> list[sp.Expr]:
        """The friction for slip velocities, one for each row."""
        if len(self.rows) == 1:
            return [-self.mu[0] * self.normal * law.at(slips[0] / epsilon)]
        square = sp.Dummy("square", positive=True)
        # phi(r)/r as a function of r^2: what is left of r has a kink at rest.
        shape = sp.simplify(law.at(sp.sqrt(square)) / sp.sqrt(square))
        for form, what in ((shape, "is 0/0"), (sp.diff(shape, square), "has a kink")):
            if form.subs(square, 0).has(sp.nan, sp.zoo, sp.oo, -sp.oo) or form.has(sp.Max, sp.Min):
                raise DeclarationError(
                    f"a contact in the plane divides the law by the slip, and ({law.expression})/{law.symbol} {what} "
                    "at rest.",
                    'Take law="coulomb", or a law that is written as the slip times a smooth function of its square.',
                )
        ratios = [(mu / self.mu[0]) ** 2 for mu in self.mu]
        size = sp.Add(*(ratio * w**2 for ratio, w in zip(ratios, slips))) / epsilon**2
        at = shape.xreplace({square: size})
        return [-self.mu[0] * self.normal * ratio * w / epsilon * at for ratio, w in zip(ratios, slips)]

    def load(self, multipliers: Sequence[sp.Expr]) -> sp.Expr:
        """The square of the share that the contact's multipliers take of what it bears: 1 on the cone."""
        return sp.Add(*(multipliers[row] ** 2 / mu**2 for row, mu in zip(self.rows, self.mu))) / self.normal**2

    def reach(self, multipliers: Sequence[sp.Expr]) -> sp.Expr:
        """The square of the slip over epsilon that bears them by a law with the slope 1: in other directions than the
        first the law acts on mu_i/mu_1 times the slip, and friction is mu_i/mu_1 times as large."""
        slips = (multipliers[row] * self.mu[0] / mu**2 for row, mu in zip(self.rows, self.mu))
        return sp.Add(*(slip**2 for slip in slips)) / self.normal**2


@dataclass(frozen=True, eq=False, repr=False)
class DryFrictionSystem(SlippingSystem):
    """A mechanical system with dry friction in its `contacts`, smoothed by `law` over slips of the size epsilon.

    `limit` is the constrained system that it is while every contact sticks, in the same `frame`.
    """

    limit: ConstrainedSystem
    epsilon: sp.Symbol
    law: SwitchLaw
    contacts: tuple[DryContact, ...]

    @cached_property
    def splitting(self) -> Splitting:
        """Slow and fast variables of `field`: v = w/epsilon is fast."""
        return split(self.field)

    @property
    def has_constant_fibres(self) -> bool:
        """True: `gsp.split` makes fast variables of the slips."""
        return True

    @cached_property
    def forces(self) -> tuple[sp.Expr, ...]:
        """The friction (k,) along each constraint, in the slips."""
        found: list[Any] = [sp.S.Zero] * len(self.frame.across)
        for contact in self.contacts:
            slips = [self.frame.across[row] for row in contact.rows]
            for row, force in zip(contact.rows, contact.forces(slips, self.law, self.epsilon)):
                found[row] = force
        return tuple(found)

    @cached_property
    def creep(self) -> tuple[sp.Expr, ...]:
        """The slips (k,) while all contacts stick, -epsilon lambda/(mu N phi'(0)) for light loads, in (q, u)."""
        multipliers = self.limit.reduced_multipliers
        found: list[Any] = [sp.S.Zero] * len(multipliers)
        for contact in self.contacts:
            for row, mu in zip(contact.rows, contact.mu):
                stiffness = mu**2 / contact.mu[0] * contact.normal * sp.nsimplify(self.law.slope)
                found[row] = -self.epsilon * multipliers[row] / stiffness
        return tuple(found)

    @cached_property
    def loads(self) -> tuple[sp.Expr, ...]:
        """For each contact the square of the share of its cone that no-slip takes, in (q, u): it holds below 1, or
        below the square of the maximum of a law that overshoots.
        """
        multipliers = self.limit.reduced_multipliers
        return tuple(contact.load(multipliers) for contact in self.contacts)

    def no_slip(self, *, start: Point, span: tuple[float, float]) -> NoSlip:
        """Does no-slip hold along the run of the constrained system from `start`, a place and velocities without slip?

        The run ends where a contact's multiplier leaves what it bears. Raises `DeclarationError` for a start that is
        not complete or that slips.
        """
        times = {s.name: values_by_name(start, what="start").get(s.name, 0.0) for s in self.system.clock}
        return self.bearing.no_slip(start={**times, **constrained_start(self.limit, start)}, span=span)

    @cached_property
    def bearing(self) -> Contacts:
        """What the contacts bear along runs of `limit`, which scenes carry."""
        slips = (tuple(str(self.frame.across[row]) for row in contact.rows) for contact in self.contacts)
        grips = tuple(sp.Mul(contact.normal, *contact.mu) for contact in self.contacts)
        multipliers = self.limit.reduced_multipliers
        reaches = tuple(contact.reach(multipliers) for contact in self.contacts)
        field = self.limit.full_field
        clock = {s: sp.S.One for s in self.system.clock if s not in field.states}
        if any(e.has(*clock) for e in (*self.loads, *grips)):
            # Time may act across the constraints alone.
            field = VectorField({**field.equations, **clock}, parameters=field.parameters, name=field.name)
        along = tuple(map(str, self.frame.along))
        return Contacts(field, self.loads, reaches, grips, tuple(slips), along, self.law)

    @cached_property
    def sharp(self) -> CrossingField:
        """The field as epsilon goes to 0: phi is 1 or -1, or what holds a contact. Reconstructed positions are states.

        Raises `DeclarationError` for a contact in a plane, whose friction has more directions than two.
        """
        if any(len(contact.rows) > 1 for contact in self.contacts):
            raise DeclarationError(
                "a contact in a plane has no sharp switch: its friction points in any direction.",
                "Run `field` at a small epsilon.",
            )
        symbols = self.frame.quasi_velocities
        matter, driven, _ = self._split
        drift = {**matter, **driven, **dict(zip(symbols, self._drift))}
        jumps = []
        for contact in self.contacts:
            (row,), bears = contact.rows, contact.mu[0] * contact.normal
            jumps.append({s: -entries[row] * bears for s, entries in zip(symbols, self._mobility)})
        return CrossingField(drift, jumps, list(self.frame.across), self.system.values, self.system.name)

    def run(self, *, start: Point, span: tuple[float, float]) -> PiecewiseRun:
        """The run from `start` in the limit of sharp friction: slipping, sticking, and the times between, by events.

        `start` gives raw velocities, or quasi-velocities, and positions; slips are 0 unless given. Raises what `sharp`
        raises.
        """
        given = with_slips(self.system, self.frame, start)
        states, places = frame_values(self.system, self.frame, self.field, self.reconstruction, given)
        whole = {**dict.fromkeys((s.name for s in self.sharp.states), 0.0), **states, **places}
        found = run_piecewise(self.sharp, start=whole, span=span, phi=self.law)
        pieces = (replace(piece, loss=piece.loss and piece.loss.of_contact) for piece in found.pieces)
        return replace(found, pieces=tuple(pieces))

    def _rates(self) -> tuple[dict[sp.Symbol, sp.Expr], list[sp.Expr]]:
        rates = {
            s: drift + sp.Add(*(entry * force for entry, force in zip(row, self.forces)))
            for s, drift, row in zip(self.frame.quasi_velocities, self._drift, self._mobility)
        }
        return rates, []

    @cached_property
    def _mobility(self) -> list[tuple[sp.Expr, ...]]:
        """eta' = drift + mobility f for forces f along the constraints."""
        ring, n = self._equations.algebra.ring, range(len(self.frame.quasi_velocities))
        units = ([ring.one if i == j else ring.zero for i in n] for j in n[len(self.frame.along) :])
        return list(zip(*(self._equations.written(unit) for unit in units)))

    def _check_over(self, scene: Scene) -> None:
        """What a contact bears is checked where it is run."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, DryFrictionSystem) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @property
    def _key(self) -> tuple:
        return self.limit, self.epsilon, self.law.expression, self.contacts

    def __repr__(self) -> str:
        listed = ", ".join(str(self.frame.across[row]) for contact in self.contacts for row in contact.rows)
        return f"DryFrictionSystem({self.system.name or 'unnamed'}: dry friction against {listed})"


def grouped(constraints: Any) -> tuple[Any, list[tuple[int, ...]]]:
    """Constraints in one list, and the rows of each contact: an entry that is a pair is one contact in the plane."""
    if not isinstance(constraints, (list, tuple)):
        return constraints, [
            (row,) for row in range(len(constraints) if hasattr(constraints, "__len__") else 0)
        ]
    flat, rows = [], []
    for entry in constraints:
        slips = list(entry) if isinstance(entry, (list, tuple)) else [entry]
        rows.append(tuple(range(len(flat), len(flat) + len(slips))))
        flat += slips
    return flat, rows


def read_contacts(
    system: LagrangianSystem, rows: list[tuple[int, ...]], mu: Any, normal: Any
) -> tuple[DryContact, ...]:
    """The contacts: `mu` and `normal` for all, or a list with one entry for each, in which mu may be a pair.

    Raises `DeclarationError` for another number of them, and for ones that are not positive, depend on velocities or
    have unknown symbols.
    """
    for name, value in (("mu", mu), ("normal", normal)):
        if value is None:
            raise DeclarationError(
                f"dry friction takes {name}.", "Give mu, and the normal force of each contact."
            )
    shares = _each(mu, len(rows), "mu")
    normals = _each(normal, len(rows), "normal")
    contacts = []
    for own, share, force in zip(rows, shares, normals):
        pair = list(share) if isinstance(share, (list, tuple)) else [share] * len(own)
        if len(pair) != len(own):
            raise DeclarationError(
                f"mu has {len(pair)} values for a contact with {len(own)} directions.", got=shown(mu)
            )
        contacts.append(
            DryContact(own, tuple(_strength(system, e, "mu") for e in pair), _strength(system, force, "normal"))
        )
    return tuple(contacts)


def _each(value: Any, count: int, name: str) -> list[Any]:
    if not isinstance(value, (list, tuple)):
        return [value] * count
    if len(value) != count:
        raise DeclarationError(f"{name} has {len(value)} entries for {count} contacts.", got=shown(value))
    return list(value)


def _strength(system: LagrangianSystem, value: Any, name: str) -> sp.Expr:
    """A positive expression in positions and parameters."""
    found = system.checked(value, name)
    moving = [s for s in (*system.velocities, *system.clock) if found.has(s)]
    if moving:
        raise DeclarationError(
            f"{name} depends on {moving[0]}: {found}.", "It is one of parameters and positions."
        )
    fixed = found.xreplace(dict(system.values))
    if fixed.is_number and not fixed.is_positive:
        raise DeclarationError(
            f"{name} is not positive: {found} = {fixed}.", "A contact that bears nothing is none."
        )
    return found
