"""Every public noun goes through pickle, copy, deepcopy and a process of its own, and works where it arrives."""

from __future__ import annotations

import copy
import inspect
import multiprocessing
import pickle
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from typing import Any

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp import models
from tests import example_systems as systems
from tests import test_contract as made
from tests.cases import thinned

epsilon, x, y, a = sp.symbols("epsilon x y a")

BOX = {"s": (0.2, 1.0)}


@cache
def study() -> gsp.Study:
    found = gsp.study(made.michaelis())
    found.series(2)
    return found


@cache
def cycle() -> gsp.PeriodicOrbit:
    return gsp.periodic_orbit(made.van_der_pol(), start={"x": 2.0, "y": 0.5}, epsilon=0.1)


@cache
def family() -> gsp.OrbitFamily:
    return gsp.continue_orbits(made.hopf(), bounds=(0.95, 1.1), max_points=4)


@cache
def canards() -> gsp.CanardOrbits:
    return gsp.folded_canards(made.node(), epsilon=0.01)


def roots_of_a_polynomial() -> gsp.SeriesManifold:
    """A series whose ring holds functions, roots, relations and denominators."""
    system = gsp.SlowFastSystem(
        slow={x: sp.sin(x) - y * sp.sqrt(2 + x)}, fast={y: sp.cos(x) * sp.exp(x) - y * sp.sqrt(2 + x)}, epsilon=epsilon
    )  # fmt: skip
    return gsp.expand(gsp.solve_critical(system).branches[0], order=2)


# What makes each noun, and what it is good for: text and numbers that have to be the same where it arrives.
CASES: dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {
    "Analysis": (lambda: gsp.analyse(made.michaelis(), order=1), lambda n: n.base),
    "BasePoint": (lambda: study().base_point(1), dict),
    "BeyondReachWarning": (lambda: gsp.BeyondReachWarning("beyond"), str),
    "Branch": (made.branch, lambda n: n.points({"s": 0.5})),
    "CanardFamily": (
        lambda: gsp.follow_canard(next(iter(canards().canards)), epsilon=(0.01, 0.011)), lambda n: n.epsilon
    ),
    "CanardOrbits": (canards, str),
    "CanardValue": (made.canard, lambda n: n.value(0.01)),
    "Certificate": (lambda: gsp.certify(made.branch(), region=BOX), lambda n: (n.verdict, n.gap)),
    "Choice": (lambda: gsp.choose(study(), orders=(0, 1)), lambda n: n.verdict),
    "Comparison": (lambda: gsp.compare(study(), orders=(0, 1)), lambda n: (n.errors, n.slopes)),
    "CompositeSolution": (
        lambda: gsp.composite(made.series(), start={"s": 1.0, "c": 0.0}, span=(0.0, 1.0), epsilon=0.01),
        lambda n: n.at([0.0, 0.01, 0.5]),
    ),
    "CriticalCurve": (made.curve, lambda n: n["x"]),
    "CriticalManifold": (lambda: study().critical, lambda n: n.branches[0].points({"s": 0.5})),
    "CriticalSheet": (
        lambda: gsp.critical_sheet(
            systems.koper(), start=made.KOPER, bounds={"y": (-1.0, 1.0), "z": (-1.0, 1.0)}, max_points=30
        ),
        lambda n: n["x"],
    ),
    "DelayedExit": (made.delayed, str),
    "Demo": (lambda: gsp.demo(made.michaelis()), lambda n: (len(n.html), n.html[:200])),
    "Ending": (lambda: gsp.Ending.SUCCESS, str),
    "Ensemble": (
        lambda: gsp.integrate_many(
            systems.michaelis_menten(), starts={"s": np.array([1.0, 0.5]), "c": 0.0}, span=(0.0, 1.0), epsilon=0.01
        ),
        lambda n: n["s"],
    ),
    "Event": (lambda: gsp.Event(x - 1), lambda n: n.expression),
    "FailureMap": (
        lambda: gsp.failure_map(study(), orders=(0,), positions=(0.4, 0.5), epsilons=(0.02, 0.01)),
        lambda n: n.as_rows(),
    ),
    "FoldCurve": (
        lambda: gsp.continue_folds(systems.koper(), start=made.KOPER, bounds={"y": (-1.0, 1.0)}), lambda n: n["x"]
    ),
    "FoldPassage": (made.passage, str),
    "FoldedSingularity": (made.node, str),
    "GspError": (lambda: gsp.GspError("a fact. A remedy."), str),
    "HopfPoint": (made.hopf, str),
    "Hyperbolicity": (lambda: study().hyperbolicity, lambda n: n.eigenvalues({"s": 0.5})),
    "Loss": (
        lambda: gsp.classify(
            gsp.solve_critical(made.van_der_pol()).branches[0], region={"x": (0.5, 2.0), "y": (-1.0, 1.0)}
        ).losses[0],
        str,
    ),
    "LossKind": (lambda: gsp.LossKind.FOLD, str),
    "Method": (lambda: gsp.Method.RADAU9, str),
    "MethodTable": (lambda: gsp.method_table(study(), orders=(0, 1)), lambda n: n.as_rows()),
    "MixedMode": (
        lambda: gsp.mixed_mode(
            made.van_der_pol(), name="x", start={"x": 2.0, "y": 0.5}, span=(0.0, 8.0), epsilon=0.1
        ),
        str,
    ),
    "OrbitFamily": (family, str),
    "PeriodicOrbit": (cycle, lambda n: (n.period, n.at(0.3))),
    "ProofVerdict": (lambda: gsp.ProofVerdict.PROVED, str),
    "ReducedFlow": (
        lambda: study().reduced(2),
        lambda n: gsp.integrate(n, start={"s": 1.0}, span=(0.0, 1.0), epsilon=0.01)["s"],
    ),
    "ReductionBound": (
        lambda: gsp.bound_reduction(made.series(), start={"s": 1.0}, span=(0.0, 0.2), epsilon=0.01, steps=8), str
    ),
    "SampledManifold": (
        lambda: gsp.solve_manifold(made.branch(), region=BOX, epsilon=0.01), lambda n: n.evaluate({"s": 0.5})
    ),
    "Scene": (made.michaelis, lambda n: gsp.integrate(n, span=(0.0, 1.0))["s"]),
    "SeriesManifold": (roots_of_a_polynomial, lambda n: (n.coefficients, n.evaluate({"x": 0.3}, 0.01))),
    "Simulation": (lambda: gsp.simulate(study()), str),
    "SingularOrbit": (
        lambda: gsp.singular_orbit(
            gsp.solve_critical(made.van_der_pol()).branches[0], start={"x": 2.0, "y": 0.5}
        ),
        lambda n: n.period,
    ),
    "SlowFastSystem": (made.van_der_pol, lambda n: hash(n) and n.with_parameters().rates),
    "SlowPoints": (lambda: gsp.zero_derivative(made.branch(), x={"s": 0.5}, epsilon=0.01), lambda n: n.y),
    "SlowTube": (lambda: gsp.certify(made.series(), region=BOX, epsilon=0.001), str),
    "TimeScales": (
        lambda: gsp.time_scales(systems.michaelis_menten(), start={"s": 1.0, "c": 0.0}, span=(0.0, 1.0), epsilon=0.01,
                                at=[0.0, 0.5, 1.0]),
        lambda n: (n.rates, n.exhausted, n.pointers, n.participation),
    ),
    "SmallParameter": (
        lambda: next(iter(gsp.small_parameters(gsp.VectorField({x: a * (y - x), y: x - 2 * y}, epsilon=None,
                                                               parameters={a: 2})))),
        lambda n: (n.vanishing, n.attracts, dict(n.reduced)),
    ),
    "SolvedTube": (
        lambda: gsp.certify(gsp.solve_manifold(made.branch(), region=BOX, epsilon=0.01), region=BOX), str
    ),
    "SpecialKind": (lambda: gsp.SpecialKind.FOLD, str),
    "SpecialPoint": (lambda: made.curve().special[0], str),
    "Splitting": (
        lambda: gsp.split(models.load("chaplygin_sleigh").system), lambda n: (n.system, n.projection, n.explain())
    ),
    "Status": (lambda: gsp.Status.SUCCESS, str),
    "Study": (study, lambda n: (n.series(3).coefficients, n.hyperbolicity.gap)),
    "Sweep": (
        lambda: gsp.sweep(
            "integrate", model="michaelis_menten", over={"epsilon": (0.01,)}, into=tempfile.mkdtemp(), workers=1
        ),
        lambda n: (str(n), n.to_xarray().final.values),
    ),
    "Trajectory": (lambda: study().full(0.01), lambda n: (n["s"], n.at(0.37))),
    "VectorField": (lambda: models.load("chaplygin_sleigh").system, lambda n: n.equations),
    "WorkPrecision": (
        lambda: gsp.work_precision(study(), orders=(0,), rtols=(1e-3, 1e-4), methods=(), peers=()),
        lambda n: n.as_rows(),
    ),
}  # fmt: skip


@cache
def noun(name: str) -> Any:
    return CASES[name][0]()


def good_for(name: str, value: Any) -> str:
    """What a noun gives, as text that has all the digits."""
    return written(CASES[name][1](value)) + repr(value)


def written(value: Any) -> str:
    if isinstance(value, np.ndarray):
        return f"{value.shape}{value.tobytes().hex()}" if value.dtype.kind in "fciub" else repr(value.tolist())
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{k}: {written(v)}" for k, v in value.items()) + "}"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return "[" + ", ".join(map(written, value)) + "]"
    if is_dataclass(value) and not isinstance(value, type) and type(value).__module__.startswith("gsp"):
        return "(" + ", ".join(written(getattr(value, f.name)) for f in fields(value) if f.repr) + ")"
    return repr(value)


def work_elsewhere(connection: Any) -> None:
    """In a process of its own: nouns come in, what they are good for goes out."""
    while (message := connection.recv_bytes()) != b"":
        try:
            connection.send(good_for(*pickle.loads(message)))
        except Exception as error:
            connection.send(f"{type(error).__name__}: {error}")


@pytest.fixture(scope="module")
def elsewhere() -> Any:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=work_elsewhere, args=(theirs,), daemon=True)
    process.start()
    yield ours
    ours.send_bytes(b"")
    process.join(20)


def test_every_public_noun_has_a_case() -> None:
    nouns = {name for name in gsp.__all__ if inspect.isclass(getattr(gsp, name))}
    assert set(CASES) == nouns


@pytest.mark.parametrize("name", thinned(CASES, 2))
def test_a_noun_works_where_it_arrives(name: str, elsewhere: Any) -> None:
    original = noun(name)
    assert type(original) is getattr(gsp, name)
    wanted = good_for(name, original)
    sent = pickle.dumps((name, original))
    for arrived in (pickle.loads(sent)[1], copy.copy(original), copy.deepcopy(original)):
        assert type(arrived) is type(original)
        assert good_for(name, arrived) == wanted
        if isinstance(original, Enum):
            assert arrived is original
    elsewhere.send_bytes(sent)
    assert elsewhere.poll(120)
    assert elsewhere.recv() == wanted
