"""What every traced curve satisfies: its solutions solve, its steps are even, folds are passed, loops close."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from gsp.critical.continuation.arclength import Controls, PointTracer
from gsp.errors import Status
from gsp.tracing.arclength import Arrival, Pace, Stride, Trace, Tracer


class Curve:
    """F(u) = 0 in the plane with its gradient."""

    def __init__(self, value: Callable, gradient: Callable) -> None:
        self.value, self.gradient = value, gradient

    def residual(self, u: np.ndarray) -> np.ndarray:
        return np.array([self.value(*u)])

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        return np.array([self.gradient(*u)])


CIRCLE = Curve(lambda a, b: a * a + b * b - 1, lambda a, b: (2 * a, 2 * b))
CUBIC = Curve(lambda a, b: a - b**3 + 3 * b, lambda a, b: (1.0, 3 - 3 * b * b))


def tracer(curve: Curve, *, step: float = 0.02, most: int = 5000, bound: float = 3.0) -> PointTracer:
    return PointTracer(
        curve, scales=np.ones(2), bounds=np.array([[-bound, bound]] * 2), names=("a", "b"),
        controls=Controls(step, step, most, 1e-12),
    )  # fmt: skip


def cubic():
    """From b = -2 through the folds at a = 2 and a = -2 to the bound a = 3."""
    curve, start = tracer(CUBIC), np.array([-2.0, -2.0])
    return curve.run(start, curve.tangent(start, np.array([0.0, 1.0])))


def test_every_point_solves_and_every_tangent_is_one() -> None:
    trace = cubic()
    points, tangents = np.array(trace.points), np.array(trace.tangents)
    assert np.abs([CUBIC.value(*u) for u in points]).max() < 1e-12
    assert np.abs(np.linalg.norm(tangents, axis=1) - 1).max() < 1e-13
    across = [CUBIC.gradient(*u) @ t for u, t in zip(points, tangents)]
    assert np.abs(across).max() < 1e-10


def test_folds_are_passed_and_the_bound_is_met_exactly() -> None:
    trace = cubic()
    a = np.array(trace.points)[:, 0]
    turns = np.flatnonzero(np.diff(np.sign(np.diff(a))) != 0)
    assert len(turns) == 2
    assert a[turns + 1] == pytest.approx([2.0, -2.0], abs=1e-3)
    assert (trace.ending, trace.bound) == (Status.BOUND_REACHED, "a")
    assert a[-1] == 3.0


def test_a_loop_closes_on_its_start_after_its_length() -> None:
    trace = tracer(CIRCLE).run(np.array([1.0, 0.0]), np.array([0.0, 1.0]))
    points = np.array(trace.points)
    assert trace.ending is Status.CLOSED
    assert (points[-1] == points[0]).all()
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).sum() == pytest.approx(2 * np.pi, rel=1e-4)


def test_the_predictor_is_of_second_order() -> None:
    """Along the tangent the guess leaves the curve by the square of the step."""
    errors = []
    for step in (0.02, 0.01):
        curve = tracer(CIRCLE, step=step)
        guess, normal = curve.predicted(_start(curve), step)
        found = curve.corrected((guess, normal), step)
        assert found is not None
        errors.append(np.linalg.norm(found[0] - guess))
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=1e-3)


def _start(curve: PointTracer):
    from gsp.critical.continuation.arclength import OrientedPoint

    u, t = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    return OrientedPoint(u, t, curve.orientation(u, t))


class Line(Tracer[float]):
    """A curve that is its own arclength, whose steps are refused or end as a test wants it."""

    def __init__(
        self, refuse: Callable[[float, float], bool], *, corrections: int = 3, turn: float = 0.0
    ) -> None:
        self.pace, self.most = Pace(0.1, 0.4, 1e-3, corrections=3, turn=0.1, largest_turn=0.5), 50
        self.refuse, self.cost, self.turn, self.taken = refuse, corrections, turn, []

    def predicted(self, here: float, length: float) -> float:
        return here + length

    def corrected(self, guess: float, length: float) -> float | None:
        return None if self.refuse(guess, length) else guess

    def oriented(self, here: float, guess: float, found: float) -> Stride[float]:
        return Stride(found, self.cost, self.turn)

    def arrived(self, trace: Trace[float], here: float, stride: Stride[float], length: float) -> Arrival[float]:
        self.taken.append(length)
        return Arrival([(stride.node, length)], Status.BOUND_REACHED if stride.node > 3.0 else None)


def test_easy_steps_grow_to_the_longest_and_hard_ones_shrink() -> None:
    easy, hard = Line(lambda *_: False, corrections=1), Line(lambda *_: False, corrections=5)
    for line in (easy, hard):
        line.follow(Trace([0.0]))
    assert easy.taken[:4] == pytest.approx([0.1, 0.2, 0.4, 0.4])
    assert hard.taken[:3] == pytest.approx([0.1, 0.05, 0.025])


def test_a_step_that_turns_twice_as_far_as_aimed_at_is_followed_by_half_of_it() -> None:
    line = Line(lambda *_: False, corrections=3, turn=0.2)
    line.follow(Trace([0.0]))
    assert line.taken[:3] == pytest.approx([0.1, 0.05, 0.025])


@pytest.mark.parametrize("turn", [0.6, float("nan")])
def test_a_step_that_turns_too_far_is_refused_until_steps_are_too_short(turn: float) -> None:
    trace = Trace([0.0])
    Line(lambda *_: False, turn=turn).follow(trace)
    assert (trace.ending, trace.nodes) == (Status.STEP_TOO_SMALL, [0.0])
    assert trace.rejected == 7


def test_refused_steps_are_halved_and_counted() -> None:
    trace, line = Trace([0.0]), Line(lambda _, length: length > 0.06)
    line.most = 70
    line.follow(trace)
    assert line.taken[0] == 0.05
    assert trace.rejected == 1
    assert trace.ending is Status.BOUND_REACHED
    assert sum(trace.lengths) == pytest.approx(trace.nodes[-1])


def test_the_number_of_solutions_is_bounded() -> None:
    trace, line = Trace([0.0]), Line(lambda *_: False)
    line.most = 5
    line.follow(trace)
    assert (trace.ending, len(trace.nodes)) == (Status.TOO_MANY_POINTS, 5)


def test_a_change_of_sign_in_a_step_is_located_and_its_step_known() -> None:
    found = Line(lambda *_: False).located(1.0, 0.4, lambda at: at - 1.3, (-0.3, 0.1), apart=1e-12)
    assert found == (pytest.approx(1.3), pytest.approx(0.3))


def test_where_no_step_leads_exactly_to_the_place_one_beside_it_is_taken() -> None:
    line = Line(lambda at, _: abs(at - 1.25) < 1e-14)
    found = line.located(1.0, 0.5, lambda at: at - 1.25, (-0.25, 0.25), apart=1e-12)
    assert found is not None
    assert 0.0 < abs(found[0] - 1.25) <= 1e-12


def test_where_no_step_leads_the_least_value_on_the_way_is_kept() -> None:
    found = Line(lambda at, _: abs(at - 1.3) < 1e-3).located(
        1.0, 0.4, lambda at: at - 1.3, (-0.3, 0.1), apart=1e-12
    )
    assert found is None or abs(found[0] - 1.3) < 0.1


def test_the_pace_follows_its_rule_exactly() -> None:
    pace = Pace(1.0, 10.0, 0.1, corrections=4, turn=0.2, growth=3.0)
    # 2^((4 - corrections)/2) and turn/angle, the lesser of them, between a half and `growth`, at most the longest.
    assert pace.after(1.0, 4, 0.1) == pytest.approx(1.0)
    assert pace.after(1.0, 3, 0.01) == pytest.approx(2**0.5)
    assert pace.after(1.0, 1, 0.1) == pytest.approx(2.0)
    assert pace.after(1.0, 1, 0.25) == pytest.approx(0.8)
    assert pace.after(1.0, 0, 0.0) == 3.0
    assert pace.after(1.0, 9, 0.0) == pace.after(1.0, 0, 3.0) == 0.5
    assert pace.after(4.0, 0, 0.0) == 10.0
    plain = Pace(1.0, 100.0, 0.1)
    assert plain.after(1.0, 99, 3.0) == 2.0
    # No pair of tangents counts as nearer than a thousandth.
    assert Pace(1.0, 1e9, 0.1, turn=0.01, growth=1e9).after(1.0, 0, 1e-9) == pytest.approx(10.0)


def test_an_ending_of_the_work_a_refused_arrival_and_the_onward_node_are_heeded() -> None:
    class Turned(Line):
        def arrived(self, trace, here, stride, length):
            if len(trace.nodes) == 2 and not trace.rejected:
                return None
            return Arrival([(stride.node, length)], onward=stride.node + 1.0)

        def spent(self):
            return Status.INTERRUPTED if len(self.seen) > 3 else None

    line, seen = Turned(lambda *_: False), []
    line.seen = seen  # pyright: ignore[reportAttributeAccessIssue]
    trace = Trace([0.0])
    line.follow(trace, progress=seen.append)
    assert trace.rejected == 1
    # Each step starts one further on than the solution that the last one ended in.
    assert np.diff(trace.nodes) == pytest.approx([trace.lengths[0], *(1.0 + s for s in trace.lengths[1:])])
    assert seen == pytest.approx([len(trace.nodes[: k + 2]) / 50 for k in range(len(seen))])
    assert trace.ending is Status.INTERRUPTED


def test_a_turn_exactly_as_far_as_allowed_is_taken() -> None:
    line = Line(lambda *_: False, turn=0.5)
    line.follow(trace := Trace([0.0]))
    assert trace.rejected == 0
    assert line.taken[0] == 0.1


def test_the_place_beside_is_before_the_one_that_was_asked_for() -> None:
    asked = []

    def refuse(at: float, _: float) -> bool:
        asked.append(at)
        return abs(at - 1.25) < 1e-4

    Line(refuse).located(1.0, 0.5, lambda at: at - 1.25, (-0.25, 0.25), apart=0.01)
    first = next(i for i, at in enumerate(asked) if abs(at - 1.25) < 1e-4)
    assert asked[first + 1] == pytest.approx(asked[first] - 0.005)


def test_of_all_places_on_the_way_the_one_with_the_least_value_is_kept() -> None:
    visited = []

    def test(at: float) -> float:
        visited.append(at)
        return np.arctan(40 * (at - 1.3))

    found = Line(lambda *_: False).located(1.0, 0.4, test, (test(1.0), test(1.4)), apart=1e-12)
    assert found is not None
    assert abs(test(found[0])) == min(abs(test(at)) for at in visited[2:-1])
    assert found[1] == pytest.approx(found[0] - 1.0, abs=1e-15)


@pytest.mark.parametrize("step", [0.02, 0.1])
def test_the_turn_of_a_step_is_the_angle_between_its_tangents(step: float) -> None:
    curve = tracer(CIRCLE, step=step)
    stride = curve.step(_start(curve), step)
    assert stride is not None
    # The new point lies a step along the old tangent, which is the sine of the angle on a circle of radius 1.
    assert stride.turn == pytest.approx(np.arcsin(step))
    assert stride.node.tangent @ [-0.8, 0.6] == pytest.approx(np.cos(stride.turn))


def test_a_curve_closes_only_where_it_passes_its_start_in_the_direction_in_which_it_left() -> None:
    curve = tracer(CIRCLE, step=0.05)
    trace = curve.run(np.array([1.0, 0.0]), np.array([0.0, 1.0]))

    def closes(before: float, after: float, along: tuple[float, float]) -> bool:
        a, b = (np.array([np.cos(angle), np.sin(angle)]) for angle in (before, after))
        return curve._closes(trace, a, b, np.array(along))

    assert closes(-0.03, 0.02, (0.0, 1.0))
    assert not closes(-0.03, 0.02, (0.0, -1.0))
    assert not closes(-0.03, 0.02, (1.0, 0.0))
    assert not closes(0.02, 0.07, (0.0, 1.0))
    assert not closes(-0.07, -0.02, (0.0, 1.0))
    assert not closes(3.11, 3.16, (0.0, 1.0))
