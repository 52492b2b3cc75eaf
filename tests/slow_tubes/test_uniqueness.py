"""What a tube says of how many manifolds lie in it, against systems all of whose invariant graphs are known.

epsilon y' = A y - b (x_1^p + x_2^p + ...) with a matrix A, and x_i' = c_i x_i or x' = 1. The polynomial solution of the
invariance equation is one invariant graph. Any other differs from it by a sum of v |x_i|^(kappa/(c_i epsilon)), or of
v exp(kappa x/epsilon) where x' = 1, v an eigenvector of A to kappa: those that are bounded over the region.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy.optimize import linprog
from sympy import Rational as R

from gsp.critical.critical_manifold import solve_critical
from gsp.proofs.checked_tube import CheckedTube
from gsp.proofs.programs import Rejected
from gsp.proofs.verdict import ProofVerdict
from gsp.proofs.verification import verify
from gsp.slow.series import SeriesManifold, expand
from gsp.slow.solved_manifold import solve_manifold
from gsp.slow_tubes.certify import certify
from gsp.slow_tubes.slow_tube import SlowTube
from gsp.systems.system import SlowFastSystem
from tests.cases import crossed
from tests.proof_files import written

epsilon = sp.Symbol("epsilon")
SMALL = 0.1
TURN = sp.Matrix([[1, R(1, 4)], [R(-1, 2), 1]])
PAIR = sp.Matrix([[1, 3], [-2, 1]])


def turned(*rates: int) -> sp.Matrix:
    return TURN * sp.diag(*rates) * TURN.inv()


# Matrices by the signs of what their eigenvalues are.
FAST = {
    "-": sp.Matrix([[-1]]),
    "+": sp.Matrix([[1]]),
    "--": turned(-1, -2),
    "+-": turned(1, -2),
    "++": turned(1, 2),
    "stable pair": -PAIR,
    "unstable pair": PAIR,
}
# c_i, or None for x' = 1.
SLOW: dict[str, tuple[int, ...] | None] = {"out": (1,), "in": (-1,), "through": None, "out and in": (1, -1)}
BOUNDARY = {"out": "overflowing", "in": "inflowing", "through": "mixed", "out and in": "mixed"}
POWERS = (2, 6)
# Two slow variables take five times as long as one.
BOTH = "out and in"


class Family:
    """All invariant graphs of one system over |x_i| <= 1."""

    def __init__(self, fast: str, slow: str, power: int) -> None:
        self.matrix, self.rates, self.power = FAST[fast], SLOW[slow], power
        self.m, self.n = self.matrix.rows, len(self.rates or (1,))
        self.x, self.y = sp.symbols(f"x:{self.n}"), sp.symbols(f"y:{self.m}")
        self.region = {x.name: (-1, 1) for x in self.x}

    def system(self) -> SlowFastSystem:
        forced = sum(x**self.power for x in self.x)
        rates = self.matrix * sp.Matrix(self.y) - sp.ones(self.m, 1) * forced
        slow = {x: c * x for x, c in zip(self.x, self.rates)} if self.rates else {self.x[0]: sp.Integer(1)}
        return SlowFastSystem(slow=slow, fast=dict(zip(self.y, rates)), epsilon=epsilon)

    def series(self) -> SeriesManifold:
        return expand(solve_critical(self.system()).branches[0], order=1)

    def polynomial(self, x: np.ndarray) -> np.ndarray:
        """The graph (points, m) that is a polynomial."""
        A, b, p = np.array(self.matrix, dtype=float), np.ones(self.m), self.power
        total = np.zeros((len(x), self.m))
        if self.rates:
            for i, c in enumerate(self.rates):
                a = np.linalg.solve(A - p * c * SMALL * np.eye(self.m), b)
                total += x[:, i : i + 1] ** p * a
            return total
        factor = 1.0
        for k in range(p + 1):
            b = np.linalg.solve(A, b)
            total += factor * SMALL**k * x ** (p - k) * b
            factor *= p - k
        return total

    def others(self, x: np.ndarray) -> list[np.ndarray]:
        """What may be added to it any number of times, (points, m) each."""
        found = []
        values, vectors = np.linalg.eig(np.array(self.matrix, dtype=float))
        for kappa, v in zip(values, vectors.T):
            if np.imag(kappa) < 0.0:
                continue
            parts = (np.real, np.imag) if np.imag(kappa) > 0.0 else (np.real,)
            shapes = []
            if self.rates is None:
                kappa_x = kappa * x[:, 0] / SMALL
                shapes.append(np.exp(kappa_x - np.real(kappa_x).max()))
            for i, c in enumerate(self.rates or ()):
                if np.real(kappa) / c > 0.0:
                    size = np.maximum(np.abs(x[:, i]), 1e-30)
                    shape = np.exp(kappa / (c * SMALL) * np.log(size))
                    shapes += [np.where(x[:, i] > 0.0, shape, 0.0), np.where(x[:, i] < 0.0, shape, 0.0)]
            found += [part(np.outer(shape, v).astype(complex)) for shape in shapes for part in parts]
        return found


def through_order(series: SeriesManifold, x: np.ndarray) -> np.ndarray:
    """The sum (points, m) of the terms, wherever it is of use."""
    terms = [
        sum(row[i] * SMALL**k for k, row in enumerate(series.coefficients))
        for i in range(len(series.coefficients[0]))
    ]
    values = sp.lambdify(series.branch.system.x, terms)
    return np.array([np.broadcast_arrays(*values(*point)) for point in x])


def nearest(family: Family, tube: SlowTube, end: float) -> float:
    """How many times the widths of the tube the nearest graph is from the series over |x_i| <= `end`, at most."""
    axis = np.linspace(-end, end, 201 if family.n == 1 else 25)
    x = np.array(np.meshgrid(*[axis] * family.n)).reshape(family.n, -1).T
    basis = np.linalg.inv(np.array(tube._proof.basis.matrix, dtype=float))
    blocks, widths = tube._proof.basis.blocks, tube._proof.widths
    scale = np.zeros(family.m)
    for block, width in zip(blocks, widths):
        scale[list(block)] = width / np.sqrt(len(block))

    def places(y: np.ndarray) -> np.ndarray:
        return (y @ basis.T / scale / SMALL**2).ravel()

    away = places(family.polynomial(x) - through_order(tube.series, x))
    columns = [places(y) for y in family.others(x)]
    if not columns:
        return float(np.abs(away).max())
    M = np.array(columns).T
    t = -np.ones((len(M), 1))
    cost = np.append(np.zeros(M.shape[1]), 1.0)
    # In units in which no entry is small beside the others.
    unit = np.abs(M).max(axis=0)
    rows, right = np.vstack([np.hstack([M / unit, t]), np.hstack([-M / unit, t])]), np.append(-away, away)
    return float(linprog(cost, A_ub=rows, b_ub=right, bounds=[(None, None)] * len(cost)).fun)


@pytest.mark.parametrize(
    ("fast", "slow", "power"),
    [
        *crossed(FAST, [slow for slow in SLOW if slow != BOTH], POWERS),
        *(pytest.param(fast, BOTH, power, marks=pytest.mark.exhaustive) for fast in FAST for power in POWERS),
    ],
)
def test_what_is_said_of_the_manifolds_in_a_tube_is_so(
    fast: str, slow: str, power: int, tmp_path: Path
) -> None:
    family = Family(fast, slow, power)
    tube = certify(family.series(), region=family.region, epsilon=SMALL)
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.boundary == BOUNDARY[slow]
    several = bool(family.others(np.zeros((1, family.n))))
    # Of those that have only the one, the signs leave no doubt.
    assert tube.is_unique is not several
    assert any("locally invariant and unique" in line for line in tube.statement) is tube.is_unique
    assert any("not unique" in line for line in tube.statement) is several
    assert (tube.collar == 0.0) is tube.is_unique
    assert 0.0 <= tube.collar < 0.9
    # Where it is unique this is the only one; else one of the others will do.
    assert nearest(family, tube, 1.0 - tube.collar) <= 1.0 + 1e-9
    proof = written(tube, tmp_path / "p.json")
    found = verify(tmp_path / "p.json")
    assert isinstance(found, CheckedTube)
    assert (found.unique, found.boundary) == (tube.is_unique, tube.boundary)
    assert 0.0 <= found.collar < 1.0
    assert ("locally invariant and unique" in str(found)) is tube.is_unique
    assert ("not unique" in str(found)) is several
    # A file that says more is refused.
    if several:
        proof |= {"unique": True, "collar": (0.0).hex()}
        proof["cones"] = [cone | {"collar": (0.0).hex()} for cone in proof["cones"]]
        for boundary in ("overflowing", "inflowing", "mixed"):
            (tmp_path / "more.json").write_text(json.dumps(proof | {"boundary": boundary}), encoding="utf-8")
            with pytest.raises(Rejected):
                verify(tmp_path / "more.json")


@pytest.mark.exhaustive
@pytest.mark.parametrize(("fast", "slow"), crossed(["-", "+", "+-"], ["out", "in", "through"]))
def test_a_solved_manifold_is_unique_where_its_series_is(fast: str, slow: str) -> None:
    family = Family(fast, slow, 2)
    manifold = solve_manifold(
        solve_critical(family.system()).branches[0], region=family.region, epsilon=SMALL, tolerance=1e-9
    )
    tube = certify(manifold, region=family.region)
    assert tube.verdict is ProofVerdict.PROVED
    assert tube.is_unique is not bool(family.others(np.zeros((1, 1))))


# -- the collar ----------------------------------------------------------------------------------


def test_a_collar_that_leaves_nothing_is_no_proof() -> None:
    x, y = sp.symbols("x y")
    system = SlowFastSystem(slow={x: -x + R(1, 1000)}, fast={y: -y + x**2}, epsilon=epsilon)
    manifold = expand(solve_critical(system).branches[0], order=1)
    tube = certify(manifold, region={"x": (0.5, 0.5001)}, epsilon=SMALL)
    assert tube.verdict is ProofVerdict.UNDECIDED
    assert tube.is_isolating
    assert "leaves something of the region" in tube.reason
    # The collar is as wide as the flow goes in the time of the fast rate: so small an epsilon leaves most of it.
    assert certify(manifold, region={"x": (0.5, 0.5001)}, epsilon=1e-5).collar < 0.00002
    largest = certify(manifold, region={"x": (0.5, 0.5001)})
    assert largest.verdict is ProofVerdict.PROVED
    assert largest.epsilon_0 < 1e-4
    assert largest.collar <= 0.25 * 0.0001 * (1 + 1e-6)


def test_a_collar_hangs_on_no_unit() -> None:
    x, y = sp.symbols("x y")
    found = []
    for unit in (1, R(1, 10**6), 10**6):
        system = SlowFastSystem(slow={x: unit * R(1, 2)}, fast={y: -y + x / unit}, epsilon=epsilon)
        manifold = expand(solve_critical(system).branches[0], order=1)
        tube = certify(manifold, region={"x": (-unit, unit)}, epsilon=SMALL)
        found.append((tube.verdict, tube.collar / float(unit)))
    assert {verdict for verdict, _ in found} == {ProofVerdict.PROVED}
    assert [collar for _, collar in found] == pytest.approx([found[0][1]] * 3, rel=1e-3)


def test_where_nothing_moves_nothing_is_cut_off(tmp_path: Path) -> None:
    x, y = sp.symbols("x y")
    system = SlowFastSystem(slow={x: sp.Integer(0)}, fast={y: -y + x**2 + epsilon * y**2}, epsilon=epsilon)
    tube = certify(expand(solve_critical(system).branches[0], order=1), region={"x": (-0.5, 0.5)}, epsilon=0.05)
    assert tube.verdict is ProofVerdict.PROVED
    assert (tube.collar, tube.boundary) == (0.0, "mixed")
    tube.save(tmp_path / "p.json")
    assert verify(tmp_path / "p.json").collar == 0.0


def test_the_collar_is_held_to_the_shortest_side(tmp_path: Path) -> None:
    x, v, y = sp.symbols("x v y")
    system = SlowFastSystem(slow={x: sp.Integer(1), v: -v}, fast={y: -y + x + v}, epsilon=epsilon)
    manifold = expand(solve_critical(system).branches[0], order=1)
    region = {"x": (-10, 10), "v": (-0.5, 0.5)}
    tube = certify(manifold, region=region, epsilon=0.05)
    assert tube.collar <= 0.25
    proof = written(tube, tmp_path / "p.json")
    proof["collar"] = (0.5).hex()
    (tmp_path / "p.json").write_text(json.dumps(proof), encoding="utf-8")
    with pytest.raises(Rejected, match="leaves nothing"):
        verify(tmp_path / "p.json")


def test_a_file_of_the_first_version_is_refused_by_name(tmp_path: Path) -> None:
    family = Family("+", "out", 2)
    proof = written(certify(family.series(), region=family.region, epsilon=SMALL), tmp_path / "p.json")
    del proof["unique"]
    proof |= {"format": "gsp slow manifold 1", "boundary": "overflowing", "collar": (0.0).hex()}
    (tmp_path / "p.json").write_text(json.dumps(proof), encoding="utf-8")
    with pytest.raises(Rejected, match=r"gsp slow manifold 2.*save it again"):
        verify(tmp_path / "p.json")
