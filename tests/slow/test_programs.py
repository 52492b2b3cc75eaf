"""Series and reduced flows of many coupled fast variables, as programs: what they equal, and their order in epsilon."""

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, expand, integrate, restrict, solve_critical
from gsp.critical.sampling import Sampler
from gsp.errors import BudgetError, HyperbolicityError
from gsp.integration import restriction
from gsp.integration.reduction_end import validity
from gsp.lowering.compiled_flow import compile_flow, parameter_vector
from gsp.slow import coordinates
from gsp.slow.coordinates import largest_block
from gsp.slow.series import SeriesManifold

x, eps = sp.symbols("x epsilon")


def chain(links: int, *, power: int = 3) -> SlowFastSystem:
    y = sp.symbols(f"y1:{links + 1}")
    rates = {
        s: (y[i - 1] if i else x) - 2 * s - s**power + (y[i + 1] / 2 if i + 1 < links else 0)
        for i, s in enumerate(y)
    }
    return SlowFastSystem(slow={x: y[-1] - x + eps * y[0]}, fast=rates, epsilon=eps)


def sheet(system: SlowFastSystem):
    return solve_critical(system).nearest({"x": 1.0, **{s.name: 0.0 for s in system.y}})


def exact_terms(series: SeriesManifold, x: np.ndarray, epsilon: float) -> np.ndarray:
    """The terms of a written series at x (m,), its formulas taken with 50 digits: (m, order + 1, n)."""
    system, rows = series.branch.system, []
    with mp.workdps(50):
        for value, guess in zip(x, series.branch.points({"x": x})):
            equations = [g.subs({system.epsilon: 0, system.x[0]: sp.Float(value, 50)}) for g in system.g]
            y = mp.findroot(sp.lambdify(system.y, equations, "mpmath"), guess.tolist())
            functions = [
                sp.lambdify([*system.x, *system.y], c, "mpmath") for c in map(list, series.coefficients)
            ]
            terms = [mp.mpf(epsilon) ** k * mp.matrix(f(mp.mpf(value), *y)) for k, f in enumerate(functions)]
            rows.append([[float(entry) for entry in term] for term in terms])
    return np.array(rows)


def first_order(system: SlowFastSystem, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """h_1, Dh_0 and f through order 1 at z (n,) by dense matrices, from the definitions."""
    sampler = Sampler(sheet(system))
    J, f = sampler.jacobians(z[None])[0], sampler.rates(z[None])[0][:1]
    Dh = -np.linalg.solve(J[1:, 1:], J[1:, :1])
    h1 = np.linalg.solve(J[1:, 1:], Dh @ f)
    return h1, Dh, np.array([f[0], J[0, 1:] @ h1 + z[1]])


@pytest.mark.exhaustive
@pytest.mark.parametrize("links", [6, 12, 20])
def test_series_and_reduced_flow_equal_those_of_dense_matrices(links: int) -> None:
    system = chain(links)
    branch = sheet(system)
    series = expand(branch, order=1)
    assert series.is_program
    y = branch.points({"x": 1.0})
    z = np.array([1.0, *y])
    h1, Dh, f = first_order(system, z)
    np.testing.assert_allclose(series.terms(1.0, 1.0), [y, h1], rtol=1e-12, atol=1e-16)
    flow = restrict(series)
    # y1 is renamed to y10, and a y10 of its own to something else.
    assert len(set(flow.states)) == links + 1
    rates = compile_flow(flow).rates(z, parameter_vector(flow, 0.01))
    moved = f[0] + 0.01 * f[1]
    np.testing.assert_allclose(rates, [moved, *(Dh[:, 0] * moved)], rtol=1e-12, atol=1e-16)


@pytest.mark.exhaustive
def test_programs_and_polynomials_are_one_series(monkeypatch: pytest.MonkeyPatch) -> None:
    system = chain(3)
    branch = sheet(system)
    written = expand(branch, order=3)
    at = {"x": np.array([0.6, 1.0, 1.4])}
    expected = exact_terms(written, at["x"], 0.1)
    # Thousands of expanded terms cancel, which moves the sum by as much as rounding of them does.
    np.testing.assert_allclose(written.terms(at, 0.1), expected, rtol=1e-10, atol=1e-9)
    one = integrate(restrict(written), start={"x": 1.0}, span=(0, 2), epsilon=0.05, rtol=1e-9)
    monkeypatch.setattr(coordinates, "WRITTEN", 2)
    programs = expand(branch, order=3)
    assert programs.is_program
    assert not written.is_program
    np.testing.assert_allclose(programs.terms(at, 0.1), expected, rtol=1e-12, atol=1e-18)
    two = integrate(restrict(programs), start={"x": 1.0}, span=(0, 2), epsilon=0.05, rtol=1e-9)
    assert one["x"][-1] == pytest.approx(two["x"][-1], rel=1e-8)


@pytest.mark.exhaustive
def test_positions_and_velocities_have_the_series_of_polynomials_and_are_not_called_singular(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Oscillators that pull one another: the rate of a position does not know the position, and no pivot stands there.

    Their velocities are declared first, last, and between.
    """
    q, v = sp.symbols("q1:4"), sp.symbols("v1:4")
    rates = {v[k]: x * (k + 1) - 5 * q[k] - q[k] ** 3 + q[k - 1] - 2 * v[k] - v[k - 2] / 3 for k in range(3)}
    for order in ([*v, *q], [*q, *v], [v[0], q[2], v[1], q[0], v[2], q[1]]):
        fast = {s: rates.get(s, v[q.index(s)] if s in q else None) for s in order}
        system = SlowFastSystem(slow={x: q[0] - x}, fast=fast, epsilon=eps)
        at, start = {"x": np.array([0.3, 0.8])}, {"x": 0.5} | {s.name: 0.1 for s in order}
        monkeypatch.setattr(coordinates, "WRITTEN", 6)
        written = expand(solve_critical(system).nearest(start), order=2)
        assert not written.is_program
        expected = written.terms(at, 0.1)
        monkeypatch.setattr(coordinates, "WRITTEN", 5)
        programs = expand(solve_critical(system).nearest(start), order=2)
        assert programs.is_program
        np.testing.assert_allclose(programs.terms(at, 0.1), expected, rtol=1e-9, atol=1e-15)


@pytest.mark.exhaustive
def test_the_defect_of_invariance_falls_with_the_square_of_epsilon() -> None:
    series = expand(sheet(chain(40)), order=1)
    sizes = [np.linalg.norm(series.residual(1.0, small)) for small in (1e-2, 1e-3)]
    assert sizes[0] / sizes[1] == pytest.approx(100.0, rel=0.05)
    lower = [np.linalg.norm(series.residual(1.0, small, order=0)) for small in (1e-2, 1e-3)]
    assert lower[0] / lower[1] == pytest.approx(10.0, rel=0.05)


@pytest.mark.exhaustive
def test_the_steps_of_a_series_grow_with_the_chain_and_no_faster() -> None:
    spent = [expand(sheet(chain(links)), order=1).chart.ring.spent for links in (20, 40, 80)]
    assert spent[2] - spent[1] == pytest.approx(2 * (spent[1] - spent[0]), rel=0.05)


@pytest.mark.exhaustive
def test_numbers_are_inverted_whatever_their_count() -> None:
    series = expand(sheet(chain(40, power=1)), order=1)
    assert not series.is_program
    assert series.coefficients[1]["y40"].has(x)
    assert largest_block({(0, 1): sp.Integer(1), (1, 0): sp.Integer(2)}, 2, lambda e: e.has(x)) == 1
    assert largest_block({(0, 1): x, (1, 0): sp.Integer(2)}, 2, lambda e: e.has(x)) == 2


@pytest.mark.exhaustive
def test_what_is_watched_along_a_run_is_what_smaller_blocks_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    flow = restrict(expand(sheet(chain(5)), order=1))
    z = np.array([0.8, 0.4, 0.3, 0.2, 0.1, 0.05])
    p = np.array([0.01])
    blocks = validity.Validity(flow)
    assert blocks.watches_pairs
    monkeypatch.setattr(validity, "LARGEST_BLOCK", 2)
    sparse = validity.Validity(flow)
    assert not sparse.watches_pairs
    J = blocks.fast_jacobian(z)
    det, rate = sparse.crossing([*z, 0.0], p)
    assert det == pytest.approx(np.linalg.det(J) / np.prod(np.linalg.norm(J, axis=1)), rel=1e-12)
    # By what D is larger, time is slower.
    desingularised = [compile_flow(v.desingularised).rates([*z, 0.0], p) for v in (blocks, sparse)]
    np.testing.assert_allclose(
        desingularised[0] / desingularised[0][-1], desingularised[1] / desingularised[1][-1], rtol=1e-11
    )
    # tr J^-1 along the flow, by differences.
    velocity = desingularised[1][:-1] / desingularised[1][-1]
    traces = [np.trace(np.linalg.inv(sparse.fast_jacobian(z + h * velocity))) for h in (1e-5, -1e-5)]
    unit, measure = sparse._parts.inverse_trace(relative=True)
    assert unit == 1
    drift = sparse._over(sparse.states, [measure], sparse._parts.calls)(z, p)[0]
    assert drift == pytest.approx(abs(traces[0] - traces[1]) / 2e-5, rel=1e-6)
    dets = [sparse.crossing([*(z + h * velocity), 0.0], p)[0] for h in (1e-5, -1e-5)]
    assert rate == pytest.approx(det * (dets[0] - dets[1]) / 2e-5, rel=1e-6)


def test_a_matrix_that_is_singular_throughout_is_refused() -> None:
    y = sp.symbols("y1:8")
    rates = {s: x - y[0] - y[0] ** 3 + 0 * s for s in y}
    system = SlowFastSystem(slow={x: -x}, fast=rates, epsilon=eps)
    from gsp.critical.branch import Branch

    with pytest.raises(HyperbolicityError, match="singular on the whole branch"):
        expand(Branch(system, tuple(rates.values()), None), order=1)


def test_coordinates_whose_motion_is_over_the_budget_move_by_programs(monkeypatch) -> None:
    system = chain(2)
    series = expand(sheet(system), order=1)
    written = restrict(series)
    calls = []

    def over_budget_at_first(chart, f):
        calls.append(chart)
        if len(calls) == 1:
            raise BudgetError("too long.")
        return coordinates.moving(chart, f)

    monkeypatch.setattr(restriction, "moving", over_budget_at_first)
    run = restrict(series)
    point = {s: sp.Rational(1, k + 3) for k, s in enumerate((*run.states, eps))}
    values = [[rate.xreplace(point) for rate in flow.rates] for flow in (written, run)]
    assert sp.Matrix(values[0]) == sp.Matrix(values[1]).applyfunc(sp.simplify)
