"""Exports for JAX, CasADi and SBML run in these with what the package computes."""

from __future__ import annotations

import math
import operator
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

import gsp
from gsp import models
from gsp.algebra.languages import CASADI, JAX, SBML
from gsp.algebra.printing import Printer
from gsp.errors import BranchError, UnsupportedFunctionError
from gsp.exports.sbml_text import MathPrinter
from gsp.readers.expressions import parse_expression
from tests import xppaut
from tests.cases import sampled
from tests.exports.test_exports import (
    FEW,
    HARD,
    NAMES,
    ORDER,
    check,
    expected,
    hostile,
    run_python,
    study,
    text_of,
)

libsbml = pytest.importorskip("libsbml")
GOLDEN = Path(__file__).parent / "michaelis_menten.jax.txt"
x, y, k = sp.symbols("x y k")


def jax() -> ModuleType:
    found = pytest.importorskip("jax")
    found.config.update("jax_enable_x64", True)
    return found


def test_the_jax_text_is_the_one_that_was_run() -> None:
    assert text_of("michaelis_menten", "jax") == GOLDEN.read_text(encoding="utf-8")


@pytest.mark.parametrize("name", sampled(NAMES, always=FEW))
def test_every_scene_computes_the_same_in_jax(name: str) -> None:
    library = jax()
    points, *_ = expected(name)
    names = run_python(text_of(name, "jax"))
    check(name, names["rates"](0.0, points.T).T, names["slow_manifold"](points.T).T)
    mapped = library.jit(library.vmap(lambda point: names["rates"](0.0, point)))(points)
    check(name, mapped, names["slow_manifold"](points.T).T)


def test_jax_differentiates_the_text() -> None:
    library = jax()
    names = run_python(text_of("michaelis_menten", "jax"))
    slope = library.jacfwd(lambda point: names["rates"](0.0, point))(np.array([0.5]))
    ahead, behind = (float(names["rates"](0.0, np.array([0.5 + h]))[0]) for h in (1e-5, -1e-5))
    assert float(slope[0, 0]) == pytest.approx((ahead - behind) / 2e-5, rel=1e-8)


@pytest.mark.parametrize("name", sampled(NAMES, always=FEW))
def test_every_scene_computes_the_same_in_casadi(name: str) -> None:
    casadi = pytest.importorskip("casadi")
    points, rates, manifold = expected(name)
    names = run_python(text_of(name, "casadi"))
    slow = casadi.SX.sym("slow", points.shape[1])
    symbolic = casadi.Function("f", [slow], [names["rates"](0.0, slow), names["slow_manifold"](slow)])
    found = [symbolic(point) for point in points]
    check(name, [f.full()[:, 0] for f, _ in found], [g.full()[:, 0] for _, g in found])
    assert found[0][0].shape == (rates.shape[1], 1)
    assert found[0][1].shape == (manifold.shape[1], 1)


@pytest.mark.parametrize("kind", HARD)
def test_every_kind_of_expression_keeps_its_value_in_casadi_and_jax(kind: str) -> None:
    casadi = pytest.importorskip("casadi")
    expression, names = HARD[kind], {x: "x", y: "y", k: "k"}
    points = np.random.default_rng(3).uniform(-2, 2, (8, 3))
    wanted = [float(expression.evalf(40, subs=dict(zip((x, y, k), map(sp.Float, p))))) for p in points]
    arguments = [casadi.SX.sym(name) for name in "xyk"]
    text = Printer(CASADI, names).text(expression)
    function = casadi.Function("f", arguments, [eval(text, {"ca": casadi, **dict(zip("xyk", arguments))})])
    np.testing.assert_allclose([float(function(*p)) for p in points], wanted, rtol=1e-13)
    jnp = jax().numpy
    text = Printer(JAX, names).text(expression)
    values = [eval(text, {"jnp": jnp, **dict(zip("xyk", map(jnp.float64, p)))}) for p in points]
    np.testing.assert_allclose(values, wanted, rtol=1e-13)


# What libSBML's own tree of an expression means, by its functions.
MEANING = {
    libsbml.AST_PLUS: lambda *a: math.fsum(a),
    libsbml.AST_TIMES: lambda *a: math.prod(a),
    libsbml.AST_MINUS: lambda *a: -a[0] if len(a) == 1 else a[0] - a[1],
    libsbml.AST_DIVIDE: lambda a, b: a / b,
    libsbml.AST_POWER: lambda a, b: a**b,
    libsbml.AST_FUNCTION_POWER: lambda a, b: a**b,
    libsbml.AST_FUNCTION_ROOT: lambda *a: a[-1] ** (1 / (a[0] if len(a) == 2 else 2)),
    libsbml.AST_FUNCTION_EXP: math.exp,
    libsbml.AST_FUNCTION_LN: math.log,
    libsbml.AST_FUNCTION_ABS: abs,
    libsbml.AST_FUNCTION_SIN: math.sin,
    libsbml.AST_FUNCTION_COS: math.cos,
    libsbml.AST_FUNCTION_TAN: math.tan,
    libsbml.AST_FUNCTION_SINH: math.sinh,
    libsbml.AST_FUNCTION_COSH: math.cosh,
    libsbml.AST_FUNCTION_TANH: math.tanh,
    libsbml.AST_FUNCTION_ARCSIN: math.asin,
    libsbml.AST_FUNCTION_ARCCOS: math.acos,
    libsbml.AST_FUNCTION_ARCTAN: math.atan,
    libsbml.AST_FUNCTION_ARCTANH: math.atanh,
    libsbml.AST_RELATIONAL_LT: operator.lt,
    libsbml.AST_RELATIONAL_GT: operator.gt,
    libsbml.AST_RELATIONAL_LEQ: operator.le,
    libsbml.AST_RELATIONAL_GEQ: operator.ge,
    libsbml.AST_LOGICAL_AND: lambda *a: all(a),
    libsbml.AST_FUNCTION_PIECEWISE: lambda *a: next((v for v, c in zip(a[::2], a[1::2]) if c), a[-1]),
}


def value_of(node: object, names: dict[str, float]) -> float:
    if node.isName():
        return names[node.getName()]
    if node.isNumber():
        return node.getValue()
    children = [value_of(node.getChild(i), names) for i in range(node.getNumChildren())]
    return MEANING[node.getType()](*children)


def sbml_model(text: str) -> object:
    document = libsbml.readSBMLFromString(text)
    document.checkConsistency()
    errors = [document.getError(i) for i in range(document.getNumErrors())]
    assert [e.getMessage() for e in errors if e.getSeverity() >= libsbml.LIBSBML_SEV_ERROR] == []
    return document


def run_sbml(text: str, points: np.ndarray, counts: tuple[int, int]) -> tuple[list, list]:
    """Rates and slow manifold by libSBML's trees, rules worked out in the order of the file."""
    document = sbml_model(text)
    model = document.getModel()
    rules = [model.getRule(i) for i in range(model.getNumRules())]
    slow = [rule.getVariable() for rule in rules if rule.isRate()]
    fast = [rule.getVariable() for rule in rules if rule.isAssignment()][-counts[1] :]
    assert len(slow) == counts[0]
    given = {p.getId(): p.getValue() for p in model.getListOfParameters() if p.getConstant()}
    rates, manifold = [], []
    for point in points:
        names = {**given, **dict(zip(slow, point))}
        for rule in rules:
            if rule.isAssignment():
                names[rule.getVariable()] = value_of(rule.getMath(), names)
        rates.append([value_of(rule.getMath(), names) for rule in rules if rule.isRate()])
        manifold.append([names[name] for name in fast])
    return rates, manifold


@pytest.mark.parametrize("name", sampled(NAMES, always=FEW))
def test_every_scene_computes_the_same_in_sbml(name: str) -> None:
    points, rates, manifold = expected(name)
    check(name, *run_sbml(text_of(name, "sbml"), points, (rates.shape[1], manifold.shape[1])))


def test_sbml_starts_where_the_scene_does_and_names_every_quantity() -> None:
    document = sbml_model(text_of("michaelis_menten", "sbml"))
    found = {p.getId(): p for p in document.getModel().getListOfParameters()}
    scene = study("michaelis_menten").scene
    assert found["s"].getValue() == scene.start["s"]
    assert found["epsilon"].getValue() == scene.epsilon
    assert found["lambda"].getConstant()
    assert not found["c"].getConstant()


@pytest.mark.parametrize("kind", HARD)
def test_every_kind_of_expression_keeps_its_value_in_sbml(kind: str) -> None:
    expression = HARD[kind]
    text = MathPrinter(SBML, {x: "x", y: "y", k: "k"}).text(expression)
    tree = libsbml.readMathMLFromString(f'<math xmlns="http://www.w3.org/1998/Math/MathML">{text}</math>')
    for point in np.random.default_rng(3).uniform(-2, 2, (8, 3)):
        wanted = float(expression.evalf(40, subs=dict(zip((x, y, k), map(sp.Float, point)))))
        assert value_of(tree, dict(zip("xyk", point.tolist()))) == pytest.approx(wanted, rel=1e-12)


def test_numbers_of_any_size_pass_through_sbml() -> None:
    for number in (
        sp.Integer(2) ** 40,
        *(sign * (sp.Integer(2) ** 31 + k) for k in (-1, 0, 1) for sign in (1, -1)),
        sp.Rational(2**31 - 1, 2**31),
        sp.Rational(2**32 + 1, 7),
        sp.Rational(1, 3**60),
        sp.Float("1.5e-300"),
        sp.Integer(-7),
        sp.Rational(-2, 3),
    ):
        text = MathPrinter(SBML, {}).text(number)
        tree = libsbml.readMathMLFromString(f'<math xmlns="http://www.w3.org/1998/Math/MathML">{text}</math>')
        assert value_of(tree, {}) == pytest.approx(float(number), rel=4e-16, abs=0)


def test_what_sbml_lacks_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedFunctionError, match="erf has no counterpart in SBML"):
        MathPrinter(SBML, {x: "x"}).text(sp.erf(x))


def test_signs_and_steps_at_zero_are_those_of_the_other_texts_in_sbml() -> None:
    for expression, wanted in ((sp.sign(x), [-1, 0, 1]), (sp.Heaviside(x), [0, 0.5, 1])):
        text = MathPrinter(SBML, {x: "x"}).text(expression)
        tree = libsbml.readMathMLFromString(f'<math xmlns="http://www.w3.org/1998/Math/MathML">{text}</math>')
        assert [value_of(tree, {"x": at}) for at in (-2.0, 0.0, 3.0)] == wanted


def test_hostile_names_and_texts_make_a_model_of_sbml_and_of_casadi() -> None:
    made = gsp.study(hostile())
    flow, places = made.reduced(1), np.array([[0.3], [1.7]])
    wanted = made.series(1).evaluate(places, 0.01)
    _, manifold = run_sbml(gsp.export(made, order=1, to="sbml"), places, (1, 1))
    np.testing.assert_allclose(manifold, wanted, rtol=1e-13)
    casadi = pytest.importorskip("casadi")
    names = run_python(gsp.export(made, order=1, to="casadi"))
    found = [float(names["slow_manifold"](casadi.DM(place))) for place in places]
    np.testing.assert_allclose(found, wanted[:, 0], rtol=1e-13)
    assert len(flow.states) == 1


# -- implicit branches -------------------------------------------------------------------------------


def two_fast_variables(a: float) -> gsp.Scene:
    """No equation gives s or u as a polynomial, so that the state holds u of the point of M0 beside s."""
    u, v, s, p, eps = sp.symbols("u v s a epsilon")
    system = gsp.SlowFastSystem(
        slow={s: -u * v}, fast={u: s * (1 + u**2) - u - sp.exp(u - 1) + v / 4, v: p * u - v - sp.sinh(v)},
        epsilon=eps, parameters={p: sp.Rational(str(a))},
    )  # fmt: skip
    return gsp.Scene(
        system, {"s": (0.2, 0.6)}, {"s": 0.5, "u": 0.3, "v": 0.15}, (0, 1), 0.01, (0.02, 0.01), 1e-6
    )


@pytest.mark.exhaustive
def test_the_states_of_an_implicit_branch_are_said_with_what_holds_between_them() -> None:
    comment = " ".join(re.findall(r"(?m)^# (.*)$", text_of("van_der_pol", "python")))
    assert "x0 is x of the point of the critical manifold over y." in comment
    assert "lie on the critical manifold" not in comment
    text = gsp.export(two_fast_variables(1), order=1, to="python")
    comment = " ".join(re.findall(r"(?m)^# (.*)$", text))
    assert "u0 is u of the point of the critical manifold over s." in comment
    (said,) = re.findall(
        r"The states lie on the critical manifold, and so does a start: (.*?)\.(?: |$)", comment
    )
    names = run_python(text)
    at = dict(zip(sp.symbols("s u0 a"), [*names["start"], 1.0]))
    for equation in said.split("; "):
        left, right = equation.split(" = ")
        read = parse_expression(right, symbols={s.name: s for s in at})
        assert left == "0"
        assert abs(float(read.xreplace(at))) < 1e-12


def test_an_equation_that_gives_a_variable_over_a_sum_of_parameters_is_nothing_that_holds_between_states() -> (
    None
):
    """(a + b) (s - u) = a sin u gives s, and put into itself it is 0 over a + b, whatever u is."""
    u, s, a, b, eps = sp.symbols("u s a b epsilon")
    system = gsp.SlowFastSystem(
        slow={s: -u}, fast={u: (a + b) * (s - u) - a * sp.sin(u)}, epsilon=eps, parameters={a: 1, b: 2}
    )
    scene = gsp.Scene(system, {"s": (0.2, 0.6)}, {"s": 0.5, "u": 0.3}, (0, 1), 0.01)
    text = gsp.export(scene, order=1, to="python")
    assert "u0 is u of the point of the critical manifold over s." in text
    assert "lie on the critical manifold" not in text


def test_an_implicit_branch_moves_with_its_parameters() -> None:
    # SymPy's `cse` takes the terms of a sum for factors where a product holds it and 1 alone; none such is written.
    names = run_python(gsp.export(two_fast_variables(1), order=1, to="python"))
    flow = gsp.study(two_fast_variables(1.5)).reduced(1)
    start = flow.initial({"s": 0.4})
    run = gsp.integrate(flow, span=(0, 1), start={"s": 0.4}, epsilon=0.02, rtol=1e-11, atol=1e-13)
    own = solve_ivp(names["rates"], (0, 1), start, args=(0.02, 1.5), method="DOP853", rtol=1e-11, atol=1e-13)
    assert [s.name for s in flow.states] == ["s", "u0"]
    np.testing.assert_allclose(own.y[:, -1], run.y[:, -1], rtol=1e-9)
    manifold = names["slow_manifold"](own.y[:, -1], 0.02, a=1.5)
    np.testing.assert_allclose(manifold, [run[name][-1] for name in ("u", "v")], rtol=1e-9)


@pytest.mark.parametrize("name", ["van_der_pol", "koper", "fitzhugh_nagumo"])
def test_an_exported_implicit_branch_runs_from_its_start_as_the_package_does(name: str) -> None:
    made, names = study(name), run_python(text_of(name, "python"))
    slow = [s.name for s in made.system.x]
    run = gsp.integrate(
        made.reduced(ORDER, reconstructed=False), span=made.scene.span, start={s: made.start[s] for s in slow},
        epsilon=made.scene.epsilon, rtol=1e-11, atol=1e-13,
    )  # fmt: skip
    own = solve_ivp(names["rates"], (0, run.t[-1]), names["start"], method="DOP853", rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(own.y[:, -1], run.y[:, -1], rtol=1e-8)


def test_an_implicit_branch_without_a_sheet_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    made = gsp.study(models.load("van_der_pol"))
    bare = gsp.Branch(made.branch.system, made.branch.equations, None)
    monkeypatch.setattr(type(made), "branch", property(lambda self: bare))
    with pytest.raises(BranchError, match="no sheet of it is chosen"):
        gsp.export(made, order=1, to="c")


# -- XPPAUT ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", sampled(NAMES, always=FEW))
def test_every_scene_computes_the_same_in_xppaut(name: str) -> None:
    points, rates, manifold = expected(name)
    text = text_of(name, "ode")
    slow = re.findall(r"(?m)^init (\w+)=", text)
    body = dict(re.findall(r"(?m)^(\w+)'=(.*)$", text))
    expressions = [*(body[s] for s in slow), *re.findall(r"(?m)^aux \w+=(.*)$", text)]
    wanted = np.hstack([rates, manifold])
    found = []
    for point, row in zip(points[:4].tolist(), wanted):
        there = text
        for s, value in zip(slow, point):
            there = re.sub(rf"(?m)^init {s}=.*$", f"init {s}={value!r}", there)
        found.append(xppaut.values(there, expressions, np.abs(row).tolist()))
    size = np.abs(wanted).max(axis=0)
    assert (np.abs(np.array(found) - wanted[:4]) <= 1e-12 * np.maximum(np.abs(wanted[:4]), size)).all()


@pytest.mark.parametrize(
    ("rate", "height", "end"), [(1.0, 1.0, 0.001), (0.001, 1.0, 5000.0), (1.0, 1e6, 1.0), (3e3, 1.0, 1.0)]
)
def test_xppaut_runs_the_whole_span_whatever_its_length_the_size_of_values_and_the_rates(
    rate: float, height: float, end: float
) -> None:
    system = gsp.SlowFastSystem(
        slow={x: -k * (x - sp.cos(x))},
        fast={y: height * x - y},
        epsilon=sp.Symbol("epsilon"),
        parameters={k: rate},
    )
    scene = gsp.Scene(system, {"x": (0, 1)}, start={"x": 0.5, "y": height}, span=(0, end), epsilon=1e-3)
    rows, _ = xppaut.run(gsp.export(scene, order=0, to="ode"))
    run = solve_ivp(
        lambda _, state: -rate * (state - np.cos(state)), (0, end), [0.5], method="LSODA", rtol=1e-10
    )
    assert rows[-1] == pytest.approx([end, run.y[0, -1], height * run.y[0, -1]], rel=1e-5)
