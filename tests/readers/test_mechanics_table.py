"""`[mechanics]` of a model file: the scene is the one that the verbs of mechanics make."""

from __future__ import annotations

import json
import tomllib
from importlib.resources import files

import jsonschema
import pytest
import sympy as sp

from gsp import models
from gsp.errors import GspError
from gsp.readers.expressions import parse_expression
from gsp.readers.toml import read_model
from gsp.readers.writing import as_toml
from gsp.scenes.study import study

SLED = """
title = "A sled on a blade"

[parameters]
m = 1
J = 1
a = 0.2
mu = 0.3
g = 9.81

[mechanics]
lagrangian = "m*(xdot^2 + ydot^2)/2 + (J + m*a^2)*phidot^2/2 + m*a*phidot*slip"
coordinates = ["x", "y", "phi"]
constraints = ["slip"]
frame = {v = "xdot*cos(phi) + ydot*sin(phi)", omega = "phidot"}
law = "coulomb"
mu = "mu"
normal = "m*g"

[definitions]
slip = "-xdot*sin(phi) + ydot*cos(phi)"
twice = "2*slip"
speed = "abs(v)"

[observables]
fast = "speed + w"

[region]
v = [0.5, 1.5]
omega = [0.1, 0.8]
w = [-1, 1]

[start]
x = 0
y = 0
phi = 0.1
v = 1
omega = 0.5
w = 0

[scene]
span = [0, 3]
epsilon = 0.01
path = ["x", "y"]
"""
VISCOUS = SLED.replace('law = "coulomb"\nmu = "mu"\nnormal = "m*g"\n', "damping = 1\n")
SCHEMA = json.loads(files("gsp.readers").joinpath("model.schema.json").read_text(encoding="utf-8"))


@pytest.mark.exhaustive
def test_a_sled_starts_from_its_lagrangian() -> None:
    scene = read_model(SLED, name="sled")
    v, omega, w, m, J, a, mu, g, epsilon = sp.symbols("v omega w m J a mu g epsilon")
    rates = dict(zip(scene.system.states, scene.system.rates))
    slip = w / epsilon
    across = -omega * v - mu * g * (J + m * a**2) / J * slip / sp.sqrt(1 + slip**2)
    assert sp.simplify(rates[w] - across) == 0
    assert sp.simplify(rates[v] - omega * (a * omega + w)) == 0
    assert set(map(str, scene.reconstruction)) == {"x", "y", "phi"}
    assert scene.full_start["phi"] == 0.1
    assert scene.path == ("x", "y")
    ready = study(scene)
    assert [str(s) for s in ready.system.x] == ["v", "omega"]
    assert ready.hyperbolicity.holds
    assert [str(o) for o in ready.system.observables][-1] == "fast"


def test_viscous_friction_gives_the_scene_that_python_gives() -> None:
    scene = read_model(VISCOUS, name="sled")
    known = models.load("sleigh_from_lagrangian")
    values = {s.name: value for s, value in scene.system.parameters.items()}
    for z, rate in known.system.equations.items():
        found = scene.system.equations[z].xreplace({sp.Symbol("J"): sp.Symbol("I")})
        assert sp.simplify(found - rate) == 0, z
    assert values["a"] == sp.Rational(1, 5)


def test_a_scene_says_what_its_velocities_and_momenta_are() -> None:
    """A blade that slides along its body: what is said gives the start that the scene has, from the file's."""
    text = """
    [mechanics]
    lagrangian = "(xdot^2 + ydot^2 + thdot^2 + sdot^2 - s^2)/2"
    coordinates = ["x", "y", "th", "s"]
    constraints = ["ydot*cos(th) - xdot*sin(th) + s*thdot"]
    [region]
    s = [-1, 1]
    u1 = [-2, 2]
    thdot = [-3, 3]
    sdot = [-1, 1]
    w = [-1, 1]
    [start]
    x = 0
    y = 0
    th = 0.3
    s = 0.2
    xdot = 0.5
    ydot = 0.1
    thdot = 0.7
    sdot = 0.4
    [scene]
    span = [0, 2]
    epsilon = 0.01
    """
    scene = read_model(text, name="blade")
    values = tomllib.loads(text)["start"]
    for sentence in sorted(scene.description.split("; "), key=lambda said: said.startswith("p")):
        name, formula = sentence.split(" = ")
        values[name] = parse_expression(formula, symbols={key: sp.Symbol(key) for key in values}).xreplace(
            {sp.Symbol(key): value for key, value in values.items()}
        )
    assert {"u1", "p", "w"} <= set(values)
    assert scene.start == pytest.approx({name: float(values[name]) for name in scene.start})
    assert read_model('description = "Mine."\n' + text, name="blade").description == "Mine."


def test_names_of_slips_pairs_forces_and_time_are_read() -> None:
    text = """
    [mechanics]
    lagrangian = "(xdot^2 + ydot^2 + phidot^2)/2"
    coordinates = ["x", "y", "phi"]
    velocities = ["xdot", "ydot", "phidot"]
    constraints = [["xdot", "ydot"]]
    forces = {x = "cos(t)"}
    time = "t"
    law = "w/sqrt(1 + w^2) + w/(1 + w^2)"
    mu = [[0.5, 0.25]]
    normal = 4
    [start]
    x = 0
    y = 0
    phi = 0
    t = 0
    phidot = 1
    w1 = 0
    w2 = 0
    [region]
    t = [0, 1]
    [scene]
    span = [0, 1]
    epsilon = 0.01
    """
    scene = read_model(text, name="disc")
    assert [s.name for s in scene.system.states] == ["phidot", "w1", "w2", "t"]
    named = read_model(text.replace('[["xdot", "ydot"]]', '{p = "xdot", q = "ydot"}').replace("[[0.5, 0.25]]", "0.5")
                       .replace("w1 =", "p =").replace("w2 =", "q ="), name="disc")  # fmt: skip
    assert [s.name for s in named.system.states] == ["phidot", "p", "q", "t"]


def test_a_wheel_at_the_end_of_a_rod_brings_the_rod_along_as_a_holonomic_constraint() -> None:
    text = """
    [parameters]
    l = 2
    r = 0.5
    [mechanics]
    lagrangian = "(xdot^2 + ydot^2 + phidot^2)/2"
    coordinates = ["x", "y", "phi"]
    holonomic = ["x^2 + y^2 - l^2"]
    constraints = {w = "(x*ydot - y*xdot)/l - r*phidot"}
    frame = {turn = "(x*ydot - y*xdot)/l^2"}
    [region]
    x = [1, 2]
    y = [-1, 1]
    turn = [-1, 1]
    w = [-1, 1]
    [start]
    x = 2
    y = 0
    phi = 0
    turn = 1
    w = 0.1
    [scene]
    span = [0, 1]
    epsilon = 0.01
    """
    scene = read_model(text, name="wheel")
    x, y, p, w, r, rod, phi, epsilon = sp.symbols("x y p w r l phi epsilon")
    # By hand: T = (l^2 turn^2 + phidot^2)/2 with phidot = (l turn - w)/r, so that p = l^2 turn + (l/r) phidot is slow.
    on_circle = {x: 2 * sp.cos(phi), y: 2 * sp.sin(phi), rod: 2, r: sp.Rational(1, 2)}
    rates = dict(zip(scene.system.states, scene.system.rates))
    assert [s.name for s in scene.system.states] == ["x", "y", "p", "w"]
    assert sp.simplify(rates[p].subs(on_circle)) == 0
    assert sp.simplify(epsilon * rates[w].subs(on_circle) + (1 + sp.Rational(1, 4)) * w) == 0
    with pytest.raises(GspError, match=r"violates the holonomic constraint .* it is -3 there"):
        read_model(text.replace("x = 2", "x = 1"), name="wheel")
    for given, words in (
        ('"x"', "mechanics.holonomic is a list"),
        ('["z"]', "z"),
        ('["xdot"]', "coordinates alone"),
    ):
        with pytest.raises(GspError, match=words):
            read_model(text.replace('["x^2 + y^2 - l^2"]', given), name="wheel")


def test_such_a_scene_is_saved_with_its_equations() -> None:
    scene = read_model(SLED, name="sled")
    again = read_model(as_toml(scene), name="sled")
    assert again.full_start == scene.full_start
    assert [s.name for s in again.system.states] == [s.name for s in scene.system.states]


@pytest.mark.parametrize("text", [SLED, VISCOUS])
def test_the_schema_takes_it(text: str) -> None:
    assert not list(jsonschema.Draft202012Validator(SCHEMA).iter_errors(tomllib.loads(text)))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('lagrangian = "m*', 'lagrange = "m*', "mechanics.lagrange is unknown"),
        ('coordinates = ["x", "y", "phi"]', "", "mechanics.coordinates is missing"),
        ('coordinates = ["x", "y", "phi"]', 'coordinates = "x"', "mechanics.coordinates is a list of names"),
        ('coordinates = ["x", "y", "phi"]', 'coordinates = ["x", "y", "sin"]', "sin is a word of the grammar"),
        (
            'coordinates = ["x", "y", "phi"]',
            'coordinates = ["x", "y", "m"]',
            "m is declared under parameters too",
        ),
        ('coordinates = ["x", "y", "phi"]', f"coordinates = {[f'q{k}' for k in range(20)]}", "12 are allowed"),
        ('constraints = ["slip"]', 'constraints = "slip"', "a list, or a table of slips"),
        ('constraints = ["slip"]', 'constraints = ["x"]', "constraint 1"),
        ('mu = "mu"\n', "", "dry friction takes mu"),
        ('law = "coulomb"', 'law = "coulombs"', "coulombs"),
        ('law = "coulomb"', 'law = "w"', "phi tends to"),
        ("omega = 0.5", "omeg = 0.5", "omeg"),
        ("[region]", '[states]\nq = "1"\n[region]', r"has no \[states\]"),
        ("span = [0, 3]", "", "scene.span is missing"),
        ('m*g"', 'm*G"', 'the name "G" is not declared'),
    ],
)
def test_what_is_wrong_is_named(old: str, new: str, says: str) -> None:
    assert old in SLED
    with pytest.raises(GspError, match=says):
        read_model(SLED.replace(old, new), name="sled")
