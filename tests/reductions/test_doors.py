"""A reduction that is found and one that is named with `take_fast` are one question, and get one answer."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from gsp.choice.choice import Choice, choose
from gsp.choice.prediction import Failure
from gsp.choice.verdict import Answer
from gsp.readers.loading import load_noted
from gsp.reductions.reductions import find_reductions
from gsp.scenes.small_parameter import take_fast, without_small
from tests.reductions.test_reductions import scene

SYSTEMS = sorted((Path(__file__).parents[1] / "systems").glob("*.toml"))


def serves(choice: Choice) -> bool:
    return choice.verdict.answer in (Answer.YES, Answer.AS_FAST, Answer.NO_GAIN)


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    "path",
    SYSTEMS,
    ids=lambda path: path.stem,
)
def test_without_its_small_parameter_every_system_is_reduced_the_same_way_found_and_named(path: Path) -> None:
    plain = without_small(load_noted(path)[0])
    found = find_reductions(plain)
    if found.taken is None or found.taken.candidate.order is None:
        return
    if not found.taken.name.startswith("quasi-steady state of "):
        return
    names = found.taken.name.removeprefix("quasi-steady state of ").split(", ")
    assert found.study is not None
    own = choose(found.study, fast=found.taken.counts_fast)
    named = choose(take_fast(plain, variables=names), fast=found.taken.counts_fast)
    if any(c.failure is Failure.REGION for c in named.candidates):
        # What is found is judged by its measured error alone, and may lie beside the region, as plankton's sheet does.
        return
    assert serves(own) is serves(named)


@pytest.mark.exhaustive
def test_a_reduction_that_is_foretold_too_is_no_chance() -> None:
    """A car whose tyres relax, 5.7 times as fast as it turns: exp(-5.7) is more than a tenth of the tolerance."""
    rates = {
        "beta": "(Ff + Fr)/(m*v) - r",
        "r": "(lf*Ff - lr*Fr)/J",
        "Ff": "v/sig*(Cf*(steer - beta - lf*r/v) - Ff)",
        "Fr": "v/sig*(Cr*(-beta + lr*r/v) - Fr)",
    }
    values = {
        "m": 1500,
        "J": 2500,
        "v": 20,
        "lf": 1.2,
        "lr": 1.4,
        "Cf": 8e4,
        "Cr": 9e4,
        "sig": 0.4,
        "steer": 0.02,
    }
    car = replace(scene(rates, values, dict.fromkeys(rates, 0.0), 2), tolerance=0.02)
    found = find_reductions(car)
    assert found.recommended is not None
    assert found.recommended.name == "quasi-steady state of Ff, Fr"
    assert found.study is not None
    assert serves(choose(found.study))
    assert serves(choose(take_fast(car, variables=["Ff", "Fr"])))
