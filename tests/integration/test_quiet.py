"""Runs of reduced flows in which nothing happens: looked at in compiled code, with the numbers of the long way."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest

from gsp.critical import branch as branches
from gsp.errors import BranchError, HyperbolicityError, Status
from gsp.integration import loop
from gsp.integration import watching as module
from gsp.integration.reduction_end.validity import validity_of
from gsp.integration.trajectory import integrate
from gsp.kernels.scan import CLOSER_LOOKS, COLUMNS, LOOKS, WATCHED, clear_of_zero
from gsp.kernels.sheets import follow_sheet
from gsp.models import load
from gsp.scenes.study import study
from tests.cases import thinned

QUIET = (
    "chaplygin_sleigh",
    "michaelis_menten",
    "van_der_pol",
    "koper",
    "fitzhugh_nagumo",
    "lindemann",
    "nonholonomic_particle",
)


@pytest.mark.parametrize("order", thinned([0, 1, 2], 2))
@pytest.mark.parametrize("name", QUIET)
def test_a_run_away_from_every_loss_is_that_of_the_long_way_and_never_goes_it(name, order, monkeypatch):
    found = study(load(name))
    flow = found.reduced(order)
    scene = found.scene
    options = {"start": dict(found.start), "span": scene.span, "epsilon": scene.epsilon, "rtol": 1e-9}
    # What asks for progress is watched step by step.
    long = integrate(flow, progress=lambda done: None, **options)
    times = np.linspace(*scene.span, 17)[1:-1]
    on_grid = integrate(flow, progress=lambda done: None, at=times, **options)
    looked = []
    ending = module.ending_of
    monkeypatch.setattr(module, "ending_of", lambda *arguments: looked.append(1) or ending(*arguments))
    quick = integrate(flow, **options)
    assert quick.status is long.status
    assert np.array_equal(quick.t, long.t)
    assert np.array_equal(quick.y, long.y)
    assert quick.stats == long.stats
    assert quick.message == long.message
    assert np.array_equal(integrate(flow, at=times, **options).y, on_grid.y)
    # The scenes' spans end before anything happens.
    assert looked == ([] if long.status.ok else [1, 1])


def test_a_run_of_many_looks_is_that_of_the_long_way():
    found = study(load("chaplygin_sleigh"))
    flow = found.reduced(1)
    options = {"start": dict(found.start), "span": (0, 400), "epsilon": found.scene.epsilon, "rtol": 1e-12}
    quick, long = integrate(flow, **options), integrate(flow, progress=lambda done: None, **options)
    assert quick.stats.steps > module.LOOK
    assert np.array_equal(quick.y, long.y)
    assert quick.stats == long.stats


def test_a_run_into_a_fold_and_a_start_on_it_end_as_they_do_the_long_way():
    found = study(load("van_der_pol"))
    for order in (0, 1, 2):
        options = {"start": {"x": 2, "y": 2 / 3}, "span": (0, 3), "epsilon": 0.01}
        quick = integrate(found.reduced(order), **options)
        long = integrate(found.reduced(order), progress=lambda done: None, **options)
        assert not quick.status.ok
        assert quick.message == long.message
        assert np.array_equal(quick.y, long.y)
        with pytest.raises((HyperbolicityError, BranchError)):
            integrate(found.reduced(order), start={"x": 1, "y": -2 / 3}, span=(0, 1), epsilon=0.01)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["van_der_pol", "koper", "fitzhugh_nagumo"])
def test_one_point_of_a_sheet_is_what_following_it_gives(name):
    branch = study(load(name)).branch
    assert branch.seed is not None
    rng = np.random.default_rng(0)
    near = np.array(branch.seed[0])
    reached = 0
    for _ in range(60):
        x = near + rng.normal(size=near.size)
        y, good = branch.follow(x[np.newaxis])
        if good[0]:
            assert branch.over(x) == pytest.approx(y[0], rel=1e-12, abs=1e-12)
            reached += 1
        else:
            with pytest.raises(BranchError, match="ends at"):
                branch.over(x)
    assert reached > 15


def test_a_step_that_may_lead_to_another_sheet_is_not_trusted():
    branch = study(load("van_der_pol")).branch
    numbers = branch._sheet[5 + branch._sheet[4] :].view(float)
    # Behind the seed come the units of x and y.
    x0, y0, p = numbers[1:2], numbers[2:3], numbers[5:]
    # From x = 2 the sheet ends at y = -2/3; Newton's method alone would find a point of the other one.
    y = y0.copy()
    for pieces in (1, 4, 16):
        assert not follow_sheet(tuple(branch._sheet[:3]), p, x0, y, np.array([-0.9]), pieces, 1e-12, 40)
    assert np.array_equal(y, y0)


@pytest.mark.parametrize("name", ["chaplygin_sleigh", "van_der_pol"])
def test_a_run_with_its_watch_is_one_call_of_compiled_code(name, monkeypatch):
    found = study(load(name))
    flow, calls = found.reduced(1), []
    watched = loop.launch_watched
    monkeypatch.setattr(loop, "launch_watched", lambda *arguments: calls.append(1) or watched(*arguments))
    monkeypatch.setattr(loop, "launch", lambda *arguments: pytest.fail("a second run"))
    # A start over an implicit branch is found in the same call.
    monkeypatch.setattr(branches, "reach_sheet", lambda *arguments: pytest.fail("a call for the start"))
    # Fast variables choose no sheet here, and take no other way.
    runs = []
    for named in (found.system.x, found.system.states):
        start = {s.name: found.start[s.name] for s in named}
        runs.append(integrate(flow, start=start, span=found.scene.span, epsilon=found.scene.epsilon, rtol=1e-6))
        assert runs[-1].status.ok
    assert calls == [1, 1]
    assert np.array_equal(runs[0].y, runs[1].y)


def test_a_run_that_is_interrupted_before_its_start_is_found_has_the_start(monkeypatch):
    found = study(load("van_der_pol"))
    flow, start = found.reduced(1), {x.name: found.start[x.name] for x in found.system.x}

    def interrupt(*arguments):
        raise KeyboardInterrupt

    monkeypatch.setattr(loop, "launch_watched", interrupt)
    run = integrate(flow, start=start, span=found.scene.span, epsilon=found.scene.epsilon)
    assert run.status is Status.INTERRUPTED
    np.testing.assert_array_equal(run.y, np.array([flow.initial(start)]).T)


@pytest.mark.parametrize(
    ("name", "order", "changing"),
    [
        ("linear", 1, 0),
        ("linear", 2, 0),
        ("chaplygin_sleigh", 1, 0),
        ("chaplygin_sleigh", 3, 0),
        ("michaelis_menten", 1, 2),
        ("michaelis_menten", 3, 2),
    ],
)
def test_what_cannot_change_along_a_run_is_looked_at_where_it_begins_alone(name, order, changing):
    found = study(load(name))
    flow = found.reduced(order)
    validity = validity_of(flow)
    assert flow.tests.count == flow.tests.functions[WATCHED] == changing
    # By numbers: what is left out is the same all over the region.
    columns = validity.watched(np.ones((1, validity.tests.outputs)))[0]
    still = [c for k, c in enumerate(columns) if k not in validity.varying]
    p, start = np.array([found.scene.epsilon]), np.array(flow.initial(dict(found.start)))
    points = start * np.linspace(0.5, 1.5, 7)[:, None]
    rows = validity.tests(validity.lift(points, p), p)[:, still]
    assert np.array_equal(rows, np.broadcast_to(rows[0], rows.shape))


PASSED = ctypes.CFUNCTYPE(None, ctypes.c_double, *[ctypes.POINTER(ctypes.c_double)] * 3)


def looked_along(value, times: np.ndarray) -> tuple[bool, int]:
    """What a look finds along t' = 1, stepped through `times`, of one function of t; and how often it asks."""
    asked = []

    def function(t, z, p, out):
        asked.append(t)
        assert z[0] == pytest.approx(t, abs=1e-15)
        out[0] = value(z[0])

    called = PASSED(function)
    functions = np.zeros(COLUMNS + 1, np.int64)
    functions[WATCHED], functions[WATCHED + 1] = 1, ctypes.cast(called, ctypes.c_void_p).value
    rest, dense = times[1:], np.zeros((len(times) - 1, 2, 1))
    start, steps = (times[0], times[:1].copy()), (rest.copy(), rest[:, None].copy(), dense)
    clear = clear_of_zero(functions, np.zeros(1), np.ones(1), start, steps)
    return clear, len(asked)


@pytest.mark.parametrize("steps", [1, 2, 3, 12])
def test_a_look_asks_a_few_times_a_step_whatever_the_stages(steps):
    assert looked_along(lambda t: 2.0 + t, np.linspace(0, 3, steps + 1)) == (True, LOOKS * steps + 1)


def test_a_look_passes_over_no_zero_and_no_dip():
    rng = np.random.default_rng(0)
    times = np.array([0.0, 0.3, 1.0])
    fine = np.linspace(0, 1, 2001)
    cleared = 0
    for _ in range(300):
        shape = np.polynomial.Polynomial(rng.normal(size=rng.integers(2, 7)), domain=(0, 1))
        for level in (-0.2, -1e-3, 0.02, 2.0):
            value = shape - shape(fine).min() + level
            clear, _ = looked_along(value, times)
            assert not (clear and level <= 0.0)
            cleared += clear
    # Far from zero nothing is left to the search.
    assert cleared > 200


def test_what_bends_is_looked_at_more_closely_before_it_is_left_to_the_search():
    times = np.array([0.0, 1.0, 2.0])
    clear, asked = looked_along(lambda t: 0.1 + (t - 1.0) ** 2, times)
    assert clear
    assert asked > CLOSER_LOOKS * 2
    # A zero ends it at once.
    assert looked_along(lambda t: 0.5 - t, times) == (False, 3)


def test_steep_growth_far_from_zero_is_no_dip_near_it():
    """A function may be large where it bends: what counts is the bend beside a value."""
    assert looked_along(lambda t: 1.0 + np.exp(1.5 * t) / 30, np.linspace(0, 6, 7))[0]
