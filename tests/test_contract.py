"""The contract of every public verb: what it cannot take it refuses by name, before any work is done."""

from __future__ import annotations

import dataclasses
import inspect
import re
import tempfile
from collections.abc import Callable, Mapping
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp import models
from gsp.errors import GspError
from gsp.orbits.canard_orbits.canard import Canard
from tests import example_systems as systems

epsilon, x, y, z, a = sp.symbols("epsilon x y z a")


def a_function() -> None:
    """Something that no verb takes."""


# Numbers, text, sequences and classes where none is meant, with what each is called in a failed assertion.
WRONG = {
    "10**400": 10**400,
    "10**5000": 10**5000,
    "nan": float("nan"),
    "inf": float("inf"),
    "-1": -1,
    "0.5": 0.5,
    "text": "no such name",
    "[]": [],
    "an array": np.array([0.1, 0.2]),
    "an array of one": np.array([0.1]),
    "an array of text": np.array(["a"]),
    "a ragged list": [1.0, [2.0]],
    "complex": 1j,
    "a NumPy complex": np.complex128(1j),
    "True": True,
    "a NumPy bool": np.True_,
    "a class": float,
    "a function": a_function,
    "a dict": {"no such name": 1.0},
    "an expression": sp.Symbol("q") + 1,
    "object": object(),
    "None": None,
}


@dataclasses.dataclass(frozen=True)
class Kind:
    """What a keyword takes: which of `WRONG` are right for it, and whether it holds such values inside."""

    right: frozenset[str]
    inside: Kind | None = None


def kind(*right: str, inside: Kind | None = None) -> Kind:
    return Kind(frozenset(right), inside)


POSITIVE = kind("0.5")
NUMBER = kind("0.5", "-1")
COUNT = kind()
# Bounded from above by nothing but memory and patience, which it does not cost to ask for more.
LIMIT = kind("10**400", "10**5000")
FLAG = kind("True", "a NumPy bool")
CALLABLE = kind("a class", "a function")
ANYTHING = kind(*WRONG)
SIGN = kind("-1")
# A name is text, but this one is nobody's.
NAME = kind()
NAMES = kind()
NAMES_OR_NONE = kind("[]")
POINT = kind(inside=NUMBER)
INTERVAL = kind("an array", inside=NUMBER)
REGION = kind(inside=INTERVAL)
ORDERS = kind(inside=COUNT)
ORDERS_OR_NONE = kind("[]", inside=COUNT)
LADDER = kind("an array", "an array of one", inside=POSITIVE)
TIMES = kind("an array", "an array of one", inside=NUMBER)
EXPRESSIONS = kind(inside=kind("10**400", "10**5000", "-1", "0.5", "an expression", "an array of one"))
EVENTS = kind("[]")
NUMBERS = kind(
    "-1", "0.5", "an array", "an array of one", inside=kind("-1", "0.5", "an array", "an array of one")
)
COLUMN = kind("0.5", "an array", "an array of one", inside=POSITIVE)
FOLDER = kind("text")

# The same name means the same everywhere, but for the verbs' own below.
KEYWORDS = {
    **dict.fromkeys(
        ("epsilon", "rtol", "atol", "tolerance", "step", "max_step", "period", "max_period", "longest", "limit",
         "radius"), POSITIVE,
    ),
    **dict.fromkeys(
        ("order", "degree", "max_points", "max_intervals", "resolution", "digits", "max_pieces", "correction"), COUNT
    ),
    "max_steps": LIMIT,
    "threads": LIMIT,
    **dict.fromkeys(("dense", "backward", "symbolic", "numeric", "fast", "solve", "switch_branches", "prove"), FLAG),
    "progress": CALLABLE,
    "direction": SIGN,
    "start": POINT,
    "near": POINT,
    "region": REGION,
    "bounds": REGION,
    "span": INTERVAL,
    "parameter": NAME,
    "method": NAME,
    "orders": ORDERS,
    "epsilons": LADDER,
    "at": TIMES,
    "reconstruction": EXPRESSIONS,
    "events": EVENTS,
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Contract:
    """A right call of a verb: what it takes first, what else, and what its keywords take beyond `KEYWORDS`."""

    takes: tuple[str, ...]
    first: Callable[[], Any]
    right: Callable[[], Mapping[str, Any]]
    own: Mapping[str, Kind] = dataclasses.field(default_factory=dict)


@cache
def van_der_pol() -> gsp.SlowFastSystem:
    return systems.van_der_pol()


@cache
def michaelis() -> gsp.Scene:
    return models.load("michaelis_menten")


@cache
def branch() -> gsp.Branch:
    return gsp.solve_critical(systems.michaelis_menten()).branches[0]


@cache
def series() -> gsp.SeriesManifold:
    return gsp.expand(branch(), order=1)


@cache
def curve() -> gsp.CriticalCurve:
    return gsp.continue_critical(van_der_pol(), start={"x": 2, "y": 2 / 3}, bounds={"y": (-1, 1)})


@cache
def canard_system() -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow={y: a - x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon, parameters={a: 1})


@cache
def canard() -> gsp.CanardValue:
    return gsp.canard_value(canard_system(), parameter=a, order=1)


@cache
def node_system() -> gsp.SlowFastSystem:
    return gsp.SlowFastSystem(slow={x: z / 18 - 10 * y / 9, z: 1}, fast={y: x + y**2}, epsilon=epsilon)


@cache
def node() -> gsp.FoldedSingularity:
    return gsp.folded_singularities(node_system(), region={"y": (-1, 1)})[0]


@cache
def hopf() -> gsp.HopfPoint:
    (found,) = gsp.hopf_points(
        canard_system().with_parameters(a=1.1), start={"x": 1.1, "y": -0.6}, parameter="a",
        bounds=(0.5, 1.5), epsilon=0.01,
    )  # fmt: skip
    return found


@cache
def passage() -> gsp.FoldPassage:
    return gsp.fold_passage(van_der_pol(), {"x": 1, "y": -2 / 3})


@cache
def delayed() -> gsp.DelayedExit:
    system = gsp.SlowFastSystem(slow={x: 1}, fast={y: x * y}, epsilon=epsilon)
    return gsp.entry_exit(gsp.solve_critical(system).branches[0], start={"x": -0.5}, region={"x": (-1, 1)})


def blank(noun: type) -> Any:
    """An instance that holds nothing: who looks further than at its type fails."""
    return object.__new__(noun)


KOPER = {"x": -1.2, "y": 0.5, "z": 0.5}
FLOWS = ("SlowFastSystem", "VectorField", "ReducedFlow")
ENZYME = {"s": 1.0, "c": 0.0}
OSCILLATOR = {"x": 2.0, "y": 0.5}
ON_FOLD = {"x": 1.0, "y": -2 / 3}
BOX = {"s": (0.1, 1.0)}
BEHIND = {"x": -0.5, "y": 0.1}

CONTRACTS = {
    "split": Contract(("VectorField", "SlowFastSystem"), van_der_pol, dict),
    "time_scales": Contract(
        (*FLOWS, "Scene"), systems.michaelis_menten,
        lambda: {"start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01},
    ),
    "small_parameters": Contract(
        ("VectorField",), lambda: gsp.VectorField({x: z * (y - x), y: x - 2 * y}, epsilon=None, parameters={z: 2}),
        dict, {"dimensions": kind(inside=kind()), "vanishing": NAMES_OR_NONE, "kept": NAMES_OR_NONE},
    ),
    "solve_critical": Contract(("SlowFastSystem",), van_der_pol, dict),
    "continue_critical": Contract(
        ("SlowFastSystem",), van_der_pol, lambda: {"start": OSCILLATOR, "bounds": {"y": (-1.0, 1.0)}},
        {"free": NAME, "direction": SIGN},
    ),
    "switch_branch": Contract(
        ("CriticalCurve",), curve, lambda: {"point": curve().special[0]}, {"point": kind()}
    ),
    "continue_folds": Contract(
        ("SlowFastSystem",), systems.koper,
        lambda: {"start": KOPER, "bounds": {"y": (-1.0, 1.0)}}, {"free": NAMES},
    ),
    "critical_sheet": Contract(
        ("SlowFastSystem",), systems.koper,
        lambda: {"start": KOPER, "bounds": {"y": (-1.0, 1.0), "z": (-1.0, 1.0)}}, {"free": NAMES},
    ),
    "classify": Contract(("Branch",), branch, lambda: {"region": BOX}),
    "canard_value": Contract(("SlowFastSystem",), canard_system, lambda: {"parameter": "a"}),
    "match_canard": Contract(
        ("CanardValue",), canard, lambda: {"epsilon": 0.05, "reach": (1.2, 1.9)},
        {"reach": kind("an array", inside=POSITIVE)},
    ),
    "folded_singularities": Contract(
        ("SlowFastSystem",), node_system, lambda: {"region": {"y": (-1.0, 1.0)}}
    ),
    "zero_derivative": Contract(
        ("Branch",), branch, lambda: {"x": {"s": 0.5}, "epsilon": 0.01},
        {"x": NUMBERS, "near": kind("-1", "0.5", "an array", "an array of one")},
    ),
    "solve_manifold": Contract(("Branch",), branch, lambda: {"region": BOX, "epsilon": 0.01}),
    "expand": Contract(("Branch",), branch, dict),
    "certify": Contract(
        ("Branch", "SeriesManifold", "SampledManifold"), branch, lambda: {"region": BOX}, {"most_boxes": LIMIT}
    ),
    "carry_back": Contract(
        ("SeriesManifold",), series, lambda: {"splitting": gsp.split(models.load("michaelis_menten").system)},
        {"splitting": kind()},
    ),
    "bound_reduction": Contract(
        ("SeriesManifold",), series, lambda: {"start": {"s": 1.0}, "span": (0.0, 1.0), "epsilon": 0.01},
        {"reduced_start": POINT, "steps": COUNT},
    ),
    "restrict": Contract(("SeriesManifold",), series, dict),
    "integrate": Contract(
        (*FLOWS, "Scene"), systems.michaelis_menten,
        lambda: {"start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01},
    ),
    "integrate_many": Contract(
        FLOWS, systems.michaelis_menten,
        lambda: {"starts": {"s": 1.0, "c": 0.0}, "span": (0.0, 1.0), "epsilon": 0.01},
        {"epsilon": COLUMN, "starts": kind("an array", inside=kind("0.5", "-1", "an array", "an array of one")),
         "parameters": kind(inside=kind("0.5", "-1", "an array", "an array of one"))},
    ),
    "periodic_orbit": Contract(FLOWS, van_der_pol, lambda: {"start": OSCILLATOR, "epsilon": 0.1}),
    "shoot": Contract(("PeriodicOrbit",), lambda: blank(gsp.PeriodicOrbit), dict, {"phase": NUMBER}),
    "hopf_points": Contract(
        FLOWS, canard_system,
        lambda: {"start": ON_FOLD, "parameter": "a", "bounds": (0.5, 1.5), "epsilon": 0.01},
        {"bounds": INTERVAL},
    ),
    "continue_orbits": Contract(
        ("PeriodicOrbit", "HopfPoint"), hopf, lambda: {"bounds": (0.5, 1.5)}, {"bounds": INTERVAL}
    ),
    "folded_canards": Contract(
        ("FoldedSingularity",), node, lambda: {"epsilon": 0.01},
        dict.fromkeys(("section", "attracting", "repelling"), kind()),
    ),
    "follow_canard": Contract(
        ("Canard",), lambda: blank(Canard), lambda: {"epsilon": (0.01, 0.02)},
        {"epsilon": kind("an array", inside=POSITIVE)},
    ),
    "project": Contract(
        ("SeriesManifold", "Branch", "SampledManifold"), series, lambda: {"start": ENZYME, "epsilon": 0.01}
    ),
    "composite": Contract(
        ("SeriesManifold", "Branch"), series, lambda: {"start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01}
    ),
    "method_table": Contract(
        ("Scene", "Study"), michaelis, dict,
        {"points": kind("-1", "0.5", "an array", "an array of one"), "refinements": ORDERS_OR_NONE,
         "iterates": ORDERS_OR_NONE, "orders": ORDERS_OR_NONE},
    ),
    "fold_passage": Contract(("SlowFastSystem",), van_der_pol, lambda: {"fold": ON_FOLD}, {"fold": POINT}),
    "fold_exit": Contract(
        ("FoldPassage",), passage, lambda: {"epsilon": 0.01, "section": {"x": -1.0}}, {"section": POINT}
    ),
    "fit_omega0": Contract(("FoldPassage",), passage, lambda: {"section": {"x": -1.0}}, {"section": POINT}),
    "entry_exit": Contract(("Branch",), branch, lambda: {"start": {"s": 1.0}, "region": BOX},
        {"start": kind("-1", "0.5", "an array of one", inside=NUMBER)}),
    "measure_delay": Contract(
        ("DelayedExit",), delayed, lambda: {"epsilon": 0.05, "radius": 0.1, "start": BEHIND},
    ),
    "follow": Contract(
        ("SlowFastSystem",), van_der_pol,
        lambda: {"start": OSCILLATOR, "span": (0.0, 0.1), "epsilon": 0.1, "watch": {"speed": x + y}},
        {"until": kind("an expression"), "after": NUMBER,
         "watch": kind(inside=kind("an expression"))},
    ),
    "compare": Contract(("Scene", "Study"), michaelis, dict),
    "work_precision": Contract(
        ("Scene", "Study"), michaelis, dict,
        {"rtols": LADDER, "methods": kind("[]"), "peers": kind("[]"), "orders": ORDERS_OR_NONE},
    ),
    "failure_map": Contract(
        ("Scene", "Study"), michaelis, dict,
        {"axis": NAME, "positions": TIMES, "tolerances": LADDER},
    ),
    "sweep": Contract(
        (), lambda: "integrate",
        lambda: {"over": {"epsilon": (0.1,)}, "into": tempfile.mkdtemp(), "model": "michaelis_menten"},
        {"over": kind(inside=TIMES), "into": FOLDER, "model": NAME, "options": kind(), "workers": LIMIT,
         "client": kind(), "anew": FLAG, "points_per_chunk": LIMIT},
    ),
    "animate": Contract(
        ("Scene", "Study"), michaelis, lambda: {"path": "film.gif"},
        {"path": kind(), "view": NAME, "seconds": POSITIVE},
    ),
    "choose": Contract(("Scene", "Study"), michaelis, dict),
    "simulate": Contract(("Scene", "Study"), michaelis, dict, {"choice": kind()}),
    "singular_orbit": Contract(("Branch",), branch, lambda: {"start": ENZYME}),
    "mixed_mode": Contract(
        FLOWS, van_der_pol,
        lambda: {"name": "x", "start": OSCILLATOR, "span": (0.0, 1.0), "epsilon": 0.1},
        {"settle": POSITIVE, "name": NAME},
    ),
    "load": Contract((), lambda: "no such file.toml", dict),
    "save": Contract(
        ("Scene",), michaelis, lambda: {"path": f"{tempfile.mkdtemp()}/kept.toml"}, {"path": kind()}
    ),
    "progress_bar": Contract((), lambda: "map", dict, {"left": FLAG}),
    "take_small": Contract(("Scene",), michaelis, lambda: {"parameter": "kappa"}, {"parameter": NAME}),
    "take_fast": Contract(
        ("Scene",), michaelis, lambda: {"variables": ("c",)}, {"variables": kind("text")}
    ),
    "study": Contract(("Scene", "Study"), michaelis, dict),
    "analyse": Contract(("Scene", "Study"), michaelis, dict),
    "write_report": Contract(
        ("Analysis",), lambda: blank(gsp.Analysis), lambda: {"folder": "report"}, {"folder": FOLDER}
    ),
    "demo": Contract(("Scene", "Study"), michaelis, dict),
    "write_demo": Contract(("Scene", "Study"), michaelis, lambda: {"path": "demo.html"}, {"path": kind("text")}),
    "export": Contract(("Scene", "Study"), michaelis, dict, {"to": NAME}),
    "SlowFastSystem": Contract(
        ("BasePoint",), lambda: {y: -y}, lambda: {"fast": {x: y - x}, "epsilon": epsilon},
        {"fast": EXPRESSIONS, "epsilon": kind(), "parameters": EXPRESSIONS, "name": kind("text"),
         "observables": EXPRESSIONS},
    ),
    "VectorField": Contract(
        ("BasePoint",), lambda: {x: -x}, lambda: {"epsilon": None},
        {"epsilon": kind("None"), "parameters": EXPRESSIONS, "name": kind("text"), "observables": EXPRESSIONS},
    ),
    "Scene": Contract(
        ("SlowFastSystem", "VectorField"), systems.michaelis_menten,
        lambda: {"region": {"s": (0.1, 1.0), "c": (0.0, 1.0)}, "start": ENZYME, "span": (0.0, 1.0), "epsilon": 0.01,
                 "epsilons": (0.02, 0.01), "tolerance": 1e-4},
        {**dict.fromkeys(("name", "title", "source", "description"), kind("text")),
         "reconstruction_start": POINT, "path": kind(), "claims": kind("[]"), "starts": kind(inside=POINT),
         "units": kind(inside=kind("text")), "views": kind(),
         "reconstruction": kind("None", inside=EXPRESSIONS.inside)},
    ),
    "Event": Contract(
        (), lambda: "x", dict, {"terminal": kind("True", "a NumPy bool", "10**400", "10**5000"), "name": kind("text")}
    ),
}  # fmt: skip

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
    "watch": {"speed": x},
}
