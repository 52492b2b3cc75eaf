"""Stories of one's own: what the documentation says is enough, what is wrong is named, and a share keeps all."""

import itertools
import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

import gsp
from gsp import models
from gsp.cli import cli
from gsp.demos.prose import markup
from gsp.errors import ModelFileError

DOCS = Path(__file__).parents[2] / "docs" / "stories.md"
MODEL, STORY = re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)[:2]


@pytest.fixture(scope="module")
def cart(tmp_path_factory) -> gsp.Scene:
    file = tmp_path_factory.mktemp("cart") / "cart.toml"
    file.write_text(MODEL, encoding="utf-8")
    return gsp.load(file)


def told(cart: gsp.Scene, tmp_path: Path, text: str) -> gsp.Demo:
    (tmp_path / "story.toml").write_text(text, encoding="utf-8")
    return gsp.demo(cart, story=tmp_path / "story.toml")


def test_the_story_of_the_page_is_clicked_through(cart, page, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("cart.toml").write_text(MODEL, encoding="utf-8")
    Path("story.toml").write_text(STORY, encoding="utf-8")
    assert STORY.count("\n") <= 41
    done = CliRunner().invoke(
        cli, ["demo", "cart.toml", "--story", "story.toml", "-o", "cart.html", "--no-open"]
    )
    assert done.exit_code == 0, done.output
    page.open(tmp_path / "cart.html")
    seen = "return Object.entries(views).filter(([, v]) => v.figure.offsetParent).map(([name]) => name)"
    assert page.run(seen) == ["path"]
    lit = "return [...document.querySelectorAll('.lit')].length"
    for step, ringed in enumerate((0, 0, 2, 3)):
        if step:
            page.run("document.getElementById('next').click()")
        page.settle()
        assert page.run("return state.step") == step
        assert page.run(lit) == ringed
        assert page.inked("path") > 2000
        assert page.run("return document.querySelectorAll('#tale math').length") > 0 or step in (0, 3)
    assert {"path", "plane", "trace", "errors"} <= set(page.run(seen))
    assert page.run("return [state.trace, state.parameters, state.epsilon]") == ["E", [4, 0.5], 0.5]
    # What the story calls energy is that of the model, at the start.
    assert page.run("return current.curves.full.q[model.quantities.indexOf('E')][0]") == pytest.approx(
        4 * 1.5**2 / 2 + 0.5 / 2
    )
    assert page.complaints() == []


@pytest.mark.exhaustive
def test_every_part_of_a_body_draws_something(cart, page, tmp_path) -> None:
    parts = re.findall(r"^\| `(\{ .* \})` \|", DOCS.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(parts) == 7
    names = {"theta": "v", "phi": "v", "a": "k"}
    for part in parts:
        known = re.sub(r'(?<!name = )"(theta|phi|a)"', lambda found: f'"{names[found[1]]}"', part)
        drawn = []
        for body in ("", known):
            head = f'[body]\nat = [0.3, -0.2]\nangle = "v"\nparts = [{body}]\n[[steps]]\ntext = "x"\n'
            page.open(told(cart, tmp_path, head).save(tmp_path / "part.html"))
            page.run("now = 1; draw()")
            drawn.append(page.inked("path"))
        assert drawn[1] > drawn[0] + 10, part
        assert page.complaints() == []


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ('axes = ["x", "v"]=>axes = ["x", "q"]', 'axes: there is no quantity q. There are x, v'),
        ("k = [0.2, 4]=>k = [4, 0.2]", "ranges.k is [low, high] with low below high"),
        ("k = [0.2, 4]=>kappa = [0.2, 4]", "ranges: there is no parameter kappa"),
        ("k = 4, b = 0.5=>k = 40, b = 0.5", "step 4: parameters.k is outside its range [0.2, 4]"),
        ("x = 1.5, v = 1 }=>q = 1 }", "step 2: start: there is no state q"),
        ("orders = [0, 1]=>orders = [0, 7]", "step 4: orders are among 0, 1, 2, 3"),
        ("epsilon = 0.2=>epsilon = -1", "step 3: epsilon is above 0"),
        ('views = ["path"]=>views = ["map"]', "step 1: views: there is no picture map"),
        ('"errors", "epsilon"]=>"error"]', 'Did you mean "errors"?'),
        ('text = "The velocity=>txt = "The velocity', "step 2: txt is unknown"),
        ("$v = -k*x/b$=>$v = -k*x/b", "step 2: a dollar sign opens a formula"),
        ("$v = -k*x/b$=>$v = -k x/b$", "step 2: in the formula v = -k x/b"),
        ("wheel = 0.12=>whel = 0.12", "body.parts 4 is one of points, wheel, spring"),
        ("coils = 9=>coils = 0", "body.parts 2.coils is above 0"),
        ('E = "k*x^2/2=>x = "k*x^2/2', "quantities.x is a name of the model already"),
        ('E = "k*x^2/2=>E = "kk*x^2/2', 'quantities.E: the name "kk" is not declared'),
        ("play = true=>rivals = true", "the model has no [claims]"),
        ("play = true=>fixed = 0.1", "belong to a story with work = true"),
        ("[[steps]]=>[[stages]]", "stages is unknown"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_place(cart, changed: str, said: str, tmp_path) -> None:
    before, after = changed.split("=>")
    assert before in STORY
    with pytest.raises(ModelFileError) as caught:
        told(cart, tmp_path, STORY.replace(before, after))
    assert said in str(caught.value)
    assert str(caught.value).startswith("story.toml: ")


def test_near_needs_a_body(cart, tmp_path) -> None:
    with pytest.raises(ModelFileError, match="step 1: near shows the body, and the story has none"):
        told(cart, tmp_path, '[[steps]]\ntext = "Nothing is near."\nnear = true\n')


def test_a_story_that_is_no_file_is_refused(cart, tmp_path) -> None:
    with pytest.raises(ModelFileError, match="there is no such file"):
        gsp.demo(cart, story=tmp_path / "nothing.toml")


def test_words_of_a_story_are_escaped_and_its_formulas_set() -> None:
    made = markup("<b>1 & 2</b>: $v' = a*omega^2/2, x -> 0.05$")
    assert made.startswith("&lt;b&gt;1 &amp; 2&lt;/b&gt;: <math>")
    assert {"<mfrac>", "<mn>0.05</mn>", "→"} <= {
        part for part in ("<mfrac>", "<mn>0.05</mn>", "→") if part in made
    }


@pytest.mark.exhaustive
def test_a_share_keeps_the_step_and_all_values(page, tmp_path) -> None:
    page.open(gsp.write_demo(models.load("van_der_pol"), tmp_path / "demo.html"))
    page.run("turnTo(3); play(false)")
    page.slide("epsilon", -1.7)
    page.slide("parameter-0", 0.4)
    page.run("document.getElementById('share').click()")
    link = page.run("return document.getElementById('link').value")
    state = page.run("return state")
    assert state["step"] == 3
    page.open(tmp_path / "demo.html", fragment=link[link.index("#") :])
    assert page.run("return state") == state
    # A step alone is that step as it is written.
    page.open(tmp_path / "demo.html", fragment="#step=3")
    fresh = page.run("return [state.step, state.epsilon, state.end, state.orders]")
    assert fresh == [3, 0.01, 0.6, [0, 1, 2, 3]]


@pytest.mark.exhaustive
def test_the_sleighs_two_equations_differ_in_path_energy_and_colour(page, tmp_path) -> None:
    page.open(gsp.write_demo(models.load("chaplygin_sleigh"), tmp_path / "demo.html"), fragment="#step=7")
    page.settle()
    page.measured()
    energies, held = page.run(
        "const at = (name) => model.quantities.indexOf(name); const { full, rivals } = current.curves;"
        "const inside = (range, values) => values.every((v) => !(v < range[0] || v > range[1]));"
        "const held = rivals.every(({ q }) => inside(views.path.box, q[at('x')]) &&"
        " inside(views.path.box.slice(2), q[at('y')]) && inside(views.plane.box, q[at('v')]) &&"
        " inside(views.plane.box.slice(2), q[at('omega')]) && inside(views.trace.box.slice(2), q[at('H')]));"
        "return [rivals.map(({ q }) => [q[at('H')][0], q[at('H')].at(-1)]), held];"
    )
    (start, printed), (same, corrected) = energies
    assert (start, same) == (pytest.approx(1.539, abs=5e-4),) * 2
    assert printed == pytest.approx(2.363, abs=5e-4)
    assert corrected == pytest.approx(1.110, abs=5e-4)
    assert held
    # The path of a claim is driven by its own velocities: a second route with SciPy's integrator.
    scene = models.load("chaplygin_sleigh")
    assert page.run("return current.curves.rivals.map(({ q }) => q[model.quantities.indexOf('x')].at(-1))") == [
        pytest.approx(path_end(scene, name, page), abs=1e-3) for name in scene.claims
    ]


def path_end(scene: gsp.Scene, name: str, page) -> float:
    """x at the end of a claim's path, with the slip w = -v omega/rho of the lecture's (17)."""
    from scipy.integrate import solve_ivp

    begun = page.run(
        "const at = (n) => model.quantities.indexOf(n); const r = current.curves.rivals[0];"
        "return [r.t[0], ...['v', 'omega', 'phi', 'x', 'y'].map((n) => r.q[at(n)][0])];"
    )
    rho, sign = (1 + 0.04) / 0.05, 1 if name.endswith("printed") else -1

    def rates(t, z):
        v, omega, phi, _, _ = z
        w = -v * omega / rho
        turning = -0.2 * v * omega / 1.04 + 0.05 * 0.2 / 1.04**2 * (0.2 * omega**3 - 0.2 * v**2 * omega / 1.04)
        rate = 0.2 * omega**2 + sign * 0.05 * v * omega**2 / 1.04
        return [rate, turning, omega, v * np.cos(phi) - w * np.sin(phi), v * np.sin(phi) + w * np.cos(phi)]

    return solve_ivp(rates, (begun[0], 12.0), begun[1:], rtol=1e-10, atol=1e-12).y[3, -1]


def test_the_arrows_are_those_of_the_lectures_figure_4(page, tmp_path) -> None:
    page.open(gsp.write_demo(models.load("chaplygin_sleigh"), tmp_path / "demo.html"))
    for v, omega in ((-1.0, 1.5), (0.5, -0.7), (1.2, 0.3)):
        got = page.run(
            "const flow = model.flowIn(['v', 'omega'].map((n) => model.quantities.indexOf(n)),"
            " settingOf(state, data)); const rate = [0, 0]; flow(arguments[0], rate); return rate;",
            [v, omega],
        )
        assert got == pytest.approx([0.2 * omega**2, -0.2 * v * omega / 1.04], abs=1e-5)


# Machado, Oliveira and Fernandes (2009): what somebody sees who lacks one kind of cones, in linear light.
LACKING = (
    "1 0 0 0 1 0 0 0 1",
    "0.152286 1.052583 -0.204868 0.114503 0.786281 0.099216 -0.003882 -0.048116 1.051998",
    "0.367322 0.860646 -0.227968 0.280085 0.672501 0.047413 -0.011820 0.042940 0.968881",
    "1.255528 -0.076749 -0.178779 -0.078411 0.930809 0.147602 0.004733 0.691367 0.303900",
)
SEEN = [np.array(numbers.split(), dtype=float).reshape(3, 3) for numbers in LACKING]
XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])


def linear(colour: str) -> np.ndarray:
    c = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def lab(light: np.ndarray) -> np.ndarray:
    x, y, z = np.cbrt(np.clip(XYZ @ np.clip(light, 0, 1) / XYZ.sum(axis=1), 0.009, None))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.exhaustive
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_the_two_equations_are_told_apart_by_the_colour_blind(theme: str, page, tmp_path) -> None:
    page.open(gsp.write_demo(models.load("chaplygin_sleigh"), tmp_path / "demo.html"))
    page.run("setTheme(arguments[0])", theme)
    shown = page.run("const c = colours(); return [...c.rivals, c.ink, c.paper]")
    for seen, (one, other) in itertools.product(SEEN, itertools.combinations(shown[:3], 2)):
        apart = np.linalg.norm(lab(seen @ linear(one)) - lab(seen @ linear(other)))
        # Differences of a few units are seen side by side, of ten at a glance.
        assert apart > 15
    for colour in shown[:2]:
        low, high = sorted(float(XYZ[1] @ linear(c)) for c in (colour, shown[3]))
        assert (high + 0.05) / (low + 0.05) >= 3


def test_a_mark_is_a_line_at_a_value_of_either_axis(cart, page, tmp_path) -> None:
    step = '[[steps]]\ntext = "Here."\nviews = ["plane"]\n'
    marked = step + 'marks = [{{ axis = "{}", at = 0.5, name = "here" }}]\n'
    text = 'axes = ["x", "v"]\n' + step + marked.format("x") + marked.format("v")
    (tmp_path / "story.toml").write_text(text, encoding="utf-8")
    page.open(gsp.write_demo(cart, tmp_path / "cart.html", story=tmp_path / "story.toml"))
    ink = []
    for _ in range(3):
        page.settle()
        ink.append(page.inked("plane"))
        page.run("document.getElementById('next').click()")
    plain, upright, level = ink
    assert upright > plain + 100
    assert level > plain + 100
