"""Other people's integrators on our flows: what a work-precision diagram measures ours against.

A peer is one integrator of one package, prepared once for a flow and run at many tolerances. SciPy's are always there;
adapters of others stand in `benchmarks/`, and are handed to `work_precision` as anybody's own are.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from gsp.kernels.evaluate import evaluate
from gsp.lowering.compiled_flow import compile_flow
from gsp.systems.flow import Flow


@dataclass(frozen=True)
class PeerRun:
    """States (n, m) on the grid, nan where the peer did not get to; steps and calls where it says."""

    states: np.ndarray
    steps: int | None = None
    field_calls: int | None = None


Solve = Callable[[float, float], PeerRun]
"""A prepared problem: rtol and atol to the states on the grid. Raises whatever the package raises when it fails."""


class Peer(ABC):
    """One integrator of one package."""

    name: str
    """How it is called in tables and legends."""
    package: str
    """The distribution that it comes with."""
    is_explicit: bool = False
    """Whether stiffness makes it hopeless."""
    is_compiled: bool = True
    """Whether no Python runs between its steps."""

    @property
    def version(self) -> str | None:
        """Version installed, None when it is not."""
        try:
            return version(self.package)
        except PackageNotFoundError:
            return None

    @abstractmethod
    def prepare(self, flow: Flow, p: np.ndarray, start: np.ndarray, first: float, grid: np.ndarray) -> Solve:
        """What solves `flow` with parameters p from `start` (n,) at `first` to each time of `grid` (m,).

        The grid leads away from `first`, forward or backward. All that does not depend on the tolerance is done
        here, and is not timed. Raises `UnsupportedFunctionError` for a flow that the peer's language cannot say,
        `ImportError` for a package that is there and does not load.
        """


@dataclass(frozen=True)
class ScipyPeer(Peer):
    """A method of `scipy.integrate.solve_ivp`: compiled field and Jacobian, steps in Python."""

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
        t_eval_times = times if times.size > 1 else None

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
                rates,
                span,
                states,
                method=self.method,
                t_eval=t_eval_times,
                rtol=rtol,
                atol=atol,
                jac=derivatives,
            )
            if t_eval_times is None:
                if not found.success:
                    raise ArithmeticError(found.message)
                return PeerRun(found.y[:, -1:], len(found.t) - 1, int(found.nfev))
            reached = np.full((n, times.size), np.nan)
            reached[:, : found.y.shape[1]] = found.y
            return PeerRun(reached, None, int(found.nfev))

        return solve


PEERS: tuple[Peer, ...] = (ScipyPeer("Radau"), ScipyPeer("BDF"), ScipyPeer("LSODA"))
"""Those that come with the packages that gsp needs."""
