"""Published fields with rates for names."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import sympy as sp

from gsp.scales.small_parameter import SmallParameters
from gsp.scales.special_values import small_parameters
from gsp.systems.system import VectorField

s, c, e0, k1, km1, k2, km2 = sp.symbols("S C e0 k1 km1 k2 km2")
B, S, H, C = sp.symbols("B S H C")
alpha, beta, gamma, delta, eta, rho = sp.symbols("alpha beta gamma delta eta rho")


def field(equations: dict, parameters, **values) -> VectorField:
    """The field with every parameter 1, or at its value in `values`."""
    return VectorField(equations, epsilon=None, parameters={p: values.get(p.name, 1) for p in parameters})


def michaelis_menten() -> VectorField:
    """Substrate and complex, irreversible."""
    made = k1 * e0 * s - (k1 * s + km1) * c
    return field({s: -made, c: made - k2 * c}, (e0, k1, km1, k2))


def rosenzweig_macarthur() -> VectorField:
    """Prey, searching and handling predators (Kruff, Lax, Liebscher and Walcher 2019)."""
    return field(
        {
            B: rho * B * (1 - B) - alpha * B * H,
            S: -eta * S + gamma * B * H,
            H: beta * S - delta * H + eta * S - gamma * B * H,
        },
        (alpha, beta, gamma, delta, eta, rho),
    )


@cache
def small_of(make: Callable[[], VectorField]) -> SmallParameters:
    """What may be called small in one of these fields."""
    return small_parameters(make())


def mutualism() -> VectorField:
    """Hosts, symbionts and pairs (Apelt and Liebscher 2025), K_i = 1/k_i."""
    names = sp.symbols("beta2 beta3 delta1 delta2 delta3 mu1 mu2 eta k1 k2 k3")
    b2, b3, d1, d2, d3, m1, m2, meet, q1, q2, q3 = names
    return field(
        {
            H: -d1 * H - meet * S * H + m1 * C * (1 - q1 * H),
            S: b2 * S * (1 - q2 * S) - d2 * S - meet * S * H + m2 * C * (1 - q2 * S),
            C: b3 * C * (1 - q3 * C) - d3 * C + meet * S * H,
        },
        names,
    )


def in_other_variables(given: VectorField, matrix: sp.Matrix) -> VectorField:
    """The field of u where its states are `matrix` u."""
    new = sp.symbols(f"u:{len(given.states)}")
    place = dict(zip(given.states, matrix * sp.Matrix(new)))
    rates = matrix.inv() * sp.Matrix([rate.xreplace(place) for rate in given.rates])
    return VectorField(dict(zip(new, rates.expand())), epsilon=None, parameters=given.parameters)
