"""The series of the slow manifold: exact coefficients, the invariance equation, and manufactured manifolds."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from gsp.critical.critical_manifold import solve_critical
from gsp.errors import BeyondReachWarning, DeclarationError, HyperbolicityError, UnsupportedFunctionError
from gsp.slow.components import Components
from gsp.slow.series import expand
from gsp.slow.slow_points import zero_derivative
from gsp.systems.system import SlowFastSystem
from tests import example_systems as systems

eps = systems.epsilon
x, y, z = systems.x, systems.y, systems.z

SLEIGH = {
    1: "-I*m*p*v/(I + a**2*m)**2",
    2: "I**2*a*m**2*p*(-2*I*m*v**2 - 2*a**2*m**2*v**2 + p**2)/(I + a**2*m)**5",
    3: "I**3*m**3*p*v*(-5*I*a**2*m**2*v**2 - I*p**2 - 5*a**4*m**3*v**2 + 9*a**2*m*p**2)/(I + a**2*m)**7",
}
MICHAELIS_MENTEN = {
    0: "s/(kappa + s)",
    1: "kappa*l*s/(kappa + s)**4",
    2: "-kappa*l*s*(kappa**2 - 2*kappa*l + kappa*s + 3*l*s)/(kappa + s)**7",
    3: "kappa*l*s*(kappa**4 - 5*kappa**3*l + 2*kappa**3*s + 5*kappa**2*l**2 + 6*kappa**2*l*s + kappa**2*s**2"
    " - 24*kappa*l**2*s + 11*kappa*l*s**2 + 15*l**2*s**2)/(kappa + s)**10",
}
# The sleigh's slow manifold w at epsilon = 0.1, m = I = 1, a = 1/5, from an orbit segment in 45 digits.
SLEIGH_POINTS = {
    (1.0, 1.0): (-0.0987164908384117188755671970196255611, [2.56e-3, 8.56e-4, 1.44e-4, 2.68e-5, 6.65e-6]),
    (-1.0, 1.0): (0.0950569759766681569343008548321774693, [1.10e-3, 6.10e-4, 1.01e-4, 1.61e-5, 4.10e-6]),
    (0.5, -2.0): (0.0847862203708975205358871087803772895, [1.14e-2, 1.65e-3, 5.82e-4, 1.21e-5, 2.40e-5]),
}


def expression(text: str) -> sp.Expr:
    names = "v p w m I a s c kappa"
    table = {name: sp.Symbol(name) for name in names.split()}
    return sp.sympify(text, locals={**table, "l": sp.Symbol("lambda")})


def branch_of(system: SlowFastSystem, **near: float):
    manifold = solve_critical(system)
    return manifold.nearest(near) if near else manifold.branches[0]


def defect(system: SlowFastSystem, series, tiny: sp.Rational) -> list[sp.Rational]:
    """epsilon Dh f - g at a rational point, parameters and epsilon rational too; exact, explicit branches."""
    symbols = (*system.x, *system.parameters)
    point = {s: sp.Rational(3 + 2 * i, 7 + i) for i, s in enumerate(symbols)}
    values = {p: point[p] for p in system.parameters}
    h = {
        symbol: sum(tiny**k * series.coefficients[k][symbol].subs(values) for k in range(series.order + 1))
        for symbol in system.y
    }
    at = {**point, **{symbol: h[symbol].subs(point) for symbol in h}, eps: tiny}
    f = [rate.subs(at) for rate in system.f]
    return [
        tiny * sum(sp.diff(h[symbol], s).subs(point) * rate for s, rate in zip(system.x, f)) - g.subs(at)
        for symbol, g in system.fast.items()
    ]


def vanishes(value: sp.Expr) -> bool:
    symbols = sorted(value.free_symbols, key=str)
    points = [{s: sp.Rational(3 + 2 * i + j, 7 + i) for i, s in enumerate(symbols)} for j in range(3)]
    return all(abs(sp.N(value.subs(point), 40)) < 1e-30 for point in points)


def test_the_sleigh_has_the_exact_coefficients() -> None:
    series = expand(branch_of(systems.sleigh()), order=3)
    assert series.coefficients[0]["w"] == 0
    for k, text in SLEIGH.items():
        assert sp.cancel(series.coefficients[k]["w"] - expression(text)) == 0


def test_michaelis_menten_has_the_exact_coefficients() -> None:
    series = expand(branch_of(systems.michaelis_menten()), order=3)
    for k, text in MICHAELIS_MENTEN.items():
        assert sp.cancel(series.coefficients[k]["c"] - expression(text)) == 0


@pytest.mark.exhaustive
@pytest.mark.parametrize("system", [systems.sleigh(), systems.michaelis_menten(), systems.saddle()])
def test_every_order_through_six_solves_the_invariance_equation_exactly(system: SlowFastSystem) -> None:
    # In exact arithmetic the defect of order n is c epsilon^(n+1), however small epsilon is.
    series = expand(branch_of(system), order=6)
    large, small = (max(map(abs, defect(system, series, sp.Rational(1, 10**k)))) for k in (9, 10))
    assert abs(float(sp.log(large / small, 10)) - 7) < 1e-3


@pytest.mark.exhaustive
def test_the_reduced_field_is_f_on_the_manifold() -> None:
    system = systems.sleigh()
    series = expand(branch_of(system), order=4)
    w = sum(eps**k * series.coefficients[k]["w"] for k in range(5))
    for symbol, rate in system.slow.items():
        full = rate.subs(sp.Symbol("w"), w)
        for k in range(5):
            taylor = sp.diff(full, eps, k).subs(eps, 0) / sp.factorial(k)
            assert vanishes(taylor - series.reduced_field[k][symbol])


def test_the_saddle_type_manifold_has_its_known_geometric_series() -> None:
    series = expand(branch_of(systems.saddle()), order=4)
    exact = {y: -(x**2) / (1 + 2 * eps), z: -(x**3) / ((1 + 2 * eps) * (1 - 3 * eps))}
    for symbol, value in exact.items():
        for k in range(5):
            taylor = sp.diff(value, eps, k).subs(eps, 0) / sp.factorial(k)
            assert sp.expand(series.coefficients[k][symbol] - taylor) == 0


@pytest.mark.parametrize(("v", "Omega"), list(SLEIGH_POINTS))
def test_the_error_at_each_order_is_the_published_one(v: float, Omega: float) -> None:
    series = expand(branch_of(systems.sleigh()), order=5)
    exact, errors = SLEIGH_POINTS[v, Omega]
    for order, expected in enumerate(errors, start=1):
        w = series.evaluate({"v": v, "p": 1.04 * Omega}, 0.1, order=order)[0]
        assert abs(w - exact) == pytest.approx(expected, rel=0.006)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("system", "near", "slow"),
    [
        (systems.van_der_pol(), {"x": 2.0, "y": 2 / 3}, {"y": 0.9}),
        (systems.van_der_pol(), {"x": 0.2, "y": -0.2}, {"y": -0.3}),
        (systems.koper(), {"x": 2.4, "y": 0.0, "z": 0.5}, {"y": 0.1, "z": 0.4}),
        (systems.coupled(), {"x": 0.5, "y": 0.4, "z": 0.2}, {"x": 0.6}),
        (systems.transcendental(), {"x": 0.5, "y": 0.3}, {"x": 0.7}),
    ],
)
@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_the_residual_falls_with_one_power_more_than_the_order(system, near, slow, order: int) -> None:
    series = expand(branch_of(system, **near), order=order)
    sizes = [np.linalg.norm(series.residual(slow, e)) for e in (4e-3, 2e-3)]
    assert np.log2(sizes[0] / sizes[1]) == pytest.approx(order + 1, abs=0.1)


def test_an_explicit_branch_and_its_implicit_twin_give_the_same_manifold() -> None:
    explicit = branch_of(systems.michaelis_menten())
    implicit = replace(explicit, graph=None, seed=((1.0,), (0.5,)))
    assert not implicit.is_explicit
    points = np.linspace(0.2, 3.0, 7)[:, None]
    for order in (1, 4):
        one = expand(explicit, order=order).evaluate(points, 0.05)
        two = expand(implicit, order=order).evaluate(points, 0.05)
        np.testing.assert_allclose(one, two, rtol=1e-13)


coefficient = st.integers(-3, 3)


@st.composite
def manufactured(draw: st.DrawFn):
    """A system with a chosen polynomial manifold y = h(x, epsilon), one slow and two fast variables."""
    h = [sum(draw(coefficient) * x**i * eps**k for i in range(3) for k in range(3)) for _ in range(2)]
    f = draw(coefficient) + draw(coefficient) * x + draw(coefficient) * y * z + draw(coefficient) * eps
    # det = 1 + (x + c)^2 never vanishes, so that the branch is hyperbolic everywhere.
    c = draw(coefficient)
    A = sp.Matrix([[1, x + c], [-(x + c), 1]])
    offset = sp.Matrix([y - h[0], z - h[1]])
    on = sp.sympify(f).subs({y: h[0], z: h[1]}, simultaneous=True)
    g = -A * offset + eps * sp.Matrix([sp.diff(part, x) for part in h]) * on
    return SlowFastSystem(slow={x: f}, fast={y: g[0], z: g[1]}, epsilon=eps), h


@pytest.mark.exhaustive
@settings(max_examples=25)
@given(manufactured())
def test_a_manufactured_system_returns_its_manifold(case) -> None:
    system, h = case
    series = expand(solve_critical(system).branches[0], order=3)
    for symbol, part in zip((y, z), h):
        for k in range(4):
            expected = sp.expand(part).coeff(eps, k)
            assert sp.expand(series.coefficients[k][symbol] - expected) == 0


def test_permuted_variables_permute_the_coefficients() -> None:
    system = systems.saddle()
    swapped = SlowFastSystem(slow=system.slow, fast={z: system.fast[z], y: system.fast[y]}, epsilon=eps)
    one = expand(branch_of(system), order=3)
    two = expand(branch_of(swapped), order=3)
    assert two.coefficients[3] == (one.coefficients[3][z], one.coefficients[3][y])


@pytest.mark.parametrize("epsilon", [0.4, 0.25, 0.2])
def test_the_optimal_order_is_as_good_as_the_best_within_a_factor_ten(epsilon: float) -> None:
    # h_k = (-1)^k k! x^(k+1), Euler's series, which diverges for every epsilon; its Borel sum is the manifold.
    system = SlowFastSystem(slow={x: x**2}, fast={y: x - y}, epsilon=eps)
    series = expand(branch_of(system), order=14)
    assert [series.coefficients[k]["y"] for k in range(4)] == [x, -(x**2), 2 * x**3, -6 * x**4]
    exact = quad(lambda t: np.exp(-t) / (1 + epsilon * t), 0, np.inf, epsabs=1e-14)[0]
    errors = np.abs(np.cumsum(series.terms(1.0, epsilon)[:, 0]) - exact)
    order = series.optimal_order(1.0, epsilon)
    assert errors[order] < 10 * min(errors)
    assert errors[14] > 100 * errors[order]
    assert 1 <= series.truncation_error(1.0, epsilon) / errors[order] < 30


@pytest.mark.exhaustive
@pytest.mark.parametrize("last", [45, 60])
def test_optimal_truncation_of_the_sleigh_is_told_where_the_series_diverges(last: int) -> None:
    # epsilon = 0.2, (v, p/J) = (1/2, -2): terms fall to about 1e-6 near order 25 and pass 1 before order 60.
    series = expand(branch_of(systems.sleigh()), order=last)
    point, exact = {"v": 0.5, "p": -2 * 1.04}, 0.14688108653956
    errors = np.abs(np.cumsum(series.terms(point, 0.2)[:, 0]) - exact)
    assert errors[last] > {45: 100 * errors.min(), 60: 1}[last]
    order = series.optimal_order(point, 0.2)
    assert 1 <= series.truncation_error(point, 0.2) / errors[order] < 30
    # One sum may be right by accident, two neighbours are not.
    assert errors[order] < 3 * np.maximum(errors[:-1], errors[1:]).min()


def test_a_terminating_series_is_best_at_its_full_order() -> None:
    gamma = (1 - eps) * x
    system = SlowFastSystem(slow={x: -x}, fast={y: -y + (gamma + x**2) / (1 + x) ** 2}, epsilon=eps)
    series = expand(branch_of(system), order=5)
    assert all(series.coefficients[k]["y"] == 0 for k in range(1, 6))
    assert series.optimal_order(0.7, 0.3) == 5
    assert abs(series.residual(0.7, 0.3)[0]) < 1e-16


def test_numerical_values_put_the_parameters_in_first() -> None:
    series = expand(branch_of(systems.sleigh()), order=6)
    with pytest.raises(KeyError):
        series.specialised.chart.ring.generator(sp.Symbol("m"))
    point = {sp.Symbol("v"): sp.Rational(7, 10), sp.Symbol("p"): sp.Rational(-3, 5)}
    values = dict(systems.sleigh().parameters)
    exact = sum(
        sp.Rational(1, 20) ** k * series.coefficients[k]["w"].subs(values).subs(point) for k in range(7)
    )
    assert series.evaluate({"v": 0.7, "p": -0.6}, 0.05)[0] == pytest.approx(float(exact), rel=1e-14)


def test_shapes_follow_the_input() -> None:
    series = expand(branch_of(systems.saddle()), order=2)
    assert series.evaluate(0.5, 0.01).shape == (2,)
    assert series.evaluate([0.5, 0.6, 0.7], 0.01).shape == (3, 2)
    assert series.evaluate({"x": np.array([0.5, 0.6])}, 0.01).shape == (2, 2)
    assert series.terms(0.5, 0.01).shape == (3, 2)
    assert series.residual([0.5, 0.6], 0.01).shape == (2, 2)


def test_components_are_found_by_place_symbol_and_name() -> None:
    row = Components((x, y), (x + 1, y + 2))
    assert row[0] == row["x"] == row[x] == x + 1
    assert row.as_dict() == {x: x + 1, y: y + 2}
    with pytest.raises(KeyError, match="none of x, y"):
        row["q"]


def test_a_branch_that_is_nowhere_hyperbolic_is_refused() -> None:
    system = SlowFastSystem(slow={x: 1}, fast={y: (y - x) ** 2}, epsilon=eps)
    with pytest.raises(HyperbolicityError, match="singular on the whole branch"):
        expand(branch_of(system), order=1)


def test_a_term_whose_powers_are_beyond_doubles_is_not_called_singular() -> None:
    """Eighth powers of 1e-9, as moles in a litre have them; in units of 1e-9 the term has a value."""
    unit, half = sp.Rational(1, 10**9), sp.Rational(1, 2)

    def at(unit: sp.Rational):
        gate = 2 * unit * x**8 / (unit**8 + x**8)
        system = SlowFastSystem(
            slow={x: unit / 2 - x / 2 + y / 5}, fast={y: gate - y - x * y / (4 * unit)}, epsilon=eps
        )
        return expand(branch_of(system), order=2).evaluate(float(half * unit), 0.01)

    assert np.isfinite(at(sp.Integer(1))).all()
    with pytest.raises(HyperbolicityError, match=r"order 2 has no value in double precision at x = 5e-10"):
        at(unit)


def test_epsilon_must_be_positive_and_finite() -> None:
    series = expand(branch_of(systems.saddle()), order=1)
    for wrong in (0.0, -0.1, float("nan"), float("inf")):
        with pytest.raises(DeclarationError, match="finite and positive"):
            series.evaluate(0.5, wrong)


def test_an_order_beyond_what_is_known_is_named() -> None:
    series = expand(branch_of(systems.saddle()), order=2)
    with pytest.raises(DeclarationError, match="known through order 2"):
        series.evaluate(0.5, 0.1, order=3)
    for wrong in ("2", 1.5):
        with pytest.raises(DeclarationError, match="order is a non-negative integer"):
            series.at_order(wrong)  # pyright: ignore[reportArgumentType]
    with pytest.raises(DeclarationError, match="over takes a Branch"):
        series.over(series)  # pyright: ignore[reportArgumentType]


def test_a_function_without_a_series_rule_is_named() -> None:
    system = SlowFastSystem(slow={x: sp.gamma(x)}, fast={y: x - y}, epsilon=eps)
    with pytest.raises(UnsupportedFunctionError, match="gamma"):
        expand(branch_of(system), order=1)


@pytest.mark.exhaustive
def test_terms_that_are_rounding_altogether_do_not_count():
    x, y, u, v, eps = sp.symbols("x y u v epsilon")
    k = sp.Rational(3, 10)
    # Eliminating v from the first equation makes a polynomial of degree 15, whose series loses a digit a term and more.
    system = SlowFastSystem(
        slow={x: -x + y / 2 + u, y: -y + v * k},
        fast={u: x - u - u**5 + k * v, v: y + u**2 / 4 - 2 * v - v**3},
        epsilon=eps,
    )
    series = expand(solve_critical(system).nearest({"x": 0.8, "y": 0.5, "u": 0.3, "v": 0.1}), order=3)
    point = {"x": 1.0, "y": 1.0}
    assert series.optimal_order(point, 0.02) == 2
    # The zero-derivative principle expands nothing.
    exact = zero_derivative(series.branch, point, epsilon=0.02).y
    assert abs(series.evaluate(point, 0.02, order=2) - exact).max() < 1e-6
    with pytest.warns(BeyondReachWarning, match="without digits, and order 2 is the best"):
        assert abs(series.evaluate(point, 0.02, order=3) - exact).max() > 1e-4
    # The level of the terms kept; the lost one, 2.5e-2, is not among them.
    assert series.truncation_error(point, 0.02) < 1e-3


@pytest.mark.parametrize("real", [False, True])
@pytest.mark.parametrize(
    ("make", "pieces"),
    [
        (sp.Abs, (1, -1)),
        (lambda u: sp.sign(u) * u, (1, -1)),
        (lambda u: sp.Max(u, 0), (1, 0)),
        (lambda u: sp.Min(u, 2 * u), (1, 2)),
        (lambda u: sp.Heaviside(u) * u, (1, 0)),
        (lambda u: sp.Max(-u, u / 2, u), (1, -1)),
    ],
)
def test_the_series_off_a_kink_is_that_of_each_side(real: bool, make, pieces: tuple[int, int]) -> None:
    # epsilon y' = k x - y with x' = -x: h = k x/(1 - epsilon), k on either side.
    x, y = sp.symbols("x y", real=True) if real else sp.symbols("x y")
    system = SlowFastSystem(slow={x: -x}, fast={y: make(x) - y}, epsilon=eps)
    series = expand(branch_of(system), order=4)
    for at, k in zip((sp.Rational(7, 5), sp.Rational(-3, 5)), pieces):
        assert [row[0].subs(x, at) for row in series.coefficients] == [k * at] * 5


def test_an_absolute_value_is_shown_as_one() -> None:
    system = SlowFastSystem(slow={x: -x}, fast={y: sp.Abs(x) - y}, epsilon=eps)
    assert expand(branch_of(system), order=1).coefficients == ((sp.Abs(x),), (sp.Abs(x),))


def test_kinks_in_fast_variables_expand_on_an_implicit_branch() -> None:
    # For x > y > 0: epsilon y' = x - 2 y - y^2 without the kinks.
    kinked = SlowFastSystem(slow={x: -x}, fast={y: sp.Max(x, y) - 2 * y - y * sp.Abs(y)}, epsilon=eps)
    smooth = SlowFastSystem(slow={x: -x}, fast={y: x - 2 * y - y**2}, epsilon=eps)
    points = np.array([[0.5], [2.0]])
    found, expected = (expand(solve_critical(s).nearest({x: 1.0, y: 0.4}), order=3) for s in (kinked, smooth))
    near = np.sqrt(1 + points) - 1
    np.testing.assert_allclose(
        found.evaluate(points, 0.01, near=near), expected.evaluate(points, 0.01, near=near), rtol=1e-13
    )


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("jump", "value"),
    [(sp.sign(y - 1), 1), (sp.sign(1 - y), -1), (sp.Heaviside(y - 1), 1), (sp.sign(x - 2), -1)],
)
def test_a_sign_of_a_variable_keeps_its_value_on_the_branch(jump: sp.Expr, value: int) -> None:
    # It has the slope 0, and yet the equation is not linear in y: at y = 0, which was put in, it has another value.
    system = SlowFastSystem(slow={x: -x + y / 4}, fast={y: x - y + jump / 9}, epsilon=eps)
    beyond = SlowFastSystem(slow={x: -x + y / 4}, fast={y: x - y + sp.Rational(value, 9)}, epsilon=eps)
    found, expected = (expand(solve_critical(s).nearest({x: 1.5, y: 1.6}), order=3) for s in (system, beyond))
    near = np.array([[1.5 + value / 9]])
    np.testing.assert_allclose(
        found.evaluate([[1.5]], 0.01, near=near), expected.evaluate([[1.5]], 0.01), rtol=1e-13
    )


def test_a_kink_along_the_whole_branch_has_no_series() -> None:
    # y = epsilon x + ..., so that z = |y| is no power series, though M0 itself is found.
    system = SlowFastSystem(slow={x: -x}, fast={y: eps * x - y, z: sp.Abs(y) - z}, epsilon=eps)
    assert expand(branch_of(system), order=0).coefficients == ((0, 0),)
    with pytest.raises(UnsupportedFunctionError, match="across that kink"):
        expand(branch_of(system), order=1)


THIRD, LATE = sp.Rational(1, 3), sp.Rational(2, 3)
STAIRS = sp.Heaviside(x - THIRD) + 2 * sp.Heaviside(x - LATE)


@pytest.mark.parametrize(
    ("pieces", "same"),
    [
        (sp.Piecewise((x, x > THIRD), (THIRD, True)), sp.Max(x, THIRD)),
        (sp.Piecewise((-y, (y < 0) & (x > -2)), (y, True)), sp.Abs(y)),
        (sp.Piecewise((0, x < THIRD), (1, sp.Or(x < 0, x < LATE)), (3, True)), STAIRS),
        (sp.Piecewise((7, sp.Eq(x, THIRD)), (y, sp.Not(y >= THIRD)), (THIRD, True)), sp.Min(y, THIRD)),
    ],
)
def test_cases_have_the_series_of_what_they_are_on_each_side(pieces: sp.Expr, same: sp.Expr) -> None:
    points = [[0.2], [0.5], [0.9]]
    values = []
    for function in (pieces, same):
        system = SlowFastSystem(
            slow={x: -x * y - function / 2}, fast={y: x - 3 * y + function / 5}, epsilon=eps
        )
        series = expand(branch_of(system, x=0.5, y=0.2), order=2)
        values.append([series.evaluate(points, e) for e in (0.01, 0.05)])
    assert np.allclose(*values, rtol=1e-13)


def test_cases_that_leave_something_out_or_ask_more_than_inequalities_are_refused() -> None:
    for pieces, words in (
        (sp.Piecewise((x, x > 0), (0, x < -1)), "in the equation for y': .*End it with a value"),
        (sp.Piecewise((x, sp.Xor(x > 0, y > 0)), (0, True)), "inequalities, And, Or and Not"),
    ):
        system = SlowFastSystem(slow={x: -x}, fast={y: pieces - y}, epsilon=eps)
        with pytest.raises(UnsupportedFunctionError, match=words):
            expand(branch_of(system), order=1)


def test_a_series_is_printed_through_its_last_order() -> None:
    system = SlowFastSystem(slow={x: -y}, fast={y: x - y}, epsilon=eps)
    shown = str(expand(solve_critical(system).branches[0], order=2)).splitlines()
    # h = x + epsilon x + 2 epsilon^2 x, and x' = -h.
    assert [line.strip() for line in shown[1:]] == [
        "h_0: y = x", "h_1: y = x", "h_2: y = 2*x", "f_0: x' = -x", "f_1: x' = -x", "f_2: x' = -2*x",
    ]  # fmt: skip


def test_what_can_be_read_of_a_series_is_the_longest_part_within_the_limit() -> None:
    series = expand(solve_critical(systems.michaelis_menten()).branches[0], order=4)
    assert series.readable(max(series.sizes)) is series
    numbers = series.specialised
    assert max(numbers.sizes) < max(series.sizes)
    for limit in range(min(numbers.sizes), max(series.sizes)):
        found = series.readable(limit)
        assert max(found.sizes) <= limit
        assert found.order == 4 or numbers.sizes[found.order + 1] > limit


QUADRATIC = SlowFastSystem(
    slow={x: -x + y * z}, fast={y: x - y + z / 4, z: x * y - 2 * z + y**2 / 8}, epsilon=eps
)


def test_terms_beside_a_root_have_the_digits_of_the_implicit_branch() -> None:
    """Numerators A + B sqrt((x - 16)*(x - 4)) left none from order 4 on."""
    explicit = solve_critical(QUADRATIC).nearest({x: 0, y: 0, z: 0})
    assert explicit.is_explicit
    here = explicit.points([[-0.5]])[0]
    implicit = replace(explicit, graph=None, equations=tuple(QUADRATIC.g))
    sheet = implicit.through({x: -0.5, y: here[0], z: here[1]})
    points = np.linspace(-1.9, 0.9, 9)[:, None]
    expected = expand(sheet, order=6).terms(points, 1.0)
    for series in (expand(explicit, order=6), expand(explicit, order=6, symbolic=False)):
        assert not series.is_program
        assert series.terms(points, 1.0) == pytest.approx(expected, rel=1e-9, abs=1e-11)


def test_programs_find_a_pivot_where_a_diagonal_entry_vanishes_on_the_branch() -> None:
    """On y = 1 the rate x (y - 1) has no slope by x: "the fast Jacobian is singular on the whole branch"."""
    system = SlowFastSystem(slow={z: -z - x}, fast={x: x * (y - 1), y: z + 3 - x * y - y}, epsilon=eps)
    series = expand(solve_critical(system).nearest({z: 0, x: 2, y: 1}), order=3)
    points = np.linspace(-1.0, 1.0, 5)[:, None]
    assert series.as_programs.terms(points, 0.1) == pytest.approx(
        series.terms(points, 0.1), rel=1e-12, abs=1e-14
    )
