"""Sheets next to folds: followed as far as they go, judged by their own numbers, and folds of graphs with roots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from gsp import load, models
from gsp.analysis.fold_surroundings import boundary_of, never_folds, not_followed
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.critical.sampling import Sampler, grid
from gsp.critical.sheet_continuation import SheetContinuation
from gsp.hyperbolicity.hyperbolicity import Kind, classify
from gsp.hyperbolicity.losses.diagnosis import Diagnosis
from gsp.hyperbolicity.losses.ends import sheet_ends
from gsp.hyperbolicity.losses.locator import REFINED, SEARCH_STEPS, Locator
from gsp.hyperbolicity.losses.shrinking import largest_sub_region
from gsp.scenes.scene import Scene
from gsp.scenes.study import study_of
from gsp.systems.system import SlowFastSystem
from tests.cases import crossed, thinned

x, y, u, v, w, k, eps = sp.symbols("x y u v w k epsilon")
Q = sp.Rational
VAN_DER_POL = SlowFastSystem(slow={y: -x}, fast={x: y + x - x**3 / 3}, epsilon=eps)
FAR = {"x": 2, "y": 2 / 3}


def sheet(system: SlowFastSystem, through):
    return solve_critical(system).nearest(through)


def gap_of_van_der_pol(distance: float) -> float:
    """x^2 - 1 where x^3/3 - x = -2/3 + distance, x > 1: with x = 1 + d, d^2 + d^3/3 = distance."""
    d = distance**0.5
    for _ in range(60):
        d -= (d**2 + d**3 / 3 - distance) / (2 * d + d**2)
    return 2 * d + d**2


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("distance", "width", "bounds"),
    crossed([2e-3, 1e-4, 1e-7, 1e-9], [1.0, 1.866, 1e-3], [{}, {"x": (0.999, 2.2)}]),
)
def test_the_gap_next_to_a_fold_is_its_own(distance, width, bounds) -> None:
    region = {"y": (-2 / 3 + distance, -2 / 3 + distance + width), **bounds}
    found = classify(sheet(VAN_DER_POL, FAR), region=region)
    assert found.kind is Kind.ATTRACTING, found
    assert found.gap == pytest.approx(gap_of_van_der_pol(distance), rel=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(6))
def test_the_gap_next_to_a_fold_is_its_own_in_any_units(seed) -> None:
    rng = np.random.default_rng(seed)
    a, b, c = (sp.Rational(float(10.0 ** rng.uniform(-3, 3))) for _ in range(3))
    turn = sp.Rational(int(rng.integers(1, 4)), 2)
    # X = (x + turn y)/a and a damped companion, slow Y = y/b, time in units of 1/c.
    X, Y, Z = sp.symbols("X Y Z")
    old_x, old_y = a * X - turn * b * Y, b * Y
    system = SlowFastSystem(
        slow={Y: -old_x / b},
        fast={X: c * (old_y + old_x - old_x**3 / 3) / a, Z: c * (-Z + 3 * X)},
        epsilon=eps,
    )
    near = {"Y": float(FAR["y"] / b), "X": float((FAR["x"] + turn * FAR["y"]) / a)}
    distance = 1e-6
    low, high = (-2 / 3 + distance) / float(b), 1.2 / float(b)
    found = classify(sheet(system, {**near, "Z": 3 * near["X"]}), region={"Y": (low, high)})
    assert found.kind is Kind.ATTRACTING, found
    # c can make the companion the slower of the two only where the fold is far.
    assert found.gap == pytest.approx(float(c) * gap_of_van_der_pol(distance), rel=1e-5)


@pytest.mark.exhaustive
@pytest.mark.parametrize("beyond", [1e-3, 0.5])
def test_a_sheet_of_a_polynomial_field_ends_at_its_fold_not_at_a_domain(beyond) -> None:
    found = classify(sheet(VAN_DER_POL, FAR), region={"y": (-2 / 3 - beyond, 1.0)})
    (loss,) = found.losses
    assert loss.kind is LossKind.FOLD
    assert dict(loss.point) == pytest.approx({"y": -2 / 3, "x": 1.0})
    assert found.sub_region is not None


def rosenzweig_macarthur(scale: sp.Expr = sp.S.One, unit: sp.Expr = sp.S.One) -> SlowFastSystem:
    """Prey u in units of `scale`, predators v of `unit`; folds at (v, u) = (0.390625, 0.375)."""
    prey, predators = scale * u, unit * v
    return SlowFastSystem(
        slow={v: predators * (prey / (prey + Q(1, 4)) - Q(3, 10)) / unit},
        fast={u: prey * (1 - prey - predators / (prey + Q(1, 4))) / scale},
        epsilon=eps,
    )


@pytest.mark.parametrize(("scale", "unit"), thinned([(1, 1), (Q(1, 7), 30), (11, Q(2, 1000))], 2))
@pytest.mark.parametrize("fast", [None, (0.4, 1.0)])
def test_the_fold_of_a_graph_with_a_root_is_named_and_a_part_offered(scale, unit, fast) -> None:
    system = rosenzweig_macarthur(sp.sympify(scale), sp.sympify(unit))
    a, b = float(scale), float(unit)
    branch = sheet(system, {"v": 0.1 / b, "u": 0.9 / a})
    assert branch.is_explicit
    region = {"v": (0.05 / b, 0.45 / b)} | ({} if fast is None else {"u": (fast[0] / a, fast[1] / a)})
    found = classify(branch, region=region)
    (loss,) = found.losses
    assert loss.kind is LossKind.FOLD
    assert dict(loss.point) == pytest.approx({"v": 0.390625 / b, "u": 0.375 / a})
    part = found.sub_region
    assert part is not None
    assert part.kind == "attracting"
    assert part.interval == pytest.approx((0.05 / b, 0.383813 / b), rel=1e-3)


def scene_of(system: SlowFastSystem, region, start) -> Scene:
    return Scene(system, region, start, (0, 0.5), 0.01, (0.02, 0.01), 1e-3)


def test_folds_of_a_graph_with_a_root_are_followed_around_the_region() -> None:
    scene = scene_of(rosenzweig_macarthur(), {"v": (0.05, 0.3), "u": (0.5, 1.0)}, {"v": 0.1, "u": 0.9})
    study = study_of(scene)
    assert study.branch.is_explicit
    ends = boundary_of(study, classify(study.branch, region=study.region))
    (fold,) = ends.folds
    assert dict(fold.point) == pytest.approx({"v": 0.390625, "u": 0.375})
    assert fold.passage is not None
    # The drop lands on another branch, u = 0, on which the slow flow comes to a transcritical point.
    assert ends.orbit is not None
    first, second = ends.orbit.pieces
    assert first.fold is not None
    assert dict(first.fold.drop.point) == pytest.approx({"v": 0.390625, "u": 0.0}, abs=1e-8)
    assert second.run["v"][-1] == pytest.approx(0.25)
    assert "branch point" in ends.orbit.message


@pytest.mark.exhaustive
def test_folds_of_a_graph_with_a_root_over_two_slow_variables_are_a_curve() -> None:
    system = SlowFastSystem(slow={x: -x, y: 1 - y}, fast={u: x + y**2 / 4 - u**2}, epsilon=eps)
    scene = scene_of(system, {"x": (0.5, 2), "y": (-1, 1), "u": (0.2, 2)}, {"x": 1, "y": 0.2, "u": 1.0})
    study = study_of(scene)
    assert study.branch.is_explicit
    ends = boundary_of(study, classify(study.branch, region=study.region))
    assert ends.has_folds


@pytest.mark.parametrize(
    ("g", "never"),
    [
        (x - u, True),
        (x / (1 + x**2) - u, True),
        (sp.exp(-x) - u, True),
        (x - u**2, False),
        (x - sp.sin(u), False),
        (u * sp.exp(u) - x, False),
    ],
)
def test_a_graph_never_folds_when_it_has_no_root_and_no_inverse(g, never) -> None:
    system = SlowFastSystem(slow={x: 1 + 0 * u}, fast={u: g}, epsilon=eps)
    branch = solve_critical(system).branches[0]
    assert never_folds(branch) is (never and branch.is_explicit)


def test_a_graph_without_roots_is_not_followed() -> None:
    assert "no folds" in str(not_followed(study_of(models.load("michaelis_menten"))))


def fast_epidemics():
    """The sheet of fast infections r(p1, p2), which folds along a curve that leaves the box through three sides."""
    study = study_of(load(Path(__file__).parents[1] / "systems" / "sirs.toml"))
    return study.branch, study.region


def counted_steps(monkeypatch) -> list[int]:
    steps, continued = [], SheetContinuation.continued

    def counting(self, x, y, step):
        steps.append(len(x))
        return continued(self, x, y, step)

    monkeypatch.setattr(SheetContinuation, "continued", counting)
    return steps


@pytest.mark.exhaustive
def test_searches_next_to_the_end_of_a_sheet_stop_when_their_steps_are_spent(monkeypatch) -> None:
    branch, region = fast_epidemics()
    part = {**region, "p1": (0.35, 0.8)}
    steps, refine = counted_steps(monkeypatch), Locator.refine
    taken = []

    def refined(self, worst, **how):
        before = len(steps)
        result = refine(self, worst, **how)
        taken.append(sum(steps[before:]))
        return result

    monkeypatch.setattr(Locator, "refine", refined)
    found = classify(branch, region=part)
    assert taken
    assert taken[0] <= REFINED * SEARCH_STEPS
    assert any(f"ended after {SEARCH_STEPS} steps along the sheet" in note for note in found.notes)
    assert found.kind is Kind.LOST


@pytest.mark.exhaustive
def test_parts_over_which_the_sheet_ends_are_not_judged(monkeypatch) -> None:
    branch, region = fast_epidemics()
    found = classify(branch, region=region)
    assert {loss.kind for loss in found.losses} == {LossKind.FOLD}
    judged = []
    part = largest_sub_region(branch, region, found.losses, judge=lambda *a, **k: judged.append(k) or found)
    assert part is None
    assert not judged


def test_folds_that_cut_off_a_corner_of_the_region_are_folds_up_to_its_edges() -> None:
    """From where the sheet ends on an edge Newton's method came to the fold a little outside, and nothing was named."""
    system = SlowFastSystem(
        slow={u: -x, v: 1 - v}, fast={x: u * (1 + v / 3) + Q(17, 10) * v + x - x**3 / 3}, epsilon=eps
    )
    corner = (-2 / 3 + 0.85) / (1 - 0.5 / 3)
    box = {"u": (corner - 1e-3, corner + 1.0), "v": (-0.5, 0.8)}
    sampler = Sampler(sheet(system, {"u": corner + 1.0, "v": 0.5, "x": 2.2}))
    samples, _ = sampler.points(grid(np.array(list(box.values())))[::16], box)
    scale = float(np.abs(sampler.eigenvalues(samples)).max())
    # As near to the fold as halvings of the way come.
    low = np.array([corner + 1e-9, -0.5, 1.0 + 3e-5])
    (loss,) = sheet_ends(Diagnosis(sampler, box, scale, samples), [(low, np.array([corner - 1e-9, -0.5]))])
    assert loss.kind is LossKind.FOLD
    assert dict(loss.point) == pytest.approx({"u": corner, "v": -0.5, "x": 1.0}, abs=1e-7)
