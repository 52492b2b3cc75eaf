"""Does no-slip hold here? On the page, in report.json and on the failure map of a model with dry friction."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import gsp
from gsp.comparison.survey import NO_SLIP
from gsp.readers.toml import read_model
from gsp.report.manuscript import TEX, manuscript
from gsp.scenes.bearing import no_slip_of
from gsp.scenes.settings import ask_again
from gsp.scenes.study import study
from tests.mechanics.test_dry_friction import TOTAL, sleigh
from tests.readers.test_mechanics_table import SLED

BEGIN = {"v": -1.5, "omega": 0.3, "w": 0, "phi": 0.1, "x": 0, "y": 0}


def scene(**changes):
    given = {
        "region": {"v": (-1.6, -1.2), "omega": (0.2, 0.5)},
        "start": BEGIN,
        "span": (0, 2),
        "epsilon": 0.01,
    }
    return sleigh().scene(**(given | changes))


@pytest.mark.exhaustive
def test_the_page_and_its_json_say_whether_and_where_no_slip_fails(tmp_path) -> None:
    """The letting go lies beyond the region, after the constrained run has left it."""
    analysis = gsp.analyse(scene(span=(0, 4)), order=1, orders=(0, 1))
    told = sleigh().no_slip(start=BEGIN, span=(0, 4))
    assert told.time is not None
    folder = gsp.write_report(analysis, tmp_path).parent
    content = json.loads((folder / "report.json").read_text())["no_slip"]
    assert content["holds"] is False
    assert content["loss"] == "end of the friction cone"
    assert content["contact"] == "w"
    assert content["time"] == pytest.approx(told.time, abs=1e-9)
    assert content["place"] == pytest.approx(told.place, abs=1e-9)
    page = (folder / "report.html").read_text()
    assert "Does no-slip hold here?" in page
    assert "fails at" in page
    assert re.search(r"The field has a switch: <math.*?</math> is a fast variable in place of <math", page)
    assert "(w)/epsilon" not in page
    assert (folder / "no_slip.png").is_file()
    text = manuscript(analysis, pictures={}, model=None)[TEX].decode()
    section = text[text.index(r"\section{Whether no-slip holds}") : text.index(r"\section{Methods}")]
    assert f"{content['largest_shares'][0]:.4g}" in section


@pytest.mark.exhaustive
def test_where_it_holds_the_page_says_how_far_the_contact_creeps() -> None:
    found = no_slip_of(study(scene()))
    assert found is not None
    assert found.holds
    # Light loads creep by epsilon lambda/(mu N), phi'(0) = 1, this one by more.
    least = 0.01 * np.trapezoid(found.shares[0], found.t)
    assert least < found.distance(0.01)[0] < 2 * least


def test_a_scene_without_contacts_is_not_asked() -> None:
    assert no_slip_of(study(gsp.models.load("chaplygin_sleigh"))) is None


def test_a_start_that_slips_is_told_so() -> None:
    with pytest.raises(gsp.GspError, match=r"the start slips: w = 0\.5"):
        no_slip_of(study(scene(start=BEGIN | {"w": 0.5})))


def test_other_parameters_have_other_answers() -> None:
    long = scene(span=(0, 4))
    assert not no_slip_of(study(long)).holds
    assert no_slip_of(study(ask_again(long, parameters={"mu": 0.2}))).holds


@pytest.mark.exhaustive
def test_a_model_file_asks_too() -> None:
    found = no_slip_of(study(read_model(SLED, name="sled")))
    assert found is not None
    assert found.holds
    assert found.names == ("w",)


@pytest.mark.exhaustive
def test_the_failure_map_shows_where_a_contact_lets_go() -> None:
    """|v omega| < F_c (I + m a^2)/(m I) at the start; the piece is too short to change that by a cell."""
    positions = np.array([-3.6, -3.3, -2.9, -1.0])
    found = gsp.failure_map(
        scene(), positions=positions.tolist(), epsilons=(0.01, 0.005), tolerances=(1e-1, 1e-2), orders=(0,)
    )
    claim = found.places[NO_SLIP]
    bears = 0.3 * np.abs(positions) < 0.9 * TOTAL
    assert (claim.holds == bears).all()
    assert claim.measure[:, 3] == pytest.approx(0.3 / 0.9 / TOTAL, rel=0.1)
    assert NO_SLIP in str(found)
    (legend,) = gsp.charts.failure_map(found).figure.legends
    assert any("a contact lets go" in text.get_text() for text in legend.texts)


def test_the_answer_is_a_table_and_a_picture() -> None:
    found = sleigh().no_slip(start=BEGIN, span=(0, 4))
    table = found.to_xarray()
    assert table["share"].dims == ("contact", "time")
    assert float(table["share"][0, -1]) == pytest.approx(1.0, abs=1e-9)
    assert len(found.plot().lines) == 3
