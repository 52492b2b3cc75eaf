"""What watches a run: events that were asked for, and where a reduced flow ends."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from gsp.errors import Status
from gsp.integration.clock_stops import stops_of
from gsp.integration.crossings import Search
from gsp.integration.events import NOT_MET, CompiledEvents, Crossings, met_within
from gsp.integration.explanations import explain
from gsp.integration.loop import RECORD, Run, run, standing
from gsp.integration.methods import choose_method
from gsp.integration.run_array import RunRecord
from gsp.integration.watched import LOOK, Stepper
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


def pair_passed(flow: Flow, p: np.ndarray, record: RunRecord) -> tuple[RunRecord, str, str] | None:
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
    return Search(values, watched, np.concatenate(signs), stepper, span, y, quiet, stuck)


class Findings(NamedTuple):
    """A run and what is told of it: what events it met, why it ended where it did, and what to do."""

    record: RunRecord
    events: Mapping[str, Crossings] = NOT_MET
    note: str = ""
    remedy: str = ""


def examined(
    flow: Flow,
    request: Run,
    record: RunRecord | None,
    compiled_events: CompiledEvents | None,
    grid: np.ndarray | None,
) -> Findings:
    """What is made of a run that is looked at from Python or has failed.

    `record` is that of the quick run, if there was one. Steps are to end on the times of `grid`.
    """
    p, last = np.array(request.p), float(request.stops[-1])
    if record is None or (record.status is not Status.SUCCESS and flow.is_reduced):
        found = _made_again(flow, request, record, compiled_events, grid)
    else:
        found = Findings(record)
    if flow.is_reduced and cast("ReducedFlow", flow).leaves_pairs:
        passed = pair_passed(flow, p, found.record)
        if passed is not None:
            met = met_within(found.events, request.first, float(passed[0].times[-1]))
            found = Findings(passed[0], met, *passed[1:])
    if found.record.status is Status.SUCCESS:
        return found
    known, remedy = explain(flow, p, found.record, last)
    return found._replace(note=found.note or known, remedy=found.remedy or remedy)


def _made_again(
    flow: Flow,
    request: Run,
    record: RunRecord | None,
    compiled_events: CompiledEvents | None,
    grid: np.ndarray | None,
) -> Findings:
    """The run with a search along it, in place of the quick one, unless Ctrl-C has ended that."""
    control, p, y = request.control, np.array(request.p), np.array(request.y)
    span = request.first, float(request.stops[-1])
    method = control.method or choose_method(request.compiled, control.rtol)
    stepper = Stepper(request.compiled, p, method, control.rtol, control.atol)
    stops = stops_of(grid, *span, [(stop, stop) for stop in request.stops])
    ending = ending_of(flow, stepper, span, y, stops) if flow.is_reduced else None
    search = search_of(compiled_events, ending, stepper, span, y)
    begun = None if ending is None else ending.at_start(span[0], y)
    if begun is not None:
        record, note, remedy = standing(span[0], y, begun.status, method), begun.note, begun.remedy
    else:
        if record is None or record.status is not Status.INTERRUPTED:
            looks = request.looks._replace(
                watch=search, rows_kept=LOOK if search.can_end else RECORD, tests=None, over_slow=False
            )
            control = control._replace(method=method)
            record = run(request._replace(p=p, y=y, control=control, dense=True, looks=looks))
        if record.status is Status.INTERRUPTED:
            # Ctrl-C may have come between the last steps and the look at them.
            unseen = slice(search.rows + 1, None)
            search(record.times[unseen], record.states[unseen], record.dense[search.rows :])
        record = search.truncated(record)
        note, remedy = ("", "") if search.end is None else (search.end.note, search.end.remedy)
        if ending is not None and search.end is None:
            record, note, remedy = ending.after_failure(record)
    met = NOT_MET if compiled_events is None else compiled_events.met(search.found)
    return Findings(record, met, note, remedy)
