"""Declarations: what is refused and in which words, exact numbers, equality, and how a system prints."""

from __future__ import annotations

import pickle
from collections import defaultdict

import numpy as np
import pytest
import sympy as sp

from gsp.errors import DeclarationError
from gsp.systems.declaration import exact
from gsp.systems.flow import as_points, check_epsilon, values_by_name
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, a, b, epsilon = sp.symbols("x y z a b epsilon")


def standard(f=y, g=x - y, **options) -> SlowFastSystem:
    return SlowFastSystem(slow={x: f}, fast={y: g}, epsilon=options.pop("epsilon", epsilon), **options)


REFUSED = {
    "no epsilon": (lambda: standard(epsilon=None), "small parameter. Got epsilon=None"),
    "epsilon is a number": (lambda: standard(epsilon=0.1), "epsilon is a SymPy symbol. Got 0.1"),
    "epsilon is a string": (lambda: standard(epsilon="epsilon"), "epsilon is a SymPy symbol"),
    "epsilon in a sine": (lambda: standard(g=sp.sin(epsilon * x) - y), r"epsilon stands in sin\(epsilon\*x\)"),
    "epsilon in an exponential": (lambda: standard(f=sp.exp(-x / epsilon)), r"epsilon stands in exp\("),
    "epsilon under a root": (lambda: standard(f=y * sp.sqrt(epsilon)), r"epsilon stands in sqrt\(epsilon\)"),
    "epsilon in an exponent": (lambda: standard(f=x**epsilon), r"epsilon stands in x\*\*epsilon"),
    "epsilon to a parameter": (lambda: standard(f=epsilon**a, parameters={a: 2}), "no pole or power"),
    "a pole in a slow rate": (lambda: standard(f=y / epsilon), "slow rate of x has a pole of order 1"),
    "a pole in a fast rate": (lambda: standard(g=y / epsilon**2), "fast rate of y has a pole of order 2"),
    "a hidden pole": (lambda: standard(f=y / (epsilon + epsilon**2)), "pole of order 1"),
    "an undeclared parameter": (lambda: standard(f=a * y), "a has no value: it is no state and no parameter"),
    "a parameter without value": (lambda: standard(f=a * y, parameters={a: None}), "parameter a has no value"),
    "an infinite parameter": (lambda: standard(f=a * y, parameters={a: float("inf")}), "inf is no finite"),
    "a parameter that is no number": (
        lambda: standard(f=a * y, parameters={a: float("nan")}),
        "nan is no finite",
    ),
    "a complex parameter": (lambda: standard(f=a * y, parameters={a: 1j}), "1j is no number"),
    "an irrational parameter": (
        lambda: standard(f=a * y, parameters={a: sp.pi}),
        "pi is irrational, and values are exact fractions. Give digits, 3.1415926535897932",
    ),
    "code as a parameter": (lambda: standard(f=a * y, parameters={a: "__import__('os')"}), "is no number"),
    "a tower as a parameter": (lambda: standard(f=a * y, parameters={a: "1e999999999"}), "is no number"),
    "a misspelt parameter": (lambda: standard(f=y, parameters={"a": 1}), "keyed by SymPy symbols"),
    "a rate as text": (lambda: standard(f="y"), "right-hand side of x is a str, 'y'"),
    "a rate that is a matrix": (lambda: standard(f=sp.Matrix([y])), "no scalar expression"),
    "a rate that is a relation": (lambda: standard(f=x < y), "no scalar expression"),
    "a division by zero": (lambda: standard(f=sp.zoo * y), "not finite"),
    "an infinite rate": (lambda: standard(f=float("inf")), "no finite real number"),
    "a complex rate": (lambda: standard(f=y * sp.sqrt(-2)), "is complex"),
    "an undefined function": (lambda: standard(f=sp.Function("q")(x)), r"unknown function q\(x\)"),
    "a state that depends on time": (lambda: standard(f=sp.Function("y")(sp.Symbol("t"))), "t' = 1|no value"),
    "an open derivative": (lambda: standard(f=sp.Derivative(x**2, x)), "Carry out derivatives"),
    "no fast variable": (lambda: SlowFastSystem(slow={x: x}, fast={}, epsilon=epsilon), "1 slow and 0 fast"),
    "no mapping": (
        lambda: SlowFastSystem(slow=[x], fast={y: y}, epsilon=epsilon),
        "maps symbols to expressions",
    ),
    "a name for a key": (lambda: SlowFastSystem(slow={"x": y}, fast={y: y}, epsilon=epsilon), "the key 'x'"),
    "slow and fast": (
        lambda: SlowFastSystem(slow={x: y}, fast={x: y}, epsilon=epsilon),
        "x is declared slow and fast",
    ),
    "epsilon is a state": (lambda: standard(epsilon=x), "x is a state and also epsilon"),
    "a parameter is a state": (lambda: standard(parameters={y: 1}), "y is a state and also a parameter"),
    "an observable is a state": (lambda: standard(observables={y: x}), "y is a state and also an observable"),
    "an observable is a parameter": (
        lambda: standard(parameters={a: 1}, observables={a: x}),
        "a is an observable and also a parameter",
    ),
    "epsilon is a parameter": (
        lambda: standard(parameters={epsilon: 1}),
        "epsilon is epsilon and also a parameter",
    ),
    "two symbols of one name": (
        lambda: standard(f=sp.Symbol("y", positive=True)),
        "different symbols are named y",
    ),
    "a name that is code": (
        lambda: SlowFastSystem(slow={sp.Symbol("__import__('os')"): x}, fast={y: y}, epsilon=epsilon),
        "no plain word",
    ),
    "a very long name": (lambda: standard(f=sp.Symbol("q" * 65), parameters={}), "no plain word"),
    "a power too large at its parameters": (
        lambda: standard(f=3**a * x, parameters={a: 10**8}),
        r"3\*\*a is too long to be written out. Got a = 100000000. Rescale",
    ),
    "a tower of powers": (
        lambda: standard(f=x + 2 ** (2 ** (2**a)), parameters={a: 40}),
        r"2\*\*\(2\*\*a\) is too long to be written out. Got a = 40",
    ),
    "a degree too high at its parameters": (
        lambda: standard(f=(x + y) ** a, parameters={a: 101}),
        r"\(x \+ y\)\*\*a has an exponent above 100. Got a = 101. Use a smaller one",
    ),
    "a division by a parameter that is zero": (
        lambda: standard(f=x / a, parameters={a: 0}),
        "1/a is zero to a power that is not always positive. Got a = 0",
    ),
    "a division by terms that cancel at the parameters": (
        lambda: standard(f=1 / (x + a * x), parameters={a: -1}),
        r"1/\(a\*x \+ x\) is zero to a power that is not always positive. Got a = -1",
    ),
    "a division by terms that vanish at the parameters": (
        lambda: standard(f=1 / (a * x + b * y**2), parameters={a: 0, b: 0}),
        r"is zero to a power that is not always positive. Got a = 0, b = 0",
    ),
    "a division by functions that cancel at the parameters": (
        lambda: standard(f=1 / (1 - sp.exp(a * x)), parameters={a: 0}),
        r"is zero to a power that is not always positive. Got a = 0",
    ),
    "zero to a state": (
        lambda: standard(f=a**x, parameters={a: 0}),
        r"a\*\*x is zero to a power that is not always positive",
    ),
    "a negative number to a state": (
        lambda: standard(f=a**x, parameters={a: -2}),
        r"a\*\*x is not real. Got a = -2. Keep its base positive",
    ),
    "a comparison of what is not real": (
        lambda: standard(f=sp.Min(x, sp.acos(a)), parameters={a: 1000}),
        r"acos\(a\) is not real and finite. Got a = 1000. Keep its arguments in its domain",
    ),
    "a function too large at its parameters": (
        lambda: standard(f=x + sp.sin(sp.cosh(a)), parameters={a: 10**8}),
        r"cosh\(a\) lies beyond 1e\+300. Got a = 100000000",
    ),
    "a state in an exponent beside a large parameter": (
        lambda: standard(f=sp.Rational(1, 10) ** (a + x), parameters={a: 10**8}),
        r"\(1/10\)\*\*\(a \+ x\) is too long to be written out",
    ),
    "a power hidden in an exponential": (
        lambda: standard(f=sp.exp(a * sp.log(5400 / x)), parameters={a: sp.Rational(-34686008, 15078125)}),
        r"exp\(a\*log\(5400/x\)\) is too long to be written out. Got a = -34686008/15078125",
    ),
    "a root to a large parameter": (
        lambda: standard(f=sp.sqrt(sp.Rational(1, 10)) ** a * x, parameters={a: 10**8}),
        r"\*\*a is too long to be written out. Got a = 100000000",
    ),
    "a root of a number that is too fine": (
        lambda: standard(f=x * sp.Integer(10) ** a, parameters={a: sp.Rational(1, 10**300)}),
        r"10\*\*a is too long to be written out. .* round the exponent",
    ),
    "a comparison that SymPy stumbles over": (
        lambda: standard(f=sp.atan(sp.tan(10**300 - a)) * x, parameters={a: 0}),
        "is not real and finite. Got a = 0",
    ),
    "an empty field": (lambda: VectorField({}, epsilon=epsilon), "at least one state"),
    "a field without its epsilon": (
        lambda: VectorField({x: -x}, epsilon=epsilon),
        r"epsilon does not appear in any equation. Got x' = -x. Leave it out",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_declaration_that_is_not_well_formed_is_refused_by_name(case: str) -> None:
    declare, words = REFUSED[case]
    with pytest.raises(DeclarationError, match=words):
        declare()


@pytest.mark.parametrize(
    "rate", [3**a, (x + y) ** a, a ** sp.Rational(1, 3), 1 / (a - 1), sp.Min(x, sp.acos(a / 100))]
)
def test_powers_and_comparisons_of_parameters_that_are_numbers_are_taken(rate: sp.Expr) -> None:
    assert standard(f=rate * x, parameters={a: 100}).parameters == {a: 100}


def test_an_unknown_symbol_is_answered_with_the_nearest_known_one() -> None:
    kappa, kapa = sp.symbols("kappa kapa")
    with pytest.raises(DeclarationError, match='Did you mean "kappa"'):
        standard(f=kapa * y, parameters={kappa: 1})


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0.2, sp.Rational(1, 5)),
        (np.float64(0.2), sp.Rational(1, 5)),
        (sp.Float(0.2), sp.Rational(1, 5)),
        (7, sp.Integer(7)),
        (np.int64(7), sp.Integer(7)),
        (sp.Rational(3, 7), sp.Rational(3, 7)),
        (1e-3, sp.Rational(1, 1000)),
        ("1/3", sp.Rational(1, 3)),
        ("-2.5e3", sp.Integer(-2500)),
    ],
)
def test_a_number_stays_exact(value, expected) -> None:
    assert exact(value) == expected


@pytest.mark.parametrize("number", [1 / 3, 0.1 + 0.2, 1e-300, 123456.789012345678, 5e-324])
def test_a_float_comes_back_to_the_same_double_by_any_road(number: float) -> None:
    assert float(exact(number)) == number
    assert float(exact(sp.Float(number))) == number


def test_floats_in_rates_and_parameters_become_fractions() -> None:
    system = standard(f=0.2 * y, g=a * x - sp.Float(1 / 3) * y, parameters={a: 0.2})
    assert system.slow[x] == y / 5
    assert system.parameters[a] == sp.Rational(1, 5)
    assert float(system.g[0].coeff(y)) == -1 / 3
    assert not any(rate.atoms(sp.Float) for rate in system.rates)


def test_sizes_of_exponentials_are_those_of_real_symbols() -> None:
    """SymPy writes |exp(x**2)| as exp(re(x)**2 - im(x)**2)."""
    rates = {x: -sp.Abs(sp.exp(x - y)), y: sp.Abs(sp.exp(-a * x**2)) + sp.Abs(2 ** sp.sin(x * y))}
    assert VectorField(rates, parameters={a: 1}).rates == (
        -sp.exp(x - y), sp.exp(-a * x**2) + 2 ** sp.sin(x * y)
    )  # fmt: skip


def test_states_are_slow_then_fast_and_rates_carry_the_pole() -> None:
    system = standard(f=y, g=x - y)
    assert system.states == (x, y)
    assert system.rates == (y, (x - y) / epsilon)
    assert (system.x, system.y) == ((x,), (y,))
    assert (system.f[0], system.g[0]) == (y, x - y)


def test_a_sum_that_vanishes_is_no_pole() -> None:
    nothing = (x + 1) / epsilon - x / epsilon - 1 / epsilon
    assert standard(f=y + nothing).x == (x,)


def test_equal_declarations_are_equal_and_hash_alike() -> None:
    one, two = (standard(f=a * y, parameters={a: 0.5}) for _ in range(2))
    assert one == two
    assert hash(one) == hash(two)
    assert one != one.with_parameters(a=1)
    assert one != standard(f=a * y, parameters={a: 0.5}, name="other")
    field = VectorField({x: a * y, y: (x - y) / epsilon}, epsilon=epsilon, parameters={a: 0.5})
    assert field == field.with_parameters(a="1/2")
    assert hash(field) == hash(field.with_parameters(a=0.5))
    assert field != one


def test_parameters_are_changed_by_name_in_a_new_system() -> None:
    system = standard(f=a * y + b, parameters={a: 1, b: 2})
    other = system.with_parameters(a=0.1)
    assert dict(other.parameters) == {a: sp.Rational(1, 10), b: 2}
    assert dict(system.parameters) == {a: 1, b: 2}
    with pytest.raises(DeclarationError, match='there is no parameter "alpha"'):
        system.with_parameters(alpha=1)


def test_a_declared_system_cannot_be_changed() -> None:
    system = standard(parameters={a: 1})
    with pytest.raises(AttributeError):
        system.epsilon = x  # pyright: ignore[reportAttributeAccessIssue]
    with pytest.raises(TypeError):
        system.parameters[a] = sp.Integer(2)  # pyright: ignore[reportIndexIssue]


def test_a_system_prints_as_one_line_and_as_a_card() -> None:
    system = standard(f=a * y, parameters={a: 0.2}, name="toy")
    assert repr(system) == "SlowFastSystem(slow=[x], fast=[y], epsilon=epsilon, parameters={a: 1/5})"
    assert str(system) == "toy\n          x' = a*y\n  epsilon y' = x - y\n  with a = 1/5"
    field = VectorField({x: -x / epsilon}, epsilon=epsilon)
    assert repr(field) == "VectorField(states=[x], epsilon=epsilon, parameters={})"
    assert str(field).startswith("vector field\n  x' = -x/epsilon")
    assert str(VectorField({x: -x / epsilon}, epsilon=epsilon, name="toy")).startswith("toy\n  x'")
    assert str(standard()).startswith("slow-fast system\n")
    assert r"\begin{aligned}" in system._repr_latex_()


def test_a_field_without_epsilon_is_declared_so() -> None:
    field = VectorField({x: -x}, epsilon=None)
    assert field.epsilon is None
    assert field.initial({"x": 1}) == (1.0,)


def test_a_start_names_every_state_once() -> None:
    system = standard()
    assert system.initial({"y": 2, x: 1}) == (1.0, 2.0)
    assert system.initial({"y": 1e308, "x": 1e308}) == (1e308, 1e308)
    # A mapping that makes up what it lacks is not asked for it.
    with pytest.raises(DeclarationError, match="no value for y"):
        system.initial(defaultdict(float, x=1.0))
    with pytest.raises(DeclarationError, match='start names "w", which is no state'):
        system.initial({"w": 1})
    with pytest.raises(DeclarationError, match="no value for y"):
        system.initial({"x": 1})
    with pytest.raises(DeclarationError, match='"x" twice'):
        system.initial({"x": 1, x: 2, "y": 0})
    with pytest.raises(DeclarationError, match=r"nan. Give a finite number"):
        system.initial({"x": float("nan"), "y": 0})
    with pytest.raises(DeclarationError, match="no real number"):
        system.initial({"x": "one", "y": 0})
    with pytest.raises(DeclarationError, match="mapping of names"):
        values_by_name([1, 2], what="start")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), "small", None])
def test_epsilon_is_finite_and_positive(value) -> None:
    with pytest.raises(DeclarationError, match="epsilon"):
        check_epsilon(value)


def test_points_come_as_mappings_or_arrays() -> None:
    single, batch = (
        as_points((x, y), {"y": 2, x: 1}, what="x"),
        as_points((x, y), {"x": [1, 2], "y": 0}, what="x"),
    )
    assert single[1]
    assert single[0].tolist() == [[1, 2]]
    assert not batch[1]
    assert batch[0].tolist() == [[1, 0], [2, 0]]
    assert as_points((x,), 3.0, what="x")[1]
    assert as_points((x,), [1, 2, 3], what="x")[0].shape == (3, 1)
    for wrong in (
        [1, 2, 3],
        np.zeros((2, 3)),
        "one",
        {"x": [1, 2], "y": [1, 2, 3]},
        {"x": 1},
        {"x": 1, "u": 2},
    ):
        with pytest.raises(DeclarationError):
            as_points((x, y), wrong, what="x")


def test_the_observables_are_part_of_the_declaration() -> None:
    system = standard(observables={z: x + y})
    assert dict(system.observables) == {z: x + y}
    assert system != standard()


def test_errors_survive_pickling() -> None:
    with pytest.raises(DeclarationError) as caught:
        standard(epsilon=None)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def test_a_sum_with_a_term_of_its_own_is_not_worked_out_at_the_parameters(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    worked_out = []
    xreplace = sp.Basic.xreplace
    monkeypatch.setattr(sp.Add, "xreplace", lambda self, rule: worked_out.append(self) or xreplace(self, rule))
    kept, tangled = 1 / (a * (1 + y / 2) + x), 1 / (a * x + x * y + b)
    SlowFastSystem(slow={x: kept}, fast={y: -y}, epsilon=epsilon, parameters={a: 2})
    assert worked_out == []
    SlowFastSystem(slow={x: tangled}, fast={y: -y}, epsilon=epsilon, parameters={a: 2, b: 1})
    assert worked_out == [1 / tangled]


def test_a_field_keeps_all_of_a_system_but_its_equations() -> None:
    words = {"epsilon": epsilon, "parameters": {a: 2}, "name": "named", "observables": {z: x + y}}
    system = SlowFastSystem(slow={x: a * y}, fast={y: x - y}, **words)
    assert system.as_field() == VectorField({x: a * y, y: (x - y) / epsilon}, **words)
    assert system.as_field({x: -x / epsilon, y: y}) == VectorField({x: -x / epsilon, y: y}, **words)


def test_places_are_told_to_six_digits_of_their_distance_from_the_centre() -> None:
    T, x = sp.symbols("T x")
    system = SlowFastSystem(
        slow={T: -((T - 10_000_301) ** 2) - x},
        fast={x: (T - 10_000_301) ** 3 - x},
        epsilon=sp.Symbol("epsilon"),
    )
    assert system.place({T: 10_000_301.0, x: 1 / 3}) == "T = 10000301, x = 0.333333"
    assert system.place({"T": 10_000_301.125}) == "T = 10000301.125"
    # A branch may go to infinity, and a run end there.
    assert system.place([(T, float("-inf")), (x, float("nan"))]) == "T = -inf, x = nan"
