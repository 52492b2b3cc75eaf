"""Passage through folds, and delayed exits: exact cases, measured powers of epsilon, and extended precision."""

from __future__ import annotations

import math
import re

import mpmath as mp
import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.critical.loss_kind import LossKind
from gsp.errors import DeclarationError, Status, UnsupportedFunctionError
from gsp.hyperbolicity.losses.consequences import OMEGA_0
from gsp.integration.events import Event
from gsp.integration.methods import Method
from gsp.singular.passage.delay_measurement import measure_delay
from gsp.singular.passage.delayed_exit import ExitKind
from gsp.singular.passage.drop import DropKind
from gsp.singular.passage.entry_exit import entry_exit
from gsp.singular.passage.extended_orbit import follow
from gsp.singular.passage.failure import PassageError
from gsp.singular.passage.fold_measurement import fit_omega0, fold_exit
from gsp.singular.passage.fold_passage import fold_passage
from gsp.singular.passage.losses_met import Outcome, PassedLoss, first_zero
from tests.cases import thinned

eps, x, y, z, w, t, s = sp.symbols("epsilon x y z w t s")
R = sp.Rational


def system(slow, fast, **parameters) -> gsp.SlowFastSystem:
    values = {sp.Symbol(name): value for name, value in parameters.items()}
    return gsp.SlowFastSystem(slow=slow, fast=fast, epsilon=eps, parameters=values)


def branch(of: gsp.SlowFastSystem, point=None):
    found = gsp.solve_critical(of)
    return found.branches[0] if point is None else found.nearest(point)


def passage_of(fast: dict) -> gsp.DelayedExit:
    """Along y' = 1 from y = -1 and the branch of zero."""
    return entry_exit(
        branch(system({y: 1}, fast), {**dict.fromkeys(map(str, fast), 0), "y": -1}), start={"y": -1}
    )


NORMAL = system({y: 1}, {x: x**2 + y})
VAN_DER_POL = system({y: -x}, {x: y - x**3 / 3 + x})
TWO_AND_TWO = system(
    {y: 1 + x / 3 + w / 5, z: R(1, 2) - 2 * x},
    {x: x**2 + y + w * x / 2 + x**3 / 4 + z * x / 3, w: -w + x**2 / 2 + x * z + y / 3},
)
SHISHKOVA = system({t: 1}, {x: t * x - y + eps, y: x + t * y})


# -- folds -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("epsilon", "exit"), [(1e-2, 0.098843792572790542), (1e-3, 0.022388518922361782)])
def test_the_normal_form_meets_the_reference_in_the_section(epsilon: float, exit: float) -> None:
    found = fold_exit(fold_passage(NORMAL, {"x": 0, "y": 0}), epsilon=epsilon, section={"x": 1})
    assert found.status is Status.SUCCESS
    assert found.point["x"] == pytest.approx(1, abs=1e-12)
    assert found.point["y"] == pytest.approx(exit, abs=1e-13)
    assert found.resolution < 1e-20


def test_the_exit_obeys_the_quotient_of_airy_functions() -> None:
    # epsilon x' = x^2 + y: x = epsilon^(1/3) Ai'(-s)/Ai(-s) with y = epsilon^(2/3) s.
    epsilon = 0.02
    found = fold_exit(fold_passage(NORMAL, {"x": 0, "y": 0}), epsilon=epsilon, section={"x": 0.7})
    scaled = -found.point["y"] / epsilon ** (2 / 3)
    quotient = mp.airyai(scaled, derivative=1) / mp.airyai(scaled)
    assert float(epsilon ** (1 / 3) * quotient) == pytest.approx(0.7, abs=1e-10)


@pytest.mark.parametrize(
    ("of", "point", "section"),
    thinned(
        [
            (NORMAL, {"x": 0, "y": 0}, {"x": 1}),
            (VAN_DER_POL, {"x": 1, "y": -0.667}, None),
            (VAN_DER_POL, {"x": -1, "y": 0.667}, None),
            (TWO_AND_TWO, dict.fromkeys("xyzw", 0), {"x": 0.5}),
        ],
        2,
    ),
    ids=["normal form", "van der Pol", "van der Pol, other fold", "two fast and two slow"],
)
def test_omega0_and_the_logarithm_come_out_of_a_fit(of, point, section) -> None:
    fit = fit_omega0(fold_passage(of, point), section=section)
    assert fit.omega0 == pytest.approx(OMEGA_0, abs=1e-3)
    assert fit.logarithmic == pytest.approx(fit.expected_logarithmic, abs=0.02)


def test_van_der_pol_has_the_logarithm_two_ninths_and_lands_at_minus_two() -> None:
    curve = gsp.continue_critical(VAN_DER_POL, start={"x": 2, "y": 2 / 3}, bounds={"x": (-3, 3), "y": (-2, 2)})
    passage = fold_passage(VAN_DER_POL, next(p for p in curve.special if p["x"] > 0))
    assert passage.logarithmic[0] == pytest.approx(-2 / 9, abs=1e-12)
    assert passage.leading[0] == pytest.approx(-OMEGA_0, abs=1e-12)
    assert passage.drop.kind is DropKind.SHEET
    assert passage.drop.point["x"] == pytest.approx(-2, abs=1e-12)
    assert passage.drop.point["y"] == passage.point["y"]
    assert passage.drop.eigenvalues == pytest.approx([-3])
    assert passage.exit(1e-3)["y"] == pytest.approx(-2 / 3 - OMEGA_0 * 0.01 - 2 / 9 * 1e-3 * math.log(1e-3))


def test_units_of_the_fast_rate_are_no_branch_point() -> None:
    # With a = b = k the exit is OMEGA_0 (k^2)^(-1/3).
    for k in (R(1, 10**9), R(10**9)):
        passage = fold_passage(system({y: 1}, {x: k * (x**2 + y)}), {"x": 0, "y": 0})
        assert passage.leading[0] == pytest.approx(OMEGA_0 * float(k) ** (-2 / 3), rel=1e-12)
    for g in (x**2 + y**2 / 2, x**2 + x * y):
        with pytest.raises(PassageError, match="two branches"):
            fold_passage(system({y: 1}, {x: g}), {"x": 0, "y": 0})


def test_a_second_slow_variable_collects_a_logarithm_along_the_fold() -> None:
    # z' = x adds int x dt = -epsilon ln Ai, whose logarithm is -1/6, to the order-zero -2/3 from (-1, -1).
    passage = fold_passage(system({y: 1, z: x}, {x: x**2 + y}), dict.fromkeys("xyz", 0))
    assert passage.logarithmic == pytest.approx([0, -1 / 6])
    ladder = np.array([1e-4, 1e-5])
    start = {"x": -1, "y": -1, "z": 2 / 3}
    found = [fold_exit(passage, epsilon=e, section={"x": 1}, start=start).point["z"] for e in ladder]
    slope = np.diff(np.array(found) / ladder) / np.diff(np.log(ladder))
    assert slope[0] == pytest.approx(-1 / 6, abs=1e-3)


def test_a_linear_change_of_the_fast_variables_changes_nothing_slow() -> None:
    straight = fold_passage(TWO_AND_TWO, dict.fromkeys("xyzw", 0))
    # (x, w) = T (u, v)
    T = sp.Matrix([[2, 1], [-1, 3]])
    u, v = sp.symbols("u v")
    old = T * sp.Matrix([u, v])
    put_in = {x: old[0], w: old[1]}
    rates = T.inv() * sp.Matrix([e.subs(put_in, simultaneous=True) for e in TWO_AND_TWO.g])
    turned = system(
        {k: e.subs(put_in, simultaneous=True) for k, e in TWO_AND_TWO.slow.items()},
        {u: sp.expand(rates[0]), v: sp.expand(rates[1])},
    )
    bent = fold_passage(turned, dict.fromkeys("uvyz", 0))
    assert bent.leading == pytest.approx(straight.leading, rel=1e-10)
    assert bent.logarithmic == pytest.approx(straight.logarithmic, rel=1e-10)


def test_a_scaled_fold_scales_its_delay() -> None:
    passage = fold_passage(system({y: R(3)}, {x: -5 * x**2 - 2 * y}), {"x": 0, "y": 0})
    assert (passage.a, passage.b) == pytest.approx((-5, -6))
    # w = -5 x and sigma = 10 y: 30 epsilon dw/dsigma = w^2 + sigma.
    found = fold_exit(passage, epsilon=1e-4, section={"x": -1})
    small = 30 * 1e-4
    scaled = -10 * found.point["y"] / small ** (2 / 3)
    quotient = mp.airyai(scaled, derivative=1) / mp.airyai(scaled)
    assert float(small ** (1 / 3) * quotient) == pytest.approx(5, abs=1e-8)
    assert passage.delay(1e-6) == pytest.approx(OMEGA_0 * 30 ** (-1 / 3) * 1e-4)


@pytest.mark.parametrize(
    ("fast", "slow"),
    thinned(
        [
            (R(1, 10**6), 1),
            (1, 10**6),
            (R(1, 10**6), 10**6),
            (10**6, R(1, 10**6)),
            (R(1, 10**18), R(1, 10**18)),
        ],
        2,
    ),
)
def test_a_measured_exit_is_the_same_in_any_units_of_the_states(fast, slow) -> None:
    scaled = system({y: slow}, {x: fast * ((x / fast) ** 2 + y / slow)})
    passage = fold_passage(scaled, {"x": 0, "y": 0})
    for epsilon in (1e-2, 1e-8):
        found = fold_exit(passage, epsilon=epsilon, section={"x": float(fast)})
        plain = fold_exit(fold_passage(NORMAL, {"x": 0, "y": 0}), epsilon=epsilon, section={"x": 1})
        assert found.point["y"] / float(slow) == pytest.approx(plain.point["y"], rel=1e-12)
        assert found.resolution < 1e-20
    assert fit_omega0(passage, section={"x": float(fast)}).omega0 == pytest.approx(OMEGA_0, abs=1e-3)


@pytest.mark.exhaustive
@pytest.mark.parametrize("powers", [(0, 6, -6), (0, -6, 6), (6, -6, -6), (-6, 6, 6)])
def test_a_passage_is_the_same_in_any_units_of_the_states(powers: tuple[int, ...]) -> None:
    slow, fast = {x: 1 - x / 9}, {y: x + y**2 - y**3 / 3 + z / 5, z: y - z - y**2}
    units = {s: sp.Integer(10) ** power for s, power in zip((x, y, z), powers)}
    inner = {s: s / unit for s, unit in units.items()}
    scaled = system(*({s: units[s] * e.xreplace(inner) for s, e in rates.items()} for rates in (slow, fast)))
    plain = system(slow, fast)
    (fold, *_) = gsp.continue_critical(plain, start={"x": -1, "y": -1, "z": -2}, bounds={"x": (-3, 1)}).special
    there = {s.name: fold[s.name] * float(unit) for s, unit in units.items()}
    found, one = fold_passage(scaled, there), fold_passage(plain, fold)
    assert found.exit(1e-3)["x"] / float(units[x]) == pytest.approx(one.exit(1e-3)["x"], rel=1e-9)
    assert found.delay(1e-3) == pytest.approx(one.delay(1e-3), rel=1e-9)
    assert found.drop.kind is one.drop.kind is DropKind.SHEET
    for s, unit in units.items():
        assert found.drop.point[s.name] / float(unit) == pytest.approx(one.drop.point[s.name], rel=1e-9)


@pytest.mark.parametrize("unit", [10**6, 10**20])
def test_a_point_that_is_the_fold_to_the_last_bit_is_one_in_any_unit(unit: int) -> None:
    scaled = system({y: -x * unit}, {x: y / unit - x**3 / 3 + x})
    found = fold_passage(scaled, {"x": 1, "y": -2 / 3 * unit})
    assert found.leading[0] / unit == pytest.approx(-OMEGA_0, rel=1e-12)
    both = fold_passage(
        system({y: -x}, {x: unit * (y / unit - (x / unit) ** 3 / 3 + x / unit)}), {x: unit, y: -2 / 3 * unit}
    )
    assert both.leading[0] / unit == pytest.approx(-OMEGA_0, rel=1e-12)


def test_a_slow_rate_that_switches_elsewhere_changes_nothing_at_the_fold() -> None:
    # As a gate does, the rate jumps where x = -9/10, far from the fold.
    gated = fold_passage(
        system({y: -x * (1 + sp.sign(x + R(9, 10))) / 2}, {x: y - x**3 / 3 + x}), {"x": 1, "y": -2 / 3}
    )
    smooth = fold_passage(VAN_DER_POL, {"x": 1, "y": -2 / 3})
    assert str(gated) == str(smooth)


def test_a_drop_in_a_region_may_leave_it_and_without_one_may_escape() -> None:
    region = {"x": (-3, 1.5), "y": (-2, 2)}
    left = fold_passage(VAN_DER_POL, {"x": -1, "y": 2 / 3}, region=region)
    assert left.drop.kind is DropKind.LEAVES
    assert fold_passage(NORMAL, {"x": 0, "y": 0}).drop.kind is DropKind.ESCAPE


def test_an_orbit_that_misses_the_section_says_so() -> None:
    passage = fold_passage(VAN_DER_POL, {"x": 1, "y": -2 / 3})
    found = fold_exit(passage, epsilon=0.01, section={"x": -2.5})
    assert found.status is Status.NOT_CONVERGED
    assert "did not meet the section x = -2.5" in found.message


BAD_FOLDS = {
    "no fold": (NORMAL, {"x": -1, "y": -1}, "there is no fold"),
    "off M0": (NORMAL, {"x": 0, "y": 0.5}, "there is no fold"),
    "linear": (system({y: 1}, {x: y - x}), {"x": 0, "y": 0}, "there is no fold"),
    "canard": (system({y: R(1) - x}, {x: y - x**3 / 3 + x}), {"x": 1, "y": -2 / 3}, "canard point"),
    "standing still": (
        system({y: eps * (x - 2)}, {x: y - x**3 / 3 + x}),
        {"x": 1, "y": -2 / 3},
        "every slow rate vanishes at epsilon = 0",
    ),
    "folded": (
        system({y: z, z: R(1)}, {x: y + x**2}),
        {"x": 0, "y": 0, "z": 0},
        "folded singularity.*folded_singularities",
    ),
    "away": (
        system({y: -2}, {x: x**2 + 3 * y}),
        {"x": 0, "y": 0},
        r"leads away.*a b = -6 < 0 with b = l \. g_x f",
    ),
    "cusp": (system({y: 1}, {x: y + x**3}), {"x": 0, "y": 0}, "a cusp"),
    "branch point": (system({y: 1}, {x: x**2 - y**2}), {"x": 0, "y": 0}, "two branches"),
    "saddle": (
        system({y: 1}, {x: x**2 + y, w: w}),
        {"x": 0, "y": 0, "w": 0},
        "not attracting",
    ),
    "double zero": (
        system({y: 1}, {x: w, w: y + x**2}),
        {"x": 0, "y": 0, "w": 0},
        "more than one fast eigenvalue",
    ),
}


def test_a_fold_that_is_refused_has_no_digits_where_it_is_0() -> None:
    front = system({y: R(1)}, {x: w, w: w / 5 - x * (1 - x) * (x - R(3) / 10) + y})
    with pytest.raises(PassageError, match=r"w = 0 is not attracting: fast eigenvalues \[0\. +0\.2\]"):
        fold_passage(front, {"x": 0.729606480625, "y": 0.0847531376778, "w": 1e-17})


@pytest.mark.parametrize("name", BAD_FOLDS)
def test_a_point_that_is_no_proper_fold_is_refused_by_name(name: str) -> None:
    of, point, message = BAD_FOLDS[name]
    with pytest.raises(PassageError, match=message):
        fold_passage(of, point)


def test_a_fold_outside_or_on_the_edge_of_the_region_is_refused() -> None:
    with pytest.raises(PassageError, match="outside the region"):
        fold_passage(NORMAL, {"x": 0, "y": 0}, region={"x": (1, 2)})
    with pytest.raises(PassageError, match="on the edge of the region"):
        fold_passage(NORMAL, {"x": 0, "y": 0}, region={"x": (-1, 1), "y": (-1, 0)})


def test_sections_and_parameters_that_do_not_fit_are_refused() -> None:
    passage = fold_passage(NORMAL, {"x": 0, "y": 0})
    with pytest.raises(DeclarationError, match="not beyond the fold"):
        fold_exit(passage, epsilon=0.01, section={"x": -1})
    with pytest.raises(DeclarationError, match="one fast variable"):
        fold_exit(passage, epsilon=0.01, section={"y": 1})
    with pytest.raises(PassageError, match="Give a section"):
        fold_exit(passage, epsilon=0.01)
    with pytest.raises(DeclarationError, match="four epsilons"):
        fit_omega0(passage, (0.1, 0.01), section={"x": 1})
    moved = system({y: 1}, {x: x**2 + y - sp.Symbol("a")}, a=1)
    with pytest.raises(PassageError, match="another value of the parameter a"):
        fold_passage(
            moved, gsp.continue_critical(moved, start={"x": -1, "y": 0, "a": 2}, parameter="a").special[0]
        )


# -- way in, way out ---------------------------------------------------------------------------------


def test_a_linear_rate_gives_back_the_entry() -> None:
    found = entry_exit(branch(system({y: 1}, {x: y * x})), start={"y": -0.7})
    assert found.kind is ExitKind.ENTRY_EXIT
    assert found.invariant
    assert found.point["y"] == pytest.approx(0.7, abs=1e-13)
    assert found.depth == pytest.approx(0.245, abs=1e-13)


@pytest.mark.parametrize("end", [0.5, 0.97, 1.3])
@pytest.mark.parametrize("by_region", [True, False])
def test_what_lies_behind_the_end_of_the_search_is_not_told(end: float, by_region: bool) -> None:
    # Phi(y) = (y - 1)^2/2 - 2 from y = -1 on: its least value is at the loss, y = 1.
    sheet, start = branch(system({y: 1}, {x: (y - 1) * x})), {"y": -1}
    found = (
        entry_exit(sheet, start=start, region={"y": (-2, end)})
        if by_region
        else entry_exit(sheet, start=start, longest=end + 1.0)
    )
    assert found.kind is ExitKind.NONE
    assert found.point["y"] == pytest.approx(end, abs=1e-9)
    assert [loss.t for loss in found.losses] == ([pytest.approx(2.0)] if end > 1.0 else [])
    assert found.depth == pytest.approx(2.0 - (min(end, 1.0) - 1.0) ** 2 / 2.0, abs=1e-9)
    assert ("Phi has not come back" if end > 1.0 else "no loss of stability was met") in found.message


def test_a_quadratic_rate_gives_the_root_of_its_cubic() -> None:
    found = entry_exit(branch(system({y: 1}, {x: (y + y**2) * x})), start={"y": -0.5})
    assert found.point["y"] == pytest.approx((math.sqrt(3) - 1) / 2, abs=1e-13)


@pytest.mark.parametrize("fast", [y * x - x**2, y * x - x**3, y * (x - 1 - y**2) + 2 * eps * y])
def test_invariant_branches_are_left_with_delay(fast: sp.Expr) -> None:
    found = entry_exit(branch(system({y: 1}, {x: fast})), start={"y": -0.6})
    assert found.kind is ExitKind.ENTRY_EXIT
    assert found.loss.outcome is Outcome.DELAY
    assert found.point["y"] == pytest.approx(0.6, abs=1e-12)


def test_two_slow_variables_on_a_curved_orbit() -> None:
    # y = -1 + t, z = exp(-t): int (y + z/2) dt = -t + t^2/2 + (1 - exp(-t))/2.
    found = entry_exit(branch(system({y: 1, z: -z}, {x: (y + z / 2) * x})), start={"y": -1, "z": 1})
    exact = mp.findroot(lambda u: -u + u**2 / 2 + (1 - mp.exp(-u)) / 2, 1.3)
    assert found.t == pytest.approx(float(exact), abs=1e-12)


def test_an_implicit_branch_with_a_second_fast_variable() -> None:
    of = system({y: 1}, {x: (y + w) * x, w: y - w - w**5})
    sheet = branch(of, {"x": 0, "y": -1, "w": -0.75})
    assert not sheet.is_explicit
    found = entry_exit(sheet, start={"y": -1})
    # w is an odd function of y on the branch, so the exit mirrors the entry.
    assert found.kind is ExitKind.ENTRY_EXIT
    assert found.point["y"] == pytest.approx(1, abs=1e-12)
    assert found.point["w"] == pytest.approx(-found.start["w"], abs=1e-12)


@pytest.mark.exhaustive
def test_the_rightmost_eigenvalue_counts_and_its_takeover_is_named() -> None:
    found = passage_of({x: y * x, w: (3 * y - 1) * w + x})
    # -1/2 + y^2/2 to the takeover at 1/2, then 3 y^2/2 - y.
    assert found.point["y"] == pytest.approx((1 + math.sqrt(2.5)) / 3, abs=1e-12)
    assert found.takeovers == pytest.approx((1.5,), abs=1e-5)
    measured = measure_delay(found, epsilon=0.01, radius=0.1)
    assert float(measured.exit) == pytest.approx(found.t, abs=0.02)


def test_losses_that_heal_again_are_passed() -> None:
    # int (s^3 - s)' ... the rate -1 + 3 cos^2-like: first rise too small to come back to 0.
    of = system({y: 1}, {x: -(y + 1) * (y - R(1, 5)) * (y - 2) * x * -1})
    found = entry_exit(branch(of), start={"y": -3})
    assert [loss.kind for loss in found.losses] == [LossKind.BRANCH_POINT] * len(found.losses)
    primitive = sp.integrate((y + 1) * (y - R(1, 5)) * (y - 2), y)
    assert float(primitive.subs(y, found.point["y"]) - primitive.subs(y, -3)) == pytest.approx(0, abs=1e-11)


# -- at a real loss an imperfection ends the delay ---------------------------------------------------


@pytest.mark.parametrize(
    ("fast", "kind", "outcome"),
    [
        (y * x - x**2 + eps, LossKind.TRANSCRITICAL, Outcome.EXCHANGE),
        (y * x + x**2 + eps, LossKind.TRANSCRITICAL, Outcome.ESCAPE),
        (y * x - x**2 - eps, LossKind.TRANSCRITICAL, Outcome.ESCAPE),
        (y * x - x**3 + eps, LossKind.PITCHFORK, Outcome.EXCHANGE),
        (y * x + x**3 - eps, LossKind.PITCHFORK, Outcome.ESCAPE),
        (y * x - x**3 + eps * y, LossKind.PITCHFORK, Outcome.EXCHANGE),
    ],
)
def test_an_imperfection_ends_the_stay_at_the_loss(fast, kind, outcome) -> None:
    found = passage_of({x: fast})
    assert found.kind is ExitKind.AT_LOSS
    assert not found.invariant
    assert (found.loss.kind, found.loss.outcome) == (kind, outcome)
    assert found.point["y"] == pytest.approx(0, abs=1e-12)
    assert "not invariant" in found.message


def test_the_transcritical_canard_value_is_one() -> None:
    # x = y^2-shifted invariant branches have lambda = 1; the residual sets the rest.
    assert passage_of({x: y * x + x**2}).loss.coefficients["lambda"] == 1
    assert passage_of({x: y * x + x**2 + eps / 2}).loss.coefficients["lambda"] == pytest.approx(2)


def test_the_side_of_a_pitchfork_counts_its_cubic_once_and_the_bending_of_the_rest() -> None:
    # w = 2 x^2 to leading order, so that x' = y x + (2 - 1) x^3: a sixth of g_yyy, and what w adds.
    loss = passage_of({x: y * x + x * w - x**3 + eps, w: 2 * x**2 - w}).loss
    assert loss.coefficients["p"] == pytest.approx(1, rel=1e-10)
    assert (loss.kind, loss.outcome) == (LossKind.PITCHFORK, Outcome.ESCAPE)


def test_a_transcritical_escape_is_at_the_zero_of_a_hermite_polynomial() -> None:
    # x = -epsilon v'/v makes epsilon x' = 2 t x + x^2 + 4 epsilon Hermite's equation: v = H_2(t/epsilon^(1/2)).
    loss = passage_of({x: 2 * y * x + x**2 + 4 * eps}).loss
    assert loss.coefficients["lambda"] == pytest.approx(5, rel=1e-12)
    assert loss.escape(0.01) - loss.t == pytest.approx(-math.sqrt(0.01 / 2), rel=1e-9)


@pytest.mark.exhaustive
def test_a_transcritical_escape_takes_the_time_of_the_parabolic_cylinder() -> None:
    found = passage_of({x: y * x + x**2 + eps / 2})
    # D_(1/2)(-sqrt(2) z) by mpmath, independently.
    zero = mp.findroot(lambda u: mp.pcfd(0.5, -mp.sqrt(2) * u), 0.5)
    assert first_zero(2.0) == pytest.approx(float(zero), abs=1e-10)
    errors = []
    for epsilon in (4e-4, 1e-4):
        expected = found.loss.escape(epsilon)
        measured = float(measure_delay(found, epsilon=epsilon, radius=0.5).exit)
        errors.append(abs(measured - expected) / math.sqrt(2 * epsilon))
    assert errors[1] < 0.03
    assert errors[0] / errors[1] == pytest.approx(2, abs=0.3)


def test_the_first_zero_is_that_of_a_hermite_polynomial_at_odd_integers() -> None:
    assert first_zero(3.0) == pytest.approx(0, abs=1e-12)
    assert first_zero(5.0) == pytest.approx(-math.sqrt(0.5), abs=1e-10)
    for beside in (1e-14, -1e-14, 1e-12, 1e-10):
        assert first_zero(5.0 + beside) == pytest.approx(-math.sqrt(0.5), abs=1e-10)
    assert first_zero(1.0) is None


# -- pairs: the buffer point -------------------------------------------------------------------------


@pytest.mark.exhaustive
def test_shishkovas_buffer_point_is_at_one() -> None:
    late = entry_exit(branch(SHISHKOVA), start={"t": -2})
    assert late.kind is ExitKind.BUFFER
    assert late.loss.kind is LossKind.HOPF
    assert late.point["t"] == pytest.approx(1, abs=1e-11)
    assert late.loss.turning_points[0].t == pytest.approx(2 - 1j, abs=1e-9)


@pytest.mark.exhaustive
def test_an_orbit_that_enters_after_the_mirrored_buffer_point_leaves_before_it() -> None:
    early = entry_exit(branch(SHISHKOVA), start={"t": -0.6})
    assert early.kind is ExitKind.ENTRY_EXIT
    assert early.point["t"] == pytest.approx(0.6, abs=1e-12)
    assert early.buffer == pytest.approx(1.6, abs=1e-11)


def test_without_forcing_there_is_no_buffer_point() -> None:
    found = entry_exit(branch(system({t: 1}, {x: t * x - y, y: x + t * y})), start={"t": -2})
    assert found.kind is ExitKind.ENTRY_EXIT
    assert found.point["t"] == pytest.approx(2, abs=1e-12)


def test_a_pole_of_the_critical_manifold_sets_the_buffer_point() -> None:
    # s' = 2, epsilon z' = (s + 3 i) z + s/4 - i/2: lambda = 0 at s = -3 i, where M0 has a pole, and
    # Re int lambda ds = (s**2 + 9)/2 from there, which equals 9 at s = 3.
    forced = branch(system({s: 2}, {x: s * x - 3 * y + s / 4, y: 3 * x + s * y - sp.Rational(1, 2)}))
    late = entry_exit(forced, start={"s": -5})
    assert late.kind is ExitKind.BUFFER
    assert late.point["s"] == pytest.approx(3, abs=1e-10)
    assert late.loss.turning_points[0].t == pytest.approx((5 - 3j) / 2, abs=1e-9)


CURVED = system(
    {t: 1 + t / 4, s: -s / 2},
    {
        x: (t + s * t / 3) * x - (1 + t / 3) * y - x * (x**2 + y**2) + eps * (1 + t / 2),
        y: (1 + t / 3) * x + (t + s * t / 3) * y - y * (x**2 + y**2),
    },
)
ZERO = gsp.Branch(CURVED, (x, y), {x: sp.Integer(0), y: sp.Integer(0)})


@pytest.mark.exhaustive
def test_an_implicit_branch_has_the_same_buffer_point() -> None:
    implicit = branch(CURVED, {"t": -1.8, "s": 1, "x": 0, "y": 0})
    assert not implicit.is_explicit
    exits = [entry_exit(each, start={"t": -1.8, "s": 1}).t for each in (implicit, ZERO)]
    assert exits[0] == pytest.approx(exits[1], abs=1e-10)


def test_the_buffer_point_agrees_with_an_independent_quadrature() -> None:
    found = entry_exit(ZERO, start={"t": -1.8, "s": 1})
    assert found.kind is ExitKind.BUFFER

    # With t as the variable: dt = (1 + t/4) d tau, s = ((1 + t/4)/(1 - 1.8/4))^-2.
    def rate(u):
        scale = ((1 + u / 4) / (1 - mp.mpf("0.45"))) ** -2
        return (u + scale * u / 3 + mp.j * (1 + u / 3)) / (1 + u / 4)

    turning = mp.findroot(rate, mp.mpc(0, -1))
    level = mp.re(mp.quad(rate, [0, turning]))
    exit = mp.findroot(lambda u: mp.re(mp.quad(rate, [0, u])) - level, 0.8)
    assert found.point["t"] == pytest.approx(float(exit), abs=1e-9)


@pytest.mark.exhaustive
def test_measured_exits_of_a_nonlinear_passage_tend_to_the_buffer_point() -> None:
    found = entry_exit(ZERO, start={"t": -1.8, "s": 1})
    gaps = [float(measure_delay(found, epsilon=e, radius=0.3).exit) - found.t for e in (0.05, 0.025)]
    assert abs(gaps[1]) < 0.05
    assert abs(gaps[1]) < 0.7 * abs(gaps[0])


@pytest.mark.exhaustive
def test_a_critical_manifold_that_folds_over_complex_time_sets_the_buffer_point() -> None:
    # FitzHugh and Nagumo's equations with a ramp: det g_y = 0 at v = i/2, I = 7/8 + i/12, a complex fold of M0.
    u, v, current = sp.symbols("u v I")
    ramp = system({current: 1}, {v: v - v**3 / 3 - u + current, u: R(1, 2) * (v + R(7, 10) - R(4, 5) * u)})
    sheet = branch(ramp, {"I": -0.2, "v": -1.3, "u": -0.76})
    found = entry_exit(sheet, start={"I": -0.2})
    assert found.kind is ExitKind.BUFFER
    turning = found.loss.turning_points[0].t - 0.2
    assert complex(turning.real, abs(turning.imag)) == pytest.approx(7 / 8 + 1j / 12, abs=1e-10)

    # On M0 with v as the variable, dI = (v^2 + 1/4) dv.
    def rate(q):
        trace, determinant = 1 - q**2 - mp.mpf("0.4"), (q**2 - 1) * mp.mpf("0.4") + mp.mpf("0.5")
        # The root that vanishes at i/2, and is continuous on the way there.
        return (trace - mp.sqrt(trace**2 - 4 * determinant)) / 2 * (q**2 + mp.mpf("0.25"))

    hopf = -mp.sqrt(mp.mpf("0.6"))
    level = mp.re(mp.quad(rate, [hopf, mp.mpc(0, 0.5)]))
    exit = mp.findroot(lambda q: mp.re(mp.quad(rate, [hopf, q])) - level, 0.03)
    assert found.point["v"] == pytest.approx(float(exit), abs=1e-8)
    run = follow(
        ramp,
        start=found.start,
        span=(0, 2),
        epsilon=0.004,
        digits=40,
        until=(v + R(7, 10) - R(4, 5) * u) ** 2 - R(1, 25),
        after=found.loss.t,
    )
    assert float(run.time) == pytest.approx(found.t, abs=0.06)


def test_a_pair_in_a_field_that_is_not_analytic_is_refused() -> None:
    of = system({t: 1}, {x: t * x - y + eps * sp.Abs(t), y: x + t * y + x * sp.Abs(t)})
    with pytest.raises(UnsupportedFunctionError, match="complex time"):
        entry_exit(branch(of), start={"t": -1})


# -- extended precision ------------------------------------------------------------------------------


def shishkova(time, epsilon):
    u = (time + mp.j) / mp.sqrt(2 * epsilon)
    return mp.sqrt(mp.pi * epsilon / 2) * mp.exp(u * u) * mp.erfc(-u)


def exit_of(epsilon: str) -> tuple[dict[str, str], str]:
    """The exact slow solution at t = -2, and the digits of the time when it first has modulus 1."""
    with mp.workdps(60):
        number = mp.mpf(epsilon)
        start = shishkova(mp.mpf(-2), number)
        time = mp.findroot(lambda u: abs(shishkova(u, number)) ** 2 - 1, 1.02)
        return {"t": "-2", "x": mp.nstr(start.real, 50), "y": mp.nstr(start.imag, 50)}, mp.nstr(time, 40)


@pytest.mark.exhaustive
def test_shishkovas_exit_at_a_twentieth_in_extended_precision() -> None:
    start, time = exit_of("0.05")
    orbit = follow(SHISHKOVA, start=start, span=(-2, 2), epsilon=R(1, 20), digits=30, until=x**2 + y**2 - 1)
    assert orbit.met
    assert abs(orbit.time - sp.Float(time, 40)) < sp.Float("1e-28")
    assert abs(orbit.time - sp.Float("1.02721300772750793745", 25)) < sp.Float("1e-19")


def test_an_orbit_is_the_same_with_more_digits() -> None:
    """On the way to t = 0 the last terms of a series are so small that their balls hold 0."""
    ends = [
        follow(SHISHKOVA, start={"t": -2, "x": 0, "y": 0}, span=(0, 2), epsilon="0.01", digits=digits).y[:, -1]
        for digits in (41, 80)
    ]
    assert ends[0] == pytest.approx(ends[1], rel=1e-12)


@pytest.mark.exhaustive
def test_double_precision_leaves_early_where_it_was_predicted_to() -> None:
    _, time = exit_of("0.01")
    found = entry_exit(branch(SHISHKOVA), start={"t": -2})
    assert found.warning(0.05) == ""
    assert "leaves early" in found.warning(0.01)
    measured = measure_delay(found, epsilon=0.01, radius=1)
    # Slow time counts from the entry at t = -2; the orbit from M0 forgets where it started to exp(-150).
    assert abs(measured.exit - 2 - sp.Float(time, 30)) < sp.Float("1e-18")
    earliest, latest = measured.expected_double_band
    assert earliest < measured.expected_double < latest < float(measured.exit)
    assert earliest < measured.double_exit < latest
    assert "expected to leave early, from 2.77" in str(measured)
    assert found.double_exit(0.01) == pytest.approx(2 + math.sqrt(2 * 0.01 * found.rounding), abs=1e-9)


def test_a_passage_that_takes_too_many_digits_is_refused_with_the_epsilon_that_is_not() -> None:
    found = entry_exit(branch(SHISHKOVA), start={"t": -2})
    # The deviation rises by 1/2 from the loss to the buffer point: exp(-1/(2 epsilon)).
    with pytest.raises(
        PassageError, match=r"takes 4363 digits, since .* exp\(-10000\); at most 2000"
    ) as caught:
        measure_delay(found, epsilon=5e-5, radius=1)
    least = float(re.search(r"an epsilon of (\S+) or more", str(caught.value))[1])
    assert 0.5 / least / math.log(10) + 20 <= 2000
    assert least < 1.05 * 0.5 / 1980 / math.log(10)


@pytest.mark.exhaustive
@pytest.mark.parametrize("method", [Method.RADAU9, Method.RADAU13])
def test_early_exits_of_runs_that_round_differently_lie_well_within_their_band(method: Method) -> None:
    # Starts moved by 1e-9 round differently all along, as another processor does.
    found = entry_exit(branch(SHISHKOVA), start={"t": -2})
    earliest, latest = found.double_exit_band(0.01)
    rng = np.random.default_rng(3)
    for _ in range(4):
        start = {name: value + 1e-9 * rng.normal() for name, value in found.start.items()}
        run = gsp.integrate(
            SHISHKOVA, start=start, span=(0, 3.5), epsilon=0.01, rtol=1e-12, atol=1e-300, method=method
        )
        # Not where a step happens to end.
        times = np.linspace(2, 3.5, 1501)
        places = dict(zip((state.name for state in run.flow.states), run.at(times)))
        exit = times[np.argmax(np.hypot(places["x"], places["y"]) >= 1)]
        # Rounding that is smaller by e leaves later by 0.01/2.9: a hundredth is a factor of 18.
        assert earliest + 0.01 < exit < latest - 0.01


@pytest.mark.exhaustive
def test_a_branch_at_zero_keeps_its_relative_precision_in_double() -> None:
    found = entry_exit(branch(system({y: 1}, {x: y * x - x**3})), start={"y": -0.7})
    measured = measure_delay(found, epsilon=0.004, radius=0.01)
    assert found.warning(0.004) == ""
    assert measured.double_exit == pytest.approx(float(measured.exit), abs=1e-5)


def test_a_run_along_a_branch_that_is_not_zero_leaves_with_its_deviation_from_it() -> None:
    """x = y + u with epsilon u' = y u - u^3, in doubles and in more digits."""
    of = system({y: 1}, {x: y * (x - y) - (x - y) ** 3 + eps})
    measured = measure_delay(
        entry_exit(branch(of, {"x": -0.7, "y": -0.7}), start={"y": -0.7}), epsilon=0.02, radius=0.01
    )
    assert measured.double_exit == pytest.approx(float(measured.exit), abs=1e-5)


@pytest.mark.parametrize("coefficients", [{}, {"q": 2.0}])
def test_a_loss_is_told_with_its_coefficients_where_it_has_any(coefficients: dict[str, float]) -> None:
    loss = PassedLoss(1.0, {"x": 0.5}, LossKind.TRANSCRITICAL, 0j, 1.0, Outcome.EXCHANGE, 0.0, coefficients)
    assert str(loss).endswith("exchange of stability" + (" (q = 2)" if coefficients else ""))


@pytest.mark.exhaustive
def test_extended_orbits_agree_with_an_exact_solution_to_all_digits() -> None:
    # epsilon y' = x y: y = exp((x^2 - 1)/(2 epsilon)).
    of = system({x: 1}, {y: x * y})
    orbit = follow(of, start={"x": -1, "y": 1}, span=(0, 1), epsilon=R(1, 100), digits=80)
    exact = sp.exp(-sp.Integer(50)).evalf(80)
    assert orbit.status is Status.SUCCESS
    assert abs(orbit.end["y"] / exact - 1) < sp.Float("1e-50")
    back = follow(of, start=orbit.end, span=(1, 0), epsilon=R(1, 100), digits=80)
    assert abs(back.end["y"] - 1) < sp.Float("1e-50")


def test_elementary_functions_are_followed_too() -> None:
    # y = sin(x) solves epsilon y' = epsilon cos(x) + sin(x) - y.
    of = system({x: 1}, {y: eps * sp.cos(x) + sp.sin(x) - y})
    orbit = follow(
        of, start={"x": 0, "y": 0}, span=(0, 2), epsilon=0.05, digits=40, watch={"gap": y - sp.sin(x)}
    )
    assert abs(orbit.end["y"] - sp.sin(2).evalf(45)) < sp.Float("1e-38")
    assert np.abs(orbit["gap"]).max() < 1e-38


# -- bad input ---------------------------------------------------------------------------------------


def test_calls_that_cannot_be_carried_out_are_refused_by_name() -> None:
    plain = branch(system({y: 1}, {x: y * x}))
    with pytest.raises(PassageError, match="does not attract at the start"):
        entry_exit(plain, start={"y": 0.5})
    with pytest.raises(DeclarationError, match="takes y"):
        entry_exit(plain, start={"z": -1})
    with pytest.raises(PassageError, match="stands still"):
        entry_exit(branch(system({y: y + 1}, {x: y * x})), start={"y": -1})
    with pytest.raises(PassageError, match="fold_passage"):
        entry_exit(branch(NORMAL, {"x": -1, "y": -1}), start={"y": -1})
    with pytest.raises(DeclarationError, match="no state"):
        follow(NORMAL, start={"x": -1, "y": -1}, span=(0, 1), epsilon=0.1, until=z - 1)


def test_a_passage_without_exit_says_why() -> None:
    of = branch(system({y: 1}, {x: y * x}))
    short = entry_exit(of, start={"y": -1}, longest=0.5)
    assert short.kind is ExitKind.NONE
    assert "no loss of stability was met" in short.message
    bounded = entry_exit(of, start={"y": -1}, region={"y": (-2, 0.5)})
    assert bounded.status is Status.REGION_LEFT
    with pytest.raises(PassageError, match="nothing to measure"):
        measure_delay(bounded, epsilon=0.1, radius=0.1)


def test_the_cards_are_short_and_name_what_matters() -> None:
    passage = fold_passage(VAN_DER_POL, {"x": 1, "y": -2 / 3})
    assert "epsilon ln epsilon" in str(passage)
    assert "attracting sheet" in str(passage)
    assert len(repr(passage).splitlines()) == 1
    found = entry_exit(branch(SHISHKOVA), start={"t": -2})
    assert "buffer point at t = 3" in str(found)
    assert len(repr(found).splitlines()) == 1


# -- charts ------------------------------------------------------------------------------------------


def test_the_charts_draw_what_was_measured() -> None:
    from gsp import charts

    passage = fold_passage(VAN_DER_POL, {"x": 1, "y": -2 / 3})
    exits = [fold_exit(passage, epsilon=e) for e in (0.1, 0.03, 0.01)]
    axes = charts.fold_passage(passage, exits=exits)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("$y$", "$x$")
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    assert {"fold", "landing point", "$M_0$, attracting", "$M_0$, repelling"} <= set(labels)
    assert len(axes.child_axes) == 1
    found = entry_exit(branch(system({y: 1}, {x: y * (x - 1 - y**2) + 2 * eps * y})), start={"y": -0.7})
    drawn = charts.delayed_exit(measure_delay(found, epsilon=0.004, radius=0.01))
    labels = [text.get_text() for text in drawn.get_legend().get_texts()]
    assert {"double precision", "way in, way out", "from rounding"} <= set(labels)
    assert drawn.get_yscale() == "log"
    assert charts.png(axes)[:4] == charts.png(drawn)[:4] == b"\x89PNG"
    two = fold_passage(TWO_AND_TWO, dict.fromkeys("xyzw", 0))
    assert charts.fold_passage(two, exits=[fold_exit(two, epsilon=0.01, section={"x": 0.5})]).lines


@pytest.mark.exhaustive
def test_a_passage_without_an_exit_says_why() -> None:
    found = entry_exit(branch(system({y: 1}, {x: x * (y + x)})), start={"y": -1})
    outside = measure_delay(found, epsilon=0.05, radius=0.1, start={"y": -1, "x": 2})
    assert outside.exit is None
    assert "outside the branch's basin" in outside.why
    assert "outside the branch's basin" in outside.double_why
    assert "no early exit expected" in str(outside)
    bounded = entry_exit(branch(system({y: 1}, {x: y * x - x**3})), start={"y": -1})
    small = measure_delay(bounded, epsilon=0.05, radius=3)
    assert small.exit is None
    assert "never reaches the radius" in small.why
    assert "never reaches the radius" in str(small)
    assert measure_delay(bounded, epsilon=0.05, radius=0.3).why == ""


def test_without_a_loss_the_remedy_is_that_of_the_passage() -> None:
    found = entry_exit(branch(system({y: -y}, {x: y - x})), start={"y": 1}, longest=5)
    assert "raise longest" in found.message
    assert "max_steps" not in found.message


def test_fast_variables_that_do_not_move_one_another_leave_each_for_itself() -> None:
    """x leaves at 1 and w at 3/2; moved by x, w has the size of exp of the integral of the rightmost eigenvalue."""
    grows = 2 * y - sp.Rational(1, 2)
    with pytest.raises(PassageError, match=r"the others do not move \(x; w\)"):
        passage_of({x: y * x, w: grows * w})
    # Phi: -1/2 up to 0, 1/8 more up to 1/2, where w takes over, and y^2 - y/2 from there.
    found = passage_of({x: y * x, w: grows * w + x})
    assert found.point["y"] == pytest.approx((1 + np.sqrt(7)) / 4, abs=1e-9)
    assert passage_of({x: y * x, w: -w - 3 * w * y**2}).point["y"] == pytest.approx(1.0, abs=1e-9)


def test_an_eigenvalue_that_rises_without_speed_is_no_pitchfork() -> None:
    for power in (3, 5):
        with pytest.raises(PassageError, match="with no speed, to a higher order"):
            passage_of({x: y**power * x + eps})
        found = passage_of({x: y**power * x - x**3})
        assert found.losses[0].kind is LossKind.DEGENERATE
        assert found.losses[0].point["y"] == pytest.approx(0.0, abs=1e-3)
        assert found.point["y"] == pytest.approx(1.0, abs=1e-9)
    assert passage_of({x: y * x / 1000 - x**3}).losses[0].kind is LossKind.PITCHFORK


# x and w turn around each other, and their real part is y.
PAIR = {x: y * x - w, w: x + y * w}


@pytest.mark.parametrize(
    ("rate", "kind"),
    [
        ((y - R(1, 2)) * z - z**3 + eps, LossKind.PITCHFORK),
        ((y - R(1, 2)) * z + z**3 + eps, LossKind.PITCHFORK),
        ((y - R(1, 2)) * z + z**2 + eps / 4, LossKind.TRANSCRITICAL),
    ],
)
def test_a_real_loss_during_the_delay_of_a_pair_ends_it(rate: sp.Expr, kind: LossKind) -> None:
    for fast in ({z: rate, **PAIR}, {**PAIR, z: rate}):
        found = passage_of(fast)
        assert [loss.kind for loss in found.losses] == [LossKind.HOPF, kind]
        assert found.kind is ExitKind.AT_LOSS
        assert found.point["y"] == pytest.approx(0.5)
        assert found.buffer is None
    # z goes to the branch that begins at the loss, or away: at y = 0.7 it is not 0.
    e = 1e-3
    run = gsp.integrate(
        system({y: 1}, {z: rate}),
        start={"y": -1, "z": 0},
        span=(0, 1.7),
        epsilon=e,
        events=Event(z - R(3, 10), name="left"),
    )
    assert 1.5 < run.events["left"].times[0] < 1.7
    # On an invariant branch only the rightmost counts.
    assert passage_of({z: rate - rate.coeff(eps) * eps, **PAIR}).point["y"] == pytest.approx(1.0)


@pytest.mark.parametrize("fastest", [1, 10**5, 10**8])
def test_a_loss_keeps_its_name_beside_directions_that_contract_much_faster(fastest: int) -> None:
    assert passage_of({**PAIR, z: -fastest * z}).loss.kind is LossKind.HOPF
    assert passage_of({z: y * z - z**3 + eps, x: -fastest * x, w: -w}).loss.kind is LossKind.PITCHFORK


def test_losses_that_are_met_together_decide_nothing_but_on_an_invariant_branch() -> None:
    for fast in ({z: y * z - z**3 + eps, **PAIR}, {**PAIR, z: y * z - z**3 + eps}):
        with pytest.raises(PassageError, match="several eigenvalues rise through 0 together near y = 0"):
            passage_of(fast)
    found = passage_of({z: y * z - z**3, **PAIR})
    assert found.losses[0].kind is LossKind.DEGENERATE
    assert found.point["y"] == pytest.approx(1.0)
