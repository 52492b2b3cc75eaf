"""The story of a ramp in docs/ramps.md: every step ends where its text says."""

from __future__ import annotations

import re
from pathlib import Path

import gsp
from gsp.readers.toml import read_model

DOCS = Path(__file__).parents[2] / "docs" / "ramps.md"
MODEL, STORY = re.findall(r"```toml\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)


def test_a_ramp_is_told_from_tracking_to_tipping_and_between(page, tmp_path) -> None:
    (tmp_path / "story.toml").write_text(STORY, encoding="utf-8")
    file = gsp.write_demo(read_model(MODEL, name="ramp"), tmp_path / "ramp.html", story=tmp_path / "story.toml")
    page.open(file)
    ended = []
    for step in range(4):
        page.run("turnTo(arguments[0]); play(false);", step)
        page.settle()
        assert page.inked("plane") > 2000
        ended.append(page.run("return current.curves.full.q.map(row => row[row.length - 1])"))
    tracks, tips, between, beside = (x for x, _ in ended)
    assert abs(tracks + 4) < 0.01
    assert abs(between + 2) < 0.01
    assert min(tips, beside) > 1e3
    assert page.complaints() == []
