"""Members of an ensemble of a reduced flow end exactly as `integrate` ends them."""

from __future__ import annotations

import signal

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import BranchError, HyperbolicityError, Status
from gsp.integration import parallel, watched_members
from gsp.integration.ensemble import integrate_many
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.trajectory import Method, integrate
from gsp.systems.system import SlowFastSystem
from tests.cases import crossed

x, y, z, w, eps = sp.symbols("x y z w epsilon")
ONE = sp.Integer(1)


def reduced(system: SlowFastSystem, near, order: int) -> ReducedFlow:
    return gsp.restrict(gsp.expand(gsp.solve_critical(system).nearest(near), order=order))


def one_by_one(many, flow, columns, *, at=None, **options):
    """Each member against its run alone, to the last bit; the statuses that were met."""
    epsilons = options.pop("epsilon")
    m = len(many)
    for i in range(m):
        start = {name: float(np.broadcast_to(column, m)[i]) for name, column in columns.items()}
        epsilon = float(np.broadcast_to(epsilons, m)[i])
        one = integrate(flow, start=start, epsilon=epsilon, at=at, **options)
        whole = integrate(flow, start=start, epsilon=epsilon, at=many.t, **options)
        member = many.member(i)
        assert member.status is one.status
        assert member.reached == one._record.times[-1]
        assert np.array_equal(list(member.last.values()), one._record.states[-1])
        assert member.stats == one.stats
        count = whole.t.size
        assert np.array_equal(member.y[:, :count], whole.y)
        assert np.isnan(member.y[:, count:]).all()
        if not one.status.ok and one._outcome.note:
            assert one._outcome.note in member.message
            assert one._outcome.remedy in member.message
    return set(many.statuses)


VAN_DER_POL = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=eps)
GRAPH = SlowFastSystem(slow={y: ONE}, fast={x: x**2 + y}, epsilon=eps)
TRANSCRITICAL = SlowFastSystem(slow={y: ONE}, fast={x: x**2 - y**2}, epsilon=eps)
ROTATION = SlowFastSystem(slow={z: ONE}, fast={x: z * x - y, y: x + z * y}, epsilon=eps)
SADDLE = SlowFastSystem(slow={z: ONE}, fast={x: -x + z, y: (2 + z) * y + x}, epsilon=eps)
POLE = SlowFastSystem(slow={y: -ONE}, fast={x: -x / y}, epsilon=eps)
DIPPING = SlowFastSystem(
    slow={z: w, w: -z}, fast={x: -((z - 1) ** 2 + sp.Rational(1, 100)) * (x - z)}, epsilon=eps
)
ENZYME = SlowFastSystem(slow={y: -y + (y + sp.Rational(1, 2)) * x}, fast={x: y - (y + 1) * x}, epsilon=eps)
ENDS, LOST, REACHED = Status.SUCCESS, Status.HYPERBOLICITY_LOST, Status.FOLD_REACHED
CASES = {
    "implicit, into a fold": (
        VAN_DER_POL, {"x": 2, "y": 2 / 3}, {"x": 2.0, "y": np.linspace(-0.6, 5, 9)}, (0, 0.8), {REACHED, ENDS},
    ),
    "explicit, into a fold": (GRAPH, {"x": -1, "y": -1}, {"y": np.linspace(-3, -0.5, 9)}, (0, 1.5), {REACHED, ENDS}),
    "transcritical": (TRANSCRITICAL, {"x": -1, "y": -1}, {"y": np.linspace(-3, -0.5, 9)}, (0, 1.5), {LOST, ENDS}),
    "imaginary pair": (ROTATION, {"x": 0, "y": 0, "z": -1}, {"z": np.linspace(-3, -0.5, 9)}, (0, 1.5), {LOST, ENDS}),
    "neutral saddle": (SADDLE, {"x": -2, "y": 2, "z": -1.7}, {"z": np.linspace(-1.9, -1.2, 5)}, (0, 1.0), {ENDS}),
    "pole": (POLE, {"x": 0, "y": 1}, {"y": np.linspace(0.5, 3, 6)}, (0, 1.5), {Status.NON_FINITE, ENDS}),
    "a near miss": (
        DIPPING, {"x": 0, "z": 0, "w": 1}, {"z": 0.0, "w": np.linspace(0.3, 3, 7)}, (0, 20), {ENDS},
    ),
    "backward": (VAN_DER_POL, {"x": 0.1, "y": -0.1}, {"x": 0.5, "y": np.linspace(-0.6, -0.1, 4)}, (0, -3.0), {ENDS}),
    "hyperbolic": (ENZYME, {"x": 0.5, "y": 1}, {"y": np.linspace(0.1, 3, 9)}, (0, 5), {ENDS}),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize(("case", "order"), crossed(CASES, [0, 1, 2]))
def test_every_member_ends_as_its_run_alone(case, order):
    system, near, starts, span, expected = CASES[case]
    flow = reduced(system, near, order)
    for at in (None, np.linspace(*span, 23)):
        options = {"span": span, "epsilon": 1e-3, "at": at}
        many = integrate_many(flow, starts, **options)
        met = one_by_one(many, flow, starts, **options)
        # Above order 0 the series may end before the loss does.
        assert order or met == expected


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", [Method.RADAU9, Method.RADAU13])
def test_with_every_method_over_epsilon_and_threads(method):
    flow = reduced(VAN_DER_POL, {"x": 2, "y": 2 / 3}, 1)
    starts = {"x": 2.0, "y": np.linspace(-0.6, 5, 40)}
    options = {"span": (0, 0.8), "epsilon": np.geomspace(1e-5, 1e-2, 40), "rtol": 1e-6, "method": method}
    many = integrate_many(flow, starts, threads=3, **options)
    assert one_by_one(many, flow, starts, **options) == {REACHED, ENDS}


def test_only_members_near_a_loss_are_run_one_by_one(monkeypatch):
    alone, run = [], watched_members.trajectory_of
    monkeypatch.setattr(
        watched_members, "trajectory_of", lambda *given: alone.append(given[-1].state[0]) or run(*given)
    )
    flow = reduced(GRAPH, {"x": -1, "y": -1}, 0)
    many = integrate_many(flow, {"y": [-9.0, -8.0, -1.0, -7.0]}, span=(0, 1.5), epsilon=1e-3, threads=1)
    assert [status is REACHED for status in many.statuses] == [False, False, True, False]
    assert alone == [-1.0]


def test_a_start_on_a_loss_is_refused_with_the_members_number():
    flow = reduced(GRAPH, {"x": -1, "y": -1}, 0)
    with pytest.raises(
        HyperbolicityError, match=r"^member 2: the start lies where normal hyperbolicity is lost"
    ):
        integrate_many(flow, {"y": [-3.0, -2.0, 0.0, 0.0]}, span=(0, 1), epsilon=1e-3)


@pytest.mark.usefixtures("interruptible")
def test_an_interrupt_leaves_no_member_beyond_its_loss(monkeypatch):
    flow = reduced(GRAPH, {"x": -1, "y": -1}, 0)
    options = {"span": (0, 1.5), "epsilon": 1e-3, "at": [0, 0.25, 1.5]}
    starts = {"y": np.tile([-0.5, -3.0], 60)}
    whole = integrate_many(flow, starts, **options)
    monkeypatch.setattr(parallel, "LARGEST_CHUNK", 4)

    def interrupt(fraction):
        if fraction > 0.2:
            signal.raise_signal(signal.SIGINT)

    many = integrate_many(flow, starts, progress=interrupt, threads=2, **options)
    done = np.array([status is not Status.INTERRUPTED for status in many.statuses])
    assert done.sum() > 0.2 * 120
    for i, member in enumerate(many):
        if done[i]:
            assert member.status is whole.statuses[i]
            assert np.array_equal(member.y, whole.y[i], equal_nan=True)
        else:
            assert member.reached <= whole.reached[i]
            assert np.isnan(member.y[0, member.t > member.reached]).all()
            assert member.y[0, 0] == starts["y"][i]


@pytest.mark.parametrize("sheet", ["transcritical", "fold"])
def test_values_on_a_grid_into_a_loss_lie_on_the_solution(sheet):
    # The run into the loss is made anew from far before it; y = y0 + t.
    system = {"transcritical": TRANSCRITICAL, "fold": GRAPH}[sheet]
    flow = reduced(system, {"x": -1, "y": -1}, 0)
    t = np.linspace(0, 0.999999, 500)
    run = integrate(flow, start={"y": -1.0}, span=(0, 2), epsilon=1e-3, at=[*t, 1.5])
    assert run.t.size == t.size
    assert run["y"] == pytest.approx(-1.0 + t, abs=1e-9)


def test_starts_on_a_fixed_sheet_are_found_in_compiled_code_as_one_by_one(monkeypatch):
    near = {"x": 2, "y": 2 / 3}
    branch = gsp.solve_critical(VAN_DER_POL).nearest(near).through(near)
    flow = gsp.restrict(gsp.expand(branch, order=1))
    columns = {"y": np.linspace(-0.5, 5, 7)}
    options = {"span": (0, 0.1), "epsilon": 0.01, "rtol": 1e-8, "atol": 1e-10}
    alone = [flow.initial({"y": value}) for value in columns["y"].tolist()]
    monkeypatch.setattr(type(flow), "initial", lambda *_: pytest.fail("one by one"))
    many = integrate_many(flow, columns, **options)
    monkeypatch.undo()
    assert np.array_equal(many.starts, alone)
    assert one_by_one(many, flow, columns, **options) == {ENDS}


def test_a_start_that_the_sheet_does_not_reach_is_named():
    near = {"x": 2, "y": 2 / 3}
    branch = gsp.solve_critical(VAN_DER_POL).nearest(near).through(near)
    flow = gsp.restrict(gsp.expand(branch, order=1))
    with pytest.raises(BranchError, match=r"^member 2: the sheet through .* ends at"):
        integrate_many(flow, {"y": [1.0, 0.5, -1.0]}, span=(0, 0.1), epsilon=0.01)
