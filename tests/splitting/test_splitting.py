"""Splitting: known answers, disguised systems that are recovered, and fields that are refused with the term."""

from __future__ import annotations

import numpy as np
import pytest
import sympy as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from gsp.algebra.laurent import laurent
from gsp.errors import DeclarationError, SplittingError
from gsp.splitting import slow_coordinates
from gsp.splitting.splitting import Splitting, split
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, u, v, w, a, k, eps = sp.symbols("x y z u v w a k epsilon")


def field(rates, **parameters) -> VectorField:
    return VectorField(rates, epsilon=eps, parameters={sp.Symbol(n): value for n, value in parameters.items()})


def assert_recombines(result: Splitting) -> None:
    """Coordinates after inverse are the identity, and the new field pulled back is the raw field."""
    assert result.system is not None
    raw = result.field
    point = {s: sp.Rational(2 * i + 3, 2 * i + 5) for i, s in enumerate((*raw.states, *raw.parameters, eps))}
    inverse = dict(result.inverse)
    new_point = {s: phi.subs(point) for s, phi in result.coordinates.items()}
    numbers = {s: value for s, value in point.items() if s not in raw.states} | new_point
    for state in raw.states:
        assert abs(sp.N(inverse[state].subs(numbers) - point[state], 30)) < 1e-20
    rates = dict(zip(result.system.states, result.system.rates))
    for symbol, phi in result.coordinates.items():
        along = sum(sp.diff(phi, s) * rate for s, rate in zip(raw.states, raw.rates))
        assert abs(sp.N(along.subs(point) - rates[symbol].subs(numbers), 30)) < 1e-20


def test_the_sleighs_slow_momentum_is_found_from_its_raw_variables() -> None:
    omega, m, inertia = sp.symbols("omega m I")
    J = inertia + m * a**2
    rates = {
        v: omega * w + a * omega**2,
        omega: a * w / (inertia * eps),
        w: -v * omega - J * w / (inertia * m * eps),
    }
    result = split(field(rates, m=1, I=1, a=0.2))
    assert [s.name for s in result.coordinates] == ["v", "p", "w"]
    p = sp.Symbol("p")
    assert sp.expand(result.coordinates[p] - (J * omega + m * a * w)) == 0
    assert sp.simplify(result.system.slow[p] + m * a * v * result.inverse[omega]) == 0
    assert sp.simplify(result.fast_jacobian[0] + J / (inertia * m)) == 0
    assert "linear first integral" in result.explain()
    assert_recombines(result)


def test_one_first_integral_and_several_are_told_in_words() -> None:
    b, c = sp.symbols("b c")
    one = split(field({a: -(a - b) / eps, b: (a - b) / eps - b}))
    assert "so p is a linear first integral of the layer problem" in one.explain()
    assert repr(one) == "Splitting(slow: p = a + b; fast: a)"
    two = split(field({a: -(a - b) / eps, b: (a - b) / eps - b, c: 2 * (a - b) / eps}))
    assert "so p1, p2 are linear first integrals of the layer problem" in two.explain()
    assert "Conserved: p2 = 2*a + c, for p2' = 0." in two.explain()
    assert repr(two) == "Splitting(slow: p1 = a + b, p2 = 2*a + c; fast: a)"


def test_a_standard_form_is_only_relabelled() -> None:
    result = split(field({y: (x - y**3) / eps, x: y - x}))
    assert dict(result.coordinates) == {x: x, y: y}
    assert result.system == SlowFastSystem(slow={x: y - x}, fast={y: x - y**3}, epsilon=eps)
    assert "standard form already" in result.explain()


def test_a_system_in_standard_form_may_be_split_too() -> None:
    system = SlowFastSystem(slow={x: y}, fast={y: x - y + eps * x}, epsilon=eps)
    assert split(system).system == system


def test_a_field_in_fast_time_is_put_in_slow_time() -> None:
    result = split(field({x: eps * (y - x), y: x - y + eps * y}))
    assert result.rescaled
    assert result.system == SlowFastSystem(slow={x: y - x}, fast={y: x - y + eps * y}, epsilon=eps)
    assert "fast time" in result.explain().splitlines()[0]


@pytest.mark.parametrize(
    ("rates", "slow"),
    [
        ({x: (x + y / eps) * (1 + eps * x), y: -x - y / eps}, x + y),
        ({x: y - x, y: (x - y) / (eps + eps**2)}, x),
        ({x: y / eps - y / (eps + eps**2), y: (x - y) / eps}, x),
        ({x: (y - x) / eps, y: (x - y) / eps - y}, x + y),
        ({x: ((y - x) + eps) ** 2 / (eps * (y - x + 2)), y: -(y - x) / eps}, None),
    ],
)
def test_poles_that_hide_in_products_are_split(rates, slow) -> None:
    result = split(field(rates))
    if slow is not None:
        assert_recombines(result)
        assert result.coordinates[result.system.x[0]] == slow
    total = result.N * result.layer / eps + result.drift
    for given_rate, found in zip(rates.values(), total):
        assert sp.cancel(given_rate - found) == 0


NONLINEAR = {
    "quadratic": ({x: -2 * y * (y - z) / eps + z, y: (z - y) / eps + x, z: -z}, "nonlinear"),
    "cubic": ({x: 3 * y**2 * (z - y) / eps + x, y: (z - y) / eps, z: x - z}, "nonlinear"),
    "exponential": ({x: x * (z - y) / eps + 1, y: (z - y) / eps, z: -z}, "nonlinear"),
    "logarithmic": ({x: (z - y) / (y * eps) + 1, y: y * (z - y) / eps, z: -z}, "nonlinear"),
    "two integrals": (
        {x: 2 * y * (z - y) / eps, y: (z - y) / eps, z: 3 * y**2 * (z - y) / eps + x},
        "nonlinear",
    ),
    "radial": ({x: -(x**2 + y**2 - 1) * x / eps - y, y: -(x**2 + y**2 - 1) * y / eps + x}, "nonlinear"),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", NONLINEAR)
def test_state_dependent_directions_are_split_by_nonlinear_integrals(case: str) -> None:
    rates, word = NONLINEAR[case]
    result = split(field(rates))
    assert result.is_standard
    assert word in result.route
    assert len(result.system.y) == 1
    assert_recombines(result)


def test_the_inverse_avoids_functions_of_restricted_domain() -> None:
    result = split(field({x: x * (z - y) / eps + 1, y: (z - y) / eps, z: -z}))
    assert result.coordinates[sp.Symbol("p")] == x * sp.exp(-y)
    assert result.to_raw(result.to_new({"x": -2.0, "y": 0.5, "z": 1.0})) == pytest.approx(
        {"x": -2, "y": 0.5, "z": 1}
    )


LOGARITHMS = {
    "small enzyme": ({x: (x + 1) * y / eps - x, y: -(x + 2) * y / eps + x}, (-1,)),
    "two lines": ({x: (x**2 - 4) * (y - x) / eps + 1, y: -(y - x) / eps}, (-2, 2)),
    "two lines, the other sign": ({x: (4 - x**2) * (y - x) / eps + 1, y: -(y - x) / eps}, (-2, 2)),
    "roots": ({x: (x**2 - 2) * (y - x) / eps + 1, y: -(y - x) / eps}, (-np.sqrt(2), np.sqrt(2))),
    "a quotient": ({x: x * (x - 2) * (y - x) / eps + 1, y: -(y - x) / eps}, (0, 2)),
    "a line of y": ({x: (y - x) * (2 - y) / (3 - y) / eps, y: -(y - x) / eps + 1}, (3,)),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", LOGARITHMS)
def test_integrals_with_logarithms_are_real_on_every_side_of_their_poles(case: str) -> None:
    rates, poles = LOGARITHMS[case]
    result = split(field(rates))
    assert result.system is not None
    (slow,) = result.system.x
    phi = result.coordinates[slow]
    assert phi.has(sp.log)
    assert sp.simplify(sum(sp.diff(phi, s) * rate for s, rate in zip((x, y), result.N * result.layer))) == 0
    line = "y" if case == "a line of y" else "x"
    other = "x" if line == "y" else "y"
    for place in (poles[0] - 0.7, *(pole + 0.7 for pole in poles)):
        point = {line: place, other: 0.3}
        assert result.to_raw(result.to_new(point)) == pytest.approx(point)


@pytest.mark.exhaustive
def test_a_logarithm_of_what_is_always_positive_is_left_as_it_is() -> None:
    result = split(field({x: (y - x) * (x**2 + 1) / eps, y: -(y - x) * (x + x**2) / eps + 1}))
    assert result.system is not None
    assert result.coordinates[result.system.x[0]].atoms(sp.log) == {sp.log(x**2 + 1)}


def test_conservation_laws_of_a_fast_binding_are_found() -> None:
    s, e, c, p = sp.symbols("s e c P")
    on, off, cat = sp.symbols("k1 k2 k3")
    bind = (on * e * s - off * c) / eps
    result = split(field({s: -bind, e: cat * c - bind, c: bind - cat * c, p: cat * c}, k1=1, k2=2, k3=3))
    assert len(result.system.x) == 3
    assert len(result.system.y) == 1
    for total in (s + c, e + c, p):
        in_new = sp.Matrix([*(result.coordinates[q] for q in result.system.x), total])
        assert in_new.jacobian([s, e, c, p]).rank() == 3
    # Substrate and product in all its forms: conserved by the whole field, not by its fast part only.
    rates = result.field.equations
    assert sp.expand(rates[s] + rates[c] + rates[p]) == 0
    assert_recombines(result)


def test_two_fast_directions_with_mixed_rates() -> None:
    r1, r2 = (x - y) / eps, (y + z - 2 * u) / eps
    result = split(field({x: -r1 + u, y: r1 - r2, z: -r2 - x, u: r2}))
    assert len(result.system.x) == 2
    assert result.fast_jacobian.shape == (2, 2)
    assert_recombines(result)
    numbers = sorted(complex(e).real for e in result.fast_jacobian.eigenvals(multiple=True))
    whole = sp.Matrix([-(x - y), x - y - (y + z - 2 * u), -(y + z - 2 * u), y + z - 2 * u]).jacobian(
        [x, y, z, u]
    )
    expected = sorted(complex(e).real for e in whole.eigenvals(multiple=True))
    assert np.allclose(numbers, [e for e in expected if abs(e) > 1e-12])


def test_constant_directions_come_out_constant() -> None:
    # Both fast rates are quadratic and mix all three states; N is a matrix of numbers all the same.
    h = (5 * x - y + 2 * z) ** 2
    g = [h / 49 - 2 * x / 7 + 3 * y / 7, 2 * h / 49 + y - z]
    result = split(field({x: g[0] / eps, y: (g[0] + g[1]) / eps - y, z: (g[1] - 2 * g[0]) / eps}))
    assert result.N.free_symbols == set()
    for given_rate, layer in zip((g[0], g[0] + g[1], g[1] - 2 * g[0]), result.N * result.layer):
        assert sp.expand(given_rate - layer) == 0


integers = st.integers(-2, 2)


@pytest.mark.exhaustive
@given(
    st.lists(integers, min_size=9, max_size=9),
    st.lists(integers, min_size=6, max_size=6),
    st.integers(1, 2),
)
@settings(max_examples=10)
def test_a_standard_form_hidden_by_a_linear_change_is_recovered(change, entries, fast_count) -> None:
    matrix = sp.Matrix(3, 3, change)
    assume(matrix.det() != 0)
    hidden = sp.symbols("h0:3")
    slow, fast = hidden[: 3 - fast_count], hidden[3 - fast_count :]
    g = [-2 * f + entries[i] * slow[0] ** 2 for i, f in enumerate(fast)]
    if fast_count == 2:
        g[0] += entries[2] * fast[1]
    f = [entries[3] * hidden[2] + entries[4] - hidden[i] for i in range(len(slow))]
    rates = sp.Matrix([*f, *(component / eps + entries[5] for component in g)])
    raw = (x, y, z)
    back = dict(zip(hidden, matrix.inv() * sp.Matrix(raw)))
    disguised = (matrix * rates).xreplace(back)
    result = split(field(dict(zip(raw, (sp.expand(e) for e in disguised)))))
    assert result.is_standard
    assert len(result.system.y) == fast_count
    assert_recombines(result)
    # The fast eigenvalues belong to the geometry, not to the coordinates.
    eigenvalues = sp.Matrix(g).jacobian(list(fast)).eigenvals(multiple=True)
    on_manifold = dict(zip(slow, (sp.Rational(1, 3), sp.Rational(2, 5))))
    where = sp.solve([e.subs(on_manifold) for e in g], fast, dict=True)[0] | on_manifold
    there = dict(zip(raw, matrix * sp.Matrix([where[h] for h in hidden])))
    found = result.fast_jacobian.subs(there).eigenvals(multiple=True)
    assert sorted(found, key=str) == sorted(eigenvalues, key=str)


@given(st.permutations([0, 1, 2]))
@settings(max_examples=6)
def test_permuted_states_permute_the_answer(order) -> None:
    rates = [(x, (y - 2 * x) / eps + z), (y, (2 * x - y) / eps - y), (z, x - z)]
    direct, other = split(field(dict(rates))), split(field(dict(rates[i] for i in order)))
    assert {s.name for s in direct.system.x} == {s.name for s in other.system.x}
    assert set(direct.coordinates.values()) >= {x + y, z}
    assert set(other.coordinates.values()) >= {x + y, z}
    point = {x: 1, y: 2}
    assert sp.cancel(direct.fast_jacobian[0] - other.fast_jacobian[0]).subs(point) == 0
    rows = [direct.field.states.index(s) for s in other.field.states]
    permuted = direct.projection.extract(rows, rows)
    assert (permuted - other.projection).applyfunc(sp.cancel) == sp.zeros(3, 3)


def nonstandard() -> Splitting:
    return split(field({x: (2 + x * y) * (x - y) / eps + 1, y: (y**2 + 3 * x + 4) * (x - y) / eps - y}))


def test_a_field_without_integrals_stays_non_standard_and_says_so() -> None:
    result = nonstandard()
    assert not result.is_standard
    assert dict(result.coordinates) == {}
    assert "stays non-standard" in result.explain()
    assert "Pi G" in result.explain()


def test_the_projection_is_one_along_the_fibres_onto_the_manifold() -> None:
    result = nonstandard()
    states = list(result.field.states)
    Df = result.layer.jacobian(states)
    zero = sp.zeros(2, 2)
    assert (result.projection**2 - result.projection).applyfunc(sp.cancel) == zero
    assert (result.projection * result.N).applyfunc(sp.cancel) == sp.zeros(2, 1)
    assert (Df * result.projection).applyfunc(sp.cancel) == sp.zeros(1, 2)
    assert sp.cancel((Df * result.reduced_field)[0]) == 0


@pytest.mark.exhaustive
def test_the_projection_holds_for_two_fast_directions_on_the_manifold() -> None:
    # N and f have rank two; off {f = 0} they are not unique, on it they satisfy every identity.
    r1, r2 = x - z**2, y + sp.sin(x) - z
    result = split(
        field({x: (-r1 * (1 + y * z) + x * r2) / eps, y: (-r2 + z * x * r1) / eps, z: r1 * y / eps - z})
    )
    states = list(result.field.states)
    height = sp.Rational(3, 4)
    there = {z: height, x: height**2, y: height - sp.sin(height**2)}
    Pi, N = (m.subs(there).evalf(30) for m in (result.projection, result.N))
    Df = result.layer.jacobian(states).subs(there).evalf(30)
    for defect in (Pi * Pi - Pi, Pi * N, Df * Pi):
        assert max(abs(e) for e in defect) < 1e-20


@pytest.mark.exhaustive
def test_the_leading_order_field_is_followed_by_the_full_flow() -> None:
    result = nonstandard()
    reduced = sp.lambdify((x, y), list(result.reduced_field))
    epsilons = (1e-2, 1e-3)
    errors = []
    for epsilon in epsilons:
        full = sp.lambdify((x, y), [rate.subs(eps, epsilon) for rate in result.field.rates])
        # (2 + x y) - (y^2 + 3 x + 4) < 0 on x = y > 0: attracting.
        start = [1.0, 1.0]
        ends = [
            solve_ivp(lambda t, q, f=f: f(*q), (0, 1), start, method="Radau", rtol=1e-10, atol=1e-12).y[:, -1]
            for f in (full, reduced)
        ]
        errors.append(float(np.linalg.norm(ends[0] - ends[1])))
    assert 0.8 < np.log10(errors[0] / errors[1]) < 1.2


REFUSED = {
    "a double pole": ({x: y, y: -x / eps**2}, r"rate of y has a pole of order 2 in epsilon: the term"),
    "a hidden double pole": ({x: y / (eps + eps**2) ** 2, y: -y}, "pole of order 2"),
    "a constant drift": ({x: 1 / eps, y: -y}, r"fast part of x' is 1/epsilon, which has no equilibrium"),
    "no real zeros": (
        {x: (1 + x**2) / eps, y: -y},
        r"no real equilibrium .* \(x\*\*2 \+ 1\)/epsilon was found",
    ),
    "second order zeros": ({x: x**2 / eps, y: x - y}, "vanishes to second order"),
    "all fast": ({x: -x / eps, y: x - y / eps}, "every state is fast"),
    "tangent directions": ({x: y / eps, y: -x}, "tangent to its own zeros"),
    "a circle of equilibria of a rotation": (
        {x: -(x**2 + y**2 - 1) * y / eps, y: (x**2 + y**2 - 1) * x / eps},
        "tangent to its own zeros",
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", REFUSED)
def test_a_field_of_another_form_is_refused_with_the_offending_term(case: str) -> None:
    rates, words = REFUSED[case]
    with pytest.raises(SplittingError, match=words):
        split(field(rates))


def test_equilibria_are_found_whatever_the_units() -> None:
    # Chapman's ozone, all of it fast: x atoms and y molecules of ozone in a cubic centimetre, 1e7 and 1e12 of them.
    fed, split_up, bound, lost = (
        sp.Integer(10) ** 5,
        sp.Rational(12, 10**6),
        sp.Rational(6, 5),
        sp.Rational(8, 10**15),
    )
    rates = (2 * fed + split_up * y - bound * x - lost * x * y, bound * x - split_up * y - lost * x * y)
    with pytest.raises(SplittingError, match=r"every state is fast: .* isolated equilibria"):
        split(VectorField({x: rates[0] / eps, y: rates[1] / eps}, epsilon=eps))
    # The same with the source slow: atoms and ozone only change into one another fast.
    slow = VectorField(
        {x: 2 * fed + (split_up * y - bound * x) / eps, y: (bound * x - split_up * y) / eps}, epsilon=eps
    )
    assert split(slow).coordinates[sp.Symbol("p")] == x + y
    # Amounts of 1e9 that only meet their zero there.
    far = VectorField({x: (x * y - sp.Integer(10) ** 18) / eps, y: 1 - y}, epsilon=eps)
    assert [s.name for s in split(far).system.x] == ["y"]


def test_rates_of_a_million_beside_rates_of_one_are_not_nilpotent() -> None:
    # An enzyme and its competitive inhibitor in moles in a litre: g_y has the eigenvalues -0.9 and -16 there.
    substrate, c, inhibited = x, y, z
    enzyme = sp.Rational(1, 10**9) - c - inhibited
    rates = {
        substrate: c - 10**6 * enzyme * substrate,
        c: (10**6 * enzyme * substrate - 2 * c) / eps,
        inhibited: (4 * enzyme - inhibited / 2) / eps,
    }
    assert [s.name for s in split(field(rates)).system.x] == ["x"]
    # Far from one in every unit, and nilpotent in each.
    with pytest.raises(SplittingError, match="tangent to its own zeros"):
        split(
            field(
                {
                    x: 10**6 * (x + y - sp.Rational(1, 10**9)) / eps,
                    y: -(10**6) * (x + y - sp.Rational(1, 10**9)) / eps,
                    z: -x,
                }
            )
        )


def test_a_field_without_epsilon_can_be_integrated_not_split() -> None:
    with pytest.raises(SplittingError, match="has no small parameter"):
        split(VectorField({x: -x}, epsilon=None))


def test_new_symbols_never_take_a_name_that_is_in_use() -> None:
    p = sp.Symbol("p")
    result = split(field({p: (x - p) / eps, x: (p - x) / eps - x}))
    (new,) = result.system.x
    assert new.name == "q"
    assert result.coordinates[new] == p + x


def test_observables_and_parameters_come_along() -> None:
    energy = sp.Symbol("E")
    raw = VectorField(
        {x: (y - x) / eps, y: (x - y) / eps - a * y},
        epsilon=eps,
        parameters={a: 0.5},
        observables={energy: x * y},
    )
    system = split(raw).system
    assert dict(system.parameters) == {a: sp.Rational(1, 2)}
    p, fast = system.x[0], system.y[0]
    assert sp.expand(system.observables[energy] - fast * (p - fast)) == 0


def test_values_are_carried_there_and_back_by_name() -> None:
    result = split(field({x: (y - x) / eps, y: (x - y) / eps - y, z: x}))
    values = {"x": 0.25, "y": -1.5, "z": 3.0}
    assert result.to_raw(result.to_new(values)) == values
    with pytest.raises(DeclarationError, match="no value for"):
        result.to_new({"x": 1.0})
    for carry in (result.to_new, result.to_raw):
        for wrong, words in ((3, "Got 3"), ({"x": "a"}, "no real number"), ({"x": np.nan}, "finite number")):
            with pytest.raises(DeclarationError, match=words):
                carry(wrong)  # pyright: ignore[reportArgumentType]


def test_values_are_carried_whatever_is_assumed_of_the_symbols() -> None:
    u, v = sp.Symbol("u", positive=True), sp.Symbol("v", real=True)
    result = split(field({u: (v - u) / eps, v: (u - v) / eps - v}))
    values = {"u": 0.25, "v": -1.5}
    assert result.to_raw(result.to_new(values)) == values


def test_non_smooth_fields_are_split_like_others() -> None:
    result = split(field({x: (sp.Abs(y) - x) / eps, y: (x - sp.Abs(y)) / eps + 1}))
    assert result.coordinates[result.system.x[0]] == x + y


def test_the_layer_and_the_drift_add_up_to_the_field() -> None:
    rates = {x: (y - x**2) / (eps * (1 + eps * y)) + sp.sin(x), y: (x**2 - y) / eps}
    result = split(field(rates))
    for given_rate, layer, drift in zip(rates.values(), result.N * result.layer, result.drift):
        assert sp.cancel(laurent(given_rate, eps, order=-1)[-1] - layer) == 0
        assert sp.simplify(given_rate - layer / eps - drift) == 0


def test_an_integral_that_an_odd_root_inverts_gives_a_standard_form() -> None:
    x, y, eps = sp.symbols("x y epsilon")
    f = x + y - 3
    field = VectorField({x: -y * f / eps + 1, y: -(x**2) * f / eps}, epsilon=eps)
    found = split(field)
    assert found.is_standard
    (phi,) = (found.coordinates[s] for s in found.system.x)
    assert phi == 2 * x**3 - 3 * y**2
    raw = {"x": 1.3, "y": 0.7}
    assert found.to_raw(found.to_new(raw)) == pytest.approx(raw)
    assert found.to_raw(found.to_new({"x": -1.3, "y": 0.7})) == pytest.approx({"x": -1.3, "y": 0.7})


def test_what_drifts_by_epsilon_alone_does_not_move_at_leading_order() -> None:
    found = split(field({x: eps * y, y: (x - y) / eps + y}))
    assert list(found.reduced_field.subs({y: x})) == [0, 0]


def test_quotients_that_are_long_over_one_denominator_hide_no_slow_variable() -> None:
    slow, fast = sp.symbols("x0:2"), sp.symbols("y0:4")
    states = (*slow, *fast)
    rates = {s: s - sp.Add(*fast) for s in slow}
    for i, s in enumerate(fast):
        coupled = slow[0] * fast[-1] / (10 + states[i + 1] ** 2) - 1 / ((i + 2) * (3 + slow[0] ** 2))
        rates[s] = (sp.Add(*[state / (k + i + 2) for k, state in enumerate(states)]) - 9 * s + coupled) / eps
    assert split(field(rates)).system.x == slow


@pytest.mark.exhaustive
def test_long_directions_are_told_in_a_line_each() -> None:
    states = sp.symbols("z0:5")
    layer = [
        states[0] * states[-1] - 8 * s + sp.Add(*[r / (i + k + 2) for k, r in enumerate(states)])
        for i, s in enumerate(states[1:])
    ]
    bent = {
        z: sp.Add(*[(1 + states[(i + j) % 5] / 3) * part for j, part in enumerate(layer)])
        for i, z in enumerate(states)
    }
    told = split(field({z: sp.expand(rate) / eps - z for z, rate in bent.items()})).explain()
    assert "operations)" in told
    assert len(told) < 40 * 300


@pytest.mark.parametrize("values", [{"a": 0.3, "k": 0.3}, {"a": 0, "k": 1}])
def test_integrals_that_have_no_value_for_the_parameters_are_none(values: dict[str, float]) -> None:
    # 1/(a - k) stands in that of the first, 1/a in that of the second.
    speed = a * x + k * y if values["a"] == 0 else (x - a) * (x - k)
    found = split(field({x: -speed * (x - y) / eps - x, y: (x - y) / eps - y}, **values))
    assert not found.is_standard
    # On x = y both move alike.
    assert [e.subs({y: x, **found.field.parameters}).simplify() for e in found.reduced_field] == [-x, -x]


@pytest.mark.parametrize(
    ("of_x", "of_y", "wanted"),
    [
        (-(x - a) * (x + k), 1, {x - a, x + k}),
        (x, k * y, {y}),
        (-(x**2), y**2, {x, y}),
        (1 + x**2, 1, set()),
        (1, sp.exp(1 / y) * y**2, {y}),
    ],
)
def test_where_an_integral_is_singular_the_change_of_coordinates_is_told_to_be(of_x, of_y, wanted) -> None:
    found = split(field({x: of_x * (x - y - 2) / eps + 1, y: of_y * (x - y - 2) / eps - y}, a=1, k=2))
    assert {sp.factor(e).as_coeff_Mul()[1] for e in found.nonzero} <= {
        f for e in wanted for f in (e, sp.expand(-e))
    }
    assert len(found.nonzero) == len(wanted)


def test_the_search_for_an_equilibrium_far_away_overflows_nothing() -> None:
    # Goldbeter's kinase: Newton's method leaves for large y, where steps get small.
    rate = 3 * x / (x + 1) * (1 - y) / (a + 1 - y) - 3 * y / (2 * (a + y))
    with np.errstate(over="raise"):
        split(field({x: -x, y: rate / eps, z: y - z}, a=0.005))


def _fast_pairs(count: int) -> VectorField:
    """As many pairs of species in fast exchange, coupled slowly in a ring."""
    first, second = sp.symbols(f"a1:{count + 1}"), sp.symbols(f"b1:{count + 1}")
    rates = {}
    for i in range(count):
        flux = second[i] - first[i] * sp.Rational(i + 2, 3)
        rates[first[i]] = flux / eps - first[i] * second[(i + 1) % count] / 7
        rates[second[i]] = -flux / eps + first[i - 1] - second[i]
    return field(rates)


@pytest.mark.exhaustive
@pytest.mark.parametrize("count", [3, 12])
def test_columns_are_chosen_by_elimination_and_not_one_minor_after_another(count: int, monkeypatch) -> None:
    asked = []
    determinant = sp.Matrix.det
    monkeypatch.setattr(sp.Matrix, "det", lambda self, **more: asked.append(1) or determinant(self, **more))
    chosen = slow_coordinates.independent_columns
    eliminations = []
    monkeypatch.setattr(
        slow_coordinates, "independent_columns", lambda *given: eliminations.append(1) or chosen(*given)
    )
    result = split(_fast_pairs(count))
    assert asked == []
    assert eliminations == [1]
    assert len(result.system.x) == len(result.system.y) == count
    assert_recombines(result)
    for i in range(1, count + 1):
        assert sp.Symbol(f"a{i}") + sp.Symbol(f"b{i}") in result.coordinates.values()
    assert result.layer.rows == count
    jacobian = sp.Matrix(result.layer).jacobian(result.field.states)
    assert result.fast_jacobian == (jacobian * result.N).as_immutable()
    assert sp.simplify(sp.Matrix(result.N) * sp.Matrix(result.layer) * 1 - _layer(result)) == sp.zeros(
        2 * count, 1
    )


def _layer(result: Splitting) -> sp.Matrix:
    """What carries 1/epsilon."""
    return sp.Matrix([laurent(rate, eps, order=-1).get(-1, 0) for rate in result.field.rates])


@pytest.mark.exhaustive
def test_a_thousand_states_are_split() -> None:
    # SymPy's dense polynomials in so many states recurse once for each.
    result = split(_fast_pairs(500))
    assert len(result.system.x) == len(result.system.y) == 500
    assert "constant" in result.route


def test_a_field_keeps_the_form_in_which_it_is_written() -> None:
    """Multiplied out, the slope of (h - x) sqrt(1 + (h - x)^2) is a difference that no enclosure sees through."""
    h, x = sp.symbols("h x")
    valve = (h - x) * sp.sqrt((h - x) ** 2 + 1)
    found = split(field({h: (-3 * h - valve) / eps, x: valve - x}))
    assert found.system.g[0].has(valve)
    assert found.system.f[0] == valve - x
    # What cancels does so all the same.
    cancels = split(field({h: (2 - h) / eps, x: x * (h - 1) / eps - (x * h - x) / eps + x}))
    assert [s.name for s in cancels.system.y] == ["h"]
    assert cancels.system.f[0] == x


@pytest.mark.parametrize("by", [300, -1_000_000])
@pytest.mark.parametrize(
    ("rates", "linear"),
    [
        ({x: (y - x**2 / (1 + x**2)) / eps + 1 - x, y: -(y - x**2 / (1 + x**2)) / eps}, True),
        ({x: -a * x * y / eps + 1 - x, y: (a * x * y - y) / eps + x}, False),
        ({x: y * z, y: (x - sp.tanh(z)) / eps, z: (sp.tanh(z) - x) / eps - z}, True),
    ],
)
def test_fields_split_about_their_own_centres(rates: dict, linear: bool, by: int) -> None:
    """Far from the origin no equilibrium was found, and exp(a y) in a first integral had no finite value."""
    back = {s: s - by for s in (x, y, z)}
    near = split(field(rates, a=2))
    far = split(field({s: e.xreplace(back) for s, e in rates.items()}, a=2))
    assert_recombines(far)
    assert far.is_standard
    point = {s: sp.Rational(k, 7) for k, s in enumerate(near.field.states, 2)} | {a: 2}
    beyond = {s: value + by for s, value in point.items() if s != a} | {a: 2}
    moved = [sp.N(far.coordinates[s].subs(beyond) - phi.subs(point)) for s, phi in near.coordinates.items()]
    assert all(abs(value - round(value)) < 1e-9 for value in moved)
    if linear:
        # Counted from the origin, without a number in their formula.
        assert all(phi.subs(dict.fromkeys(far.field.states, 0)) == 0 for phi in far.coordinates.values())
