"""Every scene of the repository in other units and in other orders: the same verdicts."""

from __future__ import annotations

import re

import pytest

from gsp.hyperbolicity.hyperbolicity import classify
from gsp.scenes.study import study_of
from tests.cases import sampled
from tests.rescaling import VERBS, in_other_units, reordered, rescaled, scene, scenes, verdict

SAMPLE = ("nonholonomic_particle", "shishkova", "oscillator_mm")
"""Slow variables in a cascade, fast ones in units of their own, and an oscillation."""
REFERENCE = {"swing_rad": 10.808, "swing_bal": 10.808, "oscillator_mm": float("inf")}


@pytest.mark.parametrize("name", sampled(scenes(), always=SAMPLE))
def test_units_change_no_verdict_of_hyperbolicity(name: str) -> None:
    plain = scene(name)
    expected = verdict(plain, "check")
    singly = name not in SAMPLE
    for powers in in_other_units(plain, singly=singly):
        assert verdict(rescaled(plain, powers), "check") == expected, powers


@pytest.mark.exhaustive
@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb != "check"])
@pytest.mark.parametrize("name", scenes())
def test_units_change_no_verdict_of_any_verb(name: str, verb: str) -> None:
    plain = scene(name)
    expected = verdict(plain, verb)
    for powers in in_other_units(plain, singly=True):
        assert verdict(rescaled(plain, powers), verb) == expected, powers


@pytest.mark.parametrize("name", sampled(scenes(), always=SAMPLE))
def test_the_order_of_declaration_and_what_ran_before_change_no_verdict(name: str) -> None:
    plain = scene(name)
    verbs = ("check",) if name in SAMPLE else VERBS
    expected = [verdict(plain, verb) for verb in verbs]
    other = reordered(plain, 1)
    assert [verdict(other, verb) for verb in reversed(verbs)][::-1] == expected


@pytest.mark.parametrize("name", REFERENCE)
def test_one_machine_and_one_oscillator_are_judged_alike_in_all_units(name: str) -> None:
    """The rate of each constant metric is at least |Re lambda|, which no units change, and the least comes to it."""
    study = study_of(scene(name))
    found = classify(study.branch, region=study.region, epsilon=study.scene.epsilon)
    assert found.holds
    assert found.rates.r(study.scene.epsilon) == pytest.approx(REFERENCE[name], rel=1e-3)
    assert not re.search("falls short", str(found))
