"""Modes of a Jacobian, fastest first: rates, and the directions a_r and covectors b^r in which they act.

By the real Schur form, ordered by |lambda| and then made block diagonal, so that no eigenvector is formed where there
is none: a complex pair is one mode of two dimensions, and rates that rounding does not tell apart share one subspace.
Linear combinations of states that the flow conserves have rate 0, and are taken out before anything is computed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, eq=False)
class Modes:
    """`rates` (n,), complex, fastest first; `groups` (n,) numbers the subspaces that belong together, from 0.

    `right` (n, n) has a_r for columns and `left` (n, n) b^r for rows, `left` @ `right` = 1. Within a group only the
    projection sum a_r b^r means something.
    """

    rates: np.ndarray
    groups: np.ndarray
    right: np.ndarray
    left: np.ndarray

    @property
    def ends(self) -> np.ndarray:
        """How many modes there are up to the end of each group."""
        return ends_of(self.groups)

    @property
    def pointers(self) -> np.ndarray:
        """diag(a_r b^r) (n modes, n states): how much each state moves with each mode; columns add up to 1.

        Modes of a group share the group's equally, which for a complex pair is the real part of each.
        """
        own = (self.right * self.left.T).T
        shares = np.add.reduceat(own, np.concatenate([[0], self.ends[:-1]]))
        counts = np.diff(self.ends, prepend=0)
        return (shares / counts[:, None])[self.groups]


def ends_of(groups: np.ndarray) -> np.ndarray:
    """How many modes there are up to the end of each group of neighbours, for their numbers (n,)."""
    return np.flatnonzero(np.append(np.diff(groups), 1)) + 1


@dataclass(frozen=True, eq=False)
class Coordinates:
    """On a level of `laws` (m, n), L z = const, the states `free` move by themselves, and z' = `embedding` z_free'."""

    laws: np.ndarray
    free: np.ndarray
    embedding: np.ndarray

    def in_units(self, units: np.ndarray) -> Coordinates:
        """The same for states counted in `units` (n,), each law in its largest term."""
        laws = self.laws * units
        laws /= np.abs(laws).max(axis=1, keepdims=True)
        return replace(self, laws=laws, embedding=self.embedding * units[self.free] / units[:, None])


def modes_of(jacobian: np.ndarray, coordinates: Coordinates, sizes: np.ndarray) -> Modes:
    """The modes of a Jacobian (n, n) of finite numbers, whose conserved combinations `coordinates` tell.

    `sizes` (n,) are those of the states. What is rounding is decided in them: nothing balances a state that drives
    others and is driven by none, such as a clock.
    """
    found = _modes_in_units(jacobian * sizes / sizes[:, None], coordinates.in_units(sizes))
    return replace(found, right=sizes[:, None] * found.right, left=found.left / sizes)


def _modes_in_units(jacobian: np.ndarray, coordinates: Coordinates) -> Modes:
    own = jacobian[coordinates.free] @ coordinates.embedding
    rates, groups, right, left = _modes(own)
    m, n = coordinates.laws.shape
    if m:
        # The direction u of each law has J u = 0 and L u = 1: along it the level is left, and nothing else moves.
        rows = jacobian[coordinates.free]
        size = np.abs(rows).max(axis=1, keepdims=True, initial=0.0)
        system = np.vstack([np.divide(rows, size, out=np.zeros_like(rows), where=size > 0.0), coordinates.laws])
        known = np.vstack([np.zeros((n - m, m)), np.eye(m)])
        still = np.linalg.lstsq(system, known, rcond=None)[0]
        onto = (np.eye(n) - still @ coordinates.laws)[coordinates.free]
        right = np.hstack([coordinates.embedding @ right, still])
        left = np.vstack([left @ onto, coordinates.laws])
        rates = np.append(rates, np.zeros(m))
        groups = np.append(groups, np.full(m, groups[-1] + 1 if len(groups) else 0))
    return Modes(rates, groups, right, left)


def _modes(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    from scipy.linalg import matrix_balance, schur

    if not len(matrix):
        return np.zeros(0, complex), np.zeros(0, int), matrix, matrix
    # Units of the states are taken out: they would decide what is rounding.
    with np.errstate(invalid="ignore"):
        # SciPy reads large units as if they were rows, too, and leaves what it read.
        balanced, units = matrix_balance(matrix)
    form, basis = (np.asfortranarray(part) for part in schur(balanced, output="real"))
    form, basis = _ordered(form, basis)
    sizes = _sizes(form)
    with np.errstate(all="ignore"):
        # First as if all were orthogonal, lest the vectors of equal ones be formed.
        sizes = _merged(form, sizes, basis, basis.T)
        while True:
            across, back = _decoupled(form, sizes)
            right, left = basis @ across, back @ basis.T
            merged = _merged(form, sizes, right, left)
            if merged == sizes:
                break
            sizes = merged
    groups = np.repeat(np.arange(len(sizes)), sizes)
    return _eigenvalues(form), groups, units @ right, left @ np.linalg.inv(units)


def _sizes(form: np.ndarray) -> list[int]:
    """Sizes of the diagonal blocks of a real Schur form."""
    ends = np.flatnonzero(np.append(np.diag(form, -1) == 0.0, True)) + 1
    return np.diff(ends, prepend=0).tolist()


def _eigenvalues(form: np.ndarray) -> np.ndarray:
    values = np.diag(form).astype(complex)
    for i in np.flatnonzero(np.diag(form, -1)):
        # LAPACK's blocks have equal entries on the diagonal, and opposite signs beside it.
        turn = np.sqrt(abs(form[i, i + 1])) * np.sqrt(abs(form[i + 1, i]))
        values[i] += 1j * turn
        values[i + 1] -= 1j * turn
    return values


def _ordered(form: np.ndarray, basis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The Schur form with the largest |lambda| first."""
    from scipy.linalg.lapack import dtrexc  # pyright: ignore[reportAttributeAccessIssue]

    place = 0
    while place < len(form):
        values = np.abs(_eigenvalues(form))[place:]
        best = place + int(np.argmax(values))
        if best > place:
            form, basis, _ = dtrexc(form, basis, best + 1, place + 1, overwrite_a=1, overwrite_q=1)
        place += 2 if place + 1 < len(form) and form[place + 1, place] != 0.0 else 1
    return form, basis


def _decoupled(form: np.ndarray, sizes: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """(X, X^-1), unit upper triangular, with X^-1 T X block diagonal: a Sylvester equation for each block."""
    from scipy.linalg.lapack import dtrsyl, dtrtri  # pyright: ignore[reportAttributeAccessIssue]

    n = len(form)
    across = np.eye(n)
    first = n
    for size in reversed(sizes):
        last, first = first, first - size
        if last == n:
            continue
        # T_gg R - R T_rest = -T_g,rest.
        coupling, shrunk, _ = dtrsyl(
            form[first:last, first:last], form[last:, last:], -form[first:last, last:], isgn=-1
        )
        across[first:last, last:] = (coupling / shrunk) @ across[last:, last:]
    # BLAS would wake its threads for each of these small matrices, and wait for them on a busy machine.
    return across, dtrtri(across, unitdiag=1)[0]


def _merged(form: np.ndarray, sizes: list[int], right: np.ndarray, left: np.ndarray) -> list[int]:
    """The sizes where those are joined whose eigenvalues rounding does not tell apart.

    Rounding moves an eigenvalue by eps |T| |a| |b| / (b a) to first order, and those of a subspace by its projection.
    """
    values = _eigenvalues(form)
    rounding = len(form) * np.finfo(float).eps * np.linalg.norm(form)
    ends = np.cumsum(sizes)
    moved_by = np.empty(len(form))
    for end, size in zip(ends, sizes):
        part = slice(end - size, end)
        a, b = right[:, part], left[part]
        moved_by[part] = rounding * np.sqrt(np.sum((a.T @ a) * (b @ b.T)))
    moved_by = np.where(np.isfinite(moved_by), moved_by, np.inf)
    group = np.repeat(np.arange(len(sizes)), sizes)
    apart = np.abs(values[:, None] - values)
    apart[group[:, None] == group] = np.inf
    # Each with its nearest, and again: where vectors do not exist that is infinite, and says nothing of others.
    nearest = apart.argmin(axis=1)
    place = np.arange(len(form))
    joined = apart[place, nearest] <= moved_by + moved_by[nearest]
    # What lies between two that are one has their modulus, and goes with them.
    last = np.repeat(ends - 1, sizes)
    np.maximum.at(last, np.minimum(place, nearest)[joined], np.maximum(place, nearest)[joined])
    last = np.maximum.accumulate(last)
    return np.diff(np.flatnonzero(last == place) + 1, prepend=0).tolist()
