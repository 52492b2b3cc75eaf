"""Switches become fast variables: the new field is the old one in other variables, to the last digit."""

from __future__ import annotations

import pytest
import sympy as sp

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import DeclarationError
from gsp.slow.series import expand
from gsp.splitting.splitting import split
from gsp.splitting.switches import has_switches, put, with_fast, without_switches
from gsp.systems.system import SlowFastSystem, VectorField

x, y, u, v, w, V, eps = sp.symbols("x y u v w V epsilon")
slip = (V - u) / eps
LAWS = {
    "clipped linear": sp.Max(-1, sp.Min(1, slip)),
    "tanh": sp.tanh(slip),
    "algebraic": slip / sp.sqrt(1 + slip**2),
    "algebraic over epsilon": (V - u) / sp.sqrt((V - u) ** 2 + eps**2),
    "arctan": 2 / sp.pi * sp.atan(slip),
    "Stribeck": sp.Rational(2, 5) * slip / sp.sqrt(1 + slip**2) + sp.Rational(6, 5) * slip / (1 + slip**2),
    "a user's": sp.erf(slip) * (1 + sp.exp(-(slip**2))),
}
FIELDS = {
    **{name: {x: u, u: -x + phi} for name, phi in LAWS.items()},
    "two switches": {x: 1 - 2 * sp.tanh(x / eps) + u, u: 1 - 2 * sp.tanh(slip) - x, y: -y + x},
    "a switch beside a pole": {x: -x + y, u: -x + sp.tanh(slip), y: (x - y) / eps},
    "a circle": {x: u - x * sp.tanh((x**2 + u**2 - 1) / eps), u: -x},
    "a sine of the state that the surface is solved for": {x: u, u: sp.sin(u) - x + sp.tanh(slip)},
}


def declared(rates) -> VectorField:
    return VectorField(rates, epsilon=eps, parameters={V: "1/5"})


@pytest.mark.parametrize("name", FIELDS)
def test_the_new_field_is_the_old_one_in_other_variables(name: str) -> None:
    raw = declared(FIELDS[name])
    assert has_switches(raw)
    changed, switches = without_switches(raw)
    assert not has_switches(changed)
    place = {x: sp.Rational(3, 7), u: sp.Rational(2, 7), y: sp.Rational(1, 3), V: sp.Rational(1, 5)}
    small = sp.Rational(1, 4)
    velocity = {z: rate.xreplace({**place, eps: small}) for z, rate in raw.equations.items()}
    new = dict(place)
    for switch in switches:
        new[switch.fast] = switch.surface.xreplace({**new, eps: small}) / small
        velocity[switch.fast] = sum(
            sp.diff(switch.surface, z).xreplace({**new, eps: small}) * velocity[z] / small
            for z in switch.surface.free_symbols & velocity.keys()
        )
        if switch.state is not None:
            assert switch.value is not None
            assert switch.state not in changed.states
            assert abs(sp.N(switch.value.xreplace({**new, eps: small}) - place[switch.state], 30)) < 1e-25
            assert changed.observables[switch.state].xreplace({**new, eps: small}).equals(place[switch.state])
    for z, rate in changed.equations.items():
        assert abs(sp.N(rate.xreplace({**new, eps: small}) - velocity[z], 30)) < 1e-25


def test_split_says_which_variable_is_fast_and_gives_both() -> None:
    found = split(declared(FIELDS["tanh"]))
    assert "v = (V - u)/epsilon is a fast variable in place of u = V - epsilon*v" in found.explain()
    assert found.system == SlowFastSystem(
        slow={x: V - eps * v}, fast={v: x - sp.tanh(v)}, epsilon=eps, parameters={V: "1/5"},
        observables={u: V - eps * v},
    )  # fmt: skip
    assert found.to_new({"x": 1.0, "u": 0.1}, epsilon=0.01) == {"x": 1.0, "v": pytest.approx(10.0)}
    (branch,) = solve_critical(found.system).branches
    assert expand(branch, order=1).reduced_field[1] == (-sp.atanh(x),)


def test_a_surface_that_no_state_is_solved_for_leaves_all_states() -> None:
    changed, (switch,) = without_switches(declared(FIELDS["a circle"]))
    assert changed.states == (x, u, v)
    assert switch.state is None
    assert "beside the states" in str(switch)


def test_two_switches_on_one_surface_are_one_fast_variable() -> None:
    changed, switches = without_switches(declared({x: u, u: sp.tanh(slip) + sp.atan(2 * slip) - x}))
    assert [s.fast for s in switches] == [v]
    assert changed.equations[v].equals((x - sp.tanh(v) - sp.atan(2 * v)) / eps)


def test_names_that_the_field_has_are_left_to_it() -> None:
    changed, (switch,) = without_switches(declared({v: -v, u: -v + sp.tanh(slip), w: u}))
    assert switch.fast == sp.Symbol("v1")
    assert changed.states == (v, switch.fast, w)
    assert put(u * sp.tanh(slip), (switch,)) == (V - eps * switch.fast) * sp.tanh(switch.fast)


def test_values_need_every_state_of_the_surface() -> None:
    _, switches = without_switches(declared(FIELDS["a circle"]))
    with pytest.raises(DeclarationError, match="no value for u"):
        with_fast(switches, {"x": 1.0}, 0.1, {})


def test_values_are_known_by_name_whatever_is_assumed_of_the_symbols() -> None:
    place, speed = sp.Symbol("x", positive=True), sp.Symbol("u", real=True)
    field = declared({place: speed, speed: -place + sp.tanh((V - speed) / eps)})
    assert split(field).to_new({"x": 1.0, "u": 0.25}, epsilon=0.1)["v"] == pytest.approx(-0.5)


def test_a_switch_in_a_standard_form_is_refused_with_the_remedy() -> None:
    with pytest.raises(DeclarationError, match=r"a switch on V - u = 0.*Declare a VectorField"):
        SlowFastSystem(slow={x: sp.tanh(slip)}, fast={u: x - u}, epsilon=eps, parameters={V: 1})
