"""Every scene of the repository in other units and in other orders: the same verdicts."""

from __future__ import annotations

import re

import numpy as np
import pytest

from gsp.analysis.analysis import analyse
from gsp.choice.choice import choose
from gsp.choice.verdict import Answer
from gsp.errors import GspError
from gsp.hyperbolicity.hyperbolicity import classify
from gsp.scenes.study import study_of
from tests.cases import sampled
from tests.rescaling import (
    VERBS,
    in_other_units,
    mirrored,
    named_points,
    reordered,
    rescaled,
    retimed,
    scene,
    scenes,
    shifted,
    told,
    unordered,
    verdict,
)

SAMPLE = ("nonholonomic_particle", "shishkova", "oscillator_mm")
"""Slow variables in a cascade, fast ones in units of their own, and an oscillation."""
REPORTED = ("van_der_pol", "folded_node")
"""A singular orbit that closes, and a fold with a folded node on it."""
JUDGED = ("check", "folds", "expand", "choose")
"""Of every second scene; of those between, a report tells what is chosen."""
REFERENCE = {"swing_rad": 10.808, "swing_bal": 10.808, "oscillator_mm": float("inf")}


@pytest.mark.parametrize(
    "case",
    sampled(
        [
            *((name, ("check",)) for name in SAMPLE),
            *((name, JUDGED[:-1] if place % 2 else JUDGED) for place, name in enumerate(scenes())),
        ],
        always=[(name, ("check",)) for name in SAMPLE],
    ),
)
def test_neither_units_nor_the_order_of_declaration_nor_what_ran_before_change_a_verdict(
    case: tuple[str, tuple[str, ...]],
) -> None:
    """Half the scenes in small units and half in large ones; `python -m tests.rescaling` tries all with all."""
    name, verbs = case
    plain = scene(name)
    small, apart, large, apart_otherwise = in_other_units(plain)
    alike, mixed = (large, apart_otherwise) if scenes().index(name) % 2 else (small, apart)
    # What is asked of one study, in this order; in the other order of the same scene declared in another.
    study, other = study_of(plain), study_of(reordered(plain, 1))
    expected = {verb: verdict(study, verb) for verb in verbs}
    for verb in reversed(verbs):
        assert verdict(other, verb) == expected[verb], verb
    assert {verb: verdict(study, verb) for verb in verbs} == expected
    for verb in verbs:
        for powers in (mixed,) if verb == "choose" else (mixed, alike):
            assert verdict(rescaled(plain, powers), verb) == expected[verb], (verb, powers)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", sorted({*scenes()[1::2], *REPORTED}))
def test_a_report_says_and_names_the_same_in_other_units(name: str) -> None:
    plain = scene(name)
    powers = list(in_other_units(plain))[1 + 2 * (scenes().index(name) % 2)]
    other = rescaled(plain, powers)
    try:
        expected = analyse(plain, order=2)
    except GspError as error:
        refusal = type(error).__name__
        expected = None
    if expected is None:
        assert verdict(other, "report") == refusal
        assert verdict(other, "choose") == verdict(plain, "choose")
        return
    found = analyse(other, order=2)
    assert told(found) == told(expected)
    points = named_points(expected, dict.fromkeys(powers, 0))
    assert named_points(found, powers) == pytest.approx(points, rel=1e-6, abs=1e-9, nan_ok=True)


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", [*((name, VERBS) for name in scenes()[::8]), ("van_der_pol", ("report",))])
def test_units_of_time_change_no_verdict(case: tuple[str, tuple[str, ...]]) -> None:
    """Each in a short unit or in a long one; `python -m tests.rescaling --time` tries all scenes with both."""
    name, verbs = case
    plain = scene(name)
    other = retimed(plain, 6 if scenes().index(name) % 16 else -6)
    for verb in verbs:
        assert verdict(other, verb) == verdict(plain, verb), verb


@pytest.mark.exhaustive
@pytest.mark.parametrize("case", [*((name, VERBS) for name in scenes()[4::8]), ("van_der_pol", ("report",))])
def test_the_direction_in_which_states_are_counted_changes_no_verdict(
    case: tuple[str, tuple[str, ...]],
) -> None:
    """`python -m tests.rescaling --mirror` tries all scenes. Two differ: how long a series of the Arrhenius reactor is
    hangs on signs, and a battery's sheet ends beside a fold far outside its region.
    """
    name, verbs = case
    plain = scene(name)
    for verb in verbs:
        assert unordered(verdict(mirrored(plain), verb)) == unordered(verdict(plain, verb)), verb


FAR = ("sled", "two_pool", "oregonator")
"""A splitting that is tried from random starts, one with rational rates, and a fold in a narrow corner."""


@pytest.mark.parametrize(
    "name", [*FAR, *(pytest.param(n, marks=pytest.mark.exhaustive) for n in scenes()[2::8])]
)
@pytest.mark.parametrize("by", [1_000, pytest.param(-1_000_000, marks=pytest.mark.exhaustive)])
def test_where_the_states_have_their_origin_changes_no_verdict(name: str, by: int) -> None:
    """`python -m tests.rescaling --shift` tries all scenes. What `choose` says is a share of the states' size."""
    plain = scene(name)
    other = shifted(plain, {s.name: by for s in plain.system.states})
    for verb in JUDGED[:-1]:
        assert verdict(other, verb) == verdict(plain, verb), verb


@pytest.mark.exhaustive
def test_a_sheet_is_followed_to_where_it_stands_in_units_in_which_it_is_large() -> None:
    """Newton's method moves a point by its rounding, 1e-8 where V is 1e8, and the way there has no length."""
    plain = scene("butera_rinzel_smith")
    study = study_of(rescaled(plain, {s.name: 6 for s in plain.system.states}))
    for h in np.linspace(*study.region["h"], 50):
        x = np.array([[h]])
        y = study.branch.points(x)
        followed, good = study.branch.follow(x, start=(x[0], y[0]))
        assert good.all()
        assert np.allclose(followed, y, rtol=1e-9, atol=0.0)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", REFERENCE)
def test_one_machine_and_one_oscillator_are_judged_alike_in_all_units(name: str) -> None:
    """The rate of each constant metric is at least |Re lambda|, which no units change, and the least comes to it."""
    study = study_of(scene(name))
    found = classify(study.branch, region=study.region, epsilon=study.scene.epsilon)
    assert found.holds
    assert found.rates.r(study.scene.epsilon) == pytest.approx(REFERENCE[name], rel=1e-3)
    assert not re.search("falls short", str(found))


@pytest.mark.exhaustive
def test_one_machine_may_be_reduced_in_all_units_or_in_none() -> None:
    """Its angular velocity is per unit, in rad/s, and balanced; the model taken is the solved manifold."""
    found = [choose(scene(name)) for name in ("swing", "swing_rad", "swing_bal")]
    assert {each.verdict.answer for each in found} <= {Answer.YES, Answer.AS_FAST, Answer.NO_GAIN}
    assert {each.model.label for each in found} == {found[0].model.label}
    predicted = [each.model.predicted for each in found]
    assert max(predicted) < 2.0 * min(predicted)
