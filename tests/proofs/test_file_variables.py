"""Sentences about a proof file whose own names are like those of its variables."""

from __future__ import annotations

from fractions import Fraction

import pytest

from gsp.proofs.checked_cycle import CheckedAnnulus, CheckedCycle
from gsp.proofs.checked_passage import CheckedDelay, CheckedPassage
from gsp.proofs.checker import Checked
from gsp.proofs.file_variables import lettered


@pytest.mark.parametrize(
    ("names", "letter"), [(("x", "y"), "z"), (("z", "z_0"), "z"), (("z1", "z0"), "zz"), (("zz3", "z12"), "zzz")]
)
def test_a_variable_of_the_file_is_no_name_of_the_system(names: tuple[str, ...], letter: str) -> None:
    assert lettered(names, "z0*z1 - exp(z10)") == (letter, f"{letter}0*{letter}1 - exp({letter}10)")


def test_z1_moves_as_the_file_says_where_it_is_the_slow_one() -> None:
    sides = (((-1.0, -0.5), (0.5, 1.0)),) * 2
    annulus = CheckedAnnulus(0.1, True, (1.0, 2.0), -1.0, sides, (3, 3))
    told = str(CheckedCycle(("z1", "z0", "z2"), ("-z1", "z0 - z1", "0"), (annulus,)))
    assert "of z1` = -zz1, z2 z0` = zz0 - zz1\n" in told
    assert "(zz0 = z1, zz1 = z0, zz2 = z2;" in told


def test_what_is_taken_off_a_variable_stands_where_it_is_named() -> None:
    delay = CheckedDelay(0.1, 0.25, 1 / 3, 2.0, None, (1.0, 2.0), 1.0, above=False)
    told = str(CheckedPassage(("y", "x", "epsilon"), ("1", "z0"), (Fraction(1, 3), Fraction(0)), delay))
    assert "(z0 = y - (1/3), z1 = x, z2 = epsilon;" in told
    assert "|z1| <= 0.25 over z0 = 0.3333333333333333 stay" in told


def test_equations_of_a_branch_are_in_the_file_s_variables() -> None:
    told = str(Checked(("z1", "z0"), 1, ("z0 - z1",), ((0.0, 1.0),), 1, 0, 1.0, 1))
    assert "branch of zz0 - zz1 = 0 (zz0 = z1, zz1 = z0)" in told
