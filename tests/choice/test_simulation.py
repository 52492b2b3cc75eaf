"""Simulation: reduced where it holds and full where it does not, over folds, regions and layers, in one solution."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import sympy as sp

from gsp import models
from gsp.choice.candidates import ModelKind
from gsp.choice.choice import choose
from gsp.choice.hybrid_run import HybridRun
from gsp.choice.model_switching import SOLVED_LOOKS, _Nearness, _Switcher, run_solved
from gsp.choice.prediction import Failure
from gsp.choice.simulation import simulate
from gsp.errors import DeclarationError, GspError, Status
from gsp.integration.trajectory import integrate
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.slow.solved_manifold import solve_manifold
from gsp.systems.system import SlowFastSystem, VectorField

x, y, w, eps = sp.symbols("x y w epsilon")


def relaxation(epsilon: float, tolerance: float, *, end: float = 8.0) -> Scene:
    """Van der Pol's oscillator through its jumps."""
    return replace(
        models.load("van_der_pol"),
        region={"y": (-2, 2), "x": (-3, 3)},
        span=(0, end),
        epsilon=epsilon,
        tolerance=tolerance,
    )


def reference(scene: Scene, times: np.ndarray):
    return integrate(
        scene.full_flow,
        start=scene.full_start,
        span=scene.span,
        epsilon=scene.epsilon,
        rtol=1e-12,
        atol=1e-14,
        at=times,
    )


@pytest.fixture(scope="module")
def oscillation():
    return simulate(relaxation(1e-3, 1e-4))


@pytest.mark.exhaustive
@pytest.mark.parametrize(("epsilon", "tolerance"), [(1e-2, 1e-3), (1e-3, 1e-6), (1e-3, 1e-4), (1e-4, 1e-6)])
def test_relaxation_oscillations_keep_to_the_tolerance_over_several_periods(
    epsilon: float, tolerance: float
) -> None:
    scene = relaxation(epsilon, tolerance)
    run = simulate(scene)
    assert run.status is Status.SUCCESS
    # A period is 3 - 2 ln 2 and something of the size of epsilon^(2/3): nine jumps or eight in this span.
    assert len(run.switches) in (16, 18)
    assert run.reduced_share > 0.6
    times = np.linspace(run.layer, 8, 1500)
    error = np.abs(run.sample(times)["y"] - reference(scene, times)["y"]).max()
    # Errors of y on the way to a fold become errors of time, and y moves twice as fast after the jump.
    assert error <= 2 * tolerance * 2 / 3


def test_models_alternate_and_pieces_meet(oscillation) -> None:
    labels = [switch.entering for switch in oscillation.switches]
    assert set(labels[::2]) == {"full"}
    assert len(set(labels[1::2])) == 1
    assert labels[1].startswith("reduced")
    for before, after in zip(oscillation.pieces, oscillation.pieces[1:]):
        assert before.end == after.begin
        for name in oscillation.names:
            left, right = (p.run.sample(before.end)[name][0] for p in (before, after))
            # The state has landed when it is within the tolerance, relative to 1 + |x|, of the slow manifold.
            assert left == pytest.approx(right, abs=1e-4 * 3.1)
    for switch in oscillation.switches:
        assert oscillation.at(switch.time) == pytest.approx(list(switch.state.values()), abs=1e-6)


def test_the_reduced_flow_is_left_before_the_fold_and_taken_up_on_the_other_sheet(oscillation) -> None:
    for switch in oscillation.switches:
        if switch.entering == "full":
            assert 1.0 < abs(switch.state["x"]) < 1.4
        else:
            assert abs(switch.state["x"]) > 1.7
            assert switch.why.startswith("landed where the gap is")


@pytest.mark.exhaustive
def test_the_distance_to_the_fold_at_which_it_is_left_grows_like_epsilon_to_two_thirds() -> None:
    # Where the terms of the series are as large as one another: epsilon/(distance in x)^3 is constant.
    ladder = np.array([1e-3, 1e-4, 1e-5])
    distances = []
    for epsilon in ladder:
        scene = relaxation(float(epsilon), 0.3, end=1.2)
        choice = choose(scene, orders=(2,), solve=False)
        switch = simulate(scene, choice=choice).switches[0]
        assert switch.why == str(Failure.ORDER)
        distances.append(switch.state["y"] + 2 / 3)
    assert np.polyfit(np.log(ladder), np.log(distances), 1)[0] == pytest.approx(2 / 3, abs=0.05)


@pytest.mark.exhaustive
def test_two_fast_variables_and_an_implicit_branch() -> None:
    system = SlowFastSystem(slow={y: -x + w / 5}, fast={x: y - x**3 / 3 + x, w: x**2 - w}, epsilon=eps)
    scene = Scene(
        system,
        {"y": (-3, 3), "x": (-3, 3), "w": (-1, 9)},
        {"y": 2 / 3, "x": 2, "w": 4},
        (0, 4),
        1e-3,
        (0.02, 0.01),
        1e-4,
    )
    run = simulate(scene, choice=choose(scene, solve=False))
    assert len(run.switches) == 8
    times = np.linspace(run.layer, 4, 800)
    assert np.abs(run.sample(times)["y"] - reference(scene, times)["y"]).max() < 1e-4


@pytest.mark.exhaustive
def test_a_scene_that_is_reduced_throughout_is_one_piece_and_tells_its_layer() -> None:
    scene = replace(models.load("lindemann"), tolerance=1e-4)
    choice = choose(scene, solve=False)
    # What costs less is a matter of the machine; here it is reduced in any case.
    reduced = replace(choice, model=next(c for c in choice.candidates if c.valid and c.order is not None))
    run = simulate(scene, choice=reduced)
    assert [piece.kind for piece in run.pieces] == [ModelKind.REDUCED]
    assert run.layer == choice.layer > 0
    assert run.reduced_share == 1
    times = np.linspace(run.layer, 5, 200)
    assert np.abs(run.sample(times)["x"] - reference(scene, times)["x"]).max() < 1e-4


@pytest.mark.exhaustive
def test_raw_variables_and_reconstruction_are_there_in_every_model() -> None:
    scene = models.load("chaplygin_sleigh")
    choice = choose(scene)
    times = np.linspace(choice.layer, 12, 100)
    expected = reference(scene, times)
    models_ = {c.label: c for c in choice.candidates if c.valid}
    assert set(models_) == {"solved", "full"}
    for label in models_:
        whole = replace(choice, model=models_[label])
        if label == "full":
            whole = replace(whole, manifold=None)
        elif whole.manifold is None:
            continue
        run = simulate(scene, choice=whole).sample(times)
        for name in ("v", "omega", "phi", "x", "y"):
            assert np.abs(run[name] - expected[name]).max() < 3e-6


@pytest.mark.exhaustive
def test_reconstruction_goes_with_the_reduced_flow_too() -> None:
    scene = replace(models.load("chaplygin_sleigh"), tolerance=1e-3)
    choice = choose(scene, solve=False)
    run = simulate(scene, choice=replace(choice, model=choice.candidates[2]))
    assert run.pieces[0].label == "reduced 2"
    times = np.linspace(choice.layer, 12, 100)
    expected = reference(scene, times)
    for name in ("v", "omega", "phi", "x", "y"):
        assert np.abs(run.sample(times)[name] - expected[name]).max() < 1e-2


def test_outside_the_region_the_full_system_runs() -> None:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - y}, epsilon=eps)
    scene = Scene(system, {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 2), 0.01, (0.02, 0.01), 1e-3)
    run = simulate(scene)
    assert [(s.entering, s.why) for s in run.switches] == [("full", str(Failure.REGION))]
    assert run.switches[0].time == pytest.approx(1, abs=1e-3)
    assert run["x"][-1] == pytest.approx(3)


@pytest.mark.parametrize("span", [(0.0, 2.0), (0.0, 0.4)])
def test_a_solved_manifold_is_left_where_the_piece_that_was_solved_ends(span: tuple[float, float]) -> None:
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: x - y}, epsilon=eps)
    study = study_of(Scene(system, {"x": (0, 4)}, {"x": 1, "y": 0}, span, 0.01, (0.02, 0.01), 1e-3))
    run = HybridRun(study, True)
    run_solved(run, solve_manifold(study.branch, region={"x": (0.5, 1.5)}, epsilon=0.01, tolerance=1e-6))
    whole = span[1] < 0.5
    assert [piece.kind for piece in run.pieces] == (
        [ModelKind.SOLVED] if whole else [ModelKind.SOLVED, ModelKind.FULL]
    )
    assert [(s.leaving, s.entering) for s in run.switches] == ([] if whole else [("solved", "full")])
    end = run.pieces[0].end
    # x = 1 + t leaves 1.5 between two of the places that are looked at.
    assert end == span[1] if whole else 0.5 - 2 * 2 / SOLVED_LOOKS < end <= 0.5
    # On the manifold y = x - epsilon.
    last = run.pieces[-1].run.sample(np.array([span[1]]))
    assert (last["x"][0], last["y"][0]) == pytest.approx((1 + span[1], 0.99 + span[1]), abs=1e-3)


@pytest.mark.exhaustive
def test_a_simulation_does_not_depend_on_when_the_clock_began() -> None:
    asked = replace(models.load("van_der_pol"), span=(0, 3), tolerance=1e-3)
    scenes = [replace(asked, span=(begin, begin + 3)) for begin in (0, 7)]
    here, later = (simulate(scene, choice=choose(scene, solve=False)) for scene in scenes)
    assert len(here.switches) > 2
    assert [p.label for p in later.pieces] == [p.label for p in here.pieces]
    for own, other in zip(here.pieces, later.pieces):
        assert (other.begin - 7, other.end - 7) == pytest.approx((own.begin, own.end), abs=1e-4)
    for own, other in zip(here.switches, later.switches):
        assert other.time - 7 == pytest.approx(own.time, abs=1e-4)
    assert later.layer == pytest.approx(here.layer, rel=1e-6)
    assert later.reduced_share == pytest.approx(here.reduced_share, abs=1e-3)
    times = np.linspace(0, 3, 200)
    assert later.sample(times + 7)["y"] == pytest.approx(here.sample(times)["y"], abs=1e-3)


def test_of_two_sheets_the_one_that_is_landed_on_first_is_taken() -> None:
    def near(first: int) -> _Nearness:
        return _Nearness(np.arange(20) >= first, np.zeros(20), np.ones(20))

    switcher = _Switcher.__new__(_Switcher)
    switcher.epsilon, switcher.barred = 0.5, -np.inf
    times = np.arange(20.0)
    run = SimpleNamespace(y=np.zeros((2, 20)))
    for first, second, taken in ((9, 4, 1), (4, 9, 0), (4, 4, 0)):
        found = dict(zip("ab", (near(first), near(second))))
        switcher.sheets = list(found)
        switcher._nearness = lambda sheet, states, found=found: found[sheet]
        landing = switcher._landing(run, times, 1.0)
        assert landing is not None
        assert landing[:2] == ("ab"[taken], min(first, second))


def test_what_cannot_be_reduced_is_run_in_full() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: y - x}, epsilon=eps)
    scene = Scene(system, {"x": (-5, 5)}, {"x": 1, "y": 0.5}, (0, 0.05), 0.01, (0.02, 0.01), 1e-5)
    run = simulate(scene)
    assert [piece.kind for piece in run.pieces] == [ModelKind.FULL]
    assert not run.switches
    assert run.reduced_share == 0


def test_a_field_without_a_standard_form_is_run_as_it_was_declared() -> None:
    oscillator = VectorField({x: (1 + eps) * y, y: -(1 + eps) * x}, epsilon=eps)
    scene = Scene(oscillator, {"x": (-5, 5)}, {"x": 1, "y": 0}, (0, 2), 0.01, (0.02, 0.01), 1e-5)
    run = simulate(scene)
    assert [piece.kind for piece in run.pieces] == [ModelKind.FULL]
    assert run.names == ("x", "y")
    assert run.sample([2.0])["x"] == pytest.approx(np.cos([2.02]), abs=1e-5)


def test_a_blow_up_ends_the_simulation_with_its_status() -> None:
    system = SlowFastSystem(slow={x: x**2}, fast={y: x - y}, epsilon=eps)
    scene = Scene(system, {"x": (-5, 5)}, {"x": 1, "y": 1}, (0, 2), 0.01, (0.02, 0.01), 1e-5)
    run = simulate(scene)
    assert run.status is Status.STEP_TOO_SMALL
    assert run.t[-1] == pytest.approx(1, abs=1e-3)
    assert "STEP_TOO_SMALL" in run.message


def test_it_is_read_like_a_trajectory(oscillation) -> None:
    assert oscillation["x"].shape == oscillation.t.shape
    assert (np.diff(oscillation.t) > 0).all()
    assert oscillation.at(1.0).shape == (2,)
    assert oscillation.at([1.0, 2.0]).shape == (2, 2)
    for masked in (np.ma.masked, np.ma.array([1.0, 2.0], mask=[0, 1])):
        for read in (oscillation.at, oscillation.sample, oscillation.model_at):
            with pytest.raises(DeclarationError, match="masked"):
                read(masked)
    assert oscillation.names == ("y", "x")
    assert list(oscillation.model_at([0.1, oscillation.switches[0].time + 1e-6])) == [
        oscillation.pieces[0].label,
        "full",
    ]
    assert not oscillation.t.flags.writeable
    assert not oscillation.sample([1.0, 2.0]).t.flags.writeable
    assert "18 changes of model" in str(oscillation)
    assert "\n" not in repr(oscillation)
    assert "t=0..8, " in repr(oscillation)
    with pytest.raises(GspError, match="covers"):
        oscillation.at(9.0)
    with pytest.raises(GspError, match="no state"):
        oscillation["z"]


def test_a_choice_for_another_scene_is_refused() -> None:
    with pytest.raises(DeclarationError, match="made for"):
        simulate(models.load("linear"), choice=choose(models.load("lindemann"), solve=False))


def test_the_chart_draws_every_model_once_in_the_legend(oscillation) -> None:
    from gsp import charts

    for names in (None, ("t", "x")):
        axes = charts.switches(oscillation, None, names=names)
        legend = axes.get_legend()
        assert legend is not None
        labels = [text.get_text() for text in legend.get_texts()]
        assert labels[:3] == [oscillation.pieces[0].label, "full system", "change of model"]
        assert ("$M_0$" in labels) == (names is None)
    assert charts.png(axes)
