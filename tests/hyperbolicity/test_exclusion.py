"""Between the samples: losses are found there, or the verdict says that they are not excluded."""

from __future__ import annotations

import random
from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.algebra.precision import precision
from gsp.errors import UnsupportedFunctionError
from gsp.hyperbolicity.exclusion import LONGER, MOST, Exclusion
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, Kind, classify
from gsp.proofs import balls
from gsp.proofs.covering import cover
from gsp.proofs.equations import EnclosedEquations
from gsp.readers.loading import load
from gsp.scenes.study import study_of
from tests.literature import FOLDER

x, y, z, w, u, eps = sp.symbols("x y z w u epsilon")
SLOW = (x, z, w)
Q = sp.Rational


def judge(
    g: dict, slow: tuple[sp.Symbol, ...] = (x,), *, through: dict | None = None, region: dict | None = None
):
    system = gsp.SlowFastSystem(slow=dict.fromkeys(slow, sp.Integer(1)), fast=g, epsilon=eps)
    branch = gsp.solve_critical(system).branches[0]
    if through:
        branch = branch.through(through)
    return classify(branch, region=region or {s.name: (-1, 1) for s in slow})


def is_told(found: Hyperbolicity, place: dict[str, float]) -> bool:
    """Whether the verdict is that a loss is there, or says that one at `place` is not excluded."""
    if found.kind is Kind.LOST:
        return not found.holds
    assert found.exclusion is not None
    told = any(all(low <= place[n] <= high for n, (low, high) in box.items()) for box in found.exclusion.left)
    return told and "not excluded" in found.evidence and not found.holds


def test_a_dip_between_all_samples_is_found() -> None:
    rate = Q(3, 2) + x - (Q(8, 5) + x) / (1 + ((x - Q(3086, 10000)) * 500) ** 2)
    found = judge({y: -rate * y})
    assert found.kind is Kind.LOST
    assert not found.holds
    zeros = np.array(sp.Poly(sp.numer(sp.together(rate)), x).nroots(n=20), dtype=complex)
    known = sorted(zero.real for zero in zeros if abs(zero.imag) < 1e-12 and abs(zero.real) < 1)
    assert sorted(loss.point["x"] for loss in found.losses) == pytest.approx(known, abs=1e-9)


@pytest.mark.exhaustive
@pytest.mark.parametrize("slow", [1, 2, 3])
@pytest.mark.parametrize("seed", range(12))
def test_random_dips_are_found_or_not_excluded(slow: int, seed: int) -> None:
    draw = random.Random(100 * slow + seed)
    names = SLOW[:slow]
    place = [Fraction(draw.randint(-900, 900), 1000) for _ in names]
    width = Q(Fraction(2.0 * 10.0 ** draw.uniform(-3, -1)))
    # Every dip crosses zero: its depth is 1.1 below a rate of 1 to 3.
    along = sum(Q(draw.randint(0, 5), 10) * (s + 1) for s in names[: draw.randint(0, slow)])
    squares = sum(((s - Q(p)) / width) ** 2 for s, p in zip(names, place))
    shape = draw.choice([1 / (1 + squares), sp.exp(-squares)])
    rate = 1 + along - (Q(11, 10) + along) * shape
    found = judge({y: -rate * y}, names)
    assert is_told(found, {s.name: float(p) for s, p in zip(names, place)}), (found, rate)


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(6))
def test_ridges_in_any_direction_are_found_or_not_excluded(seed: int) -> None:
    draw = random.Random(seed)
    direction = [Q(draw.randint(-10, 10), 10) for _ in SLOW]
    phase = sum(d * s for d, s in zip(direction, SLOW)) - Q(draw.randint(-5, 5), 10)
    width = Q(Fraction(10.0 ** draw.uniform(-3, -1.5)))
    found = judge({y: -(1 - Q(11, 10) / (1 + (phase / width) ** 2)) * y}, SLOW)
    assert found.kind is Kind.LOST or "not excluded" in found.evidence
    if found.exclusion is not None:
        assert found.exclusion.tried <= LONGER * MOST
        assert 0.0 < found.exclusion.share <= 1.0


@pytest.mark.exhaustive
@pytest.mark.parametrize("seed", range(6))
def test_a_gap_that_dips_between_samples_is_measured_there(seed: int) -> None:
    draw = random.Random(seed)
    place, width = Q(draw.randint(-900, 900), 1000), Q(1, draw.choice([2000, 10**4, 10**5]))
    found = judge({y: -(1 - Q(9, 10) / (1 + ((x - place) / width) ** 2)) * y})
    assert found.kind is Kind.ATTRACTING
    assert found.gap == pytest.approx(0.1, rel=1e-5)
    assert found.exclusion is not None
    assert found.exclusion.is_complete


def hole() -> sp.Expr:
    """Negative within 0.0003 of 0.3086, between two samples."""
    return 1 - Q(11, 10) / (1 + ((x - Q(3086, 10000)) * 1000) ** 2)


def test_a_hole_in_the_branch_between_samples_is_found() -> None:
    found = judge({y: sp.sqrt(hole()) - y})
    assert found.kind is Kind.LOST
    assert "graph" in [condition.name for condition in found.conditions if not condition.holds]


# To give a sheet up is slow: a minute.
@pytest.mark.exhaustive
def test_a_hole_in_an_implicit_branch_between_samples_is_found() -> None:
    found = judge({y: hole() - y**2}, through={"x": -1.0, "y": 1.0})
    assert found.kind is Kind.LOST


@pytest.mark.exhaustive
@pytest.mark.parametrize("how", ["through", "bounds"])
def test_a_dip_of_an_implicit_branch_is_found(how: str) -> None:
    region = {"x": (-1, 1)} | ({"y": (0.5, 1.5)} if how == "bounds" else {})
    found = judge(
        {y: (x / 10 + y - y**3) * hole()},
        through={"x": -1.0, "y": 1.0} if how == "through" else None,
        region=region,
    )
    assert not found.branch.is_explicit
    assert found.kind is Kind.LOST
    assert sorted(loss.point["x"] for loss in found.losses) == pytest.approx(
        [0.3086 - 1e-3 * 0.1**0.5, 0.3086 + 1e-3 * 0.1**0.5], abs=1e-8
    )


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", gsp.models.names())
def test_built_in_scenes_raise_no_alarm(name: str) -> None:
    study = study_of(gsp.models.load(name))
    found = study.hyperbolicity
    assert found.losses == ()
    assert found.kind is not Kind.LOST
    assert found.exclusion is not None
    assert found.exclusion.is_complete
    assert found.exclusion.tried <= 16
    assert found.evidence == f"sampled at {found.samples} points"
    assert "leave no loss" in str(found)


def test_enclosures_do_not_depend_on_units() -> None:
    # A reactor's flux, about 1e13 neutrons per square centimetre and second, over xenon's 1e15 per cubic centimetre.
    flux = y * (Q(3, 100) - x * Q(1, 10**17) - y * Q(1, 10**15))
    critical = gsp.solve_critical(gsp.SlowFastSystem(slow={x: 1}, fast={y: flux}, epsilon=eps))
    found = classify(critical.nearest({"x": 1e15, "y": 2e13}), region={"x": (1e14, 2.5e15)})
    assert found.kind is Kind.ATTRACTING
    assert found.gap == pytest.approx(0.005, rel=1e-12)
    assert found.exclusion is not None
    assert found.exclusion.is_complete


@pytest.mark.exhaustive
def test_enclosures_keep_to_the_branch_that_was_sampled() -> None:
    # The branches y = 0, 2 x/3 and x come near one another at the lower end.
    system = gsp.SlowFastSystem(slow={x: 1}, fast={y: y * (x - y) * (2 * x - 3 * y)}, epsilon=eps)
    (branch,) = (b for b in gsp.solve_critical(system).branches if b.points(3.0) == pytest.approx(2.0))
    found = classify(branch, region={"x": (0.3, 1.6)})
    assert found.kind is Kind.ATTRACTING
    assert found.exclusion is not None
    assert found.exclusion.is_complete
    assert gsp.certify(branch, region={"x": (0.3, 1.6)}).verdict == "proved"


def test_what_is_left_of_the_whole_region_is_called_so() -> None:
    left = ({"x": (0.0, 1.0)},)
    assert str(Exclusion(9, left, 1.0)).endswith("not excluded over the whole region, x in [0, 1]")
    assert str(Exclusion(9, left, 0.25)).endswith("over a share of 0.25 of the region, x in [0, 1]")


def test_functions_without_an_enclosure_are_told() -> None:
    found = judge({y: -(2 + sp.erf(x)) * y})
    assert found.kind is Kind.ATTRACTING
    assert found.holds
    assert (
        found.evidence
        == "sampled at 257 points; between them nothing is excluded: erf has no enclosure over balls"
    )


def test_a_kink_is_told_in_the_words_of_the_model_and_not_of_its_derivative() -> None:
    found = judge({y: -(2 + sp.Min(x, 3)) * y})
    assert found.evidence.endswith("a function with a kink or a jump has no enclosure over balls")
    with pytest.raises(UnsupportedFunctionError, match="abs, sign, min or max among the rates") as refused:
        found.with_proof()
    assert "Heaviside" not in str(refused.value)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", ["chemostat", "enzyme_states", "earthquake"])
def test_the_budget_follows_the_work_that_is_left(name: str) -> None:
    found = study_of(load(FOLDER / f"{name}.toml")).hyperbolicity
    assert found.exclusion is not None
    assert found.exclusion.is_complete
    assert 128 < found.exclusion.tried <= LONGER * MOST
    assert found.holds


@pytest.mark.parametrize(("rate", "done"), [(x**2 - Q(3, 5) * x + Q(9, 100) + Q(1, 100), True), (y**2, False)])
def test_a_budget_grows_while_that_decides_something(rate: sp.Expr, done: bool) -> None:
    # The square (x - 3/10)^2 written out is wide over a box; with y^2 the derivative is 0 all along y = 0.
    equations = EnclosedEquations((x,), (y,), (-rate * y,))
    with precision(balls.PRECISION):
        fixed = cover(equations, ((0.0, 1.0),), np.zeros(1), most_boxes=16)
        longer = cover(equations, ((0.0, 1.0),), np.zeros(1), most_boxes=16, at_most=128)
    assert (fixed.tried, fixed.exhausted) == (16, True)
    assert longer.exhausted is not done
    assert (16 < longer.tried <= 128) is done
    assert (not longer.undecided) is done


@pytest.mark.exhaustive
def test_a_discriminant_that_vanishes_nowhere_leaves_no_loss_where_boxes_are_too_few() -> None:
    # Binding with a small dissociation constant k: the gap is sqrt(4 k u) along u = v, and far larger beside it.
    v, k = sp.Symbol("v"), Q(1, 500)
    system = gsp.SlowFastSystem(slow={u: -u, v: -v}, fast={y: k * (u - y) - y * (v - u + y)}, epsilon=eps)
    branch = gsp.solve_critical(system).nearest({"u": 1, "v": 60, "y": 1})
    box = {"u": (1, 60), "v": (1, 60)}
    found = classify(branch, region=box)
    assert found.exclusion is not None
    assert found.exclusion.is_complete
    assert found.exclusion.by_discriminant
    assert found.holds
    assert "nothing bounds the gap" in found.evidence
    # Where it vanishes, on the region's edge, a loss stays open or is found.
    assert not classify(branch, region={"u": (0, 60), "v": (-k, 60)}).holds


@pytest.mark.parametrize("power", [sp.Rational(5, 2), sp.Rational(1, 2)])
def test_a_share_below_rounding_of_the_region_is_no_finding_and_is_not_sought(power: sp.Rational) -> None:
    # Balls about 0 hold negative numbers, of which roots are not real: no box at 0 is ever proved.
    found = judge({y: x**power - y}, region={"x": (0, 1)})
    assert found.kind is Kind.ATTRACTING
    assert found.exclusion is not None
    assert (found.exclusion.left, found.exclusion.share) == ((), 0.0)
    # Two boxes for each of the 52 halvings.
    assert found.exclusion.tried <= 2 * 53


@pytest.mark.exhaustive
def test_boxes_are_cut_across_the_variable_of_a_root_alone() -> None:
    # Where D_y F is constant the branch's slope tells; halving the other side as well squares the boxes.
    one = judge({y: sp.sqrt(x) - y}, region={"x": (0, 1)}).exclusion
    two = judge({y: sp.sqrt(x) - y}, (x, u), region={"x": (0, 1), "u": (0, 1)}).exclusion
    assert one is not None
    assert two is not None
    assert one.tried == two.tried
    assert not two.left


def test_what_is_left_far_from_the_origin_is_told_so_that_its_ends_are_told_apart() -> None:
    """It was told as "t in [1e+06, 1e+06]"."""
    left = ({"t": (1000000.25, 1000000.3125)},)
    found = Exclusion(left=left, share=0.01, gap=0.0, tried=4, reason="")
    assert "t in [1000000.25, 1000000.3125]" in str(found)
