"""Conditions of XPPAUT's expressions: as numbers they are what C makes of them, on their edges too."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from gsp.errors import ModelFileError
from gsp.readers.xppaut_conditions import without_conditions
from tests import xppaut

# Every pair of values below, above and on the numbers that conditions compare with.
POINTS = list(itertools.product((-1.0, 0.0, 0.5, 1.0, 2.0), repeat=2))


def value(text: str, v: float, w: float) -> float:
    names = {"step": lambda u: float(u > 0), "sign": np.sign, "abs": abs, "exp": np.exp, "v": v, "w": w}
    return float(eval(without_conditions(text, positive=lambda: "step"), {"__builtins__": {}}, names))


@pytest.mark.parametrize(
    ("text", "meaning"),
    [
        ("v>1", lambda v, w: v > 1),
        ("v<1", lambda v, w: v < 1),
        ("v>=1", lambda v, w: v >= 1),
        ("v<=1", lambda v, w: v <= 1),
        ("v==1", lambda v, w: v == 1),
        ("v!=1", lambda v, w: v != 1),
        ("v>1&w<1", lambda v, w: v > 1 and w < 1),
        ("v>1|w<1", lambda v, w: v > 1 or w < 1),
        ("v|w", lambda v, w: v != 0 or w != 0),
        ("v&w", lambda v, w: v != 0 and w != 0),
        ("v>0&w>0&v<2", lambda v, w: v > 0 and w > 0 and v < 2),
        ("v>1|w>1|v<0", lambda v, w: v > 1 or w > 1 or v < 0),
        ("(v>0&w>0)|v<0", lambda v, w: (v > 0 and w > 0) or v < 0),
        ("not(v>0)", lambda v, w: not v > 0),
        ("not(v)", lambda v, w: not v),
        ("not(v)&w", lambda v, w: not v and w != 0),
        ("heav(v)", lambda v, w: v >= 0),
        ("heav(v-1)*w", lambda v, w: (v >= 1) * w),
        ("2*(v>1)+3*(w>1)", lambda v, w: 2 * (v > 1) + 3 * (w > 1)),
        ("(v+w)>1", lambda v, w: v + w > 1),
        ("v>(-w)", lambda v, w: v > -w),
        ("if(v>w)then(3)else(w)", lambda v, w: 3 if v > w else w),
        ("if(v)then(3)else(4)", lambda v, w: 3 if v else 4),
        ("1+if(v>0)then(if(w>0)then(1)else(2))else(3)*2", lambda v, w: 1 + ((1 if w > 0 else 2) if v > 0 else 3) * 2),
        ("exp(v>0)", lambda v, w: np.exp(float(v > 0))),
        ("(v)>(w)", lambda v, w: v > w),
    ],
)  # fmt: skip
def test_a_condition_is_one_where_it_holds_and_zero_elsewhere(text: str, meaning) -> None:
    assert [value(text, v, w) for v, w in POINTS] == [float(meaning(v, w)) for v, w in POINTS]


@pytest.mark.parametrize(
    "text", ["v+40>0", "v>-40", "2*v>1", "v>1>w", "v>", ">v", "v>1+w", "not(v>1)>w", "v|not(w)<2"]
)
def test_comparisons_that_bind_otherwise_than_they_look_are_refused(text: str) -> None:
    with pytest.raises(ModelFileError, match="binds more tightly"):
        without_conditions(text, positive=lambda: "step")


@pytest.mark.parametrize(
    "text", ["2+w*not(v>1)", "w/not(v>1)", "w^not(v>1)", "(w<0)&not(v>1)", "1==not(v>1)", "2*(-not(v>1))"]
)
def test_a_not_that_xppaut_takes_for_another_number_is_refused(text: str) -> None:
    """XPPAUT 6.11 has 2 w + not(v>1) for 2 + w*not(v>1), and numbers that are none of the file's for others."""
    with pytest.raises(ModelFileError, match="is another number in XPPAUT"):
        without_conditions(text, positive=lambda: "step")


def test_a_not_in_parentheses_or_behind_a_sum_is_xppauts() -> None:
    texts = ["2+w*(not(v>1))", "2-not(v>1)", "1+((w<0)|not(v>1))", "w-(-(not(v>1)))", "exp(not(v>1))"]
    found = [value(text, 0.5, 3.0) for text in texts]
    assert xppaut.values("init v=0.5,w=3\nv'=1\nw'=1\n", texts, found) == pytest.approx(found, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v+1&w", "beside other operators"),
        ("(v>1", "not closed"),
        ("v>1)", "nothing is open"),
        ("not(v>1,w)", "not takes one argument"),
        ("heav(v,w)", "heav takes one argument"),
        ("if(v>1)", "if is written"),
        ("if(v>1)then(1)", "if is written"),
        ("if(v>1)then(1)else", "if is written"),
        ("if(v>1,w)then(1)else(2)", "if is written"),
        ("if(v>1)else(1)then(2)", "if is written"),
    ],
)
def test_conditions_that_are_not_complete_are_refused(text: str, words: str) -> None:
    with pytest.raises(ModelFileError, match=words):
        without_conditions(text, positive=lambda: "step")


def test_text_without_conditions_stays_as_it_is_and_needs_no_step() -> None:
    def positive() -> str:
        raise AssertionError

    for text in ("v*(w + 1) - exp(v)", "myif(v)", "x.heav(v)", ""):
        assert without_conditions(text, positive=positive) == text
