"""What a message shows of long expressions and of many quantities."""

import pytest
import sympy as sp

from gsp.algebra.brevity import LISTED, SHOWN, brief, listed
from gsp.critical.critical_manifold import solve_critical
from gsp.systems.system import SlowFastSystem


def test_a_list_shows_the_first_and_how_many_more_there_are() -> None:
    assert listed(f"y{i}" for i in range(LISTED)).endswith("y10, y11")
    assert listed(f"y{i}" for i in range(60)).endswith("y10, y11, and 48 more")
    assert listed([]) == ""


def test_a_long_sum_shows_its_first_terms_and_how_many_there_are() -> None:
    x = sp.symbols("x0:100")
    assert brief(sp.Add(*x[:3])) == "x0 + x1 + x2"
    text = brief(sp.Add(*x))
    assert text.endswith(" ... (100 terms)")
    assert len(text) <= SHOWN + 20
    assert brief(sp.Symbol("u" * SHOWN) + sp.Symbol("v")).endswith(" ... (2 terms)")
    # Whole terms.
    assert f"{sp.Add(*x)} ".startswith(text.removesuffix("... (100 terms)"))


def test_a_long_product_shows_its_first_characters_and_how_many_operations_it_has() -> None:
    product = sp.Mul(*sp.symbols("x0:100"))
    assert brief(product) == f"{str(product)[:SHOWN]} ... (99 operations)"
    longest = sp.Symbol("x" * SHOWN)
    assert brief(longest) == longest.name


def test_what_is_too_long_to_be_printed_shows_the_terms_that_are_not() -> None:
    x, y = sp.symbols("x y")
    deep = 1 / (x - y)
    for _ in range(30):
        deep = sp.Mul(deep + x, deep - y, evaluate=False)
    assert brief(sp.Add(-x, 2 * y, deep, evaluate=False)) == "-x + 2*y + 3 terms"
    assert brief(deep).endswith(" operations")


@pytest.mark.exhaustive
def test_a_branch_of_many_variables_is_shown_in_a_line() -> None:
    x, epsilon = sp.symbols("x epsilon")
    y = sp.symbols("y1:101")
    rates = {s: x - s - s**3 - before / 2 for s, before in zip(y, (x, *y))}
    (branch,) = solve_critical(SlowFastSystem(slow={x: -x}, fast=rates, epsilon=epsilon)).branches
    assert str(branch).endswith("and 88 more")
    assert len(str(branch)) < 12 * (SHOWN + 20)
