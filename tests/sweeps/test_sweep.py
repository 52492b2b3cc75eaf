"""A sweep gives what its task gives at every point, once, whoever computes it and however often it is stopped."""

from __future__ import annotations

import json
import math
import os
import resource
import signal
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp import models
from gsp.errors import DeclarationError, GspError, ModelFileError, OutputError
from gsp.readers.toml import BYTES
from gsp.results.point_verbs import point_verbs
from gsp.scenes.settings import ask_again
from gsp.sweeps import execution, ledger, worker
from gsp.sweeps.plan_file import read_plan_file
from gsp.sweeps.store import Store
from gsp.sweeps.sweep import Sweep, resume, sweep
from tests.sweeps.kills import disturb, finish
from tests.sweeps.work import contents, counted, deadly, hanging, long_record, of_scene, wave

AXES = {"x": np.linspace(0.0, 3.0, 13), "k": (-2.0, 0.5, 7.0)}


def waves(into: Path, **more) -> Sweep:
    return sweep(wave, **{"over": AXES, "into": into, "workers": 1, "points_per_chunk": 4, **more})


def test_every_point_holds_what_the_task_gives(tmp_path: Path) -> None:
    found = waves(tmp_path)
    data = found.to_xarray()
    assert found.is_complete
    assert found.computed == found.size == 39
    assert data.root.dims == ("x", "k")
    for x in AXES["x"]:
        for k in AXES["k"]:
            here = data.sel(x=x, k=k)
            assert here.root == math.sqrt(x)
            assert here.powers.values.tolist() == [x, x * k, x * k * k]
    assert set(np.unique(data.status)) == {1}
    assert data.status.attrs["flag_meanings"].split() == ["not_computed", "computed", "failed", "died"]


@pytest.mark.exhaustive
def test_any_number_of_processes_leaves_the_same_bytes(tmp_path: Path) -> None:
    alone, together = waves(tmp_path / "alone"), waves(tmp_path / "together", workers=2)
    assert alone.is_complete
    assert together.is_complete
    assert contents(tmp_path / "alone") == contents(tmp_path / "together")


def test_a_scene_is_swept_like_its_name(tmp_path: Path) -> None:
    asked = {
        "over": {"kappa": (0.5,), "epsilon": (0.01, 0.02)},
        "workers": 1,
        "options": {"orders": [0, 1]},
    }
    scene = models.load("michaelis_menten")
    made = sweep("compare", model=scene, into=tmp_path / "scene", **asked)
    named = sweep("compare", model="michaelis_menten", into=tmp_path / "name", **asked)
    assert made.to_xarray().error.values.tolist() == named.to_xarray().error.values.tolist()
    assert resume(tmp_path / "scene", workers=1).is_complete


@pytest.mark.parametrize("task", ["compare", "choose"])
def test_a_task_that_needs_a_small_parameter_says_so(tmp_path: Path, task: str) -> None:
    x, k = sp.symbols("x k")
    scene = gsp.Scene(gsp.VectorField({x: -k * x}, parameters={k: 1}), {}, {"x": 1}, (0, 1))
    with pytest.raises(GspError, match=f"no small parameter, and {task} needs one"):
        sweep(task, model=scene, over={"k": (1, 2)}, into=tmp_path, workers=1)
    found = sweep("integrate", model=scene, over={"k": (1, 2)}, into=tmp_path, workers=1).to_xarray()
    assert found.final.values[:, 0] == pytest.approx(np.exp([-1, -2]), rel=1e-5)


def test_a_claim_without_a_measure_has_its_cause(tmp_path: Path) -> None:
    scene = models.load("van_der_pol")
    over = {"y": (float(scene.start["y"]), -0.5), "epsilon": (0.01,)}
    data = sweep(
        "failure_map", model=scene, into=tmp_path, over=over, options={"orders": [0]}, workers=1
    ).to_xarray()
    words = data.ending.attrs["flag_meanings"].split()
    endings = [[words[code] for code in row] for row in data.ending.values[:, 0]]
    assert endings == [["SUCCESS", "SUCCESS"], ["FOLD_REACHED", "SUCCESS"]]
    assert np.isnan(data.measure.values[:, 0]).tolist() == [[False, False], [True, False]]


def test_an_error_that_is_none_has_its_cause(tmp_path: Path) -> None:
    """Past the fold no reduced run reaches the end; what is recorded comes back with a changed plan too."""
    scene = models.load("van_der_pol")
    ask = {"model": scene, "into": tmp_path, "options": {"orders": [0, 1]}, "workers": 1}
    y = float(scene.start["y"])
    for starts in ((y,), (y, -0.5)):
        data = sweep("compare", over={"y": starts, "epsilon": (0.01,)}, **ask).to_xarray()
    words = data.ending.attrs["flag_meanings"].split()
    assert data.ending.dims == ("y", "epsilon", "order")
    endings = [[words[code] for code in row] for row in data.ending.values[:, 0]]
    assert endings == [["SUCCESS", "SUCCESS"], ["FOLD_REACHED", "FOLD_REACHED"]]
    assert np.isnan(data.error.values[:, 0]).tolist() == [[False, False], [True, True]]
    fresh = sweep(
        "compare", over={"y": starts, "epsilon": (0.01,)}, **{**ask, "into": tmp_path.with_name("fresh")}
    )
    assert fresh.to_xarray().identical(data)


def test_a_point_that_fails_is_data(tmp_path: Path) -> None:
    found = waves(tmp_path, over={"x": (-1.0, 4.0, -9.0), "k": (1.0,)})
    data = found.to_xarray()
    assert data.status.values.ravel().tolist() == [2, 1, 2]
    assert np.isnan(data.root.values).ravel().tolist() == [True, False, True]
    assert found.failed == 2
    assert [f["x"] for f in found.failures()] == [-1.0, -9.0]
    assert found.failures(1)[0]["message"] == "ValueError: the root of -1.0 is not real"
    assert "the root of -1.0 is not real" in str(found)


def test_a_task_that_fails_everywhere_is_refused_with_its_own_words(tmp_path: Path) -> None:
    with pytest.raises(DeclarationError, match=r"failed at all of 2 points.*the root of -2\.0 is not real"):
        waves(tmp_path, over={"x": (-2.0, -1.0), "k": (1.0,)})
    assert list(tmp_path.iterdir()) == []


def test_progress_counts_at_once_what_others_have_done() -> None:
    store, shares = (
        SimpleNamespace(ledger=SimpleNamespace(done=lambda: {0, 2, 3}), plan=SimpleNamespace(chunks=4)),
        [],
    )
    tally = execution._Tally(cast("Store", store), shares.append)
    tally.tell(0)
    assert shares == [0.75]


def test_an_interrupted_sweep_goes_on_where_it_stopped_and_computes_no_point_twice(tmp_path: Path) -> None:
    log, into = tmp_path / "log", tmp_path / "runs"

    def stop(share: float) -> None:
        if share > 0.4:
            raise KeyboardInterrupt

    call = {
        "over": {"x": range(20)}, "into": into, "options": {"log": str(log)},
        "workers": 1, "points_per_chunk": 3,
    }  # fmt: skip
    with pytest.raises(KeyboardInterrupt):
        sweep(counted, **call, progress=stop)
    halfway = Sweep(into)
    assert 0 < halfway.computed < halfway.size
    data = halfway.to_xarray()
    assert np.array_equal(np.isnan(data.value), data.status == 0)
    shares: list[float] = []
    assert sweep(counted, **call, progress=shares.append).is_complete
    assert sorted(map(float, log.read_text().split())) == list(range(20))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_changed_plan_computes_what_is_new(tmp_path: Path) -> None:
    log, into = tmp_path / "log", tmp_path / "runs"
    call = {"into": into, "options": {"log": str(log)}, "workers": 1}
    sweep(counted, over={"x": range(0, 20, 2)}, points_per_chunk=3, **call)
    found = sweep(counted, over={"x": range(20)}, points_per_chunk=4, **call)
    assert found.to_xarray().value.values.tolist() == list(range(20))
    assert sorted(map(float, log.read_text().split())) == list(range(20))
    # And back: the first plan is complete already.
    assert sweep(counted, over={"x": range(0, 20, 2)}, **call).size == 10
    assert len(log.read_text().split()) == 20


def test_a_changed_model_is_refused_by_name_unless_told_to_start_anew(tmp_path: Path) -> None:
    file, into = tmp_path / "model.toml", tmp_path / "runs"
    text = (
        '[parameters]\nk = 2\n[slow]\nx = "-x"\n[fast]\ny = "k*x - y"\n[region]\nx = [0, 1]\n'
        "[start]\nx = 1\ny = 0\n[scene]\nspan = [0, 1]\nepsilon = 0.1\n"
    )
    file.write_text(text)
    call = {"model": file, "over": {"epsilon": (0.1, 0.2)}, "into": into, "workers": 1}
    assert sweep("integrate", **call).is_complete
    file.write_text(text.replace("-x", "-2*x") + "tolerance = 1e-5\n")
    before = contents(into)
    with pytest.raises(DeclarationError, match=r"other values of: equations, tolerance\..*anew"):
        sweep("integrate", **call)
    assert contents(into) == before
    assert sweep("integrate", **call, anew=True).is_complete
    assert contents(into) != before
    # A comment changes no result.
    file.write_text("# the same\n" + file.read_text())
    assert sweep("integrate", **call).is_complete


def test_a_missing_or_damaged_block_is_never_read_as_a_value(tmp_path: Path) -> None:
    found = waves(tmp_path)
    whole = contents(tmp_path)
    blocks = sorted(tmp_path.glob("data-*/points.zarr/root/c/*/*"))
    blocks[1].unlink()
    assert np.isnan(Sweep(tmp_path).to_xarray().root.values).sum() == 3
    os.truncate(blocks[4], 5)
    assert found.strike_damaged() == 2
    assert waves(tmp_path).is_complete
    assert contents(tmp_path) == whole


@pytest.mark.exhaustive
def test_a_point_that_kills_its_process_has_died_and_the_others_have_not(tmp_path: Path) -> None:
    found = sweep(
        deadly, over={"x": range(40)}, into=tmp_path, options={"home": os.getpid()}, workers=2,
        points_per_chunk=10,
    )  # fmt: skip
    assert found.to_xarray().status.values.tolist() == [3 if x == 3 else 1 for x in range(40)]
    assert found.failures()[0]["message"] == "the process that computed it died, 3 times"


def test_a_point_that_kills_its_process_while_it_is_timed_kills_no_client(tmp_path: Path) -> None:
    # The points 0 and 3 are timed to plan, and all points stand in one chunk.
    found = sweep(deadly, over={"x": range(3, 9)}, into=tmp_path, options={"home": 0}, workers=2)
    assert found.plan.chunks == 1
    assert found.to_xarray().status.values.tolist() == [3, 1, 1, 1, 1, 1]


def test_a_task_that_kills_every_process_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DeclarationError, match=r"failed at all of 1 points.*the process that computed it died"):
        sweep(deadly, over={"x": (3.0,)}, into=tmp_path, options={"home": 0}, workers=2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("points_per_chunk", [None, 2])
def test_ctrl_c_ends_a_point_that_hangs(
    tmp_path: Path, points_per_chunk: int | None, interruptible: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Where the size of chunks is given the point hangs in a chunk, else while it is timed.
    monkeypatch.setattr(execution, "GRACE", 0.1)
    begun = tmp_path / "begun"
    threading.Thread(target=_interrupt_after, args=(begun,), daemon=True).start()
    into = tmp_path / "runs"
    with pytest.raises(KeyboardInterrupt, match=f"goes on with the sweep in {into}"):
        sweep(
            hanging, over={"x": range(2)}, into=into, options={"begun": str(begun)}, workers=2,
            points_per_chunk=points_per_chunk,
        )  # fmt: skip


def _interrupt_after(begun: Path) -> None:
    while not begun.exists():
        time.sleep(0.01)
    os.kill(os.getpid(), signal.SIGINT)


def test_a_full_disk_is_named_and_the_same_call_goes_on(tmp_path: Path) -> None:
    call = {"over": {"x": range(20)}, "into": tmp_path, "workers": 1, "points_per_chunk": 2}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with pytest.raises(OutputError, match=r"the sweep in .* stopped: .*the same call goes on"):
            sweep(long_record, **call, progress=_limit_files)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert 0 < Sweep(tmp_path).computed < 20
    assert sweep(long_record, **call).is_complete


def _limit_files(share: float) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


def test_a_worker_sees_a_model_and_a_plan_that_took_the_place_of_others(tmp_path: Path) -> None:
    # As the workers of a cluster do, which outlive a sweep that is begun anew.
    scene = models.load("michaelis_menten")
    call = {"over": {"epsilon": (0.01, 0.02)}, "into": tmp_path, "workers": 1, "anew": True}
    found = []
    for kappa in (0.5, 2.0):
        changed = ask_again(scene, parameters={"kappa": kappa})
        data = sweep(of_scene, model=changed, points_per_chunk=1, **call).to_xarray()
        found += data.parameter.values.tolist()
    assert found == [0.5, 0.5, 2.0, 2.0]


def test_an_earlier_plan_with_other_variables_is_not_looked_up(tmp_path: Path) -> None:
    store = Store.open(next(waves(tmp_path).folder.glob("data-*")))
    coordinates = {"x": 0.25, "k": 7.0}
    found = worker._looked_up(store, coordinates, store.plan.variables)
    assert found is not None
    assert found["root"] == 0.5
    fewer = {"root": store.plan.variables["root"]}
    assert worker._looked_up(store, coordinates, fewer) is None
    assert worker._looked_up(store, {"x": 0.3, "k": 7.0}, store.plan.variables) is None


def test_a_claim_is_respected_until_its_process_has_ended(tmp_path: Path) -> None:
    waves(tmp_path)
    store = Store.open(next(tmp_path.glob("data-*")))
    claim = store.folder / "claims" / "000002"
    claim.write_text("another host 1")
    with store.ledger.claimed(2) as mine:
        assert not mine
    assert claim.read_text() == "another host 1"
    # Not heard of for long, by the clock of the file system.
    os.utime(claim, (1.0, 1.0))
    with store.ledger.claimed(2) as mine:
        assert mine
    assert not claim.exists()
    claim.write_text(f"{ledger.this_host()} 4194304999")
    with store.ledger.claimed(2) as mine:
        assert mine
    # The same name with another table of processes, as in containers: who is alive there cannot be seen.
    claim.write_text(f"{ledger.this_host()}0 4194304999")
    with store.ledger.claimed(2) as mine:
        assert not mine


def test_what_killed_planners_have_left_is_removed_in_the_end(tmp_path: Path) -> None:
    here = ledger.this_host()
    for name in (
        f"data-0.{here}.4194304999.partial",
        f"data-0.{here}.{os.getpid()}.partial",
        "data-0.there.1.partial",
    ):
        (tmp_path / name).mkdir()
    (tmp_path / "plan.json.0.partial").write_text("{")
    assert waves(tmp_path).is_complete
    left = sorted(path.name for path in tmp_path.glob("*.partial"))
    assert left == sorted([f"data-0.{here}.{os.getpid()}.partial", "data-0.there.1.partial"])


@pytest.mark.parametrize("step", ["_measured", "Store.create", "Path.rename", "write_whole"])
def test_a_sweep_of_a_model_that_was_killed_while_it_was_planned_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    asked = {"over": {"kappa": (0.5, 1.5)}, "model": models.load("michaelis_menten"), "workers": 1}
    runs = tmp_path / "runs"

    def killed(*_: object, **__: object) -> None:
        raise SystemExit

    with monkeypatch.context() as patched:
        patched.setattr(f"gsp.sweeps.planning.{step}", killed)
        # Nothing is put away after a kill.
        patched.setattr("gsp.sweeps.planning.shutil.rmtree", lambda *_, **__: None)
        with pytest.raises(SystemExit):
            sweep(of_scene, into=runs, **asked)
    assert sweep(of_scene, into=runs, **asked).is_complete
    sweep(of_scene, into=tmp_path / "calm", **asked)
    # What a living process has half built is its own.
    found = {name: content for name, content in contents(runs).items() if ".partial/" not in name}
    assert found == contents(tmp_path / "calm")


def test_a_claim_gives_signs_of_life(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    waves(tmp_path)
    store = Store.open(next(tmp_path.glob("data-*")))
    monkeypatch.setattr(ledger, "HEARTBEAT", 0.01)
    claim = store.folder / "claims" / "000000"
    with store.ledger.claimed(0) as mine:
        assert mine
        os.utime(claim, (1.0, 1.0))
        for _ in range(1000):
            if claim.stat().st_mtime > 2.0:
                break
            ledger.threading.Event().wait(0.01)
        assert claim.stat().st_mtime > 2.0


@pytest.mark.exhaustive
def test_verbs_record_what_the_package_answers(tmp_path: Path) -> None:
    epsilons = (0.02, 0.05)
    scene = models.load("michaelis_menten")
    compared = sweep(
        gsp.compare, model="michaelis_menten", over={"epsilon": epsilons}, into=tmp_path / "a", workers=1,
        options={"orders": [0, 1]},
    ).to_xarray()  # fmt: skip
    ours = gsp.compare(scene, orders=(0, 1), epsilons=epsilons)
    for order in (0, 1):
        for i, epsilon in enumerate(ours.epsilons):
            assert float(compared.error.sel(epsilon=epsilon, order=order)) == ours.errors[order][i]
    verdicts = sweep(
        "classify", model="van_der_pol", over={"epsilon": epsilons}, into=tmp_path / "b", workers=1
    ).to_xarray()
    kinds = verdicts.kind.attrs["flag_meanings"].split()
    assert [kinds[k] for k in verdicts.kind.values] == ["attracting"] * 2
    assert float(verdicts.gap[0]) == gsp.study(models.load("van_der_pol")).hyperbolicity.gap


@pytest.mark.exhaustive
def test_each_verb_does_on_the_scene_of_the_home_example(tmp_path: Path) -> None:
    for task in sorted(set(point_verbs()) - {"canard_value", "periodic_orbit"}):
        found = sweep(
            task, model="chaplygin_sleigh", over={"epsilon": (0.02,)}, into=tmp_path / task, workers=1
        )
        assert found.failed == 0, found


@pytest.fixture
def planar(tmp_path: Path) -> Path:
    """Van der Pol's oscillator with a parameter."""
    file = tmp_path / "vdp.toml"
    file.write_text(
        '[parameters]\na = 0\nb = 1\n[slow]\ny = "a - x"\n[fast]\nx = "b*y - x^3/3 + x"\n[region]\n'
        "y = [-0.5, 0.5]\nx = [1.2, 3]\n[start]\nx = 2\ny = 0\n[scene]\nspan = [0, 1]\nepsilon = 0.05\n"
    )
    return file


def test_canard_values_over_a_parameter(tmp_path: Path, planar: Path) -> None:
    found = sweep(
        "canard_value", model=planar, over={"b": (1.0, 2.0), "epsilon": (0.01, 0.02)}, into=tmp_path / "c",
        options={"parameter": "a"}, workers=1,
    )  # fmt: skip
    data = found.to_xarray()
    # With b y for y and b t for t the slow equation has b = 1, and epsilon b stands for epsilon.
    assert data.value.sel(b=1.0, epsilon=0.01).item() == pytest.approx(
        1 - 0.01 / 8 - 3 * 0.01**2 / 32, abs=2e-7
    )
    same = data.value.sel(b=2.0, epsilon=0.01).item(), data.value.sel(b=1.0, epsilon=0.02).item()
    assert same[0] == pytest.approx(same[1], rel=1e-10)
    assert data.coefficients.sel(b=1.0, epsilon=0.01).values[:3].tolist() == [1.0, -0.125, -0.09375]


def test_periods_over_epsilon(tmp_path: Path, planar: Path) -> None:
    found = sweep("periodic_orbit", model=planar, over={"epsilon": (0.01,)}, into=tmp_path / "p", workers=1)
    assert float(found.to_xarray().period[0]) * 10 == pytest.approx(19.078369567, abs=2e-9)


def test_axes_move_the_scene(tmp_path: Path) -> None:
    found = sweep(
        of_scene, model="michaelis_menten", into=tmp_path, workers=1,
        over={"epsilon": (0.01, 0.03), "tolerance": (1e-4,), "kappa": (1.0, 2.0), "s": (0.5, 1.5)},
    ).to_xarray()  # fmt: skip
    for name, axis in (("asked", "epsilon"), ("wanted", "tolerance"), ("parameter", "kappa"), ("begun", "s")):
        assert found.status.values.min() == 1
        # The same along every other axis.
        wanted = found[name].broadcast_like(found[name]).values
        assert np.array_equal(
            wanted, np.broadcast_to(found[axis].broadcast_like(found[name]).values, wanted.shape)
        )


def test_what_a_task_calls_like_an_axis_has_another_name(tmp_path: Path) -> None:
    found = sweep("tests.sweeps.work:named", over={"x": (1.0, 2.0)}, into=tmp_path, workers=1).to_xarray()
    assert found.named_x.values.tolist() == [2.0, 4.0]


FEW_POINTS = 480


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a sweep leaves that nobody disturbs."""
    into = tmp_path_factory.mktemp("calm") / "sweep"
    finish("files", into, FEW_POINTS)
    return into


@pytest.mark.exhaustive
@pytest.mark.parametrize("way", ["processes", "cluster", "files"])
def test_nothing_is_lost_or_wrong_when_processes_are_killed(tmp_path: Path, calm: Path, way: str) -> None:
    kills, wrong = disturb(tmp_path, way=way, kills=2, seed=1, calm=calm, points=FEW_POINTS)
    assert kills == 2
    assert wrong == []


@pytest.mark.exhaustive
def test_a_cluster_shares_the_work(tmp_path: Path) -> None:
    distributed = pytest.importorskip("distributed")
    alone = waves(tmp_path / "alone")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert waves(tmp_path / "there", workers=None, client=client).is_complete
    assert alone.is_complete
    assert contents(tmp_path / "alone") == contents(tmp_path / "there")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"task": "compute"}, r"no sweep does 'compute'.*compare"),
        ({"task": lambda x: {}}, "Put the function into a module"),
        ({"task": "no_such_module:f"}, "cannot be imported"),
        ({"over": {}}, "over maps each axis"),
        ({"over": {"x": ()}}, "one at least"),
        ({"over": {"x": (1.0, math.nan)}}, "finite"),
        ({"over": {"x": (1.0, 2.0, 1.0)}}, "the value 1 twice"),
        ({"over": {"x": 3.0}}, "sequence of finite numbers"),
        ({"task": "compare", "model": "linear", "options": {"oders": 3}}, r"no option of compare.*orders"),
        ({"options": {"f": object()}}, "maps names to numbers, text"),
        ({"workers": 0}, "workers is a whole number"),
        ({"workers": 1, "client": "tcp://127.0.0.1:1"}, "one of the two"),
        ({"points_per_chunk": 0}, "points_per_chunk"),
        ({"progress": 3}, "progress is a function"),
        ({"anew": "yes"}, "anew is True or False"),
        ({"task": "compare"}, "Give one: model="),
        ({"task": "compare", "model": "chaplygin_sleigh"}, "x is no number of the model"),
        ({"task": "compare", "model": 3}, "built-in name, a model file or a Scene"),
        ({"task": "compare", "model": "nowhere.toml"}, "no such file"),
    ],
)
def test_a_call_that_cannot_be_carried_out_is_refused(tmp_path: Path, changes, words: str) -> None:
    call = {"task": wave, "over": {"x": (1.0,), "k": (1.0,)}, "into": tmp_path / "runs", **changes}
    with pytest.raises(GspError, match=words):
        sweep(**call)


def test_a_model_that_is_no_regular_file_or_too_large_is_not_read(tmp_path: Path) -> None:
    pipe, large = tmp_path / "pipe.toml", tmp_path / "large.toml"
    os.mkfifo(pipe)
    large.write_bytes(b"#" * (BYTES + 1))
    for model, words in (
        (pipe, "no regular file"), (Path("/dev/zero"), "no regular file"), (tmp_path, "no regular file"),
        (large, "larger than 256 KiB"),
    ):  # fmt: skip
        with pytest.raises(ModelFileError, match=words):
            sweep("compare", over={"x": (1.0,)}, into=tmp_path / "runs", model=model)
    with pytest.raises(ModelFileError, match="no regular file"):
        read_plan_file(pipe)


def test_folders_of_others_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("finished")
    with pytest.raises(OutputError, match="other files"):
        waves(tmp_path)
    assert (tmp_path / "thesis.tex").read_text() == "finished"
    (tmp_path / "thesis.tex").rename(tmp_path / "model.toml")
    with pytest.raises(OutputError, match=r"other files.*model\.toml"):
        sweep(of_scene, over={"kappa": (1.0,)}, into=tmp_path, model=models.load("michaelis_menten"), workers=1)
    with pytest.raises(OutputError, match="holds no sweep"):
        Sweep(tmp_path)
    (tmp_path / "plan.json").write_text(json.dumps({"data": "../../etc"}))
    with pytest.raises(OutputError, match="holds no sweep"):
        Sweep(tmp_path)


@pytest.mark.exhaustive
def test_a_plan_of_ten_million_points_opens_at_once(tmp_path: Path) -> None:
    # Counted, not timed: opening and progress look at names of chunks alone.
    over = {"x": np.linspace(0.0, 1.0, 4000), "k": np.linspace(0.0, 1.0, 2500)}
    with pytest.raises(KeyboardInterrupt):
        waves(tmp_path, over=over, points_per_chunk=None, progress=_stop)
    found = Sweep(tmp_path)
    assert found.size == 10_000_000
    assert found.plan.chunks <= 100_000
    assert 0 < found.computed < 10_000_000
    assert found.to_xarray().root.shape == (4000, 2500)


def _stop(share: float) -> None:
    raise KeyboardInterrupt


def test_a_sweep_goes_on_from_its_folder(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        sweep(
            "integrate", model="michaelis_menten", over={"epsilon": (0.01, 0.02, 0.03, 0.04)}, into=tmp_path,
            workers=1, points_per_chunk=1, progress=_stop,
        )  # fmt: skip
    assert resume(tmp_path, workers=1).is_complete


def test_chunks_hold_about_a_second(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # The clock of the plan goes a tenth of a second further at every look, so that a point takes that long.
    ticks = iter(range(10_000))
    monkeypatch.setattr(worker.time, "perf_counter", lambda: 0.1 * next(ticks))
    found = waves(tmp_path, points_per_chunk=None)
    assert found.plan.block == (3, 3)


def test_processes_that_cannot_start_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execution, "_begin_worker", _die)
    with pytest.raises(OutputError, match="__main__"):
        waves(tmp_path, workers=2)


def _die(numbers: object) -> None:
    os._exit(1)


def test_the_name_of_0_2_0_still_works_and_warns(tmp_path: Path) -> None:
    found = waves(tmp_path)
    with pytest.warns(DeprecationWarning, match="to_xarray"):
        assert found.as_dataset().identical(found.to_xarray())
