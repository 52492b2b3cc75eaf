"""SBML: what is read says what SBML means, worked out by hand, and what is not is refused by name."""

from __future__ import annotations

import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import gsp
from gsp.cli import cli
from gsp.errors import GspError, ModelFileError
from gsp.readers import conservation
from gsp.readers.conservation import conserved
from gsp.readers.loading import import_model, load_noted
from gsp.readers.sbml import read_sbml

libsbml = pytest.importorskip("libsbml", reason="python-libsbml is not installed")

CORE = "http://www.sbml.org/sbml/level3/version{}/core"
MATH = "http://www.w3.org/1998/Math/MathML"


def math(formula: str) -> str:
    """MathML of a formula; what is MathML already stays."""
    if formula.startswith("<"):
        return f'<math xmlns="{MATH}">{formula}</math>'
    tree = libsbml.parseL3Formula(formula)
    assert tree is not None, libsbml.getLastParseL3Error()
    return libsbml.writeMathMLToString(tree).partition("?>")[2]


def species(name: str, start: str, *, place: str = "c", **given: str) -> str:
    flags = {"hasOnlySubstanceUnits": "false", "boundaryCondition": "false", "constant": "false", **given}
    rest = " ".join(f'{key}="{value}"' for key, value in flags.items())
    kind = "initialAmount" if start.endswith("a") else "initialConcentration"
    value = f'{kind}="{start.rstrip("a")}"' if start else ""
    return f'<species id="{name}" compartment="{place}" {value} {rest}/>'


def parameter(name: str, value: str = "", *, constant: str = "true") -> str:
    given = f'value="{value}"' if value else ""
    return f'<parameter id="{name}" {given} constant="{constant}"/>'


def changing(name: str, value: str = "1") -> str:
    return parameter(name, value, constant="false")


def reaction(
    name: str, left: str, right: str, law: str, *, fast: str = "", local: str = "", extra: str = ""
) -> str:
    """`left` and `right` are lists such as "2 A, B"."""

    def side(tag: str, text: str) -> str:
        inner = ""
        for piece in filter(None, (piece.strip() for piece in text.split(","))):
            number, _, word = piece.rpartition(" ")
            inner += (
                f'<speciesReference species="{word}" stoichiometry="{number or 1}" constant="true" {extra}/>'
            )
        return f"<{tag}>{inner}</{tag}>" if inner else ""

    given = f"<listOfLocalParameters>{local}</listOfLocalParameters>" if local else ""
    kinetic = f"<kineticLaw>{math(law)}{given}</kineticLaw>" if law else ""
    flag = f'fast="{fast}"' if fast else ""
    return (
        f'<reaction id="{name}" reversible="false" {flag}>{side("listOfReactants", left)}'
        f"{side('listOfProducts', right)}{kinetic}</reaction>"
    )


def rule(kind: str, name: str, formula: str) -> str:
    return f'<{kind}Rule variable="{name}">{math(formula)}</{kind}Rule>'


def document(version: int = 2, *, compartments: str = "", attributes: str = "", **lists: str) -> str:
    """An SBML text of level 3; `lists` are named as in SBML without listOf."""
    places = compartments or '<compartment id="c" size="2" spatialDimensions="3" constant="true"/>'
    order = (
        "functionDefinitions",
        "compartments",
        "species",
        "parameters",
        "initialAssignments",
        "rules",
        "reactions",
    )
    if version == 1:
        lists = {
            key: text.replace('reversible="false" >', 'reversible="false" fast="false">')
            for key, text in lists.items()
        }
    body = ""
    for name in (*order, "constraints", "events"):
        text = places if name == "compartments" else lists.get(name, "")
        if text:
            body += f"<listOf{name[0].upper()}{name[1:]}>{text}</listOf{name[0].upper()}{name[1:]}>"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<sbml xmlns="{CORE.format(version)}" level="3" version="{version}">'
        f'<model id="m" {attributes}>{body}</model></sbml>'
    )


def scene_of(folder: Path, text: str) -> gsp.Scene:
    path = folder / "model.xml"
    path.write_text(text)
    return gsp.load(path)


def rates(scene: gsp.Scene) -> dict[str, sp.Expr]:
    """Rates by name, the parameters' values put in."""
    system = scene.system
    return {
        z.name: sp.expand(rate.xreplace(dict(system.parameters)))
        for z, rate in zip(system.states, system.rates)
    }


ENZYME = document(
    species=species("S", "10") + species("E", "1") + species("C", "0") + species("P", "0"),
    parameters=parameter("k1", "0.1") + parameter("km", "3") + parameter("k2", "5") + parameter("eps", "0.01"),
    reactions=reaction("bind", "S, E", "C", "c*(k1*S*E - km*C)/eps") + reaction("make", "C", "P, E", "c*k2*C"),
)


def test_reactions_are_rates_and_what_they_conserve_is_written_out(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, ENZYME)
    S, C, eps = sp.symbols("S C eps")
    bound = (sp.Rational(1, 10) * S * (1 - C) - 3 * C) / eps
    assert rates(scene) == {"S": sp.expand(-bound), "C": sp.expand(bound - 5 * C)}
    assert dict(scene.start) == {"S": 10.0, "C": 0.0}
    values = dict(scene.system.parameters)
    watched = {symbol.name: rate.xreplace(values) for symbol, rate in scene.system.observables.items()}
    assert watched == {"E": 1 - C, "P": 10 - S - C}
    assert scene.epsilon == 0.01
    assert "conserved: E + C in amounts; E follows from the others" in scene.description


def test_what_is_small_does_not_follow_from_what_is_large(tmp_path: Path) -> None:
    """D is 0, and 1e9 - A rounds to 1e-7, ten thousand times the absolute tolerance that x needs."""
    kinds = species("A", "1e9") + species("D", "0") + species("x", "0.1") + species("y", "0.2")
    there, back = reaction("go", "x, A", "y, A", "c*x*A/1e9"), reaction("come", "y, A", "x, A", "c*y*A/2e9")
    laws = reaction("turn", "D", "A", "c*8500*D") + there + back
    scene = scene_of(tmp_path, document(species=kinds, reactions=laws))
    assert {z.name for z in scene.system.states} == {"D", "x"}
    assert "A follows from the others" in scene.description
    done = CliRunner().invoke(cli, ["run", str(tmp_path / "model.xml"), "--json"])
    assert "reached the end" in done.stdout


def test_a_scene_is_that_of_the_model_file_that_the_import_writes(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, ENZYME)
    (tmp_path / "model.toml").write_text(import_model(tmp_path / "model.xml").text)
    assert gsp.load(tmp_path / "model.toml") == scene


def test_amounts_and_concentrations_in_a_compartment_of_size_two(tmp_path: Path) -> None:
    """The rate is 3 A + b + f, of A as an amount, of b and f as concentrations; A' is that, b' half of twice it."""
    scene = scene_of(
        tmp_path,
        document(
            species=species("A", "6", hasOnlySubstanceUnits="true")
            + species("B", "6a")
            + species("F", "7a", boundaryCondition="true"),
            parameters=parameter("eps", "0.1"),
            reactions=reaction("r", "F", "A, 2 B", "(3*A + B + F)/eps"),
        ),
    )
    B, eps = sp.symbols("B eps")
    # A starts at a concentration of 6 in a size of 2, B at an amount of 6, so that b stays A - 9; f is 7/2.
    assert rates(scene) == {"B": sp.expand((3 * (B + 9) + B + sp.Rational(7, 2)) / eps)}
    assert dict(scene.start) == {"B": 3.0}
    assert [e.xreplace(dict(scene.system.parameters)) for e in scene.system.observables.values()] == [B + 9]


def test_fast_reactions_are_the_fast_part_and_their_stoichiometry_is_its_directions(tmp_path: Path) -> None:
    """A <-> 2 B fast, B -> nothing slow; in the limit p = 2 A + B decays at the rate k B on a k1 = b^2."""
    text = document(
        1,
        species=species("A", "1") + species("B", "2"),
        parameters=parameter("k", "3"),
        reactions=reaction("swap", "A", "2 B", "c*(A - B^2)", fast="true")
        + reaction("lose", "B", "", "c*k*B", fast="false"),
    )
    scene = scene_of(tmp_path, text)
    study = gsp.study(scene)
    assert study.splitting is not None
    N = study.splitting.N.xreplace(dict(scene.system.parameters))
    assert sp.simplify(N[1] / N[0]) == -2
    A, B, epsilon = sp.symbols("A B epsilon")
    assert rates(scene) == {
        "A": sp.expand(-(A - B**2) / epsilon),
        "B": sp.expand(2 * (A - B**2) / epsilon - 3 * B),
    }
    reduced = study.reduced(0)
    # On A = B^2 the slow sum p = 2 B^2 + B has p' = -3 B.
    p = 2 * 0.5**2 + 0.5
    point = {reduced.states[0].name: p}
    found = gsp.integrate(reduced, start=point, span=(0.0, 1e-3), epsilon=1e-100)
    slope = (found[reduced.states[0].name][-1] - p) / 1e-3
    assert slope == pytest.approx(-1.5, rel=2e-3)
    assert "the file means the limit 0" in scene.description


def test_where_all_is_fast_what_is_conserved_stays_a_state(tmp_path: Path) -> None:
    scene = scene_of(
        tmp_path,
        document(
            1,
            species=species("A", "1") + species("B", "2"),
            reactions=reaction("r", "A", "B", "A - B", fast="true"),
        ),
    )
    assert [z.name for z in scene.system.states] == ["A", "B"]
    assert list(gsp.study(scene).system.slow.values()) == [0]


@pytest.mark.parametrize(
    ("rated", "compartment", "slow"),
    [
        (rule("rate", "x", "-x"), "true", {"x"}),
        # The name of a reaction is its kinetic law, which is not divided.
        (rule("rate", "x", "r"), "true", {"x"}),
        (rule("rate", "x", "r*x"), "true", {"x"}),
        (rule("rate", "x", "A"), "true", {"x"}),
        (rule("rate", "c", "c*k"), "false", {"c"}),
        (rule("rate", "x", "0") + rule("rate", "c", "k"), "false", {"x", "c"}),
    ],
)
def test_with_rate_rules_beside_fast_reactions_alone_something_is_slow(
    tmp_path: Path, rated: str, compartment: str, slow: set[str]
) -> None:
    text = document(
        1,
        compartments=f'<compartment id="c" size="2" spatialDimensions="3" constant="{compartment}"/>',
        species=species("A", "1") + species("B", "2"),
        parameters=changing("x", "0.5") + parameter("k", "0.25"),
        rules=rated,
        reactions=reaction("r", "A", "B", "A - B", fast="true"),
    )
    scene = scene_of(tmp_path, text)
    system = gsp.study(scene).system
    assert {z.name for z in system.x} == slow
    assert len(system.y) == 1


def test_rules_assignments_functions_and_local_parameters(tmp_path: Path) -> None:
    """x' = 2 y(0) hill(x) + t with y = x + 1/3, hill(x) = x/(x + k), and one k that hides another."""
    text = document(
        parameters=parameter("x", constant="false")
        + parameter("y", constant="false")
        + parameter("k", "4")
        + parameter("start", "0.5")
        + changing("z", "2")
        + parameter("eps", "0.1"),
        functionDefinitions=f'<functionDefinition id="hill">{math("lambda(x, k, x/(x + k))")}</functionDefinition>',
        initialAssignments=f'<initialAssignment symbol="x">{math("3*start^2 + r")}</initialAssignment>',
        rules=rule("rate", "x", "(hill(x, k) + time)/eps")
        + rule("assignment", "y", "<apply><plus/><ci>x</ci><cn type='rational'>1<sep/>3</cn></apply>")
        + rule("rate", "z", "y"),
        species=species("A", "1"),
        reactions=reaction("r", "A", "", "k*A*start", local='<localParameter id="k" value="0.1"/>'),
    )
    scene = scene_of(tmp_path, text)
    x, A, t, eps = sp.symbols("x A t eps")
    assert rates(scene) == {
        "x": sp.expand((x / (x + 4) + t) / eps),
        "z": x + sp.Rational(1, 3),
        "A": -A / 40,
        "t": 1,
    }
    # r at the start is 0.1*1*0.5, made of its own k and not of the other one.
    assert dict(scene.start) == {"x": 0.8, "z": 2.0, "A": 1.0, "t": 0.0}
    assert scene.worked_out == {"start": ("the start of x",), "r_k": ("the start of x",)}


def test_a_function_may_have_any_name_and_arguments_of_that_name(tmp_path: Path) -> None:
    """f(f) = f^2, epsilon(f) = f + 1, whose argument hides a function, and a law called ln."""
    functions = {"f": "lambda(f, f^2)", "epsilon": "lambda(f, f + 1)"}
    texts = [
        f'<functionDefinition id="{name}">{math(body)}</functionDefinition>' for name, body in functions.items()
    ]
    text = document(
        functionDefinitions="".join(texts),
        species=species("x", "2a"),
        reactions=reaction("ln", "x", "", "f(x) + epsilon(f(x))"),
    )
    x = sp.Symbol("x")
    assert sp.expand(rates(scene_of(tmp_path, text))["x"] + (2 * x**2 + 1) / 2) == 0


def test_a_concentration_changes_with_its_compartment(tmp_path: Path) -> None:
    scene = scene_of(
        tmp_path,
        document(
            compartments='<compartment id="c" size="2" spatialDimensions="3" constant="false"/>',
            species=species("A", "3") + species("B", "5"),
            parameters=parameter("eps", "0.1"),
            rules=rule("rate", "c", "c/eps"),
            reactions=reaction("r", "A", "", "A"),
        ),
    )
    c, amount, eps = sp.symbols("c A_amount eps")
    assert rates(scene) == {"c": c / eps, "A_amount": -amount / c}
    assert dict(scene.start) == {"c": 2.0, "A_amount": 6.0}
    watched = {s.name: e.xreplace(dict(scene.system.parameters)) for s, e in scene.system.observables.items()}
    assert watched == {"A": amount / c, "B": 10 / c}


def test_conversion_factors_and_stoichiometries_that_change(tmp_path: Path) -> None:
    side = '<listOfProducts><speciesReference id="n" species="B" constant="false"/></listOfProducts>'
    text = document(
        attributes='conversionFactor="f"',
        species=species("A", "1", conversionFactor="g") + species("B", "1") + species("D", "4"),
        parameters=parameter("f", "3") + parameter("g", "5") + parameter("eps", "0.1"),
        rules=rule("assignment", "n", "A^2"),
        reactions=reaction("r", "A", "", "A/eps").replace("<kineticLaw>", f"{side}<kineticLaw>")
        + reaction("q", "A", "D", "1"),
    )
    A, eps = sp.symbols("A eps")
    scene = scene_of(tmp_path, text)
    found = rates(scene)
    assert found["A"] == sp.expand(-5 * (A / eps + 1) / 2)
    assert found["B"] == sp.expand(3 * A**3 / eps / 2)
    assert found["D"] == sp.Rational(3, 2)


def test_conserved_sums_are_those_of_amounts_over_conversion_factors(tmp_path: Path) -> None:
    """A in a size of 2 turns into B in a size of 5: 2 a + 5 b stays, with factors 2 a/3 + 5 b/7."""
    scene = scene_of(
        tmp_path,
        document(
            compartments='<compartment id="c" size="2" spatialDimensions="3" constant="true"/>'
            '<compartment id="d" size="5" spatialDimensions="3" constant="true"/>',
            species=species("A", "1", conversionFactor="f")
            + species("B", "2", place="d", conversionFactor="g"),
            parameters=parameter("f", "3") + parameter("g", "7") + parameter("eps", "0.1"),
            reactions=reaction("r", "A", "B", "A/eps"),
        ),
    )
    A = sp.Symbol("A")
    (other,) = scene.system.observables.values()
    total = sp.Rational(2, 3) + sp.Rational(10, 7)
    assert (
        sp.expand(other.xreplace(dict(scene.system.parameters)) - sp.Rational(7, 5) * (total - 2 * A / 3)) == 0
    )


@pytest.mark.parametrize(
    ("formula", "meaning"),
    [
        ("piecewise(1, x < 1, 2, x < 2, 3)", lambda x: 1 if x < 1 else 2 if x < 2 else 3),
        ("piecewise(1, x <= 1 && x > 0, 5)", lambda x: 1 if 0 < x <= 1 else 5),
        ("piecewise(1, x >= 1 || x == 0, 5)", lambda x: 1 if x >= 1 or x == 0 else 5),
        ("piecewise(x, !(x != 1), x^2)", lambda x: x if x == 1 else x**2),
        ("piecewise(1, xor(x > 0, x > 1), 0)", lambda x: int((x > 0) != (x > 1))),
        ("piecewise(7, 0 < x < 2, 8)", lambda x: 7 if 0 < x < 2 else 8),
        ("max(x, 1, 2*x - 1) + min(x, 1)", lambda x: max(x, 1, 2 * x - 1) + min(x, 1)),
        (
            "log10(x + 3) + log(3, x + 3) + root(3, x + 3)",
            lambda x: np.log10(x + 3) + np.log(x + 3) / np.log(3) + (x + 3) ** (1 / 3),
        ),
        (
            "arccot(x + 3) + sec(x) + coth(x + 3) + abs(-x)",
            lambda x: np.arctan(1 / (x + 3)) + 1 / np.cos(x) + 1 / np.tanh(x + 3) + abs(x),
        ),
        ("2 - 3 - 4*-x/2/3 + -x^2 + (-2)^2", lambda x: 2 - 3 + 4 * x / 6 - x**2 + 4),
        ("1e-3*exponentiale + pi + avogadro/1e24", lambda x: 1e-3 * np.e + np.pi + 0.602214179),
    ],
)
def test_mathematics_means_what_it_says(tmp_path: Path, formula: str, meaning) -> None:
    scene = scene_of(
        tmp_path,
        document(
            parameters=changing("x", "2") + changing("w") + parameter("eps", "0.1"),
            rules=rule("rate", "x", "-x/eps") + rule("rate", "w", formula),
        ),
    )
    x = scene.system.states[0]
    rate = sp.lambdify([x], scene.system.rates[1], "numpy")
    for value in (-0.5, 0.0, 0.5, 1.0, 1.5, 2.0, 2.5):
        assert rate(value) == pytest.approx(meaning(value), rel=1e-14), value
    # A jump is exact on its edge in machine code too.
    from gsp.lowering.compiled_flow import compile_flow

    assert compile_flow(scene.full_flow) is not None


def test_numbers_are_the_decimals_that_were_typed(tmp_path: Path) -> None:
    scene = scene_of(
        tmp_path,
        document(
            parameters=changing("x", "0.3") + parameter("k", "1.0000000000000002") + parameter("eps", "1e-3"),
            rules=rule("rate", "x", "-(<</eps".replace("<<", "0.1*k*x)")),
        ),
    )
    assert scene.system.parameters[sp.Symbol("k")] == sp.Rational("1.0000000000000002")
    assert scene.system.rates[0].subs({"x": 1, "k": 1, "eps": 1}) == -sp.Rational(1, 10)


def test_identifiers_that_are_no_names_here_get_others(tmp_path: Path) -> None:
    scene = scene_of(
        tmp_path,
        document(
            parameters=changing("_x") + parameter("sin", "2") + parameter("x", "5") + parameter("eps", "0.1"),
            rules=rule("rate", "_x", "<apply><divide/><ci>sin</ci><ci>eps</ci></apply>"),
        ),
    )
    assert rates(scene) == {"x_1": 2 / sp.Symbol("eps")}
    assert "_x is x_1, sin is sin_1" in scene.description


def with_package(name: str) -> str:
    space = f'xmlns:p="http://www.sbml.org/sbml/level3/version1/{name}/version1" p:required="true"'
    return document(parameters=X, rules=MOVING).replace("<sbml ", f"<sbml {space} ")


LAWLESS = (
    '<event useValuesFromTriggerTime="true"><trigger initialValue="true" persistent="true">{}</trigger></event>'
)
X = changing("x") + parameter("eps", "0.1")
MOVING = rule("rate", "x", "-x/eps")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            document(parameters=X, rules=MOVING, events=LAWLESS.format(math("x > 1"))),
            "1 event, which is not read",
        ),
        (document(parameters=X, rules=f"<algebraicRule>{math('x - 1')}</algebraicRule>"), "1 algebraic rule"),
        (document(parameters=X, rules=rule("rate", "x", "delay(x, 1)/eps")), "a delay is not read"),
        (document(parameters=X, rules=rule("rate", "x", "floor(x)/eps")), "floor, which jumps"),
        (document(parameters=X, rules=rule("rate", "x", "factorial(x)/eps")), "a factorial is not read"),
        (document(parameters=X, rules=rule("rate", "x", "piecewise(1, x > 1)/eps")), "without otherwise"),
        (document(parameters=X, rules=rule("rate", "x", "rateOf(eps)/eps")), "rateOf"),
        (document(species=species("A", "1"), reactions=reaction("r", "A", "", "")), "r has no kinetic law"),
        (
            document(species=species("A", ""), parameters=X, reactions=reaction("r", "A", "", "A/eps")),
            "A has no initial value",
        ),
        (document(parameters=changing("x", "") + parameter("eps", "0.1"), rules=MOVING), "x has no value"),
        (document(parameters=changing("x", "INF") + parameter("eps", "1"), rules=MOVING), "x is inf"),
        (document(parameters=X), "no reaction and no rate rule"),
        (with_package("comp"), "the package comp (submodels)"),
        (with_package("spatial"), "the package spatial"),
        (document(parameters=X, rules=MOVING + rule("assignment", "x", "2")), "x"),
        (
            document(
                species=species("A", "1"),
                parameters=X,
                rules=rule("rate", "A", "1/eps"),
                reactions=reaction("r", "A", "", "A"),
            ),
            "A",
        ),
        (document(parameters=X + parameter("y"), rules=rule("rate", "x", "-x*y/eps")), "y has no value"),
        (document(parameters=X, rules=rule("rate", "x", "nobody/eps")), "nobody"),
        (
            document(
                parameters=X + parameter("y"),
                initialAssignments=f'<initialAssignment symbol="y">{math("1/0")}</initialAssignment>',
                rules=rule("rate", "x", "-x*y/eps"),
            ),
            "the value of y: the expression divides by zero",
        ),
        (
            document(
                parameters=X + parameter("y"),
                initialAssignments=f'<initialAssignment symbol="y">{math("ln(eps - 1)")}</initialAssignment>',
                rules=rule("rate", "x", "-x*y/eps"),
            ),
            "the value of y is no finite number at time 0",
        ),
        (
            document(
                compartments='<compartment id="c" size="0" spatialDimensions="3" constant="true"/>',
                species=species("A", "1a"),
                parameters=parameter("eps", "0.1"),
                reactions=reaction("r", "A", "", "A/eps"),
            ),
            "the compartment c has the size 0",
        ),
    ],
    ids=range(21),
)
def test_what_is_not_read_is_refused_by_name(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        scene_of(tmp_path, text)
    assert str(caught.value).startswith("model.xml: ")
    assert words in str(caught.value), str(caught.value)


def in_rate(mathematics: str) -> str:
    return document(parameters=X, rules=rule("rate", "x", mathematics))


def in_formula(formula: str) -> str:
    return (
        '<sbml xmlns="http://www.sbml.org/sbml/level1" level="1" version="2"><model><listOfCompartments><compartment '
        'name="c"/></listOfCompartments><listOfParameters><parameter name="p" value="1"/></listOfParameters>'
        f'<listOfRules><parameterRule name="p" type="rate" formula="{formula}"/></listOfRules></model></sbml>'
    )


LAUGHS = "".join(f'<!ENTITY l{k} "{f"&l{k - 1};" * 10}">' for k in range(1, 12))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f'<!DOCTYPE x [<!ENTITY l0 "ha">{LAUGHS}]><sbml>&l11;</sbml>', "document type declaration"),
        ('<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]><sbml>&a;</sbml>', "document type declaration"),
        ('<!DOCTYPE x SYSTEM "http://localhost/x.dtd"><sbml/>', "document type declaration"),
        (document(parameters=X, rules=MOVING).replace("<model", "&a;<model"), "undefined entity"),
        (in_rate("<apply><minus/>" * 5000 + "<ci>x</ci>" + "</apply>" * 5000), "nested more than 200 deep"),
        (
            document(parameters=X).replace(
                "<model", "<notes>" + "<p>" * 9000 + "</p>" * 9000 + "</notes><model"
            ),
            "nested",
        ),
        (in_rate("<cn>1e999</cn>"), "not one that a double holds"),
        (in_rate("<cn>1e-999</cn>"), "not one that a double holds"),
        (in_rate("<cn>1_0</cn>"), "'1_0' is no number"),
        (in_rate("<cn>١</cn>"), "is no number"),
        (in_rate('<cn type="integer">99999999999</cn>'), "no integer of 32 bits"),
        (in_rate('<cn type="e-notation">1<sep/>99999</cn>'), "not one that a double holds"),
        (in_rate('<cn base="16">ff</cn>'), "of a base is not read"),
        (in_rate('<cn type="rational">7</cn>'), "the number '7' is not of the type rational"),
        (in_rate("<cn>1<sep/>2</cn>"), "is not of the type real"),
        (in_rate("<apply><times/><ci>eps</ci><cn type='rational'>1<sep/>0</cn></apply>"), "divides by zero"),
        (
            in_rate("<apply><times/><ci>eps</ci><apply><power/><cn>9</cn><cn>99999</cn></apply></apply>"),
            "too large",
        ),
        (document(parameters=changing("x", "1e400"), rules=MOVING), "not one that a double holds"),
        (in_formula("(" * 200 + "p" + ")" * 200), "nested more than 100 deep"),
        (in_formula("+".join(["p"] * 6000)), "characters; 10000 are allowed"),
        (in_formula("-" * 9000 + "p"), "nested"),
        (in_formula("1e-400*p"), "not one that a double holds"),
        ("<html/>", "the first element is html"),
        ("no xml", "this is no XML"),
        ("<sbml" + " " * (4 << 20), "larger than 4096 KiB"),
        (document(parameters=X, rules=MOVING).replace('id="x"', 'id="x&#10;y"'), "no valid SBML"),
    ],
    ids=range(26),
)
def test_a_hostile_file_is_refused_in_a_sentence(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        scene_of(tmp_path, text)
    assert words in str(caught.value), str(caught.value)
    assert len(str(caught.value)) < 900


def test_another_encoding_cannot_hide_what_libsbml_would_read(tmp_path: Path) -> None:
    """The declaration is replaced: what is looked through is what is read."""
    text = document(parameters=X, rules=MOVING).replace("UTF-8", "UTF-7")
    assert rates(scene_of(tmp_path, text)) == {"x": -sp.Symbol("x") / sp.Symbol("eps")}


def test_without_libsbml_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "libsbml", None)
    with pytest.raises(ModelFileError, match=r"gsp-toolkit\[sbml\]"):
        scene_of(tmp_path, ENZYME)


def test_old_levels_have_their_defaults() -> None:
    """Level 1: sizes are 1, species are amounts over them, and log is the natural logarithm."""
    text = (
        '<sbml xmlns="http://www.sbml.org/sbml/level1" level="1" version="2"><model><listOfCompartments><compartment '
        'name="c" volume="4"/></listOfCompartments><listOfSpecies><species name="A" compartment="c" initialAmount="8"/>'
        '</listOfSpecies><listOfReactions><reaction name="r" fast="true"><listOfReactants><speciesReference '
        'species="A" stoichiometry="3" denominator="2"/></listOfReactants><kineticLaw formula="log(A) - A^2"/>'
        "</reaction>"
        "</listOfReactions></model></sbml>"
    )
    model = read_sbml(text)
    assert model.states == {"A": "(-(3/2)*r/epsilon)/c"}
    assert model.definitions == {"r": "log(A) - A^2"}
    assert model.starts == {"A": "2"}


def test_the_command_line_imports_tells_and_does_not_write_over(tmp_path: Path) -> None:
    source = tmp_path / "model.sbml"
    source.write_text(ENZYME)
    answer = CliRunner().invoke(cli, ["import", str(source)])
    assert answer.exit_code == 0, answer.output
    assert "understood: 2 reactions, 4 species, 1 compartment, 4 parameters" in answer.output
    for arguments in ([], ["-o", str(tmp_path / "model.toml")]):
        again = CliRunner().invoke(cli, ["import", str(source), *arguments])
        assert isinstance(again.exception, GspError)
        assert "--force" in str(again.exception)
    assert CliRunner().invoke(cli, ["import", str(source), "--force"]).exit_code == 0
    (tmp_path / "linked.toml").symlink_to(source)
    for name, told in (
        ("model.sbml", "in .toml"),
        ("other.ode", "in .toml"),
        ("linked.toml", "over the model"),
    ):
        lost = CliRunner().invoke(cli, ["import", str(source), "--force", "-o", str(tmp_path / name)])
        assert told in str(lost.exception)
    assert source.read_text() == ENZYME
    checked = CliRunner().invoke(cli, ["check", str(source)])
    assert checked.exit_code in (0, 1)
    assert "gsp: conserved: E + C" in checked.stderr
    assert "conserved" not in checked.stdout


def test_notes_are_those_of_the_import(tmp_path: Path) -> None:
    path = tmp_path / "model.xml"
    path.write_text(ENZYME)
    assert load_noted(path)[1] == import_model(path).notes


@pytest.mark.parametrize(
    ("formula", "value"), [("sqrt(2)", 2**0.5), ("exp(1)/3", np.e / 3), ("cos(1)^2 - 1", -(np.sin(1) ** 2))]
)
def test_a_value_that_is_no_fraction_is_rounded_to_a_double(tmp_path: Path, formula: str, value: float) -> None:
    text = document(
        parameters=X + parameter("y"),
        initialAssignments=f'<initialAssignment symbol="y">{math(formula)}</initialAssignment>',
        rules=rule("rate", "x", "-x*y/eps"),
    )
    assert float(
        rates(scene_of(tmp_path, text))["x"].coeff(sp.Symbol("x")) * sp.Symbol("eps")
    ) == pytest.approx(-value, rel=1e-15)


def test_the_root_without_a_degree_is_the_square_root(tmp_path: Path) -> None:
    root = f'<math xmlns="{MATH}"><apply><divide/><apply><root/><ci>x</ci></apply><ci>eps</ci></apply></math>'
    x = sp.Symbol("x")
    text = document(parameters=X, rules=f'<rateRule variable="x">{root}</rateRule>')
    assert rates(scene_of(tmp_path, text))["x"].has(sp.sqrt(x))


@pytest.mark.parametrize(("dimensions", "guessed"), [("0", False), ("1", True), ("3", True)])
def test_a_size_that_is_not_given_is_one_and_is_told(tmp_path: Path, dimensions: str, guessed: bool) -> None:
    text = document(
        compartments=f'<compartment id="c" spatialDimensions="{dimensions}" constant="true"/>',
        species=species("A", "3a", hasOnlySubstanceUnits="true" if dimensions == "0" else "false"),
        parameters=parameter("eps", "0.1"),
        reactions=reaction("r", "A", "", "A/eps"),
    )
    scene = scene_of(tmp_path, text)
    assert dict(scene.start) == {"A": 3.0}
    assert ("sizes that are not given are 1: c" in scene.description) is guessed


@pytest.mark.parametrize(("assigned", "coefficient"), [("", 1), ("2*h", 6)])
def test_a_stoichiometry_is_the_number_written_or_the_one_assigned(
    tmp_path: Path, assigned: str, coefficient: int
) -> None:
    given = f'<initialAssignment symbol="n">{math(assigned or "1")}</initialAssignment>'
    text = document(
        species=species("A", "1") + species("B", "1"),
        parameters=parameter("eps", "0.1") + parameter("h", "3"),
        reactions=reaction("r", "A", "", "c*A/eps", extra='id="n"') + reaction("s", "B", "", "c*B"),
        **({"initialAssignments": given} if assigned else {}),
    )
    A, B, eps = sp.symbols("A B eps")
    assert rates(scene_of(tmp_path, text)) == {"A": -coefficient * A / eps, "B": -B}


def test_a_point_without_a_size_is_no_parameter(tmp_path: Path) -> None:
    for dimensions, names in (("0", {"eps"}), ("1", {"eps", "c"}), ("3", {"eps", "c"})):
        place = f'<compartment id="c" spatialDimensions="{dimensions}" constant="true"/>'
        scene = scene_of(tmp_path, document(compartments=place, parameters=X, rules=MOVING))
        assert {symbol.name for symbol in scene.system.parameters} | {"eps"} == names


@pytest.mark.parametrize(("limit", "found"), [(3, None), (4, 1)])
def test_laws_are_sought_up_to_so_many_entries(
    monkeypatch: pytest.MonkeyPatch, limit: int, found: int | None
) -> None:
    monkeypatch.setattr(conservation, "ENTRIES", limit)
    row = {"r": Fraction(1), "q": Fraction(2)}
    laws = conserved({"A": row, "B": {name: -number for name, number in row.items()}})
    assert (laws if laws is None else len(laws)) == found


@pytest.mark.exhaustive
@given(
    st.lists(st.lists(st.integers(-2, 2), min_size=1, max_size=4), min_size=1, max_size=6).filter(
        lambda rows: len({len(row) for row in rows}) == 1
    )
)
def test_conservation_laws_are_all_there_are_and_no_reaction_changes_them(rows: list[list[int]]) -> None:
    stoichiometry = {f"s{i}": {f"r{j}": Fraction(n) for j, n in enumerate(row)} for i, row in enumerate(rows)}
    laws = conserved(stoichiometry)
    assert laws is not None
    assert len(laws) == len(rows) - sp.Matrix(rows).rank()
    solved = {law.species for law in laws}
    for law in laws:
        assert solved.isdisjoint(law.others)
        for j in range(len(rows[0])):
            change = rows[int(law.species[1:])][j] - sum(
                c * rows[int(name[1:])][j] for name, c in law.others.items()
            )
            assert change == 0
