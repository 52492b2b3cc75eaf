"""Poles of a branch and of the field along it: where a denominator vanishes and what stands above it does not."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.factorisation import factor_list, quotient
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.losses.kinds import Contact
from gsp.hyperbolicity.losses.roots import gauss_newton

# Distances from a pole at which the field is compared, relative to 1 + |z|, and how much it has grown: a simple pole by
# their quotient.
NEAR_POLE = (1e-4, 1e-7)
GROWN = 100.0


def poles(sampler: Sampler, z: np.ndarray, starts: int) -> Iterator[tuple[np.ndarray, Contact, bool]]:
    """Zeros of the denominators of the branch's graph and of the field next to the samples `z` (m, n).

    Each denominator is followed from the `starts` samples nearest to its zeros. Yields the place, what goes to infinity
    there, and whether the place's fast coordinates mean nothing.
    """
    system, nx = sampler.system, len(sampler.system.x)
    graph = list((sampler.branch.graph or {}).values())
    rates = [*sampler.f, *sampler.g]
    for crossing, divisor in [
        *((Contact.BRANCH_POLE, d) for d in denominators(graph, system.x)),
        *((Contact.FIELD_POLE, d) for d in denominators(rates, system.states)),
    ]:
        free = not divisor.has(*system.y)
        value = sampler.compiled([divisor])
        slope = sampler.compiled([derivative(divisor, s) for s in system.states])

        def evaluate(u: np.ndarray, value=value, slope=slope, free=free) -> tuple[np.ndarray, np.ndarray]:
            if free:
                point = np.concatenate([u, np.zeros(len(system.y))])
                return value(point, sampler.p), slope(point, sampler.p)[None, :nx]
            branch = sampler.branch
            equations = np.concatenate([branch.residual(u[None, :])[0], value(u, sampler.p)])
            return equations, np.vstack([branch.full_jacobian(u[None, :])[0], slope(u, sampler.p)])

        sizes = np.abs(value(z, sampler.p)[:, 0])
        for sample in z[np.argsort(sizes)[:starts]]:
            found = gauss_newton(evaluate, sample[:nx] if free else sample)
            if found is None:
                continue
            # The fast coordinates at a pole of the branch mean nothing; those of the sample show the side.
            place = np.concatenate([found, sample[nx:]]) if free else found
            if crossing is Contact.BRANCH_POLE or _is_pole(sampler, place):
                yield place, crossing, free


def _is_pole(sampler: Sampler, z: np.ndarray) -> bool:
    """Whether the field grows without bound towards `z`, rather than having a removable zero of a denominator."""
    directions = np.random.default_rng(0).standard_normal((2 * len(z) + 2, len(z))) * (1.0 + np.abs(z))
    far, near = (np.abs(sampler.rates(z + distance * directions)).max(axis=1) for distance in NEAR_POLE)
    return bool(not np.isfinite(near).all() or (near > GROWN * far).any())


def denominators(expressions: list[sp.Expr], variables: tuple[sp.Symbol, ...]) -> list[sp.Expr]:
    """The factors of the denominators of `expressions` that depend on `variables` and may vanish.

    Functions stay as they are written: exp(-u) taken for 1/exp(u) overflows where the field is finite.
    """
    found: list[sp.Expr] = []
    for expression in expressions:
        masks: dict[sp.Expr, sp.Symbol] = {}
        masked = _masked(expression, masks)
        meaning = {mask: function for function, mask in masks.items()}
        for divisor in _divisors(masked):
            base = divisor.xreplace(meaning)
            if base.has(*variables) and base not in found and not isinstance(base, (sp.exp, sp.cosh)):
                found.append(base)
    return found


def _divisors(expression: sp.Expr) -> list[sp.Expr]:
    """Factors of the denominator; of a quotient over the budget, whatever stands below a line in it."""
    fraction = quotient(expression)
    if fraction is not None:
        return [base for base, _ in factor_list(fraction.expression(fraction.denominator))[1]]
    below = {power.base for power in expression.atoms(sp.Pow) if power.exp.could_extract_minus_sign()}
    return sorted(below, key=sp.default_sort_key)


def _masked(expression: sp.Expr, masks: dict[sp.Expr, sp.Symbol]) -> sp.Expr:
    """`expression` with its functions and roots as symbols, which `masks` collects."""
    if expression.is_Function or (expression.is_Pow and not expression.exp.is_Integer):
        return masks.setdefault(expression, sp.Dummy())
    if not expression.args:
        return expression
    return expression.func(*(_masked(part, masks) for part in expression.args))
