"""What a peer is: one integrator of one package, prepared once for a flow and run at many tolerances."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from gsp.systems.flow import Flow

# No run of a peer takes more steps; one that would is a failure of its own.
MAX_STEPS = 1_000_000


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
