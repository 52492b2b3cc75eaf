"""Branches on which g_y is singular everywhere: how many directions are fast, and what the others do.

On such a branch Newton's method converges slowly or not at all. Where nothing else finds points of it, they are
found by steps of least norm over a few slow points and polished on {g = 0, g_y v = 0, |v| = 1}.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gsp.critical.loss_kind import LossKind
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.losses import consequences
from gsp.hyperbolicity.losses.consequences import LossConsequence
from gsp.hyperbolicity.losses.diagnosis import Diagnosis
from gsp.hyperbolicity.losses.fibre import FibreOrder
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.roots import gauss_newton
from gsp.hyperbolicity.losses.zeros import ZERO_SINGULAR
from gsp.systems.region import Interval
from gsp.systems.scattered_points import halton

PROBE_STEPS = 400


def singular_points(sampler: Sampler, box: Mapping[str, Interval], x: np.ndarray) -> np.ndarray:
    """Points (m, n) with g = 0 and g_y singular over some of the slow points `x`; at most one over each.

    Empty unless `box` bounds every fast variable and most of the slow points have one.
    """
    system, nx = sampler.system, len(sampler.system.x)
    if any(s.name not in box for s in system.y):
        return np.empty((0, len(system.states)))
    bounds = np.array([box[s.name] for s in system.y])
    unit = halton(len(bounds), 12)
    starts = bounds[:, 0] + unit * (bounds[:, 1] - bounds[:, 0])
    # Slow points and starts over each, in the search for points.
    rows = x[np.linspace(0, len(x) - 1, min(len(x), 11)).astype(int)][1:-1]
    found = []
    for row in rows:
        for start in starts:
            z = _singular_point(sampler, np.concatenate([row, start]), nx)
            if z is not None and sampler.inside(z[None, :], box)[0]:
                found.append(z)
                break
    return np.array(found) if len(found) > len(rows) // 2 else np.empty((0, len(system.states)))


def _singular_point(sampler: Sampler, z: np.ndarray, nx: int) -> np.ndarray | None:
    x, n = z[:nx], len(z) - nx

    def layer(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point = np.concatenate([x, y])[None, :]
        return sampler.equilibria(point)[0], sampler.fast_jacobian(point)[0]

    y = gauss_newton(layer, z[nx:], steps=PROBE_STEPS)
    if y is None:
        return None
    g_y = layer(y)[1]
    sizes = np.linalg.svd(g_y, compute_uv=False)
    if sizes[-1] > 1e-3 * max(sizes[0], 1.0):
        return None

    def singular(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point, v = np.concatenate([x, u[:n]])[None, :], u[n:]
        matrix = sampler.fast_jacobian(point)[0]
        value = np.concatenate([sampler.equilibria(point)[0], matrix @ v, [v @ v - 1.0]])
        slope = np.zeros((2 * n + 1, 2 * n))
        slope[:n, :n] = matrix
        slope[n:-1, :n] = sampler.bent(point, v[None])[0, :, nx:]
        slope[n:-1, n:] = matrix
        slope[-1, n:] = 2.0 * v
        return value, slope

    polished = gauss_newton(singular, np.concatenate([y, np.linalg.svd(g_y)[2][-1]]), steps=PROBE_STEPS)
    y = y if polished is None else polished[:n]
    sizes = np.linalg.svd(layer(y)[1], compute_uv=False)
    return np.concatenate([x, y]) if sizes[-1] <= ZERO_SINGULAR * max(sizes[0], 1.0) else None


def degenerate_branch(diagnosis: Diagnosis, points: np.ndarray) -> Loss:
    """The loss of a branch whose g_y is singular at every one of `points` (m, n), as most of a few of them have it."""
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), 5) + 2).astype(int)[1:-1]]
    matrices = [diagnosis.problem.jacobian(z)[:, diagnosis.nx :] for z in chosen]
    losses = [_degenerate_point(diagnosis, z, A, matrices) for z, A in zip(chosen, matrices)]
    loss_kinds = [loss.kind for loss in losses]
    most = max(loss_kinds, key=loss_kinds.count)
    usual = [loss for loss in losses if loss.kind is most]
    return usual[len(usual) // 2]


def _degenerate_point(diagnosis: Diagnosis, z: np.ndarray, A: np.ndarray, matrices: list[np.ndarray]) -> Loss:
    norm = max(float(np.linalg.norm(m, 2)) for m in matrices)
    size = norm or 1.0
    left, singular, right = np.linalg.svd(A)
    zero = int((singular <= ZERO_SINGULAR * size).sum())
    values = np.linalg.eigvals(A)
    # Eigenvalues of a nilpotent block spread like a root of rounding.
    dimension = int((np.abs(values) <= 1e-4 * size).sum())
    R, L = right[len(A) - zero :].T, left[:, len(A) - zero :]
    worst = float(np.abs(values).min())
    test = "least |lambda| at every sample"
    fast = len(A) - max(dimension, zero)
    counts = {"fast directions": float(fast), "zero eigenvalues": float(max(dimension, zero))}

    def loss(kind: LossKind, verdict: LossConsequence, more: Mapping[str, float] = {}, note: str = "") -> Loss:
        coefficients = {**counts, **more}
        return diagnosis.loss(
            z, Contact.EVERYWHERE, kind, test, worst, verdict, coefficients=coefficients, note=note
        )

    if zero and dimension > zero:
        note = f"the zero eigenvalue has {dimension} dimensions and {zero} null vector{'s' * (zero > 1)}"
        return loss(LossKind.NILPOTENT, consequences.NILPOTENT, note=note)
    orders = _orders(diagnosis, z, R, L)
    if any(order is None for order in orders):
        note = "the fast fibre cannot be followed"
        return loss(LossKind.DEGENERATE, consequences.DEGENERATE, note=note)
    known = [order for order in orders if order is not None]
    rates = _next_order(diagnosis, z, R, L)
    more = {f"rate_{i + 1}" if len(rates) > 1 else "next_order": float(r) for i, r in enumerate(rates)}
    flat = [order for order in known if order.vanishes]
    if flat:
        verdict = _hidden(diagnosis, matrices, zero, len(flat), fast)
        return loss(LossKind.HIDDEN_TIME_SCALE, verdict, more)
    slowest = max(known, key=lambda order: order.order)
    if slowest.order <= 1.0:
        note = "an eigenvalue is too small beside the others to be told from their rounding"
        return loss(LossKind.DEGENERATE, consequences.DEGENERATE, note=note)
    more = {"order": slowest.order, "plus": slowest.plus, "minus": slowest.minus, **more}
    return loss(LossKind.VANISHING_DAMPING, _algebraic(slowest, rates), more)


def _orders(diagnosis: Diagnosis, z: np.ndarray, R: np.ndarray, L: np.ndarray) -> list[FibreOrder | None]:
    """The order of the layer problem along each null direction in turn."""
    found = []
    for i in range(R.shape[1]):
        turned = [i, *(j for j in range(R.shape[1]) if j != i)]
        # The cokernel in the basis dual to the kernel, so that each component belongs to its direction.
        dual = L @ np.linalg.inv(R.T @ L) if abs(np.linalg.det(R.T @ L)) > 1e-8 else L
        V = diagnosis.extent(z, dual[:, i])
        found.append(diagnosis.fibre(z, R[:, turned], dual[:, turned], V))
    return found


def _next_order(diagnosis: Diagnosis, z: np.ndarray, R: np.ndarray, L: np.ndarray) -> np.ndarray:
    """Real parts of the eigenvalues of L^T (dg_1/dy) R, L^T R = 1: the rates that g_1 of g_0 + epsilon g_1 gives."""
    product = L.T @ R
    if abs(np.linalg.det(product)) <= 1e-8:
        return np.zeros(0)
    block = np.linalg.solve(product, L.T @ diagnosis.push_jacobian(z) @ R)
    return np.sort(np.linalg.eigvals(block).real)


def _hidden(
    diagnosis: Diagnosis, matrices: list[np.ndarray], zero: int, flat: int, fast: int
) -> LossConsequence:
    names = ", ".join(s.name for s in diagnosis.sampler.system.y)
    combinations = _constant_combinations(diagnosis, matrices, zero)
    declare = (
        f"declare {' and '.join(combinations)} slow, its rate divided by epsilon"
        if combinations
        else "declare a VectorField and split it: it finds the slow coordinates"
    )
    are = "is" if fast == 1 else "are"
    return LossConsequence(
        f"the zeros of g extend along {flat} of the directions {names}: {fast} {are} fast, "
        "the rest moves as slowly as x",
        False,
        declare,
    )


def _constant_combinations(diagnosis: Diagnosis, matrices: list[np.ndarray], zero: int) -> list[str]:
    """Combinations of the fast variables that the layer problem leaves alone to first order, when they are constant."""
    names = [s.name for s in diagnosis.sampler.system.y]
    rows = []
    for matrix in matrices:
        left = np.linalg.svd(matrix)[0][:, len(matrix) - zero :].T
        # Reduced row echelon form, with pivots where the first matrix has its largest entries.
        for i in range(zero):
            pivot = int(np.argmax(np.abs(left[i]))) if not rows else int(np.argmax(np.abs(rows[0][i])))
            if left[i, pivot] == 0.0:
                return []
            left[i] /= left[i, pivot]
            for j in range(zero):
                if j != i:
                    left[j] -= left[j, pivot] * left[i]
        rows.append(left)
    if any(np.abs(row - rows[0]).max() > 1e-6 for row in rows):
        return []
    return [_combination(row, names) for row in rows[0]]


def _combination(row: np.ndarray, names: list[str]) -> str:
    """A linear combination as text, its first coefficient 1."""
    terms = [(c, name) for c, name in zip(row, names) if abs(c) > 1e-9 * np.abs(row).max()]
    shown = [
        name if abs(c / terms[0][0] - 1.0) < 1e-9 else f"{c / terms[0][0]:.6g} {name}" for c, name in terms
    ]
    return " + ".join(shown).replace("+ -", "- ")


def _algebraic(slowest: FibreOrder, rates: np.ndarray) -> LossConsequence:
    order, sides = slowest.order, slowest.attracts
    side = {(True, True): "attracts", (False, False): "repels"}.get(
        sides, "attracts from one side only and repels on the other"
    )
    is_odd = slowest.plus * slowest.minus < 0.0
    size = f"v |v|^{order - 1:g}".removesuffix("^1") if is_odd else f"|v|^{order:g}"
    power = f"v^{order:g}" if order % 2 == is_odd else size
    what = f"the layer problem is v' = {slowest.plus:.4g} {power} along the null direction and {side}"
    decay = (
        f"decay goes like tau^({-1.0 / (order - 1.0):.3g}) in fast time, not exponentially"
        if any(sides)
        else "orbits leave"
    )
    linear = ""
    if len(rates) and np.abs(rates).max() > 0.0:
        linear = (
            f"; the rate of order epsilon, {rates[-1]:.4g}, decides below v ~ epsilon^(1/{order - 1:g}): there the "
            "direction is as slow as x"
        )
    remedy = (
        "keep the direction as a slow variable, or rescale v by a power of epsilon; errors fall like powers of epsilon "
        "below 1"
    )
    return LossConsequence(f"{what}: {decay}{linear}", False, remedy)


def centre_branch(diagnosis: Diagnosis, points: np.ndarray) -> Loss:
    """The loss of a branch with an imaginary pair at every one of `points`."""
    z = points[len(points) // 2]
    values = diagnosis.sampler.eigenvalues(z[None, :])[0]
    closest = values[np.argmin(np.abs(values.real))]
    return diagnosis.loss(
        z,
        Contact.PAIR_EVERYWHERE,
        LossKind.CENTRE,
        "least |Re lambda| at every sample",
        abs(float(closest.real)),
        consequences.CENTRE,
        coefficients={"omega": abs(float(closest.imag))},
    )
