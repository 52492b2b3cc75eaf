"""Scalings of variables and of time: known distinguished limits, and fields that go through from raw equations."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

import gsp
from gsp.cli import cli
from gsp.errors import DeclarationError, SplittingError

mu, k, d, r = sp.symbols("mu k d r")
q1, q2, v1, v2, x, v, s, c, u, t, i = sp.symbols("q1 q2 v1 v2 x v s c u t i")

JOINT = """
epsilon = "mu"
parameters = { k = 1, d = 2, I = 1, J = 2 }
region = { link = [-1, 1.5], v = [-1, 1] }
start = { link = 1, motor = 1, v = 0, w = 0 }
scene = { span = [0, 3], epsilon = 0.02 }
[states]
link = "v"
motor = "w"
v = "(-k*(link - motor)/mu^2 - d*(v - w)/mu - sin(link))/I"
w = "(-w + k*(link - motor)/mu^2 + d*(v - w)/mu)/J"
"""


def field(rates: dict) -> gsp.VectorField:
    return gsp.VectorField(rates, epsilon=mu, parameters={k: 1, d: 2, r: 3})


def joint() -> gsp.VectorField:
    spring, damper = k * (q1 - q2) / mu**2, d * (v1 - v2) / mu
    return field({q1: v1, q2: v2, v1: -spring - damper + r, v2: spring + damper})


# Each with the exponents of its first suggestion, the powers of mu in time and in epsilon, and what is fast.
KNOWN = {
    "a flexible joint": (joint(), {"q2_scaled": 2, "v2_scaled": 1}, 0, 1, ["q2_scaled", "v2_scaled"]),
    "a singular circuit: both L and R vanish, and the current is large": (
        field({u: -u, v: i, i: (u - v - mu * r * i) / mu**2}),
        {"i_scaled": -1}, 0, 1, ["v", "i_scaled"],
    ),
    "a stiff spring with damping: large and slow forcing": (
        field({t: 1, x: v, v: t - k * x / mu**2 - d * v / mu - x**3 / mu**2}),
        {"v_scaled": -1}, 0, 1, ["x", "v_scaled"],
    ),
    "Michaelis and Menten's with little enzyme": (
        field({s: -k * mu * s + (k * s + d) * c, c: k * mu * s - (k * s + d + r) * c}),
        {"c_scaled": 1}, -1, 1, ["c_scaled"],
    ),
    "a layer of the width mu^(1/2)": (
        field({t: 1, u: v, v: (u - t) / mu}),
        {"v_scaled": sp.Rational(-1, 2)}, 0, sp.Rational(1, 2), ["u", "v_scaled"],
    ),
    "mu^2 is the small parameter": (field({x: v, v: -(x + v) / mu**2}), {}, 0, 2, ["v"]),
}  # fmt: skip


@pytest.mark.parametrize("name", KNOWN)
def test_the_known_scaling_comes_first(name: str) -> None:
    given, exponents, time, power, fast = KNOWN[name]
    found = gsp.scalings(given)[0]
    assert {s.name: a for s, a in found.exponents.items() if a} == exponents
    assert (found.time, found.power) == (time, power)
    split = gsp.split(found.field)
    assert split.system is not None
    assert [y.name for y in split.system.y] == fast


@pytest.mark.parametrize("name", KNOWN)
def test_a_scaled_field_is_the_field_itself(name: str) -> None:
    """At a point, with numbers: each scaled state's rate is what the chain rule makes of the raw rates."""
    given = KNOWN[name][0]
    place = {z: sp.Rational(j + 3, 7) for j, z in enumerate(given.states)}
    for found in gsp.scalings(given):
        numbers = {mu: sp.Rational(1, 9), **given.parameters}
        small = {found.field.epsilon: numbers[mu] ** found.power, **given.parameters}
        raw = {z: rate.subs({**place, **numbers}) for z, rate in given.equations.items()}
        new = {z: e.subs({**place, **numbers}) for z, e in found.states.items()}
        for z, e in found.states.items():
            chain = (
                sum(sp.diff(e, old).subs(numbers) * rate for old, rate in raw.items())
                * numbers[mu] ** found.time
            )
            assert sp.simplify(chain - found.field.equations[z].subs({**new, **small})) == 0
        back = {z: e.subs({**new, **small}) for z, e in found.inverse.items()}
        assert all(sp.simplify(back[z] - place[z]) == 0 for z in given.states)


def test_the_linear_part_counts_where_the_fast_rates_vanish() -> None:
    """With c = 0 the rate k s c/mu is 0 whatever s is: s is slow, once c is measured in mu."""
    given = field({s: -s - k * s * c / mu, c: s - d * c / mu})
    assert {z.name: a for z, a in gsp.scalings(given)[0].exponents.items()} == {"s": 0, "c_scaled": 1}


@pytest.mark.parametrize(
    "rates",
    [
        # Undamped, it rotates and leaves nothing slow; a perturbation that is regular; nothing but functions.
        {x: v, v: -k * x / mu**2 - x**3},
        {x: v, v: -x - mu * v},
        {x: sp.sin(x * v) / mu**2, v: sp.cos(x) / mu**2},
    ],
)
def test_no_scaling_is_an_answer(rates: dict) -> None:
    assert gsp.scalings(field(rates)) == ()
    with pytest.raises(SplittingError):
        gsp.split(field(rates))


def test_a_scaling_does_not_depend_on_the_order_of_states_nor_on_units() -> None:
    given = joint()
    other = gsp.VectorField(
        {z: given.equations[z].subs({k: 1000 * k, d: 50 * d}) for z in (v2, q2, v1, q1)},
        epsilon=mu,
        parameters={k: 7, d: sp.Rational(1, 3), r: 1},
    )
    (found,) = gsp.scalings(other)
    assert sorted(a for a in found.exponents.values() if a) == [1, 2]


def test_suggestions_are_distinguished_limits_and_end_in_large_fields() -> None:
    given = KNOWN["a stiff spring with damping: large and slow forcing"][0]
    told = [{s.name: a for s, a in each.exponents.items() if a} for each in gsp.scalings(given)]
    # The cubic term, or else the force, at the scale of the spring.
    assert told[:2] == [{"v_scaled": -1}, {"x_scaled": 1}]
    many = sp.symbols("y:40")
    chain = {y: (y - 2 * z) / mu**2 + v for y, z in zip(many, [*many[1:], v])}
    assert len(gsp.scalings(gsp.VectorField({**chain, v: -v}, epsilon=mu))) >= 1


@pytest.mark.exhaustive
def test_a_joint_goes_through_from_its_raw_equations(tmp_path: Path) -> None:
    file = tmp_path / "joint.toml"
    file.write_text(JOINT)
    scene = gsp.load(file)
    study = gsp.study(scene)
    assert study.splitting is not None
    assert "w_scaled = (v - w)/mu" in study.splitting.explain()
    assert "motor_scaled = (link - motor)/mu**2" in study.splitting.explain()
    # Link and motor as one rigid body; by hand the spring's force is that which the motor needs.
    link, speed, inertia, motor = sp.symbols("link v I J")
    series = study.series(0)
    rate = -(speed + sp.sin(link)) / (inertia + motor)
    assert sp.simplify(series.reduced_field[0]["v"] - rate) == 0
    force = k * series.coefficients[0]["motor_scaled"]
    assert sp.simplify(force - (speed + motor * rate)) == 0
    found = gsp.compare(study, orders=(1, 2))
    # f_1 vanishes: the rigid body is right through order 1.
    assert found.slopes == pytest.approx({1: 2, 2: 3}, abs=0.1)
    # The scaled run is the raw one.
    raw = gsp.integrate(scene, at=[1.0, 3.0])
    scaled = gsp.integrate(study.scene, at=[1.0, 3.0])
    for name in ("link", "motor", "v", "w"):
        assert scaled[name] == pytest.approx(np.array(raw[name]), rel=1e-6)
    for verb in ("split", "expand", "check", "choose"):
        done = CliRunner().invoke(cli, [verb, str(file)], catch_exceptions=False)
        assert done.exit_code == 0
        assert (
            verb == "choose" or "simple in scaled variables: motor_scaled = (link - motor)/mu**2" in done.stderr
        )
    told = json.loads(CliRunner().invoke(cli, ["scales", str(file), "--scalings", "--json"]).stdout)
    assert told["scalings"][0]["exponents"] == {"link": 0.0, "motor_scaled": 2.0, "v": 0.0, "w_scaled": 1.0}
    assert "fast: motor_scaled, w_scaled" in CliRunner().invoke(cli, ["scales", str(file), "--scalings"]).stdout


def test_a_model_that_needs_no_scaling_is_told_so() -> None:
    # Its x is fast as it is: it was said that nothing brings out fast variables.
    found = CliRunner().invoke(cli, ["scales", "van_der_pol", "--scalings"])
    assert found.stdout == "No other scaling by small powers of epsilon brings out fast variables.\n"
    refused = CliRunner().invoke(cli, ["scales", "van_der_pol", "--scalings", "--keep", "a"])
    assert "--keep belongs to --parameters" in str(refused.exception)


def test_time_region_and_starts_follow() -> None:
    given = KNOWN["Michaelis and Menten's with little enzyme"][0]
    driven = sp.Symbol("made")
    scene = gsp.Scene(
        given, {"s": (0.1, 2), "c": (0, 0.1)}, {"s": 1, "c": 0.01}, (0, 50), 0.01,
        reconstruction={driven: r * c}, units={"t": "s", "s": "mM"}, starts={"none": {"c": 0.0}},
    )  # fmt: skip
    scaling = gsp.scalings(given)[0]
    made = gsp.take_scaling(scene, scaling=scaling)
    assert made.region["c_scaled"] == pytest.approx((0.0, 10.0))
    assert made.start == pytest.approx({"s": 1.0, "c_scaled": 1.0})
    assert made.starts["none"]["c_scaled"] == 0.0
    assert made.span == pytest.approx((0.0, 0.5))
    assert dict(made.units) == {"s": "mM"}
    ends = gsp.integrate(made, at=[made.span[1]]), gsp.integrate(scene, at=[scene.span[1]])
    for name in ("s", "c", "made"):
        assert ends[0][name][-1] == pytest.approx(ends[1][name][-1], rel=1e-6)
    with pytest.raises(DeclarationError, match="one of scalings"):
        gsp.take_scaling(scene, scaling=gsp.scalings(joint())[0])


def test_a_root_is_the_small_parameter_of_the_scene() -> None:
    given = KNOWN["a layer of the width mu^(1/2)"][0]
    scene = gsp.Scene(given, {"t": (-1, 1)}, {"t": 0, "u": 0, "v": 1}, (0, 1), 0.01)
    made = gsp.take_scaling(scene, scaling=gsp.scalings(given)[0])
    assert made.epsilon == pytest.approx(0.1)
    assert made.epsilons == pytest.approx([value**0.5 for value in scene.epsilons])


def test_what_is_watched_of_mu_is_watched_of_the_square_of_its_root() -> None:
    given = KNOWN["a layer of the width mu^(1/2)"][0]
    watched = gsp.VectorField(given.equations, epsilon=mu, observables={s: u + mu * v})
    made = gsp.scalings(watched)[0].field
    root, v_scaled = made.epsilon, made.states[-1]
    assert sp.expand(made.observables[s] - u - root * v_scaled) == 0


def test_a_field_without_a_small_parameter_is_refused() -> None:
    with pytest.raises(DeclarationError, match="no small parameter whose powers"):
        gsp.scalings(gsp.VectorField({x: -x}))


@pytest.mark.parametrize("far", [1000, -(10**6)])
def test_states_far_from_the_origin_are_scaled_about_where_they_are(far: int) -> None:
    """Products of three states that are small about `far`, whose limits are others about the origin."""
    near = gsp.VectorField(
        {s: -s * c / mu + 2 * u, c: -s * c / mu**2 + u / mu**2, u: s * c / mu - u}, epsilon=mu
    )
    moved = {z: z - far for z in near.states}
    given = gsp.VectorField({z: e.xreplace(moved) for z, e in near.equations.items()}, epsilon=mu)
    found = gsp.scalings(given)
    assert [(each.exponents, each.time, each.power) for each in found] == [
        (each.exponents, each.time, each.power) for each in gsp.scalings(near)
    ]
    for each in found:
        rates = {z: e.xreplace(dict(each.inverse)) for z, e in given.equations.items()}
        for new, e in each.states.items():
            slope = sum(sp.diff(e, z) * rates[z] for z in given.states) * mu**each.time
            assert sp.expand(slope.xreplace(dict(each.inverse)) - each.field.equations[new]) == 0
            assert sp.expand(e.xreplace(dict(each.inverse)) - new) == 0
    place = {"s": far + 1.0, "c": far + 2.0, "u": far + 0.5}
    region = dict.fromkeys(place, (far, far + 2))
    made = gsp.take_scaling(gsp.Scene(given, region, place, (0, 1), 0.1), scaling=found[0])
    assert made.start == pytest.approx({"s_scaled": 10.0, "c_scaled": 0.2, "u": far + 0.5})
    assert made.region["s_scaled"] == pytest.approx((0.0, 20.0))
