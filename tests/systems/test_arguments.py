"""The checkers of arguments: what each takes, at its very borders, and how what it refuses is called."""

from __future__ import annotations

import pickle
from fractions import Fraction
from math import inf, isnan, nan

import numpy as np
import pytest
import sympy as sp

from gsp.errors import DeclarationError
from gsp.integration.loop import check_grid
from gsp.systems import arguments
from gsp.systems.declaration import equations_of, reconstruction_of
from gsp.systems.flow import (
    HIGHEST_ORDER,
    LARGEST,
    Flow,
    Question,
    as_points,
    check_epsilon,
    check_epsilons,
    check_given,
    check_order,
    check_orders,
    complete,
    frozen,
    plain,
    read_only,
)
from gsp.systems.region import check_interval, check_region
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, epsilon = sp.symbols("x y z epsilon")
SYSTEM = SlowFastSystem(slow={x: y}, fast={y: x - y}, epsilon=epsilon)


def words(call, *given, **named) -> str:
    """What the refusal of a call says."""
    with pytest.raises(DeclarationError) as caught:
        call(*given, **named)
    return str(caught.value)


@pytest.mark.parametrize(
    ("value", "number"),
    [
        (2, 2.0), (0.5, 0.5), (np.float32(0.5), 0.5), (np.int64(-3), -3.0), (np.array(7), 7.0), ("1e3", 1000.0),
        (Fraction(1, 4), 0.25), (sp.Rational(1, 4), 0.25), (sp.pi, float(sp.pi)), (10**400, inf), (-(10**400), -inf),
        (inf, inf), (True, nan), (np.True_, nan), (1j, nan), (np.complex128(1), nan), (b"1", nan),
        (bytearray(b"1"), nan), (np.array([1.0]), nan), (np.array("1"), nan), (np.array(True), nan), ("one", nan),
        (None, nan), (x, nan), ([1], nan),
    ],
)  # fmt: skip
def test_what_counts_as_one_real_number(value, number: float) -> None:
    found = arguments.as_float(value)
    assert type(found) is float
    assert isnan(found) if isnan(number) else found == number


def test_numbers_are_taken_between_their_borders_and_not_on_open_ones() -> None:
    check = arguments.check_number
    assert [check(v, what="q", above=0, below=1) for v in (5e-324, 0.5, 1 - 2**-53)] == [
        5e-324,
        0.5,
        1 - 2**-53,
    ]
    for wrong in (0, 1, -1, 2, nan, inf, -inf):
        assert words(check, wrong, what="q", above=0, below=1).startswith("q is a finite number.")
    assert check(0.0, what="q", least=0.0) == 0.0
    assert words(check, -5e-324, what="q", least=0.0, be="not negative", remedy="Try 1.") == (
        "q is not negative. Got -5e-324. Try 1."
    )
    assert check(-1e308, what="q") == -1e308
    for wrong in (inf, -inf, nan):
        words(check, wrong, what="q")
    assert arguments.check_positive(5e-324, what="q") == 5e-324
    assert words(arguments.check_positive, 0.0, what="q").startswith("q is a positive number. Got 0.0")


def test_whole_numbers_are_taken_from_the_least_to_the_most() -> None:
    check = arguments.check_whole
    assert [check(v, what="q") for v in (0, 10**30, np.int8(3))] == [0, 10**30, 3]
    assert [check(v, what="q", least=-2, most=2) for v in (-2, 0, 2)] == [-2, 0, 2]
    for wrong in (-3, 3, 1.0, True, np.True_, np.array(1), "1", None):
        assert words(check, wrong, what="q", least=-2, most=2).startswith(
            "q is a whole number from -2 to 2. Got"
        )
    assert words(check, -1, what="q") == "q is a whole number, 0 or more. Got -1."
    assert words(check, 0, what="q", least=1, be="a count", remedy="Try 1.") == "q is a count. Got 0. Try 1."
    assert words(check, -1, what="orders").startswith("orders are")
    assert words(check, -1, what="axis").startswith("axis is")
    among = arguments.check_one_of
    assert [among(v, (2, 4, 8), what="q", be="2, 4 or 8") for v in (2, 4, 8)] == [2, 4, 8]
    for wrong in (1, 3, 9):
        assert words(among, wrong, (2, 4, 8), what="q", be="2, 4 or 8") == f"q is 2, 4 or 8. Got {wrong}."


def test_flags_texts_and_progress() -> None:
    for given in (True, False):
        assert arguments.check_flag(given, what="q") is given
        assert arguments.check_flag(np.bool_(given), what="q") is given
    for wrong in (1, 0, None, "True"):
        assert words(arguments.check_flag, wrong, what="q").startswith("q is True or False")
    assert arguments.check_text("", what="q") == ""
    assert words(arguments.check_text, b"a", what="q").startswith("q is text. Got b'a'")
    arguments.check_progress(None)
    arguments.check_progress(print)
    assert "called with the fraction done" in words(arguments.check_progress, 1)


def test_sequences_are_checked_one_by_one() -> None:
    check = arguments.check_each
    whole = lambda value: arguments.check_whole(value, what="each")  # noqa: E731
    assert check([2, 1], whole, what="q", be="counts") == (2, 1)
    assert check((v for v in (1, 2)), whole, what="q", be="counts", length=2) == (1, 2)
    assert check(np.array([3]), whole, what="q", be="counts") == (3,)
    for wrong in ("12", b"12", int, 3, {"a": 1}, np.array(3), [1, 2, 3], [1]):
        assert words(check, wrong, whole, what="q", be="counts", length=2).startswith("q is counts. Got")
    assert words(check, [-1], whole, what="q", be="counts").startswith("each is a whole number")


def test_arrays_hold_numbers_only() -> None:
    check = arguments.check_array
    for given in (
        [1, 2],
        (1.5,),
        np.array([[1, 2]], dtype=np.uint8),
        3,
        [nan, inf],
        [],
        [10**30, sp.Rational(1, 2)],
    ):
        found = check(given, what="q", be="numbers")
        assert found.dtype == float
        assert found.shape == np.shape(given)
    assert check([10**30, sp.Rational(1, 2)], what="q", be="numbers").tolist() == [1e30, 0.5]
    assert np.isnan(check(np.array([nan, 1], dtype=object), what="q", be="numbers")).tolist() == [True, False]
    for wrong in (
        "ab",
        [True, 1.0],
        ["a"],
        [None],
        [1.0, [2.0]],
        np.array([True]),
        [1j],
        [x],
        np.array([None, 1.0]),
    ):
        assert words(check, wrong, what="q", be="numbers").startswith("q is numbers. Got")


@pytest.mark.filterwarnings("error")
def test_no_masked_value_is_taken_for_a_number() -> None:
    # float() makes NaN of it, with a warning, and asarray what lies beneath.
    masked = np.ma.masked
    half = np.ma.array([0.1, 0.2], mask=[False, True])
    bare = np.ma.array([0.1, 0.2])
    assert isnan(arguments.as_float(masked))
    assert isnan(arguments.as_float(np.ma.array(0.1, mask=True)))
    assert arguments.as_float(np.ma.array(0.1)) == 0.1
    for given in (half, masked, [0.1, masked], [[masked]], (half,)):
        assert "masked" in words(arguments.check_array, given, what="q", be="numbers")
    found = arguments.check_array(bare, what="q", be="numbers")
    assert type(found) is np.ndarray
    assert found.tolist() == [0.1, 0.2]
    assert plain({"x": masked}, ("x",)) is None
    for given in (masked, half[1:]):
        assert "masked value" in words(complete, {"x": given}, (x,), what="start")
    assert "a masked value" in words(check_epsilon, masked)
    assert words(check_grid, half, 0.0, 1.0) == (
        "at is a sequence of times. Got an array of the shape (2,) and type float64 with masked values."
    )
    assert type(check_grid(bare, 0.0, 1.0)) is np.ndarray
    assert "x is a MaskedConstant, a masked value" in words(equations_of, {x: masked}, "states")


def test_values_are_shown_short_and_on_one_line() -> None:
    shown = arguments.shown
    assert shown(10**40 - 1) == str(10**40 - 1)
    assert shown(10**40) == "an integer of 133 bits"
    assert shown(-(10**40)) == "a negative integer of 133 bits"
    assert shown(True) == "True"
    assert shown(np.zeros((2, 3))) == "an array of the shape (2, 3) and type float64"
    assert (shown(float), shown(len), shown(SYSTEM)) == (
        "the class float", "the function len", "a SlowFastSystem",
    )  # fmt: skip
    assert shown("a\n  b") == r"'a\n b'"
    assert len(shown("a" * 198)) == 200
    assert len(shown("a" * 199)) < 100
    assert "..." in shown("a" * 199)
    assert shown([10**5000]) == "a list"


def test_the_wrong_noun_is_told_the_verbs_that_come_first() -> None:
    from gsp import expand, split
    from gsp.critical.critical_manifold import solve_critical
    from gsp.slow.series import SeriesManifold

    check = arguments.check_noun
    check(SYSTEM, SlowFastSystem, verb="v")
    check(SYSTEM, (VectorField, Flow), verb="v")
    field = VectorField({x: -x / epsilon, y: x}, epsilon=epsilon)
    branch = solve_critical(SYSTEM).branches[0]
    kinds = {"SeriesManifold": type(expand(branch, order=1)), "Branch": type(branch)}
    assert words(check, field, SlowFastSystem, verb="solve_critical") == (
        "solve_critical takes a SlowFastSystem. Got a VectorField. Use solve_critical(split(field).system, ...)."
    )
    assert "Use restrict(expand(branch), ...)." in words(check, branch, SeriesManifold, verb="restrict")
    assert "Use restrict(expand(solve_critical(system).branches[0]), ...)." in words(
        check, SYSTEM, kinds["SeriesManifold"], verb="restrict"
    )
    # None of ours: where such a noun comes from, unless that is the verb itself.
    assert words(check, 3, kinds["Branch"], verb="expand") == (
        "expand takes a Branch. Got 3. Use solve_critical(system).branches[0], or .nearest(start)."
    )
    assert words(check, 3, SlowFastSystem, verb="split").endswith("Got 3.")
    assert "Got the class SlowFastSystem, not an instance of it." in words(
        check, SlowFastSystem, SlowFastSystem, verb="solve_critical"
    )
    assert "Got the class float. " in words(check, float, SlowFastSystem, verb="solve_critical")
    assert words(check, 3, (VectorField, SlowFastSystem), verb="split").startswith(
        "split takes a VectorField or a SlowFastSystem."
    )
    assert words(check, 3, Flow, verb="integrate").startswith(
        "integrate takes a SlowFastSystem, a VectorField or a ReducedFlow."
    )
    from gsp.analysis.analysis import Analysis

    assert words(check, 3, Analysis, verb="v") == "v takes an Analysis. Got 3. Use analyse(scene)."
    assert split(field).is_standard


# -- epsilon and orders ------------------------------------------------------------------------------


def test_epsilon_is_taken_where_its_third_powers_are_held() -> None:
    assert [check_epsilon(v) for v in (1 / LARGEST, 0.01, 1, LARGEST)] == [1 / LARGEST, 0.01, 1.0, LARGEST]
    for far in (np.nextafter(1 / LARGEST, 0), np.nextafter(LARGEST, inf), 5e-324):
        assert "where its powers leave double precision" in words(check_epsilon, far)
    for wrong in (0, 0.0, -0.1, inf, -inf, nan):
        assert words(check_epsilon, wrong).startswith("epsilon must be finite and positive.")
    for wrong in (True, "a", None, 1j):
        assert words(check_epsilon, wrong).startswith("epsilon is a positive number.")
    assert words(check_epsilon, 0, what="every epsilon").startswith("every epsilon must")
    assert check_epsilons([0.1, 2]) == (0.1, 2.0)
    assert words(check_epsilons, 0.1).startswith("epsilons is a sequence of positive numbers")
    assert words(check_epsilons, [0.1, 0]).startswith("every epsilon must be finite")


def test_orders_are_taken_from_zero_to_the_highest() -> None:
    assert (check_order(0), check_order(HIGHEST_ORDER)) == (0, HIGHEST_ORDER)
    for wrong in (-1, HIGHEST_ORDER + 1, 1.5, True):
        assert words(check_order, wrong).startswith("order is a non-negative integer, 200 at most.")
    assert check_orders((3, 0)) == (3, 0)
    assert check_orders([], empty=True) == ()
    assert words(check_orders, []) == (
        "orders are non-negative integers, one or more. Got none. Try (0, 1, 2, 3)."
    )
    assert words(check_orders, 3).startswith("orders are a sequence of non-negative integers. Got 3")


# -- points, regions, questions ----------------------------------------------------------------------


def test_a_plain_point_is_read_in_order_and_any_other_is_left() -> None:
    assert plain({"y": 2, "x": 1}, ("x", "y")) == (1.0, 2.0)
    for other in (
        {"x": 1}, {"x": 1, "y": 2, "z": 3}, {"x": 1, "z": 2}, {"x": 1, "y": nan}, {"x": 1, "y": inf},
        {"x": 1, "y": True},
        {"x": 1, "y": "a"}, {"x": 1, "y": np.array([1.0])}, {"x": 1, "y": 10**400}, {x: 1, y: 2}, [1, 2],
    ):  # fmt: skip
        assert plain(other, ("x", "y")) is None
    assert complete({y: 2, "x": 1}, (x, y), what="start") == (1.0, 2.0)
    # Two large numbers are finite though their sum is not.
    assert complete({"x": 1e308, "y": 1e308}, (x, y), what="start") == (1e308, 1e308)
    assert words(check_given, {"x": 1}, ["x", "y"], what="start") == (
        "start gives no value for y. Got {'x': 1}. Give every state a value."
    )


def test_a_question_takes_what_is_given_in_place_of_its_own() -> None:
    class Own(Question):
        full_flow, full_start, span, epsilon = SYSTEM, {"x": 1.0, "y": 2.0}, (0.0, 3.0), 0.1

    assert Own().setting(None, None, None) == (SYSTEM, {"x": 1.0, "y": 2.0}, (0.0, 3.0), 0.1)
    assert Own().setting({"x": 5.0}, (1.0, 2.0), 0.5) == (SYSTEM, {"x": 5.0}, (1.0, 2.0), 0.5)


def test_regions_end_where_third_powers_do() -> None:
    assert check_region({"x": (-LARGEST, LARGEST), "y": (0.0, 1 / LARGEST)}, ["x", "y"])["y"] == (
        0.0,
        1 / LARGEST,
    )
    for far in ((0.0, np.nextafter(LARGEST, inf)), (np.nextafter(-LARGEST, -inf), 0.0), (0.0, 9.9e-101)):
        assert "Rescale x" in words(check_region, {"x": far}, ["x"])
    assert check_interval(np.array([1, 2]), what="bounds", remedy="") == (1.0, 2.0)
    assert words(check_interval, (2, 1), what="amplitudes", remedy="").startswith("the amplitudes are reversed")
    assert words(check_interval, (2, 1), what="bounds of x", remedy="").startswith(
        "the bounds of x are reversed"
    )
    assert words(check_interval, (2, 1), what="span", remedy="").startswith("the span is reversed")
    assert words(check_interval, np.array(1.0), what="bounds", remedy="Give two.").startswith(
        "bounds are a pair"
    )
    assert words(check_interval, (2, 1), what="bounds", remedy="") == "the bounds are reversed. Got (2, 1)."
    assert words(check_interval, (1, 1), what="span", remedy="") == "the span is empty. Got (1, 1)."


def test_a_field_without_a_small_parameter_may_hold_what_epsilon_may_not_stand_in() -> None:
    field = VectorField({x: sp.exp(-1 / y), y: x ** sp.Rational(1, 2)}, epsilon=None)
    assert field.rates == (sp.exp(-1 / y), sp.sqrt(x))
    with pytest.raises(DeclarationError, match="epsilon stands in"):
        VectorField({x: sp.exp(-1 / epsilon), y: x}, epsilon=epsilon)


def test_what_is_called_a_function_has_a_name() -> None:
    import functools

    assert arguments.shown(functools.partial(print)) == "functools.partial(<built-in function print>)"


@pytest.mark.parametrize("value", [3.0, [3.0], [[3.0]], {"x": 3.0}, {x: [3.0]}])
def test_a_point_in_one_symbol_may_be_a_number_a_mapping_or_a_row(value) -> None:
    points, single = as_points((x,), value, what="x")
    assert points.tolist() == [[3.0]]
    assert single == (value == 3.0 or value == {"x": 3.0})
    assert as_points((x, y), [1.0, 2.0], what="x")[1]
    assert not as_points((x, y), [[1.0, 2.0]], what="x")[1]
    assert "has shape (1, 2)" in words(as_points, (x,), [[1.0, 2.0]], what="x")


def test_starts_of_many_are_those_of_each_also_where_a_flow_has_its_own() -> None:
    class Shifted(Flow):
        states = (x, y)

        def initial(self, start):
            return tuple(v + 1.0 for v in complete(start, self.states, what="start"))

    columns = {"y": np.array([1.0, 2.0]), "x": np.array([3.0, 4.0])}
    assert SYSTEM.initials(columns).tolist() == [[3.0, 1.0], [4.0, 2.0]]
    assert Shifted().initials(columns).tolist() == [[4.0, 2.0], [5.0, 3.0]]
    assert words(SYSTEM.initials, {"x": columns["x"]}).startswith("starts gives no value for y")
    assert words(Shifted().initials, {"x": columns["x"]}).startswith("member 0: start gives no value for y")


def test_what_a_result_holds_cannot_be_written_to() -> None:
    array = np.zeros(2)
    assert frozen(array) is array
    with pytest.raises(ValueError, match="read-only"):
        array[0] = 1.0
    values = {"a": 1}
    view = read_only(values)
    values["a"] = 2
    assert view["a"] == 1
    assert pickle.loads(pickle.dumps(view)) == view


def test_a_reconstruction_is_rates_of_further_variables() -> None:
    assert reconstruction_of(SYSTEM, None) == {}
    assert reconstruction_of(SYSTEM, {z: x + y}) == {z: x + y}
    for symbol, role in ((x, "a state"), (epsilon, "epsilon")):
        assert f"also {role}." in words(reconstruction_of, SYSTEM, {symbol: x})
    assert words(reconstruction_of, SYSTEM, {z: sp.Symbol("q")}).startswith(
        "the reconstruction of z contains q, which"
    )
