"""A loss of stability that a reduced orbit meets along a branch that goes on, and what it lets happen.

With u = l . (y - h_0) the deviation along the critical direction of a real loss at t = 0,

    epsilon u' = kappa t u + q u^2 + p u^3 + epsilon rho + ...,   q = l . g_yy(r, r)/2,                        (1)

where rho = l . (g_1 - Dh_0 f) says how far the branch is from invariant. If the branch is invariant for epsilon > 0 the
exit is delayed. If rho != 0 it is not:

- q != 0, transcritical: with X = q u + kappa t/2, Y = kappa t/2 this is
  epsilon X' = X^2 - Y^2 + lambda epsilon kappa/2, lambda = 1 + 2 q rho/kappa; lambda < 1 exchanges stability with the
  other branch, lambda > 1 escapes at t = z (2 epsilon/kappa)^(1/2), z the first zero of the parabolic cylinder function
  D_((lambda - 1)/2)(-sqrt(2) z), and lambda = 1 is the canard value (Krupa and
  Szmolyan, Nonlinearity 14 (2001) 1473-1491);
- q = 0, p < 0, supercritical pitchfork: the orbit settles on the branch on the side of rho (the same);
  p > 0: it escapes to that side.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
import sympy as sp

from gsp.algebra.laurent import laurent
from gsp.critical.layer_problem import LayerProblem, eigenvalue_sizes, sizes_beside
from gsp.critical.loss_kind import LossKind
from gsp.critical.normal_forms import bordered, significant
from gsp.errors import GspError
from gsp.hyperbolicity.losses.zeros import ZERO_SINGULAR
from gsp.roots import root
from gsp.singular.passage.complex_time import TurningPoint, turning_points
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_passage import ZERO
from gsp.singular.passage.slow_orbit import SlowOrbit
from gsp.slow.series import expand
from gsp.systems.flow import check_epsilon, in_words

# Zeros of the parabolic cylinder function are looked for up to here: exp(-z^2) is rounding by then.
FARTHEST = 6.5
# Orders of the formal slow manifold that are searched for a pole at the loss.
ORDERS = 6


class Outcome(StrEnum):
    """What follows a loss."""

    DELAY = "delayed exit"
    EXCHANGE = "exchange of stability"
    ESCAPE = "escape at once"
    UNDECIDED = "undecided at this order"


@dataclass(frozen=True, eq=False, repr=False)
class PassedLoss:
    """A loss met at slow time `t` at `point`: its `kind`, the critical `eigenvalue`, its `crossing` rate d Re/dt.

    `outcome` says what follows, `limit` the amount that int Re lambda dt can grow from here before orbits leave,
    whatever their start: 0 where they leave at once, infinite where only the start counts. For a real loss
    `coefficients` are q, p and rho of (1), and lambda; for a pair `turning_points` are those that were found.
    """

    t: float
    point: Mapping[str, float]
    kind: LossKind
    eigenvalue: complex
    crossing: float
    outcome: Outcome
    limit: float
    coefficients: Mapping[str, float]
    turning_points: tuple[TurningPoint, ...] = ()

    def escape(self, epsilon: float) -> float | None:
        """Slow time of an escape from a transcritical loss to leading order, O(epsilon^(1/2)) after it; else None."""
        small = check_epsilon(epsilon)
        value = self.coefficients.get("lambda", 0.0)
        if self.outcome is not Outcome.ESCAPE or not value > 1.0:
            return None
        z = first_zero(value)
        return None if z is None else self.t + z * float(np.sqrt(2.0 * small / self.crossing))

    def __str__(self) -> str:
        rest = in_words(self.coefficients, 5)
        return f"{self.kind} at {in_words(self.point, 8)}: {self.outcome}" + (f" ({rest})" if rest else "")

    def __repr__(self) -> str:
        return f"PassedLoss({self})"


def first_zero(value: float) -> float | None:
    """The first zero of D_((value - 1)/2)(-sqrt(2) z), None when it is beyond rounding."""
    from scipy.special import pbdv

    order = 0.5 * (value - 1.0)
    # Beside whole orders SciPy's function is wrong in its second digit; there the zero moves by half of what they do.
    if abs(order - round(order)) < np.sqrt(np.finfo(float).eps):
        order = float(round(order))
    z = np.linspace(-FARTHEST, FARTHEST, 2000)
    values = pbdv(order, -np.sqrt(2.0) * z)[0]
    change = np.flatnonzero(np.sign(values[1:]) != np.sign(values[:-1]))
    if not change.size:
        return None
    i = int(change[0])
    return root(lambda s: float(pbdv(order, -np.sqrt(2.0) * s)[0]), float(z[i]), float(z[i + 1]))


def passed_loss(orbit: SlowOrbit, t: float, crossing: float, *, invariant: bool, which: int = 0) -> PassedLoss:
    """The loss at time `t`, where the real part `which`, counted from the right, rises through 0 at `crossing`."""
    z = orbit.at(t)
    path = np.vstack([panel.z for panel in orbit.panels])
    sizes = orbit.units + np.abs(path).max(axis=0)
    point = orbit.named(z, 1e-14 * sizes)
    values = orbit.eigenvalues(z[None, :])[0]
    beside = sizes_beside(eigenvalue_sizes(orbit.eigenvalues(path)), values)
    leading = complex(values[which])
    is_pair = abs(leading.imag) > 1e-6 * beside[which] and abs(leading.imag) > 1e-9 * orbit.rate
    # As `classify` takes an eigenvalue to be on the axis.
    together = int((np.abs(values.real) <= ZERO_SINGULAR * beside).sum()) > (2 if is_pair else 1)
    if is_pair and not together:
        found: list[TurningPoint] = []
        if not invariant:
            with np.errstate(all="ignore"):
                found = turning_points(orbit, t, leading)
        limit = found[0].level if found else float("inf")
        return PassedLoss(
            t,
            point,
            LossKind.HOPF,
            leading,
            crossing,
            Outcome.DELAY,
            limit,
            {"omega": leading.imag},
            tuple(found),
        )
    speed = float(np.abs(np.real(orbit.eigenvalues(path)[:, which])).max()) / orbit.time
    if together or crossing <= np.sqrt(np.finfo(float).eps) * speed:
        # A zero of the order k is known to the k-th root of rounding, and no coefficient of it is.
        near = _near(orbit, z, sizes)
        if not invariant:
            shown = in_words(near, 4)
            raise _undecided(
                f"several eigenvalues rise through 0 together near {shown}"
                if together
                else f"the rightmost eigenvalue rises through 0 near {shown} with no speed, to a higher order"
            )
        none = float("inf")
        rate = crossing if together else 0.0
        return PassedLoss(t, near, LossKind.DEGENERATE, leading.real + 0j, rate, Outcome.DELAY, none, {})
    coefficients = _real_coefficients(orbit, z, crossing)
    transcritical = "lambda" in coefficients
    kind = LossKind.TRANSCRITICAL if transcritical else LossKind.PITCHFORK
    if not transcritical and coefficients["p"] == 0.0:
        kind = LossKind.BRANCH_POINT
    rho = coefficients["rho"]
    if invariant:
        outcome, limit = Outcome.DELAY, float("inf")
    else:
        if rho == 0.0:
            coefficients |= _higher_order(orbit, t, z, crossing)
            rho = coefficients.get("rho_k", 0.0)
        softens = coefficients["q"] * rho < 0.0 if transcritical else coefficients["p"] < 0.0
    if not invariant and rho == 0.0:
        outcome, limit = Outcome.UNDECIDED, float("inf")
    elif not invariant:
        outcome, limit = (Outcome.EXCHANGE if softens else Outcome.ESCAPE), 0.0
    return PassedLoss(t, point, kind, leading.real + 0j, crossing, outcome, limit, coefficients)


def check_touching(orbit: SlowOrbit, t: float) -> None:
    """Raise `PassageError` where orbits may leave at `t`, where the rightmost eigenvalue comes up to 0 and falls again.

    There epsilon u' = -s(t) u + q u^2 + p u^3 + epsilon rho with s >= 0: without a root beside s = 0 where q rho > 0.
    """
    z = orbit.at(t)
    if orbit.eigenvalues(z[None, :])[0, 0].imag:
        return
    found = _real_coefficients(orbit, z, 0.0)
    stays = found["q"] * found["rho"] < 0.0 if found["q"] else found["p"] < 0.0
    if not stays:
        path = np.vstack([panel.z for panel in orbit.panels])
        shown = in_words(_near(orbit, z, orbit.units + np.abs(path).max(axis=0)), 4)
        raise _undecided(f"the rightmost eigenvalue comes up to 0 near {shown} and falls again")


def _near(orbit: SlowOrbit, z: np.ndarray, sizes: np.ndarray) -> dict[str, float]:
    """A place that is known to a root of rounding, by name."""
    return orbit.named(np.round(z / sizes, 3) * sizes + 0.0)


def _undecided(why: str) -> PassageError:
    return PassageError(
        f"{why}, and the branch is not invariant: how it is left is not decided here.", "Run the full system."
    )


def _real_coefficients(orbit: SlowOrbit, z: np.ndarray, crossing: float) -> dict[str, float]:
    """q, p, rho of (1), and lambda where q and `crossing` are not 0; what is zero within rounding is 0."""
    system = orbit.branch.system
    m, n = len(system.x), len(system.y)
    problem = LayerProblem.over_all(system)
    # All of it with the fast variables in their units; r and l are of the plain length 1 at the end.
    unit = orbit.units[m:]
    g_y = orbit.fast_jacobian(z) * unit / unit[:, None]
    left, _, right = np.linalg.svd(g_y)
    r, l = right[-1], left[:, -1]  # noqa: E741
    r = r * np.sign(r[np.argmax(np.abs(unit * r))])
    product = float(l @ r)
    l = l / product if abs(product) > 1e-12 else l  # noqa: E741
    second = problem.second(z)[:, m:, m:] * unit[:, None] * unit / unit[:, None, None]
    bending = np.einsum("ijk,j,k->i", second, r, r)
    size = float(np.linalg.norm(l))
    path = np.vstack([panel.z for panel in orbit.panels])
    third = problem.third(z).in_units(unit)
    # At the loss, or all along the branch, second derivatives may be rounding; third ones say of which size.
    bent = np.abs(third.values).max(initial=0.0) * np.abs(path[:, m:] / unit).max()
    q = significant(0.5 * float(l @ bending), size * float(max(bent, np.abs(second).max())), zero=ZERO)
    h = np.linalg.lstsq(bordered(g_y, r, l), np.append(2.0 * q * r - bending, 0.0), rcond=None)[0][:n]
    cubic = third(r, r, r) / 6.0 + 0.5 * np.einsum("ijk,j,k->i", second, r, h)
    terms = size * float(np.abs(third.values).max(initial=0.0) + np.abs(second).max() ** 2)
    p = significant(float(l @ cubic), terms, zero=ZERO)
    rates = [laurent(g, system.epsilon, order=1).get(1, sp.Integer(0)) for g in system.g]
    first, constants = orbit.sampler.compiled(rates), orbit.sampler.p
    moved = orbit.velocity(z)[m:]
    # What rho is made of along the orbit so far: at the loss alone all of it may be small.
    typical = np.abs(first(path, constants) / unit).max() + max(
        np.abs(orbit.velocity(point)[m:] / unit).max() for point in path[::8]
    )
    rho = significant(float(l @ ((first(z, constants) - moved) / unit)), size * float(typical), zero=ZERO)
    length = float(np.linalg.norm(unit * r))
    result = {"q": q / length, "p": p / length**2, "rho": rho * length}
    if q != 0.0 and crossing != 0.0:
        result["lambda"] = 1.0 + 2.0 * q * rho / crossing
    return result


def _higher_order(orbit: SlowOrbit, t: float, z: np.ndarray, crossing: float) -> dict[str, float]:
    """The first order k >= 2 at which the formal slow manifold has a pole at the loss, and rho_k = -kappa s l . h_k.

    At a distance s from the loss h_k is -rho_k/(kappa s) to leading order: a pole is told by growth tenfold when s
    falls tenfold. Empty when there is none up to ORDERS: all those orders pass through the loss.
    """
    system = orbit.branch.system
    m = len(system.x)
    unit = orbit.units[m:]
    left, _, right = np.linalg.svd(orbit.fast_jacobian(z) * unit / unit[:, None])
    l = left[:, -1] / unit * np.sign(float(left[:, -1] @ right[-1]) or 1.0)  # noqa: E741
    try:
        series = expand(orbit.branch, order=ORDERS, symbolic=False)
        sizes = []
        # Distances from the loss, as shares of the time in which the orbit gets somewhere.
        for share in (1e-2, 1e-3):
            point = orbit.at(t - share * orbit.time)
            near = None if orbit.branch.is_explicit else point[m:]
            sizes.append(
                share * (np.asarray(series.terms(point[:m], 1.0, near=near)).reshape(ORDERS + 1, -1) @ l)
            )
    except GspError:
        return {}
    far, close = sizes
    for k in range(2, ORDERS + 1):
        if abs(close[k]) > 0.3 * abs(far[k]) and abs(close[k]) > 1e-10:
            # At t - s the denominator kappa t is negative.
            length = float(np.linalg.norm(unit * right[-1]))
            return {"order": float(k), "rho_k": float(crossing * orbit.time * close[k] * length)}
    return {}
