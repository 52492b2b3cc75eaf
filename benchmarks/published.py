"""The slow manifolds of a published comparison, solved: estimated error, difference from a second route, seconds.

Patsatzis, Fabiani, Russo and Siettos (2023, arXiv 2309.07946) learn slow manifolds of three systems with neural
networks: Michaelis-Menten in Segel and Slemrod's form, target-mediated drug disposition, and a Sel'kov model in three
variables, over these boxes and for epsilon from 1e-4 to 0.1. Their largest error on Michaelis-Menten is 5e-4.
"""

from __future__ import annotations

import time

import numpy as np
import sympy as sp

import gsp

epsilon = sp.Symbol("epsilon")
EPSILONS = (1e-4, 1e-3, 1e-2, 1e-1)
POINTS = 200


def michaelis_menten() -> tuple[gsp.SlowFastSystem, dict[str, tuple[float, float]]]:
    """Enzyme kinetics with kappa = 10, sigma = 100."""
    s, c = sp.symbols("s c")
    kappa, sigma = 10, 100
    system = gsp.SlowFastSystem(
        slow={s: (-(kappa + 1) * s + (kappa - sigma + s) * c) / sigma},
        fast={c: s - c * (kappa + s) / (kappa + 1)},
        epsilon=epsilon,
    )
    return system, {"s": (1e-6, 1)}


def drug_disposition() -> tuple[gsp.SlowFastSystem, dict[str, tuple[float, float]]]:
    """Ligand L, complex C, receptor R; the receptor is fast."""
    L, C, R = sp.symbols("L C R")
    rates = ("0.001", "0.0015", "0.11", "0.0089", "0.003", "100")
    off, eliminated, made, degraded, internalised, dose = map(sp.Rational, rates)
    k1, k2 = off / degraded, degraded / internalised
    k3, k4 = made / (internalised * dose), eliminated / internalised
    system = gsp.SlowFastSystem(
        slow={L: k3 * (-R * L + k1 * C) - k4 * L, C: k2 * (R * L - k1 * C) - C},
        fast={R: -R * L + k1 * C + 1 - epsilon * k2 * R},
        epsilon=epsilon,
    )
    return system, {"L": (0.2, 2), "C": (1.3, 2.9)}


def selkov() -> tuple[gsp.SlowFastSystem, dict[str, tuple[float, float]]]:
    """Glycolysis with three variables; the gap is Y and closes at Y = 0, where the upstream orbits come from."""
    X, Y, Z = sp.symbols("X Y Z")
    a, b = sp.Rational(1, 10), sp.Rational(6, 10)
    system = gsp.SlowFastSystem(
        slow={Y: a * Z + Y**2 * Z - Y + epsilon * X, Z: -a * Z - Y**2 * Z + b},
        fast={X: Y**2 * Z - X * Y},
        epsilon=epsilon,
    )
    return system, {"Y": (0.1, 1.4), "Z": (0.3, 2.3)}


def main() -> None:
    """Print the table."""
    print("system              epsilon   estimated   second route   seconds   status")
    generator = np.random.default_rng(0)
    for build in (michaelis_menten, drug_disposition, selkov):
        system, region = build()
        branch = gsp.solve_critical(system).branches[0]
        box = np.array([region[x.name] for x in system.x])
        points = box[:, 0] + generator.random((POINTS, len(box))) * (box[:, 1] - box[:, 0])
        for value in EPSILONS:
            begun = time.perf_counter()
            solved = gsp.solve_manifold(branch, region=region, epsilon=value, tolerance=1e-11)
            seconds = time.perf_counter() - begun
            pointwise = gsp.zero_derivative(branch, points, epsilon=value)
            apart = np.nanmax(np.abs(solved.evaluate(points) - pointwise.y), initial=0.0)
            print(
                f"{build.__name__:18}  {value:7.0e}   {solved.error_estimate:9.1e}   {apart:12.1e}   "
                f"{seconds:7.2f}   {solved.status.name}"
            )


if __name__ == "__main__":
    main()
