"""Three time scales: nested critical manifolds, double series, measured powers of both small parameters."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

import gsp
from gsp.algebra import ring
from gsp.cli import cli
from gsp.comparison.nested import compare_each
from gsp.errors import BudgetError, DeclarationError, DegenerateError, SplittingError, Status
from gsp.nested.nesting import Nesting

z, y, x, w, m, c = sp.symbols("z y x w m c")
epsilon, delta, k, q = sp.symbols("epsilon delta k q")

MODEL = """
epsilon = ["epsilon", "delta"]
[parameters]
delta = 0.01
[states]
z = "-z*(1 + x)"
y = "(z - y + x^2/4)/delta"
x = "(y - x)/(epsilon*delta)"
[region]
z = [0.05, 0.6]
y = [0, 1]
[start]
z = 0.5
y = 0.6
x = 0.6
[scene]
span = [0, 1]
epsilon = 0.05
"""


def scene(rates: dict, *, small: float = 0.05, parameters: dict | None = None, **others) -> gsp.Scene:
    """A scene in epsilon, delta = 1/50, from 1/2 in every state, in the unit box."""
    values = {delta: sp.Rational(1, 50), **(parameters or {})}
    field = gsp.VectorField(rates, epsilon=epsilon, parameters=values)
    states = [s.name for s in rates]
    given = {"region": dict.fromkeys(states, (0.1, 1.0)), "start": dict.fromkeys(states, 0.5), "span": (0, 1)}
    return gsp.Scene(field, **{**given, **others}, epsilon=small)


def published() -> gsp.Scene:
    # C2 folds at z = 1.
    region = {"z": (0.1, 0.7), "y": (0.1, 1)}
    return scene(
        {z: -z * (1 + x), y: (z - y + x**2 / 4) / delta, x: (y - x) / (epsilon * delta)}, region=region
    )


def cascade() -> gsp.Scene:
    """A substrate, the messenger that it makes, and the complex that takes the messenger up."""
    return scene(
        {z: -k * z + m / 4, m: (z - m * (1 + c)) / delta, c: (m - c * (1 + m)) / (epsilon * delta)},
        parameters={k: 1},
    )


def plane() -> gsp.Scene:
    """Two variables on the middle scale."""
    return scene(
        {
            z: -z + w,
            y: (z - 2 * y + x * w) / delta,
            w: (y - w) / delta,
            x: (y - 3 * x + z) / (epsilon * delta),
        }
    )


def cubic() -> gsp.Scene:
    """C1 is no graph that could be written down, and neither is C2."""
    return scene({z: -z - x, y: (z - 2 * y - x) / delta, x: (y - x - x**3) / (epsilon * delta)})


def agree(found: sp.Expr, wanted: sp.Expr, places: dict[sp.Symbol, sp.Rational]) -> bool:
    """Whether two algebraic expressions have one value, to 40 digits, at a rational place."""
    return bool(abs(sp.N((found - wanted).subs(places), 50)) < sp.Float("1e-40"))


PLACE = {z: sp.Rational(3, 7), k: sp.Rational(5, 4)}


@pytest.mark.exhaustive
def test_the_published_system_has_the_exact_coefficients_of_its_double_series() -> None:
    found = gsp.nest(published(), small=["epsilon", "delta"])
    root = sp.sqrt(1 - z)
    assert str(found.first.branch) == "x = y"
    assert agree(found.manifold[0, 0][y], 2 - 2 * root, PLACE)
    # The double series put into delta Y' z' = g and epsilon delta X' z' = h by hand.
    series = {(0, 0): (2 - 2 * root, 2 - 2 * root)}
    one, other = sp.symbols("one other")
    for i, j in ((1, 0), (0, 1), (1, 1), (0, 2), (2, 0)):
        both = {**series, (i, j): (one, other)}
        Y, X = (sum(pair[n] * epsilon**a * delta**b for (a, b), pair in both.items()) for n in (0, 1))
        rate = -z * (1 + X)
        defects = (
            delta * sp.diff(Y, z) * rate - (z - Y + X**2 / 4),
            epsilon * delta * sp.diff(X, z) * rate - (Y - X),
        )
        terms = [sp.expand(defect).coeff(epsilon, i).coeff(delta, j) for defect in defects]
        (solution,) = sp.solve(terms, [one, other], dict=True)
        series[i, j] = (solution[one], solution[other])
    for powers, pair in series.items():
        row = found.manifold.get(powers, {})
        for symbol, wanted in zip((y, x), pair):
            assert agree(row.get(symbol, sp.Integer(0)), wanted, PLACE), (powers, symbol)
    assert set(found.manifold) == {(0, 0), (0, 1), (0, 2), (1, 1)}
    assert agree(found.reduced_field[1, 1][z], -z * series[1, 1][1], PLACE)


@pytest.mark.exhaustive
@pytest.mark.parametrize("make", [published, cascade, plane])
def test_the_slopes_are_one_and_two_in_each_small_parameter_and_in_both(make) -> None:
    found = gsp.nest(make(), small=["epsilon", "delta"])
    for comparison in (
        gsp.compare(found),
        *(gsp.compare(each, orders=(0, 1)) for each in found.alone.values()),
    ):
        assert comparison.slopes == pytest.approx({0: 1, 1: 2}, abs=0.15)
        assert comparison.expected == {0: 1, 1: 2}
    assert found.first.hyperbolicity.holds
    assert found.second.hyperbolicity.holds


@pytest.mark.exhaustive
@pytest.mark.parametrize("make", [cascade, plane])
def test_the_double_series_is_that_in_delta_alone_expanded_in_epsilon(make) -> None:
    found = gsp.nest(make(), small=["epsilon", "delta"])
    alone = found.alone["delta"].series(2)
    # Where that branch is implicit its fast symbols stand for the point of C2.
    at_c2 = {s: sp.N(e.subs(PLACE), 60) for s, e in found.manifold[0, 0].items()}
    count = 0
    for j in range(3):
        for symbol, coefficient in alone.coefficients[j].as_dict().items():
            # A polynomial in epsilon of degree j at most, by its values at 0, 1 and 2.
            v = [sp.N(coefficient.subs({**PLACE, **at_c2, epsilon: e}), 60) for e in range(3)]
            for i, wanted in enumerate(
                [v[0], (4 * v[1] - 3 * v[0] - v[2]) / 2, (v[0] - 2 * v[1] + v[2]) / 2][: 3 - j]
            ):
                given = found.manifold.get((i, j), {}).get(symbol, sp.Integer(0))
                assert agree(given, wanted, PLACE), (symbol, i, j)
                count += not agree(wanted, sp.Integer(0), PLACE)
    assert count >= 8


def test_a_linear_chain_has_the_series_of_its_slow_eigenvector() -> None:
    """Y = z/(1 - delta), X = Y/(1 - epsilon delta) in closed form."""
    chain = scene({z: -z, y: (z - y) / delta, x: (y - x) / (epsilon * delta)})
    found = gsp.nest(chain, small=["epsilon", "delta"], order=5)
    assert {powers: row[y] for powers, row in found.manifold.items() if y in row} == {
        (0, j): z for j in range(6)
    }
    fast = {powers: row[x] for powers, row in found.manifold.items()}
    assert fast == {(i, j): z for i in range(6) for j in range(i, 6 - i)}
    assert dict(found.reduced_field) == {(0, 0): {z: -z}}
    # The flow is exact, which is told, and no slope is made of rounding.
    comparison = gsp.compare(gsp.nest(chain, small=["epsilon", "delta"]))
    assert comparison.is_exact(0)


@pytest.mark.parametrize("function", [sp.exp, sp.sqrt, sp.Abs, lambda u: 1 / (1 + u)])
def test_functions_of_the_fastest_variable_are_watched_on_its_manifold(function) -> None:
    """X = z/((1 - delta)(1 - epsilon delta)) in closed form."""
    seen = sp.Symbol("seen")
    chain = scene({z: -z, y: (z - y) / delta, x: (y - x) / (epsilon * delta)})
    old = chain.system
    field = gsp.VectorField(
        dict(zip(old.states, old.rates)),
        epsilon=epsilon,
        parameters=old.parameters,
        observables={seen: function(x)},
    )
    found = gsp.nest(replace(chain, system=field), small=["epsilon", "delta"], order=3)
    system = found.second.system
    values = {**system.parameters, z: 0.5, y: found.second.series(3).evaluate(0.5, 1.0)[0], system.epsilon: 1}
    exact = function(0.5 / ((1 - values[delta]) * (1 - values[epsilon] * values[delta])))
    told = system.observables[seen].xreplace(dict(system.observables)).subs(values)
    # Of the series through order 3 terms of the order 4 are missing, those of x three.
    left_out = 3 * sum(values[epsilon] ** i * values[delta] ** (4 - i) for i in range(3))
    assert abs(float(told - exact)) < float(left_out)


def test_implicit_manifolds_are_nested_too() -> None:
    found = gsp.nest(cubic(), small=["epsilon", "delta"])
    (x0,) = found.second.system.y
    assert not found.second.branch.is_explicit
    # On C1 y = x + x^3; the leading correction by hand: delta x0' (1 + 3 x0^2) = z - 2 y - x there.
    rate = found.reduced_field[0, 0][z]
    slope = 1 / (3 + 6 * x0**2)
    right = slope * rate * (1 + 3 * x0**2) / (-3 - 6 * x0**2)
    assert sp.cancel(found.manifold[0, 1][x0] - right) == 0
    assert gsp.compare(found).slopes == pytest.approx({0: 1, 1: 2}, abs=0.1)
    assert f"{x0} is x on C1" in found.explain()
    # On the left of a row is the slow manifold, on the right the point of C2 under it.
    assert f"{x0} on the right of what follows is of the point of C2 over z, on the left" in found.explain()


def test_what_vanishes_on_an_implicit_inner_manifold_is_no_term() -> None:
    """x moves with y alone, which stands still on C2: there is no epsilon and no epsilon^2 without delta."""
    rates = {z: x - z, y: (z - y - y * x / 4) / delta, x: (y**2 - x + z) / (epsilon * delta)}
    found = gsp.nest(scene(rates, region={"z": (0.2, 3), "y": (0, 3), "x": (0, 4)}), small=["epsilon", "delta"])
    assert not found.second.branch.is_explicit
    assert set(found.manifold) == set(found.reduced_field) == {(0, 0), (0, 1), (0, 2), (1, 1)}


@pytest.mark.exhaustive
def test_time_may_be_that_of_any_scale() -> None:
    """epsilon x' with delta z', and the fastest time, in which neither divides, have the series of the slow time."""
    f, g, h = -z + y / 2, z - 2 * y + x, y - 3 * x + z
    slow = gsp.nest(scene({z: f, y: g / delta, x: h / (epsilon * delta)}), small=["epsilon", "delta"])
    middle = scene({z: delta * f, y: g, x: h / epsilon}, span=(0, 50))
    fast = scene({z: epsilon * delta * f, y: epsilon * g, x: h}, span=(0, 50))
    for other in (middle, fast):
        found = gsp.nest(other, small=["epsilon", "delta"])
        assert found.in_fast_time
        assert found.manifold == slow.manifold
        assert found.reduced_field == slow.reduced_field
        assert gsp.compare(found).slopes == pytest.approx({0: 1, 1: 2}, abs=0.1)


@pytest.mark.exhaustive
def test_two_rates_that_each_have_their_own_small_parameter() -> None:
    """epsilon x' and delta y': nested where epsilon is small beside delta, with epsilon/delta for a power."""
    f, g, h = -z + y / 2, z - 2 * y + x, y - 3 * x + z
    both = scene({z: f, y: g / delta, x: h / epsilon}, small=0.0005)
    found = gsp.nest(both, small=["epsilon", "delta"])
    assert found.weight == 2
    standard = gsp.nest(scene({z: f, y: g / delta, x: h / (epsilon * delta)}), small=["epsilon", "delta"])
    # What was epsilon delta is epsilon.
    assert {(i, j + i): row for (i, j), row in found.manifold.items()} == dict(standard.manifold)
    for comparison in (
        gsp.compare(found),
        *(gsp.compare(each, orders=(0, 1)) for each in found.alone.values()),
    ):
        assert comparison.slopes == pytest.approx({0: 1, 1: 2}, abs=0.1)
    # It is so too where nothing feeds back into the rate of y.
    alone = scene({z: f + x, y: (z - 2 * y) / delta, x: h / epsilon}, small=0.0005)
    assert gsp.nest(alone, small=["epsilon", "delta"]).weight == 2
    with pytest.raises(
        SplittingError, match=r"delta = 0.02 is not small beside epsilon = 0.0005.*Name epsilon first"
    ):
        gsp.nest(both, small=["delta", "epsilon"])


def test_one_parameter_with_poles_of_two_orders_makes_three_time_scales() -> None:
    f, g, h = -z + y / 2, z - 2 * y + x, y - 3 * x + z
    rates = {z: f, y: g / epsilon, x: h / epsilon**2}
    field = gsp.VectorField(rates, epsilon=epsilon)
    with pytest.raises(SplittingError, match=r'pole of order 2.*nest\(scene, small=\["epsilon", "epsilon"\]\)'):
        gsp.split(field)
    box = dict.fromkeys("zyx", (0.1, 1.0))
    asked = gsp.Scene(field, box, dict.fromkeys("zyx", 0.5), (0, 1), 0.02)
    found = gsp.nest(asked, small=["epsilon", "epsilon"])
    standard = gsp.nest(scene({z: f, y: g / delta, x: h / (epsilon * delta)}), small=["epsilon", "delta"])
    assert found.manifold == standard.manifold
    assert gsp.compare(found).slopes == pytest.approx({0: 1, 1: 2}, abs=0.1)
    simple = gsp.VectorField({z: f, y: g / epsilon}, epsilon=epsilon, parameters={x: 1})
    plain = gsp.Scene(simple, {"z": (0, 1)}, {"z": 0.5, "y": 0.5}, (0, 1), 0.1)
    with pytest.raises(SplittingError, match="no rate has a pole of order two"):
        gsp.nest(plain, small=["epsilon", "epsilon"])


def test_the_wrong_order_is_refused_by_name() -> None:
    with pytest.raises(SplittingError, match=r"nested the other way round. Name epsilon first"):
        gsp.nest(published(), small=["delta", "epsilon"])


@pytest.mark.parametrize(
    ("rates", "words"),
    [
        (
            {z: -z + y, y: (x - y) / delta, x: (y - x) / (epsilon * delta)},
            "no rate carries 1/delta any more on x = y",
        ),
        (
            {z: -z + y, y: (x - y + (z - y) ** 2) / delta, x: (y - x) / (epsilon * delta)},
            "vanishes to second order",
        ),
        (
            {z: -z + y, y: (w - z) / delta, w: (x - w) / delta, x: (w - x) / (epsilon * delta)},
            "nilpotent",
        ),
        (
            {
                z: -z + y,
                y: (x - y) / delta,
                w: (z - 2 * w) / delta,
                x: (y - x + epsilon * z) / (epsilon * delta),
            },
            "the rate of y carries epsilon/delta",
        ),
    ],
)
def test_a_degenerate_leading_reduction_is_refused_as_a_hidden_time_scale(rates: dict, words: str) -> None:
    with pytest.raises(DegenerateError, match="a time scale is hidden") as refused:
        gsp.nest(scene(rates), small=["epsilon", "delta"])
    assert words in str(refused.value)


def test_a_special_value_on_a_special_value_is_a_third_time_scale() -> None:
    field = gsp.VectorField(
        {z: -k * z, y: q * (2 * z - y), x: y - x}, parameters={k: sp.Rational(1, 100), q: sp.Rational(1, 10)}
    )
    (outer,) = [each for each in gsp.small_parameters(field, dimensions=[2]) if each.vanishing == ("k", "q")]
    (inner,) = [each for each in gsp.small_parameters(outer) if each.vanishing == ("k",)]
    assert [e.lhs for e in outer.manifold] == [y - x]
    # The layer of the outer one moves x alone, so that y is a coordinate on it.
    assert [sp.expand(e.lhs) for e in inner.manifold] == [2 * z - y]
    asked = gsp.Scene(field, {"z": (0.1, 1), "y": (0.1, 2)}, {"z": 1, "y": 1, "x": 1}, (0, 20))
    found = gsp.nest(asked, small=[outer.vanishing, inner.vanishing])
    # Y = 2 q z/(q - delta k), at the values of k and q where delta is 1; X = Y/(1 - epsilon delta k).
    assert found.manifold[0, 1] == {y: 2 * k * z / q, x: 2 * k * z / q}
    assert found.manifold[1, 1] == {x: 2 * k * z}
    slow = [each for each in gsp.small_parameters(field) if each.graph is None]
    for each in slow:
        with pytest.raises(DeclarationError, match="implicit manifold"):
            gsp.small_parameters(each)


def test_a_series_beyond_the_budget_names_a_lower_order_and_not_the_values_of_the_parameters(
    monkeypatch,
) -> None:
    """The remedy was `--values`, which `gsp nest` does not take."""
    found = gsp.nest(cascade(), small=["epsilon", "delta"], order=3)
    monkeypatch.setattr(ring, "BUDGET", 300)
    with pytest.raises(BudgetError, match="Take a lower order") as refused:
        print(found.series)
    assert "--values" not in str(refused.value)


@pytest.mark.parametrize(
    ("small", "words"),
    [
        (None, "does not say which two"),
        (["epsilon"], "small are two names.*Got epsilon\\.$"),
        ([["k", "q"], ["k", "q"]], "small are two names"),
        (["epsilon", "nu"], "small names nu, and no parameter has this name"),
        (["epsilon", ["delta", "nu"]], "small names 'nu', and no parameter has this name"),
        ([[], "delta"], "small are two names"),
        ([["epsilon", "epsilon"], "delta"], "epsilon is named twice.*Got epsilon\\+epsilon"),
    ],
)
def test_names_are_checked(small, words: str) -> None:
    with pytest.raises(DeclarationError, match=words):
        gsp.nest(published(), small=small)


def test_a_second_small_parameter_is_a_positive_power() -> None:
    inside = scene({z: -z * sp.exp(delta * x), y: (z - y) / delta, x: (y - x) / (epsilon * delta)})
    with pytest.raises(DeclarationError, match=r"exp\(delta\*x\)"):
        gsp.nest(inside, small=["epsilon", "delta"])
    with pytest.raises(DeclarationError, match="delta = 0 cannot be"):
        gsp.nest(
            scene({z: -z, y: z - y + delta, x: (y - x) / epsilon}, parameters={delta: 0}),
            small=["epsilon", "delta"],
        )


def test_only_orders_below_that_of_the_series_are_compared() -> None:
    found = gsp.nest(published(), small=["epsilon", "delta"], order=1)
    assert list(gsp.compare(found).errors) == [0]
    with pytest.raises(DeclarationError, match="known through order 1"):
        gsp.compare(found, orders=(1,))
    with pytest.raises(DeclarationError, match="Leave the correction out"):
        gsp.compare(found, correction=1)


def test_a_step_of_the_ladder_whose_start_leaves_the_domain_has_no_error_and_says_so() -> None:
    """C1 is x = sqrt(1 - y), and over z = 0.7 the point of C2 is y = 0.7 (1 + 5 delta + ...), beyond 1 at 1/10."""
    field = gsp.VectorField(
        {z: -5 * z, y: (z - y) / delta, x: (sp.sqrt(1 - y) - x) / (epsilon * delta)},
        epsilon=epsilon,
        parameters={delta: 0.05},
    )
    start = {"z": 0.7, "y": 0.7, "x": 0.5}
    found = gsp.nest(
        gsp.Scene(field, {"z": (0, 1), "y": (0, 1)}, start, (0, 1), 0.05), small=["epsilon", "delta"]
    )
    measured = compare_each(found, orders=(0, 1))["epsilon and delta"]
    assert measured.epsilons == (2, 1, 0.5, 0.25)
    assert [np.isnan(error) for error in measured.errors[1]] == [True, False, False, False]
    assert measured.statuses[1][0] is Status.SERIES_ENDS
    assert "nan of order 0, 1 at 2:" in str(measured)


def test_a_model_file_names_both_and_is_written_back(tmp_path: Path) -> None:
    file = tmp_path / "three.toml"
    file.write_text(MODEL)
    read = gsp.load(file)
    assert (str(read.system.epsilon), read.second) == ("epsilon", "delta")
    assert isinstance(gsp.nest(read), Nesting)
    gsp.save(read, tmp_path / "again.toml")
    assert gsp.load(tmp_path / "again.toml").second == "delta"
    # Another small parameter is another question.
    assert gsp.take_small(read, parameter="delta").second == ""
    for wrong in ('epsilon = ["epsilon"]', 'epsilon = ["epsilon", "nu"]', 'epsilon = ["delta", "delta"]'):
        file.write_text(MODEL.replace('epsilon = ["epsilon", "delta"]', wrong))
        with pytest.raises(gsp.GspError, match=r"two, that of the fastest|second is 'nu'|delta twice"):
            gsp.load(file)


@pytest.mark.exhaustive
def test_split_and_compare_take_two_small_parameters(tmp_path: Path) -> None:
    named, plain = tmp_path / "named.toml", tmp_path / "plain.toml"
    named.write_text(MODEL)
    plain.write_text(MODEL.replace('epsilon = ["epsilon", "delta"]', 'epsilon = "epsilon"'))

    def told(*arguments: str) -> str:
        done = CliRunner().invoke(cli, list(arguments), catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return done.stdout

    for asked in ([str(named)], [str(plain), "--small", "epsilon,delta"]):
        assert "Three time scales, of epsilon and delta: x the fastest, then y, then z." in told(
            "split", *asked
        )
        assert json.loads(told("split", *asked, "--json"))["nested"]["C1"] == "x = y"
        slopes = json.loads(told("compare", *asked, "--json"))["variables"]["slope"]["values"]
        assert [round(slope) for slope in slopes] == [1, 2]
    assert "Three time scales" not in told("split", str(plain))


@pytest.mark.exhaustive
def test_a_chart_draws_the_run_and_the_flow_on_the_inner_manifold() -> None:
    """Long after both layers they are one, and in the first neither has begun."""
    axes = gsp.nest(published(), small=["epsilon", "delta"]).plot()
    curves = [line.get_ydata() for line in axes.get_lines()]
    for full, reduced in zip(curves[0:6:2], curves[1:6:2]):
        assert full[-1] == pytest.approx(reduced[-1], abs=1e-4)
    assert curves[4][0] != pytest.approx(curves[5][0], abs=1e-2)
    assert len(axes.get_lines()) == 8


def test_the_command_tells_manifolds_series_and_slopes(tmp_path: Path) -> None:
    file = tmp_path / "three.toml"
    file.write_text(MODEL)

    def run(*arguments: str):
        return CliRunner().invoke(cli, ["nest", str(file), *arguments], catch_exceptions=False)

    text = run().stdout
    for words in (
        "Three time scales, of epsilon and delta: x the fastest, then y, then z.",
        "C1: x = y",
        "C2, within C1: y = 2*(1 - sqrt(1 - z))",
        "C1: attracting, gap 2000 in slow time",
        # 1 - x/2 at y = 0.225 over z = 0.6, the least: sqrt(1 - z)/delta.
        "C2: attracting, gap 63.2456 in slow time",
        "epsilon and delta: largest relative error",
    ):
        assert words in text
    found = json.loads(run("--json", "--order", "1").stdout)
    assert [row["powers"] for row in found["manifold"]] == [[0, 0], [0, 1]]
    assert found["kinds"] == {"C1": "attracting", "C2": "attracting"}
    assert list(found["comparisons"]) == ["epsilon and delta", "epsilon", "delta"]
    assert run("--small", "epsilon,delta", "--order", "0").exit_code == 0
    with pytest.raises(SplittingError, match="other way round"):
        run("--small", "delta,epsilon")
