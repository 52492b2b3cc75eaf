"""Pages in a browser: what moves, what is computed, what is said, and that nothing leaves the page."""

import json
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize
import sympy as sp

import gsp
from gsp import models
from gsp.demos import demo as demos
from gsp.demos.page import embedded
from gsp.errors import OutputError
from gsp.results.mathml import parts_of_name
from gsp.slow import truncation

# A file as large as this loads at once from anywhere.
LARGEST = 300_000
HOSTILE = """
title = "</script><script>window.broken=1</script> \\"quoted\\" & <b>אבג</b>"
description = "<img src=x onerror=alert(1)> <!-- "
[parameters]
lambda = 2
class = 0.5
[slow]
in = "-lambda*in + class*var"
[fast]
var = "in - var + class*in^2"
[region]
in = [0, 2]
[start]
in = 1
var = 0.2
[scene]
span = [0, 2]
epsilon = 0.05
"""
CUBE = """
slow = { x = "-x*u", z = "0.5*u - z*w" }
fast = { u = "x - u - 0.2*w", w = "z - w + 0.2*u" }
region = { x = [0, 2], z = [0, 2] }
start = { x = 1, z = 0.5, u = 0, w = 2 }
scene = { span = [0, 3], epsilon = 0.004 }
"""
NON_STANDARD = """
region = { x = [0.5, 1.5], y = [0, 1] }
start = { x = 1, y = 0.5 }
scene = { span = [0, 0.5], epsilon = 0.05 }
[states]
x = "-(x^2*y + exp(y*x) - 1)*(1 + x*y)/epsilon - y"
y = "-(x^2*y + exp(y*x) - 1)*(x - sin(y))/epsilon + x"
"""
# Exact coefficients have hundreds of terms with the parameters in, fewer with their values, and the layer is long.
GRAZERS = """
parameters = { K = 1, a = 5, b = "1/3", m = "2/5", d = "3/10" }
region = { p = [0.45, 1], z = [0.01, 0.05], w = [0.01, 0.036] }
start = { p = 0.7, z = 0.02, w = 0.03 }
scene = { span = [0, 1], epsilon = 0.02 }
[states]
p = "(p*(1 - p/K) - a*p*(z + w)/(b + p))/epsilon"
z = "z*(p/(b + p) - m)"
w = "w*(p/(b + p) - d) - w^2/20"
"""
# y = x^2/(x - 1): a pole, whose two sides are two pieces. The range in view is `asked` for.
POLE = """
slow = { x = "-x" }
fast = { y = "x^2 - (x - 1)*y" }
region = { x = [2, 4] }
start = { x = 4, y = 5 }
scene = { span = [0, 0.5], epsilon = 0.01 }
[views.both]
x = "x"
y = "y"
ranges = { x = [-1, 4], y = [-10, 10] }
[views.later]
x = "t"
y = "y"
ranges = { t = [0, 0.25], y = [3, 6] }
"""
# What every object of JavaScript answers to.
INHERITED = ("constructor", "toString", "hasOwnProperty", "valueOf", "__proto__")


@cache
def made(name: str) -> gsp.Demo:
    return gsp.demo(models.load(name))


@pytest.fixture
def opened(page, tmp_path):
    """Opens the page of a scene, of a built-in name or of a model file's text."""

    def open_(model: str, **options):
        if "\n" in model:
            (tmp_path / "model.toml").write_text(model, encoding="utf-8")
            shown = gsp.demo(gsp.load(tmp_path / "model.toml"))
        else:
            shown = made(model)
        page.open(shown.save(tmp_path / "demo.html"), **options)
        return page

    return open_


def settings(scene: gsp.Scene, count: int) -> list[dict]:
    """The scene's own setting and random ones about it: epsilon, every parameter and the start."""
    random = np.random.default_rng(5)
    parameters = {s.name: float(v) for s, v in scene.system.parameters.items()}
    found = [{"epsilon": scene.epsilon, "parameters": parameters, "start": dict(scene.full_start)}]
    for _ in range(count - 1):
        factor = random.uniform(0.8, 1.25, len(parameters))
        moved = dict(scene.full_start)
        for name, (low, high) in scene.region.items():
            moved[name] += 0.05 * (high - low) * random.uniform(-1, 1)
        found.append(
            {
                "epsilon": scene.epsilon * random.uniform(0.5, 1),
                "parameters": dict(zip(parameters, factor * list(parameters.values()))),
                "start": moved,
            }
        )
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", models.names())
def test_full_runs_agree_with_python(name: str, opened) -> None:
    scene = models.load(name)
    page = opened(name)
    states = [s.name for s in scene.full_flow.states]
    for setting in settings(scene, 3):
        got = page.run(
            "const [epsilon, parameters, start, span] = arguments;"
            "const run = model.full({ epsilon, parameters, start, span }, MEASUREMENT);"
            "const half = new Float64Array(model.n); stateAt(run, (span[0] + span[1]) / 2, half);"
            "return [run.status, Array.from(half), Array.from(run.states.at(-1))];",
            setting["epsilon"],
            list(setting["parameters"].values()),
            [setting["start"][s] for s in states],
            list(scene.span),
        )
        flow = scene.full_flow.with_parameters(**setting["parameters"])
        expected = gsp.integrate(
            flow, start=setting["start"], span=scene.span, epsilon=setting["epsilon"], rtol=1e-11, atol=1e-13
        )
        middle = expected.at(sum(scene.span) / 2)
        assert got[0] == "reached"
        np.testing.assert_allclose(got[1], middle, rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(got[2], [expected[s][-1] for s in states], rtol=1e-6, atol=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", models.names())
def test_the_series_agrees_with_python_at_other_parameters_too(name: str, opened) -> None:
    scene = models.load(name)
    page = opened(name)
    for setting in settings(scene, 3):
        study = gsp.study(
            gsp.Scene(
                scene.system.with_parameters(**setting["parameters"]), scene.region, scene.start, scene.span,
                setting["epsilon"], scene.epsilons, scene.tolerance, reconstruction=scene.reconstruction,
            )
        )  # fmt: skip
        order = page.run(
            "return model.seriesAt({ parameters: arguments[0] }).order", list(setting["parameters"].values())
        )
        series = study.series(order, symbolic=False)
        x = [study.start[s.name] for s in study.system.x]
        y = study.branch.points(np.array([x]))[0]
        epsilon = setting["epsilon"]
        terms = series.terms(np.array([x]), epsilon, near=None if study.branch.is_explicit else y)
        got = page.run(
            "const [epsilon, parameters, x, near, order] = arguments; const s = { epsilon, parameters };"
            "const y0 = Float64Array.from(near); const p = model.constants(s);"
            "const found = model.onSheet(Float64Array.from(x), y0, p);"
            "const y = new Float64Array(model.nFast); const c = model.coordinatesOf(x, y0, s);"
            "model.sum('h', order, c, s, p, y); return [found, Array.from(y), model.bestOrder(c, s).best];",
            epsilon,
            list(setting["parameters"].values()),
            x,
            y.tolist(),
            order,
        )
        assert got[0] is True
        np.testing.assert_allclose(got[1], terms[0].sum(axis=0), rtol=1e-6, atol=1e-9)
        # The rule of `optimal_order`, told from the terms that the page has.
        sizes = np.linalg.norm(terms, axis=2)
        if (sizes > 1e-12).all():
            estimates = truncation.errors(sizes, order)
            assert estimates[0, got[2]] <= truncation.GROWN * np.nanmin(estimates)


DOSE = """
[slow]
x = "PULSE - y/10"
t = "2"
[fast]
y = "x - y"
[parameters]
T = 5
w = 0.001
[region]
x = [0, 2]
t = [0, 10]
[start]
x = 0
y = 0
t = 1
[scene]
epsilon = 0.01
span = [0, 5]
"""


# The clock begins at 1 and goes twice as fast as time: a dose begins at 2 and takes half of w. The train has pulses
# at T - 3, T and T + 3, and half of one where the run ends.
ONE_PULSE = 0.5 * np.exp(-0.3)
TRAIN = 0.75 * np.sqrt(0.002 / np.pi) * (1 + 0.001 / 8) * (np.exp([-0.45, -0.3, -0.15]).sum() + 0.5)


@pytest.mark.parametrize(
    ("pulse", "expected", "off"),
    [
        ("(sign(t - T) - sign(t - T - w))/(2*w)", ONE_PULSE, 2e-3),
        ("exp(-((t - T)/w)^2)/w", np.sqrt(np.pi) * ONE_PULSE, 2e-3),
        ("exp((cos(2*pi*(t - T)/3) - 1)/w)", TRAIN, 5e-3),
        ("max(t - T, 0)*exp(-max(t - T, 0)/w)/w^2", ONE_PULSE, 2e-3),
        ("exp(-(log(t/T)/w)^2)/(w*t)", np.sqrt(np.pi) * ONE_PULSE, 2e-3),
    ],
    ids=["dose", "kick", "train", "synapse", "release"],
)
def test_pulses_are_met_in_full_and_reduced_runs(pulse: str, expected: float, off: float, opened) -> None:
    full, reduced = opened(DOSE.replace("PULSE", pulse)).run(
        "const result = model.simulate(settingOf(initialState(data), data), [0]);"
        "const to = new Float64Array(model.n); const run = result.pieces[0].runs[0]; run.at(run.ended, to);"
        "return [Array.from(result.full.states.at(-1)), Array.from(to)];"
    )
    assert full[0] == pytest.approx(expected, rel=off)
    assert reduced[0] == pytest.approx(expected, rel=off)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["chaplygin_sleigh", "van_der_pol"])
def test_reduced_runs_agree_with_python(name: str, opened) -> None:
    scene = models.load(name)
    study = gsp.study(scene)
    page = opened(name)
    for order in (0, 3):
        got = page.run(
            "const s = settingOf(initialState(data), data);"
            "const result = model.simulate(s, [arguments[0]], MEASUREMENT); const run = result.pieces[0].runs[0];"
            "const from = new Float64Array(model.n); const to = new Float64Array(model.n);"
            "run.at(run.first, from); run.at(run.ended, to);"
            "return [run.status, run.first, run.ended, Array.from(from), Array.from(to)]",
            order,
        )
        assert got[:3] == ["reached", *scene.span]
        names = [*(s.name for s in scene.system.states), *(s.name for s in scene.reconstruction)]
        start = dict(zip(names, got[3]))
        if study.splitting is not None:
            start |= study.splitting.to_new({s.name: start[s.name] for s in scene.system.states})
        begun = {n: start[n] for n in [x.name for x in study.system.x] + [s.name for s in scene.reconstruction]}
        run = gsp.integrate(
            study.reduced(order), start=begun, span=scene.span, epsilon=scene.epsilon, rtol=1e-11, atol=1e-13
        )
        end = {
            n: run[n][-1]
            for n in [*(s.name for s in study.system.states), *(s.name for s in scene.reconstruction)]
        }
        if study.splitting is not None:
            end |= study.splitting.to_raw(end)
        np.testing.assert_allclose(got[4], [end[n] for n in names], rtol=1e-6, atol=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", models.names())
def test_a_page_draws_itself_and_asks_for_nothing(name: str, opened) -> None:
    page = opened(name)
    assert page.inked("plane") > 2000
    assert page.inked("trace") > 2000
    assert len(made(name).html.encode()) <= LARGEST
    page.measured()
    assert page.complaints() == []
    assert page.requests() == []


def test_errors_are_the_same_in_small_units(page, tmp_path) -> None:
    """In moles the absolute tolerance of the runs was larger than the errors."""
    x, y, eps = sp.symbols("x y epsilon")
    errors = []
    for unit in (sp.Integer(1), sp.Rational(1, 10**9)):
        rates = -x + (x / unit + sp.Rational(1, 2)) * y, x - (x / unit + 1) * y
        system = gsp.SlowFastSystem(slow={x: rates[0]}, fast={y: rates[1]}, epsilon=eps)
        size = float(unit)
        scene = gsp.Scene(system, {"x": (size / 10, 2 * size)}, {"x": size, "y": 0}, (0, 3), 0.02)
        page.open(gsp.write_demo(scene, tmp_path / "enzyme.html"))
        errors += page.run(
            "const s = { ...settingOf(state, data), epsilon: 0.005 };"
            "const result = model.simulate(s, [0, 1], { ...MEASUREMENT, rivals: [] });"
            "return [Object.values(model.errorsOf(result, s).orders)];"
        )
    assert errors[1] == pytest.approx(errors[0], rel=1e-3)


@pytest.mark.exhaustive
def test_the_measured_powers_are_those_of_the_theory(opened) -> None:
    page = opened("chaplygin_sleigh", fragment="#orders=0.1.2.3&epsilon=0.01&rivals=1")
    page.measured()
    powers = page.run("return [0, 1, 2, 3].map((k) => measuredPower((row) => row.orders[k]))")
    np.testing.assert_allclose(powers, [1, 2, 3, 4], atol=0.15)
    printed, corrected = page.run(
        "return model.claims.map((claim) => measuredPower((row) => row.rivals[claim.name]))"
    )
    assert printed == pytest.approx(1, abs=0.15)
    assert corrected == pytest.approx(2, abs=0.15)
    text = page.run("return document.getElementById('orders').innerText")
    assert re.search(r"order 1\s.*∝ ε\s*(1\.9|2\.0)", text)


@pytest.mark.exhaustive
def test_what_ends_a_series_and_what_a_power_is_taken_over_is_true_of_what_is_shown(opened) -> None:
    page = opened(GRAZERS, fragment="#orders=0.1")
    page.measured()
    told = page.run("return document.getElementById('notes').innerText")
    known, ended = map(int, re.search(r"through order (\d).*coefficients of order (\d)", told, re.S).groups())
    assert ended == known + 1
    # The layer takes most of the run at this epsilon, and half of it at a quarter.
    rows = page.run("return ladder.filter((row) => row).map((row) => [row.epsilon, row.from, row.to])")
    assert rows[0][1] > 0.5 * rows[0][2]
    power = page.run("return measuredPower((row) => row.orders[1])")
    assert power is None or power == pytest.approx(2, abs=0.2)


@pytest.mark.exhaustive
def test_sliders_change_the_picture_and_the_address(opened) -> None:
    page = opened("michaelis_menten")
    for slider, value in (("epsilon", -2.0), ("parameter-0", 2.0), ("length", 1.0)):
        before = page.picture("plane"), page.picture("trace")
        page.slide(slider, value)
        assert (page.picture("plane"), page.picture("trace")) != before, slider
    page.measured()
    fragment = page.run("return location.hash")
    assert "epsilon=0.01&" in fragment
    assert "p.kappa=2&" in fragment
    state = page.run("return state")
    page = opened("michaelis_menten", fragment=fragment)
    assert page.run("return state") == state
    assert page.complaints() == []


@pytest.mark.exhaustive
def test_a_fragment_that_says_nonsense_is_passed_over(opened) -> None:
    untouched = opened("michaelis_menten").run("return state")
    page = opened(
        "michaelis_menten", fragment="#epsilon=-3&p.kappa=NaN&orders=7.x&x=</script>&end=1e999&step=x&s.s="
    )
    assert page.run("return state") == {**untouched, "orders": []}
    assert page.inked() > 2000
    assert page.complaints() == []


@pytest.mark.exhaustive
def test_the_start_is_dragged_by_hand_and_by_keys(opened) -> None:
    from selenium.webdriver.common.action_chains import ActionChains
    from selenium.webdriver.common.by import By

    page = opened("michaelis_menten")
    before, picture = page.run("return state.start"), page.picture()
    handle = page.driver.find_element(By.ID, "start")
    ActionChains(page.driver).click_and_hold(handle).move_by_offset(-90, -60).release().perform()
    page.settle()
    dragged = page.run("return state.start")
    assert dragged[0] < before[0] - 0.05
    assert dragged[1] > before[1] + 0.05
    assert page.picture() != picture
    page.run("document.getElementById('start').focus()")
    ActionChains(page.driver).send_keys("\ue014").perform()
    page.settle()
    assert page.run("return state.start")[0] > dragged[0]


@pytest.mark.exhaustive
def test_a_start_in_slow_and_fast_variables_is_dragged_in_them(opened) -> None:
    page = opened("chaplygin_sleigh", fragment="#x=v&y=p")
    p = page.run("return startOnAxes()[1]")
    page.run("moveStart(views.plane.X(startOnAxes()[0]), views.plane.Y(startOnAxes()[1]) - 40)")
    page.settle()
    v, moved = page.run("return startOnAxes()")
    assert moved > p + 0.01
    # w is kept: what moves is the slow variable alone.
    assert page.run("return state.start[2]") == pytest.approx(0, abs=1e-4)
    assert v == pytest.approx(-1.5, abs=1e-3)


@pytest.mark.exhaustive
def test_keys_play_orders_and_light(opened) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    page = opened("van_der_pol")
    before = page.run("return [state.orders, theme, state.epsilon]")
    ActionChains(page.driver).send_keys("3d+ ").perform()
    page.settle()
    orders, theme, epsilon = page.run("return [state.orders, theme, state.epsilon]")
    assert set(orders) ^ set(before[0]) == {3}
    assert theme != before[1]
    assert epsilon == pytest.approx(1.25 * before[2])
    assert page.run("return playing !== null")
    page.driver.execute_async_script(
        "const done = arguments[0]; const look = () => (now > 0 ? done() : setTimeout(look, 10)); look();"
    )
    ActionChains(page.driver).send_keys(" ").perform()
    assert page.run("return playing") is None
    assert page.complaints() == []


@pytest.mark.exhaustive
@pytest.mark.parametrize("width", [360, 1280])
@pytest.mark.parametrize("name", ["chaplygin_sleigh", "koper"])
def test_nothing_is_wider_than_the_window(name: str, width: int, opened) -> None:
    page = opened(name, width=width, height=800)
    assert page.run("return document.documentElement.scrollWidth") <= width
    assert page.run("return Math.min(...Object.values(views).map((v) => v.canvas.clientWidth))") > 250


@pytest.mark.exhaustive
def test_a_relaxation_oscillator_is_reduced_between_its_jumps(opened) -> None:
    page = opened("van_der_pol", fragment="#end=4&epsilon=0.01&orders=0&s.x=2&s.y=0.66667")
    pieces = page.run("return current.result.pieces.map((piece) => piece.runs[0].status)")
    assert len(pieces) >= 3
    assert pieces[0] in ("lost", "too small")
    # In one go with a picture made anew: where the machine is busy the finer run has come already.
    assert "order 0 ends at t = about 0.8" in page.run(
        "update(); return document.getElementById('notes').innerText"
    )
    page.measured()
    assert "order 0 ends at t = 0.80" in page.run("return document.getElementById('notes').innerText")


def test_a_reduced_run_is_drawn_until_its_series_falls_no_more(opened) -> None:
    page = opened("van_der_pol", fragment="#orders=0.1&epsilon=0.02&s.x=2.6&s.y=0.3&end=0.6")
    runs = page.run(
        "const x = model.quantities.indexOf('x');"
        "return current.curves.reduced.map((run) => [run.order, run.isWhole, run.within, Array.from(run.q[x])])"
    )
    (_, zeroth_is_whole, *_), (_, first_is_whole, until, x) = runs
    assert zeroth_is_whole
    assert not first_is_whole
    # Towards the fold at x = 1 the first correction grows, and would take the picture to x = 3.
    drawn = [value for value in x if value is not None]
    assert 1.0 < drawn[-1] < 1.5
    assert max(drawn) < 2.0
    page.measured()
    assert f"order 1 is drawn until t = {until:.4g}"[:-2] in page.run(
        "return document.getElementById('notes').innerText"
    )


DRIFT = """
slow = {{ x = "{slow}" }}
fast = {{ y = "(x - 1)*y - 3*z", z = "3*y + (x - 1)*z" }}
region = {{ x = [-2, 3], y = [-1, 1], z = [-1, 1] }}
start = {{ x = -2, y = 0.1, z = 0 }}
scene = {{ span = [0, 4], epsilon = 0.02 }}
"""


@pytest.mark.parametrize("slow", ["1", "1 + y"], ids=["a clock", "a slow motion"])
def test_a_reduced_run_ends_where_a_pair_ceases_to_attract_however_simple_its_motion(slow: str, opened) -> None:
    """The pair is x - 1 +- 3i, and x = t - 2; a step over the rest of the run passed by where its rate is 3 % of 3."""
    page = opened(DRIFT.format(slow=slow), fragment="#orders=0.1")
    begun, *runs = page.run(
        "const runs = current.result.pieces[0].runs;"
        "return [runs[0].begun, ...runs.map((run) => [run.order, run.status, run.ended])];"
    )
    for _, status, ended in runs:
        assert status == "lost"
        assert ended == pytest.approx(3 - 0.03 * (3 - begun), abs=1e-3)
    page.measured()
    assert "has all but ceased to attract" in page.run("return document.getElementById('notes').innerText")


@pytest.mark.exhaustive
def test_a_page_says_what_cannot_be_computed(opened) -> None:
    def notes(page) -> str:
        return page.run("return document.getElementById('notes').innerText")

    page = opened("falling_disc")
    assert "order" not in notes(page)
    page.slide("parameter-0", 0.7)
    assert "known through order 1" in notes(page)
    page = opened("michaelis_menten", fragment="#epsilon=0.9&end=0.3&orders=0")
    assert "not long enough near the slow manifold" in notes(page)
    page = opened("michaelis_menten", fragment="#p.kappa=-1.5&s.s=1&orders=0")
    assert "Nothing is compared" in notes(page) or "ends at t" in notes(page)
    page = opened("van_der_pol", fragment="#end=2000&epsilon=0.00001")
    assert "its steps were used up" in notes(page)
    page = opened("van_der_pol", fragment="#s.x=1.2&s.y=-0.6&end=0.05&epsilon=0.001&orders=0.3")
    assert page.complaints() == []


@pytest.mark.exhaustive
def test_names_and_texts_of_a_model_are_inert(opened) -> None:
    page = opened(HOSTILE)
    assert page.run("return [typeof window.broken, document.scripts.length, document.images.length]") == [
        "undefined",
        2,
        0,
    ]
    assert "</script>" in page.run("return document.querySelector('h1').textContent")
    assert page.run("return document.title").startswith("</script>")
    assert page.run("return getComputedStyle(document.querySelector('h1')).unicodeBidi") == "isolate"
    assert {"in", "var"} <= set(page.run("return model.quantities"))
    assert page.inked() > 2000
    page.slide("parameter-0", 3.0)
    page.measured()
    assert page.complaints() == []
    assert page.requests() == []


@pytest.mark.exhaustive
def test_a_page_says_that_it_does_not_draw_a_manifold_whose_equation_is_solved_for_nothing(
    page, tmp_path
) -> None:
    x, y, eps = sp.symbols("x y epsilon")
    told = {}
    for name, rate in (("solved", x - y), ("not", x - 2 * y - sp.tanh(y) + x * sp.exp(y) / 9)):
        scene = gsp.Scene(
            gsp.SlowFastSystem(slow={x: -x}, fast={y: rate}, epsilon=eps),
            {"x": (0, 1)},
            {"x": 1, "y": 0},
            (0, 3),
            0.02,
        )
        page.open(gsp.write_demo(scene, tmp_path / f"{name}.html"))
        told[name] = page.run("return document.body.innerText;")
    assert "is not drawn" in told["not"]
    assert "is not drawn" not in told["solved"]


def test_a_reduced_run_that_is_quick_at_first_is_drawn_on_its_manifold(page, tmp_path) -> None:
    """Its whole drop from x = 16 takes 1/500 of the span, and its points are evenly spaced in time otherwise."""
    x, y, eps = sp.symbols("x y epsilon")
    system = gsp.SlowFastSystem(slow={x: -(x**3)}, fast={y: x**2 - y}, epsilon=eps)
    scene = gsp.Scene(system, {"x": (0.1, 20)}, {"x": 16, "y": 0}, (0, 20), 1e-3)
    page.open(gsp.write_demo(scene, tmp_path / "quick.html"))
    t, xs, ys = page.run(
        "const run = current.curves.reduced.find((r) => r.order === 0);"
        "const q = (name) => Array.from(run.q[model.quantities.indexOf(name)]);"
        "return [Array.from(run.t), q('x'), q('y')];"
    )
    assert np.all(np.diff(t) > 0.0)
    middle = 0.5 * (np.array(xs[1:]) + xs[:-1])
    assert np.abs(0.5 * (np.array(ys[1:]) + ys[:-1]) - middle**2).max() < 0.01 * max(ys)


@pytest.mark.exhaustive
@pytest.mark.parametrize("state", INHERITED)
def test_names_that_objects_of_javascript_inherit_are_names_like_others(
    state: str, page, tmp_path: Path
) -> None:
    x, y, epsilon = sp.Symbol(state), sp.Symbol("y"), sp.Symbol("epsilon")
    parameters = {sp.Symbol(name): sp.Rational(3, 2) for name in INHERITED if name != state}
    system = gsp.SlowFastSystem(
        slow={x: -x * sp.Mul(*parameters)}, fast={y: x - y}, epsilon=epsilon, parameters=parameters
    )
    scene = gsp.Scene(
        system, {state: (0, 2)}, {state: 1, "y": 0}, (0, 1), 0.05, (0.02, 0.01), 1e-6, units={state: "mol"}
    )
    page.open(gsp.write_demo(scene, tmp_path / "names.html"))
    assert page.inked() > 2000
    page.slide("parameter-0", 2.0)
    page.slide("parameter-3", 1.0)
    page.measured()
    label = "(name) => model.labelled(name).map(([text]) => text).join('')"
    parameters, own, other = page.run(
        f"return [state.parameters, ({label})(arguments[0]), ({label})('y')]", state
    )
    assert parameters == [2.0, 1.5, 1.5, 1.0]
    assert own == "".join(parts_of_name(state)) + " (mol)"
    assert other == "y"
    assert page.run("return ladder[0].orders[0]") < 0.2
    assert page.complaints() == []


def test_a_rival_may_have_the_name_of_a_row_beside_it(page, tmp_path: Path) -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = gsp.SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=epsilon)
    claims = {"full": {x: -x}, "__proto__": {x: -x * (1 + epsilon)}}
    scene = gsp.Scene(system, {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01, (0.02, 0.01), 1e-6, claims=claims)
    page.open(gsp.write_demo(scene, tmp_path / "rivals.html"))
    page.measured()
    told = page.run("tell(); return [readouts.full, ...readouts.claims].map((output) => output.textContent)")
    assert "steps at" in told[0]
    assert re.search("ε0.9|ε1.0", told[1])
    assert re.search("ε1.9|ε2.0", told[2])


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["michaelis_menten", "koper"])
def test_the_strip_shows_the_time_scales_that_gsp_scales_tells(name: str, opened) -> None:
    scene = models.load(name)
    page = opened(name)
    page.measured()
    strip = page.run(
        "const { t, modes, gaps } = current.scales;"
        "return [Array.from(t), modes.map((m) => Array.from(m)), gaps.map((g) => g && g.between)];"
    )
    times, modes, gaps = np.array(strip[0]), np.array(strip[1], dtype=float), strip[2]
    assert len(times) > 30
    # A story may begin at another epsilon than the scene.
    expected = gsp.time_scales(scene, at=times, epsilon=page.run("return state.epsilon")).times.T
    np.testing.assert_allclose(10.0**modes, expected, rtol=1e-5)
    for k, gap in enumerate(gaps):
        if gap is not None:
            # All of these decay in the model: the widest gap is the one that is shaded.
            apart = expected[1:, k] / expected[:-1, k]
            assert 10 ** (gap[1] - gap[0]) == pytest.approx(apart.max(), rel=1e-5)
            assert apart.max() >= 10
    assert any(gap is not None for gap in gaps)
    assert page.inked("scales") > 1000
    assert page.run("return views.scales.box[1] === views.trace.box[1]")


def test_a_model_without_a_small_parameter_has_its_strip_and_one_without_a_gap_says_so(
    page, tmp_path: Path
) -> None:
    file = tmp_path / "turning.toml"
    file.write_text(
        '[states]\nx = "v"\nv = "-x"\n[start]\nx = 1\nv = 0\n[scene]\nspan = [0, 9]\n', encoding="utf-8"
    )
    target = tmp_path / "turning.html"
    gsp.write_demo(gsp.load(file), target)
    page.open(target)
    page.settle()
    assert page.run("return current.scales.gaps.every((gap) => gap === null)")
    np.testing.assert_allclose(page.run("return Array.from(current.scales.modes[1])"), 0.0, atol=1e-12)
    assert "none decays" in page.run("return views.scales.caption.textContent")
    assert page.complaints() == []


def test_eigenvalues_on_a_page_are_those_of_lapack(opened) -> None:
    page = opened("linear")
    random = np.random.default_rng(5)
    matrices = [random.normal(size=(n, n)) for n in (2, 3, 5, 12)]
    # Graded by units, of lower rank, turning, and without enough eigenvectors.
    matrices += [
        10.0 ** random.uniform(-6, 6, (6, 1)) * matrices[2][0, 0] * random.normal(size=(6, 6)),
        random.normal(size=(7, 2)) @ random.normal(size=(2, 7)),
        np.kron(np.eye(3), [[0.0, 2.0], [-2.0, 0.0]]),
        np.diag(np.ones(4), 1),
    ]
    for matrix in matrices:
        n = len(matrix)
        re, im = page.run(
            "const e = eigenvaluesOf(arguments[0], arguments[1]); return [Array.from(e.re), Array.from(e.im)];",
            matrix.ravel().tolist(),
            n,
        )
        got, expected = np.array(re) + 1j * np.array(im), np.linalg.eigvals(matrix)
        near = np.abs(got[:, None] - expected)
        rows, columns = scipy.optimize.linear_sum_assignment(near)
        assert near[rows, columns].max() <= 100 * n * np.finfo(float).eps * np.linalg.norm(matrix)


def test_a_curve_is_not_joined_across_a_pole(opened) -> None:
    page = opened(POLE, fragment="#orders=0.1")
    # Where a curve is drawn, the pen is down from one point to the next.
    strokes = page.run(
        "const found = []; const curve = views.plane.curve;"
        "views.plane.curve = function (x, y, colour, ...rest) {"
        "  if (colour === colours().manifold) found.push([Array.from(x), Array.from(y)]);"
        "  curve.call(this, x, y, colour, ...rest);"
        "}; draw(); return found;"
    )
    box = page.run("return views.plane.box")
    drawn = []
    for xs, ys in strokes:
        x, y = (np.array([np.nan if v is None else v for v in values], dtype=float) for values in (xs, ys))
        known = np.isfinite(x)
        np.testing.assert_allclose(y[known], x[known] ** 2 / (x[known] - 1), rtol=1e-9)
        drawn.append(x[known])
        down = known[:-1] & known[1:]
        assert not (down & (x[:-1] < 1) & (x[1:] > 1)).any()
    # All else is one curve on either side, in steps of a pixel, up to where it leaves the picture.
    x = np.sort(np.concatenate(drawn))
    y = x**2 / (x - 1)
    seen = (y > box[2]) & (y < box[3])
    pixel = 2 * (box[3] - box[2]) / page.run("return views.plane.height")
    assert np.abs(np.diff(y)[seen[:-1] & seen[1:]]).max() < pixel
    assert page.complaints() == []


@pytest.mark.parametrize("text", ["tan(x)", "x/abs(x)", "1/(x*x)", "sqrt(x)", "1/sin(40*x)"])
def test_pieces_of_a_curve_are_told_by_its_own_values(text: str, opened) -> None:
    page = opened("linear")
    jumps = page.run(
        "const { abs, sin, tan, sqrt } = Math; const at = (x) => ({ x, y: " + text + " });"
        "const pixel = (y) => bounded(40 * y, -200, 200);"
        "const there = (p) => Number.isFinite(p.y);"
        "const apart = (a, b) => there(a) && there(b) ? Math.abs(pixel(a.y) - pixel(b.y))"
        " : there(a) === there(b) ? 0 : Infinity;"
        "const points = tracedCurve(at, [-0.7, 2.1], 30, apart, 20000);"
        "let worst = 0, gaps = []; points.forEach((p, k) => {"
        "  if (p === null) gaps.push([points[k - 1].x, points[k + 1].x]);"
        "  else if (points[k + 1]) worst = Math.max(worst, apart(p, points[k + 1]));"
        "}); return [worst, gaps, points.length];"
    )
    worst, gaps, count = jumps
    assert worst <= 1
    poles = {
        "tan(x)": [np.pi / 2], "x/abs(x)": [0], "1/(x*x)": [0], "sqrt(x)": [0],
        "1/sin(40*x)": [k * np.pi / 40 for k in range(-8, 27)],
    }[text]  # fmt: skip
    # An even pole passes above the picture, on both its sides.
    assert len(gaps) >= len(poles) - text.count("x*x")
    for low, high in gaps:
        assert high - low < 1e-12
        assert min(abs(low - pole) for pole in poles) < 1e-12
    assert count < 20_000


@pytest.mark.exhaustive
def test_folds_are_ringed_wherever_the_curve_turns_and_at_any_parameter(opened) -> None:
    page = opened("van_der_pol")
    for step in (0, 1, 4):
        page.run("turnTo(arguments[0]); play(false)", step)
        page.settle()
        folds = page.run("return views.plane.folds")
        np.testing.assert_allclose(sorted(folds), [[-1, 2 / 3], [1, -2 / 3]], atol=1e-12)
    page = opened("fitzhugh_nagumo")
    assert len(page.run("return views.plane.folds")) == 2
    # A graph with a pole changes its type there without a fold.
    assert opened(POLE).run("return views.plane.folds") == []


@pytest.mark.exhaustive
def test_the_surface_goes_as_far_as_the_run(opened) -> None:
    page = opened("koper")
    page.run("turnTo(3); play(false)")
    page.settle()
    low, spans, attracts = page.run(
        "const x = data.space.indexOf('x'); const all = net.lines.flatMap((line) => line.along[x]);"
        "const lowest = Math.min(...current.curves.full.q[model.quantities.indexOf('x')]);"
        "return [lowest, [Math.min(...all.filter(Number.isFinite)), Math.max(...all.filter(Number.isFinite))],"
        " net.lines.filter((line) => line.attracts).flatMap((line) => line.along[x].filter((v) => v < -1)).length];"
    )
    assert low < -1.9
    assert spans[0] <= low
    assert spans[1] >= 2.0
    assert attracts > 20


@pytest.mark.exhaustive
def test_the_layer_is_shaded_as_long_as_it_is_seen(opened) -> None:
    page = opened("van_der_pol")
    page.measured()
    page.settle()
    x, end, arrived = page.run(
        "const j = model.quantities.indexOf(state.trace); const { layer } = current.curves;"
        "const at = layer.times.indexOf(views.trace.layerEnd);"
        "const away = (k) => Math.abs(views.trace.Y(layer.run[k][j]) - views.trace.Y(layer.on[k][j]));"
        "return [[away(0), away(at - 1), away(at + 1)], views.trace.layerEnd, current.result.layerEnd];"
    )
    # Two e-folds of fast time tell a hundred pixels from fourteen; errors are measured from where nothing is left.
    assert x[0] > 100
    assert x[1] > 0.9
    assert x[2] < 1.1
    assert 0.02 < end < 0.08
    assert arrived > 3 * end
    # The slow variable has no layer to be seen.
    page.run("state.trace = 'y'; draw()")
    assert page.run("return views.trace.layerEnd") is None
    # A start on the slow manifold has none either.
    page = opened("linear", fragment="#orders=0")
    page.run(
        "state.start[1] = current.result.full.states.at(-1)[1]; state.start[0] = current.result.full.states.at(-1)[0];"
    )
    page.run("update()")
    assert page.run("return views.trace.layerEnd") is None


def test_the_ranges_of_a_view_hold_its_axes(opened) -> None:
    page = opened(POLE)
    assert page.run("return views.plane.box") == [-1, 4, -10, 10]
    assert page.run("return views.trace.box") == [0, 0.25, 3, 6]
    page.run("state.trace = 'x'; state.axes = ['y', 'x']; changed()")
    page.settle()
    # Other pictures than those that were asked for follow the run.
    assert page.run("return views.trace.box[1]") == 0.5
    assert page.run("return views.plane.box") != [-10, 10, -1, 4]


@pytest.mark.exhaustive
def test_a_parameters_slider_keeps_its_sign(opened) -> None:
    page = opened(HOSTILE)
    ends = "return ['min', 'max'].map((end) => Number(document.getElementById(arguments[0])[end]))"
    assert page.run(ends, "parameter-0") == [0.8, 5.0]
    for name in ("lindemann", "koper"):
        page = opened(name)
        for k, value in enumerate(page.run("return model.values")):
            low, high = page.run(ends, f"parameter-{k}")
            assert low <= value <= high
            assert low * high > 0


@pytest.mark.parametrize("text", ["<!--", "</script>", "<script>", "&lt;", "]]>"])
def test_data_on_a_page_begins_no_markup(text: str) -> None:
    held = embedded({"key " + text: [text]})
    assert not set(held) & set("<>&")
    assert json.loads(held) == {"key " + text: [text]}


def test_greek_names_are_shown_as_they_are(opened, page, tmp_path: Path) -> None:
    greek, y, epsilon = sp.symbols("π y epsilon")
    system = gsp.SlowFastSystem(slow={greek: -greek * y}, fast={y: greek - y}, epsilon=epsilon)
    scene = gsp.Scene(system, {"π": (0, 2)}, {"π": 1, "y": 0}, (0, 3), 0.01, (0.02, 0.01), 1e-6)
    page.open(gsp.write_demo(scene, tmp_path / "greek.html"))
    assert page.run("return document.getElementById('axis-x').value") == "π"
    assert page.complaints() == []


def test_the_axis_of_the_small_parameter_has_its_own_name(page, tmp_path: Path) -> None:
    x, y, small = sp.symbols("x y TA")
    system = gsp.SlowFastSystem(slow={x: -x}, fast={y: x - y}, epsilon=small)
    scene = gsp.Scene(system, {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01, (0.02, 0.01), 1e-6)
    page.open(gsp.write_demo(scene, tmp_path / "small.html"))
    shown = page.run(
        "const found = []; const axes = views.errors.axes;"
        "views.errors.axes = function (across, ...rest) { found.push(across); axes.call(this, across, ...rest); };"
        "draw(); return [...found, views.errors.caption.textContent];"
    )
    assert shown[0] == [["TA", 0]]
    assert "against TA" in shown[1]
    assert page.complaints() == []


def test_the_policy_lets_nothing_else_run(opened) -> None:
    page = opened("linear")
    page.run(
        "const s = document.createElement('script'); s.textContent = 'window.injected = 1'; document.body.append(s);"
        "const i = document.createElement('img'); i.src = 'https://example.org/x.png'; document.body.append(i);"
    )
    page.settle()
    assert page.run("return typeof window.injected") == "undefined"
    assert any("Content Security Policy" in line for line in page.complaints())


@pytest.mark.exhaustive
def test_a_model_of_ones_own_in_four_dimensions(opened) -> None:
    page = opened(CUBE)
    assert page.run("return model.quantities") == ["x", "z", "u", "w"]
    page.measured()
    powers = page.run("return [0, 1].map((k) => measuredPower((row) => row.orders[k]))")
    np.testing.assert_allclose(powers, [1, 2], atol=0.2)
    assert page.complaints() == []


def test_a_field_without_a_standard_form_is_shown_without_reduction(opened) -> None:
    page = opened(NON_STANDARD)
    assert "Only the full system is shown" in page.run("return document.getElementById('notes').innerText")
    assert page.inked() > 1000
    assert page.complaints() == []


def test_a_demo_is_saved_whole_or_not_at_all(tmp_path: Path) -> None:
    path = gsp.write_demo(models.load("linear"), tmp_path / "page.html")
    assert path.read_text(encoding="utf-8").startswith("<!doctype html>")
    with pytest.raises(OutputError):
        gsp.write_demo(models.load("linear"), tmp_path / "nowhere" / "page.html")


def test_a_scene_that_was_changed_is_not_told_another_ones_story() -> None:
    scene = models.load("van_der_pol")
    changed = gsp.study(scene).asking(epsilon=0.02).scene
    assert demos._told(changed) == {}


WHOLE_CYCLE = """
[parameters]
a = 0.7
b = 0.8
I = 0.5
[slow]
w = "v + a - b*w"
[fast]
v = "v - v^3/3 - w + I"
[region]
w = [-0.5, 1.5]
v = [-2.5, 2.5]
[start]
w = 0.5
v = 1.5
[scene]
span = [0, 8]
epsilon = 0.05
"""


@pytest.mark.exhaustive
def test_a_jump_from_a_first_short_piece_is_no_initial_layer(opened) -> None:
    """The start is a fifth of a unit of time from the fold: reduced runs begin behind the jump, and are not followed
    back through it, which took them to w = 4.5.
    """
    page = opened(WHOLE_CYCLE)
    asked = (
        "const piece = current.result.pieces[0]; const run = piece.runs[0];"
        "return [run.first, run.begun, piece.left];"
    )
    first, begun, left = page.run(asked)
    assert left is True
    assert first == begun > 0.5
    # From further off on the same sheet there is an initial layer, and reduced runs begin with the start.
    far = opened(WHOLE_CYCLE, fragment="#s.w=-0.5&s.v=1.5")
    first, begun, left = far.run(asked)
    assert (first, left) == (0, False)
    assert 0.1 < begun < 0.5
