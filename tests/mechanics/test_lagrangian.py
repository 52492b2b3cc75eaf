"""Lagrange's equations: Examples and theorems of section 1, against closed forms and SymPy's own derivation."""

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from sympy.physics.mechanics import LagrangesMethod, dynamicsymbols

from gsp.errors import DeclarationError
from gsp.integration.trajectory import Method, integrate
from gsp.mechanics import LagrangianSystem

x, y, z, xdot, ydot, zdot, t = sp.symbols("x y z xdot ydot zdot t")
m, g, omega = sp.symbols("m g omega")
TIGHT = {"rtol": 1e-13, "atol": 1e-14, "method": Method.DOP853}


def test_a_particle_in_gravity_has_the_field_of_its_weight() -> None:
    L = m * (xdot**2 + ydot**2 + zdot**2) / 2 - m * g * z
    system = LagrangianSystem(L, [x, y, z], [xdot, ydot, zdot], parameters={m: 2, g: 9.81})
    field = system.euler_lagrange()
    assert field.rates == (xdot, ydot, zdot, 0, 0, -g)
    assert system.mass_matrix == sp.diag(m, m, m)
    assert sp.expand(system.energy() - (L + 2 * m * g * z)) == 0
    assert system.energy_rate() == 0


def rotating_frame() -> LagrangianSystem:
    """The free particle with x = R(t) y put into (1), time and all, as Exercise 1.2 asks."""
    R = sp.Matrix([[sp.cos(omega * t), -sp.sin(omega * t)], [sp.sin(omega * t), sp.cos(omega * t)]])
    place, rate = sp.Matrix([x, y]), sp.Matrix([xdot, ydot])
    v = R.diff(t) * place + R * rate
    return LagrangianSystem(m * v.dot(v) / 2, [x, y], [xdot, ydot], parameters={m: 3, omega: 0.7}, time=t)


def test_a_rotating_frame_has_a_coriolis_and_a_centrifugal_force() -> None:
    field = rotating_frame().euler_lagrange()
    Omega = sp.Matrix([[0, -omega], [omega, 0]])
    wanted = -2 * Omega * sp.Matrix([xdot, ydot]) + omega**2 * sp.Matrix([x, y])
    assert [sp.expand(field.equations[v] - e) for v, e in zip((xdot, ydot), wanted)] == [0, 0]
    assert field.equations[t] == 1


@pytest.mark.exhaustive
def test_equations_agree_with_the_derivation_of_sympy() -> None:
    a, b, adot, bdot, l1, l2 = sp.symbols("a b adot bdot l1 l2")
    T = m * l1**2 * adot**2 + m * l2**2 * bdot**2 / 2 + m * l1 * l2 * adot * bdot * sp.cos(a - b)
    L = T + 2 * m * g * l1 * sp.cos(a) + m * g * l2 * sp.cos(b)
    values = {m: 1, g: 9.81, l1: 1, l2: sp.Rational(1, 2)}
    ours = LagrangianSystem(L, [a, b], [adot, bdot], parameters=values).euler_lagrange()
    A, B = dynamicsymbols("A B")
    functions = {a: A, b: B, adot: A.diff(), bdot: B.diff()}
    method = LagrangesMethod(L.subs({adot: A.diff(), bdot: B.diff()}).subs({a: A, b: B}), [A, B])
    method.form_lagranges_equations()
    theirs = method.rhs()
    point = {a: 0.7, b: -1.1, adot: 0.4, bdot: 1.3}
    numbers = {functions[s]: value for s, value in point.items()}
    for mine, other in zip(ours.rates, theirs):
        other = other.subs({k: v for k, v in numbers.items() if k.is_Derivative}).subs(numbers).subs(values)
        assert float(mine.subs(values).subs(point)) == pytest.approx(float(other), rel=1e-12)


def test_a_lagrangian_need_not_be_quadratic() -> None:
    # A relativistic particle in a linear potential: p = m x'/sqrt(1 - x'^2) grows at a constant rate.
    L = -m * sp.sqrt(1 - xdot**2 / 100) - m * g * x
    system = LagrangianSystem(L, [x], [xdot], parameters={m: 1, g: 2})
    assert not system.is_quadratic
    assert system.energy_rate() == 0
    run = integrate(system.euler_lagrange(), start={"x": 0, "xdot": 0}, span=(0, 1), at=[1.0], **TIGHT)
    v = run["xdot"][0]
    assert v / 100 / np.sqrt(1 - v**2 / 100) == pytest.approx(-2, rel=1e-10)


def test_a_potential_with_a_corner_pulls_to_it() -> None:
    field = LagrangianSystem(xdot**2 / 2 - sp.Abs(x), [x], [xdot]).euler_lagrange()
    assert field.rates == (xdot, -sp.sign(x))


def test_forces_change_the_energy_by_their_power() -> None:
    c, F, k = sp.symbols("c F k")
    system = LagrangianSystem(
        m * xdot**2 / 2 - k * x**2 / 2,
        [x],
        [xdot],
        forces={x: -c * xdot + F * sp.cos(omega * t)},
        parameters={m: 2, k: 3, c: 0.1, F: 1, omega: 2},
        time=t,
    )
    assert sp.expand(system.energy_rate() - xdot * (-c * xdot + F * sp.cos(omega * t))) == 0
    assert sp.expand(system.euler_lagrange().equations[xdot] * m + k * x + c * xdot) == F * sp.cos(omega * t)


def test_explicit_time_spoils_the_energy_exactly_by_the_lagrangians_own_rate() -> None:
    L = m * xdot**2 / 2 - (1 + sp.sin(omega * t) / 2) * x**2
    system = LagrangianSystem(L, [x], [xdot], parameters={m: 1, omega: 2}, time=t)
    assert sp.expand(system.energy_rate() + sp.diff(L, t)) == 0
    assert system.energy_rate() != 0


def test_a_mass_that_grows_with_time_brakes() -> None:
    # The Lagrangian of Caldirola and Kanai for the damped oscillator.
    c, k = sp.symbols("c k")
    L = sp.exp(2 * c * t) * (xdot**2 - k * x**2) / 2
    field = LagrangianSystem(L, [x], [xdot], parameters={c: 0.1, k: 2}, time=t).euler_lagrange()
    assert sp.expand(field.equations[xdot] + 2 * c * xdot + k * x) == 0


small = st.integers(-3, 3)


@pytest.mark.exhaustive
@settings(max_examples=10)
@given(st.lists(small, min_size=8, max_size=8))
def test_energy_is_conserved_for_any_lagrangian_of_positions_and_velocities(c: list[int]) -> None:
    # A mass matrix J^T J + 1 with J a function of angles, a magnetic term and a potential.
    J = sp.Matrix([[c[0] + c[1] * sp.cos(x), sp.sin(y)], [c[2] * sp.sin(x + y), c[3] * sp.cos(2 * y)]])
    v = sp.Matrix([xdot, ydot])
    moved = J * v
    L = (moved.dot(moved) + v.dot(v)) / 2 + (c[4] * sp.sin(y) + c[5] * x) * xdot
    L += c[6] * sp.cos(x - y) + c[7] * x * y
    system = LagrangianSystem(L, [x, y], [xdot, ydot])
    assert system.energy_rate() == 0


def test_half_and_double_angles_are_the_same_angle() -> None:
    L = (2 * sp.cos(x / 2) ** 2 - sp.cos(x) + sp.tan(y) ** 2 * sp.cos(y) ** 2) * xdot**2 / 2
    L += (sp.cos(y) ** 2 * xdot**2 + ydot**2) / 2
    system = LagrangianSystem(L, [x, y], [xdot, ydot])
    # 2 cos^2(x/2) - cos x = 1, and tan^2 cos^2 + cos^2 = 1.
    assert system.mass_matrix == sp.diag(2, 1)
    assert system.euler_lagrange().rates == (xdot, ydot, 0, 0)


def test_a_high_harmonic_by_itself_is_an_angle_of_its_own() -> None:
    """As powers of the cosine of x it takes nine terms, which cancel."""
    system = LagrangianSystem(xdot**2 / 2 - sp.cos(18 * x) / 18, [x], [xdot])
    assert system.euler_lagrange().rates == (xdot, sp.sin(18 * x))


@pytest.mark.parametrize("multiple", [2, 7, sp.Rational(3, 2), sp.Rational(-5, 3)])
def test_multiples_of_an_angle_are_chebyshev_polynomials_of_it(multiple: sp.Rational) -> None:
    L = (1 + sp.cos(x) ** 2) * xdot**2 / 2 - sp.cos(multiple * x) + sp.sin(multiple * x + y) * ydot**2 / 9
    L += ydot**2 / 2
    system = LagrangianSystem(L, [x, y], [xdot, ydot])
    at = {x: sp.Rational(3, 10), y: sp.Rational(-1, 4), xdot: sp.Rational(2, 5), ydot: sp.Rational(1, 3)}
    q, v = [x, y], [xdot, ydot]
    mass = [L.diff(u, u) for u in v]
    push = [L.diff(s) - sum(L.diff(u, r) * w for r, w in zip(q, v)) for s, u in zip(q, v)]
    expected = [float((f / m).xreplace(at)) for f, m in zip(push, mass)]
    assert [float(r.xreplace(at)) for r in system.euler_lagrange().rates[2:]] == pytest.approx(
        expected, rel=1e-12
    )


def test_equations_with_accelerations_vanish_on_the_solution() -> None:
    a = sp.Symbol("a")
    system = LagrangianSystem(m * xdot**2 * (1 + x**2) / 2, [x], [xdot], parameters={m: 2})
    left = system.equations([a])[x]
    assert left.has(a)
    assert sp.cancel(left.subs(a, system.euler_lagrange().equations[xdot])) == 0


def test_equal_systems_are_equal_and_hash_alike() -> None:
    one, two = rotating_frame(), rotating_frame()
    assert one == two
    assert hash(one) == hash(two)
    assert one != LagrangianSystem(xdot**2, [x], [xdot])
    assert repr(LagrangianSystem(xdot**2, [x], [xdot])) == "LagrangianSystem(L = xdot**2 in x)"


X = dynamicsymbols("x")
REFUSED = {
    "degenerate": (lambda: LagrangianSystem(xdot**2 / 2 + y, [x, y], [xdot, ydot]), "degenerate.*xdot"),
    "degenerate by an identity": (
        lambda: LagrangianSystem((sp.cos(x) * xdot - sp.sin(x) * ydot) ** 2, [x, y], [xdot, ydot]),
        "degenerate",
    ),
    "linear": (lambda: LagrangianSystem(x * ydot - y * xdot, [x, y], [xdot, ydot]), "degenerate"),
    "massless": (lambda: LagrangianSystem(m * xdot**2, [x], [xdot], parameters={m: 0}), "values m = 0"),
    "unknown symbol": (lambda: LagrangianSystem(m * xdot**2, [x], [xdot]), r"m\*xdot\*\*2.*m has no value"),
    "undeclared time": (lambda: LagrangianSystem(t * xdot**2, [x], [xdot]), "t has no value"),
    "functions of time": (lambda: LagrangianSystem(xdot**2 - X, [x], [xdot]), r"contains x\(t\)"),
    "dynamic coordinate": (lambda: LagrangianSystem(xdot**2, [X], [xdot]), "plain SymPy symbols"),
    "one velocity short": (lambda: LagrangianSystem(xdot**2, [x, y], [xdot]), "one velocity"),
    "named twice": (lambda: LagrangianSystem(xdot**2, [x, x], [xdot, ydot]), "x is named twice"),
    "text": (lambda: LagrangianSystem("xdot**2", [x], [xdot]), "is a str"),  # pyright: ignore
    "masked": (lambda: LagrangianSystem(np.ma.masked, [x], [xdot]), "Lagrangian is a masked value"),  # pyright: ignore
    "force elsewhere": (lambda: LagrangianSystem(xdot**2, [x], [xdot], forces={y: 1}), "y, which is no coord"),
    "force unknown": (lambda: LagrangianSystem(xdot**2, [x], [xdot], forces={x: -m}), "force along x is -m"),
    "time a coordinate": (lambda: LagrangianSystem(xdot**2, [x], [xdot], time=x), "time is a symbol"),
}


@pytest.mark.parametrize("case", list(REFUSED))
def test_what_is_no_lagrangian_system_is_refused_by_name(case: str) -> None:
    call, words = REFUSED[case]
    with pytest.raises(DeclarationError, match=words):
        call()


@pytest.mark.parametrize("wrong", [None, 3, "x"])
def test_coordinates_that_are_no_sequence_are_refused(wrong):
    x, xdot = sp.symbols("x xdot")
    for arguments in ((xdot**2, wrong, [xdot]), (xdot**2, [x], wrong)):
        with pytest.raises(DeclarationError, match="is a sequence of SymPy symbols"):
            LagrangianSystem(*arguments)
