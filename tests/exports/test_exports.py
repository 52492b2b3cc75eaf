"""Exported texts run in their own tools and compute what the package does."""

import itertools
import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

import gsp
from gsp import models
from gsp.algebra.languages import JAVASCRIPT, PYTHON, XPPAUT, C
from gsp.algebra.printing import Language, Printer
from gsp.cli import cli
from gsp.errors import BudgetError, DeclarationError, UnsupportedFunctionError
from gsp.exports import TARGETS
from gsp.exports.formats import FORMATS
from gsp.exports.reduced_model import inert
from gsp.lowering.compiled_function import compile_function
from gsp.readers.expressions import parse_expression
from tests import xppaut
from tests.cases import sampled

NAMES = [name for name, _ in models.summary()]
FEW = ("michaelis_menten", "van_der_pol", "koper")
ORDER = 2
GOLDEN = Path(__file__).parent / "michaelis_menten.jl"


@cache
def study(name: str) -> gsp.Study:
    return gsp.study(models.load(name))


@cache
def text_of(name: str, to: str) -> str:
    return gsp.export(study(name), order=ORDER, to=to)


@cache
def expected(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (m, n_states) over the region, the package's reduced rates and what it observes, slow variables first."""
    made, system, flow = study(name), study(name).system, study(name).reduced(ORDER, reconstructed=False)
    if made.branch.is_explicit:
        random = np.random.default_rng(5)
        points = np.column_stack([random.uniform(*made.region[s.name], 20) for s in system.x])
    else:
        points = on_sheet(made)[:, [system.states.index(c) for c in flow.manifold.coordinates]]
    observed = (*(s for s in system.x if s not in flow.states), *system.y)
    wanted = (*flow.rates, *(flow.observables[s] for s in observed))
    function = compile_function(wanted, arguments=flow.states, epsilon=flow.epsilon, parameters=())
    values = function(points, np.array([made.scene.epsilon])).reshape(len(points), -1)
    count = len(flow.states)
    return points, values[:, :count], values[:, count:]


def on_sheet(made: gsp.Study) -> np.ndarray:
    """Points (x, y) of an implicit branch's sheet over the region, away from its folds."""
    system, random = made.system, np.random.default_rng(5)
    candidates = np.column_stack([random.uniform(*made.region[s.name], 60) for s in system.x])
    fast, inside = made.branch.follow(candidates)
    for i, (low, high) in enumerate(made.region[s.name] for s in system.y):
        inside = inside & (fast[:, i] >= low) & (fast[:, i] <= high)
    points = np.hstack([candidates, fast])[inside][:20]
    assert len(points) >= 10
    return points


def check(name: str, rates: object, manifold: object) -> None:
    _, wanted_rates, wanted_manifold = expected(name)
    for found, wanted in ((rates, wanted_rates), (manifold, wanted_manifold)):
        values = np.asarray(found, dtype=float)
        assert values.shape == wanted.shape
        # Relative to a component's size over the region: a value near a zero has no digits of its own.
        size = np.abs(wanted).max(axis=0)
        assert (np.abs(values - wanted) <= 1e-12 * np.maximum(np.abs(wanted), size)).all(), name


def run_python(text: str) -> dict:
    names: dict = {}
    exec(compile(text, "exported.py", "exec"), names)
    return names


def run_c(
    text: str, folder: Path, points: np.ndarray, epsilon: float, counts: tuple[int, int]
) -> list[np.ndarray]:
    """What both functions give at `points`, run in a program of their own."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    rows = ", ".join("{" + ", ".join(map(repr, row)) + "}" for row in points.tolist())
    calls = "".join(
        f"{name}(points[i], {epsilon!r}, reduced_parameters, out); "
        f'for (int j = 0; j < {n}; j++) printf("%.17g ", out[j]); '
        for name, n in zip(("reduced_rates", "reduced_slow_manifold"), counts)
    )
    main = (
        f"#include <stdio.h>\nstatic const double points[][{points.shape[1]}] = {{{rows}}};\n"
        f"int main(void) {{ double out[64]; for (int i = 0; i < {len(points)}; i++) "
        f'{{ {calls} printf("\\n"); }} return 0; }}\n'
    )
    (folder / "model.c").write_text(text + main, encoding="utf-8")
    subprocess.run(
        ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-O1", "model.c",
         "-o", "model", "-lm"], cwd=folder, check=True, timeout=120,
    )  # fmt: skip
    printed = subprocess.run([folder / "model"], capture_output=True, text=True, check=True, timeout=60).stdout
    values = np.array([[float(word) for word in line.split()] for line in printed.splitlines()])
    return np.hsplit(values, [counts[0]])


def run_node(text: str, folder: Path, points: np.ndarray) -> dict:
    if shutil.which("node") is None:
        pytest.skip("node is not installed")
    (folder / "model.js").write_text(text, encoding="utf-8")
    call = (
        f"const m = require('./model.js'); const points = {json.dumps(points.tolist())};"
        "console.log(JSON.stringify({rates: points.map(p => m.rates(p)), y: points.map(p => m.slowManifold(p))}));"
    )
    done = subprocess.run(
        ["node", "-e", call], cwd=folder, capture_output=True, text=True, check=True, timeout=60
    )
    return json.loads(done.stdout)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", NAMES)
def test_every_scene_computes_the_same_in_python(name: str) -> None:
    points, *_ = expected(name)
    names = run_python(text_of(name, "python"))
    check(name, names["rates"](0.0, points.T).T, names["slow_manifold"](points.T).T)
    # At one point too, as an integrator calls it.
    one = np.array([names["rates"](0.0, point) for point in points])
    assert one.shape == points.shape
    check(name, one, names["slow_manifold"](points.T).T)


@pytest.mark.parametrize("name", sampled(NAMES, always=FEW))
def test_every_scene_computes_the_same_in_c(name: str, tmp_path: Path) -> None:
    points, rates, manifold = expected(name)
    counts = rates.shape[1], manifold.shape[1]
    found = run_c(text_of(name, "c"), tmp_path, points, study(name).scene.epsilon, counts)
    check(name, *found)


@pytest.mark.parametrize("name", sampled(NAMES, always=FEW))
def test_every_scene_computes_the_same_in_javascript(name: str, tmp_path: Path) -> None:
    found = run_node(text_of(name, "javascript"), tmp_path, expected(name)[0])
    check(name, found["rates"], found["y"])


@pytest.mark.parametrize("name", sampled(NAMES, always=FEW))
def test_every_scene_reads_back_from_an_ode_file(name: str, tmp_path: Path) -> None:
    text = text_of(name, "ode")
    path = tmp_path / "model.ode"
    # With a state that is fast, and a parameter that is small, the file is a model with two time scales.
    text, count = re.subn(r"\bepsilon=[0-9.e-]+", "epsilon=0.01", text)
    assert count == 1
    path.write_text(text.replace("par ", "probe'=(1 - probe)/epsilon\npar ", 1), encoding="utf-8")
    made, (points, _, manifold) = study(name), expected(name)
    field = gsp.load(path).system
    assert isinstance(field, gsp.VectorField)
    count = points.shape[1]
    rates = {state: rate for state, rate in zip(field.states, field.rates) if state.name != "probe"}
    assert len(rates) == count
    outputs = [*rates.values(), *field.observables.values()]
    outputs = [output.xreplace(dict(field.parameters)) for output in outputs]
    function = compile_function(outputs, arguments=tuple(rates), epsilon=field.epsilon, parameters=())
    values = function(points, np.array([made.scene.epsilon])).reshape(len(points), -1)
    assert values.shape[1] == count + manifold.shape[1]
    check(name, values[:, :count], values[:, count:])


def test_parameters_and_epsilon_are_arguments(tmp_path: Path) -> None:
    names = run_python(text_of("michaelis_menten", "python"))
    made = study("michaelis_menten")
    other = gsp.study(models.load("michaelis_menten")).system.with_parameters(kappa=2, **{"lambda": 0.25})
    series = gsp.expand(gsp.solve_critical(other).branches[0], order=ORDER)
    got = names["slow_manifold"]([0.7], 0.02, kappa=2.0, lambda_=0.25)
    assert got == pytest.approx(series.evaluate({"s": 0.7}, 0.02), rel=1e-13)
    assert got != pytest.approx(made.series(ORDER).evaluate({"s": 0.7}, 0.02), rel=1e-3)


@pytest.mark.exhaustive
def test_where_symbols_take_too_many_terms_values_are_put_in_and_the_text_says_so() -> None:
    assert "values of the parameters are put in" in text_of("car", "python")
    assert "values of the parameters are put in" not in text_of("michaelis_menten", "python")


def test_the_comment_names_origin_order_region_and_the_measured_error() -> None:
    scene = study("michaelis_menten").scene
    error = gsp.compare(study("michaelis_menten"), orders=(ORDER,), epsilons=(scene.epsilon,)).errors[ORDER][0]
    for to in FORMATS:
        comment = unescape(re.sub(r"\s*(\*/)?\n(#|%|//|/\*) ", " ", text_of("michaelis_menten", to)))
        for said in (
            "order 2 in epsilon: michaelis_menten", "Segel", "s in [0.05, 2]", f"Measured error: {error:.2g},",
            "at epsilon = 0.05 over t = 0 to 5",
        ):  # fmt: skip
            assert said in comment, (to, said)


def test_the_julia_text_is_the_one_that_was_read() -> None:
    assert text_of("michaelis_menten", "julia") == GOLDEN.read_text(encoding="utf-8")


def test_latex_holds_the_terms() -> None:
    text = text_of("michaelis_menten", "latex")
    made, (s,) = study("michaelis_menten"), study("michaelis_menten").system.x
    for row in (*made.series(ORDER).coefficients, *made.series(ORDER).reduced_field):
        assert sp.latex(row[0]) in text
    assert rf"\dot{{{s.name}}} &= " in text
    assert text.count(r"\epsilon^{2} ") == 2
    assert r"\lambda = \frac{1}{2}" in text


def test_latex_leaves_out_terms_that_vanish_and_no_variable() -> None:
    u, v, w, epsilon = sp.symbols("u v w epsilon")
    system = gsp.SlowFastSystem(slow={u: -u, w: sp.Integer(0)}, fast={v: epsilon * u * w - v}, epsilon=epsilon)
    box = {"u": (0, 1), "w": (0, 1)}
    asked = gsp.Scene(system, box, {"u": 1, "w": 1, "v": 0}, (0, 1), 0.01, (0.02, 0.01), 1e-6)
    rows = [line for line in gsp.export(gsp.study(asked), order=2, to="latex").splitlines() if "&" in line]
    # v = epsilon u w + epsilon^2 u w + ..., for v' = -v.
    assert rows == [
        r"\dot{u} &= - u \\",
        r"\dot{w} &= 0 \\",
        r"v &= \epsilon \left(u w\right) \\",
        r"&\quad + \epsilon^{2} \left(u w\right)",
    ]


def test_what_is_wider_than_a_page_is_named_in_latex_and_its_sum_stands_below(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # TeX gave up with "Dimension too large": a row had 6,000 letters of a formula in one line.
    u, v, a, b, eps = sp.symbols("u v S_1 b eps")
    loss = u ** sp.Rational(3, 2) / (1 + a * v) - 2 * v - b * v
    system = gsp.SlowFastSystem(slow={u: -u * v}, fast={v: loss}, epsilon=eps, parameters={a: 3, b: 0.5})
    box = {"u": (0.2, 2), "v": (0.01, 2)}
    made = gsp.study(gsp.Scene(system, box, {"u": 1, "v": 0.3}, (0, 2), 0.02, (0.02, 0.01), 1e-6))

    def rows(text: str) -> list[str]:
        return [line.removesuffix(r" \\") for line in text.splitlines() if "&" in line]

    set_by_tex = rows(gsp.export(made, order=2, to="latex"))
    assert max(map(len, set_by_tex)) < 400
    assert set_by_tex[2].startswith(r"&\quad + \mathrm{eps}^{2} \left(")
    # Not S_1 with a space behind the index, which looks like the parameter.
    assert any(row.startswith(r"\mathrm{S\_1\_} &= ") for row in set_by_tex)

    # The same rows in letters that Python reads, from the last to the first, as a name stands above its sum.
    monkeypatch.setattr("gsp.exports.formats.tex", lambda expression, **_: f"({expression})")
    joined = "\n".join(rows(gsp.export(made, order=2, to="latex"))).replace("\n&\\quad", "")
    values = {"u": 0.8, "S_1": 3.0, "b": 0.5, "eps": 0.02, "sqrt": math.sqrt}
    for row in reversed(joined.replace(r"\left", "*").replace(r"\right", "").splitlines()):
        left, _, right = row.partition(" &= ")
        assert left.strip("()") not in values
        values[left.strip("()")] = eval(right, {}, values)
    names = run_python(gsp.export(made, order=2, to="python"))
    state = np.array([0.8])
    assert values[r"\dot{(u)}"] == pytest.approx(names["rates"](0, state)[0], rel=1e-13)
    assert values["v"] == pytest.approx(names["slow_manifold"](state)[0], rel=1e-13)


HOSTILE = 'a "quote" */ #include <x> \\ """ =# alert(1) *\\/ /* //'


def hostile() -> gsp.Scene:
    """A model whose names are keywords of one language or another, and whose texts try to end a comment."""
    words = [sp.Symbol(name) for name in ("in", "var", "end", "lambda", "np", "slow", "u0", "int", "t")]
    x, y, epsilon, *parameters = *words, *map(sp.Symbol, ("_", "Q_", "q_", "FP_NAN", "M_PI", "start", "arg20"))
    rate = -x - sp.sin(x * sum(parameters)) ** 2 / (1 + x**2) - sp.cos(sp.sin(x * sum(parameters)))
    system = gsp.SlowFastSystem(
        slow={x: rate + y}, fast={y: sp.exp(-x) * sp.Rational(1, 3) - y}, epsilon=epsilon,
        parameters={p: sp.Rational(k + 1, 7) for k, p in enumerate(parameters)},
    )  # fmt: skip
    return gsp.Scene(
        system, {"in": (0, 2)}, {"in": 1, "var": 0.2}, (0, 1), 0.01, (0.02, 0.01), 1e-6, source=HOSTILE
    )


@pytest.mark.exhaustive
def test_names_and_texts_of_a_model_do_nothing_in_any_language(tmp_path: Path) -> None:
    made = gsp.study(hostile())
    x = np.array([[0.3], [1.7]])
    series = made.series(1)
    wanted_y = series.evaluate(x, 0.01)
    flow = made.reduced(1)
    function = compile_function(flow.rates, arguments=flow.states, epsilon=flow.epsilon, parameters=())
    wanted = function(x, np.array([0.01])).reshape(2, 1)
    texts = {to: gsp.export(made, order=1, to=to) for to in FORMATS}
    for to, text in texts.items():
        assert "#include <x>" in unescape(text), to
        assert "Renamed: " in text, to
    names = run_python(texts["python"])
    np.testing.assert_allclose(names["rates"](0.0, x.T).T, wanted, rtol=1e-13)
    np.testing.assert_allclose(names["slow_manifold"](x.T).T, wanted_y, rtol=1e-13)
    for rates, y in (
        run_c(texts["c"], tmp_path, x, 0.01, (1, 1)),
        run_node(texts["javascript"], tmp_path, x).values(),
    ):
        np.testing.assert_allclose(rates, wanted, rtol=1e-13)
        np.testing.assert_allclose(y, wanted_y, rtol=1e-13)


# What every object of JavaScript answers to.
INHERITED = ("constructor", "toString", "hasOwnProperty", "valueOf", "__proto__")


@pytest.mark.exhaustive
@pytest.mark.parametrize("state", INHERITED)
def test_names_that_objects_of_javascript_inherit_are_names_like_others(state: str, tmp_path: Path) -> None:
    x, y, epsilon = sp.Symbol(state), sp.Symbol("y"), sp.Symbol("epsilon")
    parameters = {sp.Symbol(name): sp.Rational(k + 2, 3) for k, name in enumerate(INHERITED) if name != state}
    system = gsp.SlowFastSystem(
        slow={x: -x * sum(parameters)},
        fast={y: x - y * sp.Mul(*parameters)},
        epsilon=epsilon,
        parameters=parameters,
    )
    scene = gsp.Scene(system, {state: (0, 2)}, {state: 1, "y": 0.2}, (0, 1), 0.01, (0.02, 0.01), 1e-6)
    found = run_node(gsp.export(scene, order=0, to="javascript"), tmp_path, np.array([[0.3]]))
    values = [float(value) for value in parameters.values()]
    assert found["rates"] == [[pytest.approx(-0.3 * sum(values), rel=1e-13)]]
    assert found["y"] == [[pytest.approx(0.3 / np.prod(values), rel=1e-13)]]


def test_the_sign_of_zero_is_zero_in_every_language_that_runs(tmp_path: Path) -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = gsp.SlowFastSystem(slow={x: 3 * sp.sign(x) + y}, fast={y: x - y}, epsilon=epsilon)
    scene = gsp.Scene(system, {"x": (-1, 1)}, {"x": 0.5, "y": 0.2}, (0, 0.1), 0.01, (0.02, 0.01), 1e-6)
    points, wanted = np.array([[-0.5], [0.0], [0.5]]), np.array([[-3.5], [0.0], [3.5]])
    texts = {to: gsp.export(scene, order=0, to=to) for to in ("python", "c", "javascript")}
    rates = run_python(texts["python"])["rates"]
    np.testing.assert_allclose([rates(0.0, point) for point in points], wanted, rtol=1e-13)
    np.testing.assert_allclose(run_c(texts["c"], tmp_path, points, 0.01, (1, 1))[0], wanted, rtol=1e-13)
    np.testing.assert_allclose(run_node(texts["javascript"], tmp_path, points)["rates"], wanted, rtol=1e-13)


def test_a_comment_is_one_line_without_hidden_characters_or_ends() -> None:
    assert inert("a\nb\r\nc\x1b[31m\u202e\u2028 \\ d") == "a b c/x1b[31m/u202e / d"
    assert inert("**//*/ /**/") == "** // * / / ** /"
    for hard in ("*/", "/*", "/*/", "*//*", "**//", "*\\", "\\*"):
        assert not re.search(r"\*/|/\*", inert(hard)), hard


x, y, k = sp.symbols("x y k")
HARD = {
    "powers": x**2 / y**3 - (x + y) ** 7 / (x - y) ** 4 + x**-1 + k / x**2 + 1 / (x * y) ** 2,
    "a power that varies": (x + 3) ** (2 * k + 1) + 2 ** (-y) - (x + 5) ** (k - y),
    "a power of a power": ((x + 3) ** k) ** y + ((x + 3) ** 3) ** 5,
    "roots": sp.sqrt(x + 3) + 1 / sp.sqrt(y + 3) + (x + 3) ** sp.Rational(2, 3) + (y + 4) ** sp.Rational(-5, 3),
    "cube roots": sp.cbrt(x + 3) - 1 / sp.cbrt(y + 4) + sp.root(k + 3, 4),
    "negatives": (-x) ** 3 - (-(x + 1) - y) - (-2) * -(x**2),
    "numbers": sp.Rational(-5, 7) / y + x / 3 + sp.Integer(3) ** 60 * x + sp.Rational(10**30 + 1, 10**29) * y,
    "extremes": sp.Max(x, y, k) - sp.Min(x, y, k) * sp.Max(0, x),
    "signs": sp.sign(x - y) * sp.Abs(x * y),
    "elementary": sp.exp(-x) * sp.sin(y) + sp.cos(x) * sp.tan(y / 9) + sp.tanh(x) + sp.sinh(y) - sp.cosh(k),
    "inverse": sp.atan(x) + sp.asin(x / 9) + sp.acos(y / 9) + sp.log(x**2 + 1) + sp.pi * x + sp.E * y,
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("kind", HARD)
def test_every_kind_of_expression_keeps_its_value(kind: str, tmp_path: Path) -> None:
    expression, names = HARD[kind], {x: "x", y: "y", k: "k"}

    def printed(language: Language) -> str:
        return Printer(language, names).text(expression)

    points = np.random.default_rng(3).uniform(-2, 2, (8, 3))
    wanted = [float(expression.evalf(40, subs=dict(zip((x, y, k), map(sp.Float, p))))) for p in points]
    python = [eval(printed(PYTHON), {"np": np, "x": a, "y": b, "k": c}) for a, b, c in points]
    np.testing.assert_allclose(python, wanted, rtol=1e-13)
    read = parse_expression(printed(XPPAUT), symbols={s.name: s for s in (x, y, k)})
    values = [float(read.evalf(40, subs=dict(zip((x, y, k), map(sp.Float, p))))) for p in points]
    np.testing.assert_allclose(values, wanted, rtol=1e-13)
    lines = {
        "c": "#include <math.h>\ndouble sign(double u) { return (u > 0) - (u < 0); }\n"
        "const double reduced_parameters[1] = {0};\n"
        "void reduced_rates(const double *slow, double e, const double *p, double *out)\n"
        "{ double x = slow[0], y = slow[1], k = slow[2]; (void)e; (void)p; (void)x; (void)y; (void)k; "
        f"out[0] = {printed(C)}; }}\n"
        "void reduced_slow_manifold(const double *s, double e, const double *p, double *out)\n"
        "{ (void)s; (void)e; (void)p; (void)out; }\n",
        "javascript": f"module.exports = {{rates: ([x, y, k]) => {printed(JAVASCRIPT)}, slowManifold: () => 0}};",
    }
    np.testing.assert_allclose(run_c(lines["c"], tmp_path, points, 0.0, (1, 0))[0][:, 0], wanted, rtol=1e-13)
    np.testing.assert_allclose(run_node(lines["javascript"], tmp_path, points)["rates"], wanted, rtol=1e-13)


def test_what_a_language_lacks_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedFunctionError, match="erf has no counterpart in JavaScript"):
        Printer(JAVASCRIPT, {x: "x"}).text(sp.erf(x))
    with pytest.raises(UnsupportedFunctionError, match="besselj"):
        Printer(PYTHON, {x: "x"}).text(sp.besselj(0, x))
    with pytest.raises(UnsupportedFunctionError, match="Piecewise"):
        Printer(C, {x: "x"}).text(sp.Piecewise((x, x > 0), (1, True)))


def test_the_error_function_is_xppauts_own() -> None:
    # It was refused, though XPPAUT has it.
    text = Printer(XPPAUT, {x: "x"}).text(sp.erf(2 * x) - sp.erf(-x / 3))
    assert xppaut.values("x'=-x\ninit x=0.4\n", [text], [1.0]) == pytest.approx(
        [math.erf(0.8) + math.erf(0.4 / 3)], abs=1e-13
    )


def test_the_error_function_is_read_back_from_an_ode_file(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    path.write_text(
        '[slow]\nx = "-x*(2 + erf(y))"\n[fast]\ny = "erf(3*x) - y"\n[region]\nx = [0, 1]\n[start]\nx = 0.6\ny = 0.5\n'
        "[scene]\nspan = [0, 1]\nepsilon = 0.01\n",
        encoding="utf-8",
    )
    written = tmp_path / "model.ode"
    written.write_text(gsp.export(gsp.load(path), order=0, to="ode"), encoding="utf-8")
    field = gsp.load(written).system
    assert float(field.rates[0].subs("x", 0.6)) == pytest.approx(
        -0.6 * (2 + math.erf(math.erf(1.8))), rel=1e-14
    )


def test_every_target_has_a_text_and_a_row_of_the_page() -> None:
    assert set(FORMATS) == set(TARGETS)
    page = (Path(__file__).parents[2] / "docs" / "exports.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE) == list(TARGETS)


def test_an_unknown_format_is_refused_with_the_remedy() -> None:
    with pytest.raises(DeclarationError, match=r'to is one of python.*Did you mean "latex"'):
        gsp.export(models.load("linear"), to="latx")


def test_the_command_prints_or_writes_the_text(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["export", "linear", "--order", "2", "--to", "c"]
    wanted = gsp.export(models.load("linear"), order=2, to="c")
    assert CliRunner().invoke(cli, arguments).stdout == wanted
    assert CliRunner().invoke(cli, [*arguments, "-o", "model.c"]).stdout == "export: model.c\n"
    assert Path("model.c").read_text(encoding="utf-8") == wanted
    written = json.loads(CliRunner().invoke(cli, [*arguments, "--json"]).stdout)
    assert written == {"name": "linear", "order": 2, "format": "c", "text": wanted}


def coupled(n: int) -> gsp.Scene:
    """So many fast variables that the coefficients are programs, on an implicit branch."""
    fast, x, epsilon = sp.symbols(f"y0:{n}"), sp.Symbol("x"), sp.Symbol("epsilon")
    rates = {
        y: x / (i + 1) - 2 * y + sum(fast) / (4 * n) - y**3 / 3 - fast[(i + 1) % n] ** 2 / 5
        for i, y in enumerate(fast)
    }
    system = gsp.SlowFastSystem(slow={x: -fast[0] - x**3 * fast[-1]}, fast=rates, epsilon=epsilon)
    start = {"x": 0.8, **{y.name: 0.2 for y in fast}}
    return gsp.Scene(system, {"x": (0.1, 1.0)}, start, (0, 1), 0.01, (0.02, 0.01), 1e-6)


@pytest.mark.exhaustive
def test_coefficients_that_are_programs_are_exported_step_by_step(tmp_path: Path) -> None:
    made = gsp.study(coupled(7))
    assert made.series(1).is_program
    flow = made.reduced(1)
    state = np.array([flow.initial({"x": 0.6})])
    function = compile_function(flow.rates, arguments=flow.states, epsilon=flow.epsilon, parameters=())
    wanted = function(state, np.array([0.01]))
    names = run_python(gsp.export(made, order=1, to="python"))
    np.testing.assert_allclose(names["rates"](0.0, state[0]), wanted[0], rtol=1e-12)
    rates, _ = run_c(gsp.export(made, order=1, to="c"), tmp_path, state, 0.01, (8, 7))
    np.testing.assert_allclose(rates, wanted, rtol=1e-12)
    with pytest.raises(BudgetError, match=r"programs of many steps.*another format"):
        gsp.export(made, order=1, to="latex")


def test_coefficients_too_long_to_read_are_nested(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gsp.exports.reduced_model.READABLE", 1)
    made = gsp.study(models.load("michaelis_menten"))
    names = run_python(gsp.export(made, order=ORDER, to="python"))
    points, rates, manifold = expected("michaelis_menten")
    np.testing.assert_allclose(names["rates"](0.0, points.T).T, rates, rtol=1e-12)
    np.testing.assert_allclose(names["slow_manifold"](points.T).T, manifold, rtol=1e-12)
    h, f = made.series(ORDER, symbolic=False).nested
    series = made.series(ORDER, symbolic=False)
    for nested, plain in ((h, series.coefficients), (f, series.coordinate_field)):
        assert all(sp.cancel(a - b) == 0 for rows in zip(nested, plain) for a, b in zip(*rows))


def test_coefficients_too_long_for_a_text_are_refused_with_the_order_that_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = gsp.study(models.load("michaelis_menten"))
    sizes = made.series(ORDER, symbolic=False).sizes
    assert sizes[0] < sizes[1]
    monkeypatch.setattr("gsp.exports.reduced_model.READABLE", 0)
    monkeypatch.setattr("gsp.exports.reduced_model.LONGEST", sizes[0])
    with pytest.raises(BudgetError, match=rf"order 1 have up to {sizes[1]} terms.*Export at order 0"):
        gsp.export(made, order=ORDER)
    assert "order 0" in gsp.export(made, order=0)


def test_what_a_language_has_no_inverse_function_for_keeps_its_brackets() -> None:
    x, k = sp.symbols("x k")
    for expression in (
        k * sp.atanh(x),
        -sp.atanh(x) / k,
        -k * sp.asinh(x) ** 2,
        sp.acosh(x + 2) - k * sp.atanh(x),
    ):
        text = Printer(XPPAUT, {x: "x", k: "k"}).text(expression)
        found = parse_expression(text.replace("1.0", "1"), symbols={"x": x, "k": k})
        point = {x: sp.Rational(1, 3), k: 3}
        assert float(found.subs(point)) == pytest.approx(float(expression.subs(point)), rel=1e-14)


@pytest.mark.parametrize("longest", [60, 150, 900])
def test_what_is_too_long_for_a_line_is_written_in_parts(longest: int) -> None:
    x, y, k = sp.symbols("x y k")
    terms = [(k + i) ** 2 * x**i * y / (1 + i * x) for i in range(1, 40)]
    outputs = [sp.Add(*terms), sp.Mul(*(1 + t for t in terms[:9])) + sp.exp(sp.Add(*terms[20:])), x]
    names = {x: "x", y: "y", k: "k"}
    fresh = (f"u{i}" for i in itertools.count())
    steps, results = Printer(replace(XPPAUT, longest=longest), names).steps(outputs, fresh)
    assert max(map(len, (*results, *(text for _, text in steps)))) <= longest
    values: dict[str, Any] = {"x": 0.3, "y": -1.1, "k": 0.7, "exp": np.exp}
    for name, text in steps:
        values[name] = eval(text.replace("^", "**"), dict(values))
    found = [eval(text.replace("^", "**"), dict(values)) for text in results]
    at = {x: sp.Float("0.3", 30), y: sp.Float("-1.1", 30), k: sp.Float("0.7", 30)}
    assert found == pytest.approx([float(output.evalf(30, subs=at)) for output in outputs], rel=1e-12)


def test_no_two_names_look_alike_in_latex_and_none_like_a_rate() -> None:
    x, xdot, a, b, eps = sp.symbols("x xdot k1 k_1 epsilon")
    system = gsp.SlowFastSystem(
        slow={x: -a * x + b * xdot}, fast={xdot: x - xdot}, epsilon=eps, parameters={a: 1, b: 2}
    )
    scene = gsp.Scene(system, {"x": (0.1, 0.8)}, {"x": 0.5, "xdot": 0.5}, (0, 0.1), 0.01)
    text = gsp.export(scene, order=0, to="latex")
    assert r"\dot{x} &= - x \left(\mathrm{k1} - \mathrm{k\_1}\right)" in text
    assert r"\mathrm{xdot} &= x" in text
    assert r"with $\mathrm{k1} = 1, \mathrm{k\_1} = 2$." in text


@pytest.mark.parametrize("command", [["export", "-o"], ["demo", "--no-open", "-o"], ["chart", "--csv"]])
def test_the_model_is_not_written_over(tmp_path: Path, command: list[str]) -> None:
    path = tmp_path / "m.toml"
    gsp.save(models.load("linear"), path)
    before = path.read_bytes()
    verb, *options = command
    result = CliRunner().invoke(cli, [verb, str(path), *options, str(tmp_path / "." / "m.toml")])
    assert result.exit_code == 1
    assert "the output would be written over the model" in str(result.exception)
    assert path.read_bytes() == before


def test_a_name_is_no_formula_in_latex() -> None:
    # SymPy sets kabs as |k|, x__2 as the square of x, and es as e s.
    x, es, k, m, eps = sp.symbols("x__2 es kabs σ epsilon")
    system = gsp.SlowFastSystem(
        slow={x: -x + k * es}, fast={es: m * x - es}, epsilon=eps, parameters={k: 1, m: 2}
    )
    scene = gsp.Scene(system, {"x__2": (0.1, 0.8)}, {"x__2": 0.5, "es": 0.5}, (0, 0.1), 0.01)
    text = gsp.export(scene, order=0, to="latex")
    assert r"\dot{\mathrm{x\_\_2}} &= \mathrm{x\_\_2} \left(\mathrm{kabs} \sigma - 1\right)" in text
    assert r"\mathrm{es} &= \sigma \mathrm{x\_\_2}" in text
    assert "Renamed: σ to sigma." in text
    assert "def rates(t, state, epsilon=0.01, kabs=1.0, sigma=2.0):" in gsp.export(scene, order=0, to="python")


def test_the_comment_tells_ends_apart_and_has_the_units() -> None:
    clock, state, fast = sp.symbols("clock state fast")
    system = gsp.SlowFastSystem(
        slow={clock: 1, state: fast - state}, fast={fast: state / 2 - fast}, epsilon=sp.Symbol("epsilon")
    )
    scene = gsp.Scene(
        system, {"clock": (1e9 - 5, 1e9 + 5), "state": (0, 2)}, start={"clock": 1e9 - 5, "state": 1, "fast": 1},
        span=(2020.25, 2020.75), epsilon=0.01, epsilons=(0.02, 0.01), units={"state": "nM", "t": "s"},
    )  # fmt: skip
    said = " ".join(line.removeprefix("# ") for line in gsp.export(scene, order=0).splitlines()[:8])
    assert "Region: clock in [999999995, 1000000005], state in [0, 2]." in said
    assert "Units: state in nM, t in s." in said
    assert "over t = 2020.25 to 2020.75 s." in said
