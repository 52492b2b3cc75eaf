"""Every loss has its name, on plain systems and in linear disguise; hyperbolic scenes raise no alarm."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
import sympy as sp

from gsp.algebra.laurent import laurent
from gsp.critical.branch import Branch
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.errors import BranchError
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind, classify
from gsp.hyperbolicity.losses.consequences import OMEGA_0
from gsp.hyperbolicity.losses.examination import _is_singular_throughout
from gsp.hyperbolicity.losses.kinds import Loss
from gsp.splitting.splitting import split
from gsp.systems.system import SlowFastSystem, VectorField
from tests.cases import sampled, thinned

x, u, y, z, w, eps = sp.symbols("x u y z w epsilon")
THIRD = sp.Rational(1, 3)


@dataclass(frozen=True)
class Case:
    """A system with a point of the sheet that is meant, and its region; fast bounds where sheets are searched."""

    slow: dict
    fast: dict
    through: dict
    region: dict
    kind: LossKind

    @property
    def system(self) -> SlowFastSystem:
        return SlowFastSystem(slow=self.slow, fast=self.fast, epsilon=eps)


def invertible(n: int, seed: int) -> sp.Matrix:
    """A random integer matrix, far from singular."""
    rng = np.random.default_rng(seed)
    while True:
        entries = rng.integers(-3, 4, (n, n))
        if abs(np.linalg.det(entries)) > 0.5 and np.linalg.cond(entries) < 8.0:
            return sp.Matrix(entries.tolist())


def disguised(case: Case, seed: int) -> tuple[Case, sp.Matrix, sp.Matrix]:
    """`case` with a stable fast direction added when it has one only, and x -> S x, y -> T y; S and T too."""
    fast, through = dict(case.fast), dict(case.through)
    if len(fast) == 1:
        (only,) = fast
        fast[w] = -2 * w + only
        through["w"] = through[only.name] / 2
    xs, ys = list(case.slow), list(fast)
    S, T = invertible(len(xs), seed), invertible(len(ys), seed + 1)
    back = dict(zip(xs, S.inv() * sp.Matrix(xs))) | dict(zip(ys, T.inv() * sp.Matrix(ys)))
    f = (S * sp.Matrix(list(case.slow.values()))).subs(back, simultaneous=True)
    g = (T * sp.Matrix([fast[s] for s in ys])).subs(back, simultaneous=True)
    point = [*(S * sp.Matrix([through[s.name] for s in xs])), *(T * sp.Matrix([through[s.name] for s in ys]))]
    corners = np.array(np.meshgrid(*[case.region[s.name] for s in xs])).reshape(len(xs), -1)
    images = np.array(S.tolist(), dtype=float) @ corners
    region = {s.name: (float(low), float(high)) for s, low, high in zip(xs, images.min(1), images.max(1))}
    if any(s.name in case.region for s in ys):
        region |= {s.name: (-12, 12) for s in ys}
    changed = Case(
        {s: sp.expand(e) for s, e in zip(xs, f)},
        {s: sp.expand(e) for s, e in zip(ys, g)},
        {s.name: float(value) for s, value in zip((*xs, *ys), point)},
        region,
        case.kind,
    )
    return changed, S, T


def judge(case: Case) -> Hyperbolicity:
    critical = solve_critical(case.system)
    branch = critical.nearest(case.through) if case.through else critical.branches[0]
    return classify(branch, region=case.region)


@cache
def judged(name: str) -> Hyperbolicity:
    """The verdict on one of `CASES` or `CURVES`, found once by whichever test asks first."""
    return judge(CASES[name] if name in CASES else CURVES[name])


def only(verdict: Hyperbolicity, kind: LossKind) -> Loss:
    found = [loss for loss in verdict.losses if loss.kind is kind]
    assert len(found) == 1, [loss.headline for loss in verdict.losses]
    return found[0]


UNIT = {"x": (-1, 1.1)}
PLANE = {"x": (-1, 1), "u": (-1, 1.1)}
HOPF = x * y - z - y * (y**2 + z**2), y + x * z - z * (y**2 + z**2)
CASES = {
    "fold of a cubic": Case(
        {x: sp.Rational(1, 2) - y}, {y: x - y**3 / 3 + y}, {"x": 0, "y": 3**0.5}, UNIT, LossKind.FOLD
    ),
    "fold of an exponential": Case(
        {x: sp.Integer(1)}, {y: x + sp.exp(y) - y - 1}, {"x": -0.3, "y": -0.7}, UNIT, LossKind.FOLD
    ),
    "cusp over a line": Case({x: sp.Integer(1)}, {y: x - y**3}, {"x": 0.5, "y": 0.8}, UNIT, LossKind.CUSP),
    "cusp of a sine": Case(
        {x: sp.Integer(1)}, {y: x + sp.sin(y) - y}, {"x": 0.5, "y": 1.49}, {"x": (-0.5, 0.6)}, LossKind.CUSP
    ),
    "exchange of stability": Case(
        {x: sp.Integer(1)}, {y: y * (x - y) + 2 * eps}, {"x": -0.5, "y": 0}, UNIT, LossKind.TRANSCRITICAL
    ),
    "crossing lines": Case(
        {x: sp.Integer(1)}, {y: 3 * x**2 - x * y - 2 * y**2 + eps}, {"x": -0.5, "y": -0.5}, UNIT,
        LossKind.TRANSCRITICAL,
    ),
    "pitchfork": Case({x: sp.Integer(1)}, {y: x * y - y**3 + eps}, {"x": -0.5, "y": 0}, UNIT, LossKind.PITCHFORK),
    "subcritical pitchfork": Case(
        {x: sp.Integer(2)}, {y: x * y + y**3 - y**5}, {"x": -0.2, "y": 0}, UNIT, LossKind.PITCHFORK
    ),
    "turning point": Case({x: sp.Integer(1)}, {y: x * y}, {"x": -0.5, "y": 0}, UNIT, LossKind.RANK_CHANGE),
    "vanishing factor": Case(
        {x: sp.Integer(1)}, {y: x * (y - x)}, {"x": -0.5, "y": -0.5}, UNIT, LossKind.RANK_CHANGE
    ),
    "Hopf normal form": Case(
        {x: sp.Integer(1)}, {y: HOPF[0], z: HOPF[1]}, {"x": -0.5, "y": 0, "z": 0}, UNIT, LossKind.HOPF
    ),
    "Hopf of FitzHugh and Nagumo": Case(
        {x: sp.Integer(1)},
        {y: y - y**3 / 3 - z + x, z: (y + sp.Rational(7, 10) - sp.Rational(4, 5) * z) / 2},
        {"x": 0.0, "y": -1.199408, "z": -0.62426},
        {"x": (0, 0.6)},
        LossKind.HOPF,
    ),
    "corank two": Case(
        {x: sp.Integer(1)}, {y: x * y, z: x * z}, {"x": -0.5, "y": 0, "z": 0}, UNIT, LossKind.DEGENERATE
    ),
    "fold of fourth order": Case(
        {x: sp.Integer(1)}, {y: x + y**4}, {"x": -0.5, "y": -0.84}, {"x": (-0.5, 0)}, LossKind.DEGENERATE
    ),
    "double zero": Case(
        {x: sp.Integer(1)}, {y: x - y**2, z: y - z**2 - x}, {"x": 0.5, "y": 0.707, "z": 0.455},
        {"x": (-0.2, 0.7)}, LossKind.NILPOTENT,
    ),
    "centre": Case({x: -x}, {y: z, z: x - y}, {"x": 0, "y": 0, "z": 0}, UNIT, LossKind.CENTRE),
}  # fmt: skip
# Names that others come to by the same way.
REPEATED = {
    "fold of fourth order", "fold of an exponential", "fold of a cubic", "cusp of a sine", "cusp over a line",
    "Hopf normal form", "Hopf of FitzHugh and Nagumo",
}  # fmt: skip


@pytest.mark.parametrize("name", sampled(CASES, always=set(CASES) - REPEATED))
def test_a_loss_has_its_name(name) -> None:
    loss = only(judged(name), CASES[name].kind)
    assert loss.consequence
    assert loss.remedy
    assert "reduction ends" not in loss.remedy
    assert loss.test


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CASES)
def test_a_linear_disguise_changes_neither_name_nor_invariants(name) -> None:
    plain = only(judged(name), CASES[name].kind)
    hidden, S, _ = disguised(CASES[name], 1)
    loss = only(judge(hidden), hidden.kind)
    place = {s.name: plain.point[s.name] for s in CASES[name].slow}
    moved = np.array(S.tolist(), dtype=float) @ list(place.values())
    assert [loss.point[n] for n in place] == pytest.approx(moved, abs=1e-6)
    invariants = [*INVARIANT, "crossing"] if plain.kind is not LossKind.FOLD else INVARIANT
    for key in invariants:
        if key in plain.coefficients:
            assert loss.coefficients[key] == pytest.approx(plain.coefficients[key], rel=1e-6, abs=1e-7), key
    if "l1" in plain.coefficients:
        assert np.sign(loss.coefficients["l1"]) == np.sign(plain.coefficients["l1"])
    assert loss.may_reduce is plain.may_reduce


INVARIANT = ["kappa", "delay", "lambda", "omega"]


# -- coefficients against closed forms ----------------------------------------------------------------


def test_the_coefficients_of_a_fold() -> None:
    # v' = v - v^3/3 + x at y = 1: a = -1, b = 1, f = -1/2.
    loss = only(judged("fold of a cubic"), LossKind.FOLD)
    found = loss.coefficients
    assert (found["a"], found["b_x"], found["switching"]) == pytest.approx((-1, 1, -0.5))
    assert found["kappa"] == pytest.approx(0.5)
    assert found["delay"] == pytest.approx(OMEGA_0 * 2 ** (1 / 3))
    assert not loss.may_reduce
    assert "epsilon^(2/3)" in loss.consequence


def test_a_small_parameter_is_called_by_its_name_in_what_is_said_of_a_loss() -> None:
    x, v, mu = sp.symbols("x v mu")
    system = SlowFastSystem(slow={x: 1 + v / 10}, fast={v: -x - v**2}, epsilon=mu)
    found = classify(solve_critical(system).branches[0], region={"x": (-1, 0), "v": (0, 3)}, epsilon=0.004)
    (loss,) = found.losses
    assert "2.338 mu^(2/3) later" in loss.consequence
    assert loss.scaling == "v ~ mu^(1/3), x ~ mu^(2/3), by the weights (1, 2, 3) of v, x and mu in the blow-up"
    assert "epsilon" not in str(found)
    assert not any("epsilon" in condition.statement for condition in found.conditions)


@pytest.mark.exhaustive
def test_the_delay_at_a_fold_is_the_time_of_the_jump() -> None:
    # epsilon v' = v^2 + kappa t, t' = 1, blows up at t = Omega_0 epsilon^(2/3) kappa^(-1/3).
    from gsp.integration.trajectory import integrate

    for kappa in (1, 3):
        system = SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: kappa * x + y**2}, epsilon=eps)
        loss = classify(solve_critical(system).branches[0], region={"x": (-1, 0)}).losses[0]
        epsilon = 1e-3
        run = integrate(
            system, start={"x": -1, "y": -(kappa**0.5)}, span=(0, 2), epsilon=epsilon, rtol=1e-9, atol=1e-9
        )
        assert run.t[-1] - 1 == pytest.approx(loss.coefficients["delay"] * epsilon ** (2 / 3), rel=2e-3)


@pytest.mark.exhaustive
def test_a_fold_that_slow_orbits_leave_and_a_canard_point_are_told_apart() -> None:
    away = Case({x: sp.Integer(-1)}, {y: x + y**2}, {}, {"x": (-1, 0)}, LossKind.FOLD)
    assert only(judge(away), LossKind.FOLD).coefficients["kappa"] == -1
    canard = Case({x: 1 - y}, {y: x - y**3 / 3 + y}, {"x": 0, "y": 3**0.5}, UNIT, LossKind.FOLD)
    loss = only(judge(canard), LossKind.FOLD)
    assert loss.coefficients["switching"] == 0
    assert "canard" in loss.consequence


@pytest.mark.parametrize(
    ("push", "value", "may_reduce", "word"),
    [(0, 1, False, "delay"), (2, -3, True, "exchange"), (-2, 5, False, "jump")],
)
def test_lambda_decides_what_follows_at_a_transcritical_point(push, value, may_reduce, word) -> None:
    # v' = x v - v^2 + push epsilon: lambda = (1/2 - push)/(1/2).
    case = Case(
        {x: sp.Integer(1)}, {y: y * (x - y) + push * eps}, {"x": -0.5, "y": 0}, UNIT, LossKind.TRANSCRITICAL
    )
    loss = only(judge(case), case.kind)
    assert loss.coefficients["lambda"] == pytest.approx(1 - 2 * push)
    assert loss.coefficients["lambda"] == pytest.approx(value)
    assert loss.may_reduce is may_reduce
    assert word in loss.consequence


def test_a_pitchfork_by_its_cubic_coefficient_and_its_push() -> None:
    loss = only(judged("pitchfork"), LossKind.PITCHFORK)
    assert (loss.coefficients["c"], loss.coefficients["crossing"]) == pytest.approx((-1, 1))
    assert loss.coefficients["push"] == pytest.approx(1)
    assert loss.may_reduce
    subcritical = only(judged("subcritical pitchfork"), LossKind.PITCHFORK)
    assert subcritical.coefficients["c"] == pytest.approx(1)
    assert not subcritical.may_reduce


def test_the_coefficients_of_a_hopf_point() -> None:
    loss = only(judged("Hopf normal form"), LossKind.HOPF)
    assert loss.coefficients["omega"] == pytest.approx(1)
    assert loss.coefficients["crossing"] == pytest.approx(1)
    assert loss.coefficients["l1"] < 0
    # FitzHugh and Nagumo: the trace 1 - y^2 - 2/5 vanishes at y = -sqrt(3/5).
    nagumo = only(judged("Hopf of FitzHugh and Nagumo"), LossKind.HOPF)
    assert nagumo.point["y"] == pytest.approx(-np.sqrt(0.6), abs=1e-8)
    slope = 1 / (1.25 - 1 + 0.6)  # dy/dx along the equilibria
    assert nagumo.coefficients["crossing"] == pytest.approx(np.sqrt(0.6) * slope, rel=1e-6)


# Rates of y, a start on the branch, and the coefficients that have no units of y.
IN_UNITS = {
    "cusp over a line": (x - y**3, (0.5, 0.8), LossKind.CUSP, {"kappa": -1.0}),
    "quadratic fold": (x - y**2, (0.5, 0.7), LossKind.FOLD, {"kappa": -1.0}),
    "exchange of stability": (
        y * (x - y) + 2 * eps, (-0.5, 0.0), LossKind.TRANSCRITICAL, {"lambda": -3.0},
    ),
}  # fmt: skip


@pytest.mark.exhaustive
@pytest.mark.parametrize(("unit", "length"), [(10**-4, 10**3), (10**4, 10**-3)])
@pytest.mark.parametrize("name", IN_UNITS)
def test_units_of_the_variables_change_neither_name_nor_invariants(
    name: str, unit: float, length: float
) -> None:
    rate, (x0, y0), kind, invariants = IN_UNITS[name]
    of_y, of_x = map(sp.nsimplify, (unit, length))
    fast = {y: sp.expand(of_y * rate.subs({x: x / of_x, y: y / of_y}, simultaneous=True))}
    region = {"x": (-length, 1.1 * length)}
    case = Case({x: of_x}, fast, {"x": length * x0, "y": unit * y0}, region, kind)
    (loss,) = judge(case).losses
    assert loss.kind is kind
    assert (loss.point["x"] / length, loss.point["y"] / unit) == pytest.approx((0.0, 0.0), abs=1e-7)
    assert {name: loss.coefficients[name] for name in invariants} == pytest.approx(invariants, rel=1e-6)


# -- two slow variables -------------------------------------------------------------------------------

CURVES = {
    "cusp": Case({x: sp.Integer(1), u: sp.Rational(1, 2)}, {y: x + u * y - y**3}, {}, PLANE, LossKind.CUSP),
    "Bogdanov-Takens": Case(
        {x: sp.Integer(1), u: sp.Integer(1)},
        {y: z, z: x + u * z + y**2 + y * z},
        {"x": -0.5, "u": -0.5, "y": -(0.5**0.5), "z": 0},
        PLANE,
        LossKind.BOGDANOV_TAKENS,
    ),
    "Bogdanov-Takens, the other sign": Case(
        {x: sp.Integer(1), u: sp.Integer(1)},
        {y: z, z: x + u * z + y**2 - y * z},
        {"x": -0.5, "u": -0.5, "y": -(0.5**0.5), "z": 0},
        PLANE,
        LossKind.BOGDANOV_TAKENS,
    ),
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", CURVES)
def test_a_curve_of_folds_is_one_loss_and_its_special_points_are_others(name) -> None:
    case = CURVES[name]
    verdict = judged(name)
    fold = only(verdict, LossKind.FOLD)
    assert fold.samples > 8
    special = only(verdict, case.kind)
    assert [special.point[n] for n in ("x", "u", "y")] == pytest.approx([0, 0, 0], abs=1e-7)


@pytest.mark.exhaustive
def test_a_double_zero_in_disguise_keeps_a_over_b() -> None:
    for name, ratio in (("Bogdanov-Takens", 1), ("Bogdanov-Takens, the other sign", -1)):
        loss = only(judged(name), LossKind.BOGDANOV_TAKENS)
        assert loss.coefficients["a/b"] == pytest.approx(ratio)
        hidden, _, _ = disguised(CURVES[name], 3)
        found = only(judge(hidden), LossKind.BOGDANOV_TAKENS)
        assert found.coefficients["a/b"] == pytest.approx(ratio, rel=1e-5)


@pytest.mark.exhaustive
def test_a_cusp_in_disguise_is_a_cusp() -> None:
    (cusp,) = [loss for loss in judged("cusp").losses if loss.kind is LossKind.CUSP]
    case = CURVES["cusp"]
    start = Case(case.slow, case.fast, {"x": 0.5, "u": -0.5, "y": 0.59}, PLANE, LossKind.CUSP)
    hidden, _, _ = disguised(start, 2)
    loss = only(judge(hidden), LossKind.CUSP)
    assert loss.coefficients["kappa"] == pytest.approx(cusp.coefficients["kappa"], rel=1e-5)


@pytest.mark.exhaustive
def test_curves_of_other_losses_are_merged() -> None:
    case = Case(
        {x: -x, u: sp.Integer(1)},
        {y: y * (x + u - y)},
        {"x": 0, "u": -0.5, "y": 0},
        PLANE,
        LossKind.TRANSCRITICAL,
    )
    loss = only(judge(case), case.kind)
    assert loss.samples > 1
    assert loss.extent["x"][1] - loss.extent["x"][0] > 1
    hopf = Case(
        {x: sp.Integer(1), u: sp.Integer(1)},
        {y: (x + THIRD) * y - z - y**3, z: y + (x + THIRD) * z - z**3},
        {"x": -0.5, "u": 0, "y": 0, "z": 0},
        PLANE,
        LossKind.HOPF,
    )
    assert only(judge(hopf), LossKind.HOPF).samples > 8


@pytest.mark.exhaustive
def test_folds_that_are_not_joined_are_two_losses() -> None:
    # Folds at 1 and -3/2, between which Newton's method leads from one curve to the other.
    rate = x - y**3 / 3 - y**2 / 4 + 3 * y / 2
    verdict = judge(
        Case({x: sp.Integer(1), u: -u}, {y: rate}, {}, {"x": (-2, 3), "u": (-1, 1.1)}, LossKind.FOLD)
    )
    assert sorted(loss.point["y"] for loss in verdict.losses) == pytest.approx([-1.5, 1])


# -- singular everywhere ------------------------------------------------------------------------------

BOX = {"x": (-1, 1), "y": (-5, 5), "z": (-5, 5)}
START = {"x": 0, "y": 0, "z": 0}
EVERYWHERE = {
    "cubic": ({y: x - y, z: -((z - x) ** 3)}, LossKind.VANISHING_DAMPING, 3),
    "quadratic damping": ({y: x - y, z: -z * sp.Abs(z)}, LossKind.VANISHING_DAMPING, 2),
    "one-sided": ({y: x - y, z: -(z**2)}, LossKind.VANISHING_DAMPING, 2),
    "slow below the cubic": ({y: x - y, z: -(z**3) - eps * z}, LossKind.VANISHING_DAMPING, 3),
    "nilpotent": ({y: z, z: -((y - x) ** 3)}, LossKind.NILPOTENT, None),
}


@pytest.mark.parametrize("unit", [1, 10**6, sp.Rational(1, 10**6)])
@pytest.mark.parametrize("others", [{}, {y: x - y}], ids=["alone", "with another"])
@pytest.mark.parametrize(
    "rate",
    [
        -z * sp.sqrt(sp.Abs(z)),
        z * sp.sqrt(sp.Abs(z)),
        -sp.sign(z) * sp.Abs(z) ** sp.Rational(3, 2),
        (x - z) * sp.sqrt(sp.Abs(z - x)),
        -x * (z - 7) * sp.sqrt(sp.Abs(z - 7)),
    ],
    ids=["damped", "driven", "by a sign", "along x", "elsewhere"],
)
def test_a_damping_with_a_root_is_no_linear_one(rate: sp.Expr, others: dict, unit: int) -> None:
    """Its slope was 0/0 on the branch: no point of it was seen, or it was one of two, the other without a formula."""
    system = SlowFastSystem(slow={x: -x}, fast={z: unit * rate, **others}, epsilon=eps)
    (branch,) = solve_critical(system).branches
    verdict = classify(branch, region={"x": (0.5, 1.5)})
    loss = only(verdict, LossKind.VANISHING_DAMPING)
    assert verdict.kind is Kind.LOST
    assert verdict.samples > 200
    assert loss.coefficients["order"] == pytest.approx(1.5)
    assert all(condition.holds for condition in verdict.conditions if condition.name in ("graph", "equilibria"))


@pytest.mark.parametrize("rate", [-z * sp.Abs(z), -(z**3)])
def test_a_zero_is_written_without_a_sign(rate: sp.Expr) -> None:
    """It was next_order = -0 and eigenvalue -0+0j."""
    system = SlowFastSystem(slow={x: -sp.Integer(1)}, fast={z: rate}, epsilon=eps)
    (loss,) = classify(solve_critical(system).branches[0], region={"x": (-1, 1)}).losses
    assert "eigenvalue 0+0j" in str(loss)
    assert "-0" not in str(loss).replace("-0.5", "")


def test_a_point_of_a_multiple_zero_may_be_inexact() -> None:
    # g_y = ((0, 1), (-3 d^2, 0)) at a point that is d off the branch, where it is nilpotent.
    matrices = np.array([[[0.0, 1.0], [-3.0 * d**2, 0.0]] for d in (0.0, 1e-6, 0.0)])
    assert _is_singular_throughout(matrices)
    assert not _is_singular_throughout(matrices[[0, 1, 1]])
    assert not _is_singular_throughout(np.concatenate([matrices, np.eye(2)[None]]))


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", [None, 4], ids=["as it is", "in disguise"])
@pytest.mark.parametrize("name", EVERYWHERE)
def test_a_branch_that_is_singular_everywhere_is_named(name: str, seed: int | None) -> None:
    fast, kind, order = EVERYWHERE[name]
    case = Case({x: -x}, fast, START, BOX, kind)
    meant = case if seed is None else disguised(case, seed)[0]
    verdict = classify(solve_critical(meant.system).branches[0], region=meant.region)
    loss = only(verdict, kind)
    assert verdict.kind is Kind.LOST
    assert loss.coefficients.get("order") == order
    if kind is LossKind.VANISHING_DAMPING:
        assert loss.coefficients["fast directions"] == 1
        expected = -1 if name == "slow below the cubic" else 0
        assert loss.coefficients["next_order"] == pytest.approx(expected, abs=1e-9)
        assert ("one side only" in loss.consequence) is (name == "one-sided")


HIDDEN = {
    "slow equation mixed in": [x - y, eps * (y - z)],
    "fast part of rank one": [x - y, y - x + eps * (y - 2 * z)],
    "curved": [x - y + y * z, -eps * z],
}


@pytest.mark.parametrize(("rate", "lost"), [(-((y**3 + y - x) ** 2), True), ((x - y - y**3) / 10**12, False)])
def test_a_row_that_vanishes_on_the_branch_is_told_from_one_that_is_small(rate: sp.Expr, lost: bool) -> None:
    # Points of a double zero are known to the root of rounding, and to that the row 2 (y^3 + y - x)(...) vanishes.
    system = SlowFastSystem(slow={x: 1}, fast={y: rate, z: y - z}, epsilon=eps)
    verdict = classify(solve_critical(system).branches[0], region={"x": (0.5, 2), "y": (-3, 3), "z": (-3, 3)})
    assert (verdict.kind is Kind.LOST) == lost
    assert [loss.kind for loss in verdict.losses] == [LossKind.VANISHING_DAMPING] * lost


def test_the_slow_combinations_of_a_fast_block_are_told() -> None:
    flux = x - 2 * y - z
    system = SlowFastSystem(slow={x: -x}, fast={y: flux + eps * y, z: -flux + eps * z}, epsilon=eps)
    with pytest.raises(BranchError, match=r"Declare x, p = y \+ z as slow, or split the VectorField\."):
        solve_critical(system)


@pytest.mark.parametrize("name", thinned(HIDDEN, 2))
def test_a_time_scale_hidden_in_the_fast_block_is_named(name) -> None:
    rates = HIDDEN[name]
    hidden, _, T = disguised(Case({x: -x}, dict(zip((y, z), rates)), START, BOX, LossKind.HIDDEN_TIME_SCALE), 1)
    with pytest.raises(
        BranchError, match=r"time scale is hidden in the fast block: of its 2 directions 1 is fast"
    ):
        solve_critical(hidden.system)
    equations = tuple(laurent(g, eps, order=0).get(0, sp.Integer(0)) for g in hidden.system.g)
    verdict = classify(Branch(hidden.system, equations, None), region=hidden.region)
    loss = only(verdict, LossKind.HIDDEN_TIME_SCALE)
    assert loss.coefficients["fast directions"] == 1
    assert "slow" in loss.remedy
    # The combination named is the one that the layer problem leaves alone.
    if name == "slow equation mixed in":
        row = T.inv()[1, :]
        ratio = float(row[1] / row[0])
        assert f"{ratio:.6g}".lstrip("-").removesuffix(".0") in loss.remedy or ratio in (1, -1)


# -- functions that are not smooth --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("g", "met", "jump", "kink"),
    [
        (sp.Abs(x) - y, True, False, True),
        (sp.Max(x, 2 * x) - y, True, False, True),
        (x * sp.Abs(x) - y, True, False, False),
        (sp.Piecewise((x, x < THIRD), (2 * x, True)) - y, True, True, True),
        (sp.Abs(x + 3) - y, False, False, False),
        (sp.sqrt(x + 5) - y, False, False, False),
    ],
)
def test_a_switching_surface_is_a_loss_when_the_branch_meets_it(g, met, jump, kink) -> None:
    verdict = judge(Case({x: sp.Integer(1)}, {y: g}, {}, UNIT, LossKind.NON_SMOOTH))
    assert verdict.kind is Kind.ATTRACTING
    assert verdict.holds is not met
    if met:
        loss = only(verdict, LossKind.NON_SMOOTH)
        assert loss.value == pytest.approx(0, abs=1e-12)
        assert (loss.coefficients["jump"] > 0) is jump
        if not jump:
            assert (loss.coefficients["kink"] > 0) is kink
    else:
        assert verdict.losses == ()
        assert "not smooth" in verdict.notes[0]


@pytest.mark.parametrize(
    ("g", "top"),
    [
        (x - sp.Abs(y), 1.0),
        (x - sp.Max(-y, y / 2), 2.0),
        (x - sp.Abs(y) + y / 3, 1.5),
        (x - y - 2 * sp.Max(0, -y), 1.0),
    ],
)
def test_where_two_sheets_meet_at_a_kink_no_reduction_goes_on(g: sp.Expr, top: float) -> None:
    """It was said that the slow manifold is continuous there, with a kink, and that orbits cross."""
    case = Case({x: -sp.Integer(1)}, {y: g}, {"x": 1, "y": top}, UNIT, LossKind.NON_SMOOTH)
    loss = only(judge(case), LossKind.NON_SMOOTH)
    assert loss.point == pytest.approx({"x": 0, "y": 0}, abs=1e-6)
    assert "two sheets of M0 meet there" in loss.consequence
    assert not loss.may_reduce


@pytest.mark.parametrize(("unit", "origin"), [(1, 0), (10**6, 0), (sp.Rational(1, 10**6), 0), (1, 7)])
@pytest.mark.parametrize(
    "g",
    [
        sp.Abs(x) - sp.Abs(y),
        sp.Abs(y) - 10 * sp.Abs(x),
        x + 2 * sp.Abs(x) - sp.Abs(y),
        x**2 - y**2 + y**5 / 40,
    ],
    ids=["kinks", "repelling", "two slopes", "smooth"],
)
def test_a_sheet_that_meets_another_goes_on_beyond_it(g: sp.Expr, unit: sp.Expr, origin: int) -> None:
    """Beyond it no sample was found, and half of the region was said to have no real point."""
    g = g.subs({x: unit * x - origin, y: y - origin}, simultaneous=True)
    (branch,) = solve_critical(SlowFastSystem(slow={x: -1}, fast={y: g}, epsilon=eps)).branches
    low, at, high = (float((origin + far) / unit) for far in (-0.1, 0.08, 0.1))
    verdict = classify(
        branch.through({"x": at, "y": origin + 0.2}), region={"x": (low, high), "y": (origin, origin + 2)}
    )
    assert verdict.kind is Kind.LOST
    (graph,) = [condition for condition in verdict.conditions if condition.name == "graph"]
    assert graph.holds
    assert any(not loss.is_hyperbolic and loss.point["y"] == pytest.approx(origin) for loss in verdict.losses)


def test_a_kink_where_an_eigenvalue_passes_zero_by_itself_is_no_corner() -> None:
    case = Case({x: -sp.Integer(1)}, {y: -y * sp.Max(x, 2 * x)}, {"x": 0.5, "y": 0}, UNIT, LossKind.NON_SMOOTH)
    assert all("corner" not in loss.consequence for loss in judge(case).losses)


@pytest.mark.parametrize(
    ("g", "top", "end"), [(x - y - sp.sign(y) / 2, 0.4, 0.5), (x - y + sp.sign(y) / 2, 1.4, -0.5)]
)
def test_where_a_sheet_ends_at_a_jump_is_told_of_that_sheet(g: sp.Expr, top: float, end: float) -> None:
    """Newton's method came to where the other sheet ends, over -0.5 and 0.5, and that was told."""
    case = Case({x: -sp.Integer(1)}, {y: g}, {"x": 0.9, "y": top}, UNIT, LossKind.NON_SMOOTH)
    loss = only(judge(case), LossKind.NON_SMOOTH)
    assert loss.point == pytest.approx({"x": end, "y": 0}, abs=1e-6)


@pytest.mark.exhaustive
@pytest.mark.parametrize(("g", "grows"), [(sp.sqrt(x) - y, True), (x ** sp.Rational(3, 2) - y, False)])
def test_a_root_on_the_edge_of_its_domain_is_said_to_have_no_bounded_slope(g: sp.Expr, grows: bool) -> None:
    # Only one side of x = 0 has a field: nothing there tells a jump, and x^(1/2) has an infinite slope.
    branch = solve_critical(SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: g}, epsilon=eps)).branches[0]
    loss = only(classify(branch, region={"x": (0, 4)}), LossKind.NON_SMOOTH)
    assert loss.on_edge
    assert ("grows without bound" in loss.consequence) is grows
    assert loss.may_reduce is not grows
    assert ("kink" in loss.coefficients) is not grows


@pytest.mark.exhaustive
def test_a_kink_in_disguise_is_found_where_it_is() -> None:
    case = Case(
        {x: sp.Integer(1)}, {y: sp.Abs(y - THIRD) + x - 3 * y}, {"x": 0, "y": 0.0833}, UNIT, LossKind.NON_SMOOTH
    )
    plain = only(judge(case), case.kind)
    assert plain.point["x"] == pytest.approx(1, abs=1e-8)
    hidden, S, _ = disguised(case, 7)
    assert only(judge(hidden), case.kind).point["x"] == pytest.approx(float(S[0, 0]), abs=1e-8)


def test_an_eigenvalue_that_jumps_across_the_axis_is_lost_at_the_switching_surface() -> None:
    verdict = judge(Case({x: sp.Integer(1)}, {y: (2 * sp.Heaviside(x) - 1) * y}, {}, UNIT, LossKind.NON_SMOOTH))
    loss = only(verdict, LossKind.NON_SMOOTH)
    assert verdict.kind is Kind.LOST
    assert "jumps" in loss.crossing


@pytest.mark.exhaustive
def test_a_sheet_that_ends_at_a_switching_surface_says_so() -> None:
    # y = x + 1 where x + y > 0, so for x > -1/2.
    fast = {y: sp.sign(x + y) - y + x}
    verdict = judge(Case({x: sp.Integer(1)}, fast, {"x": 0.5, "y": 1.5}, UNIT, LossKind.NON_SMOOTH))
    loss = only(verdict, LossKind.NON_SMOOTH)
    assert loss.crossing == "end of the sheet"
    assert loss.point["x"] == pytest.approx(-0.5, abs=1e-6)
    assert verdict.kind is Kind.LOST
    assert not any("does not cross" in note for note in verdict.notes)


@pytest.mark.exhaustive
def test_a_branch_that_ends_for_no_reason_found_is_not_given_one() -> None:
    loss = only(
        judge(Case({x: sp.Integer(1)}, {y: sp.exp(y) - x}, {}, UNIT, LossKind.DEGENERATE)), LossKind.DEGENERATE
    )
    assert "no zero eigenvalue, pole or switching surface" in loss.note


@pytest.mark.parametrize("factor", [x, x - u])
def test_where_the_directions_n_of_a_field_vanish_the_rank_changes(factor) -> None:
    # z' = N f/epsilon + G with N = -factor, f = y - 1.
    slow = {s: sp.Integer(1) for s in (x, u) if factor.has(s)}
    field = VectorField({**slow, y: -factor * (y - 1) / eps - x * y}, epsilon=eps)
    splitting = split(field)
    assert splitting.system is not None
    region = {s.name: (-1, 1.1) for s in slow}
    verdict = classify(solve_critical(splitting.system).branches[0], region=region)
    assert only(verdict, LossKind.RANK_CHANGE).point["y"] == pytest.approx(1)


@pytest.mark.parametrize("kink", [0.06, 0.03, 0.01])
def test_a_fibre_of_zeros_that_ends_at_a_kink_has_no_order(kink) -> None:
    # Over x = 0 every y <= kink is an equilibrium; beyond, y' = kink - y.
    fast = {y: x * y + sp.Min(sp.Rational(str(kink)) - y, 0)}
    case = Case({x: sp.Integer(1)}, fast, {"x": -0.5, "y": 0}, UNIT, LossKind.RANK_CHANGE)
    loss = only(judge(case), case.kind)
    assert loss.point == pytest.approx({"x": 0, "y": 0}, abs=1e-9)
    assert "consists of equilibria" in loss.consequence


# -- no false alarm -----------------------------------------------------------------------------------

HYPERBOLIC = {
    "small eigenvalue": {y: x - y, z: -z / 1000 + x},
    "neutral saddle": {y: z, z: x * y / 2 + y - x * z},
    "neutral saddle everywhere": {y: z, z: y + x},
    "strongly non-normal": {y: -y + 10**4 * z, z: -z + x},
    "stiff": {y: -(10**6) * (y - x), z: -z + y},
    "nearly touching": {y: -y * (x**2 + sp.Rational(1, 1000))},
    "slowly damped": {y: -y / 1000 + 5 * z, z: -5 * y - z / 1000 + x},
    "nearly folded": {y: x - y**3 / 3 - y / 1000 - y**5},
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", HYPERBOLIC)
def test_a_hyperbolic_branch_raises_no_alarm(name) -> None:
    verdict = judge(Case({x: -x}, HYPERBOLIC[name], {}, UNIT, LossKind.FOLD))
    assert verdict.losses == ()
    assert verdict.kind is not Kind.LOST
    assert ("neutral" in name) is bool(verdict.looked_at)
    if verdict.looked_at:
        assert verdict.looked_at[0].kind is LossKind.NEUTRAL_SADDLE


# -- what is bad input, and what is shown ---------------------------------------------------------------


def test_a_fold_on_the_edge_of_the_region_is_named() -> None:
    case = Case({x: sp.Integer(1)}, {y: x + y**2}, {}, {"x": (-1, 0)}, LossKind.FOLD)
    loss = only(judge(case), LossKind.FOLD)
    assert loss.on_edge
    assert "on the edge of the region" in str(loss)


@pytest.mark.exhaustive
@pytest.mark.parametrize("place", [sp.Rational(123, 1000), sp.Integer(0), -sp.Rational(1, 3)])
def test_an_eigenvalue_that_touches_the_axis_is_named_degenerate(place: sp.Expr) -> None:
    # A multiple zero is approached linearly, and met exactly only where a sample lies on it.
    rate = (x - place) ** 2
    for fast in ({y: -rate * y}, {y: -rate * y - 2 * z, z: 2 * y - rate * z}):
        loss = only(
            judge(Case({x: sp.Integer(1)}, fast, {}, {"x": (-1, 1)}, LossKind.DEGENERATE)), LossKind.DEGENERATE
        )
        assert "first order" in loss.note


def test_a_zero_and_a_pair_together_are_named() -> None:
    fast = {y: x * y - z, z: y + x * z, w: x * w}
    loss = only(judge(Case({x: sp.Integer(1)}, fast, {}, UNIT, LossKind.DEGENERATE)), LossKind.DEGENERATE)
    assert "imaginary pair together" in loss.note or "on the axis" in loss.note


@pytest.mark.exhaustive
def test_a_hopf_point_without_nonlinearity_says_that_l1_is_zero() -> None:
    fast = {y: x * y - z, z: y + x * z}
    loss = only(judge(Case({x: sp.Integer(1)}, fast, {}, UNIT, LossKind.HOPF)), LossKind.HOPF)
    assert "l1 = 0" in loss.note
    assert "what higher terms decide" in loss.consequence


@pytest.mark.parametrize(
    ("first", "second"), thinned([(1, 1), (1000, 1000), (sp.Rational(1, 10**5), 10**4), (10**6, 1)], 3)
)
def test_a_hopf_point_is_degenerate_in_all_units_or_in_none(first, second) -> None:
    """y = `first` Y and z = `second` Z of the cubic normal form, whose l1 is -2 for vectors of length 1."""
    Y, Z = y / first, z / second
    rates = {y: (x * Y - Z - Y * (Y**2 + Z**2)) * first, z: (Y + x * Z - Z * (Y**2 + Z**2)) * second}
    box = {**UNIT, "y": (-2 * float(first), 2 * float(first)), "z": (-2.0 * second, 2.0 * second)}
    loss = only(judge(Case({x: sp.Integer(1)}, rates, {}, box, LossKind.HOPF)), LossKind.HOPF)
    assert loss.coefficients["l1"] < 0.0
    assert "l1" not in loss.note
    assert "small cycles" in loss.consequence


@pytest.mark.exhaustive
def test_a_part_of_the_region_where_the_conditions_hold_is_proposed() -> None:
    verdict = judged("fold of a cubic")
    part = verdict.sub_region
    assert part is not None
    assert part.axis == "x"
    assert part.interval[0] > -2 / 3
    branch = solve_critical(CASES["fold of a cubic"].system).nearest(CASES["fold of a cubic"].through)
    assert classify(branch, region=part.region).kind is Kind.ATTRACTING
    assert "holds: for x in" in str(verdict)
    assert judge(Case({x: -x}, {y: x - y}, {}, UNIT, LossKind.FOLD)).sub_region is None


def test_a_loss_prints_what_it_is_and_what_follows() -> None:
    loss = only(judged("fold of a cubic"), LossKind.FOLD)
    text = str(loss)
    for word in (
        "fold: zero eigenvalue at x = -0.666667, y = 1",
        "test",
        "kappa = 0.5",
        "follows",
        "ends here",
    ):
        assert word in text
    assert repr(loss) == f"Loss({loss.headline})"
    assert "\n" not in repr(loss)


@pytest.mark.exhaustive
def test_the_end_of_a_domain_is_no_loss_of_an_eigenvalue() -> None:
    x, y, u, v, epsilon = sp.symbols("x y u v epsilon")
    plain = SlowFastSystem(slow={x: -x}, fast={y: sp.log(x) - y}, epsilon=epsilon)
    disguised = SlowFastSystem(
        slow={u: -u}, fast={v: sp.log(2 * u) - sp.Rational(3, 2) * (v + u)}, epsilon=epsilon
    )
    for system, name in ((plain, "x"), (disguised, "u")):
        found = classify(solve_critical(system).branches[0], region={name: (-1, 1)})
        assert [loss.kind for loss in found.losses] == [LossKind.DOMAIN_END]
        assert found.losses[0].point[name] == pytest.approx(0.0, abs=1e-6)
        assert not found.losses[0].may_reduce


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", [1, 5])
@pytest.mark.parametrize(
    ("fast", "kind"),
    [
        ({y: 1 / x - y, z: y - z}, LossKind.BRANCH_POLE),
        ({y: (x - y) / (x - sp.Rational(1, 4)), z: y - z}, LossKind.FIELD_POLE),
        ({y: z / 2 + x, z: y - x * z}, LossKind.NEUTRAL_SADDLE),
    ],
)
def test_poles_and_neutral_saddles_keep_their_names_in_disguise(fast, kind, seed) -> None:
    for twist in (None, seed):
        case = Case({x: sp.Integer(1)}, fast, {}, {"x": (-1, 1)}, kind)
        if twist is not None:
            T = invertible(2, twist)
            back = dict(zip((y, z), T.inv() * sp.Matrix([y, z])))
            rates = (T * sp.Matrix([fast[y], fast[z]])).subs(back, simultaneous=True)
            case = Case(
                {x: sp.Integer(1)}, dict(zip((y, z), map(sp.together, rates))), {}, {"x": (-1, 1)}, kind
            )
        verdict = classify(solve_critical(case.system).branches[0], region=case.region)
        if kind is LossKind.NEUTRAL_SADDLE:
            # Not a loss: two real eigenvalues of opposite sign. Their sum is zero where the trace, -x, is.
            assert not verdict.losses
            found = [loss for loss in verdict.looked_at if loss.kind is kind]
        else:
            found = [loss for loss in verdict.losses if loss.kind is kind]
        assert len(found) == 1, verdict
        expected = 0.25 if kind is LossKind.FIELD_POLE else 0.0
        assert found[0].point["x"] == pytest.approx(expected, abs=1e-6)


@pytest.mark.exhaustive
def test_a_hopf_point_that_is_a_sample_is_no_eigenvalue_that_jumps() -> None:
    """The Brusselator's feed b drifts: X = a, Y = b/a has the eigenvalues (b - 2 +- sqrt((b - 2)^2 - 4))/2 at a = 1."""
    b, X, Y = sp.symbols("b X Y")
    system = SlowFastSystem(slow={b: 1}, fast={X: 1 - (b + 1) * X + X**2 * Y, Y: b * X - X**2 * Y}, epsilon=eps)
    branch = solve_critical(system).nearest({"b": 1, "X": 1, "Y": 1})
    # b = 2 is a sample of each region, where eigenvalues on the axis are rounding.
    for interval in ((0.5, 2.5), (1.0, 3.0), (1.75, 2.25)):
        (loss,) = classify(branch, region={"b": interval}).losses
        assert loss.kind is LossKind.HOPF
        assert loss.point["b"] == pytest.approx(2.0, abs=1e-9)
        assert dict(loss.coefficients)["omega"] == pytest.approx(1.0)


@pytest.mark.exhaustive
def test_a_fold_curve_is_named_where_a_fast_variable_has_hundreds_of_units() -> None:
    """Over two slow variables the nearest fold is meant in units of the region: in raw ones y, in hundreds, all but
    stays and x leaves it. The region's corner is cut off by the curve x + 4 u^2 = 2/300."""
    v = y / 500
    system = SlowFastSystem(
        slow={x: 1, u: 1}, fast={y: 100 * x + 400 * u**2 + v - v**3 / 3, z: v**2 / 4 - z}, epsilon=eps
    )
    branch = solve_critical(system).nearest({"x": 0, "u": 0, "y": -900, "z": 0.75})
    region = {"x": (-0.01, 0.008), "u": (-0.03, 0.05), "y": (-1200, -300), "z": (0, 2)}
    verdict = classify(branch, region=region)
    assert [loss.kind for loss in verdict.losses] == [LossKind.FOLD]
    (loss,) = verdict.losses
    assert loss.point["x"] + 4 * loss.point["u"] ** 2 == pytest.approx(2 / 300, rel=1e-9)
    assert loss.point["y"] == pytest.approx(-500)
    assert loss.samples > 1


def test_a_place_at_a_corner_of_the_region_is_told_without_rounding() -> None:
    """Ozone: without any molecules the atoms rest wherever they are."""
    fast = {y: 3 * x - 1200 * z * y - 50 * x * y}
    branch = solve_critical(SlowFastSystem(slow={x: -x, z: 1 - z}, fast=fast, epsilon=eps)).branches[0]
    losses = classify(branch, region={"x": (0, 1), "z": (0, 2)}).losses
    assert losses
    assert all(loss.point["x"] == loss.point["z"] == 0.0 for loss in losses)


def test_a_loss_far_from_the_origin_is_told_so_that_its_place_is_seen() -> None:
    """It was told at t = 1e+06, y = 1e+06."""
    t, y, epsilon = sp.symbols("t y epsilon")
    v = y - 10**6
    system = SlowFastSystem(
        slow={t: sp.Integer(1)}, fast={y: v * (t - 10**6 - sp.Rational(1, 4) - v)}, epsilon=epsilon
    )
    branch = next(b for b in solve_critical(system).branches if b.graph == {y: 10**6})
    (loss,) = classify(branch, region={"t": (10**6 - 1, 10**6 + 1)}).losses
    assert loss.headline == "transcritical point: zero eigenvalue at t = 1000000.25, y = 1000000"
