"""Nineteen systems with dry friction: sticking, slipping and the times between, against SciPy on Lagrange's equations.

SciPy runs M qdd = R + A^T f in the raw velocities with f = -mu N tanh(w/epsilon) at a tiny epsilon, without frames,
elimination or events. What it slips by while it sticks is of that size.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from sympy import Rational as R

from gsp.mechanics import DryFrictionSystem, LagrangianSystem, with_friction
from gsp.readers.toml import read_model
from gsp.sliding.law import W, switch_law
from gsp.sliding.piecewise_run import Side
from tests.cases import sampled

x, y, phi, psi, X, xdot, ydot, phidot, psidot, Xdot, t, epsilon = sp.symbols(
    "x y phi psi X xdot ydot phidot psidot Xdot t epsilon"
)
STRIBECK = W / sp.sqrt(1 + W**2) + W / (1 + W**2)
SIDEWAYS = -xdot * sp.sin(phi) + ydot * sp.cos(phi)
FORWARD = xdot * sp.cos(phi) + ydot * sp.sin(phi)


@dataclass(frozen=True)
class Case:
    """A Lagrangian, the slips of its contacts, what each bears, and a start in raw states; time where it counts."""

    lagrangian: sp.Expr
    coordinates: tuple[sp.Symbol, ...]
    velocities: tuple[sp.Symbol, ...]
    slips: tuple[sp.Expr, ...]
    bears: tuple[sp.Expr | float, ...]
    start: dict[str, float]
    span: float
    forces: dict[sp.Symbol, sp.Expr] = field(default_factory=dict)
    law: str | sp.Expr = "tanh"
    small: float = 1e-9

    def system(self) -> DryFrictionSystem:
        system = LagrangianSystem(
            self.lagrangian,
            self.coordinates,
            self.velocities,
            forces=self.forces or None,
            time=t if "t" in self.start else None,
        )
        return with_friction(
            system, list(self.slips), epsilon=epsilon, law=self.law, mu=1, normal=list(self.bears)
        )

    def model(self) -> str:
        """The same as a model file."""

        def table(values: dict) -> str:
            return "{" + ", ".join(f'{key} = "{text(value)}"' for key, value in values.items()) + "}"

        def text(value: object) -> str:
            return str(value).replace("**", "^")

        rows = [
            f'lagrangian = "{text(self.lagrangian)}"',
            f"coordinates = {[q.name for q in self.coordinates]}",
            f"velocities = {[v.name for v in self.velocities]}",
            f"constraints = {[text(slip) for slip in self.slips]}",
            f'law = "{text(self.law)}"',
            "mu = 1",
            f"normal = {[text(bears) for bears in self.bears]}",
            *([f"forces = {table(self.forces)}"] if self.forces else []),
            *(['time = "t"'] if "t" in self.start else []),
        ]
        start = [f"{key} = {value}" for key, value in self.start.items()]
        slip = "w" if len(self.slips) == 1 else "w1"
        scene = ["[region]", f"{slip} = [-9, 9]", "[scene]", f"span = [0, {self.span}]", "epsilon = 0.01"]
        return "\n".join(["[mechanics]", *rows, "[start]", *start, *scene])

    def stiff(self):
        """SciPy's run of Lagrange's equations, and the slips as a function of its states."""
        q, v = self.coordinates, self.velocities
        momenta = [sp.diff(self.lagrangian, u) for u in v]
        M = sp.Matrix([[sp.diff(p, u) for u in v] for p in momenta])
        right = sp.Matrix(
            [
                sp.diff(self.lagrangian, s)
                - sum(sp.diff(p, r) * u for r, u in zip(q, v))
                - sp.diff(p, t)
                + self.forces.get(s, 0)
                for s, p in zip(q, momenta)
            ]
        )
        A = sp.Matrix([[sp.diff(w, u) for u in v] for w in self.slips])
        law = switch_law(self.law)
        friction = sp.Matrix([-N * law.at(w / sp.Float(self.small)) for w, N in zip(self.slips, self.bears)])
        states = sp.Matrix([*q, *v])
        field = sp.Matrix([*v, *M.LUsolve(right + A.T * friction)])
        read = sp.lambdify([t, [*states]], field.T, "numpy", cse=True)
        slopes = sp.lambdify([t, [*states]], field.jacobian(states), "numpy", cse=True)
        slips = sp.lambdify([t, [*states]], list(self.slips), "numpy")
        begin = [self.start[s.name] for s in (*q, *v)]
        run = solve_ivp(
            lambda t, z: read(t, z).ravel(), (0, self.span), begin, "Radau", rtol=1e-10, atol=1e-13,
            jac=slopes, dense_output=True,
        )  # fmt: skip
        assert run.success
        return run, lambda t: np.array(slips(t, run.sol(t)))


def plane(inertia: float, *more: sp.Expr) -> sp.Expr:
    return sp.Add((xdot**2 + ydot**2) / 2, sp.Rational(inertia) * phidot**2 / 2, *more)


def corner(ahead: str, above: str) -> tuple[sp.Expr, sp.Expr]:
    """How fast a point of a body in the upright plane moves along the ground, and the push of the ground upon it.

    The push is SOFT deep for every e-fold, so that the normal force is one of positions.
    """
    a, b = sp.Rational(ahead), sp.Rational(above)
    height = y + a * sp.sin(phi) + b * sp.cos(phi)
    return xdot - (a * sp.sin(phi) + b * sp.cos(phi)) * phidot, 5 * sp.exp(-height / SOFT)


def upright(inertia: str, *pushes: sp.Expr) -> sp.Expr:
    return plane(float(inertia), -10 * y, *(-SOFT * push for push in pushes))


SOFT = sp.Rational(1, 20)
TOE, HEEL, TIP = corner("3/10", "-1/5"), corner("-3/10", "-1/5"), corner("-1/2", "0")
BODY = (x, y, phi), (xdot, ydot, phidot)
TURNED = (SIDEWAYS + phidot) * sp.Rational(4, 5) - FORWARD * sp.Rational(3, 5)
CASES = {
    "a sleigh whose centre of mass is ahead of its blade": Case(
        plane(1.04, phidot * SIDEWAYS / 5), *BODY, (SIDEWAYS,), (0.9,),
        {"x": 0, "y": 0, "phi": 0.2, "xdot": -1.4, "ydot": 0.3, "phidot": 0.3}, 4.0,
    ),
    "a knife edge on an incline": Case(
        plane(1, -x / 2), *BODY, (SIDEWAYS,), (0.4,),
        {"x": 0, "y": 0, "phi": 0.1, "xdot": 0.4, "ydot": 0.5, "phidot": 0.6}, 5.0,
    ),
    "two blades that stand across": Case(
        plane(0.5), *BODY, (SIDEWAYS + phidot / 2, FORWARD), (0.3, 0.2),
        {"x": 0, "y": 0, "phi": 0.1, "xdot": 0.5, "ydot": 0.4, "phidot": 0.8}, 4.0,
    ),
    "a car with its wheels turned": Case(
        plane(0.5), *BODY, (SIDEWAYS, TURNED), (0.5, 0.4),
        {"x": 0, "y": 0, "phi": 0, "xdot": 0.8, "ydot": 0.5, "phidot": 0.1}, 4.0,
    ),
    "a disc that comes to roll": Case(
        plane(0.25, psidot**2 / 4), (x, y, phi, psi), (xdot, ydot, phidot, psidot),
        (FORWARD - psidot, SIDEWAYS), (0.4, 0.3),
        {"x": 0, "y": 0, "phi": 0.1, "psi": 0, "xdot": 1, "ydot": 0.3, "phidot": 0.4, "psidot": 0}, 4.0,
    ),
    "a block on a belt, pulled by another": Case(
        xdot**2 / 2 + Xdot**2 / 4 - x**2 / 2 - (X - x) ** 2, (x, X), (xdot, Xdot), (xdot - sp.Rational(1, 5),), (0.4,),
        {"x": 0, "X": 0.3, "xdot": 0.2, "Xdot": 0}, 6.0,
    ),
    "two blocks, one upon the other": Case(
        xdot**2 + Xdot**2 / 2 + phidot**2 / 2 - phi * x / 2 - phi**2 / 2, (x, X, phi), (xdot, Xdot, phidot),
        (xdot, Xdot - xdot), (0.2, 0.15), {"x": 0, "X": 0, "phi": 1, "xdot": 0.8, "Xdot": 0, "phidot": 0}, 5.0,
    ),
    "a wheel that locks": Case(
        xdot**2 / 2 + phidot**2 / 8 + ydot**2 / 2, (x, y, phi), (xdot, ydot, phidot),
        (xdot - phidot, phidot), (0.3, 0.5), {"x": 0, "y": 0, "phi": 0, "xdot": 1, "ydot": 0, "phidot": 1}, 5.0,
    ),
    "a pendulum in a joint that sticks, with a swing": Case(
        phidot**2 / 2 + sp.cos(phi) + psidot**2 / 2 + phidot * psidot * sp.cos(phi - psi) / 4 - psi**2, (phi, psi),
        (phidot, psidot), (phidot,), (0.6,), {"phi": 1, "psi": 0.5, "phidot": 0, "psidot": 0}, 5.0,
    ),
    "a foot that tips over its toe": Case(
        upright("0.05", TOE[1], HEEL[1]), *BODY, (TOE[0],), (TOE[1] / 2,),
        {"x": 0, "y": 0.2, "phi": 0, "xdot": 1.5, "ydot": 0, "phidot": 0}, 1.2,
    ),
    "a rod that falls upon its rough end": Case(
        upright("0.1", TIP[1]), *BODY, (TIP[0],), (TIP[1] * 3 / 10,),
        {"x": 0, "y": 0.45, "phi": 1.2, "xdot": 0.5, "ydot": 0, "phidot": 0}, 0.8,
    ),
    "a spool that its thread pulls up a slope": Case(
        xdot**2 / 2 + phidot**2 / 5 + Xdot**2 / 2 - 2 * X**2, (x, phi, X), (xdot, phidot, Xdot), (xdot - phidot,),
        (0.35,), {"x": 0, "phi": 0, "X": 0.6, "xdot": 0.3, "phidot": 0, "Xdot": 0}, 5.0,
        forces={x: X - sp.Rational(1, 4), phi: -X / 3},
    ),
    "a rope over a drum with a brake": Case(
        xdot**2 / 2 + phidot**2 / 4 + Xdot**2 / 2 - X - (X - x) ** 2 + x, (x, phi, X), (xdot, phidot, Xdot),
        (xdot - phidot, phidot), (0.5, 0.3),
        {"x": 0, "phi": 0, "X": 0.4, "xdot": 0.6, "phidot": 0, "Xdot": 0}, 5.0,
    ),
    "a drill that sticks at its bit": Case(
        5 * phidot**2 / 2 + psidot**2 / 4 - (phi - psi) ** 2 / 8, (phi, psi), (phidot, psidot), (psidot,), (0.5,),
        {"phi": 2.4, "psi": 0, "phidot": 0.3, "psidot": 0}, 14.0,
        forces={phi: sp.Rational(1, 2)}, law=STRIBECK, small=1e-11,
    ),
    "a top on an axle that is rough": Case(
        (phidot**2 + xdot**2 * sp.sin(phi) ** 2) / 2 + (psidot + xdot * sp.cos(phi)) ** 2 / 4 - sp.cos(phi),
        (phi, x, psi), (phidot, xdot, psidot), (xdot,), (1.5,),
        {"phi": 1, "x": 0, "psi": 0, "phidot": 0, "xdot": 0.6, "psidot": 1}, 1.8,
    ),
    "a parcel on a conveyor that shakes": Case(
        (xdot + sp.cos(2 * t)) ** 2 / 2 + ydot**2 / 2 - (y - x - sp.sin(2 * t) / 2) ** 2, (x, y), (xdot, ydot), (xdot,),
        (0.9,), {"x": 0, "y": 0.2, "xdot": -0.5, "ydot": 0, "t": 0}, 6.0,
    ),
    "a ring thrown with backspin": Case(
        xdot**2 / 2 + phidot**2 / 2, (x, phi), (xdot, phidot), (xdot - phidot,), (0.5,),
        {"x": 0, "phi": 0, "xdot": 1, "phidot": -0.5}, 3.0,
    ),
    "a door with a closer": Case(
        5 * phidot**2 / 2 - 3 * (phi + R(1, 2)) ** 2 / 2, (phi,), (phidot,), (phidot,), (1.2,),
        {"phi": 1.2, "phidot": 0}, 8.0, forces={phi: -2 * phidot},
    ),
    "a finger that drags a pad over a table": Case(
        xdot**2 / 2 + Xdot**2 / 4 - 10 * (X - sp.sin(t) / 2) ** 2, (x, X), (xdot, Xdot), (Xdot - xdot, xdot),
        (1.6, 0.3), {"x": 0, "X": 0, "xdot": 0, "Xdot": 0, "t": 0}, 4.0,
    ),
}  # fmt: skip


QUICK = (
    "a block on a belt, pulled by another",
    "a door with a closer",
    "a wheel that locks",
    "a ring thrown with backspin",
)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_sticking_slipping_and_the_times_of_change_are_scipys(name: str) -> None:
    case = CASES[name]
    run = case.system().run(start=case.start, span=(0, case.span))
    assert run.t[-1] == case.span, run.message
    stiff, slips = case.stiff()
    for position in case.coordinates:
        place = list(case.coordinates).index(position)
        assert run[position.name][-1] == pytest.approx(stiff.y[place, -1], abs=1e-6)
    changes = 0
    for before, after in zip(run.pieces, run.pieces[1:]):
        time = float(after.run.t[0])
        for contact in range(len(case.slips)):
            if before.sides[contact] is not Side.SLIDING and after.sides[contact] is Side.SLIDING:
                early, late = (abs(slips(time + shift)[contact]) for shift in (-2e-6, 2e-6))
                assert late < 20 * case.small < early
                changes += 1
    assert changes > 0
    for piece in run.pieces:
        middle = float(piece.run.t[0] + piece.run.t[-1]) / 2
        for contact, side in enumerate(piece.sides):
            slip = slips(middle)[contact]
            if side is Side.SLIDING:
                assert abs(slip) < 50 * case.small
            else:
                assert np.sign(slip) == (1 if side is Side.PLUS else -1)


@pytest.mark.parametrize("name", sampled(CASES, always=QUICK))
def test_a_model_file_makes_the_same_field(name: str) -> None:
    """Its start gives raw velocities; the scene's rates are those that Python makes, at a place drawn at random."""
    case = CASES[name]
    scene, ours = read_model(case.model(), name="system"), case.system().field
    states = {s.name: value for s, value in zip(ours.states, np.random.default_rng(1).uniform(0.2, 0.9, 20))}
    place = {
        **{sp.Symbol(key): sp.Float(value, 30) for key, value in states.items()},
        epsilon: sp.Rational(1, 7),
    }
    theirs = dict(zip(scene.system.states, scene.system.rates))
    assert [s.name for s in theirs] == list(states)
    for state, rate in zip(ours.states, ours.rates):
        assert float(theirs[state].subs(place)) == pytest.approx(float(rate.subs(place)), rel=1e-12, abs=1e-12)
    assert scene.contacts is not None
