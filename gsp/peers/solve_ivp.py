"""SciPy's integrators, which are always there: compiled field and Jacobian, steps in Python."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gsp.kernels.evaluate import evaluate
from gsp.lowering.compiled_flow import compile_flow
from gsp.peers.peer import Peer, PeerRun, Solve
from gsp.systems.flow import Flow


@dataclass(frozen=True)
class ScipyPeer(Peer):
    """A method of `scipy.integrate.solve_ivp`."""

    method: str
    package = "scipy"
    is_compiled = False

    @property
    def name(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]
        """SciPy and the method."""
        return f"SciPy {self.method}"

    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """See `Peer.prepare`."""
        from scipy.integrate import solve_ivp

        compiled = compile_flow(flow)
        field, jacobian, n = compiled.field, compiled.jacobian, compiled.size
        states = np.array(start, dtype=float)
        times = np.array(grid, dtype=float)
        span = (first, float(times[-1]))
        # The end alone needs no dense output.
        wanted = times if times.size > 1 else None

        def rates(t: float, z: np.ndarray) -> np.ndarray:
            out = np.empty(n)
            evaluate(field, t, np.ascontiguousarray(z), p, out)
            return out

        def derivatives(t: float, z: np.ndarray) -> np.ndarray:
            out = np.empty(n * n)
            evaluate(jacobian, t, np.ascontiguousarray(z), p, out)
            return out.reshape(n, n)

        def solve(rtol: float, atol: float) -> PeerRun:
            # The object keeps `compiled`, and with it the addresses, alive.
            assert compiled.field == field
            found = solve_ivp(
                rates, span, states, method=self.method, t_eval=wanted, rtol=rtol, atol=atol, jac=derivatives
            )
            if wanted is None:
                if not found.success:
                    raise ArithmeticError(found.message)
                return PeerRun(found.y[:, -1:], len(found.t) - 1, int(found.nfev))
            reached = np.full((n, times.size), np.nan)
            reached[:, : found.y.shape[1]] = found.y
            return PeerRun(reached, None, int(found.nfev))

        return solve
