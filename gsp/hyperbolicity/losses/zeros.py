"""Names for zero eigenvalues: folds, cusps, branch points, double zeros, and what no coefficient decides."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsp.critical.loss_kind import LossKind
from gsp.critical.normal_forms import (
    ZERO_TERM,
    bogdanov_takens,
    bordered,
    cubic_coefficient,
    null_vectors,
    quadratic_coefficient,
    significant,
)
from gsp.hyperbolicity.losses import consequences
from gsp.hyperbolicity.losses.consequences import OMEGA_0
from gsp.hyperbolicity.losses.diagnosis import Diagnosis, Local
from gsp.hyperbolicity.losses.kinds import Contact, Loss

# Singular values and eigenvalues that count as zero, relative to their like in the region. A double zero
# spreads like the square root of what its place is off.
ZERO_SINGULAR = 1e-6
# What the place of a branch point may be off, relative to the region.
OFF = 1e-9
# Share of the region over which a change of the quadratic form is measured.
BESIDE = 0.01


def zero(diagnosis: Diagnosis, z: np.ndarray) -> Loss:
    """The loss at z, where g_y is singular."""
    at = diagnosis.local(z)
    determinant = float(np.linalg.det(at.A))
    if not at.is_finite:
        return _degenerate(diagnosis, at, determinant, "g has no second or third derivative here")
    values = np.linalg.eigvals(at.A)
    singular = np.linalg.svd(diagnosis.in_units(at.A), compute_uv=False)
    corank = int((singular <= ZERO_SINGULAR * diagnosis.singular_sizes).sum())
    sizes, near = diagnosis.sizes_beside(values), diagnosis.near_zero(values)
    on_axis = (np.abs(values.real) <= ZERO_SINGULAR * sizes) & ~near & (np.abs(values.imag) > 0.0)
    if corank > 1:
        return _degenerate(diagnosis, at, determinant, f"{corank} zero eigenvalues with {corank} null vectors")
    if on_axis.any():
        return _degenerate(diagnosis, at, determinant, "a zero eigenvalue and an imaginary pair together")
    if near.sum() == 2:
        return _double_zero(diagnosis, at, determinant)
    if near.sum() > 2:
        if near.all():
            test = f"det g_y = {determinant:.3g}, largest |lambda|"
            return diagnosis.loss(
                z, Contact.ZERO, LossKind.NILPOTENT, test, np.abs(values).max(), consequences.NILPOTENT
            )
        return _degenerate(diagnosis, at, determinant, f"{near.sum()} zero eigenvalues with one null vector")
    others = int((values.real > ZERO_SINGULAR * sizes).sum())
    note = f"{others} of the other fast directions are unstable, so orbits leave anyway" if others else ""
    return _simple_zero(diagnosis, at, determinant, note)


def _degenerate(
    diagnosis: Diagnosis, at: Local, value: float, note: str, coefficients: Mapping[str, float] | None = None
) -> Loss:
    return diagnosis.loss(
        at.z,
        Contact.ZERO,
        LossKind.DEGENERATE,
        "det g_y",
        value,
        consequences.DEGENERATE,
        coefficients=coefficients,
        note=note,
    )


def _double_zero(diagnosis: Diagnosis, at: Local, determinant: float) -> Loss:
    a, b = bogdanov_takens(at.A, at.g_yy)
    size = float(np.abs(at.g_yy).sum())
    coefficients = {"a": a, "b": b, "a/b": a / b} if b else {"a": a, "b": b}
    trace = float(np.trace(at.A))
    test = f"det g_y = {determinant:.3g}, trace of the block"
    if min(abs(a), abs(b)) > ZERO_TERM * size > 0.0:
        kind, verdict, note = LossKind.BOGDANOV_TAKENS, consequences.BOGDANOV_TAKENS, ""
    else:
        kind, verdict = LossKind.DEGENERATE, consequences.DEGENERATE
        note = "a double zero eigenvalue with one null vector, a or b = 0"
        if len(at.A) == 2:
            kind, verdict = LossKind.NILPOTENT, consequences.NILPOTENT
    double = np.sort(np.abs(np.linalg.eigvals(at.A)))[:2].sum() if len(at.A) > 2 else trace
    return diagnosis.loss(
        at.z, Contact.ZERO, kind, test, float(double), verdict, coefficients=coefficients, note=note
    )


@dataclass(frozen=True, eq=False)
class _SimpleZero:
    """A simple zero of g_y: null vectors with <left, right> = 1, and the `width` of v along `right` in the region."""

    at: Local
    determinant: float
    note: str
    right: np.ndarray
    left: np.ndarray
    width: float


def _simple_zero(diagnosis: Diagnosis, at: Local, determinant: float, note: str) -> Loss:
    nx = diagnosis.nx
    right, left = null_vectors(at.A)
    left = left / (left @ right)
    b, a = left @ at.g_x, quadratic_coefficient(at.g_yy, right, left)
    c = cubic_coefficient(at.A, at.g_yy, at.third, right, left)
    # Directions of the kernel of (g_x, g_y) up to b: (0, r), and (e_j, w_j) with <l, w_j> = 0.
    w = np.linalg.solve(bordered(at.A, right, left), np.vstack([-at.g_x, np.zeros((1, nx))]))[:-1]
    kernel = np.vstack([np.append(np.zeros(nx), right), np.hstack([np.eye(nx), w.T])])
    form = np.einsum("i,ijk,aj,bk->ab", left, at.second, kernel, kernel)
    V = _width(diagnosis, at.z, left, a, c, form)
    here = _SimpleZero(at, determinant, note, right, left, V)
    sizes = np.append(V, diagnosis.widths)
    scaled = form * sizes[:, None] * sizes
    if not np.isfinite(scaled).all():
        return _degenerate(
            diagnosis, at, determinant, "the second derivatives of g leave double precision here"
        )
    bend, tilt, cubic = abs(a) * V**2, np.abs(b) * diagnosis.widths, abs(c) * V**3
    mixed, square = float(np.abs(scaled[0, 1:]).max()), float(np.abs(scaled[1:, 1:]).max())
    names = [s.name for s in diagnosis.sampler.system.x]
    coefficients = {"a": a, **{f"b_{name}": float(value) for name, value in zip(names, b)}}
    if max(bend, float(tilt.max()), cubic, mixed, square) == 0.0:
        return _touching(diagnosis, here, {})
    is_zero = ZERO_TERM * max(bend, float(tilt.max()), cubic, mixed)
    # At a branch point b is as large as the square terms times what the place is off. Next to a double zero w is large,
    # and the place is off by no more than the fast variables have in the region.
    within = 1.0 / np.maximum(1.0, np.abs(w / diagnosis.units[nx:, None]).max(axis=0) * diagnosis.widths)
    if float(tilt.max()) > max(is_zero, OFF * float(np.abs(scaled[1:, 1:] * within).max())):
        switching = float(b @ at.slow)
        if abs(switching) <= ZERO_TERM * float(np.abs(b) @ diagnosis.fastest):
            switching = 0.0
        if bend > is_zero:
            return _fold(diagnosis, here, coefficients, switching)
        coefficients["c"] = c
        fibre = diagnosis.fibre(at.z, right[:, None], left[:, None], V)
        # A second route to the order: near a zero of higher order c is small, not zero.
        # Where a cubic coefficient vanishes the place is known to a root of rounding only.
        if cubic > 1e-4 / ZERO_TERM * is_zero and (fibre is None or fibre.order == 3.0):
            coefficients |= {"kappa": c * switching**2}
            verdict = consequences.cusp(coefficients, nx)
            test = f"det g_y = {determinant:.3g}, a"
            return diagnosis.loss(
                at.z, Contact.ZERO, LossKind.CUSP, test, a, verdict, coefficients=coefficients, note=note
            )
        return _touching(diagnosis, here, coefficients)
    is_zero = max(is_zero, ZERO_TERM * square)
    scaled = np.where(np.abs(scaled) > OFF * _change(diagnosis, at, left, kernel, sizes), scaled, 0.0)
    terms = (a if bend > is_zero else 0.0, c if cubic > is_zero else 0.0)
    return _branch_point(diagnosis, here, scaled, kernel, *terms)


def _change(
    diagnosis: Diagnosis, at: Local, left: np.ndarray, kernel: np.ndarray, sizes: np.ndarray
) -> np.ndarray:
    """How much the entries of the scaled form change over the region: what the place is off, they are off by this."""
    largest, second = np.zeros((len(kernel), len(kernel))), diagnosis.problem.second
    for way in kernel[1:] * (BESIDE * diagnosis.widths)[:, None]:
        change = 0.5 * (second(at.z + way) - second(at.z - way)) / BESIDE
        form = np.einsum("i,ijk,aj,bk->ab", left, change, kernel, kernel) * sizes[:, None] * sizes
        largest = np.maximum(largest, np.nan_to_num(np.abs(form)))
    return largest


def _width(
    diagnosis: Diagnosis, z: np.ndarray, left: np.ndarray, a: float, c: float, form: np.ndarray
) -> float:
    """The size of v in the region: the branch's own, else its fast bounds', else where two terms balance."""
    moved = diagnosis.extent(z, left)
    if moved > 0.0:
        return moved
    mixed = float(np.max(np.abs(form[0, 1:]) * diagnosis.widths, initial=0.0))
    if a != 0.0 and mixed > 0.0:
        return mixed / abs(a)
    if c != 0.0 and mixed > 0.0:
        return float(np.sqrt(mixed / abs(c)))
    return diagnosis.spread(left) or 1.0


def _fold(diagnosis: Diagnosis, here: _SimpleZero, known: Mapping[str, float], switching: float) -> Loss:
    coefficients = dict(known)
    if diagnosis.fastest.any():
        coefficients |= {"switching": switching, "kappa": known["a"] * switching}
        if coefficients["kappa"] > 0.0:
            coefficients["delay"] = OMEGA_0 * coefficients["kappa"] ** (-1.0 / 3.0)
        verdict = consequences.fold(coefficients, diagnosis.nx)
    else:
        verdict = consequences.STANDS_STILL
    return diagnosis.loss(
        here.at.z,
        Contact.ZERO,
        LossKind.FOLD,
        "det g_y",
        here.determinant,
        verdict,
        coefficients=coefficients,
        note=here.note,
    )


def _branch_point(
    diagnosis: Diagnosis, here: _SimpleZero, scaled: np.ndarray, kernel: np.ndarray, a: float, c: float
) -> Loss:
    """Where (g_x, g_y) loses rank: M0 branches. Decided by the quadratic form on its kernel; a and c may count as 0."""
    at, left = here.at, here.left
    spectrum = np.linalg.eigvalsh(scaled)
    zero = ZERO_TERM * float(np.abs(spectrum).max())
    plus, minus = int((spectrum > zero).sum()), int((spectrum < -zero).sum())
    coefficients = {"a": a} if a else {"c": c} if c else {}
    test = f"det g_y = {here.determinant:.3g}, |<l, g_x>|"
    value = float(np.abs(left @ at.g_x).max())
    if (plus, minus) != (1, 1):
        if not a and plus + minus <= 1:
            return _touching(diagnosis, here, coefficients)
        text = f"(g_x, g_y) loses rank with {plus} positive and {minus} negative squares of the quadratic form"
        return _degenerate(diagnosis, at, here.determinant, text, coefficients)
    along = kernel[1:].T @ at.slow
    moves = bool((np.abs(at.slow) > ZERO_TERM * diagnosis.fastest).any())
    cross = float(np.einsum("i,ijk,j,k->", left, at.second, kernel[0], along))
    bent = 0.5 * float(np.einsum("i,ijk,j,k->", left, at.second, along, along))
    terms = float(np.einsum("i,ijk,j,k->", *map(np.abs, (left, at.second, along, along))))
    bent = significant(bent, terms)
    push = significant(float(left @ at.push), diagnosis.largest_push(left))
    if a:
        # A power of a float that is too large raises; a product is infinite.
        discriminant = 0.25 * cross * cross - a * bent
        coefficients["discriminant"] = discriminant
        if moves and discriminant > 0.0:
            coefficients["lambda"] = (a * push + 0.5 * cross) / float(np.sqrt(discriminant))
        kind, verdict = LossKind.TRANSCRITICAL, consequences.transcritical(coefficients)
    else:
        if moves and cross != 0.0:
            # The tangent of the branch that is a graph over x is along + slope (0, r).
            slope = -bent / cross
            coefficients |= {"crossing": cross, "push": significant(push - slope, max(abs(push), abs(slope)))}
        if c:
            kind, verdict = LossKind.PITCHFORK, consequences.pitchfork(coefficients)
        else:
            fibre = diagnosis.fibre(at.z, here.right[:, None], left[:, None], here.width)
            if fibre is None or not fibre.vanishes:
                return _touching(diagnosis, here, coefficients)
            kind, verdict = LossKind.RANK_CHANGE, consequences.rank_change(coefficients)
    return diagnosis.loss(
        at.z, Contact.ZERO, kind, test, value, verdict, coefficients=coefficients, note=here.note
    )


def _touching(diagnosis: Diagnosis, here: _SimpleZero, coefficients: Mapping[str, float]) -> Loss:
    """Neither quadratic nor cubic terms decide."""
    fibre = diagnosis.fibre(here.at.z, here.right[:, None], here.left[:, None], here.width)
    if fibre is None:
        text = "the quadratic and cubic coefficients do not decide"
    elif fibre.vanishes:
        text = "g vanishes along the fast fibre and its eigenvalue does not cross zero to first order"
    else:
        text = f"the fast fibre has order {fibre.order:g}: v' = {fibre.plus:.4g} v^{fibre.order:g} for v > 0"
    text = text + (f"; {here.note}" if here.note else "")
    return _degenerate(diagnosis, here.at, here.determinant, text, coefficients)
