"""`certify` against closed forms: what is proved is true, what is refuted is false, and what it cannot tell it says."""

import math
import random
import re
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import BranchError, GspError, UnsupportedFunctionError
from gsp.proofs import certification as module
from gsp.proofs import refutation
from gsp.proofs.verdict import ProofVerdict
from gsp.proofs.verification import verify
from gsp.slow_tubes.certify import certify
from tests.cases import thinned

x, y, z, w, c, eps = sp.symbols("x y z w c epsilon")
PROVED, REFUTED, UNDECIDED = ProofVerdict.PROVED, ProofVerdict.REFUTED, ProofVerdict.UNDECIDED


def branch(g: dict, *, parameters: dict | None = None, slow: dict | None = None, through: dict | None = None):
    """The first branch of a system, or that nearest to a point."""
    system = gsp.SlowFastSystem(
        slow=slow or {x: sp.Integer(1)}, fast=g, epsilon=eps, parameters=parameters or {}
    )
    branches = gsp.solve_critical(system).branches
    return branches[0].through(through) if through else branches[0]


def van_der_pol():
    return branch({y: x - y**3 / 3 + y}, through={"x": 1.0, "y": 2.1})


# -- the figures that were promised, in boxes -----------------------------------


@pytest.mark.exhaustive
@pytest.mark.parametrize("distance", [1e-2, 1e-6, 1e-12])
def test_van_der_pol_is_proved_up_to_its_fold(distance: float) -> None:
    low = -2 / 3 + distance
    found = certify(van_der_pol(), region={"x": (low, 2.0)})
    assert found.verdict is PROVED
    assert found.kind == "attracting"
    # On the branch the eigenvalue is 1 - y^2, in absolute value least at the fold's end: about 2 sqrt(distance).
    heights = [r.real for r in np.roots([-1 / 3, 0, 1, low]) if abs(r.imag) < 1e-9 and r.real > 1]
    assert 0.4 * (max(heights) ** 2 - 1) < found.gap <= 1.001 * (max(heights) ** 2 - 1) + 1e-9
    assert found.tried < 120


def test_a_law_of_friction_is_proved_far_along_its_tail(tmp_path) -> None:
    found = certify(
        branch({y: x - y / sp.sqrt(1 + y**2)}, through={"x": 0.0, "y": 0.0}), region={"x": (-0.99, 0.99)}
    )
    assert found.verdict is PROVED
    # The slope is (1 - x^2)^(3/2) on the branch.
    assert 0.4 * (1 - 0.99**2) ** 1.5 < found.gap <= (1 - 0.99**2) ** 1.5
    # 460 boxes with the product rule's slope.
    assert found.tried < 120
    found.save(tmp_path / "proof.json")
    assert verify(tmp_path / "proof.json").gap >= found.gap / 2


def test_a_box_with_the_fold_is_refuted_with_the_fold_as_witness() -> None:
    found = certify(van_der_pol(), region={"x": (-1.0, 2.0)})
    assert found.verdict is REFUTED
    assert found.witness is not None
    assert found.witness.kind == "fold"
    for name, value in (("x", Fraction(-2, 3)), ("y", 1)):
        low, high = found.witness.box[name]
        assert Fraction(low) <= value <= Fraction(high)
        assert high - low < 1e-9
    told = {name: float(value) for name, value in re.findall(r"(\w) = ([-\d.e]+)", found.witness.statement)}
    assert told == pytest.approx({"x": -2 / 3, "y": 1}, abs=1e-9)


def test_each_box_has_its_own_gap_and_the_least_is_that_of_all() -> None:
    # The eigenvalue is -1 - x^2.
    found = certify(branch({y: x - (1 + x**2) * y}), region={"x": (0.5, 4.0)})
    assert len(found.gaps) == len(found.boxes) > 1
    for box, gap in zip(found.boxes, found.gaps):
        low = box[0][0]
        assert 1.0 < gap <= 1 + low**2
    assert max(found.gaps) > 4 * min(found.gaps)
    assert min(found.gaps) == found.gap


def test_a_loss_between_all_samples_is_refuted() -> None:
    # "attracting, gap 0.5" at 257 points; the eigenvalue at 0.3086 is 0.1.
    rate = sp.Rational(3, 2) + x - (sp.Rational(8, 5) + x) / (1 + ((x - sp.Rational(3086, 10000)) * 500) ** 2)
    found = certify(branch({y: -rate * y}), region={"x": (-1, 1)})
    assert found.verdict is REFUTED
    assert found.witness is not None
    low, high = found.witness.box["x"]
    assert 0.30 < low < high < 0.32


def test_a_loss_between_samples_that_fades_exponentially_is_refuted() -> None:
    # Taken for 1/exp(u^2), exp(-u^2) has no finite enclosure a little away from u = 0.
    rate = 1 - sp.Rational(11, 10) * sp.exp(-(((x - sp.Rational(3086, 10000)) * 2000) ** 2))
    found = certify(branch({y: -rate * y}), region={"x": (-1, 1)})
    assert found.verdict is REFUTED
    assert found.tried < 200


@pytest.mark.parametrize("width", thinned([10.0**-k for k in range(1, 13)], 3))
def test_a_sliver_of_any_width_is_never_called_proved(width: float) -> None:
    place, size = sp.Rational(3086, 10000), sp.Rational(Fraction(width))
    rate = 1 - sp.Rational(11, 10) / (1 + ((x - place) / size) ** 2)
    found = certify(branch({y: -rate * y}), region={"x": (-1, 1)}, most_boxes=3000)
    assert found.verdict is not PROVED
    if found.verdict is UNDECIDED:
        assert any(low <= 0.3086 <= high for ((low, high),) in found.undecided)


def test_another_branch_behind_a_fold_is_not_taken_for_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    glued = []
    original = module.glue

    def counted(*arguments):
        glued.append(original(*arguments))
        return glued[-1]

    monkeypatch.setattr(module, "glue", counted)
    k, lam, a, v = sp.Integer(-10), sp.Integer(-7), sp.Symbol("a"), sp.Symbol("v")
    koper = branch(
        {v: k * a - v**3 + 3 * v - lam},
        slow={a: v},
        through={"a": 0.2, "v": 2.2},
    )
    found = certify(koper, region={"a": (0.2, 1.2)})
    assert found.verdict is REFUTED
    assert found.witness is not None
    low, high = found.witness.box["a"]
    # The fold: -10 a - 1 + 3 + 7 = 0 at v = 1.
    assert low <= 0.9 <= high or math.isclose(low, 0.9, abs_tol=1e-9)


# -- ten systems with closed forms ----------------------------------------------


def systems():
    """(branch, span of the box, truth): truth(low, high) is True, False, or None too near the border to be asked."""

    def border(value: float) -> bool | None:
        return None if abs(value) < 1e-12 else value > 0

    def all_of(*values: float) -> bool | None:
        signs = [border(v) for v in values]
        return False if False in signs else None if None in signs else True

    def without(*zeros: float):
        def truth(low: float, high: float) -> bool | None:
            return all_of(*(max(zero - high, low - zero) for zero in zeros))

        return truth

    root2 = math.sqrt(2.0)
    return {
        "fold": (van_der_pol(), (-1.2, 2.0), lambda low, high: border(low + 2 / 3)),
        "linear": (branch({y: x - 2 * y}), (-3, 3), lambda low, high: True),
        "type": (branch({y: (x - sp.Rational(1, 3)) * y}), (-1, 1), without(1 / 3)),
        "twice": (branch({y: (x**2 - 2) * y}), (-2, 2), without(root2, -root2)),
        "sine": (branch({y: sp.sin(x) * y}), (-4, 4), without(-math.pi, 0.0, math.pi)),
        "exponential": (branch({y: (sp.exp(x) - 2) * y}), (-1, 2), without(math.log(2))),
        "hopf": (branch({y: x * y - z, z: y + x * z}), (-1, 1), without(0.0)),
        "saddle": (branch({y: x * y / 2 + y, z: -z + x**2}), (-3, 1), without(-2.0)),
        "tanh": (branch({y: sp.tanh(x - 1) - y}), (-3, 3), lambda low, high: True),
        "root": (branch({y: (sp.sqrt(x + 4) - 2) * y}), (-3, 3), without(0.0)),
    }


@pytest.mark.exhaustive
def test_thousands_of_random_boxes_agree_with_closed_forms() -> None:
    draw = random.Random(7)
    counts = dict.fromkeys(("proved", "refuted", "undecided"), 0)
    every = list(systems().items())
    for i in range(2_000):
        name, (found_branch, (first, last), truth) = every[i % len(every)]
        centre = draw.uniform(first, last)
        width = (last - first) * 10.0 ** draw.uniform(-6, 0)
        low, high = max(first, centre - width), min(last, centre + width)
        if name == "fold":
            high = last
        known = truth(low, high)
        try:
            found = certify(found_branch, region={"x": (low, high)}, most_boxes=150)
        except GspError:
            # The branch has no point over this box, or none that belongs to it.
            assert name == "fold"
            continue
        counts[found.verdict.value] += 1
        if known is not None:
            assert found.verdict is not (REFUTED if known else PROVED), (name, low, high)
    assert counts["proved"] > 1700
    assert counts["refuted"] > 200
    assert counts["undecided"] < 20


# -- what is proved about what -------------------------------------------------


def test_a_fold_on_another_sheet_is_no_witness() -> None:
    # y = -2 is regular everywhere; the fold at (0, 0) is on another sheet.
    system = gsp.SlowFastSystem(slow={x: sp.Integer(1)}, fast={y: (y**2 - x) * (y + 2)}, epsilon=eps)
    flat = next(b for b in gsp.solve_critical(system).branches if b.graph == {y: -2})
    found = certify(flat, region={"x": (-1.0, 3.0)})
    assert found.verdict is PROVED
    assert found.kind == "repelling"


@pytest.mark.parametrize("more", [False, True], ids=["one slow variable", "two"])
def test_a_sheet_that_ends_beside_one_that_does_not_is_refuted(more: bool) -> None:
    """The boxes hold the sheet near y = 3 alone, and nothing is undecided over them."""
    z = sp.Symbol("z")
    rate = -((y**2 + x + 1 + (z / 10 if more else 0)) * (y - 3) + sp.Rational(1, 10))
    system = gsp.SlowFastSystem(slow={x: 1} | ({z: 1} if more else {}), fast={y: rate}, epsilon=eps)
    region = {"x": (-2, 2)} | ({"z": (-1, 1)} if more else {})
    start = {"x": -1.9, "y": 0.96} | ({"z": 0} if more else {})
    found = certify(gsp.solve_critical(system).nearest(start), region=region)
    assert found.verdict is ProofVerdict.REFUTED
    assert found.witness is not None
    assert found.witness.kind == "fold"
    at = {s: np.mean(found.witness.box[s.name]) for s in system.states if s.name in found.witness.box}
    assert float(rate.diff(y).subs(at)) == pytest.approx(0.0, abs=1e-5)


def test_a_sheet_among_several_within_the_bounds_is_that_of_the_seed() -> None:
    region = {"x": (-0.5, 0.5), "y": (-3.0, 3.0)}
    found = certify(van_der_pol(), region=region)
    assert (found.verdict, found.kind) == (PROVED, "attracting")
    whole = branch({y: x - y**3 / 3 + y})
    assert whole.seed is None
    with pytest.raises(BranchError, match="3 sheets within the bounds on y"):
        certify(whole, region=region)
    assert certify(whole, region={**region, "y": (1.2, 3.0)}).verdict is PROVED


@pytest.mark.exhaustive
def test_a_branch_that_is_real_in_a_part_of_the_region_is_found_there() -> None:
    # y = -sqrt(x - 13): over the middle of the region, x = 12, there is no point.
    found = certify(branch({y: x - 13 - y**2}), region={"x": (10.0, 14.0), "y": (-3.0, -0.25)})
    assert found.verdict is REFUTED
    assert found.witness is not None
    low, high = found.witness.box["x"]
    assert Fraction(low) <= 13 <= Fraction(high)


@pytest.mark.exhaustive
def test_a_change_of_type_outside_the_bounds_on_y_is_none_of_the_region() -> None:
    # y = x loses its stability where it crosses y = 1/4, below the bounds.
    line = branch({y: (x - y) * (y - sp.Rational(1, 4))})
    region = {"x": (-1.0, 1.0), "y": (0.3, 1.0)}
    assert line.graph == {y: x}
    assert certify(line, region={"x": region["x"]}).verdict is REFUTED
    found = certify(line, region=region)
    assert found.verdict is UNDECIDED
    assert found.witness is None
    assert "0.25 only, which is not in the region" in found.reason
    assert gsp.classify(line, region=region, prove=True).kind == "attracting"
    assert certify(line, region={**region, "x": (0.3, 1.0)}).verdict is PROVED


@pytest.mark.exhaustive
def test_a_fold_outside_the_bounds_on_y_is_told_as_the_end_of_the_sheet() -> None:
    region = {"x": (-1.0, 3.0), "y": (1.5, 2.5)}
    found = certify(van_der_pol(), region=region)
    assert found.verdict is REFUTED
    assert found.witness is not None
    assert "outside the bounds on the fast variables: over slow values beyond it" in found.witness.statement
    assert "outside" not in str(certify(van_der_pol(), region={"x": region["x"]}))


def test_a_pole_at_which_the_eigenvalue_changes_its_sign_is_no_change_of_type() -> None:
    found = certify(branch({y: -y / (x - sp.Rational(1, 3))}), region={"x": (-1.0, 1.0)})
    assert found.verdict is UNDECIDED
    assert "pole" in found.reason
    assert "x in [" in found.reason


@pytest.mark.exhaustive
@pytest.mark.parametrize("rate", [sp.log(x), sp.sqrt(x), 1 / x])
def test_poles_and_branch_points_are_named_with_where(rate: sp.Expr) -> None:
    found = certify(branch({y: -(2 + sp.sin(rate)) * y}), region={"x": (0, 1)})
    assert found.verdict is UNDECIDED
    assert "pole or a branch point" in found.reason
    assert "x in [0, " in found.reason


@pytest.mark.exhaustive
def test_parameters_may_be_intervals() -> None:
    found = certify(branch({y: x - c * y}, parameters={c: 1}), region={"x": (0, 1), "c": (0.5, 2.0)})
    assert found.verdict is PROVED
    assert 0.499999 < found.gap <= 0.5
    assert (
        certify(
            branch({y: x - c * y}, parameters={c: 1}), region={"x": (0, 1), "c": (-0.5, 2.0)}, most_boxes=200
        ).verdict
        is not PROVED
    )


def test_ends_that_are_no_doubles_are_rounded_outwards_and_witnesses_are_inside() -> None:
    third = Fraction(1, 3)
    found = certify(branch({y: (x - sp.Rational(1, 3)) * y}), region={"x": (third, 1)})
    assert Fraction(found.region["x"][0]) <= third
    assert found.verdict is UNDECIDED
    assert (
        certify(branch({y: (x - sp.Rational(1, 3)) * y}), region={"x": (third - Fraction(1, 100), 1)}).verdict
        is REFUTED
    )


@pytest.mark.exhaustive
def test_the_normal_rate_has_to_dominate_where_epsilon_is_given() -> None:
    slow = {x: -10 * x}
    found = certify(branch({y: x - y}, slow=slow), region={"x": (0, 1)}, epsilon=0.05)
    assert found.verdict is PROVED
    assert found.rate_ratio == pytest.approx(2.0)
    assert Fraction(found.rate_ratio) <= Fraction(1) / (Fraction(0.05) * 10)
    undecided = certify(branch({y: x - y}, slow=slow), region={"x": (0, 1)}, epsilon=0.2)
    assert undecided.verdict is UNDECIDED
    assert "r >= 1" in undecided.reason


@pytest.mark.parametrize("unit", [1, 1000, sp.Rational(1, 10**6)])
def test_the_rate_along_a_damped_oscillation_is_its_damping_in_any_units(unit) -> None:
    u = sp.Symbol("u")
    slow = {x: unit * u - x / 2, u: -x / unit - u / 2}
    found = certify(branch({y: x - y}, slow=slow), region={"x": (-unit, unit), "u": (-1, 1)}, epsilon=1)
    assert found.verdict is PROVED
    assert 0.5 <= found.tangential <= 0.5 * (1 + 1e-6)


# -- budgets, interrupts, bad input ---------------------------------------------


def test_plain_values_are_those_that_are_proved_and_none_where_there_are_none() -> None:
    # x' = -x and y' = (2 x - 4 y)/epsilon: the rates are 1 and 4/epsilon.
    proved = certify(branch({y: 2 * x - 4 * y}, slow={x: -x}), region={"x": (0, 1)}, epsilon=0.125).as_dict()
    assert proved["gap"] == pytest.approx(4, rel=1e-12)
    assert proved["rate_ratio"] == pytest.approx(32, rel=1e-9)
    without = certify(branch({y: 2 * x - 4 * y}, slow={x: -x}), region={"x": (0, 1)}).as_dict()
    assert (without["gap"], without["rate_ratio"]) == (proved["gap"], None)


def test_a_budget_that_ends_leaves_what_was_proved() -> None:
    found = certify(van_der_pol(), region={"x": (-2 / 3 + 1e-9, 2.0)}, most_boxes=7)
    assert found.verdict is UNDECIDED
    assert found.tried == 7
    assert "budget of 7 boxes" in found.reason
    left = sum(high - low for ((low, high),) in found.undecided)
    assert 0.0 < found.undecided_volume == pytest.approx(left / (8 / 3 - 1e-9), rel=1e-12)
    assert found.undecided_volume < 0.5
    assert found.boxes


@pytest.mark.parametrize("stage", ["cover", "glue"])
def test_ctrl_c_returns_what_is_proved_by_then(stage: str, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0

    def stop(*_: object) -> list:
        nonlocal calls
        calls += 1
        if stage == "glue" or calls == 2:
            raise KeyboardInterrupt
        return []

    if stage == "glue":
        monkeypatch.setattr(module, "glue", stop)
    found = certify(
        van_der_pol(), region={"x": (-2 / 3 + 1e-3, 2.0)}, progress=stop if stage == "cover" else None
    )
    assert found.verdict is UNDECIDED
    assert "interrupted" in found.reason
    assert found.boxes


def test_functions_without_an_enclosure_are_refused_by_name() -> None:
    with pytest.raises(UnsupportedFunctionError, match="erf"):
        certify(branch({y: -(2 + sp.erf(x)) * y}), region={"x": (0, 1)})


@pytest.mark.exhaustive
@pytest.mark.parametrize("region", [(-1, 1), (-0.5, 1)])
def test_a_branch_that_is_symmetric_about_the_middle_is_cut_across_its_symmetry(region: tuple) -> None:
    """The Jacobian of an odd branch is the same at both ends of a box about zero, and another in its middle."""
    odd = branch({y: z - (1 + x**2 / 2) * y - y**3}, slow={x: y, z: 1})
    found = certify(odd, region={"x": (-1, 1), "z": region}, most_boxes=300)
    assert found.verdict is PROVED
    assert float(found.gap) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    "g",
    [
        {y: x * y - z, z: y + x * z + x**2},
        {y: x * y * (1 + y)},
        {y: x * (y - x), z: -z},
    ],
)
def test_a_loss_in_the_middle_of_the_region_is_refuted_in_few_boxes(g: dict) -> None:
    """From the middle itself no change of type is told; boxes that end at 0 were halved to the least double."""
    found = certify(branch(g), region={"x": (-1, 1)})
    assert found.verdict is REFUTED
    assert found.witness is not None
    low, high = found.witness.box["x"]
    assert low <= 0 <= high
    assert found.tried < 100


def test_a_branch_that_is_a_centre_everywhere_is_cut_into_parts_of_its_region_only() -> None:
    found = certify(branch({y: -z, z: y + x**2}), region={"x": (-1, 1)})
    assert found.verdict is UNDECIDED
    assert found.tried < 300


@pytest.mark.exhaustive
@pytest.mark.parametrize("power", [1, 2])
@pytest.mark.parametrize("width", [sp.Rational(1, 10**5), sp.Rational(1, 250000000)])
def test_a_sliver_beyond_doubles_is_refuted(power: int, width: sp.Rational) -> None:
    # sinh and cosh overflow all over, and their quotient with them; |y - x/2| grows where A/cosh > c.
    rate, place = sp.Rational(263, 100), sp.Rational(7809957, 25000000)
    dip = sp.Rational(3, 2) * rate / sp.cosh((x - place) / width) ** power
    sliver = branch({y: (dip - rate) * (y - x / 2)})
    found = certify(sliver, region={"x": (0, 1)}, most_boxes=100)
    assert found.verdict is REFUTED
    assert found.witness is not None
    low, high = found.witness.box["x"]
    ends = [place + side * width * sp.acosh(sp.Rational(3, 2) ** sp.Rational(1, power)) for side in (-1, 1)]
    assert any(low <= float(end) + 1e-15 and float(end) - 1e-15 <= high for end in ends)
    # A lesser dip is no loss.
    harmless = branch({y: (dip / 2 - rate) * (y - x / 2)})
    kept = certify(harmless, region={"x": (0, 1)}, most_boxes=400)
    assert kept.verdict is PROVED
    assert 0.9 * 0.25 * 2.63 < kept.gap <= 0.25 * 2.63


@pytest.mark.exhaustive
def test_overflow_is_no_missing_point(monkeypatch: pytest.MonkeyPatch) -> None:
    # The derivative by x is inf/inf in doubles; balls are too wide to decide.
    monkeypatch.setattr(refutation, "LINE_BOXES", 10)
    u = 250000000 * (x - sp.Rational(1, 3))
    steep = 1 / (sp.exp(u) + sp.exp(-u) + sp.exp(-2 * u))
    found = certify(branch({y: (steep - 2) * (y - x / 2)}), region={"x": (0, 1)}, most_boxes=10)
    assert found.verdict is UNDECIDED
    # Of two exponentials that are reciprocals the sum is a cosh.
    decided = certify(branch({y: (2 / (sp.exp(u) + sp.exp(-u)) - 2) * (y - x / 2)}), region={"x": (0, 1)})
    assert decided.verdict is PROVED
    assert 0.99 < decided.gap <= 1.0


@pytest.mark.exhaustive
@pytest.mark.parametrize("steepness", [10**4, 250000000])
def test_a_steep_gate_is_decided(steepness: int) -> None:
    gate = 1 / (1 + sp.exp(-steepness * (x - sp.Rational(1, 3))))
    proved = certify(branch({y: (gate - 2) * (y - x / 2)}), region={"x": (0, 1)}, most_boxes=200)
    assert proved.verdict is PROVED
    assert 0.99 < proved.gap <= 1.0
    # gate (1 - gate) is 1/4 at most, and nearly 0 all over.
    for depth, verdict in ((3, PROVED), (5, REFUTED)):
        found = certify(branch({y: (depth * gate * (1 - gate) - 1) * y}), region={"x": (0, 1)}, most_boxes=400)
        assert found.verdict is verdict
