"""Losses over two and more slow variables: samples of one curve or surface become one loss.

Samples are linked along a spanning tree of nearest neighbours when Newton's method, from the points between two of
them, stays there. Along the links the test functions of cusps and Bogdanov-Takens points change their sign; those
points are located and named by themselves.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gsp.critical.layer_problem import least_norm_newton
from gsp.critical.loss_kind import LossKind
from gsp.critical.minimally_augmented import MatrixMap, bialternate, identity, singular_near
from gsp.critical.normal_forms import null_vectors, quadratic_coefficient
from gsp.critical.sheet_points import EQUAL
from gsp.hyperbolicity.losses.diagnosis import Diagnosis, Found
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.naming import name_loss
from gsp.hyperbolicity.losses.zeros import zero
from gsp.roots import root

# In units of the region: nearer samples are linked as they are; branch points, which Newton's method does not isolate,
# are linked up to the second.
NEAR = 0.03
NEAR_BRANCH_POINTS = 0.35
# Nearer losses of one kind are one: multiple zeros are located to the root of rounding only.
SAME_KIND = 1e-4
HALVINGS = 3

FOLDS = (LossKind.FOLD, LossKind.CUSP, LossKind.BOGDANOV_TAKENS)
Chain = list[np.ndarray]


def named_losses(diagnosis: Diagnosis, found: Sequence[Found]) -> list[Loss]:
    """The losses at `found`, one for each component of one kind, those on curves with their special points."""
    losses = [name_loss(diagnosis, place) for place in found]
    points = [place.z for place in found]
    if diagnosis.nx == 1:
        return [_ranged(diagnosis, [loss]) for loss in _distinct(diagnosis, losses)]
    result: list[Loss] = []
    for group in _groups(losses):
        members = [losses[i] for i in group]
        result += _merged(diagnosis, members, np.array([points[i] for i in group]))
    return result


def _groups(losses: Sequence[Loss]) -> list[list[int]]:
    """Indices of losses that may lie on one component: folds with the special points on them, else one kind."""
    groups: dict[object, list[int]] = {}
    for i, loss in enumerate(losses):
        key = FOLDS if loss.kind in FOLDS else (loss.kind, loss.crossing)
        groups.setdefault(key, []).append(i)
    return list(groups.values())


def _ranged(diagnosis: Diagnosis, losses: Sequence[Loss]) -> Loss:
    """The first loss with the range of all of them in the slow variables."""
    names = [s.name for s in diagnosis.sampler.system.x]
    values = {name: [loss.point[name] for loss in losses] for name in names}
    return replace(losses[0], extent={name: (min(v), max(v)) for name, v in values.items()})


def _distinct(diagnosis: Diagnosis, losses: Sequence[Loss]) -> list[Loss]:
    names = [s.name for s in diagnosis.sampler.system.states]
    z = np.array([[loss.point[name] for name in names] for loss in losses]).reshape(-1, len(names))
    # In y a multiple zero is located to a root of what it is in x.
    lengths = diagnosis.units[diagnosis.nx :]
    margin = np.append(SAME_KIND * diagnosis.widths, 0.1 * SAME_KIND**0.5 * lengths)
    kept: list[int] = []
    for i, loss in enumerate(losses):
        if not any(losses[j].kind is loss.kind and (np.abs(z[j] - z[i]) <= margin).all() for j in kept):
            kept.append(i)
    return [losses[i] for i in kept]


def _merged(diagnosis: Diagnosis, losses: list[Loss], z: np.ndarray) -> list[Loss]:
    """One loss for each connected part, and the special points on it."""
    scales = _scales(diagnosis, z)
    kind = losses[0].kind
    of = bialternate if losses[0].crossing is Contact.PAIR else identity
    isolated = kind in FOLDS or kind is LossKind.HOPF
    part, turns = np.arange(len(z)), np.ones(len(z))
    special: list[Loss] = []
    for i, j, distance in _spanning_tree(z / scales):
        turn = 1.0
        if isolated:
            chain = _chain(diagnosis, of, z[i], z[j], scales, HALVINGS)
            if chain is None:
                continue
            if kind in FOLDS:
                folds = [z[i], *chain, z[j]]
                special += _special_points(diagnosis, folds, scales)
                turn = _turn(diagnosis, folds)
        elif distance > NEAR_BRANCH_POINTS:
            continue
        beyond = part == part[j]
        turns[beyond] *= turn * turns[i] * turns[j]
        part[beyond] = part[i]
    result = []
    for first in dict.fromkeys(part.tolist()):
        members = np.flatnonzero(part == first)
        result.append(
            _represented(diagnosis, [losses[i] for i in members], z[members] / scales, turns[members])
        )
    own = [loss for loss in losses if isolated and loss.kind not in (LossKind.FOLD, LossKind.HOPF)]
    kept = [loss for loss in _distinct(diagnosis, [*special, *own]) if loss.kind is not result[0].kind]
    return [*result, *(_ranged(diagnosis, [loss]) for loss in kept)]


def _represented(diagnosis: Diagnosis, losses: list[Loss], places: np.ndarray, turns: np.ndarray) -> Loss:
    """One loss that stands for its part: a typical one; what differs along the part is noted.

    `turns` are the signs of the losses' left null vectors, <l, r> = 1, against one that is followed along the part.
    """
    usual = [i for i, loss in enumerate(losses) if loss.kind in (LossKind.FOLD, LossKind.HOPF)]
    usual = usual or list(range(len(losses)))
    speeds = [
        abs(losses[i].coefficients.get("kappa", losses[i].coefficients.get("crossing", 0.0))) for i in usual
    ]
    if max(speeds) > 0.0:
        middle = usual[int(np.argsort(speeds)[len(speeds) // 2])]
    else:
        distances = np.linalg.norm(places[:, None, :] - places[None, :, :], axis=2).sum(axis=1)
        middle = min(usual, key=lambda i: distances[i])
    chosen = losses[middle]
    notes = [chosen.note] if chosen.note else []
    folds = [(loss.coefficients, turn) for loss, turn in zip(losses, turns) if "switching" in loss.coefficients]
    if _changes_sign(known["switching"] * turn for known, turn in folds):
        notes.append("the slow flow changes its direction across it: folded singularities lie on it")
    if _changes_sign(known["a"] * turn for known, turn in folds) and _changes_sign(
        known["kappa"] for known, _ in folds
    ):
        notes.append("kappa changes its sign at a cusp on it")
    if _changes_sign(loss.coefficients["l1"] for loss in losses if "l1" in loss.coefficients):
        notes.append("l1 changes its sign along it: a generalised Hopf point lies on it")
    ranged = _ranged(diagnosis, [chosen, *losses])
    return replace(ranged, samples=len(losses), note="; ".join(notes))


def _changes_sign(values: Iterable[float]) -> bool:
    return len({value > 0.0 for value in values if value}) > 1


def _turn(diagnosis: Diagnosis, chain: Chain) -> float:
    """-1 where the left null vector of the first of `chain`, <l, r> = 1, is against the last's when followed to it."""
    vectors = [null_vectors(diagnosis.problem.jacobian(u)[:, diagnosis.nx :]) for u in chain]
    followed = [before @ after for (_, before), (_, after) in pairwise(vectors)]
    ends = [left @ right for right, left in (vectors[0], vectors[-1])]
    return float(np.prod(np.copysign(1.0, [*followed, *ends])))


def _scales(diagnosis: Diagnosis, z: np.ndarray) -> np.ndarray:
    """Typical sizes of (x, y): the region's widths, and what the branch and the losses span in y."""
    nx = diagnosis.nx
    y, lengths = np.vstack([diagnosis.samples[:, nx:], z[:, nx:]]), diagnosis.units[nx:]
    spans = np.ptp(y[np.isfinite(y).all(axis=1)], axis=0)
    # Points of a branch on which a variable is constant differ in it by rounding.
    return np.append(diagnosis.widths, np.where(spans > EQUAL * lengths, spans, lengths))


def _spanning_tree(points: np.ndarray) -> list[tuple[int, int, float]]:
    """Edges (i, j, length) of the shortest tree through `points` (m, d)."""
    from scipy.sparse.csgraph import minimum_spanning_tree

    distances = np.linalg.norm(points[:, None, :] - points[None, :, :], axis=2)
    # SciPy takes 0 for no edge; one more for each leaves the tree what it is.
    tree = minimum_spanning_tree(distances + 1.0).tocoo()
    return [(int(i), int(j), float(distances[i, j])) for i, j in zip(tree.row, tree.col)]


def _singular_point(
    diagnosis: Diagnosis, of: MatrixMap, u: np.ndarray, scales: np.ndarray
) -> np.ndarray | None:
    try:
        return least_norm_newton(singular_near(diagnosis.problem, of, u, scales), u, scales, 1e-12)
    except np.linalg.LinAlgError:
        return None


def _chain(
    diagnosis: Diagnosis, of: MatrixMap, p: np.ndarray, q: np.ndarray, scales: np.ndarray, halvings: int
) -> Chain | None:
    """Points of the same set between p and q, in order; None when it does not join them."""
    length = float(np.linalg.norm((q - p) / scales))
    if length <= NEAR:
        return []
    between = _singular_point(diagnosis, of, 0.5 * (p + q), scales)
    # A point between two of a curve is nearer to both than this share of their distance, once they are near
    # enough. Between two curves one of the distances stays what it is.
    nearest = length if halvings else 0.8 * length
    if between is None or max(np.linalg.norm((between - end) / scales) for end in (p, q)) > nearest:
        return None
    if halvings == 0:
        return [between]
    first = _chain(diagnosis, of, p, between, scales, halvings - 1)
    second = _chain(diagnosis, of, between, q, scales, halvings - 1)
    return None if first is None or second is None else [*first, between, *second]


def _special_points(diagnosis: Diagnosis, chain: Chain, scales: np.ndarray) -> list[Loss]:
    """Cusps and Bogdanov-Takens points between consecutive points of a chain of folds."""
    found = []
    for p, q in pairwise(chain):
        before, after = _tests(diagnosis, p, p), _tests(diagnosis, q, p)
        for which in (0, 1):
            if before[which] * after[which] >= 0.0:
                continue
            z = _changed(diagnosis, p, q, which, (before[which], after[which]), scales)
            if z is None or not diagnosis.sampler.inside(z[None, :], diagnosis.box)[0]:
                continue
            loss = zero(diagnosis, z)
            if loss.kind is not LossKind.FOLD:
                found.append(loss)
    return found


def _tests(diagnosis: Diagnosis, u: np.ndarray, reference: np.ndarray) -> tuple[float, float]:
    """<l, g_yy r r>/2 and <l, r> at u, unit vectors turned as at `reference`: zero at cusps, and at double zeros."""
    nx = diagnosis.nx
    right, left = null_vectors(diagnosis.problem.jacobian(u)[:, nx:])
    right_0, left_0 = null_vectors(diagnosis.problem.jacobian(reference)[:, nx:])
    right, left = right * np.sign(right @ right_0), left * np.sign(left @ left_0)
    g_yy = diagnosis.problem.second(u)[:, nx:, nx:]
    return quadratic_coefficient(g_yy, right, left), float(left @ right)


def _changed(
    diagnosis: Diagnosis,
    p: np.ndarray,
    q: np.ndarray,
    which: int,
    values: tuple[float, float],
    scales: np.ndarray,
) -> np.ndarray | None:
    """Where the test changes its sign between p and q; None where no singular point is found on the way."""
    met: dict[float, np.ndarray] = {}

    def value(share: float) -> float:
        found = _singular_point(diagnosis, identity, p + share * (q - p), scales)
        if found is None:
            return float("nan")
        met[share] = found
        return _tests(diagnosis, found, p)[which]

    share = root(value, 0.0, 1.0, ends=values)
    return None if share is None else met[share]
