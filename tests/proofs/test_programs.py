"""The checker's programs against a second route: values and slopes in fractions, by dual numbers, and by mpmath."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import mpmath
import pytest

from gsp.proofs import intervals as ia
from gsp.proofs.programs import MOST_DEPTH, MOST_DIGITS, MOST_POWER, MOST_ROOT, IntervalProgram, Rejected
from tests.proof_files import counted_products

F = Fraction


@dataclass(frozen=True)
class Dual:
    """A number and its slopes, exactly."""

    value: Fraction
    slopes: tuple[Fraction, ...]

    def __add__(self, other: Any) -> Dual:
        o = dual(other)
        return Dual(self.value + o.value, tuple(p + q for p, q in zip(self.slopes, o.slopes)))

    def __mul__(self, other: Any) -> Dual:
        o = dual(other)
        return Dual(
            self.value * o.value, tuple(p * o.value + self.value * q for p, q in zip(self.slopes, o.slopes))
        )

    def __pow__(self, n: int) -> Dual:
        return Dual(self.value**n, tuple(n * self.value ** (n - 1) * p for p in self.slopes))

    def __sub__(self, other: Any) -> Dual:
        return self + -1 * dual(other)

    def __neg__(self) -> Dual:
        return -1 * self

    def __truediv__(self, other: Any) -> Dual:
        return self * dual(other) ** -1

    def __radd__(self, other: Any) -> Dual:
        return dual(other) + self

    def __rsub__(self, other: Any) -> Dual:
        return dual(other) - self

    def __rtruediv__(self, other: Any) -> Dual:
        return dual(other) / self

    __rmul__ = __mul__


def dual(value: Any) -> Dual:
    return value if isinstance(value, Dual) else Dual(F(value), (F(0),) * 3)


RATIONAL: dict[str, Callable[[Any, Any, Any], Any]] = {
    "z0 - z1 - z2": lambda a, b, c: a - b - c,
    "z0 - (z1 - z2)": lambda a, b, c: a - (b - c),
    "z0/z1/z2": lambda a, b, c: a / b / c,
    "z0/(z1/z2)*z0": lambda a, b, c: a / (b / c) * a,
    "z0 + z1*z2**3": lambda a, b, c: a + b * c**3,
    "-z1**2": lambda a, b, c: -(b**2),
    "(-z1)**2*z1": lambda a, b, c: b**3,
    "--z0 - -z1": lambda a, b, c: a + b,
    "z0**-2*-z1": lambda a, b, c: -(a**-2) * b,
    "2 - 3*z0/4": lambda a, b, c: 2 - F(3, 4) * a,
    "1/3 + 2/5 - 7/4*z1 - (2/3)/(4/5)*z0*z0": lambda a, b, c: F(11, 15) - F(7, 4) * b - F(5, 6) * a * a,
    "(z0 + z1)*(z0 - z2)/(z1**2 + 3)": lambda a, b, c: (a + b) * (a - c) / (b**2 + 3),
    "  z0 *z1- z1 * z0*z2  ": lambda a, b, c: a * b - b * a * c,
    "z1**5/(1 - z1*z2)**3": lambda a, b, c: b**5 / (1 - b * c) ** 3,
    "5": lambda a, b, c: dual(5),
    "z2": lambda a, b, c: c,
    "3*5*z0 - 2*7/4": lambda a, b, c: 15 * a - F(7, 2),
    "7*z1**0": lambda a, b, c: dual(7),
    "z0/7 - 7/z0 + (3 - z2)/(3 + z2)": lambda a, b, c: a / 7 - 7 / a + (3 - c) / (3 + c),
    "(z0*z2)**4*z0 - 1/(z0*z2)": lambda a, b, c: (a * c) ** 4 * a - 1 / (a * c),
}
MIDDLE, RADII = (F(3, 4), F(-5, 4), F(7, 8)), (F(1, 8), F(1, 16), F(1, 4))


def within(found: ia.Interval, value: Any) -> bool:
    return found[0] <= value * ia.ONE <= found[1]


@pytest.mark.exhaustive
@pytest.mark.parametrize("text", RATIONAL)
def test_values_and_slopes_over_a_box_hold_those_of_every_point_and_of_one_point_hardly_more(text: str) -> None:
    program = IntervalProgram((text,), 3)
    for radii in ((F(0),) * 3, RADII):
        box = [(int((m - r) * ia.ONE), int((m + r) * ia.ONE)) for m, r in zip(MIDDLE, radii)]
        (value,), (slopes,) = program.values(box), program.derivatives(box)
        assert program.derivatives(box, 1) == [slopes[1:]]
        for shares in itertools.product((-1, F(1, 3), 1), repeat=3):
            point = [m + s * r for m, s, r in zip(MIDDLE, shares, radii)]
            exact = RATIONAL[text](
                *(Dual(p, tuple(F(int(i == k)) for k in range(3))) for i, p in enumerate(point))
            )
            assert within(value, exact.value), point
            assert all(map(within, slopes, exact.slopes)), point
        if not any(radii):
            assert max(high - low for low, high in (value, *slopes)) < 1 << 14


TRANSCENDENT: dict[str, Callable[[Any, Any], Any]] = {
    "exp(z0 - z1)": lambda a, b: mpmath.exp(a - b),
    "log(z0*z1)": lambda a, b: mpmath.log(a * b),
    "tanh(z0/z1)": lambda a, b: mpmath.tanh(a / b),
    "sinh(z0*z1) - cosh(z0 - z1)": lambda a, b: mpmath.sinh(a * b) - mpmath.cosh(a - b),
    "sin(3*z0)*cos(2*z1)": lambda a, b: mpmath.sin(3 * a) * mpmath.cos(2 * b),
    "tan(z0) + atan(4*z1)": lambda a, b: mpmath.tan(a) + mpmath.atan(4 * b),
    "sqrt(z0 + z1)/z1": lambda a, b: mpmath.sqrt(a + b) / b,
    "z0**(2/3)*z1**(-3/2)": lambda a, b: a ** (mpmath.mpf(2) / 3) * b ** (-mpmath.mpf(3) / 2),
    "-3*z1*z0/sqrt(1 + z0**2)": lambda a, b: -3 * a * b / mpmath.sqrt(1 + a * a),
    "(pi - z1)*z0**4/(1/16 + z0**4)**2": lambda a, b: (mpmath.pi - b) * a**4 / (mpmath.mpf(1) / 16 + a**4) ** 2,
    "2*z0*(2 - z0)**-2*exp(z1)/z1": lambda a, b: 2 * a / (2 - a) ** 2 * mpmath.exp(b) / b,
    "z0**(3/2)/(z0**(3/2) + z1)": lambda a, b: a**1.5 / (a**1.5 + b),
    "z0**z1 + 2**z0 + z1**2**3": lambda a, b: a**b + 2**a + b**8,
    "pi*z0 - E**z1 + 0*E*pi": lambda a, b: mpmath.pi * a - mpmath.e**b,
}


@pytest.mark.parametrize("text", TRANSCENDENT)
def test_functions_and_their_slopes_hold_the_value(text: str) -> None:
    program, middle = IntervalProgram((text,), 2), (F(5, 8), F(11, 8))
    with mpmath.workprec(400):
        for radius, places in ((F(0), (0,)), (F(1, 32), (-1, 1))):
            box = [(int((m - radius) * ia.ONE), int((m + radius) * ia.ONE)) for m in middle]
            found = [*program.values(box), *program.derivatives(box)[0]]
            for shares in itertools.product(places, repeat=2):
                at = [mpmath.mpf(int(64 * (m + s * radius))) / 64 for m, s in zip(middle, shares)]
                for order, held in zip(((0, 0), (1, 0), (0, 1)), found):
                    value = (
                        TRANSCENDENT[text](*at)
                        if order == (0, 0)
                        else mpmath.diff(TRANSCENDENT[text], at, order)
                    )
                    assert within(held, value), (order, at)
                    assert radius or held[1] - held[0] < 1 << 14


@pytest.mark.parametrize(
    ("text", "read"),
    [
        ("(" * (MOST_DEPTH - 1) + "z0" + ")" * (MOST_DEPTH - 1), True),
        ("(" * MOST_DEPTH + "z0" + ")" * MOST_DEPTH, False),
        ("+".join(["(z0)"] * 2 * MOST_DEPTH), True),
        (MOST_DEPTH * "(z0) + " + "(" * MOST_DEPTH + "z0" + ")" * MOST_DEPTH, False),
        (MOST_DEPTH * "z0**2 + " + "z0" + "**1" * MOST_DEPTH, False),
        ("z0" + "**1" * (MOST_DEPTH - 1), True),
        ("z0" + "**1" * MOST_DEPTH, False),
        ("*".join(["z0**2"] * 2 * MOST_DEPTH), True),
        ("9" * MOST_DIGITS, True),
        ("9" * (MOST_DIGITS + 1), False),
        (f"z0**{MOST_POWER}", True),
        (f"z0**-{MOST_POWER}", True),
        (f"z0**{MOST_POWER + 1}", False),
        (f"z0**-{MOST_POWER + 1}", False),
        (f"z0**(1/{MOST_ROOT})", True),
        (f"z0**(1/{MOST_ROOT + 1})", False),
        ("z2", True),
        ("z3", False),
        ("z0000", False),
        ("z", False),
        ("z0/(1 - 1)", True),
        ("2/(1 - 1)", False),
        ("z0 z1", False),
        ("z0)", False),
        ("(z0", False),
        ("sin(z0", False),
        ("tan(z0", False),
        ("tan z0", False),
        ("tan", False),
        ("sin z0", False),
        ("exp", False),
        ("z0 +", False),
        ("", False),
        ("+z0", False),
        ("1.5*z0", False),
        ("z0²", False),
        ("z0\n", False),
        (b"z0", False),
        ("z0" + 200_000 * " ", False),
    ],
)
def test_what_the_grammar_holds_is_read_and_nothing_else(text: Any, read: bool) -> None:
    try:
        program = IntervalProgram((text,), 3)
    except Rejected:
        assert not read
    else:
        assert read
        assert len(program.outputs) == 1


def test_what_stands_twice_is_computed_once() -> None:
    assert len(IntervalProgram(("sin(z0*z1) + z0*z1", "z0*z1"), 2).code) == 3


@pytest.mark.parametrize("text", ["z0**1000", "z0**3*z1 - z0/z1**-7", "(z0*z1*z2)**31*z2"])
def test_work_is_about_the_products_that_are_taken(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    program, products = IntervalProgram((text,), 3), counted_products(monkeypatch)
    for run in (program.values, program.derivatives):
        work, taken = program.work, products[0]
        run([ia.UNIT] * 3)
        assert (products[0] - taken) / 2 <= program.work - work <= 2 * (products[0] - taken)


@pytest.mark.parametrize(
    ("text", "slope"),
    [
        ("z0/sqrt(1 + z0**2)", lambda a: (1 + a * a) ** -1.5),
        ("-z0*(z0**2 + 1)**(-1/2)", lambda a: -((1 + a * a) ** -1.5)),
        ("2*z0**2/(3 + z0**2)", lambda a: 12 * a / (3 + a * a) ** 2),
    ],
)
def test_a_quotient_far_out_has_a_slope_hardly_wider_than_it_varies(text: str, slope: Callable) -> None:
    program = IntervalProgram((text,), 1)
    ((low, high),) = program.derivatives([ia.hull(ia.of(F(50)), ia.of(F(60)))])[0]
    ends = sorted(slope(a) for a in (50.0, 60.0))
    # The product rule's two terms, of the size of f^(k-1) B^p, cancel to a share of 1/2500.
    assert (high - low) / ia.ONE < 4.0 * (ends[1] - ends[0])
