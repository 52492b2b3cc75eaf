"""One verdict: made once, shown on every face, accuracy apart from speed, with what would help."""

import json
from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from click.testing import CliRunner

from gsp import charts, models
from gsp.choice.candidates import Candidate, ModelKind
from gsp.choice.choice import choose
from gsp.choice.prediction import Failure
from gsp.choice.verdict import Answer, Evidence, far_from_origin, judge
from gsp.cli import cli
from gsp.integration.trajectory import integrate
from gsp.reductions.reductions import find_reductions
from gsp.report import as_json, write_report
from gsp.report.sections import Page
from gsp.report.wording import words
from gsp.scenes.scene import Scene
from gsp.scenes.small_parameter import without_small
from gsp.systems.system import SlowFastSystem
from tests.analyses import analysis_of

ASKED = replace(models.load("michaelis_menten"), span=(0, 1), tolerance=1e-5, epsilon=0.01)


def candidate(order: int | None, **changes) -> Candidate:
    kind = ModelKind.FULL if order is None else ModelKind.REDUCED
    given = {"predicted": 1e-7, "holds_until": 1.0, "preparation": 0.1, "steps": 10, "field_calls": 100}
    return Candidate(kind, order, **({"timings": (1e-5, 1e-5), "valid": True} | given | changes))


def failing(order: int, failure: Failure | None, **changes) -> Candidate:
    # The words play no part: what is decided is decided by the failure.
    return candidate(
        order, valid=False, why_not="of words", failure=failure, **({"holds_until": 0.0} | changes)
    )


FULL = candidate(None, timings=(5e-5, 5e-5), preparation=0.0)


def verdict_of(model: Candidate, *candidates: Candidate, **changes):
    return judge(Evidence(**({"scene": ASKED, "candidates": candidates, "model": model} | changes)))


def test_accuracy_is_told_apart_from_speed() -> None:
    one = candidate(1, predicted=3e-6)
    found = verdict_of(one, one, FULL)
    assert found.answer is Answer.YES
    assert "order 1 stays within a relative error of 1e-05 over t = 0 to 1 at epsilon = 0.01" in found.accuracy
    assert "over t = 0.1 to 1 at" in verdict_of(one, one, FULL, layer=0.1).accuracy
    assert "3.0e-06" in found.accuracy
    assert "fast" not in found.accuracy
    assert "5 times as fast: 10 us a run against 50 us" in found.speed
    assert "2500 runs" in found.speed
    # What readying the full system takes is saved, whichever is run.
    assert "2000 runs" in verdict_of(one, one, replace(FULL, preparation=0.02)).speed


def test_numbers_have_the_digits_that_are_known() -> None:
    one = candidate(1, predicted=3e-6)
    told = verdict_of(one, one, FULL, fast_error=0.953, layer_error=18.2).accuracy
    assert "it is 0.95 after the initial layer and 18 within the layer" in told
    # 198,500 of times that are measured to three digits.
    late = replace(one, preparation=7.94)
    assert "after about 200000 runs." in verdict_of(late, late, FULL).speed


def test_a_model_that_is_exact_enough_and_no_faster_is_no_refusal() -> None:
    one = candidate(1, timings=(6e-5, 8e-5))
    found = verdict_of(FULL, one, FULL)
    assert found.answer is Answer.NO_GAIN
    assert "stays within" in found.accuracy
    assert "takes longer: 60 us a run against 50 us" in found.speed
    assert "formula" in found.remedy


def test_the_epsilon_that_would_do_is_named() -> None:
    # An error of 1.44e-3 at order 1 falls like epsilon^2 to 9e-6 at epsilon/12.6.
    short = failing(1, Failure.ERROR, predicted=1.44e-3)
    found = verdict_of(FULL, short, FULL)
    assert found.answer is Answer.NO
    assert "about 0.0006" in found.remedy
    far = failing(0, Failure.ERROR, predicted=0.5)
    assert "about" not in verdict_of(FULL, far, FULL).remedy


@pytest.mark.parametrize("failure", [Failure.RATE, Failure.ORDER, Failure.ERROR])
def test_no_epsilon_is_said_to_help_beyond_where_the_limit_ends(failure: Failure) -> None:
    short = failing(2, failure, predicted=1e-4)
    ends = (0.4, "normal hyperbolicity is lost")
    remedy = verdict_of(FULL, short, FULL, limit_ends=ends).remedy
    assert remedy.endswith("help up to t = 0.4 only, where the limit's run ends: normal hyperbolicity is lost.")
    assert "only" not in verdict_of(FULL, short, FULL).remedy


@pytest.mark.parametrize("failure", list(Failure))
def test_what_is_not_predicted_is_not_said_to_fail(failure: Failure) -> None:
    """Beyond a kink that is crossed, say, an error may be small, as that of max(x - 1, 0) is."""
    found = verdict_of(FULL, failing(0, Failure.ERROR), failing(1, failure, predicted=1e-9), FULL)
    stays = "stays" if failure in (Failure.ERROR, Failure.END) else "is known to stay"
    assert f"no reduced model {stays} within" in found.accuracy


def test_a_loss_that_the_limit_meets_is_met_at_every_epsilon() -> None:
    """An infection dies out along I = 0, which loses its stability at S = 2/5: 1 - S = 4/5 exp(-2 t) is 3/5 there."""
    susceptible, ill, epsilon = sp.symbols("S I epsilon")
    scene = Scene(
        system=SlowFastSystem(
            slow={susceptible: 2 * (1 - susceptible) - susceptible * ill},
            fast={ill: ill * (sp.Rational(5, 2) * susceptible - 1) - epsilon * ill},
            epsilon=epsilon,
        ),
        region={"S": (0.1, 0.9), "I": (0.0, 1.0)},
        start={"S": 0.2, "I": 0.05},
        span=(0.0, 1.0),
        epsilon=0.01,
        tolerance=1e-3,
    )
    assert f"up to t = {np.log(4 / 3) / 2:.4g} only" in choose(scene).verdict.remedy


def test_part_of_the_span_is_told_with_its_place() -> None:
    part = failing(2, Failure.GAP, holds_until=0.6, predicted=float("inf"))
    found = verdict_of(FULL, part, FULL, partial=part, place={"s": 0.25})
    assert found.answer is Answer.IN_PART
    assert "It serves until t = 0.6, s = 0.25." in found.accuracy
    assert "ends before that place" in found.remedy
    # What fails at the end of the layer serves for no part.
    assert verdict_of(FULL, part, FULL, partial=part, layer=0.59).answer is Answer.NO


def test_a_shorter_span_helps_only_where_it_is_not_mostly_layer() -> None:
    remedies = {
        (failure, layer): verdict_of(FULL, each, FULL, layer=layer).remedy
        for failure in (Failure.END, Failure.REGION)
        for layer in (0.1, 0.2, 0.4)
        for each in [failing(0, failure, holds_until=0.3)]
    }
    assert {key for key, remedy in remedies.items() if "span" in remedy} == {
        (Failure.END, 0.1),
        (Failure.REGION, 0.1),
    }
    assert remedies[Failure.REGION, 0.2] == "A larger region would help."
    assert remedies[Failure.END, 0.4] == "A start further from that place, or behind it, would help."


def test_a_region_without_the_slow_manifold_asks_for_a_larger_one_and_no_shorter_span() -> None:
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: -x}, fast={y: 3 + x - y}, epsilon=epsilon)
    asked = Scene(system, {"x": (0, 2), "y": (0, 1)}, {"x": 1, "y": 1}, (0, 5), 0.05, tolerance=0.01)
    assert choose(asked).verdict.remedy == "A larger region would help."
    plain = find_reductions(without_small(asked))
    for told in (choose(asked).verdict.accuracy, plain.reason):
        assert "but the slow manifold is outside the region at t = 0" in told
    assert plain.reason.endswith(". A larger region would help.")


def test_what_comes_nearest_is_predicted_to_be_least_wrong() -> None:
    # All fail at the end of the layer, so that none serves longer than another.
    flows = [
        failing(n, Failure.ERROR, holds_until=0.6, predicted=p) for n, p in enumerate((0.43, 0.30, 0.34, 0.45))
    ]
    found = verdict_of(FULL, *flows, FULL, partial=flows[-1], layer=0.6)
    assert found.answer is Answer.NO
    assert "The nearest is the reduced flow of order 1," in found.accuracy
    alike = [replace(flow, predicted=0.3 + 1e-5 * n) for n, flow in enumerate(reversed(flows))]
    found = verdict_of(FULL, *reversed(alike), FULL, partial=alike[0], layer=0.6)
    assert "The nearest is the reduced flow of order 0," in found.accuracy


def test_none_is_nearest_for_an_error_that_is_all_of_its_size() -> None:
    flows = [
        failing(n, Failure.ERROR, holds_until=0.4, predicted=p) for n, p in enumerate((np.inf, 1e5, 630.0))
    ]
    found = verdict_of(FULL, *flows, FULL, layer=0.4)
    assert "The nearest is the reduced flow of order 0," in found.accuracy
    assert found.remedy == "A smaller epsilon or a larger tolerance would help."


def test_a_solved_manifold_that_holds_longest_comes_nearest() -> None:
    flow = failing(2, Failure.ERROR, holds_until=0.3, predicted=1e-3)
    left = replace(flow, kind=ModelKind.SOLVED, order=None, failure=Failure.REGION, holds_until=0.8)
    found = verdict_of(FULL, flow, left, FULL, partial=flow)
    assert "The nearest is the flow on the solved manifold," in found.accuracy
    assert "The reduced flow of order 2 serves until t = 0.3." in found.accuracy
    assert "larger region" in found.remedy
    # By less than the digits that are shown it holds no longer.
    level = replace(left, holds_until=0.30001)
    assert (
        "The nearest is the reduced flow of order 2,"
        in verdict_of(FULL, flow, level, FULL, partial=flow).accuracy
    )
    # One that was not solved holds nowhere, and one that ends before does not come nearer.
    for other in (replace(left, failure=None), replace(left, holds_until=0.2)):
        assert (
            "The nearest is the reduced flow of order 2,"
            in verdict_of(FULL, flow, other, FULL, partial=flow).accuracy
        )


@pytest.mark.parametrize(
    ("failure", "changes", "help"),
    [
        (Failure.REGION, {}, "larger region"),
        (None, {"layer": 2.0}, "about 0.002, or a longer span"),
        (Failure.END, {}, "ends before that place"),
        (Failure.ORDER, {}, "smaller epsilon"),
    ],
)
def test_what_would_help_depends_on_why(failure: Failure | None, changes: dict, help: str) -> None:
    short = failing(1, failure, predicted=float("inf"), holds_until=0.5)
    assert help in verdict_of(FULL, short, FULL, **changes).remedy


def test_without_reduced_candidates_the_obstacle_is_told_and_a_full_run_that_stops() -> None:
    found = verdict_of(FULL, FULL, obstacle="g has no real zeros.")
    assert found.answer is Answer.NO
    assert found.accuracy.endswith("g has no real zeros.")
    stopped = replace(FULL, valid=False, why_not="stopped after 3 points")
    assert "stopped after 3 points" in verdict_of(stopped, stopped, obstacle="no").speed
    one = candidate(1)
    assert "stopped after 3 points" in verdict_of(one, one, stopped).speed


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["linear", "michaelis_menten", "van_der_pol", "chaplygin_sleigh"])
def test_every_face_shows_the_same_verdict(name: str, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(charts, "applicable", lambda analysis: {"time_series": charts.time_series})
    analysis = analysis_of(name)
    choice = analysis.choice
    monkeypatch.setattr("gsp.analysis.analysis.analyse", lambda *a, **k: analysis)
    monkeypatch.setattr("gsp.choice.choice.choose", lambda *a, **k: choice)
    verdict = choice.verdict
    assert str(choice).splitlines()[0] == str(verdict)
    assert choice.reason == verdict.sentences
    page = Page(analysis)
    assert page.verdict() == (verdict.answer.capitalize(), words(verdict.sentences))
    folder = write_report(analysis, tmp_path / name).parent
    text = (folder / "report.html").read_text(encoding="utf-8")
    # On the card, and above the table of candidates.
    assert text.count(str(words(verdict.sentences))) == 2
    assert text.count(f"{verdict.answer.capitalize()}:</b>") == 2
    for content in (json.loads((folder / "report.json").read_text(encoding="utf-8")), as_json(analysis)):
        assert content["choice"] == choice.as_json()
        assert content["choice"]["attributes"]["answer"] == verdict.answer
    for command in (["choose", name], ["report", name, "-o", str(tmp_path / "again")]):
        assert str(verdict) in CliRunner().invoke(cli, command).output.splitlines()
    assert str(verdict) in str(analysis).splitlines()
    # What is shown of seconds is one measurement.
    rows = {row["name"]: row["microseconds"] for row in page.choice()["rows"]}
    assert rows == pytest.approx({c.label: 1e6 * c.seconds for c in choice.candidates}, nan_ok=True)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["michaelis_menten", "van_der_pol", "chaplygin_sleigh"])
def test_the_report_decides_as_choose_does(name: str) -> None:
    # Seconds differ from run to run, and with them whether it pays; what is exact enough does not.
    def may(answer: str) -> str:
        return "yes" if answer in (Answer.YES, Answer.AS_FAST, Answer.NO_GAIN) else answer

    shown = json.loads(CliRunner().invoke(cli, ["choose", name, "--json"]).stdout)
    asked, told = choose(models.load(name)), analysis_of(name).choice
    valid = [(c.label, c.valid) for c in told.candidates]
    assert [(c.label, c.valid) for c in asked.candidates] == valid
    labels, fit = (
        shown[kind][name]["values"] for kind, name in (("coordinates", "model"), ("variables", "valid"))
    )
    assert list(zip(labels, fit)) == valid
    assert may(shown["attributes"]["answer"]) == may(asked.verdict.answer) == may(told.verdict.answer)


TANH = sp.tanh(30 * (sp.Symbol("x") - sp.Rational(1, 2)))


@pytest.mark.parametrize(
    ("target", "expected"),
    [(TANH, None), (TANH / 50, None), (sp.sin(sp.Symbol("x")), 0.05), (sp.exp(sp.Symbol("x") ** 2 / 4), 0.03)],
    ids=["a switch", "a low switch", "a sine", "a growing one"],
)
def test_the_answer_says_of_which_variables_it_speaks_and_what_the_fast_ones_are_off_by(
    target, expected
) -> None:
    # x' = 1 is exact at order 0, while y lags behind.
    x, y, epsilon = sp.symbols("x y epsilon")
    system = SlowFastSystem(slow={x: 1}, fast={y: -y + target}, epsilon=epsilon)
    scene = Scene(system, {"x": (0, 1)}, {"x": 0, "y": 0}, (0, 1), 0.05)
    choice = choose(scene, orders=(0,), solve=False)
    assert choice.candidates[0].predicted < 1e-12
    assert "in x; in the fast variables it is" in choice.verdict.accuracy
    manifold = sp.lambdify(x, target, "numpy")
    size = abs(manifold(np.linspace(0, 1, 1001))).max()
    # The slow manifold lies about epsilon times the slope beside the critical one.
    assert choice.layer_error == pytest.approx(abs(manifold(0.0)) / size, abs=0.1)
    begin, end = choice.fast_measured or (choice.layer, 1.0)
    times = np.linspace(begin, end, 33)
    run = integrate(system, start=scene.start, span=(0, 1), epsilon=0.05, rtol=1e-10, atol=1e-13, at=times)
    truth = abs(run["y"] - manifold(times)).max() / size
    # A series that does not converge gives no number; what is told was measured, and where.
    assert ("does not converge" in choice.verdict.accuracy) == (choice.fast_measured is not None)
    assert (choice.fast_measured is None) == (expected is not None)
    if expected is None:
        assert choice.fast_error == pytest.approx(truth, rel=1e-3)
        assert f"measured on t = {begin:.4g} to {end:.4g}" in choice.verdict.accuracy
    else:
        assert choice.fast_error == pytest.approx(expected, rel=0.5)
    # Asked for, they are among the errors themselves.
    asked = choose(scene, orders=(0,), solve=False, fast=True)
    assert not asked.candidates[0].valid
    assert asked.fast_error != asked.fast_error


def test_far_from_the_origin_an_error_is_told_as_a_share_of_what_moves_too() -> None:
    T, x, epsilon = sp.symbols("T x epsilon")
    system = SlowFastSystem(slow={T: -((T - 300) ** 2) - x}, fast={x: (T - 300) ** 3 - x}, epsilon=epsilon)
    far = far_from_origin(system, ["T"], {"T": (299.0, 303.0), "x": (-1.0, 1.0)})
    assert far == ("T", pytest.approx(4.0 / 303.0))
    # Not far off for what it moves, not asked about, or not bounded.
    assert far_from_origin(system, ["T"], {"T": (-400.0, 303.0)}) is None
    assert far_from_origin(system, ["x"], {"T": (299.0, 303.0), "x": (-1.0, 1.0)}) is None
    assert far_from_origin(system, ["T"], {}) is None
    one = candidate(1, predicted=3e-6)
    assert (
        "As a share of the width of its region, that of T may be 0.00023."
        in verdict_of(one, one, FULL, far=far).accuracy
    )
    exact = replace(one, predicted=9e-8)
    for found in (verdict_of(one, one, FULL), verdict_of(exact, exact, FULL, far=far)):
        assert "width" not in found.accuracy
