"""The report of a model without a small parameter begins with its time scales and what may be left out."""

import html
import json
import re

import numpy as np
import pytest
import sympy as sp

import gsp


@pytest.fixture(scope="module")
def found():
    i, w, R, L = sp.symbols("i w R L")
    motor = gsp.VectorField(
        {i: (12 - R * i - w / 10) / L, w: 10 * i - w / 10},
        parameters={R: 1, L: sp.Rational(1, 500)},
        name="motor",
    )
    return gsp.find_reductions(gsp.Scene(motor, {}, {"i": 0, "w": 0}, (0, 5), tolerance=0.01))


@pytest.mark.exhaustive
def test_the_page_begins_with_the_time_scales_the_table_and_the_reason(found, tmp_path, monkeypatch) -> None:
    assert found.taken is not None
    analysis = gsp.analyse(found.taken.scene, order=1, orders=(0, 1))
    page = gsp.write_report(analysis, tmp_path / "motor", reductions=found)
    source = html.unescape(page.read_text(encoding="utf-8"))
    # Names are set as mathematics.
    text = re.sub(r"</?i>", "", source)
    begun = text.index("Time scales, and which variables can be eliminated")
    assert begun < text.index("Figure 1.") < text.index(found.reason) < text.index("May I reduce?")
    assert text.index('id="time_scales"') < text.index("Figure 1.")
    assert found.scales.message in text
    rows = re.findall(r"<tr><td>(.*?)</td><td>(quasi-steady[^<]*)</td>", text)
    assert [name for _, name in rows] == [each.name for each in found.with_costs(analysis.choice).shown()]
    assert [name for mark, name in rows if mark] == [found.taken.name]
    assert "an error was measured" not in text
    content = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    assert content["reductions"] == found.with_costs(analysis.choice).as_dict()
    assert content["figures"][0] == "time_scales.png"
    code = next(
        c for c in re.findall(r"<pre>(import gsp.*?)</pre>", source, re.DOTALL) if "gsp.time_scales" in c
    )
    monkeypatch.chdir(page.parent)
    drawn = []
    monkeypatch.setattr(gsp.charts, "time_scales", lambda scales, axes=None: drawn.append(scales))
    monkeypatch.setattr(gsp.charts, "save", lambda axes, path: drawn.append(path))
    exec(compile(code, "report", "exec"), {})
    assert drawn[1] == "time_scales.svg"
    # The model of the folder has a small parameter, and the same time scales.
    np.testing.assert_allclose(drawn[0].times[-1], found.scales.times[-1], rtol=1e-6)


def test_the_page_says_which_errors_were_measured(found, tmp_path) -> None:
    """Of a study with the table's errors the verdict, the rows and the sentence below speak of measured ones."""
    page = gsp.write_report(
        gsp.analyse(found.study, order=1, orders=(0, 1)), tmp_path / "motor", reductions=found
    )
    source = page.read_text(encoding="utf-8")
    assert "Its measured error is" in source
    assert "serves: measured over the span" in source
    assert "Where the table says that an error was measured" in source
