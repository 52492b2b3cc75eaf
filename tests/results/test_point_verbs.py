"""Verbs that a sweep can do: each is public, and the page says what it records."""

from __future__ import annotations

import re
from pathlib import Path

import gsp
from gsp.results.point_verbs import point_verbs

PAGE = Path(__file__).parents[2] / "docs" / "sweeps.md"


def test_every_verb_is_public_and_has_a_row_of_the_page() -> None:
    rows = re.findall(r"^\| `(\w+)` \|", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(rows) == list(point_verbs())
    assert set(rows) <= set(gsp.__all__)
