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
    assert serves(own) is serves(named)


@pytest.mark.parametrize(("region", "answer"), [({}, True), ({"a": (0, 3)}, True), ({"a": (0, 2)}, False)])
def test_a_region_that_was_given_and_not_found_is_a_limit(
    region: dict[str, tuple[int, int]], answer: bool
) -> None:
    """a goes to 2.5."""
    asked = replace(
        scene({"a": "1", "b": "1000*(a - b)"}, {}, {"a": 1, "b": 1}, 1.5), region=region, tolerance=0.01
    )
    found = find_reductions(asked)
    assert (found.recommended is not None) is answer
    assert ("but the region is left at t = 1. A larger region or a shorter span" in found.reason) is not answer
    assert serves(choose(take_fast(asked, variables=["b"]))) is answer


@pytest.mark.exhaustive
def test_bounds_that_a_run_found_do_not_limit_the_states_of_a_field_that_was_split() -> None:
    """The fast one is off by more than the tolerance, beyond all that it was over the run; the slow sum is not."""
    path = Path(__file__).parents[1] / "systems" / "brusselator.toml"
    plain = replace(without_small(load_noted(path)[0]), region={}, tolerance=1e-2)
    found = find_reductions(plain).recommended
    assert found is not None
    assert found.name == "partial equilibrium of y <-> x"
    assert choose(found.scene, orders=(0,), solve=False).candidates[0].valid


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


@pytest.mark.parametrize(("most", "leaves"), [(2.05, True), (2.5, False)])
def test_a_limit_of_a_fast_variable_is_met_where_the_corrected_run_begins(most: float, leaves: bool) -> None:
    """With a' = -4 a or so b is 2 a + 8 a/40 on M_epsilon, 2.2 at the start, where M0 has 2; a feels no layer."""
    asked = scene({"a": "-4*a - b/100", "b": "40*(2*a - b)"}, {}, {"a": 1, "b": 2}, 1)
    asked = replace(asked, region={"a": (0, 1), "b": (0, most)}, tolerance=0.05)
    first = choose(take_fast(asked, variables=["b"]), orders=(1,), solve=False).candidates[0]
    assert (first.failure is Failure.REGION) is leaves
