"""Ends of intervals as doubles: outwards they hold what was given, inwards they are held, each by a step at most."""

import math
import random
from decimal import Decimal
from fractions import Fraction

import sympy as sp

from gsp.proofs.sides import rounded


def test_ends_are_rounded_by_one_step_at_most_and_never_the_wrong_way() -> None:
    draw = random.Random(4)
    moved = 0
    for _ in range(200):
        low = Fraction(draw.randint(-99, 99), draw.randint(1, 99))
        high = low + Fraction(draw.randint(1, 99), draw.randint(1, 99))
        given = (sp.Rational(low.numerator, low.denominator), high)
        outer, inner = rounded(given, (float(low), float(high)))
        assert outer[0] <= low <= inner[0]
        assert inner[1] <= high <= outer[1]
        for (below, above), exact in (((outer[0], inner[0]), low), ((inner[1], outer[1]), high)):
            assert above == (below if Fraction(below) == exact else math.nextafter(below, math.inf))
            moved += above > below
    assert moved > 200


def test_decimals_are_what_they_say_and_doubles_what_they_are() -> None:
    outer, inner = rounded((Decimal("0.1"), 0.3), (0.1, 0.3))
    # The double 0.1 is above a tenth.
    assert (outer, inner) == ((math.nextafter(0.1, 0.0), 0.3), (0.1, 0.3))
