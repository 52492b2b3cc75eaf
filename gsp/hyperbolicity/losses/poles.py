"""Poles of a branch and of the field along it: where a denominator vanishes and what stands above it does not."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.algebra.factorisation import factor_list, quotient
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.losses.kinds import Contact
from gsp.hyperbolicity.losses.roots import STEPS, STEPS_OF_LARGE, gauss_newton
from gsp.systems.region import Interval

# With many fast variables: how many samples further the tangent may put a zero. Before a simple zero it is one, before
# one at which the sheet folds two.
REACH = 2.0
# Samples from which zeros are then sought, of all denominators together.
MOST_STARTS = 48


def poles(
    sampler: Sampler,
    z: np.ndarray,
    starts: int,
    box: Mapping[str, Interval],
    notes: list[str],
    *,
    units: np.ndarray,
) -> Iterator[tuple[np.ndarray, Contact, bool]]:
    """Zeros of the denominators of the branch's graph and of the field next to the samples `z` (m, n) over `box`.

    Each denominator is followed from the `starts` samples nearest to its zeros. With many fast variables it is followed
    from samples next to which the sheet's tangent leads to a zero, from `MOST_STARTS` for all denominators together;
    `notes` says when there were more. Lengths are in `units` (n,). Yields the place, what goes to infinity there, and
    whether the place's fast coordinates mean nothing.
    """
    system, nx = sampler.system, len(sampler.system.x)
    values = dict(system.parameters)
    graph = list((sampler.branch.graph or {}).values())
    sought = [
        (crossing, divisor)
        for crossing, expressions, variables in (
            (Contact.BRANCH_POLE, graph, system.x),
            (Contact.FIELD_POLE, [*sampler.f, *sampler.g], system.states),
        )
        for divisor in denominators(expressions, variables)
        if not is_above_zero(divisor.xreplace(values))
    ]
    if not sought:
        return

    def heights(x: np.ndarray) -> np.ndarray:
        return sampler.over(x, None)[0]

    followed = _next_to_zeros if sampler.is_large else _nearest
    divisors = [divisor for _, divisor in sought]
    for (crossing, divisor), samples in zip(sought, followed(sampler, divisors, z, starts, box, notes)):
        free = not divisor.has(*system.y)
        if not len(samples):
            continue
        evaluate = _equations(sampler, divisor, samples, free=free)
        for sample in samples:
            found = gauss_newton(
                evaluate,
                sample[:nx] if free else sample,
                steps=STEPS_OF_LARGE if sampler.is_large else STEPS,
                sparse=sampler.is_large and not free,
                scales=units[:nx] if free else units,
            )
            if found is None:
                continue
            # The fast coordinates at a pole of the branch mean nothing; those of the sample show the side.
            place = np.concatenate([found, sample[nx:]]) if free else found
            # The same of the branch's heights, which may go to infinity as slowly as 1/|x|^(1/3), by a factor
            # of 10.
            grows = (
                _is_pole(heights, place[:nx], units[:nx], 5.0)
                if crossing is Contact.BRANCH_POLE
                else _is_pole(sampler.rates, place, units, 100.0)
            )
            if grows:
                yield place, crossing, free


def _equations(sampler: Sampler, divisor: sp.Expr, samples: np.ndarray, *, free: bool):
    """`divisor` = 0 on the branch and its Jacobian, as functions of (x, y), or of x when it is `free` of y.

    Its unit is its largest slope at `samples` (m, n): without fractions y - 0.42... has coefficients of sixteen digits.
    """
    system, branch = sampler.system, sampler.branch
    value = sampler.compiled([divisor])
    slope = sampler.compiled([derivative(divisor, s) for s in system.states])
    steep = np.abs(slope(samples, sampler.p))
    unit = float(steep[np.isfinite(steep)].max(initial=0.0)) or 1.0

    def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        if free:
            point = np.concatenate([u, np.zeros(len(system.y))])
            return value(point, sampler.p) / unit, slope(point, sampler.p)[None, : len(system.x)] / unit
        equations = np.concatenate([branch.residual(u[None, :])[0], value(u, sampler.p) / unit])
        return equations, np.vstack([branch.full_jacobian(u[None, :])[0], slope(u, sampler.p) / unit])

    return evaluate


def _nearest(sampler: Sampler, divisors: list[sp.Expr], z: np.ndarray, starts: int, *_) -> Iterator[np.ndarray]:
    """The `starts` samples at which each divisor is least."""
    for divisor in divisors:
        sizes = np.abs(sampler.compiled([divisor])(z, sampler.p)[:, 0])
        yield z[np.argsort(sizes)[:starts]]


def _next_to_zeros(
    sampler: Sampler,
    divisors: list[sp.Expr],
    z: np.ndarray,
    starts: int,
    box: Mapping[str, Interval],
    notes: list[str],
) -> list[np.ndarray]:
    """The samples from which each divisor falls to zero before the next ones, to first order along the sheet."""
    system = sampler.system
    places = [(i, k, derivative(d, s)) for i, d in enumerate(divisors) for k, s in enumerate(system.states)]
    places = [place for place in places if place[2] != 0]
    slopes = np.zeros((len(z), len(divisors), z.shape[1]))
    rows, columns = (np.array([place[i] for place in places], dtype=int) for i in (0, 1))
    slopes[:, rows, columns] = sampler.compiled([place[2] for place in places])(z, sampler.p)
    widths = np.array([high - low for low, high in (box[s.name] for s in system.x)])
    spacing = widths / max(1.0, len(sampler.grid(box)) ** (1.0 / len(widths)) - 1.0)
    change = np.abs(slopes @ sampler.tangents(z)) @ spacing
    with np.errstate(divide="ignore", invalid="ignore"):
        # What is not a number tells nothing against a zero.
        distance = np.nan_to_num(np.abs(sampler.compiled(divisors)(z, sampler.p)) / change, nan=0.0)
    near = distance <= REACH
    chosen = near & (np.argsort(np.argsort(distance, axis=0), axis=0) < starts)
    if chosen.sum() > MOST_STARTS:
        limit = np.sort(distance[chosen])[MOST_STARTS - 1]
        left = int((near.any(axis=0) & ~(chosen & (distance <= limit)).any(axis=0)).sum())
        chosen &= distance <= limit
        notes.append(
            f"poles were sought from {MOST_STARTS} samples, and {int(near.sum())} lie next to where a denominator may "
            f"vanish: {left} of {len(divisors)} denominators were not followed. Look at a smaller region."
        )
    return [z[row] for row in chosen.T]


def _is_pole(
    values: Callable[[np.ndarray], np.ndarray], z: np.ndarray, units: np.ndarray, grown: float
) -> bool:
    """Whether `values` (m, k) at (m, n) grow without bound towards `z`, where a denominator vanishes.

    Where they are real nowhere around `z` they do not: next to a zero of its argument's denominator atanh has no value.
    """
    directions = np.random.default_rng(0).standard_normal((2 * len(z) + 2, len(z))) * (units + np.abs(z))
    # Distances from a pole at which the field is compared, relative to units + |z|, and how much it has grown: a
    # simple pole by their quotient.
    far, near = (np.abs(values(z + distance * directions)).max(axis=1) for distance in (1e-4, 1e-7))
    lost = np.isnan(near) & np.isfinite(far)
    return bool((np.isinf(near) | lost | (near > grown * far)).any())


def denominators(expressions: list[sp.Expr], variables: tuple[sp.Symbol, ...]) -> list[sp.Expr]:
    """The factors of all denominators in `expressions` that depend on `variables` and may vanish.

    Functions stay as they are written: exp(-u) taken for 1/exp(u) overflows where the field is finite. A tangent has
    its cosine below.
    """
    found: list[sp.Expr] = []
    left = list(expressions)
    seen = set(left)
    for expression in left:
        masks: dict[sp.Expr, sp.Symbol] = {}
        masked = _masked(expression, masks)
        meaning = {mask: function for function, mask in masks.items()}
        for function in masks:
            inside = set(function.args)
            if isinstance(function, sp.tan):
                inside.add(1 / sp.cos(*function.args))
            left += sorted(inside - seen, key=sp.default_sort_key)
            seen |= inside
        for divisor in _divisors(masked):
            base = divisor.xreplace(meaning)
            if base.has(*variables) and base not in found and not isinstance(base, (sp.exp, sp.cosh)):
                found.append(base)
    return found


def is_above_zero(expression: sp.Expr) -> bool:
    """Whether `expression` is positive wherever it is real, by the signs of its parts alone: 1 + y**2 is."""
    if isinstance(expression, sp.Add):
        return all(map(_is_not_below_zero, expression.args)) and any(map(is_above_zero, expression.args))
    if isinstance(expression, sp.Mul):
        return all(map(is_above_zero, expression.args))
    if isinstance(expression, sp.Pow):
        return is_above_zero(expression.base)
    if isinstance(expression, (sp.exp, sp.cosh)):
        return True
    return expression.is_number and expression.is_Number and bool(expression > 0)


def _is_not_below_zero(expression: sp.Expr) -> bool:
    """Whether `expression` is positive or 0 wherever it is real, by the signs of its parts alone."""
    if isinstance(expression, (sp.Add, sp.Mul)):
        return all(map(_is_not_below_zero, expression.args))
    if isinstance(expression, sp.Pow) and expression.exp.is_Rational:
        # An even power, or a root, which is real where it is not negative.
        return bool(expression.exp.p % 2 == 0 or expression.exp.q != 1) or _is_not_below_zero(expression.base)
    return isinstance(expression, sp.Abs) or expression is sp.S.Zero or is_above_zero(expression)


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
