"""What watches a run: events that were asked for, and where a reduced flow ends."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

import numpy as np

from gsp.integration.crossings import Search, Stepper
from gsp.integration.events import CompiledEvents
from gsp.integration.run_array import Record
from gsp.systems.flow import Flow

if TYPE_CHECKING:
    from gsp.integration.reduced_flow import ReducedFlow
    from gsp.integration.reduction_end.endings import Ending


def ending_of(
    flow: Flow, stepper: Stepper, span: tuple[float, float], y: np.ndarray, stops: np.ndarray
) -> Ending:
    """What watches the run of a reduced flow."""
    # Imported here: all that series need would be an eighth of the first solve of a flow that is not reduced.
    from gsp.integration.reduced_flow import ReducedFlow
    from gsp.integration.reduction_end.endings import Ending

    assert isinstance(flow, ReducedFlow)
    return Ending(flow, stepper, span, y, stops)


def pair_passed(flow: Flow, p: np.ndarray, record: Record) -> tuple[Record, str, str] | None:
    """Of the run of a reduced flow that has passed an imaginary pair unseen, what holds; a note and a remedy."""
    from gsp.integration.reduction_end.passed_pairs import cut_at_pair

    return cut_at_pair(cast("ReducedFlow", flow), p, record)


def search_of(
    compiled_events: CompiledEvents | None,
    ending: Ending | None,
    stepper: Stepper,
    span: tuple[float, float],
    y: np.ndarray,
) -> Search:
    """What watches the run: the events asked for, then the reduced flow's own tests."""
    first, last = span
    watched = [*(compiled_events.watched() if compiled_events else ()), *(ending.watched if ending else ())]
    signs = [] if compiled_events is None else [compiled_events.signs(first, y, last > first)]
    parts = [part.values for part in (compiled_events, ending) if part is not None]
    # Events are looked for step by step; the tests of a reduced flow alone are passed over quickly.
    quiet = ending.quiet if ending is not None and compiled_events is None else None

    def values(t: np.ndarray, states: np.ndarray) -> np.ndarray:
        return parts[0](t, states) if len(parts) == 1 else np.hstack([part(t, states) for part in parts])

    signs += [ending.signs] if ending else []
    stuck = None if ending is None else ending.stuck
    return Search(values, watched, np.concatenate(signs), stepper, first, y, quiet, stuck)
