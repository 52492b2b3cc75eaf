"""SUNDIALS through scikit-sundae: C, with callbacks into Python that call our machine code."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.kernels.evaluate import evaluate
from gsp.peers.forward import Forward
from gsp.peers.peer import MAX_STEPS, Peer, PeerRun, Solve
from gsp.systems.flow import Flow


@dataclass(frozen=True)
class SundaePeer(Peer):
    """CVODE with the BDF formulas, compiled field and Jacobian behind the callbacks."""

    name = "sundae CVODE"
    package = "scikit-sundae"
    is_compiled = False

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        from sksundae.cvode import CVODE  # pyright: ignore[reportMissingImports]

        problem = Forward(flow, p, start, first, grid)
        field, jacobian = problem.field.address, problem.jacobian.address
        states, times, n = np.array(start, dtype=float), problem.times_from_start, len(flow.states)
        flat = np.empty(n * n)

        def rates(t: float, z: np.ndarray, out: np.ndarray) -> None:
            evaluate(field, t, z, p, out)

        def derivatives(t: float, z: np.ndarray, _: np.ndarray, matrix: np.ndarray) -> None:
            evaluate(jacobian, t, z, p, flat)
            matrix[:] = flat.reshape(n, n)

        def solve(rtol: float, atol: float) -> PeerRun:
            # The problem keeps the machine code alive.
            assert problem is not None
            solver = CVODE(
                rates, jacfn=derivatives, rtol=rtol, atol=atol, method="BDF", max_num_steps=MAX_STEPS
            )
            found = solver.solve(times, states)
            if not found.success:
                raise ArithmeticError(found.message)
            # Asked for a start and an end it returns every step.
            return PeerRun(found.y[1 - times.size :].T, None, int(found.nfev))

        return solve
