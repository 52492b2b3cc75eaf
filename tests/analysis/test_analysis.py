"""The whole pipeline on a scene: every stage present, its timings, and the refusals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp import load, models
from gsp.analysis.analysis import STAGES, _failures, _short, analyse
from gsp.choice.verdict import Answer
from gsp.errors import DeclarationError
from gsp.hyperbolicity.hyperbolicity import Kind
from gsp.scenes import study
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.systems.system import SlowFastSystem
from tests.analyses import analysis_of


@pytest.fixture(scope="module")
def sleigh():
    return analysis_of("chaplygin_sleigh")


@pytest.mark.exhaustive
def test_every_stage_is_there_and_timed(sleigh) -> None:
    assert set(sleigh.timings) == set(STAGES)
    assert all(seconds >= 0 for seconds in sleigh.timings.values())
    assert sleigh.hyperbolicity.kind is Kind.ATTRACTING
    assert sleigh.hyperbolicity.gap == pytest.approx(1.04)
    assert sleigh.hyperbolicity.holds


@pytest.mark.exhaustive
def test_pictured_runs_go_from_the_friction_to_its_limit(sleigh) -> None:
    epsilons = sorted(sleigh.ladder)
    assert sleigh.full is sleigh.ladder[sleigh.scene.epsilon]
    ends = [sleigh.ladder[e].at(6.0)[-2:] for e in epsilons]
    limit = np.array([sleigh.limit.sample(6.0)[name] for name in ("x", "y")]).ravel()
    distances = [float(np.linalg.norm(end - limit)) for end in ends]
    assert distances == sorted(distances)


@pytest.mark.exhaustive
def test_landing_runs_end_on_the_slow_manifold(sleigh) -> None:
    assert sleigh.landing
    for run in sleigh.landing:
        x = np.array([[run["v"][-1], run["p"][-1]]])
        distance = abs(run["w"][-1] - sleigh.series.evaluate(x, sleigh.scene.epsilon)[0, 0])
        assert distance < 1e-3


@pytest.mark.exhaustive
def test_orders_whose_coefficients_are_too_long_are_not_run() -> None:
    olsen = study_of(load(Path(__file__).parents[1] / "systems" / "olsen.toml"), verb="analyse")
    assert olsen.series(3, symbolic=False).sizes == (3, 50, 915, 4682)
    # Order 2 is run as a program of 338 steps, order 3 would have 1166.
    assert olsen.short_series(3).order == 2
    assert olsen.short_series(3, at_least=3).order == 3
    assert _short(olsen, (0, 1, 2, 3)) == (0, 1, 2)
    assert _short(olsen, (3, 4)) == (3,)


@pytest.mark.exhaustive
def test_a_long_series_is_run_through_a_lower_order_and_the_analysis_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Its longest coefficients have 1, 2, 2 and 4 terms.
    monkeypatch.setattr(study, "LONGEST", 3)
    found = analyse(models.load("michaelis_menten"))
    assert (found.series.order, found.short_series.order) == (3, 2)
    assert list(found.comparison.errors) == [0, 1, 2]
    assert found.reduced.flow.order == 2
    assert "at order 3 it has coefficients of 4 terms, more than 3" in found.cut
    assert found.cut in str(found)


@pytest.mark.exhaustive
def test_a_scene_whose_region_holds_a_fold_is_analysed_as_far_as_it_goes(tmp_path) -> None:
    """FitzHugh and Nagumo as everybody gives it: the whole cycle, of which a slow piece alone can be reduced."""
    v, w, a, b, current = sp.symbols("v w a b I")
    system = gsp.SlowFastSystem(
        slow={w: v + a - b * w},
        fast={v: v - v**3 / 3 - w + current},
        epsilon=sp.Symbol("epsilon"),
        parameters={a: 0.7, b: 0.8, current: 0.5},
    )
    scene = gsp.Scene(system, {"w": (-0.5, 1.5), "v": (-2.5, 2.5)}, {"w": 0.5, "v": 1.5}, (0, 8), 0.05)
    found = analyse(scene)
    assert found.lost == {}
    assert found.hyperbolicity.kind is Kind.LOST
    assert found.choice.verdict.answer is Answer.NO
    orbit = found.boundary.orbit
    assert orbit is not None
    assert len(orbit.cycle) == 2
    assert found.base is not None
    assert found.base["w"] == pytest.approx(0.5, abs=0.02)
    page = gsp.write_report(found, tmp_path).read_text()
    for text in (
        "not normally hyperbolic (refuted on w",
        "orbits that reach it jump",
        "It ends here: ",
        "refuted",
    ):
        assert text in page
    # Nothing was measured, so that there is nothing to draw; the rest is there.
    assert not (tmp_path / "error_against_epsilon.png").exists()
    for name in ("time_series", "convergence", "failure_map", "critical_manifold", "phenomenon"):
        assert (tmp_path / f"{name}.png").exists()
    assert "the computation failed" not in page
    assert "does not land" not in page


@pytest.mark.exhaustive
def test_a_saddle_type_scene_is_analysed_without_landing_runs() -> None:
    s, x, y, eps = sp.symbols("s x y epsilon")
    system = SlowFastSystem(slow={s: -s}, fast={x: x + s**2, y: -y + x * s}, epsilon=eps)
    scene = Scene(system, {"s": (-1, 1)}, {"s": 0.5, "x": 0, "y": 0}, (0, 0.01), 0.01, (0.02, 0.01), 1e-6)
    analysis = analyse(scene, orders=(0,))
    assert analysis.hyperbolicity.kind is Kind.SADDLE
    assert analysis.landing == ()


def test_the_map_of_failures_is_coarse_and_starts_at_the_region(sleigh) -> None:
    found = sleigh.failures
    assert found is not None
    assert sleigh.failures_reason == ""
    assert found.places["slow manifold"].measure.shape == (11, 25)
    assert found.orders == (0, 1, 2)
    low, high = sleigh.study.region[found.axis]
    for n in found.orders:
        largest = found.holds_up_to(n, between=(low, high))
        inside = (found.positions > low - 1e-9) & (found.positions < high + 1e-9)
        holds = found.places[f"reduced flow {n}"].holds[:, inside]
        assert holds[found.epsilons <= largest].all()
        assert largest == found.epsilons[-1] or not holds[found.epsilons > largest][0].all()
    # What the comparison measured agrees with what the map says.
    ladder = dict(zip(sleigh.comparison.epsilons, sleigh.comparison.errors[2]))
    largest = found.holds_over_span(2)
    assert all(error <= found.tolerance for small, error in ladder.items() if small <= largest)


def test_a_region_without_slow_bounds_has_a_reason_in_place_of_a_map() -> None:
    s, x, eps = sp.symbols("s x epsilon")
    system = SlowFastSystem(slow={s: -s}, fast={x: -x + s}, epsilon=eps)
    scene = Scene(system, {"s": (0.1, 1)}, {"s": 0.5, "x": 0}, (0, 0.1), 0.01, (0.02, 0.01), 1e-6)
    study = study_of(replace(scene, region={"x": (0, 1)}))
    found, reason = _failures(study, lambda share: None)
    assert found is None
    assert "no slow variable" in reason


@pytest.mark.exhaustive
def test_progress_names_the_stages_in_order() -> None:
    seen: list[tuple[str, float]] = []
    analyse(models.load("linear"), orders=(0,), progress=lambda stage, share: seen.append((stage, share)))
    assert list(dict.fromkeys(stage for stage, _ in seen)) == list(STAGES)


def test_a_name_in_place_of_a_scene_is_named_with_the_remedy() -> None:
    with pytest.raises(DeclarationError, match=r"takes a Scene.*models\.load"):
        analyse("chaplygin_sleigh")  # pyright: ignore[reportArgumentType]


def test_runs_start_off_the_manifold_by_as_much_in_any_unit_and_far_from_the_origin() -> None:
    """Where nothing bounds the fast variable it was 1: moles were flat beside it, and pascals were on the manifold."""
    x, y, epsilon = sp.symbols("x y epsilon")
    found = []
    for unit, far in ((1, 0), (sp.Rational(1, 10**9), 0), (10**6, 10**7)):
        X, Y = (x - far) / unit, (y - far) / unit
        system = gsp.SlowFastSystem(slow={x: -unit * X}, fast={y: unit * (X - (X + 1) * Y)}, epsilon=epsilon)
        length, place = float(unit), float(far)
        region, start = {"x": (place + length / 10, place + 2 * length)}, {"x": place + length, "y": place}
        scene = gsp.Scene(system, region, start, (0, 2), 0.02)
        found.append(
            [(run["y"][0] - place) / length for run in gsp.analyse(scene, orders=(0, 1), order=1).landing]
        )
    assert len(found[0]) == 8
    assert found[1] == pytest.approx(found[0], rel=1e-6)
    assert found[2] == pytest.approx(found[0], rel=1e-6)
