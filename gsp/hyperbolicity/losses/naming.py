"""`name_loss`: the loss at a place that the search met; Hopf points, neutral saddles and poles."""

from __future__ import annotations

import numpy as np

from gsp.critical.continuation.special_points import most_opposite
from gsp.critical.loss_kind import LossKind
from gsp.critical.normal_forms import ZERO_TERM, first_lyapunov
from gsp.hyperbolicity.losses import consequences
from gsp.hyperbolicity.losses.diagnosis import Diagnosis, Found
from gsp.hyperbolicity.losses.kinds import Contact, Loss
from gsp.hyperbolicity.losses.zeros import ZERO_SINGULAR, zero


def name_loss(diagnosis: Diagnosis, found: Found) -> Loss:
    """The named loss at a place that the search met."""
    z, crossing = found
    if crossing is Contact.BRANCH_POLE:
        return diagnosis.loss(
            z, crossing, LossKind.BRANCH_POLE, "denominator of the branch", 0.0, consequences.BRANCH_POLE
        )
    if crossing is Contact.FIELD_POLE:
        return diagnosis.loss(
            z, crossing, LossKind.FIELD_POLE, "denominator of the field", 0.0, consequences.FIELD_POLE
        )
    if crossing is Contact.PAIR:
        return pair(diagnosis, z)
    if crossing is Contact.SUM:
        total = float(abs(sum(most_opposite(diagnosis.sampler.eigenvalues(z[None, :])[0]))))
        return diagnosis.loss(
            z,
            crossing,
            LossKind.NEUTRAL_SADDLE,
            "sum of two real eigenvalues",
            total,
            consequences.NEUTRAL_SADDLE,
        )
    if crossing is Contact.JUMP:
        value = float(np.abs(diagnosis.sampler.eigenvalues(z[None, :])[0].real).min())
        return diagnosis.loss(z, crossing, LossKind.NON_SMOOTH, "least |Re lambda|", value, consequences.JUMP)
    values = diagnosis.sampler.eigenvalues(z[None, :])[0]
    # Beside a much larger eigenvalue the search takes a pair for a zero.
    if not diagnosis.near_zero(values).any() and (values.imag != 0.0).any():
        return pair(diagnosis, z)
    return zero(diagnosis, z)


def pair(diagnosis: Diagnosis, z: np.ndarray) -> Loss:
    """The loss at z, where a pair of eigenvalues is imaginary."""
    at = diagnosis.local(z)
    values = np.linalg.eigvals(at.A)
    test = "least |Re lambda| of a pair"
    # The bisection for it ends where rounding does; multiple pairs spread like a root of that.
    sizes = diagnosis.sizes_beside(values)
    axis = np.abs(values.real) <= ZERO_SINGULAR * sizes
    value = float(np.abs(values.real).min())
    if axis.sum() != 2 or not at.is_finite:
        text = "derivatives do not exist here" if not at.is_finite else f"{axis.sum()} eigenvalues on the axis"
        return diagnosis.loss(
            z, Contact.PAIR, LossKind.DEGENERATE, test, value, consequences.DEGENERATE, note=text
        )
    size = float(sizes[axis].max())
    omega = float(np.abs(values[axis].imag).max())
    l1, q, p = first_lyapunov(at.A, at.g_yy, at.third, omega)
    coefficients = {"omega": omega, "l1": l1}
    slope = np.linalg.solve(at.A, at.g_x)
    tangents = np.vstack([np.eye(diagnosis.nx), -slope])
    changes = [float(np.vdot(p, (at.second[:, diagnosis.nx :, :] @ t) @ q).real) for t in tangents.T]
    change = float(np.abs(changes) @ diagnosis.widths)
    speed = float(np.dot(changes, at.slow))
    notes = []
    if change <= ZERO_TERM * size:
        notes.append("the pair touches the axis and does not cross it to first order")
    elif abs(speed) <= ZERO_TERM * float(np.abs(changes) @ diagnosis.fastest):
        notes.append("the slow flow is tangent to the place, or vanishes there")
        coefficients["crossing"] = 0.0
    else:
        coefficients["crossing"] = speed
    if l1 == 0.0:
        notes.append("l1 = 0: degenerate, higher terms decide on the cycles")
    others = int((values.real > ZERO_SINGULAR * sizes).sum())
    if others:
        notes.append(f"{others} of the other fast directions are unstable, so orbits leave anyway")
    kind = LossKind.HOPF if change > ZERO_TERM * size else LossKind.DEGENERATE
    verdict = consequences.hopf(coefficients) if kind is LossKind.HOPF else consequences.DEGENERATE
    return diagnosis.loss(
        z, Contact.PAIR, kind, test, value, verdict, coefficients=coefficients, note="; ".join(notes)
    )
