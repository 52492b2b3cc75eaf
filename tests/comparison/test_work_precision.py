"""Work and precision: floors where theory puts them, curves read as they should be, one answer by every route."""

from __future__ import annotations

import csv
import math
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

from gsp import models
from gsp.comparison.peers import PEERS, Peer, PeerRun
from gsp.comparison.work_precision import work_precision
from gsp.comparison.work_runs import WorkCurve, WorkKind, WorkPoint
from gsp.errors import DeclarationError, GspError, OutputError
from gsp.integration.methods import Method
from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem

RTOLS = (1e-4, 1e-8)


@pytest.fixture(scope="module", autouse=True)
def timed_once():
    """One round of measurements instead of five: nothing here depends on how exact the seconds are."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("gsp.comparison.work_runs.ROUNDS", 1)
        yield


@pytest.fixture(scope="module")
def michaelis_menten(timed_once):
    return work_precision(models.load("michaelis_menten"), rtols=(1e-3, 1e-6, 1e-9), orders=(0, 1, 2))


@pytest.mark.exhaustive
def test_the_floor_of_a_reduced_model_falls_with_its_power_of_epsilon():
    scene = models.load("chaplygin_sleigh")
    floors = {
        epsilon: [
            work_precision(scene, epsilon=epsilon, rtols=(1e-10,), orders=(0, 1, 2), methods=(), peers=())[
                f"reduced {n}"
            ].floor
            for n in range(3)
        ]
        for epsilon in (0.02, 0.005)
    }
    fitted = np.log(np.divide(floors[0.02], floors[0.005])) / math.log(4.0)
    assert fitted == pytest.approx([1, 2, 3], abs=0.15)


def test_curves_do_not_depend_on_when_the_clock_began():
    asked = models.load("michaelis_menten")
    length = asked.span[1] - asked.span[0]
    chosen = {"rtols": (1e-6,), "orders": (0, 1), "methods": (Method.RADAU9,), "peers": ()}
    here, later = (work_precision(replace(asked, span=(t, t + length)), **chosen) for t in (0, 7))
    labels = [c.label for c in here.curves]
    assert [c.label for c in later.curves] == labels
    assert Method.RADAU9.value in labels
    assert Method.RADAU13.value not in labels
    for own, other in zip(here.curves, later.curves):
        assert len(own.points) == len(other.points) > 0
        for one, two in zip(own.points, other.points):
            assert two.error == pytest.approx(one.error, rel=0.1)
            assert two.steps == pytest.approx(one.steps, abs=2)


@pytest.mark.exhaustive
def test_every_method_and_every_peer_agree(michaelis_menten):
    labels = [curve.label for curve in michaelis_menten.curves]
    assert labels[: len(Method) + 1] == [*(method.value for method in Method), "default"]
    assert {"SciPy Radau", "SciPy BDF", "SciPy LSODA"} <= set(labels)
    assert labels[-3:] == ["reduced 0", "reduced 1", "reduced 2"]
    assert michaelis_menten.reference_error < 1e-12
    for curve in michaelis_menten.curves:
        if curve.kind is not WorkKind.REDUCED:
            assert curve.points[-1].rtol == 1e-9
            assert curve.points[-1].error < 2e-8, curve.label


@pytest.mark.exhaustive
def test_a_run_says_what_it_cost(michaelis_menten):
    point = michaelis_menten["radau9"].points[0]
    assert point.seconds > 0.0
    assert 0 < point.steps < point.field_calls
    assert point.end_error <= point.error
    assert michaelis_menten["reduced 2"].preparation > 0.0
    assert michaelis_menten["SciPy BDF"].version


def test_rows_and_csv_hold_every_run(michaelis_menten, tmp_path):
    rows = michaelis_menten.as_rows()
    assert sum(np.isfinite(row["error"]) for row in rows) == sum(len(c.points) for c in michaelis_menten.curves)
    path = michaelis_menten.write_csv(tmp_path / "runs.csv")
    with path.open(encoding="utf-8") as file:
        read = list(csv.DictReader(file))
    assert [float(row["error"]) for row in read] == pytest.approx(
        [row["error"] for row in rows], abs=0, nan_ok=True
    )
    with pytest.raises(OutputError, match="cannot be written"):
        michaelis_menten.write_csv(tmp_path / "missing" / "runs.csv")


def test_the_card_shows_targets_that_somebody_reached(michaelis_menten):
    text = str(michaelis_menten)
    assert "reduced 2" in text
    assert "1e-07" in text
    assert michaelis_menten.fastest(1e-7) is not None
    assert michaelis_menten.fastest(1e-7, kind=WorkKind.REDUCED) is None


def curve(*points: tuple[float, float]) -> WorkCurve:
    runs = tuple(WorkPoint(10.0**-i, error, error, seconds, 1, 1) for i, (error, seconds) in enumerate(points))
    return WorkCurve("drawn", WorkKind.FULL, runs)


def test_seconds_are_interpolated_on_logarithmic_axes():
    drawn = curve((1e-2, 1.0), (1e-4, 4.0))
    assert drawn.seconds_at(1e-3) == pytest.approx(2.0)
    assert drawn.seconds_at(1e-1) == 1.0
    assert math.isnan(drawn.seconds_at(1e-5))
    assert drawn.floor == 1e-4


def test_a_lucky_run_at_a_loose_tolerance_counts():
    drawn = curve((1e-6, 1.0), (1e-3, 2.0), (1e-7, 4.0))
    assert drawn.seconds_at(1e-5) == 1.0
    assert 2.0 < drawn.seconds_at(5e-7) < 4.0


def test_a_curve_ends_with_its_first_run_beyond_the_limit():
    scene = models.load("michaelis_menten")
    found = work_precision(scene, rtols=RTOLS, orders=(), methods=(), peers=PEERS[:1], limit=1e-9)
    assert len(found["SciPy Radau"].points) == 1
    assert "1e-04" in found["SciPy Radau"].ended


def test_a_peer_that_is_not_installed_is_named():
    class Missing(Peer):
        name = "nobody's"
        package = "gsp-has-no-such-package"

        def prepare(self, flow, p, start, first, grid):
            raise AssertionError("not installed")

    scene = models.load("michaelis_menten")
    found = work_precision(scene, rtols=RTOLS, orders=(), methods=(Method.RADAU9,), peers=(Missing(),))
    assert found.omitted == {"nobody's": "gsp-has-no-such-package is not installed"}
    assert "without nobody's" in str(found)


def test_a_peer_that_fails_has_no_points():
    class Failing(Peer):
        name = "failing"
        package = "scipy"

        def prepare(self, flow, p, start, first, grid):
            return lambda rtol, atol: PeerRun(np.full((len(flow.states), len(grid)), np.nan))

    scene = models.load("michaelis_menten")
    found = work_precision(scene, rtols=RTOLS, orders=(), methods=(), peers=(Failing(),))
    assert found["failing"].points == ()
    # It is tried at every tolerance, and the last one tells how the ladder ended.
    assert found["failing"].ended == "did not reach the end at rtol 1e-08"
    assert math.isnan(found["failing"].floor)


x, y, epsilon = sp.symbols("x y epsilon")


def test_a_repelling_branch_is_run_backward():
    system = SlowFastSystem(slow={x: -x}, fast={y: y - x**2}, epsilon=epsilon, name="repelling")
    scene = Scene(system, {"x": (0, 4)}, {"x": 1, "y": 2}, (0, 1), 0.01, (0.02, 0.01), 1e-6, name="repelling")
    found = work_precision(scene, rtols=RTOLS, orders=(0, 1, 2), peers=())
    assert found.grid[-1] == -1.0
    assert "from the slow manifold" in found.start
    # The slow variable does not feel the fast one.
    assert found["reduced 0"].floor < 1e-8


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"rtols": ()}, "rtols has no value"),
        ({"rtols": (1e-20,)}, "rtols is a number from"),
    ],
)
def test_bad_input_is_named(arguments, message):
    with pytest.raises(DeclarationError, match=message):
        work_precision(models.load("michaelis_menten"), **arguments)


def test_curves_have_names() -> None:
    found = work_precision(models.load("linear"), orders=(0,), rtols=(1e-4,), peers=())
    with pytest.raises(GspError, match=r"The names are .*reduced 0"):
        found["reduced 9"]
