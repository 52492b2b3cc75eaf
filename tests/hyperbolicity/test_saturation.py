"""Where the sheet of a switch ends: folds of the fields of both sides, two-folds, and the onset of slip."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from gsp.analysis.fold_surroundings import never_folds, not_followed, switch_ends
from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.critical.critical_manifold import solve_critical
from gsp.critical.loss_kind import LossKind
from gsp.hyperbolicity.hyperbolicity import Hyperbolicity, classify
from gsp.scenes.study import study
from gsp.sliding.law import W
from gsp.sliding.piecewise_field import switching
from gsp.splitting.splitting import split
from gsp.systems.system import SlowFastSystem
from tests.cases import thinned
from tests.mechanics.test_dry_friction import sleigh
from tests.report.test_no_slip import BEGIN

x, y, z, v, epsilon = sp.symbols("x y z v epsilon")
clipped = sp.Max(-1, sp.Min(1, W))
QUINTIC = (15 * clipped - 10 * clipped**3 + 3 * clipped**5) / 8
SEXTIC = (693 * clipped - 1155 * clipped**3 + 1386 * clipped**5 - 990 * clipped**7 + 385 * clipped**9) / 256
SEXTIC -= 63 * clipped**11 / 256
STRIBECK = W / sp.sqrt(1 + W**2) + W / (1 + W**2)
LINE = {"x": (-0.5, 0.5), "v": (-3, 3)}
SHEET = {**LINE, "z": (-0.5, 0.5)}


def verdict(plus, minus, phi, region=LINE, rates=(1, 1)) -> Hyperbolicity:
    """Of the field that is (1, .., plus) where y > 0 and (1, .., minus) where y < 0."""
    slow = [s for s in (x, z) if s.name in region]
    above, below = (dict.fromkeys(slow, rate) | {y: e} for rate, e in zip(rates, (plus, minus)))
    system = split(switching(above, minus=below, surface=y, phi=phi, epsilon=epsilon)).system
    assert system is not None
    return classify(solve_critical(system).branches[0], region=region)


@pytest.mark.parametrize(
    ("phi", "end", "exponent"),
    thinned(
        [
            ("linear", 1, 1),
            ("cubic", 1, Fraction(2, 3)),
            (QUINTIC, 1, Fraction(3, 5)),
            (SEXTIC, 1, Fraction(6, 11)),
            (W / (1 + W**4) ** sp.Rational(1, 4), np.inf, Fraction(4, 9)),
            ("algebraic", np.inf, Fraction(2, 5)),
            ("atan", np.inf, Fraction(1, 3)),
            ("tanh", np.inf, None),
        ],
        8,
    ),
)
def test_the_end_of_sliding_is_a_visible_fold_with_the_power_of_its_law(phi, end, exponent) -> None:
    """X+ = (1, x): the exponents are those that runs of the smooth field show (tests/sliding/test_sliding_exit.py)."""
    (loss,) = verdict(x, 1, phi).losses
    assert loss.kind is LossKind.VISIBLE_FOLD
    assert loss.point == pytest.approx({"x": 0.0, "v": end}, abs=1e-9)
    assert (loss.coefficients["beta"], loss.coefficients["gamma"]) == pytest.approx((1.0, 1.0))
    assert not loss.may_reduce
    if exponent is None:
        assert "n" not in loss.coefficients
        assert "by no power of epsilon" in loss.consequence
    else:
        n = int(loss.coefficients["n"])
        assert Fraction(n, 2 * n - 1) == exponent
        assert f"epsilon^({exponent})" in loss.consequence


@pytest.mark.exhaustive
def test_the_other_side_and_other_sizes() -> None:
    """X- = (3, -5 x) is tangent from below, and bends away."""
    (loss,) = verdict(-2, -5 * x, "cubic", rates=(1, 3)).losses
    assert (loss.kind, loss.point["v"]) == (LossKind.VISIBLE_FOLD, -1.0)
    assert (loss.coefficients["beta"], loss.coefficients["gamma"]) == pytest.approx((15.0, 2.0))


@pytest.mark.exhaustive
@pytest.mark.parametrize("phi", ["cubic", "tanh"])
def test_a_field_that_bends_back_has_an_invisible_fold(phi) -> None:
    (loss,) = verdict(-x, 1, phi).losses
    assert loss.kind is LossKind.INVISIBLE_FOLD
    assert "begin to slide" in loss.consequence


@pytest.mark.exhaustive
def test_a_law_that_overshoots_lets_go_at_its_maximum() -> None:
    """phi' = 0 at sqrt(3), where phi = 1.299: the fold of M0 is the onset of slip, with the passage of a fold."""
    (loss,) = verdict(x, 1, STRIBECK).losses
    assert loss.kind is LossKind.SLIP_ONSET
    assert loss.point["v"] == pytest.approx(np.sqrt(3.0), abs=1e-8)
    assert loss.weights == (1, 2, 3)
    assert "delay" in loss.coefficients


def test_folds_of_continuation_have_the_same_names() -> None:
    system = split(switching({x: 1, y: x}, minus={x: 1, y: 1}, surface=y, phi=STRIBECK, epsilon=epsilon)).system
    assert system is not None
    curve = continue_critical(system, start={"x": -0.2, "v": 0.7}, bounds={"x": (-0.5, 0.5), "v": (-1, 4)})
    assert [point.kind for point in curve.special] == [LossKind.SLIP_ONSET]
    assert all(point.kind.is_fold for point in curve.special)


def test_over_two_slow_variables_there_are_curves_of_folds_and_the_two_fold_where_they_meet() -> None:
    """Y+ = x and Y- = x/5 - z."""
    found = verdict(x, x / 5 - z, "cubic", region=SHEET, rates=(1, -1)).losses
    kinds = {loss.kind for loss in found}
    assert LossKind.TWO_FOLD in kinds
    assert kinds <= {LossKind.TWO_FOLD, LossKind.VISIBLE_FOLD, LossKind.INVISIBLE_FOLD}
    for loss in found:
        place = loss.point
        rates = (place["x"], place["x"] / 5 - place["z"])
        assert min(map(abs, rates)) < 1e-9
        if loss.kind is LossKind.TWO_FOLD:
            assert max(map(abs, rates)) < 1e-9


@pytest.mark.exhaustive
def test_two_fields_that_are_tangent_at_once() -> None:
    (loss,) = verdict(x, -x, "linear").losses
    assert loss.kind is LossKind.TWO_FOLD
    assert loss.point["x"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.exhaustive
def test_a_fold_of_what_does_not_saturate_stays_one() -> None:
    system = SlowFastSystem(slow={x: 1}, fast={v: x + v - v**3 / 3}, epsilon=epsilon)
    region = {"x": (-1, 1), "v": (-3, 3)}
    branch = solve_critical(system).nearest({"x": 0.0, "v": -1.7})
    (loss,) = classify(branch, region=region).losses
    assert loss.kind is LossKind.FOLD


@pytest.mark.exhaustive
def test_where_a_blade_lets_go_is_a_fold_also_on_the_edge_of_the_region() -> None:
    """|v omega| = mu N (I + m a^2)/(m I) = 0.936 cuts a corner off the region."""
    branch = study(
        sleigh().scene(start=BEGIN, region={"v": (-2, 2), "omega": (0, 1)}, span=(0, 1), epsilon=0.01)
    ).branch
    found = classify(branch, region={"v": (-1.6, 0.5), "omega": (0.2, 0.62)})
    assert {loss.kind for loss in found.losses} == {LossKind.VISIBLE_FOLD}
    for loss in found.losses:
        assert loss.point["v"] * loss.point["omega"] == pytest.approx(-0.936, abs=1e-9)
        assert loss.coefficients["n"] == -2.0


def test_next_to_a_pole_in_the_formula_of_a_sheet_that_ended_before_it_is_none_of_the_sheet() -> None:
    """v = atanh((1 - x)/(x - 3)) has its end at x = 2, and no value around x = 3."""
    (loss,) = verdict(x - 2, 1, "tanh", region={"x": (0.2, 4), "v": (-3, 3)}).losses
    assert (loss.kind, loss.point["x"]) == (LossKind.VISIBLE_FOLD, pytest.approx(2.0))


@pytest.mark.exhaustive
def test_a_root_of_what_is_positive_is_no_switching_surface() -> None:
    assert not verdict(x, 1, "algebraic", region={"x": (-0.5, -0.1), "v": (-3, 3)}).notes


@pytest.mark.exhaustive
@pytest.mark.parametrize(("law", "n"), [("cubic", 2.0), ("coulomb", -2.0), ("tanh", None)])
def test_a_scene_with_contacts_calls_the_end_of_their_cone_so(law, n) -> None:
    """As `no_slip` and `run` do."""
    blade = sleigh(law)
    scene = blade.scene(
        start=BEGIN, region={"v": (-1.6, -1.2), "omega": (0.3, 0.75)}, span=(0, 1), epsilon=0.01
    )
    losses = study(scene).hyperbolicity.losses
    assert LossKind.CONE_END in {loss.kind for loss in losses}
    assert {loss.coefficients.get("n") for loss in losses} == {n}
    assert blade.no_slip(start=BEGIN, span=(0, 8)).loss is LossKind.CONE_END
    assert blade.run(start=BEGIN, span=(0, 4)).pieces[0].loss is LossKind.CONE_END
    assert [end.kind for end in switch_ends(study(scene))] == [loss.kind for loss in losses]
    assert not_followed(study(scene)) is None or never_folds(study(scene).branch)
