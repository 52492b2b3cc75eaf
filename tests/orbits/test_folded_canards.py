"""Canards of folded nodes: exact orbits of the normal form, published systems, and two routes to each point."""

import sys

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.orbits.canard_orbits.canard import CanardKind
from gsp.orbits.canard_orbits.canard_family import FamilyEnd
from gsp.orbits.canard_orbits.folded_canards import CanardOrbitError
from gsp.orbits.canard_orbits.frame import frame_at
from gsp.orbits.canard_orbits.node_units import in_own_units
from gsp.orbits.canard_orbits.sheet import SheetEnd
from gsp.singular.singularities.desingularised import FoldedError
from tests.cases import sampled, thinned

x, z, y, epsilon = sp.symbols("x z y epsilon")
# Desroches, Krauskopf and Osinga 2008, and AUTO's demo fnc: v is fast there, and time is fast time.
v, h, s = sp.symbols("v h s")
FITZHUGH_NAGUMO = gsp.SlowFastSystem(
    slow={h: -2 * h - sp.Rational(13, 5) * v, s: -sp.Rational(113, 200) * s},
    fast={v: h - (v**3 - v + 1) / 2 - s * v / 2},
    epsilon=epsilon,
)
# T_a and T_r at which the demo's authors matched the two sheets by hand, for xi_3 to xi_8.
MATCHED_BY_HAND = np.array(
    [
        [56.312667620, 144.10077659],
        [71.853132166, 160.62079695],
        [85.797089436, 178.59845751],
        [98.432124179, 197.98334090],
        [110.04693491, 218.62796126],
        [120.81663908, 240.27107973],
    ]
)


def normal_form(mu: sp.Rational) -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow={x: mu * z / 2 - (mu + 1) * y, z: 1}, fast={y: x + y**2}, epsilon=epsilon)


def node(system: gsp.SlowFastSystem, **region: tuple[float, float]) -> gsp.FoldedSingularity:
    (found,) = gsp.folded_singularities(system, region=region)
    return found


@pytest.mark.exhaustive
def test_the_frame_takes_fast_rates_that_switch_elsewhere() -> None:
    smooth = normal_form(sp.Rational(1, 9))
    gated = gsp.SlowFastSystem(
        slow=smooth.slow, fast={s: g * sp.Abs(s + 3) / (s + 3) for s, g in smooth.fast.items()}, epsilon=epsilon
    )
    box = {s.name: (-1.0, 1.0) for s in smooth.states}
    wanted, found = (frame_at(node(system, **box), epsilon=0.01) for system in (smooth, gated))
    np.testing.assert_allclose(
        [*found.strong, *found.weak], [*wanted.strong, *wanted.weak], rtol=1e-9, atol=1e-12
    )


@pytest.fixture(scope="module")
def koper() -> gsp.CanardOrbits:
    system = gsp.models.load("koper").system
    assert isinstance(system, gsp.SlowFastSystem)
    return gsp.folded_canards(node(system, x=(0.5, 1.5), y=(-2, 2), z=(-2, 2)), epsilon=0.01)


@pytest.fixture(scope="module")
def neuron() -> gsp.CanardOrbits:
    return gsp.folded_canards(
        node(FITZHUGH_NAGUMO, v=(-1, 0)),
        epsilon=0.015,
        section={"s": 0.2797},
        attracting={"h": -6},
        repelling={"v": 0},
    )


# -- the normal form -------------------------------------------------------------------------------


@pytest.mark.parametrize(("mu", "secondary"), thinned([("3/5", 0), ("3/10", 1), ("3/20", 2), ("2/25", 5)], 4))
def test_the_normal_form_has_its_canards_as_the_theory_counts_them(mu: str, secondary: int) -> None:
    found = gsp.folded_canards(node(normal_form(sp.Rational(mu)), y=(-1, 1)), epsilon=0.01)
    assert found.expected == secondary
    assert found.missing == ()
    assert [c.half_turns for c in found.canards if c.index is not None] == [
        2 * k + 1 for k in range(secondary + 1)
    ]
    # (x, y, z, t) -> (x, -y, -z, -t) exchanges the sheets: canards cross z = 0 at y = 0.
    assert np.abs([c.point["y"] for c in found.canards]).max() < 1e-9
    # x = epsilon a - a^2 z^2, y = a z for every epsilon, a = 1/2 (strong) and mu/2 (weak).
    assert found["gamma_0"].point["x"] == pytest.approx(0.005, abs=1e-12)
    if secondary < 5:
        assert found.canards[-1].kind is CanardKind.WEAK
        assert found["gamma_w"].point["x"] == pytest.approx(0.005 * float(sp.Rational(mu)), abs=1e-10)


@pytest.mark.parametrize("mu", sampled(["1/2", "7/10", "9/10", "99/100", "2"], always=["1/2", "7/10"]))
def test_two_canards_where_the_weak_direction_is_not_much_weaker(mu: str) -> None:
    # With mu = 2 in the equations the node has mu = 1/2, and the two parabolas change places.
    strong, weak = max(sp.Rational(mu), sp.Integer(1)), min(sp.Rational(mu), sp.Integer(1))
    found = gsp.folded_canards(node(normal_form(sp.Rational(mu)), y=(-1, 1)), epsilon=0.01)
    assert [c.name for c in found.canards] == ["gamma_0", "gamma_w"]
    assert found.status.ok
    assert found["gamma_0"].half_turns == 1
    assert found["gamma_0"].point["x"] == pytest.approx(0.005 * float(strong), abs=1e-12)
    # Where 1/mu is whole the curves touch there: a multiple root.
    assert found.touching == (mu in ("1/2", "2"))
    assert found["gamma_w"].point["x"] == pytest.approx(0.005 * float(weak), abs=1e-8)
    assert found["gamma_w"].error < (1e-4 if found.touching else 1e-10)
    assert ("touch at gamma_w" in found.message) == found.touching
    # The lines are left before the slow flow runs along them: no orbit goes round by far away.
    assert max(orbit.time for orbit in found.attracting.segments) < 10
    assert len(found.attracting.segments) < 300


@pytest.mark.exhaustive
def test_where_the_curves_touch_the_strong_canard_is_not_taken_for_the_weak_one() -> None:
    found = gsp.folded_canards(node(normal_form(sp.Rational(1, 3)), y=(-1, 1)), epsilon=0.01)
    assert found.missing == ("xi_1",)
    assert found["gamma_0"].point["x"] == pytest.approx(0.005, abs=1e-12)
    assert found["gamma_w"].point["x"] == pytest.approx(0.005 / 3, abs=1e-8)


@pytest.mark.exhaustive
def test_a_sole_strong_canard_is_named_so_away_from_the_normal_form() -> None:
    # The curves end before gamma_w, which the terms of higher order move by epsilon^(1/2).
    system = gsp.SlowFastSystem(
        slow={x: 7 * z / 20 - 17 * y / 10 + z * y / 3 + y**2 / 5, z: 1 + x / 2 - y / 4},
        fast={y: x + y**2 + y**3 / 3 + x * y / 7},
        epsilon=epsilon,
    )
    singularity = node(system, x=(-0.1, 0.1), y=(-0.1, 0.1), z=(-0.1, 0.1))
    assert singularity.mu == sp.Rational(7, 10)
    found = gsp.folded_canards(singularity, epsilon=0.001)
    assert [c.name for c in found.canards] == ["gamma_0"]
    assert found["gamma_0"].point["x"] == pytest.approx(0.0005, rel=1e-2)
    assert "do not cross at gamma_w before they end" in found.message


@pytest.mark.exhaustive
def test_the_strong_canard_of_the_normal_form_is_the_parabola_along_its_whole_length() -> None:
    strong = gsp.folded_canards(node(normal_form(sp.Rational(3, 10)), y=(-1, 1)), epsilon=0.02)["gamma_0"]
    # From starts on M0 orbits reach the slow manifold after a few epsilon.
    inside = np.abs(strong["z"]) < 0.5 * np.abs(strong["z"]).max()
    a = 0.5
    assert np.abs(strong["y"] - a * strong["z"])[inside].max() < 1e-7
    assert np.abs(strong["x"] - (0.02 * a - (a * strong["z"]) ** 2))[inside].max() < 1e-7


@pytest.mark.exhaustive
def test_secondary_canards_of_the_normal_form_scale_with_epsilon() -> None:
    singularity = node(normal_form(sp.Rational(3, 20)), y=(-1, 1))
    places = [
        gsp.folded_canards(singularity, epsilon=value)["xi_2"].point["x"] / value for value in (1e-2, 1e-5)
    ]
    assert places[0] == pytest.approx(places[1], rel=1e-8)


def test_lines_along_the_variable_of_the_section_begin_at_the_strong_canard() -> None:
    # From z = -0.8 to z = 0 orbits far out take longer than those near the weak canard, for z' = 1 + y/3.
    curved = gsp.SlowFastSystem(
        slow={x: z / 10 - sp.Rational(11, 10) * y, z: 1 + y / 3}, fast={y: x + y**2 + y**3 / 4}, epsilon=epsilon
    )
    found = node(curved, x=(-2, 2), z=(-1, 1), y=(-1, 1))
    usual, others = (
        gsp.folded_canards(found, epsilon=0.001, **lines)
        for lines in ({}, {"attracting": {"z": -0.8}, "repelling": {"z": 0.8}})
    )
    assert [c.name for c in others.canards] == ["gamma_0", "xi_1", "gamma_w"]
    assert [c.half_turns for c in others.canards] == [1, 3, None]
    # Without y/3 and y^3/4 these are y = a z with 2 a^2 - 11 a/10 + 1/10 = 0, so that x = epsilon a at z = 0.
    for name, sign in (("gamma_0", 1), ("gamma_w", -1)):
        assert others[name].point["x"] / 0.001 == pytest.approx((1.1 + sign * 0.41**0.5) / 4, rel=0.01)
    for canard in others.canards:
        assert canard.point["x"] == pytest.approx(usual[canard.name].point["x"], abs=1e-9)


@pytest.mark.parametrize(("k", "weak", "secondary"), [(0.1, 0.1149, 0.0882), (1 / 15, 0.0694, 0.0850)])
@pytest.mark.parametrize("small", [0.01, 0.004])
def test_a_secondary_canard_is_not_called_weak_where_the_curves_end_before_that(
    k, weak, secondary, small
) -> None:
    # To leading order gamma_w is y = a z with the lesser a of 2 a^2 - 11 a/10 + k = 0, so that x = epsilon a at z = 0.
    bent = gsp.SlowFastSystem(
        slow={x: k * z - sp.Rational(11, 10) * y, z: 1 + y / 3}, fast={y: x + y**2 + y**3 / 4}, epsilon=epsilon
    )
    found = node(bent, x=(-2, 2), z=(-1, 1), y=(-1, 1))
    usual = gsp.folded_canards(found, epsilon=small)
    places = {c.name: c.point["x"] / small for c in usual.canards}
    assert places.pop("gamma_w", weak) == pytest.approx(weak, rel=0.01)
    assert places[f"xi_{usual.expected}"] == pytest.approx(secondary, rel=0.03)
    assert usual.missing == ()


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("end", "mixing", "small", "strong"),
    [
        (sp.Rational(-1, 2), "3/20", 0.003, 0.0035540816),
        (sp.Rational(3, 2), "3/20", 0.003, -0.0011773654),
        (sp.Rational(1, 2), "1/8", 0.003, -0.0033986772),
        (sp.Rational(-1, 5), "1/8", 0.003, 0.0089099535),
        (sp.Rational(4, 5), "1/8", 0.01, -0.0070982743),
    ],
)
def test_where_another_folded_point_bounds_the_funnel_the_strong_canard_is_named_once_and_no_other_is_claimed(
    end: sp.Rational, mixing: str, small: float, strong: float
) -> None:
    # A folded saddle at z = `end`: one curve unwinds beyond it, and passes where it came from.
    system = gsp.SlowFastSystem(
        slow={x: sp.Rational(mixing) * z * (1 - z / end) - sp.Rational(13, 10) * y, z: 1},
        fast={y: x + y**2},
        epsilon=epsilon,
    )
    found = gsp.folded_canards(node(system, x=(-1, 1), z=(-0.1, 0.1), y=(-1, 1)), epsilon=small)
    assert [c.name for c in found.canards] == ["gamma_0"]
    assert found["gamma_0"].point["y"] == pytest.approx(strong, abs=1e-9)
    assert "beyond the ends of the curves" in found.message


def test_a_change_of_variables_changes_nothing() -> None:
    # u = 2 x + z, w = z - 3 x and the fast variable -4 y; the same canards take the same time.
    u, w, f = sp.symbols("u w f")
    mu = sp.Rational(3, 10)
    back = {x: (u - w) / 5, z: (3 * u + 2 * w) / 5, y: -f / 4}
    rates = [(mu * z / 2 - (mu + 1) * y).xreplace(back), sp.Integer(1)]
    disguised = gsp.SlowFastSystem(
        slow={w: rates[1] - 3 * rates[0], u: 2 * rates[0] + rates[1]},
        fast={f: -4 * (x + y**2).xreplace(back)},
        epsilon=epsilon,
    )
    plain = gsp.folded_canards(
        node(normal_form(mu), y=(-1, 1)), epsilon=0.01, attracting={"y": -0.5}, repelling={"y": 0.5}
    )
    other = gsp.folded_canards(
        node(disguised, f=(-1, 1)), epsilon=0.01, attracting={"f": 2}, repelling={"f": -2}
    )
    assert [c.name for c in other.canards] == [c.name for c in plain.canards]
    for a, b in zip(plain.canards, other.canards):
        assert a.orbit.time == pytest.approx(b.orbit.time, rel=1e-7)


def test_the_weak_canard_is_found_where_the_curves_stand_still_before_they_cross() -> None:
    """At mu = 1/10 they touch at gamma_w and end 1e-13 beside each other; their last crossing was xi_4."""
    found = gsp.folded_canards(node(normal_form(sp.Rational(1, 10)), y=(-1, 1)), epsilon=0.01)
    assert [c.name for c in found.canards] == ["gamma_0", "xi_1", "xi_2", "xi_3", "xi_4", "gamma_w"]
    assert found.touching
    assert found["gamma_w"].point["x"] == pytest.approx(0.1 * 0.01 / 2, abs=1e-7)


def test_a_node_at_roots_of_polynomials_is_where_it_is_in_any_units() -> None:
    """SymPy writes such roots with an x, as if it were the state of that name; in its units they were others."""
    size = sp.Rational(1, 10**6)
    renamed = {v: x / size, h: y / size, s: z / size}
    slow, fast = (
        {symbol.xreplace({v: x, h: y, s: z}): size * e.xreplace(renamed) for symbol, e in part.items()}
        for part in (FITZHUGH_NAGUMO.slow, FITZHUGH_NAGUMO.fast)
    )
    system = gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    frame = in_own_units(frame_at(node(system, x=(-1e-6, 0)), epsilon=0.015))
    plain = node(FITZHUGH_NAGUMO, v=(-1, 0))
    place = [float(plain.point[name]) * 1e-6 for name in "hsv"]
    assert frame.units.back.of(frame.point) == pytest.approx(np.array(place), rel=1e-12)


@pytest.mark.parametrize(("mu", "length"), [("3/20", 10**6), ("19/200", 1)])
def test_curves_that_cross_at_a_wide_angle_do_not_touch(mu: str, length: int) -> None:
    """Newton's method ends in rounding at gamma_w, in some units: its curves cross at right angles, nearly."""
    inner = {s: length * s for s in (x, y, z)}
    slow, fast = (
        {s: sp.expand(e.xreplace(inner) / length) for s, e in part.items()}
        for part in (normal_form(sp.Rational(mu)).slow, normal_form(sp.Rational(mu)).fast)
    )
    system = gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    found = gsp.folded_canards(node(system, y=(-1 / length, 1 / length)), epsilon=0.01)
    assert not found.touching
    assert "touch" not in found.message
    place = 0.005 * float(sp.Rational(mu))
    assert length * found["gamma_w"].point["x"] == pytest.approx(place, abs=1e-9)
    assert found["gamma_w"].error < 1e-8


@pytest.mark.parametrize("far", [1000, -(10**6)])
def test_far_from_the_origin_the_canards_are_the_same(far: int) -> None:
    """Their curves were said to touch at gamma_w, and at 10^6 gamma_0 was off by six times its error."""
    mu, place = sp.Rational(3, 20), {x: x - far, y: y + 2 * far, z: z - 3 * far}
    slow, fast = (
        {s: e.xreplace(place) for s, e in part.items()} for part in (normal_form(mu).slow, normal_form(mu).fast)
    )
    system = gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    singularity = node(system, y=(-2 * far - 1, -2 * far + 1))
    found = gsp.folded_canards(singularity, epsilon=0.01, attracting={"y": -2 * far - 0.5})
    assert [c.name for c in found.canards] == ["gamma_0", "xi_1", "xi_2", "gamma_w"]
    assert not found.touching
    assert found.section == ("z", 3 * far)
    rounding = 2 * np.spacing(3.0 * abs(far))
    assert found["gamma_0"].point["x"] - far == pytest.approx(0.005, abs=rounding)
    assert found["gamma_w"].point["x"] - far == pytest.approx(0.00075, abs=rounding)
    assert max(c.error for c in found.canards) < 1e-9
    assert found.attracting.line.value == -2 * far - 0.5
    assert found.repelling.ends[:, 1] == pytest.approx(-2.0 * far, abs=1)
    family = gsp.follow_canard(found["xi_1"], epsilon=(0.0098, 0.0102))
    assert family["z"] == pytest.approx(3 * far, abs=rounding)
    # In the normal form x is as large as epsilon.
    np.testing.assert_allclose(family["x"] - far, -0.100240089 * family.epsilon, rtol=0, atol=rounding + 1e-8)


@pytest.mark.parametrize(
    "units",
    [(1, 1, 10**6), (sp.Rational(1, 10**6), sp.Rational(1, 10**3), sp.Rational(1, 10**3)), (10**3, 10**6, 1)],
)
def test_units_of_the_states_change_nothing(units) -> None:
    """In the first the strong canard began beside it, and gamma_0 was lost; in the second no orbit met the section."""
    mu, smooth = sp.Rational(7, 20), normal_form(sp.Rational(7, 20))
    sizes = dict(zip((x, z, y), map(sp.sympify, units)))
    inner = {s: s * unit for s, unit in sizes.items()}
    slow, fast = (
        {s: e.xreplace(inner) / sizes[s] for s, e in part.items()} for part in (smooth.slow, smooth.fast)
    )
    box = (-1 / float(sizes[y]), 1 / float(sizes[y]))
    system = gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=epsilon)
    found = gsp.folded_canards(node(system, y=box), epsilon=0.01)
    assert [c.name for c in found.canards] == ["gamma_0", "gamma_w"]
    assert found.section == ("z", 0.0)
    for canard, place in zip(found.canards, (0.005, 0.01 * float(mu) / 2)):
        assert canard.point["x"] * float(sizes[x]) == pytest.approx(place, rel=1e-9)
        family = gsp.follow_canard(canard, epsilon=(0.0095, 0.0105))
        np.testing.assert_allclose(family["x"] * float(sizes[x]), family.epsilon * place / 0.01, rtol=1e-8)
    # Where both sheets end, in the model's units.
    ends = found.attracting.ends * [float(sizes[x]), float(sizes[y])]
    assert np.abs(ends).max() < 1.0
    assert found.repelling.line.value * float(sizes[y]) == pytest.approx(0.451, abs=0.01)


# -- Koper's model ---------------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_koper_has_its_strong_and_six_secondary_canards(koper: gsp.CanardOrbits) -> None:
    assert koper.expected == 6
    assert koper.missing == ()
    assert koper.status.ok
    assert [c.half_turns for c in koper.canards[:7]] == [1, 3, 5, 7, 9, 11, 13]
    assert koper.message == "7 of 7 canards that turn"


@pytest.mark.exhaustive
def test_crossing_curves_and_orbits_from_line_to_line_agree(koper: gsp.CanardOrbits) -> None:
    for canard in koper.canards:
        assert canard.crossing_gap < 1e-3
        assert canard.error < 1e-9
        assert canard.residual < 1e-5


@pytest.mark.exhaustive
def test_other_lines_on_the_critical_manifold_give_the_same_canards(koper: gsp.CanardOrbits) -> None:
    other = gsp.folded_canards(koper.singularity, epsilon=0.01, attracting={"x": 1.7}, repelling={"x": 0.3})
    assert min(other.attracting.contraction, other.repelling.contraction) > 30
    for a, b in zip(koper.canards, other.canards):
        assert a.name == b.name
        assert np.allclose(list(a.point.values()), list(b.point.values()), rtol=0, atol=1e-9)


@pytest.mark.exhaustive
def test_another_section_meets_the_same_orbits(koper: gsp.CanardOrbits) -> None:
    other = gsp.folded_canards(koper.singularity, epsilon=0.01, section={"z": 0.7985})
    for name in ("gamma_0", "xi_1", "xi_4"):
        a, b = koper[name], other[name]
        t = a.time_before - b.time_before
        assert np.allclose(a.at(-t), list(b.point.values()), rtol=0, atol=1e-9)


def test_integration_arrives_where_the_orbits_cross_the_section(koper: gsp.CanardOrbits) -> None:
    # Forward from the attracting line and backward from the repelling one the fast direction contracts.
    for name in ("gamma_0", "xi_2"):
        canard = koper[name]
        for start, time in (
            (canard.orbit.start, canard.time_before),
            (canard.orbit.end, -canard.time_after),
        ):
            run = gsp.integrate(
                koper.system,
                start=dict(zip("yzx", start)),
                span=(0.0, time),
                epsilon=0.01,
                rtol=1e-11,
                atol=1e-12,
            )
            assert np.allclose(run.y[:, -1], list(canard.point.values()), rtol=0, atol=1e-6)


@pytest.mark.exhaustive
def test_a_canard_followed_in_epsilon_is_the_one_found_there(koper: gsp.CanardOrbits) -> None:
    family = gsp.follow_canard(koper["xi_3"], epsilon=(2e-3, 0.012))
    assert family.ends == (FamilyEnd.BOUND, FamilyEnd.BOUND)
    assert family.folds == ()
    assert family.epsilon[0] == pytest.approx(2e-3, rel=1e-12)
    there = gsp.folded_canards(
        koper.singularity,
        epsilon=2e-3,
        attracting={"x": koper.attracting.line.value},
        repelling={"x": koper.repelling.line.value},
    )["xi_3"]
    assert family["x"][0] == pytest.approx(there.point["x"], abs=1e-9)
    assert family["y"][0] == pytest.approx(there.point["y"], abs=1e-9)


# -- the self-coupled FitzHugh-Nagumo system -------------------------------------------------------


@pytest.mark.exhaustive
def test_the_folded_node_of_the_self_coupled_neuron(neuron: gsp.CanardOrbits) -> None:
    place = {name: float(value) for name, value in neuron.singularity.point.items()}
    assert place["v"] == pytest.approx(-0.49001, abs=1e-5)
    assert place["h"] == pytest.approx(0.61766, abs=1e-5)
    assert place["s"] == pytest.approx(0.27967, abs=1e-5)
    assert neuron.expected == 27


@pytest.mark.exhaustive
def test_canards_of_the_neuron_are_found_where_they_were_matched_by_hand(neuron: gsp.CanardOrbits) -> None:
    times = np.array(
        [[neuron[f"xi_{k}"].time_before / 0.015, neuron[f"xi_{k}"].time_after / 0.015] for k in range(3, 9)]
    )
    assert np.abs(times / MATCHED_BY_HAND - 1).max() < 3e-4
    assert neuron["xi_3"].point["h"] == pytest.approx(0.4355466, abs=1e-6)
    assert neuron["xi_3"].point["v"] == pytest.approx(-0.9509381, abs=1e-6)


@pytest.mark.exhaustive
def test_the_neuron_has_its_secondary_canards_through_the_last(neuron: gsp.CanardOrbits) -> None:
    turns = {c.index: c.half_turns for c in neuron.canards if c.index is not None}
    assert all(turns[k] == 2 * k + 1 for k in range(3, 28))
    # The strong canard and the first two begin beyond the section at this epsilon.
    assert neuron.missing == ("gamma_0", "xi_1", "xi_2")
    assert "gamma_0 to xi_2 do not cross the section" in neuron.message
    assert all(c.error < 1e-8 for c in neuron.canards)


@pytest.mark.exhaustive
def test_the_missing_canards_of_the_neuron_are_there_at_a_smaller_epsilon() -> None:
    found = gsp.folded_canards(node(FITZHUGH_NAGUMO, v=(-1, 0)), epsilon=0.003)
    assert {"gamma_0", "xi_1", "xi_2"} <= {c.name for c in found.canards}
    assert found.attracting.inner is SheetEnd.STILL


@pytest.mark.exhaustive
def test_the_canard_of_the_neuron_turns_round_in_epsilon(neuron: gsp.CanardOrbits) -> None:
    family = gsp.follow_canard(neuron["xi_3"], epsilon=(0.0149, 0.08), max_points=118)
    # As read off the demo's published diagram, and to more digits; beyond the second one the orbit has grown an
    # excursion while its ends stood still.
    assert family.folds[:2] == pytest.approx([0.0525, 0.0473], abs=2e-4)
    assert family.folds[:2] == pytest.approx([0.0524826841, 0.0473373495], abs=1e-8)
    assert family.status is gsp.Status.TOO_MANY_STEPS


# -- the work is bounded ---------------------------------------------------------------------------


def test_a_sheet_ends_when_its_newton_steps_are_used_up(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["gsp.orbits.canard_orbits.sheet"], "WORK", 5000)
    found = gsp.folded_canards(node(normal_form(sp.Rational(3, 10)), y=(-1, 1)), epsilon=0.01)
    assert found.attracting.inner is SheetEnd.WORK
    assert found.status is gsp.Status.TOO_MANY_STEPS
    assert "the allowed number of Newton steps was used up" in found.message
    # One segment more than allowed each way, of at most 480 elements and 3 x 8 steps.
    assert sum(len(sheet.segments) for sheet in (found.attracting, found.repelling)) < 60


@pytest.mark.exhaustive
def test_crossings_are_looked_at_until_the_work_allowed_is_used_up(
    koper: gsp.CanardOrbits, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys.modules["gsp.orbits.canard_orbits.canard_finder"], "WORK", 3000)
    found = gsp.folded_canards(koper.singularity, epsilon=0.01)
    assert 1 <= len(found) < len(koper)
    assert found.exhausted
    assert found.status is gsp.Status.TOO_MANY_STEPS
    assert "the work allowed for the crossings was used up" in found.message
    # The outermost come first, and are those of the whole search.
    assert found["gamma_0"].point == pytest.approx(koper["gamma_0"].point, abs=1e-9)


def test_curves_that_run_along_each_other_have_a_bounded_number_of_crossings(koper: gsp.CanardOrbits) -> None:
    canard = sys.modules["gsp.orbits.canard_orbits.canard"]
    # A curve crosses itself wherever it is: the chords are parallel, or meet at their ends.
    found, _ = canard.crossings(koper.attracting, koper.attracting)
    assert len(found) <= canard.MOST_CROSSINGS
    few, all_of_them = canard.crossings(koper.attracting, koper.repelling)
    assert all_of_them
    assert len(few) == 8


# -- wrong calls -----------------------------------------------------------------------------------


def test_what_is_no_folded_node_is_named() -> None:
    saddle = node(normal_form(sp.Rational(-1, 5)), y=(-1, 1))
    with pytest.raises(FoldedError, match="folded saddle has one canard"):
        gsp.folded_canards(saddle, epsilon=0.01)
    focus = node(gsp.SlowFastSystem(slow={x: z - y, z: 1}, fast={y: x + y**2}, epsilon=epsilon), y=(-1, 1))
    with pytest.raises(FoldedError, match="no canards: every orbit jumps"):
        gsp.folded_canards(focus, epsilon=0.01)
    faux = node(
        gsp.SlowFastSystem(slow={x: 3 * z / 20 + 13 * y / 10, z: 1}, fast={y: x + y**2}, epsilon=epsilon),
        y=(-1, 1),
    )
    with pytest.raises(FoldedError, match="faux canards"):
        gsp.folded_canards(faux, epsilon=0.01)
    with pytest.raises(FoldedError, match="Got mu = 1: at a degenerate node"):
        gsp.folded_canards(node(normal_form(sp.Integer(1)), y=(-1, 1)), epsilon=0.01)


def test_sections_and_lines_that_do_not_fit_are_named(koper: gsp.CanardOrbits) -> None:
    singularity = koper.singularity
    with pytest.raises(gsp.GspError, match=r"221\.4 local units from the folded node"):
        gsp.folded_canards(singularity, epsilon=0.01, section={"z": 1.5})
    with pytest.raises(gsp.GspError, match="not crossed by the slow flow"):
        gsp.folded_canards(singularity, epsilon=0.01, section={"y": 0.9})
    with pytest.raises(gsp.GspError, match="section fixes one of y, z"):
        gsp.folded_canards(singularity, epsilon=0.01, section={"x": 1.0})
    with pytest.raises(CanardOrbitError, match="does not cross the line x = -3"):
        gsp.folded_canards(singularity, epsilon=0.01, attracting={"x": -3})


def test_bounds_that_do_not_hold_the_canard_are_named(koper: gsp.CanardOrbits) -> None:
    with pytest.raises(gsp.GspError, match=r"enclose the canard\'s own epsilon = 0\.01"):
        gsp.follow_canard(koper["gamma_0"], epsilon=(0.02, 0.03))
    with pytest.raises(gsp.GspError, match="there is no canard 'xi_9' here"):
        koper["xi_9"]


def test_where_epsilon_is_too_large_for_the_node_nothing_is_claimed(koper: gsp.CanardOrbits) -> None:
    found = gsp.folded_canards(koper.singularity, epsilon=1.0)
    assert len(found) == 0
    assert "come nearer by 1.2 powers of e only" in found.message


def test_charts_of_canards_are_drawn(koper: gsp.CanardOrbits) -> None:
    from gsp import charts

    assert charts.canard_section(koper).get_xlabel() == "$y$"
    assert charts.canard_orbits(koper).name == "3d"
