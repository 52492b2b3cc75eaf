"""Poles among many fast variables: what can vanish is followed from where it may, and the work is counted."""

import numpy as np
import pytest
import sympy as sp

from gsp import SlowFastSystem, classify, solve_critical
from gsp.critical import sampling
from gsp.critical.sampling import Sampler
from gsp.hyperbolicity.losses import poles
from gsp.hyperbolicity.samples import Kind

Q = sp.Rational
x, y, eps = sp.symbols("x y epsilon")


def network(genes: int, *, seed: int = 0, sink: sp.Expr = sp.S.Zero, slow: sp.Expr | None = None):
    """Each gene is washed out, raised by one and repressed by another, with Hill's kinetics."""
    rng = np.random.default_rng(seed)
    z = sp.symbols(f"y1:{genes + 1}")
    rates = {}
    for s in z:
        a, b = (z[i] for i in rng.choice(genes, 2, replace=False))
        fed = (1 + x * Q(int(rng.integers(1, 20)), 10)) / 10
        rates[s] = fed - s + Q(3, 10) * a**2 / (1 + a**2) + Q(1, 5) / (1 + b**3) - sink.subs(y, s)
    system = SlowFastSystem(slow={x: z[-1] - x if slow is None else slow}, fast=rates, epsilon=eps)
    (branch,) = solve_critical(system).branches
    return branch.through({"x": 1.0, **{s.name: 0.4 for s in z}})


@pytest.fixture
def followed(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """The samples from which a denominator's zero is sought."""
    found = []
    search = poles.gauss_newton

    def counted(evaluate, start, **more):
        found.append(start)
        return search(evaluate, start, **more)

    monkeypatch.setattr(poles, "gauss_newton", counted)
    return found


@pytest.mark.exhaustive
@pytest.mark.parametrize("sink", [sp.S.Zero, y / (Q(1, 2) + y)])
def test_denominators_that_stay_away_from_zero_are_not_followed(sink: sp.Expr, followed: list) -> None:
    """From 24 samples each, by dense steps, those of 200 genes took hours."""
    verdict = classify(network(36, sink=sink), region={"x": (0.5, 1.5)})
    assert verdict.kind is Kind.ATTRACTING
    assert not followed


@pytest.mark.exhaustive
def test_poles_among_many_fast_variables_are_those_among_few(
    monkeypatch: pytest.MonkeyPatch, followed: list
) -> None:
    v = sp.symbols("y1:9")
    where = network(8).points([[0.9], [1.2]])[:, [2, 5]]
    # One along the slow variable, and two where a fast variable passes.
    slow = 1 / (x - Q(7, 10)) + 1 / (v[2] - Q(float(where[0, 0]))) + 1 / (v[5] - Q(float(where[1, 1]))) ** 2
    branch = network(8, slow=slow)
    few = classify(branch, region={"x": (0.5, 1.5)})
    of_few = len(followed)
    monkeypatch.setattr(sampling, "LARGE", 4)
    many = classify(branch, region={"x": (0.5, 1.5)})
    for verdict in (few, many):
        assert sorted(loss.point["x"] for loss in verdict.losses) == pytest.approx([0.7, 0.9, 1.2], abs=1e-6)
        assert all(loss.is_pole for loss in verdict.losses)
    assert len(followed) - of_few < of_few / 2


def test_what_is_over_the_budget_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sampling, "LARGE", 4)
    monkeypatch.setattr(poles, "MOST_STARTS", 2)
    branch = network(6, slow=1 / (x - Q(7, 10)) + 1 / (x - Q(9, 10)) + 1 / (x - Q(11, 10)))
    verdict = classify(branch, region={"x": (0.5, 1.5)})
    assert verdict.losses
    (note,) = [note for note in verdict.notes if "denominators" in note]
    assert "poles were sought from 2 samples" in note
    assert "Look at a smaller region." in note


def test_tangents_are_those_of_the_sheet() -> None:
    branch = network(6)
    sampler, step = Sampler(branch), 1e-5
    x0 = np.array([[0.8], [1.1]])
    at, before, after = (np.hstack([x0 + d, branch.points(x0 + d)]) for d in (0.0, -step, step))
    np.testing.assert_allclose(sampler.tangents(at)[:, :, 0], (after - before) / (2 * step), rtol=1e-7)
