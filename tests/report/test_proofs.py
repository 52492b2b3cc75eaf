"""The certificate beside the verdict, and in a report: its words, its numbers and its picture."""

import dataclasses
import json
import re
from pathlib import Path

import matplotlib.patches
import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp import charts
from gsp.analysis.analysis import Analysis, analyse
from gsp.errors import DeclarationError, UnsupportedFunctionError
from gsp.hyperbolicity.hyperbolicity import Kind, classify
from gsp.report import hyperbolicity_as_json, write_report
from gsp.report.sections import Page
from tests.analyses import analysis_of

x, y, eps = sp.symbols("x y epsilon")


def branch(g: sp.Expr):
    system = gsp.SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: g}, epsilon=eps)
    return gsp.solve_critical(system).branches[0]


@pytest.fixture(scope="module")
def van_der_pol() -> Analysis:
    return analysis_of("van_der_pol")


@pytest.mark.exhaustive
def test_a_proof_stands_beside_the_verdict() -> None:
    found = classify(branch(x - 2 * y), region={"x": (0, 1)}, epsilon=0.1, prove=True)
    assert found.holds
    assert found.evidence == "proved on x in [0, 1]"
    assert "gap at least 2 in fast time (2 at the samples)" in str(found)
    assert found.certificate is not None
    assert found.certificate.gap == 2.0
    assert found.certificate.epsilon == 0.1
    assert "proved on x in [0, 1]" in str(found)
    assert classify(branch(x - 2 * y), region={"x": (0, 1)}).certificate is None


@pytest.mark.exhaustive
def test_a_refutation_makes_the_verdict_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    from gsp.hyperbolicity import hyperbolicity as module
    from gsp.hyperbolicity.exclusion import Exclusion

    # With nothing looked at between its samples the verdict is open; the proof refutes it.
    monkeypatch.setattr(module, "exclude", lambda *_: Exclusion(0, ({"x": (-1.0, 1.0)},), 1.0))
    rate = 1 - sp.Rational(11, 10) * sp.exp(-(((x - sp.Rational(3086, 10000)) * 2000) ** 2))
    sampled = classify(branch(-rate * y), region={"x": (-1, 1)})
    assert all(condition.holds for condition in sampled.conditions)
    assert sampled.is_open
    assert not sampled.holds
    found = classify(branch(-rate * y), region={"x": (-1, 1)}, prove=True)
    assert found.kind is Kind.LOST
    assert not found.holds
    assert found.evidence.startswith("refuted on x in [-1, 1]: ")


@pytest.mark.exhaustive
def test_what_is_undecided_stays_sampled() -> None:
    # The gap is 0 at one point and positive beside it: no box that holds it is ever decided.
    found = classify(branch(-y / (x - 2) ** 2), region={"x": (0, 1)}).with_proof(most_boxes=1)
    assert found.certificate is not None
    assert found.certificate.verdict.name == "UNDECIDED" or found.evidence.startswith("proved")
    touching = classify(branch(-(x**2 + sp.Rational(1, 10**9)) * y), region={"x": (-1, 1)}).with_proof(
        most_boxes=5
    )
    assert touching.certificate is not None
    assert touching.certificate.verdict.name == "UNDECIDED"
    assert "the budget of 5 boxes is spent" in touching.evidence
    assert touching.evidence.startswith("sampled at ")


@pytest.mark.exhaustive
def test_what_cannot_be_proved_is_refused_by_name() -> None:
    with pytest.raises(UnsupportedFunctionError, match="erf"):
        classify(branch(-(2 + sp.erf(x)) * y), region={"x": (0, 1)}, prove=True)


def test_ctrl_c_during_a_proof_goes_on_upwards(monkeypatch: pytest.MonkeyPatch) -> None:
    from gsp.proofs import certification

    def stop(*_: object) -> list:
        raise KeyboardInterrupt

    found = classify(branch(x - 2 * y), region={"x": (0, 1)})
    monkeypatch.setattr(certification, "glue", stop)
    with pytest.raises(KeyboardInterrupt):
        found.with_proof()


def test_a_report_proves_and_says_so(
    van_der_pol: Analysis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = {"proof": charts.applicable(van_der_pol)["proof"]}
    monkeypatch.setattr(charts, "applicable", lambda _: drawn)
    certificate = van_der_pol.hyperbolicity.certificate
    assert certificate is not None
    assert certificate.verdict.name == "PROVED"
    page = write_report(van_der_pol, tmp_path).read_text(encoding="utf-8")
    assert "(proved on " in page
    assert 'Normal hyperbolicity<span class="label">proved</span>' in page
    assert f"in {len(certificate.boxes)} boxes" in page
    assert "not a proof" not in page
    content = json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert content["hyperbolicity"]["certificate"]["verdict"] == "proved"
    assert content["hyperbolicity"]["certificate"]["gap"] == certificate.gap
    assert content["hyperbolicity"]["exclusion"]["left"] == []
    assert "proof.png" in content["figures"]
    assert (tmp_path / "proof.png").stat().st_size > 10_000


def test_the_picture_draws_every_box_at_its_height(van_der_pol: Analysis) -> None:
    certificate = van_der_pol.hyperbolicity.certificate
    assert certificate is not None
    axes = charts.proof(van_der_pol)
    drawn = [p for p in axes.patches if isinstance(p, matplotlib.patches.Rectangle)]
    shown = sorted((p.get_x(), p.get_x() + p.get_width(), p.get_height()) for p in drawn)
    known = sorted((low, high, gap) for ((low, high),), gap in zip(certificate.boxes, certificate.gaps))
    assert np.array(shown) == pytest.approx(np.array(known))
    sampled = axes.lines[0]
    for (low, high), gap in zip([box[0] for box in certificate.boxes], certificate.gaps):
        inside = [v for u, v in zip(sampled.get_xdata(), sampled.get_ydata()) if low <= u <= high]
        assert min(inside, default=gap) >= gap * (1 - 1e-9)


@pytest.mark.exhaustive
def test_without_boxes_there_is_no_picture() -> None:
    found = analyse(gsp.models.load("linear"), order=1, orders=(0, 1))
    assert found.hyperbolicity.evidence.startswith("proved on ")
    assert "proof" not in charts.applicable(found)
    with pytest.raises(DeclarationError, match="boxes of a proof"):
        charts.proof(found)


@pytest.mark.exhaustive
def test_json_has_no_certificate_where_none_was_asked_for() -> None:
    content = hyperbolicity_as_json(classify(branch(x - 2 * y), region={"x": (0, 1)}))
    assert content["certificate"] is None
    assert content["exclusion"] == {
        "tried": 1, "left": [], "share": 0, "reason": "", "gap": 2, "by_discriminant": True,
        "drops_rounding": False,
    }  # fmt: skip


def test_what_is_said_of_the_gap_is_what_is_proved(van_der_pol: Analysis) -> None:
    found = van_der_pol.hyperbolicity
    assert found.is_proved
    told = re.match(r"at least ([0-9.e-]+) in fast time, proved in ", str(Page(van_der_pol).gap()))
    assert told is not None
    assert float(told[1]) <= found.gap
    axes = Figure().add_subplot()
    charts.eigenvalues(van_der_pol, axes)
    (label,) = [text for text in axes.get_legend_handles_labels()[1] if text.startswith("gap")]
    assert label.startswith("gap at least ")
    assert float(label.split()[-1]) <= found.gap
    # Without a proof it is that of the samples.
    sampled = dataclasses.replace(van_der_pol, hyperbolicity=dataclasses.replace(found, certificate=None))
    assert str(Page(sampled).gap()) == f"{found.sampled_gap:.4g} in fast time"
