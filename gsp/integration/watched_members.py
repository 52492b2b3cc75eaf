"""The members of an ensemble of a reduced flow, each ended where `integrate` ends it.

Compiled code runs the members and looks at the test functions along each record of steps as the single run does. Most
members keep clear of every loss of normal hyperbolicity; the others are integrated one by one.
"""

from __future__ import annotations

import numpy as np

from gsp.errors import GspError
from gsp.integration.members import Members
from gsp.integration.methods import Method
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.reduction_end.endings import Ending
from gsp.integration.reduction_end.validity import validity_of
from gsp.integration.trajectory import RunOptions, Trajectory, trajectory_of
from gsp.integration.watched import Stepper
from gsp.kernels import integrator
from gsp.kernels.ensemble import NOT_FINISHED
from gsp.kernels.watched_ensemble import begin_members, run_watched_members
from gsp.lowering.compiled_flow import compile_flow

# Failures that may be runs into a zero of det g_y.
MAY_BE_LOSSES = (integrator.STEP_TOO_SMALL, integrator.NON_FINITE)

Arrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""What is known of each member: state and time reached, states at the times kept, counters and code."""


class WatchedMembers:
    """Runs the members of an ensemble of a reduced flow over `span`, each as `integrate` does.

    `t` (k,) are the times kept. `alone` holds the runs that were made one by one, by the member's number. Raises the
    `HyperbolicityError` of the first member that starts on a loss of normal hyperbolicity, with its number.
    """

    def __init__(
        self,
        flow: ReducedFlow,
        members: Members,
        t: np.ndarray,
        *,
        span: tuple[float, float],
        method: Method,
        control: tuple[float, float, int],
    ) -> None:
        self.flow, self.members, self.t, self.span = flow, members, t, span
        self.method, self.control = method, control
        self.alone: dict[int, Trajectory] = {}
        validity = validity_of(flow)
        # Asked for here and not in the threads, since it compiles.
        functions = validity.functions
        constants, starts = members.constants.copy(), members.starts.copy()
        signs, clear = np.empty((len(members), len(validity.varying))), np.empty(len(members), np.bool_)
        begin_members(functions, constants, span[0], starts, signs, clear)
        for i in np.flatnonzero(~clear).tolist():
            stepper = Stepper(compile_flow(flow), constants[i], method, *control[:2])
            try:
                # On a loss this raises; other members are integrated one by one.
                Ending(flow, stepper, span, starts[i])
            except GspError as error:
                raise error.under(f"member {i}") from None
        self._clear = clear & (not validity.leaves_pairs)
        self._tests = (functions, signs)

    def run(self, shared: tuple, low: int, high: int, halt: np.ndarray, arrays: Arrays, scratch: tuple) -> None:
        """Run the members low to high - 1 into their rows of `arrays`; `shared` and `scratch` are the kernel's."""
        *_, codes = arrays
        run_watched_members(shared, self._tests, low, high, halt, arrays, self._clear, scratch)
        alone = ~self._clear[low:high]
        for code in MAY_BE_LOSSES:
            alone |= codes[low:high] == code
        for i in np.flatnonzero(alone).tolist():
            self._run_alone(low + i, halt, arrays)

    def _run_alone(self, i: int, halt: np.ndarray, arrays: Arrays) -> None:
        """Member `i` as `integrate` runs it; as one that has not begun once `halt` is not 0."""
        ends, reached, kept, counters, codes = arrays
        start = self.members.starts[i]
        # What the compiled run went through after a loss is no result.
        ends[i], reached[i], kept[i], counters[i], codes[i] = start, self.span[0], np.nan, 0, NOT_FINISHED
        kept[i, self.t == self.span[0]] = start
        if halt[0]:
            return

        def look(_: float) -> None:
            # Ctrl-C itself reaches the calling thread alone.
            if halt[0]:
                raise KeyboardInterrupt

        rtol, atol, max_steps = self.control
        options = RunOptions(
            self.method, max_steps=max_steps, progress=look, returns_partial=True, state=tuple(start.tolist())
        )
        epsilon = float(self.members.constants[i, 0])
        trajectory = trajectory_of(self.flow, {}, self.span, epsilon, rtol, atol, self.t, options)
        record = trajectory._record
        ends[i], reached[i] = record.states[-1], record.times[-1]
        kept[i, : trajectory.t.size] = trajectory.y.T
        counters[i, : len(record.counters)] = record.counters
        self.alone[i] = trajectory
