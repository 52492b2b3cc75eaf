"""Shooting: the period of an orbit by integration alone, as a check of collocation by a second route."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.errors import Status
from gsp.integration.loop import Control, Run, check_tolerances, run
from gsp.integration.methods import Method
from gsp.orbits.periodic.collocation import OrbitProblem
from gsp.orbits.periodic.orbit import PeriodicOrbit
from gsp.systems.arguments import check_noun, check_number
from gsp.systems.flow import Point


@dataclass(frozen=True)
class Shot:
    """An orbit by shooting: `period`, the `point` it starts from, and by how much it fails to close, `defect`.

    The defect is in units of the amplitudes, the status NOT_CONVERGED when it is not near rounding.
    """

    period: float
    point: Point
    defect: float
    status: Status


def shoot(orbit: PeriodicOrbit, *, phase: float = 0.0, rtol: float = 1e-13) -> Shot:
    """The orbit once more, by integration with Radau IIA of order 13 over one lap from the state at `phase`.

    The end of the lap is brought to its start by Newton's method in the start, held in the plane across the flow
    there, and in the period; the derivative of the lap by its start is collocation's. Nothing else is taken over.
    A lap goes backward in time where volumes grow along the orbit. Where an orbit stays long near an attracting and
    near a repelling manifold a lap loses all digits either way, and the status is NOT_CONVERGED.
    """
    check_noun(orbit, PeriodicOrbit, verb="shoot")
    phase = check_number(phase, what="phase", be="a number, a share of the period")
    rtol = check_tolerances(rtol, 1.0)[0]
    flow, p = orbit.flow, orbit._constants.copy()
    problem = OrbitProblem(flow, p)
    compiled = problem.compiled
    cycle = orbit._cycle
    scales = np.maximum(cycle.amplitudes, 1e-300)
    linear = problem.linearise(cycle)
    backward = problem.divergence(cycle) > 0.0
    # The lap's derivative from the mesh point next to the phase.
    first = int(np.argmin(np.abs(cycle.mesh[:-1] - np.mod(phase, 1.0))))
    M = np.eye(problem.size)
    with np.errstate(all="ignore"):
        transfers = np.roll(linear.transfers, -first, axis=0)
        for transfer in np.linalg.inv(transfers[::-1]) if backward else transfers:
            M = transfer @ M
    z, T = cycle.values[first, 0].copy(), -orbit.period if backward else orbit.period
    start, defect, best = z.copy(), np.inf, (np.inf, z, T)
    status = Status.NOT_CONVERGED
    atol = 1e-3 * rtol * float(scales.min())
    # Newton's method with collocation's derivative converges at once or not at all.
    for _ in range(6):
        end = z.copy()
        record = run(Run(compiled, p, end, 0.0, np.array([T]), Control(Method.RADAU13, rtol, atol, 10**6)))
        if not record.status.ok:
            status = record.status
            break
        gap = record.states[-1] - z
        defect = float(np.abs(gap / scales).max())
        rate = compiled.rates(z, p)
        if defect >= best[0] or not np.isfinite(M).all():
            break
        best = (defect, z, T)
        # M dz + F dT - dz = -gap, <F, z + dz - start> = 0, in units of the scales.
        across = rate / scales
        across = across / np.linalg.norm(across)
        matrix = np.zeros((problem.size + 1, problem.size + 1))
        matrix[:-1, :-1] = M * scales / scales[:, None] - np.eye(problem.size)
        matrix[:-1, -1] = T * compiled.rates(record.states[-1], p) / scales
        matrix[-1, :-1] = across
        right = np.append(-gap / scales, across @ ((start - z) / scales))
        step = np.linalg.lstsq(matrix, right, rcond=None)[0]
        z, T = z + step[:-1] * scales, T * (1.0 + step[-1])
    defect, z, T = best
    if defect <= 1e-11:
        status = Status.SUCCESS
    point = {symbol.name: float(value) for symbol, value in zip(flow.states, z + flow.centre)}
    return Shot(float(abs(T)), point, defect, status)
