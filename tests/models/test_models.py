"""The contract that every named scene meets."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from gsp import models
from gsp.errors import GspError
from gsp.scenes.scene import Scene
from gsp.systems.system import SlowFastSystem, VectorField

every_scene = pytest.mark.parametrize("name", models.names())


def right_hand_side(flow: VectorField, epsilon: float):
    values = {**flow.parameters, flow.epsilon: sp.Float(epsilon, 30)}
    compiled = sp.lambdify([flow.states], [rate.subs(values) for rate in flow.rates])
    return lambda t, z: compiled(z)


@pytest.mark.parametrize("name", [["linear"], None, 3, {"linear": 1}])
@pytest.mark.parametrize("load", [models.load, models.title, models.lagrangian_system, models.friction_system])
def test_a_name_that_is_no_text_is_refused(load, name):
    with pytest.raises(GspError, match="a name is a text"):
        load(name)


@pytest.mark.exhaustive
@every_scene
def test_a_scene_is_complete_and_equal_to_itself_loaded_again(name):
    scene = models.load(name)
    assert isinstance(scene, Scene)
    assert scene == models.load(name)
    assert hash(scene) == hash(models.load(name))
    assert scene.name == scene.system.name == name
    assert scene.title == models.title(name)
    assert scene.source
    assert scene.description


@every_scene
def test_symbols_carry_no_assumptions_so_that_a_users_own_compare_equal(name):
    flow = models.load(name).full_flow
    for symbol in (*flow.states, *flow.parameters, flow.epsilon):
        assert symbol == sp.Symbol(symbol.name)


@pytest.mark.exhaustive
@every_scene
def test_the_start_is_in_the_region_and_the_field_is_finite_there(name):
    scene = models.load(name)
    for state, (low, high) in scene.region.items():
        assert low <= scene.start[state] <= high
    start = [scene.full_start[state.name] for state in scene.full_flow.states]
    for epsilon in (scene.epsilon, *scene.epsilons):
        assert np.isfinite(right_hand_side(scene.full_flow, epsilon)(0, start)).all()


@pytest.mark.exhaustive
@every_scene
def test_reconstruction_extends_the_states_and_does_not_feed_back(name):
    scene = models.load(name)
    count = len(scene.system.states)
    assert scene.full_flow.states[:count] == scene.system.states
    assert scene.full_flow.rates[:count] == scene.system.rates
    assert scene.full_flow.states[count:] == tuple(scene.reconstruction)
    assert list(scene.full_start) == [state.name for state in scene.full_flow.states]


# Runs of SciPy on rates in Python are slow.
@pytest.mark.exhaustive
@pytest.mark.parametrize("name", models.names())
def test_the_trajectory_stays_in_the_region_and_ends_on_the_attracting_sheet(name):
    scene = models.load(name)
    flow = scene.full_flow
    names = [state.name for state in flow.states]
    for epsilon in {scene.epsilon, *scene.epsilons}:
        rates = right_hand_side(flow, epsilon)
        solution = solve_ivp(
            rates, scene.span, list(scene.full_start.values()), method="Radau", rtol=1e-7, atol=1e-9
        )
        assert solution.success
        for state, (low, high) in scene.region.items():
            values = solution.y[names.index(state)]
            assert low - 1e-8 <= values.min()
            assert values.max() <= high + 1e-8
        if isinstance(scene.system, SlowFastSystem):
            end = dict(zip(flow.states, solution.y[:, -1]))
            at_end = {**scene.system.parameters, **end, flow.epsilon: epsilon}
            g = scene.system.g
            fast = np.array(g.jacobian(list(scene.system.y)).subs(at_end), dtype=float)
            assert np.linalg.eigvals(fast).real.max() < -0.5
            assert abs(np.array(g.subs(at_end), dtype=float)).max() < 5 * epsilon


def test_the_sleigh_follows_its_published_trajectory():
    """Full solution at epsilon = 0.1, t = 5, computed with two independent high-precision integrators."""
    scene = models.load("chaplygin_sleigh")
    rates = right_hand_side(scene.full_flow, 0.1)
    start = {**dict.fromkeys(scene.full_start, 0.0), "v": 1.0, "omega": 1.0}
    solution = solve_ivp(rates, (0, 5), list(start.values()), method="Radau", rtol=1e-9, atol=1e-11)
    expected = {
        "v": 1.2050260012970218,
        "omega": 0.3326857714203566,
        "w": -0.0394150434031963,
        "phi": 3.1146617404076758,
        "x": -1.1677176932471661,
        "y": 3.5340209167011440,
    }
    assert dict(zip(scene.full_start, solution.y[:, -1])) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "fast", "manifold"),
    [("linear", "x", "y/(1 - epsilon)"), ("davis_skodje", "y2", "y1/(1 + y1)")],
)
def test_the_slow_manifold_known_in_closed_form_is_invariant(name, fast, manifold):
    system = models.load(name).system
    assert isinstance(system, SlowFastSystem)
    h = sp.sympify(manifold)
    on_it = {sp.Symbol(fast): h}
    (slow,) = system.x
    defect = system.epsilon * h.diff(slow) * system.f[0].subs(on_it) - system.g[0].subs(on_it)
    assert sp.simplify(defect) == 0


def test_an_unknown_scene_is_refused_with_the_nearest_and_the_list():
    with pytest.raises(GspError, match=r'no scene "van_der_pool".*koper.*Did you mean "van_der_pol"'):
        models.load("van_der_pool")
    with pytest.raises(GspError, match="no scene"):
        models.title("")


def test_the_list_of_scenes_has_a_title_for_each():
    assert dict(models.summary()).keys() == set(models.names())


def test_a_path_is_sent_to_the_reader() -> None:
    with pytest.raises(GspError, match=r"gsp\.load\(path\)"):
        models.load("four.toml")
