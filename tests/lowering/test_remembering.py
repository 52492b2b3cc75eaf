"""What is remembered: no answer depends on what ran before, and nothing outlives what it was made of."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import weakref
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.integration.reduced_flow import ReducedFlow
from gsp.integration.reduction_end.validity import validity_of
from gsp.integration.trajectory import integrate
from gsp.lowering import compiled_flow as lowering
from gsp.lowering import compiled_function
from gsp.lowering.remembering import remembered
from gsp.lowering.tape import write_tape
from gsp.systems.system import SlowFastSystem, VectorField

x, y, z, a, epsilon = sp.symbols("x y z a epsilon")
ONE = sp.Integer(1)


def reduced(system: SlowFastSystem, order: int = 0, **options) -> ReducedFlow:
    return gsp.restrict(gsp.expand(gsp.solve_critical(system).branches[0], order=order), **options)


class Noun:
    pass


def test_it_is_made_once_for_each_object_and_forgotten_with_it():
    calls = []

    @remembered
    def made(noun):
        calls.append(id(noun))
        return [len(calls)]

    one, two = Noun(), Noun()
    assert made(one) is made(one) is not made(two)
    assert len(calls) == 2
    # At once, without a collector: there is no cycle.
    gone = weakref.ref(one)
    kept = made(two)
    del one
    assert gone() is None
    assert made(two) is kept


def test_what_cannot_be_made_is_not_remembered():
    calls = []

    @remembered
    def made(noun):
        calls.append(noun)
        raise ValueError("no")

    noun = Noun()
    for _ in range(2):
        with pytest.raises(ValueError, match="no"):
            made(noun)
    assert len(calls) == 2


# Each runs in a process of its own, and after the others in both orders. The twins have equal rates on the manifold y =
# 0 and differ in what the rates do not tell: where the branch ends, its parameters, the order, what can be observed.
SERVER = """
import json, os, sys
import numpy as np
import sympy as sp
import gsp
from gsp.choice.forecast import forecast_of

x, y, z, a, epsilon = sp.symbols("x y z a epsilon")
# What is loaded once, by a field that is none of the twins.
gsp.integrate(gsp.VectorField({x: -3 * x}, epsilon=None), start={"x": 1}, span=(0, 1), method="dop853")

def system(g, slow=1, **options):
    return gsp.SlowFastSystem(slow={x: sp.Integer(1) * slow}, fast={y: g}, epsilon=epsilon, **options)

def run(g, order=0, start=0.0, eps=0.01, slow=1, events=(), observe=(), **options):
    declared = system(g, slow, **options)
    flow = gsp.restrict(gsp.expand(gsp.solve_critical(declared).branches[0], order=order))
    found = gsp.integrate(flow, start={"x": start}, span=(0.0, 3.0), epsilon=eps, events=events)
    seen = [value for name in observe for value in found[name].tolist()]
    ends = {name: one.times.tolist() for name, one in found.events.items()}
    return [found.status.name, found.message, found.t.tolist(), found.y.tolist(), seen, ends]

def ahead(g, **options):
    scene = gsp.Scene(
        system(g, **options), region={"x": (0, 4)}, start={"x": 0.0, "y": 0.2}, span=(0, 3), epsilon=0.01,
        epsilons=(0.01, 0.005), tolerance=1e-3, name="twins",
    )
    try:
        forecast = forecast_of(scene, (0, 1))
    except gsp.GspError as error:
        return str(error)
    return [forecast.layer, *(forecast.errors(n, np.array([1.0, 2.0, 3.0])).tolist() for n in (0, 1))]

event = gsp.Event("double", name="double")
twins = [
    lambda: run((x - a) * y, parameters={a: 1}),
    lambda: run((x - a) * y, parameters={a: 5}),
    lambda: run(-y),
    lambda: run(-2 * y),
    lambda: run((x - 1) * y),
    lambda: run((x - 1) * y, order=1),
    lambda: run((x - 1) * y, order=2),
    lambda: run((x - 2) * y, order=1, eps=0.1),
    lambda: run(-y - y**3),
    lambda: run(-y, slow=-1),
    lambda: run(-y / (4 + x)),
    lambda: run(-y, observables={z: x**2, sp.Symbol("w"): x**3}, observe=("z", "w")),
    lambda: run(-y, observables={sp.Symbol("w"): x**2, z: x**3}, observe=("z", "w")),
    lambda: run(-y, observables={sp.Symbol("double"): 2 * x - 1}, events=(event,)),
    lambda: run(-y, observables={sp.Symbol("double"): 2 * x - 3}, events=(event,)),
    lambda: ahead(-y),
    lambda: ahead((x - 1) * y),
    lambda: ahead((x - a) * y, parameters={a: 5}),
    lambda: ahead(-y, name="other"),
]

def after(order):
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.close(reader)
        with os.fdopen(writer, "w") as stream:
            json.dump({i: twins[i]() for i in order}, stream)
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as stream:
        found = json.load(stream)
    os.waitpid(child, 0)
    return found

alone = {}
orders = json.loads(sys.argv[1])
for i in orders[0]:
    alone |= after([i])
print(json.dumps([alone, *map(after, orders)]))
"""
ORDERS = {
    "a few": [[17, 16, 15, 2, 1, 0]],
    "forwards": [list(range(19))],
    "backwards": [list(range(19))[::-1]],
    "shuffled": [np.random.default_rng(seed).permutation(19).tolist() for seed in range(2)],
}


@pytest.mark.exhaustive
@pytest.mark.skipif(not hasattr(__import__("os"), "fork"), reason="fresh processes are made by fork")
@pytest.mark.parametrize("orders", ORDERS)
def test_no_answer_depends_on_what_ran_before(orders):
    done = subprocess.run(
        [sys.executable, "-c", SERVER, json.dumps(ORDERS[orders])],
        capture_output=True, text=True, cwd=Path(__file__).parent.parent.parent,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    alone, *together = json.loads(done.stdout)
    assert len(alone) == len(ORDERS[orders][0])
    # The twins do differ, or nothing would be shown.
    endings = {alone[str(i)][0] for i in range(11) if str(i) in alone}
    assert {"SUCCESS", "HYPERBOLICITY_LOST"} <= endings
    assert alone["0"] != alone["1"]
    assert alone["15"] != alone["16"] != alone["17"]
    for found in together:
        # As text, in which what is not a number equals itself.
        assert {i: json.dumps(value) for i, value in found.items()} == {
            i: json.dumps(value) for i, value in alone.items()
        }


def test_a_loss_belongs_to_its_own_system():
    ends = {1: "HYPERBOLICITY_LOST", 5: "SUCCESS"}
    for value, status in [*ends.items(), *reversed(ends.items())]:
        system = SlowFastSystem(slow={x: ONE}, fast={y: (x - a) * y}, epsilon=epsilon, parameters={a: value})
        found = integrate(reduced(system), start={"x": 0}, span=(0, 3), epsilon=0.01)
        assert found.status.name == status


def other(value):
    """Something of the same kind that is not `value`."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int):
        return value + 1
    if isinstance(value, sp.Symbol):
        return sp.Symbol(value.name + "_other")
    if isinstance(value, tuple):
        return (*value, ONE)
    return {**value, z: ONE}


@pytest.mark.parametrize("name", [f.name for f in fields(ReducedFlow) if f.name != "manifold"])
def test_reduced_flows_that_differ_in_anything_are_not_equal(name):
    system = SlowFastSystem(slow={x: -x}, fast={y: x**2 - y}, epsilon=epsilon)
    flow = reduced(system, 2)
    assert replace(flow) == flow
    assert hash(replace(flow)) == hash(flow)
    assert replace(flow, **{name: other(getattr(flow, name))}) != flow


def test_reduced_flows_of_equal_systems_are_equal_and_of_others_not():
    def flow(g, order=0, **options):
        return reduced(SlowFastSystem(slow={x: ONE}, fast={y: g}, epsilon=epsilon, **options), order)

    assert flow(-y) == flow(-y)
    assert flow(-y).rates == flow(-2 * y).rates
    assert flow(-y) != flow(-2 * y)
    assert flow(-a * y, parameters={a: 1}) != flow(-a * y, parameters={a: 2})
    assert flow(-y, 1) != flow(-y, 2)
    first, second = {z: x**2, sp.Symbol("w"): x}, {sp.Symbol("w"): x, z: x**2}
    assert flow(-y, observables=first) != flow(-y, observables=second)
    # The two sheets of y^2 = x differ in their seed alone.
    folded = SlowFastSystem(slow={x: ONE + y}, fast={y: y**5 + y - x}, epsilon=epsilon)
    branch = gsp.solve_critical(folded).branches[0]
    sheets = [replace(branch, seed=((0.0,), (seed,))) for seed in (0.0, 1.0)]
    one, two = (gsp.restrict(gsp.expand(sheet, order=0)) for sheet in sheets)
    assert one.rates == two.rates
    assert one != two


def systems_in_use(i: int) -> list:
    """A system and a reduced flow that have been through all that remembers, and nothing else holds."""
    rate = sp.Rational(i + 1, 1000)
    system = SlowFastSystem(slow={x: -x * rate}, fast={y: x**2 + rate - y}, epsilon=epsilon)
    integrate(system, start={"x": 1, "y": 0}, span=(0, 0.1), epsilon=0.01)
    write_tape(system)
    flow = reduced(system, 1)
    integrate(flow, start={"x": 1}, span=(0, 0.1), epsilon=0.01)
    assert isinstance(validity_of(flow).desingularised.states, tuple)
    return [weakref.ref(system), weakref.ref(flow), weakref.ref(lowering.compile_flow(flow))]


@pytest.mark.exhaustive
def test_systems_are_released():
    living = [one for i in range(12) for one in systems_in_use(i)]
    gc.collect()
    assert sum(one() is not None for one in living) == 0


@pytest.mark.exhaustive
def test_machine_code_is_released(monkeypatch):
    build, engines = compiled_function.build, []

    def counted(*args, **options):
        engine = build(*args, **options)
        engines.append(weakref.ref(engine))
        return engine

    monkeypatch.setattr(compiled_function, "build", counted)
    count = lowering.MOST_KEPT + 30
    for i in range(count):
        field = VectorField({x: -x * sp.Rational(i + 1, 7919)}, epsilon=None)
        assert lowering.compile_flow(field).field
    gc.collect()
    assert len(engines) == count
    assert sum(one() is not None for one in engines) <= lowering.MOST_KEPT


@pytest.mark.exhaustive
def test_code_in_use_is_good_however_much_came_after():
    field = VectorField({x: -3 * x}, epsilon=None)
    lowering.compile_flow(field).field  # noqa: B018 - compiled here, and lost from the cache below
    for i in range(lowering.MOST_KEPT + 5):
        lowering.compile_function([x * sp.Rational(i, 7907)], arguments=[x], epsilon=None, parameters=[])
    assert lowering.compile_flow(field).rates([2.0], [np.nan])[0] == -6.0


def test_parameter_values_compile_nothing(monkeypatch):
    field = VectorField({x: -a * x + y, y: -20 * y + x}, epsilon=None, parameters={a: 1})
    integrate(field, start={"x": 1, "y": 0}, span=(0, 100), method="radau9")

    def refuse(*_, **__):
        raise AssertionError("compiled again")

    monkeypatch.setattr(lowering, "build", refuse)
    other = field.with_parameters(a=2)
    found = integrate(other, start={"x": 1, "y": 0}, span=(0, 100), method="radau9")
    assert found.status.ok
