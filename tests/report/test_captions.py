"""What captions and sentences of a page say: what is drawn, with the signs, digits and units that hold."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

import gsp
from gsp import charts
from gsp.analysis.analysis import Analysis
from gsp.analysis.pictured_runs import landing_runs
from gsp.charts import manifolds, sampling
from gsp.charts.orbits import shrinks_in_proportion
from gsp.charts.style import add_units
from gsp.errors import DeclarationError, Status
from gsp.hyperbolicity.hyperbolicity import Condition, Kind
from gsp.report.captions import caption
from gsp.report.reduction_limits import _as, _bound
from gsp.report.sections import Page
from gsp.report.setting import Setting
from gsp.results.bounds import at_least, at_most
from gsp.scenes.study import study_of
from tests.analyses import analysis_of


@pytest.fixture(scope="module")
def enzyme() -> Analysis:
    return analysis_of("michaelis_menten")


def said(name: str, analysis: Analysis) -> str:
    return str(caption(name, analysis, Page(analysis).set))


def of_kind(analysis: Analysis, kind: Kind) -> Analysis:
    return replace(analysis, hyperbolicity=replace(analysis.hyperbolicity, kind=kind))


def test_a_limit_that_ends_at_a_fold_is_not_approached_in_proportion(enzyme: Analysis) -> None:
    assert shrinks_in_proportion(enzyme)
    outcome = enzyme.limit._outcome
    outcome = outcome._replace(record=outcome.record._replace(status=Status.FOLD_REACHED))
    ended = replace(enzyme, limit=replace(enzyme.limit, _outcome=outcome))
    assert not shrinks_in_proportion(ended)
    assert "The limit ends early: a fold" in said("convergence", ended)
    assert "proportional" not in said("convergence", ended)


def test_runs_that_ended_early_are_told_once_with_their_orders_and_epsilons(enzyme: Analysis) -> None:
    found, lost, ends = enzyme.comparison, Status.HYPERBOLICITY_LOST, Status.SERIES_ENDS
    fine = [Status.SUCCESS] * len(found.epsilons)
    statuses = dict.fromkeys(found.errors, fine) | {0: [lost] * len(fine), 1: [ends, *fine[1:]]}
    told = Page(replace(enzyme, comparison=replace(found, statuses=statuses))).errors()["stopped"]
    assert told == [
        f"A run of order 0 at each epsilon did not reach the end: {lost.meaning}.",
        f"Of order 1 at {found.epsilons[0]:.3g} for epsilon a run did not reach the end: {ends.meaning}.",
    ]


def test_the_limit_is_drawn_as_far_as_runs_are_compared_with_it(enzyme: Analysis) -> None:
    short = enzyme.limit.sample(np.linspace(0.0, 0.25 * enzyme.limit.t[-1], 50))
    axes = charts.convergence(replace(enzyme, limit=short))
    assert axes.lines[0].get_xdata()[-1] == short.t[-1]
    assert axes.get_xlim()[1] < 1.1 * short.t[-1]


def test_what_repels_has_no_layer_in_which_variables_settle(enzyme: Analysis) -> None:
    repelling = of_kind(enzyme, Kind.REPELLING)
    assert "initial layer" in said("convergence", enzyme)
    assert "layer" not in said("convergence", repelling)
    assert "come nearer to it" in said("time_series", enzyme)
    assert "move away from it by a factor of e" in said("time_series", repelling)
    assert "away from it where it repels" in said("phase_portrait", repelling)


def test_the_caption_of_eigenvalues_speaks_of_what_is_drawn(enzyme: Analysis) -> None:
    assert "the strip of half-width" in said("eigenvalues", enzyme)
    # Colours over two slow variables, and no strip.
    coloured = said("eigenvalues", analysis_of("chaplygin_sleigh"))
    assert "is nearer to 0 than" in coloured
    assert "strip" not in coloured


def test_a_distance_is_drawn_up_to_where_the_manifold_is_known(
    enzyme: Analysis, monkeypatch: pytest.MonkeyPatch
) -> None:
    def known(analysis: Analysis, x: np.ndarray) -> np.ndarray:
        on = np.zeros((len(x), 1))
        on[len(x) // 3 :] = np.nan
        return on

    monkeypatch.setattr(sampling, "slow_manifold", known)
    found = manifolds.approaches(enzyme)
    assert found
    assert not any(each.is_whole for each in found)
    assert {len(each.gaps) for each in found} == {sampling.LINE // 3}
    assert len(charts.distance(enzyme).lines) > len(found)
    text = said("distance", enzyme)
    assert "A line ends where its run leaves" in text
    assert "grey zone" not in text


def test_no_distance_is_drawn_where_the_manifold_is_not_known_at_any_start(
    enzyme: Analysis, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sampling, "slow_manifold", lambda analysis, x: np.full((len(x), 1), np.nan))
    assert "distance" not in charts.applicable(enzyme)
    with pytest.raises(DeclarationError, match="no run starts where the slow manifold is known"):
        charts.distance(enzyme)


def test_landing_runs_start_within_the_region() -> None:
    scene = gsp.models.load("michaelis_menten")
    # The limit run falls from 1 to below 0.1.
    study = study_of(replace(scene, region={**scene.region, "s": (0.7, 2.0)}))
    limit = gsp.integrate(study.reduced(0), start={"s": 1}, span=scene.span, epsilon=scene.epsilon)
    runs = landing_runs(study, study.series(1), study.hyperbolicity, limit)
    assert min(run["s"][0] for run in runs) >= 0.7
    assert len({run["s"][0] for run in runs}) == 3


def test_a_base_point_that_is_not_known_to_the_digits_shown_says_so(enzyme: Analysis) -> None:
    assert enzyme.base is not None
    assert "is known to" not in said("time_series", enzyme)
    vague = replace(enzyme.base, errors={"s": 0.2})
    assert "is known to about 0.2" in said("time_series", replace(enzyme, base=vague))
    lost = replace(enzyme.base, errors={"s": 4e3})
    assert "is not known: it may be off by about 4×10" in said("time_series", replace(enzyme, base=lost))


def test_proved_numbers_are_rounded_to_the_side_on_which_they_hold() -> None:
    proved = Condition("hyperbolic equilibria", "", 0.99999, "", True, is_proved=True)
    assert Page.decided_by(proved) == "0.9999"
    assert Page.decided_by(replace(proved, is_proved=False)) == "1"
    assert Page.decided_by(replace(proved, value=np.inf)) == "∞"
    assert _bound(-1.0, at_least) == "−1"
    assert _bound(1.23456789e-5, at_most) == "1.23457×10<sup>−5</sup>"
    assert _as("-0.30000000000000004") == "−0.30000000000000004"


def test_units_stand_behind_values_and_times() -> None:
    s = sp.Symbol("s")
    setting = Setting([s], {"s": "<mM>"})
    assert str(setting.named_value(s, 2)).endswith("\u00a0&lt;mM&gt;")
    assert str(setting.interval("s", (0.0, 1.0))).endswith("\u00a0&lt;mM&gt;")
    assert setting.unit("t") == ""
    axes = Figure().add_subplot()
    axes.set_xlabel(r"fast time $\tau = t$/$\epsilon$")
    axes.set_ylabel("slow time $t$, logarithmic")
    for _ in range(2):
        add_units(axes, {"t": "min"})
    assert axes.get_xlabel().endswith("$ (min)")
    assert axes.get_ylabel() == "slow time $t$, logarithmic (min)"


def test_the_critical_manifold_has_the_units_of_the_scene() -> None:
    found = analysis_of("van_der_pol")
    slow = found.study.system.x[0].name
    axes = charts.surroundings(replace(found, study=study_of(replace(found.scene, units={slow: "mV"}))))
    assert axes.get_xlabel().endswith("(mV)")


def test_what_was_not_measured_is_no_number(enzyme: Analysis) -> None:
    unmeasured = replace(enzyme, choice=replace(enzyme.choice, measured=float("nan")))
    assert Page(unmeasured).choice()["measured"] is None
    assert Page(enzyme).choice()["measured"] == enzyme.choice.measured
