"""Systems that several tests share, small and each for a reason."""

from __future__ import annotations

import sympy as sp

from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem, VectorField

epsilon = sp.Symbol("epsilon")
x, y, z = sp.symbols("x y z")


def sleigh() -> SlowFastSystem:
    """The Chaplygin sleigh in its slow momentum p, parameters symbolic."""
    v, p, w, m, inertia, a = sp.symbols("v p w m I a")
    J = inertia + m * a**2
    omega = (p - m * a * w) / J
    return SlowFastSystem(
        slow={v: omega * w + a * omega**2, p: -m * a * v * omega},
        fast={w: -epsilon * v * omega - J * w / (inertia * m)},
        epsilon=epsilon,
        parameters={m: 1, inertia: 1, a: 0.2},
        name="sleigh",
    )


def michaelis_menten() -> SlowFastSystem:
    """One slow, one fast, an explicit rational branch, two parameters."""
    s, c, kappa, lam = sp.symbols("s c kappa lambda")
    return SlowFastSystem(
        slow={s: -s + (s + kappa - lam) * c},
        fast={c: s - (s + kappa) * c},
        epsilon=epsilon,
        parameters={kappa: 1, lam: 0.5},
    )


def van_der_pol() -> SlowFastSystem:
    """An implicit cubic branch with two folds."""
    a = sp.Symbol("a")
    return SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 0.5})


def koper() -> SlowFastSystem:
    """Two slow variables over an implicit cubic."""
    k, lam = sp.symbols("k lambda")
    return SlowFastSystem(
        slow={y: x - 2 * y + z, z: y - z},
        fast={x: k * y - x**3 + 3 * x - lam},
        epsilon=epsilon,
        parameters={k: -10, lam: -7},
    )


def saddle() -> SlowFastSystem:
    """One attracting and one repelling fast direction; the manifold is known exactly."""
    return SlowFastSystem(slow={x: -x}, fast={y: y + x**2, z: -z + y * x}, epsilon=epsilon)


def coupled() -> SlowFastSystem:
    """Two fast variables, both implicit: no equation gives either."""
    return SlowFastSystem(
        slow={x: -x + y * z}, fast={y: x - y - z**3 - y**3, z: x * y - z - z**3}, epsilon=epsilon
    )


def transcendental() -> SlowFastSystem:
    """Functions of the slow, the fast and both variables on an implicit branch."""
    return SlowFastSystem(
        slow={x: sp.sin(x) + y},
        fast={y: sp.exp(-x) - sp.tanh(y) - y + epsilon * sp.cos(x * y)},
        epsilon=epsilon,
    )


def oscillator() -> VectorField:
    """The harmonic oscillator with its energy E."""
    return VectorField({x: y, y: -x}, epsilon=None, observables={sp.Symbol("E"): (x**2 + y**2) / 2})


def enzyme() -> SlowFastSystem:
    """A reaction of Michaelis and Menten with one parameter and an observable E."""
    s, c, a = sp.symbols("s c a")
    return SlowFastSystem(
        slow={s: -s + (s + a) * c},
        fast={c: s - (s + 1) * c},
        epsilon=epsilon,
        parameters={a: "0.5"},
        observables={sp.Symbol("E"): s + epsilon * a * c},
    )


def saddle_scene(**words: str) -> Scene:
    """A scene with one attracting and one repelling fast direction, and what is to be written about it."""
    s = sp.Symbol("s")
    system = SlowFastSystem(slow={s: -s}, fast={x: x + s**2, y: -y + x * s}, epsilon=epsilon)
    return Scene(
        system,
        region={"s": (0.1, 2)},
        start={"s": 1, "x": -1, "y": -1},
        span=(0, 0.5),
        epsilon=0.02,
        epsilons=(0.04, 0.02),
        tolerance=1e-4,
        **words,
    )
