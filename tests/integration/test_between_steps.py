"""Whoever reads between steps gets what the tolerance promises: by any method, at any tolerance, forced in any way."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import sympy as sp

from gsp.integration.methods import Method
from gsp.integration.trajectory import Trajectory, integrate
from gsp.systems.system import VectorField
from tests.integration.test_stiff_accuracy import PROBLEMS, y

s = sp.Symbol("s")
FORCING = {
    "grows": sp.exp(5 * s),
    "decays": sp.exp(-2 * s),
    "decays sooner": sp.exp(-20 * s),
    "turns": sp.sin(5 * s),
    "turns sooner": 2 + sp.sin(50 * s),
}
RATES = [1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8]
# An explicit method is for fields on one time scale: what is stiffer takes more steps than it has time.
SLOWEST = {Method.DOP853: 1e4}
MILD = ["Davis and Skodje, 1e3", "line", "Kaps, 1e4", "spiral"]
CASES = [(method, name) for method in Method for name in (MILD if method in SLOWEST else PROBLEMS)]
TOLERANCES = np.geomspace(1e-2, 1e-11, 10).tolist()
# In tolerances. DOP853's output is corrected to the lowest order of its error, which leaves more in a few steps.
BOUND = {Method.RADAU9: 1.0, Method.RADAU13: 1.0, Method.DOP853: 3.0}
# Places in each step.
SHARES = np.linspace(0.0, 1.0, 33)[1:-1]


def errors_of(run: Trajectory, exact, rtol: float, atol: float) -> float:
    """The greatest error between the ends of a step, in the step's tolerance.

    An explicit step's end may be off by more than its estimate says, and what lies in the step is then as far off:
    between the ends counts what passes one and a half times the larger error of the step's two ends.
    """
    steps = run.t[:-1, None] + np.diff(run.t)[:, None] * SHARES
    found = run.at(steps.ravel()).reshape(len(run.y), *steps.shape)
    between = 0.0
    for row, values, y_true, y_between in zip(run.y, found, exact(run.t), exact(steps)):
        weight = atol + rtol * np.maximum(np.abs(row[:-1]), np.abs(row[1:]))
        off = np.abs(row - y_true)
        at_ends = np.maximum(off[:-1], off[1:]) / weight
        inside = (np.abs(values - y_between) / weight[:, None]).max(axis=1)
        between = max(between, float((inside / np.maximum(1.0, 1.5 * at_ends)).max()))
    return between


def slaved(name: str, rate: float, off: float):
    """y' = -rate (y - phi(s)) + phi'(s) on the clock s from phi(0) + off: the field, its start, and the solution."""
    phi = FORCING[name]
    values = sp.lambdify(s, phi)
    field = VectorField({s: sp.S.One, y: -sp.Integer(int(rate)) * (y - phi) + phi.diff(s)}, epsilon=None)

    def exact(t):
        return t, values(t) + off * np.exp(-rate * t)

    return field, {"s": 0.0, "y": float(values(0.0)) + off}, exact


def check(method: Method, field: VectorField, start, end: float, exact, tolerances, atols=()) -> None:
    """Runs at `tolerances`, with a thousandth or all of them or `atols` as absolute ones, are as good between their
    steps as is promised."""
    for rtol in tolerances:
        for atol in (1e-3 * rtol, rtol, *atols):
            run = integrate(
                field, start=start, span=(0, end), rtol=rtol, atol=atol, method=method, max_steps=10**6
            )
            assert run.status.ok
            assert errors_of(run, exact, rtol, atol) < BOUND[method], (start, rtol, atol)


def check_forced(method: Method, name: str, rates, tolerances) -> None:
    for rate, off in product(rates, (0.0, 1.0)):
        field, start, exact = slaved(name, rate, off)
        # Absolute tolerances beside which y is large throughout, or small for a while, too.
        check(method, field, start, 3.0, exact, tolerances, (1.0, 485.0))


def check_problem(method: Method, name: str, tolerances) -> None:
    problem = PROBLEMS[name]
    field = VectorField(problem.rates, epsilon=None)
    for start in problem.starts:

        def exact(t, start=start):
            found = problem.exact(t, start)
            return [found[state] for state in field.states]

        named = {symbol.name: value for symbol, value in start.items()}
        check(method, field, named, problem.end, exact, tolerances)


@pytest.mark.parametrize("name", ["tanh", "root"])
@pytest.mark.parametrize("method", [Method.RADAU9, Method.RADAU13])
def test_poles_beside_the_path_at_which_a_term_of_a_step_vanishes_are_foreseen(
    method: Method, name: str
) -> None:
    # Two terms of the collocation polynomial that were small by chance foretold too little: up to 16 tolerances.
    check_problem(method, name, np.geomspace(1e-7, 1e-11, 13).tolist())


@pytest.mark.exhaustive
@pytest.mark.parametrize(("method", "name"), list(product(Method, FORCING)))
def test_a_forced_variable_is_read_to_any_tolerance_at_any_rate(method: Method, name: str) -> None:
    rates = [rate for rate in RATES if rate <= SLOWEST.get(method, np.inf)]
    check_forced(method, name, rates, TOLERANCES[1::3] if method in SLOWEST else TOLERANCES)


@pytest.mark.parametrize("rtol", [1e-3, 1e-5, 1e-8])
@pytest.mark.parametrize("name", ["grows", "decays", "turns"])
def test_what_is_read_between_steps_at_the_edge_of_stability_is_as_good_as_the_steps(
    name: str, rtol: float
) -> None:
    # What the output's error is found to be in lowest order says little there: up to 880 tolerances were left.
    check_forced(Method.DOP853, name, (10, 100, 1000), [rtol])


@pytest.mark.exhaustive
@pytest.mark.parametrize(("method", "name"), CASES)
def test_stiff_problems_are_read_to_any_tolerance(method: Method, name: str) -> None:
    check_problem(method, name, TOLERANCES)
