"""The classical approximations of a slow manifold, point by point: quasi-steady state, ILDM, CSP, Fraser-Roussel.

Each but the first replaces the unknown slope in the invariance equation epsilon Dh f = g: it solves

    g(x, y, epsilon) = epsilon S(x, y, epsilon) f(x, y, epsilon)

for y, with its own S for Dh. They take any number of slow and fast variables and implicit branches.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from math import factorial

import numpy as np
import sympy as sp

from gsp.algebra.differentiation import derivative
from gsp.critical.branch import Branch
from gsp.critical.common_units import common_units
from gsp.lowering.compiled_flow import parameter_vector
from gsp.lowering.compiled_function import CompiledFunction, compile_over
from gsp.slow.chebyshev import ChebyshevSurface, interpolate, nodes
from gsp.slow.slow_track import divide
from gsp.systems.region import Interval
from gsp.systems.system import SlowFastSystem

# Fraser-Roussel iterates are differentiated as Chebyshev interpolants. An axis has FIRST points, then more until h_0 is
# resolved to RESOLVED and h_k to LOSS^k times that (each is felt a factor epsilon less), at most so many in all.
FIRST, RESOLVED, LOSS, MOST_NODES = 9, 1e-13, 100.0, 20_000


@dataclass(frozen=True)
class Points:
    """`y` (m, n_fast), NaN where the method found nothing, and `evaluations` of the model per point.

    One evaluation is one call for the rates, their Jacobian, or one derivative of it along the flow.
    """

    y: np.ndarray
    evaluations: float


class Model:
    """The rates of a system at one epsilon, their Jacobian, and its derivatives along the flow, with a count."""

    def __init__(self, system: SlowFastSystem, epsilon: float) -> None:
        self.system = system
        self.epsilon = epsilon
        self.slow = len(system.x)
        self.evaluations = 0
        self._p = parameter_vector(system, epsilon)
        self._code = _code(system)

    def rates(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """f (m, n_slow) and g (m, n_fast)."""
        self.evaluations += len(z)
        values = self._code.rates(z, self._p)
        return values[:, : self.slow], values[:, self.slow :]

    def jacobians(self, z: np.ndarray, count: int = 1) -> list[np.ndarray]:
        """J, J', J''/2, ... (m, n, n): Taylor coefficients along the flow of the Jacobian of z' = (f, g/epsilon)."""
        self.evaluations += count * len(z)
        n = len(self.system.states)
        return [self._code.along(k)(z, self._p).reshape(-1, n, n) / float(factorial(k)) for k in range(count)]


class _Code:
    """Compiled rates and Lie derivatives of the Jacobian of one system."""

    def __init__(self, system: SlowFastSystem) -> None:
        self._system = system
        self._expressions = [[derivative(rate, s) for rate in system.rates for s in system.states]]
        self._compiled: dict[int, CompiledFunction] = {}

    @cached_property
    def rates(self) -> CompiledFunction:
        return compile_over(self._system, [*self._system.f, *self._system.g])

    def along(self, k: int) -> CompiledFunction:
        """The k-th derivative of the Jacobian's entries along the flow."""
        system = self._system
        if k not in self._compiled:
            while len(self._expressions) <= k:
                last = self._expressions[-1]
                self._expressions.append(
                    [
                        sp.Add(*[derivative(e, s) * rate for s, rate in zip(system.states, system.rates)])
                        for e in last
                    ]
                )
            self._compiled[k] = compile_over(system, self._expressions[k])
        return self._compiled[k]


@lru_cache(maxsize=8)
def _code(system: SlowFastSystem) -> _Code:
    return _Code(system)


def box_around(branch: Branch, x: np.ndarray) -> list[Interval]:
    """The smallest box that contains the points `x` (m, n_slow), widened where it has no width."""
    low, high = x.min(axis=0), x.max(axis=0)
    flat = np.zeros(len(low))
    if not (high > low).all():
        units = common_units(branch.system, np.hstack([x, branch.points(x)]))[: len(low)]
        flat = np.where(high > low, 0.0, 1e-3 * (units + np.abs(low)))
    return [(float(a), float(b)) for a, b in zip(low - flat, high + flat)]


def quasi_steady_state(branch: Branch, x: np.ndarray) -> Points:
    """h_0(x): the fast variables at rest, g(x, y, 0) = 0. In error by O(epsilon)."""
    return Points(branch.points(x), 1.0)


def ildm(branch: Branch, x: np.ndarray, *, epsilon: float) -> Points:
    """The intrinsic low-dimensional manifold: Q F(x, y) = 0, the rows of Q spanning the fast left eigenspace of DF.

    U. Maas and S. B. Pope, Combustion and Flame 88 (1992) 239-264. In error by O(epsilon^2), with a coefficient
    proportional to the curvature of M0 (H. G. Kaper and T. J. Kaper, Physica D 165 (2002) 66-93).
    """
    model = Model(branch.system, epsilon)
    fast = len(branch.system.y)

    def slope(z: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        values, vectors = np.linalg.eig(np.swapaxes(jacobian, 1, 2))
        order = np.argsort(-np.abs(values), axis=1)[:, :fast]
        rows = np.swapaxes(np.take_along_axis(vectors, order[:, None, :], axis=2), 1, 2)
        # Scaled so that Q = (K, 1): the condition is then g = -epsilon K f.
        return -np.real(_quotient(rows[:, :, model.slow :], rows[:, :, : model.slow]))

    return _solved(model, x, branch.points(x), slope)


def csp(branch: Branch, x: np.ndarray, *, epsilon: float, refinements: int) -> Points:
    """Computational singular perturbation with q two-sided refinements: the fast amplitudes B_f F(x, y) vanish.

    S. H. Lam and D. A. Goussis, International Journal of Chemical Kinetics 26 (1994) 461-486. The CSP manifold of
    order q agrees with M_epsilon through epsilon^q, so that its error is O(epsilon^(q+1)) (A. Zagaris, H. G. Kaper
    and T. J. Kaper, Journal of Nonlinear Science 14 (2004) 59-91, theorem 3.1); q = 0 with the coordinate basis is g =
    0. The refined basis is evaluated at the point itself; there it is at the manifold of order q - 1, which
    changes terms of O(epsilon^(q+1)) only.
    """
    model = Model(branch.system, epsilon)

    def slope(z: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        if refinements == 0:
            return np.zeros((len(z), len(branch.system.y), model.slow))
        taylor = [jacobian, *model.jacobians(z, refinements)[1:]] if refinements > 1 else [jacobian]
        rows = _refined(taylor, model.slow, refinements)
        return -_quotient(rows[:, :, model.slow :], rows[:, :, : model.slow])

    return _solved(model, x, branch.points(x), slope)


@dataclass(frozen=True, eq=False)
class FraserRoussel:
    """Functional iteration of the invariance equation: g(x, h_(k+1), epsilon) = epsilon Dh_k f(x, h_(k+1), epsilon).

    S. J. Fraser, Journal of Chemical Physics 88 (1988) 4732-4738; M. R. Roussel and S. J. Fraser, ibid. 93 (1990)
    1072-1081. From h_0 on M0 the k-th iterate is in error by O(epsilon^(k+1)) (Kaper and Kaper 2002). Derivatives are
    those of Chebyshev interpolants, so that the iterates h_0 to h_(k-1) at one epsilon are `surfaces` on one grid over
    a box, of one to three slow variables.

    `evaluations` of the model were spent on them; `resolved` says whether `MOST_NODES` points were enough.
    """

    branch: Branch
    epsilon: float
    surfaces: tuple[ChebyshevSurface, ...]
    evaluations: int
    resolved: bool

    @staticmethod
    def over(
        branch: Branch, x: np.ndarray, *, epsilon: float, iterates: int, dropped: float = 10.0
    ) -> FraserRoussel:
        """On the box that contains the points `x` (m, n_slow), for iterates through `iterates`.

        Coefficients below `dropped` roundings a point count as rounding.
        """
        model = Model(branch.system, epsilon)
        box = np.array(box_around(branch, x))
        surfaces, resolved = _iterated(branch, model, box, iterates - 1, dropped) if iterates else ([], True)
        return FraserRoussel(branch, epsilon, tuple(surfaces), model.evaluations, resolved)

    def points(self, x: np.ndarray, iterate: int) -> Points:
        """h_k at points of the box, k from 0 to the number of surfaces."""
        if iterate == 0:
            return quasi_steady_state(self.branch, x)
        model = Model(self.branch.system, self.epsilon)
        slopes = self.surfaces[iterate - 1].derivative(x)
        return _solved(model, x, self.branch.points(x), lambda z, jacobian: slopes)

    def noise(self, x: np.ndarray) -> list[float]:
        """How far h_0, h_1, ... at the points that span the box move when one digit more counts as rounding."""
        iterates = len(self.surfaces)
        other = FraserRoussel.over(self.branch, x, epsilon=self.epsilon, iterates=iterates, dropped=100.0)
        return [float(np.abs(self.points(x, k).y - other.points(x, k).y).max()) for k in range(iterates + 1)]


def _iterated(
    branch: Branch, model: Model, box: np.ndarray, iterates: int, dropped: float
) -> tuple[list[ChebyshevSurface], bool]:
    """Interpolants of the iterates h_0 to h_k on a grid fine enough for all of them, if it may be so fine."""
    sizes = [FIRST] * len(box)
    while True:
        grid, start = _resting(branch, tuple(map(tuple, box.tolist())), tuple(sizes))
        y = start
        finer, surfaces, resolved = sizes, [], True
        for k in range(iterates + 1):
            surface = interpolate(box, y.reshape(*sizes, -1))
            scale = float(np.abs(y).max()) or 1.0
            rough = surface.tails() > RESOLVED * LOSS**k * scale
            finer = [2 * n - 1 if r else n for n, r in zip(sizes, rough)]
            if rough.any() and np.prod(finer) <= MOST_NODES:
                break
            finer, resolved = sizes, resolved and not rough.any()
            # Coefficients of the size of rounding are dropped before differentiating.
            surface = surface.chopped(dropped * np.finfo(float).eps * scale * max(sizes))
            surfaces.append(surface)
            if k < iterates:
                slopes = surface.slopes(sizes).reshape(*start.shape, -1)
                y = _solved(model, grid, start, lambda z, jacobian, S=slopes: S).y
        if finer == sizes:
            return surfaces, resolved
        sizes = finer


# As many grids as one box goes through: those of one epsilon serve the next.
@lru_cache(maxsize=16)
def _resting(
    branch: Branch, box: tuple[tuple[float, float], ...], sizes: tuple[int, ...]
) -> tuple[np.ndarray, np.ndarray]:
    """A grid (m, n_slow) over the box and M0 over it (m, n_fast), which are the same at every epsilon."""
    grid = nodes(np.array(box), sizes).reshape(-1, len(box))
    return grid, branch.points(grid)


def _refined(jacobian: list[np.ndarray], slow: int, refinements: int) -> np.ndarray:
    """B_f (m, n_fast, n) after `refinements` steps from the coordinate basis, the Jacobian's Taylor series given.

    Lambda = B J A + B' A;  U = Lambda_ff^-1 Lambda_fs,  L = Lambda_sf Lambda_ff^-1;
    B <- (1 - L)(1 + U) B,  A <- A (1 - U)(1 + L). Each step needs B' and so takes one Taylor coefficient.
    """
    m, n, _ = jacobian[0].shape
    identity = np.eye(n)
    depth = len(jacobian)

    def constant(matrix: np.ndarray) -> list[np.ndarray]:
        return [np.broadcast_to(matrix, (m, *matrix.shape))] + [
            np.zeros((m, *matrix.shape)) for _ in range(depth - 1)
        ]

    Bs, Bf = constant(identity[:slow]), constant(identity[slow:])
    As, Af = constant(identity[:, :slow]), constant(identity[:, slow:])
    for step in range(refinements):
        # A refinement knows one derivative less than the one before.
        keep = depth - step
        mid_f = [a + b for a, b in zip(_product(Bf, jacobian, keep), _rate(Bf, keep))]
        mid_s = [a + b for a, b in zip(_product(Bs, jacobian, keep), _rate(Bs, keep))]
        inverse = _inverse(_product(mid_f, Af, keep))
        U = _product(inverse, _product(mid_f, As, keep), keep)
        L = _product(_product(mid_s, Af, keep), inverse, keep)
        Bf = [b + c for b, c in zip(Bf, _product(U, Bs, keep))]
        Bs = [b - c for b, c in zip(Bs, _product(L, Bf, keep))]
        As = [a - c for a, c in zip(As, _product(Af, U, keep))]
        Af = [a + c for a, c in zip(Af, _product(As, L, keep))]
    return Bf[0]


def _product(a: list[np.ndarray], b: list[np.ndarray], keep: int) -> list[np.ndarray]:
    return [sum((a[i] @ b[k - i] for i in range(k + 1)), start=np.zeros(())) for k in range(keep)]


def _rate(a: list[np.ndarray], keep: int) -> list[np.ndarray]:
    """Taylor coefficients of a', one unknown one at the end left out as 0."""
    return [(k + 1) * a[k + 1] if k + 1 < len(a) else np.zeros_like(a[0]) for k in range(keep)]


def _inverse(a: list[np.ndarray]) -> list[np.ndarray]:
    first = _quotient(a[0], np.broadcast_to(np.eye(a[0].shape[-1]), a[0].shape))
    result = [first]
    for k in range(1, len(a)):
        result.append(-first @ sum((a[i] @ result[k - i] for i in range(1, k + 1)), start=np.zeros(())))
    return result


def _quotient(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """A^-1 B for stacks of matrices, NaN where A is singular; which few are, so that each is looked at only then."""
    try:
        return np.linalg.solve(matrices, right)
    except np.linalg.LinAlgError:
        return divide(matrices, right)


def _solved(
    model: Model,
    x: np.ndarray,
    y: np.ndarray,
    slope: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> Points:
    """g = epsilon S f for y by Newton's method with S held fixed in each step's derivative.

    NaN where that ends without a root, as where a matrix is singular on the way.
    """
    slow, epsilon = model.slow, model.epsilon
    y = y.copy()
    units = common_units(model.system, np.hstack([x, y]))[slow:]
    lost = np.zeros(len(y), dtype=bool)
    for _ in range(80):
        z = np.hstack([x, y])
        f, g = model.rates(z)
        jacobian = model.jacobians(z)[0]
        lost |= ~np.isfinite(jacobian).all(axis=(1, 2))
        jacobian[lost] = np.eye(z.shape[1])
        S = slope(z, jacobian)
        defect = g - epsilon * np.einsum("mij,mj->mi", S, f)
        matrix = epsilon * (jacobian[:, slow:, slow:] - S @ jacobian[:, :slow, slow:])
        step = _quotient(matrix, defect[:, :, None])[:, :, 0]
        lost |= ~np.isfinite(step).all(axis=1)
        # What is lost stays where it is.
        y = y - np.where(lost[:, None], 0.0, step)
        size = np.where(lost, np.nan, np.abs(step / units).max(axis=1) / (1.0 + np.abs(y / units).max(axis=1)))
        # A correction this small relative to 1 + |y|, in common units, ends the iteration.
        if not (size > 2 * np.finfo(float).eps).any():
            break
    bad = ~(size < 1e-9)
    y[bad] = np.nan
    return Points(y, model.evaluations / len(x))
