from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gsp.results.bounds import at_least, at_most, inside, outside

numbers = st.floats(allow_nan=False, allow_infinity=False)


@given(numbers, st.integers(1, 17))
def test_the_text_of_a_bound_is_on_its_safe_side(bound: float, digits: int) -> None:
    low, high = Fraction(at_least(bound, digits)), Fraction(at_most(bound, digits))
    assert low <= Fraction(bound) <= high


@given(numbers, st.integers(1, 15))
def test_the_text_of_a_bound_is_next_to_it(bound: float, digits: int) -> None:
    low, high = Fraction(at_least(bound, digits)), Fraction(at_most(bound, digits))
    assert high - low <= abs(Fraction(bound)) * Fraction(10) ** (1 - digits)


@pytest.mark.parametrize(
    ("bound", "low", "high"),
    [
        (0.1234567, "0.123456", "0.123457"),
        (-0.1234567, "-0.123457", "-0.123456"),
        (2.0, "2", "2"),
        (100.0, "100", "100"),
        (1234567.0, "1.23456e+06", "1.23457e+06"),
        (999999.9, "999999", "1e+06"),
        (0.00012345678, "0.000123456", "0.000123457"),
        (0.000012345678, "1.23456e-05", "1.23457e-05"),
        (5e-324, "4.94065e-324", "4.94066e-324"),
        (0.0, "0", "0"),
        (float("inf"), "inf", "inf"),
        (float("nan"), "nan", "nan"),
    ],
)
def test_bounds_are_written_as_other_numbers_are(bound: float, low: str, high: str) -> None:
    assert at_least(bound) == low
    assert at_most(bound) == high


@given(numbers, numbers)
def test_ends_are_told_to_the_digits_of_what_is_between_them(a: float, b: float) -> None:
    low, high = Fraction(min(a, b)), Fraction(max(a, b))
    (outer_low, outer_high), (inner_low, inner_high) = (
        map(Fraction, told(float(low), float(high))) for told in (outside, inside)
    )
    assert outer_low <= low <= inner_low
    assert inner_high <= high <= outer_high
    if low < high:
        assert inner_low < inner_high
        assert outer_high - outer_low - (high - low) <= (high - low) * Fraction(10) ** -4


def test_an_interval_far_from_the_origin_is_not_told_as_one_number() -> None:
    """It was "from -999998 to -999998"."""
    assert inside(-999998.3, -999997.875) == ("-999998.3", "-999997.875")
