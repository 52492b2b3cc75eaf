"""Losses of a switch: where a sheet ends because its fast variable v = s/epsilon goes to the end of the law.

Beyond the end g is Y(x), the rate at which the field of that side crosses the surface s = 0. The sheet ends where it
vanishes, a fold of that field, next to which

    epsilon u' = -beta t - c u^n + ...,    u the distance of v from the end,                                       (1)

so that orbits leave epsilon^(n/(2n - 1)) later (`gsp.sliding.sliding_exit` has the coefficient). Along a tail
1/v^m it is (1) with n = -m, and along one that falls faster than any power there is none.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import sympy as sp

from gsp.algebra.switching_functions import switches
from gsp.critical.loss_kind import LossKind
from gsp.critical.normal_forms import null_vectors
from gsp.critical.saturation import BOTH, FAR, far_off, saturates
from gsp.hyperbolicity.losses import consequences
from gsp.hyperbolicity.losses.diagnosis import Diagnosis
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.roots import gauss_newton

# What the search calls the ends of sheets whose variable saturates.
ENDS = (LossKind.DEGENERATE, LossKind.NON_SMOOTH, LossKind.DOMAIN_END, LossKind.BRANCH_POLE)
# A sheet that is followed to v = 10 ends within this share of the region of where its law does.
NEAR = 1e-2
# How far from a whole number the contact order may be read off.
WHOLE = 0.1
# Rates that are zero beside the other terms.
ZERO = 1e-9


class Saturation(NamedTuple):
    """The fast variable of a column of (x, y), and the side on which it goes to the end of its law."""

    column: int
    side: int


def named_by_switch(
    diagnosis: Diagnosis, losses: Sequence[Loss], ends: Sequence[tuple[np.ndarray, np.ndarray]]
) -> tuple[Loss, ...]:
    """The losses with those of a switch under its own names; `ends` are samples next to places without a point."""
    nx, states = diagnosis.nx, diagnosis.sampler.system.states
    # Not at one sample alone, which may lie where both fields are tangent to the surface.
    some = diagnosis.samples[[0, len(diagnosis.samples) // 2, -1]]
    columns = [i for i in range(nx, len(states)) if any(saturates(diagnosis.problem, u, i) for u in some)]
    if not columns:
        return tuple(losses)
    kept: list[Loss] = []
    folds: list[Loss] = []
    for loss in losses:
        z = np.array([loss.point[s.name] for s in states])
        found = _fold(diagnosis, columns, z, NEAR) if loss.kind in ENDS else None
        if loss.kind in (LossKind.FOLD, LossKind.CUSP, LossKind.RANK_CHANGE):
            # A law that is flat or bends no more at its end, and fields that are tangent to the surface at one place:
            # places this near are one.
            found = _fold(diagnosis, columns, z, 1e-6)
        if found is not None:
            folds.append(found)
        elif loss.kind is LossKind.FOLD:
            right, _ = null_vectors(diagnosis.problem.jacobian(z)[:, nx:])
            onset = nx + int(np.abs(right).argmax()) in columns
            kept.append(replace(loss, kind=LossKind.SLIP_ONSET) if onset else loss)
        else:
            kept.append(loss)
    if not losses:
        seen = [_fold(diagnosis, columns, z, np.inf) for z, _ in ends]
        folds = [fold for fold in seen if fold is not None]
    folds += _two_folds(diagnosis, columns, folds)
    return (*kept, *_distinct(diagnosis, folds))


def _two_folds(diagnosis: Diagnosis, columns: list[int], folds: list[Loss]) -> list[Loss]:
    """Where curves of folds of both sides meet in the region, over two slow variables or more."""
    if diagnosis.nx == 1:
        return []
    found = []
    for column in columns:
        for fold in folds:
            z = np.array([fold.point[s.name] for s in diagnosis.sampler.system.states])
            z[column] = 0.0
            two = _tangent(diagnosis, [Saturation(column, side) for side in BOTH], z)
            if two is not None and _is_inside(diagnosis, two):
                loss = _named(diagnosis, Saturation(column, 1), two)
                found += [loss] if loss.kind is LossKind.TWO_FOLD else []
    return found


def _fold(diagnosis: Diagnosis, columns: list[int], z: np.ndarray, near: float) -> Loss | None:
    """The fold of one of the two fields within a share `near` of the region of `z`, or None."""
    for column in columns:
        # That of the side on which v is, first.
        for side in sorted(BOTH, key=lambda each: -each * z[column]):
            place = _tangent(diagnosis, [Saturation(column, side)], z)
            # Where a loss was met, the fold next to it may lie on the edge of the region, to either side.
            if place is None or not (
                _is_near(diagnosis, place, z, near) if near < np.inf else _is_inside(diagnosis, place)
            ):
                continue
            return _named(diagnosis, Saturation(column, side), place)
    return None


def _is_near(diagnosis: Diagnosis, place: np.ndarray, z: np.ndarray, near: float) -> bool:
    return bool((np.abs(place - z)[: diagnosis.nx] <= near * diagnosis.widths).all())


def _is_inside(diagnosis: Diagnosis, place: np.ndarray) -> bool:
    slow = {s.name: diagnosis.box[s.name] for s in diagnosis.sampler.system.x}
    return bool(diagnosis.sampler.inside(place[None, :], slow)[0])


def _tangent(diagnosis: Diagnosis, sides: Sequence[Saturation], start: np.ndarray) -> np.ndarray | None:
    """The point next to `start` at which the fields of all `sides` are tangent to the surface; v stays as it is."""
    nx = diagnosis.nx
    fixed = {saturation.column for saturation in sides}
    free = [i for i in range(len(start)) if i not in fixed]
    rows = [i - nx for i in fixed]

    def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z = start.copy()
        z[free] = u
        values, slopes = [], []
        for k, (column, side) in enumerate(sides):
            there = far_off(z, column, side)
            chosen = slice(None) if k == 0 else rows
            values.append(diagnosis.problem.residual(there)[chosen])
            slopes.append(diagnosis.problem.jacobian(there)[chosen][:, free])
        return np.concatenate(values), np.vstack(slopes)

    found = gauss_newton(evaluate, start[free], scales=diagnosis.units[free])
    if found is None:
        return None
    z = start.copy()
    z[free] = found
    return z


def _named(diagnosis: Diagnosis, at: Saturation, z: np.ndarray) -> Loss:
    """The loss at a fold of the field of one side."""
    sampler, nx = diagnosis.sampler, diagnosis.nx
    column, side = at
    there, across = far_off(z, column, side), far_off(z, column, -side)
    rates = sampler.rates(there[None, :])[0]
    slopes = diagnosis.problem.jacobian(there)
    row = column - nx
    moving = slopes[:, :nx] @ rates[:nx]
    others = [k for k in range(len(slopes)) if k != row]
    beta = side * moving[row]
    if others:
        # The other fast variables stay on their own equilibria.
        own = np.array([nx + k for k in others])
        drift = np.linalg.lstsq(slopes[others][:, own], moving[others], rcond=None)[0]
        beta -= side * float(slopes[row, own] @ drift)
    gamma = side * float(diagnosis.problem.residual(across)[row])
    two = _tangent(diagnosis, [at, Saturation(column, -side)], z)
    is_two = two is not None and _is_near(diagnosis, two, z, ZERO)
    kind = LossKind.VISIBLE_FOLD if beta > 0.0 else LossKind.INVISIBLE_FOLD
    kind = LossKind.TWO_FOLD if is_two else kind
    end, order = (z[column], None) if is_two else _end(diagnosis, at, z)
    coefficients = {"beta": float(beta), "gamma": gamma} | ({} if order is None else {"n": float(order)})
    repels = not is_two and not gamma > 0.0
    exponent = None if order is None else Fraction(order, 2 * order - 1)
    name = sampler.system.states[column].name
    loss = diagnosis.loss(
        far_off(z, column, 1, end) if np.isfinite(end) else there,
        Contact.SATURATION,
        kind,
        f"rate across the surface where {name} goes to {'+' if side > 0 else '-'}infinity",
        float(diagnosis.problem.residual(there)[row]),
        consequences.of_switch(kind, exponent),
        coefficients=coefficients,
        note="both fields lead away from the surface beside it: sliding repels" if repels else "",
    )
    return replace(loss, point={**loss.point, name: float(end)})


def _end(diagnosis: Diagnosis, at: Saturation, z: np.ndarray) -> tuple[float, int | None]:
    """Where the law ends, infinity along a tail, and its contact order there, negative along a tail; None without."""
    column, side = at
    symbol = diagnosis.sampler.system.states[column]
    values = dict(diagnosis.sampler.system.parameters)
    row = column - diagnosis.nx

    def rate(v: float) -> float:
        return float(diagnosis.problem.residual(far_off(z, column, 1, v))[row])

    beyond = rate(side * FAR)

    def gap(v: float) -> float:
        return abs(rate(v) - beyond)

    size = gap(0.0)
    places = []
    for switch in switches(diagnosis.sampler.g, [symbol]):
        for surface in _pieces(switch.surface.xreplace(values)):
            slope = surface.diff(symbol)
            if surface.free_symbols == {symbol} and slope.is_number:
                places.append(float(-surface.xreplace({symbol: sp.S.Zero}) / slope))
    ends = [v for v in places if side * v > 0.0 and gap(v) <= ZERO * size and gap(2.0 * v) <= ZERO * size]
    if ends:
        end = min(ends, key=abs)
        return end, _power(lambda half: gap(end * (1.0 - 0.5**half)), size)
    order = _power(lambda half: gap(side * 2.0**half), size)
    return side * np.inf, None if order is None else -order


def _power(gap: Callable[[int], float], size: float) -> int | None:
    """The whole number p with gap ~ C 2^(-p k) for large k, as two steps of k agree on it; None without one."""
    # Down to where rounding, a share of the whole size, is less than the square of what p may be off by.
    values = list(
        itertools.takewhile(lambda g: g * WHOLE**2 > np.finfo(float).eps * size, map(gap, range(1, 64)))
    )
    powers = np.log2(np.array(values[:-1]) / np.array(values[1:]))
    # What a power is off by is halved with every step, or less, until rounding in the law is seen.
    for last, before in itertools.pairwise(powers[::-1]):
        better = 2.0 * last - before
        order = round(float(better))
        if order > 0 and max(abs(last - order), abs(better - order)) <= WHOLE:
            return order
    return None


def _pieces(surface: sp.Expr) -> list[sp.Expr]:
    """What a surface is where one or another operand is the largest or the least."""
    extremum = next(iter(surface.atoms(sp.Max, sp.Min)), None)
    if extremum is None:
        return [surface]
    return [piece for operand in extremum.args for piece in _pieces(surface.xreplace({extremum: operand}))]


def _distinct(diagnosis: Diagnosis, folds: list[Loss]) -> list[Loss]:
    """One loss for each fold of one slow variable, and for each kind and side over several."""
    names = [s.name for s in diagnosis.sampler.system.x]
    parts: dict[tuple, list[Loss]] = {}
    for fold in folds:
        place = () if len(names) > 1 else (round(fold.point[names[0]] / (NEAR * diagnosis.widths[0])),)
        side = "" if fold.kind is LossKind.TWO_FOLD else fold.test
        parts.setdefault((fold.kind, side, *place), []).append(fold)
    result = []
    for part in parts.values():
        points = np.array([[fold.point[name] for name in names] for fold in part])
        extent = {
            name: (float(low), float(high)) for name, low, high in zip(names, points.min(0), points.max(0))
        }
        is_curve = len(names) > 1 and part[0].kind is not LossKind.TWO_FOLD
        result.append(replace(part[0], samples=len(part) if is_curve else 1, extent=extent))
    return result
