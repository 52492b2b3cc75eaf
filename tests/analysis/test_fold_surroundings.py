"""Where a scene's reduction ends: folds with their passages, canard points, folded singularities, singular orbits."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp import load, models
from gsp.analysis.fold_surroundings import boundary_of, local_scales, never_folds, not_followed, surroundings
from gsp.critical.continuation.critical_sheet import CriticalSheet
from gsp.critical.critical_manifold import solve_critical
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.report import write_report
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.singular.passage.fold_passage import fold_passage
from gsp.systems.system import SlowFastSystem
from tests.literature import FOLDER

x, y, z, a, b, epsilon = sp.symbols("x y z a b epsilon")
REGION = {"y": (-0.6, 1.2), "x": (1.1, 2.2)}


def oscillator(shift, parameters) -> Scene:
    system = SlowFastSystem(
        slow={y: shift - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters=parameters
    )
    return Scene(system, REGION, {"y": 0.6, "x": 2}, (0, 0.3), 0.01, (0.02, 0.01), 1e-4)


def found(scene: Scene):
    study = study_of(scene)
    return boundary_of(study, classify(study.branch, region=study.region, epsilon=scene.epsilon))


@pytest.mark.exhaustive
def test_a_fold_beside_the_region_has_its_passage_and_the_orbit_its_period() -> None:
    scene = models.load("van_der_pol")
    ends = found(scene)
    (fold,) = ends.folds
    assert dict(fold.point) == pytest.approx({"x": 1, "y": -2 / 3})
    same = fold_passage(scene.system, fold.point)
    assert fold.passage is not None
    assert fold.passage.exit(0.01) == same.exit(0.01)
    assert fold.canard is None
    assert ends.orbit is not None
    assert ends.period == ends.orbit.coefficients
    assert ends.period == pytest.approx([3 - 2 * np.log(2), 7.014322231, 1 / 3])
    assert ends.has_folds


def test_a_canard_point_of_the_one_parameter_has_its_series() -> None:
    ends = found(oscillator(a, {a: 1}))
    (fold,) = ends.folds
    assert fold.passage is None
    assert "canard" in fold.reason
    assert fold.canard is not None
    assert fold.canard.coefficients == (1, sp.Rational(-1, 8))
    assert ends.period is None
    assert ends.orbit is not None
    assert "canard" in ends.orbit.message


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("shift", "parameters"), [(sp.Integer(1), {}), (a + b, {a: sp.Rational(1, 2), b: sp.Rational(1, 2)})]
)
def test_the_parameter_of_a_canard_point_is_not_guessed(shift, parameters) -> None:
    (fold,) = found(oscillator(shift, parameters)).folds
    assert fold.passage is None
    assert fold.canard is None


@pytest.mark.exhaustive
def test_folded_singularities_of_a_sheet_are_found() -> None:
    ends = found(models.load("koper"))
    assert {str(point.kind) for point in ends.folded} == {"folded node", "folded focus"}
    assert ends.folds == ()
    assert ends.orbit is not None
    assert "folded singularity" in ends.orbit.message


def test_explicit_branches_have_no_folds_and_cost_nothing() -> None:
    ends = found(models.load("michaelis_menten"))
    assert not ends.has_folds
    assert ends.surroundings is None
    assert ends.orbit is None
    assert repr(ends) == "Boundary(no folds)"


def test_a_sheet_outside_the_box_is_named_with_its_place() -> None:
    # Over y = 1 only the sheet through x = 2.1 is left; bounds on x that were meant for the left one do not hold it.
    system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    region = {"y": (-0.4, 1.2), "x": (-2.0, -1.2)}
    study = study_of(Scene(system, region, {"y": 1.0, "x": -1.5}, (0, 0.1), 0.01, (0.02, 0.01), 1e-4))
    obstacle = not_followed(study)
    assert obstacle is not None
    assert "the sheet of its run is at x = 2.1038, outside the box" in obstacle.fact
    assert surroundings(study) is None


def test_no_orbit_starts_on_a_repelling_branch() -> None:
    system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)
    region = {"y": (-0.4, 0.4), "x": (-0.6, 0.6)}
    scene = Scene(system, region, {"y": -0.1, "x": 0.1}, (0, 0.1), 0.01, (0.02, 0.01), 1e-4)
    ends = found(scene)
    assert ends.has_folds
    assert ends.orbit is None
    assert "repelling" in ends.orbit_reason


@pytest.mark.parametrize(
    ("graph", "never"),
    [(y**3 + sp.exp(y) / 7, True), (sp.tanh(y), True), (sp.asin(y / 9), False), (sp.sqrt(9 - y), False)],
    ids=str,
)
def test_a_graph_has_no_folds_where_none_of_its_functions_ends(graph, never) -> None:
    system = SlowFastSystem(slow={y: -y}, fast={x: graph - x}, epsilon=epsilon)
    assert never_folds(solve_critical(system).branches[0]) is never


def planar(slow: sp.Expr, fast: sp.Expr, start: dict, region: dict) -> Scene:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={y: slow}, fast={x: fast}, epsilon=epsilon)
    return Scene(
        system,
        region=region,
        start=start,
        span=(0.0, 0.5),
        epsilon=0.01,
        epsilons=(0.01, 0.005),
        tolerance=1e-2,
    )


@pytest.mark.exhaustive
def test_what_is_proved_of_a_passage_and_of_a_cycle_by_an_axis_is_told(tmp_path) -> None:
    """A predator without prey comes back late: one cycle, and its passage of the fold, in a report too."""
    x, y = sp.symbols("x y")
    eaten = x / (sp.Rational(3, 10) + x)
    scene = planar(
        y * (eaten - sp.Rational(2, 5)), x * (1 - x) - y * eaten, {"x": 0.7, "y": 0.2},
        {"y": (0.15, 0.35), "x": (0.5, 0.95)},
    )  # fmt: skip
    analysis = gsp.analyse(scene)
    cycle, passage = analysis.boundary.cycle, analysis.boundary.passage
    assert cycle is not None
    assert passage is not None
    assert min(cycle.epsilon_1, passage.epsilon_0) >= 0.01
    page = write_report(analysis, tmp_path / "report")
    text = page.read_text(encoding="utf-8")
    assert "just one closed orbit lies in the strip and tube of the figure" in text
    assert "passes the strip of the figure" in text
    content = json.loads((tmp_path / "report" / "report.json").read_text(encoding="utf-8"))
    assert "passage.png" in content["figures"]
    found = content["boundary"]["proved_passage"]
    (low, high), level = passage.strip.exit if passage.strip else ((0.0, 0.0), ())
    assert found["exit"] == {"y": [low, high], "x": list(level)}
    # The fold is at y = 0.4225, and orbits leave after it.
    assert 0.42 < low < 0.4225 < high < 0.45


@pytest.mark.exhaustive
def test_a_delay_along_a_graph_is_proved_and_without_a_loss_nothing_is_said() -> None:
    x, y = sp.symbols("x y")
    region = {"y": (-1.0, -0.5), "x": (-0.2, 0.2)}
    scene = planar(sp.S.One, x * (y - x), {"x": 0.0, "y": -1.0}, region)
    passage = found(scene).passage
    assert passage is not None
    assert passage.delay is not None
    assert 0.9 < passage.delay.stays_to < 1.0 < passage.delay.leaves_by
    assert found(planar(sp.S.One, -x, {"x": 0.0, "y": -1.0}, region)).passage is None
    assert found(models.load("michaelis_menten")).passage is None


A, B, X, Y = sp.symbols("A B X Y")
RADICALS = {A: -A * X, B: A * X - B}, {X: A - 2 * X**2 - A * X / 10 + Y / 5, Y: 2 * X**2 - 3 * B * Y / 4 - Y}


@pytest.mark.exhaustive
def test_where_nothing_can_be_blown_up_outside_the_region_nothing_is_said() -> None:
    """Folds of two radicals at A = 0 and at B = -4/3 and -16/15, at which whole curves of points meet."""
    system = SlowFastSystem(slow=RADICALS[0], fast=RADICALS[1], epsilon=epsilon)
    scene = Scene(
        system, {"A": (0.05, 2), "B": (0, 2), "X": (0, 3), "Y": (0, 3)},
        {"A": 1.5, "B": 0.1, "X": 0.7, "Y": 0.7}, (0, 1), 0.01,
    )  # fmt: skip
    study = study_of(scene)
    sheet = surroundings(study)
    assert isinstance(sheet, CriticalSheet)
    assert len(sheet.folds) == 3
    assert all(each.blow_up is not None for each in local_scales(study, sheet))
    texts = [curve.described(study.region) for curve in sheet.folds]
    assert any("A = 0 throughout" in text for text in texts)
    # Rounding of 0 is told as 0.
    assert not any(re.search(r"e-(1[6-9]|[2-9]\d|\d{3})", text.split("(a =")[0]) for text in texts)


@pytest.mark.exhaustive
def test_the_folds_of_a_hill_function_have_their_powers() -> None:
    """Its exponent is a parameter, and their points are no rational numbers."""
    s, q = sp.symbols("s q")
    system = SlowFastSystem(
        slow={A: X - A, B: sp.Integer(1)}, fast={X: a - s * X + A * X**q / (1 + X**q) + B}, epsilon=epsilon,
        parameters={a: 0.4, s: 0.8, q: 8},
    )  # fmt: skip
    scene = Scene(
        system, {"A": (0.5, 3), "B": (-0.1, 0.1), "X": (0.1, 4)}, {"A": 1, "B": 0, "X": 0.4}, (0, 1), 0.02
    )
    study = study_of(scene)
    sheet = surroundings(study)
    assert sheet is not None
    along, *_ = local_scales(study, sheet)
    assert along.blow_up is not None
    assert dict(along.blow_up.weights)["X"] == 1
    assert along.blow_up.degree == 1
    assert sorted(along.blow_up.weights.values())[-2:] == [2, 3]


def test_the_singular_orbit_begins_on_the_sheet_of_the_run() -> None:
    """Of a gene without messengers another sheet, of negative amounts, is nearer to the start."""
    ends = found(load(FOLDER / "gene_dimers_from_nothing.toml"))
    assert ends.orbit is not None
    run = ends.orbit.pieces[0].run
    assert min(run[name].min() for name in ("p", "M", "P")) > 0
