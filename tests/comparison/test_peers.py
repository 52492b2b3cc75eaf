"""Other people's integrators: every one that is installed solves what it is given, or says why not."""

from __future__ import annotations

import dataclasses
import importlib
import operator
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from gsp.comparison.peers import PEERS as OWN
from gsp.comparison.peers import Peer
from gsp.comparison.work_precision import work_precision
from gsp.errors import DeclarationError, UnsupportedFunctionError
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.models import load
from gsp.systems.system import VectorField

# The adapters of the benchmarks, which are scripts beside each other.
BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
with pytest.MonkeyPatch.context() as patch:
    patch.syspath_prepend(str(BENCHMARKS))
    choosing, forward, rivals, translation = map(
        importlib.import_module, ("choosing", "forward", "rivals", "translation")
    )
PEERS, Forward = rivals.PEERS, forward.Forward

x, y, k, n, epsilon = sp.symbols("x y k n epsilon")
GRID = np.linspace(0.25, 2.0, 8)
# y' = -(y - cos x)/epsilon - sin x with x' = 1 has the solution y = cos x.
STIFF = VectorField({x: 1, y: -k * (y - sp.cos(x)) / epsilon - sp.sin(x)}, epsilon=epsilon, parameters={k: 2})
BERNOULLI = VectorField({y: -y + y**n}, epsilon=None, parameters={n: 3})

installed = pytest.mark.parametrize(
    "peer",
    [
        pytest.param(peer, marks=pytest.mark.skipif(peer.version is None, reason=f"no {peer.package}"))
        for peer in PEERS
    ],
    ids=lambda peer: peer.name,
)
quiet = pytest.mark.filterwarnings("ignore")


def prepared(peer: Peer, field: VectorField, start: list[float], grid=GRID, value: float | None = None):
    return peer.prepare(field, parameter_vector(field, value), np.array(start), 0.0, grid)


@quiet
@installed
def test_the_error_falls_with_the_tolerance(peer: Peer) -> None:
    solve = prepared(peer, STIFF, [0.0, 1.0], value=0.05)
    errors = [np.abs(solve(rtol, rtol).states[1] - np.cos(GRID)).max() for rtol in (1e-3, 1e-6, 1e-9)]
    assert errors[0] > 10 * errors[1] > 100 * errors[2]
    assert errors[0] < 3e-2
    assert errors[2] < 1e-6


@quiet
@installed
def test_parameters_are_those_that_are_passed(peer: Peer) -> None:
    # y^(1-n) = 1 + (y0^(1-n) - 1) exp((n-1) t), here with n = 2 in place of the field's own 3.
    run = peer.prepare(BERNOULLI, np.array([np.nan, 2.0]), np.array([0.5]), 3.0, 3.0 + GRID)(1e-8, 1e-10)
    assert run.states.shape == (1, len(GRID))
    assert run.states[0] == pytest.approx(1 / (1 + np.exp(GRID)), rel=1e-5)


@quiet
@installed
def test_a_grid_may_run_backward(peer: Peer) -> None:
    growing = VectorField({x: k * x}, epsilon=None, parameters={k: 2})
    for grid in (-GRID, -GRID[-1:]):
        assert prepared(peer, growing, [1.0], grid)(1e-8, 1e-10).states[0] == pytest.approx(
            np.exp(2 * grid), rel=1e-5
        )


@quiet
@installed
def test_a_run_is_repeatable_at_any_tolerance(peer: Peer) -> None:
    solve = prepared(peer, STIFF, [0.0, 0.5], value=0.05)
    first = solve(1e-5, 1e-7).states
    solve(1e-3, 1e-5)
    # Whether to the last bit is for the peer and its BLAS; what a tolerance leaves behind is larger.
    assert solve(1e-5, 1e-7).states == pytest.approx(first, rel=1e-9)


SINGLE = {
    "trigonometric": sp.sin(x) + sp.cos(x) + sp.tan(x),
    "inverse": sp.asin(x / 3) + sp.acos(x / 3) ** 2 + sp.atan(x),
    "two arguments": sp.atan2(x, 2),
    "exponential": sp.exp(-x) + sp.log(1 + x),
    "hyperbolic": sp.sinh(x) + sp.cosh(x) + sp.tanh(x),
    "inverse hyperbolic": sp.asinh(x) + sp.acosh(1 + x) + sp.atanh(x / 5),
    "error function": sp.erf(x),
    "powers": x**5 / (1 + x**2) ** 2 + sp.sqrt(x) + x ** sp.Rational(1, 3) + 2**x + x**sp.pi,
    "largest and smallest": sp.Abs(x - 1) + sp.Max(x, 1, 2 * x - 1) + sp.Min(x, 1),
    "jumps": sp.sign(x + 1) + sp.Heaviside(x + 1),
    "pieces": sp.Piecewise((x, x < 1), (2 - x, (x < 2) & (x >= 1)), (0, True)),
    "nothing but numbers": sp.sqrt(2) + sp.E**2 + sp.sin(1),
}
BEYOND_DIFFSL = {"inverse", "two arguments", "inverse hyperbolic", "error function", "jumps", "pieces"}


@pytest.mark.exhaustive
@quiet
@installed
@pytest.mark.parametrize("name", SINGLE)
def test_what_a_language_can_say_means_the_same(peer: Peer, name: str) -> None:
    # The span keeps x within the domain of all of them.
    field = VectorField({x: SINGLE[name] / 10}, epsilon=None)
    grid = np.array([0.1, 0.2])
    if peer.package == "pydiffsol" and name in BEYOND_DIFFSL:
        with pytest.raises(UnsupportedFunctionError, match="pydiffsol's DiffSL has no"):
            prepared(peer, field, [0.5], grid)
        return
    solve = prepared(peer, field, [0.5], grid)
    exact = prepared(PEERS[0], field, [0.5], grid)(1e-11, 1e-13).states
    assert solve(1e-9, 1e-11).states == pytest.approx(exact, rel=1e-6)


def test_values_put_in_agree_with_the_machine_code() -> None:
    scene = load("chaplygin_sleigh")
    flow = scene.system
    p = parameter_vector(flow, 0.03)
    z = np.array([0.3, -0.7, 0.2])
    for sign in (1, -1):
        problem = Forward(flow, p, z, 1.0, 1.0 + sign * GRID)
        assert not set().union(*(rate.free_symbols for rate in problem.rates)) - set(flow.states)
        rates = [float(rate.subs(dict(zip(flow.states, z)))) for rate in problem.rates]
        assert rates == pytest.approx(sign * compile_flow(flow).rates(z, p), rel=1e-14)
        assert problem.field(z, p) == pytest.approx(rates, rel=1e-14)
        assert problem.jacobian(z, p) == pytest.approx(sign * compile_flow(flow).derivatives(z, p), rel=1e-14)
        assert problem.times == pytest.approx(GRID)


@pytest.mark.parametrize("grid", [[], [0.0, 1.0], [1.0, 0.5], [-1.0, 1.0]])
def test_a_grid_that_turns_is_named(grid: list[float]) -> None:
    with pytest.raises(DeclarationError, match="without turning"):
        Forward(BERNOULLI, np.array([np.nan, 3.0]), np.array([0.5]), 0.0, np.array(grid))


PLAIN = translation.Language("plain", float, lambda a, b: a**b, lambda a: a**0.5, {sp.exp: np.exp})


def test_a_function_that_a_language_lacks_is_named() -> None:
    said = translation.translate([sp.exp(x) * x**3 / 2], states={x: 2.0}, language=PLAIN)
    assert said == [pytest.approx(4 * np.exp(2.0))]
    for rate, what in (
        (sp.sin(x), "sin"),
        (sp.Piecewise((x, x < 1), (1, True)), "Piecewise"),
        (sp.sign(x), "Piecewise"),
    ):
        with pytest.raises(UnsupportedFunctionError, match=f"plain has no {what}"):
            translation.translate([rate], states={x: 2.0}, language=PLAIN)


def test_the_peers_of_the_package_come_first() -> None:
    assert PEERS[: len(OWN)] == OWN
    assert len({peer.name for peer in PEERS}) == len(PEERS)


CHOOSING = choosing.ChoosingLanguage(
    "choosing",
    float,
    operator.pow,
    np.sqrt,
    {sp.Max: max, sp.Min: min},
    choose=lambda condition, a, b: a if condition else b,
    relations={sp.Lt: operator.lt, sp.Le: operator.le, sp.Gt: operator.gt, sp.Ge: operator.ge},
    joins={sp.And: operator.and_, sp.Or: operator.or_},
)


@pytest.mark.parametrize("name", ["largest and smallest", "jumps", "pieces"])
@pytest.mark.parametrize("value", [-1.5, -1.0, 0.5, 1.0, 1.5, 2.0, 3.0])
def test_choices_mean_the_same_in_a_language_that_has_them(name: str, value: float) -> None:
    rate = SINGLE[name].replace(sp.Abs, lambda a: sp.Max(a, -a))
    assert choosing.translate([rate], states={x: value}, language=CHOOSING) == [float(rate.subs(x, value))]


def test_a_value_where_no_condition_holds_is_none_and_a_join_that_is_missing_is_named() -> None:
    pieces = sp.Piecewise((x, x < 1))
    assert np.isnan(choosing.translate([pieces], states={x: 2.0}, language=CHOOSING)[0])
    both = sp.Piecewise((x, (x < 2) & (y > 1)), (0, True))
    assert choosing.translate([both], states={x: 1.5, y: 2.0}, language=CHOOSING) == [1.5]
    assert choosing.translate([both], states={x: 1.5, y: 0.0}, language=CHOOSING) == [0.0]
    bare = dataclasses.replace(CHOOSING, joins={})
    with pytest.raises(UnsupportedFunctionError, match="choosing has no And"):
        choosing.translate([both], states={x: 1.5, y: 2.0}, language=bare)


def _failing(*, prepares: bool) -> Peer:
    class Failing(Peer):
        name = "failing"
        package = "scipy"

        def prepare(self, flow, p, start, first, grid):
            if not prepares:
                raise UnsupportedFunctionError("failing has no exp")

            def solve(rtol, atol):
                raise ArithmeticError("gave up\nat once")

            return solve

    return Failing()


def test_a_peer_that_raises_is_named() -> None:
    scene = load("michaelis_menten")
    arguments = {"rtols": (1e-4, 1e-6), "orders": (), "methods": ()}
    found = work_precision(scene, peers=(_failing(prepares=False),), **arguments)
    assert found.omitted == {"failing": "failing has no exp"}
    found = work_precision(scene, peers=(_failing(prepares=True),), **arguments)
    assert found["failing"].points == ()
    assert found["failing"].ended == "ArithmeticError: gave up at once at rtol 1e-06"
