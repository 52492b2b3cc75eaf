"""Every noun has the faces that its class promises, and nothing heavy is imported for those that are not drawn."""

from __future__ import annotations

import subprocess
import sys

import pytest

import gsp
from gsp.results import registry
from gsp.results.card import Card
from gsp.results.drawn import Drawn
from gsp.results.tabular import Tabular

NOUNS = [v for v in (getattr(gsp, n) for n in gsp.__all__) if isinstance(v, type) and issubclass(v, Card)]


@pytest.mark.parametrize("noun", NOUNS)
def test_a_noun_has_the_faces_that_its_class_promises(noun: type) -> None:
    blank = object.__new__(noun)
    assert (registry.tables.find(blank) is not None) == issubclass(noun, Tabular)
    assert (registry.charts.find(blank) is not None) == issubclass(noun, Drawn)


def test_a_noun_of_a_user_has_the_faces_of_what_it_inherits_from() -> None:
    own = type("Own", (gsp.Trajectory,), {"__module__": "no.such.package"})
    assert registry.tables.find(object.__new__(own)) is registry.tables.find(object.__new__(gsp.Trajectory))
    assert registry.tables.find(3) is None


@pytest.mark.exhaustive
def test_a_table_imports_no_matplotlib() -> None:
    code = (
        "import sys, gsp; from gsp.results import registry;"
        "assert registry.tables.find(object.__new__(gsp.Trajectory));"
        "print('matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
