"""Time scales along runs: exhausted modes, amplitudes in closed form, no separation, indices, texts and charts."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import DeclarationError
from gsp.scales import time_scales as module
from gsp.scales.conservation import conserved_by, reactions_of
from gsp.scales.time_scales import TimeScales, time_scales
from gsp.systems.system import VectorField
from tests.scales.fields import in_other_variables, michaelis_menten

x, y, z, gamma = sp.symbols("x y z gamma")
a, b, c = sp.symbols("a b c")


def linear(value: float = 100) -> VectorField:
    return VectorField({x: -x, y: gamma * (x - y)}, parameters={gamma: value})


def test_a_linear_system_is_exhausted_when_its_fast_part_has_decayed() -> None:
    """y - y_slow falls like exp(-100 t), and (1) says when: |a (b . F)| < rtol |z| + atol in each component."""
    found = time_scales(linear(), start={"x": 1, "y": 0}, span=(0, 1), rtol=0.01)
    assert found.rates == pytest.approx(np.tile([-100.0, -1.0], (len(found.t), 1)))
    # y = g/(g-1) (exp(-t) - exp(-g t)): the fast mode's share of y' is g^2/(g-1) exp(-g t).
    fast = 100**2 / 99 * np.exp(-100 * found.t)
    tolerance = 0.01 * np.abs(found.states[:, 1]) + 1e-4 * np.abs(found.states[:, 1]).max()
    wanted = fast < tolerance
    # At the very threshold the run's own error decides.
    clear = np.abs(fast / tolerance - 1.0) > 1e-3
    assert wanted.any()
    assert not wanted.all()
    assert (found.exhausted.astype(bool) == wanted)[clear].all()
    assert found.gap[found.exhausted == 1] == pytest.approx(100.0)
    assert (found.gap[found.exhausted == 0] == 1.0).all()
    assert found.fast(-1) == ("y",)
    assert "Fast there: y." in found.message


@pytest.mark.parametrize("value", [3, 10, 300])
def test_the_zero_fast_amplitude_of_davis_and_skodje(value: float) -> None:
    """x' = -x, y' = -g y + ((g-1) x + g x^2)/(1+x)^2: b . F = 0 at y - x/(1+x) = 2 x^2/(g (g-1) (1+x)^3)."""
    field = VectorField(
        {x: -x, y: -gamma * y + ((gamma - 1) * x + gamma * x**2) / (1 + x) ** 2}, parameters={gamma: value}
    )
    at = [0.0, 1e-9]
    for place in (0.2, 1.0, 4.0):
        own = place / (1 + place) + 2 * place**2 / (value * (value - 1) * (1 + place) ** 3)
        amplitudes = []
        for shift in (0.0, 1e-3):
            found = time_scales(field, start={"x": place, "y": own + shift}, span=(0, 1e-9), at=at)
            force = np.array(
                [-place, -value * (own + shift) + ((value - 1) * place + value * place**2) / (1 + place) ** 2]
            )
            amplitudes.append(found.left[0, 0] @ force / found.left[0, 0, 1])
        assert abs(amplitudes[0]) < 1e-12 * value
        assert amplitudes[1] == pytest.approx(-1e-3 * value, rel=1e-9)


WITHOUT = {
    "Lorenz": (
        {x: 10 * (y - x), y: x * (28 - z) - y, z: x * y - sp.Rational(8, 3) * z}, {"x": 1, "y": 1, "z": 1}, 20,
    ),
    "Lotka and Volterra": ({x: x - x * y, y: x * y - y}, {"x": 8, "y": 1}, 30),
    "oscillator": ({x: y, y: -4 * x}, {"x": 2, "y": 1}, 20),
    "Kuramoto": (
        {
            a: 1 + (sp.sin(b - a) + sp.sin(c - a)) / 2,
            b: sp.Rational(6, 5) + (sp.sin(a - b) + sp.sin(c - b)) / 2,
            c: sp.Rational(9, 10) + (sp.sin(a - c) + sp.sin(b - c)) / 2,
        },
        {"a": 0, "b": 1, "c": 2.5},
        20,
    ),
    "diffusion": (
        {
            u: (left - u if left != 0 else 0) + (right - u if right != 0 else 0)
            for left, u, right in zip(
                (0, *sp.symbols("u:9")), sp.symbols("u:10"), (*sp.symbols("u1:10"), 0)
            )
        },
        {f"u{i}": float(i) for i in range(10)},
        40,
    ),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", WITHOUT)
def test_no_separation_is_an_answer(name: str) -> None:
    equations, start, end = WITHOUT[name]
    found = time_scales(VectorField(equations), start=start, span=(0, end))
    assert not found.separated.any()
    assert found.separates_from is None
    assert found.message.startswith("No separation")
    pairs = np.abs(found.rates.imag) > 0
    assert (found.groups[:, 1:] == found.groups[:, :-1])[pairs[:, 1:] & (found.rates[:, 1:].imag < 0)].all()


def test_rates_do_not_change_with_the_variables() -> None:
    given = michaelis_menten().with_parameters(e0=0.05)
    matrix = sp.Matrix([[2, 1], [1, 1]])
    here = time_scales(given, start={"S": 1, "C": 0.02}, span=(0, 30), at=np.linspace(0, 30, 25))
    start = matrix.inv() * sp.Matrix([1, sp.Rational(2, 100)])
    there = time_scales(
        in_other_variables(given, matrix), start={"u0": start[0], "u1": start[1]}, span=(0, 30), at=here.t
    )
    assert there.rates == pytest.approx(here.rates, rel=1e-5)
    assert here.separates_from is not None


def test_a_scene_with_and_without_a_small_parameter_gives_the_same() -> None:
    from gsp.scenes.small_parameter import without_small

    scene = gsp.models.load("michaelis_menten")
    at = np.linspace(0.0, scene.span[1], 5)
    with_small, without = time_scales(scene, at=at), time_scales(without_small(scene), at=at)
    assert without.rates == pytest.approx(with_small.rates, rel=1e-7)
    assert without.exhausted.tolist() == with_small.exhausted.tolist()


def enzyme() -> TimeScales:
    e, s, p = sp.symbols("e s p")
    bind, leave, make = 10 * e * s, c, c / 2
    field = VectorField({e: -bind + leave + make, s: -bind + leave, c: bind - leave - make, p: make})
    return time_scales(field, start={"e": 0.1, "s": 1, "c": 0, "p": 0}, span=(0, 30))


def test_conserved_sums_are_found_and_have_no_rate() -> None:
    found = enzyme()
    assert {str(law) for law in found.conserved} == {"c + e", "c + p + s"}
    assert (found.rates[:, 2:] == 0.0).all()
    assert np.isinf(found.times[:, 2:]).all()
    assert found.pointers.sum(axis=1) == pytest.approx(np.ones((len(found.t), 4)), abs=1e-9)
    assert (found.exhausted <= 1).all()


def test_terms_are_reactions() -> None:
    k = sp.Symbol("k")
    found = reactions_of([-2 * k * x * y + x, k * x * y - x / 3])
    assert set(found.rates) == {k * x * y, x}
    columns = dict(zip(found.rates, found.matrix.T.tolist()))
    assert columns == {k * x * y: [-2.0, 1.0], x: [1.0, pytest.approx(-1 / 3)]}
    assert reactions_of([sp.Integer(0)]).matrix.shape == (1, 1)
    _, laws = conserved_by(VectorField({x: k * y, y: -2 * y}, parameters={k: 3}))
    assert [str(law) for law in laws] == ["x + 3*y/2"]


@pytest.mark.exhaustive
@pytest.mark.parametrize("unit", [1, sp.Rational(1, 10**9), 10**6])
def test_a_sum_across_the_time_scales_is_conserved(unit) -> None:
    """i binds to what is left of an enzyme, 1 - d: i' = -w, delta d' = w, with i in any unit."""
    i, d, s, k, delta = sp.symbols("i d s k delta")
    w = k * (i / unit * (1 - d) - d / 2)
    system = gsp.SlowFastSystem(slow={s: -s, i: -unit * w}, fast={d: w}, epsilon=delta, parameters={k: 3})
    start = {"s": 1, "i": float(unit), "d": 0.3}
    for flow in (system, system.as_field()):
        found = time_scales(flow, start=start, span=(0, 2), epsilon=0.02)
        assert found.conserved == (i + unit * delta * d,)
        assert (found.rates[:, -1] == 0.0).all()
        assert np.isfinite(found.times[:, :-1]).all()
        total = found.states @ [0.0, 1.0, 0.02 * float(unit)]
        assert total == pytest.approx(total[0], rel=1e-6)
    # With the fast state first the sum begins with it, and one that holds at this epsilon alone has its value.
    _, laws = conserved_by(VectorField({d: w / delta, i: -w, s: 0}, epsilon=delta, parameters={k: 3}), 0.5)
    assert laws == (d + i / delta, s)
    _, laws = conserved_by(VectorField({d: w / delta, i: -4 * w}, epsilon=delta, parameters={k: 3}), 0.5)
    assert laws == (d + i / (4 * delta),)
    _, laws = conserved_by(VectorField({d: w * (1 + delta), i: -3 * w}, epsilon=delta, parameters={k: 3}), 0.5)
    assert laws == (d + i / 2,)


def test_participation_and_importance_add_up_and_name_the_fast_reactions() -> None:
    """Partial equilibrium A <-> B at 1000, B -> drain at 1: the pair drives the fast mode, the drain the slow one."""
    field = VectorField({x: -1000 * x + 1000 * y, y: 1000 * x - 1000 * y - y})
    found = time_scales(field, start={"x": 1, "y": 0}, span=(0, 2))
    # The terms x and y: a term that differs by a factor alone is one reaction.
    assert found.participation.shape == (len(found.t), 2, 2)
    assert np.abs(found.participation).sum(axis=2) == pytest.approx(np.ones((len(found.t), 2)))
    slow, fast = found.importance(), found.importance(fast=True)
    done = found.exhausted == 1
    assert np.abs(slow).sum(axis=2)[done] == pytest.approx(1.0)
    assert (np.abs(fast[~done]) == 0.0).all()
    # On the manifold what drives and what brakes the fast mode are as large, and of opposite signs.
    last = found.participation[-1, 0]
    assert last.sum() == pytest.approx(0.0, abs=1e-3)
    moved = found.reactions.matrix * np.array([float(r.subs({x: found.states[-1, 0], y: found.states[-1, 1]}))
                                               for r in found.reactions.rates])  # fmt: skip
    share = found.left[-1, 1] @ moved * found.right[-1, 1, 0]
    assert slow[-1, 0] == pytest.approx(share / np.abs(share).sum())


def test_groups_participate_together() -> None:
    field = VectorField({x: -x + 5 * y, y: -5 * x - y, z: -z / 100 + x})
    found = time_scales(field, start={"x": 1, "y": 1, "z": 1}, span=(0, 3))
    assert found.groups[0].tolist() == [0, 0, 1]
    assert found.participation[:, 0] == pytest.approx(found.participation[:, 1])
    assert (found.participation[:, 0] >= 0.0).all()


@pytest.mark.parametrize("speed", [None, sp.Integer(1), sp.Symbol("omega")])
def test_beside_a_clock_the_run_is_the_longest_time_scale_and_a_conserved_sum_has_none(speed) -> None:
    # The rate of x is 0 beside a clock, or its own; u + v is conserved, and its rate is 0 whatever else there is.
    t, u, v = sp.symbols("t u v")
    pair = {u: v - 100 * u, v: 100 * u - v}
    forced = {x: y - x - sp.sin(t), y: -100 * (y - x), t: speed} if speed is not None else {}
    found = time_scales(
        VectorField({**forced, **pair}, parameters={speed: 1} if isinstance(speed, sp.Symbol) else {}),
        start=dict.fromkeys(map(str, {**forced, **pair}), 1.0),
        span=(0, 20),
        at=[0.0, 5.0, 20.0],
    )
    assert found.exhausted.tolist() == ([0, 2, 2] if forced else [0, 0, 0])
    assert np.isinf(found.times[:, -1]).all()
    if forced:
        assert found.gap[1:] == pytest.approx(20.0 * 101.0)
        assert found.message.startswith("From t = ")
        assert "nothing else moves" not in found.message
        assert found.fast(2) == ("y", "u")


def test_a_growing_mode_is_never_exhausted() -> None:
    found = time_scales(VectorField({x: -x, y: 100 * (y - x)}), start={"x": 1, "y": 100 / 101}, span=(0, 0.05))
    assert (found.exhausted == 0).all()


@pytest.mark.exhaustive
def test_many_states_are_looked_at_less_often(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PRODUCTS", 30 * 12**3)
    states = sp.symbols("u:12")
    field = VectorField({u: -(i + 1) * u + v for i, (u, v) in enumerate(zip(states, (*states[1:], states[0])))})
    found = time_scales(field, start=dict.fromkeys(map(str, states), 1.0), span=(0, 1))
    assert len(found.t) == 30
    assert found.pointers.shape == (30, 12, 12)


def test_wrong_calls_are_refused() -> None:
    with pytest.raises(DeclarationError, match="start is missing"):
        time_scales(linear(), span=(0, 1))


def test_a_run_that_ends_early_is_told() -> None:
    found = time_scales(VectorField({x: x**2, y: -100 * y}), start={"x": 1, "y": 1}, span=(0, 2))
    assert "The run ended early" in str(found)


def test_text_table_and_chart_say_the_same() -> None:
    shares: list[float] = []
    found = time_scales(linear(), start={"x": 1, "y": 0}, span=(0, 1), progress=shares.append)
    assert shares == sorted(shares)
    assert "exhausted" in str(found)
    data = found.to_xarray()
    assert data["pointer"].shape == (len(found.t), 2, 2)
    assert data["rate_real"].values == pytest.approx(found.rates.real)
    axes = found.plot()
    assert axes.get_xscale() == axes.get_yscale() == "log"
    assert [text.get_text() for text in axes.get_legend().get_texts()] == ["time scales", "exhausted", "gap"]


def test_a_run_along_which_no_jacobian_is_finite_is_named() -> None:
    still = VectorField({x: sp.sqrt(y), y: sp.Integer(0)})
    with pytest.raises(DeclarationError, match="at the start the derivative of the rate of x by y is not"):
        time_scales(still, start={"x": 1, "y": 0}, span=(0, 1))


def test_progress_goes_through_the_run_and_the_modes_and_an_interrupt_ends_both() -> None:
    field, seen = VectorField({x: -x, y: -100 * (y - x)}), []
    time_scales(field, start={"x": 1, "y": 0}, span=(0, 1), progress=seen.append)
    assert seen == sorted(seen)
    assert 0.0 < seen[0] <= 0.5 < seen[-1] <= 1.0

    def interrupt(share: float) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        time_scales(field, start={"x": 1, "y": 0}, span=(0, 1), progress=interrupt)


def test_a_rate_with_too_many_terms_is_taken_as_it_is_written() -> None:
    """Multiplied out it has 2^24 of them; y + 2 z is conserved by both."""
    tall = sp.Mul(*[x + k for k in range(1, 25)])
    found = reactions_of([sp.Integer(1), tall - 2 * y, -tall / 2 + y])
    assert set(found.rates) == {sp.Integer(1), tall, y}
    assert (found.matrix[1] == -2 * found.matrix[2]).all()
