"""Whoever reads between steps gets what the tolerance promises: by any method, at any tolerance, forced in any way."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
import sympy as sp

from gsp.integration.methods import Method
from gsp.integration.trajectory import Trajectory, integrate
from gsp.systems.system import VectorField
from tests.cases import thinned
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
TOLERANCES = [1e-3, 1e-6, 1e-9]
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


def check(method: Method, field: VectorField, start, end: float, exact, tolerances, shares) -> None:
    """Runs at `tolerances`, with `shares` of them as absolute ones, are as good between their steps as is promised."""
    for rtol, share in product(tolerances, shares):
        run = integrate(
            field, start=start, span=(0, end), rtol=rtol, atol=share * rtol, method=method, max_steps=10**6
        )
        assert run.status.ok
        assert errors_of(run, exact, rtol, share * rtol) < BOUND[method], (start, rtol, share)


def check_forced(method: Method, name: str, rates, tolerances, shares) -> None:
    for rate, off in product(rates, (0.0, 1.0)):
        if rate <= SLOWEST.get(method, np.inf):
            field, start, exact = slaved(name, rate, off)
            check(method, field, start, 3.0, exact, tolerances, shares)


def check_problem(method: Method, name: str, tolerances, shares) -> None:
    problem = PROBLEMS[name]
    field = VectorField(problem.rates, epsilon=None)
    for start in problem.starts:

        def exact(t, start=start):
            found = problem.exact(t, start)
            return [found[state] for state in field.states]

        named = {symbol.name: value for symbol, value in start.items()}
        check(method, field, named, problem.end, exact, tolerances, shares)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("method", "name"), list(product(Method, FORCING)))
def test_a_forced_variable_is_read_between_steps_to_the_tolerance(method: Method, name: str) -> None:
    check_forced(method, name, (1e2, 1e3, 1e6), TOLERANCES, (1e-3,))


@pytest.mark.exhaustive
@pytest.mark.parametrize(("method", "name"), thinned(CASES, 3))
def test_stiff_problems_are_read_between_steps_to_the_tolerance(method: Method, name: str) -> None:
    check_problem(method, name, TOLERANCES, (1e-3,))


@pytest.mark.parametrize("name", ["tanh", "root"])
@pytest.mark.parametrize("method", [Method.RADAU9, Method.RADAU13])
def test_poles_beside_the_path_at_which_a_term_of_a_step_vanishes_are_foreseen(
    method: Method, name: str
) -> None:
    # Two terms of the collocation polynomial that were small by chance foretold too little: up to 16 tolerances.
    check_problem(method, name, np.geomspace(1e-7, 1e-11, 13).tolist(), (1e-3, 1.0))


@pytest.mark.exhaustive
@pytest.mark.parametrize(("method", "name"), list(product(Method, FORCING)))
def test_a_forced_variable_is_read_to_any_tolerance_at_any_rate(method: Method, name: str) -> None:
    tolerances = TOLERANCES if method in SLOWEST else np.geomspace(1e-2, 1e-11, 10).tolist()
    check_forced(method, name, RATES, tolerances, (1e-3, 1.0))


@pytest.mark.exhaustive
@pytest.mark.parametrize(("method", "name"), CASES)
def test_stiff_problems_are_read_to_any_tolerance(method: Method, name: str) -> None:
    check_problem(method, name, np.geomspace(1e-2, 1e-11, 10).tolist(), (1e-3, 1.0))
