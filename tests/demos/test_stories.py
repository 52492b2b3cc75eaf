"""Stories: what they set exists, what they say holds, and every step draws itself."""

import tomllib
from importlib.resources import files

import pytest

import gsp
from gsp import models
from gsp.demos.demo import stories
from gsp.demos.program import program_of
from tests.cases import sampled

STEP = {"text", "epsilon", "parameters", "start", "end", "orders", "axes", "trace", "rivals", "play"}
STORY = {"axes", "trace", "space", "frame", "ranges", "body", "steps"}
# What a lecturer reads aloud in one breath or two.
LONGEST = 320


def story(name: str) -> dict:
    return tomllib.loads(files("gsp.demos").joinpath("stories", f"{name}.toml").read_text(encoding="utf-8"))


def test_six_scenes_are_told() -> None:
    assert len(stories()) >= 6
    assert {"chaplygin_sleigh", "van_der_pol", "michaelis_menten"} <= set(stories())


@pytest.mark.parametrize("name", stories())
def test_a_story_sets_only_what_there_is(name: str) -> None:
    told = story(name)
    scene = models.load(name)
    parts = program_of(gsp.study(scene)).parts
    assert set(told) <= STORY
    quantities, parameters = set(parts["quantities"]), set(parts["parameters"])
    assert set(told["axes"]) | {told["trace"]} | set(told.get("frame", {})) <= quantities
    assert set(told["ranges"]) <= parameters
    for step in told["steps"]:
        assert set(step) <= STEP
        assert 40 < len(step["text"]) <= LONGEST
        assert set(step.get("axes", ())) | {step.get("trace", told["trace"])} <= quantities
        assert set(step.get("parameters", {})) <= parameters
        assert set(step.get("start", {})) <= {s.name for s in scene.full_flow.states}
        assert set(step.get("orders", ())) <= {0, 1, 2, 3}
        assert not step.get("rivals") or parts["claims"]


@pytest.mark.parametrize("name", sampled(stories(), always=("chaplygin_sleigh", "van_der_pol", "koper")))
def test_every_step_draws_itself(name: str, page, tmp_path) -> None:
    page.open(gsp.write_demo(models.load(name), tmp_path / "demo.html"))
    count = page.run("return data.story.length")
    assert count == len(story(name)["steps"])
    for step in range(count):
        if step:
            page.run("document.getElementById('next').click()")
        page.settle()
        assert (
            page.run("return document.getElementById('tale').textContent") == story(name)["steps"][step]["text"]
        )
        assert page.inked("plane") > 2000
        page.measured()
        assert page.run("return current.result.full.status") == "reached"
    assert page.run("return document.getElementById('next').disabled")
    page.run("document.getElementById('previous').click()")
    assert page.run("return state.step") == count - 2
    assert page.complaints() == []
    assert page.requests() == []


def test_the_sleigh_is_drawn_and_moves_when_played(page, tmp_path) -> None:
    page.open(gsp.write_demo(models.load("chaplygin_sleigh"), tmp_path / "demo.html"))
    page.run("turnTo(1); play(false); now = 1; draw();")
    page.settle()
    before = page.picture("path")
    page.run("now = 6; draw();")
    assert page.picture("path") != before
    page.run("data.body = null; draw();")
    without = page.inked("path")
    page.open(tmp_path / "demo.html")
    page.run("turnTo(1); play(false); now = 6; draw();")
    assert page.inked("path") > without


def test_the_picture_in_space_is_turned(page, tmp_path) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    page.open(gsp.write_demo(models.load("koper"), tmp_path / "demo.html"))
    before = page.picture("space")
    canvas = page.run("return views.space.canvas")
    ActionChains(page.driver).move_to_element(canvas).click_and_hold().move_by_offset(
        60, 20
    ).release().perform()
    page.settle()
    assert page.picture("space") != before
    assert page.run(
        "return model.manifoldSurface(current.s, data.box, 4).flat().some((point) => !point.attracts)"
    )


def test_the_canard_value_that_is_told_is_the_one_that_is_computed(page, tmp_path) -> None:
    scene = models.load("van_der_pol")
    system = scene.system.with_parameters(a=1)
    match = gsp.match_canard(gsp.canard_value(system, parameter="a", order=3), epsilon=0.05, reach=(1.2, 1.9))
    steps = story("van_der_pol")["steps"]
    (told,) = [s["parameters"]["a"] for s in steps if "maximal canard" in s["text"]]
    assert told == pytest.approx(float(match.value), abs=6e-16)
    assert f"a = {told}" in next(s["text"] for s in steps if "maximal canard" in s["text"])
    # On either side of it: a canard that turns back, and one that jumps to the far sheet.
    page.open(gsp.write_demo(scene, tmp_path / "demo.html"))
    lowest = (
        "turnTo(7); state.parameters[0] = arguments[0]; const s = settingOf(state, data);"
        "return Math.min(...model.full(s, MEASUREMENT).states.map((z) => z[model.states.indexOf('x')]));"
    )
    assert page.run(lowest, 0.993491) > -0.5
    assert page.run(lowest, 0.9934908) < -1.5
