"""Critical rates of several states: formulas in turned coordinates, published thresholds, and runs on both sides."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import gsp
from gsp.singular.ramps.critical_rate import TippingVerdict
from gsp.singular.ramps.ramped import RampError
from gsp.singular.ramps.section import Passage, matched
from gsp.systems.ramp import PHASE, Ramp

x, y, z, l, mu = sp.symbols("x y z l mu")  # noqa: E741
PARABOLA = (x + l) ** 2 - mu


def turned(rates: dict[sp.Symbol, sp.Expr], scale: sp.Expr = sp.S.One) -> tuple[gsp.VectorField, sp.Matrix]:
    """The field in coordinates U with X = M U, and M."""
    states = list(rates)
    n = len(states)
    M = sp.Matrix(n, n, lambda i, j: 1 if i == j else sp.Rational(i - 2 * j, 3)) * sp.diag(
        *([1] * (n - 1)), scale
    )
    old = dict(zip(states, M * sp.Matrix(states)))
    new = M.LUsolve(sp.Matrix([sp.sympify(r).xreplace(old) for r in rates.values()]))
    field = gsp.VectorField(dict(zip(states, new)), epsilon=None, parameters={l: 0, mu: 1})
    return field, M


def in_turned(M: sp.Matrix, point: list[float]) -> dict[str, float]:
    return {s.name: float(v) for s, v in zip((x, y, z), M.LUsolve(sp.Matrix(point)))}


@pytest.mark.exhaustive
@pytest.mark.parametrize(("m", "length"), [(1, 3), (1, 2.5), (0.25, 4), (3, 3.6)])
@pytest.mark.parametrize("decay", [-3, -sp.Rational(1, 5)])
def test_a_parabola_among_other_states_has_its_rate(m: float, length: float, decay: sp.Expr) -> None:
    """r_c = 4 mu/(L (L - 2 sqrt(mu))), whatever y does that x does not feel, in turned coordinates."""
    field, M = turned({x: PARABOLA, y: decay * (y - x * l)})
    root = m**0.5
    found = gsp.critical_rate(
        field.with_parameters(mu=m), ramp=Ramp.logistic({l: (0, length)}), start=in_turned(M, [-root, 0]),
        edge=in_turned(M, [root - length, (root - length) * length]),
    )  # fmt: skip
    exact = 4 * m / (length * (length - 2 * root))
    assert found.verdict is TippingVerdict.ABOVE
    assert found.rates == (pytest.approx(exact, rel=1e-10),)
    assert found.error is not None
    assert abs(found.rates[0] - exact) <= 10 * found.error + 1e-12 * exact


@pytest.mark.exhaustive
def test_three_states_in_units_far_apart() -> None:
    field, M = turned({x: PARABOLA, y: -y + x / 2, z: -2 * z + y * x}, scale=sp.Rational(1, 10**6))
    edge = [-2, -1, 1]
    found = gsp.critical_rate(
        field, ramp={l: l * (3 - l)}, start={**in_turned(M, [-1, -sp.Rational(1, 2), sp.Rational(1, 4)]), "l": 0},
        edge={**in_turned(M, edge), "l": 3},
    )  # fmt: skip
    assert found.rates == (pytest.approx(4 / 3, rel=1e-10),)


RAMPS = {
    "tanh": Ramp.tanh({l: (0, 3)}),
    "there and back": Ramp.there_and_back({l: (0, 5)}),
    "linear with ends": Ramp.linear_with_ends({l: (0, 3)}),
    "sech and stop": Ramp({l: 3 * sp.sin(PHASE)}, sp.sin(PHASE), (0, sp.pi / 2)),
}


@pytest.mark.parametrize("name", RAMPS)
def test_one_state_and_several_agree_on_every_kind_of_ramp(name: str) -> None:
    """Collocation over the phase against runs that are matched at a section."""
    alone = gsp.VectorField({x: PARABOLA}, epsilon=None, parameters={l: 0, mu: 1})
    last = RAMPS[name].parameters[l].xreplace({PHASE: RAMPS[name].ends[1]})
    edge = [float(1 - last), float(1 - last) / 2]
    one = gsp.critical_rate(alone, ramp=RAMPS[name], start={"x": -1}, edge={"x": edge[0]})
    field, M = turned({x: PARABOLA, y: x - 2 * y})
    two = gsp.critical_rate(field, ramp=RAMPS[name], start=in_turned(M, [-1, -0.5]), edge=in_turned(M, edge))
    assert one.verdict is two.verdict
    assert two.rates == pytest.approx(one.rates, rel=1e-10)
    assert one.rates


def test_there_and_back_tips_in_a_window_of_rates() -> None:
    """Slow ramps are followed, fast ones are over before the state has moved."""
    alone = gsp.VectorField({x: PARABOLA}, epsilon=None, parameters={l: 0, mu: 1})
    found = gsp.critical_rate(alone, ramp=RAMPS["there and back"], start={"x": -1}, edge={"x": 1})
    assert (found.verdict, len(found.rates)) == (TippingVerdict.WINDOWS, 2)
    small = gsp.critical_rate(
        alone, ramp=RAMPS["there and back"].amplified(0.3), start={"x": -1}, edge={"x": 1}
    )
    assert small.verdict is TippingVerdict.NEVER


P, H, rho = sp.symbols("P H rho")
GRAZED = P**2 / (P**2 + 100) * sp.exp(-P / 40)
MORTALITY = (rho - sp.Rational(1, 2)) / 30 + sp.Rational(1, 8)
HERBIVORES = gsp.VectorField(
    {
        P: rho * P - P**2 / 50 - H * GRAZED,
        H: (sp.Rational(2, 5) * GRAZED * sp.exp(-P / 40) - MORTALITY) * H,
    },
    epsilon=None, parameters={rho: 0.5},
)  # fmt: skip
# The fold of the model, by which amplitudes are divided.
FOLD = sp.Rational(6966, 10000) - sp.Rational(1, 2)
HOME = {"P": 10.69, "H": 7.494}


def herbivores_edge(growth: float) -> dict[str, float]:
    """The saddle with herbivores: the larger P at which these live, and the H that it feeds."""
    rates = [e.xreplace({rho: sp.Float(growth)}) for e in (HERBIVORES.rates[1] / H, HERBIVORES.rates[0])]
    value = sp.lambdify(P, rates[0])
    plants = brentq(value, 13.5, 40.0)
    return {"P": plants, "H": float(sp.solve(rates[1].xreplace({P: sp.Float(plants)}), H)[0])}


# Peak change of growth over that of the fold, and rates per day at which it tips, of a sech that stays at its peak and
# of one that returns: figure 5 of Ritchie, Alkhayuon, Cox and Wieczorek, Earth Syst. Dynam. 14 (2023) 669-683, in its
# authors' table of data, made by runs and bisection with a relative tolerance of 1e-10.
STAYING = [(0.944427317984952, 0.00514175182768393), (0.456332873045051, 0.0599484250318941)]
RETURNING = [
    (0.944719175379306, 0.00514175182768393), (0.631539655497497, 0.026437611857491),
    (0.568675118242666, 0.0599484250318941), (1.13125961071341, 0.308239923974514),
]  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize(("change", "rate"), STAYING)
def test_published_rates_of_plants_and_herbivores(change: float, rate: float) -> None:
    peak = sp.Rational(1, 2) + FOLD * sp.Rational(str(change))
    ramp = Ramp(
        {rho: sp.Rational(1, 2) + (peak - sp.Rational(1, 2)) * sp.sin(PHASE)}, sp.sin(PHASE), (0, sp.pi / 2)
    )
    found = gsp.critical_rate(HERBIVORES, ramp=ramp, start=HOME, edge=herbivores_edge(float(peak)))
    assert found.verdict is TippingVerdict.ABOVE
    assert found.rates == (pytest.approx(rate, rel=2e-9),)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("change", "rate"), RETURNING)
def test_published_points_of_return_of_plants_and_herbivores(change: float, rate: float) -> None:
    peak = sp.Rational(1, 2) + FOLD * sp.Rational(str(change))
    found = gsp.critical_rate(
        HERBIVORES, ramp=Ramp.there_and_back({rho: (0.5, peak)}), start=HOME, edge=herbivores_edge(0.5)
    )
    assert found.verdict is (TippingVerdict.WINDOWS if change < 1 else TippingVerdict.BELOW)
    assert len(found.rates) == (2 if change < 1 else 1)
    assert min(abs(r / rate - 1) for r in found.rates) < 2e-9


@pytest.mark.exhaustive
def test_the_orbit_leads_to_the_edge() -> None:
    peak = 0.6
    found = gsp.critical_rate(
        HERBIVORES, ramp=Ramp.tanh({rho: (0.5, peak)}), start=HOME, edge=herbivores_edge(peak)
    )
    (orbit,) = found.connections
    assert found.edge is not None
    edge = np.array([found.edge["P"], found.edge["H"]])
    assert orbit.x[0] == pytest.approx([found.start["P"], found.start["H"]])
    assert np.abs(orbit.x / edge - 1).max(axis=1).min() < 1e-6


def test_an_attracting_end_is_no_edge() -> None:
    with pytest.raises(RampError, match="one unstable direction"):
        gsp.critical_rate(
            HERBIVORES, ramp=Ramp.tanh({rho: (0.5, 0.6)}), start=HOME, edge={"P": 11.55, "H": 9.95}
        )


def test_a_saddle_that_orbits_do_not_pass_has_no_rate() -> None:
    """Predators that die out at all rates: what changes is when, and the saddle without them is passed by no orbit."""
    y_, z_ = sp.symbols("y z")
    field = gsp.VectorField(
        {x: x * (x - l) * (1 - x) - x * y_ / 2, y_: y_ * (x / 2 - sp.Rational(3, 10) - y_ / 5), z_: x - z_},
        epsilon=None, parameters={l: 0.1},
    )  # fmt: skip
    found = gsp.critical_rate(
        field, ramp=Ramp.logistic({l: (0.1, 0.45)}), start={"x": 0.735, "y": 0.337, "z": 0.735},
        edge={"x": 1, "y": 0, "z": 1},
    )  # fmt: skip
    assert found.rates == ()


PREY, PREDATOR, A = sp.symbols("N P A")
EATEN = PREY / (sp.Rational(2, 5) + PREY)
PASSED = {
    # Beyond the edge it turns for ever, and passes rest points without number.
    "a generator that slips": (
        gsp.VectorField({x: y, y: l - sp.sin(x) - y / 10}, epsilon=None, parameters={l: sp.Rational(1, 5)}),
        Ramp.tanh({l: (sp.Rational(1, 5), sp.Rational(19, 20))}), {"x": 0.2, "y": 0}, {"x": 1.888, "y": 0}, 100,
    ),
    # The edge lies on the axis without predators, along which its unstable direction leads to another saddle.
    "an edge on an axis": (
        gsp.VectorField(
            {
                PREY: 4 * PREY * (1 - PREY) * (PREY - A) - PREDATOR * EATEN,
                PREDATOR: PREDATOR * (sp.Rational(6, 5) * EATEN - sp.Rational(102, 125)),
            },
            epsilon=None, parameters={A: sp.Rational(1, 20)},
        ),
        Ramp.tanh({A: (sp.Rational(1, 20), sp.Rational(1, 2))}), {"N": 0.85, "P": 0.6}, {"N": 0.5, "P": 0}, 400,
    ),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", PASSED)
def test_where_orbits_beside_the_edge_go_is_told(name: str) -> None:
    field, ramp, start, edge, after = PASSED[name]
    found = gsp.critical_rate(field, ramp=ramp, start=start, edge=edge)
    assert (found.verdict, len(found.rates)) == (TippingVerdict.ABOVE, 1)
    assert found.rate is not None
    first = field.states[0].name
    ends = [found.run(factor * found.rate, after=after)[first][-1] for factor in (1 - 1e-6, 1 + 1e-6)]
    home = {"x": np.arcsin(0.95), "N": 0.85}[first]
    assert ends[0] == pytest.approx(home, abs=0.05)
    assert abs(ends[1] - home) > 0.5


@pytest.mark.exhaustive
def test_an_edge_that_is_a_cycle_is_asked_about_by_a_level() -> None:
    """Inside the cycle |z - l| = 1 the state comes home, beyond it it blows up: where the ramp ends, that decides."""
    offset = x - l
    rate = 1 - offset**2 - y**2
    field = gsp.VectorField({x: -offset * rate - y, y: -y * rate + offset}, epsilon=None, parameters={l: 0})
    ramp, start = Ramp.linear_with_ends({l: (0, 3)}), {"x": 0, "y": 0}
    with pytest.raises(RampError, match="a cycle name a level of one state beyond it"):
        gsp.critical_rate(field, ramp=ramp, start=start, edge={"x": 4, "y": 0})
    found = [gsp.critical_rate(field, ramp=ramp, start=start, edge={"x": level}) for level in (5, 20)]

    def beyond(r: float) -> float:
        def rates(t: float, u: np.ndarray) -> list[float]:
            d = u[0] - r * t
            decay = 1 - d * d - u[1] ** 2
            return [-d * decay - u[1], -u[1] * decay + d]

        end = solve_ivp(rates, (0, 3 / r), [0.0, 0.0], rtol=1e-12, atol=1e-14).y[:, -1]
        return float(np.hypot(end[0] - 3, end[1]) - 1)

    wanted = brentq(beyond, 0.3, 0.9, xtol=1e-14)
    assert [f.rate for f in found] == pytest.approx([wanted] * 2, rel=1e-9)
    assert all(f.verdict is TippingVerdict.ABOVE for f in found)


ALLEE = {
    PREY: 4 * PREY * (1 - PREY) * (PREY - sp.Rational(3, 20))
    - 3 * PREY * PREDATOR / (2 + sp.Rational(6, 5) * PREY),
    PREDATOR: 6 * PREY * PREDATOR / (5 + 3 * PREY) - A * PREDATOR,
}


def allee(prey: int = 0, predator: int = 0, *, reverse: bool = False) -> gsp.VectorField:
    """A predator of prey with an Allee effect, in units of these powers of 10."""
    units = {PREY: sp.Integer(10) ** prey, PREDATOR: sp.Integer(10) ** predator}
    back = {z: z * unit for z, unit in units.items()}
    rates = {z: rate.xreplace(back) / units[z] for z, rate in ALLEE.items()}
    return gsp.VectorField(
        dict(reversed(rates.items())) if reverse else rates, epsilon=None, parameters={A: 0.7}
    )


@pytest.mark.parametrize(
    ("prey", "predator", "reverse"),
    [(0, 0, False)] + [pytest.param(*case, marks=pytest.mark.exhaustive)
                       for case in ((0, 0, True), (-3, 0, False), (0, -1, False), (0, 2, True), (3, 3, False))],
)  # fmt: skip
def test_what_rounding_decides_is_no_critical_rate(prey: int, predator: int, reverse: bool) -> None:
    """Where the ramp turns back the rest point does not attract. Slow ramps stay there so long that rounding decides
    how double precision leaves; with 200 digits 0.002 and 0.003 come back. Beside the edge runs stay off the axis."""
    field = allee(prey, predator, reverse=reverse)
    start, edge = {"N": 0.897 * 10.0**-prey, "P": 0.3145 * 10.0**-predator}, {"N": 0.15 * 10.0**-prey, "P": 0}
    found = gsp.critical_rate(field, ramp=Ramp.there_and_back({A: (0.7, 0.5)}), start=start, edge=edge)
    assert found.verdict is TippingVerdict.WINDOWS
    assert found.rates == pytest.approx((0.117666666, 0.240134817), rel=1e-8)
    assert max(found.errors) < 1e-12
    for rate, size in ((0.112, 1), (0.122, 0), (0.23, 0), (0.25, 1)):
        assert found.run(rate, after=3000.0)["N"][-1] * 10.0**prey == pytest.approx(0.8974359 * size, abs=1e-3)


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_coin_beyond_an_end_of_the_bracket_is_seen(side: float) -> None:
    """At 1, an end, runs end on the one side, and within the bracket on the other; beyond, as a coin has it."""

    def gap(rate: float) -> float:
        beyond = side * (rate - 1.0)
        return -1e-9 if beyond == 0.0 or (beyond < 0.0 and np.sin(1e9 * rate) < 0.0) else 1.0

    passage = cast("Passage", SimpleNamespace(gap=gap, orbit=lambda rate: (np.zeros((2, 1)), np.zeros(2))))
    assert matched(passage, *sorted((1.0, 1.0 + side))) is None


def test_a_ramp_to_where_the_rest_point_does_not_attract_always_tips() -> None:
    start, edge = {"N": 0.897, "P": 0.3145}, {"N": 0.15, "P": 0}
    found = gsp.critical_rate(allee(), ramp=Ramp.tanh({A: (0.7, 0.5)}), start=start, edge=edge)
    assert (found.verdict, found.rates) == (TippingVerdict.ALWAYS, ())
    with pytest.raises(RampError, match="at any rate the state leaves it"):
        gsp.critical_rate(allee(), ramp=Ramp.tanh({A: (0.7, 0.5)}), start=start, edge={"N": 0.1})


@pytest.mark.exhaustive
def test_among_windows_without_end_no_single_rate_is_the_one_above_which_ramps_tip() -> None:
    """Lorenz's equations with rho from 4 to 20: between rates that tip others do not, down to the finest."""
    rho_ = sp.Symbol("R")
    field = gsp.VectorField(
        {x: 10 * (y - x), y: x * (rho_ - A) - y, A: x * y - sp.Rational(8, 3) * A},
        epsilon=None,
        parameters={rho_: 4},
    )
    start = {"x": 8**0.5, "y": 8**0.5, "A": 3}
    found = gsp.critical_rate(
        field, ramp=Ramp.tanh({rho_: (4, 20)}), start=start, edge={"x": 0, "y": 0, "A": 0}
    )
    # Which of them are found differs between processors, as chaotic runs do.
    assert found.verdict in (TippingVerdict.WINDOWS, TippingVerdict.UNDECIDED)
    assert "runs end differently where no orbit from the start meets the edge" in found.message


def test_a_ramp_to_a_level_is_run_at_any_rate() -> None:
    """An excitable state comes back to rest when the ramp is over, and has been beyond the level above the rate."""
    w = sp.Symbol("w")
    field = gsp.VectorField(
        {x: 20 * (x - x**3 / 3 - w + l), w: x + sp.Rational(7, 10) - sp.Rational(4, 5) * w},
        epsilon=None,
        parameters={l: 0},
    )
    found = gsp.critical_rate(
        field, ramp=Ramp.tanh({l: (0, sp.Rational(3, 10))}), start={"x": -1.2, "w": -0.62}, edge={"x": 1}
    )
    assert found.verdict is TippingVerdict.ABOVE
    assert not found.has_chart
    runs = [found.run(found.rate * factor) for factor in (0.99, 1.01)]
    assert [run["x"].max() > 1 for run in runs] == [False, True]
    rest = brentq(lambda v: v - v**3 / 3 - (v + 0.7) / 0.8 + 0.3, -1.5, -0.5)
    assert [run["x"][-1] for run in runs] == pytest.approx([rest, rest], abs=1e-3)


def beside(end: float, far: int = 0) -> gsp.CriticalRate:
    """A parabola that is coupled to another state, with its parameter `far` from 0, along r l (end - l)/2."""
    moved = l - far
    field = gsp.VectorField(
        {x: (x + moved) ** 2 - 1 + y / 5, y: -y + (x + moved) / 4}, epsilon=None, parameters={l: far}
    )
    return gsp.critical_rate(
        field, ramp={l: moved * (sp.nsimplify(end) - moved) / 2}, start={"x": -1, "y": -0.3, "l": far},
        edge={"x": 1 - end, "y": 0.25, "l": far + end},
    )  # fmt: skip


@pytest.mark.parametrize("end", [3.1, 2.7])
def test_a_profile_that_vanishes_at_a_decimal_rests_there(end: float) -> None:
    """The same ramp as `Ramp.logistic` makes, whose rate counts twice."""
    found, field = beside(end), beside(end).ramped.source
    assert isinstance(field, gsp.VectorField)
    whole = gsp.critical_rate(
        field, ramp=Ramp.logistic({l: (0, end)}), start={"x": -1, "y": -0.3}, edge={"x": 1 - end, "y": 0.25}
    )
    assert found.verdict is TippingVerdict.ABOVE
    assert found.rates == (pytest.approx(2 * whole.rates[0], rel=1e-12),)


def test_a_parameter_far_from_0_has_the_same_rate() -> None:
    """Its start was no rest point at 10**6, and at -10**6 windows were told."""
    near = beside(3)
    assert near.verdict is TippingVerdict.ABOVE
    for far in (10**6, -(10**6)):
        found = beside(3, far)
        assert found.verdict is near.verdict
        assert found.rates == pytest.approx(near.rates, rel=1e-12)
