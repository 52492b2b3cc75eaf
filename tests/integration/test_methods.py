"""Which methods there are, and what is said of those that there are no more."""

from __future__ import annotations

import pytest

from gsp.errors import UnknownNameError
from gsp.integration.methods import Method


@pytest.mark.parametrize(
    ("name", "serves"), [("RODAS5P", "RADAU9"), ("RADAU5", "RADAU9"), ("TAYLOR", "DOP853")]
)
def test_the_name_of_a_removed_method_says_what_to_take(name: str, serves: str) -> None:
    with pytest.raises(AttributeError, match=rf"Method\.{name} was removed\. Take Method\.{serves}, or leave"):
        getattr(Method, name)
    with pytest.raises(UnknownNameError, match=rf"{name} was removed\. Take Method\.{serves}, or leave"):
        Method[name]
    assert serves in Method.__members__


def test_other_names_are_no_methods() -> None:
    assert not hasattr(Method, "EULER")
    with pytest.raises(AttributeError, match=r"Method has no EULER"):
        getattr(Method, "EULER")  # noqa: B009
    with pytest.raises(KeyError, match=r"Method has no EULER\. The methods are RADAU9, RADAU13, DOP853"):
        Method["EULER"]
    assert Method["RADAU9"] is Method.RADAU9
