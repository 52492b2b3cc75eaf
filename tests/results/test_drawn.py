"""Results draw themselves, charts show in notebooks, and a report begins with the whole phenomenon."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

from gsp import charts, compare, integrate, mixed_mode, models, periodic_orbit
from gsp.analysis import pictured_runs
from gsp.analysis.fold_surroundings import boundary_of
from gsp.charts.style import mathematics
from gsp.errors import DeclarationError
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.report.setting import is_decimal
from gsp.scenes.study import study_of
from gsp.singular.mixed_modes import MixedMode


def phenomenon(name: str):
    study = study_of(models.load(name))
    found = classify(study.branch, region=study.region, epsilon=study.scene.epsilon)
    return pictured_runs.phenomenon_of(study, boundary_of(study, found))


@pytest.mark.exhaustive
def test_van_der_pol_is_followed_over_both_folds_again_and_again():
    run = phenomenon("van_der_pol")
    assert pictured_runs._swings(run["x"]) >= pictured_runs.SWINGS
    assert run["x"].max() > 1.9
    assert run["x"].min() < -1.9


@pytest.mark.exhaustive
def test_kopers_mixed_modes_are_counted():
    found = phenomenon("koper")
    assert isinstance(found, MixedMode)
    assert found.is_large.any()
    assert not found.is_large.all()


@pytest.mark.exhaustive
def test_a_scene_without_folds_has_no_phenomenon_beyond_them():
    assert phenomenon("michaelis_menten") is None


def test_swings_are_counted_from_quarter_to_quarter():
    t = np.linspace(0.0, 6.0 * np.pi, 2000)
    assert pictured_runs._swings(np.sin(t - np.pi / 2)) == 3
    assert pictured_runs._swings(np.sin(t) * 0.1 + np.linspace(0, 10, t.size)) == 1


@pytest.mark.exhaustive
def test_results_are_plotted_and_shown_in_a_notebook():
    scene = models.load("van_der_pol")
    run = integrate(scene.system, start=scene.start, span=(0, 4), epsilon=0.05)
    orbit = periodic_orbit(scene.system, start=scene.start, epsilon=0.05)
    mode = mixed_mode(scene.system, "x", start=scene.start, span=(0, 8), epsilon=0.05)
    for result in (run, run.sample([0.0]), orbit, mode, compare(models.load("linear"))):
        axes = result.plot()
        assert axes.lines
        assert axes._repr_png_().startswith(b"\x89PNG")
    labels = [text.get_text() for text in run.plot().get_legend().get_texts()]
    assert labels == ["$y$", "$x$"]
    given = orbit.plot()
    assert run.plot(given) is given
    for value in (3, DeclarationError("a fact.")):
        with pytest.raises(DeclarationError, match=f"no chart of a {type(value).__name__}"):
            charts.draw(value)


def test_names_of_several_letters_are_upright_and_decimals_are_decimals():
    assert mathematics("glucose") == r"$\mathrm{glucose}$"
    assert mathematics("Ca_i") == r"$\mathrm{Ca}_{i}$"
    assert mathematics("omega") == r"$\omega$"
    assert mathematics("y1") == "$y_{1}$"
    assert is_decimal(sp.Rational(3, 10))
    assert not is_decimal(sp.Rational(1, 3))
    assert not is_decimal(sp.Integer(2))
