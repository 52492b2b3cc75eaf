"""Observables that have no value on the slow manifold: they are nan, and cost no verb."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp

import gsp


@pytest.mark.exhaustive
@pytest.mark.parametrize("verb", [gsp.choose, gsp.simulate, gsp.compare])
@pytest.mark.parametrize("make", [lambda g: 1 / g, sp.log, lambda g: sp.sqrt(g - 1)])
def test_an_observable_without_a_value_on_the_manifold_costs_no_verb(verb, make) -> None:
    scene = gsp.models.load("michaelis_menten")
    system = scene.system
    lost = gsp.SlowFastSystem(
        slow=system.slow, fast=system.fast, epsilon=system.epsilon, parameters=system.parameters,
        observables={sp.Symbol("q"): make(system.g[0])}, name="lost",
    )  # fmt: skip
    verb(replace(scene, system=lost))


def test_such_an_observable_is_nan_and_a_rate_is_not() -> None:
    scene = gsp.models.load("michaelis_menten")
    system = scene.system
    lost = gsp.SlowFastSystem(
        slow=system.slow, fast=system.fast, epsilon=system.epsilon, parameters=system.parameters,
        observables={sp.Symbol("q"): 1 / system.g[0], sp.Symbol("r"): system.x[0] ** 2}, name="lost",
    )  # fmt: skip
    manifold = gsp.expand(gsp.solve_critical(lost).branches[0], order=0)
    run = gsp.integrate(gsp.restrict(manifold), start={"s": 1.0}, span=(0.0, 1.0), epsilon=0.01)
    assert run.status.ok
    assert np.isnan(run["q"]).all()
    np.testing.assert_allclose(run["r"], run["s"] ** 2)
    x = sp.Symbol("x")
    with pytest.raises(gsp.GspError):
        gsp.integrate(gsp.VectorField({x: 1 / (x - x)}, epsilon=None), start={"x": 1.0}, span=(0.0, 1.0))
