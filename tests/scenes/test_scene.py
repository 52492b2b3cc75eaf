"""A scene checks everything it is given, once, and says what to do about it."""

import dataclasses

import pytest
import sympy as sp

from gsp.errors import DeclarationError
from gsp.scenes.scene import FINEST, Scene
from gsp.systems.system import SlowFastSystem, VectorField

x, y, eps, k = sp.symbols("x y epsilon k")
phi, q = sp.symbols("phi q")


def system() -> SlowFastSystem:
    return SlowFastSystem(
        slow={x: -x}, fast={y: k * x - y}, epsilon=eps, parameters={k: 1}, name="decay", observables={q: x + y}
    )


def scene(**changes) -> Scene:
    values = {
        "system": system(),
        "region": {"x": (0, 2)},
        "start": {"x": 1, "y": 0},
        "span": (0, 3),
        "epsilon": 0.01,
        "epsilons": (0.01, 0.04, 0.02),
        "tolerance": 1e-6,
    }
    return Scene(**(values | changes))


def test_the_first_seven_arguments_are_positional():
    assert Scene(system(), {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01, (0.01, 0.04, 0.02), 1e-6) == scene()


def test_values_are_stored_in_declared_order_as_floats():
    made = scene(region={y: (-1, 2), "x": (0, 2)}, start={"y": 0, x: sp.Rational(1, 2)})
    assert list(made.region.items()) == [("x", (0.0, 2.0)), ("y", (-1.0, 2.0))]
    assert list(made.start.items()) == [("x", 0.5), ("y", 0.0)]
    assert made.epsilons == (0.04, 0.02, 0.01)
    assert made.span == (0.0, 3.0)


def test_a_scene_without_ladder_and_tolerance_has_those_of_a_model_file():
    asked = Scene(system(), {"x": (0, 2)}, {"x": 1, "y": 0}, (0, 3), 0.01)
    assert asked == scene(epsilons=(0.02, 0.01, 0.005, 0.0025), tolerance=1e-6)


def test_equal_scenes_hash_alike_and_a_replaced_value_makes_another():
    assert scene() == scene()
    assert hash(scene()) == hash(scene())
    other = dataclasses.replace(scene(), epsilon=0.02)
    assert other != scene()
    assert other.epsilon == 0.02
    assert other.system == scene().system


def test_a_scene_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        scene().epsilon = 0.5  # type: ignore[misc]
    with pytest.raises(TypeError):
        scene().start["x"] = 2  # type: ignore[index]


def test_reconstruction_extends_the_flow_and_the_start_but_not_the_system():
    made = scene(reconstruction={phi: x * sp.cos(phi) + y}, start={"x": 1, "y": 0, "phi": 2}, path=("phi", "q"))
    assert made.full_flow == VectorField(
        {x: -x, y: (k * x - y) / eps, phi: x * sp.cos(phi) + y},
        epsilon=eps,
        parameters={k: 1},
        name="decay",
        observables={q: x + y},
    )
    assert made.full_start == {"x": 1.0, "y": 0.0, "phi": 2.0}
    assert made.start == {"x": 1.0, "y": 0.0}
    assert made.path == ("phi", "q")
    assert scene(reconstruction={phi: x}).full_start["phi"] == 0.0
    assert dataclasses.replace(made, epsilon=0.02).full_start == made.full_start


def test_floats_in_reconstruction_rates_become_exact():
    assert scene(reconstruction={phi: 0.2 * x}).reconstruction[phi] == x / 5


def test_a_field_without_reconstruction_is_its_own_full_flow():
    field = VectorField({x: -x, y: (x - y) / eps}, epsilon=eps)
    assert scene(system=field).full_flow == field


def test_repr_is_one_line_and_str_an_aligned_card():
    made = scene(title="Decay", reconstruction={phi: x})
    assert repr(made) == "Scene(decay: SlowFastSystem in x, y; epsilon=0.01, span=(0.0, 3.0), tolerance=1e-06)"
    card = str(made).splitlines()
    assert card[0] == "Decay"
    assert "     region  x in [0, 2]" in card
    assert "       phi'  x" in card


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"system": "decay"}, ("SlowFastSystem or a VectorField", "decay")),
        ({"system": VectorField({x: -x, y: x - y})}, ("no small parameter", "0.01", "Leave the value out")),
        ({"name": "../x"}, ("plain word", "title")),
        ({"name": 3}, ("name is text", "3")),
        ({"region": {}}, ("bounds no state", "at least one of x, y")),
        ({"start": {"x": 1}}, ("no value for y", "every state")),
        ({"start": {"x": 1, "y": 0, "z": 1}}, ('start names "z"', "x, y")),
        ({"start": {"x": 1, "y": float("nan")}}, ("start gives y", "nan")),
        ({"start": {"x": 3, "y": 0}}, ("outside the region", "x = 3", "widen")),
        ({"span": (0, 0)}, ("span is empty", "t0 < t1")),
        ({"span": (1, 0)}, ("span is reversed", "(1, 0)")),
        ({"epsilon": 0}, ("epsilon", "positive", "0")),
        ({"epsilons": (0.1,)}, ("too few", "[0.1]")),
        ({"epsilons": (0.1, 0.1)}, ("repeats", "different")),
        ({"epsilons": (0.1, -0.1)}, ("every epsilon", "positive")),
        ({"epsilons": 0.1}, ("sequence", "0.1")),
        ({"tolerance": 0}, ("tolerance", "between 0 and 1", "0")),
        ({"tolerance": 1}, ("tolerance", "between 0 and 1", "1")),
        ({"reconstruction": {x: y}}, ("x is a reconstruction variable", "a state", "another name")),
        ({"reconstruction": {k: y}}, ("a parameter",)),
        ({"reconstruction": {q: y}}, ("an observable",)),
        ({"reconstruction": {eps: y}}, ("epsilon",)),
        ({"reconstruction": {"phi": y}}, ("SymPy symbols", "'phi'")),
        ({"reconstruction": {phi: sp.Symbol("theta")}}, ("theta", "no state")),
        ({"reconstruction": {phi: sp.exp(eps)}}, ("epsilon stands in", "no pole or power")),
        ({"reconstruction": [phi]}, ("reconstruction maps", "[phi]")),
        ({"claims": {3: {x: -x}}}, ("a claim is a name",)),
        ({"claims": {"rival": [x]}}, ("a claim is a name",)),
        ({"claims": {"rival": {}}}, ("a claim is a name",)),
        ({"path": ("x", "z")}, ('path names "z"', "x, y, q")),
        ({"path": ("x", "x")}, ("different names",)),
        ({"path": "xy"}, ("pair of names", "'xy'")),
    ],
    ids=str,
)
def test_what_cannot_be_is_refused_with_fact_value_and_remedy(changes, words):
    with pytest.raises(DeclarationError) as caught:
        scene(**changes)
    for word in words:
        assert word in str(caught.value)


def test_the_nearest_state_is_suggested():
    wide = VectorField({sp.Symbol("velocity"): -sp.Symbol("velocity") / eps}, epsilon=eps)
    with pytest.raises(DeclarationError, match='Did you mean "velocity"'):
        scene(system=wide, region={"velocty": (0, 1)}, start={"velocity": 0})


def test_the_least_that_is_taken_is_taken():
    assert scene(epsilons=(0.01, 0.02), tolerance=FINEST).epsilons == (0.02, 0.01)
    with pytest.raises(DeclarationError, match="no run in double precision"):
        scene(tolerance=FINEST * (1 - 1e-15))
