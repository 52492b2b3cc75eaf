"""Twenty stiff problems with known solutions: runs end near their tolerance, and the default stays near it.

A fast variable y is attracted to phi(x) at the rate gamma, y' = phi'(x) x' - gamma (y - phi(x)), so that y = phi(x) +
(y0 - phi(x0)) exp(-gamma t), whatever the slow variables do. Starts lie on the slow manifold and off it: a run that
comes out of its first transient has steps that grow by orders of magnitude.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
import sympy as sp

from gsp.errors import Status
from gsp.integration.methods import Method
from gsp.integration.trajectory import integrate
from gsp.systems.system import VectorField
from tests.cases import crossed

x, y, z, u, v = sp.symbols("x y z u v")
STIFF = [Method.RADAU9, Method.RADAU13]
# (rates, slow solution by time and start), for slow variables alone.
DECAY = ({x: -x}, lambda t, s: {x: s[x] * np.exp(-t)})
LOGISTIC = ({x: x * (1 - x)}, lambda t, s: {x: s[x] / (s[x] + (1 - s[x]) * np.exp(-t))})
TIME = ({x: sp.Integer(1)}, lambda t, s: {x: s[x] + t})
TURN = (
    {x: -u, u: x},
    lambda t, s: {x: s[x] * np.cos(t) - s[u] * np.sin(t), u: s[x] * np.sin(t) + s[u] * np.cos(t)},
)


@dataclass(frozen=True)
class Problem:
    """Rates, starts, the end of the span, and the exact solution by times (k,) and start."""

    rates: dict[sp.Symbol, sp.Expr]
    starts: list[dict[sp.Symbol, float]]
    end: float
    exact: Callable


def slope(graph: sp.Expr, slow: dict[sp.Symbol, sp.Expr]) -> sp.Expr:
    return sp.Add(*[graph.diff(s) * rate for s, rate in slow.items()])


def attracted(slow, graph, gamma, *, starts, off=(0.0,), end=4.25, speed=sp.S.One, bend=0) -> Problem:
    """One fast variable at the rate gamma `speed` (x), with a cubic term of size `bend`, which needs starts on phi."""
    rates, solution = slow
    phi = sp.lambdify(list(rates), graph)
    gap = y - graph
    field = {**rates, y: slope(graph, rates) - gamma * speed * (gap + bend * gap**3)}
    points = [{**s, y: float(phi(*s.values())) + d} for s in starts for d in off]

    def exact(t, start):
        found = solution(t, start)
        left = start[y] - phi(*(start[s] for s in rates))
        gone = np.exp(-gamma * t) if speed == 1 else np.zeros_like(t)
        return {**found, y: phi(*found.values()) + left * gone}

    return Problem(field, points, end, exact)


def kaps(gamma) -> Problem:
    """P. Kaps's problem, with y = x^2 on its slow manifold whatever gamma."""
    rates = {x: y - x - x**2, y: -(gamma + 2) * y + gamma * x**2}
    return Problem(rates, [{x: 1.0, y: 1.0}], 3.0, lambda t, s: {x: np.exp(-t), y: np.exp(-2 * t)})


def pair(gamma, twist, off) -> Problem:
    """Two fast variables that spiral into (1/(1 + x), x^2) with the eigenvalues -gamma (1 +- i twist)."""
    graphs = (1 / (1 + x), x**2)
    a, b = y - graphs[0], z - graphs[1]
    rates = {
        x: -x,
        y: slope(graphs[0], DECAY[0]) - gamma * (a - twist * b),
        z: slope(graphs[1], DECAY[0]) - gamma * (twist * a + b),
    }

    def exact(t, start):
        X = start[x] * np.exp(-t)
        left = complex(start[y] - 1 / (1 + start[x]), start[z] - start[x] ** 2)
        gone = left * np.exp(-gamma * (1 + 1j * twist) * t)
        return {x: X, y: 1 / (1 + X) + gone.real, z: X**2 + gone.imag}

    starts = [{x: s, y: 1 / (1 + s) + off, z: s**2 - off} for s in (0.7, 2.3)]
    return Problem(rates, starts, 3.0, exact)


def cascade(gamma) -> Problem:
    """Three time scales: z is attracted to y^2 at the rate gamma^2, and y to x/(1 + x) at the rate gamma."""
    y_rate = slope(x / (1 + x), DECAY[0]) - gamma * (y - x / (1 + x))
    rates = {x: -x, y: y_rate, z: 2 * y * y_rate - gamma**2 * (z - y**2)}

    def exact(t, start):
        X = start[x] * np.exp(-t)
        Y = X / (1 + X) + (start[y] - start[x] / (1 + start[x])) * np.exp(-gamma * t)
        return {x: X, y: Y, z: Y**2 + (start[z] - start[y] ** 2) * np.exp(-(gamma**2) * t)}

    return Problem(rates, [{x: 2.0, y: 1.0, z: 0.5}, {x: 1.0, y: 0.5, z: 0.25}], 4.0, exact)


ONES, MANY = [{x: 1.0}], [{x: 0.6}, {x: 2.0}, {x: 3.3}]
CIRCLE = [{x: 1.0, u: 0.0}, {x: 0.3, u: 1.1}]
PROBLEMS = {
    "Davis and Skodje, 1e3": attracted(DECAY, x / (1 + x), 10**3, starts=MANY, off=(0.0, 1.2)),
    "Davis and Skodje, 1e5": attracted(DECAY, x / (1 + x), 10**5, starts=MANY, off=(0.0, 1.2, 2.5)),
    "Davis and Skodje, 1e8": attracted(DECAY, x / (1 + x), 10**8, starts=MANY, off=(0.0, 1.2, 2.5)),
    "square": attracted(DECAY, x**2, 10**6, starts=MANY, off=(0.0, 1.0)),
    "root": attracted(DECAY, sp.sqrt(1 + x**2), 10**6, starts=MANY, off=(0.0, 1.0)),
    "exponential": attracted(DECAY, sp.exp(-x), 10**7, starts=MANY, off=(0.0, 0.5)),
    "logistic": attracted(LOGISTIC, 1 + x**3, 10**5, starts=[{x: 0.05}, {x: 0.4}], off=(0.0, 1.0)),
    "logistic, stiffer": attracted(LOGISTIC, 1 / (1 + x), 10**9, starts=[{x: 0.05}, {x: 2.0}], off=(0.0, 1.0)),
    "line": attracted(TIME, 2 + sp.sin(x), 10**4, starts=ONES, off=(0.0, 1.0)),
    "line, stiffer": attracted(TIME, 2 + sp.cos(2 * x), 10**8, starts=ONES, off=(0.0, 1.0)),
    "tanh": attracted(TIME, 2 + sp.tanh(x - 3), 10**6, starts=ONES, off=(0.0, 1.0)),
    "circle": attracted(TURN, 3 + x * u, 10**5, starts=CIRCLE, off=(0.0, 2.0)),
    "circle, stiffer": attracted(TURN, 3 + x - u**2, 10**8, starts=CIRCLE, off=(0.0, 2.0)),
    "rate of the slow variable": attracted(DECAY, x / (1 + x), 10**6, starts=MANY, speed=1 + x**2),
    "cubic attraction": attracted(DECAY, x / (1 + x), 10**6, starts=MANY, bend=1),
    "Kaps, 1e4": kaps(10**4),
    "Kaps, 1e8": kaps(10**8),
    "spiral": pair(10**4, 3, 0.5),
    "spiral, stiffer": pair(10**7, 10, 0.5),
    "cascade": cascade(10**4),
}
TOLERANCES = [1e-3, 2.9e-4, 1e-4, 2e-5, 1e-6, 1e-8]


def errors_of(problem: Problem, method: Method, rtol: float) -> tuple[float, float]:
    """The greatest errors at the end and along the run, in tolerances, relative to the state's own value there."""
    field = VectorField(problem.rates, epsilon=None)
    worst = [0.0, 0.0]
    for start in problem.starts:
        run = integrate(
            field, start={s.name: value for s, value in start.items()}, span=(0, problem.end), rtol=rtol,
            atol=1e-3 * rtol, method=method,
        )  # fmt: skip
        assert run.status is Status.SUCCESS
        times = np.linspace(0.0, problem.end, 400)
        for k, t in enumerate((np.array([problem.end]), times)):
            exact = problem.exact(t, start)
            found = run.at(t)
            for row, symbol in zip(found, field.states):
                off = np.abs(row - exact[symbol]) / (rtol * np.maximum(np.abs(exact[symbol]), 1e-2))
                worst[k] = max(worst[k], float(off.max()))
    return worst[0], worst[1]


@pytest.mark.parametrize(("name", "method"), crossed(PROBLEMS, STIFF))
def test_runs_of_stiff_problems_are_within_three_tolerances_at_their_end_and_between_their_steps(
    name: str, method: Method
) -> None:
    errors = {rtol: errors_of(PROBLEMS[name], method, rtol) for rtol in TOLERANCES}
    assert max(max(both) for both in errors.values()) < 3, errors


@pytest.mark.exhaustive
def test_loose_tolerances_are_met_over_an_output_grid_in_few_attempts() -> None:
    # 702 runs. With the Jacobian of a step's start, guesses of degree 5 whatever the step and steps that only the error
    # held back, 110 attempts were rejected, the field was called 97,279 times, and the worst error was 12 tolerances.
    worst, rejected, calls = [], 0, 0
    for problem in PROBLEMS.values():
        field, times = VectorField(problem.rates, epsilon=None), np.linspace(0.0, problem.end, 101)[1:]
        for start in problem.starts:
            for rtol in np.geomspace(1e-1, 1e-5, 9).tolist():
                run = integrate(
                    field, start={s.name: value for s, value in start.items()}, span=(0, problem.end), rtol=rtol,
                    atol=1e-3 * rtol, at=times,
                )  # fmt: skip
                exact = problem.exact(times, start)
                off = [
                    np.abs(run[s] - exact[s]) / np.maximum(np.abs(exact[s]), 1e-2) / rtol for s in field.states
                ]
                worst.append(np.max(off))
                rejected += run.stats.rejected
                calls += run.stats.field_calls
    assert len(worst) == 702
    assert np.mean(np.array(worst) < 1) > 0.98
    assert max(worst) < 2
    # Six in a thousand attempts; steps end where the polynomial does, which a longer one would overlook.
    assert rejected <= 60
    assert calls < 93_000


@pytest.mark.parametrize(
    ("name", "method"), [("Davis and Skodje, 1e5", Method.RADAU9), ("cascade", Method.RADAU13)]
)
def test_no_tolerance_is_an_unlucky_one(name: str, method: Method) -> None:
    # One run in some hundreds ended far off, after a step whose first round was believed.
    worst = max(errors_of(PROBLEMS[name], method, rtol)[0] for rtol in np.geomspace(2e-5, 1e-3, 120).tolist())
    assert worst < 1


@pytest.mark.parametrize("method", STIFF)
def test_a_single_round_of_newton_is_believed_only_where_it_moves_little(method: Method) -> None:
    # Out of the transient x moves on and y follows one round late: in the transient, where only y moves and is linear,
    # the iteration contracts by 1e-12, which says nothing about the first long step.
    eps = sp.Symbol("epsilon")
    rates = {x: -x, y: -(y - x / (1 + x)) / eps - x / (1 + x) ** 2}
    field = VectorField(rates, epsilon=eps)
    rng = np.random.default_rng(1)
    for _ in range(150):
        start = {"x": rng.uniform(0.3, 4), "y": rng.uniform(0, 4)}
        rtol, small = 10 ** rng.uniform(-6, -3.55), 10 ** rng.uniform(-9, -3)
        run = integrate(field, start=start, span=(0, 4.25), epsilon=small, rtol=rtol, method=method)
        exact = start["x"] * np.exp(-4.25)
        assert run.y[:, -1] == pytest.approx([exact, exact / (1 + exact)], rel=rtol)
