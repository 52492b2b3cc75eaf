"""The contract of every public verb: what it cannot take it refuses by name, before any work is done."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any

import pytest
import sympy as sp

import gsp
from gsp.errors import GspError
from tests.contracts import KEYWORDS, WRONG, Kind, public
from tests.example_nouns import OSCILLATOR, blank, michaelis, van_der_pol

CONTRACTS = public("VERBS")

NOUNS = {
    name: value
    for name in gsp.__all__
    if isinstance(value := getattr(gsp, name), type) and not issubclass(value, (Enum, Exception))
}
VERBS = [
    name
    for name in gsp.__all__
    if inspect.isfunction(getattr(gsp, name)) or name in ("SlowFastSystem", "VectorField", "Scene", "Event")
]


def parameters_of(verb: str) -> dict[str, inspect.Parameter]:
    return dict(list(inspect.signature(getattr(gsp, verb)).parameters.items())[1:])


def kind_of(verb: str, keyword: str) -> Kind:
    known = {**KEYWORDS, **CONTRACTS[verb].own}
    if keyword not in known:
        pytest.fail(f"{verb} takes {keyword}, of which the contract says nothing. Add its kind.")
    return known[keyword]


def variants(wanted: Kind, right: Any, optional: bool) -> dict[str, Any]:
    """Wrong values for a keyword: as a whole, and in the place of the first thing inside the `right` one."""
    wrong = {
        what: value
        for what, value in WRONG.items()
        if what not in wanted.right and not (value is None and optional)
    }
    if wanted.inside is None or not isinstance(right, (Mapping, tuple)) or not right:
        return wrong
    deeper = variants(wanted.inside, first_of(right), False)
    for what, value in deeper.items():
        if isinstance(right, Mapping):
            wrong[f"{{..: {what}}}"] = {**right, next(iter(right)): value}
        else:
            wrong[f"[{what}, ..]"] = (value, *right[1:])
    return wrong


def first_of(right: Any) -> Any:
    return next(iter(right.values())) if isinstance(right, Mapping) else right[0]


def complaint(call: Callable[[], object], words: list[str]) -> str:
    """What is wrong with the answer to a wrong call; empty when it is refused in one of these words."""
    try:
        call()
    except GspError as error:
        message = str(error)
        if not any(word in message for word in words):
            return f"refused without naming {' or '.join(words)}: {message}"
        return "" if len(message) < 600 else f"refused in {len(message)} characters"
    except Exception as error:
        return f"{type(error).__name__}: {error}"[:300]
    return "accepted"


def test_every_verb_has_a_contract() -> None:
    assert set(CONTRACTS) == set(VERBS)


@pytest.mark.parametrize("verb", VERBS)
def test_what_a_verb_cannot_take_is_refused_by_name(verb: str) -> None:
    contract = CONTRACTS[verb]
    right = contract.right()
    takes_text = verb in ("load", "Event", "progress_bar")
    given = {what: value for what, value in WRONG.items() if not (takes_text and what == "text")}
    if verb == "Event":
        given.pop("an expression")
    nouns = {name: blank(noun) for name, noun in NOUNS.items() if name not in contract.takes}
    assert len(nouns) > 30
    words = [verb, "event" if verb == "Event" else next(iter(inspect.signature(getattr(gsp, verb)).parameters))]
    found = {
        what: answer
        for what, value in {**given, **nouns, "the class of it": gsp.Branch}.items()
        if (answer := complaint(lambda value=value: getattr(gsp, verb)(value, **right), words))
    }
    assert not found, f"{verb}: {found}"


@pytest.mark.parametrize(
    ("verb", "keyword"), [(verb, keyword) for verb in VERBS for keyword in parameters_of(verb)]
)
def test_a_wrong_value_of_a_keyword_is_refused_by_name(verb: str, keyword: str) -> None:
    contract = CONTRACTS[verb]
    first, right = contract.first(), dict(contract.right())
    default = parameters_of(verb)[keyword].default
    example = right.get(keyword, None if default is inspect.Parameter.empty else default)
    example = EXAMPLES.get(keyword) if example is None or example == () else example
    words = [keyword, keyword.removesuffix("s"), keyword.replace("_", " ")]
    found = {
        what: answer
        for what, value in variants(kind_of(verb, keyword), example, default is None).items()
        if (
            answer := complaint(
                lambda value=value: getattr(gsp, verb)(first, **{**right, keyword: value}), words
            )
        )
    }
    assert not found, f"{verb}({keyword}=...): {found}"


@pytest.mark.parametrize(
    ("verb", "noun", "words"),
    [
        ("solve_critical", "VectorField", "solve_critical(split(field).system"),
        ("expand", "SlowFastSystem", "expand(solve_critical(system).branches[0]"),
        ("restrict", "Branch", "restrict(expand(branch)"),
        ("restrict", "VectorField", "restrict(expand(solve_critical(split(field).system).branches[0])"),
        ("integrate", "SeriesManifold", "integrate(restrict(series)"),
        ("integrate", "CriticalManifold", "integrate(restrict(expand(critical.branches[0]))"),
        ("integrate_many", "Scene", "integrate_many(scene.system"),
        ("write_report", "Scene", "write_report(analyse(scene)"),
        ("folded_canards", "SlowFastSystem", "folded_canards(folded_singularities(system, region=...)[0]"),
        ("shoot", "ReducedFlow", "shoot(periodic_orbit(flow, start=...)"),
        ("choose", "Comparison", "choose(comparison.scene"),
    ],
)
def test_a_noun_of_ours_is_answered_with_the_verbs_that_come_first(verb: str, noun: str, words: str) -> None:
    with pytest.raises(GspError) as caught:
        getattr(gsp, verb)(blank(NOUNS[noun]), **CONTRACTS[verb].right())
    assert words in str(caught.value)


def test_every_verb_that_a_message_names_is_there() -> None:
    from gsp.systems.arguments import _SOURCES, _STEPS

    texts = [*_SOURCES.values(), *(text for steps in _STEPS.values() for text in steps.values())]
    called = {name for text in texts for name in re.findall(r"(?<![.\w])([a-z_]+)\(", text)}
    assert {name for name in called if name not in gsp.__all__} == set()
    attributes = {(noun, text[3:].split("[")[0]) for noun, steps in _STEPS.items() for text in steps.values()
                  if text.startswith("{}.")}  # fmt: skip
    assert attributes
    for noun, attribute in attributes:
        known = NOUNS[noun]
        assert hasattr(known, attribute) or attribute in known.__dataclass_fields__, (noun, attribute)


def test_a_scene_simply_runs_and_what_the_call_says_stands_in_its_place() -> None:
    scene = michaelis()
    run = gsp.integrate(scene)
    same = gsp.integrate(scene.full_flow, start=scene.full_start, span=scene.span, epsilon=scene.epsilon)
    assert run.t.tobytes() == same.t.tobytes()
    assert run.y.tobytes() == same.y.tobytes()
    other = gsp.integrate(scene, start={"s": 0.5, "c": 0.1}, span=(0.0, 0.5), epsilon=0.02)
    assert (other.t[-1], other.epsilon, other["s"][0]) == (0.5, 0.02, 0.5)


def test_only_a_scene_has_a_start_and_a_span_of_its_own() -> None:
    with pytest.raises(GspError, match="start is missing"):
        gsp.integrate(van_der_pol(), span=(0, 1), epsilon=0.1)
    with pytest.raises(GspError, match="span is missing"):
        gsp.integrate(van_der_pol(), start=OSCILLATOR, epsilon=0.1)


@pytest.mark.parametrize("method", ["at", "sample"])
@pytest.mark.parametrize(
    "what", ["text", "an array of text", "a ragged list", "complex", "True", "None", "a class"]
)
def test_a_trajectory_is_asked_for_times_only(method: str, what: str) -> None:
    run = gsp.integrate(van_der_pol(), start=OSCILLATOR, span=(0, 0.1), epsilon=0.1)
    with pytest.raises(GspError, match=r"^t is "):
        getattr(run, method)(WRONG[what])


# Right values of what is left out by default, to put wrong ones into.
EXAMPLES = {
    "epsilons": (0.02, 0.01),
    "at": (0.25, 0.5),
    "reconstruction": {sp.Symbol("u"): sp.Symbol("s")},
    "near": None,
    "region": {"s": (0.1, 1.0)},
    "positions": (0.3, 0.5),
    "tolerances": (0.1, 0.01),
    "parameters": None,
    "observables": None,
    "reconstruction_start": {"u": 0.0},
    "section": {"x": -1.0},
    "watch": {"speed": sp.Symbol("x")},
}
