"""Letters of mathematics in what people read: formulas change, what is typed as it stands does not."""

import pytest

from gsp.results.lettering import GREEK, in_unicode, letter


@pytest.mark.parametrize(
    ("plain", "written"),
    [
        ("epsilon*y' = a*x**2 - lambda", "ε·y' = a·x² - λ"),
        ("M_epsilon through h_0 + epsilon*h_1", "M_ε through h₀ + ε·h₁"),
        ("sqrt(x) <= 2*pi, epsilon^(2/3), x**(-1)", "√(x) ≤ 2·π, ε^(2/3), x⁻¹"),
        ("use --epsilon 0.1, epsilon=0.1 or `epsilon`", "use --epsilon 0.1, epsilon=0.1 or `epsilon`"),
        ("error_against_epsilon.svg, my.beta and upsilons", "error_against_epsilon.svg, my.beta and upsilons"),
        ("x -> 0 and 2 ** 3", "x -> 0 and 2 ^ 3"),
    ],
)
def test_formulas_are_written_as_people_write_them(plain: str, written: str) -> None:
    assert in_unicode(plain) == written
    assert in_unicode(written) == written


def test_on_a_card_arguments_are_read_and_not_typed() -> None:
    assert in_unicode("Run(epsilon=0.1, `epsilon`)", is_typed=False) == "Run(ε=0.1, `epsilon`)"


def test_columns_and_signs_of_equality_stay_below_one_another() -> None:
    table = "order  epsilon  error\n    0     0.05   1e-2"
    assert in_unicode(table).splitlines()[0].index("error") == table.index("error")
    equations = "          v' = -v\n  epsilon w' = v - w"
    first, second = in_unicode(equations).splitlines()
    assert second.index("=") == first.index("=")


def test_every_greek_letter_has_one_sign_of_its_own() -> None:
    assert len(set(GREEK.values())) == len(GREEK) == 34
    assert letter("omega") == "ω"
    assert letter("k1") == letter("k_1") == "k₁"
    assert letter("K_M") == "K_M"
