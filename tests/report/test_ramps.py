"""Ramps in reports: what the page and its JSON say of them, and the figure."""

from __future__ import annotations

import json

import gsp
from gsp.readers.toml import read_model
from gsp.report.manuscript import TEX, manuscript

MODEL = """
[parameters]
l = 0

[slow]
z = "-z/2"

[fast]
x = "(x + l)^2 - 1"

[region]
z = [0.1, 2]
x = [-1.5, -0.5]

[start]
z = 1
x = -1

[scene]
span = [0, 1]
epsilon = 0.5

[ramps.up]
profile = "tanh"
parameters = {l = [0, 3]}
start = {x = -1, z = 0}
edge = {x = -2, z = 0}

[ramps.wrong]
profile = "tanh"
parameters = {l = [0, 3]}
start = {x = -1, z = 0}
edge = {x = -4, z = 0}
"""


def test_the_page_says_how_fast_is_too_fast(tmp_path) -> None:
    """In slow time x is twice as fast: the rate is that of one state, 2, over epsilon."""
    scene = read_model(MODEL, name="ramped")
    folder = tmp_path / "report"
    analysis = gsp.analyse(scene)
    page = gsp.write_report(analysis, folder).read_text(encoding="utf-8")
    content = json.loads((folder / "report.json").read_text(encoding="utf-8"))["ramps"]
    (rate,) = content["up"]["rates"]
    assert abs(rate - 4) < 1e-9
    assert "one unstable direction" in content["wrong"]["reason"]
    for words in ("How fast is too fast?", "tips above the rate", "not told"):
        assert words in page
    assert (folder / "ramp.png").is_file()
    text = manuscript(analysis, pictures={}, model=None)[TEX].decode()
    table = text[text.index(r"\section{Critical rates of ramps}") :]
    assert "& tips above the rate & 4 &" in table
    assert "& not told &" in table
