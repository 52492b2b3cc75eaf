"""Where a branch meets the switching surfaces of functions that are not smooth, and how rough the field is there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gsp.algebra.differentiation import derivative
from gsp.algebra.switching_functions import SwitchingFunction, switches
from gsp.critical.loss_kind import LossKind
from gsp.hyperbolicity.losses.consequences import LossConsequence
from gsp.hyperbolicity.losses.diagnosis import Diagnosis
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.poles import is_above_zero
from gsp.hyperbolicity.losses.roots import gauss_newton

# A switching function is zero on the branch below this, relative to its largest value over the samples.
ZERO_SWITCH = 1e-12
# Distance from the surface at which the two sides are compared.
SIDE = 1e-6
# Each step is so much nearer to the surface.
NEARER = 1e-2


def meetings(
    diagnosis: Diagnosis, z: np.ndarray, links: tuple[np.ndarray, np.ndarray]
) -> tuple[list[Loss], list[SwitchingFunction]]:
    """A loss for every switching surface that the branch meets, and the switches that it does not meet."""
    sampler = diagnosis.sampler
    found, unmet = [], []
    values = dict(sampler.system.parameters)
    for switch in switches([*sampler.f, *sampler.g], sampler.system.states):
        if is_above_zero(switch.surface.xreplace(values)):
            continue
        points, lies_in_it = _located(diagnosis, switch, z, links)
        if len(points):
            found.append(_loss(diagnosis, switch, points, lies_in_it))
        else:
            unmet.append(switch)
    return found, unmet


def _located(
    diagnosis: Diagnosis, switch: SwitchingFunction, z: np.ndarray, links: tuple[np.ndarray, np.ndarray]
) -> tuple[np.ndarray, bool]:
    sampler, nx = diagnosis.sampler, diagnosis.nx
    function = sampler.compiled([switch.surface])
    lows = np.array([diagnosis.box[s.name][0] for s in sampler.system.x])

    def values(points: np.ndarray) -> np.ndarray:
        return function(points, sampler.p)[:, 0]

    sizes = values(z)
    largest = float(np.nanmax(np.abs(sizes), initial=0.0))
    # Beside the branch, over the region, the function is of this size; on it, it may vanish altogether. Outside the
    # region an exponential may be of any size.
    numbers = np.random.default_rng(0)
    over = lows + numbers.random((len(z), nx)) * diagnosis.widths
    moved = np.hstack(
        [over, z[:, nx:] + numbers.uniform(-1.0, 1.0, (len(z), z.shape[1] - nx)) * diagnosis.units[nx:]]
    )
    around = values(moved)
    typical = float(np.max(np.abs(around[np.isfinite(around)]), initial=0.0))
    if largest <= ZERO_SWITCH * max(typical, 1e-300):
        return z[len(z) // 2][None, :], True
    a, b = links
    changed = np.sign(values(a)) * np.sign(values(b)) < 0
    changed_rows = np.flatnonzero(changed)
    chosen = changed_rows[np.linspace(0, len(changed_rows) - 1, min(len(changed_rows), 24)).astype(int)]
    points = [_bisected(diagnosis, values, a[chosen], b[chosen])] if len(chosen) else []
    points.append(z[np.abs(sizes) <= ZERO_SWITCH * largest][:24])
    if not sum(map(len, points)):
        points.append(_touched(diagnosis, switch, values, z[np.argsort(np.abs(sizes))[:6]]))
    return np.vstack(points), False


def _bisected(diagnosis: Diagnosis, values, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Zeros of the switching function between linked points of one sheet, by bisection in x."""
    sampler, sign = diagnosis.sampler, np.sign(values(a))
    found, _ = sampler.bisected(a, b, lambda z: np.sign(values(z)) == sign)
    return found[sampler.inside(found, diagnosis.box)]


def _touched(diagnosis: Diagnosis, switch: SwitchingFunction, values, starts: np.ndarray) -> np.ndarray:
    """Zeros next to `starts` that the function touches or that lie between the samples."""
    sampler, branch = diagnosis.sampler, diagnosis.sampler.branch
    slope = sampler.compiled([derivative(switch.surface, s) for s in sampler.system.states])

    def evaluate(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        point = u[None, :]
        equations = np.append(branch.residual(point)[0], values(point))
        return equations, np.vstack([branch.full_jacobian(point)[0], slope(u, sampler.p)])

    found = [(start, point) for start in starts if (point := gauss_newton(evaluate, start)) is not None]
    starts, points = np.array(found).reshape(-1, 2, starts.shape[1]).swapaxes(0, 1)
    # Newton's method may have come to another sheet, from which the field jumps.
    reached, _ = sampler.bisected(starts, points, lambda z: np.ones(len(z), dtype=bool))
    on_sheet = (np.abs(reached - points) <= SIDE * diagnosis.units).all(axis=1)
    return points[on_sheet & sampler.inside(points, diagnosis.box)][:1]


def _loss(diagnosis: Diagnosis, switch: SwitchingFunction, points: np.ndarray, lies_in_it: bool) -> Loss:
    sampler = diagnosis.sampler
    z = points[len(points) // 2]
    slopes = sampler.compiled([derivative(switch.surface, s) for s in sampler.system.states])
    units = diagnosis.units
    # Across the surface in the states' own sizes, so that the sides are the same in whatever units states are given.
    normal = slopes((z + SIDE * units)[None, :], sampler.p)[0] * units
    length = float(np.linalg.norm(normal))
    step, jumps, endless = np.zeros_like(z), (0.0, 0.0), False
    if np.isfinite(length) and length > 0.0:
        step = SIDE * units * normal / length
        jumps = _jumps(diagnosis, z - step, z + step)
        endless = _grows(diagnosis, z, step)
    contact = Contact.SWITCH
    coefficients = {} if endless else {"jump": jumps[0], "kink": jumps[1]}
    if endless:
        verdict = LossConsequence(
            "the Jacobian grows without bound, and so do the terms of the series from the first on: the slow manifold "
            "is not smooth up to the surface",
            False,
            "keep the region off the surface",
        )
    elif jumps[0]:
        verdict = LossConsequence(
            "the rates jump: orbits cross or slide along the surface, and no slow manifold goes through it",
            False,
            "use one smooth piece on each side, or Filippov's rule on the surface",
        )
    elif jumps[1] and switch.surface.has(*sampler.system.y) and _turns(diagnosis, z - step, z + step):
        contact = Contact.JUMP
        verdict = LossConsequence(
            "an eigenvalue jumps through 0: two sheets of M0 meet there, at a corner, and orbits that reach it may "
            "leave along the fast fibre",
            False,
            "shrink the region to one side of it, and integrate the full system across",
        )
    elif jumps[1]:
        verdict = LossConsequence(
            "the Jacobian jumps: the slow manifold is continuous with a kink; an orbit that crosses it is off by order "
            "epsilon^2 beyond it, and in the fast variables by order epsilon next to it, at every order from the first "
            "on",
            True,
            "through order 1, as further ones gain no power of epsilon; or expand on each side by itself",
        )
    else:
        verdict = LossConsequence(
            "a derivative of higher order jumps or does not exist: the series loses that many orders near the surface",
            True,
            "to low order, or on each side by itself",
        )
    note = f"{switch.source} switches at {switch.surface} = 0" + (
        ", in which the whole branch lies" if lies_in_it else ""
    )
    loss = diagnosis.loss(
        z,
        contact,
        LossKind.NON_SMOOTH,
        str(switch.surface),
        float(sampler.compiled([switch.surface])(z[None, :], sampler.p)[0, 0]),
        verdict,
        coefficients=coefficients,
        note=note,
    )
    names = [s.name for s in sampler.system.x]
    extent = {name: (float(points[:, i].min()), float(points[:, i].max())) for i, name in enumerate(names)}
    return replace(loss, samples=len(points), extent=extent)


def _grows(diagnosis: Diagnosis, z: np.ndarray, step: np.ndarray) -> bool:
    """Whether the Jacobian of (f, g) at z + s step, on a side where it is finite, grows without bound as s falls."""
    for side in (step, -step):
        jacobians = diagnosis.sampler.jacobians(
            np.array([z + share * side for share in (1.0, NEARER, NEARER**2)])
        )
        sizes = np.abs(jacobians).max(axis=tuple(range(1, jacobians.ndim)))
        # It is unbounded when it doubles at every step towards the surface.
        if np.isfinite(sizes).all() and (sizes[1:] > 2.0 * sizes[:-1]).all():
            return True
    return False


def _turns(diagnosis: Diagnosis, before: np.ndarray, after: np.ndarray) -> bool:
    """Whether det g_y has different signs on the two sides of a surface that the fast variables cross."""
    first, second = np.sign(np.linalg.det(diagnosis.sampler.fast_jacobian(np.vstack([before, after]))))
    return bool(first * second < 0.0)


def _jumps(diagnosis: Diagnosis, before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Jumps of (f, g) and of its Jacobian from one side to the other; 0 where smoothness alone explains them."""
    pair = np.vstack([before, after])
    rates = diagnosis.sampler.rates(pair)
    jacobians = diagnosis.sampler.jacobians(pair)
    if not (np.isfinite(rates).all() and np.isfinite(jacobians).all()):
        return (0.0, 0.0)
    # Each rate by itself, as states in other units have rates and slopes of other sizes.
    sized = jacobians * diagnosis.units
    size = np.abs(sized).max(axis=(0, 2))
    jump, kink = np.abs(rates[1] - rates[0]), np.abs(jacobians[1] - jacobians[0]).max(axis=1)
    # Over a distance SIDE a smooth field changes by SIDE times its Jacobian.
    far = float(np.linalg.norm((after - before) / diagnosis.units))
    # A kink is a change of the derivatives by this share.
    return (
        float(np.max(jump, initial=0.0, where=jump > 10.0 * size * far * np.sqrt(len(before)))),
        float(np.max(kink, initial=0.0, where=np.abs(sized[1] - sized[0]).max(axis=1) > 1e-3 * size)),
    )
