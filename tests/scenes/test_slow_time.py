"""A scene in fast time: whatever reduces it works with the same scene in slow time."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest
import sympy as sp
from click.testing import CliRunner

import gsp
from gsp import models
from gsp.cli import cli
from gsp.scenes.ramp_question import RampQuestion
from gsp.scenes.scene import Scene
from gsp.scenes.slow_time import has_slow_time, in_slow_time
from gsp.scenes.study import study_of
from gsp.scenes.view import View
from gsp.splitting.fast_time import is_in_fast_time
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, k, eps = sp.symbols("x y z k epsilon")
EPSILON, SPAN = 0.02, 40.0
FILE = """
[states]
x = "-epsilon*x*y"
y = "x - y"
[region]
x = [0.1, 2]
y = [0, 2]
[start]
x = 1
y = 0.5
[scene]
span = [0, 40]
epsilon = 0.02
tolerance = 1e-3
"""


def scene(rates, span: float, **others) -> Scene:
    field = VectorField(rates, epsilon=eps, parameters={k: 2})
    return Scene(
        field, {"x": (0.1, 2), "y": (0, 2)}, {"x": 1, "y": 0.5}, (0.0, span), EPSILON, tolerance=1e-3, **others
    )


def fast(**others) -> Scene:
    return scene({x: -eps * k * x * y, y: x - y + eps * x}, SPAN, **others)


def test_it_is_the_scene_that_one_would_write_in_slow_time() -> None:
    ramps = {"up": RampQuestion(gsp.Ramp.tanh({k: (1, 2)}))}
    given = fast(
        reconstruction={z: eps * x},
        claims={"limit": {x: -eps * k * x**2}},
        views={"run": View("t", "x", ranges={"t": (SPAN / 4, SPAN)})},
        units={"x": "m", "t": "s"},
        ramps=ramps,
    )
    expected = scene(
        {x: -k * x * y, y: x / eps - y / eps + x},
        EPSILON * SPAN,
        reconstruction={z: x},
        claims={"limit": {x: -k * x**2}},
        views={"run": View("t", "x", ranges={"t": (EPSILON * SPAN / 4, EPSILON * SPAN)})},
        units={"x": "m"},
        ramps=ramps,
    )
    assert is_in_fast_time(given.system)
    assert in_slow_time(given) == expected
    study = study_of(given)
    assert (study.scene, study.given) == (expected, given)
    assert not is_in_fast_time(expected.system)
    assert study_of(expected).given is None


def test_a_scene_without_a_pole_to_take_is_left_as_it_is() -> None:
    standard = Scene(
        SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=eps), {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 1), 0.1
    )
    assert not is_in_fast_time(standard.system)
    # A switch is fast by itself.
    assert not is_in_fast_time(scene({x: -k * x, y: 1 - sp.tanh(y / eps)}, 1.0).system)
    plain = replace(
        standard, system=VectorField({x: -k * x, y: x - y}, parameters={k: 2}), epsilon=None, epsilons=None
    )
    assert not is_in_fast_time(plain.system)
    # What turns at both epsilons has no slow variable, and keeps its time.
    turning = VectorField({x: (1 + eps) * y, y: -(1 + eps) * x}, epsilon=eps)
    assert is_in_fast_time(turning)
    assert not has_slow_time(turning)


@pytest.mark.exhaustive
def test_reduced_and_full_runs_end_at_the_same_place() -> None:
    """Over the span in its own time x moves by a half; in slow time, over so long a span, all of it was gone."""
    given = fast()
    full = gsp.integrate(
        given.system, start=given.start, span=given.span, epsilon=EPSILON, rtol=1e-10, atol=1e-12
    )
    assert 0.2 < full["x"][-1] < 0.6
    choice = gsp.choose(given)
    assert choice.scene.span[1] == pytest.approx(EPSILON * SPAN)
    assert gsp.simulate(given, choice=choice)["x"][-1] == pytest.approx(full["x"][-1], rel=given.tolerance)
    other = replace(given, tolerance=1e-4)
    assert gsp.simulate(other)["x"][-1] == pytest.approx(full["x"][-1], rel=1e-4)


def test_another_epsilon_is_asked_over_the_span_in_the_models_own_time() -> None:
    study = study_of(fast())
    assert study.asking(epsilon=0.01).scene.span == pytest.approx((0.0, 0.01 * SPAN))
    assert study.asking(epsilon=0.01).scene == study_of(replace(fast(), epsilon=0.01)).scene
    assert study.asking(tolerance=1e-4).scene.span == study.scene.span


@pytest.mark.exhaustive
def test_the_command_line_says_so_and_has_one_answer(tmp_path) -> None:
    file = tmp_path / "model.toml"
    file.write_text(FILE, encoding="utf-8")
    ends = []
    for options in ([], ["--order", "2"]):
        target = tmp_path / f"run{len(options)}.csv"
        done = CliRunner().invoke(cli, ["run", str(file), *options, "-o", str(target)])
        assert done.exit_code == 0, done.output
        assert ("the span 0 to 40 becomes 0 to 0.8" in done.output) == bool(options)
        (head, *_, last) = target.read_text(encoding="utf-8").splitlines()
        ends.append(float(dict(zip(head.split(","), last.split(",")))["x"]))
    assert ends[1] == pytest.approx(ends[0], rel=1e-3)
    done = CliRunner().invoke(cli, ["choose", str(file)])
    assert "the span 0 to 40 becomes 0 to 0.8" in done.output
    assert " to 0.8 at epsilon" in done.output


def test_a_report_says_that_the_field_was_in_fast_time(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gsp.charts, "applicable", lambda analysis: {})
    page = gsp.write_report(gsp.analyse(fast(), order=1), tmp_path, latex=True)
    assert "the span 40 became 0.8" in re.sub(r"<[^>]+>", "", page.read_text(encoding="utf-8"))
    assert "given in fast time, over a span of 40." in (tmp_path / "report.tex").read_text(encoding="utf-8")
    content = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert (content["span"], content["span_in_fast_time"]) == ([0.0, 0.8], [0.0, 40.0])


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", models.names())
def test_every_model_is_the_same_system_through_either_door(name: str) -> None:
    """Written in fast time, t/epsilon, and put into slow time again: the same rates over the same span."""
    given = models.load(name)
    if given.contacts is not None:
        pytest.skip("dry friction is declared by its mechanics")
    small = given.system.epsilon
    assert small is not None
    field = given.system.as_field()
    rates = {z: sp.expand(small * rate) for z, rate in field.equations.items()}
    if not any(rate.has(small) for rate in rates.values()):
        pytest.skip("nothing moves in slow time but what the states drive")
    faster = given.system.as_field(rates)
    ends = tuple(t / given.epsilon for t in given.span)
    asked = replace(
        given,
        system=faster,
        span=ends,
        reconstruction={},
        reconstruction_start={},
        claims={},
        path=None,
        views={},
        units={},
    )
    study, own = study_of(asked), study_of(replace(asked, system=field, span=given.span))
    assert study.given == asked
    assert study.scene.span == pytest.approx(given.span)
    assert [s.name for s in study.system.states] == [s.name for s in own.system.states]
    place = {s: sp.Rational(37 + 11 * i, 100) for i, s in enumerate(study.system.states)}
    numbers = {**place, **study.system.parameters, small: sp.Rational(1, 50)}
    for one, two in zip(study.system.rates, own.system.rates):
        assert complex(one.xreplace(numbers)) == pytest.approx(complex(two.xreplace(numbers)), rel=1e-12)


def test_a_small_parameter_that_only_sets_the_pace_is_told_as_such() -> None:
    x, y, delta = sp.symbols("x y delta")
    field = VectorField({x: -delta * x, y: delta * (x - y)}, epsilon=delta)
    scene = Scene(field, {"x": (0, 2), "y": (0, 2)}, {"x": 1, "y": 0}, (0, 50), 0.05)
    words = "delta is a factor of every rate and stands nowhere else"
    with pytest.raises(gsp.GspError, match=words):
        gsp.split(field)
    assert words in str(gsp.choose(scene))
    assert gsp.integrate(scene.system, start=scene.start, span=scene.span, epsilon=0.05).t[-1] == 50
