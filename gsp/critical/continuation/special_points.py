"""Special points on a curve of M0: folds, cusps, Hopf points of the layer problem, and branch points.

Each is told by a test function that changes its sign, located by a secant method along the curve, polished by
Newton's method on an augmented system, and given the coefficients that decide what it looks like nearby.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gsp.critical.continuation.arclength import PointTracer
from gsp.critical.layer_problem import LayerProblem, least_norm_newton, sizes_beside
from gsp.critical.loss_kind import LossKind
from gsp.critical.minimally_augmented import MatrixMap, Singular, singular_near
from gsp.critical.normal_forms import cubic_coefficient, first_lyapunov, null_vectors, quadratic_coefficient
from gsp.critical.saturation import saturates
from gsp.results.card import Card
from gsp.systems.flow import in_words
from gsp.systems.region import Interval, is_within

# An eigenvalue counts as zero below this, and two sums as equal, relative to their like on the curve.
ZERO_EIGENVALUE = 1e-6
# A tangent counts as vertical when its free component is below this, in scaled units.
VERTICAL = 1e-6
# A step of Newton's method of at least this share of the one before does not converge by squares.
STAGNANT = 0.3


@dataclass(frozen=True, eq=False)
class SpecialPoint(Card):
    """A special point: its `kind`, `point` by name, the `row` of the curve that holds it, and what was computed.

    `eigenvalues` (n_fast,) are those of g_y; `right` and `left` (n_fast,) its null vectors at a fold, the
    eigenvectors of i omega at a Hopf point, empty otherwise. `coefficients` are

    - at a fold, a = <psi, g_yy phi phi>/2 and b = <psi, g_x> for the free variable x, with |phi| = 1, the
      largest component of phi positive, and <psi, phi> = 1: v' = b dx + a v^2 to leading order along phi; at a
      cusp also c = <psi, g_yyy phi phi phi + 3 g_yy phi h>/6 with g_y h = -g_yy phi phi, which is 0 at a
      degenerate point;
    - at a Hopf point, omega, l1, the first Lyapunov coefficient (negative: supercritical, the cycles are stable),
      and crossing, the rate of Re lambda with the free variable along M0;
    - at a branch point, the discriminant of the algebraic bifurcation equation <psi, g_uu d d> = 0, positive where
      two curves cross; `directions` (2, N) are their unit tangents in (free, fast), in scaled units, that of this
      curve first.
    """

    kind: LossKind
    point: Mapping[str, float]
    row: int
    eigenvalues: np.ndarray
    coefficients: Mapping[str, float]
    right: np.ndarray
    left: np.ndarray
    directions: np.ndarray
    unknowns: np.ndarray

    def __getitem__(self, name: str) -> float:
        return self.point[name]

    def is_in(self, region: Mapping[str, Interval]) -> bool:
        """Whether no variable that the region bounds is outside it."""
        return is_within(self.point, region)

    def __str__(self) -> str:
        # That of a loss is along the slow flow.
        names = {"crossing": "crossing along the curve"}
        rest = in_words((names.get(n, n), value) for n, value in self.coefficients.items())
        return f"{self.kind} at {in_words(self.point, 10)}" + (f" ({rest})" if rest else "")

    def __repr__(self) -> str:
        return f"SpecialPoint({self})"


NONE = np.empty(0)


def special_point(
    problem: LayerProblem,
    u: np.ndarray,
    kind: LossKind,
    *,
    coefficients: Mapping[str, float] | None = None,
    right: np.ndarray = NONE,
    left: np.ndarray = NONE,
    directions: np.ndarray = NONE,
) -> SpecialPoint:
    """A `SpecialPoint` with its names and eigenvalues filled in, of row 0 until rows are numbered."""
    values = problem.eigenvalues(u[None, :])[0]
    return SpecialPoint(
        kind, problem.point(u), 0, values, coefficients or {}, right, left, directions, u
    )  # fmt: skip


# -- test functions --------------------------------------------------------------------------------


def pair_test(eigenvalues: np.ndarray) -> np.ndarray:
    """Product of all sums of two eigenvalues over the size of the largest, (m, n) to (m,): zero at Hopf points."""
    n = eigenvalues.shape[1]
    size = np.abs(eigenvalues).max(axis=1)
    i, j = np.triu_indices(n, 1)
    sums = (eigenvalues[:, i] + eigenvalues[:, j]) / np.where(size > 0.0, size, 1.0)[:, None]
    return np.prod(sums, axis=1).real


def most_opposite(eigenvalues: np.ndarray) -> tuple[complex, complex]:
    """The two of the eigenvalues (n,) whose sum is nearest to zero."""
    i, j = np.triu_indices(len(eigenvalues), 1)
    closest = int(np.argmin(np.abs(eigenvalues[i] + eigenvalues[j])))
    return complex(eigenvalues[i[closest]]), complex(eigenvalues[j[closest]])


def polished(tracer: PointTracer, problem: LayerProblem, of: MatrixMap, u: np.ndarray) -> np.ndarray:
    """The point next to u where `of`(g_y) is singular, by Newton's method; u itself when that leads away."""
    try:
        system = singular_near(problem, of, u, tracer.scales)
    except np.linalg.LinAlgError:
        return u
    found = least_norm_newton(system, u, tracer.scales, 1e-13)
    if found is None or np.abs((found - u) / tracer.scales).max() > 1e-4:
        return u
    return found


# -- folds -----------------------------------------------------------------------------------------


def fold_vectors(problem: LayerProblem, u: np.ndarray, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Right and left null vectors (phi, psi) of g_y at a fold, of unit length in the fast variables' `scales`.

    The largest component of phi is positive. In raw units a variable whose numbers are large would hide the others.
    """
    k = len(problem.free)
    phi, psi = null_vectors(problem.jacobian(u)[:, k:] * scales / scales[:, None])
    return phi * scales, psi / scales


def fold_point(
    problem: LayerProblem,
    u: np.ndarray,
    *,
    scales: np.ndarray,
    curvature: float,
    sizes: np.ndarray,
    is_flat: bool = False,
) -> SpecialPoint:
    """What kind of fold there is at u, with its coefficients; `curvature` is the largest |g_yy| on the curve.

    `sizes` (n_fast,) are those of its eigenvalues. Where `is_flat`, a test has told already that a = 0.
    """
    k, n = len(problem.free), problem.size
    phi, psi = fold_vectors(problem, u, scales[k:])
    g_yy = problem.second(u)[:, k:, k:]
    # A fold coefficient is zero below this, relative to the largest second derivative on the curve, in scaled
    # units.
    is_flat = is_flat or abs(quadratic_coefficient(g_yy, phi, psi)) <= 1e-6 * curvature
    length = float(np.linalg.norm(phi))
    phi, psi = phi / length, psi * length
    values = np.sort(np.abs(problem.eigenvalues(u[None, :])[0]))
    product = float(psi @ phi)
    double = n > 1 and (values[1] <= 1e-5 * min(values[-1], sizes[1]) or abs(product) < ZERO_EIGENVALUE)
    if double:
        return special_point(
            problem, u, LossKind.BOGDANOV_TAKENS, right=phi, left=psi / float(np.linalg.norm(psi))
        )
    psi = psi / product
    a = quadratic_coefficient(g_yy, phi, psi)
    b = float(psi @ problem.jacobian(u)[:, 0])
    coefficients = {"a": a, "b": b}
    onset = saturates(problem, u, k + int(np.abs(phi).argmax()))
    kind = LossKind.SLIP_ONSET if onset else LossKind.FOLD
    if is_flat:
        g_y = problem.jacobian(u)[:, k:]
        c = cubic_coefficient(g_y, g_yy, problem.third(u), phi, psi)
        coefficients |= {"a": 0.0, "c": c}
        # c in scaled units: of a fold of higher order it is 0 as well.
        kind = LossKind.CUSP if abs(c) * length**2 > 1e-6 * curvature else LossKind.DEGENERATE
    return special_point(problem, u, kind, coefficients=coefficients, right=phi, left=psi)


def curvature(problem: LayerProblem, points: np.ndarray, scales: np.ndarray) -> float:
    """The largest |g_yy| in scaled units over points (m, N)."""
    k = len(problem.free)
    chosen = points[np.linspace(0, len(points) - 1, min(len(points), 33)).astype(int)]
    fast = scales[k:]
    weights = fast[None, :, None] * fast[None, None, :] / fast[:, None, None]
    sizes = [np.abs(problem.second(u)[:, k:, k:] * weights).max() for u in chosen]
    return float(max((s for s in sizes if np.isfinite(s)), default=1.0)) or 1.0


def fold_coefficient(system: Singular, u: np.ndarray) -> float:
    """<w, g_yy v v> with the bordered vectors of `system`: smooth along a curve, zero at a cusp."""
    k = len(system.problem.free)
    try:
        null = system.null(u)
    except np.linalg.LinAlgError:
        return float("nan")
    return float(
        np.einsum("ijk,i,j,k->", system.problem.second(u)[:, k:, k:], null.left, null.right, null.right)
    )


# -- Hopf points -----------------------------------------------------------------------------------


def pair_point(
    problem: LayerProblem, u: np.ndarray, tangent: np.ndarray, sizes: np.ndarray
) -> SpecialPoint | None:
    """Hopf point, neutral saddle or double zero at u, where two eigenvalues have the sum zero; `sizes` of the curve."""
    values = problem.eigenvalues(u[None, :])[0]
    first, second = most_opposite(values)
    own = sizes_beside(sizes, values)[np.isin(values, (first, second))]
    largest = min(float(np.abs(values).max()), float(own.max()))
    if largest == 0.0 or abs(first + second) > 1e-4 * largest:
        return None
    if (
        abs(first) <= ZERO_EIGENVALUE * largest
        or (abs(first.imag) + abs(first.real)) ** 2 <= 1e-12 * largest**2
    ):
        return special_point(problem, u, LossKind.BOGDANOV_TAKENS)
    if abs(first.imag) <= ZERO_EIGENVALUE * largest:
        return special_point(problem, u, LossKind.NEUTRAL_SADDLE)
    return hopf_point(problem, u, tangent, omega=abs(float(first.imag)))


def hopf_point(problem: LayerProblem, u: np.ndarray, tangent: np.ndarray, *, omega: float) -> SpecialPoint:
    """The Hopf point at u with its first Lyapunov coefficient (Kuznetsov 2004, (5.62))."""
    k = len(problem.free)
    second = problem.second(u)
    l1, q, p = first_lyapunov(problem.jacobian(u)[:, k:], second[:, k:, k:], problem.third(u), omega)
    # d lambda = <p, dA q>, dA along the curve per unit of the free variable.
    along = np.einsum("ijl,l->ij", second[:, k:, :], tangent / tangent[0])
    crossing = float(np.vdot(p, along @ q).real)
    coefficients = {"omega": omega, "l1": l1, "crossing": crossing}
    return special_point(problem, u, LossKind.HOPF, coefficients=coefficients, right=q, left=p)


# -- branch points ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class CurveCrossing:
    """What is known of a branch point: the discriminant, and the tangents (2, N) of the curves, or neither."""

    discriminant: float
    directions: np.ndarray


class BranchPoints:
    """Finds branch points by Moore's system {g + alpha w, g_u^T w, w^T w - 1} = 0 in (u, alpha, w).

    It is regular at simple branch points, transcritical or pitchfork (Moore 1980; Govaerts 2000, 8.1). Where the
    curves only come near one another it converges to a point with alpha != 0, off M0.
    """

    def __init__(self, problem: LayerProblem, tracer: PointTracer) -> None:
        self.problem = problem
        self.tracer = tracer

    def __call__(
        self, a: np.ndarray, b: np.ndarray, tangent: np.ndarray, short: bool
    ) -> tuple[np.ndarray, CurveCrossing] | None:
        """The branch point between a and b with its tangents; None when there is none.

        `short` accepts a point of higher order, whose curves are not told apart, in place of none.
        """
        found = self._moore(0.5 * (a + b))
        scales = self.tracer.scales
        self.tracer.counters.located += 1
        if found is not None:
            u, w, size = found
            chord, share = (b - a) / scales, (u - a) / scales
            length = float(np.linalg.norm(chord))
            inside = -0.1 <= float(share @ chord) / length**2 <= 1.1 and np.linalg.norm(share) <= 1.5 * length
            if inside:
                crossing = self._directions(u, w, size, tangent)
                if crossing is not None:
                    return u, crossing
        return (
            (self._turned(a, b, tangent), CurveCrossing(0.0, NONE))
            if short and not self._is_pole(a, b)
            else None
        )

    def _turned(self, a: np.ndarray, b: np.ndarray, tangent: np.ndarray) -> np.ndarray:
        """Where on the chord from a to b the orientation changes: kinks tell no better place."""
        before = self.tracer.orientation(a, tangent)
        for _ in range(np.finfo(float).nmant):
            middle = 0.5 * (a + b)
            a, b = (middle, b) if self.tracer.orientation(middle, tangent) == before else (a, middle)
        return 0.5 * (a + b)

    def _is_pole(self, a: np.ndarray, b: np.ndarray) -> bool:
        """Whether g_u grows towards the place between a and b, where at a branch point its rank falls."""
        near, far = (float(np.linalg.norm(self.problem.jacobian(u))) for u in (a, a + 100.0 * (a - b)))
        # g_u is looked at near a place and a hundred steps before it: where it grows tenfold the field has a pole.
        return not near < 10.0 * far

    def _moore(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        problem, scales, n = self.problem, self.tracer.scales, self.problem.size
        slope = problem.jacobian(u) * scales
        if not np.isfinite(slope).all():
            return None
        # Rates in units of each equation's own variable can be compared, as rates in its numbers cannot.
        unit = scales[-n:]
        size = np.linalg.norm(slope, axis=1) / unit
        size = unit * np.where(size > 1e-3 * size.max(), size, 1e-3 * size.max() or 1.0)
        w = np.linalg.svd(slope / size[:, None])[0][:, -1]
        N, alpha, previous = len(u), 0.0, np.inf
        for _ in range(25):
            value, slope = problem.residual(u) / size, problem.jacobian(u) * scales / size[:, None]
            curved = problem.second(u) * (scales[:, None] * scales) / size[:, None, None]
            if not (np.isfinite(value).all() and np.isfinite(slope).all() and np.isfinite(curved).all()):
                return None
            matrix = np.zeros((N + 1 + n, N + 1 + n))
            matrix[:n, :N], matrix[:n, N], matrix[:n, N + 1 :] = slope, w, alpha * np.eye(n)
            matrix[n : n + N, :N] = np.einsum("i,ijk->jk", w, curved)
            matrix[n : n + N, N + 1 :] = slope.T
            matrix[-1, N + 1 :] = 2.0 * w
            right = np.concatenate([value + alpha * w, slope.T @ w, [w @ w - 1.0]])
            try:
                step = np.linalg.solve(matrix, right)
            except np.linalg.LinAlgError:
                return None
            length = float(np.abs(step).max())
            if not np.isfinite(length) or length > 1e2:
                return None
            u, alpha, w = u - scales * step[:N], alpha - step[N], w - step[N + 1 :]
            if length < 1e-11:
                # A branch point is on the curve when g misses zero there by at most this, in rows of unit
                # slope. At one of higher order, where the system is singular, a step halves the one before.
                return (u, w, size) if abs(alpha) < 1e-11 and length < STAGNANT * previous else None
            previous = length
        return None

    def _directions(
        self, u: np.ndarray, w: np.ndarray, size: np.ndarray, tangent: np.ndarray
    ) -> CurveCrossing | None:
        """Both tangents from the algebraic bifurcation equation w^T g_uu d d = 0 on the kernel of g_u."""
        problem, scales = self.problem, self.tracer.scales
        kernel = np.linalg.svd(problem.jacobian(u) * scales / size[:, None])[2][-2:]
        curved = problem.second(u) * (scales[:, None] * scales) / size[:, None, None]
        form = kernel @ np.einsum("i,ijk->jk", w, curved) @ kernel.T
        values, vectors = np.linalg.eigh(form)
        discriminant = float(-values[0] * values[1])
        if discriminant <= 1e-12 * float(np.abs(curved).max()) ** 2:
            return None
        plus, minus = np.sqrt(-values[0]) * vectors[:, 1], np.sqrt(values[1]) * vectors[:, 0]
        directions = np.array([(plus + minus) @ kernel, (plus - minus) @ kernel])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        own = int(np.argmax(np.abs(directions @ tangent)))
        first, second = directions[own], directions[1 - own]
        # The same null vectors in raw units, of length one.
        left, right = w / size, np.linalg.qr((kernel * scales).T)[0].T
        raw = np.einsum("i,ijk,aj,bk->ab", left / np.linalg.norm(left), problem.second(u), right, right)
        discriminant = float(raw[0, 1] ** 2 - raw[0, 0] * raw[1, 1])
        return CurveCrossing(discriminant, np.array([first * np.sign(first @ tangent), second]))


def branch_point(problem: LayerProblem, u: np.ndarray, crossing: CurveCrossing) -> SpecialPoint:
    """The branch point at u, named by how its curves lie over the free variable."""
    kind, coefficients = LossKind.BRANCH_POINT, {}
    if len(crossing.directions):
        vertical = np.abs(crossing.directions[:, 0]) < VERTICAL
        coefficients = {"discriminant": crossing.discriminant}
        if not vertical.all():
            kind = LossKind.PITCHFORK if vertical.any() else LossKind.TRANSCRITICAL
    return special_point(
        problem, u, kind, coefficients=coefficients, directions=crossing.directions
    )  # fmt: skip
