"""Critical manifolds of many fast variables: elimination and classification by sparsity, and what they must equal."""

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, classify, solve_critical
from gsp.critical import elimination, sampling, sheet_points
from gsp.critical.sampling import Sampler
from gsp.critical.spectrum import eigenvalues, symmetrised
from gsp.hyperbolicity.losses.roots import _least_norm
from gsp.hyperbolicity.samples import Kind
from gsp.lowering.compiled_function import compile_function

x, eps = sp.symbols("x epsilon")


def chain(links: int, cubic: int = 0) -> SlowFastSystem:
    """Each fast variable is driven by the one before it, and half as strongly by the one after."""
    y = sp.symbols(f"y1:{links + 1}")
    rates = {
        s: (y[i - 1] if i else x) - 2 * s - cubic * s**3 + (y[i + 1] / 2 if i + 1 < links else 0)
        for i, s in enumerate(y)
    }
    return SlowFastSystem(slow={x: y[-1] - x}, fast=rates, epsilon=eps)


def sheet(system: SlowFastSystem):
    (branch,) = solve_critical(system).branches
    return branch if branch.is_explicit else branch.through({"x": 1.0, **{s.name: 0.0 for s in system.y}})


@pytest.mark.exhaustive
def test_a_linear_chain_is_solved_with_a_derivative_or_two_for_each_entry() -> None:
    n = 40
    elimination._slope.cache_clear()
    (branch,) = solve_critical(chain(n)).branches
    assert elimination._slope.cache_info().misses < 6 * n
    matrix = np.diag(np.full(n, -2.0)) + np.diag(np.ones(n - 1), -1) + np.diag(np.full(n - 1, 0.5), 1)
    expected = np.linalg.solve(matrix, -np.eye(n)[0])
    np.testing.assert_allclose(branch.points([[1.0]])[0], expected, rtol=1e-13)


@pytest.mark.exhaustive
def test_elimination_ends_where_the_equations_grow() -> None:
    # A ring of products: whatever is eliminated makes the others longer.
    y = sp.symbols("y1:25")
    rates = {s: x - s - s * y[i - 5] - y[i - 1] / 3 + y[i - 11] * y[i - 2] / 5 for i, s in enumerate(y)}
    (branch,) = solve_critical(SlowFastSystem(slow={x: -x}, fast=rates, epsilon=eps)).branches
    assert not branch.is_explicit
    assert sum(len(sp.Add.make_args(e)) for e in branch.equations) <= elimination.FACTOR_TERMS


@pytest.mark.exhaustive
def test_elimination_ends_where_the_numbers_grow() -> None:
    # Every coefficient is a fraction that depends on x: what 60 links leave of each other is found by numbers instead.
    n = 60
    y = sp.symbols(f"y1:{n + 1}")
    left, right = (x, *y[:-1]), (*y[1:], sp.Integer(0))
    rates = {
        s: k * a / 7 - (sp.Rational(20 * k, 91) + x / (k + 3)) * s + k * b / 17
        for k, s, a, b in zip(range(1, n + 1), y, left, right)
    }
    branch = sheet(SlowFastSystem(slow={x: y[-1] - x}, fast=rates, epsilon=eps))
    assert not branch.is_explicit
    assert sum(map(elimination._bits, branch.equations)) < elimination.BIT_LIMIT
    k = np.arange(1.0, n + 1)
    matrix = np.diag(-20 * k / 91 - 1.0 / (k + 3)) + np.diag(k[1:] / 7, -1) + np.diag(k[:-1] / 17, 1)
    np.testing.assert_allclose(branch.points([[1.0]])[0], np.linalg.solve(matrix, -np.eye(n)[0] / 7), rtol=1e-9)


@pytest.mark.exhaustive
def test_the_gap_of_a_chain_far_from_normal_is_exact() -> None:
    # The units of neighbours differ by sqrt(2), those of the ends by 2^100: no decomposition in doubles tells.
    verdict = classify(sheet(chain(200)), region={"x": (0.5, 1.5)})
    assert verdict.kind is Kind.ATTRACTING
    assert verdict.gap == pytest.approx(2 - np.sqrt(2) * np.cos(np.pi / 201), rel=1e-12)
    assert verdict.samples == sampling.COARSE[1]


def test_what_is_symmetric_in_other_units_has_the_same_eigenvalues() -> None:
    rng = np.random.default_rng(1)
    units = np.exp(rng.uniform(-1.0, 1.0, 20))
    S = rng.standard_normal((20, 20)) * (rng.random((20, 20)) < 0.3)
    S = S + S.T
    A = S * units[None, :] / units[:, None]
    found = symmetrised(A)
    assert found is not None
    np.testing.assert_allclose(found, S, atol=1e-12)
    np.testing.assert_allclose(np.sort(eigenvalues(A[None])[0].real), np.linalg.eigvalsh(S), atol=1e-11)
    A[3, 4] += 1.0
    assert symmetrised(A) is None


@pytest.mark.exhaustive
def test_many_fast_variables_are_judged_as_few_are(monkeypatch: pytest.MonkeyPatch) -> None:
    branch = sheet(chain(12, cubic=1))
    dense = classify(branch, region={"x": (0.5, 1.5)}, epsilon=0.01)
    monkeypatch.setattr(sampling, "LARGE", 4)
    monkeypatch.setattr(sheet_points, "LARGE", 4)
    sparse = classify(branch, region={"x": (0.5, 1.5)}, epsilon=0.01)
    assert sparse.kind is dense.kind
    assert sparse.gap == pytest.approx(dense.gap, rel=1e-6)
    assert sparse.rates.tangential == pytest.approx(dense.rates.tangential, rel=1e-9)
    assert sparse.conditions[-2].value == pytest.approx(dense.conditions[-2].value, rel=1e-9)
    assert dense.exclusion is not None
    assert dense.exclusion.is_complete
    assert sparse.exclusion is not None
    assert sparse.exclusion.share == 1.0
    assert "between them nothing is excluded" in sparse.evidence


@pytest.mark.parametrize("sign", [1, -1])
def test_with_time_reversed_many_fast_variables_have_the_same_gap(
    sign: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The eigenvalues are sign (k + (x - 1)^2), k = 1, ..., 5: the least distance from the axis is 1, at x = 1.
    monkeypatch.setattr(sampling, "LARGE", 4)
    y = sp.symbols("y1:6")
    rates = {s: sign * (k + (x - 1) ** 2) * (s - x) for k, s in enumerate(y, start=1)}
    (branch,) = solve_critical(SlowFastSystem(slow={x: sp.Integer(1)}, fast=rates, epsilon=eps)).branches
    verdict = classify(branch, region={"x": (0.38, 1.57)})
    assert verdict.kind is (Kind.REPELLING if sign > 0 else Kind.ATTRACTING)
    assert verdict.gap == pytest.approx(1.0, rel=1e-7)


@pytest.mark.exhaustive
def test_a_loss_among_many_fast_variables_is_found_between_the_samples() -> None:
    # A line with diffusion: y = 0 loses its stability where x is the least eigenvalue of the diffusion.
    n = 40
    y = sp.symbols(f"y1:{n + 1}")
    line = (0, *y, 0)
    rates = {s: x * s - s**3 + line[i] - 2 * s + line[i + 2] for i, s in enumerate(y)}
    system = SlowFastSystem(slow={x: sp.Integer(1)}, fast=rates, epsilon=eps)
    (branch,) = solve_critical(system).branches
    verdict = classify(branch.through({"x": -1.0, **{s.name: 0.0 for s in y}}), region={"x": (-1.0, 0.0101)})
    least = 2 - 2 * np.cos(np.pi / (n + 1))
    assert verdict.kind is Kind.LOST
    assert [loss.point["x"] for loss in verdict.losses] == [pytest.approx(least, abs=1e-8)]


def test_second_derivatives_are_those_of_the_whole_array() -> None:
    system = chain(5, cubic=1)
    sampler, z = Sampler(sheet(system)), np.random.default_rng(0).uniform(-1.0, 1.0, (3, 6))
    v = np.arange(15.0).reshape(3, 5)
    expected = np.zeros((3, 5, 5, 6))
    for i in range(5):
        expected[:, i, i, 1 + i] = -6.0 * z[:, 1 + i]
    np.testing.assert_allclose(sampler.bent(z, v), np.einsum("mijk,mj->mik", expected, v))
    J = sampler.jacobians(z)
    slope = -np.linalg.solve(J[:, 1:, 1:], J[:, 1:, :1])
    total = np.einsum("mijk,mkl->mijl", expected, np.concatenate([np.ones((3, 1, 1)), slope], axis=1))
    assert sampler.jacobian_variation(z) == pytest.approx(np.abs(total).max(), rel=1e-13)


def test_sparse_linear_algebra_is_that_of_dense_matrices() -> None:
    rng = np.random.default_rng(2)
    A = rng.standard_normal((6, 40, 40)) * (rng.random((6, 40, 40)) < 0.1) + np.eye(40) * rng.choice(
        [-2.0, 2.0], 40
    )
    A[5, 7] = 0.0
    b = rng.standard_normal((6, 40))
    found = sheet_points.solve_each(A, b)
    np.testing.assert_allclose(found[:5], np.linalg.solve(A[:5], b[:5, :, None])[:, :, 0], rtol=1e-9)
    assert np.isnan(found[5]).all()
    np.testing.assert_array_equal(sheet_points.signs(A), [*np.linalg.slogdet(A[:5])[0], 0.0])
    wide, right = A[:2, :30], b[:2, :30]
    # An equation without a slope.
    wide[1, 3] = 0.0
    steps = _least_norm(wide, right)
    np.testing.assert_allclose(steps[0], np.linalg.lstsq(wide[0], right[0], rcond=None)[0], rtol=1e-9)
    assert np.isnan(steps[1]).all()


@pytest.mark.exhaustive
def test_eigenvalues_are_followed_by_shift_and_invert() -> None:
    n = 40
    y = sp.symbols(f"y1:{n + 1}")
    rates = {s: -s * (1 + x * i) + 3 * y[i - 1] * (-1) ** i + y[(i + 7) % n] for i, s in enumerate(y)}
    sampler = Sampler(sheet(SlowFastSystem(slow={x: -x}, fast=rates, epsilon=eps)))
    z = np.array([1.0, *np.zeros(n)])
    every = sampler.eigenvalues(z[None, :])[0]
    nearest = every[np.argmin(np.abs(every.real))]
    found = sampler.followed(z, complex(nearest))
    assert symmetrised(sampler.fast_jacobian(z[None, :])[0]) is None
    assert np.abs(found[:, None] - every[None, :]).min(axis=1).max() < 1e-9
    assert np.abs(found - nearest).min() < 1e-9


def test_entries_that_are_zero_take_no_code() -> None:
    outputs = [sp.S.Zero] * 500
    outputs[7], outputs[499] = x**2, sp.Integer(3)
    f = compile_function(outputs, arguments=[x], epsilon=None, parameters=[])
    found = f([[2.0], [5.0]], [np.nan])
    expected = np.zeros((2, 500))
    expected[:, 7], expected[:, 499] = [4.0, 25.0], 3.0
    np.testing.assert_array_equal(found, expected)
