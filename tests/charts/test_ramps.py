"""Charts of ramps: which run is called what, and where nothing can be drawn."""

from __future__ import annotations

import pytest
import sympy as sp

import gsp
from gsp import charts
from gsp.errors import DeclarationError

x, y, l = sp.symbols("x y l")  # noqa: E741
FIELD = gsp.VectorField({x: (x + l) ** 2 - 1}, epsilon=None, parameters={l: 0})
BACK = gsp.Ramp.there_and_back({l: (0, 5)})


def window() -> gsp.CriticalRate:
    return gsp.critical_rate(FIELD, ramp=BACK, start={"x": -1}, edge={"x": 1})


@pytest.mark.parametrize(("threshold", "tips"), [(0, "above"), (1, "below")])
def test_what_tips_is_on_the_right_side_of_a_threshold(threshold: int, tips: str) -> None:
    found = window()
    labels = charts.critical_rate(found, threshold=threshold).get_legend_handles_labels()[1]
    rate = found.rates[threshold]
    (named,) = [label for label in labels if label.startswith("tips")]
    drawn = float(named.split("=")[1])
    assert (drawn > rate) == (tips == "above")
    assert f"threshold, $r$ = {rate:.6g}" in labels


def test_runs_go_where_the_labels_say() -> None:
    found = window()
    assert abs(found.run(0.9 * found.rates[0])["x"][-1] + 1) < 1e-3
    assert not abs(found.run(1.1 * found.rates[0])["x"][-1]) < 10
    run = found.run(found.rates[0])
    assert run["l"].max() == pytest.approx(5, abs=1e-3)
    assert abs(run["x"] - 1).min() < 1e-2


def test_a_diagram_shades_what_tips() -> None:
    found = gsp.rate_diagram(FIELD, ramp=BACK, start={"x": -1}, edge={"x": 1}, amplitudes=(0.5, 1.0), points=3)
    assert [found.tips(len(found.found) - 1, rate) for rate in (0.1, 2.0, 100.0)] == [False, True, False]
    labels = charts.rate_diagram(found).get_legend_handles_labels()[1]
    assert {"tracks", "tips", "critical rate"} <= set(labels)


def test_what_has_no_threshold_is_not_drawn() -> None:
    endless = gsp.critical_rate(FIELD, ramp=gsp.Ramp.linear({l: 0}), start={"x": -1})
    with pytest.raises(DeclarationError, match="no threshold to draw: the ramp has no end"):
        charts.critical_rate(endless)
    returns = gsp.Ramp.there_and_back({l: (0, 0.5)})
    never = gsp.critical_rate(FIELD, ramp=returns, start={"x": -1}, edge={"x": 1})
    with pytest.raises(DeclarationError, match=r"no critical rate was found\. Got never tips"):
        charts.critical_rate(never)
    with pytest.raises(DeclarationError, match="name is that of a state"):
        charts.critical_rate(window(), name="y")
